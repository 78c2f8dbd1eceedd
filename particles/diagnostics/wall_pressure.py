"""Pressure and shear stress of the grains on the walls, in bins along each wall, over as many moments as wished.

A contact at a wall presses it with N = f . n, f the force on the wall and n the unit vector from the grain's centre to
the point of contact, and drags it with f . t, t the direction of flow: e_phi about the axis, in a box x (y on walls
across x). The pressure of a bin is the sum of N over its area, the shear stress that of f . t; sums over the bins of a
wall are the wall's whole force. Magnetic attraction between steel and grains is not in them: it acts on the steel
through the field, and on the wall only as far as it makes grains press.

`wall_sums` takes what adds up from one moment; sums of several moments add (``+``); `wall_pressure` divides.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from itertools import pairwise

import numpy as np

from geometry.triangle_wall import TriangleWall
from geometry.walls import AnnularBox, Plane, RevolvedWall, Wall
from particles.diagnostics.bins import even_edges
from particles.diagnostics.contact_geometry import contact_geometry
from particles.diagnostics.enclosed_space import LEVEL, BoxSpace, Space
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable
from particles.sector import CyclicSector


@dataclass(frozen=True, slots=True, eq=False)
class WallBins:
    """Bins of all walls, b in all, those of a wall one after the other.

    Attributes
    ----------
    wall : ndarray of int64, shape (b,)
        Index of the wall.
    coordinate : ndarray of int64, shape (walls,)
        What a wall of revolution is divided along: 0 for r, 1 for z; -1 for a wall of one bin.
    low, high : ndarray, shape (b,)
        Limits in that coordinate [m]; nan in a wall of one bin.
    area : ndarray, shape (b,)
        In the whole device [m^2]; nan for a plane whose part at the grains is not known.
    in_ring : bool
        Whether the flow is about the axis.
    """

    wall: np.ndarray
    coordinate: np.ndarray
    low: np.ndarray
    high: np.ndarray
    area: np.ndarray
    in_ring: bool


@dataclass(frozen=True, slots=True, eq=False)
class WallSums:
    """Sums over the contacts of each of b bins at one moment, or at several, in what is simulated.

    Attributes
    ----------
    moments : ndarray, shape (1,)
        How many were added.
    normal, along, torque : ndarray, shape (b,)
        Normal force, force along the flow [N], and torque about the axis [N m] on the wall.
    contacts : ndarray, shape (b,)
        Number of contacts.
    """

    moments: np.ndarray
    normal: np.ndarray
    along: np.ndarray
    torque: np.ndarray
    contacts: np.ndarray

    def __add__(self, other: WallSums) -> WallSums:
        return WallSums(*(getattr(self, f.name) + getattr(other, f.name) for f in fields(self)))


@dataclass(frozen=True, slots=True, eq=False)
class WallPressure:
    """Mean load of the walls.

    Attributes
    ----------
    bins : WallBins
    normal_force, flow_force, torque : ndarray, shape (b,)
        Of the grains on the wall, pressing positive, whole device [N, N, N m].
    contacts : ndarray, shape (b,)
        Contacts at a moment, in what is simulated.
    moments : int
        Moments in the mean.
    """

    bins: WallBins
    normal_force: np.ndarray
    flow_force: np.ndarray
    torque: np.ndarray
    contacts: np.ndarray
    moments: int

    @property
    def pressure(self) -> np.ndarray:
        """[Pa], shape (b,)."""
        return self.normal_force / self.bins.area

    @property
    def shear_stress(self) -> np.ndarray:
        """On the wall, positive along the flow's direction [Pa], shape (b,)."""
        return self.flow_force / self.bins.area

    def over(self, chosen: np.ndarray) -> dict[str, float | None]:
        """Return area, forces, torque, pressure, shear stress and tau/P of the bins ``chosen`` together, in SI."""
        area, normal, along = (
            float(values[chosen].sum()) for values in (self.bins.area, self.normal_force, self.flow_force)
        )
        means: dict[str, float | None] = {
            "area": area, "pressure": normal / area, "shear_stress": along / area,
            "mu": abs(along) / normal if normal > 0.0 else None, "normal_force": normal,
        }  # fmt: skip
        return means | ({"torque": float(self.torque[chosen].sum())} if self.bins.in_ring else {})


