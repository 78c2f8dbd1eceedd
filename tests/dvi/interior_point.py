"""Interior point, the oracle of contact problems on which sweeps stall: dense packings, cold starts, tight tolerances.

The convex law is a second-order cone programme in the velocities,

    min 1/2 (v - v_free)' M (v - v_free)   subject to   A v + b in K*,

whose multipliers are the impulses. It is solved by a primal-dual predictor-corrector method with Nesterov-Todd scaling
(Andersen, Roos & Terlaky, Math. Program. 95 (2003) 249; Vandenberghe, The CVXOPT linear and quadratic cone program
solvers, 2010): 20 to 35 sparse factorisations of M + A' W^-2 A, with 6 unknowns a grain, whatever the conditioning of
the packing and also where impulses are not unique.

Exact Coulomb is the convex law with the normal velocities shifted by s = mu |u_t| of the solution itself (De Saxce &
Feng, Math. Comput. Model. 28 (1998) 225). At rest s = 0 and one programme is enough. Iterating s (Cadoux's fixed
point; Acary, Cadoux, Lemarechal & Malick, ZAMM 91 (2011) 155) is no contraction where much slides: in a bed that shears
it goes round at 1e-3 of the sliding speeds, however exact the programmes. The second trial therefore linearises s
within the programme, which makes its matrix unsymmetric; of the steps on which sweeps stall it solved three of eight
tried, and from the others iterated shifts continue. Each trial starts accelerated sweeps, which finish as soon as the
contacts' states are right. Where the trials run out the best impulses met, those at the start included, are kept.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

from particles.dvi.accelerated import accelerate_records
from particles.dvi.gauss_seidel import (
    ARM,
    BRAKE,
    EX,
    IJ,
    IM,
    IWN,
    LX,
    LY,
    MU,
    PX,
    RX,
    SPEED,
    VX,
    B,
    apply_records,
    residual_records,
)  # fmt: skip

TRIALS = 6  # updates of the shift
POLISH = 300  # accelerated sweeps after each
CENTRING = 0.1  # least share of the gap that an iteration with a linearised shift aims at
MIN_FRICTION = 1e-6  # the cone of a frictionless contact has no inside


@dataclass(frozen=True, slots=True)
class ConeProblem:
    """Sparse form of a contact problem with m contacts and k velocities (six a grain, then the free shafts).

    Attributes
    ----------
    relative : csr_matrix, shape (3 m, k)
        u = relative v: normal and two tangential velocities of each contact [m/s].
    mass : ndarray, shape (k,)
        M: mass [kg] for velocities and scaled spins, inertia [kg m^2] for shafts.
    free : ndarray, shape (k,)
        v_free.
    offset, friction, inverse_mass : ndarray, shape (m,)
        b [m/s], mu [-] and w_n [1/kg].
    frame : ndarray, shape (m, 3, 3)
        Rows: normal and two tangents in world axes.
    """

    relative: sp.csr_matrix
    mass: np.ndarray
    free: np.ndarray
    offset: np.ndarray
    friction: np.ndarray
    inverse_mass: np.ndarray
    frame: np.ndarray


def cone_problem(
    grain: np.ndarray, body: np.ndarray, pair_index: np.ndarray, pair: np.ndarray, wall_index: np.ndarray,
    wall: np.ndarray,
) -> ConeProblem:  # fmt: skip
    """Build it from the records of `particles.dvi.gauss_seidel`; ``grain`` and ``body`` hold free velocities."""
    n = len(grain)
    free_bodies = np.flatnonzero(body[:, IJ] > 0.0)
    column = np.full(len(body), -1)
    column[free_bodies] = 6 * n + np.arange(len(free_bodies))
    rows, columns, values = [], [], []

    def add(contact: np.ndarray, first: np.ndarray, block: np.ndarray) -> None:
        rows.append(np.broadcast_to(3 * contact[:, None, None] + np.arange(3)[:, None], block.shape).ravel())
        columns.append(
            np.broadcast_to(first[:, None, None] + np.arange(block.shape[2])[None, None], block.shape).ravel()
        )
        values.append(block.ravel())

    frame = np.concatenate([_frames(pair[:, EX : EX + 3]), _frames(wall[:, EX : EX + 3])])
    p, m = len(pair), len(pair) + len(wall)
    offset, friction, inverse_mass = (np.concatenate([pair[:, c], wall[:, c]]) for c in (B, MU, IWN))
    moving = np.zeros((m, 3))  # velocity of prescribed walls in the contact's frame
    for index, row, first, between in ((pair_index, pair, 0, True), (wall_index, wall, p, False)):
        k = first + np.arange(len(row))
        f = frame[k]
        spin = -row[:, ARM, None, None] * np.cross(row[:, None, EX : EX + 3], f)
        i = 6 * index[:, 0].astype(np.int64)
        add(k, i, f)
        add(k, i + 3, spin)
        j = index[:, 1].astype(np.int64)
        if between:
            add(k, 6 * j, -f)
            add(k, 6 * j + 3, spin)
        elif len(row):
            lever = row[:, LX, None] * f[:, :, 0] + row[:, LY, None] * f[:, :, 1]
            here = column[j] >= 0
            add(k[here], column[j[here]], -lever[here][:, :, None])
            moving[k[~here]] = -lever[~here] * body[j[~here], SPEED][:, None]
    shape = (3 * m, 6 * n + len(free_bodies))
    relative = sp.csr_matrix((np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), shape=shape)
    mass = np.concatenate([np.repeat(1.0 / grain[:, IM], 6) * np.tile([1, 1, 1, 0.4, 0.4, 0.4], n),
                           1.0 / body[free_bodies, IJ]])  # fmt: skip
    free = np.concatenate([grain[:, [VX, VX + 1, VX + 2, PX, PX + 1, PX + 2]].ravel(), body[free_bodies, SPEED]])
    return ConeProblem(
        relative, mass, free, np.stack([offset, 0 * offset, 0 * offset], axis=1) + moving,
        np.maximum(friction, MIN_FRICTION), 1.0 / inverse_mass, frame,
    )  # fmt: skip


def solve_by_interior_point(
    convex: bool | None, tolerance: float, grain: np.ndarray, body: np.ndarray, pair_index: np.ndarray,
    pair: np.ndarray, wall_index: np.ndarray, wall: np.ndarray, trials: int = TRIALS,
) -> tuple[int, float]:  # fmt: skip
    """Improve the impulses and velocities in the records to ``tolerance`` [m/s].

    Returns the sweeps done and the honest residual reached, the best one met.
    """
    records = (pair_index, pair, wall_index, wall)
    free, free_body = grain.copy(), body.copy()
    apply_records(-1.0, free, free_body, *records)
    problem = cone_problem(free, free_body, *records)
    shafts = free_body[:, IJ] > 0.0
    unbraked = problem.free.copy()
    shift = np.zeros(len(problem.friction))
    sweeps = 0
    begun = residual_records(convex, None, grain, body, *records)
    best = begun, pair[:, RX : RX + 3].copy(), wall[:, RX : RX + 3].copy(), body[:, BRAKE].copy()
    for trial in range(trials):
        # the load's impulse is held while the programme runs, and swept afterwards
        problem.free[6 * len(grain) :] = unbraked[6 * len(grain) :] - (body[:, IJ] * body[:, BRAKE])[shafts]
        # shifts that are iterated do not settle where much slides; linearised ones mostly do
        impulse, velocity = cone_programme(problem, None if trial == 1 else shift, tolerance)
        world = np.einsum("mi,mij->mj", impulse, problem.frame)
        pair[:, RX : RX + 3], wall[:, RX : RX + 3] = world[: len(pair)], world[len(pair) :]
        grain[:], body[:, SPEED] = free, free_body[:, SPEED]
        apply_records(1.0, grain, body, *records)
        count, reached = accelerate_records(convex, None, tolerance, POLISH, grain, body, *records)
        sweeps += count
        if reached < best[0]:
            best = reached, pair[:, RX : RX + 3].copy(), wall[:, RX : RX + 3].copy(), body[:, BRAKE].copy()
        if reached <= tolerance or convex:
            break
        slip = (problem.relative @ velocity).reshape(-1, 3) + problem.offset
        new = problem.friction * np.linalg.norm(slip[:, 1:], axis=1)
        # under-relaxed later on, where the fixed point may go round in a circle
        shift = new if trial < 4 else 0.5 * (shift + new)
    if reached > best[0]:
        pair[:, RX : RX + 3], wall[:, RX : RX + 3], body[:, BRAKE] = best[1:]
        grain[:], body[:, SPEED] = free, free_body[:, SPEED]
        apply_records(1.0, grain, body, *records)
    return sweeps, best[0]


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # digits run out near the end: seen and stopped at
def cone_programme(problem: ConeProblem, shift: np.ndarray | None, tolerance: float, cap: int = 60):
    """Impulses (m, 3) and velocities (k,) of the convex law with the normal velocities raised by ``shift`` (m,).

    ``shift`` None: by mu |u_t| of the solution itself, linearised in every iteration (exact Coulomb).
    """
    mu, m = problem.friction, len(problem.friction)
    if m == 0:
        return np.zeros((0, 3)), problem.free.copy()
    # the cone r_n >= |r_t|/mu becomes the standard one for z = (mu r_n, r_t) and s = ((u_n + shift)/mu, u_t)
    scale = np.ones((m, 3))
    scale[:, 0] = 1.0 / mu
    a = (sp.diags(scale.ravel()) @ problem.relative).tocsr()
    at = a.T.tocsr()
    base = scale * problem.offset
    offset = base if shift is None else base + (scale[:, 0] * shift)[:, None] * np.array([1.0, 0.0, 0.0])
    least = CENTRING if shift is None else 0.0
    slope, slopes = a, np.broadcast_to(np.eye(3), (m, 3, 3)).copy()
    mass, free = problem.mass, problem.free
    diagonal = sp.diags(mass)
    unit = np.array([1.0, 0.0, 0.0])
    v = free.copy()
    speed = float(np.sqrt(np.sum(mass * free**2) / np.sum(mass))) + tolerance
    s = np.outer(np.full(m, 2.0 * speed), unit)
    z = np.outer(2.0 * speed / problem.inverse_mass, unit)
    places = np.arange(m + 1)
    for _ in range(cap):
        gap = float(np.sum(s * z)) / m
        if shift is None:
            slip = ((a @ v).reshape(-1, 3) + base)[:, 1:]
            # rounded off at a tenth of the speed that the gap stands for
            size = np.sqrt(np.sum(slip**2, axis=1) + 0.01 * gap * np.median(problem.inverse_mass))
            offset = base + size[:, None] * unit
            slopes[:, 0, 1:] = slip / size[:, None]
            slope = (sp.bsr_matrix((slopes, places[:-1], places), shape=(3 * m, 3 * m)) @ a).tocsr()
        miss_s = s - (a @ v).reshape(-1, 3) - offset
        miss_v = mass * (v - free) - at @ z.ravel()
        w, w_inverse = _scaling(s, z)
        lam = None if w is None else _times(w, z)
        # the scaled point leaves the cone when its digits are used up
        if (
            lam is None
            or not np.all(_square_norm(lam) > 0.0)
            or (np.sqrt(gap * np.median(problem.inverse_mass)) < 0.1 * tolerance and np.abs(miss_s).max() < tolerance)
        ):
            break
        square = w_inverse @ w_inverse
        matrix = (diagonal + at @ sp.bsr_matrix((square, places[:-1], places), shape=(3 * m, 3 * m)) @ slope).tocsc()
        try:
            factor = splu(matrix, permc_spec="MMD_AT_PLUS_A", options={"SymmetricMode": True},
                          diag_pivot_thresh=0.01 if shift is None else 0.0)  # fmt: skip
        except RuntimeError:  # the scaling has run out of digits: what is there is as good as it gets
            break

        def direction(target, square=square, w_inverse=w_inverse, factor=factor, miss_s=miss_s, miss_v=miss_v,
                      matrix=matrix, slope=slope):  # fmt: skip
            right = -miss_v + at @ (_times(w_inverse, target) + _times(square, miss_s)).ravel()
            dv = factor.solve(right)
            dv += factor.solve(right - matrix @ dv)
            ds = (slope @ dv).reshape(-1, 3) - miss_s
            return dv, ds, _times(w_inverse, target - _times(w_inverse, ds))

        dv, ds, dz = direction(-lam)
        step = min(1.0, _to_boundary(s, ds), _to_boundary(z, dz))
        both = (
            max((1.0 - step) ** 3, least) * gap * unit
            - _product(lam, lam)
            - _product(_times(w_inverse, ds), _times(w, dz))
        )
        dv, ds, dz = direction(_quotient(lam, both))
        if not (np.isfinite(ds).all() and np.isfinite(dz).all()):
            break
        step = min(1.0, 0.98 * min(_to_boundary(s, ds), _to_boundary(z, dz)))
        if step < 1e-8:
            break
        v, s, z = v + step * dv, s + step * ds, z + step * dz
    return z * scale, v


# Jordan algebra of the cone x_0 >= |(x_1, x_2)|, rows (m, 3)


def _square_norm(x: np.ndarray) -> np.ndarray:
    size = np.hypot(x[:, 1], x[:, 2])
    return (x[:, 0] - size) * (x[:, 0] + size)


def _times(w: np.ndarray, x: np.ndarray) -> np.ndarray:
    return np.einsum("mij,mj->mi", w, x)


def _product(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    return np.concatenate([np.sum(x * y, axis=1)[:, None], x[:, :1] * y[:, 1:] + y[:, :1] * x[:, 1:]], axis=1)


def _quotient(x: np.ndarray, y: np.ndarray) -> np.ndarray:
    """q with `_product` (x, q) = y."""
    first = (x[:, 0] * y[:, 0] - np.sum(x[:, 1:] * y[:, 1:], axis=1)) / _square_norm(x)
    return np.concatenate([first[:, None], (y[:, 1:] - first[:, None] * x[:, 1:]) / x[:, :1]], axis=1)


def _scaling(s: np.ndarray, z: np.ndarray):
    """Nesterov-Todd scaling W and its inverse, (m, 3, 3): W z = W^-1 s. None when a point is outside the cone."""
    ns, nz = _square_norm(s), _square_norm(z)
    if not (np.all(ns > 0.0) and np.all(nz > 0.0) and np.all(s[:, 0] > 0.0) and np.all(z[:, 0] > 0.0)):
        return None, None
    ns, nz = np.sqrt(ns), np.sqrt(nz)
    s, z = s / ns[:, None], z / nz[:, None]
    half = np.sqrt(0.5 * (1.0 + np.sum(s * z, axis=1)))
    w = (s + z * np.array([1.0, -1.0, -1.0])) / (2.0 * half[:, None])
    matrix = np.empty((len(s), 3, 3))
    matrix[:, 0, :] = matrix[:, :, 0] = w
    matrix[:, 1:, 1:] = np.eye(2) + w[:, 1:, None] * w[:, None, 1:] / (1.0 + w[:, 0])[:, None, None]
    inverse = matrix.copy()
    inverse[:, 0, 1:] *= -1.0
    inverse[:, 1:, 0] *= -1.0
    eta = np.sqrt(ns / nz)[:, None, None]
    return matrix * eta, inverse / eta


def _to_boundary(x: np.ndarray, d: np.ndarray) -> float:
    """Largest step along d that keeps every row of x in its cone."""
    a, c = _square_norm(d), _square_norm(x)
    b = x[:, 0] * d[:, 0] - x[:, 1] * d[:, 1] - x[:, 2] * d[:, 2]
    with np.errstate(divide="ignore", invalid="ignore"):
        q = -(b + np.where(b < 0.0, -1.0, 1.0) * np.sqrt(np.maximum(b * b - a * c, 0.0)))
        roots = np.stack([q / a, c / q, np.where(d[:, 0] < 0.0, -x[:, 0] / d[:, 0], np.inf)])
    return float(np.min(np.where((roots > 0.0) & np.isfinite(roots), roots, np.inf)))


def _frames(normal: np.ndarray) -> np.ndarray:
    """Rows normal, tangent, tangent for each unit normal, shape (m, 3, 3)."""
    x, y, z = normal.T
    zero = np.zeros_like(x)
    tangent = np.where((np.abs(x) < 0.6)[:, None], np.stack([zero, z, -y], axis=1), np.stack([-z, zero, x], axis=1))
    tangent /= np.linalg.norm(tangent, axis=1)[:, None]
    return np.stack([normal, tangent, np.cross(normal, tangent)], axis=1)
