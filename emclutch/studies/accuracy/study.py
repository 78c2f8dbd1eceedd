"""Accuracy study: the errors of a scene's settings within a budget, and the settings for wanted accuracies.

Replicas at the scene's own settings come first; their cost and scatter decide what the budget is enough for
(`emclutch.studies.accuracy.plan`). Magnetic settings are measured on the grains at the end of the first.
Every replica is a task in a folder of its own, and depends on its scene and seed alone; ``plan.json`` holds every
decision. So a study that is stopped, or killed, continues to the same result.
"""

from __future__ import annotations

import logging
import math
import shlex
from collections.abc import Callable, Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import nullcontext
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from emclutch.results import RunFolder
from emclutch.results.accuracy_studies import SHIPPED, accuracy_study_folder, find_accuracy_study, save_accuracy_study
from emclutch.results.accuracy_study import INTERACTION, AccuracyStudy
from emclutch.results.atomic_file import replace_text
from emclutch.results.errors import OutputError
from emclutch.results.history import last_time
from emclutch.results.recommended import (
    ONE_VALUE,
    STATISTICS,
    Choice,
    LimitingError,
    budget_option,
    comfortable_budget,
    own_choice,
    recommended,
)
from emclutch.results.report.render import Reported
from emclutch.results.report.report import Report, Shown, Statement, Statements, Table, note, warning
from emclutch.results.text import format_cost, format_duration, format_percent, in_words
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.replica_count import cores_at_hand, replica_seed
from emclutch.scene.value_list import seconds_of
from emclutch.settings import FROZEN, HISTORIES, TORQUE, Setting, settings_of
from emclutch.settings.powder import START_UP
from emclutch.simulation.discretisation_error import TARGETS, device_of
from emclutch.simulation.plan_in_words import fill_in_words, narrow_sector
from emclutch.simulation.recommended_case import cheapest_case
from emclutch.studies.accuracy.budgeted_study import BUDGET, BudgetedStudy
from emclutch.studies.accuracy.fidelities import (
    CheapestAnswer,
    TorqueByLaw,
    estimate_by_other_devices,
    statements_on,
)
from emclutch.studies.accuracy.measured_study import StudyRuns, refuse_no_torque, scatter_of, study_of, this_machine
from emclutch.studies.accuracy.plan import (
    BASE,
    OWN,
    Aim,
    Key,
    OfferedSetting,
    OfferedValue,
    Torques,
    first_replicas,
    left_out,
    makespan,
    more_replicas,
    replicas_for,
)
from emclutch.studies.accuracy.planned_values import (
    Base,
    PlannedValue,
    accepted_values,
    base_of,
    compiling_run,
    plan_value,
    refuse_unmeasurable,
    source_of,
    starts_of,
    values_to_plan,
)
from emclutch.studies.accuracy.report import TAKEN_AS_GIVEN, accuracy_report, own_in_words
from emclutch.studies.accuracy.tasks import GRAINS, measure_moments, measure_replica
from emclutch.studies.study import DONE, FAILED, Row, Task, call_all, checked_jobs, child_processes

log = logging.getLogger(__name__)
BUDGET_OPTION = "--budget"
BASE_REPLICAS = 4
FROZEN_SHARE = 0.25
"""Fraction of the budget for the settings without noise."""
STAGE_FRACTIONS = (1.0, 0.5, 1.0)
"""Fraction of the time left that each stage of replicas plans for; its results decide the next."""
OVERRUN = 1.2
"""Wall-clock time over the budget, from which on no more replicas are begun."""
MAX_LOAD = 2.0
FIRST_SEED = 1_000_000
"""Number of the first replica's seed (`replica_seed`): a run of the scene, which counts from 0, has other replicas."""
WARM_UP, FROZEN_FOLDER = "warm-up", "frozen"
TELL_SHARE = 0.01
PLAN = "plan.json"


