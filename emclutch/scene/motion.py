"""[motion.rotor] and [motion.disc]: how the shafts turn."""

from __future__ import annotations

from typing import Self

from pydantic import Field, model_validator

from emclutch.scene.section import Section, refuse
from emclutch.scene.time_table import SpeedCourse
from emclutch.units import Inertia, LoadTorque, Speed, Torque


class FreeShaft(Section):
    """A shaft that its torques accelerate; the load opposes rotation and holds at rest, as a brake does."""

    inertia: Inertia = Field(description="moment of inertia of shaft and load about the axis")
    load_torque: LoadTorque = Field(default=0.0, description="opposes rotation, >= 0")
    drive_torque: Torque = Field(default=0.0, description="positive about +z")
    initial_speed: Speed = Field(default=0.0, description="speed at the start")


class ShaftMotion(Section):
    """A prescribed speed, or a free shaft."""

    speed: SpeedCourse | None = Field(default=None, description="speed about +z, one value or a table in time")
    free: FreeShaft | None = Field(default=None, description="let torques drive the shaft instead")

    @model_validator(mode="after")
    def _moves_one_way(self) -> Self:
        if self.speed is not None and self.free is not None:
            raise refuse("stands beside free; keep the speed, or let the shaft be free", key="speed")
        if self.speed is None and self.free is None:
            raise refuse(
                "is missing; give speed, e.g. '100 rpm' (0 holds the shaft), or free = {inertia = ...}",
                key="speed",
            )
        return self


HELD = ShaftMotion(speed=0.0)


class Motion(Section):
    """Both shafts; one that is not named is held."""

    rotor: ShaftMotion = HELD
    disc: ShaftMotion = HELD
