"""Images of grains in steel walls, in SIMD vectors of eight: their influence on grains, and their forces.

A grain's image acts on itself and on its neighbours. Of a pair and a wall both halves of the energy of
`coupling.mirror` are found at once, for both grains: they are the same two pairs of dipoles, j* with i and j with i*.

Influence: blocks (3, 4), the part of S_x, S_y, S_z [1/m^3] and P [1/m^2] that each component of the moment makes, in
the neighbour's own frame. With T = (c1 n n - c2 1)/(4 pi) and P = k (2 u u - 1) the mirror at a wall's normal u, an
image adds (T P_j + P_i T)/2 to the field, the one T from the image of j to i, the other from j to the image of i, and
p n . P_j to the potential. The field's part seen from j is the transposed one, because both are derivatives of one
energy.

Pairs and walls whose images may be within reach are listed, a few hundred at a time, and found eight at a time
(`geometry.kernels.simd`). A last group that is not full repeats its last image, which adds nothing then.
"""

from __future__ import annotations

import numpy as np

from coupling.kernel_state import ENTRY, FIRST, N_PAIR, SECOND, SHIFT, TWIN
from coupling.mirror import FACES_NO_WALL, mirror_height, mirror_moment
from coupling.pair_fields import MU_0_OVER_4PI, OVER_4PI, field_factors, field_slopes
from coupling.row_lanes import first_present
from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, from_integers, mask_of_first, select, splat
from geometry.kernels.simd_math import sqrt
from geometry.kernels.simd_tables import gather_columns, load, scatter_add

MAX_WALLS = 31  # two bits of a word each
IMAGED_CHUNK = 256  # pairs, or grains, whose images one thread takes at once
# of an image: both grains, shift and entries of the pair (of a grain itself: the grain), wall; and heights of mirroring
WALL, N_SEEN = N_PAIR, N_PAIR + 1  # after the columns of a pair
HEIGHT_I, HEIGHT_J, N_HEIGHTS = range(3)


