"""What each effect adds: a scene, and the same without each of its effects, in replicas of equal length.

An effect that others need is left out together with them: which ones the scene's own checks say. All scenes are
sheared at the same speeds to the same strain; stiffness, step and windows that the program chooses are each scene's
own, since what an effect calls for is a part of its cost. What a scene does not have is not simulated, and costs
nothing.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from math import inf
from pathlib import Path
from statistics import fmean
from typing import Any

from emclutch.effects import EFFECTS
from emclutch.results import RunFolder
from emclutch.results.atomic_file import replace_text
from emclutch.results.effect_contributions import WHOLE, Contributions, Without
from emclutch.results.pictures.effect_contributions import effects_picture
from emclutch.results.report.render import Reported, markdown, write_index
from emclutch.results.report.report import Mark, Picture, Report, Shown, Statement, Statements, Table, note
from emclutch.results.text import format_duration
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.replica_count import replica_seed
from emclutch.scene.value_list import seconds_of
from emclutch.simulation.plan import make_plan
from emclutch.studies.accuracy.budgeted_study import BUDGET, BudgetedStudy
from emclutch.studies.accuracy.planned_values import base_of, compiling_run, refuse_unmeasurable, source_of, starts_of
from emclutch.studies.accuracy.tasks import measure_replica
from emclutch.studies.study import DONE, Task, checked_jobs, child_processes

PLAN = "effects_plan.json"
MIN_ROUNDS, MAX_ROUNDS = 3, 16
"""Rounds: in each one replica without each effect, and two of the whole scene, which is in all differences."""
OF_WHOLE = 2
WARM_UP = "warm-up"


@dataclass(frozen=True, slots=True)
class EffectsResult(Reported):
    """What each effect of a scene adds to torque and cost. `effect_contributions` returns it.

    Attributes
    ----------
    folder : Path
        With effects.csv, effects.md and effects.png.
    contributions : Contributions
        Torque [N m] and processor time [s] of the whole scene and of the scene without each effect.
    """

    folder: Path
    contributions: Contributions

    def report(self) -> Report:
        """Return torque and processor time without each effect."""
        return effects_report(self.contributions, self.folder)


def removals(case: Case) -> list[Without]:
    """Return for each effect of a scene what is left out with it, the fewest others with which the scene is valid.

    An effect that a setting of another section or effect needs, as saturation is needed by necks, is not left out: the
    scene without it would be another one in more than an effect. Nor is one that no run of the grains depends on.
    """
    return [_removal(case, name) for name in case.scene.effects.active]


def _removal(case: Case, name: str) -> Without:
    active = case.scene.effects.active
    if not case.scene.effects.get(name).acts_on_grains:
        return Without(name, was_run=False, reason="a run of the grains does not depend on it")
    for fault in _faults(case, Without(name)):
        if fault.key.removeprefix("effects.") not in active:
            return Without(name, was_run=False, reason=str(fault))
    others = [other for other in active if other != name]
    for size in range(len(others) + 1):
        for some in combinations(others, size):
            if not _faults(case, Without(name, some)):
                return Without(name, some)
    return Without(name, was_run=False, reason="the scene is not valid without it, whatever else is left out")


def _faults(case: Case, removal: Without) -> Sequence[Fault]:
    try:
        case.with_values(removal.values)
    except SceneError as error:
        return error.faults
    return ()


def effect_contributions(
    case: Case | str | Path,
    *,
    out: str | Path | None = None,
    budget: float | str | None = None,
    jobs: int | None = None,
    resume: bool = False,
    progress=None,
) -> EffectsResult:
    """Measure torque and cost of a scene without each of its effects.

    The folder holds ``effects.csv``, ``effects.md``, ``effects.png`` and a folder for each replica.

    Parameters
    ----------
    case : Case, or the path of a scene file.
    out : folder; default: the next free studies/<case>-effects-<nnn>.
    budget : wall-clock time [s], or a text "40 min"; default 20 min. Three replicas without each effect are run in any
        case.
    jobs, resume, progress : as of `emclutch.studies.accuracy.study.accuracy`.

    Raises
    ------
    SceneError
        Before anything runs: no torque on a disc, no effect that could be left out, a budget that is too short.
    OutputError
        The folder is in use, not empty, or of another scene.
    RunError
        A replica of the whole scene failed; `Interrupted` after Ctrl-C: what is done is kept.
    ValueError
        `jobs` is less than 1.
    """
    case, jobs = as_case(case), checked_jobs(jobs)
    seconds = seconds_of(budget, "budget")
    _refuse_without_effects(case)
    folder = Path(out) if out is not None else RunFolder.next_path(f"{case.name}-effects", "studies")

    with child_processes(jobs) as executor:
        running = _EffectsRun(case, folder, PLAN, executor, progress)
        asked = BUDGET if seconds is None else seconds
        with running.planned(lambda: _begun(case, asked, jobs), resume=resume, budget=seconds):
            found = running.measure()
            write_effects(found, folder)
    return EffectsResult(folder, found)


def _refuse_without_effects(case: Case) -> None:
    refuse_unmeasurable(case)
    if not case.scene.effects.active:
        raise SceneError([Fault("effects", "", "has no table: there is nothing to leave out")], source_of(case))


def preview_effects(case: Case, budget: float | None, jobs: int | None) -> Report:
    """Return which effects would be left out, and the processor time of a replica without each; nothing runs."""
    jobs = checked_jobs(jobs)
    _refuse_without_effects(case)
    known = _begun(case, inf if budget is None else budget, jobs)
    rows = [(_scene_name(one["effect"], one["others"]), one["reason"] or format_duration(one["seconds"]))
            for one in known["rows"]]  # fmt: skip
    least = format_duration(MIN_ROUNDS * known["round"] / jobs)
    text = f"The shortest study runs {MIN_ROUNDS} replicas without each effect and {MIN_ROUNDS * OF_WHOLE} of the "
    text += f"whole scene: about {least} with {jobs} at a time (--budget)."
    report = Report("", data={"effects": known["rows"], "seconds": MIN_ROUNDS * known["round"] / jobs})
    report.add("", Statements([note(text)]), Shown.TERMINAL)
    return report.add("", Table(rows, ("scene", "processor time of a replica, estimate"), ()), Shown.TERMINAL)


def _begun(case: Case, budget: float, jobs: int) -> dict[str, Any]:
    """Plan every scene, and return what is decided before anything runs."""
    base, starts = _scene_of_replicas(case)
    rows, seconds = [], 0.0
    for one in (Without(""), *removals(base)):
        predicted = 0.0
        if one.was_run:
            try:
                predicted = make_plan(base.with_values(one.values), threads=1)[1].cost.seconds["total"]
            except ValueError as error:
                one = replace(one, reason=str(error), was_run=False)
        seconds += predicted * (1 if one.effect else OF_WHOLE)
        rows.append({"effect": one.effect, "others": list(one.others), "reason": one.reason, "seconds": predicted})
    least = MIN_ROUNDS * seconds / jobs
    if least > budget:
        message = (
            f"is less than {MIN_ROUNDS} replicas without each effect take with {jobs} jobs, about "
            f"{format_duration(least)}; give {format_duration(1.5 * least)} or more"
        )
        raise SceneError([Fault("--budget", f"{budget:g} s", message)], source_of(case))
    return {"case": case.toml(), "starts": starts, "budget": budget, "jobs": jobs, "rows": rows, "round": seconds,
            "rounds": None}  # fmt: skip


def _scene_of_replicas(case: Case) -> tuple[Case, list[float | str]]:
    """Return the scene of a replica, at speeds that do not follow from its effects, and where its average begins."""
    base = base_of(case)
    scene, scaled = base.case, base.plan.scaled
    if scaled is not None:
        speeds = {f"motion.{name}.speed": scaled.factor * speed for name, speed in scaled.speeds.items()}
        scene = scene.with_values(speeds | {"accuracy.inertial_number": None})
    return scene, starts_of(base)[:1]


class _EffectsRun(BudgetedStudy):
    """Its replicas, round by round."""

    def measure(self) -> Contributions:
        """Run all replicas, and return what was found."""
        self.base, _ = _scene_of_replicas(self.case)
        self.removals = [
            Without(row["effect"], tuple(row["others"]), reason=row["reason"], was_run=not row["reason"])
            for row in self.known["rows"]
        ]
        self.removed = [one for one in self.removals if one.was_run]
        self._tell_cost()
        self._run([self._warm_up(one) for one in self.removed], "short runs compile the kernels")
        self._run(list(self._round(0)), "replicas")
        if self.known["rounds"] is None:
            each = sum(self.rows[task.name].wall for task in self._round(0))
            self.decide(rounds=min(MAX_ROUNDS, max(MIN_ROUNDS, int(self.budget / each))))
        self._run([task for n in range(1, self.known["rounds"]) for task in self._round(n)], "replicas")
        whole, *without = [self._found(one) for one in self.removals]
        absent = tuple(one.name for one in EFFECTS if one.name not in self.case.scene.effects.active)
        return Contributions(self.case.name, whole, tuple(without), absent)

    def _round(self, number: int) -> Iterator[Task]:
        for row, one in enumerate(self.removed):
            each = OF_WHOLE if not one.effect else 1
            for n in range(each * number, each * (number + 1)):
                seed = replica_seed(self.case.scene.scene.seed, n + 1000 * row)  # replicas of their own: independent
                yield self._task(one, f"{one.folder}/{n:02d}", {"scene.seed": seed})

    def _warm_up(self, one: Without) -> Task:
        case = self.base.with_values(one.values)
        plan = make_plan(case, threads=1)[1]
        return self._task(one, f"{WARM_UP}/{one.folder}", compiling_run(plan), starts=(0.0,))

    def _task(self, one: Without, folder: str, values: dict[str, Any], **more: Any) -> Task:
        options = {"starts": self.known["starts"]} | more
        return Task(folder, self.base.with_values(one.values | values), measure_replica, options)

    def _run(self, tasks: Sequence[Task], text: str) -> None:
        """Do those tasks that are not done yet; RunError where the whole scene fails."""
        self.do(tasks, text)
        for task in tasks:
            if WHOLE in Path(task.name).parts:
                self.refuse_failed(task.name)

    def open_decisions(self) -> dict[str, Any]:
        return {"rounds": None}

    def fraction(self) -> float:
        rounds = self.known["rounds"] or max(MIN_ROUNDS, self.budget / self.known["round"])
        spent = sum(one.seconds for name, one in self.rows.items() if not name.startswith(WARM_UP))
        return min(0.99, spent / max(rounds * self.known["round"], 1e-9))

    def _found(self, one: Without) -> Without:
        if not one.was_run:
            return one
        done = [row for name, row in self.rows.items() if Path(name).parent == Path(one.folder)]
        good = [row for row in done if row.state == DONE]
        failures = [row.short_reason for row in done if row.state != DONE]
        return replace(
            one,
            torques=tuple(row.values["torque"] for row in good),
            seconds=fmean(row.seconds for row in good) if good else float("nan"),
            reason=f"{len(failures)} of {len(done)} replicas failed: {failures[0]}" if failures else "",
        )

    def _tell_cost(self) -> None:
        known = self.known
        words = (
            f"{len(self.removed) - 1} of {len(self.removals) - 1} effects can be left out; a replica without each of "
            f"them and {OF_WHOLE} of the whole scene take about {format_duration(known['round'])} of processor time, "
            f"by estimate; {format_duration(known['budget'])} with {known['jobs']} at a time are enough for some "
            f"{min(MAX_ROUNDS, self.budget / known['round']):.0f} of each"
        )
        self.log(words)


def write_effects(found: Contributions, folder: Path) -> None:
    """Write ``effects.csv``, ``effects.png``, ``effects.md`` and ``index.html``."""
    import pandas

    replace_text(folder / "effects.csv", pandas.DataFrame(rows_of(found)).to_csv(index=False))
    effects_picture(folder / "effects.png", found, title=f"What each effect adds: {found.case}")
    report = effects_report(found, folder)
    replace_text(folder / "effects.md", markdown(report, folder))
    write_index(report)


def effects_report(found: Contributions, folder: Path) -> Report:
    """Return the report on what each effect adds to torque and processor time."""
    report = Report(f"What each effect adds: {found.case}", folder=folder, data={"effects": rows_of(found)})
    report.add("Result", Statements([Statement(Mark.GOOD, line) for line in found.in_words()]), Shown.TERMINAL)
    report.add("Torque and cost", _table(found), Shown.TERMINAL)
    remarks = [
        note("What an effect adds: the whole scene less the scene without it, and without what needs it (nor)."),
        note("Intervals of 95 % by Student's t over the replicas. Not significant: the interval holds zero."),
        *(note(f"{one.effect}: {one.reason}.") for one in found.without if one.reason),
    ]
    if found.absent:
        remarks.append(note(f"Effects that the scene does not have, and that cost no time: {', '.join(found.absent)}."))
    report.add("Remarks", Statements(remarks), Shown.PAGE)
    what = "torque and processor time without each effect"
    return report.add("Picture", Picture(what, folder / "effects.png"), Shown.PAGE)


def rows_of(found: Contributions) -> list[dict[str, Any]]:
    """Return the rows of ``effects.csv``: torques [N m], half widths of 95 % intervals, processor time [s]."""
    rows = []
    for one in (found.whole, *found.without):
        torque, added = one.torque, found.torque(one) if one.effect else None
        rows.append({
            "left_out": one.effect,
            "with_it": " ".join(one.others),
            "replicas": len(one.torques),
            "torque": None if torque is None else torque.value,
            "half_width": None if torque is None else torque.half_width(),
            "adds_torque": None if added is None else added.value,
            "adds_half_width": None if added is None else added.half_width(),
            "significant": None if added is None else added.is_significant(),
            "seconds": one.seconds,
            "adds_seconds": found.seconds(one) if one.effect else None,
            "reason": one.reason,
        })  # fmt: skip
    return rows


def _scene_name(effect: str, others: Sequence[str]) -> str:
    return (f"without {effect}" if effect else "whole") + (f" (nor {', '.join(others)})" if others else "")


def _table(found: Contributions) -> Table:
    head = ("scene", "replicas", "torque [N m]", "the effect adds [N m]", "of the torque", "seconds a replica", "adds")
    rows = []
    for one in (found.whole, *found.without):
        torque, added, share = one.torque, found.torque(one), found.share(one)
        name = _scene_name(one.effect, one.others)
        if torque is None or added is None or share is None:
            why = "failed" if one.was_run else "cannot be left out"
            rows.append((name, str(len(one.torques)), why, "", "", "", ""))
            continue
        row = (name, str(len(one.torques)), torque.text())
        seconds = f"{one.seconds:.3g}"
        if not one.effect:
            rows.append((*row, "", "", seconds, ""))
            continue
        mark = "" if added.is_significant() else "not significant: "
        cost = (found.whole.seconds - one.seconds) / found.whole.seconds
        percent = share.scaled(100.0).text("+") + " %"
        rows.append((*row, mark + added.text("+"), percent, seconds, f"{100.0 * cost:+.2g} %"))
    return Table(rows, head, (1, 2, 3, 4, 5, 6))
