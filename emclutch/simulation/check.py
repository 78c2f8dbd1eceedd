"""`emclutch check`: what follows from a right scene, before anything is simulated."""

from __future__ import annotations

import shlex
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.device_model.decision import Decision, warnings_of
from emclutch.device_model.grain_size import grain_size
from emclutch.effects.omitted_effect import OmittedEffect
from emclutch.results.quantity import RPM
from emclutch.results.report.render import Reported
from emclutch.results.report.report import Mark, Report, Shown, Statement, Statements, Table, note, warning
from emclutch.results.report.run_report import effects_table
from emclutch.results.report.verdict import omitted_in_words
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import SceneError, bad_input_for
from emclutch.scene.grain_smear import moments_are_fed_back
from emclutch.scene.usual_ranges import FLUX_DENSITY
from emclutch.simulation.discretisation_error import accuracy_in_words, has_accuracy_study
from emclutch.simulation.forecast.expected_field import (
    field_of_sheared_powder,
    limits_of,
    powder_in_words,
    sheared_in_words,
)
from emclutch.simulation.plan import make_plan
from emclutch.simulation.plan_in_words import paths_in_words, plan_in_words
from field import ConvergenceError, MagneticField
from field.laws.table_end import driven_beyond_their_tables

if TYPE_CHECKING:
    from emclutch.results import Result
    from emclutch.scene.model import Scene
    from emclutch.simulation.forecast.expected_torque import ExpectedTorque


FIRST = {
    "expected torque": "torque",
    "drag": "drag",
    "fill": "fill",
    "bodies": "bodies",
    "cost": "cost",
    "field": "field",
    "accuracy": "accuracy",
    "grain size": "grain size",
}
"""Decisions that the first screen shows, and their labels there."""


@dataclass(frozen=True, slots=True, repr=False)
class Checked(Reported):
    """What `emclutch check` prints of a scene. `check` returns it.

    Attributes
    ----------
    title : str
    effects : tuple of str
        Names of the effects that the scene has.
    warnings : tuple of str
        Of entries that are allowed but likely not meant.
    decisions : dict of str to str
        The plan in words, by labels.
    omitted_effects : tuple of OmittedEffect
        Effects that the scene does not have, each with the criterion of its significance.
    expected : ExpectedTorque
        Expected torque [N m] with its 95 % interval.
    source : str
        The scene in the commands that are shown.
    """

    title: str
    effects: tuple[str, ...]
    warnings: tuple[str, ...]
    decisions: dict[str, str]
    omitted_effects: tuple[OmittedEffect, ...]
    expected: ExpectedTorque
    source: str = "CASE"

    def __repr__(self) -> str:
        torque = self.expected.real
        return f"<Checked: {self.title}: expected torque {'unknown' if torque is None else torque.in_words()}>"

    def report(self) -> Report:
        """Return torque, fill, cost, field, accuracy and grain size, a line each, and warnings; then all decisions."""
        closing = f"All settings chosen by the program: emclutch check {self.source} --details"
        report = Report(self.title, data=self._data(), closing=closing)
        report.add("Result", Statements([Statement(Mark.GOOD, f"{self.title}: the scene is valid.")]), Shown.TERMINAL)
        point = self.decisions.get("operating point", "")
        first = [
            (label, f"{point}: {self.decisions[name]}" if point and label == "torque" else self.decisions[name])
            for name, label in FIRST.items()
            if name in self.decisions
        ]
        report.add("Estimates", Table(first), Shown.TERMINAL)
        doubts = [warning(text) for text in self.warnings if text != self.expected.law]  # which the torque says
        of_decisions = warnings_of(self.decisions)
        doubts += [warning(f"{label}: {text}") for label, texts in of_decisions.items() for text in texts]
        doubts += [
            warning(omitted_in_words(one.effect, one.in_words())) for one in self.omitted_effects if one.is_reservation
        ]
        doubts += [note(one.in_operation) for one in self.omitted_effects if one.in_operation]
        report.add("Warnings", Statements(doubts), Shown.TERMINAL)
        report.add("Plan", Table([*self.decisions.items()]))
        return report.add("Effects, on and off", effects_table(self.effects, self.omitted_effects))

    def _data(self) -> dict[str, Any]:
        return {
            "title": self.title, "effects": self.effects, "plan": self.decisions,
            "warnings": [*self.warnings, *warnings_of(self.decisions).get("field", ())],
            "plan_warnings": warnings_of(self.decisions),
            "omitted_effects": [line.as_dict() for line in self.omitted_effects], **self.expected.as_dict(),
        }  # fmt: skip


def check(case: Case | str | Path, threads: int | None = None) -> Checked:
    """Check a scene and predict its torque, cost and accuracy. Nothing is simulated and nothing written.

    Parameters
    ----------
    case : Case, or the path of a scene file.
    threads : for which the cost is estimated; default: as many as a run takes.

    Raises
    ------
    SceneError
        The scene has faults, or a step or a stiffness that is not possible.
    """
    case = as_case(case)
    with bad_input_for(case.path):
        return _check(case, threads)


