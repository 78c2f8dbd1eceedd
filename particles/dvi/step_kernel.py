"""The compiled step of rigid grains: drift, free velocities, contacts, impulses, drift; K steps a call.

Moreau-Jean with the middle of the step at x_m:

    x_m = x + (1 - theta) h v;    v' = v + h F/m + r/m;    x' = x_m + theta h v'.

A contact at the gap g > 0 in x_m may close within the step, not cross: u_n' >= -g/h. So it holds its impulse only if
it is reached, and the next middle is free of overlap whatever theta is (the middles are h v' apart). With restitution
e an approach faster than the threshold that would end in a contact within the step rebounds: u_n' >= -e u_n. What
overlap is left by the curvature of paths is removed from the positions alone (`project`): no velocity is touched, no
kinetic energy made; the work of the held forces on that displacement is reported. Bodies turn to the same middle as
the grains; triangles, in scenes that have them, are met there (`particles.dvi.rigid_triangles`).

**Slop.** A gap of less than ``slop`` radii counts as closed, u_n' >= 0, as an overlap of so much is let be. Were it to
be closed, to the last picometre that the tolerance of earlier steps has left, the contacts of a packing at rest would
ask for velocities that contradict each other: more contacts than degrees of freedom. Its forces would then grow from
sweep to sweep until something slips, which is what makes such iterations stall.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from particles.dvi import gauss_seidel as gs
from particles.dvi.accelerated import APGD, INTERIOR, solve
from particles.dvi.apgd import apgd
from particles.dvi.couples import begin_couples, book_couples
from particles.dvi.gauss_seidel import (
    ARM,
    BRAKE,
    EX,
    EY,
    EZ,
    IJ,
    IM,
    IWN,
    IWT,
    LOAD,
    LX,
    LY,
    MU,
    PX,
    PY,
    PZ,
    RX,
    RY,
    RZ,
    SPEED,
    VX,
    VY,
    VZ,
    B,
)  # fmt: skip
from particles.dvi.rigid_triangles import overlapping, pass_on, record, search, turn_bodies
from particles.dvi.shares import sort_walls
from particles.dvi.springs import remember, stored
from particles.kernel_stamp import kernel_stamp
from particles.walls.triangle_kernels import DISTANCE, TOWARDS_X, TOWARDS_Y, TOWARDS_Z
from particles.walls.wall_kernels import _wall_gap

# what the kernel answers
DONE, REBUILD, NOT_FINITE, OVERLAP, HAND_OVER = 0, 1, 2, 3, 4
# columns of the totals
(
    CONTACTS, IMPACT, SLIDING, CONTACT_WORK, GRAVITY_WORK, EXTERNAL_WORK, STABILISATION, MAX_OVERLAP, GRAIN, MAX_SPEED,
    SWEEPS, RESIDUAL, MISSED, KEPT, LOADED, VISITS, TAKEN_OVER, PROJECTIONS, MAX_SWEEPS, ROLLING, TWISTING,
) = range(21)  # fmt: skip
N_SUMS = 21
# columns of a body's sums: torques and forces of the normal and of the tangential impulses, and work
TORQUE_N, TORQUE_T, NORMAL_X, NORMAL_Y, NORMAL_Z, FORCE_X, FORCE_Y, FORCE_Z, BODY_WORK, DRIVE_WORK, LOAD_WORK = range(
    11
)
N_BODY_SUMS = 11
# columns of what `_book` adds up in a step
LOADED_NOW, KEPT_NOW, IMPACT_NOW, SLIDING_NOW, WORK_NOW, SPRING_N, SPRING_T = range(7)
N_BOOKED = 7
# columns of what moves a body in a step, and of its constants
PRESCRIBED, DRIVE, DRIVE_SLOPE, LOAD_TORQUE = range(4)
FREE, INERTIA = range(2)
PROJECTION_SWEEPS = 5  # a jam that needs more gets them in the next steps


@njit(error_model="numpy", fastmath={"contract"})
def free_velocities(h, gravity, external, velocity, spin, radius, mass, grain, bound):
    """Fill the records of the grains with v + h F/m; ``bound`` (n,): the larger speed of before and after."""
    fastest = 0.0
    for i in range(mass.shape[0]):
        x, y, z = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        before = x * x + y * y + z * z
        if gravity is not None:
            x, y, z = x + h * gravity[0], y + h * gravity[1], z + h * gravity[2]
        if external is not None:
            a = h / mass[i]
            x, y, z = x + a * external[i, 0], y + a * external[i, 1], z + a * external[i, 2]
        grain[i, VX], grain[i, VY], grain[i, VZ] = x, y, z
        grain[i, IM] = 1.0 / mass[i]
        r = radius[i]
        grain[i, PX], grain[i, PY], grain[i, PZ] = r * spin[i, 0], r * spin[i, 1], r * spin[i, 2]
        bound[i] = np.sqrt(max(before, x * x + y * y + z * z))
        fastest = max(fastest, bound[i])
    return fastest


@njit(error_model="numpy", fastmath={"contract"})
def find_contacts(
    lo, hi, pairs, walls, near, h, law, soft, margin, slop, grain, bound, position, velocity, radius,
    pair_start, pair_other, pair_impulse, wall, triangle, wall_body, wall_start, wall_other, wall_impulse,
    body, old_speed, pair_index, pair_slot, pair, wall_index, wall_slot, wall_row,
):  # fmt: skip
    """Fill the records of contacts, from the numbers ``pairs`` and ``walls`` on, of the rows lo <= i < hi.

    These are the slots whose gap may close within the step; ``near`` says of which pairs it is already known. Returns
    the numbers behind the last ones.
    """
    for i in range(lo, hi):
        x, y, z, ri = position[i, 0], position[i, 1], position[i, 2], radius[i]
        for k in range(pair_start[i], pair_start[i + 1]):
            j = pair_other[k]
            dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
            reach = ri + radius[j]
            d2 = dx * dx + dy * dy + dz * dz
            far = reach + h * (bound[i] + bound[j]) + margin + slop * ri  # a touch at rest is a contact
            apart = d2 >= far * far
            if near is not None:
                apart = near[k] == 0
            if apart:
                pair_impulse[k, 0] = pair_impulse[k, 1] = pair_impulse[k, 2] = 0.0
                continue
            d = np.sqrt(d2)
            inverse = 1.0 / d if d > 0.0 else 0.0
            ex, ey, ez = dx * inverse, dy * inverse, dz * inverse
            row = pair[pairs]
            row[EX], row[EY], row[EZ], row[ARM] = ex, ey, ez, d / reach
            row[RX], row[RY], row[RZ] = pair_impulse[k, 0], pair_impulse[k, 1], pair_impulse[k, 2]
            w_n = grain[i, IM] + grain[j, IM]
            row[IWN] = 1.0 / w_n
            row[IWT] = 1.0 / (w_n * (1.0 + 2.5 * row[ARM] * row[ARM]))
            row[MU] = law[0, 0]
            gap, give = d - reach, 0.0
            if soft is None:
                row[B] = gap / h if gap > slop * min(ri, radius[j]) else 0.0
            else:
                give = remember(h, soft, gs.PAIRS, gap, row, gs.N_PAIR)
            if law[0, 1] > 0.0 and give >= 0.0:
                before = (
                    (velocity[i, 0] - velocity[j, 0]) * ex
                    + (velocity[i, 1] - velocity[j, 1]) * ey
                    + (velocity[i, 2] - velocity[j, 2]) * ez
                )
                if before < -law[0, 2] and gap + h * before < 0.0:
                    row[B] = (law[0, 1] + (1.0 + law[0, 1]) * give) * before
            pair_index[pairs, 0], pair_index[pairs, 1], pair_slot[pairs] = i, j, k
            pairs += 1
        for k in range(wall_start[i], wall_start[i + 1]):
            if triangle is not None:
                if wall_other[k] >= wall.shape[0]:
                    break
            distance, nx, ny, nz, owned = _wall_gap(wall, wall_other[k], x, y, z)
            b = wall_body[wall_other[k]]
            if not owned or distance >= ri + h * 2.0 * bound[i] + margin + slop * ri:
                wall_impulse[k, 0] = wall_impulse[k, 1] = wall_impulse[k, 2] = 0.0
                continue
            row = wall_row[walls]
            row[EX], row[EY], row[EZ], row[ARM] = -nx, -ny, -nz, distance / ri
            row[RX], row[RY], row[RZ] = wall_impulse[k, 0], wall_impulse[k, 1], wall_impulse[k, 2]
            row[LX], row[LY] = -(y + distance * ny), x + distance * nx
            along = row[LX] * row[EX] + row[LY] * row[EY]
            row[IWN] = 1.0 / (grain[i, IM] + body[b, IJ] * along * along)
            row[IWT] = 1.0 / (grain[i, IM] * (1.0 + 2.5 * row[ARM] * row[ARM]))
            row[MU] = law[1, 0]
            gap, give = distance - ri, 0.0
            if soft is None:
                row[B] = gap / h if gap > slop * ri else 0.0
            else:
                give = remember(h, soft, gs.WALLS, gap, row, gs.N_WALL_CONTACT)
            if law[1, 1] > 0.0 and give >= 0.0:
                before = -(velocity[i, 0] * nx + velocity[i, 1] * ny + velocity[i, 2] * nz) - old_speed[b] * along
                if before < -law[1, 2] and gap + h * before < 0.0:
                    row[B] = (law[1, 1] + (1.0 + law[1, 1]) * give) * before
            wall_index[walls, 0], wall_index[walls, 1], wall_slot[walls] = i, b, k
            walls += 1
    return pairs, walls


@njit(error_model="numpy", fastmath={"contract"})
def _near(lo, hi, h, margin, slop, bound, position, radius, pair_start, pair_other, near):
    """Mark the pairs of rows lo <= i < hi whose gap may close within the step; returns how many."""
    count = 0
    for i in range(lo, hi):
        x, y, z, ri = position[i, 0], position[i, 1], position[i, 2], radius[i]
        for k in range(pair_start[i], pair_start[i + 1]):
            j = pair_other[k]
            dx, dy, dz = x - position[j, 0], y - position[j, 1], z - position[j, 2]
            far = ri + radius[j] + h * (bound[i] + bound[j]) + margin + slop * ri
            near[k] = 1 if dx * dx + dy * dy + dz * dz < far * far else 0
            count += near[k]
    return count


@njit(parallel=True, error_model="numpy", fastmath={"contract"})
def _find_shares(
    h, law, soft, margin, slop, grain, bound, position, velocity, radius,
    pair_start, pair_other, pair_impulse, wall, triangle, wall_body, wall_start, wall_other, wall_impulse,
    body, old_speed, turn, found, tally, pair_index, pair_slot, pair, wall_index, wall_slot, wall_row,
    rows, pairs, near, ends,
):  # fmt: skip
    """`find_contacts` and `record` by shares: pairs without gaps, walls from the first slot of each share to ``ends``.

    How many contacts the shares before it have must be known before a share can fill its records.
    """
    count = rows.shape[0] - 1
    for c in prange(count):
        pairs[c + 1] = _near(
            rows[c], rows[c + 1], h, margin, slop, bound, position, radius, pair_start, pair_other, near
        )
    for c in range(count):
        pairs[c + 1] += pairs[c]
    for c in prange(count):
        _, end = find_contacts(
            rows[c], rows[c + 1], pairs[c], wall_start[rows[c]], near,
            h, law, soft, margin, slop, grain, bound, position, velocity, radius, pair_start, pair_other, pair_impulse,
            wall, triangle, wall_body, wall_start, wall_other, wall_impulse, body, old_speed,
            pair_index, pair_slot, pair, wall_index, wall_slot, wall_row,
        )  # fmt: skip
        if triangle is not None:
            end = record(
                rows[c], rows[c + 1], h, law, soft, margin, slop, grain, bound, position, velocity, radius,
                wall.shape[0], wall_body, wall_start, wall_other, wall_impulse, body, old_speed, turn, found, tally,
                end, wall_index, wall_slot, wall_row,
            )  # fmt: skip
        ends[c] = end


@njit(parallel=True, error_model="numpy", fastmath={"contract"})
def _search_shares(
    h, law, margin, bound, position, radius, triangle, n_smooth, wall_body, wall_start, wall_other,
    body, old_speed, body_reach, turn, found, tally, rows, sums,
):  # fmt: skip
    """`search` by shares."""
    count = rows.shape[0] - 1
    for c in prange(count):
        sums[c, 0] = search(
            rows[c], rows[c + 1], h, law, margin, bound, position, radius, triangle, n_smooth,
            wall_body, wall_start, wall_other, body, old_speed, body_reach, turn, found, tally,
        )  # fmt: skip
    raised = 0.0
    for c in range(count):
        raised = max(raised, sums[c, 0])
    return raised


@njit(error_model="numpy", fastmath={"contract"})
def _book(
    h, soft, grain, velocity, spin, radius, body_speed, mean_speed, pair_index, pair_slot, pair, pair_impulse,
    wall_index, wall_slot, wall, wall_impulse, sums, body_sums,
):  # fmt: skip
    """Keep the impulses for the next step; book work and torques with the mean of old and new velocity."""
    loaded = kept = 0
    impact = sliding = work = spring_n = spring_t = 0.0
    for k in range(pair.shape[0]):
        s = pair_slot[k]
        x, y, z = pair[k, RX], pair[k, RY], pair[k, RZ]
        old = pair_impulse[s, 0] != 0.0 or pair_impulse[s, 1] != 0.0 or pair_impulse[s, 2] != 0.0
        pair_impulse[s, 0], pair_impulse[s, 1], pair_impulse[s, 2] = x, y, z
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        loaded += 1
        kept += old
        i, j = pair_index[k, 0], pair_index[k, 1]
        ex, ey, ez, arm = pair[k, EX], pair[k, EY], pair[k, EZ], pair[k, ARM]
        sx = grain[i, PX] + grain[j, PX] + radius[i] * spin[i, 0] + radius[j] * spin[j, 0]
        sy = grain[i, PY] + grain[j, PY] + radius[i] * spin[i, 1] + radius[j] * spin[j, 1]
        sz = grain[i, PZ] + grain[j, PZ] + radius[i] * spin[i, 2] + radius[j] * spin[j, 2]
        ux = grain[i, VX] - grain[j, VX] + velocity[i, 0] - velocity[j, 0] - arm * (sy * ez - sz * ey)
        uy = grain[i, VY] - grain[j, VY] + velocity[i, 1] - velocity[j, 1] - arm * (sz * ex - sx * ez)
        uz = grain[i, VZ] - grain[j, VZ] + velocity[i, 2] - velocity[j, 2] - arm * (sx * ey - sy * ex)
        if soft is not None:
            u_n = (grain[i, VX] - grain[j, VX]) * ex + (grain[i, VY] - grain[j, VY]) * ey
            u_n += (grain[i, VZ] - grain[j, VZ]) * ez
            a, b = stored(soft, gs.PAIRS, pair[k, gs.GAP] + h * u_n, x, y, z, ex, ey, ez)
            spring_n, spring_t = spring_n + a, spring_t + b
        whole = 0.5 * (x * ux + y * uy + z * uz)
        normal = 0.5 * (x * ex + y * ey + z * ez) * (ux * ex + uy * ey + uz * ez)
        impact -= normal
        sliding -= whole - normal
        work += whole
    for k in range(wall.shape[0]):
        s = wall_slot[k]
        x, y, z = wall[k, RX], wall[k, RY], wall[k, RZ]
        old = wall_impulse[s, 0] != 0.0 or wall_impulse[s, 1] != 0.0 or wall_impulse[s, 2] != 0.0
        wall_impulse[s, 0], wall_impulse[s, 1], wall_impulse[s, 2] = x, y, z
        if x == 0.0 and y == 0.0 and z == 0.0:
            continue
        loaded += 1
        kept += old
        i, b = wall_index[k, 0], wall_index[k, 1]
        ex, ey, ez, arm = wall[k, EX], wall[k, EY], wall[k, EZ], wall[k, ARM]
        sx = grain[i, PX] + radius[i] * spin[i, 0]
        sy = grain[i, PY] + radius[i] * spin[i, 1]
        sz = grain[i, PZ] + radius[i] * spin[i, 2]
        ux = 0.5 * (grain[i, VX] + velocity[i, 0] - arm * (sy * ez - sz * ey))
        uy = 0.5 * (grain[i, VY] + velocity[i, 1] - arm * (sz * ex - sx * ez))
        uz = 0.5 * (grain[i, VZ] + velocity[i, 2] - arm * (sx * ey - sy * ex))
        on_grain = x * ux + y * uy + z * uz
        r_n = x * ex + y * ey + z * ez
        lever_n = wall[k, LX] * ex + wall[k, LY] * ey
        lever = wall[k, LX] * x + wall[k, LY] * y
        omega = mean_speed[b]
        if soft is not None:
            u_n = grain[i, VX] * ex + grain[i, VY] * ey + grain[i, VZ] * ez - body_speed[b] * lever_n
            a, c = stored(soft, gs.WALLS, wall[k, gs.GAP] + h * u_n, x, y, z, ex, ey, ez)
            spring_n, spring_t = spring_n + a, spring_t + c
        normal = r_n * (ux * ex + uy * ey + uz * ez - omega * lever_n)
        impact -= normal
        sliding -= on_grain - omega * lever - normal
        work += on_grain
        body_sums[b, TORQUE_N] -= r_n * lever_n / h
        body_sums[b, TORQUE_T] -= (lever - r_n * lever_n) / h
        body_sums[b, NORMAL_X] -= r_n * ex / h
        body_sums[b, NORMAL_Y] -= r_n * ey / h
        body_sums[b, NORMAL_Z] -= r_n * ez / h
        body_sums[b, FORCE_X] -= x / h
        body_sums[b, FORCE_Y] -= y / h
        body_sums[b, FORCE_Z] -= z / h
        body_sums[b, BODY_WORK] += omega * lever
    sums[LOADED_NOW], sums[KEPT_NOW], sums[IMPACT_NOW], sums[SLIDING_NOW] = loaded, kept, impact, sliding
    sums[WORK_NOW], sums[SPRING_N], sums[SPRING_T] = work, spring_n, spring_t


@njit(error_model="numpy", fastmath={"contract"})
def _enter(soft, springs, sums, totals):
    """Add the books of a step, one row a share."""
    loaded = impact = sliding = spring_n = spring_t = 0.0
    for c in range(sums.shape[0]):
        loaded += sums[c, LOADED_NOW]
        totals[KEPT] += sums[c, KEPT_NOW]
        impact, sliding = impact + sums[c, IMPACT_NOW], sliding + sums[c, SLIDING_NOW]
        totals[CONTACT_WORK] += sums[c, WORK_NOW]
        spring_n, spring_t = spring_n + sums[c, SPRING_N], spring_t + sums[c, SPRING_T]
    totals[CONTACTS] = loaded
    totals[LOADED] += loaded
    if soft is not None:
        impact, sliding = impact - spring_n + springs[0], sliding - spring_t + springs[1]
        springs[0], springs[1] = spring_n, spring_t
    totals[IMPACT] += impact
    totals[SLIDING] += sliding


@njit(parallel=True, error_model="numpy", fastmath={"contract"})
def _book_shares(
    h, soft, grain, velocity, spin, radius, body_speed, mean_speed, pair_index, pair_slot, pair, pair_impulse,
    wall_index, wall_slot, wall, wall_impulse, pairs, walls, sums, body_sums, body_totals,
):  # fmt: skip
    """`_book` by shares."""
    count = pairs.shape[0] - 1
    for c in prange(count + 1):
        p0, p1, w0, w1 = pairs[c], pairs[min(c + 1, count)], walls[c], walls[c + 1]
        body_sums[c] = 0.0
        _book(
            h, soft, grain, velocity, spin, radius, body_speed, mean_speed,
            pair_index[p0:p1], pair_slot[p0:p1], pair[p0:p1], pair_impulse,
            wall_index[w0:w1], wall_slot[w0:w1], wall[w0:w1], wall_impulse, sums[c], body_sums[c],
        )  # fmt: skip
    for c in range(count + 1):
        for b in range(body_totals.shape[0]):
            for q in range(N_BODY_SUMS):
                body_totals[b, q] += body_sums[c, b, q]


@njit(error_model="numpy", fastmath={"contract"})
def _move(h, drift, gravity, external, grain, position, velocity, spin, radius, mass, reference, totals):
    """Take the new velocities and drift; returns the largest squared distance from the list's positions."""
    gravity_work = external_work = travel = fastest = 0.0
    for i in range(mass.shape[0]):
        x, y, z = grain[i, VX], grain[i, VY], grain[i, VZ]
        sx, sy, sz = velocity[i, 0] + x, velocity[i, 1] + y, velocity[i, 2] + z
        if gravity is not None:
            gravity_work += 0.5 * h * mass[i] * (gravity[0] * sx + gravity[1] * sy + gravity[2] * sz)
        if external is not None:
            external_work += 0.5 * h * (external[i, 0] * sx + external[i, 1] * sy + external[i, 2] * sz)
        velocity[i, 0], velocity[i, 1], velocity[i, 2] = x, y, z
        inverse = 1.0 / radius[i]
        spin[i, 0], spin[i, 1], spin[i, 2] = grain[i, PX] * inverse, grain[i, PY] * inverse, grain[i, PZ] * inverse
        position[i, 0] += drift * x
        position[i, 1] += drift * y
        position[i, 2] += drift * z
        dx, dy, dz = (
            position[i, 0] - reference[i, 0],
            position[i, 1] - reference[i, 1],
            position[i, 2] - reference[i, 2],
        )
        d2 = dx * dx + dy * dy + dz * dz + 0.0 * (spin[i, 0] + spin[i, 1] + spin[i, 2])
        if not d2 <= travel:
            travel = d2 if d2 == d2 else np.inf
        fastest = max(fastest, x * x + y * y + z * z)
    totals[GRAVITY_WORK] += gravity_work
    totals[EXTERNAL_WORK] += external_work
    totals[MAX_SPEED] = max(totals[MAX_SPEED], np.sqrt(fastest))
    return travel


