"""The cheapest fidelity that reaches a wanted accuracy: the law of the powder, or grains with a study's settings.

The law's interval is that of runs of grains over the law (docs/explanation/two_scales.md). The errors of grains are
those of an accuracy study. Neither has the error of the powder's data.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from time import process_time
from typing import Any

from emclutch.device_model.device import build_device
from emclutch.results.recommended import Choice, LimitingError
from emclutch.results.report.report import Statement, note, warning
from emclutch.results.text import format_duration, format_percent
from emclutch.scene.case import Case
from emclutch.scene.errors import bad_input_for
from emclutch.simulation.forecast.expected_field import expected_magnetisation
from emclutch.simulation.forecast.expected_torque import ExpectedTorque, expected_torque


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

    def cheapest(self, target: float, grains: Choice | LimitingError | None, command: str) -> dict[str, Any]:
        """Return what reaches a half width at the least cost.

        Parameters
        ----------
        target : relative half width of the torque's 95 % interval
        grains : what reaches it by an accuracy study of the device, or why nothing does; None: there is no study
        command : that runs the grains with these settings, or the study

        Returns
        -------
        dict
            `target`, `fidelity` ("law" or "grains"; None: nothing known reaches it), `half_width`, `seconds` of
            processor time, None where unknown, `command`, and the `reason` where nothing known reaches it.
        """
        found: dict[str, Any] = {"target": target, "fidelity": None, "half_width": None, "seconds": None}
        if self.half_width is not None and self.half_width <= target:
            known = {"fidelity": "law", "half_width": self.half_width, "seconds": self.seconds, "command": self.command}
        elif isinstance(grains, Choice):
            known = {"fidelity": "grains", "half_width": grains.half_width, "seconds": grains.seconds}
        else:
            half = self.half_width
            law = "the law of the powder is a guess" if half is None else f"the law has ± {format_percent(half)}"
            study = "there is no accuracy study of this device yet" if grains is None else grains.in_words()
            known = {"reason": f"{law}, and {study}"}
        return found | {"command": command, "reason": ""} | known

    def as_dict(self) -> dict[str, Any]:
        """Return torque [N m], interval, half width and processor time [s] for a report's data."""
        return self.expected.as_dict() | {"half_width": self.half_width, "seconds": self.seconds}


def cheapest_in_words(row: Mapping[str, Any]) -> Statement:
    """Return what `TorqueByLaw.cheapest` found for a target, as a line to copy the command from."""
    target = f"± {format_percent(row['target'])}"
    if row["fidelity"] is None:
        return warning(f"{target}: {row['reason']}; to measure it: {row['command']}")
    names = {"law": "the law of the powder", "grains": "grains with the settings of the accuracy study"}
    cost = f"± {format_percent(row['half_width'])} in {format_duration(row['seconds'])} of processor time"
    return note(f"{target}: {names[row['fidelity']]}, {cost}: {row['command']}")
