"""Accelerated projected gradients (APGD) for the convex law: the solver that Project Chrono offers beside PSOR.

The impulses minimise the energy of the motion that they leave,

    f(r) = 1/2 |v|_M^2 + b.r_n,     v = v_free + M^-1 H r,     r in K,

a convex quadratic whose gradient is the relative velocity (b added to its normal part). Nesterov's method with a step
length that backtracks and is lengthened again, and a restart whenever a step turns against the momentum (Mazhar,
Heyn, Negrut & Tasora, ACM Trans. Graph. 34 (2015) 32; O'Donoghue & Candes, Found. Comput. Math. 15 (2015) 715). One
length for all contacts in the metric of w_n, so that light and heavy grains move at the same pace. An iteration costs
about two sweeps and depends on no order of the contacts. The exact Coulomb law has no such energy.
"""

from __future__ import annotations

import numpy as np

from geometry.inner_functions import inner
from particles.dvi.gauss_seidel import (
    ARM,
    BRAKE,
    EX,
    EY,
    EZ,
    IJ,
    IM,
    IWN,
    LX,
    LY,
    MU,
    PX,
    PY,
    PZ,
    RX,
    SPEED,
    VX,
    VY,
    VZ,
    B,
    apply_impulses,
    residual,
    sweep_loads,
)
from particles.dvi.kernel_state import Records, whole
from particles.dvi.local_problem import on_cone

FIRST_LENGTH = 0.25  # of 1/w_n
LONGER = 1.1  # growth of the step length after an iteration that needed no shorter one
CHECK = 10  # iterations between two looks at the natural map


@inner(error_model="numpy", fastmath={"contract"})
def apgd(tolerance, cap, records):
    """Up to ``cap`` iterations from the impulses in the records; returns their number and the residual [m/s].

    The load of a free shaft is swept once an iteration, between the gradient steps.
    """
    pair, wall, body = records.pair, records.wall, records.body
    p, w = pair.shape[0], wall.shape[0]
    size = 3 * (p + w) + body.shape[0]
    free, free_body = records.grain.copy(), body.copy()
    apply_impulses(-1.0, Records(free, free_body, records.pair_index, pair, records.wall_index, wall))
    r, y, new, slope, best = np.empty(size), np.empty(size), np.empty(size), np.zeros(size), np.empty(size)
    weight = np.zeros(size)
    for k in range(p):
        weight[3 * k : 3 * k + 3] = 1.0 / pair[k, IWN]
    for k in range(w):
        weight[3 * (p + k) : 3 * (p + k) + 3] = 1.0 / wall[k, IWN]
    _collect(r, records)
    y[:], best[:] = r, r
    reached = residual(whole(records), True, None, records)
    length, theta, count = FIRST_LENGTH, 1.0, 0
    while count < cap and reached > tolerance:
        # the energy at y, and its gradient
        at_y = _put(y, free, free_body, records)
        _gradient(slope, records)
        shorter = False
        while True:
            _step(new, y, slope, length, records)
            at_new = _put(new, free, free_body, records)
            model = at_y
            for q in range(size):
                d = new[q] - y[q]
                model += d * (slope[q] + 0.5 * weight[q] * d / length)
            # round-off of the energies must not shorten the step for ever
            if at_new <= model + 1e-14 * abs(at_y) or length < 1e-6:
                break
            length, shorter = 0.5 * length, True
        count += 1
        turn = 0.0
        for q in range(size):
            turn += weight[q] * (y[q] - new[q]) * (new[q] - r[q])
        ahead = 0.5 * (1.0 + np.sqrt(1.0 + 4.0 * theta * theta))
        momentum = (theta - 1.0) / ahead
        theta = ahead
        if turn > 0.0:
            momentum, theta = 0.0, 1.0
        for q in range(size):
            y[q] = new[q] + momentum * (new[q] - r[q])
        r[:] = new
        if not shorter:
            length = min(LONGER * length, 1.0)
        _swept_loads(r, y, body)
        if count % CHECK == 0 or count == cap:
            now = residual(whole(records), True, None, records)
            if now < reached:
                reached = now
                _collect(best, records)
    _put(best, free, free_body, records)
    return count, residual(whole(records), True, None, records)


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def _swept_loads(r, y, body):
    """One visit to the loads; their impulses stand behind those of the contacts."""
    first = r.shape[0] - body.shape[0]
    sweep_loads(body)
    for b in range(body.shape[0]):
        r[first + b] = y[first + b] = body[b, BRAKE]


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def _collect(r, records):
    """Impulses of pairs and walls, then of the loads, from the records into r."""
    pair, wall, body = records.pair, records.wall, records.body
    p, w = pair.shape[0], wall.shape[0]
    for k in range(p):
        r[3 * k], r[3 * k + 1], r[3 * k + 2] = pair[k, RX], pair[k, RX + 1], pair[k, RX + 2]
    for k in range(w):
        q = 3 * (p + k)
        r[q], r[q + 1], r[q + 2] = wall[k, RX], wall[k, RX + 1], wall[k, RX + 2]
    for b in range(body.shape[0]):
        r[3 * (p + w) + b] = body[b, BRAKE]


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def _spread(r, records):
    """The inverse of `_collect`."""
    pair, wall, body = records.pair, records.wall, records.body
    p, w = pair.shape[0], wall.shape[0]
    for k in range(p):
        pair[k, RX], pair[k, RX + 1], pair[k, RX + 2] = r[3 * k], r[3 * k + 1], r[3 * k + 2]
    for k in range(w):
        q = 3 * (p + k)
        wall[k, RX], wall[k, RX + 1], wall[k, RX + 2] = r[q], r[q + 1], r[q + 2]
    for b in range(body.shape[0]):
        body[b, BRAKE] = r[3 * (p + w) + b]


