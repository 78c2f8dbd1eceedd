"""Bins across a gap: shells or discs of a ring, slabs of a box.

What is known of grains and contacts is shared out among bins exactly: a grain by the volume of it that lies in each bin
(`sphere_parts`), a contact by the fraction of its line, from s_i to s_end in the coordinate s across the gap, that runs
through each. Overlaps of grains count twice in the volume.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

import numpy as np
from scipy.sparse import csr_array

from geometry.walls import AnnularBox
from particles.diagnostics.sphere_parts import cap_volume, volume_in_cylinder
from particles.diagnostics.tensors import cylindrical_frame
from particles.grains import Grains


@dataclass(frozen=True, slots=True, eq=False)
class RingBins:
    """Bins of an annular space about z.

    Attributes
    ----------
    along : "r" or "z"
        Shells between cylinders, or discs between planes normal to the axis.
    edges : ndarray, shape (bins + 1,)
        Increasing [m].
    low, high : float
        Limits of the other coordinate [m].
    angle : float
        Of the sector that is simulated [rad].
    """

    along: Literal["r", "z"]
    edges: np.ndarray
    low: float
    high: float
    angle: float = 2.0 * math.pi

    def __post_init__(self) -> None:
        _require_edges(self.edges)
        inner = self.edges[0] if self.along == "r" else self.low
        if not (self.low < self.high and inner >= 0.0):
            raise ValueError(
                f"bins along {self.along} from {self.edges[0]:g} to {self.edges[-1]:g} m between {self.low:g} and "
                f"{self.high:g} m hold no ring: radii must not be negative, the second limit not below the first"
            )

    @property
    def volumes(self) -> np.ndarray:
        """Volume of each bin in what is simulated [m^3], shape (bins,)."""
        if self.along == "r":
            return 0.5 * self.angle * np.diff(self.edges**2) * (self.high - self.low)
        return 0.5 * self.angle * (self.high**2 - self.low**2) * np.diff(self.edges)

    @property
    def n_sectors(self) -> float:
        """Number of simulated parts in the full ring."""
        return 2.0 * math.pi / self.angle

    def coordinate(self, points: np.ndarray) -> np.ndarray:
        """Coordinate across the gap [m], shape (n,)."""
        return _radius(points) if self.along == "r" else points[:, 2]

    def lever(self, points: np.ndarray) -> np.ndarray:
        """Distance from the axis [m]: speed over lever is the angular speed."""
        return _radius(points)

    def axes(self, points: np.ndarray) -> np.ndarray:
        """Rows: flow (e_phi), gradient (across the gap), third, at each point; shape (n, 3, 3)."""
        return cylindrical_frame(points)[:, [1, 0, 2] if self.along == "r" else [1, 2, 0]]

    def holds(self, points: np.ndarray) -> np.ndarray:
        """True where points lie between the limits of the other coordinate: bool, shape (n,)."""
        other = points[:, 2] if self.along == "r" else _radius(points)
        margin = 1e-6 * (self.high - self.low)  # where a limit is a wall, contacts lie on it but for round-off
        return (other >= self.low - margin) & (other <= self.high + margin)

    def moment(self, points: np.ndarray, force: np.ndarray) -> np.ndarray:
        """Moment of each force about z [N m], shape (n,)."""
        return points[:, 0] * force[:, 1] - points[:, 1] * force[:, 0]

    def grain_volumes(self, grains: Grains) -> csr_array:
        """Volume of each grain in each bin [m^3], shape (bins, n)."""
        x, radius = grains.position, grains.radius
        r, z = _radius(x), x[:, 2]
        if self.along == "r":
            low, high = self.low - z, self.high - z
            near = (high > -radius) & (low < radius)
            parts = [
                _spread(near & (np.abs(r - edge) < radius), r, radius, edge, low, high, near & (r + radius <= edge))
                for edge in self.edges
            ]
        else:  # below each plane, and between the two cylinders
            parts = []
            for edge in self.edges:
                top = np.minimum(edge - z, radius)
                inside = (top > -radius) & (r + radius > self.low) & (r - radius < self.high)
                whole = inside & (r - radius >= self.low) & (r + radius <= self.high)
                volume = np.where(whole, cap_volume(radius, top), 0.0)
                k = np.flatnonzero(inside & ~whole)
                volume[k] = volume_in_cylinder(r[k], radius[k], self.high, -np.inf, top[k]) - volume_in_cylinder(
                    r[k], radius[k], self.low, -np.inf, top[k]
                )
                parts.append(volume)
        return _differences(parts)


@dataclass(frozen=True, slots=True, eq=False)
class SlabBins:
    """Slabs of a box between planes normal to a Cartesian axis.

    Attributes
    ----------
    axis, flow : int
        Of the coordinate across (0, 1, 2 for x, y, z), and of the direction of flow.
    edges : ndarray, shape (bins + 1,)
        Increasing [m].
    area : float
        Cross-section of the box [m^2]; all grains are taken to lie in it.
    """

    axis: int
    flow: int
    edges: np.ndarray
    area: float

    def __post_init__(self) -> None:
        _require_edges(self.edges)
        if self.axis == self.flow or not {self.axis, self.flow} <= {0, 1, 2} or not self.area > 0.0:
            raise ValueError(
                f"slabs across axis {self.axis} with flow along {self.flow} and an area of {self.area:g} m^2; the "
                "axes are two different ones of 0, 1, 2, the area more than 0"
            )

    @property
    def along(self) -> str:
        """Name of the coordinate across."""
        return "xyz"[self.axis]

    @property
    def volumes(self) -> np.ndarray:
        """Volume of each slab [m^3], shape (bins,)."""
        return self.area * np.diff(self.edges)

    @property
    def n_sectors(self) -> float:
        """A box is simulated as a whole."""
        return 1.0

    def coordinate(self, points: np.ndarray) -> np.ndarray:
        """Coordinate across the slabs [m], shape (n,)."""
        return points[:, self.axis]

    def lever(self, points: np.ndarray) -> np.ndarray:
        """1: there is no axis to turn about."""
        return np.ones(len(points))

    def axes(self, points: np.ndarray) -> np.ndarray:
        """Rows: flow, gradient, third; shape (n, 3, 3)."""
        rows = np.eye(3)[[self.flow, self.axis, 3 - self.flow - self.axis]]
        return np.broadcast_to(rows, (len(points), 3, 3))

    def holds(self, points: np.ndarray) -> np.ndarray:
        """All points: a box has no other limits."""
        return np.ones(len(points), dtype=bool)

    def moment(self, points: np.ndarray, force: np.ndarray) -> np.ndarray:
        """The force itself along the flow [N], shape (n,)."""
        return force[:, self.flow]

    def grain_volumes(self, grains: Grains) -> csr_array:
        """Volume of each grain in each slab [m^3], shape (bins, n)."""
        height = grains.position[:, self.axis]
        return _differences([cap_volume(grains.radius, edge - height) for edge in self.edges])


Bins = RingBins | SlabBins


def even_edges(low: float, high: float, width: float) -> np.ndarray:
    """Edges of equal bins from ``low`` to ``high`` of about ``width`` [m], one bin at the least."""
    return np.linspace(low, high, max(1, round((high - low) / width)) + 1)


def ring_bins(
    space: AnnularBox, width: float, *, along: Literal["r", "z"] = "r", angle: float = 2.0 * math.pi
) -> RingBins:
    """Bins of about ``width`` [m] of an annular space, in a sector of ``angle`` [rad]."""
    if along == "r":
        return RingBins("r", even_edges(space.r0, space.r1, width), space.z0, space.z1, angle)
    return RingBins("z", even_edges(space.z0, space.z1, width), space.r0, space.r1, angle)


def contact_fractions(start: np.ndarray, end: np.ndarray, edges: np.ndarray) -> csr_array:
    """Fraction of each contact's line from ``start`` to ``end`` (m,) [m] in each bin, shape (bins, m)."""
    low, high = np.minimum(start, end), np.maximum(start, end)
    length = high - low
    parts = []
    for a, b in pairwise(edges):
        through = np.maximum(np.minimum(high, b) - np.maximum(low, a), 0.0)
        at = ((low >= a) & (low < b)).astype(float)  # a line along the bin lies in one
        parts.append(np.where(length > 0.0, through / np.where(length > 0.0, length, 1.0), at))
    return _rows(parts)