@dataclass(frozen=True)
class AccuracyResult(Reported):
    """Result of an accuracy study.

    Attributes
    ----------
    folder : Path
    study : AccuracyStudy
    answers : tuple of CheapestAnswer
        What reaches each target.
    law : TorqueByLaw
        What is known without a study.
    remarks : tuple of str
        Sentences on an earlier study.
    """

    folder: Path
    study: AccuracyStudy
    law: TorqueByLaw
    answers: tuple[CheapestAnswer, ...] = ()
    remarks: tuple[str, ...] = ()

    def report(self) -> Report:
        """Return best estimate, settings for the targets, and errors."""
        return accuracy_report(self.study, self.answers, self.folder, self.remarks, self.law)


def accuracy(
    case: Case | str | Path,
    *,
    out: str | Path | None = None,
    budget: float | str | None = None,
    jobs: int | None = None,
    resume: bool = False,
    targets: Sequence[float] = TARGETS,
    progress=None,
) -> AccuracyResult:
    """Measure what each numerical setting of a scene adds to its torque's error, and what it costs.

    The folder holds ``accuracy_study.json``, tables, a picture and a scene for each target that can be reached;
    ``plan.json`` with all decisions; a folder for each replica. Runs of the same device find the study by themselves.

    Parameters
    ----------
    case : Case, or the path of a scene file.
    out : folder; default: the next free studies/<case>-accuracy-<nnn>.
    budget : wall-clock time [s], or a text "40 min"; default 20 min. Four replicas at the scene's own settings are
        run in any case.
    jobs : replicas at a time, each on one thread of a process of its own; default: the cores at hand. The result of a
        replica does not depend on it.
    resume : continue the study in `out`, with its own budget or a larger one: what is finished is kept.
    targets : relative half widths of the torque's 95 % interval to find settings for.
    progress : as of `emclutch.run`; if it has log(text), it is called with what the study is going to cost.

    Raises
    ------
    SceneError
        Before anything runs: no torque on a disc, nothing to vary, or a value in `accuracy.values` that the scene
        does not take.
    OutputError
        The folder is in use, not empty, or of another scene.
    RunError
        A replica at the scene's own settings failed; `Interrupted` after Ctrl-C: what is done is kept.
    ValueError
        `jobs` is less than 1.
    """
    case, jobs = as_case(case), checked_jobs(jobs)
    seconds = seconds_of(budget, "budget")
    refuse_unmeasurable(case)
    from emclutch.studies.accuracy import answers as answers_module  # local: it draws

    folder = Path(out) if out is not None else RunFolder.next_path(f"{case.name}-accuracy", "studies")
    base, law = base_of(case), TorqueByLaw.of(case)
    with child_processes(jobs) as executor:
        running = _StudyRun(case, folder, PLAN, executor, progress)

        def begin() -> dict[str, Any]:
            return _begun(case, base, BUDGET if seconds is None else seconds, jobs, targets, executor, progress)

        with running.planned(begin, resume=resume, budget=seconds):
            running.log(law.in_words())
            study = running.measure(base)
            remarks = _saved(study, running)
            answers = answers_module.write_answers(case, study, folder, targets, remarks, law)
    return AccuracyResult(folder, study, law, answers, remarks)


def _saved(study: AccuracyStudy, running: _StudyRun) -> tuple[str, ...]:
    """Keep a study for its device, and say what it replaces."""
    replace_text(running.folder / "accuracy_study.json", study.to_json())
    earlier = _earlier_study(study.device)
    if not running.performed and earlier is not None:  # one that was finished may have a later study in its place
        return ()
    save_accuracy_study(study)
    if earlier is None:
        return ()
    spent, before = (float(one.machine.get("processor_seconds") or 0.0) for one in (study, earlier[0]))
    if before <= spent:
        return ()
    where = accuracy_study_folder() / f"{study.device}.json"
    longer = f"one of {format_duration(before)} ({earlier[0].machine.get('date')})"
    back = f"remove {where}" if earlier[1].parent == SHIPPED else "repeat that study"
    text = f"runs of this device now take their errors from this study of {format_duration(spent)} of processor time"
    return (f"{text}, no longer from {longer}. To go back {back}",)