def wall_bins(walls: Sequence[Wall], space: Space, width: float, cuts: Sequence[AnnularBox] = ()) -> WallBins:
    """Divide the walls of revolution into bins of about ``width`` [m]; planes and triangle walls are one bin each.

    Parameters
    ----------
    walls : sequence of Wall
    space : AnnularBox or BoxSpace
        That the walls enclose: a plane has the area of its side of the space.
    width : float
        [m]
    cuts : sequence of AnnularBox
        Pole faces, whose limits are edges of bins.
    """
    rows: list[tuple[int, float, float, float]] = []
    coordinate = np.full(len(walls), -1)
    for number, wall in enumerate(walls):
        if not isinstance(wall, RevolvedWall):
            rows.append((number, np.nan, np.nan, _area(wall, space)))
            continue
        k = int(abs(wall.end[1] - wall.start[1]) > abs(wall.end[0] - wall.start[0]))
        coordinate[number] = k
        a, b = sorted((wall.start, wall.end), key=lambda end: end[k])
        inner = {(box.r0, box.r1, box.z0, box.z1)[2 * k + side] for box in cuts for side in (0, 1)}
        margin = 0.25 * width
        parts = [a[k], *sorted(edge for edge in inner if a[k] + margin < edge < b[k] - margin), b[k]]
        edges = np.unique(np.concatenate([even_edges(low, high, width) for low, high in pairwise(parts)]))
        radius = a[0] + (b[0] - a[0]) * (edges - a[k]) / (b[k] - a[k])
        length = wall.length * np.diff(edges) / (b[k] - a[k])
        area = np.pi * (radius[1:] + radius[:-1]) * length
        rows += [(number, *row) for row in zip(edges[:-1], edges[1:], area, strict=True)]
    owner, low, high, area = np.array(rows, dtype=float).reshape(-1, 4).T
    return WallBins(owner.astype(np.int64), coordinate, low, high, area, isinstance(space, AnnularBox))


def wall_sums(grains: Grains, contacts: ContactTable, bins: WallBins, sector: CyclicSector | None = None) -> WallSums:
    """Contribution of one instant to the load of the walls in ``bins``."""
    geometry = contact_geometry(grains, contacts, sector)
    at = np.flatnonzero(contacts.wall >= 0)
    wall, point, force = contacts.wall[at], contacts.point[at], -contacts.force[at]
    if bins.in_ring:
        flow = np.column_stack([-point[:, 1], point[:, 0], np.zeros(len(at))])
        flow /= np.maximum(np.hypot(point[:, 0], point[:, 1]), 1e-300)[:, None]
    else:
        across_x = np.abs(geometry.normal[at, 0]) > LEVEL
        flow = np.where(across_x[:, None], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    where = np.stack([np.hypot(point[:, 0], point[:, 1]), point[:, 2]])
    first = np.searchsorted(bins.wall, np.arange(len(bins.coordinate) + 1))
    row = first[wall]
    for number in np.flatnonzero(bins.coordinate >= 0):
        own = np.flatnonzero(wall == number)
        inner = bins.high[first[number] : first[number + 1] - 1]  # edges between bins: beyond the ends is the last one
        row[own] += np.searchsorted(inner, where[bins.coordinate[number], own], side="right")

    def total(values: np.ndarray) -> np.ndarray:
        return np.bincount(row, values, minlength=len(bins.wall))

    return WallSums(
        moments=np.ones(1),
        normal=total(geometry.normal_force[at]),
        along=total(np.einsum("ka,ka->k", force, flow)),
        torque=total(point[:, 0] * force[:, 1] - point[:, 1] * force[:, 0]),
        contacts=total(np.ones(len(at))),
    )


def wall_pressure(sums: WallSums, bins: WallBins, n_sectors: float = 1.0) -> WallPressure:
    """The mean load that ``sums`` hold; ``n_sectors`` simulated parts are the whole device."""
    moments = float(sums.moments[0])
    scale = n_sectors / moments
    return WallPressure(
        bins, scale * sums.normal, scale * sums.along, scale * sums.torque, sums.contacts / moments, round(moments)
    )


def _area(wall: Plane | TriangleWall, space: Space) -> float:
    """Area [m^2] of a wall that is not of revolution."""
    if isinstance(wall, TriangleWall):
        a, b, c = np.moveaxis(wall.vertices[wall.triangles], 1, 0)
        return float(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1).sum())
    axes = np.flatnonzero(np.abs(wall.normal) > LEVEL)
    if not len(axes):
        return np.nan
    if isinstance(space, BoxSpace):
        return float(np.prod(np.delete(space.upper - space.lower, axes[0])))
    return float(np.pi * (space.r1**2 - space.r0**2)) if axes[0] == 2 else np.nan
