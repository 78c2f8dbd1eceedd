"""The pictures of a run and of a study, all drawn without a display (matplotlib's Agg)."""

from emclutch.results.pictures.axial import axial_picture
from emclutch.results.pictures.current_ramp import current_ramp_picture
from emclutch.results.pictures.grains import grains_picture
from emclutch.results.pictures.profile import profile_picture
from emclutch.results.pictures.section import section_picture
from emclutch.results.pictures.sheared_box import sheared_box_picture, stress_picture
from emclutch.results.pictures.speeds import speed_picture, torque_speed_picture
from emclutch.results.pictures.torque import torque_picture
from emclutch.results.pictures.torque_curves import (
    torque_against_current_picture,
    torque_against_grain_size_picture,
    torque_against_speed_picture,
)
from emclutch.results.pictures.wall_pressure import wall_pressure_picture

__all__ = [
    "axial_picture",
    "current_ramp_picture",
    "grains_picture",
    "profile_picture",
    "section_picture",
    "sheared_box_picture",
    "speed_picture",
    "stress_picture",
    "torque_against_current_picture",
    "torque_against_grain_size_picture",
    "torque_against_speed_picture",
    "torque_picture",
    "torque_speed_picture",
    "wall_pressure_picture",
]
