"""The parametric magnetic particle clutch, as in the classic drawing, turned about the z axis.

From the axis outwards: a **disc** (output) on its shaft, the **powder** chamber around rim and faces of the
disc, the **rotor** (input), a steel shell that a non-magnetic **ring** divides into two poles, closed by
two **covers**; a running clearance; the standing **housing** with the **coil**, open towards the rotor; air
around all. The coil's flux cannot pass the ring: it goes rotor pole - gap - disc - gap - rotor pole, or,
when the disc is thin and the covers are steel, cover - face gap - disc - face gap - cover. A thick disc
(«drum») and a thin one are the same family.

Inside ``seal_radius`` a non-magnetic **seal** fills the space between disc and covers: without it steel
covers would short the gap. The shaft stubs are regions of their own, as a clutch with steel covers needs
non-magnetic ones.

Disc and rotor may have slots around their rim and bore (`geometry.slots`), filled flush and non-magnetic:
they belong to the field in 3D alone; walls, chamber and cross-section are those of the unslotted bodies.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.annular_spaces import AnnularSpaces
from geometry.fault import FaultFinder, GeometryFault, millimetres
from geometry.pole_edges import CHORDS, SMALLEST_EDGE, cut_corners
from geometry.sheared_gap import ShearedGap
from geometry.slots import Slots, slot_faults
from geometry.walls import AnnularBox, Pair, RevolvedWall, outline

# A gap is meshed with elements as wide as a quarter of it: about 40 x slenderness triangles, here 80 000.
SLENDEREST = 2000.0
AIR_FACTORS = (1.5, 20.0)

_SIZES = (
    "disc_radius", "disc_thickness", "gap", "face_gap", "seal_radius", "rotor_wall", "ring_width", "cover_thickness",
    "clearance", "coil_width", "coil_height", "yoke", "shaft_radius", "housing_width", "coil_radius",
)  # fmt: skip

REGIONS = {
    "cavity": ("rim", "face_left", "face_right"),
    "rim": ("rim",),
    "poles": ("pole_left", "pole_right"),
    "faces": ("face_left", "face_right"),
}
"""Boxes of the parts of the chamber that may be filled."""

_AT_RIM = ("rim", "poles")
"""Regions from which the powder is sheared in the rim gap."""


@dataclass(frozen=True, slots=True)
class Clutch(AnnularSpaces):
    """Sizes of a clutch [m]; the defaults are a drum form of the 12 N·m class. Symmetric about z = 0.

    Attributes
    ----------
    disc_radius, disc_thickness
        The disc (output): r < disc_radius, |z| < disc_thickness/2.
    gap, face_gap
        Radial gap at the rim and axial gap at both faces; both hold powder.
    seal_radius
        Inner radius of the powder chamber.
    rotor_wall, ring_width, cover_thickness
        Radial thickness of the rotor's shell, axial width of its non-magnetic ring (0: none), thickness of
        the covers.
    clearance
        Radial running clearance between rotor and housing (air).
    coil_width, coil_height, coil_radius
        Axial and radial size of the winding; its inner radius (None: right at the housing's bore). With a
        greater coil_radius the window below the winding is air.
    yoke, housing_width
        Radial thickness of the housing outside the coil; axial width of the housing (None: as the rotor).
    shaft_radius
        Both shaft stubs.
    air_factor
        Radius of the air half-disc over that of the circle around the device.
    magnetic : frozenset of str
        Regions of magnetic material: their faces mirror dipoles. With magnetic covers the ring may be wider than the
        disc.
    pole_chamfer, pole_fillet : float
        Leg of a chamfer, or radius of a fillet, of the edges of the housing's poles at the running clearance; 0: sharp.
        The edges of disc and rotor bound the powder and stay sharp, as the grains' walls are.
    disc_slots, rotor_slots : Slots or None
        Slots in the disc's rim and in the rotor's poles, open towards the rim gap.
    """

    disc_radius: float = 44.5e-3
    disc_thickness: float = 30e-3
    gap: float = 1e-3
    face_gap: float = 1e-3
    seal_radius: float = 41e-3
    rotor_wall: float = 6e-3
    ring_width: float = 6e-3
    cover_thickness: float = 4e-3
    clearance: float = 0.3e-3
    coil_width: float = 14e-3
    coil_height: float = 14e-3
    yoke: float = 8e-3
    shaft_radius: float = 8e-3
    housing_width: float | None = None
    coil_radius: float | None = None
    pole_chamfer: float = 0.0
    pole_fillet: float = 0.0
    air_factor: float = 3.0
    magnetic: frozenset[str] = frozenset({"disc", "rotor"})
    disc_slots: Slots | None = None
    rotor_slots: Slots | None = None

    @property
    def axisymmetric(self) -> bool:
        """Without slots: the field of the cross-section is then the field of the clutch."""
        return self.disc_slots is None and self.rotor_slots is None

    @property
    def cover_magnetic(self) -> bool:
        """Covers that carry flux: it may cross the face gaps."""
        return "cover" in self.magnetic

    @property
    def bore_radius(self) -> float:
        """Radius of the rotor's bore [m], the outer wall of the powder chamber."""
        return self.disc_radius + self.gap

    @property
    def rotor_radius(self) -> float:
        """Outer radius of the rotor [m]."""
        return self.bore_radius + self.rotor_wall

    @property
    def housing_bore(self) -> float:
        """Inner radius of the housing [m]."""
        return self.rotor_radius + self.clearance

    @property
    def pole_edge(self) -> float:
        """How far the edges of the housing's poles are cut, along both sides [m]."""
        return max(self.pole_chamfer, self.pole_fillet)

    @property
    def coil_inner_radius(self) -> float:
        """Inner radius of the winding [m]: ``coil_radius``, or the housing's bore."""
        # A radius that only rounding tells from the bore is the bore: no sliver of air for the mesher.
        if self.coil_radius is None or math.isclose(self.coil_radius, self.housing_bore, rel_tol=1e-6):
            return self.housing_bore
        return self.coil_radius

    @property
    def coil_outer_radius(self) -> float:
        """Outer radius of the winding [m]."""
        return self.coil_inner_radius + self.coil_height

    @property
    def outer_radius(self) -> float:
        """Outer radius of the housing [m]."""
        return self.coil_outer_radius + self.yoke

    @property
    def cavity_length(self) -> float:
        """Axial length of the powder chamber [m]."""
        return self.disc_thickness + 2.0 * self.face_gap

    @property
    def rotor_length(self) -> float:
        """Axial length of the rotor with its covers [m]."""
        return self.cavity_length + 2.0 * self.cover_thickness

    @property
    def housing_length(self) -> float:
        """Axial length of the housing [m]: ``housing_width``, or that of the rotor."""
        return self.rotor_length if self.housing_width is None else self.housing_width

    @property
    def length(self) -> float:
        """Axial length [m] over the shaft stubs, each as long as the shaft is thick."""
        return max(self.rotor_length + 4.0 * self.shaft_radius, self.housing_length)

    @property
    def air_radius(self) -> float:
        """Radius of the air half-disc [m]."""
        return self.air_factor * math.hypot(self.outer_radius, 0.5 * self.length)

    @property
    def coil_area(self) -> float:
        """Section of the winding [m^2]."""
        return self.coil_width * self.coil_height

    @property
    def coil_mean_radius(self) -> float:
        """Mean radius of the winding [m]: a mean turn is 2 pi times as long."""
        return self.coil_inner_radius + 0.5 * self.coil_height

    @property
    def mean_gap_radius(self) -> float:
        """Radius in the middle of the rim gap [m]."""
        return self.disc_radius + 0.5 * self.gap

    @property
    def mean_face_radius(self) -> float:
        """Mean radius of the face gaps by area [m]: what turns past them moves so fast on average."""
        inner, outer = self.seal_radius, self.disc_radius
        return 2.0 / 3.0 * (outer**2 + outer * inner + inner**2) / (outer + inner)

    @property
    def rim_area(self) -> float:
        """Area [m^2] of the disc's rim."""
        return 2.0 * math.pi * self.disc_radius * self.disc_thickness

    @property
    def face_area(self) -> float:
        """Area [m^2] of both faces of the disc, inside the chamber."""
        return 2.0 * math.pi * (self.disc_radius**2 - self.seal_radius**2)

    @property
    def pole_length(self) -> float:
        """Axial length [m] of each of the two steel pole faces that look at the rim."""
        return max(0.0, 0.5 * (self.disc_thickness - self.ring_width))

    @property
    def largest_radius(self) -> float:
        """Largest radius [m] at which a wall touches grains."""
        return self.bore_radius

    def shears_faces(self, region: str = "cavity") -> bool:
        """True if powder in a region of the chamber is sheared at the faces; of both the greater area."""
        return region not in _AT_RIM and (region == "faces" or self.face_area > self.rim_area)

    def sheared_gap(self, region: str = "cavity") -> ShearedGap:
        """The gap at the rim or at the faces, by the region that is filled."""
        narrowest = min(self.gap, self.face_gap)
        if self.shears_faces(region):
            narrowest = self.face_gap if region == "faces" else narrowest
            return ShearedGap(self.mean_face_radius, self.face_gap, narrowest, True, 0.5 * self.disc_thickness)
        return ShearedGap(self.mean_gap_radius, self.gap, self.gap if region in _AT_RIM else narrowest)

    def gap_parts(self, boxes: Sequence[AnnularBox]) -> list[tuple[AnnularBox, bool]]:
        """Those filled parts, of `boxes`, that lie between the shafts, and whether the gap's width is along r."""
        half, rim = 0.5 * self.disc_thickness, self.disc_radius
        return [
            (AnnularBox(box.r0, box.r1, max(box.z0, -half), min(box.z1, half)), True) if box.r0 >= rim else (box, False)
            for box in boxes
        ]

    def gap_midline(self, count: int = 101) -> np.ndarray:
        """Points (r, z) [m] along the middle of the rim gap, over the disc's thickness; shape (count, 2)."""
        z = np.linspace(-0.5, 0.5, count) * self.disc_thickness
        return np.column_stack((np.full(count, self.mean_gap_radius), z))

    def face_midline(self, count: int = 101) -> np.ndarray:
        """Points (r, z) [m] along the middle of the face gap at z > 0; shape (count, 2)."""
        r = np.linspace(self.seal_radius, self.disc_radius, count)
        return np.column_stack((r, np.full(count, 0.5 * (self.disc_thickness + self.face_gap))))

    def air_gaps(self) -> dict[str, list[AnnularBox]]:
        """Air that the coil's flux has to cross: the running clearance under both cheeks of the housing."""
        inner, outer = 0.5 * self.coil_width, 0.5 * min(self.rotor_length, self.housing_length)
        r = self.rotor_radius, self.housing_bore
        return {"clearance": [AnnularBox(*r, -outer, -inner), AnnularBox(*r, inner, outer)]}

    def body(self, region: str) -> str:
        """The body (shaft) that a region turns with."""
        if region in ("disc", "shaft_out"):
            return "disc"
        return "housing" if region in ("housing", "coil") else "rotor"

    def faults(self, grain_diameter: float | None = None) -> list[GeometryFault]:
        """Every inconsistency of the sizes; with a grain diameter [m], also gaps that no grain fits into.

        The parts are stacked radially, so that most cannot overlap whatever their sizes. Relations are judged only
        between sizes that are lengths by themselves.
        """
        mm = millimetres
        it = FaultFinder(self, {"housing_width": self.housing_length, "coil_radius": self.coil_inner_radius})
        sharp = dict.fromkeys(("pole_chamfer", "pole_fillet"), "sharp edges")
        it.check_lengths(*_SIZES, *sharp, or_zero={"ring_width": "no ring", **sharp})
        for name in ("gap", "face_gap", "clearance"):
            it.refuse(0.0 < self.disc_radius <= getattr(self, name) < math.inf, name,
                      "a gap is wider than the disc's radius; a bare number is in metres",
                      f"less than {mm(self.disc_radius)}",
                      f"write it with its unit, as in `{name}` = '1 mm'")  # fmt: skip
        low, high = AIR_FACTORS
        it.refuse(not low <= self.air_factor <= high, "air_factor",
                  "the air must enclose the device with some room, and not dwarf it", f"{low:g} to {high:g}",
                  "3 is a good choice for `air_factor`", value=f"{self.air_factor:g}")  # fmt: skip
        it.judge_relations()

        it.refuse(self.seal_radius >= self.disc_radius, "seal_radius",
                  "the seal covers the whole face of the disc, no powder reaches it",
                  f"less than `disc_radius` ({mm(self.disc_radius)})", "lower `seal_radius` or raise `disc_radius`",
                  "disc_radius")  # fmt: skip
        it.refuse(self.seal_radius <= self.shaft_radius, "seal_radius", "the seal lies inside the shaft",
                  f"more than `shaft_radius` ({mm(self.shaft_radius)})", "raise `seal_radius` or lower `shaft_radius`",
                  "shaft_radius")  # fmt: skip
        it.refuse(self.shaft_radius >= self.disc_radius, "shaft_radius", "the shaft is as thick as the disc",
                  f"less than `disc_radius` ({mm(self.disc_radius)})", "lower `shaft_radius` or raise `disc_radius`",
                  "disc_radius")  # fmt: skip

        # With steel covers the flux enters the disc through its faces and needs no pole at the rim.
        rotor = ("disc_thickness", "face_gap", "cover_thickness")
        limit, part = ((self.cavity_length, "powder chamber") if self.cover_magnetic else
                       (self.disc_thickness, "disc"))  # fmt: skip
        it.refuse(self.ring_width >= limit, "ring_width",
                  f"the non-magnetic ring is as wide as the {part} and leaves no pole",
                  f"0 mm to less than {mm(limit)}", "lower `ring_width` or raise `disc_thickness`", *rotor)  # fmt: skip
        width = mm(self.housing_length)
        if not it.refuse(self.coil_width >= self.housing_length, "coil_width",
                         f"the coil cuts through the side walls of the housing, which is {width} wide",
                         f"less than {width}", "lower `coil_width` or raise `housing_width`",
                         "housing_width", *rotor):  # fmt: skip
            it.refuse(self.coil_width >= self.rotor_length, "coil_width",
                      "the coil is as wide as the rotor: the housing's poles face no rotor",
                      f"less than {mm(self.rotor_length)}", "lower `coil_width` or raise `disc_thickness`",
                      "housing_width", *rotor)  # fmt: skip
        it.refuse(self.housing_length <= self.ring_width, "housing_width",
                  "the housing is no wider than the ring: its poles face no steel",
                  f"more than `ring_width` ({mm(self.ring_width)})", "raise `housing_width` or lower `ring_width`",
                  "ring_width", "coil_width", *rotor)  # fmt: skip
        ends = ((self.disc_radius, "the disc"), (self.bore_radius, "the powder cavity"),
                (self.rotor_radius, "the rotor's shell"), (self.housing_bore, "the running clearance"))  # fmt: skip
        cut = next((end for end in ends if self.coil_inner_radius < end[0]), (0.0, ""))
        it.refuse(bool(cut[1]), "coil_radius", f"the coil cuts {cut[1]}, which reaches to r = {mm(cut[0])}",
                  f"at least {mm(self.housing_bore)}",
                  "raise `coil_radius`, or leave it out and the coil lies right outside the rotor",
                  "disc_radius", "gap", "rotor_wall", "clearance")  # fmt: skip

        # two edges share the pole's face, and its sides reach as far as the coil
        room = min(0.25 * (self.housing_length - self.coil_width), self.coil_outer_radius - self.housing_bore)
        for name in sharp:
            it.refuse(0.0 < room <= getattr(self, name), name, "the cut edges leave no face of the housing's poles",
                      f"0 mm (sharp edges), or {mm(SMALLEST_EDGE)} to less than {mm(room)}", f"lower `{name}`",
                      "coil_width", "housing_width", "coil_height", "coil_radius", *rotor)  # fmt: skip
            it.refuse(0.0 < getattr(self, name) < SMALLEST_EDGE, name, "an edge that is broken so little is sharp",
                      f"0 mm (sharp edges), or at least {mm(SMALLEST_EDGE)}", f"leave `{name}` out")  # fmt: skip
        it.refuse(self.pole_chamfer > 0.0 and self.pole_fillet > 0.0, "pole_fillet", "the same edges have a chamfer",
                  "0 mm with `pole_chamfer`", "keep one of `pole_chamfer` and `pole_fillet`",
                  "pole_chamfer")  # fmt: skip

        for name, length, sizes in (
            ("gap", self.cavity_length, rotor[:2]),
            ("face_gap", self.disc_radius - self.seal_radius, ("disc_radius", "seal_radius")),
            ("clearance", self.rotor_length, rotor),
        ):
            it.refuse(getattr(self, name) * SLENDEREST < length, name,
                      f"it is {mm(length)} long: too slender for a mesh", f"at least {mm(length / SLENDEREST)}",
                      f"raise `{name}`, and check the units of the sizes", *sizes)  # fmt: skip
        if self.disc_slots is not None and it.are_right("disc_radius", "shaft_radius"):
            room = self.disc_radius - self.shaft_radius
            it.faults += slot_faults(self.disc_slots, "disc_slots", "the disc", room, "the shaft")
        if self.rotor_slots is not None and it.are_right("rotor_wall"):
            it.faults += slot_faults(
                self.rotor_slots, "rotor_slots", "the rotor's shell", self.rotor_wall, "the clearance"
            )

        if grain_diameter is not None:
            grain, lower_grain = mm(grain_diameter), "or lower `grain_diameter`"
            for name in ("gap", "face_gap"):
                it.refuse(getattr(self, name) < grain_diameter, name,
                          f"it is thinner than one grain ({grain}): no grain fits", f"at least {grain}",
                          f"raise `{name}` {lower_grain}")  # fmt: skip
            lowers = grain_diameter < self.disc_radius  # a larger grain fits at no radius of the seal
            it.refuse(lowers and 0.0 < self.disc_radius - self.seal_radius < grain_diameter, "seal_radius",
                      f"the chamber is lower than one grain ({grain})",
                      f"at most {mm(self.disc_radius - grain_diameter)}", "lower `seal_radius` or `grain_diameter`",
                      "disc_radius")  # fmt: skip
        return it.faults

    def walls(self) -> list[RevolvedWall]:
        """Walls of the grains: the rotor's chamber, from seal rim to seal rim, and the disc in it.

        A wall is magnetic when the region that it belongs to is.
        """
        face, half = 0.5 * self.disc_thickness, 0.5 * self.cavity_length
        seal, bore, ring = self.seal_radius, self.bore_radius, min(0.5 * self.ring_width, half)
        chamber: list[Pair] = [(seal, -face), (seal, -half), (bore, -half)]
        regions = {"seal_rim_left": "seal", "cover_left": "cover"}
        if ring == 0.0:
            regions["bore"] = "rotor"
        else:
            chamber += [(bore, -ring), (bore, ring)]
            regions |= {"bore_left": "rotor", "bore_ring": "ring", "bore_right": "rotor"}
        chamber += [(bore, half), (seal, half), (seal, face)]
        regions |= {"cover_right": "cover", "seal_rim_right": "seal"}
        steel = [region in self.magnetic for region in regions.values()]
        disc: list[Pair] = [(seal, -face), (self.disc_radius, -face), (self.disc_radius, face), (seal, face)]
        return outline(list(regions), "rotor", chamber, magnetic=steel) + outline(
            ["disc_face_left", "disc_rim", "disc_face_right"], "disc", disc, magnetic="disc" in self.magnetic
        )

    def fill_boxes(self) -> dict[str, AnnularBox]:
        """Three disjoint parts of the chamber: ``rim`` (full length), ``face_left``, ``face_right``."""
        face, half = 0.5 * self.disc_thickness, 0.5 * self.cavity_length
        return {
            "rim": AnnularBox(self.disc_radius, self.bore_radius, -half, half),
            "face_left": AnnularBox(self.seal_radius, self.disc_radius, -half, -face),
            "face_right": AnnularBox(self.seal_radius, self.disc_radius, face, half),
        }

    def pole_boxes(self) -> dict[str, AnnularBox]:
        """The two parts of ``rim`` that lie between steel pole faces; none where the ring leaves no pole."""
        if self.pole_length == 0.0:
            return {}
        start, end = 0.5 * self.ring_width, 0.5 * self.disc_thickness
        return {
            "pole_left": AnnularBox(self.disc_radius, self.bore_radius, -end, -start),
            "pole_right": AnnularBox(self.disc_radius, self.bore_radius, start, end),
        }

    def boxes_to_fill(self, region: str = "cavity") -> list[AnnularBox]:
        """The boxes of a region: ``cavity``, ``rim``, ``poles`` or ``faces``."""
        boxes = self.fill_boxes() | self.pole_boxes()
        # without poles that region is refused, but still counted
        return [boxes[name] for name in REGIONS["rim" if region == "poles" and self.pole_length == 0.0 else region]]

    def clearances(self) -> list[AnnularBox]:
        """Rings of air between rotor and housing: the running clearance, and the window below a wider coil."""
        half, coil = 0.5 * min(self.rotor_length, self.housing_length), 0.5 * self.coil_width
        rings = [AnnularBox(self.rotor_radius, self.housing_bore, -half, half)]
        if self.coil_inner_radius > self.housing_bore:
            rings.append(AnnularBox(self.housing_bore, self.coil_inner_radius, -coil, coil))
        return rings

    def shaft_ends(self) -> list[tuple[float, float]]:
        """Radius and z [m] of the plane ends of both shaft stubs."""
        tip = 0.5 * self.rotor_length + 2.0 * self.shaft_radius
        return [(self.shaft_radius, -tip), (self.shaft_radius, tip)]

    def section_polygons(self) -> dict[str, list[np.ndarray]]:
        """Every region but ``air``: disjoint polygons (r, z) [m], shape (n, 2), counter-clockwise."""
        face, half, rotor = 0.5 * self.disc_thickness, 0.5 * self.cavity_length, 0.5 * self.rotor_length
        ring, coil, housing = 0.5 * self.ring_width, 0.5 * self.coil_width, 0.5 * self.housing_length
        tip = rotor + 2.0 * self.shaft_radius
        disc, bore, shell = self.disc_radius, self.bore_radius, self.rotor_radius
        seal, shaft = self.seal_radius, self.shaft_radius
        inner, window, outer = self.housing_bore, self.coil_outer_radius, self.outer_radius
        powder = [(seal, -half), (bore, -half), (bore, half), (seal, half),
                  (seal, face), (disc, face), (disc, -face), (seal, -face)]  # fmt: skip
        steel = [(inner, -housing), (outer, -housing), (outer, housing), (inner, housing),
                 (inner, coil), (window, coil), (window, -coil), (inner, -coil)]  # fmt: skip
        polygons = {
            "disc": [_rectangle(0.0, disc, -face, face)],
            "shaft_in": [_rectangle(0.0, shaft, -tip, -half)],
            "shaft_out": [_rectangle(0.0, shaft, face, tip)],
            "seal": [_rectangle(0.0, seal, -half, -face), _rectangle(shaft, seal, face, half)],
            "powder": [np.array(powder)],
            "cover": [_rectangle(shaft, bore, -rotor, -half), _rectangle(shaft, bore, half, rotor)],
            "rotor": [_rectangle(bore, shell, -rotor, -ring), _rectangle(bore, shell, ring, rotor)],
            "ring": [_rectangle(bore, shell, -ring, ring)],
            "coil": [_rectangle(self.coil_inner_radius, window, -coil, coil)],
            "housing": [
                cut_corners(np.array(steel), _POLES, chamfer=self.pole_chamfer, fillet=self.pole_fillet)
            ],
        }
        if self.ring_width == 0.0:
            del polygons["ring"]
        return polygons

    def fillet_arcs(self) -> list[tuple[int, int, np.ndarray]]:
        """First and last corner of the housing's polygon and centre (r, z) [m] of each fillet of the poles."""
        if self.pole_fillet == 0.0:
            return []
        r, out, back = self.housing_bore + self.pole_fillet, 0.5 * self.housing_length, 0.5 * self.coil_width
        heights = (self.pole_fillet - out, out - self.pole_fillet, back + self.pole_fillet, -back - self.pole_fillet)
        firsts = [corner + k * CHORDS for k, corner in enumerate(_POLES)]
        return [(first, first + CHORDS, np.array((r, z))) for first, z in zip(firsts, heights, strict=True)]


# Corners of the housing's polygon at the running clearance, whose edges are cut.
_POLES = (0, 3, 4, 7)


def _rectangle(r0: float, r1: float, z0: float, z1: float) -> np.ndarray:
    return np.array([(r0, z0), (r1, z0), (r1, z1), (r0, z1)])
