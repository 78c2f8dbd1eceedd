"""Views of shapes with the keys and values of their dimensions: what `geometry.dimension_drawing` draws.

The parts are those of the shape itself. What is thinner than `THIN` of the drawing is drawn so thick, that a gap of a
millimetre has room for its arrows: proportions are those of the shape, gaps and walls are not.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Sequence
from dataclasses import asdict, dataclass, replace
from math import cos, pi, sin

import numpy as np
from scipy.spatial import ConvexHull

from geometry.annular_cell import ShearCell
from geometry.centrifugal import CentrifugalClutch, vane_outline
from geometry.clutch import Clutch
from geometry.fault import millimetres
from geometry.slots import Slots
from geometry.triangle_wall import TriangleWall

Point = tuple[float, float]
THIN = 0.06
"""Over the outer radius."""
DEFAULT = " (default)"
WIDER = " (thin parts are drawn thicker)"


@dataclass(frozen=True, slots=True)
class Dimension:
    """A dimension of a view.

    Attributes
    ----------
    key : str
    value : float
        Its length [m], written beside it: what is thin is drawn thicker.
    start, end : tuple of 2 floats
        Points [m] between which it is measured, along x or along y.
    line : float
        Where its line lies [m], across the direction in which it is measured; extension lines lead there.
    along_x : bool
        Whether it is measured along x.
    note : str
        Written behind the value.
    """

    key: str
    value: float
    start: Point
    end: Point
    line: float
    along_x: bool
    note: str = ""

    @property
    def text(self) -> str:
        """What is written beside it."""
        return f"{self.key} = {millimetres(self.value)}{self.note}"

    def ends(self) -> tuple[Point, Point]:
        """Return both ends of its line [m]."""
        if self.along_x:
            return (self.start[0], self.line), (self.end[0], self.line)
        return (self.line, self.start[1]), (self.line, self.end[1])


@dataclass(frozen=True, slots=True)
class View:
    """A section, or what is seen along the axis.

    Attributes
    ----------
    title, x_label, y_label : str
    parts : sequence of (str, ndarray)
        Name and outline (n, 2) [m] of each part, those in front last.
    dimensions : sequence of Dimension
    notes : sequence of (str, point, point)
        Text of a key that is no distance in this view, what it points at, and where the text stands [m].
    """

    title: str
    x_label: str
    y_label: str
    parts: Sequence[tuple[str, np.ndarray]]
    dimensions: Sequence[Dimension]
    notes: Sequence[tuple[str, Point, Point]] = ()


def mark_defaults(view: View, keys: Collection[str]) -> View:
    """Return a view in which values of some keys are marked as defaults."""

    def marked(found: re.Match[str]) -> str:
        return found[0] + DEFAULT if found[1] in keys else found[0]

    dimensions = [replace(one, note=DEFAULT) if one.key in keys else one for one in view.dimensions]
    notes = [(re.sub(r"(\w+) =\s[\d.]+( mm)?", marked, text), at, stands) for text, at, stands in view.notes]
    return replace(view, dimensions=dimensions, notes=notes)


def clutch_views(clutch: Clutch) -> list[View]:
    """Return the upper half of a clutch's section, z to the right, and a pitch of each of its bodies that has slots."""
    c = _thickened(clutch)
    sizes = asdict(clutch) | {"coil_radius": clutch.coil_inner_radius, "housing_width": clutch.housing_length}
    u, end = 0.01 * c.outer_radius, max(0.5 * c.housing_length, 0.5 * c.rotor_length)
    face, chamber, rotor = 0.5 * c.disc_thickness, 0.5 * c.cavity_length, 0.5 * c.rotor_length
    tip = rotor + 2.0 * c.shaft_radius
    coil, ring, housing = 0.5 * c.coil_width, 0.5 * c.ring_width, 0.5 * c.housing_length
    right, left = end + 8.0 * u, -tip
    stack = (
        ("gap", c.disc_radius, c.bore_radius, face),
        ("rotor_wall", c.bore_radius, c.rotor_radius, rotor),
        ("clearance", c.rotor_radius, c.housing_bore, rotor),
        ("coil_height", c.coil_inner_radius, c.coil_outer_radius, coil),
        ("yoke", c.coil_outer_radius, c.outer_radius, housing),
    )
    from_axis = (
        ("seal_radius", c.seal_radius, -face, 6.0),
        ("disc_radius", c.disc_radius, -face, 14.0),
        ("coil_radius", c.coil_inner_radius, -coil, 22.0),
    )
    below = (("cover_thickness", chamber, rotor, 8.0), ("face_gap", face, chamber, 16.0),
             ("disc_thickness", -face, face, 24.0))  # fmt: skip
    above = (("housing_width", housing, c.outer_radius, 6.0), ("coil_width", coil, c.coil_outer_radius, 14.0),
             ("ring_width", ring, c.rotor_radius, 22.0))  # fmt: skip
    dimensions = [
        *(Dimension(key, sizes[key], (z, low), (z, high), right, False) for key, low, high, z in stack),
        *(Dimension(key, sizes[key], (z, 0.0), (z, r), left - away * u, False) for key, r, z, away in from_axis),
        Dimension("shaft_radius", clutch.shaft_radius, (tip, 0.0), (tip, c.shaft_radius), tip + 6.0 * u, False),
        *(
            Dimension(key, sizes[key], (low, c.seal_radius), (high, c.seal_radius), -away * u, True)
            for key, low, high, away in below
        ),
        *(Dimension(key, sizes[key], (-z, r), (z, r), c.outer_radius + away * u, True) for key, z, r, away in above),
    ]
    edge = (-housing, c.housing_bore)
    corner = "pole_fillet" if clutch.pole_fillet else "pole_chamfer"
    stands = (0.5 * (left - housing) - 8.0 * u, c.outer_radius + 10.0 * u)
    notes = [(f"{corner} =\n{millimetres(sizes[corner])}", edge, stands)]
    parts = [(name, polygon[:, ::-1]) for name, polygons in c.section_polygons().items() for polygon in polygons]
    section = View(f"Section, upper half{WIDER}", "z, the axis", "r", parts, dimensions, notes)
    slotted = {"disc_slots": clutch.disc_slots, "rotor_slots": clutch.rotor_slots}
    return [section, *(_slots_view(clutch, key, slots) for key, slots in slotted.items() if slots is not None)]


