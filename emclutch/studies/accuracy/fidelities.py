"""The cheapest fidelity that reaches a wanted accuracy: the law of the powder, or grains with a study's settings.

The law's interval is that of runs of grains over the law (docs/explanation/two_scales.md). The errors of grains are
those of an accuracy study; before there is one, those of the studies of other devices estimate what it will find.
Neither has the error of the powder's data.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from time import process_time
from typing import Any

from emclutch.device_model.device import build_device
from emclutch.results.accuracy_studies import known_studies
from emclutch.results.recommended import STATISTICS, Choice, LimitingError
from emclutch.results.report.report import Mark, Statement, note
from emclutch.results.text import format_cost, format_duration, format_percent, in_words
from emclutch.scene.case import Case
from emclutch.scene.errors import bad_input_for
from emclutch.settings import settings_of
from emclutch.simulation.forecast.expected_field import expected_magnetisation
from emclutch.simulation.forecast.expected_torque import ExpectedTorque, expected_torque
from emclutch.simulation.plan import make_plan
from emclutch.simulation.recommended_case import cheapest_case

COST_FACTOR = 5.0
"""Factor that an estimate of the cost by other devices is uncertain by: for 10 % the plan has 18 s for the quickstart
by the study of the brake, and 41 s for the brake by its own, and the replicas of their studies took 37 and 178 s."""


@dataclass(frozen=True, slots=True)
class TorqueByLaw:
    """The torque of a scene by the law of its powder, without a run.

    Attributes
    ----------
    expected : ExpectedTorque
    seconds : float
        Processor time that it took [s].
    command : str
        That prints it.
    """

    expected: ExpectedTorque
    seconds: float
    command: str

    @classmethod
    def of(cls, case: Case, source: str | None = None) -> TorqueByLaw:
        """Return that of a scene, named `source` in the command; SceneError where its field cannot be solved."""
        start = process_time()
        with bad_input_for(case.path):
            device = build_device(case.scene)
            field, _ = expected_magnetisation(case, device)
            expected = expected_torque(case.scene, device, field, unknown_powder=False)
        return cls(expected, process_time() - start, f"emclutch check {source or case.path or 'CASE'}")

    @property
    def half_width(self) -> float | None:
        """Half of the 95 % interval, relative; None of a guess."""
        real = self.expected.real
        return None if real is None or not self.expected.parts else real.high / real.mean - 1.0

    def in_words(self) -> str:
        """Return the torque with its interval and its cost; of a guess why it reaches no target."""
        text = f"The powder's law gives {self.expected.in_words().rstrip('.')}"
        if self.half_width is None:
            return f"{text}. It reaches no target."
        return f"{text} in seconds, without a run: {self.command}"

    def as_dict(self) -> dict[str, Any]:
        """Return torque [N m], interval, half width and processor time [s] for a report's data."""
        return self.expected.as_dict() | {"half_width": self.half_width, "seconds": self.seconds}


@dataclass(frozen=True, slots=True, kw_only=True)
class CheapestAnswer:
    """What reaches a half width at the least cost, or what a study takes that may.

    Attributes
    ----------
    target : float
        Half of the torque's 95 % interval, relative.
    law : TorqueByLaw
    grains : Choice, LimitingError or None
        What reaches it by the accuracy study of the device, or why nothing does; None: there is no study.
    own : Choice or None
        Runs at the settings of that study.
    command : str
        That runs the grains with these settings, or a study; empty: none.
    cores : int
        For which costs are wall-clock times too.
    estimate : dict or None
        Of `estimate_by_other_devices`.
    """

    target: float
    law: TorqueByLaw
    grains: Choice | LimitingError | None
    command: str
    cores: int
    own: Choice | None = None
    estimate: dict[str, Any] | None = None

    @property
    def fidelity(self) -> str | None:
        """The cheapest that reaches the target, "law" or "grains"; None: nothing known does."""
        if self.law.half_width is not None and self.law.half_width <= self.target:
            return "law"
        return "grains" if isinstance(self.grains, Choice) else None

    def as_dict(self) -> dict[str, Any]:
        """Return `target`, `fidelity`, `half_width`, processor time `seconds` [s] and `command` for a report's data.

        `reason` says why nothing known reaches it. Beside the law, `grains` has the same of grains that reach it.
        """
        found: dict[str, Any] = {"target": self.target, "fidelity": self.fidelity, "half_width": None, "seconds": None}
        found |= {"command": self.command, "reason": "", "estimate": self.estimate}
        grains: dict[str, Any] = {}
        if isinstance(self.grains, Choice):
            grains = {"half_width": self.grains.half_width, "seconds": self.grains.seconds}
        if self.fidelity == "law":
            known = {"half_width": self.law.half_width, "seconds": self.law.seconds, "command": self.law.command}
            return found | known | ({"grains": grains | {"command": self.command}} if grains else {})
        return found | (grains or {"reason": f"{self._by_law()}; {self._by_grains()}"})

    def in_words(self) -> Statement:
        """Return the answer, then what it follows from, then the command."""
        head, command = f"± {format_percent(self.target)}:", f": {self.command}" if self.command else ""
        grains = self.grains
        if isinstance(grains, Choice):
            reach = f"± {format_percent(grains.half_width)} in {grains.cost_in_words(self.cores)}{command}"
            if self.fidelity == "law":
                return note(f"{head} reached by the powder's law (± {format_percent(self.law.half_width or 0.0)}). "
                            f"Runs of grains reach {reach}")  # fmt: skip
            return note(f"{head} reached by runs of grains. {self._by_law()}. Runs of grains reach {reach}")
        if self.fidelity == "law":
            return note(f"{head} reached by the powder's law (± {format_percent(self.law.half_width or 0.0)}).")
        answer = "not reached" if grains is not None else "not known"
        text = f"{head} {answer}. {self._by_law()}. {self._by_grains()}."
        return Statement(Mark.WARNING, f"{text} {self._study_in_words()}{command}".rstrip())

    def _by_law(self) -> str:
        half = self.law.half_width
        return "The powder's law is a guess" if half is None else f"The powder's law gives ± {format_percent(half)}"

    def _by_grains(self) -> str:
        """Return what runs of grains reach, and by what they are limited."""
        if self.grains is None:
            none = "This device has no accuracy study"
            return none if self.estimate is None else f"{none}. {estimate_in_words(self.target, self.estimate)}"
        assert isinstance(self.grains, LimitingError)
        limit = in_words(self.grains.setting)
        if self.grains.half_width is None:
            return f"The error of the setting {limit} is not known: {self.grains.reason}"
        of = "scatter between replicas" if self.grains.setting == STATISTICS else limit
        limited = f"limited by the {of} (± {format_percent(self.grains.half_width)})"
        if self.own is None or self.own.total.unknown:
            return f"Runs of grains are {limited}"
        return f"Runs of grains reach ± {format_percent(self.own.half_width)}, {limited}"

    def _study_in_words(self) -> str:
        """Return what a study takes that may reach the target."""
        found = self.grains
        if found is None:
            if self.estimate is None or self.estimate["study_seconds"] is None:
                return "A study measures it"
            cost = format_cost(self.estimate["study_seconds"], self.cores)
            return f"A study of this device takes at least {cost} (estimate), and may not be enough"
        assert isinstance(found, LimitingError)
        if found.seconds is not None:
            cost = format_cost(found.seconds, self.cores)
            if found.at_least:
                return f"A finer value takes at least {cost}, and may not be enough"
            return f"A longer study of about {cost} may reach it"
        return "A longer study measures it" if found.needs_budget else "A study with other values may help"


