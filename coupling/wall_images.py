"""Image dipoles of grains in steel walls.

A magnetic charge q at height h over a half-space of permeability mu_r has the image -k q at depth h,
k = (mu_r - 1)/(mu_r + 1) (Jackson §4.4 with charges for poles). A dipole m = m_n n + m_t therefore has the image
k (m_n n - m_t) at the mirrored place. A grain is pulled by its own image with
3 mu_0 k (m_t^2 + 2 m_n^2)/(64 pi h^4) and feels the images of its neighbours; the field of an image at fixed
moment gives the force F = grad(m_i . B_image) directly (no factor 1/2: the induced poles follow the grain).

Where it is valid: the mirror is the wall's tangent plane under each grain, so the cut-off must be small against
the wall's radius of curvature; only grains that face the wall (foot of the perpendicular on the wall) have an image;
one image a wall, no images of images, so the cut-off should not exceed about the gap. Steel far from
saturation has k close to 1.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from coupling.neighbour_rows import NeighbourRows
from geometry import RevolvedWall


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def _image_rows(
    position, moment, radius, start, other, shift, turn_cos, turn_sin, walls, reflection, cutoff, height, force, torque
):
    """One grain a row; walls (w, 5): r0, z0, tangent r, z, length; height (n, w) is scratch and result."""
    n = position.shape[0]
    n_walls = walls.shape[0]
    inner = 0.9 * cutoff
    for i in prange(n):
        rho = np.sqrt(position[i, 0] ** 2 + position[i, 1] ** 2)
        for w in range(n_walls):
            dr = rho - walls[w, 0]
            dz = position[i, 2] - walls[w, 1]
            along = dr * walls[w, 2] + dz * walls[w, 3]
            # signed height over the wall's line, normal = tangent turned by +90 degrees; 1e30: faces no wall
            h = -dr * walls[w, 3] + dz * walls[w, 2]
            height[i, w] = h if 0.0 <= along <= walls[w, 4] and abs(h) < cutoff else 1e30
    for i in prange(n):
        xi, yi, zi = position[i, 0], position[i, 1], position[i, 2]
        ax, ay, az = moment[i, 0], moment[i, 1], moment[i, 2]
        fx = fy = fz = 0.0
        for w in range(n_walls):
            if height[i, w] > 1e29:
                continue
            for p in range(start[i] - 1, start[i + 1]):
                j = np.int64(i)  # the grain's own image first
                c = 1.0
                s = 0.0
                if p >= start[i]:
                    j = np.int64(other[p])
                    c = turn_cos[shift[p]]
                    s = turn_sin[shift[p]]
                h = height[j, w]
                if h > 1e29 or h * height[i, w] < 0.0:
                    continue
                xj = c * position[j, 0] - s * position[j, 1]
                yj = s * position[j, 0] + c * position[j, 1]
                rho = np.sqrt(xj * xj + yj * yj)
                nx = -walls[w, 3] * xj / rho
                ny = -walls[w, 3] * yj / rho
                nz = walls[w, 2]
                # |h| no smaller than the radius: an overlapping grain's poles do not enter the steel
                push = 2.0 * h
                if abs(h) < radius[j]:
                    push = 2.0 * radius[j] if h > 0.0 else -2.0 * radius[j]
                dx = xi - (xj - push * nx)
                dy = yi - (yj - push * ny)
                dz = zi - (position[j, 2] - push * nz)
                r2 = dx * dx + dy * dy + dz * dz
                if r2 >= cutoff * cutoff:
                    continue
                bx = c * moment[j, 0] - s * moment[j, 1]
                by = s * moment[j, 0] + c * moment[j, 1]
                bz = moment[j, 2]
                bn = 2.0 * (bx * nx + by * ny + bz * nz)
                bx = reflection * (bn * nx - bx)
                by = reflection * (bn * ny - by)
                bz = reflection * (bn * nz - bz)
                r = np.sqrt(r2)
                dx /= r
                dy /= r
                dz /= r
                ar = ax * dx + ay * dy + az * dz
                br = bx * dx + by * dy + bz * dz
                ab = ax * bx + ay * by + az * bz
                switch, slope = 1.0, 0.0
                if r > inner:
                    t = (r - inner) / (cutoff - inner)
                    switch = 1.0 - t * t * (3.0 - 2.0 * t)
                    slope = -6.0 * t * (1.0 - t) / (cutoff - inner)
                w3 = 1e-7 / (r * r * r)
                w4 = 3.0 * w3 / r * switch
                along = w4 * (ab - 5.0 * ar * br) - slope * w3 * (ab - 3.0 * ar * br)
                fx += w4 * (br * ax + ar * bx) + along * dx
                fy += w4 * (br * ay + ar * by) + along * dy
                fz += w4 * (br * az + ar * bz) + along * dz
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
        torque[i] = xi * fy - yi * fx


def magnetic_wall_table(walls) -> np.ndarray:
    """(w, 5) rows r0, z0, tangent r, tangent z, length [m] of the steel surfaces of revolution among `walls`."""
    rows = []
    for wall in walls:
        if isinstance(wall, RevolvedWall) and wall.magnetic:
            start, end = np.asarray(wall.start), np.asarray(wall.end)
            length = float(np.hypot(*(end - start)))
            rows.append([*start, *((end - start) / length), length])
    return np.array(rows, dtype=float).reshape(-1, 5)


def add_image_forces(
    position, moment, radius, rows: NeighbourRows, walls: np.ndarray, reflection: float, cutoff: float, force
) -> float:
    """Add the forces [N] of all images within `cutoff` [m] to `force` (n, 3), in place.

    `walls` is `magnetic_wall_table(...)`, `reflection` is k [-]; other arguments as in `add_dipole_forces`.
    Returns the torque about z of these forces on the grains [N m]; the walls' bodies take its opposite.
    """
    n = position.shape[0]
    torque = np.empty(n)
    _image_rows(
        position,
        moment,
        radius,
        rows.start,
        rows.other,
        rows.shift,
        rows.turn_cos,
        rows.turn_sin,
        walls,
        reflection,
        cutoff,
        np.empty((n, len(walls))),
        force,
        torque,
    )
    return float(torque.sum())