@device_function(error_model="numpy", fastmath={"contract"})
def wall_sides(grains):
    """Heights (n, w) [m] at which grains are mirrored; and, as bits (n,), on which side of which walls they are."""
    height, radius = grains.height, grains.radius
    mirrored_at, sides = np.empty(height.shape), np.zeros(height.shape[0], np.int64)
    for i in range(height.shape[0]):
        for w in range(height.shape[1]):
            h = height[i, w]
            mirrored_at[i, w] = mirror_height(h, radius[i])
            if h < FACES_NO_WALL:
                sides[i] |= np.int64(1 if h > 0.0 else 2) << (2 * w)
    return mirrored_at, sides


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _list_seen(i, j, shift, e, t, reach, faces, count, seen, heights):
    """List the walls in which grain i may be within reach of the image of j; how many are listed then."""
    mirrored_at, sides = faces
    common, w = sides[i] & sides[j], 0
    while common != 0:
        here, there = mirrored_at[i, w], mirrored_at[j, w]
        seen[FIRST, count], seen[SECOND, count], seen[SHIFT, count] = i, j, shift
        seen[ENTRY, count], seen[TWIN, count], seen[WALL, count] = e, t, w
        heights[HEIGHT_I, count], heights[HEIGHT_J, count] = here, there
        # an image is never nearer than both heights
        count += 1 if (common & 3) != 0 and abs(here + there) < reach else 0
        common, w = common >> 2, w + 1
    return count


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def list_pair_images(h, until, reach, faces, imaged, seen, heights):
    """List the images of the pairs h to ``until``; how many. ``faces``: see `wall_sides`."""
    count = 0
    for g in range(h, until):
        b, a = g // LANES, g % LANES
        once = imaged.once[b]
        count = _list_seen(
            once[FIRST, a], once[SECOND, a], once[SHIFT, a], once[ENTRY, a], once[TWIN, a], reach, faces, count, seen,
            heights,
        )  # fmt: skip
    _fill_up(count, seen, heights)
    return count


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def list_grain_images(i, until, reach, faces, seen, heights):
    """List the images that the grains i to ``until`` have of themselves; how many."""
    count = 0
    for g in range(i, until):
        count = _list_seen(g, g, 0, g, -1, reach, faces, count, seen, heights)
    _fill_up(count, seen, heights)
    return count


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def _fill_up(count, seen, heights):
    for c in range(count, LANES * ((count + LANES - 1) // LANES)):
        for a in range(N_SEEN):
            seen[a, c] = seen[a, count - 1]
        for a in range(N_HEIGHTS):
            heights[a, c] = heights[a, count - 1]


@device_function(forceinline=True)
def _of_walls(i, w, n_walls):
    """Rows of eight grains and walls in a table (n w, ...)."""
    return (
        i[0] * n_walls + w[0], i[1] * n_walls + w[1], i[2] * n_walls + w[2], i[3] * n_walls + w[3],
        i[4] * n_walls + w[4], i[5] * n_walls + w[5], i[6] * n_walls + w[6], i[7] * n_walls + w[7],
    )  # fmt: skip


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def normal_over(x, y, h, tangent_r, tangent_z):
    """Normal of a wall over a place, which it does not have on the axis; and the vector (3) from there to the image."""
    rho2 = x * x + y * y
    out = select(rho2 > 0.0, -tangent_z / sqrt(rho2), 0.0)
    nx, ny = out * x, out * y
    return nx, ny, tangent_r, -2.0 * h * nx, -2.0 * h * ny, -2.0 * h * tangent_r


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _block(dx, dy, dz, reach, smear):
    """4 pi T (xx, yy, zz, xy, xz, yz) and 4 pi p n at the distance vector d from a moment; 0 beyond reach."""
    r2 = dx * dx + dy * dy + dz * dz
    r = sqrt(r2)
    per_r = 1.0 / r
    nx, ny, nz = dx * per_r, dy * per_r, dz * per_r
    c1, c2, p = field_factors(r, reach, smear)
    within = select(r2 < reach * reach, 1.0, 0.0)
    c1, c2, p = c1 * within, c2 * within, p * within
    ax, ay, az = c1 * nx, c1 * ny, c1 * nz
    return ax * nx - c2, ay * ny - c2, az * nz - c2, ax * ny, ax * nz, ay * nz, p * nx, p * ny, p * nz


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _load_images(c, seen, heights, place, rows, walls):
    """Of eight images from c on: turn of the partner, strength; of both grains centre [m] and `normal_over` it."""
    crossed = from_integers(load(seen, SHIFT, c))
    turn = select(crossed * crossed > 0.0, rows.turn_cos[1], 1.0), rows.turn_sin[1] * crossed
    tangent_r, tangent_z, _, k = gather_columns(walls, load(seen, WALL, c), 2)
    xi, yi, zi, _ = gather_columns(place, load(seen, FIRST, c), 0)
    xj, yj, zj, _ = gather_columns(place, load(seen, SECOND, c), 0)
    xj, yj = turn[0] * xj - turn[1] * yj, turn[1] * xj + turn[0] * yj
    over_i = normal_over(xi, yi, load(heights, HEIGHT_I, c), tangent_r, tangent_z)
    over_j = normal_over(xj, yj, load(heights, HEIGHT_J, c), tangent_r, tangent_z)
    return turn, k, (xi, yi, zi), over_i, (xj, yj, zj), over_j


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _influence(images, there, reach, smear):
    """Block of the image of j, and what the image of i makes of the potential at j; none where not ``there``."""
    (c, s), k, (xi, yi, zi), (wx, wy, wz, ox, oy, oz), (jx, jy, jz), (ux, uy, uz, qx, qy, qz) = images
    k = OVER_4PI * select(there, k, 0.0)
    # at i of the image of j: T P
    axx, ayy, azz, axy, axz, ayz, fx, fy, fz = _block(xi - (jx + qx), yi - (jy + qy), zi - (jz + qz), reach, smear)
    vx, vy, vz = axx * ux + axy * uy + axz * uz, axy * ux + ayy * uy + ayz * uz, axz * ux + ayz * uy + azz * uz
    # at the image of i of j: P T
    bxx, byy, bzz, bxy, bxz, byz, gx, gy, gz = _block((xi + ox) - jx, (yi + oy) - jy, (zi + oz) - jz, reach, smear)
    tx, ty, tz = bxx * wx + bxy * wy + bxz * wz, bxy * wx + byy * wy + byz * wz, bxz * wx + byz * wy + bzz * wz
    xx = k * (vx * ux + wx * tx - 0.5 * (axx + bxx))
    yy = k * (vy * uy + wy * ty - 0.5 * (ayy + byy))
    zz = k * (vz * uz + wz * tz - 0.5 * (azz + bzz))
    axy, axz, ayz = 0.5 * (axy + bxy), 0.5 * (axz + bxz), 0.5 * (ayz + byz)
    # xy: along x, of a moment along y
    xy, yx = k * (vx * uy + wx * ty - axy), k * (vy * ux + wy * tx - axy)
    xz, zx = k * (vx * uz + wx * tz - axz), k * (vz * ux + wz * tx - axz)
    yz, zy = k * (vy * uz + wy * tz - ayz), k * (vz * uy + wz * ty - ayz)
    px, py, pz = mirror_moment(k, fx, fy, fz, ux, uy, uz)
    qx, qy, qz = mirror_moment(-k, gx, gy, gz, wx, wy, wz)  # seen from j: against the distance vector
    return (  # to the frame of j
        (c * xx + s * xy, c * yx + s * yy, c * zx + s * zy, c * px + s * py),
        (c * xy - s * xx, c * yy - s * yx, c * zy - s * zx, c * py - s * px),
        (xz, yz, zz, pz),
        (qx, qy, qz),
    )


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def clear_blocks(h, until, imaged, image):
    """Put 0 into the blocks (k, 12) of the pairs h to ``until``."""
    for g in range(h, until):
        e, t = imaged.once[g // LANES, ENTRY, g % LANES], imaged.once[g // LANES, TWIN, g % LANES]
        t = t if t >= 0 else e
        for m in range(12):
            image[e, m] = 0.0
        for m in range(12):
            image[t, m] = 0.0


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def influences_of_pairs(count, model, place, rows, walls, seen, heights, image):
    """Blocks (k, 12) of the first ``count`` images listed, of pairs: of both entries."""
    for c in range(0, count, LANES):
        there = mask_of_first(count - c)
        x, y, z, back = _influence(_load_images(c, seen, heights, place, rows, walls), there, model.reach, model.smear)
        e, t = load(seen, ENTRY, c), load(seen, TWIN, c)
        scatter_add(image, e, 0, None, None, x)
        scatter_add(image, e, 4, None, None, y)
        scatter_add(image, e, 8, None, None, z)
        weight = select(from_integers(t) >= 0.0, 1.0, 0.0)
        back = back[0] * weight, back[1] * weight, back[2] * weight
        to = first_present(t, e)
        scatter_add(image, to, 0, None, None, (x[0] * weight, y[0] * weight, z[0] * weight, back[0]))
        scatter_add(image, to, 4, None, None, (x[1] * weight, y[1] * weight, z[1] * weight, back[1]))
        scatter_add(image, to, 8, None, None, (x[2] * weight, y[2] * weight, z[2] * weight, back[2]))


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def influences_of_grains(count, model, place, rows, walls, seen, heights, itself, own_image):
    """Add the first ``count`` images listed, of grains themselves, to blocks (n, 12); and what they make of the
    potential: rows (n w, 4)."""
    n_walls = walls.shape[0]
    for c in range(0, count, LANES):
        there = mask_of_first(count - c)
        x, y, z, _ = _influence(_load_images(c, seen, heights, place, rows, walls), there, model.reach, model.smear)
        i = load(seen, ENTRY, c)
        scatter_add(itself, i, 0, None, None, x)
        scatter_add(itself, i, 4, None, None, y)
        scatter_add(itself, i, 8, None, None, z)
        scatter_add(
            own_image, _of_walls(i, load(seen, WALL, c), n_walls), 0, None, None, (x[3], y[3], z[3], 0.0 * z[3])
        )


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _pull(ax, ay, az, bx, by, bz, dx, dy, dz, reach, smear):
    """Force on moment a at d from moment b, over mu_0/(4 pi); at a the field of b, at b that of a, on 4 pi.

    As `coupling.pair_fields.pair_force`; 0 beyond reach.
    """
    r2 = dx * dx + dy * dy + dz * dz
    r = sqrt(r2)
    per_r = 1.0 / r
    nx, ny, nz = dx * per_r, dy * per_r, dz * per_r
    c1, c2, _ = field_factors(r, reach, smear)
    c1_r, c2_r = field_slopes(r, reach, smear)
    within = select(r2 < reach * reach, 1.0, 0.0)
    c1, c2, c1_r, c2_r = c1 * within, c2 * within, c1_r * within, c2_r * within
    an, bn = ax * nx + ay * ny + az * nz, bx * nx + by * ny + bz * nz
    turning = c1 * per_r
    along = (c1_r - 2.0 * turning) * an * bn - c2_r * (ax * bx + ay * by + az * bz)
    u, v = turning * bn, turning * an
    at_a, at_b = c1 * bn, c1 * an
    return (
        (along * nx + u * ax + v * bx, along * ny + u * ay + v * by, along * nz + u * az + v * bz),
        (at_a * nx - c2 * bx, at_a * ny - c2 * by, at_a * nz - c2 * bz),
        (at_b * nx - c2 * ax, at_b * ny - c2 * ay, at_b * nz - c2 * az),
    )


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _moving_along(x, y, image, k, m, turned, n, g, field):
    """Force on the grain at x, y itself from the force g on its image, because the image moves with it.

    ``image`` (2), ``n`` (3): its place and the wall's normal; ``m`` and ``turned``: the grain's moment and that of its
    image; ``field`` (3): at the image.
    """
    along = 2.0 * (g[0] * n[0] + g[1] * n[1] + g[2] * n[2])  # in the section it moves mirrored
    gx, gy, gz = g[0] - along * n[0], g[1] - along * n[1], g[2] - along * n[2]
    rho2 = x * x + y * y
    per_rho = select(rho2 > 0.0, 1.0 / sqrt(rho2), 0.0)
    ex, ey = -y * per_rho, x * per_rho
    # about the axis by the ratio of radii
    more = (sqrt(image[0] * image[0] + image[1] * image[1]) * per_rho - 1.0) * (gx * ex + gy * ey)
    # its moment turns with the half plane: dm*/dphi = z x m* - P (z x m)
    tx, ty, tz = mirror_moment(k, -m[1], m[0], 0.0, n[0], n[1], n[2])
    more = more + (field[0] * (-turned[1] - tx) + field[1] * (turned[0] - ty) - field[2] * tz) * per_rho
    return gx + more * ex, gy + more * ey, gz


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _forces(images, there, a, b, reach, smear):
    """Forces of images on i and on j [N], of the moments a and b: -dU/dx, see `coupling.mirror`; 0 if not there."""
    (c, s), k, (xi, yi, zi), (wx, wy, wz, ox, oy, oz), (jx, jy, jz), (ux, uy, uz, qx, qy, qz) = images
    (ax, ay, az), (bx, by, bz) = a, b
    bx, by = c * bx - s * by, s * bx + c * by
    own, others = mirror_moment(k, ax, ay, az, wx, wy, wz), mirror_moment(k, bx, by, bz, ux, uy, uz)
    ox, oy, oz, qx, qy, qz = xi + ox, yi + oy, zi + oz, jx + qx, jy + qy, jz + qz
    # the image of j with i
    f, _, at_image_j = _pull(
        ax, ay, az, others[0], others[1], others[2], xi - qx, yi - qy, zi - qz, reach, smear
    )  # fmt: skip
    # j with the image of i
    g, at_image_i, _ = _pull(own[0], own[1], own[2], bx, by, bz, ox - jx, oy - jy, oz - jz, reach, smear)
    p = _moving_along(xi, yi, (ox, oy), k, (ax, ay), own, (wx, wy, wz), g, at_image_i)
    f_on_image = (-f[0], -f[1], -f[2])
    q = _moving_along(jx, jy, (qx, qy), k, (bx, by), others, (ux, uy, uz), f_on_image, at_image_j)
    half = select(there, 0.5 * MU_0_OVER_4PI, 0.0)
    x, y, z = half * (q[0] - g[0]), half * (q[1] - g[1]), half * (q[2] - g[2])
    none = splat(0.0)
    return (
        (half * (f[0] + p[0]), half * (f[1] + p[1]), half * (f[2] + p[2]), none),
        (c * x + s * y, c * y - s * x, z, none),  # in the frame of j
    )


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def clear_forces(h, until, imaged, force):
    """Put 0 into the rows (k, 4) of the pairs h to ``until``."""
    for g in range(h, until):
        e, t = imaged.once[g // LANES, ENTRY, g % LANES], imaged.once[g // LANES, TWIN, g % LANES]
        t = t if t >= 0 else e
        force[e, 0] = force[e, 1] = force[e, 2] = force[e, 3] = 0.0
        force[t, 0] = force[t, 1] = force[t, 2] = force[t, 3] = 0.0


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def find_forces(count, model, place, source, rows, walls, seen, heights, force):
    """Add the forces of the first ``count`` images listed to rows (k, 4) [N]: of their entries, or of their grains.

    ``source`` (n, 4): moments [A m^2].
    """
    for c in range(0, count, LANES):
        images = _load_images(c, seen, heights, place, rows, walls)
        ax, ay, az, _ = gather_columns(source, load(seen, FIRST, c), 0)
        bx, by, bz, _ = gather_columns(source, load(seen, SECOND, c), 0)
        there = mask_of_first(count - c)
        here, back = _forces(images, there, (ax, ay, az), (bx, by, bz), model.reach, model.smear)
        e, t = load(seen, ENTRY, c), load(seen, TWIN, c)
        scatter_add(force, e, 0, None, None, here)
        weight = select(from_integers(t) >= 0.0, 1.0, 0.0)
        back = weight * back[0], weight * back[1], weight * back[2], back[3]
        scatter_add(force, first_present(t, e), 0, None, None, back)
