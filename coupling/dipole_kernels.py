"""Compiled rows of dipole forces: grains on grains, and the images of grains in steel on grains.

Both share `_pair`; they stand in one file because numba's cache of a kernel does not notice when a function of
another file changes. The theory is in `coupling.dipoles` and `coupling.wall_images`.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from geometry.inner_functions import inner

FACES_NO_WALL = 1e30


@inner(error_model="numpy", fastmath={"contract"})
def _pair(ax, ay, az, bx, by, bz, dx, dy, dz, r, cutoff):
    """Force on moment a from moment b, the unit vector d pointing from b to a, at distance r; switched energy, and
    mu_0/(4 pi r^3) times the switch s(r), with which s B_b(a) = that [3 (b.d) d - b]."""
    inner = 0.9 * cutoff
    w3 = 1e-7 / (r * r * r)
    ar = ax * dx + ay * dy + az * dz
    br = bx * dx + by * dy + bz * dz
    ab = ax * bx + ay * by + az * bz
    switch, slope = 1.0, 0.0
    if r > inner:
        t = (r - inner) / (cutoff - inner)
        switch = 1.0 - t * t * (3.0 - 2.0 * t)
        slope = -6.0 * t * (1.0 - t) / (cutoff - inner)
    energy = w3 * (ab - 3.0 * ar * br)
    w4 = 3.0 * w3 / r * switch
    along = w4 * (ab - 5.0 * ar * br) - slope * energy
    fx = w4 * (br * ax + ar * bx) + along * dx
    fy = w4 * (br * ay + ar * by) + along * dy
    fz = w4 * (br * az + ar * bz) + along * dz
    return fx, fy, fz, switch * energy, switch * w3, br


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def dipole_rows(position, moment, radius, rows, cutoff, force, torque, energy):
    """One grain a row: force [N], z-component of m x B of its neighbours [N m], half of its pair energies [J]."""
    start, other, shift, turn_cos, turn_sin = rows
    for i in prange(position.shape[0]):
        xi, yi, zi = position[i, 0], position[i, 1], position[i, 2]
        ax, ay, az = moment[i, 0], moment[i, 1], moment[i, 2]
        fx = fy = fz = tz = u = 0.0
        for p in range(start[i], start[i + 1]):
            j = other[p]
            c, s = turn_cos[shift[p]], turn_sin[shift[p]]
            dx = xi - (c * position[j, 0] - s * position[j, 1])
            dy = yi - (s * position[j, 0] + c * position[j, 1])
            dz = zi - position[j, 2]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 >= cutoff * cutoff:
                continue
            bx = c * moment[j, 0] - s * moment[j, 1]
            by = s * moment[j, 0] + c * moment[j, 1]
            true_distance = np.sqrt(r2)
            dx /= true_distance
            dy /= true_distance
            dz /= true_distance
            r = max(true_distance, radius[i] + radius[j])
            gx, gy, gz, e, w, br = _pair(ax, ay, az, bx, by, moment[j, 2], dx, dy, dz, r, cutoff)
            fx += gx
            fy += gy
            fz += gz
            u += 0.5 * e
            # clamped pairs act at their true distance: the lever is shorter by true/r
            w *= true_distance / r
            tz += ax * w * (3.0 * br * dy - by) - ay * w * (3.0 * br * dx - bx)
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
        torque[i] = tz
        energy[i] = u


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def image_rows(position, moment, radius, rows, walls, reflection, cutoff, height, force, torque):
    """One grain a row; walls (w, 5): r0, z0, tangent r, z, length; height (n, w) is scratch and result."""
    start, other, shift, turn_cos, turn_sin = rows
    n = position.shape[0]
    n_walls = walls.shape[0]
    for i in prange(n):
        rho = np.sqrt(position[i, 0] ** 2 + position[i, 1] ** 2)
        for w in range(n_walls):
            dr = rho - walls[w, 0]
            dz = position[i, 2] - walls[w, 1]
            along = dr * walls[w, 2] + dz * walls[w, 3]
            # signed height over the wall's line, normal = tangent turned by +90 degrees; FACES_NO_WALL: faces no wall
            h = -dr * walls[w, 3] + dz * walls[w, 2]
            height[i, w] = h if 0.0 <= along <= walls[w, 4] and abs(h) < cutoff else FACES_NO_WALL
    for i in prange(n):
        xi, yi, zi = position[i, 0], position[i, 1], position[i, 2]
        ax, ay, az = moment[i, 0], moment[i, 1], moment[i, 2]
        fx = fy = fz = 0.0
        for w in range(n_walls):
            if height[i, w] >= FACES_NO_WALL:
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
                if h >= FACES_NO_WALL or h * height[i, w] < 0.0:
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
                gx, gy, gz, _, _, _ = _pair(ax, ay, az, bx, by, bz, dx / r, dy / r, dz / r, r, cutoff)
                fx += gx
                fy += gy
                fz += gz
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
        torque[i] = xi * fy - yi * fx