@njit(error_model="numpy", fastmath={"contract"})
def project(
    slop, cap, gravity, external, position, radius, mass, pair_start, pair_other,
    wall, triangle, wall_body, wall_start, wall_other, turn, found, share=None, alone=True,
):  # fmt: skip
    """Push overlapping grains apart, positions only, by inverse masses, until none overlaps by more than slop*radius.

    Nonlinear Gauss-Seidel on the gaps; with an infinite ``slop``, that of springs, they are only looked at. Returns the
    deepest overlap met at first (share of the smaller diameter), the grain, the work of the held forces on the
    displacements [J], and the sweeps.
    """
    deepest, at, work, sweeps = 0.0, -1, 0.0, 0
    for sweep in range(cap):
        if alone is not None:
            worst, depth, where, done = _project_rows(
                0, radius.shape[0], sweep == 0, slop, gravity, external, position, radius, mass, pair_start, pair_other,
                wall, triangle, wall_body, wall_start, wall_other, turn, found,
            )  # fmt: skip
        if share is not None:
            worst, depth, where, done = _project_shares(
                sweep == 0, slop, gravity, external, position, radius, mass, pair_start, pair_other,
                wall, triangle, wall_body, wall_start, wall_other, turn, found, share.rows, share.sums,
            )  # fmt: skip
        if sweep == 0:
            deepest, at = depth, where
        work += done
        if worst <= (slop if sweep == 0 else 0.1 * slop):
            break
        sweeps += 1
    return deepest, at, work, sweeps


