"""The compiled step of the grains: contact forces, kick, drift, shafts; K steps a call.

Leapfrog, kick-drift, with velocities half a step behind positions:

    F = F(x(t), v(t - dt/2));   v(t + dt/2) = v(t - dt/2) + F dt/m;   x(t + dt) = x(t) + v(t + dt/2) dt,

and the same for spins (2/5 m R^2). A step has two parallel stages over chunks of rows whose number follows from the
number of grains alone (`particles.dem.row_kernel`); sums over grains are kept by chunk and added in the order of the
chunks. So nothing depends on the number of threads, bit for bit.

What would cost in the loop over pairs and is not in the scene (``turn``, ``resisting``, ``ledger``, ``equal``,
``attraction``, the laws but one) is passed as None: numba prunes its branches, the compiled code does not contain it.
What is done once a grain or once a contact (gravity, held forces, triangles, species, cohesion, which of rolling and
twisting) is a branch at run time, on an empty array or a flag: every combination compiled would be 5 632 variants of
ten seconds and more. Rolling and twisting as such a branch too made steps slower, and stayed compiled out.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from geometry.inner_functions import inner
from particles.dem.row_kernel import finish_rows, sweep_rows
from particles.dem.sums import (
    BODY_WORK,
    CONTACT_LATER,
    CONTACT_WORK,
    CONTACTS,
    DONE,
    DRIVE,
    DRIVE_SLOPE,
    DRIVE_WORK,
    ELASTIC,
    FREE,
    GRAIN,
    INERTIA,
    KINETIC,
    LAST_TORQUE,
    LOAD,
    LOAD_WORK,
    MAX_OVERLAP,
    MAX_SPEED,
    MAX_TRAVEL,
    N_CHUNK_BODY,
    NORMAL_DAMPING,
    NOT_FINITE,
    OVERLAP,
    REBUILD,
    SHAFT_CONTACT_WORK,
    SPEED,
    TOO_FAST,
    TORQUE_T,
)  # fmt: skip


@inner(error_model="numpy", fastmath={"contract"})
def _turn_bodies(dt, n_sectors, drives, step, body_data, body_angle, body_speed, body_chunks, body_totals):
    """Add the chunks in their order, turn the shafts (`particles.bodies`)."""
    for b in range(body_speed.shape[0]):
        torque = 0.0
        for column in range(N_CHUNK_BODY):
            total = 0.0
            for c in range(body_chunks.shape[0]):
                total += body_chunks[c, b, column]
            body_totals[b, column] += total
            if column <= TORQUE_T:
                torque += total
        mean = before = body_speed[b]
        if body_data[b, FREE] != 0.0:
            old = body_speed[b]
            per = dt / body_data[b, INERTIA]
            # the drive falls with speed: taken at the mean of old and new
            slope = 0.5 * per * drives[step, b, DRIVE_SLOPE]
            new = (old * (1.0 - slope) + per * (n_sectors * torque + drives[step, b, DRIVE])) / (1.0 + slope)
            held = per / (1.0 + slope) * drives[step, b, LOAD]
            # dry friction: shrink the speed, never reverse it
            brake = min(max(new, -held), held)
            new -= brake
            mean = 0.5 * (old + new)
            drive = drives[step, b, DRIVE] - drives[step, b, DRIVE_SLOPE] * mean
            body_totals[b, DRIVE_WORK] += drive * mean * dt
            body_totals[b, SHAFT_CONTACT_WORK] += n_sectors * torque * mean * dt
            body_totals[b, LOAD_WORK] += brake * (1.0 + slope) / per * mean * dt
            body_speed[b] = new
        # by drifts, as the works on the grains: the mean of the last and this torque, at the speed between them
        body_totals[b, BODY_WORK] -= 0.5 * (body_totals[b, LAST_TORQUE] + torque) * before * dt
        body_totals[b, LAST_TORQUE] = torque
        body_angle[b] += body_speed[b] * dt


@inner(error_model="numpy", fastmath={"contract"})
def _verdict(chunk_sums, totals, travel_limit, wall_travel, wall_limit, overlap_limit, speed_limit):
    """Add the chunks in their order: energies accumulate, extremes are kept, contacts are the last."""
    contacts = elastic = travel = fastest = 0.0
    for c in range(chunk_sums.shape[0]):
        row = chunk_sums[c]
        contacts += row[CONTACTS]
        elastic += row[ELASTIC]
        for column in range(NORMAL_DAMPING, MAX_OVERLAP):
            totals[column] += row[column]
        if row[MAX_OVERLAP] > totals[MAX_OVERLAP]:
            totals[MAX_OVERLAP], totals[GRAIN] = row[MAX_OVERLAP], row[GRAIN]
        travel, fastest = max(travel, row[MAX_TRAVEL]), max(fastest, row[MAX_SPEED])
    for kind in range(KINETIC - CONTACT_WORK):
        # works of the drift that has just ended: the later half of the last kick and the earlier half of this one
        totals[CONTACT_WORK + kind] += totals[CONTACT_LATER + kind]
        totals[CONTACT_LATER + kind] = 0.0
        for c in range(chunk_sums.shape[0]):
            totals[CONTACT_WORK + kind] += chunk_sums[c, CONTACT_WORK + kind]
            totals[CONTACT_LATER + kind] += chunk_sums[c, CONTACT_LATER + kind]
    totals[KINETIC] = 0.0
    for c in range(chunk_sums.shape[0]):
        totals[KINETIC] += chunk_sums[c, KINETIC]
    totals[CONTACTS], totals[ELASTIC] = contacts, elastic
    totals[MAX_TRAVEL], totals[MAX_SPEED] = travel, max(totals[MAX_SPEED], fastest)
    if not travel < np.inf:
        return NOT_FINITE
    if totals[MAX_OVERLAP] > overlap_limit:
        return OVERLAP
    if fastest > speed_limit * speed_limit:
        return TOO_FAST
    return REBUILD if travel > travel_limit or wall_travel > wall_limit else DONE


@njit(parallel=True, cache=True, error_model="numpy", fastmath={"contract"})
def run_steps(
    n_steps, dt, n_sectors, last_call, travel_limit, wall_limit, overlap_limit, speed_limit,
    linear, hertz_mindlin, hertz, thesis, walton_braun, law, pair_row, wall_row, species, equal, columns,
    cohesive, resisting, ledger, turn, gravity, external, attraction,
    where, motion, mass, reference, net, late,
    pair_start, pair_other, pair_shift, pair_touching, pair_history, pair_record,
    chunk, cross_start, cross, late_start, late_grain, in_start, in_slot,
    wall, triangle, wall_body, body_reach, body_start_angle,
    wall_start, wall_other, wall_touching, wall_history, wall_record, scratch,
    drives, body_data, body_angle, body_speed, body_turn, chunk_sums, body_chunks, totals, body_totals,
):  # fmt: skip
    """Up to ``n_steps`` steps; stops early when a list must be rebuilt or a grain is in trouble.

    Returns (answer, steps done); every array is documented where it is made, in `particles.dem.dem`.
    """
    n_chunks = chunk.shape[0] - 1
    for step in range(n_steps):
        last = last_call and step == n_steps - 1
        for b in range(body_speed.shape[0]):
            if body_data[b, FREE] == 0.0:
                body_speed[b] = drives[step, b, SPEED]
            if triangle.shape[0] > 0:
                body_turn[b, 0], body_turn[b, 1] = np.cos(body_angle[b]), np.sin(body_angle[b])
        for c in prange(n_chunks):
            sweep_rows(  # int64: numba's own index is unsigned, and everything would be compiled for both
                np.int64(c), chunk[c], chunk[c + 1], dt, step, last,
                linear, hertz_mindlin, hertz, thesis, walton_braun, law, pair_row, wall_row, species, equal,
                columns, cohesive, resisting, ledger, turn, gravity, external, attraction,
                where, motion, mass, reference, net, late,
                pair_start, pair_other, pair_shift, pair_touching, pair_history, pair_record, cross_start, cross,
                wall, triangle, wall_body, body_speed, body_turn,
                wall_start, wall_other, wall_touching, wall_history, wall_record, scratch,
                chunk_sums, body_chunks,
            )  # fmt: skip
        if late_grain.shape[0] > 0:
            for c in prange(n_chunks):
                finish_rows(
                    np.int64(c), dt, step, last, equal, ledger, gravity, external, attraction, where, motion, mass,
                    reference, net, late_start, late_grain, in_start, in_slot, cross, chunk_sums,
                )  # fmt: skip
        _turn_bodies(dt, n_sectors, drives, step, body_data, body_angle, body_speed, body_chunks, body_totals)
        wall_travel = 0.0
        for b in range(body_speed.shape[0]):
            wall_travel = max(wall_travel, abs(body_angle[b] - body_start_angle[b]) * body_reach[b])
        answer = _verdict(chunk_sums, totals, travel_limit, wall_travel, wall_limit, overlap_limit, speed_limit)
        if answer != DONE:
            return answer, step + 1
    return DONE, n_steps
