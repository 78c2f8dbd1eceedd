"""Energy of the neck of two near spheres over their gap and the magnetomotive force (mmf) between them.

Each sphere of a pair is a dipole of the magnetisation M and, at its centre, a charge: the flux q that crosses the neck
beyond that of the dipoles leaves one sphere and enters the other. The neck takes part in the energy of all spheres with

    w(g, D, s) = D^2 y(ln g, ln(|D|/s)),        q = -dw/dD,

D the mmf, the drop of the scalar potential between the two nodes, s = 1 - sgn(D) (M_i + M_j).n/2 the capacity that
the dipoles leave to the neck (n from j to i). For small D/s the neck is linear, y constant; for large D/s it carries no
more than a flux proportional to s, y ~ 1/|D|. As w depends on D/s apart from the factor s^2, D w_D + s w_s = 2 w.
Lengths in radii, fields and magnetisations in Ms, mmfs in Ms a, fluxes in Ms a^2, energies in mu_0 Ms^2 a^3.

**How it is made.** From the force F_2 of an isolated pair on the axis of a field h (`pair_table`), so that in the same
model the pair has that force and, with it, its moment. Its energy is E(h, g) = E(h, G) - int_g^G F_2 dg, and
M_2 = -(1/2V) dE/dh, V = 4 pi/3. At the largest gap G of the table E is that of two mutual dipoles, less the work
that their excess of attraction does beyond it, where it falls as R^-9 (a dipole and the quadrupole that it induces,
R = 2 + g): 1e-4 of the moment. With the energy

    E = 2V [u(M) - M h] - (8 pi/9) M^2/R^3 + (2/3) M q/R^2 + c q^2/(4 pi) - q h R + w + q D,        c = 1 - 1/R,

(u' = M/3 + h_in(M) for spheres of the law h_in; a charge lives on a sphere of its own radius) stationary in q, D, M,

    q = 2V (M_2 - M)/R,    D = h R - 2 M/(3 R^2) - c q/(2 pi),
    2V [u'(M) - h - (4 M - 2 M_2)/(3 R^3)] = (2 w + q D)/(1 - M)

is one equation for M at each gap and field, and w the rest of E. Solved by bisection in the flux density inside a
sphere, below the root that it has without its right side.

**Limits.** Between gaps of 1 and 1.2 the energy fades to zero (`pair_table.fade`). Below the first mmf y is constant;
beyond the last one the flux is. The table meets both with the same slope, so that q, w_s, w_g are continuous. In
fields of several Ms, where both spheres are saturated and q is a small difference, it need not be exact; at the knee of
a sharp law, h = Ms/3, moments are 1e-3 off with a susceptibility of 999 and 1e-2 with 1e6. Between the
susceptibilities of the shipped tables ln(-y) is interpolated: against finite elements at 14, 35, 200 and 2000 force is
within 0.1 %, at a gap of 0.001 within 0.9 % (14) and 0.4 % (35), the moment within 0.03 %.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property, lru_cache
from typing import NamedTuple

import numpy as np
from scipy.interpolate import CubicSpline, PchipInterpolator

from field.laws.powder_law import GrainLaw
from field.laws.reluctivity import MU_0, Law
from field.spheres.pair_table import FADE_FROM, FADE_TO, PairTable, fade, fade_slope, pair_table, shipped_neighbours

LOG_GAP = math.log(FADE_TO / FADE_FROM) / 3.0 * np.arange(-134, 4) + math.log(FADE_FROM)
"""Logarithms of the gaps [radii] of the table, from 2.9e-4; both ends of the fade are among them."""
LOG_MMF = np.linspace(math.log(1e-4), 6.0, 210)
"""Logarithms of the mmfs over the capacity [a]: iron is linear at the first, its flux the capacity at the last."""

_VOLUME = 4.0 / 3.0 * math.pi
# Fields [Ms] at which a pair is solved: those of its table, closer.
_FIELDS = 300
# Of the excess of force over dipoles beyond the table, (R_last/R)^n.
_DECAY = 9.0
_BISECTIONS = 60  # to round-off


class NeckState(NamedTuple):
    """Energy of a neck and its derivatives, all of one shape; see `NeckEnergy.at`."""

    w: np.ndarray
    q: np.ndarray  # -dw/dD
    w_s: np.ndarray
    w_g: np.ndarray
    dq_dD: np.ndarray
    dq_ds: np.ndarray
    w_ss: np.ndarray


@dataclass(frozen=True, eq=False)
class NeckEnergy:
    """Table of y for kernels, a bicubic patch for each cell.

    Attributes
    ----------
    log_gap : ndarray (ng,)
        ln g, evenly spaced.
    log_mmf : ndarray (nz,)
        ln(|D|/s), evenly spaced.
    patch : ndarray (ng, nz, 4)
        y, dy/di, dy/dj and d2y/didj, derivatives over the indices of gap and mmf, of a bicubic spline whose slope
        over the mmf is 0 in the first column and -y in the last. Without the fade.
    """

    log_gap: np.ndarray
    log_mmf: np.ndarray
    patch: np.ndarray

    @property
    def y(self) -> np.ndarray:
        """Values at the nodes, (ng, nz)."""
        return self.patch[:, :, 0]

    @cached_property
    def gap_step(self) -> float:
        """Of `log_gap`."""
        return float(self.log_gap[1] - self.log_gap[0])

    @cached_property
    def mmf_step(self) -> float:
        """Of `log_mmf`."""
        return float(self.log_mmf[1] - self.log_mmf[0])

    def at(self, g: np.ndarray | float, D: np.ndarray | float, s: np.ndarray | float) -> NeckState:
        """Energy and derivatives of the interpolant itself, so that they are exactly each other's.

        Parameters
        ----------
        g : array_like
            Gaps [radii], not below the first of the table.
        D : array_like
            Mmfs [Ms a] of either sign: w is even, q odd in D.
        s : array_like
            Capacities [Ms], above 0.

        Raises
        ------
        ValueError
            A gap below the table, a capacity that is not above 0.
        """
        g, D, s = np.broadcast_arrays(*(np.asarray(one, dtype=float) for one in (g, D, s)))
        if not np.all(g >= math.exp(self.log_gap[0]) * (1.0 - 1e-12)):
            raise ValueError(f"gaps must be at least {math.exp(self.log_gap[0]):.3g} radii, the first of the table")
        if not np.all(s > 0.0):
            raise ValueError("the capacity s = 1 - sgn(D) (M_i + M_j).n/2 must be above 0")
        size = np.maximum(np.abs(D), 1e-300)
        x = np.clip((np.log(g) - self.log_gap[0]) / self.gap_step, 0.0, self.log_gap.size - 1.0)
        z = (np.log(size / s) - self.log_mmf[0]) / self.mmf_step
        inside = np.clip(z, 0.0, self.log_mmf.size - 1.0)
        y, y_x, y_z, y_zz = self._interpolate(x, inside)
        y_z, y_zz = np.where(z < 0.0, 0.0, y_z), np.where(z < 0.0, 0.0, y_zz)
        # beyond the last mmf: y exp(-(z - z_last)), the flux is constant
        beyond = z > self.log_mmf.size - 1.0
        decay = np.exp(-np.maximum(z - inside, 0.0) * self.mmf_step)
        y, y_x = y * decay, y_x * decay
        y_z, y_zz = np.where(beyond, -y, y_z / self.mmf_step), np.where(beyond, y, y_zz / self.mmf_step**2)
        f = fade(g)
        w = f * D**2 * y
        q = -f * D * (2.0 * y + y_z)
        w_g = D**2 * (f * y_x / (self.gap_step * g) + fade_slope(g) * y)
        dq_dD = -f * (2.0 * y + 3.0 * y_z + y_zz)
        # Euler: of degree 2 in (D, s)
        w_s = (2.0 * w + q * D) / s
        dq_ds = (q - D * dq_dD) / s
        return NeckState(w, q, w_s, w_g, dq_dD, dq_ds, (w_s + D * dq_ds) / s)

    def _interpolate(self, x: np.ndarray, z: np.ndarray) -> tuple[np.ndarray, ...]:
        """y, dy/dx, dy/dz and d2y/dz2 by Hermite's cubics in both indices."""
        i = np.minimum(x.astype(int), self.log_gap.size - 2)
        j = np.minimum(z.astype(int), self.log_mmf.size - 2)
        along, slope = _hermite(x - i)
        across, first, second = (*_hermite(z - j), _hermite_curvature(z - j))
        corners = np.stack([self.patch[i + a, j + b] for a in (0, 1) for b in (0, 1)], axis=-2)
        corners = corners.reshape(*x.shape, 2, 2, 4)  # end of x, end of z, value of the four

        def sum_of(over_x: np.ndarray, over_z: np.ndarray) -> np.ndarray:
            # weights (2 kinds, 2 ends): of values and of slopes
            at_x = over_x[0][..., None, None] * corners[..., [0, 2]] + over_x[1][..., None, None] * corners[..., [1, 3]]
            at_x = at_x.sum(axis=-3)
            return (over_z[0] * at_x[..., 0] + over_z[1] * at_x[..., 1]).sum(axis=-1)

        return sum_of(along, across), sum_of(slope, across), sum_of(along, first), sum_of(along, second)


