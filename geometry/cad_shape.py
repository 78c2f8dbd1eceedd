"""Shape of a device from CAD: the powder's outline as walls of bodies, and the boxes to fill.

The section of `cad_meshing` says what lies behind each edge of the powder's outline; each region belongs to a body
(shaft), and runs of edges of one body become one outline, whose inner corners have an owner each (`walls.outline`).
To be filled, the powder's region must consist of rectangles: edges along r or z.
"""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import groupby, pairwise

import numpy as np

from geometry.annular_spaces import AnnularSpaces
from geometry.cad_meshing import CadSection, OutlineEdge
from geometry.fault import GeometryFault, millimetres
from geometry.sheared_gap import ShearedGap
from geometry.walls import AnnularBox, Pair, RevolvedWall, outline

BODIES: Mapping[str, str] = {
    "disc": "disc",
    "shaft_out": "disc",
    "housing": "housing",
    "coil": "housing",
    "yoke": "housing",
    "air": "housing",
}
"""Body of a region by its name; every other region turns with the rotor."""

_CLOSE = 1e-8  # m; ends of edges that are one corner


@dataclass(frozen=True, slots=True)
class FacingPart:
    """Part of the powder's space between two parallel faces, with the regions behind the lower and the upper one.

    `radial` where its width is along r.
    """

    box: AnnularBox
    radial: bool
    regions: tuple[str, str]

    @property
    def width(self) -> float:
        """Distance of the two faces [m]."""
        return self.box.r1 - self.box.r0 if self.radial else self.box.z1 - self.box.z0

    @property
    def area(self) -> float:
        """In the middle of the gap [m^2]."""
        return self.box.volume() / self.width

    @property
    def radius(self) -> float:
        """Mean lever of a stress there [m]."""
        r0, r1 = self.box.r0, self.box.r1
        return 0.5 * (r0 + r1) if self.radial else 2.0 / 3.0 * (r1**3 - r0**3) / (r1**2 - r0**2)


def mean_radius(parts: Sequence[FacingPart]) -> float:
    """Mean lever [m] of a stress that is the same in all parts."""
    return sum(part.area * part.radius for part in parts) / sum(part.area for part in parts)


