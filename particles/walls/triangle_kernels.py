"""Compiled geometry of triangle meshes: closest point, which triangles a grain touches, push-off.

**Closest point.** Every triangle has a frame of its own: A the start of its longest edge, e1 along that edge, N its
normal, e2 = N x e1, so that A = (0, 0), B = (l, 0), C = (cx, cy) with 0 <= cx <= l and cy > 0 the height. A centre is
(p, q, s) there. If (p, q) is inside, the offset to the closest point is -s N, whatever the triangle's shape; if not,
the closest point lies on one of the edges that (p, q) is beyond, because a triangle is convex. (The regions are those
of C. Ericson, Real-Time Collision Detection, 2005, section 5.1.5; his barycentric products lose the digits of a sliver,
a frame on the longest edge does not.)

**Which triangles count.** All triangles within reach of a centre have a closest point x, from the centre, at distance d
in direction n. In the order of (d, index) a candidate c counts, unless an earlier a hides it. One that counts hides
what lies on or behind the plane that touches the wall at a's point, let down towards the grain by the feature angle;
one that is hidden itself hides by the plane of its triangle, unit normal m and height h over it, if it is met
within the feature angle of its normal:

    x_c · n_a >= d_a cos(FEATURE_ANGLE),   or   x_c · m_a >= h_a cos(FEATURE_ANGLE) with h_a >= d_a cos(FEATURE_ANGLE).

So

- neighbours in one plane, shared edges and vertices, the far side of a plate, and every other face of a convex body
  are behind the first plane: one contact, over face, edge or vertex alike;
- a concave crease of more than the feature angle touches twice, a corner of three faces three times;
- facets of a concave curved surface that turn by no more than the feature angle from one to the next hide each
  other in a chain by their planes, and touch once, even a ball that nearly fills its tube;
- no topology is needed: vertices may be unmerged, edges split, surfaces pass through each other.

The contacts of one smooth patch are one at its least distance, which is a continuous function of the centre: the
elastic energy does not jump when the triangle changes. What is lost: two creases or ridges that a grain touches less
than the feature angle apart count once; a crease slightly sharper than it counts twice only for overlaps
below about 1 - cos(FEATURE_ANGLE) / cos(crease).
"""

from __future__ import annotations

import numpy as np
from numba import njit

from geometry.kernels.device_functions import device_function

# columns of a triangle's row: point A, axes e1 and e2, normal, and the flat coordinates of B and C
AX, AY, AZ, UX, UY, UZ, VX, VY, VZ, NX, NY, NZ, LENGTH, CX, CY = range(15)
N_TRIANGLE = 15
# columns of a contact: LEADER is the row of the contact that hides this one, then normal towards the wall and
# distance of the triangle's plane, infinite where that hides nothing
SLOT, DISTANCE, TOWARDS_X, TOWARDS_Y, TOWARDS_Z, LEADER, PLANE_X, PLANE_Y, PLANE_Z, HEIGHT = range(10)
N_CONTACT = 10

# columns of a body's grid of cells (`particles.walls.triangle_search`)
X0, Y0, Z0, PER_LENGTH, SHAPE_X, SHAPE_Y, SHAPE_Z, FIRST_CELL = range(8)

