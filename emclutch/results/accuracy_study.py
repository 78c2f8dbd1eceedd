"""Accuracy study of a device: how much each numerical setting changes its torque, and what it costs.

The study measures each setting (`emclutch.settings`) at several values, all others being the scene's own. The result at
a value is the mean torque of some replicas, or a quantity without noise. The errors of all settings follow from these
results by one posterior (`emclutch.results.setting_errors`).
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

from emclutch.results.fits import NORMAL, student
from emclutch.results.setting_errors import SMALL_ERROR, SettingErrors, own_place

SMALL = 0.01
"""Half width of an error that needs no decision."""
CONFIDENCE = 0.95
VERSION = 4
"""Of the file: the settings, and the units and step sizes of their values, are those of this version."""
LARGEST = 300.0
"""Largest logarithm of a torque over that without error; it is far beyond the values that are measured."""
INTERACTION = "interaction"
"""Name of the part of the error that belongs to no single setting: what errors may do to each other."""


class Basis(StrEnum):
    """Quantity that is measured at each value of a setting."""

    TORQUE = "torque"
    MOMENTS = "moments"
    """Sum of squared moments of a frozen packing, to which the torque is taken to be in proportion."""
    START_UP = "start_up"
    """Torque of the same replicas, averaged from another strain on."""


@dataclass(frozen=True, slots=True)
class MeasuredValue:
    """One value of a setting, and the result at it.

    Attributes
    ----------
    value, step_size : float
        As of the setting; the step size is its h.
    result : float or None
        Mean torque [N m], or the quantity of the basis; None: no replica has one.
    error : float
        Relative standard error of the result, by the pooled scatter; 0 without noise.
    replicas : int
    seconds : float
        Processor time of a replica, or of a solution [s].
    cost : float
        Processor time of a replica at this value over that at the scene's own; predicted where no replica was run.
    failure : str
        Why there is no result.
    """

    value: float
    step_size: float
    result: float | None
    error: float
    replicas: int
    seconds: float
    cost: float = 1.0
    failure: str = ""


@dataclass(frozen=True, slots=True)
class SettingError:
    """Error of the torque by a value of a setting, relative to the torque without it.

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
    def of(cls, draws: np.ndarray) -> SettingError:
        """Return the error of draws of ln(T/T_0) and of their noise, (2, s): the median, and what 95 % lie within."""
        middle = min(float(np.median(draws[0])), LARGEST)
        half = min(float(np.quantile(np.abs(draws[0] - middle), CONFIDENCE)), LARGEST)
        return cls(math.expm1(middle), half, min(NORMAL * float(draws[1].std()), half))

    @property
    def interval(self) -> tuple[float, float]:
        """Return the ends of the 95 % interval of the bias."""
        return (1.0 + self.bias) * math.exp(-self.half_width) - 1.0, (1.0 + self.bias) * math.exp(self.half_width) - 1.0

    @property
    def is_significant(self) -> bool:
        """Return whether the interval of the bias excludes zero, or lies within 1 %."""
        low, high = self.interval
        return low * high > 0.0 or max(-low, high) <= SMALL


Draws = tuple[np.ndarray, SettingError]


@dataclass(frozen=True)
class MeasuredSetting:
    """One setting, measured at several values.

    Attributes
    ----------
    name, key : str
    basis : Basis
    own : float
        The scene's own value.
    order : float or None
        Of convergence in theory; None: unknown.
    limit : float
        Step size without error.
    values : tuple of MeasuredValue
        From coarse to fine.
    freedom : float
        Degrees of freedom of the pooled scatter; infinite without noise.
    is_large : bool
        Whether its error is large in most scenes.
    """

    name: str
    key: str
    basis: Basis
    own: float
    order: float | None
    limit: float
    values: tuple[MeasuredValue, ...]
    freedom: float = math.inf
    is_large: bool = False

    def is_own(self, value: float) -> bool:
        """Return whether a value is the scene's own."""
        return math.isclose(value, self.own, rel_tol=1e-6)

    @property
    def own_step_size(self) -> float | None:
        """Return the step size of the scene's own value; None where its error is not known."""
        place, known = own_place(self), [one for one in self.values if one.result]
        return None if place is None or len(known) < 2 else known[place].step_size


@dataclass(frozen=True, slots=True)
class Total:
    """Discretisation error of a run, from the accuracy study of its device.

    Attributes
    ----------
    parts : dict of str to SettingError
        By setting.
    unknown : dict of str to str
        Settings whose error is not known, with the reason.
    whole : SettingError
        Of all settings together.
    interaction : float
        Half width for what errors may do to each other.
    """

    parts: dict[str, SettingError]
    unknown: dict[str, str]
    whole: SettingError
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
        """The part of the half width by noise, which more replicas of the study lower."""
        return self.whole.noise

    @property
    def widths(self) -> dict[str, float]:
        """Return the half width by each setting, and by the interaction where there is one."""
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
            name: asdict(one) | {"interval": one.interval, "significant": one.is_significant}
            for name, one in self.parts.items()
        }
        return {
            "bias": self.bias, "half_width": self.half_width, "interval": self.whole.interval,
            "interaction": self.interaction, "largest": self.largest, "parts": parts, "unknown": self.unknown,
        }  # fmt: skip


