"""Images of grains in steel walls, many side by side: their influence on grains, and their forces.

A grain's image acts on itself and on its neighbours. Of a pair and a wall both halves of the energy of
`coupling.mirror` are found at once, for both grains: they are the same two pairs of dipoles, j* with i and j with i*.

Influence: blocks (3, 4), the part of S_x, S_y, S_z [1/m^3] and P [1/m^2] that each component of the moment makes, in
the neighbour's own frame. With T = (c1 n n - c2 1)/(4 pi) and P = k (2 u u - 1) the mirror at a wall's normal u, an
image adds (T P_j + P_i T)/2 to the field, the one T from the image of j to i, the other from j to the image of i, and
p n . P_j to the potential. The field's part seen from j is the transposed one, because both are derivatives of one
energy.
"""

from __future__ import annotations

import numpy as np

from coupling.kernel_state import Chosen
from coupling.mirror import mirrored, pushed
from coupling.pair_fields import MU_0_OVER_4PI, OVER_4PI, field_factors, field_slopes
from geometry.inner_functions import inner
from geometry.lane_functions import LANES, lane_room, square_root

# fields in the lanes: places of i and, turned to its side, of j; cosine and sine of that turn; heights at which they
# are mirrored, and of the wall its strength and tangent; moments; which pair and wall; then what comes out: forces, or
# of an influence a block (12) and what is made of the potential of i at j (3)
XI, XJ, TURN, HEIGHT_I, HEIGHT_J, STRENGTH, TANGENT, MOMENT_I, MOMENT_J, PAIR, WALL = (
    0,
    3,
    6,
    8,
    9,
    10,
    11,
    13,
    16,
    19,
    20,
)
OUT = FORCE_I = 21
FORCE_J = FORCE_I + 3
INFLUENCE_FIELDS, FORCE_FIELDS = OUT + 15, FORCE_J + 3


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def sees_image(height, i, j, w, radius, reach):
    """Whether grain i may be within reach of the image of j in wall ``w``, which is never nearer than both heights."""
    # without branches, which would often be mispredicted; one that faces no wall is farther than any reach
    within = abs(pushed(height[i, w], radius[i]) + pushed(height[j, w], radius[j])) < reach
    return within & (height[i, w] * height[j, w] >= 0.0)


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def partners(h, rows, imaged):
    """Of the h-th pair, or behind the pairs grain, i, j, the cosine and sine of the turn and the place of the pair."""
    if h < imaged.once.shape[0]:
        e = np.int64(imaged.once[h, 1])
        q = imaged.entry[e]
        return (
            np.int64(imaged.once[h, 0]), np.int64(rows.other[q]), rows.turn_cos[rows.shift[q]],
            rows.turn_sin[rows.shift[q]], e,
        )  # fmt: skip
    i = h - imaged.once.shape[0]
    return i, i, 1.0, 0.0, np.int64(-1)


@inner(error_model="numpy", fastmath={"contract"}, forceinline=True)
def over(x, y, h, tangent_r, tangent_z):
    """Normal of a wall over a place, which it does not have on the axis; and the way (3) from there to the image."""
    rho2 = x * x + y * y
    out = -tangent_z / square_root(rho2) if rho2 > 0.0 else 0.0
    nx, ny = out * x, out * y
    return nx, ny, tangent_r, -2.0 * h * nx, -2.0 * h * ny, -2.0 * h * tangent_r


