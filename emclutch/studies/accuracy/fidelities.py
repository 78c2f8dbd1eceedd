"""The cheapest fidelity that reaches a wanted accuracy: the law of the powder, or grains with a study's settings.

The law's interval is that of runs of grains over the law (docs/explanation/two_scales.md). The errors of grains are
those of an accuracy study; before there is one, those of the studies of other devices estimate what it will find.
Neither has the error of the powder's data.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from time import process_time
from typing import Any

from emclutch.device_model.device import build_device
from emclutch.results.accuracy_studies import known_studies
from emclutch.results.recommended import Choice, LimitingError
from emclutch.results.report.report import Statement, note, warning
from emclutch.results.text import format_duration, format_percent, in_words
from emclutch.scene.case import Case
from emclutch.scene.errors import bad_input_for
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
    def of(cls, case: Case) -> TorqueByLaw:
        """Return that of a scene; SceneError where its field cannot be solved."""
        start = process_time()
        with bad_input_for(case.path):
            device = build_device(case.scene)
            field, _ = expected_magnetisation(case, device)
            expected = expected_torque(case.scene, device, field, unknown_powder=False)
        return cls(expected, process_time() - start, f"emclutch check {case.path or 'CASE'}")

    @property
    def half_width(self) -> float | None:
        """Half of the 95 % interval, relative; None of a guess."""
        real = self.expected.real
        return None if real is None or not self.expected.parts else real.high / real.mean - 1.0

    def in_words(self) -> str:
        """Return the torque with its interval and its cost; of a guess why it reaches no target."""
        text = f"The powder's law, without a run, in {format_duration(self.seconds)}: {self.expected.in_words()}"
        if self.half_width is None:
            return f"{text.rstrip('.')}. It reaches no target."
        return f"{text}, the interval of runs of grains, not of a real powder."

    def cheapest(
        self, target: float, grains: Choice | LimitingError | None, command: str, estimate: Any = None
    ) -> dict[str, Any]:
        """Return what reaches a half width at the least cost.

        Parameters
        ----------
        target : relative half width of the torque's 95 % interval
        grains : what reaches it by an accuracy study of the device, or why nothing does; None: there is no study
        command : that runs the grains with these settings, or the study
        estimate : of `estimate_by_other_devices`

        Returns
        -------
        dict
            `target`, `fidelity` ("law" or "grains"; None: nothing known reaches it), `half_width`, `seconds` of
            processor time, None where unknown, `command`, `estimate`, and the `reason` where nothing known reaches it.
            Beside the law, `grains` has the same of grains that reach it.
        """
        found: dict[str, Any] = {"target": target, "fidelity": None, "half_width": None, "seconds": None}
        by_grains: dict[str, Any] = {}
        if isinstance(grains, Choice):
            by_grains = {"half_width": grains.half_width, "seconds": grains.seconds}
        if self.half_width is not None and self.half_width <= target:
            known = {"fidelity": "law", "half_width": self.half_width, "seconds": self.seconds, "command": self.command}
            known |= {"grains": by_grains | {"command": command}} if by_grains else {}
        elif by_grains:
            known = {"fidelity": "grains"} | by_grains
        else:
            half = self.half_width
            law = "the law of the powder is a guess" if half is None else f"the law has ± {format_percent(half)}"
            study = "no accuracy study of this device yet" if grains is None else grains.in_words()
            known = {"reason": f"{law}; grains: {study}"}
        return found | {"command": command, "reason": "", "estimate": estimate} | known

    def as_dict(self) -> dict[str, Any]:
        """Return torque [N m], interval, half width and processor time [s] for a report's data."""
        return self.expected.as_dict() | {"half_width": self.half_width, "seconds": self.seconds}


def estimate_by_other_devices(case: Case, target: float, replica_seconds: float) -> dict[str, Any] | None:
    """Return what grains will cost for a half width if a device's errors are those of other devices.

    The settings that the accuracy study of another device recommends are taken, as far as the scene has them, and
    their cost is that of the plan.

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
    for study in known_studies():
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
    """Return an estimate of `estimate_by_other_devices` as a sentence."""
    head = f"Estimate for grains by the study of {' and '.join(estimate['devices'])}: ± {format_percent(target)}"
    if estimate["seconds"] is not None:
        low, high = map(format_duration, estimate["seconds"])
        return f"{head} takes {low} to {high} of processor time."
    limit = in_words(estimate["limit"])
    half = format_percent(estimate["half_width"])
    text = f"{head} not reached, ± {half} at best; the largest error is that of {limit}"
    if estimate["study_seconds"] is None:
        return f"{text}."
    return f"{text}; a study of more than {format_duration(estimate['study_seconds'])} of processor time may reach it."


def cheapest_in_words(row: Mapping[str, Any]) -> Statement:
    """Return what `TorqueByLaw.cheapest` found for a target, as a line to copy the command from."""
    target = f"± {format_percent(row['target'])}"
    if row["fidelity"] is None:
        known = "" if row["estimate"] is None else f"{estimate_in_words(row['target'], row['estimate'])} "
        return warning(f"{target}: {row['reason']}. {known}To measure it: {row['command']}")
    names = {"law": "the law of the powder", "grains": "grains with the settings of the accuracy study"}
    text = f"{target}: {names[row['fidelity']]}, {_cost_in_words(row)}"
    return note(f"{text}; or grains, {_cost_in_words(row['grains'])}" if "grains" in row else text)


def _cost_in_words(row: Mapping[str, Any]) -> str:
    cost = f"± {format_percent(row['half_width'])} in {format_duration(row['seconds'])} of processor time"
    return f"{cost}: {row['command']}"
