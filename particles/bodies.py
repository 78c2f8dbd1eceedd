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
from dataclasses import dataclass

from geometry.time_profile import TimeProfile

ZERO = TimeProfile.constant(0.0)
"""No load torque, no speed."""


@dataclass(frozen=True, slots=True)
class FreeShaft:
    """A shaft that torques move; all of them belong to the whole device, also where only a sector is simulated.

    Attributes
    ----------
    inertia : float
        [kg m^2]
    drive_torque : float
        Of the drive at rest [N m].
    load_torque : TimeProfile
        Brake-like load [N m].
    drive_slope : float
        What the drive loses for each rad/s [N m s]: stall torque over no-load speed of a motor.
    switched_on : float
        When the drive begins [s].
    """

    inertia: float
    drive_torque: float = 0.0
    load_torque: TimeProfile = ZERO
    drive_slope: float = 0.0
    switched_on: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.inertia < math.inf:
            raise ValueError(f"inertia of a free shaft = {self.inertia:g} kg m^2; allowed: more than 0")
        if not isinstance(self.load_torque, TimeProfile):
            raise TypeError(f"load torque = {self.load_torque!r}: give a TimeProfile, e.g. TimeProfile.constant(0.5)")
        for load in self.load_torque.values:
            if not 0.0 <= load < math.inf:
                raise ValueError(
                    f"load torque = {load:g} N m; allowed: 0 or more (it opposes the rotation); "
                    "use drive_torque for a torque with a sign"
                )
        if not math.isfinite(self.drive_torque):
            raise ValueError(f"drive torque = {self.drive_torque:g} N m must be finite")
        if not 0.0 <= self.drive_slope < math.inf:
            raise ValueError(f"drive slope = {self.drive_slope:g} N m s; allowed: 0 or more")


@dataclass(slots=True)
class Body:
    """A rigid part of the machine that turns about z.

    Attributes
    ----------
    name : str
        The name that walls refer to.
    motion : TimeProfile or FreeShaft
        The speed [rad/s] at which it is driven, whatever torque that takes, or what moves it; at rest by default.
    angle, speed : float
        Current angle [rad] and speed [rad/s]; a prescribed body takes its speed from the profile.
    external_torque : float
        A torque [N m] on the whole device's free shaft, held constant during a call of `DEM.run`.
    """

    name: str
    motion: TimeProfile | FreeShaft = ZERO
    angle: float = 0.0
    speed: float = 0.0
    external_torque: float = 0.0

    def __post_init__(self) -> None:
        if isinstance(self.motion, TimeProfile):
            self.speed = self.motion(0.0)

    @property
    def is_free(self) -> bool:
        """True if torques move it."""
        return isinstance(self.motion, FreeShaft)

    @property
    def can_turn(self) -> bool:
        """True if it ever turns."""
        return not isinstance(self.motion, TimeProfile) or any(w != 0.0 for w in self.motion.values)
