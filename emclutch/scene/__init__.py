"""The scene: what a TOML file may say about a device, its grains and its motion, as frozen models in SI."""

from emclutch.scene.coil import Coil
from emclutch.scene.contact import Contact
from emclutch.scene.effects import Dipoles, Effects, Gravity
from emclutch.scene.field_source import CoilField, UniformField
from emclutch.scene.geometry import BoxGeometry, ClutchGeometry, DrumGeometry, ShearCellGeometry
from emclutch.scene.grains import Particles
from emclutch.scene.model import Header, Scene
from emclutch.scene.motion import FreeShaft, Motion, ShaftMotion
from emclutch.scene.time_table import CurrentTable, SpeedTable, TimeTable, largest, points_of
from emclutch.scene.timing import Accuracy, Output, TimeSpan

__all__ = [
    "Accuracy", "BoxGeometry", "ClutchGeometry", "Coil", "CoilField", "Contact", "CurrentTable", "Dipoles",
    "DrumGeometry", "Effects", "FreeShaft", "Gravity", "Header", "Motion", "Output", "Particles", "Scene",
    "ShaftMotion", "ShearCellGeometry", "SpeedTable", "TimeSpan", "TimeTable", "UniformField", "largest",
    "points_of",
]  # fmt: skip
