"""Bodies that walls belong to: rotor, disc, housing. Each turns about z, driven or free.

A free shaft obeys J domega/dt = T_contact + T_drive + T_external - T_load, integrated by the same leapfrog as the
grains. The drive falls with speed, T_drive = T_0 - c omega, and is taken at the mean speed of the step (trapezoidal
rule, stable for any c). The load is dry friction: it opposes the rotation, never reverses it, and holds the shaft at
rest while the other torques stay below it. One step is therefore a shrinkage, exact for a constant load: with
h = dt/J, s = c h/2,

    omega* = (omega (1 - s) + h (T_contact + T_0 + T_external))/(1 + s)
    omega' = sign(omega*) max(0, |omega*| - h T_load/(1 + s)).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from itertools import pairwise

import numpy as np


@dataclass(frozen=True, slots=True)
class PrescribedSpeed:
    """Speed [rad/s] linear between ``times`` [s], held before the first and after the last."""

    times: tuple[float, ...]
    speeds: tuple[float, ...]

    def __post_init__(self) -> None:
        times = tuple(float(t) for t in self.times)
        speeds = tuple(float(w) for w in self.speeds)
        if not times or len(times) != len(speeds):
            raise ValueError(f"a speed profile has {len(times)} times but {len(speeds)} speeds; give as many of each")
        if not all(map(math.isfinite, times + speeds)) or any(b <= a for a, b in pairwise(times)):
            raise ValueError(f"times of a speed profile must be finite and increase, got {times} s")
        object.__setattr__(self, "times", times)
        object.__setattr__(self, "speeds", speeds)

    @classmethod
    def constant(cls, speed: float) -> PrescribedSpeed:
        """One speed [rad/s] for ever."""
        return cls((0.0,), (speed,))

    def at(self, time: float | np.ndarray) -> np.ndarray:
        """Speed [rad/s] at ``time`` [s]."""
        return np.asarray(np.interp(time, self.times, self.speeds))


@dataclass(frozen=True, slots=True)
class FreeShaft:
    """A shaft that torques move; all of them belong to the whole device, also where only a sector is simulated.

    Attributes
    ----------
    inertia : float
        [kg m^2]
    drive_torque : float
        Of the drive at rest [N m].
    load_torque : float or (times, torques)
        Brake-like load [N m], constant or linear between times [s].
    drive_slope : float
        What the drive loses for each rad/s [N m s]: stall torque over no-load speed of a motor.
    switched_on : float
        When the drive begins [s].
    """

    inertia: float
    drive_torque: float = 0.0
    load_torque: float | tuple[tuple[float, ...], tuple[float, ...]] = 0.0
    drive_slope: float = 0.0
    switched_on: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.inertia < math.inf:
            raise ValueError(f"inertia of a free shaft = {self.inertia:g} kg m^2; allowed: more than 0")
        for load in self._load_points[1]:
            if not 0.0 <= load < math.inf:
                raise ValueError(
                    f"load torque = {load:g} N m; allowed: 0 or more (it opposes the rotation); "
                    "use drive_torque for a torque with a sign"
                )
        if not math.isfinite(self.drive_torque):
            raise ValueError(f"drive torque = {self.drive_torque:g} N m must be finite")
        if not 0.0 <= self.drive_slope < math.inf:
            raise ValueError(f"drive slope = {self.drive_slope:g} N m s; allowed: 0 or more")
        PrescribedSpeed(*self._load_points)  # times must increase, as many as loads

    @property
    def _load_points(self) -> tuple[tuple[float, ...], tuple[float, ...]]:
        load = self.load_torque
        return load if isinstance(load, tuple) else ((0.0,), (float(load),))

    def load_at(self, time: float | np.ndarray) -> np.ndarray:
        """Load torque [N m] at ``time`` [s]."""
        return np.asarray(np.interp(time, *self._load_points))


@dataclass(slots=True)
class Body:
    """A rigid part of the machine that turns about z.

    Attributes
    ----------
    name : str
        The name that walls refer to.
    motion : PrescribedSpeed or FreeShaft
        What moves it; at rest by default.
    angle, speed : float
        Current angle [rad] and speed [rad/s]; a prescribed body takes its speed from the profile.
    external_torque : float
        A torque [N m] on the whole device's free shaft, held constant during a call of `DEM.run`.
    """

    name: str
    motion: PrescribedSpeed | FreeShaft = field(default_factory=lambda: PrescribedSpeed.constant(0.0))
    angle: float = 0.0
    speed: float = 0.0
    external_torque: float = 0.0

    def __post_init__(self) -> None:
        if isinstance(self.motion, PrescribedSpeed):
            self.speed = float(self.motion.at(0.0))

    @property
    def is_free(self) -> bool:
        """Whether torques move it."""
        return isinstance(self.motion, FreeShaft)

    @property
    def can_turn(self) -> bool:
        """Whether it ever turns."""
        return not isinstance(self.motion, PrescribedSpeed) or any(w != 0.0 for w in self.motion.speeds)