def preview(
    case: Case,
    budget: float | None = None,
    jobs: int | None = None,
    targets: Sequence[float] = TARGETS,
    progress: Callable[[], Any] = nullcontext,
    source: str | None = None,
) -> Iterator[Report]:
    """Yield what is known before a study, then what it would measure and cost; nothing runs or is written.

    First the torque by the law of the powder, then the cheapest that reaches each of the `targets`, last the values
    that the study would measure. Costs are processor times: measured by the accuracy study of the device, where it has
    one at the scene's settings, else planned, within a factor of two. The first replicas decide which values get more.

    Parameters
    ----------
    budget, jobs, targets : as of `accuracy`, with the same errors.
    progress : makes a context manager whose value has update(fraction, text), or is None.
    source : the scene in the commands that are shown, with the options that change it; default: its file.
    """
    jobs, source = checked_jobs(jobs), source or shlex.quote(str(case.path or "CASE"))
    refuse_unmeasurable(case)
    law = TorqueByLaw.of(case, source)
    yield _lines({"law": law.as_dict()}, note(law.in_words()))
    base, found = base_of(case), _earlier_study(device_of(case))
    study = None if found is None else found[0]
    own, measured = _replica_seconds(base, study)
    first = makespan([own] * BASE_REPLICAS, jobs)
    if budget is not None:
        _refuse_small_budget(case, first, budget, jobs)
    usual = BUDGET if first <= BUDGET else comfortable_budget(4.0 * first)
    answers: list[CheapestAnswer] = []
    budgets = [budget or usual]
    for target in sorted(targets, reverse=True):
        share, command, estimate, enough = format_percent(target), "", None, None
        cheapest = None if study is None else cheapest_case(case, study, target)
        grains = cheapest[0] if isinstance(cheapest, tuple) else cheapest
        if isinstance(grains, Choice):
            command = f"emclutch run {source} --set time.until=none --set 'accuracy.target={share}'"
        elif grains is not None:
            enough = grains.budget(jobs, usual)
        else:
            estimate = estimate_by_other_devices(case, target, own, jobs)
            # twice the estimate, whose uncertainty is larger
            enough = max(usual, comfortable_budget(2.0 * ((estimate and estimate["study_seconds"]) or 0.0) / jobs))
        if enough is not None:
            command = f"emclutch accuracy {source} --for '{share}' --budget {budget_option(enough)}"
            command += "" if jobs == cores_at_hand() else f" --jobs {jobs}"
            budgets += [enough] if budget is None else []
        answers.append(
            CheapestAnswer(target=target, law=law, grains=grains, command=command, cores=jobs, estimate=estimate)
        )
    known = [] if study is None else [note(own_in_words(study, jobs))]
    without = note(f"{TAKEN_AS_GIVEN} Fill: {fill_in_words(base.scene, base.device)}.")
    yield _lines({"cheapest": [one.as_dict() for one in answers]}, *known, *statements_on(answers), without,
                 *map(warning, law.warnings))
    if any(one.fidelity != "law" for one in answers):  # else no study is needed
        which = "The budget" if budget is not None else "The largest budget of these commands"
        yield _costs(base, own, measured, first, max(budgets), which, jobs, progress)


def _lines(data: dict[str, Any], *statements: Statement) -> Report:
    return Report("", data=data).add("", Statements(statements), Shown.TERMINAL)


def _replica_seconds(base: Base, study: AccuracyStudy | None) -> tuple[float, bool]:
    """Return the processor time of a replica [s], and whether a study has measured it at the scene's settings."""
    if study is not None:
        own = {one.name: one for one in study.settings}
        settings = [one for one in settings_of(base.scene) if one.measured_on != HISTORIES]
        if all(one.name in own and own[one.name].is_own(one.own(base.scene, base.plan)) for one in settings):
            return study.seconds, True
    return base.plan.cost.seconds["total"], False


