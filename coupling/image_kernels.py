"""Images of grains in steel walls, in SIMD vectors of eight: their influence on grains, and their forces.

A grain's image acts on itself and on its neighbours. Of a pair and a wall both halves of the energy of
`coupling.mirror` are computed at once, for both grains: they are the same two pairs of grains, j* with i and j with i*.

Influence: blocks (4, 4), rows S_x, S_y, S_z [A/m] and phi [A] at i that the columns m_x, m_y, m_z [A m^2] and Q [A m]
of the neighbour j make, in j's own frame. With d_1 = x_i - x_j*, d_2 = x_i* - x_j and their unit vectors n_1, n_2,
T = c1 n n - c2 and P = k (2 u u - 1) the mirror at a wall's normal u, they are, over 8 pi,

    [ T_1 P_j + P_i T_2              P_i p_2 n_2 - k p_1 n_1 ]
    [ (P_j p_1 n_1 - k p_2 n_2)^T    -k (psi_1 + psi_2)      ].

The block [[A, b], [c^T, d]] seen from j is [[A^T, -c], [-b^T, d]], because both are derivatives of one energy. With a
model of dipoles alone (`coupling.kernel_state.PairModel.near` is False) there are no charges: its blocks are (3, 4),
without the last row and with zeros in the last column.

Pairs and walls whose images may be within reach are listed, a few hundred at a time, and computed eight at a time
(`geometry.kernels.simd`). A last group that is not full repeats its last image, which adds nothing then.
"""

from __future__ import annotations

import numpy as np

from coupling.kernel_state import ENTRY, FIRST, IMAGE, N_PAIR, SECOND, TWIN
from coupling.mirror import FACES_NO_WALL, mirror_height, mirror_moment
from coupling.pair_fields import MU_0_OVER_4PI, OVER_4PI, charge_factors, field_factors, field_slopes
from coupling.row_kernels import first_present
from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, from_integers, mask_of_first, select, splat, to_tuple
from geometry.kernels.simd_math import sqrt
from geometry.kernels.simd_tables import gather_columns, load, scatter_add
from particles.periodic_images import images_of_partners, place_to_image, vector_from_image, vector_to_image