FEATURE_ANGLE = np.deg2rad(21.0)  # tessellated circles of 18 sides, 20 degrees a corner, and more are round
_TILT = float(np.cos(FEATURE_ANGLE))


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _offset(rows, t, x, y, z):
    """Closest point minus centre in the frame of the triangle: along e1, along e2, and the height s above it."""
    x, y, z = x - rows[t, AX], y - rows[t, AY], z - rows[t, AZ]
    s = x * rows[t, NX] + y * rows[t, NY] + z * rows[t, NZ]
    p = x * rows[t, UX] + y * rows[t, UY] + z * rows[t, UZ]
    q = x * rows[t, VX] + y * rows[t, VY] + z * rows[t, VZ]
    l, cx, cy = rows[t, LENGTH], rows[t, CX], rows[t, CY]
    du = dv = 0.0
    nearest = np.inf
    if q < 0.0:  # beyond AB
        du, dv = min(max(p, 0.0), l) - p, -q
        nearest = du * du + dv * dv
    gx = cx - l
    if gx * q - cy * (p - l) < 0.0:  # beyond BC
        f = min(max(((p - l) * gx + q * cy) / (gx * gx + cy * cy), 0.0), 1.0)
        a, b = l + f * gx - p, f * cy - q
        if a * a + b * b < nearest:
            du, dv, nearest = a, b, a * a + b * b
    if cy * p - cx * q < 0.0:  # beyond CA
        f = min(max((p * cx + q * cy) / (cx * cx + cy * cy), 0.0), 1.0)
        a, b = f * cx - p, f * cy - q
        if a * a + b * b < nearest:
            du, dv = a, b
    return du, dv, s


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def closest_on_triangle(rows, t, x, y, z):
    """The point of triangle ``t`` that is closest to (x, y, z): (px, py, pz) [m]."""
    du, dv, s = _offset(rows, t, x, y, z)
    return (
        x + du * rows[t, UX] + dv * rows[t, VX] - s * rows[t, NX],
        y + du * rows[t, UY] + dv * rows[t, VY] - s * rows[t, NY],
        z + du * rows[t, UZ] + dv * rows[t, VZ] - s * rows[t, NZ],
    )


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _hides(contact, a, counts, c):
    x, y, z = contact[c, TOWARDS_X], contact[c, TOWARDS_Y], contact[c, TOWARDS_Z]
    d = contact[c, DISTANCE]
    if counts and d * (x * contact[a, TOWARDS_X] + y * contact[a, TOWARDS_Y] + z * contact[a, TOWARDS_Z]) >= (
        _TILT * contact[a, DISTANCE]
    ):
        return True
    height = x * contact[a, PLANE_X] + y * contact[a, PLANE_Y] + z * contact[a, PLANE_Z]
    return d * height >= _TILT * contact[a, HEIGHT]


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def triangle_contacts(rows, other, first, last, x, y, z, radius, contact):
    """Contacts of one grain with the triangles ``other[first:last]`` of one body.

    Parameters
    ----------
    rows : (t, N_TRIANGLE), from `particles.walls.wall_table.triangle_table`.
    other : triangle of each slot; ascending within first .. last.
    x, y, z, radius : the centre in the frame of the body [m].
    contact : scratch and result, at least ``last - first`` rows of N_CONTACT columns.

    Returns
    -------
    count : int
        Contacts, nearest first: ``contact[:count]`` has slot, distance [m] and the unit vector from the centre towards
        the wall. A centre exactly on a triangle is taken to be on the side that its normal points to.
    candidates : int
        ``contact[count:candidates]`` are the candidates that do not count: their slot, and LEADER, the row of the
        contact that hides each.
    """
    candidates = 0
    for k in range(first, last):
        t = other[k]
        height = (x - rows[t, AX]) * rows[t, NX] + (y - rows[t, AY]) * rows[t, NY] + (z - rows[t, AZ]) * rows[t, NZ]
        if abs(height) >= radius:  # most triangles near a grain go here, at a third of the price
            continue
        du, dv, s = _offset(rows, t, x, y, z)
        distance = np.sqrt(du * du + dv * dv + s * s)
        if not distance < radius:
            continue
        c = candidates
        while c > 0 and contact[c - 1, DISTANCE] > distance:
            for column in range(N_CONTACT):
                contact[c, column] = contact[c - 1, column]
            c -= 1
        side = 1.0 if s >= 0.0 else -1.0
        contact[c, PLANE_X], contact[c, PLANE_Y] = -side * rows[t, NX], -side * rows[t, NY]
        contact[c, PLANE_Z], contact[c, HEIGHT] = -side * rows[t, NZ], abs(s) if abs(s) >= _TILT * distance else np.inf
        if distance > 0.0:
            du, dv, s = du / distance, dv / distance, s / distance
        else:
            s = 1.0
        contact[c, SLOT], contact[c, DISTANCE] = k, distance
        contact[c, TOWARDS_X] = du * rows[t, UX] + dv * rows[t, VX] - s * rows[t, NX]
        contact[c, TOWARDS_Y] = du * rows[t, UY] + dv * rows[t, VY] - s * rows[t, NY]
        contact[c, TOWARDS_Z] = du * rows[t, UZ] + dv * rows[t, VZ] - s * rows[t, NZ]
        candidates += 1
    count = 0
    for c in range(candidates):
        leader = -1.0
        for a in range(c):  # those that count stand first, then the hidden ones
            if _hides(contact, a, a < count, c):
                leader = contact[a, LEADER]
                break
        if leader >= 0.0:
            contact[c, LEADER] = leader
            continue
        contact[c, LEADER] = count
        for column in range(N_CONTACT):
            contact[count, column], contact[c, column] = contact[c, column], contact[count, column]
        count += 1
    return count, candidates


