"""Energy of magnetised spheres, dense and in plain numpy: what compiled kernels are compared with.

Each sphere i has a dipole m_i = V_i M_i and a charge Q_i at its centre. Over each near pair k = (i, j), n from j to i,
the scalar potential drops by the mmf D_k, and the flux q_k enters at i and leaves at j, so that Q_i = sum of q_k - sum
of q_k of the pairs in which i comes first or second. The energy, with lengths in any unit, fields in Ms, mu_0 = 1,

    W =   sum_i V_i [u(M_i) - M_i.H] + Q_i^2/(8 pi a_i)
        + sum over pairs {c2 m_i.m_j - c1 (m_i.n)(m_j.n) + p [(m_j.n) Q_i - (m_i.n) Q_j] + psi Q_i Q_j}/(4 pi)
        + sum_k {w(g_k, D_k, s_k) + q_k D_k - q_k r_k.H}
        - sum_k kappa(g_k) c_i c_j m_i'.m_j'/(4 pi r_k^3)                            (' the part across n)

is stationary in M, D and q; forces are -dW/dx at fixed M, D, q. In open space psi = 1/r, p = c2 r = c1 r/3 = 1/r^2;
with a reach A, the macroscopic field H contains the smear of each dipole and charge over a sphere of that radius, and
they are without it (`kernels`). The neck's energy and capacity s are those of `field.spheres.neck_energy` with the
length a_ij = 2 a_i a_j/(a_i + a_j), w = a_ij^3 w^(g/a_ij, D/a_ij, s).

A pair may be one with an image: the displacement r = x_i - x_j is given, and i may be j.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from field import GrainLaw
from field.spheres.neck_energy import neck_energy
from field.spheres.pair_table import FADE_TO
from field.spheres.transverse_pair import transverse_fraction

PI4 = 4.0 * np.pi


class State(NamedTuple):
    """Unknowns: magnetisation of the dipoles (n, 3) [Ms], mmfs (k,) and fluxes (k,) of the near pairs."""

    M: np.ndarray
    D: np.ndarray
    q: np.ndarray


class Kernels(NamedTuple):
    """Factors of the interactions of each pair (p,) and their derivatives over the distance."""

    psi: np.ndarray
    p: np.ndarray
    c1: np.ndarray
    c2: np.ndarray
    dc1: np.ndarray
    dc2: np.ndarray


def kernels(r: np.ndarray, reach: float) -> Kernels:
    """See the module; `reach` infinite: open space."""
    x = r / reach
    rest = 1.0 - x**2
    outside = 1.0 - (35.0 * x**3 - 42.0 * x**5 + 15.0 * x**7) / 8.0  # fraction of a smear beyond r
    smear, dsmear = 105.0 / (8.0 * reach**3) * rest**2, -105.0 / (2.0 * reach**4) * x * rest
    c2, dc2 = outside / r**3, -smear / r - 3.0 * outside / r**4
    psi = 1.0 / r - (19.0 - 35.0 * x**2 + 21.0 * x**4 - 5.0 * x**6) / (16.0 * reach) - 1.0 / reach
    return Kernels(psi, outside / r**2, 3.0 * c2 + smear, c2, 3.0 * dc2 + dsmear, dc2)


def _dot(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.einsum("...a,...a->...", a, b)


@dataclass(frozen=True)
class Solution:
    """Stationary state of a `DenseEnergy`.

    Attributes
    ----------
    state : State
    moment : ndarray (n, 3)
        m and of each neck's q r the part a_i/(a_i + a_j), from the centre to the neck.
    force : ndarray (n, 3)
    virial : ndarray (3, 3)
        -sum of F r over all pairs; over the volume of a cell it is the stress, tension > 0, without that of the smear.
    residual : float
        Largest change [Ms] of a magnetisation, and of an mmf over the length of its pair, by a whole sweep.
    sweeps : int
    """

    state: State
    moment: np.ndarray
    force: np.ndarray
    virial: np.ndarray
    residual: float
    sweeps: int


class DenseEnergy:
    """Spheres of Froehlich's law that are near or far from each other.

    Parameters
    ----------
    radius : ndarray (n,)
    first, second : ndarray (p,) of int
        The grains i and j of each pair, each pair once.
    r : ndarray (p, 3)
        x_i - x_j.
    chi : float
    H : array_like (3,)
        Applied field, or the macroscopic one with a finite reach [Ms].
    reach : float
        Radius of the smear that H holds.
    odd : bool
        Transverse part from multipoles of odd orders.
    """

    def __init__(self, radius, first, second, r, chi, H, *, reach=np.inf, odd=True):
        self.a, self.i, self.j, self.r = np.asarray(radius, float), np.asarray(first), np.asarray(second), np.asarray(r)
        self.chi, self.H, self.reach = chi, np.asarray(H, float), reach
        self.V = PI4 / 3.0 * self.a**3
        self.d = np.linalg.norm(self.r, axis=1)
        self.n = self.r / self.d[:, None]
        self.of = kernels(self.d, reach)
        length = 2.0 * self.a[self.i] * self.a[self.j] / (self.a[self.i] + self.a[self.j])
        g = (self.d - self.a[self.i] - self.a[self.j]) / length
        self.near = np.flatnonzero(g < FADE_TO)
        k = self.near
        self.ni, self.nj, self.nn, self.nd = self.i[k], self.j[k], self.n[k], self.d[k]
        self.length, self.gap = length[k], g[k]
        self.table = neck_energy(GrainLaw(chi, 1.7e6))
        self.sphere = GrainLaw(chi, 1.0)
        kappa, slope = transverse_fraction(self.gap, odd=odd)
        self.across, self.across_slope = kappa / self.nd**3, (slope / self.length - 3.0 * kappa / self.nd) / self.nd**3

    # parts

    def charges(self, q: np.ndarray) -> np.ndarray:
        """Q (n,)."""
        Q = np.zeros(len(self.a))
        np.add.at(Q, self.ni, q)
        np.add.at(Q, self.nj, -q)
        return Q

    def capacity(self, M: np.ndarray, D: np.ndarray) -> np.ndarray:
        """s (k,)."""
        return 1.0 - 0.5 * np.sign(D) * _dot(M[self.ni] + M[self.nj], self.nn)

    def neck(self, M: np.ndarray, D: np.ndarray):
        """State of the necks, w and its derivatives in this model's lengths."""
        s = self.capacity(M, D)
        at, b = self.table.at(self.gap, D / self.length, s), self.length
        return at._replace(
            w=at.w * b**3,
            q=at.q * b**2,
            w_s=at.w_s * b**3,
            w_g=at.w_g * b**2,
            dq_dD=at.dq_dD * b,
            dq_ds=at.dq_ds * b**2,
        )

    def response(self, M: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """c (n,) and dc/dM (n, 3)."""
        size = np.linalg.norm(M, axis=1)
        left = 1.0 - size
        A, B = 1.0 + 3.0 / (self.chi * left), 1.0 + 3.0 / (self.chi * left**2)
        c = (A * B) ** -0.6
        slope = -0.6 * c * (3.0 / (self.chi * left**2) / A + 6.0 / (self.chi * left**3) / B)
        return c, slope[:, None] * M / np.maximum(size, 1e-300)[:, None]

    def energy(self, state: State) -> float:
        """W; see the module."""
        M, D, q = state
        i, j, n, of = self.i, self.j, self.n, self.of
        m, Q, size = self.V[:, None] * M, self.charges(q), np.linalg.norm(M, axis=1)
        W = float(self.V @ (size**2 / 6.0 - (size + np.log1p(-size)) / self.chi)) - float((m @ self.H).sum())
        W += float((Q**2 / self.a).sum()) / (2.0 * PI4)
        if np.isfinite(self.reach):  # what each has of its own smear
            own = 35.0 / (8.0 * self.reach**3) * (m**2).sum() + 35.0 / (16.0 * self.reach) * (Q**2).sum()
            W -= float(own) / (2.0 * PI4)
        m_i, m_j = _dot(m[i], n), _dot(m[j], n)
        pairs = of.c2 * _dot(m[i], m[j]) - of.c1 * m_i * m_j + of.p * (m_j * Q[i] - m_i * Q[j]) + of.psi * Q[i] * Q[j]
        W += float(pairs.sum()) / PI4
        W += float((self.neck(M, D).w + q * D - q * self.nd * (self.nn @ self.H)).sum())
        c = self.response(M)[0]
        return W - float((self.across * c[self.ni] * c[self.nj] * self._across(m)).sum()) / PI4

    def _across(self, m: np.ndarray) -> np.ndarray:
        i, j, n = self.ni, self.nj, self.nn
        return _dot(m[i], m[j]) - _dot(m[i], n) * _dot(m[j], n)

    # stationary

    def field(self, M: np.ndarray, Q: np.ndarray) -> np.ndarray:
        """S (n, 3), the field of everything at each centre."""
        i, j, n, of = self.i, self.j, self.n, self.of
        m, S = self.V[:, None] * M, np.broadcast_to(self.H, M.shape).copy()
        for here, there, sign in ((i, j, 1.0), (j, i, -1.0)):
            field = (of.c1 * _dot(m[there], n))[:, None] * n - of.c2[:, None] * m[there]
            np.add.at(S, here, (field + sign * (of.p * Q[there])[:, None] * n) / PI4)
        if np.isfinite(self.reach):
            S += 35.0 / (8.0 * self.reach**3) * m / PI4
        return S

    def potential(self, M: np.ndarray, Q: np.ndarray) -> np.ndarray:
        """phi (n,) of everything at each centre, without the applied field."""
        i, j, n, of = self.i, self.j, self.n, self.of
        m, phi = self.V[:, None] * M, Q / self.a / PI4
        for here, there, sign in ((i, j, 1.0), (j, i, -1.0)):
            np.add.at(phi, here, (sign * of.p * _dot(m[there], n) + of.psi * Q[there]) / PI4)
        if np.isfinite(self.reach):
            phi -= 35.0 / (16.0 * self.reach) * Q / PI4
        return phi

    def mmfs(self, M: np.ndarray, Q: np.ndarray) -> np.ndarray:
        """D (k,) that the potentials make."""
        phi = self.potential(M, Q)
        return self.nd * (self.nn @ self.H) - (phi[self.ni] - phi[self.nj])

    def effective_field(self, M: np.ndarray, D: np.ndarray, Q: np.ndarray, w_s: np.ndarray) -> np.ndarray:
        """Field (n, 3) to which each dipole is the response of a lone sphere: S less the parts of necks and W_t."""
        m, S = self.V[:, None] * M, self.field(M, Q)
        c, slope = self.response(M)
        both = self.across / PI4
        along = self._across(m)
        for here, there in ((self.ni, self.nj), (self.nj, self.ni)):
            np.add.at(S, here, (0.5 * np.sign(D) * w_s / self.V[here])[:, None] * self.nn)
            other = m[there] - _dot(m[there], self.nn)[:, None] * self.nn
            np.add.at(S, here, (both * c[here] * c[there])[:, None] * other)
            np.add.at(S, here, (both * c[there] * along / self.V[here])[:, None] * slope[here])
        return S

    def sweep(self, M: np.ndarray, D: np.ndarray, damping: float) -> tuple[np.ndarray, np.ndarray, float]:
        """One damped step to the stationary state: M, D, and the residual before it.

        Steps are divided by what they change of their own equation: one of D moves the charges and so the mmf, one of
        M the capacity of the necks and so the field that they take from it, which matters in saturation.
        """
        neck = self.neck(M, D)
        Q = self.charges(neck.q)
        S = self.effective_field(M, D, Q, neck.w_s)
        size = np.linalg.norm(S, axis=1)
        response = (self.sphere.magnetisation(size, 0.0) / np.maximum(size, 1e-300))[:, None] * S
        of_mmf, of_field = np.zeros((2, len(self.a)))
        for here in (self.ni, self.nj):
            np.add.at(of_mmf, here, neck.dq_dD / PI4 / self.a[here])
            np.add.at(of_field, here, 0.5 * np.abs(neck.w_ss) / self.V[here])
        mmf = self.mmfs(M, Q) - D
        residual = max(np.abs(response - M).max(initial=0.0), np.abs(mmf / self.length).max(initial=0.0))
        slope = np.maximum(self.slope(M), self.slope(response))
        M = M + (damping / (1.0 + slope * of_field))[:, None] * (response - M)
        D = D + damping / (1.0 + 0.5 * (of_mmf[self.ni] + of_mmf[self.nj])) * mmf
        return M, D, float(residual)

    def slope(self, M: np.ndarray) -> np.ndarray:
        """dM/dS (n,) of the lone sphere, 1/u''."""
        left = 1.0 - np.linalg.norm(M, axis=1)
        return 1.0 / (1.0 / 3.0 + 1.0 / (self.chi * left**2))

    def solve(self, *, tolerance=1e-12, damping=0.7, max_sweeps=3000, start: State | None = None) -> Solution:
        """Sweep to the stationary state, with a smaller step where the residual has not fallen for 25 sweeps."""
        M = np.zeros((len(self.a), 3)) if start is None else start.M
        D = self.nd * (self.nn @ self.H) if start is None else start.D
        least, since = np.inf, 0
        sweeps = 0
        while True:
            new_M, new_D, residual = self.sweep(M, D, damping)
            if residual <= tolerance or sweeps == max_sweeps:
                break
            M, D, since, sweeps = new_M, new_D, since + 1, sweeps + 1
            if residual < 0.9 * least:
                least, since = residual, 0
            elif since >= 25:
                damping, least, since = max(0.7 * damping, 0.05), residual, 0
        return self.solution(State(M, D, self.neck(M, D).q), residual, sweeps)

    def solution(self, state: State, residual: float, sweeps: int) -> Solution:
        """Moments, forces and virial of a state."""
        M, _, q = state
        moment = self.V[:, None] * M
        for here in (self.ni, self.nj):
            share = self.a[here] / (self.a[self.ni] + self.a[self.nj])
            np.add.at(moment, here, (share * q * self.nd)[:, None] * self.nn)
        pair = self.pair_forces(state)
        force = np.zeros_like(M)
        np.add.at(force, self.i, pair)
        np.add.at(force, self.j, -pair)
        return Solution(state, moment, force, -np.einsum("ka,kb->ab", pair, self.r), residual, sweeps)

    def pair_forces(self, state: State) -> np.ndarray:
        """Force (p, 3) on i of each pair, -dW/dr at fixed M, D, q."""
        M, D, q = state
        i, j, n, of, d = self.i, self.j, self.n, self.of, self.d[:, None]
        m, Q = self.V[:, None] * M, self.charges(q)
        a, b, Q_i, Q_j = m[i], m[j], Q[i][:, None], Q[j][:, None]
        a_n, b_n = _dot(a, n)[:, None], _dot(b, n)[:, None]
        p, c1, c2, dc1, dc2 = (one[:, None] for one in of[1:])
        F = (dc1 * a_n * b_n - dc2 * _dot(a, b)[:, None]) * n + c1 / d * (a_n * (b - b_n * n) + b_n * (a - a_n * n))
        F += Q_i * Q_j * p * n
        dp = c2 - c1
        F += Q_j * ((dp - p / d) * a_n * n + p / d * a) - Q_i * ((dp - p / d) * b_n * n + p / d * b)
        F /= PI4
        neck = self.neck(M, D)
        i, j, n = self.ni, self.nj, self.nn
        both = M[i] + M[j]
        turn = (0.5 * np.sign(D) * neck.w_s / self.nd)[:, None] * (both - _dot(both, n)[:, None] * n)
        near = -neck.w_g[:, None] * n + q[:, None] * self.H + turn
        c, mi, mj = self.response(M)[0], m[i], m[j]
        cc = c[i] * c[j] / PI4
        near += (cc * self.across_slope * self._across(m))[:, None] * n
        mi_n, mj_n = _dot(mi, n)[:, None], _dot(mj, n)[:, None]
        near -= (cc * self.across / self.nd)[:, None] * (mi_n * (mj - mj_n * n) + mj_n * (mi - mi_n * n))
        F[self.near] += near
        return F


def cluster(centre, radius, chi, H, **options) -> DenseEnergy:
    """Spheres in open space."""
    x = np.asarray(centre, float)
    i, j = np.triu_indices(len(x), 1)
    return DenseEnergy(np.broadcast_to(radius, len(x)), i, j, x[i] - x[j], chi, H, **options)


def periodic_cell(centre, radius, box, chi, H, *, reach, **options) -> DenseEnergy:
    """Spheres in a periodic box (3,) with the macroscopic field H, each pair of images within the reach once."""
    x, box = np.asarray(centre, float), np.asarray(box, float)
    most = np.ceil(reach / box).astype(int) + 1
    shifts = np.stack(np.meshgrid(*(np.arange(-m, m + 1) for m in most), indexing="ij"), axis=-1).reshape(-1, 3)
    i, j = np.triu_indices(len(x))
    place, pair = (one.ravel() for one in np.meshgrid(np.arange(len(shifts)), np.arange(len(i)), indexing="ij"))
    i, j, shift = i[pair], j[pair], shifts[place]
    # of a grain's own images one of each two that are opposite
    first = np.where(shift[:, 0] != 0, shift[:, 0], np.where(shift[:, 1] != 0, shift[:, 1], shift[:, 2]))
    r = x[i] - x[j] - shift * box
    kept = (_dot(r, r) < reach**2) & ((i != j) | (first > 0))
    return DenseEnergy(np.broadcast_to(radius, len(x)), i[kept], j[kept], r[kept], chi, H, reach=reach, **options)