def _slots_view(clutch: Clutch, key: str, slots: Slots) -> View:
    """Return one pitch of the disc or the rotor with slots, as it is seen along the axis, the rim gap drawn thicker."""
    c = replace(clutch, gap=max(clutch.gap, 0.5 * THIN * clutch.outer_radius))
    top, side, edge = 0.5 * pi, 0.5 * slots.pitch, 0.5 * slots.fraction * slots.pitch
    in_disc = key == "disc_slots"
    r0, r1 = (c.disc_radius - slots.depth, c.disc_radius) if in_disc else (c.bore_radius, c.bore_radius + slots.depth)
    root = max(0.0, c.disc_radius - 2.0 * max(slots.depth, THIN * c.outer_radius))
    parts = [
        ("rotor", _ring_part(c.bore_radius, c.rotor_radius, top - side, top + side)),
        ("powder", _ring_part(c.disc_radius, c.bore_radius, top - side, top + side)),
        ("disc", _ring_part(root, c.disc_radius, top - side, top + side)),
        ("slot, filled flush", _ring_part(r0, r1, top - edge, top + edge)),
    ]
    u = 0.03 * (c.rotor_radius - root)
    depth = Dimension("depth", slots.depth, (0.0, r0), (0.0, r1), c.rotor_radius * sin(side) + 3.0 * u, False)
    words = f"count = {slots.count}\nfraction = {slots.fraction:.3g}\nof the pitch"
    note = (words, (0.0, r0 if in_disc else r1), (0.0, root - 4.0 * u))
    return View(f"[geometry.{key}], seen along the axis", "x", "y", parts, [depth], [note])


def _ring_part(r0: float, r1: float, start: float, end: float) -> np.ndarray:
    angles = np.linspace(start, end, 41)
    arc = np.column_stack((np.cos(angles), np.sin(angles)))
    return np.vstack((r0 * arc, r1 * arc[::-1]))


def _thickened(clutch: Clutch) -> Clutch:
    """Return the clutch with gaps and walls that have room for arrows, and a chamfer that is seen."""
    thin = THIN * clutch.outer_radius
    names = ("gap", "face_gap", "rotor_wall", "ring_width", "cover_thickness", "clearance", "coil_height", "yoke")
    wide = {name: max(thin, getattr(clutch, name)) for name in names}
    return replace(
        clutch,
        **wide,
        seal_radius=min(clutch.seal_radius, clutch.disc_radius - 2.0 * thin),
        shaft_radius=min(max(thin, clutch.shaft_radius), clutch.disc_radius - 4.0 * thin),
        disc_thickness=max(clutch.disc_thickness, 2.0 * thin),
        coil_radius=None,
        housing_width=None,
        pole_chamfer=0.4 * thin if clutch.pole_chamfer else 0.0,
        pole_fillet=0.4 * thin if clutch.pole_fillet else 0.0,
        disc_slots=None,
        rotor_slots=None,
    )


def cell_views(cell: ShearCell) -> list[View]:
    """Return the upper half of a shear cell's section, z to the right."""
    inner, outer, half = cell.inner_radius, cell.outer_radius, 0.5 * cell.height
    outer = max(outer, (1.0 + 3.0 * THIN) * inner)
    u = 0.01 * outer
    wall, right = 4.0 * u, half + 4.0 * u
    parts = [
        ("disc", _rectangle(-half, half, 0.0, inner)),
        ("powder", _rectangle(-half, half, inner, outer)),
        ("rotor", _rectangle(-half, half, outer, outer + wall)),
        ("housing", _rectangle(-half - wall, -half, inner, outer)),
        ("housing", _rectangle(half, half + wall, inner, outer)),
    ]
    dimensions = [
        Dimension("inner_radius", cell.inner_radius, (-half, 0.0), (-half, inner), -right - 6.0 * u, False),
        Dimension("outer_radius", cell.outer_radius, (half, 0.0), (half, outer), right + 6.0 * u, False),
        Dimension("height", cell.height, (-half, outer), (half, outer), outer + wall + 8.0 * u, True),
    ]
    return [View(f"Section, upper half{WIDER}", "z, the axis", "r", parts, dimensions)]


