"""geometry.kind = "clutch": a disc in a rotor's cavity, in a housing with a coil (`geometry.clutch`)."""

from __future__ import annotations

import math
from collections.abc import Iterable, Iterator, Mapping
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

from pydantic import Field

from emclutch.devices.geometry_section import NO_MATERIALS, ONE_CARRIER, GeometrySection
from emclutch.scene.errors import Fault
from emclutch.scene.magnetic_regions import magnetic_regions
from emclutch.scene.partial_scene import PartialScene
from emclutch.scene.section import Integer, Section
from emclutch.scene.units import Length, LengthOrNone, number

if TYPE_CHECKING:
    from emclutch.device_model.device_3d import Solid
    from emclutch.device_model.pole_zone import GapZone, PoleZone
    from emclutch.scene.materials import Material
    from field import Law
    from field.coil.magnetic_circuit import FilledPowder, MagneticCircuit
    from geometry.clutch import Clutch
    from geometry.dimensioned_views import View
    from geometry.fault import GeometryFault
    from geometry.section import SectionMesh
    from geometry.walls import AnnularBox


class ClutchMaterials(Section):
    """[geometry.materials]: material of each region, e.g. rotor = "steel_1010", built in or from [materials.NAME]."""

    housing: str = "steel_1010"
    rotor: str = "steel_1010"
    disc: str = "steel_1010"
    ring: str = "stainless_304"
    cover: str = "steel_1010"
    seal: str = "aluminium"
    shaft: str = "stainless_304"
    coil: str = "copper"


class SlotsSection(Section):
    """Equal axial slots around a body, open towards the rim gap, filled flush with a non-magnetic material.

    Grains meet smooth walls; the field is solved in 3D instead of in the section.
    """

    count: Annotated[int, Integer(2, 500, "24")] = Field(description="slots around the body")
    fraction: Annotated[float, number("0.5", 0.0, 1.0, above=True)] = Field(
        default=0.5, description="part of the pitch that a slot takes"
    )
    depth: Length = Field(description="radial depth")


def _one_slotted_body(partial: PartialScene) -> Iterator[Fault]:
    """The field stands still in the frame of one body: no other may have slots."""
    if partial.scene.coil_field is not None and len(partial.scene.geometry.slotted) == 2:
        yield Fault("geometry.rotor_slots", "", f"conflicts with geometry.disc_slots: {ONE_CARRIER}; keep one of them")


def _sector_of_whole_pitches(partial: PartialScene) -> Iterator[Fault]:
    """The field of a body with slots repeats every pitch only."""
    sector, slotted = partial.scene.particles.sector, partial.scene.geometry.slotted
    if sector is None or partial.scene.coil_field is None or len(slotted) != 1:
        return
    ((key, slots),) = slotted.items()
    pitches = sector * slots.count / (2.0 * math.pi)
    if abs(pitches - round(pitches)) > 1e-6 or round(pitches) < 1:
        yield partial.fault(
            "particles.sector",
            f"is {pitches:.4g} pitches of geometry.{key}; the field repeats every pitch only: take "
            f"'{360.0 / slots.count:.10g} deg' or a multiple, or another count of slots",
        )