@njit(cache=True, error_model="numpy")
def triangle_overlaps(position, radius, rows, body, turn, start, other):
    """Overlap [m] and unit vector towards the wall of each slot, in the fixed frame, shape (s, 4); hidden: -inf.

    ``turn`` (n_bodies, 2): cosine and sine of the angle of each body; ``start``, ``other``: the slots of each grain.
    """
    result = np.empty((other.shape[0], 4))
    longest = 0
    for i in range(position.shape[0]):
        longest = max(longest, start[i + 1] - start[i])
    contact = np.empty((longest, N_CONTACT))
    for i in range(position.shape[0]):
        first = start[i]
        while first < start[i + 1]:
            b = body[other[first]]
            last = first
            while last < start[i + 1] and body[other[last]] == b:
                result[last, 0] = -np.inf
                result[last, 1] = result[last, 2] = result[last, 3] = 0.0
                last += 1
            cos, sin = turn[b, 0], turn[b, 1]
            x, y = cos * position[i, 0] + sin * position[i, 1], cos * position[i, 1] - sin * position[i, 0]
            count, _ = triangle_contacts(rows, other, first, last, x, y, position[i, 2], radius[i], contact)
            for c in range(count):
                k = int(contact[c, SLOT])
                nx, ny = contact[c, TOWARDS_X], contact[c, TOWARDS_Y]
                result[k, 0] = radius[i] - contact[c, DISTANCE]
                result[k, 1], result[k, 2] = cos * nx - sin * ny, sin * nx + cos * ny
                result[k, 3] = contact[c, TOWARDS_Z]
            first = last
    return result


@njit(cache=True, error_model="numpy")
def push_off_triangles(position, radius, rows, start, other):
    """Move each centre out of the triangles that it overlaps; returns the largest overlap met [m].

    All bodies at angle 0; ``start``, ``other``: the triangles near each centre. A centre leaves to the side that
    it is on.
    """
    worst = 0.0
    longest = 0
    for i in range(position.shape[0]):
        longest = max(longest, start[i + 1] - start[i])
    contact = np.empty((longest, N_CONTACT))
    for i in range(position.shape[0]):
        if start[i] == start[i + 1]:
            continue
        x, y, z = position[i, 0], position[i, 1], position[i, 2]
        count, _ = triangle_contacts(rows, other, start[i], start[i + 1], x, y, z, radius[i], contact)
        for c in range(count):
            worst = max(worst, radius[i] - contact[c, DISTANCE])
            nx, ny, nz = contact[c, TOWARDS_X], contact[c, TOWARDS_Y], contact[c, TOWARDS_Z]
            # what earlier pushes of this grain have already moved it away from this wall
            moved = -(nx * (position[i, 0] - x) + ny * (position[i, 1] - y) + nz * (position[i, 2] - z))
            push = radius[i] - contact[c, DISTANCE] - moved
            if push > 0.0:
                position[i, 0] -= push * nx
                position[i, 1] -= push * ny
                position[i, 2] -= push * nz
    return worst


