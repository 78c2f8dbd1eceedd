"""Hysteresis of a steel: walls that are pinned, as stops of the flux density beside its first magnetisation curve.

Each cell k of the material resists a change of B like a spring of stiffness K_k that slips at the force kappa_k. Its
position p_k [T], a vector, is the history:

    s(e) = K e  for |e| <= kappa/K,  kappa e/|e| beyond,      e = B - p,      p' = B - s/K,

so that s is reversible (bowing walls) up to the pinning field kappa, and then drags p along: dry friction, rate
independent. The field strength is that of the first magnetisation curve H_0(|B|), the one that tables hold, in which a
demagnetised steel (p = 0) has the same cells:

    H = H_0(|B|) B/|B| + sum_k [ s_k(B - p_k) - s_k(B) ].

Without history, or without cells, H is H_0 to the last bit. By H_0 less the cells' part P(B) = sum_k min(K_k B,
kappa_k) the anhysteretic curve is given; P grows to the coercivity H_c. After a reversal at B_m the cells follow
P(B_m) - 2 P((B_m - B)/2) (Masing's rule), so that the major loop has half the width H_c, minor loops close at the point
that they left, and the loss of a loop is its area.

In a step from p to p' the work is that of the convex potential

    w = w_0(|B|) + sum_k [ h_k(|B - p_k|) - h_k(|B|) ],      h(x) = K x^2/2,  beyond the limit  kappa x - kappa^2/(2 K),

whose derivative is H: implicit, energy-consistent, with a symmetric tangent. It is convex if P' <= H_0' everywhere.

The cells: P' = m (1 - P/H_*), with m(B) nine tenths of the least slope of H_0 between 0 and B, and H_* such that P is
H_c where H_0 is 2 H_c, or at the first of 2.5 to 8 H_c that leaves room for it: small loops widen with B^2, as
Rayleigh's do. H_c is the one number that a steel needs. Its remanence follows, of a loop from saturation
H_0(B_r) = H_c + P(B_r).

Sources: A. Bergqvist, Physica B 233 (1997) 342 (dry friction, distributed pinning, vectors); V. Francois-Lavet,
F. Henrotte, L. Stainier, L. Noels, C. Geuzaine, J. Comput. Appl. Math. 246 (2013) 243, and L. Prigozhin, V. Sokolovsky,
J. W. Barrett, S. E. Zirka, IEEE Trans. Magn. 52 (2016) 7301211 (energy and convex steps); T. Matsuo, M. Shimasaki, IEEE
Trans. Magn. 41 (2005) 3112 (stops of B, the form for a vector potential). The distribution by P' is this module's own.

Neglected: rates (eddy currents stand elsewhere), anisotropy, stress, magnetic ageing; cells do not vanish in
saturation, where a rotating field would lose less than they say.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numba import njit
from scipy.optimize import brentq

from field.laws.reluctivity import Law
from geometry.kernels.device_functions import device_function

CELLS = 12
# Of the curve's slope, what cells may take: the rest is that of the anhysteretic curve, which must grow.
_SHARE = 0.9
# Where the branches of the major loop have met, in coercivities: the first of these at which P reaches H_c.
_CLOSED = (2.0, 2.5, 3.0, 4.0, 6.0, 8.0)
_SAMPLES = 400  # of the slope in a cell's interval


@dataclass(frozen=True, slots=True)
class Pinning:
    """Pinned cells of a steel.

    Attributes
    ----------
    stiffness : ndarray (n,)
        K [m/H], > 0.
    reach : ndarray (n,)
        kappa/K [T], how far B moves a cell's walls before they slip; growing.
    """

    stiffness: np.ndarray
    reach: np.ndarray

    @classmethod
    def of(cls, law: Law, coercivity: float) -> Pinning:
        """Cells of a steel whose first magnetisation curve and coercivity [A/m] are known; none of 0 A/m.

        Raises
        ------
        ValueError
            A coercivity below 0 or not finite, or more than the curve allows: B would jump on first magnetisation.
        """
        if not (math.isfinite(coercivity) and coercivity >= 0.0):
            raise ValueError(f"`coercivity` = {coercivity} A/m of {law.name!r} must be a finite number of at least 0")
        if coercivity == 0.0:
            return cls(np.zeros(0), np.zeros(0))
        for closed in _CLOSED:
            end = _flux_density_at(law, closed * coercivity)
            reach = end * (np.arange(CELLS + 1) / CELLS) ** 2
            B = np.interp(np.arange(CELLS * _SAMPLES + 1), np.arange(CELLS + 1) * _SAMPLES, reach)
            least = np.minimum.accumulate(law.H_of_B(B)[1])[_SAMPLES::_SAMPLES]
            width = np.diff(reach)
            room = _SHARE * np.cumsum(least * width)
            if room[-1] > 1.01 * coercivity:
                break
        else:
            raise ValueError(
                f"`coercivity` = {coercivity:g} A/m of {law.name!r} is too much for its magnetisation curve, which "
                f"allows {room[-1] / 1.01:.3g} A/m: B would jump on first magnetisation; lower it, or give the steel's "
                "own curve"
            )

        def reached(scale: float) -> float:  # P at the end, over the coercivity, for H_* = coercivity/scale
            return -math.expm1(-room[-1] * scale / coercivity) / scale - 1.0

        # towards scale = 0 it is room/coercivity - 1 > 0
        scale = coercivity / brentq(reached, 1e-9, 1.0, xtol=1e-14)
        P = -scale * np.expm1(-np.concatenate(([0.0], room)) / scale)
        slope = np.append(np.diff(P) / width, 0.0)
        return cls(-np.diff(slope), reach[1:])

    @property
    def coercivity(self) -> float:
        """Half the width of the major loop, sum of the pinning fields [A/m]."""
        return float((self.stiffness * self.reach).sum())

    def remanence(self, law: Law) -> float:
        """B_r [T] of the major loop from saturation, H_0(B_r) = H_c + P(B_r); 0 without cells."""
        if not self.reach.size:
            return 0.0

        def beyond(B: float) -> float:
            P = float((self.stiffness * np.minimum(B, self.reach)).sum())
            return float(law.H_of_B(np.array([B]))[0][0]) - self.coercivity - P

        end = self.reach[-1]
        while beyond(end) < 0.0:
            end *= 2.0
        return float(brentq(beyond, 0.0, end, xtol=1e-12))

    def demagnetised(self, *shape: int) -> np.ndarray:
        """Positions (*shape, 2, n) [T] of a steel without history."""
        return np.zeros((*shape, 2, self.reach.size))

    def step(self, B: np.ndarray, position: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """What history adds to H, to its derivative, and to the potential of a step that ends at B.

        Parameters
        ----------
        B : ndarray (..., 2)
            Flux density [T].
        position : ndarray (..., 2, n)
            Of the cells when the step begins [T].

        Returns
        -------
        H : ndarray (..., 2)
            [A/m].
        tangent : ndarray (..., 3)
            xx, xy, yy of the symmetric dH/dB [m/H].
        w : ndarray (...,)
            [J/m^3].
        """
        H, tangent, w = np.empty(B.shape), np.empty((*B.shape[:-1], 3)), np.empty(B.shape[:-1])
        flat = np.ascontiguousarray(B, dtype=float).reshape(-1, 2)
        cells = np.ascontiguousarray(position).reshape(len(flat), 2, self.reach.size)
        _step(flat, cells, self.stiffness, self.reach, H.reshape(-1, 2), tangent.reshape(-1, 3), w.reshape(-1))
        return H, tangent, w

    def advanced(self, B: np.ndarray, position: np.ndarray) -> np.ndarray:
        """Positions (..., 2, n) [T] after a step to B (..., 2) [T]."""
        e = B[..., None] - position
        return B[..., None] - self._slipped(e)

    def loss(self, position: np.ndarray, later: np.ndarray) -> np.ndarray:
        """Heat of slipping from one position to a later one, sum of kappa |p' - p|, (...,) [J/m^3]."""
        return (self.stiffness * self.reach * np.hypot(*np.moveaxis(later - position, -2, 0))).sum(axis=-1)

    def stored(self, B: np.ndarray, position: np.ndarray) -> np.ndarray:
        """What cells add to the reversible energy beside w_0, (...,) [J/m^3]: bowing, less all that w_0 has of them."""
        e = B[..., None]
        bowing = 0.5 * (self._slipped(e - position) ** 2).sum(axis=-2)
        return ((bowing - self._potential(e)) * self.stiffness).sum(axis=-1)

    def _slipped(self, e: np.ndarray) -> np.ndarray:
        """s/K: e (..., 2, n) [T], cut to the reach."""
        size = np.hypot(e[..., :1, :], e[..., 1:, :])
        return e * np.minimum(1.0, self.reach / np.maximum(size, self.reach))

    def _potential(self, e: np.ndarray) -> np.ndarray:
        size = np.hypot(e[..., 0, :], e[..., 1, :])
        bent = np.minimum(size, self.reach)
        return bent * (size - 0.5 * bent)


