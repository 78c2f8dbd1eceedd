"""The rectangular grid of a potential table and the least-squares fit of tensor splines on it; once a mesh.

Phi = sum c_ij R_i(r) Z_j(z) with B-splines R, Z of degree 4 over the lines of the grid.  The fit minimises

    integral |grad Phi + H|^2 + g^2 |grad grad Phi + grad H|^2 dr dz,      g = 0.3 cell sizes,

by 4 x 4 Gauss points in each cell of the region.  The normal matrix is a sum of products of one-dimensional
ones and is factorised once; a new field costs a product and a pair of triangular solves.
"""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp
from scipy.interpolate import BSpline

from field.sampling.recovery import RegionRecovery

DEGREE = 4
GAUSS_POINTS = 4
# Fewer cells than this between two steps of a wall would let one spline reach across the wall.
_MIN_CELLS = DEGREE
_MAX_CELLS = 20_000
# Weight of the gradients in the fit, in cell sizes: the recovered grad H is as trustworthy as the slope of
# the recovered H over a third of a cell.
_GRADIENT_WEIGHT = 0.3
_MARGIN = 1e-3  # of a cell: a centre as far outside still counts as inside

# Derivatives of Phi in r and z that are fitted.
_FITTED = ((1, 0), (0, 1), (2, 0), (1, 1), (0, 2))


class NoTable(ValueError):
    """A region or a field that a table cannot represent; the message says why."""


class TableGrid:
    """The rectangular grid of a region and the factorised fit on it; once a mesh.

    Parameters
    ----------
    recovery : RegionRecovery
    cell_size : float or None
        Largest side of a cell [m]; None: the median edge of the region's mesh.

    Attributes
    ----------
    knots : tuple of ndarray
        Lines of the grid in r and z [m].
    number : ndarray (n_r, n_z)
        Of each cell of the grid, -1 outside the region.
    positions : ndarray (n_cells * 16, 3)
        Gauss points, Cartesian [m].

    Raises
    ------
    NoTable
        The section has walls that are not parallel to an axis, or needs too many cells.
    """

    def __init__(self, recovery: RegionRecovery, cell_size: float | None = None) -> None:
        points, triangles = recovery.points, recovery.triangles
        ends = points[np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)]
        edge = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
        length = np.linalg.norm(ends[:, 1] - ends[:, 0], axis=1)
        size = float(np.median(length)) if cell_size is None else cell_size
        wall, uses = np.unique(edge, axis=0, return_counts=True)
        wall = points[wall[uses == 1]]  # (n, 2, 2)
        tolerance = 1e-7 * np.ptp(points, axis=0).max()
        along = np.abs(wall[:, 1] - wall[:, 0]) < tolerance
        if not np.all(along.any(axis=1)):
            raise NoTable("its section is not a union of rectangles parallel to the axes")
        knots = []
        for i in range(2):
            steps = np.unique(np.round(wall[along[:, i], 0, i] / tolerance)) * tolerance
            # walls' own coordinates, not the rounded ones
            steps = np.array([wall[along[:, i], 0, i][np.argmin(np.abs(wall[along[:, i], 0, i] - s))] for s in steps])
            counts = np.maximum(np.ceil(np.diff(steps) / size - 1e-6).astype(int), _MIN_CELLS)
            pieces = [np.linspace(a, b, n + 1)[:-1] for a, b, n in zip(steps, steps[1:], counts, strict=False)]
            knots.append(np.concatenate((*pieces, steps[-1:])))
        self.knots = (knots[0], knots[1])
        n_all = (knots[0].size - 1) * (knots[1].size - 1)
        if n_all > 50 * _MAX_CELLS:
            raise NoTable(f"its table would need up to {n_all} cells; the limit is {_MAX_CELLS}")
        centres = np.stack(np.meshgrid(*((k[1:] + k[:-1]) / 2 for k in knots), indexing="ij"), axis=-1)
        inside = recovery.locator.find(centres.reshape(-1, 2))[0] >= 0
        if inside.sum() > _MAX_CELLS:
            raise NoTable(f"its table would need {inside.sum()} cells; the limit is {_MAX_CELLS}")
        self.number = np.where(inside, np.cumsum(inside) - 1, -1).reshape(centres.shape[:2])
        self.cells = np.argwhere(self.number >= 0)  # (n_cells, 2)
        self._axes = tuple(_Axis(k) for k in knots)
        self.size = np.column_stack([axis.size[self.cells[:, i]] for i, axis in enumerate(self._axes)])
        self.centre = centres[self.cells[:, 0], self.cells[:, 1]]
        r = self._axes[0].gauss[self.cells[:, 0]][:, :, None]
        z = self._axes[1].gauss[self.cells[:, 1]][:, None, :]
        r, z = np.broadcast_arrays(r, z)
        self.positions = np.column_stack((r.ravel(), np.zeros(r.size), z.ravel()))
        # unknowns: splines that reach into the region
        n_z = knots[1].size - 1 + DEGREE
        spline = (self.cells[:, 0, None, None] + np.arange(DEGREE + 1)[:, None]) * n_z
        spline = spline + self.cells[:, 1, None, None] + np.arange(DEGREE + 1)
        self._unknowns, self._local = np.unique(spline.reshape(len(self.cells), -1), return_inverse=True)
        self._local = self._local.reshape(len(self.cells), -1)
        # bins no wider than a cell, so that a bin meets one line at most
        self.lookup = tuple(_bins(k) for k in knots)
        self.margin = _MARGIN * float(self.size.min())

    def _weights(self) -> np.ndarray:
        """Of the fitted derivatives in each cell, shape (5, n_cells): lengths^2 times the cell's area."""
        g = _GRADIENT_WEIGHT * self.size.min(axis=1)
        one = np.ones(len(self.cells))
        return np.array([one, one, g**2, 2.0 * g**2, g**2]) * self.size.prod(axis=1)

    @cached_property
    def _solve(self):
        """Solver of the normal equations, and the diagonal scaling that precedes it."""
        from scipy.sparse.linalg import splu

        n, m = self._unknowns.size, self._local.shape[1]
        blocks: np.ndarray = np.zeros((len(self.cells), *(DEGREE + 1,) * 4))
        for (d_r, d_z), w in zip(_FITTED, self._weights(), strict=True):
            gram_r = self._axes[0].gram[d_r][self.cells[:, 0]]
            gram_z = self._axes[1].gram[d_z][self.cells[:, 1]]
            blocks += np.einsum("c,cik,cjl->cijkl", w, gram_r, gram_z, optimize=True)
        blocks = blocks.reshape(len(self.cells), m, m)
        rows = np.repeat(self._local, m, axis=1).ravel()
        columns = np.tile(self._local, (1, m)).ravel()
        matrix = sp.csc_matrix((blocks.ravel(), (rows, columns)), shape=(n, n))
        scale = 1.0 / np.sqrt(matrix.diagonal())
        matrix = sp.diags(scale) @ matrix @ sp.diags(scale)
        # Phi is free up to a constant in each connected part: one spline of each is fixed
        _, part = sp.csgraph.connected_components(matrix, directed=False)
        pinned = np.zeros(n)
        pinned[np.unique(part, return_index=True)[1]] = 1.0
        factor = splu((matrix + sp.diags(pinned)).tocsc(), permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True})
        return factor, scale

    def potential(self, H: np.ndarray, grad: np.ndarray) -> np.ndarray:
        """Fit Phi to H (n, 3) and grad H (n, 3, 3) at `positions`.

        Returns
        -------
        ndarray (n_cells, 25)
            Coefficients of s^i t^j in each cell, i then j falling from 4; s and t are the distances from its
            centre over its sides.
        """
        data = -np.array([H[:, 0], H[:, 2], grad[:, 0, 0], 0.5 * (grad[:, 0, 2] + grad[:, 2, 0]), grad[:, 2, 2]])
        data = data.reshape(5, len(self.cells), GAUSS_POINTS, GAUSS_POINTS)
        right = np.zeros((len(self.cells), DEGREE + 1, DEGREE + 1))
        for (d_r, d_z), w, target in zip(_FITTED, self._weights(), data, strict=True):
            basis_r = self._axes[0].weighted[d_r][self.cells[:, 0]]
            basis_z = self._axes[1].weighted[d_z][self.cells[:, 1]]
            right += w[:, None, None] * (basis_r.transpose(0, 2, 1) @ target @ basis_z)
        factor, scale = self._solve
        load = np.bincount(self._local.ravel(), right.ravel(), self._unknowns.size)
        coefficient = scale * factor.solve(scale * load)
        local = coefficient[self._local].reshape(-1, DEGREE + 1, DEGREE + 1)
        taylor_r = self._axes[0].taylor[self.cells[:, 0]]
        taylor_z = self._axes[1].taylor[self.cells[:, 1]]
        powers = taylor_r @ local @ taylor_z.transpose(0, 2, 1)
        return np.ascontiguousarray(powers[:, ::-1, ::-1].reshape(len(self.cells), -1))


