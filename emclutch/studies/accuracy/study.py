"""Accuracy study: the ladder of a scene's knobs within a budget, and the settings for wanted accuracies.

Packings at the scene's own settings come first; what they cost, and how much they scatter, decides what the budget is
enough for (`emclutch.studies.accuracy.plan`). Magnetic knobs are measured on the grains at the end of the first.
Every packing is a task in a folder of its own, and depends on its scene and seed alone; ``plan.json`` holds every
decision. So a study that is stopped, or killed, continues to the same ladder.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from itertools import chain
from pathlib import Path
from typing import Any

from emclutch.knobs import FROZEN, TORQUE, Knob, knobs_of
from emclutch.results import RunFolder
from emclutch.results.atomic_file import replace_text
from emclutch.results.errors import Interrupted, OutputError
from emclutch.results.history import last_time
from emclutch.results.ladder import INTERACTION, Ladder
from emclutch.results.ladders import SHIPPED, find_ladder, ladder_folder, save_ladder
from emclutch.results.recommended import STATISTICS, Choice, Obstacle, own_choice, recommended
from emclutch.results.text import format_duration
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.replica_count import replica_seed
from emclutch.simulation.plan_in_words import narrow_sector
from emclutch.studies.accuracy.measured_ladder import Measured, ladder_of, refuse_no_torque, scatter_of, this_machine
from emclutch.studies.accuracy.plan import (
    BASE,
    OWN,
    Aim,
    Key,
    OfferedKnob,
    OfferedRung,
    Torques,
    first_packings,
    left_out,
    makespan,
    more_packings,
    packings_for,
)
from emclutch.studies.accuracy.rungs import (
    Base,
    PlannedRung,
    PlannedSetting,
    base_of,
    compiling_run,
    planned_rungs,
    planned_setting,
    refuse_what_has_no_ladder,
    setting_tasks,
    source_of,
    starts_of,
)
from emclutch.studies.accuracy.tasks import GRAINS, AccuracyTask, TaskResult
from emclutch.studies.resumable import BUDGET, ResumableStudy, begun_study, checked_jobs
from emclutch.studies.task_queue import TaskQueue, tell

log = logging.getLogger(__name__)
BUDGET_OPTION = "--budget"
TARGETS = (0.10, 0.05, 0.03)
BASE_PACKINGS = 4
FROZEN_SHARE = 0.25
"""Of the budget, for the knobs without noise."""
ROOMS = (1.0, 0.5, 1.0)
"""Share of the time left that each stage of packings plans for; what it finds decides the next."""
OVERRUN = 1.2
"""Wall-clock time over the budget, from which on no more packings are begun."""
BUSIEST = 2.0
FIRST_SEED = 1_000_000
"""Number of the first packing's seed (`replica_seed`): a run of the scene, which counts from 0, has other packings."""
WARM_UP, STANDING = "warm-up", "standing"
TELL_SHARE = 0.01
PLAN = "plan.json"


@dataclass(frozen=True)
class AccuracyResult:
    """An accuracy study.

    Attributes
    ----------
    folder : Path
    ladder : Ladder
    lines : tuple of str
        What it has found, in words.
    """

    folder: Path
    ladder: Ladder
    lines: tuple[str, ...] = ()