@dataclass(frozen=True, slots=True)
class CadShape(AnnularSpaces):
    """Walls and boxes of a device from CAD.

    Parameters
    ----------
    section : CadSection
    bodies : mapping of str to str
        Body of a region, where it is another than that of `BODIES`.
    magnetic : collection of str
        Regions whose faces mirror dipoles.
    """

    section: CadSection
    bodies: Mapping[str, str] = field(default_factory=dict)
    magnetic: frozenset[str] = frozenset()

    def body(self, region: str) -> str:
        """The body (shaft) that a region turns with."""
        return self.bodies.get(region, BODIES.get(region, "rotor"))

    @property
    def bodies_at_powder(self) -> frozenset[str]:
        """Bodies whose parts border the powder: of one alone nothing is sheared. Air counts if `bodies` names it."""
        solid = {edge.region for edge in self.section.powder_outline} - ({"air"} - self.bodies.keys())
        return frozenset(map(self.body, solid))

    def facing_parts(self) -> list[FacingPart]:
        """Thin parts of the powder's space, each with one region at each of its two faces.

        They are cut where the region of a face ends. A part that is open to further powder at a face is left out.
        """
        found = []
        for box in self.fill_boxes().values():
            size = np.array([box.r1 - box.r0, box.z1 - box.z0])
            across = int(np.argmin(size))
            if size[across] >= 1.5 * self.gap:
                continue
            low, high = np.array([box.r0, box.z0]), np.array([box.r1, box.z1])
            faces = [self._face(across, at[across], low[1 - across], high[1 - across]) for at in (low, high)]
            cuts = _distinct([end for face in faces for piece in face for end in piece[:2]])
            for start, end in pairwise(cuts):
                middle = 0.5 * (start + end)
                regions = [next((of for a, b, of in face if a < middle < b), "") for face in faces]
                if all(regions):
                    r, z = ((box.r0, box.r1), (start, end)) if across == 0 else ((start, end), (box.z0, box.z1))
                    found.append(FacingPart(AnnularBox(*r, *z), across == 0, (regions[0], regions[1])))
        return found

    def _face(self, across: int, at: float, low: float, high: float) -> list[tuple[float, float, str]]:
        """Pieces (start, end, region) of the powder's outline on a face, the coordinate `across` being `at` there."""
        found = []
        for edge in self.section.powder_outline:
            ends = np.array([edge.start, edge.end])
            start, end = np.clip(np.sort(ends[:, 1 - across]), low, high)
            if np.abs(ends[:, across] - at).max() < _CLOSE < end - start:
                found.append((float(start), float(end), edge.region))
        return found

    def sheared_parts(self) -> list[FacingPart]:
        """Those between two bodies, one of which is the disc where it is at the powder at all."""
        if len(self.bodies_at_powder) < 2:
            return []
        disc = {"disc"} & self.bodies_at_powder
        solid = [part for part in self.facing_parts() if "air" not in part.regions or "air" in self.bodies]
        bodies = [set(map(self.body, part.regions)) for part in solid]
        return [part for part, of in zip(solid, bodies, strict=True) if len(of) == 2 and disc <= of]

    @property
    def carriers(self) -> frozenset[str]:
        """Bodies that parts belong to which are no bodies of revolution: the field turns with them."""
        return frozenset(self.body(region) for region in self.section.odd)

    @property
    def gap(self) -> float:
        """Smallest width of the powder's space [m]."""
        return self.section.gap

    @property
    def mean_gap_radius(self) -> float:
        """Mean radius [m] of the sheared gaps along r or along z, of those with the greater area.

        Without a sheared gap: halfway between the disc's outermost wall and what faces it.
        """
        if sheared := self.sheared_parts():
            ways = ([part for part in sheared if part.radial == radial] for radial in (True, False))
            return mean_radius(max(ways, key=lambda parts: sum(part.area for part in parts)))
        disc = [
            max(edge.start[0], edge.end[0]) for edge in self.section.powder_outline if self.body(edge.region) == "disc"
        ]
        return (max(disc) if disc else self.bore_radius) + (0.5 * self.gap if disc else 0.0)

    @property
    def bore_radius(self) -> float:
        """Largest radius [m] of the powder's space."""
        return max((max(edge.start[0], edge.end[0]) for edge in self.section.powder_outline), default=0.0)

    @property
    def largest_radius(self) -> float:
        """Largest radius [m] at which a wall touches grains."""
        return self.bore_radius

    def sheared_gap(self, region: str = "cavity") -> ShearedGap:
        """The smallest width of the powder's space; a file says of no region."""
        return ShearedGap(self.mean_gap_radius, self.gap, self.gap)

    def gap_parts(self, boxes: Sequence[AnnularBox]) -> list[tuple[AnnularBox, bool]]:
        """`sheared_parts`, and whether the gap's width is along r: a drawing is filled as a whole."""
        return [(part.box, part.radial) for part in self.sheared_parts()]

    @property
    def coil_area(self) -> float:
        """Section of the winding [m^2], the parts named coil."""
        return sum(part.size for part in self.section.parts if part.region == "coil")

    @property
    def coil_mean_radius(self) -> float:
        """Mean radius of the winding [m]: a mean turn is 2 pi times as long."""
        return sum(part.size * part.radius for part in self.section.parts if part.region == "coil") / self.coil_area

    def pole_parts(self) -> list[FacingPart]:
        """Sheared parts with steel at both faces."""
        return [part for part in self.sheared_parts() if self.magnetic.issuperset(part.regions)]

    @property
    def ring_width(self) -> float:
        """Axial width [m] that the middle of the gap leaves out: none, a file does not say where poles end."""
        return 0.0

    def air_gaps(self) -> dict[str, list[AnnularBox]]:
        """No part of the air by name: a file does not say what is a clearance."""
        return {}

    def gap_midline(self, count: int = 101) -> np.ndarray:
        """Points (r, z) [m] along the middle of the largest gap, a gap's width short of its ends; shape (count, 2)."""
        boxes = list(self.fill_boxes().values())
        box = max([box for box, _ in self.gap_parts(boxes)] or boxes, key=lambda box: box.volume())
        wide = box.r1 - box.r0, box.z1 - box.z0
        short = min(min(wide), 0.25 * max(wide))
        along = np.linspace(short, max(wide) - short, count)
        if wide[0] < wide[1]:
            return np.column_stack((np.full(count, box.r0 + 0.5 * wide[0]), box.z0 + along))
        return np.column_stack((box.r0 + along, np.full(count, box.z0 + 0.5 * wide[1])))

    def face_midline(self, count: int = 101) -> np.ndarray:
        """As `gap_midline`: there is but one of them here."""
        return self.gap_midline(count)

    def faults(self, grain_diameter: float | None = None) -> list[GeometryFault]:
        """Return why grains cannot be filled in: no powder region, not a set of rectangles, a gap below a grain."""
        if not self.section.powder_outline:
            return [_fault("no part of the file is the powder: grains have no space", "a part named powder",
                           "draw the space of the grains as a part of its own, named powder")]  # fmt: skip
        faults = []
        for edge in self.section.powder_outline:
            if not _same(edge.start[0], edge.end[0]) and not _same(edge.start[1], edge.end[1]):
                place = f"r = {millimetres(edge.start[0])}, z = {millimetres(edge.start[1])}"
                faults.append(_fault(f"the powder's outline runs obliquely at {place}", "edges along r or z",
                                    "draw the space of the grains of rectangles"))  # fmt: skip
                break
        if grain_diameter is not None and self.gap < grain_diameter:
            grain = millimetres(grain_diameter)
            reason = f"the powder's gap of {millimetres(self.gap)} is smaller than one grain ({grain}): no grain fits"
            faults.append(_fault(reason, f"at least {grain}", "widen it, or lower `grain_diameter`"))
        return faults

    def walls(self) -> list[RevolvedWall]:
        """The walls around the powder, each belonging to its region's body."""
        walls: list[RevolvedWall] = []
        for regions, corners, is_closed in _chains(self.section.powder_outline):
            bodies = [self.body(region) for region in regions]
            begins = [k for k in range(len(bodies)) if bodies[k] != bodies[k - 1]]  # of a closed chain
            if is_closed and begins:  # begin where a body begins
                first = begins[0]
                regions, bodies = regions[first:] + regions[:first], bodies[first:] + bodies[:first]
                corners = corners[first:-1] + corners[: first + 1]
            start = 0
            for body, run in groupby(bodies):
                end = start + len(list(run))
                names = [f"{region}_{len(walls) + k}" for k, region in enumerate(regions[start:end], 1)]
                steel = [region in self.magnetic for region in regions[start:end]]
                is_loop = is_closed and not begins
                walls += outline(names, body, corners[start : end + (not is_loop)], is_loop, magnetic=steel)
                start = end
        return walls

    def fill_boxes(self) -> dict[str, AnnularBox]:
        """Disjoint rectangles of the powder's space, ``part_1`` and so on, the ones at small radius first."""
        edges = self.section.powder_outline
        r = _distinct([x for edge in edges for x in (edge.start[0], edge.end[0])])
        z = _distinct([x for edge in edges for x in (edge.start[1], edge.end[1])])
        # A cell between two radii is inside where a line along z has crossed the outline an odd number of times.
        boxes: list[AnnularBox] = []
        for r0, r1 in pairwise(r):
            middle = 0.5 * (r0 + r1)
            crossed = sorted(
                edge.start[1]
                for edge in edges
                if _same(edge.start[1], edge.end[1]) and min(edge.start[0], edge.end[0]) < middle
                and middle < max(edge.start[0], edge.end[0])
            )  # fmt: skip
            for z0, z1 in zip(crossed[::2], crossed[1::2], strict=True):
                last = next((b for b in boxes if _same(b.r1, r0) and _same(b.z0, z0) and _same(b.z1, z1)), None)
                if last is not None:
                    boxes[boxes.index(last)] = AnnularBox(last.r0, r1, z0, z1)
                else:
                    boxes.append(AnnularBox(r0, r1, _nearest(z, z0), _nearest(z, z1)))
        return {f"part_{k + 1}": box for k, box in enumerate(boxes)}


