"""The compiled step of the grains, K steps a call: the leapfrog (kick, drift) and its splitting among threads.

Velocities are half a step behind positions:

    F = F(x(t), v(t - dt/2));   v(t + dt/2) = v(t - dt/2) + F dt/m;   x(t + dt) = x(t) + v(t + dt/2) dt,

and the same for spins (2/5 m R^2). `_run_worker` is the step, stage by stage. Contacts, walls, kick and drift of a
chunk of rows follow one another while its grains are in the cache (`particles.dem.chunk_rows`). The number of chunks
follows from the number of grains alone; sums over grains are kept by chunk and added in the order of the chunks. So
nothing depends on the number of threads, bit for bit, nor on which of them does what (`particles.dem.chunk_scheduler`).

The contact law is a number in its table, read once for eight contacts (`particles.laws.springs`). What would cost in
the loop over pairs and is not in the scene (a sector's ``turn``, a sheared box's ``images`` and ``flow``,
``resistance``, ``energy_column``, ``attraction``) is None where a function takes it as an argument: numba prunes its
branches, the compiled code does not contain it. What is done once a grain or once a contact (gravity, lagged forces,
triangles, species, cohesion, which of rolling and twisting) is a branch at run time, on an empty array or a number:
every combination compiled would be thousands of variants of ten seconds and more. Rolling and twisting as such a branch
too made steps slower, and stayed compiled out.

Functions take tuples of arrays (`particles.dem.kernel_state`), and those that are called for every grain count no
references to them (`geometry.kernels.device_functions`): counted, a step took twice as long.
"""

from __future__ import annotations

import numpy as np
from numba import njit, prange

from geometry.kernels.atomics import load_acquire
from geometry.kernels.device_functions import device_function
from particles.dem.body_kernel import drive_bodies, turn_bodies, wall_travel
from particles.dem.box_kernel import allowed_travel, move_box
from particles.dem.chunk_rows import finish_rows, sweep_rows
from particles.dem.chunk_scheduler import NONE, STATUS, STEPS, Worker, barrier, claim, complete, shared_words
from particles.dem.kernel_state import Now, StepArguments
from particles.dem.total_columns import (
    CONTACT_LATER,
    CONTACT_WORK,
    CONTACTS,
    ELASTIC,
    GRAIN,
    KINETIC,
    MAX_OVERLAP,
    MAX_SQUARED_SPEED,
    MAX_SQUARED_TRAVEL,
    NORMAL_DAMPING,
)
from particles.step_status import DONE, NOT_FINITE, OVERLAP, REBUILD, TOO_FAST


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
    attraction : LaggedAttraction, or None
    grains, pairs, slots, walls, shafts, chunks, totals
        `particles.dem.kernel_state`, and `particles.neighbours.partition.Chunks`.

    Returns
    -------
    status, steps done : int
    """
    if call.n_steps < 1:
        return DONE, 0
    n_chunks = chunks.start.shape[0] - 1
    words, workers = shared_words(n_chunks), min(call.threads, n_chunks)
    drive_bodies(0, shafts, walls)
    for w in prange(workers):
        arguments = StepArguments(  # made here: numba hands no tuple of tuples to the threads
            call, law, resistance, energy_column, attraction, grains, pairs, slots, walls, shafts, chunks, totals
        )
        # numba's own index is unsigned
        _run_worker(Worker(np.int64(w), workers, words), arguments)  # type: ignore[arg-type]
    # by calls: numba would read an element before the loop
    return load_acquire(words, STATUS), load_acquire(words, STEPS)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _run_worker(worker, arguments):
    """Run all steps of a call as one of the threads that share each stage."""
    call, law, resistance, energy_column, attraction, grains, pairs, slots, walls, shafts, chunks, totals = arguments
    n_chunks, words = chunks.start.shape[0] - 1, worker.words
    for step in range(call.n_steps):
        now, stage = Now(step, call.dt, call.last and step == call.n_steps - 1), 3 * step

        # forces at x(t) of pairs, walls and attraction; kick and drift of the grains that no other chunk pushes
        for k in range(n_chunks):
            c = claim(worker, stage, k, n_chunks)
            if c != NONE:
                sweep_rows(
                    c, now, law, resistance, energy_column, attraction, grains, pairs, slots, walls, chunks, totals
                )
                complete(worker, stage, n_chunks)
        barrier(worker, stage)

        # reactions from other chunks; kick and drift of the grains that have waited for them
        for k in range(n_chunks):
            c = claim(worker, stage + 1, k, n_chunks)
            if c != NONE:
                finish_rows(c, now, law, energy_column, attraction, grains, chunks, totals)
                complete(worker, stage + 1, n_chunks)
        barrier(worker, stage + 1)

        # totals over the chunks; bodies turn under their loads, and take the speeds of the next step; by one thread
        if claim(worker, stage + 2, 0, 1) != NONE:
            turn_bodies(call.dt, step, shafts, totals)
            move_box(call.dt, grains.flow, pairs.images, grains.virial, totals.box)
            allowed = allowed_travel(grains.flow, call.squared_travel)
            status = _add_chunks(call, allowed, wall_travel(shafts), totals.chunk, totals.run)
            words[STATUS], words[STEPS] = status, step + 1
            if status == DONE and step + 1 < call.n_steps:
                drive_bodies(step + 1, shafts, walls)
            complete(worker, stage + 2, 1)
        barrier(worker, stage + 2)
        if load_acquire(words, STATUS) != DONE:
            return


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _add_chunks(call, allowed, wall_travel, chunk_sums, totals):
    """Add the chunks in their order: energies accumulate, extremes are kept, contacts are the last; returns the status.

    It is DONE, or why the call stops after this step; ``allowed`` is a squared displacement [m^2].
    """
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
    return REBUILD if squared_travel > allowed or wall_travel > call.wall_travel else DONE