def accuracy(
    case: Case | str | Path,
    *,
    out: str | Path | None = None,
    budget: float | None = None,
    jobs: int | None = None,
    resume: bool = False,
    targets: Sequence[float] = TARGETS,
    progress=None,
) -> AccuracyResult:
    """Measure what each numerical setting of a scene adds to its torque's error, and what it costs.

    The folder holds ``ladder.json``, tables, a picture and a scene for each target that can be reached; ``plan.json``
    with what was decided; a folder for each packing. Runs of the same device find the ladder by themselves.

    Parameters
    ----------
    case : Case, or the path of a scene file.
    out : folder; default: the next free studies/<case>-accuracy-<nnn>.
    budget : wall-clock time [s]; default 20 min. Four packings at the scene's own settings are run in any case.
    jobs : packings at a time, each on one thread of a process of its own; default: the cores at hand. A script that
        asks for more than one must do so under ``if __name__ == "__main__":``. What a packing gives does not depend on
        it.
    resume : continue the study in `out`, with its own budget.
    targets : relative half widths of the torque's 95 % interval to find settings for.
    progress : as of `emclutch.run`; if it has note(text), it is called with what the study is going to cost.

    Raises
    ------
    SceneError
        Before anything runs: no torque on a disc, nothing to vary, or a setting in `accuracy.ladders` that the scene
        does not take.
    OutputError
        The folder is in use, not empty, or of another scene.
    RunError
        A packing at the scene's own settings failed; `Interrupted` after Ctrl-C: what is done is kept.
    ValueError
        `jobs` is less than 1.
    """
    case, jobs = as_case(case), checked_jobs(jobs)
    refuse_what_has_no_ladder(case)
    folder = Path(out) if out is not None else RunFolder.next_path(f"{case.name}-accuracy", "studies")
    base = base_of(case)

    def begin(queue: TaskQueue) -> dict[str, Any]:
        return _begun(case, base, BUDGET if budget is None else budget, jobs, targets, queue, progress)

    with begun_study(case, folder, PLAN, resume=resume, budget=budget, jobs=jobs, begin=begin) as (known, queue):
        study = _Study(case, base, folder, known, queue, progress)
        ladder = study.measure()
        replace_text(folder / "ladder.json", ladder.to_json())
        earlier = _ladder_so_far(ladder.device)
        lines = _presented(case, ladder, folder, targets)
        if study.performed or earlier is None:  # one that was finished may have a later ladder in its place
            save_ladder(ladder)
            lines += _replaced(ladder, earlier)
    return AccuracyResult(folder, ladder, tuple(lines))


def preview(case: Case, budget: float | None = None, jobs: int | None = None) -> list[str]:
    """Return what `accuracy` would measure and what that is estimated to cost, in lines; nothing runs or is written.

    `budget` [s], `jobs` and what is raised before anything runs are as of `accuracy`. Costs are processor times of one
    packing each, within a factor of two, and on standing grains of mesh and field alone, without that of the moments;
    which rungs get more packings is decided by what the first ones say.
    """
    jobs, budget = checked_jobs(jobs), BUDGET if budget is None else budget
    refuse_what_has_no_ladder(case)
    base = base_of(case)
    _refuse_small_budget(case, base, budget, jobs)
    tasks, own = setting_tasks(base), base.plan.cost.seconds["total"]
    rungs = _distinct(base, planned_rungs(base, tasks, [planned_setting(one) for one in tasks]))
    lines = [f"{BASE_PACKINGS} packings at the scene's own settings: {format_duration(BASE_PACKINGS * own)}"]
    for knob in knobs_of(base.scene):
        frozen = knob.measured_on == FROZEN
        found = [
            f"{one.setting:.4g} (field alone: {format_duration(one.planning)})"
            if frozen
            else f"{one.setting:.4g} ({format_duration(own * one.seconds / base.seconds)})"
            for one in rungs
            if one.knob == knob.name
        ]
        how = "on standing grains" if frozen else "a packing each"
        setting = f"{knob.name.replace('_', ' ')}, {knob.own(base.scene, base.plan):.4g} in the scene"
        lines.append(f"{setting}: {', '.join(found)}, {how}" if found else f"{setting}: no other setting")
    number = jobs * budget / own
    room = f"in {format_duration(budget)} with {jobs} at a time there is time for some {number:.0f} packings"
    lines += [f"WARNING: {narrow}"] if (narrow := narrow_sector(base.scene)) else []
    return [*lines, f"{room} at the scene's own settings; the four above run in any case"]


def _ladder_so_far(device: str) -> tuple[Ladder, Path] | None:
    try:
        return find_ladder(device)
    except OutputError:  # damaged: the new one takes its place
        return None


def _replaced(ladder: Ladder, earlier: tuple[Ladder, Path] | None) -> list[str]:
    """Say that a ladder has taken the place of one that took longer to measure."""
    if earlier is None:
        return []
    spent, before = (float(one.machine.get("processor_seconds") or 0.0) for one in (ladder, earlier[0]))
    if before <= spent:
        return []
    where = ladder_folder() / f"{ladder.device}.json"
    return [
        f"runs of this device now have their errors from this ladder, in place of one of {format_duration(before)} of "
        f"processor time ({earlier[0].machine.get('date')}); "
        + (f"remove {where} to have that one back" if earlier[1].parent == SHIPPED else "repeat that study to go back")
    ]


