"""The compiled step of rigid grains: drift, free velocities, contacts, impulses, drift; K steps a call.

Moreau-Jean with the middle of the step at x_m:

    x_m = x + (1 - theta) h v;    v' = v + h F/m + r/m;    x' = x_m + theta h v'.

A contact at the gap g > 0 in x_m may close within the step, not cross: u_n' >= -g/h. So it holds its impulse only if
it is reached, and the next middle is free of overlap whatever theta is (the middles are h v' apart). With restitution
e an approach faster than the threshold that would end in a contact within the step rebounds: u_n' >= -e u_n. What
overlap is left by the curvature of paths is removed from the positions alone (`particles.dvi.projection`): no velocity
is touched, no kinetic energy made; the work of the lagged forces on that displacement is reported. Bodies turn to the
same middle as the grains; triangles, in scenes that have them, are met there (`particles.dvi.triangle_contacts`).

**Slop.** A gap of less than ``slop`` radii counts as closed, u_n' >= 0, as an overlap of so much is let be. Were it to
be closed, to the last picometre that the tolerance of earlier steps has left, the contacts of a packing at rest would
ask for velocities that contradict each other: more contacts than degrees of freedom. Its forces would then grow from
sweep to sweep until something slips, which is what makes such iterations stall.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from geometry.kernels.device_functions import device_function
from particles.dem.box_kernel import RATE
from particles.dvi import gauss_seidel as gs
from particles.dvi.accelerated import solve
from particles.dvi.adhesion import pull_together
from particles.dvi.contact_groups import group_contacts
from particles.dvi.contact_search import find_contacts, find_in_chunks, free_velocities, search_in_chunks
from particles.dvi.contact_torques import accumulate_torque_work, begin_contact_torques
from particles.dvi.end_of_step import (
    ACCELERATED,
    BODY_WORK,
    CONTACT_WORK,
    DRIVE_WORK,
    GRAIN,
    LOAD_WORK,
    MAX_OVERLAP,
    MAX_SWEEPS,
    MISSED,
    N_STEP_SUMS,
    PROJECTIONS,
    RESIDUAL,
    ROLLING,
    STABILISATION,
    SWEEPS,
    TORQUE_T,
    TWISTING,
    VISITS,
    accumulate_in_chunks,
    accumulate_work,
    add_totals,
    move,
)
from particles.dvi.flow_in_box import (
    add_drift,
    add_impulses,
    add_shifts,
    bound_peculiar_speeds,
    nearer_by_flow,
    shear,
    strain_of_list,
)
from particles.dvi.gauss_seidel import BRAKE, IJ
from particles.dvi.near_pulls import set_lagged_forces
from particles.dvi.projection import project
from particles.dvi.solver_state import Horizon, SolverContacts, WallImpulses, all_of, first_of
from particles.dvi.sweep_chunks import group_chunks, sort_walls
from particles.dvi.triangle_contacts import find_triangle_contacts, pass_on, search, turn_bodies
from particles.shafts import DRIVE, DRIVE_SLOPE, FREE, INERTIA, LOAD, SPEED
from particles.step_status import DONE, NOT_FINITE, OVERLAP, REBUILD

PROJECTION_SWEEPS = 5  # a jam that needs more gets them in the next steps


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _drift_half(call, grains, pairs, shafts, walls, box):
    """Stage 1: to the middle of the step."""
    h, theta = call.h, call.theta
    position, velocity = grains.position, grains.velocity
    if theta < 1.0:
        if box.shape[0] > 0:
            add_drift((1.0 - theta) * h, grains, velocity, box)
            shear((1.0 - theta) * h, grains.flow, pairs.images)
        for i in range(position.shape[0]):
            for c in range(3):
                position[i, c] += (1.0 - theta) * h * velocity[i, c]
    turn_bodies(h, theta, shafts, walls)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _free_bodies(h, step, shafts, body):
    """Fill the records of the bodies: speeds without contacts, and what the load of a shaft can do."""
    drives, constants, n_sectors = shafts.drives, shafts.constants, shafts.n_sectors
    for b in range(body.shape[0]):
        if constants[b, FREE] != 0.0:
            # the slope of the drive is taken at the end of the step: it only adds to the inertia
            inertia = constants[b, INERTIA] + h * drives[step, b, DRIVE_SLOPE]
            body[b, gs.SPEED] = (constants[b, INERTIA] * shafts.speed[b] + h * drives[step, b, DRIVE]) / inertia
            body[b, IJ] = n_sectors / inertia
            body[b, gs.LOAD] = h * drives[step, b, LOAD] / n_sectors
        else:
            body[b, gs.SPEED], body[b, IJ], body[b, gs.LOAD] = drives[step, b, SPEED], 0.0, 0.0
        body[b, BRAKE] = min(max(body[b, BRAKE], -body[b, gs.LOAD]), body[b, gs.LOAD])


@device_function(error_model="numpy", fastmath={"contract"})
def _search(horizon, grains, slots, walls, shafts, body, chunk, serial):
    """Find the triangles that grains may meet within the step; returns the largest speed of a pushed grain [m/s]."""
    if serial is not None:
        raised = search(np.int64(0), grains.mass.shape[0], horizon, grains, slots, walls, shafts, body)
    if chunk is not None:
        raised = search_in_chunks(horizon, grains, slots, walls, shafts, body, chunk)
    return raised


@device_function(error_model="numpy", fastmath={"contract"})
def _find(horizon, compliance, grains, pairs, slots, walls, shafts, records, chunk, serial):
    """The contacts that may close within the step, with the impulses of the last one; their numbers."""
    if serial is not None:
        rows = np.int64(0), grains.mass.shape[0]
        n_pairs, n_walls = find_contacts(
            rows, (np.int64(0), np.int64(0)), None, horizon, compliance, grains, pairs, slots, walls, shafts.speed,
            records,
        )  # fmt: skip
        if walls.triangle.shape[0] > 0:
            n_walls = find_triangle_contacts(
                rows, n_walls, horizon, compliance, grains, slots, walls, shafts.speed, records
            )
    if chunk is not None:
        unsorted = SolverContacts(
            records.grain, records.body, records.pair_index, records.pair, chunk.unsorted_index, chunk.unsorted_row,
            records.pair_group, records.wall_group, records.membership, records.pair_shift, records.images,
        )  # fmt: skip
        places = WallImpulses(
            slots.start, slots.other, slots.impulse, chunk.unsorted_slot, slots.triangle_contact, slots.tally
        )
        find_in_chunks(horizon, compliance, grains, pairs, places, walls, shafts.speed, unsorted, chunk, chunk.ends)
        n_pairs, n_walls = chunk.pairs[-1], sort_walls(chunk, slots, records)
        group_chunks(first_of(records, n_pairs, n_walls), chunk)
    if serial is not None:
        contacts = first_of(records, n_pairs, n_walls)
        group_contacts(all_of(contacts), contacts.body, IJ, contacts)
    return n_pairs, n_walls


@device_function(error_model="numpy", fastmath={"contract"})
def _begin(
    call, step, compliance, grains, near, pairs, slots, walls, shafts, records, contact_torques, threads, totals
):
    """Stages 1 to 3: near pulls, half drift, overlap, free velocities, contacts, warm start.

    Returns the numbers of pairs and walls that are contacts, and the largest speed [m/s].
    """
    h, chunk, serial = call.h, threads.chunk, threads.serial
    if near.lagged.shape[0] > 0:
        set_lagged_forces(h, near, grains, pairs, slots, walls, chunk, serial, totals.box)
    _drift_half(call, grains, pairs, shafts, walls, totals.box)
    before = grains.position[:0]
    if totals.box.shape[0] > 0:
        before = grains.position.copy()
    deepest, at, work, count = project(
        call.slop if compliance is None else np.inf, PROJECTION_SWEEPS, step, grains, pairs, slots, walls, chunk,
        serial,
    )  # fmt: skip
    totals.run[STABILISATION] += work
    totals.run[PROJECTIONS] += count
    if totals.box.shape[0] > 0 and count > 0:
        add_shifts(before, grains, totals.box)
    if deepest > totals.run[MAX_OVERLAP]:
        totals.run[MAX_OVERLAP], totals.run[GRAIN] = deepest, at

    _free_bodies(h, step, shafts, records.body)
    fastest = free_velocities(h, step, grains, records.grain)
    if totals.box.shape[0] > 0:
        fastest = bound_peculiar_speeds(grains, records.grain)
    if walls.triangle.shape[0] > 0:
        horizon = Horizon(h, call.margin * h * fastest, call.slop, call.law)
        raised = _search(horizon, grains, slots, walls, shafts, records.body, chunk, serial)
        if raised > 0.0:
            fastest = max(fastest, raised)
            pass_on(h, grains, pairs)
    horizon = Horizon(h, call.margin * h * fastest, call.slop, call.law)
    n_pairs, n_walls = _find(horizon, compliance, grains, pairs, slots, walls, shafts, records, chunk, serial)
    contacts = first_of(records, n_pairs, n_walls)
    gs.apply_impulses(1.0, contacts)
    if call.pull > 0:
        pull_together(call, compliance, grains.radius, pairs, slots, contacts)
    if contact_torques.law.shape[0] > 0:
        begin_contact_torques(compliance, grains.radius, pairs, slots, walls, contacts, contact_torques)
    return n_pairs, n_walls, fastest


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _count(tolerance, contacts, sweeps, reached, accelerated, run):
    """Count the sweeps and visits of a step."""
    run[SWEEPS] += sweeps
    run[VISITS] += sweeps * (contacts.pair.shape[0] + contacts.wall.shape[0])
    run[MAX_SWEEPS] = max(run[MAX_SWEEPS], sweeps)
    run[RESIDUAL] = max(run[RESIDUAL], reached)
    run[ACCELERATED] += accelerated
    if not reached <= tolerance:
        run[MISSED] += 1.0


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _turn_shafts(call, step, shafts, body, mean, body_totals):
    """New speeds and angles of the bodies, and ``mean`` of old and new speeds (n_bodies,) [rad/s]; works of shafts."""
    h, drives = call.h, shafts.drives
    for b in range(mean.shape[0]):
        mean[b] = body[b, gs.SPEED]
        if shafts.constants[b, FREE] != 0.0:
            mean[b] = 0.5 * (shafts.speed[b] + body[b, gs.SPEED])
            torque = drives[step, b, DRIVE] - drives[step, b, DRIVE_SLOPE] * body[b, gs.SPEED]
            body_totals[b, DRIVE_WORK] += torque * mean[b] * h
            body_totals[b, LOAD_WORK] += shafts.n_sectors * body[b, BRAKE] * mean[b]
        shafts.speed[b] = body[b, gs.SPEED]
        shafts.angle[b] += call.theta * h * shafts.speed[b]


@device_function(error_model="numpy", fastmath={"contract"})
def _accumulate_work(h, pull, compliance, mean, grains, pairs, slots, shafts, contacts, chunk, serial, totals):
    """Keep the impulses, and add up their works and torques."""
    sums = np.zeros((1, N_STEP_SUMS))
    if serial is not None:
        accumulate_work(
            all_of(contacts), h, pull, compliance, shafts.speed, mean, grains, pairs, slots, contacts, sums[0],
            totals.bodies,
        )  # fmt: skip
    if chunk is not None:
        sums = chunk.sums
        accumulate_in_chunks(
            h, pull, compliance, shafts.speed, mean, grains, pairs, slots, contacts, chunk, totals.bodies
        )
    add_totals(compliance, sums, totals)


@device_function(error_model="numpy", fastmath={"contract"})
def _finish(call, step, compliance, grains, pairs, slots, shafts, contacts, contact_torques, threads, totals):
    """Stages 5 and 6: work recorded, and drift; returns how far from its list a grain is [m]."""
    h, run = call.h, totals.run
    mean = np.empty(shafts.speed.shape[0])
    _turn_shafts(call, step, shafts, contacts.body, mean, totals.bodies)
    _accumulate_work(
        h, call.pull, compliance, mean, grains, pairs, slots, shafts, contacts, threads.chunk, threads.serial, totals
    )
    if contact_torques.law.shape[0] > 0:
        rolling, twisting, work = accumulate_torque_work(
            h, compliance, mean, grains, pairs, slots, contacts, contact_torques, totals, TORQUE_T, BODY_WORK
        )
        run[ROLLING] += rolling
        run[TWISTING] += twisting
        run[CONTACT_WORK] += work
    rate = strain = nearer = 0.0
    if totals.box.shape[0] > 0:
        add_impulses(call.pull, grains.radius, pairs, contacts, totals.box)
        add_drift(call.theta * h, grains, contacts.grain, totals.box)
        shear(call.theta * h, grains.flow, contacts.images)
        rate, strain, nearer = grains.flow[RATE], strain_of_list(grains.flow), nearer_by_flow(h, grains.flow)
    return np.sqrt(move(h, call.theta * h, rate, strain, step, grains, contacts.grain, run)) + nearer


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _verdict(call, travel, shafts, walls):
    """Return NOT_FINITE, REBUILD (a grain or triangle may be too far from its place in the list), or DONE."""
    if not travel < np.inf:
        return NOT_FINITE
    if travel > call.travel:
        return REBUILD
    if walls.triangle.shape[0] > 0:
        for b in range(shafts.speed.shape[0]):
            turn = abs(shafts.angle[b] - shafts.list_angle[b]) + call.h * abs(shafts.speed[b])
            if turn * shafts.reach[b] > call.wall_travel:
                return REBUILD
    return DONE


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def run_steps(
    call, convex, compliance, grains, near, pairs, slots, walls, shafts, records, contact_torques, threads, totals
):
    """Up to ``call.n_steps`` steps; stops early when the list must be rebuilt or a grain is in trouble.

    Parameters
    ----------
    convex : bool, or None
        The convex relaxation; None: exact Coulomb.
    compliance : ndarray, or None
        Table of springs (`particles.dvi.compliance`); None: rigid.
    near : NearPulls
        `particles.dvi.near_pulls`.
    call, grains, pairs, slots, walls, shafts, records, contact_torques, threads, totals
        `particles.dvi.solver_state`, and `particles.shafts.Shafts`.

    Returns
    -------
    status, steps done : int
    """
    for step in range(call.n_steps):
        # 1-3. half drift, free velocities, contacts, warm start
        n_pairs, n_walls, fastest = _begin(
            call, step, compliance, grains, near, pairs, slots, walls, shafts, records, contact_torques, threads, totals
        )
        call.n_contacts[0], call.n_contacts[1] = n_pairs, n_walls
        if totals.run[MAX_OVERLAP] > call.overlap:
            return OVERLAP, step
        # 4. impulses
        contacts = first_of(records, n_pairs, n_walls)
        sweeps, reached, accelerated = solve(
            convex, compliance, call.settings, contacts, contact_torques, threads.chunk, threads.serial
        )
        # 5-6. work recorded, half drift
        _count(call.settings.tolerance, contacts, sweeps, reached, accelerated, totals.run)
        travel = _finish(
            call, step, compliance, grains, pairs, slots, shafts, contacts, contact_torques, threads, totals
        )
        status = _verdict(call, travel + call.h * fastest, shafts, walls)
        if status != DONE:
            return status, step + 1
    return DONE, call.n_steps