def _spread(cut, r, radius, edge, low, high, within) -> np.ndarray:
    """Volume of each grain inside the cylinder r = ``edge`` and between the heights ``low`` and ``high``, (n,)."""
    volume = np.zeros(len(r))
    volume[within] = cap_volume(radius[within], high[within]) - cap_volume(radius[within], low[within])
    volume[cut] = volume_in_cylinder(r[cut], radius[cut], edge, low[cut], high[cut])
    return volume


def _differences(cumulative: list[np.ndarray]) -> csr_array:
    return _rows([np.maximum(b - a, 0.0) for a, b in pairwise(cumulative)])


def _rows(parts: list[np.ndarray]) -> csr_array:
    """A sparse matrix of these rows."""
    columns = [np.flatnonzero(part) for part in parts]
    start = np.concatenate([[0], np.cumsum([len(k) for k in columns])])
    data = np.concatenate([part[k] for part, k in zip(parts, columns, strict=True)])
    return csr_array((data, np.concatenate(columns), start), shape=(len(parts), len(parts[0])))


def _radius(points: np.ndarray) -> np.ndarray:
    return np.hypot(points[:, 0], points[:, 1])


def _require_edges(edges: np.ndarray) -> None:
    if np.ndim(edges) != 1 or len(edges) < 2 or not np.all(np.diff(edges) > 0.0):
        raise ValueError(f"edges of bins must be two or more that increase, got {edges} m")
