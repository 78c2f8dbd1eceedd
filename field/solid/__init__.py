"""Magnetostatics in space, for devices with slots or teeth: scalar potential, forces, H and grad H at grains."""

from .body_force import BodyForce
from .scalar_potential import SolidProblem
from .sector import SectorFold
from .solid_field import SolidField
from .solid_sampler import SolidSampler
from .source_field import FlatCoil, Source, UniformSource
from .tetrahedron_locator import SolidPointOutside

__all__ = [
    "BodyForce",
    "FlatCoil",
    "SectorFold",
    "SolidField",
    "SolidPointOutside",
    "SolidProblem",
    "SolidSampler",
    "Source",
    "UniformSource",
]