@dataclass(frozen=True)
class AccuracyStudy:
    """The results of an accuracy study.

    Attributes
    ----------
    device : str
        Hash of what matters (`emclutch.results.accuracy_studies.device_hash`).
    case : str
        Name of the scene.
    drive : dict of str to Any
        Entries of the scene that the hash leaves out, as the current.
    torque : float
        Mean at the scene's own settings [N m].
    scatter : float
        Relative standard deviation between replicas at the scene's own settings.
    freedom : float
        Degrees of freedom of the pooled scatter.
    strain : float or None
        Shear strain that is averaged in each replica.
    replicas : int
        At the scene's own settings.
    seconds : float
        Processor time of one of them [s].
    settings : tuple of MeasuredSetting
    unknown : dict of str to str
        Settings that were not measured, with the reason.
    over_budget : tuple of str
        Those of them that the budget had no room for.
    machine : dict of str to Any
        Processor, cores, versions, date.
    kind : str
        `geometry.kind` of the scene; empty: not known.
    """

    device: str
    case: str
    drive: dict[str, Any]
    torque: float
    scatter: float
    freedom: float
    strain: float | None
    replicas: int
    seconds: float
    settings: tuple[MeasuredSetting, ...]
    unknown: dict[str, str] = field(default_factory=dict)
    over_budget: Sequence[str] = ()
    machine: dict[str, Any] = field(default_factory=dict)
    kind: str = ""

    def setting(self, name: str) -> MeasuredSetting | None:
        """Return a measured setting; None where it was not measured."""
        return next((one for one in self.settings if one.name == name), None)

    def on_another_machine(self, slower: float) -> AccuracyStudy:
        """Return the study with the times of a machine that is slower by a factor."""
        settings = tuple(
            replace(one, values=tuple(replace(measured, seconds=slower * measured.seconds) for measured in one.values))
            for one in self.settings
        )
        return replace(self, seconds=slower * self.seconds, settings=settings)

    @property
    def statistical(self) -> float:
        """Half the 95 % interval of the mean of its replicas at the scene's own settings, relative."""
        return student(self.freedom) * self.scatter / math.sqrt(self.replicas)

    @cached_property
    def posterior(self) -> SettingErrors:
        """Draws of the errors of all settings."""
        return SettingErrors(self._groups)

    @property
    def _groups(self) -> list[list[MeasuredSetting]]:
        told = [one for one in self.settings if one.name in self.told]
        of_torque = [one for one in told if one.basis is Basis.TORQUE]
        return [of_torque, *([one] for one in told if one.basis is not Basis.TORQUE)]

    @cached_property
    def _without_prior(self) -> SettingErrors:
        return SettingErrors(self._groups, has_prior=False)

    @property
    def without_prior(self) -> float:
        """Half width of the error of the scene's own settings without the prior of small errors."""
        return self._total({name: self._without_prior.error(name, h) for name, h in self.told.items()})[0].half_width

    def prior_check(self) -> tuple[float, int]:
        """Return chi^2 of the errors of small settings under their prior, and how many there are.

        Each is its estimate without the prior over that one's standard deviation and the scale of the prior.
        """
        small = [one.name for one in self.settings if one.name in self.told and not one.is_large]
        found = [SettingError.of(self._without_prior.error(name, self.told[name])) for name in small]
        return sum(one.bias**2 / ((one.half_width / NORMAL) ** 2 + SMALL_ERROR**2) for one in found), len(found)

    @cached_property
    def told(self) -> dict[str, float]:
        """Return the settings whose error is known, with the step size of the scene's own value."""
        return {one.name: h for one in self.settings if (h := one.own_step_size) is not None}

    @cached_property
    def _known(self) -> dict[tuple[str, float, float | None], Draws]:
        return {}

    def draws(self, setting: str, step_size: float, limit: float | None = None) -> Draws | None:
        """Return draws of ln(T/T_0) at a value, and of their noise, (2, s), and the error; None where it is not known.

        `limit`: step size without error, where it is another one than that of the study.
        """
        measured, key = self.setting(setting), (setting, step_size, limit)
        if measured is None or setting not in self.told:
            return None
        coarsest = max(one.step_size for one in measured.values if one.result)
        if measured.order is None and step_size > coarsest * (1.0 + 1e-6):
            return None
        if key not in self._known:
            found = self.posterior.error(setting, step_size, limit)
            self._known[key] = found, SettingError.of(found)
        return self._known[key]

    def error(self, setting: str, step_size: float | None = None, limit: float | None = None) -> SettingError | None:
        """Return the error at a value by its step size, default the scene's own; None where it is not known."""
        h = self.told.get(setting) if step_size is None else step_size
        found = None if h is None else self.draws(setting, h, limit)
        return None if found is None else found[1]

    def best_estimate(self) -> tuple[float, float]:
        """Return the torque without the error of the scene's own settings [N m], and half its 95 % interval, relative.

        Its replicas are also those that the errors are measured by.
        """
        errors = {name: found[0] for name, h in self.told.items() if (found := self.draws(name, h)) is not None}
        whole, _, draws = self._total(errors)
        if not self._groups[0]:  # of the mean at the scene's own settings the errors say nothing
            return self.torque / (1.0 + whole.bias), math.hypot(self.statistical, whole.half_width)
        torque = SettingError.of(self.posterior.level - draws)
        return math.copysign(1.0 + torque.bias, self.torque), torque.half_width

    def total(self, step_sizes: Mapping[str, float], limits: Mapping[str, float] | None = None) -> Total:
        """Return the discretisation error at some step sizes, one for each setting of a scene.

        `limits`: step sizes without error by setting, where they are others than those of the study.
        """
        parts, unknown, limits = {}, {}, limits or {}
        for name, h in step_sizes.items():
            found = self.draws(name, h, limits.get(name))
            if found is None:
                unknown[name] = self.unknown.get(name) or (
                    "coarser than all values that were measured, and no order of convergence is known"
                    if name in self.told
                    else "the accuracy study has not measured it"
                )
            else:
                parts[name] = found
        whole, interaction, _ = self._total({name: one[0] for name, one in parts.items()})
        return Total({name: one[1] for name, one in parts.items()}, unknown, whole, interaction)

    def _total(self, draws: Mapping[str, np.ndarray]) -> tuple[SettingError, float, np.ndarray]:
        """Return the error by some draws together, the half width of their interaction, and the draws of the whole."""
        if not draws:
            return SettingError(0.0, 0.0), 0.0, np.zeros_like(self.posterior.level)
        whole = np.sum(list(draws.values()), axis=0)
        between = self.posterior.interaction(list(draws.values()))
        whole[0] += between
        return SettingError.of(whole), float(np.quantile(np.abs(between), CONFIDENCE)), whole

    def to_json(self) -> str:
        """Return the study as text."""
        entries = {"version": VERSION} | asdict(self)
        for one in entries["settings"]:
            one["freedom"] = None if math.isinf(one["freedom"]) else one["freedom"]
        return json.dumps(entries, indent=2)

    @classmethod
    def from_json(cls, text: str) -> AccuracyStudy:
        """Read what `to_json` wrote; ValueError or KeyError for anything else."""
        entries = json.loads(text)
        if (version := entries.pop("version", None)) != VERSION:
            raise ValueError(f"it is of version {version} of accuracy studies; this program reads {VERSION}")
        settings = []
        for one in entries.pop("settings"):
            values = tuple(_measured_value(measured) for measured in one.pop("values"))
            freedom = one.pop("freedom")
            basis = Basis(one.pop("basis"))
            freedom = math.inf if freedom is None else _positive("freedom", freedom)
            settings.append(MeasuredSetting(**one, basis=basis, values=values, freedom=freedom))
        for name in ("freedom", "replicas", "seconds"):
            _positive(name, entries[name])
        if not 0.0 <= entries["scatter"] < math.inf:
            raise ValueError(f"scatter = {entries['scatter']!r} is out of range; allowed: finite numbers from 0 on")
        if not 0.0 < abs(entries["torque"]) < math.inf:
            raise ValueError(f"torque = {entries['torque']!r} is out of range; allowed: any finite number but 0")
        return cls(**entries, settings=tuple(settings))


