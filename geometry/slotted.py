"""3D mesh of a clutch with slots: triangles of its cross-section, swept around the axis layer by layer.

Everything but the slots is a body of revolution, and the slots begin and end at fixed angles: the section is
meshed once, by gmsh, and each triangle sweeps a prism from one angle of a list to the next, cut into three
tetrahedra (at the axis, where prisms are pyramids and less, two or one).  The place of the slots is `slots` in one
layer and the steel of its body in the next.  Nothing crosses in 3D, so that thin gaps are as safe as in the
section, and the two sides of the sector match of themselves.

The field varies across the gap and around the steel's corners, where the field strength is singular like
d^(-1/3): there the triangles are small, as in `geometry.meshing`.  Along the angle it varies only beside the
slots: layers are thin there and grow in proportion to the distance.  Stretched tetrahedra with right angles in the
section are as good as stout ones where the field changes slowly along them.

**The sector.** Bodies with the same symmetry repeat after the pitch 2 pi/N, N the greatest common divisor of
their counts. Where every slot pattern is its own mirror image, half a pitch between two mirror planes is
enough: there B is tangential, the natural condition of a scalar potential. Otherwise (or on request) the
mesh spans a whole pitch, and its two sides carry matching nodes (`Mesh3D.periodic`). Without slots the
sector is a wedge of any angle.

**Internal faces.** The planes of the coil's two ends, from the axis to its outer radius, and its inner and
outer cylinder between them are faces of the mesh: a source field that jumps there is integrated exactly.
"""

from __future__ import annotations

import math
from itertools import pairwise
from typing import Any

import numpy as np

from geometry.clutch import Clutch
from geometry.fault import GeometryError
from geometry.mesh_3d import EDGES, Mesh3D
from geometry.mesher import region_ranges
from geometry.meshing import powder_faces
from geometry.meshing_3d import faces_of, faces_where, finish, positive
from geometry.slotted_section import gap_size, meshed_section, refuse_too_many_layers, section_sizes

WEDGE = math.pi / 12.0
"""Angle of the sector that stands for a clutch without slots [rad]."""

_NARROWEST = math.radians(0.5)

# Thickness of the layers: beside a slot over the size of the gap's triangles, growth with the distance from there
# (about 1.8 times from layer to layer), and the greatest angle, at which the quadratic arcs of the swept edges still
# keep volumes to 1e-6.
_BESIDE_SLOT = 1.0
_LAYER_GROWTH = 0.6
_WIDEST_LAYER = math.pi / 24.0
# Two layers of quadratic elements carry a quartic in the angle, which the recovery of grad H fits.
_FEWEST_LAYERS = 2


def mesh_slotted(
    clutch: Clutch,
    *,
    gap_layers: int = 3,
    size_factor: float = 1.0,
    periodic: bool | None = None,
    wedge: float = WEDGE,
    order: int = 2,
    arc: float = math.inf,
) -> Mesh3D:
    """Tetrahedra for one sector of a clutch and the air around it.

    Parameters
    ----------
    clutch : Clutch
        Its faults are looked for first.
    gap_layers : int
        Elements across the rim gap and across the face gaps.
    size_factor : float
        Scales every element size, 0.2 to 4, but the gaps keep at least two layers.
    periodic : bool or None
        A whole pitch with matching sides. None: only where half a pitch between mirror planes will not do.
    wedge : float
        Angle of the sector of a clutch without slots [rad], a whole part of 2 pi.
    order : int
        2: curved elements; 1: flat ones.
    arc : float
        Elements in the rim gap are at most so long along the angle [m].

    Returns
    -------
    Mesh3D
        Regions of the section, and `slots`. Boundaries: `outer` (the sphere around the air), `low_side` and
        `high_side` (the two planes), and those of the powder: `rotor_bore`, `rotor_faces`, `disc_rim`,
        `disc_faces`, `seal_rim`.

    Raises
    ------
    GeometryError
        With every fault of the clutch.
    ValueError
        For slot counts without a common divisor, or numbers out of range.
    """
    faults = clutch.faults()
    if faults:
        raise GeometryError(faults)
    if gap_layers < 1 or order not in (1, 2):
        raise ValueError(f"`gap_layers` = {gap_layers} must be 1 or more and `order` = {order} must be 1 or 2")
    if not 0.2 <= size_factor <= 4.0:
        raise ValueError(f"`size_factor` = {size_factor:g}: allowed are 0.2 to 4; the default is 1")
    start, end, mirrored = _sector(clutch, periodic, wedge)
    angles = _layers(clutch, gap_layers, size_factor, start, end, arc)
    refuse_too_many_layers(section_sizes(clutch, gap_layers, size_factor), len(angles) - 1)
    section, triangles, owners = meshed_section(clutch, gap_layers, size_factor)
    points, elements, regions = _sweep(clutch, section, triangles, owners, angles, order)
    boundaries = _boundaries(points, elements[:, :4], regions, clutch, start, end)
    return finish(
        points,
        elements,
        regions,
        boundaries,
        periodic=None if mirrored else _matching(points, boundaries),
        sector_angle=end - start,
        n_sectors=round(2.0 * math.pi / (end - start)),
    )


