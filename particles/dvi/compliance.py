r"""Compliant contacts: springs and dashpots taken implicitly, so that a jam has finite forces.

Between perfectly rigid bodies that are driven against each other a grain has no finite force, and in a packing with
more contacts than it needs the forces are not unique. With the stiffness k of the scene both are (unique: in tests
at a friction of 0.3), and the step may still be longer than the contact time pi sqrt(m/k).

**Normal.** Over a step h an overlap delta becomes delta - h u_n', and the impulse is

    r_n = h k delta - m K u_n',        i.e.    u_n' + c (r_n - h k delta) = 0,        c = 1/(m K),        1/m = w_n,

where K says how far into the step the spring is taken, and what its dashpot takes: the step's matrix for a pair alone
has the determinant 1/(1 + K). For short steps K = 2 zeta sqrt(a), a = k h^2/m, is the dashpot of `LinearContact`. K is
calibrated (`calibrated`): a binary impact has the restitution e, in the mean over where in the step it begins. It is

* no less than a/4, below which some impacts make energy, nor than a - 2 sqrt(a), from which on the eigenvalues of the
  step are complex, none rings, and both are less than 1/(sqrt(a) - 1);
* no less than a/2 - 2/mu, mu = 4: groups vibrate faster than pairs, with mu times a and K, and a mode of a smaller K
  grows from step to step. A straight chain has mu = 2, a dense crystal 4 (8 k/m against a pair's 2 k/m);
* no more than a + 2 sqrt(a): backward Euler with critical damping.

Steps longer than about 0.45 contact times lose more than e says by the first rule; there Newton's restitution acts at
the first touch.

**Tangential.** Backward Euler: h k_t xi' = h k_t xi + h^2 k_t u_t' is the impulse itself as long as it sticks,

    u_t' + c_t (r_t' - r_t) = 0,        c_t = 1/(k_t h^2),

so that the impulses of the step before, which start the sweeps, are the springs' memory as well; dashpots are left out.

In the laws of contact, u + o + C r' takes the place of u: a slip then is the plastic part of the sliding. As k grows it
becomes the rigid law; as h shrinks, the springs, dashpots and sliders of `particles.laws.linear`.
"""

from __future__ import annotations

from functools import cache

import numpy as np

from geometry.kernels.device_functions import device_function
from particles.dvi.gauss_seidel import (
    DASHPOT,
    EX,
    EY,
    EZ,
    GAP,
    IWN,
    IWT,
    MET,
    RX,
    RY,
    RZ,
    SHARES,
    STIFFNESS,
    TANGENTIAL,
    B,
)
from particles.laws.restitution import damping_ratio

FIRST_ROOT, PER_OCTAVE, OCTAVES = 0.0625, 8, 9
ROOTS = FIRST_ROOT * 2.0 ** (np.arange(OCTAVES * PER_OCTAVE + 1) / PER_OCTAVE)
HARD = 0.001  # c_n/w_n of a contact that rebounds by Newton's law: hard, yet finite where it jams
STIFFEST_MODE = 4.0
"""Largest eigenvalue of the contacts' masses in a packing, over that of a pair alone: a dense crystal's."""
MIN_RESTITUTION = 1e-3  # for which the dashpot is critical already
PHASES = (np.arange(16) + 0.5) / 16.0  # of the first gap, in ways of a step


def spring_table(dt: float, stiffness: np.ndarray, restitution: np.ndarray) -> np.ndarray:
    """Return tables for `set_springs`, between grains and at walls, (2, SHARES + n): log K at sqrt(a) of `ROOTS` (n,).

    Parameters
    ----------
    dt : float
        Step [s].
    stiffness : ndarray, shape (2, 2)
        k_n and k_t [N/m] between grains, at walls.
    restitution : ndarray, shape (2,)
        Between grains, at walls [-].

    Raises
    ------
    ValueError
        If a stiffness is not more than 0.
    """
    springs = np.array(stiffness, dtype=float)
    if springs.shape != (2, 2) or not (np.isfinite(springs).all() and (springs > 0.0).all()):
        raise ValueError(
            f"stiffness = {stiffness} N/m; allowed: [[k_n, k_t] between grains, [k_n, k_t] at walls], each more than 0"
        )
    rows = []
    for (k_n, k_t), e in zip(springs, restitution, strict=True):
        fraction, met = _calibrated_roots(float(e))
        limit = ROOTS[met].max() if met.any() else 0.0
        dashpot = 2.0 * min(damping_ratio(max(float(e), MIN_RESTITUTION)), 1.0)
        rows.append(np.concatenate([[k_n, 1.0 / (k_t * dt * dt), limit, dashpot], np.log(fraction)]))
    return np.array(rows)


@cache
def _calibrated_roots(restitution: float) -> tuple[np.ndarray, np.ndarray]:
    """`calibrated` at `ROOTS`, which takes a tenth of a second."""
    return calibrated(ROOTS, restitution)


