"""Sweeps to a tolerance, and their Anderson acceleration when they stall.

A few sweeps are a map r -> G(r) whose fixed points solve the contact problem. In a dense packing its slowest modes,
chains of contacts that are nearly mechanisms or nearly self-stressed, shrink by less than 1 % a sweep. Anderson's
method of type II (J. ACM 12 (1965) 547; Walker & Ni, SIAM J. Numer. Anal. 49 (2011) 1715) fits the last m changes,

    r_{k+1} = G(r_k) - sum_j c_j dG_j,     c = argmin |F_k - sum_j c_j dF_j|,     F_k = G(r_k) - r_k,

and takes these modes out together. Velocities, which are linear in the impulses, v = v_free + M^-1 H r, are
extrapolated with them, and the following sweep puts every impulse back into its cone.
Norms weigh an impulse by sqrt(w_n): an energy, so that light and heavy grains count
alike. **Safeguard**: the map has kinks, where contacts open, stick or slip. When |F| exceeds twice the smallest one of
this history, the history is dropped and the iteration goes on from the best G(r).

**Stalls.** In a bed that shears, a warm start often makes more contacts stick than its motion allows. Each sweep then
adds the same small change to a pattern of forces that the velocities hardly feel, until a contact at its end slips,
and so forth from contact to contact: thousands of sweeps, with little to fit in between. So when |F| has not shrunk by
a tenth in PATIENCE sweeps, over-relaxed ones follow (exact Coulomb; plain ones for the convex law), twice as many as
the last time: they make that way in larger steps, and tolerate the kinks.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from particles.dvi.couples import put_couples, residual, sweep, take_couples, weigh_couples
from particles.dvi.gauss_seidel import (
    BRAKE,
    IWN,
    PX,
    PY,
    PZ,
    RX,
    SPEED,
    VX,
    VY,
    VZ,
)  # fmt: skip
from particles.kernel_stamp import kernel_stamp

# methods: sweeps alone, accelerated, then an interior point; accelerated projected gradients (convex only)
GAUSS_SEIDEL, ANDERSON, INTERIOR, APGD = range(4)
PLAIN_SWEEPS = 30  # before the acceleration begins: most warm-started steps are done by then
HISTORY = 5
SWEEPS = 3  # in one application of G: they cost less than an extrapolation
PATIENCE = 60  # sweeps in which |F| must have found a new minimum; as many without extrapolation follow otherwise
SLIGHTLY_OVER = 1.3  # over-relaxation within G
FURTHEST = 1e2  # largest coefficient: beyond, changes do not shrink, as of contacts that contradict each other
OVER = 1.6  # over-relaxation of the sweeps after a stall; beyond 1.8 sheared beds do not converge


@njit(error_model="numpy", fastmath={"contract"})
def solve(convex, relax, soft, method, tolerance, cap, grain, body, pair_index, pair, wall_index, wall, couples=None):
    """Plain sweeps, then (unless ``method`` is GAUSS_SEIDEL) accelerated ones.

    ``couples``: as in `particles.dvi.couples.sweep`. Returns sweeps, the honest residual [m/s], and whether
    acceleration took over.
    """
    first = cap if method == GAUSS_SEIDEL else min(cap, PLAIN_SWEEPS)
    for count in range(first):
        change = sweep(convex, relax, soft, couples, grain, body, pair_index, pair, wall_index, wall)
        if change <= tolerance:
            reached = residual(convex, soft, couples, grain, body, pair_index, pair, wall_index, wall)
            if reached <= tolerance:
                return count + 1, reached, 0
    if first == cap:
        return cap, residual(convex, soft, couples, grain, body, pair_index, pair, wall_index, wall), 0
    done, reached = anderson(
        convex, relax, soft, tolerance, cap - first, grain, body, pair_index, pair, wall_index, wall, couples
    )
    return first + done, reached, 1


@njit(error_model="numpy", fastmath={"contract"})
def anderson(convex, relax, soft, tolerance, cap, grain, body, pair_index, pair, wall_index, wall, couples=None):
    """Up to ``cap`` accelerated sweeps from the impulses in the records; returns their number and the residual."""
    contacts = 3 * (pair.shape[0] + wall.shape[0]) + body.shape[0]
    if couples is not None:
        contacts += 3 * (pair.shape[0] + wall.shape[0])
    size = contacts + 6 * grain.shape[0] + body.shape[0]
    weight = np.empty(contacts)
    _weights(weight, pair, wall, body, couples)
    r, g, old_g, best_g = np.empty(size), np.empty(size), np.empty(size), np.empty(size)
    f, old_f = np.empty(contacts), np.empty(contacts)
    d_g, d_f = np.empty((HISTORY, size)), np.empty((HISTORY, contacts))
    gram, c = np.zeros((HISTORY, HISTORY)), np.zeros(HISTORY)
    known, slot, best = 0, 0, np.inf
    first = True
    waited, plain, mark, pause = 0, 0, np.inf, PATIENCE
    done = 0
    _read(r, contacts, pair, wall, grain, body, couples)
    while done < cap:
        change = 0.0
        for _ in range(min(SWEEPS, cap - done)):
            if convex is None:
                over = OVER if plain > 0 else SLIGHTLY_OVER
                change = sweep(convex, over, soft, couples, grain, body, pair_index, pair, wall_index, wall)
            else:
                change = sweep(convex, relax, soft, couples, grain, body, pair_index, pair, wall_index, wall)
            done += 1
        if change <= tolerance:
            reached = residual(convex, soft, couples, grain, body, pair_index, pair, wall_index, wall)
            if reached <= tolerance:
                return done, reached
        if plain > 0:
            plain -= SWEEPS
            if plain <= 0:
                _read(r, contacts, pair, wall, grain, body, couples)
                waited, best, mark = 0, np.inf, np.inf
            continue
        _read(g, contacts, pair, wall, grain, body, couples)
        for q in range(contacts):
            f[q] = weight[q] * (g[q] - r[q])
        norm = np.sqrt(_dot(f, f))
        waited += SWEEPS
        if waited > PATIENCE:
            known, slot, best, first, plain = 0, 0, np.inf, True, pause
            pause *= 2
            continue
        if norm > 2.0 * best:
            known, slot, best, first = 0, 0, np.inf, True
            r[:] = best_g
        else:
            if norm < best:
                if norm < 0.9 * mark:
                    waited, mark = 0, norm
                best = norm
                best_g[:] = g
            if not first:
                for q in range(size):
                    d_g[slot, q] = g[q] - old_g[q]
                for q in range(contacts):
                    d_f[slot, q] = f[q] - old_f[q]
                known = min(known + 1, HISTORY)
                for q in range(known):
                    gram[slot, q] = gram[q, slot] = _dot(d_f[slot], d_f[q])
                slot = (slot + 1) % HISTORY
            old_g[:], old_f[:] = g, f
            first = False
            r[:] = g
            if known > 0:
                for q in range(known):
                    c[q] = _dot(d_f[q], f)
                if _solve_gram(gram, c, known) and _largest(c, known) < FURTHEST:
                    for q in range(known):
                        for k in range(size):
                            r[k] -= c[q] * d_g[q, k]
        _write(r, contacts, pair, wall, grain, body, couples)
    sweep(convex, relax, soft, couples, grain, body, pair_index, pair, wall_index, wall)
    return done, residual(convex, soft, couples, grain, body, pair_index, pair, wall_index, wall)


@njit(error_model="numpy", fastmath={"contract"})
def _weights(weight, pair, wall, body, couples):
    """sqrt(w_n) for each component of an impulse, sqrt(1/J) for the loads of shafts, sqrt(W) for couples."""
    p = pair.shape[0]
    for k in range(p):
        weight[3 * k : 3 * k + 3] = 1.0 / np.sqrt(pair[k, IWN])
    for k in range(wall.shape[0]):
        weight[3 * (p + k) : 3 * (p + k) + 3] = 1.0 / np.sqrt(wall[k, IWN])
    q = 3 * (p + wall.shape[0])
    weight[q : q + body.shape[0]] = np.sqrt(body[:, 1])
    if couples is not None:
        weigh_couples(weight, q + body.shape[0], p, wall.shape[0], couples)


@njit(error_model="numpy", fastmath={"contract"})
def _read(r, contacts, pair, wall, grain, body, couples):
    """Impulses, then velocities, into ``r``: these are linear in those, so that both are extrapolated alike."""
    _collect(r, pair, wall, body)
    if couples is not None:
        p, w = pair.shape[0], wall.shape[0]
        put_couples(r, 3 * (p + w) + body.shape[0], p, w, couples)
    q = contacts
    for i in range(grain.shape[0]):
        r[q], r[q + 1], r[q + 2] = grain[i, VX], grain[i, VY], grain[i, VZ]
        r[q + 3], r[q + 4], r[q + 5] = grain[i, PX], grain[i, PY], grain[i, PZ]
        q += 6
    for b in range(body.shape[0]):
        r[q + b] = body[b, SPEED]


@njit(error_model="numpy", fastmath={"contract"})
def _write(r, contacts, pair, wall, grain, body, couples):
    """The inverse of `_read`."""
    _spread(r, pair, wall, body)
    if couples is not None:
        p, w = pair.shape[0], wall.shape[0]
        take_couples(r, 3 * (p + w) + body.shape[0], p, w, couples)
    q = contacts
    for i in range(grain.shape[0]):
        grain[i, VX], grain[i, VY], grain[i, VZ] = r[q], r[q + 1], r[q + 2]
        grain[i, PX], grain[i, PY], grain[i, PZ] = r[q + 3], r[q + 4], r[q + 5]
        q += 6
    for b in range(body.shape[0]):
        body[b, SPEED] = r[q + b]


@njit(error_model="numpy", fastmath={"contract"})
def _collect(r, pair, wall, body):
    p, w = pair.shape[0], wall.shape[0]
    for k in range(p):
        r[3 * k], r[3 * k + 1], r[3 * k + 2] = pair[k, RX], pair[k, RX + 1], pair[k, RX + 2]
    for k in range(w):
        q = 3 * (p + k)
        r[q], r[q + 1], r[q + 2] = wall[k, RX], wall[k, RX + 1], wall[k, RX + 2]
    for b in range(body.shape[0]):
        r[3 * (p + w) + b] = body[b, BRAKE]


@njit(error_model="numpy", fastmath={"contract"})
def _spread(r, pair, wall, body):
    p, w = pair.shape[0], wall.shape[0]
    for k in range(p):
        pair[k, RX], pair[k, RX + 1], pair[k, RX + 2] = r[3 * k], r[3 * k + 1], r[3 * k + 2]
    for k in range(w):
        q = 3 * (p + k)
        wall[k, RX], wall[k, RX + 1], wall[k, RX + 2] = r[q], r[q + 1], r[q + 2]
    for b in range(body.shape[0]):
        body[b, BRAKE] = r[3 * (p + w) + b]


@njit(error_model="numpy", fastmath={"contract"})
def _dot(a, b):
    """Sum of products in eight partial sums: a fixed order that the processor can still do side by side."""
    s0 = s1 = s2 = s3 = s4 = s5 = s6 = s7 = 0.0
    whole = 8 * (a.shape[0] // 8)
    for k in range(0, whole, 8):
        s0 += a[k] * b[k]
        s1 += a[k + 1] * b[k + 1]
        s2 += a[k + 2] * b[k + 2]
        s3 += a[k + 3] * b[k + 3]
        s4 += a[k + 4] * b[k + 4]
        s5 += a[k + 5] * b[k + 5]
        s6 += a[k + 6] * b[k + 6]
        s7 += a[k + 7] * b[k + 7]
    for k in range(whole, a.shape[0]):
        s0 += a[k] * b[k]
    return ((s0 + s1) + (s2 + s3)) + ((s4 + s5) + (s6 + s7))


@njit(error_model="numpy", fastmath={"contract"})
def _largest(c, n):
    worst = 0.0
    for q in range(n):
        worst = max(worst, abs(c[q]))
    return worst


@njit(error_model="numpy", fastmath={"contract"})
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


def _entries(stamp: int):
    """`solve` and `anderson` for calls from Python; ``stamp`` stands in their cache keys (`particles.kernel_stamp`)."""

    @njit(cache=True, error_model="numpy", fastmath={"contract"})
    def solve_records(
        convex, relax, soft, method, tolerance, cap, grain, body, pair_index, pair, wall_index, wall, couples=None
    ):
        if stamp == 0:
            return 0, np.inf, 0
        return solve(
            convex, relax, soft, method, tolerance, cap, grain, body, pair_index, pair, wall_index, wall, couples
        )

    @njit(cache=True, error_model="numpy", fastmath={"contract"})
    def accelerate_records(convex, relax, soft, tolerance, cap, grain, body, pair_index, pair, wall_index, wall):
        if stamp == 0:
            return 0, np.inf
        return anderson(convex, relax, soft, tolerance, cap, grain, body, pair_index, pair, wall_index, wall)

    return solve_records, accelerate_records


solve_records, accelerate_records = _entries(kernel_stamp())