MAX_WALLS = 31  # two bits of a word each
IMAGED_CHUNK = 256  # pairs, or grains, whose images one thread takes at once
# of an image: both grains, shift and entries of the pair (of a grain itself: the grain), wall; and heights of mirroring
WALL, N_LIST = N_PAIR, N_PAIR + 1  # after the columns of a pair
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
def _list_images(i, j, image, e, t, reach, faces, count, image_list, heights):
    """List the walls in which grain i may be within reach of the image of j; returns the new length of the list."""
    mirrored_at, sides = faces
    common, w = sides[i] & sides[j], 0
    while common != 0:
        here, there = mirrored_at[i, w], mirrored_at[j, w]
        image_list[FIRST, count], image_list[SECOND, count], image_list[IMAGE, count] = i, j, image
        image_list[ENTRY, count], image_list[TWIN, count], image_list[WALL, count] = e, t, w
        heights[HEIGHT_I, count], heights[HEIGHT_J, count] = here, there
        # an image is never nearer than both heights
        count += 1 if (common & 3) != 0 and abs(here + there) < reach else 0
        common, w = common >> 2, w + 1
    return count


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def list_pair_images(h, until, reach, faces, imaged, image_list, heights):
    """List the images of the pairs h to ``until``; how many. ``faces``: see `wall_sides`."""
    count = 0
    for g in range(h, until):
        b, a = g // LANES, g % LANES
        unique = imaged.unique[b]
        count = _list_images(
            unique[FIRST, a], unique[SECOND, a], unique[IMAGE, a], unique[ENTRY, a], unique[TWIN, a], reach, faces,
            count, image_list, heights,
        )  # fmt: skip
    _fill_up(count, image_list, heights)
    return count


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def list_grain_images(i, until, reach, faces, rows, image_list, heights):
    """List the images that the grains i to ``until`` have of themselves; how many."""
    count = 0
    for g in range(i, until):
        count = _list_images(g, g, rows.images.shape[0] // 2, g, -1, reach, faces, count, image_list, heights)
    _fill_up(count, image_list, heights)
    return count


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def _fill_up(count, image_list, heights):
    for c in range(count, LANES * ((count + LANES - 1) // LANES)):
        for a in range(N_LIST):
            image_list[a, c] = image_list[a, count - 1]
        for a in range(N_HEIGHTS):
            heights[a, c] = heights[a, count - 1]


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def normal_over(x, y, h, tangent_r, tangent_z):
    """Normal of a wall over a place, which it does not have on the axis; and the vector (3) from there to the image."""
    rho2 = x * x + y * y
    out = select(rho2 > 0.0, -tangent_z / sqrt(rho2), 0.0)
    nx, ny = out * x, out * y
    return nx, ny, tangent_r, -2.0 * h * nx, -2.0 * h * ny, -2.0 * h * tangent_r


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _block(dx, dy, dz, reach, smear):
    """4 pi T (xx, yy, zz, xy, xz, yz), 4 pi p n and 4 pi psi at the distance vector d from a grain; 0 beyond reach."""
    r2 = dx * dx + dy * dy + dz * dz
    r = sqrt(r2)
    per_r = 1.0 / r
    nx, ny, nz = dx * per_r, dy * per_r, dz * per_r
    c1, c2, p = field_factors(r, reach, smear)
    psi, _ = charge_factors(r, reach, smear)
    within = select(r2 < reach * reach, 1.0, 0.0)
    c1, c2, p, psi = c1 * within, c2 * within, p * within, psi * within
    ax, ay, az = c1 * nx, c1 * ny, c1 * nz
    return (ax * nx - c2, ay * ny - c2, az * nz - c2, ax * ny, ax * nz, ay * nz), (p * nx, p * ny, p * nz), psi


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _load_images(c, image_list, heights, place, rows, walls):
    """Of eight images from c on: motion of the partner, strength; of both grains centre [m] and `normal_over` it."""
    motion = images_of_partners(rows.images, load(image_list, IMAGE, c))
    tangent_r, tangent_z, _, k = gather_columns(walls, load(image_list, WALL, c), 2)
    xi, yi, zi, _ = gather_columns(place, load(image_list, FIRST, c), 0)
    xj, yj, zj, _ = gather_columns(place, load(image_list, SECOND, c), 0)
    xj, yj, zj = place_to_image(motion, xj, yj, zj)
    over_i = normal_over(xi, yi, load(heights, HEIGHT_I, c), tangent_r, tangent_z)
    over_j = normal_over(xj, yj, load(heights, HEIGHT_J, c), tangent_r, tangent_z)
    return motion, k, (xi, yi, zi), over_i, (xj, yj, zj), over_j


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _influence(images, there, reach, smear, charged):
    """Rows of the block of a pair's images at i; 0 where not ``there``, and beside moments if not ``charged``."""
    motion, k, (xi, yi, zi), (wx, wy, wz, ox, oy, oz), (jx, jy, jz), (ux, uy, uz, qx, qy, qz) = images
    k = 0.5 * OVER_4PI * select(there, k, 0.0)
    # at i of the image of j: T P
    t, f, psi = _block(xi - (jx + qx), yi - (jy + qy), zi - (jz + qz), reach, smear)
    axx, ayy, azz, axy, axz, ayz = t
    vx, vy, vz = axx * ux + axy * uy + axz * uz, axy * ux + ayy * uy + ayz * uz, axz * ux + ayz * uy + azz * uz
    # at the image of i of j: P T
    t, g, more = _block((xi + ox) - jx, (yi + oy) - jy, (zi + oz) - jz, reach, smear)
    bxx, byy, bzz, bxy, bxz, byz = t
    tx, ty, tz = bxx * wx + bxy * wy + bxz * wz, bxy * wx + byy * wy + byz * wz, bxz * wx + byz * wy + bzz * wz
    twice = 2.0 * k
    xx = twice * (vx * ux + wx * tx) - k * (axx + bxx)
    yy = twice * (vy * uy + wy * ty) - k * (ayy + byy)
    zz = twice * (vz * uz + wz * tz) - k * (azz + bzz)
    axy, axz, ayz = k * (axy + bxy), k * (axz + bxz), k * (ayz + byz)
    # xy: along x, of a moment along y
    xy, yx = twice * (vx * uy + wx * ty) - axy, twice * (vy * ux + wy * tx) - axy
    xz, zx = twice * (vx * uz + wx * tz) - axz, twice * (vz * ux + wz * tx) - axz
    yz, zy = twice * (vy * uz + wy * tz) - ayz, twice * (vz * uy + wz * ty) - ayz
    px = py = pz = sx = sy = sz = both = splat(0.0)
    if charged:
        px, py, pz = mirror_moment(k, f[0], f[1], f[2], ux, uy, uz)
        px, py, pz = px - k * g[0], py - k * g[1], pz - k * g[2]
        sx, sy, sz = mirror_moment(k, g[0], g[1], g[2], wx, wy, wz)
        sx, sy, sz = sx - k * f[0], sy - k * f[1], sz - k * f[2]
        both = -k * (psi + more)
    xx, xy, xz = vector_from_image(motion, xx, xy, xz)
    yx, yy, yz = vector_from_image(motion, yx, yy, yz)
    zx, zy, zz = vector_from_image(motion, zx, zy, zz)
    px, py, pz = vector_from_image(motion, px, py, pz)
    return (xx, xy, xz, sx), (yx, yy, yz, sy), (zx, zy, zz, sz), (px, py, pz, both)


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def clear_blocks(h, until, imaged, image):
    """Put 0 into the blocks (k, 16), or (k, 12), of the pairs h to ``until``."""
    for g in range(h, until):
        e, t = imaged.unique[g // LANES, ENTRY, g % LANES], imaged.unique[g // LANES, TWIN, g % LANES]
        t = t if t >= 0 else e
        for m in range(image.shape[1]):
            image[e, m] = 0.0
        for m in range(image.shape[1]):
            image[t, m] = 0.0


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _add_block(blocks, rows, x, y, z, potential, charged):
    """Add eight blocks to ``rows`` of a table (n, 16), or (n, 12) if not ``charged``."""
    scatter_add(blocks, rows, 0, None, None, x)
    scatter_add(blocks, rows, 4, None, None, y)
    scatter_add(blocks, rows, 8, None, None, z)
    if charged:
        scatter_add(blocks, rows, 12, None, None, potential)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def influences_of_pairs(count, model, place, rows, walls, image_list, heights, image):
    """Blocks (k, 16), or (k, 12), of the first ``count`` images listed, of pairs: of both entries."""
    charged = model.near
    for c in range(0, count, LANES):
        there = mask_of_first(count - c)
        images = _load_images(c, image_list, heights, place, rows, walls)
        x, y, z, v = _influence(images, there, model.reach, model.smear, charged)
        e, t = load(image_list, ENTRY, c), load(image_list, TWIN, c)
        _add_block(image, e, x, y, z, v, charged)
        w = select(from_integers(t) >= 0.0, 1.0, 0.0)
        _add_block(
            image, first_present(t, e),
            (w * x[0], w * y[0], w * z[0], -w * v[0]),
            (w * x[1], w * y[1], w * z[1], -w * v[1]),
            (w * x[2], w * y[2], w * z[2], -w * v[2]),
            (-w * x[3], -w * y[3], -w * z[3], w * v[3]),
            charged,
        )  # fmt: skip


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def influences_of_grains(count, model, place, rows, walls, image_list, heights, itself):
    """Add the first ``count`` images listed, of grains themselves, to blocks (n, 16), or (n, 12)."""
    charged = model.near
    for c in range(0, count, LANES):
        there = mask_of_first(count - c)
        images = _load_images(c, image_list, heights, place, rows, walls)
        x, y, z, v = _influence(images, there, model.reach, model.smear, charged)
        _add_block(itself, load(image_list, ENTRY, c), x, y, z, v, charged)


@device_function(error_model="numpy")
def columns_twice(vector, last):
    """Table (n, 8): every row of `coupling.row_kernels.columns_of` twice, for two rows of a block."""
    table = np.empty((vector.shape[0], LANES))
    for i in range(vector.shape[0]):
        table[i, 0], table[i, 1], table[i, 2], table[i, 3] = vector[i, 0], vector[i, 1], vector[i, 2], last[i]
        table[i, 4], table[i, 5], table[i, 6], table[i, 7] = vector[i, 0], vector[i, 1], vector[i, 2], last[i]
    return table


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def field_of_images(i, start, entry, other, blocks, source):
    """Field (3) [A/m] and potential [A] at grain i of its neighbours' images; of dipoles alone no potential.

    ``blocks`` (k + 1 or more, 16), or (k + 1, 12): of the k entries ``start[i]`` to ``start[i + 1]`` those of grain i,
    whose place in the rows ``entry`` says; ``source`` (n, 8): `columns_twice` of moments [A m^2] and charges [A m].
    """
    upper = lower = splat(0.0)
    for b in range(start[i], start[i + 1]):
        neighbour = load(source, np.int64(other[entry[b]]), 0)
        upper = upper + load(blocks, b, 0) * neighbour
        lower = lower + load(blocks, b, LANES) * neighbour  # of 12 numbers it reads on into the next block, for nothing
    u, v = to_tuple(upper), to_tuple(lower)
    total = (v[4] + v[5]) + (v[6] + v[7]) if blocks.shape[1] > 12 else 0.0
    return (u[0] + u[1]) + (u[2] + u[3]), (u[4] + u[5]) + (u[6] + u[7]), (v[0] + v[1]) + (v[2] + v[3]), total


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _force_and_fields(ax, ay, az, qa, bx, by, bz, qb, dx, dy, dz, reach, smear, charged):
    """Force on a at d from b, of moments and charges, over mu_0/(4 pi); at a the field of b, at b that of a, on 4 pi.

    As `coupling.pair_fields.pair_force` and `coupling.pair_fields.charge_force`; 0 beyond reach.
    """
    r2 = dx * dx + dy * dy + dz * dz
    r = sqrt(r2)
    per_r = 1.0 / r
    nx, ny, nz = dx * per_r, dy * per_r, dz * per_r
    c1, c2, p = field_factors(r, reach, smear)
    c1_r, c2_r = field_slopes(r, reach, smear)
    within = select(r2 < reach * reach, 1.0, 0.0)
    c1, c2, c1_r, c2_r = c1 * within, c2 * within, c1_r * within, c2_r * within
    an, bn = ax * nx + ay * ny + az * nz, bx * nx + by * ny + bz * nz
    turning = c1 * per_r
    along = (c1_r - 2.0 * turning) * an * bn - c2_r * (ax * bx + ay * by + az * bz)
    u, v = turning * bn, turning * an
    at_a, at_b = c1 * bn, c1 * an
    if charged:
        _, p_r = charge_factors(r, reach, smear)
        p = p * within
        away = p * per_r
        along = along + (p_r * within - away) * (qb * an - qa * bn) + p * qa * qb
        u, v = u + away * qb, v - away * qa
        at_a, at_b = at_a + p * qb, at_b - p * qa
    return (
        (along * nx + u * ax + v * bx, along * ny + u * ay + v * by, along * nz + u * az + v * bz),
        (at_a * nx - c2 * bx, at_a * ny - c2 * by, at_a * nz - c2 * bz),
        (at_b * nx - c2 * ax, at_b * ny - c2 * ay, at_b * nz - c2 * az),
    )


@device_function(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _moving_along(x, y, image, k, m, turned, n, g, field):
    """Force on the grain at x, y itself from the force g on its image, because the image moves with it.

    ``image`` (2), ``n`` (3): its place and the wall's normal; ``m`` and ``turned``: the grain's moment and that of its
    image; ``field`` (3): at the image. A charge does not turn.
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
def _forces(images, there, a, b, reach, smear, charged):
    """Forces of images on i and on j [N], of the moments and charges a and b: -dU/dx, see `coupling.mirror`.

    0 if not ``there``.
    """
    motion, k, (xi, yi, zi), (wx, wy, wz, ox, oy, oz), (jx, jy, jz), (ux, uy, uz, qx, qy, qz) = images
    (ax, ay, az, qa), (bx, by, bz, qb) = a, b
    bx, by, bz = vector_to_image(motion, bx, by, bz)
    own, others = mirror_moment(k, ax, ay, az, wx, wy, wz), mirror_moment(k, bx, by, bz, ux, uy, uz)
    ox, oy, oz, qx, qy, qz = xi + ox, yi + oy, zi + oz, jx + qx, jy + qy, jz + qz
    # the image of j with i
    f, _, at_image_j = _force_and_fields(
        ax, ay, az, qa, others[0], others[1], others[2], -k * qb, xi - qx, yi - qy, zi - qz, reach, smear, charged
    )  # fmt: skip
    # j with the image of i
    g, at_image_i, _ = _force_and_fields(
        own[0], own[1], own[2], -k * qa, bx, by, bz, qb, ox - jx, oy - jy, oz - jz, reach, smear, charged
    )  # fmt: skip
    p = _moving_along(xi, yi, (ox, oy), k, (ax, ay), own, (wx, wy, wz), g, at_image_i)
    f_on_image = (-f[0], -f[1], -f[2])
    q = _moving_along(jx, jy, (qx, qy), k, (bx, by), others, (ux, uy, uz), f_on_image, at_image_j)
    half = select(there, 0.5 * MU_0_OVER_4PI, 0.0)
    x, y, z = vector_from_image(motion, half * (q[0] - g[0]), half * (q[1] - g[1]), half * (q[2] - g[2]))
    none = splat(0.0)
    return (half * (f[0] + p[0]), half * (f[1] + p[1]), half * (f[2] + p[2]), none), (x, y, z, none)


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def clear_forces(h, until, imaged, force):
    """Put 0 into the rows (k, 4) of the pairs h to ``until``."""
    for g in range(h, until):
        e, t = imaged.unique[g // LANES, ENTRY, g % LANES], imaged.unique[g // LANES, TWIN, g % LANES]
        t = t if t >= 0 else e
        force[e, 0] = force[e, 1] = force[e, 2] = force[e, 3] = 0.0
        force[t, 0] = force[t, 1] = force[t, 2] = force[t, 3] = 0.0


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def find_forces(count, model, place, source, rows, walls, image_list, heights, force):
    """Add the forces of the first ``count`` images listed to rows (k, 4) [N]: of their entries, or of their grains.

    ``source`` (n, 4): moments [A m^2] and charges [A m].
    """
    for c in range(0, count, LANES):
        images = _load_images(c, image_list, heights, place, rows, walls)
        a = gather_columns(source, load(image_list, FIRST, c), 0)
        b = gather_columns(source, load(image_list, SECOND, c), 0)
        there = mask_of_first(count - c)
        here, back = _forces(images, there, a, b, model.reach, model.smear, model.near)
        e, t = load(image_list, ENTRY, c), load(image_list, TWIN, c)
        scatter_add(force, e, 0, None, None, here)
        weight = select(from_integers(t) >= 0.0, 1.0, 0.0)
        back = weight * back[0], weight * back[1], weight * back[2], back[3]
        scatter_add(force, first_present(t, e), 0, None, None, back)