@device_function(error_model="numpy")
def _stop(x, y, reach):
    """s/K, its derivative xx, xy, yy, and h/K of one cell at e = (x, y)."""
    size = math.sqrt(x * x + y * y)
    if size <= reach:
        return x, y, 1.0, 0.0, 1.0, 0.5 * size * size
    c = reach / size
    x1, y1 = x / size, y / size
    return c * x, c * y, c * y1 * y1, -c * x1 * y1, c * x1 * x1, reach * (size - 0.5 * reach)


@njit(cache=True, error_model="numpy", nogil=True)
def _step(B, position, stiffness, reach, H, tangent, w):
    for i in range(B.shape[0]):
        x, y = B[i, 0], B[i, 1]
        h_x = h_y = xx = xy = yy = work = 0.0
        for k in range(reach.size):
            K, r = stiffness[k], reach[k]
            a, b, a_x, a_xy, a_y, a_w = _stop(x - position[i, 0, k], y - position[i, 1, k], r)
            # those of the curve itself: equal to the last bit where there is no history
            c, d, c_x, c_xy, c_y, c_w = _stop(x, y, r)
            h_x += K * (a - c)
            h_y += K * (b - d)
            xx += K * (a_x - c_x)
            xy += K * (a_xy - c_xy)
            yy += K * (a_y - c_y)
            work += K * (a_w - c_w)
        H[i, 0], H[i, 1] = h_x, h_y
        tangent[i, 0], tangent[i, 1], tangent[i, 2] = xx, xy, yy
        w[i] = work


def _flux_density_at(law: Law, H: float) -> float:
    """B [T] at which the curve has reached H [A/m]."""
    end = 1e-3
    while float(law.H_of_B(np.array([end]))[0][0]) < H:
        end *= 2.0
    return float(brentq(lambda B: float(law.H_of_B(np.array([B]))[0][0]) - H, 0.0, end, xtol=1e-12))