class ClutchGeometry(GeometrySection):
    """A disc in a rotor's cavity, in a housing with a coil; steel covers lead the flux to the faces.

    The kind is that of a disc device, sheared between its faces, clutch or brake: a brake is one whose disc is held.
    `drum` is the one that is sheared at its rim.
    """

    has_coil = True
    has_regions = True
    has_poles = True
    CHECKS: ClassVar = (
        (_one_slotted_body, ("field",)),
        (_sector_of_whole_pitches, ("field", "particles")),
    )

    kind: Literal["clutch"]
    disc_radius: Length = Field(description="outer radius of the disc")
    disc_thickness: Length = Field(description="axial thickness of the disc")
    gap: Length = Field(description="radial gap between the disc's rim and the rotor; usually sheared in a drum")
    face_gap: Length = Field(
        description="axial gap between each face of the disc and the rotor's cover; usually sheared in a clutch"
    )
    seal_radius: Length = Field(description="inner radius of the powder's cavity")
    rotor_wall: Length = Field(description="radial thickness of the rotor's shell")
    ring_width: LengthOrNone = Field(description="axial width of the non-magnetic ring in the rotor's shell; 0: none")
    cover_thickness: Length = Field(description="axial thickness of the rotor's covers")
    clearance: Length = Field(description="radial air gap between rotor and housing")
    coil_width: Length = Field(description="axial width of the coil's window")
    coil_height: Length = Field(description="radial height of the coil's window")
    yoke: Length = Field(description="radial thickness of the housing outside the coil")
    shaft_radius: Length = Field(description="radius of both shafts")
    housing_width: Length | None = Field(
        default=None, description="axial width of the housing; default: the rotor's", examples=["20 mm"]
    )
    coil_radius: Length | None = Field(
        default=None, description="inner radius of the coil; default: the housing's bore", examples=["55 mm"]
    )
    pole_chamfer: LengthOrNone = Field(
        default=0.0,
        description="leg of a 45 degree chamfer of the edges of the housing's poles at the clearance; the edges of "
        "disc and rotor bound the powder and stay sharp; 0: sharp",
    )
    pole_fillet: LengthOrNone = Field(default=0.0, description="radius of a fillet of the same edges; 0: sharp")
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
    def key_of_3d(self) -> str:
        """With slots it is no device of revolution."""
        return next(iter(self.slotted), "")

    def false_mirrors(self, shape: Clutch) -> str:
        """The slots: grains meet smooth walls."""
        return f"in the slots of geometry.{self.key_of_3d} too, as if they were steel" if self.slotted else ""

    def warnings(self, scene: Any) -> Iterator[str]:
        """Yield slots that no field sees."""
        if self.slotted and scene.coil_field is None:
            yield (
                f"geometry.{self.key_of_3d} has no effect: only the field of a coil sees slots, grains meet smooth "
                "walls"
            )

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
            None if section is None else Slots(section.count, section.fraction, section.depth)
            for section in (self.disc_slots, self.rotor_slots)
        )
        magnetic = magnetic_regions(self.materials.model_dump(), own)
        return Clutch(**given, disc_slots=disc, rotor_slots=rotor, magnetic=magnetic)

    def dimension_views(self, shape: Clutch) -> list[View]:
        """See `GeometrySection.dimension_views`."""
        from geometry.dimensioned_views import clutch_views

        return clutch_views(shape)

    def check_valid_dimensions(
        self, unknown: set[str], own: Mapping[str, Material], diameter: float | None
    ) -> list[GeometryFault]:
        """See `GeometrySection.check_valid_dimensions`."""
        lengths = unknown & set(type(self).model_fields) - {"materials", "disc_slots", "rotor_slots"}
        # not a number: whatever is compared with it is judged neither right nor wrong, but for itself, reported already
        shape = self.model_copy(update=dict.fromkeys(lengths, math.nan)).shape(own)
        return [fault for fault in shape.faults(diameter) if fault.what.split(".")[0] not in unknown]

    def mesh(self, shape: Clutch, gap_layers: int, size_factor: float) -> SectionMesh:
        """See `GeometrySection.mesh`."""
        from geometry.meshing import mesh_clutch

        return mesh_clutch(shape, gap_layers=gap_layers, size_factor=size_factor)

    def solid(self, shape: Clutch, gap_layers: int, size_factor: float, order: int, arc: float = math.inf) -> Solid:
        """See `GeometrySection.solid`."""
        from emclutch.device_model.device_3d import ALONG, Solid, under_the_poles
        from field.three_d import FlatCoil
        from geometry.slotted import mesh_slotted

        half = 0.5 * shape.coil_width
        slots = shape.disc_slots or shape.rotor_slots
        assert slots is not None  # else the field is that of a section
        return Solid(
            mesh_slotted(shape, gap_layers=gap_layers, size_factor=size_factor, order=order, arc=arc),
            FlatCoil.ring((shape.coil_inner_radius, shape.coil_outer_radius), (-half, half)),
            carrier="disc" if shape.disc_slots is not None else "rotor",
            pole_line=under_the_poles(shape),
            face_line=shape.face_midline(ALONG),
            pitch=slots.pitch,
        )

    def cooled_surface(self, shape: Clutch) -> float:
        """Mantle and both ends of the housing [m^2]."""
        return 2.0 * math.pi * shape.outer_radius * (shape.housing_length + shape.outer_radius)

    def clearances(self, shape: Clutch) -> list[AnnularBox]:
        """See `GeometrySection.clearances`."""
        return shape.clearances()

    def magnetic_circuit(self, shape: Clutch, laws: Mapping[str, Law], powder: FilledPowder | None) -> MagneticCircuit:
        """See `GeometrySection.magnetic_circuit`."""
        from field.coil.magnetic_circuit import clutch_circuit

        return clutch_circuit(shape, laws) if powder is None else clutch_circuit(shape, laws, powder)

    def pole_zone(self, shape: Clutch, region: str) -> PoleZone:
        """The zone at the rim, or at the disc's faces where these carry the flux."""
        from emclutch.device_model.pole_zone import PoleZone
        from geometry.walls import AnnularBox

        half, disc = 0.5 * shape.disc_thickness, shape.disc_radius
        if shape.shears_faces(region) or shape.pole_length == 0.0:
            inner = max(shape.seal_radius, 0.0)
            ends = (-half - shape.face_gap, -half), (half, half + shape.face_gap)
            boxes = tuple(AnnularBox(inner, disc, *each) for each in ends)
            return PoleZone(boxes, shape.face_area, shape.mean_face_radius)
        radius = shape.mean_gap_radius
        return PoleZone(tuple(shape.pole_boxes().values()), 4.0 * math.pi * radius * shape.pole_length, radius)

    def gap_key(self, shape: Clutch, region: str) -> str:
        """That of the faces where they are sheared, else that of the rim."""
        return "geometry.face_gap" if shape.shears_faces(region) else "geometry.gap"

    def gap_zone(self, shape: Clutch, region: str) -> GapZone:
        """Both face gaps, or the rim gap."""
        from emclutch.device_model.pole_zone import GapZone

        boxes, radius = shape.fill_boxes(), shape.sheared_gap(region).radius
        if shape.shears_faces(region):
            return GapZone((boxes["face_left"], boxes["face_right"]), shape.face_area * radius)
        return GapZone.between_cylinders(boxes["rim"], radius)