def calibrated(root: np.ndarray, restitution: float) -> tuple[np.ndarray, np.ndarray]:
    """K for sqrt(a) = ``root`` (n,), and whether binary impacts have ``restitution`` with it, by bisection."""
    a = root * root
    least, most = np.maximum.reduce([0.25 * a, 0.5 * a - 2.0 / STIFFEST_MODE, root * (root - 2.0)]), root * (root + 2.0)
    low, high = least.copy(), most.copy()
    for _ in range(40):
        middle = np.sqrt(low * high)
        bouncy = rebound(root, middle).mean(axis=0) > restitution
        low, high = np.where(bouncy, middle, low), np.where(bouncy, high, middle)
    return high, rebound(root, least).mean(axis=0) >= restitution


def rebound(root: np.ndarray, fraction: np.ndarray) -> np.ndarray:
    """Restitution of binary impacts that begin at each of `PHASES`, shape (16, n)."""
    a, c = root * root, 1.0 / fraction
    gap = np.repeat(PHASES[:, None], len(root), axis=1)  # in ways of a step
    speed = -np.ones_like(gap)
    for _ in range(int(2.0 * np.pi / root.min()) + 12):
        impulse = np.maximum(0.0, -(speed + np.where(gap > 0.0, 1.0, a * c) * gap) / (1.0 + c))
        speed = speed + impulse
        gap = gap + speed
    return speed


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def implicit_fraction(root, row):
    """K for sqrt(a) = ``root`` from a row of the table."""
    if root <= FIRST_ROOT:
        beyond = np.exp(row[SHARES]) - row[DASHPOT] * FIRST_ROOT
        return row[DASHPOT] * root + beyond * (root / FIRST_ROOT) ** 2
    x = PER_OCTAVE * np.log2(root / FIRST_ROOT)
    k = int(x)
    if k >= PER_OCTAVE * OCTAVES:
        return root * (root - 2.0)
    return np.exp(row[SHARES + k] + (x - k) * (row[SHARES + k + 1] - row[SHARES + k]))


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def set_springs(h, compliance, kind, gap, row, offset):
    """Put springs into a contact's row, which holds its geometry, masses and the impulse of the step before.

    Returns c_n/w_n where Newton's restitution may act, -1 elsewhere. ``offset``: column of the tangential offset.
    """
    w_n, c_t = 1.0 / row[IWN], compliance[kind, TANGENTIAL]
    root = h * np.sqrt(compliance[kind, STIFFNESS] * w_n)
    fraction = implicit_fraction(root, compliance[kind])
    c_n = w_n / fraction
    row[IWN] = 1.0 / (w_n + c_n)
    row[IWT] = 1.0 / (1.0 / row[IWT] + c_t)
    r_n = row[RX] * row[EX] + row[RY] * row[EY] + row[RZ] * row[EZ]
    row[GAP], row[B] = gap, gap / h
    row[offset] = row[offset + 1] = row[offset + 2] = 0.0
    row[offset + 3] = c_n
    if gap <= 0.0:
        row[B] = root * root / fraction * gap / h
        row[offset] = -c_t * (row[RX] - r_n * row[EX])
        row[offset + 1] = -c_t * (row[RY] - r_n * row[EY])
        row[offset + 2] = -c_t * (row[RZ] - r_n * row[EZ])
    return -1.0 if root <= compliance[kind, MET] or (gap <= 0.0 and r_n > 0.0) else 1.0 / fraction


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def apply_restitution(e, before, give, row, offset):
    """Put Newton's restitution into a contact that `set_springs` has filled, with c_n/w_n = ``give``.

    ``before`` is u_n [m/s].

    That law is a rigid one: it would rebound from each of several contacts as if it were alone, to the compliance's
    fraction of the impulse. So c_n falls to `HARD` for this step; a grain alone rebounds at e exactly.
    """
    hard = min(give, HARD)
    w_n = 1.0 / (row[IWN] * (1.0 + give))
    row[IWN] = 1.0 / (w_n * (1.0 + hard))
    row[offset + 3] = w_n * hard
    row[B] = hard_restitution(e, hard) * before


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def hard_restitution(e, hard):
    """Restitution of a rigid contact [-] that gives e at the compliance ``hard``; no more than 1, lest it make energy.

    A grain alone rebounds at e, beyond e = (1 - hard)/(1 + hard) at this.
    """
    return min(e + (1.0 + e) * hard, 1.0)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def spring_energy(compliance, kind, gap, x, y, z, ex, ey, ez):
    """Energy [J] in the normal spring at ``gap`` [m], and in the tangential one that carries the impulse (x, y, z)."""
    r_n = x * ex + y * ey + z * ez
    t2 = x * x + y * y + z * z - r_n * r_n
    depth = min(gap, 0.0)
    return 0.5 * compliance[kind, STIFFNESS] * depth * depth, 0.5 * compliance[kind, TANGENTIAL] * max(t2, 0.0)
