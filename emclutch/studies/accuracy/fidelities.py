"""The cheapest fidelity that reaches a wanted accuracy: the law of the powder, or grains with a study's settings.

The law's interval is that of runs of grains over the law (docs/explanation/two_scales.md). The errors of grains are
those of an accuracy study; before there is one, those of the studies of other devices estimate what it will find.
Neither has the error of the powder's data.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from time import process_time
from typing import Any

from emclutch.device_model.device import build_device
from emclutch.results.accuracy_studies import known_studies
from emclutch.results.recommended import Choice, LimitingError
from emclutch.results.report.report import Mark, Statement, note
from emclutch.results.text import format_cost, format_duration, format_percent
from emclutch.scene.case import Case
from emclutch.scene.errors import bad_input_for
from emclutch.settings import settings_of
from emclutch.simulation.forecast.expected_field import expected_magnetisation, limits_of
from emclutch.simulation.forecast.expected_torque import ExpectedTorque, expected_torque
from emclutch.simulation.plan import make_plan
from emclutch.simulation.recommended_case import cheapest_at

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
    warnings : tuple of str
        Of `limits_of`.
    """

    expected: ExpectedTorque
    seconds: float
    command: str
    warnings: tuple[str, ...] = ()

    @classmethod
    def of(cls, case: Case, source: str | None = None) -> TorqueByLaw:
        """Return that of a scene, named `source` in the command; SceneError where its field cannot be solved."""
        start = process_time()
        with bad_input_for(case.path):
            device = build_device(case.scene)
            field, _ = expected_magnetisation(case, device)
            expected = expected_torque(case.scene, device, field)
        command, doubts = f"emclutch check {source or case.path or 'CASE'}", limits_of(case.scene, device, field)
        return cls(expected, process_time() - start, command, doubts)

    @property
    def half_width(self) -> float | None:
        """Half of the 95 % interval, relative; None of a guess."""
        real = self.expected.real
        return None if real is None or not self.expected.parts else real.high / real.mean - 1.0

    def in_words(self) -> str:
        """Return the torque with its interval and its cost; of a guess why it reaches no target."""
        text = f"The law of the powder gives {self.expected.in_words().rstrip('.')}"
        if self.half_width is None:
            return f"{text}. A guess reaches no target."
        return f"{text}. This takes seconds and no run: {self.command}"

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
        found |= {"reason": "" if self.fidelity else self.in_words()}
        found |= {"command": self.command, "estimate": self.estimate}
        grains: dict[str, Any] = {}
        if isinstance(self.grains, Choice):
            grains = {"half_width": self.grains.half_width, "seconds": self.grains.seconds, "command": self.command}
        if self.fidelity == "law":
            known = {"half_width": self.law.half_width, "seconds": self.law.seconds, "command": self.law.command}
            return found | known | ({"grains": grains} if grains else {})
        return found | grains

    def in_words(self) -> str:
        """Return what reaches the target, or why nothing does and what may; without target, command and full stop."""
        reach = ""
        if isinstance(self.grains, LimitingError) and self.grains.half_width is None:
            reach = self.grains.limit
        if isinstance(self.grains, Choice):
            half, cost = format_percent(self.grains.half_width), self.grains.cost_in_words(self.cores)
            reach = f"runs of grains reach ± {half} in {cost}"
        if self.fidelity == "law":
            text = f"reached by the law of the powder (± {format_percent(self.law.half_width or 0.0)})"
            return f"{text}; {reach}" if reach else text
        if isinstance(self.grains, Choice):
            return f"reached; {reach}"
        if isinstance(self.grains, LimitingError):
            return f"not reached. {self.grains.in_words(self.cores)}"
        text = "not known: no accuracy study of this device yet"
        return text if self.estimate is None else f"{text}. {self.estimate['words']}"


