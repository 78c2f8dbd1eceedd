"""H and grad H from a table of the scalar potential: conservative forces in a smooth gap.

Without current in it a gap has curl H = 0, whatever its permeability, and H = -grad Phi.  Phi is a tensor
spline of degree 4 on a grid of rectangles, three times continuously differentiable; H and grad H are its exact
derivatives, grad H is symmetric, and for a moment parallel to H

    mu_0 (m . grad) H = mu_0 |m| grad |H|        to round-off, with the gradient of the |H| that is sampled,

so that the work of m = V M(|H|) H/|H| around a closed path, mu_0 V times the integral of M(|H|) d|H|, is zero
whatever the magnetisation curve.  A table of psi would have div B = 0 exactly and curl H = 0 only nearly: the
force of such a table does not derive from an energy.  Here div B vanishes to the interpolation's error.

`table_grid` fits it to the recovered H and grad H.
"""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
from numba import njit, prange

from field.sampling.element_sampler import RecoveredSampler
from field.sampling.locate import PointOutside
from field.sampling.result_arrays import result_arrays
from field.sampling.table_grid import TableGrid
from field.sampling.thread_count import limit_threads
from geometry.kernels.device_functions import device_function

_CHUNK = 1024  # points a task
# Powers of t for each power of s; a constant from another file would go stale in the kernel's cache.
_ROW = 5