def _check(case: Case, threads: int | None) -> Checked:
    from emclutch.device_model.coil_heat import coil_heat_in_words  # local, as the next three: a run does not need them
    from emclutch.simulation.field_plan import ampere_turns_row, field_plan, steel_row
    from emclutch.simulation.forecast.expected_torque import ExpectedTorque, expected_torque
    from emclutch.simulation.forecast.regime import omitted_effects

    scene, source = case.scene, shlex.quote(str(case.path or "CASE"))
    if scene.particles is None:
        none = ExpectedTorque(None, "the scene has no grains")
        return Checked(scene.scene.title, scene.effects.active, case.warnings, field_plan(case), (), none, source)
    device, made = make_plan(case, threads=threads)
    words, B_max = plan_in_words(device, made), 0.0
    coil, even, phi = device.section_coil, made.peak_section, device.fill.solid_fraction
    words["largest magnetisation"] = f"{made.M_max / 1e3:.3g} kA/m of the grains"
    if coil is not None and even is not None:
        faces = device.shears_faces
        midline = coil.shape.face_midline() if faces else coil.shape.gap_midline()

        def largest(field: MagneticField) -> float:
            return float(np.linalg.norm(field.B_along(midline), axis=1).max())

        B_max = largest(even)
        where = ("face gap" if faces else "rim gap") if coil.has_poles else "powder"
        words["field"] = f"up to {B_max:.3g} T in the {where}"
        if moments_are_fed_back(scene) and coil.largest_current > 0.0:
            with suppress(ConvergenceError):  # the expected torque says so
                sheared = field_of_sheared_powder(coil, coil.uniform_fill(phi), scene, coil.largest_current, even)
                words["field"] += sheared_in_words(coil, even, sheared, largest(sheared), faces)
        words |= {"powder in that field": powder_in_words(scene, phi)} | ampere_turns_row(coil, even)
    elif device.coil is not None and made.peak_field is not None:
        B_max = device.coil.gap_flux_density(made.peak_field)
        words["field"] = f"mean {B_max:.3g} T under the poles"
        words["powder in that field"] = powder_in_words(scene, phi)
    beyond = [] if made.peak_field is None else driven_beyond_their_tables([made.peak_field])
    if doubtful := [text for text in (FLUX_DENSITY.remark("|B|", B_max), *beyond) if text]:
        words["field"] = Decision(words["field"], *doubtful)
    if device.coil is not None:
        words |= steel_row(case, device.coil)
        words["coil heat"] = coil_heat_in_words(scene, device.coil, device.coil.shape)
    compared = methods_compared(scene)
    if compared:
        words["method"] = f"{scene.contact.method}; {compared}"
    expected = expected_torque(scene, device, made.peak_field)
    if device.coil is not None and scene.geometry.has_axis:
        slip = f"{RPM * scene.motion.largest_slip:.4g} rpm of slip"
        if scene.motion.largest_slip == 0.0 < (expected.torque or 0.0):
            slip += " (holding torque: the largest, quasi-static, before the shafts slip)"
        words["operating point"] = f"{device.coil.largest_current:.4g} A, {slip}"
    words |= {"expected torque": expected.in_words()} | expected.details()
    words |= {"drag": scene.motion.drag_in_words} if scene.motion.drag_torque else {}
    if bodies := scene.geometry.bodies_in_words(scene):
        words["bodies"] = bodies
    size = grain_size(scene, device)
    if size is not None:
        measured = has_accuracy_study(case) or bool(expected.parts)  # the law of the powder has the torque of both
        words["grain size"] = Decision(size.in_words(measured), *size.warnings(measured))
    if scene.geometry.measured == "torque" and scene.geometry.has_axis:
        words["accuracy"] = accuracy_in_words(case, made)
    words |= paths_in_words(case)
    warnings = case.warnings + limits_of(scene, device, made.peak_field)
    title, effects, missing = scene.scene.title, scene.effects.active, omitted_effects(scene, device, made, expected)
    return Checked(title, effects, warnings, words, tuple(missing), expected, source)


def methods_compared(scene: Scene) -> str:
    """What both contact methods were measured to take on scenes like this one; empty where none was run by both."""
    attraction = scene.effects.attraction
    return (attraction.methods_compared if attraction is not None else "") or scene.geometry.methods_compared


def omitted_effects_of(result: Result) -> list[OmittedEffect]:
    """Return what the scene of a finished run leaves out; empty where it cannot be read again."""
    try:
        return list(check(result.folder.case).omitted_effects)
    except (SceneError, OSError, ValueError, RuntimeError):  # a file that the scene names is gone, a script in it
        return []