class _Axis:
    """B-splines of degree 4 over the lines of a grid: per cell, the five that reach into it.

    Attributes
    ----------
    size : ndarray (n,)
        Of the cells.
    gauss : ndarray (n, 4)
        Gauss points.
    weighted : list of ndarray (n, 4, 5)
        Derivatives 0, 1, 2 of the splines there times the weight of the point (their sum is 1).
    gram : list of ndarray (n, 5, 5)
        Mean over the cell of products of these derivatives.
    taylor : ndarray (n, 5, 5)
        From splines to powers of the distance from the centre over the size.
    """

    def __init__(self, lines: np.ndarray) -> None:
        n = lines.size - 1
        self.size = np.diff(lines)
        # beyond the ends the outermost cells are repeated
        before = lines[0] - self.size[0] * np.arange(DEGREE, 0, -1)
        after = lines[-1] + self.size[-1] * np.arange(1, DEGREE + 1)
        spline = BSpline(np.concatenate((before, lines, after)), np.eye(n + DEGREE), DEGREE)
        x, weight = np.polynomial.legendre.leggauss(GAUSS_POINTS)
        weight = 0.5 * weight
        centre = 0.5 * (lines[1:] + lines[:-1])
        self.gauss = centre[:, None] + 0.5 * self.size[:, None] * x
        mine = np.arange(n)[:, None] + np.arange(DEGREE + 1)
        self.weighted, self.gram = [], []
        for d in range(3):
            basis = np.take_along_axis(spline(self.gauss, nu=d), mine[:, None, :], axis=2)
            self.weighted.append(basis * weight[:, None])
            self.gram.append(basis.transpose(0, 2, 1) @ self.weighted[d])
        rows, factorial = [], 1.0
        for d in range(DEGREE + 1):
            factorial *= max(d, 1)
            at_centre = np.take_along_axis(spline(centre, nu=d), mine, axis=1)
            rows.append(at_centre * (self.size**d / factorial)[:, None])
        self.taylor = np.stack(rows, axis=1)


def _bins(lines: np.ndarray) -> np.ndarray:
    """First cell of each of equal bins between the ends."""
    n = int(np.ceil((lines[-1] - lines[0]) / np.diff(lines).min() * 1.01))
    edges = lines[0] + (lines[-1] - lines[0]) / n * np.arange(n)
    return np.clip(np.searchsorted(lines, edges, side="right") - 1, 0, lines.size - 2)