def estimate_by_other_devices(case: Case, target: float, replica_seconds: float) -> dict[str, Any] | None:
    """Return what grains will cost for a half width if a device's errors are those of other devices.

    The settings that the accuracy study of another device recommends are taken, and their cost is that of the plan.
    Settings that the scene does not have are left out of the study.

    Parameters
    ----------
    target : relative half width of the torque's 95 % interval
    replica_seconds : processor time of a replica at the scene's own settings [s]

    Returns
    -------
    dict or None
        `devices`: names of the cases whose studies reach the target, or if none does of those that miss it; `seconds`:
        least and most processor time [s] of runs that reach the target, widened by `COST_FACTOR`, None where none of
        these devices reaches it; `half_width`: the least that they have; `limit`: the setting that limits it;
        `study_seconds`: processor time [s] of an accuracy study that may reach the target, at least. None where no
        study has the settings of the scene, or the scene refuses those that reach the target.
    """
    costs, missed = [], []
    settings = {one.name for one in settings_of(case.scene)}
    for known in known_studies():
        study = replace(known, settings=tuple(one for one in known.settings if one.name in settings))
        found = cheapest_case(case, study, target)
        if isinstance(found, LimitingError):
            # a combination that reaches the target, but which the scene refuses, says nothing of the errors
            if found.best is not None and found.best.half_width > target:
                missed.append((study.case, found.best.half_width, found, replica_seconds / study.seconds))
            continue
        choice, run = found
        cost = make_plan(run)[1].cost
        costs.append((study.case, choice.replicas * (sum(cost.loop.values()) + sum(cost.once.values()))))
    estimate: dict[str, Any] = dict.fromkeys(("seconds", "half_width", "limit", "study_seconds"))
    if costs:
        names, seconds = zip(*costs, strict=True)
        estimate |= {"seconds": [min(seconds) / COST_FACTOR, COST_FACTOR * max(seconds)], "half_width": target}
    elif missed:
        names, _, _, _ = zip(*missed, strict=True)
        _, half_width, error, ratio = min(missed, key=lambda one: one[1])
        more = None if error.seconds is None else ratio * error.seconds
        estimate |= {"half_width": half_width, "limit": error.setting, "study_seconds": more}
    else:
        return None
    return {"devices": [*names]} | estimate


def estimate_in_words(target: float, estimate: Mapping[str, Any]) -> str:
    """Return an estimate of `estimate_by_other_devices` as a sentence without its full stop."""
    devices = estimate["devices"]
    head = f"By the stud{'y' if len(devices) == 1 else 'ies'} of {' and '.join(devices)}, runs of grains reach"
    if estimate["seconds"] is not None:
        low, high = map(format_duration, estimate["seconds"])
        return f"{head} ± {format_percent(target)} in {low} to {high} of processor time (estimate)"
    limit, half = in_words(estimate["limit"]), format_percent(estimate["half_width"])
    return f"{head} ± {half} (estimate), limited by the {limit}"