def _sector(clutch: Clutch, periodic: bool | None, wedge: float) -> tuple[float, float, bool]:
    """First and last angle of the sector [rad], and whether its sides are mirror planes."""
    slots = [each for each in (clutch.disc_slots, clutch.rotor_slots) if each is not None]
    if not slots:
        turns = 2.0 * math.pi / wedge if wedge > 0.0 else 0.0
        if turns < 2.0 or wedge < _NARROWEST or abs(turns - round(turns)) > 1e-9 * turns:
            raise ValueError(f"`wedge` = {wedge:g} rad must be 2 pi over a whole number from 2 to 720")
        return 0.0, wedge, not periodic
    common = math.gcd(*(each.count for each in slots))
    if common == 1:
        counts = " and ".join(str(each.count) for each in slots)
        raise ValueError(
            f"{counts} slots have no common sector; choose counts with a common divisor, which then is meshed once"
        )
    pitch = 2.0 * math.pi / common
    symmetric = all(each.mirrored for each in slots)
    if periodic or not symmetric:
        if periodic is False:
            raise ValueError("the slots are not their own mirror image: half a pitch will not do; leave out `periodic`")
        start = _widest(np.concatenate([each.edges(0.0, pitch) for each in slots]), pitch)
        return start, start + pitch, False
    return 0.0, 0.5 * pitch, True


def _widest(sides: np.ndarray, pitch: float) -> float:
    """Middle of the widest step between the slots' sides: no thin slice where the sector is cut."""
    sides = np.sort(sides)
    steps = np.diff(np.append(sides, sides[0] + pitch))
    return float(sides[np.argmax(steps)] + 0.5 * steps.max()) - pitch


def _layers(clutch: Clutch, layers: int, factor: float, start: float, end: float, arc: float) -> np.ndarray:
    """Angles between which the section is swept [rad], the slots' sides among them."""
    patterns = [each for each in (clutch.disc_slots, clutch.rotor_slots) if each is not None]
    sides = np.unique(np.concatenate([each.edges(start, end) for each in patterns])) if patterns else np.zeros(0)
    # sides of two patterns that differ by rounding only are one
    sides = sides[np.append(True, np.diff(sides) > 1e-9)] if sides.size else sides
    least = _BESIDE_SLOT * gap_size(clutch.gap, layers, factor) / clutch.mean_gap_radius
    widest = min(factor * _WIDEST_LAYER, 2.0 * _WIDEST_LAYER, arc / clutch.mean_gap_radius)
    angles = [start]
    for low, high in pairwise([start, *sides.tolist(), end]):
        s = np.linspace(low, high, 513)
        distance = np.abs(s[:, None] - sides).min(axis=1) if sides.size else np.full(s.size, np.inf)
        density = 1.0 / np.minimum(least + _LAYER_GROWTH * distance, widest)
        count = np.concatenate(([0.0], np.cumsum(0.5 * (density[1:] + density[:-1]) * np.diff(s))))
        n = max(math.ceil(count[-1] - 1e-6), 1 if sides.size else _FEWEST_LAYERS)
        angles += [*np.interp(np.arange(1, n) / n, count / count[-1], s).tolist(), high]
    return np.array(angles)


def _sweep(
    clutch: Clutch, section: np.ndarray, triangles: np.ndarray, owners: list[str], angles: np.ndarray, order: int
) -> tuple[np.ndarray, np.ndarray, dict[str, np.ndarray]]:
    """Tetrahedra of the prisms between the angles.

    Returns
    -------
    points : ndarray (n, 3)
        [m], corners first.
    elements : ndarray (m, 4 or 10)
    regions : dict of str to ndarray
    """
    n_planes = len(angles)
    on_axis = section[:, 0] == 0.0
    # a node of the section is a corner in every plane, a node of the axis the same in all of them
    number = np.empty((len(section), n_planes), dtype=np.int64)
    number[on_axis] = np.arange(np.count_nonzero(on_axis))[:, None]
    n_axis, n_off = np.count_nonzero(on_axis), np.count_nonzero(~on_axis)
    number[~on_axis] = n_axis + np.arange(n_off)[:, None] + n_off * np.arange(n_planes)
    polar = np.empty((n_axis + n_off * n_planes, 3))  # (r, z, angle)
    polar[number, :2] = section[:, None, :]
    polar[number, 2] = angles
    # cutting every side of a prism from its lower node to its upper one makes neighbours agree
    a, b, c = np.sort(triangles, axis=1).T
    low, high = number[:, :-1], number[:, 1:]
    la, lb, lc, ha, hb, hc = low[a], low[b], low[c], high[a], high[b], high[c]
    prisms = ((la, lb, lc, hc), (la, lb, hb, hc), (la, ha, hb, hc))
    elements = np.concatenate([np.stack(corners, axis=-1) for corners in prisms])  # (3 m, layers, 4)
    names, kind = _layer_regions(clutch, owners, angles)
    region = np.tile(kind, (3, 1))
    ordered = np.sort(elements, axis=2)
    whole = np.all(np.diff(ordered, axis=2) > 0, axis=2)  # at the axis some have lost their volume
    elements, region = elements[whole], region[whole]
    rank = np.argsort(region, kind="stable")
    elements = positive(_cartesian(polar), elements[rank])
    if order == 2:
        ends, edge = np.unique(np.sort(elements[:, EDGES].reshape(-1, 2), axis=1), axis=0, return_inverse=True)
        middles = _middles(polar[ends[:, 0]], polar[ends[:, 1]], clutch.air_radius)
        elements = np.concatenate((elements, len(polar) + edge.reshape(-1, len(EDGES))), axis=1)
        polar = np.concatenate((polar, middles))
    counts = np.bincount(region, minlength=len(names))
    return _cartesian(polar), elements, region_ranges(dict(zip(names, counts.tolist(), strict=True)))


