"""The compiled step of rigid grains: drift, free velocities, contacts, impulses, drift; K steps a call.

Moreau-Jean with the middle of the step at x_m:

    x_m = x + (1 - theta) h v;    v' = v + h F/m + r/m;    x' = x_m + theta h v'.

A contact at the gap g > 0 in x_m may close within the step, not cross: u_n' >= -g/h. So it holds its impulse only if
it is reached, and the next middle is free of overlap whatever theta is (the middles are h v' apart). With restitution
e an approach faster than the threshold that would end in a contact within the step rebounds: u_n' >= -e u_n. What
overlap is left by the curvature of paths is removed from the positions alone (`particles.dvi.projection`): no velocity
is touched, no kinetic energy made; the work of the held forces on that displacement is reported. Bodies turn to the
same middle as the grains; triangles, in scenes that have them, are met there (`particles.dvi.rigid_triangles`).

**Slop.** A gap of less than ``slop`` radii counts as closed, u_n' >= 0, as an overlap of so much is let be. Were it to
be closed, to the last picometre that the tolerance of earlier steps has left, the contacts of a packing at rest would
ask for velocities that contradict each other: more contacts than degrees of freedom. Its forces would then grow from
sweep to sweep until something slips, which is what makes such iterations stall.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from geometry.inner_functions import inner
from particles.dvi import gauss_seidel as gs
from particles.dvi.accelerated import APGD, INTERIOR, solve
from particles.dvi.apgd import apgd
from particles.dvi.contact_search import find_contacts, find_in_shares, free_velocities, search_in_shares
from particles.dvi.couples import begin_couples, book_couples
from particles.dvi.gauss_seidel import (
    BRAKE,
    IJ,
    LOAD,
    SPEED,
)  # fmt: skip
from particles.dvi.projection import project
from particles.dvi.rigid_triangles import pass_on, record, search, turn_bodies
from particles.dvi.shares import sort_walls
from particles.dvi.step_books import (
    BODY_WORK,
    CONTACT_WORK,
    DRIVE_WORK,
    GRAIN,
    LOAD_WORK,
    MAX_OVERLAP,
    MAX_SWEEPS,
    MISSED,
    N_BOOKED,
    PROJECTIONS,
    RESIDUAL,
    ROLLING,
    STABILISATION,
    SWEEPS,
    TAKEN_OVER,
    TORQUE_T,
    TWISTING,
    VISITS,
    book,
    book_shares,
    enter,
    move,
)

# what the kernel answers
DONE, REBUILD, NOT_FINITE, OVERLAP, HAND_OVER = 0, 1, 2, 3, 4
# columns of what moves a body in a step, and of its constants
PRESCRIBED, DRIVE, DRIVE_SLOPE, LOAD_TORQUE = range(4)
FREE, INERTIA = range(2)
PROJECTION_SWEEPS = 5  # a jam that needs more gets them in the next steps


@inner(error_model="numpy", fastmath={"contract"})
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
    if triangle.shape[0] > 0:
        if alone is not None:
            raised = search(
                0, mass.shape[0], h, law, margin * h * fastest, bound, position, radius, triangle, wall_table.shape[0],
                wall_body, wall_start, wall_other, body, body_speed, body_reach, turn, found, tally,
            )  # fmt: skip
        if share is not None:
            raised = search_in_shares(
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
        if triangle.shape[0] > 0:
            walls = record(
                0, mass.shape[0], h, law, soft, margin * h * fastest, slop, grain, bound, position, velocity, radius,
                wall_table.shape[0], wall_body, wall_start, wall_other, wall_impulse, body, body_speed,
                turn, found, tally, walls, wall_index, wall_slot, wall_rows,
            )  # fmt: skip
    if share is not None:
        find_in_shares(
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
    if couples[0].shape[0] > 0:
        begin_couples(
            couples[0], soft, radius, grain, body, pair_index[:pairs], pair_slot[:pairs], pair_rows[:pairs],
            pair_impulse, wall_index[:walls], wall_slot[:walls], wall_rows[:walls], wall_impulse, wall_table.shape[0],
            wall_other, turn, couples[1], couples[2],
        )  # fmt: skip
    return pairs, walls, fastest


@inner(error_model="numpy", fastmath={"contract"})
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
        book(
            h, soft, grain, velocity, spin, radius, body_speed, mean, pair_index, pair_slot, pair, pair_impulse,
            wall_index, wall_slot, wall, wall_impulse, booked[0], body_totals,
        )  # fmt: skip
    if share is not None:
        booked = share.sums
        book_shares(
            h, soft, grain, velocity, spin, radius, body_speed, mean, pair_index, pair_slot, pair, pair_impulse,
            wall_index, wall_slot, wall, wall_impulse, share.pairs, share.walls, booked, share.body_sums, body_totals,
        )  # fmt: skip
    enter(soft, springs, booked, totals)
    if couples[0].shape[0] > 0:
        rolling, twisting, work = book_couples(
            h, soft, springs, grain, spin, radius, mean, pair_index, pair_slot, pair, pair_impulse, couples[1],
            wall_index, wall_slot, wall, wall_impulse, couples[2], body_totals, TORQUE_T, BODY_WORK,
        )  # fmt: skip
        totals[ROLLING] += rolling
        totals[TWISTING] += twisting
        totals[CONTACT_WORK] += work
    travel = move(h, theta * h, gravity, external, grain, position, velocity, spin, radius, mass, reference, totals)
    return np.sqrt(travel) + h * fastest


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
    mean, weightless = np.empty(body_speed.shape[0]), np.empty(0)
    for step in range(n_steps):
        pull = weightless
        if gravity.shape[0] > 0:
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
        if triangle.shape[0] > 0:
            for b in range(body_speed.shape[0]):
                way = abs(body_angle[b] - list_angle[b]) + h * abs(body_speed[b])
                if way * body_reach[b] > wall_limit:
                    return REBUILD, step + 1
    return DONE, n_steps
