"""The pictures of a run and of a study, all drawn without a display (matplotlib's Agg)."""

from emclutch.results.axial_picture import axial_picture
from emclutch.results.grains_picture import grains_picture
from emclutch.results.profile_picture import profile_picture
from emclutch.results.section_picture import section_picture
from emclutch.results.speed_picture import speed_picture, torque_speed_picture
from emclutch.results.study_pictures import work_precision_picture
from emclutch.results.torque_curve_pictures import torque_against_current_picture, torque_against_speed_picture
from emclutch.results.torque_picture import torque_picture

__all__ = [
    "axial_picture",
    "grains_picture",
    "profile_picture",
    "section_picture",
    "speed_picture",
    "torque_against_current_picture",
    "torque_against_speed_picture",
    "torque_picture",
    "torque_speed_picture",
    "work_precision_picture",
]