def _layer_regions(clutch: Clutch, owners: list[str], angles: np.ndarray) -> tuple[list[str], np.ndarray]:
    """Names of the regions, and the region of each triangle's prism in each layer, shape (m, layers)."""
    slots = {"disc_slots": clutch.disc_slots, "rotor_slots": clutch.rotor_slots}
    middle = 0.5 * (angles[1:] + angles[:-1])
    names = sorted({owner.partition("|")[0] for owner in owners} | ({"slots"} if not clutch.axisymmetric else set()))
    rows = {}
    for owner in set(owners):
        body, _, cut = owner.partition("|")
        pattern = slots.get(cut)
        rows[owner] = [names.index("slots" if pattern is not None and pattern.cuts(x) else body) for x in middle]
    return names, np.array([rows[owner] for owner in owners])


def _middles(p: np.ndarray, q: np.ndarray, air_radius: float) -> np.ndarray:
    """Middles (r, z, angle) of edges between two corners each: on the arc that a swept edge is."""
    # an edge from the axis lies at the angle of its other end
    angle = np.where(p[:, 0] == 0.0, q[:, 2], np.where(q[:, 0] == 0.0, p[:, 2], 0.5 * (p[:, 2] + q[:, 2])))
    middle = np.column_stack((0.5 * (p[:, :2] + q[:, :2]), angle))
    far = (1.0 - 1e-9) * air_radius
    outer = (np.hypot(p[:, 0], p[:, 1]) > far) & (np.hypot(q[:, 0], q[:, 1]) > far)
    middle[outer, :2] *= (air_radius / np.hypot(middle[outer, 0], middle[outer, 1]))[:, None]
    return middle


def _cartesian(polar: np.ndarray) -> np.ndarray:
    """(x, y, z) of (r, z, angle), shape (n, 3)."""
    r, z, angle = polar.T
    return np.column_stack((r * np.cos(angle), r * np.sin(angle), z))


def _boundaries(
    points: np.ndarray,
    tetrahedra: np.ndarray,
    regions: dict[str, np.ndarray],
    clutch: Clutch,
    start: float,
    end: float,
) -> dict[str, np.ndarray]:
    """Sides, outer sphere, and the faces of the powder, distinguished by where their corners lie."""
    faces, neighbours = faces_of(tetrahedra)
    outline = faces[neighbours[:, 1] < 0]
    close = 1e-7 * clutch.air_radius
    radius = np.hypot(points[:, 0], points[:, 1])

    def at_angle(angle: float) -> Any:
        return lambda p: np.abs(p[:, 1] * math.cos(angle) - p[:, 0] * math.sin(angle)) < close

    boundaries = {
        "low_side": faces_where(points, outline, at_angle(start)),
        "high_side": faces_where(points, outline, at_angle(end)),
        "outer": faces_where(points, outline, lambda p: np.linalg.norm(p, axis=1) > clutch.air_radius - close),
    }
    powder = np.zeros(len(tetrahedra) + 1, dtype=bool)  # the last stands for the outside
    powder[regions["powder"]] = True
    skin = faces[(neighbours[:, 1] >= 0) & (powder[neighbours[:, 0]] != powder[neighbours[:, 1]])]
    for name, passed in powder_faces(clutch, radius, points[:, 2]).items():
        boundaries[name] = skin[passed[skin].all(axis=1)]
    return {name: np.ascontiguousarray(boundaries[name]) for name in sorted(boundaries)}


def _matching(points: np.ndarray, boundaries: dict[str, np.ndarray]) -> np.ndarray:
    """Corner pairs (slave on `high_side`, master on `low_side`); on the axis a node is its own match, left out."""
    master, slave = (np.unique(boundaries[name]) for name in ("low_side", "high_side"))
    keys = []
    for nodes in (master, slave):
        r = np.hypot(points[nodes, 0], points[nodes, 1])
        keys.append(np.column_stack((r, points[nodes, 2])))
    from scipy.spatial import cKDTree

    distance, nearest = cKDTree(keys[0]).query(keys[1])
    if len(master) != len(slave) or distance.max(initial=0.0) > 1e-8 * np.abs(points).max():
        raise ValueError("the two sides of the sector do not match: the mesher did not copy them")
    pairs = np.column_stack((slave, master[nearest]))
    return pairs[pairs[:, 0] != pairs[:, 1]]