@inner(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _block(dx, dy, dz, reach, smear):
    """4 pi T (xx, yy, zz, xy, xz, yz) and 4 pi p n at the distance vector d from a moment; 0 beyond reach."""
    r2 = dx * dx + dy * dy + dz * dz
    r = square_root(r2)
    per_r = 1.0 / r
    nx, ny, nz = dx * per_r, dy * per_r, dz * per_r
    c1, c2, p = field_factors(r, reach, smear)
    if r2 >= reach * reach:
        c1 = c2 = p = 0.0
    ax, ay, az = c1 * nx, c1 * ny, c1 * nz
    return ax * nx - c2, ay * ny - c2, az * nz - c2, ax * ny, ax * nz, ay * nz, p * nx, p * ny, p * nz


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _place(lane, a, where, height):
    """Centre [m] in the fields from ``where`` on of lane ``a``, and what is `over` it at the ``height`` of its wall."""
    x, y, z = lane[a, where], lane[a, where + 1], lane[a, where + 2]
    return (x, y, z), over(x, y, lane[a, height], lane[a, TANGENT], lane[a, TANGENT + 1])


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _influence(lane, a, reach, smear):
    """Block of the image in lane ``a``, and what it makes of the potential of i at j."""
    k = OVER_4PI * lane[a, STRENGTH]
    (xi, yi, zi), (wx, wy, wz, ox, oy, oz) = _place(lane, a, XI, HEIGHT_I)
    (jx, jy, jz), (ux, uy, uz, qx, qy, qz) = _place(lane, a, XJ, HEIGHT_J)
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
    px, py, pz = mirrored(k, fx, fy, fz, ux, uy, uz)
    qx, qy, qz = mirrored(-k, gx, gy, gz, wx, wy, wz)  # seen from j: against the distance vector
    c, s = lane[a, TURN], lane[a, TURN + 1]  # to the frame of j
    return (
        (c * xx + s * xy, c * yx + s * yy, c * zx + s * zy, c * px + s * py),
        (c * xy - s * xx, c * yy - s * yx, c * zy - s * zx, c * py - s * px),
        (xz, yz, zz, pz),
        (qx, qy, qz),
    )


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def gather(lane, h, w, until, model, grains, rows, imaged, walls):
    """Lay pairs and walls, from pair h and wall w on, into the lanes until these are full; how many, next h and w."""
    position, moment, height, radius = grains.position, grains.moment, grains.height, grains.radius
    count = 0
    while h < until and count < LANES:
        i, j, c, s, _ = partners(h, rows, imaged)
        while w < walls.shape[0] and count < LANES:
            if sees_image(height, i, j, w, radius, model.reach):
                a = count
                lane[a, XI], lane[a, XI + 1], lane[a, XI + 2] = position[i, 0], position[i, 1], position[i, 2]
                x, y = position[j, 0], position[j, 1]
                lane[a, XJ], lane[a, XJ + 1], lane[a, XJ + 2] = c * x - s * y, s * x + c * y, position[j, 2]
                lane[a, TURN], lane[a, TURN + 1] = c, s
                lane[a, HEIGHT_I], lane[a, HEIGHT_J] = pushed(height[i, w], radius[i]), pushed(height[j, w], radius[j])
                lane[a, STRENGTH], lane[a, TANGENT], lane[a, TANGENT + 1] = walls[w, 5], walls[w, 2], walls[w, 3]
                x, y = moment[j, 0], moment[j, 1]
                lane[a, MOMENT_I], lane[a, MOMENT_I + 1], lane[a, MOMENT_I + 2] = (
                    moment[i, 0],
                    moment[i, 1],
                    moment[i, 2],
                )
                lane[a, MOMENT_J], lane[a, MOMENT_J + 1], lane[a, MOMENT_J + 2] = (
                    c * x - s * y,
                    s * x + c * y,
                    moment[j, 2],
                )
                lane[a, PAIR], lane[a, WALL] = h, w
                count += 1
            w += 1
        if w == walls.shape[0]:
            h, w = h + 1, 0
    return count, h, w


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def find_influences(h, until, model, grains, rows, imaged, walls, image, itself, own_image):
    """Blocks of the pairs h to ``until``, or behind the pairs grains; see `partners`."""
    lane = lane_room(INFLUENCE_FIELDS)
    for g in range(h, min(until, imaged.once.shape[0])):
        e = imaged.once[g, 1]
        t = imaged.twin[e]
        image[e] = 0.0
        if t >= 0:
            image[t] = 0.0
    w = np.int64(0)
    while h < until:
        count, h, w = gather(lane, h, w, until, model, grains, rows, imaged, walls)
        for a in range(LANES):
            x, y, z, back = _influence(lane, a, model.reach, model.smear)
            lane[a, OUT], lane[a, OUT + 1], lane[a, OUT + 2], lane[a, OUT + 3] = x
            lane[a, OUT + 4], lane[a, OUT + 5], lane[a, OUT + 6], lane[a, OUT + 7] = y
            lane[a, OUT + 8], lane[a, OUT + 9], lane[a, OUT + 10], lane[a, OUT + 11] = z
            lane[a, OUT + 12], lane[a, OUT + 13], lane[a, OUT + 14] = back
        for a in range(count):
            i, _, _, _, e = partners(np.int64(lane[a, PAIR]), rows, imaged)
            block = itself[i] if e < 0 else image[e]
            for b in range(3):
                for m in range(4):
                    block[b, m] += lane[a, OUT + 4 * b + m]
            if e < 0:
                for b in range(3):
                    own_image[i, np.int64(lane[a, WALL]), b] = lane[a, OUT + 4 * b + 3]
                continue
            t = imaged.twin[e]
            if t >= 0:
                for b in range(3):
                    for m in range(3):
                        image[t, b, m] += lane[a, OUT + 4 * m + b]
                    image[t, b, 3] += lane[a, OUT + 12 + b]


@inner(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _pull(ax, ay, az, bx, by, bz, dx, dy, dz, reach, smear):
    """Force on moment a at d from moment b, over mu_0/(4 pi); at a the field of b, at b that of a, on 4 pi.

    As `coupling.pair_fields.pair_force`; 0 beyond reach.
    """
    r2 = dx * dx + dy * dy + dz * dz
    r = square_root(r2)
    per_r = 1.0 / r
    nx, ny, nz = dx * per_r, dy * per_r, dz * per_r
    c1, c2, _ = field_factors(r, reach, smear)
    c1_r, c2_r = field_slopes(r, reach, smear)
    if r2 >= reach * reach:
        c1 = c2 = c1_r = c2_r = 0.0
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


@inner(error_model="numpy", fastmath={"contract"}, forceinline=True)
def _moving_along(x, y, image, k, m, turned, n, g, field):
    """What the force g on a grain's image is on the grain at x, y itself, because the image moves with it.

    ``image`` (2), ``n`` (3): its place and the wall's normal; ``m`` and ``turned``: the grain's moment and that of its
    image; ``field`` (3): at the image.
    """
    along = 2.0 * (g[0] * n[0] + g[1] * n[1] + g[2] * n[2])  # in the section it moves mirrored
    gx, gy, gz = g[0] - along * n[0], g[1] - along * n[1], g[2] - along * n[2]
    rho2 = x * x + y * y
    per_rho = 1.0 / square_root(rho2) if rho2 > 0.0 else 0.0
    ex, ey = -y * per_rho, x * per_rho
    # about the axis by the ratio of radii
    more = (square_root(image[0] * image[0] + image[1] * image[1]) * per_rho - 1.0) * (gx * ex + gy * ey)
    # its moment turns with the half plane: dm*/dphi = z x m* - P (z x m)
    tx, ty, tz = mirrored(k, -m[1], m[0], 0.0, n[0], n[1], n[2])
    more += (field[0] * (-turned[1] - tx) + field[1] * (turned[0] - ty) - field[2] * tz) * per_rho
    return gx + more * ex, gy + more * ey, gz


@inner(borrows=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def _forces(lane, a, reach, smear):
    """Forces of the image in lane ``a`` on i and on j [N]: -dU/dx, see `coupling.mirror`."""
    k = lane[a, STRENGTH]
    (xi, yi, zi), (wx, wy, wz, ox, oy, oz) = _place(lane, a, XI, HEIGHT_I)
    (jx, jy, jz), (ux, uy, uz, qx, qy, qz) = _place(lane, a, XJ, HEIGHT_J)
    ax, ay, az = lane[a, MOMENT_I], lane[a, MOMENT_I + 1], lane[a, MOMENT_I + 2]
    bx, by, bz = lane[a, MOMENT_J], lane[a, MOMENT_J + 1], lane[a, MOMENT_J + 2]
    own, others = mirrored(k, ax, ay, az, wx, wy, wz), mirrored(k, bx, by, bz, ux, uy, uz)
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
    half = 0.5 * MU_0_OVER_4PI
    x, y, z = half * (q[0] - g[0]), half * (q[1] - g[1]), half * (q[2] - g[2])
    c, s = lane[a, TURN], lane[a, TURN + 1]  # to the frame of j
    return (half * (f[0] + p[0]), half * (f[1] + p[1]), half * (f[2] + p[2])), (c * x + s * y, c * y - s * x, z)


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def find_forces(h, until, model, grains, rows, known, walls, force, own_force):
    """Forces (k, 3) [N] of images, of each chosen entry on its grain, and (n, 3) of each grain's own; both 0 before.

    Those of the pairs h to ``until``, or behind the pairs of grains; see `partners`.
    """
    imaged = Chosen(known.image_start, known.image_entry, known.image_twin, known.image_once)
    lane = lane_room(FORCE_FIELDS)
    w = np.int64(0)
    while h < until:
        count, h, w = gather(lane, h, w, until, model, grains, rows, imaged, walls)
        for a in range(LANES):
            here, there = _forces(lane, a, model.reach, model.smear)
            lane[a, FORCE_I], lane[a, FORCE_I + 1], lane[a, FORCE_I + 2] = here
            lane[a, FORCE_J], lane[a, FORCE_J + 1], lane[a, FORCE_J + 2] = there
        for a in range(count):
            i, _, _, _, e = partners(np.int64(lane[a, PAIR]), rows, imaged)
            for b in range(3):
                if e < 0:
                    own_force[i, b] += lane[a, FORCE_I + b]
                else:
                    force[e, b] += lane[a, FORCE_I + b]
                    if imaged.twin[e] >= 0:
                        force[imaged.twin[e], b] += lane[a, FORCE_J + b]