def _costs(
    base: Base, own: float, measured: bool, first: float, budget: float, which: str, jobs: int,
    progress: Callable[[], Any],
) -> Report:  # fmt: skip
    """Return the values that a study within a budget measures, with what a replica of each costs [s].

    `which` names the budget.
    """
    asked, settings = values_to_plan(base), settings_of(base.scene)
    by_torque = {one.name for one in settings if one.measured_on == TORQUE}
    replicas = [one for one in asked if one.setting in by_torque]
    plans = []
    with progress() as bar:
        for number, one in enumerate(replicas):
            if bar is not None:
                bar.update(number / len(replicas), "estimating the cost of the study")
            plans.append(plan_value(one, base))
    planned = _distinct(base, accepted_values(base, replicas, plans))
    late: list[str] = []
    rows: list[tuple[str, ...]] = []
    room = budget - first
    for setting in settings:
        seconds = {one.value: own * one.seconds / base.seconds for one in planned if one.setting == setting.name}
        dear = {value: one for value, one in seconds.items() if one > room}
        late += [f"{in_words(setting.name)} {value:.4g} ({format_duration(one)})" for value, one in dear.items()]
        if setting.measured_on == TORQUE:
            values = [f"{value:.4g} ({format_duration(one)})" for value, one in seconds.items() if value not in dear]
            how = "one run per value" if values else "no time in this budget" if dear else ""
        else:
            values = [f"{one.asked:.4g}" for one in asked if one.setting == setting.name]
            how = "field solved again on fixed grains" if values else ""
        if setting is START_UP:
            values, how = [one.removeprefix("strain ") for one in map(str, starts_of(base)[1:])], "the same replicas"
        own_value = f"{setting.own(base.scene, base.plan):.4g} {setting.unit}".rstrip()
        none = "" if dear else ONE_VALUE
        rows.append((in_words(setting.name), own_value, ", ".join(values) or none, how if values or dear else ""))
    statements = [
        *map(note, _cost_in_words(own, measured, which, budget, jobs)),
        *([warning(f"values too expensive for this budget: {', '.join(late)}")] if late else []),
        *([warning(narrow)] if (narrow := narrow_sector(base.scene)) else []),
    ]  # fmt: skip
    head = ("setting", "in the scene", "values to measure (processor time)", "measured on")
    data = {"budget": budget, "jobs": jobs, "replica_seconds": own}
    found = Report("", data=data).add("Cost", Statements(statements), Shown.TERMINAL)
    return found.add("Values", Table(rows, head, (1,)), Shown.TERMINAL)


def _cost_in_words(own: float, measured: bool, which: str, budget: float, jobs: int) -> tuple[str, str]:
    """Return what the first replicas of a study take, `own` [s] each, and what a budget [s] is enough for."""
    cost = format_cost(BASE_REPLICAS * own, min(jobs, BASE_REPLICAS), makespan([own] * BASE_REPLICAS, jobs))
    by, cores = "measured" if measured else "estimate, within a factor of two", "core" if jobs == 1 else "cores"
    return (
        f"A study begins with {BASE_REPLICAS} replicas at the settings of the scene: {cost}, {by}.",
        f"{which}, {format_duration(budget)} on {jobs} {cores}, is enough for about {jobs * budget / own:.0f} such "
        "replicas. Finer values cost more.",
    )


def _earlier_study(device: str) -> tuple[AccuracyStudy, Path] | None:
    try:
        return find_accuracy_study(device)
    except OutputError:  # damaged: the new one takes its place
        return None


def _refuse_small_budget(case: Case, first: float, budget: float, jobs: int) -> None:
    """SceneError where the replicas that run in any case take longer, `first` [s] of wall-clock time."""
    if first > budget:
        message = (
            f"is less than the {BASE_REPLICAS} replicas at the scene's own settings take with {jobs} jobs, about "
            f"{format_duration(first)}, and replicas at other settings must be run beside them; give five times that, "
            f"{budget_option(comfortable_budget(4.0 * first))}, or more"
        )
        raise SceneError([Fault(BUDGET_OPTION, f"{budget:g} s", message)], source_of(case))


