"""Bodies that walls belong to: rotor, disc, housing. Each turns about z, driven or free.

A free shaft obeys J domega/dt = T_contact + T_drive + T_external - T_load, integrated by the same leapfrog
as the grains. The load is dry friction: it opposes the rotation, never reverses it, and holds the shaft at
rest while the other torques stay below it. One step is therefore a shrinkage, exact for a constant load:

    omega* = omega + dt/J (T_contact + T_drive + T_external)
    omega  = sign(omega*) max(0, |omega*| - dt/J T_load).
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
    """A shaft with ``inertia`` [kg m^2], a constant ``drive_torque`` [N m] and a brake-like ``load_torque``
    [N m].

    All three belong to the whole device, also where only a sector of it is simulated.
    """

    inertia: float
    drive_torque: float = 0.0
    load_torque: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.inertia < math.inf:
            raise ValueError(f"inertia of a free shaft = {self.inertia:g} kg m^2; allowed: more than 0")
        if not 0.0 <= self.load_torque < math.inf:
            raise ValueError(
                f"load torque = {self.load_torque:g} N m; allowed: 0 or more (it opposes the rotation); "
                "use drive_torque for a torque with a sign"
            )
        if not math.isfinite(self.drive_torque):
            raise ValueError(f"drive torque = {self.drive_torque:g} N m must be finite")


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
