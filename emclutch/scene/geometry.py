"""[geometry]: what the device looks like. One model a kind; the shapes are in the package `geometry`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Literal

from pydantic import Field

from emclutch.scene.section import Section
from emclutch.units import Length, LengthOrNone, number

if TYPE_CHECKING:
    from geometry.annular_cell import ShearCell
    from geometry.box import Box
    from geometry.clutch import Clutch

PLANNED_KINDS = ("centrifugal", "cad")
NON_MAGNETIC = ("air", "aluminium", "copper", "stainless_304")
"""Built-in materials that carry no flux."""


class ClutchMaterials(Section):
    """[geometry.materials]: a material's name for each region; built in or from [materials.NAME]."""

    housing: str = "steel_1010"
    rotor: str = "steel_1010"
    disc: str = "steel_1010"
    ring: str = "stainless_304"
    cover: str = "steel_1010"
    seal: str = "aluminium"
    shaft: str = "stainless_304"
    coil: str = "copper"


class DrumMaterials(ClutchMaterials):
    """As in the clutch, with covers that carry no flux: it crosses the rim gap twice instead."""

    cover: str = "aluminium"


class ClutchGeometry(Section):
    """A disc in a rotor's cavity, in a housing with a coil; steel covers lead the flux to the faces."""

    kind: Literal["clutch"]
    disc_radius: Length = Field(description="outer radius of the disc")
    disc_thickness: Length = Field(description="axial thickness of the disc")
    gap: Length = Field(description="radial gap between the disc's rim and the rotor")
    face_gap: Length = Field(description="axial gap between each face of the disc and the rotor's cover")
    seal_radius: Length = Field(description="inner radius of the powder's cavity")
    rotor_wall: Length = Field(description="radial thickness of the rotor's shell")
    ring_width: LengthOrNone = Field(description="axial width of the non-magnetic ring in the rotor's shell; 0: none")
    cover_thickness: Length = Field(description="axial thickness of the rotor's covers")
    clearance: Length = Field(description="radial air gap between rotor and housing")
    coil_width: Length = Field(description="axial width of the coil's window")
    coil_height: Length = Field(description="radial height of the coil's window")
    yoke: Length = Field(description="radial thickness of the housing outside the coil")
    shaft_radius: Length = Field(description="radius of both shafts")
    housing_width: Length | None = Field(default=None, description="axial width of the housing; default: the rotor's")
    coil_radius: Length | None = Field(
        default=None, description="inner radius of the coil; default: the housing's bore"
    )
    air_factor: Annotated[float, number("3", 1.5, 20.0)] = Field(default=3.0, description="air box / device size")
    materials: ClutchMaterials = ClutchMaterials()

    def shape(self, cover_magnetic: bool | None = None) -> Clutch:
        """Return the shape for meshing, walls and volumes.

        `cover_magnetic`: the covers mirror dipoles; default: unless their built-in material carries no flux.
        """
        from geometry.clutch import Clutch  # local: the schema itself needs no shapes

        if cover_magnetic is None:
            cover_magnetic = self.materials.cover not in NON_MAGNETIC
        given = self.model_dump(exclude={"kind", "materials"}, exclude_none=True)
        return Clutch(**given, cover_magnetic=cover_magnetic)


class DrumGeometry(ClutchGeometry):
    """The same family with a thick disc and non-magnetic covers: the flux crosses the rim gap twice."""

    kind: Literal["drum"]  # type: ignore[assignment]
    materials: DrumMaterials = DrumMaterials()


class ShearCellGeometry(Section):
    """The annulus between two cylinders: body `disc` inside, `rotor` outside, floor and ceiling at rest."""

    kind: Literal["shear_cell"]
    inner_radius: Length = Field(description="radius of the inner cylinder")
    outer_radius: Length = Field(description="radius of the outer cylinder")
    height: Length = Field(description="axial height")

    @property
    def mid_radius(self) -> float:
        """Radius in the middle of the gap [m]."""
        return 0.5 * (self.inner_radius + self.outer_radius)

    def shape(self) -> ShearCell:
        """Return the shape for walls and volumes."""
        from geometry.annular_cell import ShearCell

        return ShearCell(self.inner_radius, self.outer_radius, self.height)


class BoxGeometry(Section):
    """A closed box at rest, x and y centred on the axis, its floor at z = 0."""

    kind: Literal["box"]
    size: tuple[Length, Length, Length] = Field(description="lengths along x, y and z")

    def shape(self) -> Box:
        """Return the shape for walls and volumes."""
        from geometry.box import Box

        return Box(self.size)


Geometry = Annotated[ClutchGeometry | DrumGeometry | ShearCellGeometry | BoxGeometry, Field(discriminator="kind")]
