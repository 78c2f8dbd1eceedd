"""The scene as a whole. A scene file is this model in TOML."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated

from pydantic import Field, StringConstraints

from emclutch.scene.coil import Coil
from emclutch.scene.contact import Contact
from emclutch.scene.effects import Effects
from emclutch.scene.field_source import FieldSource
from emclutch.scene.geometry import CadGeometry, ClutchGeometry, Geometry
from emclutch.scene.grains import Particles
from emclutch.scene.materials import Material
from emclutch.scene.motion import Motion
from emclutch.scene.section import Section, Whole
from emclutch.scene.surfaces import Surface
from emclutch.scene.timing import Accuracy, Output, TimeSpan

if TYPE_CHECKING:
    from geometry import Box, Clutch, ShearCell
    from geometry.cad_shape import CadShape
    from geometry.centrifugal import CentrifugalClutch

_Name = Annotated[str, StringConstraints(pattern=r"^[A-Za-z][A-Za-z0-9_]*$")]


class Header(Section):
    """[scene]: what the scene is."""

    title: str = Field(min_length=1, description="a line of text")
    description: str = Field(default="", description="what is asked, and what to expect")
    seed: Annotated[int, Whole(0, 2**63 - 1, "1")] = Field(default=1, description="of the packing's random numbers")


class Scene(Section):
    """A scene of an electromagnetic particle clutch. Quantities: text with a unit, or a bare SI number."""

    scene: Header
    geometry: Geometry
    materials: dict[_Name, Material] = Field(default={}, description="own materials by name")
    surfaces: dict[_Name, Surface] = Field(default={}, description="surfaces from files that grains touch as well")
    coil: Coil | None = None
    field: FieldSource | None = None
    particles: Particles
    contact: Contact = Contact()
    motion: Motion = Motion()
    effects: Effects = Effects()
    time: TimeSpan
    accuracy: Accuracy = Accuracy()
    output: Output = Output()

    def shape(self) -> Clutch | CadShape | ShearCell | CentrifugalClutch | Box:
        """Return the device's shape, for meshing, walls and volumes."""
        if isinstance(self.geometry, (ClutchGeometry, CadGeometry)):
            return self.geometry.shape(self.materials)
        return self.geometry.shape()