def _fault(reason: str, allowed: str, remedy: str) -> GeometryFault:
    return GeometryFault("file", "", reason, allowed, remedy)


def _chains(edges: Sequence[OutlineEdge]) -> Iterator[tuple[list[str], list[Pair], bool]]:
    """Yield edges joined end to end: the region behind each, the corners in order, and whether they are closed.

    Open chains, which end on the axis, begin at an end.
    """
    corners: list[Pair] = []

    def corner_at(point: Pair) -> Pair:
        """Return one pair of numbers for a corner: neighbours must agree to the last digit."""
        corner = next((c for c in corners if math.dist(c, point) < _CLOSE), None)
        if corner is None:
            corners.append(point)
        return corner or point

    ends = {k: (corner_at(edge.start), corner_at(edge.end)) for k, edge in enumerate(edges)}
    while ends:
        uses = Counter(corner for pair in ends.values() for corner in pair)
        here = next((corner for corner, count in uses.items() if count == 1), next(iter(uses)))
        regions, chain = [], [here]
        while (k := next((k for k, pair in ends.items() if here in pair), None)) is not None:
            start, end = ends.pop(k)
            here = end if here == start else start
            regions.append(edges[k].region)
            chain.append(here)
            if here == chain[0]:
                break
        yield regions, chain, here == chain[0]


def _same(a: float, b: float) -> bool:
    return abs(a - b) < _CLOSE


def _distinct(values: Sequence[float]) -> list[float]:
    ordered = np.sort(values)
    return [float(x) for x in ordered[np.diff(ordered, prepend=-np.inf) > _CLOSE]]


def _nearest(values: Sequence[float], x: float) -> float:
    return min(values, key=lambda value: abs(value - x))
