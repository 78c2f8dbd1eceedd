"""[geometry]: what the device looks like. One model a kind; the shapes are in the package `geometry`."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from emclutch.scene.magnetic_regions import magnetic_regions
from emclutch.scene.section import Choice, Section, Whole, refuse
from emclutch.units import Length, LengthOrNone, number

if TYPE_CHECKING:
    from emclutch.scene.materials import Material
    from geometry.annular_cell import ShearCell
    from geometry.box import Box
    from geometry.cad_meshing import CadSection
    from geometry.cad_shape import CadShape
    from geometry.centrifugal import CentrifugalClutch
    from geometry.clutch import Clutch
    from geometry.section import SectionMesh


NO_MATERIALS: Mapping[str, Material] = MappingProxyType({})


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


class SlotsSection(Section):
    """Equal axial slots around a body, open towards the rim gap, filled flush with a non-magnetic material.

    Grains meet smooth walls; the field is solved in space instead of in the section.
    """

    count: Annotated[int, Whole(2, 500, "24")] = Field(description="slots around the body")
    share: Annotated[float, number("0.5", 0.0, 1.0, above=True)] = Field(
        default=0.5, description="part of the pitch that a slot takes"
    )
    depth: Length = Field(description="radial depth")


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
    disc_slots: SlotsSection | None = Field(default=None, description="slots in the disc's rim")
    rotor_slots: SlotsSection | None = Field(default=None, description="slots in the rotor's poles")
    materials: ClutchMaterials = ClutchMaterials()

    def shape(self, own: Mapping[str, Material] = NO_MATERIALS) -> Clutch:
        """Return the shape for meshing, walls and volumes; `own`: the scene's own materials by name."""
        from geometry.clutch import Clutch  # local: the schema itself needs no shapes
        from geometry.slots import Slots

        given = self.model_dump(exclude={"kind", "materials", "disc_slots", "rotor_slots"}, exclude_none=True)
        disc, rotor = (
            None if section is None else Slots(section.count, section.share, section.depth)
            for section in (self.disc_slots, self.rotor_slots)
        )
        magnetic = magnetic_regions(self.materials.model_dump(), own)
        return Clutch(**given, disc_slots=disc, rotor_slots=rotor, magnetic=magnetic)


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
    steel: bool = Field(default=False, description="the cylinders are of steel: grains see their images in them")

    @property
    def mid_radius(self) -> float:
        """Radius in the middle of the gap [m]."""
        return 0.5 * (self.inner_radius + self.outer_radius)

    def shape(self) -> ShearCell:
        """Return the shape for walls and volumes."""
        from geometry.annular_cell import ShearCell

        return ShearCell(self.inner_radius, self.outer_radius, self.height, self.steel)


class CentrifugalGeometry(Section):
    """A shot clutch: vanes on the input (body `rotor`) throw the grains against the ribbed drum of the output (`disc`).

    Its axis is z; gravity across it, e.g. direction = [0, -1, 0], makes it a horizontal shaft.
    """

    kind: Literal["centrifugal"]
    drum_radius: Length = Field(description="inner radius of the drum")
    width: Length = Field(description="axial distance of the drum's covers")
    hub_radius: Length = Field(description="radius of the hub that carries the vanes")
    vanes: Annotated[int, Whole(1, 60, "6")] = Field(description="straight radial vanes on the hub")
    vane_thickness: Length = Field(description="thickness of a vane")
    tip_clearance: Length = Field(description="radial clearance between the vanes' tips and the ribs")
    side_clearance: Length = Field(description="axial clearance between a vane and the cover, on both sides")
    slots: Annotated[int, Whole(0, 20, "2")] = Field(
        default=0, description="slots in each vane, open at its tip, through which shot slips under overload"
    )
    slot_width: LengthOrNone = Field(default=0.0, description="axial width of a slot")
    slot_depth: LengthOrNone = Field(default=0.0, description="radial depth of a slot, from the tip")
    ribs: Annotated[int, Whole(0, 360, "20")] = Field(default=0, description="ribs along the drum's inner face")
    rib_height: LengthOrNone = Field(default=0.0, description="radial height of a rib")
    rib_width: LengthOrNone = Field(default=0.0, description="tangential width of a rib")

    def shape(self) -> CentrifugalClutch:
        """Return the shape for walls and volumes."""
        from geometry.centrifugal import CentrifugalClutch

        return CentrifugalClutch(**self.model_dump(exclude={"kind"}))


class BoxGeometry(Section):
    """A closed box at rest, x and y centred on the axis, its floor at z = 0."""

    kind: Literal["box"]
    size: tuple[Length, Length, Length] = Field(description="lengths along x, y and z")

    def shape(self) -> Box:
        """Return the shape for walls and volumes."""
        from geometry.box import Box

        return Box(self.size)


