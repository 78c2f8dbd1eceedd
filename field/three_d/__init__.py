"""Magnetostatics in 3D, for devices with slots or teeth: scalar potential, forces, H and grad H at grains."""

from .body_force import BodyForce
from .current_source import FlatCoil, Source, UniformSource
from .field_3d import Field3D
from .sampler_3d import Sampler3D
from .scalar_potential import Problem3D
from .sector import SectorFold
from .tetrahedron_locator import PointOutside3D

__all__ = [
    "BodyForce",
    "Field3D",
    "FlatCoil",
    "PointOutside3D",
    "Problem3D",
    "Sampler3D",
    "SectorFold",
    "Source",
    "UniformSource",
]