@inner(error_model="numpy", fastmath={"contract"})
def _put(r, free, free_body, records):
    """Write impulses into the records, velocities to match; returns the energy [J] less that of resting grains."""
    grain, body, _, pair, wall_index, wall = records
    grain[:], body[:, SPEED] = free, free_body[:, SPEED]
    _spread(r, records)
    apply_impulses(1.0, records)
    energy = 0.0
    for i in range(grain.shape[0]):
        linear = grain[i, VX] ** 2 + grain[i, VY] ** 2 + grain[i, VZ] ** 2
        spin = grain[i, PX] ** 2 + grain[i, PY] ** 2 + grain[i, PZ] ** 2
        energy += 0.5 * (linear + 0.4 * spin) / grain[i, IM]
    for b in range(body.shape[0]):
        if body[b, IJ] > 0.0:
            energy += 0.5 * body[b, SPEED] ** 2 / body[b, IJ]
    for k in range(pair.shape[0]):
        energy += pair[k, B] * (
            pair[k, RX] * pair[k, EX] + pair[k, RX + 1] * pair[k, EY] + pair[k, RX + 2] * pair[k, EZ]
        )
    for k in range(wall.shape[0]):
        r_n = wall[k, RX] * wall[k, EX] + wall[k, RX + 1] * wall[k, EY] + wall[k, RX + 2] * wall[k, EZ]
        energy += wall[k, B] * r_n
        b = wall_index[k, 1]
        if body[b, IJ] == 0.0:  # work on a prescribed wall
            energy -= body[b, SPEED] * (wall[k, LX] * wall[k, RX] + wall[k, LY] * wall[k, RX + 1])
    return energy


@inner(borrows=True, error_model="numpy", fastmath={"contract"})
def _gradient(slope, records):
    """Relative velocity of every contact, b added along its normal."""
    grain, body, pair_index, pair, wall_index, wall = records
    for k in range(pair.shape[0]):
        i, j = pair_index[k, 0], pair_index[k, 1]
        ex, ey, ez, arm = pair[k, EX], pair[k, EY], pair[k, EZ], pair[k, ARM]
        sx, sy, sz = grain[i, PX] + grain[j, PX], grain[i, PY] + grain[j, PY], grain[i, PZ] + grain[j, PZ]
        slope[3 * k] = grain[i, VX] - grain[j, VX] - arm * (sy * ez - sz * ey) + pair[k, B] * ex
        slope[3 * k + 1] = grain[i, VY] - grain[j, VY] - arm * (sz * ex - sx * ez) + pair[k, B] * ey
        slope[3 * k + 2] = grain[i, VZ] - grain[j, VZ] - arm * (sx * ey - sy * ex) + pair[k, B] * ez
    for k in range(wall.shape[0]):
        i, b, q = wall_index[k, 0], wall_index[k, 1], 3 * (pair.shape[0] + k)
        ex, ey, ez, arm = wall[k, EX], wall[k, EY], wall[k, EZ], wall[k, ARM]
        omega = body[b, SPEED]
        sx, sy, sz = grain[i, PX], grain[i, PY], grain[i, PZ]
        slope[q] = grain[i, VX] - omega * wall[k, LX] - arm * (sy * ez - sz * ey) + wall[k, B] * ex
        slope[q + 1] = grain[i, VY] - omega * wall[k, LY] - arm * (sz * ex - sx * ez) + wall[k, B] * ey
        slope[q + 2] = grain[i, VZ] - arm * (sx * ey - sy * ex) + wall[k, B] * ez


@inner(error_model="numpy", fastmath={"contract"})
def _step(new, y, slope, length, records):
    """A gradient step of ``length``/w_n for each contact, put back into its cone."""
    pair, wall = records.pair, records.wall
    p = pair.shape[0]
    new[:] = y
    for k in range(p + wall.shape[0]):
        row = pair[k] if k < p else wall[k - p]
        q, a = 3 * k, length * row[IWN]
        x, z = y[q] - a * slope[q], y[q + 2] - a * slope[q + 2]
        s = y[q + 1] - a * slope[q + 1]
        n = x * row[EX] + s * row[EY] + z * row[EZ]
        tx, ty, tz = x - n * row[EX], s - n * row[EY], z - n * row[EZ]
        size = np.sqrt(tx * tx + ty * ty + tz * tz)
        n, t = on_cone(row[MU], n, size)
        scale = t / size if size > 0.0 else 0.0
        new[q] = n * row[EX] + scale * tx
        new[q + 1] = n * row[EY] + scale * ty
        new[q + 2] = n * row[EZ] + scale * tz
