"""The compiled step of the grains: contact forces, kick, drift, shafts; K steps a call.

Leapfrog, kick-drift, with velocities half a step behind positions:

    F = F(x(t), v(t - dt/2));   v(t + dt/2) = v(t - dt/2) + F dt/m;   x(t + dt) = x(t) + v(t + dt/2) dt,

and the same for spins (2/5 m R^2). A step has two parallel stages over chunks of rows whose number follows from the
number of grains alone (`particles.dem.row_kernel`); sums over grains are kept by chunk and added in the order of the
chunks. So nothing depends on the number of threads, bit for bit.

All steps of a call are one parallel loop, over threads. A thread takes chunks of the present stage, its own share first
and then what others have left; who ends the last one opens the next stage. That costs a tenth of numba's loops, of
which each stage was one (1.3 microseconds, most of it to hand over the arguments), a thread that has lost its core
holds up the others by one chunk at the most, and one thread alone can do all: nothing waits for a thread that does not
come.

The law is the one whose table is given: numba compiles for its type (`particles.laws.springs`). What would cost in the
loop over pairs and is not in the scene (a sector's ``turn``, ``resistance``, ``energy_column``, ``attraction``) is None
where a function takes it as an argument: numba prunes its branches, the compiled code does not contain it. What is
done once a grain or once a contact (gravity, held forces, triangles, species, cohesion, which of rolling and twisting)
is a branch at run time, on an empty array or a number: every combination compiled would be thousands of variants of ten
seconds and more. Rolling and twisting as such a branch too made steps slower, and stayed compiled out.

Functions take tuples of arrays (`particles.dem.kernel_state`), and those that are called for every grain count no
references to them (`geometry.kernels.device_functions`): counted, a step took twice as long.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from geometry.kernels.atomics import WORDS_APART, compare_exchange, fetch_add, load_acquire, sched_yield, store_release
from geometry.kernels.device_functions import device_function
from particles.dem.kernel_state import Now, StepArguments
from particles.dem.row_kernel import finish_rows, sweep_rows
from particles.dem.total_columns import (
    BODY_WORK,
    CONTACT_LATER,
    CONTACT_WORK,
    CONTACTS,
    DONE,
    DRIVE_WORK,
    ELASTIC,
    GRAIN,
    KINETIC,
    LAST_TORQUE,
    LOAD_WORK,
    MAX_OVERLAP,
    MAX_SQUARED_SPEED,
    MAX_SQUARED_TRAVEL,
    N_CHUNK_BODY,
    NORMAL_DAMPING,
    NOT_FINITE,
    OVERLAP,
    REBUILD,
    SHAFT_CONTACT_WORK,
    TOO_FAST,
    TORQUE_T,
)  # fmt: skip
from particles.shafts import DRIVE, DRIVE_SLOPE, FREE, INERTIA, LOAD, SPEED

# What threads tell each other during a call: the stage, counted through; chunks of it that are done; answer and steps
# done; and for each chunk how many stages have taken it
STAGE, DONE_CHUNKS, ANSWER, STEPS, CHUNKS = 0, WORDS_APART, 2 * WORDS_APART, 2 * WORDS_APART + 1, 3 * WORDS_APART
OVER = -1
SPIN = 20_000  # looks at the stage before a thread that waits lets others have its core


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _drive_bodies(step, shafts, walls):
    """Speeds of driven bodies, and where their triangles have turned to."""
    for b in range(shafts.speed.shape[0]):
        if shafts.constants[b, FREE] == 0.0:
            shafts.speed[b] = shafts.drives[step, b, SPEED]
        if walls.triangle.shape[0] > 0:
            walls.turn[b, 0], walls.turn[b, 1] = np.cos(shafts.angle[b]), np.sin(shafts.angle[b])


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _turn_bodies(dt, step, shafts, totals):
    """Add the chunks in their order, turn the shafts (`particles.bodies`)."""
    drives, constants, body_angle, body_speed = shafts.drives, shafts.constants, shafts.angle, shafts.speed
    body_chunks, body_totals, n_sectors = totals.chunk_bodies, totals.bodies, shafts.n_sectors
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
        if constants[b, FREE] != 0.0:
            old = body_speed[b]
            per = dt / constants[b, INERTIA]
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


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _wall_travel(shafts):
    """The longest way of a triangle since the list was made [m]."""
    way = 0.0
    for b in range(shafts.speed.shape[0]):
        way = max(way, abs(shafts.angle[b] - shafts.list_angle[b]) * shafts.reach[b])
    return way


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _verdict(call, wall_travel, chunk_sums, totals):
    """Add the chunks in their order: energies accumulate, extremes are kept, contacts are the last."""
    contacts = elastic = squared_travel = squared_speed = 0.0
    for c in range(chunk_sums.shape[0]):
        row = chunk_sums[c]
        contacts += row[CONTACTS]
        elastic += row[ELASTIC]
        for column in range(NORMAL_DAMPING, MAX_OVERLAP):
            totals[column] += row[column]
        if row[MAX_OVERLAP] > totals[MAX_OVERLAP]:
            totals[MAX_OVERLAP], totals[GRAIN] = row[MAX_OVERLAP], row[GRAIN]
        squared_travel = max(squared_travel, row[MAX_SQUARED_TRAVEL])
        squared_speed = max(squared_speed, row[MAX_SQUARED_SPEED])
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
    totals[MAX_SQUARED_TRAVEL] = squared_travel
    totals[MAX_SQUARED_SPEED] = max(totals[MAX_SQUARED_SPEED], squared_speed)
    if not squared_travel < np.inf:
        return NOT_FINITE
    if totals[MAX_OVERLAP] > call.overlap:
        return OVERLAP
    if squared_speed > call.speed * call.speed:
        return TOO_FAST
    return REBUILD if squared_travel > call.squared_travel or wall_travel > call.wall_travel else DONE


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _run_chunks(worker, workers, given, words):
    """One of the ``workers`` threads: takes chunks of each stage, its own share first, until all steps are done."""
    call, law, resistance, energy_column, attraction, grains, pairs, slots, walls, shafts, chunks, totals = given
    n_chunks, late = chunks.start.shape[0] - 1, chunks.late_grain.shape[0] > 0
    # contacts, pulls, kick and drift of grains that no other chunk touches; then kick and drift of the others
    stages = 2 if late else 1
    while True:
        stage = load_acquire(words, STAGE)
        if stage == OVER:
            return
        step = stage // stages
        now = Now(step, call.dt, call.last and step == call.n_steps - 1)
        for k in range(n_chunks):
            c = worker * n_chunks // workers + k
            c -= n_chunks if c >= n_chunks else 0
            place = CHUNKS + c * WORDS_APART
            if load_acquire(words, place) != stage or not compare_exchange(words, place, stage, stage + 1):
                continue
            if stage % stages == 0:
                sweep_rows(
                    c, now, law, resistance, energy_column, attraction, grains, pairs, slots, walls, chunks, totals
                )
            else:
                finish_rows(c, now, law, energy_column, attraction, grains, chunks, totals)
            if fetch_add(words, DONE_CHUNKS, 1) == n_chunks - 1:  # the last one continues for all
                store_release(words, DONE_CHUNKS, 0)
                over = False
                if stage % stages == stages - 1:
                    over = _end_step(step, call, shafts, walls, totals, words)
                store_release(words, STAGE, OVER if over else stage + 1)
        turns = 0
        while load_acquire(words, STAGE) == stage:
            turns += 1
            if turns > SPIN:
                sched_yield()


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _end_step(step, call, shafts, walls, totals, words):
    """Shafts and totals of a step, and bodies at the speeds of the next one; whether there is none."""
    _turn_bodies(call.dt, step, shafts, totals)
    answer = _verdict(call, _wall_travel(shafts), totals.chunk, totals.run)
    words[ANSWER], words[STEPS] = answer, step + 1
    if answer != DONE or step + 1 == call.n_steps:
        return True
    _drive_bodies(step + 1, shafts, walls)
    return False


@njit(parallel=True, cache=True, error_model="numpy", fastmath={"contract"})
def run_steps(call, law, resistance, energy_column, attraction, grains, pairs, slots, walls, shafts, chunks, totals):
    """Up to ``call.n_steps`` steps; stops early when a list must be rebuilt or a grain is in trouble.

    Parameters
    ----------
    call : Call
    law : table of a spring (`particles.laws.springs`)
    resistance : Resistance, or None
        Rolling and twisting.
    energy_column : int, or None
        First column of the last forces in a contact's history, in a step that keeps the energy budget.
    attraction : HeldAttraction, or None
    grains, pairs, slots, walls, shafts, chunks, totals
        `particles.dem.kernel_state`, and `particles.neighbours.partition.Chunks`.

    Returns
    -------
    answer, steps done : int
    """
    if call.n_steps < 1:
        return DONE, 0
    n_chunks = chunks.start.shape[0] - 1
    words = np.zeros(CHUNKS + n_chunks * WORDS_APART, dtype=np.int64)
    workers = min(call.threads, n_chunks)
    _drive_bodies(0, shafts, walls)
    for w in prange(workers):
        given = StepArguments(  # made here: numba hands no tuple of tuples to the threads
            call, law, resistance, energy_column, attraction, grains, pairs, slots, walls, shafts, chunks, totals
        )
        _run_chunks(np.int64(w), workers, given, words)  # numba's own index is unsigned
    return load_acquire(words, ANSWER), load_acquire(
        words, STEPS
    )  # by calls: numba would read an element before the loop
