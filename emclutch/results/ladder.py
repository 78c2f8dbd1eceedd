"""Ladders of a device: how much each numerical setting moves its torque, and what it costs.

A *knob* (`emclutch.knobs`) is a numerical parameter. A *rung* is one setting of it, all others being the scene's own;
its value is the mean torque of some packings, or a quantity without noise. A *ladder* is the rungs of all knobs.

**Error of a setting.** ln T = ln T_0 + c (h^p - h_0^p) over the step size h of a knob of known order p, by weighted
least squares; the relative error of a setting is b = T/T_0 - 1, positive where the torque is too large. Its interval is
Student's t, with the scatter between packings pooled over all rungs (that of a rung of twice the grains is smaller by
the root of two), so that few packings a rung suffice. Whether the rungs follow the law is decided by an F test of their
misfit, at 5 %. Where they do not, the error is the middle of what p and all orders from p/2 to 2 p that pass it say,
and half of how far these differ is added to the half width. Where noise is absent p is fitted, to three rungs or more
over a factor of 2 in h.

**One noise in all knobs.** All knobs share the packings at the scene's own settings, so that their errors are
correlated: the part that this noise has in each (`KnobError.shared`) is added with its sign, all else in quadrature.

**Deviations.** Rungs may differ from the law at random: grains order in layers, and a gap holds whole ones. The
variance of that, as far as noise does not explain the misfit, is tau^2 = (chi^2 - nu) / (tr W - tr((X' W X)^-1 X' W^2
X)) with the weights W, the terms X of the law and nu degrees of freedom (R. DerSimonian, N. Laird, Controlled Clinical
Trials 7 (1986) 177, for regression S. G. Thompson, S. J. Sharp, Stat. Med. 18 (1999) 2693). Student's t times tau is
added to the half width, in quadrature; without noise the largest misfit.

**Interaction.** Each knob is measured with all others at the scene's own settings, and the factors 1 + b are
multiplied. That two settings may change each other's errors adds b_i b_j to the half width, in quadrature over pairs.

**What the law lacks.** As for the grid convergence index (P. J. Roache, J. Fluids Eng. 116 (1994) 405-413; ASME V&V
20-2009, section 2), the extrapolation is not trusted fully: the half width of the error is that of its statistics, plus
in quadrature (F - 1) |b|, with F = 1.25 where three rungs or more follow the law, 1.5 where two rungs leave it
unchecked, and 3 where the rungs do not follow it, or at settings coarser than all of them. Where they do not follow it
|b| is that of the finest rung, as coarser ones are measured against it, and the largest misfit, or without noise the
largest difference from finer rungs, takes its place if that is larger (L. Eca, M. Hoekstra, J. Comput. Phys. 262
(2014) 104-130). Noisy rungs of a knob without a known order have their
difference from the finest one as b, or that of the last two if it is larger, with F = 1.5. Without a law nothing is
said of settings coarser than all.

**Decided** is a knob whose error at the scene's setting is known to be different from zero, or smaller than `SMALL`;
all others are undecided, and count with their half width all the same.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from typing import Any

import numpy as np

SAFETY = {"follows": 1.25, "other order": 1.25, "not checked": 1.5, "no law": 3.0}
SMALL = 0.01
"""Half width of an error that needs no decision."""
ORDERS = np.linspace(0.5, 8.0, 151)
MISFIT = 0.1  # of the range of the rungs: largest residual of rungs without noise that follow a law
NARROW = 2.0  # coarsest over finest step size: over less no order is seen
SIGNIFICANCE = 0.05
CONFIDENCE = 0.95
VERSION = 2
"""Of the file: settings, units and step sizes of the knobs are those of this version; since 2 sectors of finer grains
are as wide as those of the scene."""
INTERACTION = "interaction"
"""Name of the part that is no knob's: what errors may do to each other."""


class Basis(StrEnum):
    """Quantity of a rung."""

    TORQUE = "torque"
    MOMENTS = "moments"
    """Sum of squared moments of standing grains, to which the torque is taken to be in proportion."""
    LATER = "later"
    """Torque of the same packings over a later stretch."""


@dataclass(frozen=True, slots=True)
class Rung:
    """One setting of a knob.

    Attributes
    ----------
    setting, step_size : float
        As of the knob; the step size is its h.
    value : float or None
        Mean torque [N m], or the quantity of the basis; None: no packing has one.
    error : float
        Relative standard error of the value, by the pooled scatter; 0 without noise.
    packings : int
    seconds : float
        Processor time of a packing, or of a solution [s].
    cost : float
        Processor time of a packing at this setting over that at the scene's own; predicted where no packing was run.
    failure : str
        Why the rung has no value.
    """

    setting: float
    step_size: float
    value: float | None
    error: float
    packings: int
    seconds: float
    cost: float = 1.0
    failure: str = ""


