"""Nonlinear Gauss-Seidel over the graph of contacts, and the honest residual.

Unknown are the velocities v = v_free + M^-1 H r after the step and one impulse r a contact, in world axes, that acts
on the first grain; e is the unit vector from the partner (or wall) to the first grain, u the velocity of the first
relative to the second at the contact. A sweep visits contact by contact, solves its local problem for the velocities
of now (`particles.dvi.local_problem`) and passes the change of its impulse on to the two bodies at once (Jean, Comput.
Methods Appl. Mech. Engrg. 177 (1999) 235).

**Scaled spins.** With p = R omega a solid sphere (J = 2/5 m R^2) that takes the impulse r at the lever arm a R obeys

    dv = r/m,   dp = -(5/2) a (e x r)/m    and    u = v_i - v_j - a (p_i + p_j) x e,

so that its radius is needed nowhere, and its record is one cache line. The arms R_i a and R_j a add up to the
distance of the centres (a = 1 where they touch): angular momentum is conserved to round-off.

**Order.** Rows of the neighbour list in the order of memory, or in chunks of them (`particles.dvi.partition`). It
follows from the list alone.

A contact that is open and stays open is left after five multiplications.

**Springs.** With ``compliance`` every contact gives way like the springs of `LinearContact`, taken at the end of the
step (`particles.dvi.compliance`): instead of u the laws hold for u + o + C r, with C = diag(c_n, c_t, c_t), and
an offset o that holds the springs of now. 1/w_n and 1/w_t then hold c as well. None: rigid.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from geometry.inner_functions import inner
from particles.dvi.kernel_state import Records, whole
from particles.dvi.local_problem import coulomb_block, natural_map

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
N_WALL_CONTACT = 14
N_SPRING = 4  # behind these, with springs: the tangential offset in world axes, and c_n
# rows of ``compliance``: between grains, at walls; columns: k_n [N/m], c_t [1/kg], and what K follows from
# (`particles.dvi.compliance`): the largest sqrt(a) at which the restitution is met, 2 zeta, log K against sqrt(a)
PAIRS, WALLS = 0, 1
STIFFNESS, TANGENTIAL, MET, DASHPOT, SHARES = range(5)


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def apply_impulses(sign, records):
    """Add to the velocities ``sign`` times what the impulses in the records do."""
    grain, body, pair_index, pair, wall_index, wall = records
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
        grain[j, VX] -= b * x
        grain[j, VY] -= b * y
        grain[j, VZ] -= b * z
        grain[i, PX] += a * sx
        grain[i, PY] += a * sy
        grain[i, PZ] += a * sz
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


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def sweep_pairs(lo, hi, convex, relax, compliance, records):
    """Visit the pairs lo <= k < hi; returns the largest change of an impulse times w_n, squared [m^2/s^2].

    ``convex`` None: exact Coulomb, over-relaxed by ``relax`` (1: not), which the convex law does not read.
    """
    grain, index, pair = records.grain, records.pair_index, records.pair
    largest = 0.0
    for k in range(lo, hi):
        i, j = index[k, 0], index[k, 1]
        ex, ey, ez = pair[k, EX], pair[k, EY], pair[k, EZ]
        rx, ry, rz = pair[k, RX], pair[k, RY], pair[k, RZ]
        ux, uy, uz = grain[i, VX] - grain[j, VX], grain[i, VY] - grain[j, VY], grain[i, VZ] - grain[j, VZ]
        v_n = ux * ex + uy * ey + uz * ez
        was = rx * ex + ry * ey + rz * ez
        inverse = pair[k, IWN]
        if convex is None:
            inverse *= relax
        u_n = v_n + pair[k, B]
        if compliance is not None:
            u_n += pair[k, N_PAIR + 3] * was
        r_n = was - u_n * inverse
        if convex is None:
            if r_n <= 0.0 and rx == 0.0 and ry == 0.0 and rz == 0.0:
                continue
        arm = pair[k, ARM]
        sx, sy, sz = grain[i, PX] + grain[j, PX], grain[i, PY] + grain[j, PY], grain[i, PZ] + grain[j, PZ]
        ux = ux - v_n * ex - arm * (sy * ez - sz * ey)
        uy = uy - v_n * ey - arm * (sz * ex - sx * ez)
        uz = uz - v_n * ez - arm * (sx * ey - sy * ex)
        if compliance is not None:
            c = compliance[PAIRS, TANGENTIAL]
            ux += pair[k, N_PAIR] + c * (rx - was * ex)
            uy += pair[k, N_PAIR + 1] + c * (ry - was * ey)
            uz += pair[k, N_PAIR + 2] + c * (rz - was * ez)
        slow, mu = pair[k, IWT], pair[k, MU]
        if convex is None:
            slow *= relax
        if convex is not None:
            # open, and further than sliding lifts it
            if u_n >= mu * np.sqrt(ux * ux + uy * uy + uz * uz) and rx == 0.0 and ry == 0.0 and rz == 0.0:
                continue
        tx, ty, tz = rx - was * ex - slow * ux, ry - was * ey - slow * uy, rz - was * ez - slow * uz
        size2 = tx * tx + ty * ty + tz * tz
        if convex is None:
            if r_n <= 0.0:
                r_n, tx, ty, tz = 0.0, 0.0, 0.0, 0.0
            else:
                limit = mu * r_n
                if size2 > limit * limit:
                    scale = limit / np.sqrt(size2)
                    tx, ty, tz = scale * tx, scale * ty, scale * tz
        else:
            size = np.sqrt(size2)
            if size > mu * r_n:
                weight = inverse / slow  # the nearest point of the cone in the metric of W
                r_n = max((r_n + weight * mu * size) / (1.0 + weight * mu * mu), 0.0)
                scale = mu * r_n / size if size > 0.0 else 0.0
                tx, ty, tz = scale * tx, scale * ty, scale * tz
        x, y, z = r_n * ex + tx - rx, r_n * ey + ty - ry, r_n * ez + tz - rz
        change = (x * x + y * y + z * z) / (inverse * inverse)
        largest = max(largest, change)
        pair[k, RX], pair[k, RY], pair[k, RZ] = rx + x, ry + y, rz + z
        a, b = grain[i, IM], grain[j, IM]
        grain[i, VX] += a * x
        grain[i, VY] += a * y
        grain[i, VZ] += a * z
        grain[j, VX] -= b * x
        grain[j, VY] -= b * y
        grain[j, VZ] -= b * z
        arm *= -2.5
        sx, sy, sz = arm * (ey * z - ez * y), arm * (ez * x - ex * z), arm * (ex * y - ey * x)
        grain[i, PX] += a * sx
        grain[i, PY] += a * sy
        grain[i, PZ] += a * sz
        grain[j, PX] += b * sx
        grain[j, PY] += b * sy
        grain[j, PZ] += b * sz
    return largest


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def sweep_walls(lo, hi, convex, relax, compliance, records):
    """The same for contacts with walls."""
    grain, body, index, wall = records.grain, records.body, records.wall_index, records.wall
    largest = 0.0
    for k in range(lo, hi):
        i, b = index[k, 0], index[k, 1]
        ex, ey, ez = wall[k, EX], wall[k, EY], wall[k, EZ]
        rx, ry, rz = wall[k, RX], wall[k, RY], wall[k, RZ]
        omega = body[b, SPEED]
        ux, uy, uz = grain[i, VX] - omega * wall[k, LX], grain[i, VY] - omega * wall[k, LY], grain[i, VZ]
        v_n = ux * ex + uy * ey + uz * ez
        was = rx * ex + ry * ey + rz * ez
        inverse, mu = wall[k, IWN], wall[k, MU]
        if convex is None:
            inverse *= relax
        u_n = v_n + wall[k, B]
        if compliance is not None:
            u_n += wall[k, N_WALL_CONTACT + 3] * was
        r_n = was - u_n * inverse
        free = body[b, IJ]
        if convex is None:
            if r_n <= 0.0 and rx == 0.0 and ry == 0.0 and rz == 0.0:
                continue
        arm = wall[k, ARM]
        ux = ux - v_n * ex - arm * (grain[i, PY] * ez - grain[i, PZ] * ey)
        uy = uy - v_n * ey - arm * (grain[i, PZ] * ex - grain[i, PX] * ez)
        uz = uz - v_n * ez - arm * (grain[i, PX] * ey - grain[i, PY] * ex)
        if compliance is not None:
            c = compliance[WALLS, TANGENTIAL]
            ux += wall[k, N_WALL_CONTACT] + c * (rx - was * ex)
            uy += wall[k, N_WALL_CONTACT + 1] + c * (ry - was * ey)
            uz += wall[k, N_WALL_CONTACT + 2] + c * (rz - was * ez)
        slow = wall[k, IWT]
        if convex is None:
            slow *= relax
        if convex is None and free > 0.0:
            x, y, z = _block(wall, k, free, mu, u_n, ux, uy, uz, was)
            x, y, z = x - rx, y - ry, z - rz
        else:
            if convex is not None and free > 0.0:  # a gradient step, short enough for every direction of the block
                slow = 1.0 / (1.0 / slow + free * (wall[k, LX] ** 2 + wall[k, LY] ** 2))
                r_n = was - u_n * slow
                inverse = slow
            tx, ty, tz = rx - was * ex - slow * ux, ry - was * ey - slow * uy, rz - was * ez - slow * uz
            size = np.sqrt(tx * tx + ty * ty + tz * tz)
            if convex is None:
                r_n = max(r_n, 0.0)
            elif size > mu * r_n:
                weight = inverse / slow
                r_n = max((r_n + weight * mu * size) / (1.0 + weight * mu * mu), 0.0)
            if size > mu * r_n:
                scale = mu * r_n / size
                tx, ty, tz = scale * tx, scale * ty, scale * tz
            x, y, z = r_n * ex + tx - rx, r_n * ey + ty - ry, r_n * ez + tz - rz
        largest = max(largest, (x * x + y * y + z * z) / (wall[k, IWN] * wall[k, IWN]))
        wall[k, RX], wall[k, RY], wall[k, RZ] = rx + x, ry + y, rz + z
        a = grain[i, IM]
        grain[i, VX] += a * x
        grain[i, VY] += a * y
        grain[i, VZ] += a * z
        arm *= -2.5 * a
        grain[i, PX] += arm * (ey * z - ez * y)
        grain[i, PY] += arm * (ez * x - ex * z)
        grain[i, PZ] += arm * (ex * y - ey * x)
        if free > 0.0:  # several threads share a body of prescribed speed
            body[b, SPEED] -= free * (wall[k, LX] * x + wall[k, LY] * y)
    return largest


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
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


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
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


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
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


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def sweep(convex, relax, compliance, records):
    """One sweep over everything; returns the largest change [m/s]."""
    first = np.int64(0)  # a plain 0 is a type of its own
    b = sweep_pairs(first, records.pair.shape[0], convex, relax, compliance, records)
    a = sweep_walls(first, records.wall.shape[0], convex, relax, compliance, records)
    sweep_loads(records.body)
    return np.sqrt(max(a, b))


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def residual(part, convex, compliance, records):
    """Largest natural map over the contacts of a part [m/s], all at the same velocities."""
    grain, body, pair_index, pair, wall_index, wall = records
    law = convex is not None
    worst = 0.0
    for k in range(part.p0, part.p1):
        i, j = pair_index[k, 0], pair_index[k, 1]
        ex, ey, ez = pair[k, EX], pair[k, EY], pair[k, EZ]
        ux, uy, uz = grain[i, VX] - grain[j, VX], grain[i, VY] - grain[j, VY], grain[i, VZ] - grain[j, VZ]
        u_n = ux * ex + uy * ey + uz * ez
        if u_n + pair[k, B] >= 0.0 and pair[k, RX] == 0.0 and pair[k, RY] == 0.0 and pair[k, RZ] == 0.0 and not law:
            continue
        arm = pair[k, ARM]
        sx, sy, sz = grain[i, PX] + grain[j, PX], grain[i, PY] + grain[j, PY], grain[i, PZ] + grain[j, PZ]
        ux = ux - u_n * ex - arm * (sy * ez - sz * ey)
        uy = uy - u_n * ey - arm * (sz * ex - sx * ez)
        uz = uz - u_n * ez - arm * (sx * ey - sy * ex)
        worst = max(worst, _map(law, compliance, PAIRS, N_PAIR, pair, k, u_n, ux, uy, uz))
    for k in range(part.w0, part.w1):
        i, b = wall_index[k, 0], wall_index[k, 1]
        ex, ey, ez = wall[k, EX], wall[k, EY], wall[k, EZ]
        omega, arm = body[b, SPEED], wall[k, ARM]
        ux, uy, uz = grain[i, VX] - omega * wall[k, LX], grain[i, VY] - omega * wall[k, LY], grain[i, VZ]
        u_n = ux * ex + uy * ey + uz * ez
        ux = ux - u_n * ex - arm * (grain[i, PY] * ez - grain[i, PZ] * ey)
        uy = uy - u_n * ey - arm * (grain[i, PZ] * ex - grain[i, PX] * ez)
        uz = uz - u_n * ez - arm * (grain[i, PX] * ey - grain[i, PY] * ex)
        worst = max(worst, _map(law, compliance, WALLS, N_WALL_CONTACT, wall, k, u_n, ux, uy, uz))
    return worst


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def _map(law, compliance, kind, offset, row, k, u_n, ux, uy, uz):
    """Natural map of contact k from its velocity, tangential part in world axes."""
    ex, ey, ez = row[k, EX], row[k, EY], row[k, EZ]
    r_n = row[k, RX] * ex + row[k, RY] * ey + row[k, RZ] * ez
    tx, ty, tz = row[k, RX] - r_n * ex, row[k, RY] - r_n * ey, row[k, RZ] - r_n * ez
    if compliance is not None:
        u_n += row[k, offset + 3] * r_n
        c = compliance[kind, TANGENTIAL]
        ux += row[k, offset] + c * tx
        uy += row[k, offset + 1] + c * ty
        uz += row[k, offset + 2] + c * tz
    # two coordinates span the tangent plane: along t (along u without t), and what is left of u across it
    size = np.sqrt(tx * tx + ty * ty + tz * tz)
    if size > 0.0:
        a = (ux * tx + uy * ty + uz * tz) / size
        x, y, z = ux - a * tx / size, uy - a * ty / size, uz - a * tz / size
        b = np.sqrt(x * x + y * y + z * z)
    else:
        a, b = np.sqrt(ux * ux + uy * uy + uz * uz), 0.0
    return natural_map(law, 1.0 / row[k, IWN], row[k, MU], r_n, size, 0.0, u_n + row[k, B], a, b)


# The same for calls from Python: these have a cache, and no kernel calls them
@njit(cache=True, error_model="numpy", fastmath={"contract"})
def apply_records(sign, grain, body, pair_index, pair, wall_index, wall):
    """`apply_impulses` for calls from Python."""
    apply_impulses(sign, Records(grain, body, pair_index, pair, wall_index, wall))


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def sweep_records(convex, relax, compliance, grain, body, pair_index, pair, wall_index, wall):
    """`sweep` for calls from Python."""
    return sweep(convex, relax, compliance, Records(grain, body, pair_index, pair, wall_index, wall))


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def residual_records(convex, compliance, grain, body, pair_index, pair, wall_index, wall):
    """`residual` for calls from Python."""
    records = Records(grain, body, pair_index, pair, wall_index, wall)
    return residual(whole(records), convex, compliance, records)
