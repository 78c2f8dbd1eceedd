"""Predicted cost of a study: the plan of each point, and all of them so many at a time."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from math import inf
from typing import Any

from emclutch.results.report.render import Reported
from emclutch.results.report.report import Mark, Report, Shown, Statement, Statements, Table, note, warning
from emclutch.scene.case import Case
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.replica_count import cores_at_hand, replica_count
from emclutch.scene.study import StudySection
from emclutch.simulation.forecast.cost import format_rough_time
from emclutch.simulation.forecast.space import shortage
from emclutch.simulation.plan import make_plan
from emclutch.simulation.stopping_rule import stopping_rule
from emclutch.simulation.threads import threads_of_a_process
from emclutch.studies.accuracy.target import cases_of


@dataclass(frozen=True, slots=True)
class PointForecast:
    """Prediction for one point.

    Attributes
    ----------
    label : its values.
    steps, grains : of one replica.
    replicas : runs of the point, each with another seed.
    seconds : wall-clock time to the scene's end [s], while other points run at the same time.
    earliest : the same where `time.until` ends it as early as shear of the gap allows [s]; `seconds` without an aim.
    memory, disk : of all its replicas at most, and of its folder in the end [MiB].
    """

    label: str
    steps: int
    grains: int
    replicas: int
    seconds: float
    earliest: float
    memory: float
    disk: float


@dataclass(frozen=True, slots=True)
class StudyForecast(Reported):
    """Prediction for a study.

    Attributes
    ----------
    title : str
    points : tuple of PointForecast
        Those that are still to run.
    done : int
        Points that are done already.
    jobs : int
        Points at a time.
    seconds, earliest : wall-clock time of all [s], as those of a point.
    needs_studies : whether points have a target of accuracy, and their devices no accuracy study yet.
    """

    title: str
    points: tuple[PointForecast, ...]
    done: int
    jobs: int
    seconds: float
    earliest: float
    needs_studies: bool = False

    @property
    def memory(self) -> float:
        """Memory [MiB] of the largest points that may run at a time."""
        return sum(sorted((point.memory for point in self.points), reverse=True)[: self.jobs])

    @property
    def disk(self) -> float:
        """Disk [MiB] of all points."""
        return sum(point.disk for point in self.points)

    def as_dict(self) -> dict[str, Any]:
        """Plain values for JSON."""
        return asdict(self) | {"memory": self.memory, "disk": self.disk}

    def in_words(self) -> str:
        """One line: the sum, and what stands against it."""
        kept = f" ({self.done} more are done)" if self.done else ""
        first = ". Missing accuracy studies of devices are run first (accuracy.budget)" if self.needs_studies else ""
        text = (
            f"{len(self.points)} {'point' if len(self.points) == 1 else 'points'}{kept}, {self.jobs} at a time: "
            f"{time_in_words(self.seconds, self.earliest)} (estimate, without compiling). Memory up to "
            f"{self.memory:.0f} MiB, disk {self.disk:.0f} MiB{first}"
        )
        return text

    def report(self) -> Report:
        """Return the cost of each point, and of all."""
        report = Report(self.title, data=self.as_dict())
        statements = [Statement(Mark.GOOD, f"{self.title}: the study is valid."), note(f"{self.in_words()}.")]
        statements += [warning(f"{lack}; or take fewer --jobs")] if (lack := shortage(self.memory)) else []
        report.add("Result", Statements(statements), Shown.TERMINAL)
        table = [
            (
                point.label, str(point.steps), str(point.grains), str(point.replicas),
                time_in_words(point.seconds, point.earliest), f"{point.memory:.0f} MiB", f"{point.disk:.0f} MiB",
            )
            for point in self.points
        ]  # fmt: skip
        head = ("point", "steps", "grains", "replicas", "takes", "memory", "disk")
        return report.add("Points", Table(table, head, (1, 2, 3, 5, 6)), Shown.TERMINAL)


def time_in_words(seconds: float, earliest: float) -> str:
    """About how long something takes, or between which times."""
    if format_rough_time(earliest) == format_rough_time(seconds):
        return f"about {format_rough_time(seconds)}"
    return f"about {format_rough_time(earliest)} to {format_rough_time(seconds)}"


def predict_study(study: StudySection, jobs: int = 1, reached: Sequence[float] = ()) -> StudyForecast:
    """Plan every point of a study that is not done, and say what they cost, `jobs` at a time.

    `reached` are the simulated times [s] from which the points continue (`emclutch.studies.point.time_reached`), where
    the study was begun: of a point that has begun the rest is predicted.

    Raises
    ------
    SceneError
        Points cannot be planned: all of them at once, each with its values.
    """
    points: dict[int, PointForecast] = {}
    planned: dict[str, PointForecast] = {}
    faults, needs_studies = [], False
    for number, (values, case) in enumerate(cases_of(study)):
        begun = reached[number] if reached else 0.0
        if begun == inf:
            continue
        needs_studies |= case.scene.accuracy.target is not None
        label = ", ".join(f"{key} = {value}" for key, value in values.items())
        scene = case.resolved()
        scene["scene"].pop("seed", None)  # points that differ in it alone cost the same
        alike = repr((begun, scene))
        try:
            if alike not in planned:
                planned[alike] = _predict(case, label, jobs, begun)
        except ValueError as error:
            faults.append(Fault("", "", f"{error} (at {label})"))
            continue
        points[number] = replace(planned[alike], label=label)
    if faults:
        raise SceneError(faults, str(study.path))
    before = study.predecessors()
    latest, earliest = (
        total_seconds({number: getattr(point, name) for number, point in points.items()}, before, jobs)
        for name in ("seconds", "earliest")
    )
    return StudyForecast(
        study.title or study.path.stem,
        tuple(points.values()),
        sum(one == inf for one in reached),
        jobs,
        latest,
        min(earliest, latest),
        needs_studies,
    )


def _predict(case: Case, label: str, jobs: int, reached: float) -> PointForecast:
    """One point, which continues from the simulated time `reached` [s]."""
    replicas = replica_count(case.scene)
    device, plan = make_plan(case, threads=threads_of_a_process(jobs * replicas) if jobs > 1 else None)
    cost = plan.cost
    busy, cores = cost.replicas * cost.threads, cores_at_hand()
    slower = max(cores, jobs * busy) / max(cores, busy)
    spent = cost.until(reached)
    seconds = earliest = cost.seconds["total"] - spent
    rule = stopping_rule(plan.scene, device, plan.end)
    if rule is not None:
        first = rule.first(replicas, reached).length
        earliest = max(0.0, cost.rounds * cost.until(first) - spent) + sum(cost.once.values())
    return PointForecast(
        label, cost.steps, cost.grains, replicas, slower * seconds, slower * earliest, replicas * cost.memory, cost.disk
    )


def total_seconds(seconds: dict[int, float], before: Sequence[int | None], jobs: int) -> float:
    """Wall-clock time [s] of all points, `jobs` at a time: their sum over the places, or the longest chain of them.

    Parameters
    ----------
    seconds : of each point that is to run, by its number [s].
    before : of each point the number of the one that it waits for, or None; it comes earlier.
    """
    ended: dict[int | None, float] = {}
    for number in sorted(seconds):
        ended[number] = ended.get(before[number], 0.0) + seconds[number]
    return max(sum(seconds.values()) / jobs, max(ended.values(), default=0.0))