def statements_on(answers: Sequence[CheapestAnswer]) -> list[Statement]:
    """Return what reaches each target, with the command; targets with the same answer in one sentence."""
    groups: dict[str, list[CheapestAnswer]] = {}
    for one in answers:
        groups.setdefault(one.in_words(), []).append(one)
    found = []
    limits: set[str] = set()
    for words, some in groups.items():
        last, text = some[-1], f"± {', '.join(format_percent(one.target) for one in some)}: "
        limiting = last.grains if isinstance(last.grains, LimitingError) and not last.fidelity else None
        if limiting is not None and limiting.limit in limits and (help_ := limiting.help_in_words(last.cores)):
            text += f"not reached, either. {help_}"  # its limit was said
        else:
            text += words
        limits |= {limiting.limit} if limiting is not None else set()
        has_command = last.command and (last.fidelity != "law" or "grains" in last.as_dict())
        text += f". Command: {last.command}" if has_command else "."
        found.append(note(text) if last.fidelity else Statement(Mark.WARNING, text))
    return found


def estimate_by_other_devices(case: Case, target: float, replica_seconds: float, cores: int) -> dict[str, Any] | None:
    """Return what grains will cost for a half width if a device's errors are those of other devices.

    Studies of devices of the same `geometry.kind` are taken, or all where there are none. The settings that a study
    recommends are taken, and their cost is that of the plan.
    Settings that the scene does not have are left out of the study, but not the inertial number: coarse grains have a
    larger one than the real powder at the scene's own speed, too.

    Parameters
    ----------
    target : relative half width of the torque's 95 % interval
    replica_seconds : processor time of a replica at the scene's own settings [s]
    cores : for the wall-clock time in the words

    Returns
    -------
    dict or None
        `devices`: names of the cases whose studies reach the target, or if none does of those that miss it; `seconds`:
        least and most processor time [s] of runs that reach the target, widened by `COST_FACTOR`, None where none of
        these devices reaches it; `half_width`: the least that they have; `limit`: the setting that limits it;
        `study_seconds`: processor time [s] of an accuracy study that may reach the target, the least of the studies;
        `words`: all this without its full stop. None where no study has the settings of the scene, or the scene refuses
        those that reach the target.
    """
    costs, missed = [], []
    settings = {one.name for one in settings_of(case.scene)} | {"inertial_number"}
    others = known_studies()
    for known in [one for one in others if one.kind == case.scene.geometry.name()] or others:
        study = replace(known, settings=tuple(one for one in known.settings if one.name in settings))
        found = cheapest_at(case, study, target)
        if isinstance(found, LimitingError):
            # a combination that reaches the target, but which the scene refuses, says nothing of the errors
            if found.best is not None and found.best.half_width > target:
                missed.append((study.case, found.best.half_width, found, replica_seconds / study.seconds))
            continue
        choice, run = found
        cost = make_plan(run)[1].cost
        costs.append((study.case, choice.replicas * (sum(cost.loop.values()) + sum(cost.once.values()))))
    if not costs and not missed:
        return None
    words, times = [], []
    for name, _, error, ratio in missed:
        text = f"With the errors of {name} {error.limit}"
        if error.seconds is not None:
            times.append(ratio * error.seconds)
            price = format_cost(times[-1], cores)
            text += f". A study for a smaller error takes at least {price}, and may not be enough"
        words.append(text)
    if costs:
        seconds = [min(one for _, one in costs) / COST_FACTOR, COST_FACTOR * max(one for _, one in costs)]
        span = " to ".join(map(format_duration, seconds))
        names = " or ".join(name for name, _ in costs)
        words.insert(0, f"With the errors of {names} runs of grains reach it in {span} of processor time, after an "
                     "accuracy study")  # fmt: skip
        values = {"seconds": seconds, "half_width": target, "limit": None, "study_seconds": None}
    else:
        _, half, error, _ = min(missed, key=lambda one: one[1])
        more = min(times, default=None)
        values = {"seconds": None, "half_width": half, "limit": error.setting, "study_seconds": more}
    devices = [name for name, *_ in costs or missed]
    return {"devices": devices, **values, "words": f"{'. '.join(words)} (estimates, within a factor of five)"}
