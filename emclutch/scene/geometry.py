"""[geometry]: what the device looks like. One model a kind; the shapes are in the package `geometry`."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import Field, PrivateAttr, ValidationInfo, field_validator, model_validator

from emclutch.scene.geometry_section import NO_MATERIALS, GeometrySection
from emclutch.scene.magnetic_regions import magnetic_regions
from emclutch.scene.section import Choice, Section, Whole, refuse
from emclutch.scene.units import Length, LengthOrNone, number

if TYPE_CHECKING:
    from emclutch.scene.materials import Material
    from geometry.annular_cell import ShearCell
    from geometry.box import Box
    from geometry.cad_meshing import CadSection
    from geometry.cad_shape import CadShape
    from geometry.centrifugal import CentrifugalClutch
    from geometry.clutch import Clutch
    from geometry.mesh_3d import Mesh3D
    from geometry.section import SectionMesh


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

    Grains meet smooth walls; the field is solved in 3D instead of in the section.
    """

    count: Annotated[int, Whole(2, 500, "24")] = Field(description="slots around the body")
    share: Annotated[float, number("0.5", 0.0, 1.0, above=True)] = Field(
        default=0.5, description="part of the pitch that a slot takes"
    )
    depth: Length = Field(description="radial depth")


class ClutchGeometry(GeometrySection):
    """A disc in a rotor's cavity, in a housing with a coil; steel covers lead the flux to the faces."""

    has_coil: ClassVar[bool] = True
    has_regions: ClassVar[bool] = True

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

    @property
    def slotted(self) -> dict[str, Any]:
        """Slots of the disc and of the rotor, where they have some."""
        both = {"disc_slots": self.disc_slots, "rotor_slots": self.rotor_slots}
        return {key: slots for key, slots in both.items() if slots is not None}

    @property
    def is_solved_in_3d(self) -> bool:
        """With slots it is no device of revolution."""
        return bool(self.slotted)

    def region_materials(self, regions: Iterable[str]) -> dict[str, str]:
        """Name of the material of each of the mesh's regions that has one."""
        names = self.materials.model_dump()
        names["shaft_in"] = names["shaft_out"] = names.pop("shaft")
        return {region: names[region] for region in regions if region in names}

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


class ShearCellGeometry(GeometrySection):
    """The annulus between two cylinders: body `disc` inside, `rotor` outside, floor and ceiling at rest."""

    is_annulus: ClassVar[bool] = True

    kind: Literal["shear_cell"]
    inner_radius: Length = Field(description="radius of the inner cylinder")
    outer_radius: Length = Field(description="radius of the outer cylinder")
    height: Length = Field(description="axial height")
    steel: bool = Field(default=False, description="the cylinders are of steel: grains see their images in them")

    @property
    def may_have_steel_faces(self) -> bool:
        """True if its cylinders are of steel."""
        return self.steel

    def shape(self, own: Mapping[str, Material] = NO_MATERIALS) -> ShearCell:
        """Return the shape for walls and volumes."""
        from geometry.annular_cell import ShearCell

        return ShearCell(self.inner_radius, self.outer_radius, self.height, self.steel)


class CentrifugalGeometry(GeometrySection):
    """A shot clutch: vanes on the input (body `rotor`) throw the grains against the ribbed drum of the output (`disc`).

    Its axis is z; gravity across it, e.g. direction = [0, -1, 0], makes it a horizontal shaft.
    """

    why_no_sector: ClassVar[str] = (
        "cannot stand in a centrifugal clutch: its vanes and ribs do not repeat from sector to sector as one turns "
        "past the other; remove it (the full ring is simulated)"
    )

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

    def shape(self, own: Mapping[str, Material] = NO_MATERIALS) -> CentrifugalClutch:
        """Return the shape for walls and volumes."""
        from geometry.centrifugal import CentrifugalClutch

        return CentrifugalClutch(**self.model_dump(exclude={"kind"}))