@njit(parallel=True, error_model="numpy", fastmath={"contract"})
def _project_shares(
    first, slop, gravity, external, position, radius, mass, pair_start, pair_other,
    wall, triangle, wall_body, wall_start, wall_other, turn, found, rows, sums,
):  # fmt: skip
    """`_project_rows` by shares."""
    count = rows.shape[0] - 1
    for odd in range(2):
        for half in prange((count + 1 - odd) // 2):
            c = 2 * half + odd
            sums[c, 0], sums[c, 1], sums[c, 2], sums[c, 3] = _project_rows(
                rows[c], rows[c + 1], first, slop, gravity, external, position, radius, mass, pair_start, pair_other,
                wall, triangle, wall_body, wall_start, wall_other, turn, found,
            )  # fmt: skip
    worst, deepest, at, work = 0.0, 0.0, -1, 0.0
    for c in range(count):
        worst = max(worst, sums[c, 0])
        if sums[c, 1] > deepest:
            deepest, at = sums[c, 1], int(sums[c, 2])
        work += sums[c, 3]
    return worst, deepest, at, work


@njit(error_model="numpy", fastmath={"contract"})
def _project_rows(
    lo, hi, first, slop, gravity, external, position, radius, mass, pair_start, pair_other,
    wall, triangle, wall_body, wall_start, wall_other, turn, found,
):  # fmt: skip
    """One sweep over the rows lo <= i < hi; returns the largest overlap as a share of the radius and, the first time,
    of the diameter, whose it is, and the work."""
    worst, deepest, at, work = 0.0, 0.0, -1, 0.0
    for i in range(lo, hi):
        for k in range(pair_start[i], pair_start[i + 1]):
            j = pair_other[k]
            dx, dy, dz = (
                position[i, 0] - position[j, 0], position[i, 1] - position[j, 1], position[i, 2] - position[j, 2],
            )  # fmt: skip
            reach = radius[i] + radius[j]
            d2 = dx * dx + dy * dy + dz * dz
            if d2 >= reach * reach:
                continue
            d = np.sqrt(d2)
            small = min(radius[i], radius[j])
            depth = (reach - d) / small
            if first and 0.5 * depth > deepest:
                deepest, at = 0.5 * depth, i
            worst = max(worst, depth)
            if first and worst <= slop:
                continue
            share = (reach - d) / (max(d, 1e-300) * (mass[i] + mass[j]))
            a, b = share * mass[j], share * mass[i]
            work += _shift(gravity, external, mass, position, i, a * dx, a * dy, a * dz)
            work += _shift(gravity, external, mass, position, j, -b * dx, -b * dy, -b * dz)
        for k in range(wall_start[i], wall_start[i + 1]):
            if triangle is not None:
                if wall_other[k] >= wall.shape[0]:
                    break
            distance, nx, ny, nz, owned = _wall_gap(wall, wall_other[k], position[i, 0], position[i, 1], position[i, 2])
            depth = 1.0 - distance / radius[i]
            if depth <= 0.0 or not owned:
                continue
            if first and 0.5 * depth > deepest:
                deepest, at = 0.5 * depth, i
            worst = max(worst, depth)
            if first and worst <= slop:
                continue
            depth *= radius[i]
            work += _shift(gravity, external, mass, position, i, -depth * nx, -depth * ny, -depth * nz)
        if triangle is not None:
            k, end = wall_start[i], wall_start[i + 1]
            while k < end and wall_other[k] < wall.shape[0]:
                k += 1
            while k < end:
                first, b = k, wall_body[wall_other[k]]
                while k < end and wall_body[wall_other[k]] == b:
                    k += 1
                x, y, z = position[i, 0], position[i, 1], position[i, 2]
                count = overlapping(triangle, wall_body, wall_other, first, k, x, y, z, radius[i], turn, found[first:k])
                for a in range(first, first + count):
                    nx, ny, nz = found[a, TOWARDS_X], found[a, TOWARDS_Y], found[a, TOWARDS_Z]
                    # what earlier pushes have already moved it away from this wall
                    gone = -(nx * (position[i, 0] - x) + ny * (position[i, 1] - y) + nz * (position[i, 2] - z))
                    depth = 1.0 - (found[a, DISTANCE] + gone) / radius[i]
                    if depth <= 0.0:
                        continue
                    if first and 0.5 * depth > deepest:
                        deepest, at = 0.5 * depth, i
                    worst = max(worst, depth)
                    if first and worst <= slop:
                        continue
                    depth *= radius[i]
                    work += _shift(gravity, external, mass, position, i, -depth * nx, -depth * ny, -depth * nz)
    return worst, deepest, at, work


@njit(error_model="numpy", fastmath={"contract"})
def _shift(gravity, external, mass, position, i, x, y, z):
    """Move grain i; returns the work of gravity and the held force on it."""
    position[i, 0] += x
    position[i, 1] += y
    position[i, 2] += z
    work = 0.0
    if gravity is not None:
        work += mass[i] * (gravity[0] * x + gravity[1] * y + gravity[2] * z)
    if external is not None:
        work += external[i, 0] * x + external[i, 1] * y + external[i, 2] * z
    return work


@njit(error_model="numpy", fastmath={"contract"})
def _begin(
    h, theta, n_sectors, law, soft, couples, gravity, external, slop, margin, drive,
    position, velocity, spin, radius, mass, pair_start, pair_other, pair_impulse,
    wall_table, triangle, wall_body, wall_start, wall_other, wall_impulse, body_reach, turn, found, tally,
    body_data, body_angle, body_speed, brake,
    grain, bound, body, pair_index, pair_slot, pair_rows, wall_index, wall_slot, wall_rows, share, alone, totals,
):  # fmt: skip
    """Stages 1 to 3: half drift, overlap, free velocities, contacts, warm start; returns the numbers of contacts."""
    if theta < 1.0:
        for i in range(mass.shape[0]):
            for c in range(3):
                position[i, c] += (1.0 - theta) * h * velocity[i, c]
    turn_bodies(h, theta, body_angle, body_speed, turn)
    deepest, at, work, count = project(
        slop if soft is None else np.inf, PROJECTION_SWEEPS, gravity, external, position, radius, mass,
        pair_start, pair_other, wall_table, triangle, wall_body, wall_start, wall_other, turn, found, share, alone,
    )  # fmt: skip
    totals[STABILISATION] += work
    totals[PROJECTIONS] += count
    if deepest > totals[MAX_OVERLAP]:
        totals[MAX_OVERLAP], totals[GRAIN] = deepest, at

    for b in range(body_speed.shape[0]):
        if body_data[b, FREE] != 0.0:
            # the slope of the drive is taken at the end of the step: it only adds to the inertia
            inertia = body_data[b, INERTIA] + h * drive[b, DRIVE_SLOPE]
            body[b, SPEED] = (body_data[b, INERTIA] * body_speed[b] + h * drive[b, DRIVE]) / inertia
            body[b, IJ] = n_sectors / inertia
            body[b, LOAD] = h * drive[b, LOAD_TORQUE] / n_sectors
        else:
            body[b, SPEED], body[b, IJ], body[b, LOAD] = drive[b, PRESCRIBED], 0.0, 0.0
        body[b, BRAKE] = min(max(brake[b], -body[b, LOAD]), body[b, LOAD])
    fastest = free_velocities(h, gravity, external, velocity, spin, radius, mass, grain, bound)
    if triangle is not None:
        if alone is not None:
            raised = search(
                0, mass.shape[0], h, law, margin * h * fastest, bound, position, radius, triangle, wall_table.shape[0],
                wall_body, wall_start, wall_other, body, body_speed, body_reach, turn, found, tally,
            )  # fmt: skip
        if share is not None:
            raised = _search_shares(
                h, law, margin * h * fastest, bound, position, radius, triangle, wall_table.shape[0],
                wall_body, wall_start, wall_other, body, body_speed, body_reach, turn, found, tally,
                share.rows, share.sums,
            )  # fmt: skip
        if raised > 0.0:
            fastest = max(fastest, raised)
            pass_on(h, bound, position, radius, pair_start, pair_other)
    if alone is not None:
        pairs, walls = find_contacts(
            0, mass.shape[0], 0, 0, None, h, law, soft, margin * h * fastest, slop, grain, bound, position, velocity,
            radius, pair_start, pair_other, pair_impulse, wall_table, triangle, wall_body, wall_start, wall_other,
            wall_impulse, body, body_speed, pair_index, pair_slot, pair_rows, wall_index, wall_slot, wall_rows,
        )  # fmt: skip
        if triangle is not None:
            walls = record(
                0, mass.shape[0], h, law, soft, margin * h * fastest, slop, grain, bound, position, velocity, radius,
                wall_table.shape[0], wall_body, wall_start, wall_other, wall_impulse, body, body_speed,
                turn, found, tally, walls, wall_index, wall_slot, wall_rows,
            )  # fmt: skip
    if share is not None:
        _find_shares(
            h, law, soft, margin * h * fastest, slop, grain, bound, position, velocity, radius, pair_start, pair_other,
            pair_impulse, wall_table, triangle, wall_body, wall_start, wall_other, wall_impulse, body, body_speed,
            turn, found, tally, pair_index, pair_slot, pair_rows, share.met_index, share.met_slot, share.met,
            share.rows, share.pairs, share.near, share.ends,
        )  # fmt: skip
        pairs = share.pairs[-1]
        walls = sort_walls(
            share.rows, share.walls, wall_start, share.ends, body, share.met_index, share.met_slot, share.met,
            wall_index, wall_slot, wall_rows,
        )  # fmt: skip
    gs.apply_impulses(1.0, grain, body, pair_index[:pairs], pair_rows[:pairs], wall_index[:walls], wall_rows[:walls])
    if couples is not None:
        begin_couples(
            couples[0], soft, radius, grain, body, pair_index[:pairs], pair_slot[:pairs], pair_rows[:pairs],
            pair_impulse, wall_index[:walls], wall_slot[:walls], wall_rows[:walls], wall_impulse, wall_table.shape[0],
            wall_other, turn, couples[1], couples[2],
        )  # fmt: skip
    return pairs, walls, fastest


@njit(error_model="numpy", fastmath={"contract"})
def _finish(
    h, theta, n_sectors, soft, couples, springs, gravity, external, tolerance, sweeps, reached, taken, fastest,
    position, velocity, spin, radius, mass, reference, pair_impulse, wall_impulse,
    drive, body_data, body_angle, body_speed, brake, mean,
    grain, body, pair_index, pair_slot, pair, wall_index, wall_slot, wall, share, alone, totals, body_totals,
):  # fmt: skip
    """Stages 5 and 6: books and drift; returns how far from its list a grain may be after the next step."""
    totals[SWEEPS] += sweeps
    totals[VISITS] += sweeps * (pair.shape[0] + wall.shape[0])
    totals[MAX_SWEEPS] = max(totals[MAX_SWEEPS], sweeps)
    totals[RESIDUAL] = max(totals[RESIDUAL], reached)
    totals[TAKEN_OVER] += taken
    if not reached <= tolerance:
        totals[MISSED] += 1.0
    for b in range(body_speed.shape[0]):
        brake[b] = body[b, BRAKE]
        mean[b] = body[b, SPEED]
        if body_data[b, FREE] != 0.0:
            mean[b] = 0.5 * (body_speed[b] + body[b, SPEED])
            torque = drive[b, DRIVE] - drive[b, DRIVE_SLOPE] * body[b, SPEED]
            body_totals[b, DRIVE_WORK] += torque * mean[b] * h
            body_totals[b, LOAD_WORK] += n_sectors * brake[b] * mean[b]
        body_speed[b] = body[b, SPEED]
        body_angle[b] += theta * h * body_speed[b]
    booked = np.zeros((1, N_BOOKED))
    if alone is not None:
        _book(
            h, soft, grain, velocity, spin, radius, body_speed, mean, pair_index, pair_slot, pair, pair_impulse,
            wall_index, wall_slot, wall, wall_impulse, booked[0], body_totals,
        )  # fmt: skip
    if share is not None:
        booked = share.sums
        _book_shares(
            h, soft, grain, velocity, spin, radius, body_speed, mean, pair_index, pair_slot, pair, pair_impulse,
            wall_index, wall_slot, wall, wall_impulse, share.pairs, share.walls, booked, share.body_sums, body_totals,
        )  # fmt: skip
    _enter(soft, springs, booked, totals)
    if couples is not None:
        rolling, twisting, work = book_couples(
            h, soft, springs, grain, spin, radius, mean, pair_index, pair_slot, pair, pair_impulse, couples[1],
            wall_index, wall_slot, wall, wall_impulse, couples[2], body_totals, TORQUE_T, BODY_WORK,
        )  # fmt: skip
        totals[ROLLING] += rolling
        totals[TWISTING] += twisting
        totals[CONTACT_WORK] += work
    travel = _move(h, theta * h, gravity, external, grain, position, velocity, spin, radius, mass, reference, totals)
    return np.sqrt(travel) + h * fastest


def _made(stamp: int):
    """The kernel; ``stamp`` stands in its cache key (`particles.kernel_stamp`)."""

    @njit(cache=True, error_model="numpy", fastmath={"contract"})
    def run_steps(
        n_steps, h, theta, n_sectors, law, soft, couples, springs, gravity, external, travel_limit, wall_limit,
        overlap_limit, slop, margin,
        convex, relax, method, tolerance, cap, open_step,
        position, velocity, spin, radius, mass, reference,
        pair_start, pair_other, pair_impulse, wall_table, triangle, wall_body, wall_start, wall_other, wall_impulse,
        body_reach, list_angle, turn, found, tally, drives, body_data, body_angle, body_speed, brake,
        grain, bound, body, pair_index, pair_slot, pair_rows, wall_index, wall_slot, wall_rows,
        share, alone, totals, body_totals,
    ):  # fmt: skip
        """Up to ``n_steps`` steps; stops early when the list must be rebuilt or a grain is in trouble.

        With ``method`` INTERIOR a step on which the sweeps stall is left open (HAND_OVER): ``open_step`` then holds the
        numbers of pairs and walls, sweeps, residual and largest speed, and the next call finishes it; its last two
        entries are the numbers of contacts of the last step in any case. Returns (answer, steps done); every array is
        documented where it is made, in `particles.dvi.dvi`.
        """
        if stamp == 0:
            return DONE, 0
        mean = np.empty(body_speed.shape[0])
        for step in range(n_steps):
            if gravity is None:
                pull = None
            else:
                pull = gravity[min(step, gravity.shape[0] - 1)]
            if open_step[0] >= 0.0:
                pairs, walls, sweeps = int(open_step[0]), int(open_step[1]), int(open_step[2])
                reached, fastest, taken = open_step[3], open_step[4], 1
                open_step[0] = -1.0
            else:
                # 1-3. half drift, free velocities, contacts, warm start
                pairs, walls, fastest = _begin(
                    h, theta, n_sectors, law, soft, couples, pull, external, slop, margin, drives[step],
                    position, velocity, spin, radius, mass, pair_start, pair_other, pair_impulse,
                    wall_table, triangle, wall_body, wall_start, wall_other, wall_impulse, body_reach, turn, found,
                    tally, body_data, body_angle, body_speed, brake,
                    grain, bound, body, pair_index, pair_slot, pair_rows, wall_index, wall_slot, wall_rows,
                    share, alone, totals,
                )  # fmt: skip
                open_step[5], open_step[6] = pairs, walls
                if totals[MAX_OVERLAP] > overlap_limit:
                    return OVERLAP, step
                # 4. impulses
                taken = 0
                if convex is None:
                    sweeps, reached, taken = solve(
                        convex, relax, soft, method, tolerance, cap, grain, body, pair_index[:pairs], pair_rows[:pairs],
                        wall_index[:walls], wall_rows[:walls], couples, share, alone,
                    )  # fmt: skip
                elif method == APGD:
                    sweeps, reached = apgd(
                        tolerance, cap, grain, body, pair_index[:pairs], pair_rows[:pairs],
                        wall_index[:walls], wall_rows[:walls],
                    )  # fmt: skip
                else:
                    sweeps, reached, taken = solve(
                        convex, relax, soft, method, tolerance, cap, grain, body, pair_index[:pairs], pair_rows[:pairs],
                        wall_index[:walls], wall_rows[:walls], couples, share, alone,
                    )  # fmt: skip
                if method == INTERIOR and reached > tolerance:
                    open_step[0], open_step[1], open_step[2] = pairs, walls, sweeps
                    open_step[3], open_step[4] = reached, fastest
                    return HAND_OVER, step
            # 5-6. books, half drift
            travel = _finish(
                h, theta, n_sectors, soft, couples, springs, pull, external, tolerance, sweeps, reached, taken, fastest,
                position, velocity, spin, radius, mass, reference, pair_impulse, wall_impulse,
                drives[step], body_data, body_angle, body_speed, brake, mean, grain, body,
                pair_index, pair_slot, pair_rows[:pairs], wall_index, wall_slot, wall_rows[:walls],
                share, alone, totals, body_totals,
            )  # fmt: skip
            if not travel < np.inf:
                return NOT_FINITE, step + 1
            if travel > travel_limit:
                return REBUILD, step + 1
            if triangle is not None:
                for b in range(body_speed.shape[0]):
                    way = abs(body_angle[b] - list_angle[b]) + h * abs(body_speed[b])
                    if way * body_reach[b] > wall_limit:
                        return REBUILD, step + 1
        return DONE, n_steps

    return run_steps


run_steps = _made(kernel_stamp())
