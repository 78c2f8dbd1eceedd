"""Ladders of a device: how much each numerical setting moves its torque, and what it costs.

A *knob* (`emclutch.knobs`) is a numerical parameter. A *rung* is one setting of it, all others being the scene's own;
its value is the mean torque of some replicas, or a quantity without noise. A *ladder* is the rungs of all knobs. What
the rungs say of the errors of all settings is one posterior (`emclutch.results.setting_errors`).
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from enum import StrEnum
from functools import cached_property
from typing import Any

import numpy as np

from emclutch.results.setting_errors import NORMAL, SMALL_ERROR, SettingErrors, own_place

SMALL = 0.01
"""Half width of an error that needs no decision."""
CONFIDENCE = 0.95
VERSION = 3
"""Of the file: settings, units and step sizes of the knobs are those of this version; since 2 sectors of finer grains
are as wide as those of the scene; since 3 it says which errors are large."""
LARGEST = 300.0
"""Logarithm of a torque over that without error, that is told: far beyond the settings that were measured."""
LARGE = ("grains_across",)
"""Knobs whose errors are large in most scenes, in files of version 2."""
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
        Of the 95 % interval of the logarithm of the torque so corrected.
    noise : float
        The part of `half_width` by the scatter between replicas, which more of them lower.
    """

    bias: float
    half_width: float
    noise: float = 0.0

    @classmethod
    def of(cls, draws: np.ndarray) -> KnobError:
        """Return the error of draws of ln(T/T_0) and of their noise, (2, s): the median, and what 95 % lie within."""
        middle = min(float(np.median(draws[0])), LARGEST)
        half = min(float(np.quantile(np.abs(draws[0] - middle), CONFIDENCE)), LARGEST)
        return cls(math.expm1(middle), half, min(NORMAL * float(draws[1].std()), half))

    @property
    def interval(self) -> tuple[float, float]:
        """Return the ends of the 95 % interval of the bias."""
        return (1.0 + self.bias) * math.exp(-self.half_width) - 1.0, (1.0 + self.bias) * math.exp(self.half_width) - 1.0

    @property
    def is_decided(self) -> bool:
        """Return whether the bias differs from zero, or is small, at the confidence of its interval."""
        low, high = self.interval
        return low * high > 0.0 or max(-low, high) <= SMALL


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
        Of convergence in theory; None: unknown.
    limit : float
        Step size without error.
    rungs : tuple of Rung
        From coarse to fine.
    freedom : float
        Degrees of freedom of the pooled scatter; infinite without noise.
    is_large : bool
        Whether its error is large in most scenes.
    """

    knob: str
    key: str
    basis: Basis
    own: float
    order: float | None
    limit: float
    rungs: tuple[Rung, ...]
    freedom: float = math.inf
    is_large: bool = False

    def is_own(self, setting: float) -> bool:
        """Return whether a setting is the scene's own."""
        return math.isclose(setting, self.own, rel_tol=1e-6)

    @property
    def own_step_size(self) -> float | None:
        """Return the step size of the scene's own setting; None where the knob does not tell its error."""
        place, values = own_place(self), [one for one in self.rungs if one.value]
        return None if place is None or len(values) < 2 else values[place].step_size