def _begun(
    case: Case,
    base: Base,
    budget: float,
    jobs: int,
    targets: Sequence[float],
    executor: Executor | None,
    progress: Any,
) -> dict[str, Any]:
    """Plan every value, and return what stands in plan.json before anything runs."""
    own = base.plan.cost.seconds["total"]
    _refuse_small_budget(case, makespan([own] * BASE_REPLICAS, jobs), budget, jobs)
    values = values_to_plan(base)
    found = []
    for one in call_all(executor, plan_value, values):
        found.append(one)
        if progress is not None:
            progress.update(0.0, f"values are planned: {len(found)} of {len(values)}")
    planned = accepted_values(base, values, found)
    return {
        "case": case.toml(),
        "budget": budget,
        "jobs": jobs,
        "targets": list(targets),
        "machine": this_machine(),
        "values": [asdict(one) for one in _distinct(base, planned)],
        "frozen": None,
        "stages": [],
        "begun": None,
    }


def _distinct(base: Base, planned: Sequence[PlannedValue]) -> list[PlannedValue]:
    """Leave out values that come out as the scene's own, or as another one."""
    seen = {one.name: [one.own(base.scene, base.plan)] for one in settings_of(base.scene)}
    kept = []
    for one in planned:
        if all(abs(one.value / other - 1.0) > 1e-3 for other in seen[one.setting]):
            seen[one.setting].append(one.value)
            kept.append(one)
    return kept


