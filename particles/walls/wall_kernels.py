"""Compiled geometry of planes and walls of revolution: distance, near walls, overlaps, push-off."""

from __future__ import annotations

import numpy as np
from numba import njit

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd_math import sqrt

# columns of the wall table (`particles.walls.wall_table`)
KIND, R0, Z0, R1, Z1, UR, UZ, OWN0, NR0, NZ0, OWN1, NR1, NZ1 = range(13)
N_WALL = 13
NEAR_AXIS = 1e-5
"""Distance of a centre from the axis, over that from the wall, within which it touches the wall all round.

There the radial forces of a ring balance, but its nearest point jumps from side to side, by which a grain that rests
in a hole would tremble: the radial part of the normal goes to 0 with the distance from the axis. Further away, as here
from 1e-3 on, the ball would not lose its energy by impacts on both sides any more, but roll to and fro.
"""


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _wall_gap(wall, w, x, y, z):
    """Distance of the centre to a wall, unit vector towards it (3), and whether this wall owns the point."""
    if wall[w, KIND] == 1.0:  # plane: point in columns 1-3, normal in 4-6
        s = (x - wall[w, 1]) * wall[w, 4] + (y - wall[w, 2]) * wall[w, 5] + (z - wall[w, 3]) * wall[w, 6]
        return s, -wall[w, 4], -wall[w, 5], -wall[w, 6], True
    r = sqrt(x * x + y * y)
    owned = True
    a, b = r - wall[w, R0], z - wall[w, Z0]
    if a * wall[w, UR] + b * wall[w, UZ] <= 0.0:  # the start is the closest point
        owned = wall[w, OWN0] != 0.0 and a * wall[w, NR0] + b * wall[w, NZ0] <= 0.0
    else:
        c, d = r - wall[w, R1], z - wall[w, Z1]
        if c * wall[w, UR] + d * wall[w, UZ] >= 0.0:  # the end is
            owned = wall[w, OWN1] != 0.0 and c * wall[w, NR1] + d * wall[w, NZ1] <= 0.0
            a, b = c, d
        else:
            p = b * wall[w, UR] - a * wall[w, UZ]
            a, b = -p * wall[w, UZ], p * wall[w, UR]
    distance = sqrt(a * a + b * b)
    inverse = 1.0 / distance if distance > 0.0 else 0.0
    nr, nz = -a * inverse, -b * inverse
    if r < NEAR_AXIS * distance and nz != 0.0:
        nr *= r / (NEAR_AXIS * distance)
        size = sqrt(nr * nr + nz * nz)
        nr, nz = nr / size, nz / size
    if r > 0.0:
        return distance, nr * x / r, nr * y / r, nz, owned
    return distance, nr, 0.0, nz, owned  # on the axis every half-plane is as good


@njit(cache=True, error_model="numpy")
def near_walls(position, reach, wall, start, other):
    """Fill the rows of walls within ``reach`` (n,) of each centre; returns their number, whatever fits."""
    count = 0
    for i in range(position.shape[0]):
        start[i] = count
        x, y, z, far = position[i, 0], position[i, 1], position[i, 2], reach[i]
        for w in range(wall.shape[0]):
            if wall[w, KIND] == 1.0:
                distance = (x - wall[w, 1]) * wall[w, 4] + (y - wall[w, 2]) * wall[w, 5] + (z - wall[w, 3]) * wall[w, 6]
            else:
                distance, _, _, _, _ = _wall_gap(wall, w, x, y, z)
            if distance < far:
                if count < other.shape[0]:
                    other[count] = w
                count += 1
    start[position.shape[0]] = count
    return count


@njit(cache=True, error_model="numpy")
def wall_overlaps(position, radius, wall, row, other):
    """Overlap [m] and unit vector towards the wall of each slot, shape (s, 4); not owned: -inf."""
    result = np.empty((row.shape[0], 4))
    for k in range(row.shape[0]):
        i = row[k]
        distance, nx, ny, nz, owned = _wall_gap(wall, other[k], position[i, 0], position[i, 1], position[i, 2])
        result[k, 0] = radius[i] - distance if owned else -np.inf
        result[k, 1], result[k, 2], result[k, 3] = nx, ny, nz
    return result


@njit(cache=True, error_model="numpy")
def push_off_walls(position, radius, wall):
    """Move each centre out of the walls that it overlaps; returns the largest overlap met [m]."""
    worst = 0.0
    for i in range(position.shape[0]):
        for w in range(wall.shape[0]):
            distance, nx, ny, nz, owned = _wall_gap(wall, w, position[i, 0], position[i, 1], position[i, 2])
            depth = radius[i] - distance
            if depth > 0.0 and owned:
                worst = max(worst, depth)
                position[i, 0] -= depth * nx
                position[i, 1] -= depth * ny
                position[i, 2] -= depth * nz
    return worst


@njit(cache=True, error_model="numpy")
def beyond(position, planes, radius, bottom, top, margin):
    """True for centres more than ``margin`` behind one of the ``planes`` (rows) or out of a cylinder; bool (n,)."""
    out = np.zeros(position.shape[0], dtype=np.bool_)
    for i in range(position.shape[0]):
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        if x * x + y * y > (radius + margin) ** 2 or z < bottom - margin or z > top + margin:
            out[i] = True
        for w in range(planes.shape[0]):
            s = (
                (x - planes[w, 1]) * planes[w, 4]
                + (y - planes[w, 2]) * planes[w, 5]
                + (z - planes[w, 3]) * planes[w, 6]
            )
            if s < -margin:
                out[i] = True
    return out