def _presented(case: Case, ladder: Ladder, folder: Path, targets: Sequence[float]) -> list[str]:
    from emclutch.studies.accuracy.answers import present  # local: it draws

    return present(case, ladder, folder, targets)


def _refuse_small_budget(case: Case, base: Base, budget: float, jobs: int) -> None:
    """SceneError where the packings that run in any case take longer."""
    first = makespan([base.plan.cost.seconds["total"]] * BASE_PACKINGS, jobs)
    if first > budget:
        message = (
            f"is less than the {BASE_PACKINGS} packings at the scene's own settings take with {jobs} jobs, about "
            f"{format_duration(first)}, and packings of other settings must be run beside them; give five times that, "
            f"{format_duration(5.0 * first)}, or more"
        )
        raise SceneError([Fault(BUDGET_OPTION, f"{budget:g} s", message)], source_of(case))


def _begun(
    case: Case, base: Base, budget: float, jobs: int, targets: Sequence[float], queue: TaskQueue, progress: Any
) -> dict[str, Any]:
    """Plan every setting, and return what stands in plan.json before anything runs."""
    _refuse_small_budget(case, base, budget, jobs)
    tasks = setting_tasks(base)
    found: dict[int, PlannedSetting] = {}

    def take(number: int, one: PlannedSetting) -> None:
        found[number] = one
        tell(progress, 0.0, f"settings are planned: {len(found)} of {len(tasks)}")

    queue.all(planned_setting, enumerate(tasks), take)
    if queue.stopped:
        raise Interrupted("stopped before the study began")
    rungs = planned_rungs(base, tasks, [found[n] for n in range(len(tasks))])
    return {
        "case": case.toml(),
        "budget": budget,
        "jobs": jobs,
        "targets": list(targets),
        "machine": this_machine(),
        "rungs": [asdict(one) for one in _distinct(base, rungs)],
        "frozen": None,
        "stages": [],
        "begun": None,
    }


def _distinct(base: Base, rungs: Sequence[PlannedRung]) -> list[PlannedRung]:
    """Leave out settings that come out as the scene's own, or as another one."""
    seen = {one.name: [one.own(base.scene, base.plan)] for one in knobs_of(base.scene)}
    kept = []
    for rung in rungs:
        if all(abs(rung.setting / one - 1.0) > 1e-3 for one in seen[rung.knob]):
            seen[rung.knob].append(rung.setting)
            kept.append(rung)
    return kept