def _hermite(t: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Weights of (values, slopes) at the ends 0 and 1, and their derivatives: (2, ..., 2) each."""
    values = np.stack([1.0 - t**2 * (3.0 - 2.0 * t), t**2 * (3.0 - 2.0 * t)], axis=-1)
    slopes = np.stack([t * (1.0 - t) ** 2, t**2 * (t - 1.0)], axis=-1)
    rise = 6.0 * t * (1.0 - t)
    values_t = np.stack([-rise, rise], axis=-1)
    slopes_t = np.stack([(1.0 - t) * (1.0 - 3.0 * t), t * (3.0 * t - 2.0)], axis=-1)
    return np.stack([values, slopes]), np.stack([values_t, slopes_t])


def _hermite_curvature(t: np.ndarray) -> np.ndarray:
    values = np.stack([12.0 * t - 6.0, 6.0 - 12.0 * t], axis=-1)
    slopes = np.stack([6.0 * t - 4.0, 6.0 * t - 2.0], axis=-1)
    return np.stack([values, slopes])


def neck_energy(law: Law | GrainLaw) -> NeckEnergy:
    """The table of a grain's law, made in a second from its pair table and kept.

    Raises
    ------
    ValueError
        A law that does not saturate.
    ConvergenceError
        Finite elements failed where a pair table had to be built.
    """
    try:
        return _kept_energy(law)  # type: ignore[arg-type]
    except TypeError:  # a law of points cannot be hashed
        return _make_energy(law)


def _make_energy(law: Law | GrainLaw) -> NeckEnergy:
    neighbours = shipped_neighbours(law)
    if neighbours is None:
        return table_of(_solve_pair(pair_table(law)))
    logs = [factor * np.log(-neck_energy(node).y) for node, factor in neighbours]
    return table_of(-np.exp(np.sum(logs, axis=0)))


_kept_energy = lru_cache(maxsize=16)(_make_energy)


def table_of(y: np.ndarray) -> NeckEnergy:
    """Table with the values y (ng, nz) at `LOG_GAP` and `LOG_MMF`; its slopes are those of a cubic spline."""
    i, j = np.arange(float(LOG_GAP.size)), np.arange(float(LOG_MMF.size))
    step = LOG_MMF[1] - LOG_MMF[0]
    y_z = CubicSpline(j, y, axis=1, bc_type=((1, np.zeros(i.size)), (1, -step * y[:, -1])))(j, 1)
    patch = [y, CubicSpline(i, y)(i, 1), y_z, CubicSpline(i, y_z)(i, 1)]
    return NeckEnergy(LOG_GAP, LOG_MMF, np.ascontiguousarray(np.stack(patch, axis=-1)))


def _solve_pair(pair: PairTable) -> np.ndarray:
    """Find y (ng, nz) so that an isolated pair has the force of its table; see the module."""
    h = np.geomspace(pair.field[0], pair.field[-1], _FIELDS)
    g = np.exp(LOG_GAP)[:, None]
    R, c = 2.0 + g, 1.0 - 1.0 / (2.0 + g)
    E, M_2 = _pair_energy(pair, g, h)

    def state(b: np.ndarray) -> tuple[np.ndarray, ...]:
        M, slope, u = _sphere_energy(pair, b)
        q = 2.0 * _VOLUME * (M_2 - M) / R
        D = h * R - 2.0 / 3.0 * M / R**2 - c * q / (2.0 * math.pi)
        w = E - 2.0 * _VOLUME * (u - M * h) + 8.0 * math.pi / 9.0 * M**2 / R**3 - 2.0 / 3.0 * M * q / R**2
        w += -c * q**2 / (4.0 * math.pi) + q * h * R - q * D
        rest = 2.0 * _VOLUME * (slope - h - (4.0 * M - 2.0 * M_2) / (3.0 * R**3))
        return rest, rest - (2.0 * w + q * D) / (1.0 - M), M, D, w

    top = _bisect(lambda b: state(b)[0], 3.0 * (1.0 + h) * np.ones_like(E))
    _, left, M, D, w = state(_bisect(lambda b: state(b)[1], top))
    z, y = np.log(D / (1.0 - M)), w / D**2
    solved = (np.abs(left) < 1e-6 * (1.0 + h)) & (y < 0.0)
    return np.stack([_resample(*row) for row in zip(z, y, solved, strict=True)])


def _pair_energy(pair: PairTable, g: np.ndarray, h: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """E(g, h) and M_2 = -(1/2V) dE/dh of the isolated pair."""
    F = pair.force_of(g, h)
    F_h = F * pair.force_log_slope(g, h) / h
    x = LOG_GAP

    def work(integrand: np.ndarray) -> np.ndarray:
        integral = CubicSpline(x, g * integrand).antiderivative()(x)
        return integral[-1] - integral

    last = 2.0 + g[-1, 0]
    M = _mutual_dipoles(pair, last, h)
    M, _, u = _sphere_energy(pair, M)
    excess = np.maximum(F[-1] - math.pi / 6.0 * M**2 * (2.0 / last) ** 4, 0.0) * last / (_DECAY - 1.0)
    E = 2.0 * _VOLUME * (u - M * h) - 8.0 * math.pi / 9.0 * M**2 / last**3 - excess
    M = M + CubicSpline(np.log(h), excess)(np.log(h), 1) / (2.0 * _VOLUME * h)
    return E - work(F), M + work(F_h) / (2.0 * _VOLUME)


def _sphere_energy(pair: PairTable, b: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """M, u'(M) = M/3 + h_in and u(M) of a lone sphere over its flux density b [mu_0 Ms]."""
    scale = MU_0 * pair.Ms
    H = pair.law.H_of_B(scale * b)[0] / pair.Ms
    M = b - H
    return M, M / 3.0 + H, M**2 / 6.0 + pair.law.energy_density(scale * b) / (scale * pair.Ms) - 0.5 * H**2


def _mutual_dipoles(pair: PairTable, R: float, h: np.ndarray) -> np.ndarray:
    """Flux density [mu_0 Ms] inside two spheres that are dipoles to each other, on the axis of h."""

    def rest(b: np.ndarray) -> np.ndarray:
        M, slope, _ = _sphere_energy(pair, b)
        return slope - h - 2.0 * M / (3.0 * R**3)

    return _bisect(rest, 3.0 * (1.0 + h))


def _bisect(function, high: np.ndarray) -> np.ndarray:
    """Root between 0 and `high` of a function that is negative at 0."""
    low = np.zeros_like(high)
    for _ in range(_BISECTIONS):
        middle = 0.5 * (low + high)
        below = function(middle) < 0.0
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    return 0.5 * (low + high)


def _resample(z: np.ndarray, y: np.ndarray, solved: np.ndarray) -> np.ndarray:
    """One gap's y at `LOG_MMF`: constant below the first mmf, with a flux that is constant beyond the last.

    Points at which y would fall or the flux turn round are left out, and no overshoot is put between the others: at the
    knee of a sharp law the pair's table, with a field every 12 %, is not good enough.
    """
    z, y = z[solved], y[solved]
    z, y = _where_rising(z, z, y)
    z, y = _where_rising(y, z, y)
    z, y = _where_rising(2.0 * z + np.log(-y), z, y)
    inside = np.clip(LOG_MMF, z[0], z[-1])
    return PchipInterpolator(z, y)(inside) * np.exp(-np.maximum(LOG_MMF - z[-1], 0.0))


def _where_rising(values: np.ndarray, z: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Points of a curve at which `values` are above all those before."""
    kept = np.concatenate(([True], values[1:] > np.maximum.accumulate(values)[:-1]))
    return z[kept], y[kept]