@njit(cache=True, error_model="numpy")
def winding_number(position, rows, first, last):
    """Winding number of the triangles first .. last about each centre: 0 outside of a closed surface, +-1 inside.

    The sum of the solid angles over 4 pi (A. Van Oosterom, J. Strackee, IEEE Trans. Biomed. Eng. 30, 1983, 125).
    """
    result = np.empty(position.shape[0])
    for i in range(position.shape[0]):
        total = 0.0
        for t in range(first, last):
            x, y, z = position[i, 0] - rows[t, AX], position[i, 1] - rows[t, AY], position[i, 2] - rows[t, AZ]
            p = x * rows[t, UX] + y * rows[t, UY] + z * rows[t, UZ]
            q = x * rows[t, VX] + y * rows[t, VY] + z * rows[t, VZ]
            s = x * rows[t, NX] + y * rows[t, NY] + z * rows[t, NZ]
            l, cx, cy = rows[t, LENGTH], rows[t, CX], rows[t, CY]
            bp, cp, cq = l - p, cx - p, cy - q
            a = np.sqrt(p * p + q * q + s * s)
            b = np.sqrt(bp * bp + q * q + s * s)
            c = np.sqrt(cp * cp + cq * cq + s * s)
            ab, bc, ca = -p * bp + q * q + s * s, bp * cp - q * cq + s * s, -cp * p - cq * q + s * s
            total += 2.0 * np.arctan2(-s * l * cy, a * b * c + ab * c + bc * a + ca * b)
        result[i] = total / (4.0 * np.pi)
    return result


@njit(cache=True, error_model="numpy")
def list_by_cell(rows, lo, hi, reach, lower, upper, grid, cursor, listed):
    """Count the triangles of each cell in ``cursor``, or, where ``listed`` has room, write them there."""
    per = grid[PER_LENGTH]
    ny, nz = int(grid[SHAPE_Y]), int(grid[SHAPE_Z])
    # half a cell's diagonal farther than the reach, with room for rounding
    limit = reach + 0.5 * np.sqrt(3.0) / per * (1.0 + 1e-9)
    for t in range(lo, hi):
        ix0, ix1 = int((lower[t, 0] - grid[X0]) * per), int((upper[t, 0] - grid[X0]) * per)
        iy0, iy1 = int((lower[t, 1] - grid[Y0]) * per), int((upper[t, 1] - grid[Y0]) * per)
        iz0, iz1 = int((lower[t, 2] - grid[Z0]) * per), int((upper[t, 2] - grid[Z0]) * per)
        for ix in range(ix0, min(ix1 + 1, int(grid[SHAPE_X]))):
            for iy in range(iy0, min(iy1 + 1, ny)):
                for iz in range(iz0, min(iz1 + 1, nz)):
                    x, y, z = grid[X0] + (ix + 0.5) / per, grid[Y0] + (iy + 0.5) / per, grid[Z0] + (iz + 0.5) / per
                    du, dv, s = _offset(rows, t, x, y, z)
                    if du * du + dv * dv + s * s <= limit * limit:
                        c = int(grid[FIRST_CELL]) + (ix * ny + iy) * nz + iz
                        if listed.shape[0] > 0:
                            listed[cursor[c]] = t
                        cursor[c] += 1


@njit(cache=True, error_model="numpy")
def near_triangles(position, reach, rows, turn, grids, cell_start, cell_triangle, start, other):
    """Fill ``start`` (n + 1,) and ``other`` as in `TriangleSearch.near`; returns their number, whatever fits."""
    count = 0
    for i in range(position.shape[0]):
        start[i] = count
        limit = reach[i] * reach[i]
        z = position[i, 2]
        for b in range(grids.shape[0]):
            per = grids[b, PER_LENGTH]
            if per == 0.0:  # a body without triangles
                continue
            x = turn[b, 0] * position[i, 0] + turn[b, 1] * position[i, 1]
            y = turn[b, 0] * position[i, 1] - turn[b, 1] * position[i, 0]
            fx, fy, fz = (x - grids[b, X0]) * per, (y - grids[b, Y0]) * per, (z - grids[b, Z0]) * per
            inside = fx >= 0.0 and fy >= 0.0 and fz >= 0.0
            if not (inside and fx < grids[b, SHAPE_X] and fy < grids[b, SHAPE_Y] and fz < grids[b, SHAPE_Z]):
                continue
            c = int(grids[b, FIRST_CELL]) + (int(fx) * int(grids[b, SHAPE_Y]) + int(fy)) * int(
                grids[b, SHAPE_Z]
            ) + int(fz)  # fmt: skip
            for k in range(cell_start[c], cell_start[c + 1]):
                t = cell_triangle[k]
                du, dv, s = _offset(rows, t, x, y, z)
                if du * du + dv * dv + s * s < limit:
                    if count < other.shape[0]:
                        other[count] = t
                    count += 1
    start[position.shape[0]] = count
    return count