class BoxGeometry(GeometrySection):
    """A closed box at rest, x and y centred on the axis, its floor at z = 0."""

    has_axis: ClassVar[bool] = False
    why_no_sector: ClassVar[str] = "needs a shape with an axis; remove it, or take another geometry.kind than 'box'"

    kind: Literal["box"]
    size: tuple[Length, Length, Length] = Field(description="lengths along x, y and z")

    def shape(self, own: Mapping[str, Material] = NO_MATERIALS) -> Box:
        """Return the shape for walls and volumes."""
        from geometry.box import Box

        return Box(self.size)


_Body = Annotated[str, Choice(("rotor", "disc", "housing"))]


_UNITS = {"m": 1.0, "cm": 1e-2, "mm": 1e-3, "um": 1e-6, "inch": 25.4e-3}
_UNIT_OF_SHAPES = "mm"


class CadGeometry(GeometrySection):
    """A device of revolution from a CAD file or a finished mesh, its regions by the names of the parts.

    A CAD file holds the faces of the half section (x is the radius, y or z the axis), or solids of revolution; what no
    part fills is air. A mesh holds the triangles of the half section and of the air around it, by physical groups
    (.msh), cell sets or a column of tags: tag 3 is the name `tag3`. Part 3 of a BREP file, which has no names, is
    `part3`. `coil` and `powder` are the winding and the space of the grains. Parts named disc and shaft_out turn with
    the disc, housing, yoke and coil stand still, all others turn with the rotor.

    With `three_dimensional` the file holds solids of any shape, and the field is solved in 3D. `powder` and
    `coil` are of revolution about z even then, the coil a ring of rectangular section whose current flows around z;
    all parts that are not belong to one body, with which the field turns. Walls are those of the half-plane y = 0,
    x > 0.
    """

    has_coil: ClassVar[bool] = True
    is_from_file: ClassVar[bool] = True

    kind: Literal["cad"]
    file: str = Field(
        min_length=1,
        description="STEP (names are those of PRODUCT), IGES, BREP or trusted .geo; or a mesh: .msh, .vtu, .vtk, .inp, "
        ".mesh, .med; from the scene's folder",
    )
    materials: dict[str, str] = Field(description="a material's name for each part but coil and powder")
    names: dict[str, str] = Field(default={}, description="region for a part's name in the file, where they differ")
    bodies: dict[str, _Body] = Field(
        default={},
        description="body that a region turns with; default: by its name, see the text above",
    )
    axis: Annotated[str, Choice(("x", "y", "z"))] = Field(default="z", description="axis of revolution of solids")
    unit: Annotated[str, Choice(tuple(_UNITS))] | None = Field(
        default=None, description="of a file that does not say it; default: mm for BREP and .geo, m for meshes"
    )
    scale: Annotated[float, number("0.001", 1e-9, 1e9)] = Field(default=1.0, description="factor on the file's lengths")
    air_factor: Annotated[float, number("3", 1.5, 20.0)] = Field(
        default=3.0, description="air box / device size; a mesh has its air with it"
    )
    three_dimensional: bool = Field(default=False, description="solve in 3D: solids of any shape, see the text above")
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
        self._refuse_what_the_file_says()
        try:
            self._section()
        except (ValueError, OSError) as error:
            from geometry.fault import with_keys

            reason = str(error).removeprefix(self.file).lstrip(": ")
            keys = type(self).model_fields
            reason = with_keys(reason, lambda name: f"geometry.{name}" if name in keys else f"`{name}`")
            raise refuse(reason, key="file") from None
        return self

    @property
    def is_meshed(self) -> bool:
        """True if the file is a finished mesh, which is taken as it is."""
        from geometry.section_import import MESH_SUFFIXES

        return Path(self.file).suffix.lower() in MESH_SUFFIXES

    @property
    def is_solved_in_3d(self) -> bool:
        """Solids of any shape are."""
        return self.three_dimensional

    @property
    def files(self) -> dict[str, Path]:
        """The drawing or mesh."""
        return {"geometry.file": Path(self.file)}

    def region_materials(self, regions: Iterable[str]) -> dict[str, str]:
        """Name of the material of each part; the mesh's regions are those of the file."""
        return dict(self.materials)

    def _refuse_what_the_file_says(self) -> None:
        """Refuse keys that a file of this kind leaves nothing to say about."""
        suffix = Path(self.file).suffix.lower()
        if self.unit is not None and suffix in (".step", ".stp", ".iges", ".igs"):
            raise refuse(f"is not for {suffix} files, which say their own unit; remove it, or mend a wrong one by "
                         "geometry.scale", key="unit")  # fmt: skip
        for key in ("axis", "air_factor"):
            if self.is_meshed and getattr(self, key) != type(self).model_fields[key].default:
                raise refuse(f"is for CAD files, and {Path(self.file).name} is a mesh: its radius is x, and it has its "
                             "air with it; remove it", key=key)  # fmt: skip
        if self.three_dimensional and self.is_meshed:
            raise refuse(
                "needs solids of a CAD file, which are meshed here; take STEP, or a section", key="three_dimensional"
            )
        if self.three_dimensional and self.axis != "z":
            raise refuse(
                "is of sections; with geometry.three_dimensional turn the parts about z in the CAD program", key="axis"
            )

    def options(self) -> dict[str, Any]:
        """Return what the import needs beside the path; see `geometry.cad_import.imported_section`."""
        native = "m" if self.is_meshed else _UNIT_OF_SHAPES
        return {
            "names": self.names,
            "needed": tuple(dict.fromkeys(("coil", *(self.materials or ())))),
            "known": ("powder", "air"),
            "axis": self.axis,
            "scale": self.scale * _UNITS[self.unit or native] / _UNITS[native],
            "trust_scripts": self._trust_scripts,
        }

    def shape(self, own: Mapping[str, Material] = NO_MATERIALS) -> CadShape:
        """Return the shape for walls and volumes; `own`: the scene's own materials by name."""
        from geometry.cad_shape import CadShape

        return CadShape(self._section()[1], self.bodies, magnetic_regions(self.materials, own))

    def mesh(self, gap_layers: int, size_factor: float) -> SectionMesh:
        """Mesh the section; see `geometry.cad_meshing.mesh_cad`. A finished mesh is taken as it is."""
        from geometry.cad_meshing import mesh_cad

        finished = self._section()[0]
        if finished is not None:
            return finished
        return mesh_cad(
            self.file,
            gap_layers=gap_layers,
            size_factor=size_factor,
            air_factor=self.air_factor,
            **self.options(),
        )

    def mesh_3d(self, gap_layers: int, size_factor: float, order: int) -> Mesh3D:
        """Mesh the device in 3D; see `geometry.cad_solid.mesh_cad_solids`."""
        from geometry.cad_solid import mesh_cad_solids

        options = {key: entry for key, entry in self.options().items() if key != "axis"}
        return mesh_cad_solids(
            self.file,
            section=self._section()[1],
            gap_layers=gap_layers,
            size_factor=size_factor,
            air_factor=self.air_factor,
            order=order,
            **options,
        )

    def _section(self) -> tuple[SectionMesh | None, CadSection]:
        options = self.options() | ({"any_shape": True} if self.three_dimensional else {})
        path = Path(self.file)
        changed = path.stat().st_mtime_ns if path.is_file() else 0
        options["names"] = tuple(sorted(self.names.items()))
        return _read_section(self.file, changed, self.is_meshed, **options)


@lru_cache(maxsize=8)
def _read_section(
    file: str, changed: int, is_meshed: bool, *, names: tuple[tuple[str, str], ...], **options: Any
) -> tuple[SectionMesh | None, CadSection]:
    """Read a file once for the many that ask; `changed` is its time, so that a new export is seen."""
    from geometry.cad_meshing import cad_section
    from geometry.cad_solid import check_device_3d
    from geometry.section_import import meshed_section

    if not is_meshed:
        section = cad_section(file, names=dict(names), **options)
        if options.get("any_shape"):
            check_device_3d(file, section)
        return None, section
    del options["axis"], options["trust_scripts"]
    return meshed_section(file, names=dict(names), **options)


Geometry = Annotated[
    ClutchGeometry | DrumGeometry | CentrifugalGeometry | ShearCellGeometry | BoxGeometry | CadGeometry,
    Field(discriminator="kind"),
]
