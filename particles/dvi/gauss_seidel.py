"""Nonlinear Gauss-Seidel over the graph of contacts, and the honest residual.

Unknown are the velocities v = v_free + M^-1 H r after the step and one impulse r a contact, in world axes, that acts
on the first grain; e is the unit vector from the partner (or wall) to the first grain, u the velocity of the first
relative to the second at the contact. A sweep visits contact by contact, solves its local problem for the velocities
just updated (`particles.dvi.local_problem`) and passes the change of its impulse on to the two bodies at once (Jean,
Comput. Methods Appl. Mech. Engrg. 177 (1999) 235).

**Scaled spins.** With p = R omega a solid sphere (J = 2/5 m R^2) that takes the impulse r at the lever arm a R obeys

    dv = r/m,   dp = -(5/2) a (e x r)/m    and    u = v_i - v_j - a (p_i + p_j) x e,

so that its radius is needed nowhere, and its record is one cache line. The arms R_i a and R_j a add up to the
distance of the centres (a = 1 where they touch): angular momentum is conserved to round-off.

**Images.** Where space repeats (`particles.periodicity`), a contact may couple its first grain with an image of the
second. Everything of it is kept as the first grain sees it: velocity and spin of the second are turned to the image,
the change of its impulse and of its moment is turned back; in a sheared box the image is faster than the grain itself
(`particles.dvi.flow_in_box`). The contacts of the other copies are those images of it, and
a free shaft, which all of them turn, is that many times lighter.

**Order.** Groups of up to eight contacts without a common grain are visited at once, which is the same as one contact
after another (`particles.dvi.contact_groups`); those of all rows of the neighbour list, or in chunks of them
(`particles.dvi.sweep_chunks`); it follows from the list alone. No branch within a group: wrong guesses would cost more.

**Springs.** With ``compliance`` every contact is compliant like the springs of `LinearContact`, taken at the end of the
step (`particles.dvi.compliance`): instead of u the laws hold for u + o + C r, with C = diag(c_n, c_t, c_t), and
an offset o that holds the present springs. 1/w_n and 1/w_t then hold c as well. None: rigid.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, llvm_sqrt, reduce_max, select, splat
from geometry.kernels.simd_tables import gather_columns, load, scatter_columns
from particles.dvi.contact_groups import CONTACT, FIRST, N_GROUP, SECOND, group_contacts
from particles.dvi.local_problem import coulomb_block, natural_map
from particles.dvi.solver_state import SolverContacts, all_of
from particles.periodic_images import pair_vector_from_image, pairs_from_images, pairs_to_images
from particles.periodicity import N_IMAGE

# columns of a grain: velocity, 1/m, scaled spin
VX, VY, VZ, IM, PX, PY, PZ = range(7)
N_GRAIN = 8
# columns of a body: speed [rad/s], sectors/inertia (0: prescribed), largest impulse of the load, and the present one
SPEED, IJ, LOAD, BRAKE = range(4)
N_BODY = 4
# columns of a contact: normal, arm, impulse on the first grain, offset of the normal velocity, 1/w_n, 1/w_t, friction,
# with springs the gap; of a wall contact also the lever z x (contact point) of its body
EX, EY, EZ, ARM, RX, RY, RZ, B, IWN, IWT, MU, GAP, LX, LY = range(14)
N_PAIR = 12
N_WALL_CONTACT = 16  # four are read at once
N_SPRING = 4  # behind these, with springs: the tangential offset in world axes, and c_n
# rows of ``compliance``: between grains, at walls; columns: k_n [N/m], c_t [1/kg], and what K follows from
# (`particles.dvi.compliance`): the largest sqrt(a) at which the restitution is met, 2 zeta, log K against sqrt(a)
PAIRS, WALLS = 0, 1
STIFFNESS, TANGENTIAL, MET, DASHPOT, SHARES = range(5)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def apply_impulses(sign, records):
    """Add to the velocities ``sign`` times what the impulses in the records do."""
    grain, body, pair_index, pair, wall_index, wall = records[:6]
    images, shift = records.images, records.pair_shift
    for k in range(pair.shape[0]):
        i, j = pair_index[k, 0], pair_index[k, 1]
        x, y, z = sign * pair[k, RX], sign * pair[k, RY], sign * pair[k, RZ]
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        a, b, c = grain[i, IM], grain[j, IM], -2.5 * pair[k, ARM]
        sx = c * (pair[k, EY] * z - pair[k, EZ] * y)
        sy = c * (pair[k, EZ] * x - pair[k, EX] * z)
        sz = c * (pair[k, EX] * y - pair[k, EY] * x)
        grain[i, VX] += a * x
        grain[i, VY] += a * y
        grain[i, VZ] += a * z
        grain[i, PX] += a * sx
        grain[i, PY] += a * sy
        grain[i, PZ] += a * sz
        x, y = pair_vector_from_image(images, shift, k, x, y)
        sx, sy = pair_vector_from_image(images, shift, k, sx, sy)
        grain[j, VX] -= b * x
        grain[j, VY] -= b * y
        grain[j, VZ] -= b * z
        grain[j, PX] += b * sx
        grain[j, PY] += b * sy
        grain[j, PZ] += b * sz
    for k in range(wall.shape[0]):
        i, b = wall_index[k, 0], wall_index[k, 1]
        x, y, z = sign * wall[k, RX], sign * wall[k, RY], sign * wall[k, RZ]
        a = grain[i, IM]
        c = -2.5 * a * wall[k, ARM]
        grain[i, VX] += a * x
        grain[i, VY] += a * y
        grain[i, VZ] += a * z
        grain[i, PX] += c * (wall[k, EY] * z - wall[k, EZ] * y)
        grain[i, PY] += c * (wall[k, EZ] * x - wall[k, EX] * z)
        grain[i, PZ] += c * (wall[k, EX] * y - wall[k, EY] * x)
        if body[b, IJ] > 0.0:
            body[b, SPEED] -= body[b, IJ] * (wall[k, LX] * x + wall[k, LY] * y)
    for b in range(body.shape[0]):
        body[b, SPEED] -= sign * body[b, IJ] * body[b, BRAKE]


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _springs(compliance, kind, row, contacts, behind):
    """Offset and compliances of contacts, or None of rigid ones; their columns begin ``behind`` the others."""
    if compliance is None:
        return None
    else:
        ox, oy, oz, c_n = gather_columns(row, contacts, behind)
        return ox, oy, oz, c_n, compliance[kind, TANGENTIAL]


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _velocity(e, arm, r, u, s, b, springs):
    """u_n with its offset, u_t in world axes, and r_n, of the velocities u of centres and the spins s about them."""
    ex, ey, ez = e
    ux, uy, uz = u
    sx, sy, sz = s
    rx, ry, rz = r
    along = ux * ex + uy * ey + uz * ez
    was = rx * ex + ry * ey + rz * ez
    u_n = along + b
    ux = ux - along * ex - arm * (sy * ez - sz * ey)
    uy = uy - along * ey - arm * (sz * ex - sx * ez)
    uz = uz - along * ez - arm * (sx * ey - sy * ex)
    if springs is not None:
        ox, oy, oz, c_n, c = springs
        u_n = u_n + c_n * was
        ux = ux + ox + c * (rx - was * ex)
        uy = uy + oy + c * (ry - was * ey)
        uz = uz + oz + c * (rz - was * ez)
    return u_n, ux, uy, uz, was


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _change(convex, relax, e, r, inverse, slow, mu, velocity):
    """Return the change of the impulses r by the local law, and its square."""
    ex, ey, ez = e
    rx, ry, rz = r
    u_n, ux, uy, uz, was = velocity
    if convex is None:
        inverse, slow = relax * inverse, relax * slow
    r_n = was - u_n * inverse
    tx, ty, tz = rx - was * ex - slow * ux, ry - was * ey - slow * uy, rz - was * ez - slow * uz
    size2 = tx * tx + ty * ty + tz * tz
    if convex is None:
        r_n = select(r_n > 0.0, r_n, 0.0)
        limit = mu * r_n
        scale = select(size2 > limit * limit, limit / llvm_sqrt(size2), 1.0)
    else:
        size = llvm_sqrt(size2)  # the nearest point of the cone in the metric of W
        nearest = (slow * r_n + inverse * mu * size) / (slow + inverse * mu * mu)
        r_n = select(size > mu * r_n, nearest, r_n)
        r_n = select(r_n > 0.0, r_n, 0.0)
        scale = select(size > mu * r_n, mu * r_n / size, 1.0)
    x, y, z = r_n * ex + scale * tx - rx, r_n * ey + scale * ty - ry, r_n * ez + scale * tz - rz
    return x, y, z, x * x + y * y + z * z


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def sweep_pairs(lo, hi, convex, relax, compliance, records):
    """Visit the pairs lo <= k < hi; returns the largest change of an impulse times w_n, squared [m^2/s^2].

    ``convex`` None: exact Coulomb, over-relaxed by ``relax`` (1: not), which the convex law does not read.
    """
    grain, table, pair = records.grain, records.pair_group, records.pair
    images, shift = records.images, records.pair_shift
    largest = splat(0.0)
    for g in range(lo, hi):
        if table[g, CONTACT, 0] < 0:
            break
        k, i, j = load(table, g, CONTACT), load(table, g, FIRST), load(table, g, SECOND)
        vx, vy, vz, a = gather_columns(grain, i, VX)
        px, py, pz, rest = gather_columns(grain, i, PX)
        wx, wy, wz, b = gather_columns(grain, j, VX)
        qx, qy, qz, other_rest = gather_columns(grain, j, PX)
        ex, ey, ez, arm = gather_columns(pair, k, EX)
        rx, ry, rz, offset = gather_columns(pair, k, RX)
        inverse, slow, mu, _ = gather_columns(pair, k, IWN)
        springs = _springs(compliance, PAIRS, pair, k, N_PAIR)
        e, r = (ex, ey, ez), (rx, ry, rz)
        ux, uy, sx, sy = pairs_to_images(images, shift, k, wx, wy, qx, qy)
        u, s = (vx - ux, vy - uy, vz - wz), (px + sx, py + sy, pz + qz)
        velocity = _velocity(e, arm, r, u, s, offset, springs)
        x, y, z, change = _change(convex, relax, e, r, inverse, slow, mu, velocity)
        change = change / (inverse * inverse)
        largest = select(change > largest, change, largest)
        scatter_columns(pair, k, RX, rx + x, ry + y, rz + z, offset)
        scatter_columns(grain, i, VX, vx + a * x, vy + a * y, vz + a * z, a)
        arm = -2.5 * arm
        sx, sy, sz = arm * (ey * z - ez * y), arm * (ez * x - ex * z), arm * (ex * y - ey * x)
        scatter_columns(grain, i, PX, px + a * sx, py + a * sy, pz + a * sz, rest)
        x, y, sx, sy = pairs_from_images(images, shift, k, x, y, sx, sy)
        scatter_columns(grain, j, VX, wx - b * x, wy - b * y, wz - b * z, b)
        scatter_columns(grain, j, PX, qx + b * sx, qy + b * sy, qz + b * sz, other_rest)
    return reduce_max(largest) if convex is not None else reduce_max(largest) / (relax * relax)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def sweep_walls(lo, hi, convex, relax, compliance, records):
    """Visit the contacts with walls lo <= k < hi, as `sweep_pairs`."""
    grain, body, table, wall = records.grain, records.body, records.wall_group, records.wall
    largest, at_shafts = splat(0.0), 0.0
    for g in range(lo, hi):
        if table[g, CONTACT, 0] < 0:
            break
        if body[table[g, SECOND, 0], IJ] > 0.0:
            at_shafts = max(at_shafts, _visit_shaft(table[g, CONTACT, 0], convex, relax, compliance, records))
            continue
        k, i = load(table, g, CONTACT), load(table, g, FIRST)
        vx, vy, vz, a = gather_columns(grain, i, VX)
        px, py, pz, rest = gather_columns(grain, i, PX)
        omega, _, _, _ = gather_columns(body, load(table, g, SECOND), SPEED)
        ex, ey, ez, arm = gather_columns(wall, k, EX)
        rx, ry, rz, offset = gather_columns(wall, k, RX)
        inverse, slow, mu, _ = gather_columns(wall, k, IWN)
        lx, ly, _, _ = gather_columns(wall, k, LX)
        springs = _springs(compliance, WALLS, wall, k, N_WALL_CONTACT)
        e, r = (ex, ey, ez), (rx, ry, rz)
        velocity = _velocity(e, arm, r, (vx - omega * lx, vy - omega * ly, vz), (px, py, pz), offset, springs)
        x, y, z, change = _change(convex, relax, e, r, inverse, slow, mu, velocity)
        change = change / (inverse * inverse)
        largest = select(change > largest, change, largest)
        scatter_columns(wall, k, RX, rx + x, ry + y, rz + z, offset)
        scatter_columns(grain, i, VX, vx + a * x, vy + a * y, vz + a * z, a)
        arm = -2.5 * a * arm
        sx, sy, sz = arm * (ey * z - ez * y), arm * (ez * x - ex * z), arm * (ex * y - ey * x)
        scatter_columns(grain, i, PX, px + sx, py + sy, pz + sz, rest)
    return max(reduce_max(largest), at_shafts)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _visit_shaft(k, convex, relax, compliance, records):
    """Visit a contact with a free shaft."""
    grain, body, wall = records.grain, records.body, records.wall
    i, b = records.wall_index[k, 0], records.wall_index[k, 1]
    ex, ey, ez, arm = wall[k, EX], wall[k, EY], wall[k, EZ], wall[k, ARM]
    rx, ry, rz = wall[k, RX], wall[k, RY], wall[k, RZ]
    omega, free = body[b, SPEED], body[b, IJ]
    u = grain[i, VX] - omega * wall[k, LX], grain[i, VY] - omega * wall[k, LY], grain[i, VZ]
    s = grain[i, PX], grain[i, PY], grain[i, PZ]
    springs = None
    u_n, ux, uy, uz, was = _velocity((ex, ey, ez), arm, (rx, ry, rz), u, s, wall[k, B], springs)
    if compliance is not None:
        c = compliance[WALLS, TANGENTIAL]
        u_n += wall[k, N_WALL_CONTACT + 3] * was
        ux += wall[k, N_WALL_CONTACT] + c * (rx - was * ex)
        uy += wall[k, N_WALL_CONTACT + 1] + c * (ry - was * ey)
        uz += wall[k, N_WALL_CONTACT + 2] + c * (rz - was * ez)
    inverse, slow, mu = wall[k, IWN], wall[k, IWT], wall[k, MU]
    if convex is None:
        if was - u_n * relax * inverse <= 0.0 and rx == 0.0 and ry == 0.0 and rz == 0.0:
            return 0.0
        x, y, z = _block(wall, k, free, mu, u_n, ux, uy, uz, was)
        x, y, z = x - rx, y - ry, z - rz
    else:  # a gradient step, short enough for every direction of the block
        slow = 1.0 / (1.0 / slow + free * (wall[k, LX] ** 2 + wall[k, LY] ** 2))
        velocity = u_n, ux, uy, uz, was
        x, y, z, _ = _change(convex, relax, (ex, ey, ez), (rx, ry, rz), slow, slow, mu, velocity)
    wall[k, RX], wall[k, RY], wall[k, RZ] = rx + x, ry + y, rz + z
    a = grain[i, IM]
    grain[i, VX] += a * x
    grain[i, VY] += a * y
    grain[i, VZ] += a * z
    arm *= -2.5 * a
    grain[i, PX] += arm * (ey * z - ez * y)
    grain[i, PY] += arm * (ez * x - ex * z)
    grain[i, PZ] += arm * (ex * y - ey * x)
    body[b, SPEED] -= free * (wall[k, LX] * x + wall[k, LY] * y)
    return (x * x + y * y + z * z) / (inverse * inverse)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _frame(wall, k):
    """Lever along the normal, lever in the tangent plane, and the unit tangent vector along it."""
    along = wall[k, LX] * wall[k, EX] + wall[k, LY] * wall[k, EY]
    x, y, z = wall[k, LX] - along * wall[k, EX], wall[k, LY] - along * wall[k, EY], -along * wall[k, EZ]
    across = np.sqrt(x * x + y * y + z * z)
    if across > 0.0:
        return along, across, x / across, y / across, z / across
    if abs(wall[k, EX]) < 0.6:  # any tangent will do
        x, y, z = 0.0, wall[k, EZ], -wall[k, EY]
    else:
        x, y, z = -wall[k, EZ], 0.0, wall[k, EX]
    size = np.sqrt(x * x + y * y + z * z)
    return along, 0.0, x / size, y / size, z / size


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _block(wall, k, free, mu, u_n, ux, uy, uz, was):
    """The new impulse (world axes) of a contact with a free shaft; u_t in world axes, ``was`` the old r_n."""
    ex, ey, ez = wall[k, EX], wall[k, EY], wall[k, EZ]
    along, across, fx, fy, fz = _frame(wall, k)
    gx, gy, gz = ey * fz - ez * fy, ez * fx - ex * fz, ex * fy - ey * fx
    w_t = 1.0 / wall[k, IWT]
    w_nn, w_n1, w_11 = 1.0 / wall[k, IWN], free * along * across, w_t + free * across * across
    r_1 = wall[k, RX] * fx + wall[k, RY] * fy + wall[k, RZ] * fz
    r_2 = wall[k, RX] * gx + wall[k, RY] * gy + wall[k, RZ] * gz
    q_n = u_n - w_nn * was - w_n1 * r_1
    q_1 = ux * fx + uy * fy + uz * fz - w_n1 * was - w_11 * r_1
    q_2 = ux * gx + uy * gy + uz * gz - w_t * r_2
    n, a, b = coulomb_block(w_nn, w_n1, 0.0, w_11, 0.0, w_t, mu, q_n, q_1, q_2)
    return n * ex + a * fx + b * gx, n * ey + a * fy + b * gy, n * ez + a * fz + b * gz


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def sweep_loads(body):
    """Dry friction on the free shafts: the brake's impulse stops them, up to its limit; returns the largest change."""
    largest = 0.0
    for b in range(body.shape[0]):
        if body[b, LOAD] > 0.0:
            brake = body[b, BRAKE] + body[b, SPEED] / body[b, IJ]
            brake = min(max(brake, -body[b, LOAD]), body[b, LOAD])
            change = (brake - body[b, BRAKE]) * body[b, IJ]
            body[b, SPEED] -= change
            body[b, BRAKE] = brake
            largest = max(largest, abs(change))
    return largest


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def sweep(convex, relax, compliance, records):
    """One sweep over everything; returns the largest change [m/s]."""
    first = np.int64(0)  # a plain 0 is a type of its own
    b = sweep_pairs(first, records.pair.shape[0], convex, relax, compliance, records)
    a = sweep_walls(first, records.wall.shape[0], convex, relax, compliance, records)
    sweep_loads(records.body)
    return np.sqrt(max(a, b))


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def residual(part, convex, compliance, records):
    """Largest natural map over the contacts of a part [m/s], all at the same velocities."""
    grain, body, pair, wall = records.grain, records.body, records.pair, records.wall
    pairs, walls = records.pair_group, records.wall_group
    worst = splat(0.0)
    for g in range(part.p0, part.p1):
        if pairs[g, CONTACT, 0] < 0:
            break
        k = load(pairs, g, CONTACT)
        i, j = load(pairs, g, FIRST), load(pairs, g, SECOND)
        vx, vy, vz, _ = gather_columns(grain, i, VX)
        px, py, pz, _ = gather_columns(grain, i, PX)
        wx, wy, wz, _ = gather_columns(grain, j, VX)
        qx, qy, qz, _ = gather_columns(grain, j, PX)
        wx, wy, qx, qy = pairs_to_images(records.images, records.pair_shift, k, wx, wy, qx, qy)
        u, s = (vx - wx, vy - wy, vz - wz), (px + qx, py + qy, pz + qz)
        missed = _map(convex is not None, pair, k, u, s, _springs(compliance, PAIRS, pair, k, N_PAIR))
        worst = select(missed > worst, missed, worst)
    for g in range(part.w0, part.w1):
        if walls[g, CONTACT, 0] < 0:
            break
        k, i = load(walls, g, CONTACT), load(walls, g, FIRST)
        vx, vy, vz, _ = gather_columns(grain, i, VX)
        px, py, pz, _ = gather_columns(grain, i, PX)
        omega, _, _, _ = gather_columns(body, load(walls, g, SECOND), SPEED)
        lx, ly, _, _ = gather_columns(wall, k, LX)
        u, s = (vx - omega * lx, vy - omega * ly, vz), (px, py, pz)
        missed = _map(convex is not None, wall, k, u, s, _springs(compliance, WALLS, wall, k, N_WALL_CONTACT))
        worst = select(missed > worst, missed, worst)
    return reduce_max(worst)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _map(convex, row, contacts, u, s, springs):
    """Natural map of contacts from velocities of centres and spins."""
    ex, ey, ez, arm = gather_columns(row, contacts, EX)
    rx, ry, rz, offset = gather_columns(row, contacts, RX)
    inverse, _, mu, _ = gather_columns(row, contacts, IWN)
    u_n, ux, uy, uz, r_n = _velocity((ex, ey, ez), arm, (rx, ry, rz), u, s, offset, springs)
    tx, ty, tz = rx - r_n * ex, ry - r_n * ey, rz - r_n * ez
    # two coordinates span the tangent plane: along t (along u without t), and what is left of u across it
    size = llvm_sqrt(tx * tx + ty * ty + tz * tz)
    holds, all_of_u = size > 0.0, llvm_sqrt(ux * ux + uy * uy + uz * uz)
    a = (ux * tx + uy * ty + uz * tz) / size
    x, y, z = ux - a * tx / size, uy - a * ty / size, uz - a * tz / size
    b = llvm_sqrt(x * x + y * y + z * z)
    a, b = select(holds, a, all_of_u), select(holds, b, 0.0)
    return natural_map(convex, 1.0 / inverse, mu, r_n, size, splat(0.0), u_n, a, b)


