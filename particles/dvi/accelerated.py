"""Sweeps to a tolerance, and their Anderson acceleration when they stall.

A few sweeps are a map r -> G(r) whose fixed points solve the contact problem. In a dense packing its slowest modes,
chains of contacts that are nearly mechanisms or nearly self-stressed, shrink by less than 1 % a sweep. Anderson's
method of type II (J. ACM 12 (1965) 547; Walker & Ni, SIAM J. Numer. Anal. 49 (2011) 1715) fits the last m changes,

    r_{k+1} = G(r_k) - sum_j c_j dG_j,     c = argmin |F_k - sum_j c_j dF_j|,     F_k = G(r_k) - r_k,

and takes these modes out together. Velocities, which are linear in the impulses, v = v_free + M^-1 H r, are
extrapolated with them, and the following sweep puts every impulse back into its cone.
Norms weigh an impulse by sqrt(w_n): an energy, so that light and heavy grains count
alike. **Safeguard**: the map has kinks, where contacts open, stick or slip. When |F| exceeds twice the smallest one of
this history, the history is dropped and the iteration continues from the best G(r).

**Heavy on light.** Through a light grain of mass m that carries a heavy one of mass M a sweep passes on m/M of what is
missing: the changes of F are m/M of F, and the coefficient that removes this mode is M/m. Where contacts contradict
each other impulses grow by the same every sweep; what is left of the changes of F then, round-off, fits F badly, and as
large a coefficient would throw the impulses away. So one beyond FAR must come from a fit that explains F. Such an
extrapolation multiplies the round-off of the velocities as well; so these are then recomputed from the impulses,
v = v_free + M^-1 H r, before the residual is looked at.

**Stalls.** In a bed that shears, a warm start often makes more contacts stick than its motion allows. Each sweep then
adds the same small change to a pattern of forces that the velocities hardly feel, until a contact at its end slips,
and so forth from contact to contact: thousands of sweeps, with little to fit in between. So when |F| has not shrunk by
a tenth in PATIENCE sweeps, over-relaxed ones follow (exact Coulomb; the convex law's are plain), twice as many as
the last time: they cover that distance in larger steps, and tolerate the kinks.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from geometry.kernels.device_functions import device_function
from particles.dvi.anderson_vectors import HISTORY, N_PRODUCTS, Vectors, extrapolate, gather, store_change
from particles.dvi.contact_torques import (
    apply_contact_torques,
    no_contact_torques,
    residual,
    sweep,
    weigh_contact_torques,
)
from particles.dvi.gauss_seidel import IWN, SPEED, apply_impulses, grouped
from particles.dvi.solver_state import SolverSettings, all_of
from particles.dvi.sweep_chunks import extrapolate_chunks, gather_chunks, residual_of_chunks, store_chunks, sweep_chunks

GAUSS_SEIDEL, ANDERSON = range(2)  # methods: sweeps alone, accelerated
PLAIN = 1.0  # relaxation of sweeps that are not over-relaxed
PLAIN_SWEEPS = 30  # most warm-started steps are done by then
FIRST_SWEEPS = 100  # before the acceleration begins, over-relaxed after the plain ones, at most half of all
SWEEPS = 3  # in one application of G: they cost less than an extrapolation
PATIENCE = 60  # sweeps in which |F| must reach a new minimum; as many without extrapolation follow otherwise
SLIGHTLY_OVER = 1.3  # over-relaxation within G
FAR = 1e2  # largest coefficient where the fit leaves much of F, as of contacts that contradict each other
FURTHEST, UNEXPLAINED = 1e8, 0.1  # largest one where it leaves no more than this fraction of |F|^2; beyond is round-off
OVER = 1.6  # over-relaxation of the sweeps after a stall; beyond 1.8 sheared beds do not converge


@device_function(error_model="numpy", fastmath={"contract"})
def solve(convex, compliance, settings, records, contact_torques, chunk=None, serial=True):
    """Plain sweeps, then (unless the method is GAUSS_SEIDEL) over-relaxed and at last accelerated ones.

    A sweep with its part of an extrapolation takes twice the time of one alone, so that in beds that move over-relaxed
    sweeps reach 1e-3 m/s sooner; a thousandth of that they do not reach.

    ``chunk`` not None, and ``serial`` None: threads share the sweeps (`particles.dvi.sweep_chunks`). Returns sweeps,
    the residual [m/s] of all contacts at the same velocities, and whether acceleration took over.
    """
    cap, tolerance = settings.cap, settings.tolerance
    first, over = cap, PLAIN
    if settings.method != GAUSS_SEIDEL:
        first, over = min(cap, max(PLAIN_SWEEPS, min(FIRST_SWEEPS, cap // 2))), OVER
    for count in range(first):
        relax = PLAIN if count < PLAIN_SWEEPS else over
        change = _sweep_contacts(convex, relax, compliance, records, contact_torques, chunk, serial)
        if change <= tolerance:
            reached = _residual(convex, compliance, records, contact_torques, chunk, serial)
            if reached <= tolerance:
                return count + 1, reached, 0
    if first == cap:
        return cap, _residual(convex, compliance, records, contact_torques, chunk, serial), 0
    done, reached = anderson(convex, compliance, settings, cap - first, records, contact_torques, chunk, serial)
    return first + done, reached, 1


@device_function(error_model="numpy", fastmath={"contract"})
def anderson(convex, compliance, settings, cap, records, contact_torques, chunk=None, serial=True):
    """Up to ``cap`` accelerated sweeps from the impulses in the records; returns their number and the residual."""
    tolerance = settings.tolerance
    bodies, all_contacts = records.body.shape[0], records.pair.shape[0] + records.wall.shape[0]
    contacts = 3 * all_contacts + bodies
    if contact_torques.law.shape[0] > 0:
        contacts += 3 * all_contacts
    size = contacts + 6 * records.grain.shape[0] + bodies
    vectors = Vectors(
        np.empty(size), np.empty(size), np.empty(size), np.empty(size), np.zeros(contacts), np.zeros(contacts),
        np.empty(contacts), np.empty((HISTORY, size)), np.empty((HISTORY, contacts)), np.zeros(N_PRODUCTS),
    )  # fmt: skip
    r, g, products = vectors.r, vectors.g, vectors.products
    _weights(vectors.weight, records, contact_torques)
    gram, c = np.zeros((HISTORY, HISTORY)), np.zeros(HISTORY)
    none = gram.shape[0] - HISTORY  # a plain 0 is a type of its own, and would compile what takes it twice
    known, slot, best, first = none, none, np.inf, True
    waited, plain, mark, pause = 0, 0, np.inf, PATIENCE
    free, free_body, far = records.grain[:0], records.body[:0], False
    done = 0
    _gather(r, vectors, records, contact_torques, chunk, serial)
    while done < cap:
        change = 0.0
        for _ in range(min(SWEEPS, cap - done)):
            over = OVER if plain > 0 else SLIGHTLY_OVER
            change = _sweep_contacts(convex, over, compliance, records, contact_torques, chunk, serial)
            done += 1
        if change <= tolerance:
            if far:
                _renew_velocities(free, free_body, records, contact_torques)
                far = False
            reached = _residual(convex, compliance, records, contact_torques, chunk, serial)
            if reached <= tolerance:
                return done, reached
        if plain > 0:
            plain -= SWEEPS
            if plain <= 0:
                _gather(r, vectors, records, contact_torques, chunk, serial)
                waited, best, mark = 0, np.inf, np.inf
            continue
        _gather(g, vectors, records, contact_torques, chunk, serial)
        norm = np.sqrt(products[0])
        waited += SWEEPS
        if waited > PATIENCE:
            known, slot, best, first, plain = none, none, np.inf, True, pause
            pause *= 2
            continue
        if norm > 2.0 * best:
            known, slot, best, first = none, none, np.inf, True
            _extrapolate(vectors.best_g, c, known, vectors, records, contact_torques, chunk, serial)
            continue
        better = norm < best
        if better:
            if norm < 0.9 * mark:
                waited, mark = 0, norm
            best = norm
        if not first:
            known = min(known + 1, HISTORY)
        _store_change(better, first, slot, known, vectors, records, contact_torques, chunk, serial)
        if not first:
            for q in range(known):
                gram[slot, q] = gram[q, slot] = products[q]
            slot = (slot + 1) % HISTORY
        first = False
        for q in range(known):
            c[q] = products[HISTORY + q]
        solved = known > 0 and _solve_gram(gram, c, known)
        if solved:
            largest, left = _largest(c, known), _left(c, known, products, norm * norm)
            solved = largest < FAR or (largest < FURTHEST and left < UNEXPLAINED * norm * norm)
            if solved and largest >= FAR:
                if free.shape[0] == 0:
                    free, free_body = _free_velocities(records, contact_torques)
                far = True
        _extrapolate(g, c, known if solved else none, vectors, records, contact_torques, chunk, serial)
    if far:
        _renew_velocities(free, free_body, records, contact_torques)
    _sweep_contacts(convex, PLAIN, compliance, records, contact_torques, chunk, serial)
    return done, _residual(convex, compliance, records, contact_torques, chunk, serial)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _weights(weight, records, contact_torques):
    """sqrt(w_n) for each component of an impulse, sqrt(1/J) for the loads of shafts, sqrt(W) for torques."""
    pair, wall, body = records.pair, records.wall, records.body
    p = pair.shape[0]
    for k in range(p):
        weight[3 * k : 3 * k + 3] = 1.0 / np.sqrt(pair[k, IWN])
    for k in range(wall.shape[0]):
        weight[3 * (p + k) : 3 * (p + k) + 3] = 1.0 / np.sqrt(wall[k, IWN])
    q = 3 * (p + wall.shape[0])
    for b in range(body.shape[0]):
        weight[q + b] = np.sqrt(body[b, 1])
    if contact_torques.law.shape[0] > 0:
        weigh_contact_torques(weight, q + body.shape[0], p, wall.shape[0], contact_torques)


# What follows is done in one piece, or in chunks: numba leaves out a branch that asks for something that is None
@device_function(inline="always", error_model="numpy", fastmath={"contract"})
def _sweep_contacts(convex, relax, compliance, records, contact_torques, chunk, serial):
    change = 0.0
    if serial is not None:
        change = sweep(convex, relax, compliance, records, contact_torques)
    if chunk is not None:
        change = sweep_chunks(convex, relax, compliance, records, contact_torques, chunk)
    return change


@device_function(inline="always", error_model="numpy", fastmath={"contract"})
def _residual(convex, compliance, records, contact_torques, chunk, serial):
    reached = 0.0
    if serial is not None:
        reached = residual(all_of(records), convex, compliance, records, contact_torques)
    if chunk is not None:
        reached = residual_of_chunks(convex, compliance, records, contact_torques, chunk)
    return reached


@device_function(inline="always", error_model="numpy", fastmath={"contract"})
def _gather(g, vectors, records, contact_torques, chunk, serial):
    if serial is not None:
        gather(all_of(records), g, vectors, vectors.products, records, contact_torques)
    if chunk is not None:
        gather_chunks(g, vectors, records, contact_torques, chunk)


@device_function(inline="always", error_model="numpy", fastmath={"contract"})
def _store_change(better, first, slot, known, vectors, records, contact_torques, chunk, serial):
    if serial is not None:
        store_change(all_of(records), better, first, slot, known, vectors, vectors.products, records, contact_torques)
    if chunk is not None:
        store_chunks(better, first, slot, known, vectors, records, contact_torques, chunk)


@device_function(inline="always", error_model="numpy", fastmath={"contract"})
def _extrapolate(g, c, known, vectors, records, contact_torques, chunk, serial):
    if serial is not None:
        extrapolate(all_of(records), g, c, known, vectors, records, contact_torques)
    if chunk is not None:
        extrapolate_chunks(g, c, known, vectors, records, contact_torques, chunk)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _largest(c, n):
    worst = 0.0
    for q in range(n):
        worst = max(worst, abs(c[q]))
    return worst


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _left(c, n, products, square):
    """|F|^2, given as ``square``, less what n coefficients explain of it."""
    for q in range(n):
        square -= c[q] * products[HISTORY + q]
    return square


@device_function(error_model="numpy", fastmath={"contract"})
def _free_velocities(records, contact_torques):
    """Copies of grains and bodies without what the impulses do; these velocities are left in the records as well."""
    apply_impulses(-1.0, records)
    if contact_torques.law.shape[0] > 0:
        apply_contact_torques(-1.0, records, contact_torques)
    return records.grain.copy(), records.body.copy()


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _renew_velocities(free, free_body, records, contact_torques):
    """Recompute the velocities from the impulses."""
    for i in range(free.shape[0]):
        for q in range(free.shape[1]):
            records.grain[i, q] = free[i, q]
    for b in range(free_body.shape[0]):
        records.body[b, SPEED] = free_body[b, SPEED]
    apply_impulses(1.0, records)
    if contact_torques.law.shape[0] > 0:
        apply_contact_torques(1.0, records, contact_torques)


@device_function(error_model="numpy", fastmath={"contract"})
def _solve_gram(gram, c, n):
    """Solve gram x = c (leading n) by Cholesky; x replaces c. False where the history is dependent."""
    trace = 0.0
    for i in range(n):
        trace += gram[i, i]
    low = np.zeros((HISTORY, HISTORY))
    for i in range(n):
        for j in range(i + 1):
            s = gram[i, j]
            if i == j:
                s += 1e-14 * trace  # differences that are nearly dependent must not blow up the coefficients
            for k in range(j):
                s -= low[i, k] * low[j, k]
            if i == j:
                if not s > 0.0:
                    return False
                low[i, i] = np.sqrt(s)
            else:
                low[i, j] = s / low[j, j]
    for i in range(n):
        for k in range(i):
            c[i] -= low[i, k] * c[k]
        c[i] /= low[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            c[i] -= low[k, i] * c[k]
        c[i] /= low[i, i]
    return True


# for calls from Python: the functions above are compiled into the step and have no cache of their own
@njit(cache=True, error_model="numpy", fastmath={"contract"})
def _anderson(convex, compliance, settings, contact_torques, grain, body, pair_index, pair, wall_index, wall):
    records = grouped(grain, body, pair_index, pair, wall_index, wall)
    return anderson(convex, compliance, settings, settings.cap, records, contact_torques)


def accelerate_records(convex, compliance, tolerance, cap, *records):
    """`anderson` for calls from Python, without torques."""
    return _anderson(convex, compliance, SolverSettings(ANDERSON, tolerance, cap), no_contact_torques(), *records)