class TableSampler:
    """H and grad H of a solved field from a table of the scalar potential of one region.

    Parameters
    ----------
    recovered : RecoveredSampler
        What is tabulated.
    grid : TableGrid or None
        None: the recovery's own, shared by all fields on its mesh.

    Raises
    ------
    NoTable
        See `TableGrid`.
    """

    def __init__(self, recovered: RecoveredSampler, grid: TableGrid | None = None) -> None:
        self.region = recovered.region
        self.grid = recovered.recovery.table_grid if grid is None else grid
        self._recovered = recovered
        self._powers = self.grid.potential(*recovered.sample(self.grid.positions))
        assert self._powers.shape[1] == _ROW * _ROW
        self._cell = np.zeros(0, dtype=np.int64)

    @cached_property
    def difference(self) -> tuple[float, float]:
        """From the element kernel: mean of |dH| over the section relative to that of |H|, and of grad H.

        A mean and not its square: grad H is not square-integrable at a steel corner.  A region with current
        shows here as well, because there is no potential.
        """
        recovery = self._recovered.recovery
        r, z = recovery.centroids.T
        position = np.column_stack((r, np.zeros(r.size), z))
        corner = recovery.points[recovery.triangles]
        u, v = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        area = np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])
        ratios = []
        for mine, theirs in zip(self.sample(position), self._recovered.sample(position), strict=True):
            axes = tuple(range(1, theirs.ndim))
            size = area @ np.sqrt((theirs**2).sum(axis=axes))
            error = area @ np.sqrt(((mine - theirs) ** 2).sum(axis=axes))
            ratios.append(float(error / size) if size > 0.0 else 0.0)
        return ratios[0], ratios[1]

    def sample(
        self, position: np.ndarray, out: tuple[np.ndarray, np.ndarray] | None = None, threads: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `FieldSampler.sample`.

        Raises
        ------
        PointOutside
            A point outside the region.
        """
        position = np.ascontiguousarray(position, dtype=float)
        H, grad = result_arrays(len(position), out)
        if len(self._cell) != len(position):
            self._cell = np.empty(len(position), dtype=np.int64)
        g = self.grid
        (r_lines, z_lines), (r_bins, z_bins) = g.knots, g.lookup
        cells = _Cells(r_lines, z_lines, r_bins, z_bins, g.number)
        with limit_threads(threads, len(position)):
            _sample(
                position, cells, g.margin, g.centre, 1.0 / g.size, self._powers,
                self._cell, H, grad,
            )  # fmt: skip
        if len(position) and self._cell.min() < 0:
            raise PointOutside.at(position[self._cell < 0], f"region {self.region!r}")
        return H, grad


class _Cells(NamedTuple):
    """Lines of the grid [m], bins in which they are looked up, and the number of each cell (-1: none)."""

    r_lines: np.ndarray
    z_lines: np.ndarray
    r_bins: np.ndarray
    z_bins: np.ndarray
    number: np.ndarray


@device_function(error_model="numpy", inline="always")
def _cell_at(r, z, r_lines, z_lines, r_bins, z_bins, number):
    """Cell of the grid, -1 outside."""
    # written so that a NaN coordinate is outside
    if not (r >= r_lines[0] and r <= r_lines[-1] and z >= z_lines[0] and z <= z_lines[-1]):
        return -1
    b = min(int((r - r_lines[0]) / (r_lines[-1] - r_lines[0]) * r_bins.size), r_bins.size - 1)
    i = r_bins[b]
    if i + 2 < r_lines.size and r >= r_lines[i + 1]:
        i += 1
    b = min(int((z - z_lines[0]) / (z_lines[-1] - z_lines[0]) * z_bins.size), z_bins.size - 1)
    j = z_bins[b]
    if j + 2 < z_lines.size and z >= z_lines[j + 1]:
        j += 1
    return number[i, j]


@njit(cache=True, error_model="numpy", nogil=True, parallel=True)
def _sample(position, cells, margin, centre, inverse_size, powers, cell, H, grad):
    n = position.shape[0]
    r_lines, z_lines, r_bins, z_bins, number = cells  # a tuple within the parallel loop would cost a sixth
    for chunk in prange((n + _CHUNK - 1) // _CHUNK):
        for k in range(chunk * _CHUNK, min(n, (chunk + 1) * _CHUNK)):
            x, y, z = position[k, 0], position[k, 1], position[k, 2]
            r = np.sqrt(x * x + y * y)
            c = _cell_at(r, z, r_lines, z_lines, r_bins, z_bins, number)
            if c < 0:
                # a hair outside a wall: the cell on its other side
                for corner in range(4):
                    d_r = margin if corner < 2 else -margin
                    d_z = margin if corner % 2 else -margin
                    c = max(c, _cell_at(r + d_r, z + d_z, r_lines, z_lines, r_bins, z_bins, number))
            cell[k] = c
            if c < 0:
                continue
            i_r, i_z = inverse_size[c, 0], inverse_size[c, 1]
            s, t = (r - centre[c, 0]) * i_r, (z - centre[c, 1]) * i_z
            # Horner with derivatives: value, first, and half the second one, in t inside and in s outside
            v0 = v1 = v2 = w0 = w1 = u0 = 0.0
            for i in range(_ROW):
                row = _ROW * i
                p0, p1, p2 = powers[c, row], 0.0, 0.0
                for j in range(1, _ROW):
                    p2 = p2 * t + p1
                    p1 = p1 * t + p0
                    p0 = p0 * t + powers[c, row + j]
                v2 = v2 * s + v1
                v1 = v1 * s + v0
                v0 = v0 * s + p0
                w1 = w1 * s + w0
                w0 = w0 * s + p1
                u0 = u0 * s + p2
            h_r, h_z = -v1 * i_r, -w0 * i_z
            rr, rz, zz = -2.0 * v2 * i_r * i_r, -w1 * i_r * i_z, -2.0 * u0 * i_z * i_z
            cos, sin, hoop = x / r, y / r, h_r / r
            H[k, 0], H[k, 1], H[k, 2] = cos * h_r, sin * h_r, h_z
            grad[k, 0, 0] = cos * cos * rr + sin * sin * hoop
            grad[k, 1, 1] = sin * sin * rr + cos * cos * hoop
            grad[k, 0, 1] = grad[k, 1, 0] = cos * sin * (rr - hoop)
            grad[k, 0, 2] = grad[k, 2, 0] = cos * rz
            grad[k, 1, 2] = grad[k, 2, 1] = sin * rz
            grad[k, 2, 2] = zz