def pooled_scatter(groups: Sequence[tuple[Sequence[float], float]]) -> tuple[float, float]:
    """Return the relative standard deviation of replicas, and its degrees of freedom.

    Parameters
    ----------
    groups : of each value the torques of its replicas [N m], and the expected ratio of their variance to that at the
        scene's own settings (grains there over grains here).
    """
    squares, freedom = 0.0, 0
    for torques, factor in groups:
        if len(torques) > 1:
            logs = np.log(np.abs(torques))
            squares += float(((logs - logs.mean()) ** 2).sum()) / factor
            freedom += len(torques) - 1
    if freedom == 0:
        raise ValueError("no value has two replicas, so their scatter is unknown; run at least two replicas of one")
    return math.sqrt(squares / freedom), float(freedom)


def _positive(name: str, value: Any) -> float:
    """Return a number above 0; ValueError for another one, TypeError for what is no number."""
    if not 0.0 < value < math.inf:
        raise ValueError(f"{name} = {value!r} is out of range; allowed: finite numbers above 0")
    return float(value)


def _measured_value(entries: Mapping[str, Any]) -> MeasuredValue:
    """Return a measured value from plain entries; ValueError or TypeError where one is no number."""
    numbers = ("value", "step_size", "error", "seconds", "cost")
    result = entries["result"]
    return MeasuredValue(**{**entries, **{name: float(entries[name]) for name in numbers if name in entries},
                   "result": None if result is None else float(result)})  # fmt: skip