# The same for calls from Python: these have a cache, and no kernel calls them
@device_function(error_model="numpy", fastmath={"contract"})
def grouped(grain, body, pair_index, pair, wall_index, wall):
    """Records of so many contacts in a space that does not repeat, with their groups."""
    pair_group = np.empty((pair.shape[0], N_GROUP, LANES), dtype=np.int32)
    wall_group = np.empty((wall.shape[0], N_GROUP, LANES), dtype=np.int32)
    membership = np.empty((grain.shape[0], 2), dtype=np.int64)
    shift, images = np.empty(0, dtype=np.int8), np.empty((1, N_IMAGE))
    records = SolverContacts(
        grain, body, pair_index, pair, wall_index, wall, pair_group, wall_group, membership, shift, images
    )
    group_contacts(all_of(records), body, IJ, records)
    return records


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def apply_records(sign, grain, body, pair_index, pair, wall_index, wall):
    """`apply_impulses` for calls from Python."""
    apply_impulses(sign, grouped(grain, body, pair_index, pair, wall_index, wall))


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _visit_records(sweeps, convex, relax, compliance, grain, body, pair_index, pair, wall_index, wall):
    records, change = grouped(grain, body, pair_index, pair, wall_index, wall), 0.0
    for _ in range(sweeps):
        change = sweep(convex, relax, compliance, records)
    return change, residual(all_of(records), convex, compliance, records)


def sweep_records(convex, relax, compliance, *records):
    """`sweep` for calls from Python."""
    return _visit_records(1, convex, relax, compliance, *records)[0]


def residual_records(convex, compliance, *records):
    """`residual` for calls from Python."""
    return _visit_records(0, convex, 1.0, compliance, *records)[1]