def centrifugal_views(clutch: CentrifugalClutch) -> list[View]:
    """Return a shot clutch as it is seen along its axis, and one of its vanes in the section, with what it has."""
    thin = THIN * clutch.drum_radius
    names = ("vane_thickness", "tip_clearance", "side_clearance", "rib_height")
    c = replace(clutch, **{name: max(thin, getattr(clutch, name)) for name in names})
    u, R, tip, t = 0.01 * c.drum_radius, c.drum_radius, c.tip_height, 0.5 * c.vane_thickness
    end, half, side = 0.5 * c.width, 0.5 * c.width - c.side_clearance, c.drum_radius * 1.08
    bodies = [wall for wall in c.walls() if isinstance(wall, TriangleWall)]
    outlines = [
        ("vane" if "vane" in wall.name else "rib", wall.vertices[ConvexHull(wall.vertices[:, :2]).vertices, :2])
        for wall in bodies
    ]
    front = [("drum", _circle(side)), ("shot", _circle(R)), *outlines, ("hub", _circle(c.hub_radius))]
    seen = [
        Dimension("hub_radius", c.hub_radius, (0.0, 0.0), (0.0, c.hub_radius), -side - 20.0 * u, False),
        Dimension("drum_radius", R, (0.0, 0.0), (0.0, R), -side - 8.0 * u, False),
        Dimension("vane_thickness", clutch.vane_thickness, (tip, -t), (tip, t), side + 8.0 * u, False),
    ]
    notes = [(f"vanes = {c.vanes}", (0.5 * (c.hub_radius + tip), -t), (0.5 * R, -side - 14.0 * u))]
    parts = [
        ("drum", _rectangle(-end - 8.0 * u, end + 8.0 * u, c.hub_radius, side)),
        ("shot", _rectangle(-end, end, c.hub_radius, R)),
        *([("rib", _rectangle(-end, end, c.rib_radius, R))] if c.ribs else []),
        ("vane", vane_outline(c)),
        ("hub", _rectangle(-end - 8.0 * u, end + 8.0 * u, 0.0, c.hub_radius)),
    ]
    right, below = end + 8.0 * u, tip - 30.0 * u
    line = right + 8.0 * u
    section = [
        Dimension("width", clutch.width, (-end, R), (end, R), side + 8.0 * u, True),
        Dimension("side_clearance", clutch.side_clearance, (half, below), (end, below), -8.0 * u, True),
        Dimension("tip_clearance", clutch.tip_clearance, (half, c.tip_radius), (half, c.rib_radius), line, False),
    ]
    in_vane = []
    if c.ribs:
        angle = pi / c.ribs
        words, rib = f"ribs = {c.ribs}\nrib_width = {millimetres(clutch.rib_width)}", -c.rib_radius
        notes.append((words, (rib * cos(angle), rib * sin(angle)), (-0.75 * R, -side - 14.0 * u)))
        section.append(Dimension("rib_height", clutch.rib_height, (end, c.rib_radius), (end, R), line, False))
    if c.slots:
        tooth, floor = -half + c.tooth_width, tip - c.slot_depth
        section += [
            Dimension("slot_width", c.slot_width, (tooth, tip), (tooth + c.slot_width, tip), -20.0 * u, True),
            Dimension("slot_depth", c.slot_depth, (tooth, floor), (tooth, tip), -right - 10.0 * u, False),
        ]
        middle = tooth + 0.5 * c.slot_width
        in_vane.append((f"slots = {c.slots}\nin each vane", (middle, floor), (middle, floor - 18.0 * u)))
    return [
        View(f"Seen along the axis{WIDER}", "x", "y", front, seen, notes),
        View("Section through a vane", "z, the axis", "r", parts, section, in_vane),
    ]


def box_views(size: Sequence[float]) -> list[View]:
    """Return a box as it is seen along y and along z."""
    x, y, z = size
    away = 0.08 * max(size)
    views = []
    for title, across, (up, key) in (("Seen along y", "z", (z, "size[2]")), ("Seen along z", "y", (y, "size[1]"))):
        dimensions = [
            Dimension("size[0]", x, (-0.5 * x, up), (0.5 * x, up), up + away, True),
            Dimension(key, up, (0.5 * x, 0.0), (0.5 * x, up), 0.5 * x + away, False),
        ]
        views.append(View(title, "x", across, [("powder", _rectangle(-0.5 * x, 0.5 * x, 0.0, up))], dimensions))
    return views


def _rectangle(x0: float, x1: float, y0: float, y1: float) -> np.ndarray:
    return np.array([(x0, y0), (x1, y0), (x1, y1), (x0, y1)])


def _circle(radius: float) -> np.ndarray:
    angles = np.linspace(0.0, 2.0 * pi, 181)[:-1]
    return radius * np.column_stack((np.cos(angles), np.sin(angles)))