_Body = Annotated[str, Choice(("rotor", "disc", "housing"))]


class CadGeometry(Section):
    """A device from a CAD file, its regions by the names of the parts.

    The file holds the faces of the half section (x is the radius, y or z the axis), or solids of revolution. `coil`
    and `powder` are the winding and the space of the grains; what no part fills is air. Parts named disc and
    shaft_out turn with the disc, housing, yoke and coil stand still, all others turn with the rotor.
    """

    kind: Literal["cad"]
    file: str = Field(
        min_length=1,
        description="STEP (or IGES, BREP, trusted .geo in mm), from the scene's folder; names are those of PRODUCT",
    )
    materials: dict[str, str] = Field(description="a material's name for each part but coil and powder")
    names: dict[str, str] = Field(default={}, description="region for a part's name in the file, where they differ")
    bodies: dict[str, _Body] = Field(
        default={},
        description="body that a region turns with; default: by its name, see the text above",
    )
    axis: Annotated[str, Choice(("x", "y", "z"))] = Field(default="z", description="axis of revolution of solids")
    scale: Annotated[float, number("0.001", 1e-9, 1e9)] = Field(default=1.0, description="factor on the file's lengths")
    air_factor: Annotated[float, number("3", 1.5, 20.0)] = Field(default=3.0, description="air box / device size")
    _trust_scripts: bool = PrivateAttr(default=False)  # the caller's word: no scene may give it to itself

    @field_validator("file")
    @classmethod
    def _from_the_scenes_folder(cls, given: str, info: ValidationInfo) -> str:
        """Make the path absolute, so that a resolved scene finds the file from anywhere."""
        return str(((info.context or {}).get("folder", Path()) / given).resolve())

    @model_validator(mode="after")
    def _is_a_device(self, info: ValidationInfo) -> Self:
        """Read the file once, so that what is wrong with it is told with the scene's other faults."""
        self._trust_scripts = bool((info.context or {}).get("trust_scripts", False))
        try:
            self._section()
        except (ValueError, OSError) as error:
            reason = str(error).removeprefix(self.file).lstrip(": ")
            raise refuse(reason.replace("`axis`", "geometry.axis").replace("`scale`", "geometry.scale")
                         .replace("`names`", "geometry.names"), key="file") from None  # fmt: skip
        return self

    def options(self) -> dict[str, Any]:
        """Return what the import needs beside the path; see `geometry.cad_import.imported_section`."""
        return {
            "names": self.names,
            "needed": tuple(dict.fromkeys(("coil", *(self.materials or ())))),
            "known": ("powder", "air"),
            "axis": self.axis,
            "scale": self.scale,
            "trust_scripts": self._trust_scripts,
        }

    def shape(self, own: Mapping[str, Material] = NO_MATERIALS) -> CadShape:
        """Return the shape for walls and volumes; `own`: the scene's own materials by name."""
        from geometry.cad_shape import CadShape

        return CadShape(self._section(), self.bodies, magnetic_regions(self.materials, own))

    def mesh(self, gap_layers: int, size_factor: float, path: Path | None = None) -> SectionMesh:
        """Mesh the section; see `geometry.cad_meshing.mesh_cad`."""
        from geometry.cad_meshing import mesh_cad

        return mesh_cad(
            self.file,
            gap_layers=gap_layers,
            size_factor=size_factor,
            air_factor=self.air_factor,
            out=path,
            **self.options(),
        )

    def _section(self) -> CadSection:
        options = self.options()
        path = Path(self.file)
        changed = path.stat().st_mtime_ns if path.is_file() else 0
        names = tuple(sorted(self.names.items()))
        return _read_section(
            self.file,
            changed,
            names,
            options["needed"],
            options["known"],
            self.axis,
            self.scale,
            self._trust_scripts,
        )


@lru_cache(maxsize=8)
def _read_section(
    file: str,
    changed: int,
    names: tuple[tuple[str, str], ...],
    needed: tuple[str, ...],
    known: tuple[str, ...],
    axis: str,
    scale: float,
    trust_scripts: bool,
) -> CadSection:
    """Read a file once for the many that ask; `changed` is its time, so that a new export is seen."""
    from geometry.cad_meshing import cad_section

    return cad_section(
        file, names=dict(names), needed=needed, known=known, axis=axis, scale=scale, trust_scripts=trust_scripts
    )


Geometry = Annotated[
    ClutchGeometry | DrumGeometry | CentrifugalGeometry | ShearCellGeometry | BoxGeometry | CadGeometry,
    Field(discriminator="kind"),
]
