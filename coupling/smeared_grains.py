"""Grains spread over the section of a field's mesh: their volume and their moments, with a smooth kernel.

A grain at x_i is spread with K(s) = 105/(32 pi a^3) (1 - s^2/a^2)^2 about its centre, in the (r, z) plane

    K2(rho) = 7/(2 pi a^2) (1 - rho^2/a^2)^(5/2),        density at (r, z): K2(rho)/(angle sqrt(r r_i)),

over the angle of the simulated sector. Dividing by the geometric mean of both radii keeps it symmetric in the two
places: r alone would break the third law by a/r. M_r and M_z are those along the grain's own r and z; the mean of
M_phi about the axis makes no H and is left out.

What the kernel would put into steel is folded back at the steel's face as its image is: at a point x of powder or air
whose mirror point x* lies in steel, K2(x* - x_i) k (m_n, -m_t) is added, with k of `coupling.mirror`; of the volume K2
itself. Nothing is put into steel or beyond it, and nothing is folded past the end of a face.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from geometry.kernels.device_functions import device_function

CELLS = 2  # of the grid in which grains are searched, along the width


class SectionSmear:
    """Grains, spread with the width a; rebuilt when they have moved or changed.

    Parameters
    ----------
    place : (n, 2) float64
        r, z of the grains [m].
    volume : (n,) float64
        [m^3].
    moment : (n, 2) float64
        m_r, m_z in each grain's own half plane [A m^2].
    width : float
        a [m].
    angle : float
        Of the simulated sector [rad].
    walls : (w, 6) float64
        Steel faces, see `coupling.mirror`.
    """

    def __init__(
        self,
        place: np.ndarray,
        volume: np.ndarray,
        moment: np.ndarray,
        width: float,
        angle: float,
        walls: np.ndarray | None = None,
    ) -> None:
        self.width, self.angle = float(width), float(angle)
        self.walls = np.zeros((0, 6)) if walls is None else np.ascontiguousarray(walls, dtype=float)
        place = np.ascontiguousarray(place, dtype=float).reshape(-1, 2)
        self._cell = self.width / CELLS
        self._low = place.min(axis=0) if len(place) else np.zeros(2)
        cell = np.floor((place - self._low) / self._cell).astype(np.int64)
        self._shape = cell.max(axis=0) + 1 if len(place) else np.ones(2, dtype=np.int64)
        index = cell[:, 0] * self._shape[1] + cell[:, 1]
        order = np.argsort(index, kind="stable")
        self._start = np.concatenate(([0], np.cumsum(np.bincount(index, minlength=int(self._shape.prod())))))
        root = np.sqrt(place[order, 0])
        amounts = np.column_stack((volume, moment))[order].T / root
        self._grains = np.ascontiguousarray(np.vstack((place[order].T, amounts)))

    def at(self, points: np.ndarray, folds: np.ndarray, *, slopes: bool = True) -> np.ndarray:
        """Solid fraction, magnetisation and, with ``slopes``, its gradient at points.

        Parameters
        ----------
        points : (p, 2) float64
            r, z [m].
        folds : (p, w) bool
            Whether the mirror point in each wall lies in its steel, of `mirror_points_in_steel`.

        Returns
        -------
        (7, p) or (3, p) float64
            phi [-], M_r, M_z [A/m], dM_r/dr, dM_r/dz, dM_z/dr, dM_z/dz [A/m^2].
        """
        out = np.zeros((7 if slopes else 3, len(points)))
        _smear(
            np.ascontiguousarray(points, dtype=float), folds, self._grains, self._start, self._low, self._shape,
            self._cell, self.walls, self.width, self.angle, True if slopes else None, out,
        )  # fmt: skip
        return out


@device_function(error_model="numpy", fastmath={"contract", "reassoc"})
def _sums(r, z, grains, start, low, shape, cell, width, slopes):
    """Sums over the grains near (r, z) of (1 - rho^2/a^2)^(5/2)/sqrt(r r_i) times volume and moment, and their slopes.

    Nine numbers: volume, its slopes in r and in z, and the same of m_r and of m_z; without ``slopes`` (None) these are
    0. Grains beyond a add nothing instead of being left out, and the order of sums is free: then the processor takes
    several at once. It is the same order at every point whatever the threads.
    """
    v = v_r = v_z = p = p_r = p_z = q = q_r = q_z = 0.0
    per_a2 = 1.0 / (width * width)
    c_r, c_z = np.int64(np.floor((r - low[0]) / cell)), np.int64(np.floor((z - low[1]) / cell))
    low_z, high_z = max(c_z - CELLS, np.int64(0)), min(c_z + CELLS, shape[1] - 1)
    if low_z <= high_z:
        for i in range(max(c_r - CELLS, np.int64(0)), min(c_r + CELLS + 1, shape[0])):
            first, last = start[i * shape[1] + low_z], start[i * shape[1] + high_z + 1]
            r_g, z_g, v_g = grains[0, first:last], grains[1, first:last], grains[2, first:last]
            p_g, q_g = grains[3, first:last], grains[4, first:last]
            for g in range(r_g.shape[0]):
                dr, dz = r - r_g[g], z - z_g[g]
                left = 1.0 - (dr * dr + dz * dz) * per_a2
                left = left if left > 0.0 else 0.0
                slope = left * np.sqrt(left)
                w = left * slope
                v += w * v_g[g]
                p += w * p_g[g]
                q += w * q_g[g]
                if slopes is not None:
                    w_r, w_z = slope * dr, slope * dz
                    v_r += w_r * v_g[g]
                    v_z += w_z * v_g[g]
                    p_r += w_r * p_g[g]
                    p_z += w_z * p_g[g]
                    q_r += w_r * q_g[g]
                    q_z += w_z * q_g[g]
    root = 1.0 / np.sqrt(r)
    v, p, q = root * v, root * p, root * q
    slope, half = -5.0 * per_a2 * root, 0.5 / r
    return (
        v, slope * v_r - half * v, slope * v_z, p, slope * p_r - half * p, slope * p_z, q, slope * q_r - half * q,
        slope * q_z,
    )  # fmt: skip


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def _smear(points, folds, grains, start, low, shape, cell, walls, width, angle, slopes, out):
    scale = 7.0 / (2.0 * np.pi * width * width * angle)
    for i in prange(len(points)):
        r, z = points[i, 0], points[i, 1]
        sums = _sums(r, z, grains, start, low, shape, cell, width, slopes)
        for k in range(3):
            out[k, i] = scale * sums[3 * k]
        if slopes is not None:
            for k in range(2):
                out[3 + 2 * k, i], out[4 + 2 * k, i] = scale * sums[4 + 3 * k], scale * sums[5 + 3 * k]
        for w in range(walls.shape[0]):
            if not folds[i, w]:
                continue
            n_r, n_z = -walls[w, 3], walls[w, 2]
            h = (r - walls[w, 0]) * n_r + (z - walls[w, 1]) * n_z
            R, Z = r - 2.0 * h * n_r, z - 2.0 * h * n_z
            sums = _sums(R, Z, grains, start, low, shape, cell, width, slopes)
            # as much as would be in the steel: the rings there are R/r times as long
            more = scale * R / r
            out[0, i] += more * sums[0]
            for k in range(2):
                # P m = k (2 n (n.m) - m), and the gradient of what is mirrored
                own = n_r if k == 0 else n_z
                a_r, a_z = 2.0 * own * n_r - (1.0 if k == 0 else 0.0), 2.0 * own * n_z - (0.0 if k == 0 else 1.0)
                value = walls[w, 5] * (a_r * sums[3] + a_z * sums[6])
                out[1 + k, i] += more * value
                if slopes is not None:
                    g_r = walls[w, 5] * (a_r * sums[4] + a_z * sums[7])
                    g_z = walls[w, 5] * (a_r * sums[5] + a_z * sums[8])
                    along = g_r * n_r + g_z * n_z
                    g_r, g_z = g_r - 2.0 * along * n_r, g_z - 2.0 * along * n_z
                    # d(R/r): R = r - 2 h n_r
                    turn_r = ((1.0 - 2.0 * n_r * n_r) - R / r) / r
                    turn_z = -2.0 * n_r * n_z / r
                    out[3 + 2 * k, i] += more * g_r + scale * turn_r * value
                    out[4 + 2 * k, i] += more * g_z + scale * turn_z * value


def ring_smear(position: np.ndarray, volume: np.ndarray, moment: np.ndarray, width: float, angle: float,
               walls: np.ndarray | None = None) -> SectionSmear:  # fmt: skip
    """The smear of grains at Cartesian positions (n, 3) [m] with moments (n, 3) [A m^2]."""
    r = np.hypot(position[:, 0], position[:, 1])
    m_r = (position[:, 0] * moment[:, 0] + position[:, 1] * moment[:, 1]) / r
    place = np.column_stack((r, position[:, 2]))
    return SectionSmear(place, volume, np.column_stack((m_r, moment[:, 2])), width, angle, walls)
