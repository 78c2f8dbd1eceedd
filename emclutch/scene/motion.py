"""[motion.rotor] and [motion.disc]: how the shafts turn."""

from __future__ import annotations

from math import copysign
from typing import Annotated, Self

import numpy as np
from pydantic import Field, model_validator

from emclutch.scene.section import Section, refuse
from emclutch.scene.time_table import LoadProfile, SpeedProfile
from emclutch.scene.units import Inertia, Instant, Quantity, Speed, Torque
from geometry.time_profile import TimeProfile

_StallTorque = Annotated[float, Quantity("a torque", "N*m", "1500 N m", 0.0, 1e7, open_minimum=True)]

_Drag = Annotated[float, Quantity("a torque", "N*m", "0.1 N m", 0.0, 1e7)]


class MotorSection(Section):
    """A motor whose torque falls linearly with the speed, as that of a DC machine at a constant voltage does.

    Above its no-load speed it brakes.
    """

    stall_torque: _StallTorque = Field(description="torque at rest, about +z where no_load_speed is positive")
    no_load_speed: Speed = Field(description="speed at which it gives no torque; its sign is the sense of rotation")
    switched_on: Instant = Field(default=0.0, description="instant from which it gives torque")

    @model_validator(mode="after")
    def _turns(self) -> Self:
        if self.no_load_speed == 0.0:
            raise refuse("is not a speed; give that of the idling motor, e.g. '1500 rpm'", key="no_load_speed")
        return self

    @property
    def signed_stall_torque(self) -> float:
        """Torque at rest about +z [N m]."""
        return self.stall_torque if self.no_load_speed > 0.0 else -self.stall_torque

    @property
    def slope(self) -> float:
        """Torque lost per speed [N m s], positive."""
        return self.stall_torque / abs(self.no_load_speed)


class FreeShaftSection(Section):
    """A shaft that its torques accelerate; the load opposes rotation and holds at rest, as a brake does."""

    inertia: Inertia = Field(description="moment of inertia of shaft and load about the axis")
    load_torque: LoadProfile = Field(
        default=0.0,
        validate_default=True,
        description="opposes rotation, >= 0; one value or a table in time (an overload switched on later)",
    )
    drive_torque: Torque = Field(default=0.0, description="positive about +z")
    motor: MotorSection | None = Field(
        default=None, description="a motor with a linear characteristic drives the shaft"
    )
    initial_speed: Speed = Field(default=0.0, description="speed at the start")

    @model_validator(mode="after")
    def _has_one_drive(self) -> Self:
        if self.motor is not None and self.drive_torque != 0.0:
            raise refuse("conflicts with motor; keep one of them", key="drive_torque")
        return self

    @property
    def largest_speed(self) -> float:
        """Largest speed [rad/s] that follows from the entries alone: at the start, or of the idling motor."""
        return max(abs(self.initial_speed), 0.0 if self.motor is None else abs(self.motor.no_load_speed))


class ShaftMotionSection(Section):
    """A prescribed speed, or a free shaft."""

    speed: SpeedProfile | None = Field(default=None, description="speed about +z, one value or a table in time")
    free: FreeShaftSection | None = Field(default=None, description="let torques drive the shaft instead")

    @model_validator(mode="after")
    def _moves_one_way(self) -> Self:
        if self.speed is not None and self.free is not None:
            raise refuse("conflicts with free; keep the speed, or let the shaft be free", key="speed")
        if self.speed is None and self.free is None:
            raise refuse(
                "is missing; give speed, e.g. '100 rpm' (0 holds the shaft), or free = {inertia = ...}",
                key="speed",
            )
        return self

    @property
    def largest_speed(self) -> float:
        """Largest speed [rad/s] that follows from the entries alone, driven or free."""
        if self.free is not None:
            return self.free.largest_speed
        assert self.speed is not None  # by the model's rule
        return self.speed.largest

    @property
    def initial_speed(self) -> float:
        """Speed [rad/s] at time 0."""
        if self.free is not None:
            return self.free.initial_speed
        assert self.speed is not None  # by the model's rule
        return self.speed(0.0)


HELD = ShaftMotionSection(speed=TimeProfile.constant(0.0))


class MotionSection(Section):
    """Motion of both shafts; a shaft without a table is held."""

    rotor: ShaftMotionSection = HELD
    disc: ShaftMotionSection = HELD
    drag_torque: _Drag = Field(
        default=0.0,
        description="drag of seals and bearings between both shafts, which opposes their slip; added to the result",
    )

    @model_validator(mode="after")
    def _drag_acts_between_driven_shafts(self) -> Self:
        if self.drag_torque > 0.0 and (self.rotor.free is not None or self.disc.free is not None):
            raise refuse("does not act on a free shaft; add it to free.load_torque", key="drag_torque")
        return self

    @property
    def drag_in_words(self) -> str:
        """Say that an expected torque, which is that of the powder, is without the drag; empty where there is none."""
        text = f"motion.drag_torque = {self.drag_torque:.4g} N m is not in the expected torque"
        return f"{text}. Subtract it from torques measured on a shaft." if self.drag_torque else ""

    @property
    def largest_slip(self) -> float:
        """Largest difference [rad/s] of both speeds; with a free shaft the larger of both."""
        rotor, disc = self._speeds_of_largest_slip
        if self.rotor.speed is None or self.disc.speed is None:
            return max(rotor, disc)
        return abs(rotor - disc)

    @property
    def _speeds_of_largest_slip(self) -> tuple[float, float]:
        """Speeds [rad/s] of rotor and disc when their slip is largest; with a free shaft the largest of each."""
        if self.rotor.speed is None or self.disc.speed is None:
            return self.rotor.largest_speed, self.disc.largest_speed
        times = np.array(sorted({*self.rotor.speed.times, *self.disc.speed.times}))
        rotor, disc = self.rotor.speed.at(times), self.disc.speed.at(times)
        at = int(np.argmax(np.abs(rotor - disc)))
        return float(rotor[at]), float(disc[at])

    def speeds_at_slip(self, slip: float) -> tuple[float, float]:
        """Speeds [rad/s] of rotor and disc when the slip is `slip` [rad/s], >= 0; at the largest slip, the scene's own.

        A body at rest stays at rest, and the other one turns with the slip. Bodies that turn in opposite senses keep
        the ratio of their speeds. Of two that turn in one sense the faster one keeps its speed and the slower one loses
        the slip, until it stands; from there on the faster one turns with the slip. Where neither turns, both rest.
        """
        rotor, disc = self._speeds_of_largest_slip
        if rotor * disc > 0.0:
            fast, sense = max(abs(rotor), abs(disc), slip), copysign(1.0, rotor)
            slow = sense * (fast - slip)
            return (sense * fast, slow) if abs(rotor) >= abs(disc) else (slow, sense * fast)
        own = abs(rotor - disc)
        return (rotor * slip / own, disc * slip / own) if own > 0.0 else (0.0, 0.0)