@dataclass(frozen=True, slots=True)
class Total:
    """Discretisation error of a run, from the ladder of its device.

    Attributes
    ----------
    parts : dict of str to KnobError
        By knob.
    unknown : dict of str to str
        Knobs whose error is not known: why.
    whole : KnobError
        Of all settings together.
    interaction : float
        Half width for what errors may do to each other.
    """

    parts: dict[str, KnobError]
    unknown: dict[str, str]
    whole: KnobError
    interaction: float = 0.0

    @property
    def bias(self) -> float:
        """Relative error by all settings together."""
        return self.whole.bias

    @property
    def half_width(self) -> float:
        """Of its 95 % interval."""
        return self.whole.half_width

    @property
    def noise(self) -> float:
        """The part of the half width by noise, which more packings of the ladder lower."""
        return self.whole.noise

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
        parts = {
            name: asdict(one) | {"interval": one.interval, "decided": one.is_decided}
            for name, one in self.parts.items()
        }
        return {
            "bias": self.bias, "half_width": self.half_width, "interval": self.whole.interval,
            "interaction": self.interaction, "largest": self.largest, "parts": parts, "unknown": self.unknown,
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

    @cached_property
    def posterior(self) -> SettingErrors:
        """Draws of the errors of all knobs."""
        return SettingErrors(self._groups)

    @property
    def _groups(self) -> list[list[KnobLadder]]:
        told = [one for one in self.knobs if one.knob in self.told]
        of_torque = [one for one in told if one.basis is Basis.TORQUE]
        return [of_torque, *([one] for one in told if one.basis is not Basis.TORQUE)]

    @cached_property
    def _without_prior(self) -> SettingErrors:
        return SettingErrors(self._groups, has_prior=False)

    @property
    def without_prior(self) -> float:
        """Half width of the error of the scene's own settings if nothing is assumed of the size of small errors."""
        return self._total({name: self._without_prior.error(name, h) for name, h in self.told.items()})[0].half_width

    def prior_check(self) -> tuple[float, int]:
        """Return chi^2 of the errors of small settings under their prior, and how many there are.

        Each is its estimate without the prior over that one's standard deviation and the scale of the prior.
        """
        small = [one.knob for one in self.knobs if one.knob in self.told and not one.is_large]
        found = [KnobError.of(self._without_prior.error(name, self.told[name])) for name in small]
        return sum(one.bias**2 / ((one.half_width / NORMAL) ** 2 + SMALL_ERROR**2) for one in found), len(found)

    @cached_property
    def told(self) -> dict[str, float]:
        """Return the knobs whose error is told, with the step size of the scene's own setting."""
        return {one.knob: h for one in self.knobs if (h := one.own_step_size) is not None}

    @cached_property
    def _known(self) -> dict[tuple[str, float, float | None], tuple[np.ndarray, KnobError]]:
        return {}

    def draws(self, knob: str, step_size: float, limit: float | None = None) -> tuple[np.ndarray, KnobError] | None:
        """Return draws of ln(T/T_0) of a setting, and of their noise, (2, s), and the error; None where none is told.

        `limit`: step size without error, where it is another one than the ladder's.
        """
        rungs, key = self.knob(knob), (knob, step_size, limit)
        if rungs is None or knob not in self.told:
            return None
        coarsest = max(one.step_size for one in rungs.rungs if one.value)
        if rungs.order is None and step_size > coarsest * (1.0 + 1e-6):
            return None
        if key not in self._known:
            found = self.posterior.error(knob, step_size, limit)
            self._known[key] = found, KnobError.of(found)
        return self._known[key]

    def error(self, knob: str, step_size: float | None = None, limit: float | None = None) -> KnobError | None:
        """Return the error of a setting by its step size, default the scene's own; None where the rungs say nothing."""
        h = self.told.get(knob) if step_size is None else step_size
        found = None if h is None else self.draws(knob, h, limit)
        return None if found is None else found[1]

    def corrected_torque(self) -> tuple[float, float]:
        """Return the torque without the error of the scene's own settings [N m], and half its 95 % interval, relative.

        Its replicas are also those that the errors are measured by.
        """
        errors = {name: found[0] for name, h in self.told.items() if (found := self.draws(name, h)) is not None}
        whole, _, draws = self._total(errors)
        if not self._groups[0]:  # of the mean at the scene's own settings the errors say nothing
            return self.torque / (1.0 + whole.bias), math.hypot(self.statistical, whole.half_width)
        torque = KnobError.of(self.posterior.level - draws)
        return math.copysign(1.0 + torque.bias, self.torque), torque.half_width

    def total(self, step_sizes: Mapping[str, float], limits: Mapping[str, float] | None = None) -> Total:
        """Return the discretisation error at some step sizes, one for each knob of a scene.

        `limits`: step sizes without error by knob, where they are others than the ladder's.
        """
        parts, unknown, limits = {}, {}, limits or {}
        for name, h in step_sizes.items():
            found = self.draws(name, h, limits.get(name))
            if found is None:
                unknown[name] = self.unknown.get(name) or (
                    "coarser than all settings that were measured, and no law is known"
                    if name in self.told
                    else "the ladder has no rungs of it"
                )
            else:
                parts[name] = found
        whole, interaction, _ = self._total({name: one[0] for name, one in parts.items()})
        return Total({name: one[1] for name, one in parts.items()}, unknown, whole, interaction)

    def _total(self, draws: Mapping[str, np.ndarray]) -> tuple[KnobError, float, np.ndarray]:
        """Return the error by some draws together, the half width of their interaction, and the draws of the whole."""
        if not draws:
            return KnobError(0.0, 0.0), 0.0, np.zeros_like(self.posterior.level)
        whole = np.sum(list(draws.values()), axis=0)
        between = self.posterior.interaction(list(draws.values()))
        whole[0] += between
        return KnobError.of(whole), float(np.quantile(np.abs(between), CONFIDENCE)), whole

    def to_json(self) -> str:
        """Return the ladder as text."""
        values = {"version": VERSION} | asdict(self)
        for one in values["knobs"]:
            one["freedom"] = None if math.isinf(one["freedom"]) else one["freedom"]
        return json.dumps(values, indent=2)

    @classmethod
    def from_json(cls, text: str) -> Ladder:
        """Read what `to_json` wrote; ValueError or KeyError for anything else."""
        values = json.loads(text)
        if (version := values.pop("version", None)) not in (2, VERSION):
            raise ValueError(f"it is of version {version} of accuracy studies; this program reads 2 and {VERSION}")
        knobs = []
        for one in values.pop("knobs"):
            rungs = tuple(_rung_of(rung) for rung in one.pop("rungs"))
            freedom = one.pop("freedom")
            one.setdefault("is_large", one["knob"] in LARGE)
            basis = Basis(one.pop("basis"))
            freedom = math.inf if freedom is None else _positive("freedom", freedom)
            knobs.append(KnobLadder(**one, basis=basis, rungs=rungs, freedom=freedom))
        for name in ("freedom", "packings", "seconds"):
            _positive(name, values[name])
        if not 0.0 <= values["scatter"] < math.inf:
            raise ValueError(f"scatter = {values['scatter']!r} is out of range; allowed: finite numbers from 0 on")
        if not 0.0 < abs(values["torque"]) < math.inf:
            raise ValueError(f"torque = {values['torque']!r} is out of range; allowed: any finite number but 0")
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


def _positive(name: str, value: Any) -> float:
    """Return a number above 0; ValueError for another one, TypeError for what is no number."""
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} = {value!r} is out of range; allowed: finite numbers above 0")
    return float(value)


def _rung_of(values: Mapping[str, Any]) -> Rung:
    """Return a rung of plain values; ValueError or TypeError where one is no number."""
    numbers = ("setting", "step_size", "error", "seconds", "cost")
    value = values["value"]
    return Rung(**{**values, **{name: float(values[name]) for name in numbers if name in values},
                   "value": None if value is None else float(value)})  # fmt: skip