class _Study(ResumableStudy):
    """What is to be done next."""

    def __init__(
        self, case: Case, base: Base, folder: Path, known: dict[str, Any], queue: TaskQueue, progress: Any
    ) -> None:
        super().__init__(folder, PLAN, known, queue, progress)
        self.case, self.base = case, base
        self.rungs = [PlannedRung(**one) for one in known["rungs"]]
        self.knobs = {one.name: one for one in knobs_of(base.scene)}
        self.starts = tuple(starts_of(base))
        self.share = self.told = 0.0

    def measure(self) -> Ladder:
        """Do all tasks, and return the ladder."""
        self._tell_cost()
        warm = self.base.case.with_values(compiling_run(self.base.plan))
        self.do([self._task(warm, WARM_UP, starts=(0.0,))], "a short run compiles the kernels")
        self.refuse_failed(WARM_UP)
        packings = [self._packing(BASE, 0.0, packing_name(BASE, 0.0, n)) for n in range(BASE_PACKINGS)]
        self.do(packings, "packings at the scene's own settings", look=self._look)
        for task in packings:
            self.refuse_failed(task.folder)
        refuse_no_torque([self.results[task.folder] for task in packings])
        self._tell_scatter()
        self._measure_frozen()
        self._measure_torque()
        return ladder_of(self._measured())

    # what is done -----------------------------------------------------------------------------------------------

    def _measure_frozen(self) -> None:
        """Turn the knobs without noise on standing grains, the cheapest settings first."""
        frozen = [one for one in self.knobs.values() if one.measured_on == FROZEN]
        if not frozen:
            return
        own = {task.folder: task for task in (self._standing(knob, None) for knob in frozen)}
        self.do(list(own.values()), "field and moments of standing grains")
        if self.known["frozen"] is None:
            ratio = max(self.results[name].seconds for name in own) / max(self._planning(None), 1e-3)
            room, chosen = FROZEN_SHARE * self.budget - sum(self.results[name].seconds for name in own), []
            number = [n for n, one in enumerate(self.rungs) if self.knobs[one.knob].measured_on == FROZEN]
            for n in sorted(number, key=lambda n: (self.rungs[n].planning, n)):
                room -= ratio * self._planning(self.rungs[n])
                if room >= 0.0:
                    chosen.append(n)
            self.decide(frozen=chosen)
        tasks = [self._standing(self.knobs[self.rungs[n].knob], self.rungs[n]) for n in self.known["frozen"]]
        self.do(tasks, "field and moments of standing grains")

    def _planning(self, rung: PlannedRung | None) -> float:
        """Return the processor time of a setting's mesh and field [s]; of the scene's own that of most others."""
        all_of_them = sorted(one.planning for one in self.rungs)
        usual = all_of_them[len(all_of_them) // 2] if all_of_them else 1.0
        return usual if rung is None else max(rung.planning, usual)

    def _measure_torque(self) -> None:
        """Run a packing of each knob that fits in, then what else lowers the error until the budget is used up."""
        for number, share in enumerate(ROOMS):
            if number == len(self.known["stages"]):
                room = share * (self.known["budget"] - self._elapsed()) / self._busy()
                self.decide(stages=[*self.known["stages"], self._planned(number, room)])
            self._tell_packings(self.known["stages"][number])
            begin = sum(map(len, self.known["stages"][:number]))
            self._do_packings(begin, begin + len(self.known["stages"][number]))

    def _planned(self, stage: int, room: float) -> tuple[Key, ...]:
        """Return the packings of a stage that fit into a wall-clock time of cores that do nothing else [s]."""
        offers, jobs = self._offers(), self.known["jobs"]
        if stage == 0:
            return first_packings(offers, BASE_PACKINGS, room, jobs)
        measured = self._measured()
        count = {key: len(some) for key, some in measured.packings.items()}
        found = Torques(measured.means, *measured.scatter)
        return more_packings(offers, count, found, self._seconds(), room, jobs, self._aims(ladder_of(measured)))

    def _aims(self, ladder: Ladder) -> list[Aim]:
        """Return the scene's own settings, and those that come nearest to each target."""
        choices = [own_choice(ladder)]
        for target in self.known["targets"]:
            found = recommended(ladder, target)
            choice = found.best if isinstance(found, Obstacle) else found
            if choice is not None and all(choice.settings != one.settings for one in choices):
                choices.append(choice)
        return [self._aim(one) for one in choices]

    def _aim(self, choice: Choice) -> Aim:
        step_sizes = {name: self.knobs[name].step_size(one) for name, one in choice.settings.items()}
        rest = [half for name, half in choice.parts.items()
                if name != INTERACTION and (name == STATISTICS or self.knobs[name].measured_on != TORQUE)]  # fmt: skip
        return Aim(step_sizes, math.hypot(*rest))

    def _do_packings(self, begin: int, end: int) -> None:
        """Run those of the planned packings, but for what overruns the budget."""
        tasks = [self._packing(*key, name) for key, name in self._order()[begin:end]]

        def may_begin(number: int) -> bool:
            if self.known["begun"] is None and self._elapsed() + self.wall(tasks) > OVERRUN * self.known["budget"]:
                log.warning("the budget is used up: %d packings are not run", len(tasks) - number)
                self.decide(begun=begin + number)
            return self.known["begun"] is None or begin + number < self.known["begun"]

        self.do(tasks, "packings", may_begin, self._look)

    def _seconds(self, rung: PlannedRung | None = None) -> float:
        """Return what a packing of a rung, or at the scene's own settings, takes [s]; predicted before one was run."""
        if run := self._run(BASE if rung is None else rung.knob, 0.0 if rung is None else rung.setting):
            return sum(one.seconds for one in run) / len(run)
        if rung is None:
            return self.base.plan.cost.seconds["total"]
        return self._seconds() * rung.seconds / self.base.seconds

    def _run(self, knob: str, setting: float) -> list[TaskResult]:
        """Return the first packings of a setting that were run."""
        names = [packing_name(knob, setting, n) for n in range(BASE_PACKINGS)]
        return [self.results[name] for name in names if name in self.results]

    def _offers(self) -> list[OfferedKnob]:
        return [self._offer(one) for one in self.knobs.values() if one.measured_on == TORQUE]

    def _offer(self, knob: type[Knob]) -> OfferedKnob:
        own = float(knob.own(self.base.scene, self.base.plan))
        here = OfferedRung(own, knob.step_size(own), self._seconds(), 1.0)
        others = tuple(
            OfferedRung(one.setting, one.step_size, self._seconds(one), self.base.plan.cost.grains / one.grains)
            for one in self.rungs
            if one.knob == knob.name and not any(run.failure for run in self._run(one.knob, one.setting))
        )
        limit = knob.limit(self.base.scene, self.base.plan)
        return OfferedKnob(knob.name, knob.order, limit, here, others, knob.is_large)

    def _order(self) -> list[tuple[tuple[str, float], str]]:
        """Return knob and setting, and the folder, of each packing that was planned after the first ones."""
        number: dict[tuple[str, float], int] = {OWN: BASE_PACKINGS}
        found = []
        for knob, setting in chain(*self.known["stages"]):
            n = number.get((knob, setting), 0)
            number[knob, setting] = n + 1
            found.append(((knob, setting), packing_name(knob, setting, n)))
        return found

    def _measured(self) -> Measured:
        """Return all results, by knob and setting; packings that were not run are left out."""
        packings: dict[tuple[str, float], list[TaskResult]] = {}
        first = [((BASE, 0.0), packing_name(BASE, 0.0, n)) for n in range(BASE_PACKINGS)]
        for key, name in (*first, *self._order()):
            if name in self.results and (key != OWN or self.results[name].value is not None):
                packings.setdefault(key, []).append(self.results[name])
        standing = {}
        for knob in self.knobs.values():
            if knob.measured_on == FROZEN:
                standing[knob.name, float(knob.own(self.base.scene, self.base.plan))] = self._standing(
                    knob, None
                ).folder
        for n in self.known["frozen"] or ():
            rung = self.rungs[n]
            standing[rung.knob, rung.setting] = self._standing(self.knobs[rung.knob], rung).folder
        return Measured(
            case=self.case,
            base=self.base,
            rungs=tuple(self.rungs),
            starts=self.starts,
            packings=packings,
            standing={key: self.results[name] for key, name in standing.items()},
            left_out=left_out(self._offers(), [key for key, _ in self._order()]),
            budget=self.known["budget"],
            jobs=self.known["jobs"],
            spent=self._spent(),
            machine=self.known.get("machine") or this_machine(),
        )

    # tasks ------------------------------------------------------------------------------------------------------

    def _packing(self, knob: str, setting: float, name: str) -> AccuracyTask:
        """Return the task of a packing, whose seed follows from its number, the last part of its name.

        Packings with equal seeds at different settings have independent torques beyond a shear strain of 2 to 4
        (docs/accuracy.md).
        """
        number = int(Path(name).name)
        values: dict[str, Any] = {"scene.seed": replica_seed(self.case.scene.scene.seed, FIRST_SEED + number)}
        if knob != BASE:
            values |= self._rung(knob, setting).values
        return self._task(
            self.base.case.with_values(values),
            name,
            starts=self.starts,
            keeps_grains=name == packing_name(BASE, 0.0, 0),
        )

    def _standing(self, knob: type[Knob], rung: PlannedRung | None) -> AccuracyTask:
        """Return the task of a setting on standing grains; None: the scene's own."""
        own_key = knob.key if knob.key.startswith("effects.") and knob.key.endswith(".tolerance") else ""
        if rung is None:
            setting, case = float(knob.own(self.base.scene, self.base.plan)), self.base.case
        else:
            setting, case = rung.setting, self.base.case.with_values(rung.values)
        name = standing_name(knob.name, setting) if rung or own_key else standing_name("own", 0.0)
        return self._task(case, name, grains=f"{packing_name(BASE, 0.0, 0)}/{GRAINS}", own_key=own_key)

    def _task(self, case: Case, name: str, **more: Any) -> AccuracyTask:
        path = None if case.path is None else str(case.path.resolve())
        return AccuracyTask(case.data, path, case.trust_scripts, str(self.folder.resolve()), name, **more)

    def _rung(self, knob: str, setting: float) -> PlannedRung:
        return next(one for one in self.rungs if one.knob == knob and one.setting == setting)

    def _look(self, running: list[AccuracyTask]) -> None:
        """Tell how far the packings are that run."""
        part = 0.0
        for task in running:
            reached = None if task.grains else last_time(RunFolder(task.target).history)
            part += (reached or 0.0) / self.base.plan.end * self._seconds()
        now = self.fraction(part)
        if now - self.told >= TELL_SHARE:
            self.told = now
            tell(self.progress, now, None)

    def _spent(self) -> float:
        """Return the processor time so far [s], without that of compiling, once on a machine."""
        tasks = sum(one.seconds for name, one in self.results.items() if name != WARM_UP)
        return tasks + sum(one.planning for one in self.rungs)

    def _elapsed(self) -> float:
        """Return the wall-clock time so far [s], without that of compiling, once on a machine."""
        warm_up = self.results[WARM_UP].wall
        return self.elapsed - warm_up + sum(one.planning for one in self.rungs) / self.known["jobs"]

    def _busy(self) -> float:
        """Return how much longer the packings took than their processor time, by what else the machine does.

        At most `BUSIEST`: on a machine that is busier still the study takes longer than its budget, and says so.
        """
        run = [one for name, one in self.results.items() if name != WARM_UP and not name.startswith(STANDING)]
        found = sum(one.wall for one in run) / max(sum(one.seconds for one in run), 1e-9)
        return min(max(1.0, found), BUSIEST)

    def fraction(self, more: float = 0.0) -> float:
        """Return how much of what is planned, or before that of the budget, is done."""
        total = self.budget
        if len(self.known["stages"]) == len(ROOMS):
            planned = {(one.knob, one.setting): self._seconds(one) for one in self.rungs} | {
                (BASE, 0.0): self._seconds()
            }
            left = [planned[key] for key, name in self._order() if name not in self.results]
            total = self._spent() + sum(left)
        self.share = max(self.share, min((self._spent() + more) / total, 0.99))
        return self.share

    # words ------------------------------------------------------------------------------------------------------

    def _tell_cost(self) -> None:
        each, jobs = self._seconds(), self.known["jobs"]
        words = (
            f"{len(self.knobs)} knobs with {len(self.rungs)} settings beside the scene's own; a packing of "
            f"{self.base.plan.cost.grains} grains takes about {format_duration(each)} of processor time, by estimate; "
            f"{format_duration(self.known['budget'])} with {jobs} at a time, {format_duration(self.budget)} of "
            f"processor time, are enough for some {self.budget / each:.0f} packings"
        )
        self.say(words)
        if narrow := narrow_sector(self.base.scene):
            self.say(f"WARNING: {narrow}")

    def _tell_scatter(self) -> None:
        values = [self.results[packing_name(BASE, 0.0, n)].value for n in range(BASE_PACKINGS)]
        scatter = scatter_of([float(one or 0.0) for one in values])
        words = (
            f"packings differ by {100.0 * scatter:.2g} % (standard deviation of {len(values)}): to tell a difference "
            f"of 5 % two settings need {packings_for(0.05, scatter)} packings each, of 2 % "
            f"{packings_for(0.02, scatter)}"
        )
        self.say(words)

    def _tell_packings(self, packings: Sequence[tuple[str, float]]) -> None:
        names = sorted({knob or "the scene's own settings" for knob, _ in packings})
        words = f"{len(packings)} more packings, for {', '.join(names)}" if packings else "no more packings"
        if self._busy() > 1.3:
            words += f"; other programs are busy too: all takes {self._busy():.1f} times as long, or longer"
        if len(self.known["stages"]) > 1 and (without := self._measured().left_out):
            words += f"; the budget has no room for {', '.join(without)}"
        self.say(words)


def packing_name(knob: str, setting: float, number: int) -> str:
    """Return the folder of a packing in that of the study."""
    return f"{knob}-{setting:.6g}/{number:02d}" if knob else f"own/{number:02d}"


def standing_name(knob: str, setting: float) -> str:
    """Return the folder of a setting on standing grains."""
    return f"{STANDING}/{knob}-{setting:.6g}" if setting else f"{STANDING}/{knob}"