@dataclass(frozen=True, slots=True)
class KnobError:
    """Error of a setting, relative to the torque without it.

    Attributes
    ----------
    bias : float
        Positive where the torque is too large: the torque over 1 + bias is that without the error.
    half_width : float
        Of the 95 % interval of the torque so corrected, relative.
    shared : float
        The part of `half_width` by the noise of the scene's own settings, which all knobs share; with the sign of its
        effect on the bias.
    noise : float
        The part of `half_width` by all noise, which more packings lower.
    """

    bias: float
    half_width: float
    shared: float = 0.0
    noise: float = 0.0

    @property
    def is_decided(self) -> bool:
        """Return whether the bias differs from zero, or is small, at the confidence of its interval."""
        return abs(self.bias) > self.half_width or abs(self.bias) + self.half_width <= SMALL


@dataclass(frozen=True)
class KnobLadder:
    """The rungs of one knob.

    Attributes
    ----------
    knob, key : str
    basis : Basis
    own : float
        The scene's setting.
    order : float or None
        Of the law; None: fitted, or none.
    limit : float
        Step size without error.
    rungs : tuple of Rung
        From coarse to fine.
    freedom : float
        Degrees of freedom of the pooled scatter; infinite without noise.
    """

    knob: str
    key: str
    basis: Basis
    own: float
    order: float | None
    limit: float
    rungs: tuple[Rung, ...]
    freedom: float = math.inf
    _fit: _Fit | None = field(default=None, init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_fit", _fitted(self))

    @property
    def verdict(self) -> str:
        """Return whether the rungs follow the law, and the order where it was fitted."""
        return "not measured" if self._fit is None else self._fit.verdict

    @property
    def observed_order(self) -> float | None:
        """Return the order that fits rungs without noise best; None where the law's is taken, or none fits."""
        return None if self._fit is None else self._fit.observed

    def error(self, step_size: float, limit: float | None = None) -> KnobError | None:
        """Return the error of a setting by its step size; None where the rungs say nothing.

        `limit`: step size without error, where it is another one than the ladder's.
        """
        return None if self._fit is None else self._fit.error(step_size, self.limit if limit is None else limit)

    def is_own(self, setting: float) -> bool:
        """Return whether a setting is the scene's own."""
        return math.isclose(setting, self.own, rel_tol=1e-6)

    @property
    def own_error(self) -> KnobError | None:
        """Return the error of the scene's own setting."""
        own = [rung for rung in self.rungs if self.is_own(rung.setting)]
        return self.error(own[0].step_size) if own else None


@dataclass(frozen=True, slots=True)
class Total:
    """Discretisation error of a run, from the ladder of its device.

    Attributes
    ----------
    parts : dict of str to KnobError
        By knob.
    unknown : dict of str to str
        Knobs whose error is not known: why.
    """

    parts: dict[str, KnobError]
    unknown: dict[str, str]

    @property
    def bias(self) -> float:
        """Relative error by all settings together: the product of all 1 + b, less 1."""
        return math.expm1(sum(math.log1p(max(one.bias, -0.9)) for one in self.parts.values()))

    @property
    def half_width(self) -> float:
        """Of its 95 % interval: the parts' in quadrature, but that of the noise they share by their sum."""
        parts = self.parts.values()
        own = sum(one.half_width**2 - one.shared**2 for one in parts)
        return math.sqrt(max(0.0, own) + sum(one.shared for one in parts) ** 2 + self.interaction**2)

    @property
    def interaction(self) -> float:
        """Half width for what errors may do to each other: the products of all pairs, in quadrature."""
        squares = [one.bias**2 for one in self.parts.values()]
        return math.sqrt(max(0.0, 0.5 * (sum(squares) ** 2 - sum(one**2 for one in squares))))

    @property
    def noise(self) -> float:
        """The part of the half width by noise, which more packings of the ladder lower."""
        parts = self.parts.values()
        own = sum(one.noise**2 - one.shared**2 for one in parts)
        return math.sqrt(max(0.0, own) + sum(one.shared for one in parts) ** 2)

    @property
    def widths(self) -> dict[str, float]:
        """Return the half width by each knob, and by the interaction where there is one."""
        widths = {name: one.half_width for name, one in self.parts.items()}
        return widths | ({INTERACTION: self.interaction} if self.interaction else {})

    @property
    def largest(self) -> str | None:
        """Return the name of the widest part."""
        widths = self.widths
        return max(widths, key=lambda name: widths[name], default=None)

    def as_dict(self) -> dict[str, Any]:
        """Return plain values for JSON."""
        parts = {name: asdict(one) | {"decided": one.is_decided} for name, one in self.parts.items()}
        return {
            "bias": self.bias, "half_width": self.half_width, "interaction": self.interaction,
            "largest": self.largest, "parts": parts, "unknown": self.unknown,
        }  # fmt: skip


@dataclass(frozen=True)
class Ladder:
    """What a study has measured of a device.

    Attributes
    ----------
    device : str
        Hash of what matters (`emclutch.results.ladders.device_hash`).
    case : str
        Name of the scene.
    drive : dict of str to Any
        Entries of the scene that the hash leaves out, as the current.
    torque : float
        Mean at the scene's own settings [N m].
    scatter : float
        Relative standard deviation between packings of the scene's own settings.
    freedom : float
        Degrees of freedom of the pooled scatter.
    strain : float or None
        Shear strain that is averaged in each packing.
    packings : int
        At the scene's own settings.
    seconds : float
        Processor time of one of them [s].
    knobs : tuple of KnobLadder
    unknown : dict of str to str
        Knobs without a rung of their own: why.
    machine : dict of str to Any
        Processor, cores, versions, date.
    """

    device: str
    case: str
    drive: dict[str, Any]
    torque: float
    scatter: float
    freedom: float
    strain: float | None
    packings: int
    seconds: float
    knobs: tuple[KnobLadder, ...]
    unknown: dict[str, str] = field(default_factory=dict)
    machine: dict[str, Any] = field(default_factory=dict)

    def knob(self, name: str) -> KnobLadder | None:
        """Return the rungs of a knob; None where it has none."""
        return next((one for one in self.knobs if one.knob == name), None)

    def on_another_machine(self, slower: float) -> Ladder:
        """Return the ladder with the times of a machine that is slower by a factor."""
        knobs = tuple(
            replace(one, rungs=tuple(replace(rung, seconds=slower * rung.seconds) for rung in one.rungs))
            for one in self.knobs
        )
        return replace(self, seconds=slower * self.seconds, knobs=knobs)

    @property
    def statistical(self) -> float:
        """Half the 95 % interval of the mean of its packings at the scene's own settings, relative."""
        return student(self.freedom) * self.scatter / math.sqrt(self.packings)

    def corrected_torque(self, total: Total) -> tuple[float, float]:
        """Return the torque without the error of the scene's own settings [N m], and half its 95 % interval, relative.

        Its packings are also those that the errors are measured by: their noise raises the torque and the biases
        alike, and counts by what is left of it.
        """
        statistical = self.statistical
        shared = sum(one.shared for one in total.parts.values())
        half = math.sqrt(max(0.0, total.half_width**2 - shared**2) + (statistical - shared) ** 2)
        return self.torque / (1.0 + total.bias), half

    def total(self, step_sizes: Mapping[str, float], limits: Mapping[str, float] | None = None) -> Total:
        """Return the discretisation error at some step sizes, one for each knob of a scene.

        `limits`: step sizes without error by knob, where they are others than the ladder's.
        """
        parts, unknown = {}, {}
        for name, h in step_sizes.items():
            ladder = self.knob(name)
            found = None if ladder is None else ladder.error(h, (limits or {}).get(name))
            if found is None:
                unknown[name] = self.unknown.get(name) or (
                    "the ladder has no rungs of it"
                    if ladder is None or ladder.error(ladder.rungs[-1].step_size) is None
                    else "coarser than all settings that were measured, and no law is known"
                )
            else:
                parts[name] = found
        return Total(parts, unknown)

    def to_json(self) -> str:
        """Return the ladder as text."""
        values = {"version": VERSION} | asdict(self)
        for one in values["knobs"]:
            del one["_fit"]
            one["freedom"] = None if math.isinf(one["freedom"]) else one["freedom"]
        return json.dumps(values, indent=2)

    @classmethod
    def from_json(cls, text: str) -> Ladder:
        """Read what `to_json` wrote; ValueError or KeyError for anything else."""
        values = json.loads(text)
        if values.pop("version", None) != VERSION:
            raise ValueError("it is of another version of the program")
        knobs = []
        for one in values.pop("knobs"):
            rungs = tuple(Rung(**rung) for rung in one.pop("rungs"))
            freedom = one.pop("freedom")
            basis = Basis(one.pop("basis"))
            knobs.append(KnobLadder(**one, basis=basis, rungs=rungs, freedom=math.inf if freedom is None else freedom))
        return cls(**values, knobs=tuple(knobs))


def student(freedom: float) -> float:
    """Return the quantile of Student's t of a 95 % interval."""
    from scipy.special import stdtrit

    return 1.96 if math.isinf(freedom) else float(stdtrit(freedom, 0.5 + 0.5 * CONFIDENCE))


def pooled_scatter(groups: Sequence[tuple[Sequence[float], float]]) -> tuple[float, float]:
    """Return the relative standard deviation of packings, and its degrees of freedom.

    Parameters
    ----------
    groups : of each rung the torques of its packings [N m], and by what factor its variance is expected to be that of
        the scene's own settings (grains there over grains here).
    """
    squares, freedom = 0.0, 0
    for torques, factor in groups:
        if len(torques) > 1:
            logs = np.log(np.abs(torques))
            squares += float(((logs - logs.mean()) ** 2).sum()) / factor
            freedom += len(torques) - 1
    if freedom == 0:
        raise ValueError("no rung has two packings: nothing says how much packings differ; run at least two of one")
    return math.sqrt(squares / freedom), float(freedom)


@dataclass(frozen=True)
class _Fit:
    """Law of a knob's rungs: ln T = const + c x, x = h^p - h_0^p; with p None the differences of the rungs."""

    verdict: str
    coarsest: float  # step size
    finest: float
    p: float | None = None
    slope: float = 0.0
    slope_half: float = 0.0
    slope_shared: float = 0.0
    misfit: float = 0.0  # largest distance of a rung from the line
    deviation: float = 0.0  # half width of what rungs differ from the law by beyond their noise
    others: tuple[tuple[float, float], ...] = ()  # order and slope of other laws that the rungs allow
    observed: float | None = None
    differences: dict[float, KnobError] = field(default_factory=dict)  # without a law, by step size

    def error(self, h: float, limit: float) -> KnobError | None:
        """Return the error at a step size; without a law that of the next coarser rung, None where there is none."""
        outside = h > self.coarsest * (1.0 + 1e-6)
        if self.p is None:
            coarser = [one for one in self.differences if one >= h * (1.0 - 1e-6)]
            return self.differences[min(coarser)] if coarser else None
        if math.isclose(h, limit, rel_tol=1e-6):
            return KnobError(0.0, 0.0)
        x = h**self.p - limit**self.p
        changes = [min(c * (h**p - limit**p), 5.0) for p, c in ((self.p, self.slope), *self.others)]
        change, apart = 0.5 * (max(changes) + min(changes)), 0.5 * (max(changes) - min(changes))
        model = SAFETY["no law" if outside else self.verdict] - 1.0
        if self.verdict == "no law" and not outside:  # the rungs have measured what the finest one does not lack
            model *= max(abs(self.slope * (min(h, self.finest) ** self.p - limit**self.p)), self.misfit)
        else:
            model *= abs(change)
        half = apart + math.hypot(self.slope_half * x, model, self.deviation)
        return KnobError(math.expm1(change), half, self.slope_shared * x, abs(self.slope_half * x))


def _fitted(ladder: KnobLadder) -> _Fit | None:
    rungs = sorted((rung for rung in ladder.rungs if rung.value), key=lambda rung: -rung.step_size)
    if len(rungs) < 2 or any(rung.value * (rungs[0].value or 0.0) <= 0.0 for rung in rungs if rung.value):
        return None
    h = np.array([rung.step_size for rung in rungs])
    y = np.log(np.abs([float(rung.value or 0.0) for rung in rungs]))
    error = np.array([rung.error for rung in rungs])
    if not error.any():
        return _without_noise(ladder, h, y)
    shares = ladder.basis is Basis.TORQUE
    own = np.array([shares and ladder.is_own(rung.setting) for rung in rungs])
    half = student(ladder.freedom) * error
    return _differences(h, y, half, own) if ladder.order is None else _line(ladder, h, y, error, own)


def _without_noise(ladder: KnobLadder, h: np.ndarray, y: np.ndarray) -> _Fit:
    """Fit the order; without one that fits the differences count, three times the largest of finer rungs."""
    low, high = (ORDERS[0], ORDERS[-1]) if ladder.order is None else (0.5 * ladder.order, 2.0 * ladder.order)
    orders = ORDERS[(ORDERS >= low) & (ORDERS <= high)]
    spread = float(np.ptp(y))
    if h.size > 2 and spread > 0.0 and h.max() >= NARROW * h.min():
        best = None
        for p in orders:
            x = h**p - ladder.limit**p
            slope, constant = np.polyfit(x, y, 1)
            misfit = float(np.abs(y - constant - slope * x).max())
            if best is None or misfit < best[0]:
                best = misfit, float(p), float(slope)
        assert best is not None
        misfit, p, slope = best
        if misfit <= MISFIT * spread and p not in (orders[0], orders[-1]):
            return _Fit("follows", float(h.max()), float(h.min()), p, slope, deviation=misfit, observed=p)
    found = {}
    last_step = abs(float(y[-2] - y[-1]))
    for i, one in enumerate(h):
        largest = max(last_step, float(np.abs(y[i:] - y[i]).max()))
        found[float(one)] = KnobError(math.expm1(float(y[i] - y[-1])), (SAFETY["no law"] - 1.0) * largest)
    return _Fit("no law", float(h.max()), float(h.min()), differences=found)


def _differences(h: np.ndarray, y: np.ndarray, half: np.ndarray, own: np.ndarray) -> _Fit:
    """Differences of noisy rungs from the finest one, where nothing is known of their law."""
    model = SAFETY["not checked"] - 1.0
    found = {}
    last_step = abs(float(y[-2] - y[-1]))  # what the finest one lacks is no better known
    for i, one in enumerate(h):
        difference = float(y[i] - y[-1])
        shared = float(half[i] * own[i] - half[-1] * own[-1])
        noise = math.hypot(float(half[min(i, len(h) - 2)]), float(half[-1]))
        half_width = math.hypot(noise, model * max(abs(difference), last_step))
        found[float(one)] = KnobError(math.expm1(difference), half_width, shared, noise)
    return _Fit("no law", float(h.max()), float(h.min()), differences=found)


def _line(ladder: KnobLadder, h: np.ndarray, y: np.ndarray, error: np.ndarray, own: np.ndarray) -> _Fit:
    """Weighted least squares of noisy rungs over the law, or over those of other orders where they do not follow it."""
    assert ladder.order is not None
    law = _Line.of(ladder, ladder.order, h, y, error)
    verdict, others = "not checked" if h.size == 2 else "follows" if law.passes else "no law", []
    if verdict == "no law":
        allowed = ORDERS[(ORDERS >= 0.5 * ladder.order) & (ORDERS <= 2.0 * ladder.order)]
        others = [one for p in allowed if (one := _Line.of(ladder, float(p), h, y, error)).passes]
    if others:  # the law is not dropped: it is refused in 5 % of all cases where it holds
        verdict, others, law = "other order", [law, *others], max(others, key=lambda one: one.by_chance)
    quantile = student(ladder.freedom)
    shared = float(((law.x - law.mean) / error)[own].sum()) / law.spread  # of the slope, by the noise of the own rung
    return _Fit(
        verdict,
        float(h.max()),
        float(h.min()),
        law.p,
        law.slope,
        quantile * law.spread**-0.5,
        quantile * shared,
        law.misfit,
        quantile * law.deviation,
        others=tuple((one.p, one.slope) for one in others),
        observed=law.p if others else None,
    )


@dataclass(frozen=True)
class _Line:
    """Weighted least squares of noisy rungs over x = h^p - h_0^p."""

    p: float
    x: np.ndarray
    mean: float
    spread: float
    slope: float
    misfit: float
    deviation: float  # standard one, of the rungs from the law beyond their noise
    by_chance: float

    @property
    def passes(self) -> bool:
        return self.by_chance >= SIGNIFICANCE

    @classmethod
    def of(cls, ladder: KnobLadder, p: float, h: np.ndarray, y: np.ndarray, error: np.ndarray) -> _Line:
        from scipy.special import chdtrc, fdtrc

        x, weight = h**p - ladder.limit**p, error**-2
        mean_x, mean_y = (float(weight @ one / weight.sum()) for one in (x, y))
        spread = float(weight @ (x - mean_x) ** 2)
        slope = float(weight @ ((x - mean_x) * (y - mean_y))) / spread
        left = y - mean_y - slope * (x - mean_x)
        chi2, freedom = float(weight @ left**2), max(h.size - 2, 1)
        by_chance = (
            chdtrc(freedom, chi2) if math.isinf(ladder.freedom) else fdtrc(freedom, ladder.freedom, chi2 / freedom)
        )
        deviation = 0.0
        if h.size > 2:
            expected = weight.sum() - weight @ weight / weight.sum() - weight**2 @ (x - mean_x) ** 2 / spread
            deviation = math.sqrt(max(0.0, chi2 - freedom) / float(expected))
        return cls(p, x, mean_x, spread, slope, float(np.abs(left).max()), deviation, float(by_chance))
