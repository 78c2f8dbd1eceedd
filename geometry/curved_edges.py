"""Edges of a section's mesh that lie on curves: arcs, fillets, round poles, splines.

A triangle of the mesh is the straight one of its corners, and an edge of it may bulge: the element of the field is the
image of the reference triangle under the straight map plus 4 L_i L_j b for each edge i, j, with L its barycentric
coordinates and b the bulge. Its curved edge is the parabola over the chord that leaves the same area as the curve does.
Between curve and parabola lies then an area that changes its sign and falls with the fourth power of the edge's length,
so that integrals over the section are off by its sixth.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicHermiteSpline

# Least determinant of a curved element's map over that of the straight one.
_MIN_STRETCH = 0.2
# Nodes of the reference triangle of second order, corners and then the middles of the edges 01, 12, 20.
_NODES = np.array([(0.0, 0.0), (1.0, 0.0), (0.0, 1.0), (0.5, 0.0), (0.5, 0.5), (0.0, 0.5)])


@dataclass(frozen=True, slots=True, eq=False)
class CurvedEdges:
    """Edges and the pieces of curves that they stand for.

    Attributes
    ----------
    nodes : ndarray (k, 2), int64
        Ends of each edge.
    curve : ndarray (k,), int64
        Its curve.
    ends : ndarray (k, 2)
        Parameters of the curve at the ends.
    curves : tuple of CubicHermiteSpline
        (r, z) [m] of the parameter.
    """

    nodes: np.ndarray
    curve: np.ndarray
    ends: np.ndarray
    curves: tuple[CubicHermiteSpline, ...]

    def middle(self) -> np.ndarray:
        """Points (k, 2) [m] on the curves at the middle of the parameter."""
        return self._evaluate(self.ends.mean(axis=1)[:, None])[0][:, 0]

    def bulge(self) -> np.ndarray:
        """Offset (k, 2) [m] of the parabola's middle from that of the chord."""
        node, weight = np.polynomial.legendre.leggauss(8)
        middle, half = self.ends.mean(axis=1)[:, None], 0.5 * np.diff(self.ends, axis=1)
        point, slope = self._evaluate(middle + half * node)
        start, end = self._evaluate(self.ends)[0].transpose(1, 0, 2)
        chord = end - start
        length = np.linalg.norm(chord, axis=1)
        away = point - start[:, None]
        # twice the area to the right of the chord, between it and the curve
        area = ((away[..., 0] * slope[..., 1] - away[..., 1] * slope[..., 0]) * weight).sum(axis=1) * half[:, 0]
        # a parabola of height b over a chord of length c holds the area 2 b c/3
        height = 0.75 * area / length
        return np.column_stack((chord[:, 1], -chord[:, 0])) * (height / length)[:, None]

    def halved(self, middle: np.ndarray) -> CurvedEdges:
        """The edges with some cut in two at new nodes (k,); -1: the edge stays."""
        cut = middle >= 0
        centre = self.ends.mean(axis=1)
        first = np.column_stack((self.nodes[:, 0], np.where(cut, middle, self.nodes[:, 1])))
        first_ends = np.column_stack((self.ends[:, 0], np.where(cut, centre, self.ends[:, 1])))
        second, second_ends = np.column_stack((middle, self.nodes[:, 1])), np.column_stack((centre, self.ends[:, 1]))
        return CurvedEdges(
            np.concatenate((first, second[cut])),
            np.concatenate((self.curve, self.curve[cut])),
            np.concatenate((first_ends, second_ends[cut])),
            self.curves,
        )

    def without(self, triangles: np.ndarray) -> CurvedEdges | None:
        """The edges that are none of some triangles; None where no edge is left."""
        most = int(max(triangles.max(), self.nodes.max())) + 1
        sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2) @ (most, 1)
        kept = ~np.isin(np.sort(self.nodes, axis=1) @ (most, 1), sides)
        return CurvedEdges(self.nodes[kept], self.curve[kept], self.ends[kept], self.curves) if kept.any() else None

    def of_triangles(self, triangles: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Triangles with a curved edge (m,), and the bulges of their edges 01, 12, 20, shape (m, 3, 2) [m]."""
        sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2)
        most = int(triangles.max()) + 1
        own = np.sort(self.nodes, axis=1)
        order = np.argsort(own[:, 0] * most + own[:, 1])
        key = (own[:, 0] * most + own[:, 1])[order]
        side_key = sides[..., 0] * most + sides[..., 1]
        at = np.minimum(np.searchsorted(key, side_key), key.size - 1)
        is_curved = key[at] == side_key
        element = np.flatnonzero(is_curved.any(axis=1))
        bulge = np.where(is_curved[element, :, None], self.bulge()[order[at[element]]], 0.0)
        return element, bulge

    def tangled(self, points: np.ndarray, triangles: np.ndarray) -> np.ndarray:
        """Triangles (m,) whose bulges are too large for their corners: these must be divided."""
        element, bulge = self.of_triangles(triangles)
        corner, second, third = (points[triangles[element, i]] for i in range(3))
        map_slopes = np.stack((second - corner, third - corner), axis=2)[:, None]
        map_slopes = map_slopes + np.einsum("eki,qkj->eqij", bulge, edge_functions(_NODES)[1])
        at_nodes = np.linalg.det(map_slopes)
        # a quadratic polynomial is nowhere below the least of its Bernstein coefficients
        at_corners = at_nodes[:, :3]
        between = 2.0 * at_nodes[:, 3:] - 0.5 * (at_corners + np.roll(at_corners, -1, axis=1))
        straight = np.linalg.det(np.stack((second - corner, third - corner), axis=2))
        return element[np.minimum(at_corners, between).min(axis=1) < _MIN_STRETCH * straight]

    def _evaluate(self, parameter: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Points and derivatives (k, q, 2) of each edge's curve at parameters (k, q)."""
        point, slope = np.empty((*parameter.shape, 2)), np.empty((*parameter.shape, 2))
        for number, curve in enumerate(self.curves):
            own = self.curve == number
            point[own], slope[own] = curve(parameter[own]), curve(parameter[own], 1)
        return point, slope


def edge_functions(points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """4 L_i L_j of the edges 01, 12, 20 at points (q, 2) of the reference triangle, (q, 3), and gradients (q, 3, 2)."""
    x, y = points.T
    values = np.column_stack((4.0 * x * (1.0 - x - y), 4.0 * x * y, 4.0 * y * (1.0 - x - y)))
    along_x = np.column_stack((4.0 * (1.0 - 2.0 * x - y), 4.0 * y, -4.0 * y))
    along_y = np.column_stack((-4.0 * x, 4.0 * x, 4.0 * (1.0 - x - 2.0 * y)))
    return values, np.stack((along_x, along_y), axis=2)
