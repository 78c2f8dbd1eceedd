"""Torque over the size of the grains, extrapolated to the size of the real powder.

**Law.** T(n) = T_inf (1 + a/n^p) with n grains per gap. Flow of grains is nonlocal: what is sheared sets the powder
next to it in motion over a length of some diameters, and walls that hold it take that away. In the quasi-static limit
the excess of the friction over that of a wide gap is then (pi A d/g)^2 for a gap g and the nonlocal amplitude A, which
is p = 2 (K. Kamrin, D. L. Henann, Soft Matter 11 (2015) 179-185, from the fluidity's equation of K. Kamrin, G. Koval,
Phys. Rev. Lett. 108 (2012) 178301); a layer of a fixed number of diameters at each wall would have p = 1.

**Fit.** The posterior of `emclutch.results.setting_errors`, as in an accuracy study: p within 35 % of theory (one
standard deviation), and torques that deviate from the law by chance, as grains that order in layers do. The two give
one answer for the same runs. All numbers have 95 % intervals.

**Errors of the torques.** Where all sizes have several seeds, these have one relative scatter, from all of them: with
few seeds a size the scatter of each alone is hardly known. Else each torque has the error of its run.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, field
from typing import Any

import numpy as np

from emclutch.results.accuracy_study import Basis, MeasuredSetting, MeasuredValue
from emclutch.results.fits import NORMAL, student
from emclutch.results.setting_errors import SettingErrors
from emclutch.results.torque_curves import TorqueCurve

EXPONENT = 2.0  # of the grains per gap: Kamrin and Henann 2015
NO_LAW = "no law of the grain size: fewer than two sizes have a torque of known error; run longer, or add sizes"
NAME = "grain size"
FARTHEST = 1e-9  # step size of the limit: grains per gap of which no deviation is known


@dataclass(frozen=True, slots=True)
class Interval:
    """A number with its 95 % interval."""

    value: float
    low: float
    high: float

    @classmethod
    def of(cls, draws: np.ndarray) -> Interval:
        """Return median and 95 % interval of draws."""
        low, middle, high = np.quantile(draws, [0.025, 0.5, 0.975])
        return cls(float(middle), float(low), float(high))

    def in_words(self, unit: str = "") -> str:
        """Return the number with its unit and the ends."""
        return f"{self.value:.4g}{unit and ' '}{unit} (95 %: {self.low:.4g} to {self.high:.4g})"


@dataclass(frozen=True, slots=True)
class GrainSizeLaw:
    """The law of torques over n grains per gap.

    Attributes
    ----------
    sizes : how many different n.
    coarsest, finest : smallest and largest n.
    limit : T at n to infinity [N m].
    order : exponent p; with two sizes hardly more than its prior.
    excess : of the torque at the finest size over that at the real size, or at n to infinity, relative.
    real_across : n of the powder that the grains stand for; None where it is not known.
    real_torque : T there [N m].
    unconverged : how many of the torques are not converged.
    reason : all of it in words.
    """

    sizes: int
    coarsest: float
    finest: float
    limit: Interval
    order: Interval
    excess: Interval
    real_across: float | None
    real_torque: Interval | None
    unconverged: int
    _errors: SettingErrors = field(repr=False)

    def torque(self, across: Any) -> tuple[np.ndarray, np.ndarray]:
        """Return T(n) (k,) and the ends of its 95 % interval (2, k) [N m] for `across` (k,), infinity included."""
        sizes = np.where(np.isinf(across), FARTHEST, 1.0 / np.asarray(across, dtype=np.float64))
        sign = math.copysign(1.0, self.limit.value)
        rows = [np.quantile(sign * _torques(self._errors, self.finest, h), [0.025, 0.5, 0.975]) for h in sizes]
        low, middle, high = np.array(rows).T
        return middle, np.array([low, high])

    @property
    def reason(self) -> str:
        """Extrapolation, order and excess in words, a line each."""
        sizes = f"{self.sizes} grain sizes, {self.coarsest:.3g} to {self.finest:.3g} grains per gap"
        lines = [f"{sizes}: T = {self.limit.in_words('N m')} for n to infinity"]
        if self.real_torque is not None:
            size = f"at the {self.real_across:.3g} grains per gap of the real powder"
            lines.append(f"{size}: {self.real_torque.in_words('N m')}")
        ends = f"{100.0 * self.excess.low:.2g} to {100.0 * self.excess.high:.2g} %"
        excess = f"excess of the torque at the finest size: {100.0 * self.excess.value:.2g} % (95 %: {ends})"
        lines.append(f"exponent of 1/n^p: p = {self.order.in_words()}; {excess}")
        if self.unconverged:
            lines.append(f"torques that are not converged, with errors too small: {self.unconverged}; run longer")
        return "\n".join(lines)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        names = (name for name in self.__slots__ if name != "_errors")
        values = {name: getattr(self, name) for name in names}
        plain = {name: asdict(one) if isinstance(one, Interval) else one for name, one in values.items()}
        return plain | {"reason": self.reason}


def grain_size_law(curve: TorqueCurve, exponent: float = EXPONENT) -> GrainSizeLaw | None:
    """Return the law of a curve over the grains per gap; None with fewer than two sizes of known error.

    Parameters
    ----------
    curve : over n, in any order; points without torque or error are left out.
    exponent : p of the theory, above 0.
    """
    known = np.isfinite(curve.torque) & np.isfinite(curve.error) & (curve.error > 0.0) & (curve.x > 0.0)
    n, torque = curve.x[known].round(6), curve.torque[known]
    error, freedom = _errors_of(curve, known)
    sizes = np.unique(n)
    if sizes.size < 2 or torque.min() * torque.max() <= 0.0:
        return None
    values = []
    for size in sizes:  # from coarse to fine; torques of equal size are one measurement
        at = n == size
        weight = error[at] ** -2
        mean = float(weight @ torque[at] / weight.sum())
        spread = float(weight.sum() ** -0.5) / abs(mean)
        values.append(MeasuredValue(size, 1.0 / size, mean, spread, int(at.sum()), 0.0))
    limit = 0.0 if curve.real_across is None else 1.0 / curve.real_across
    finest = float(sizes[-1])
    setting = MeasuredSetting(NAME, "", Basis.TORQUE, finest, exponent, limit, tuple(values), freedom, True)
    errors = SettingErrors([[setting]])
    sign = 1.0 if torque[0] > 0.0 else -1.0
    reached = FARTHEST if curve.real_across is None else limit
    at_limit, at_real = (sign * _torques(errors, finest, h) for h in (FARTHEST, reached))
    return GrainSizeLaw(
        sizes.size, float(sizes[0]), finest, Interval.of(at_limit), Interval(*errors.order(NAME)),
        Interval.of(np.exp(errors.error(NAME, 1.0 / finest, reached if limit else 0.0)[0]) - 1.0),
        curve.real_across, None if curve.real_across is None else Interval.of(at_real),
        int(np.count_nonzero(~curve.converged[known])), errors,
    )  # fmt: skip


def law_in_words(curve: TorqueCurve, law: GrainSizeLaw | None) -> str:
    """Return the law of a curve in lines for people, or why there is none."""
    reason = NO_LAW if law is None else law.reason
    return f"{curve.label}: {reason}" if curve.label else reason


def _torques(errors: SettingErrors, finest: float, step_size: float) -> np.ndarray:
    """Return draws of the magnitude of the torque at a step size [N m]."""
    return np.exp(errors.level[0] - errors.error(NAME, 1.0 / finest, 0.0)[0] + errors.law(NAME, step_size, 0.0))


def _errors_of(curve: TorqueCurve, known: np.ndarray) -> tuple[np.ndarray, float]:
    """Return standard errors [N m] of the torques that are known, and the degrees of freedom of their scatter."""
    error, seeds = curve.error[known], curve.seeds[known] if curve.seeds is not None else np.zeros(1)
    if not (seeds > 1).all():
        return error, math.inf
    freedom, torque = seeds - 1.0, curve.torque[known]
    quantile = np.array([student(one) for one in freedom])
    scatter = error * NORMAL / quantile * np.sqrt(seeds) / np.abs(torque)  # that of each size alone
    pooled = math.sqrt(float(freedom @ scatter**2 / freedom.sum()))
    return pooled * np.abs(torque) / np.sqrt(seeds), float(freedom.sum())