class _StudyRun(BudgetedStudy):
    """The tasks of a study, and the order in which they are done."""

    base: Base
    share = told = 0.0
    _begins: Mapping[str, int] = {}
    """Number of each replica in the order of the stages, while these are run."""

    def measure(self, base: Base) -> AccuracyStudy:
        """Do all tasks, and return the study."""
        self.base = base
        self.values = [PlannedValue(**one) for one in self.known["values"]]
        self.settings = {one.name: one for one in settings_of(base.scene)}
        self.starts = tuple(starts_of(base))
        self._tell_cost()
        warm = self.base.case.with_values(compiling_run(self.base.plan))
        self.do([Task(WARM_UP, warm, measure_replica, {"starts": (0.0,)})], "a short run compiles the kernels")
        self.refuse_failed(WARM_UP)
        replicas = [self._replica(BASE, 0.0, replica_name(BASE, 0.0, n)) for n in range(BASE_REPLICAS)]
        self.do(replicas, "replicas at the scene's own settings")
        for task in replicas:
            self.refuse_failed(task.name)
        refuse_no_torque([self.rows[task.name] for task in replicas])
        self._tell_scatter()
        self._measure_frozen()
        self._measure_torque()
        return study_of(self._measured())

    # what is done -----------------------------------------------------------------------------------------------

    def _measure_frozen(self) -> None:
        """Measure the settings without noise on a frozen packing, the cheapest values first."""
        frozen = [one for one in self.settings.values() if one.measured_on == FROZEN]
        if not frozen:
            return
        own = {task.name: task for task in (self._frozen(setting, None) for setting in frozen)}
        self.do(list(own.values()), "field and moments of a frozen packing")
        if self.known["frozen"] is None:
            ratio = max(self.rows[name].seconds for name in own) / max(self._planning(None), 1e-3)
            room, chosen = FROZEN_SHARE * self.budget - sum(self.rows[name].seconds for name in own), []
            number = [n for n, one in enumerate(self.values) if self.settings[one.setting].measured_on == FROZEN]
            for n in sorted(number, key=lambda n: (self.values[n].planning, n)):
                room -= ratio * self._planning(self.values[n])
                if room >= 0.0:
                    chosen.append(n)
            self.decide(frozen=chosen)
        tasks = [self._frozen(self.settings[self.values[n].setting], self.values[n]) for n in self.known["frozen"]]
        self.do(tasks, "field and moments of a frozen packing")

    def _planning(self, planned: PlannedValue | None) -> float:
        """Return the processor time of a value's mesh and field [s]; of the scene's own that of most others."""
        all_of_them = sorted(one.planning for one in self.values)
        usual = all_of_them[len(all_of_them) // 2] if all_of_them else 1.0
        return usual if planned is None else max(planned.planning, usual)

    def _measure_torque(self) -> None:
        """Run a replica of each setting that fits in, then what else lowers the error until the budget is used up."""
        for number in range(self._stages()):
            if number == len(self.known["stages"]):
                stage = number - self._former_stages()
                room = STAGE_FRACTIONS[stage] * (self.known["budget"] - self._elapsed()) / self._busy()
                self.decide(stages=[*self.known["stages"], self._stage(stage, room)])
            self._tell_replicas(self.known["stages"][number])
            begin = sum(map(len, self.known["stages"][:number]))
            order = self._order()[begin : begin + len(self.known["stages"][number])]
            tasks = [self._replica(*key, name) for key, name in order]
            self._begins = {task.name: begin + n for n, task in enumerate(tasks)}
            self.do(tasks, "replicas")

    def open_decisions(self) -> dict[str, Any]:
        """Return what a larger budget leaves open: more values without noise, and three more stages of replicas."""
        return {"frozen": None, "begun": None, "former_stages": len(self.known["stages"])}

    def _former_stages(self) -> int:
        """Return the number of stages that were planned before the budget was last raised."""
        return self.known.get("former_stages", 0)

    def _stages(self) -> int:
        return self._former_stages() + len(STAGE_FRACTIONS)

    def _stage(self, stage: int, room: float) -> tuple[Key, ...]:
        """Return the replicas of a stage that fit into a wall-clock time of cores that do nothing else [s]."""
        offers, jobs = self._offers(), self.known["jobs"]
        if stage == 0:
            planned = {name for (name, _), _ in self._order()}
            return first_replicas([one for one in offers if one.name not in planned], BASE_REPLICAS, room, jobs)
        measured = self._measured()
        count = {key: len(some) for key, some in measured.replicas.items()}
        found = Torques(measured.means, *measured.scatter)
        return more_replicas(offers, count, found, self._seconds(), room, jobs, self._aims(study_of(measured)))

    def _aims(self, study: AccuracyStudy) -> list[Aim]:
        """Return the scene's own settings, and those that come nearest to each target."""
        choices = [own_choice(study)]
        for target in self.known["targets"]:
            found = recommended(study, target)
            choice = found.best if isinstance(found, LimitingError) else found
            if choice is not None and all(choice.values != one.values for one in choices):
                choices.append(choice)
        return [self._aim(one) for one in choices]

    def _aim(self, choice: Choice) -> Aim:
        step_sizes = {name: self.settings[name].step_size(one) for name, one in choice.values.items()}
        rest = [half for name, half in choice.parts.items() if name == STATISTICS or
                (name != INTERACTION and self.settings[name].measured_on != TORQUE)]  # fmt: skip
        return Aim(step_sizes, math.hypot(*rest))

    def may_begin(self, task: Task) -> bool:
        if task.name not in self._begins:
            return True
        number, tasks = self._begins[task.name], self._series[0]
        if self.known["begun"] is None and self._elapsed() + self.wall(tasks) > OVERRUN * self.known["budget"]:
            log.warning("the budget is used up: from replica %d on none is run", number)
            self.decide(begun=number)
        return self.known["begun"] is None or number < self.known["begun"]

    def _seconds(self, planned: PlannedValue | None = None) -> float:
        """Return the time of a replica at a value, or at the scene's own settings [s]; predicted before one was run."""
        if run := self._run(BASE if planned is None else planned.setting, 0.0 if planned is None else planned.value):
            return sum(one.seconds for one in run) / len(run)
        if planned is None:
            return self.base.plan.cost.seconds["total"]
        return self._seconds() * planned.seconds / self.base.seconds

    def _run(self, setting: str, value: float) -> list[Row]:
        """Return the first replicas at a value that were run."""
        names = [replica_name(setting, value, n) for n in range(BASE_REPLICAS)]
        return [self.rows[name] for name in names if name in self.rows]

    def _offers(self) -> list[OfferedSetting]:
        return [self._offer(one) for one in self.settings.values() if one.measured_on == TORQUE]

    def _offer(self, setting: Setting) -> OfferedSetting:
        own = float(setting.own(self.base.scene, self.base.plan))
        here = OfferedValue(own, setting.step_size(own), self._seconds(), 1.0)
        others = tuple(
            OfferedValue(one.value, one.step_size, self._seconds(one), self.base.plan.cost.grains / one.grains)
            for one in self.values
            if one.setting == setting.name and not any(run.state == FAILED for run in self._run(one.setting, one.value))
        )
        limit = setting.limit(self.base.scene, self.base.plan)
        return OfferedSetting(setting.name, setting.order, limit, here, others, setting.is_large)

    def _order(self) -> list[tuple[tuple[str, float], str]]:
        """Return setting and value, and the folder, of each replica that was planned after the first ones."""
        number: dict[tuple[str, float], int] = {OWN: BASE_REPLICAS}
        found = []
        for setting, value in chain(*self.known["stages"]):
            n = number.get((setting, value), 0)
            number[setting, value] = n + 1
            found.append(((setting, value), replica_name(setting, value, n)))
        return found

    def _measured(self) -> StudyRuns:
        """Return all results, by setting and value; replicas that were not run are left out."""
        replicas: dict[tuple[str, float], list[Row]] = {}
        first = [((BASE, 0.0), replica_name(BASE, 0.0, n)) for n in range(BASE_REPLICAS)]
        for key, name in (*first, *self._order()):
            if name in self.rows and (key != OWN or self.rows[name].state == DONE):
                replicas.setdefault(key, []).append(self.rows[name])
        frozen = {}
        for setting in self.settings.values():
            if setting.measured_on == FROZEN:
                own = float(setting.own(self.base.scene, self.base.plan))
                frozen[setting.name, own] = self._frozen(setting, None).name
        for n in self.known["frozen"] or ():
            planned = self.values[n]
            frozen[planned.setting, planned.value] = self._frozen(self.settings[planned.setting], planned).name
        return StudyRuns(
            case=self.case, base=self.base, planned=tuple(self.values), starts=self.starts, replicas=replicas,
            frozen={key: self.rows[name] for key, name in frozen.items()},
            left_out=left_out(self._offers(), [key for key, _ in self._order()]),
            budget=self.known["budget"],
            jobs=self.known["jobs"],
            spent=self._spent(),
            machine=self.known.get("machine") or this_machine(),
        )  # fmt: skip

    # tasks ------------------------------------------------------------------------------------------------------

    def _replica(self, setting: str, value: float, name: str) -> Task:
        """Return the task of a replica, whose seed follows from its number, the last part of its name.

        Replicas with equal seeds at different settings have independent torques beyond a shear strain of 2 to 4
        (docs/explanation/accuracy_method.md).
        """
        number = int(Path(name).name)
        values: dict[str, Any] = {"scene.seed": replica_seed(self.case.scene.scene.seed, FIRST_SEED + number)}
        if setting != BASE:
            values |= next(one for one in self.values if (one.setting, one.value) == (setting, value)).entries
        options = {"starts": self.starts, "keeps_grains": name == replica_name(BASE, 0.0, 0)}
        return Task(name, self.base.case.with_values(values), measure_replica, options)

    def _frozen(self, setting: Setting, planned: PlannedValue | None) -> Task:
        """Return the task of a value on the frozen packing; None: the scene's own."""
        own_key = setting.key if setting.key.startswith("effects.") and setting.key.endswith(".tolerance") else ""
        if planned is None:
            value, case = float(setting.own(self.base.scene, self.base.plan)), self.base.case
        else:
            value, case = planned.value, self.base.case.with_values(planned.entries)
        name = frozen_name(setting.name, value) if planned or own_key else frozen_name("own", 0.0)
        grains = str((self.folder / replica_name(BASE, 0.0, 0) / GRAINS).resolve())
        return Task(name, case, measure_moments, {"grains": grains, "own_key": own_key})

    def look(self, running: Sequence[Task]) -> None:
        """Report the progress of the replicas that run."""
        part = 0.0
        if WARM_UP in self.rows:
            names, folders = {task.name for task in running}, self.attempts_at(running)
            times = (last_time(RunFolder(folder).history) or 0.0 for name, folder in folders.items() if name in names)
            part = sum(times) / self.base.plan.end * self._seconds()
        now = self.fraction(part)
        if now - self.told >= TELL_SHARE and self.progress is not None:
            self.told = now
            self.progress.update(now, None)

    def _spent(self) -> float:
        """Return the processor time so far [s], without that of compiling, once on a machine."""
        tasks = sum(one.seconds for name, one in self.rows.items() if name != WARM_UP)
        return tasks + sum(one.planning for one in self.values)

    def _elapsed(self) -> float:
        """Return the wall-clock time so far [s], without that of compiling, once on a machine."""
        warm_up = self.rows[WARM_UP].wall
        return self.elapsed - warm_up + sum(one.planning for one in self.values) / self.known["jobs"]

    def _busy(self) -> float:
        """Return how much longer the replicas took than their processor time, since the machine does other work too.

        At most `MAX_LOAD`: on a machine that is busier still the study takes longer than its budget, and says so.
        """
        run = [one for name, one in self.rows.items() if name != WARM_UP and not name.startswith(FROZEN_FOLDER)]
        found = sum(one.wall for one in run) / max(sum(one.seconds for one in run), 1e-9)
        return min(max(1.0, found), MAX_LOAD)

    def fraction(self, more: float = 0.0) -> float:
        """Return how much of what is planned, or before that of the budget, is done."""
        total = self.budget
        if len(self.known["stages"]) == self._stages():
            planned = {(one.setting, one.value): self._seconds(one) for one in self.values} | {OWN: self._seconds()}
            left = [planned[key] for key, name in self._order() if name not in self.rows]
            total = self._spent() + sum(left)
        self.share = max(self.share, min((self._spent() + more) / total, 0.99))
        return self.share

    # words ------------------------------------------------------------------------------------------------------

    def _tell_cost(self) -> None:
        earlier = _earlier_study(device_of(self.case))
        cost = _replica_seconds(self.base, None if earlier is None else earlier[0])
        for words in _cost_in_words(*cost, "The budget", self.known["budget"], self.known["jobs"]):
            self.log(words)
        if narrow := narrow_sector(self.base.scene):
            self.log(f"Warning: {narrow}")

    def _tell_scatter(self) -> None:
        rows = [self.rows[replica_name(BASE, 0.0, n)] for n in range(BASE_REPLICAS)]
        values = [float(one.values["torque"]) for one in rows]
        scatter = scatter_of(values)
        self.log(
            f"Replicas scatter by {100.0 * scatter:.2g} % (standard deviation of {len(values)}). A difference of 5 % "
            f"between two values needs {replicas_for(0.05, scatter)} replicas of each, of 2 % "
            f"{replicas_for(0.02, scatter)}."
        )

    def _tell_replicas(self, replicas: Sequence[tuple[str, float]]) -> None:
        names = sorted({setting or "the scene's own settings" for setting, _ in replicas})
        words = f"{len(replicas)} more replicas, for {', '.join(names)}" if replicas else "no more replicas"
        if self._busy() > 1.3:
            words += f"; the machine is busy: all takes {self._busy():.1f} times as long, or longer"
        if len(self.known["stages"]) > 1 and (without := self._measured().left_out):
            words += f"; the budget has no room for {', '.join(without)}"
        self.log(words)


def replica_name(setting: str, value: float, number: int) -> str:
    """Return the folder of a replica in that of the study."""
    return f"{setting}-{value:.6g}/{number:02d}" if setting else f"own/{number:02d}"


def frozen_name(setting: str, value: float) -> str:
    """Return the folder of a value on the frozen packing."""
    return f"{FROZEN_FOLDER}/{setting}-{value:.6g}" if value else f"{FROZEN_FOLDER}/{setting}"
