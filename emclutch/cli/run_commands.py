"""The commands that simulate, or say what a simulation would be: run, check, sweep, accuracy, design, ..."""

from __future__ import annotations

import shlex
from contextlib import nullcontext
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from emclutch.cli import options as opt
from emclutch.cli.errors import FAILED, INCOMPLETE, explained
from emclutch.cli.input import (
    assignments,
    check_threads,
    load,
    map_axes,
    read_budget,
    read_share,
    read_shares,
    refuse_beside,
    refuse_to_resume_nothing,
    refuse_without,
    run_to_resume,
    search,
    study_to_check,
    warn,
)
from emclutch.cli.output import print_json, print_points, show
from emclutch.scene.errors import Fault, SceneError

if TYPE_CHECKING:
    from emclutch.results.report.study_report import StudyState
    from emclutch.scene.case import Case
    from emclutch.scene.study import StudySection


def run(
    case: opt.RunSource,
    out: opt.Out = None,
    sets: opt.Sets = None,
    resume: opt.Resume = False,
    threads: opt.Threads = None,
    dry_run: opt.DryRun = False,
    measured: opt.Catalogue = None,
    as_json: opt.AsJson = False,
    trust_scripts: opt.TrustScripts = False,
    force: opt.Force = False,
) -> None:
    """Simulate a scene."""
    with explained():
        check_threads(threads)
        if dry_run:
            given = {"--with": measured is not None, "--resume": resume, "--out": out is not None, "--force": force}
            refuse_beside("--dry-run", given)
        if resume and (case.is_dir() or case.suffix == ".h5"):
            case, out = run_to_resume(case, out)
        read = load(case, sets, trust_scripts, warns=not dry_run)
        if resume and out is None and read.scene.output.folder is None:
            message = f"needs a run; name the run's folder: emclutch run FOLDER --resume, not the scene {case}"
            raise SceneError([Fault("--resume", "", message)], "command line")
        if dry_run:
            show_plan(read, as_json, threads)
            return
        from emclutch.results import Progress
        from emclutch.studies.accuracy.target import run as run_scene

        with nullcontext() if as_json else Progress() as progress:
            result = run_scene(
                read, out=out, threads=threads, resume=resume, progress=progress, force=force, measured=measured
            )
        show(result.report(), as_json)


def check(
    case: opt.CheckedFile,
    sets: opt.Sets = None,
    jobs: opt.Jobs = 1,
    details: opt.Details = False,
    as_json: opt.AsJson = False,
    trust_scripts: opt.TrustScripts = False,
) -> None:
    """Check a scene or a study, and predict its torque, cost and errors."""
    with explained():
        if (study := study_to_check(case, sets, jobs, details, trust_scripts)) is not None:
            from emclutch.studies.forecast import predict_study

            show(predict_study(study, jobs).report(), as_json)
            return
        show_plan(load(case, sets, trust_scripts, warns=False), as_json, details=details)


def show_plan(case: Case, as_json: bool, threads: int | None = None, details: bool = False) -> None:
    """Print what a scene is expected to give and take, or with `details` all decisions."""
    from emclutch.simulation.check import check as check_scene

    show(check_scene(case, threads).report(), as_json, details)


def sweep(
    study: opt.StudyFile,
    out: opt.Out = None,
    resume: opt.Resume = False,
    jobs: opt.Jobs = 1,
    dask: opt.DaskAddress = None,
    point: opt.PointAsked = None,
    listed: opt.ListAsked = False,
    collected: opt.CollectAsked = False,
    dry_run: opt.DryRunOfStudy = False,
    threads: opt.Threads = None,
    measured: opt.Catalogue = None,
    trust_scripts: opt.TrustScripts = False,
    force: opt.Force = False,
) -> None:
    """Simulate all points of a study, on one machine or on many."""
    with explained():
        from emclutch.results.measured_table import TORQUE_CURVE, read_measured
        from emclutch.scene.study import read_study
        from emclutch.studies.sweep import collect, commands

        check_threads(threads)
        alone = {"--point": point is not None, "--list": listed, "--collect": collected, "--dry-run": dry_run}
        of_all = {"--resume": resume, "--jobs": jobs != 1, "--dask": dask is not None, "--with": measured is not None}
        for option in [name for name, given in alone.items() if given]:
            own = {"--force": force, "--threads": threads is not None} if option in ("--collect", "--dry-run") else {}
            refuse_beside(option, {name: given for name, given in alone.items() if name != option} | of_all | own)
            if out is None and option != "--dry-run":
                message = "needs the folder of the study; name it with --out"
                raise SceneError([Fault(option, "", message)], "command line")
        refuse_to_resume_nothing("study", resume, out)
        if measured is not None:
            read_measured(measured, *TORQUE_CURVE)  # before anything runs
        if dask is not None:
            refuse_beside("--dask", {"--jobs": jobs != 1})
        numbers = None if point is None else [point]
        read = read_study(study, trust_scripts=trust_scripts, numbers=numbers)
        if dry_run:
            print_points(read)
        elif listed and out is not None:
            given_on = ["--threads", str(threads)] if threads is not None else []
            given_on += ["--force"] * force + ["--trust-scripts"] * trust_scripts
            lines = commands(read, out, given_on)
            typer.echo("\n".join(lines) if lines else "all points are done", err=not lines)
        elif collected and out is not None:
            state = collect(read, out)
            show_study(out, state)
            if not state.is_complete:
                raise typer.Exit(FAILED if state.failures else INCOMPLETE)
        else:
            warn(read.warnings(numbers))
            how = {"out": out, "force": force, "threads": threads, "measured": measured}
            _sweep(read, how | ({"resume": resume, "jobs": jobs} if point is None else {"point": point}), dask)


def _sweep(study: StudySection, how: dict[str, Any], dask: str | None) -> None:
    """Run a study, or one point of it, and print what its tables say."""
    from emclutch.results.study_table import StudyTable
    from emclutch.studies.dask_executor import dask_executor
    from emclutch.studies.forecast import predict_study
    from emclutch.studies.point import tasks_of, time_reached
    from emclutch.studies.sweep import sweep

    if "point" in how:
        with StudyTable() as table:
            sweep(study, **how, progress=table)
        typer.echo(
            f"point {how['point']} is done; tables of all: emclutch sweep {study.path} --out {how['out']} --collect"
        )
        return
    out, memory = how["out"], 0.0
    reached = [time_reached(task, out) for task in tasks_of(study, out)] if how["resume"] and out is not None else []
    predicted = predict_study(study, how["jobs"], reached)
    if predicted.points:
        typer.echo(predicted.in_words(), err=True)
        memory = max(point.memory for point in predicted.points) * 2**20
    with nullcontext() if dask is None else dask_executor(dask, memory) as executor, StudyTable() as table:
        if executor is not None:
            how |= {"executor": executor, "threads": how["threads"] or 1, "jobs": None}
        folder = sweep(study, **how, progress=table)
    show_study(folder)


def show_study(folder: Path, state: StudyState | None = None) -> None:
    """Print what the tables of a study say, or the state of its points."""
    from emclutch.results.report.study_report import state_of, state_report
    from emclutch.results.study_result import load_study

    study = load_study(folder)
    show(state_report(state or state_of(study), study.total))


def accuracy(
    case: opt.CaseFile,
    out: opt.Out = None,
    budget: opt.Budget = None,
    jobs: opt.JobsOfCores = None,
    resume: opt.ResumeAccuracy = False,
    targets: opt.Targets = None,
    effects: opt.OfEffects = False,
    dry_run: opt.DryRunOfAccuracy = False,
    sets: opt.Sets = None,
    as_json: opt.AsJson = False,
    trust_scripts: opt.TrustScripts = False,
) -> None:
    """Measure the error of each numerical setting, and find the cheapest settings for an accuracy."""
    with explained():
        refuse_to_resume_nothing("study", resume, out)
        if effects and targets is not None:
            message = "cannot be combined with --effects, which chooses no settings; remove one of the two"
            raise SceneError([Fault("--for", targets, message)], "command line")
        wanted, seconds = read_shares(targets or opt.USUAL_TARGETS, "--for"), read_budget(budget)
        read = load(case, sets, trust_scripts)
        from emclutch.results import Progress
        from emclutch.studies.accuracy.effect_contributions import EffectsResult, effect_contributions, preview_effects
        from emclutch.studies.accuracy.study import AccuracyResult, preview
        from emclutch.studies.accuracy.study import accuracy as measure_accuracy

        if dry_run:
            refuse_beside("--dry-run", {"--resume": resume, "--out": out is not None})
            if effects:
                show(preview_effects(read, seconds, jobs), as_json)
                return
            source = shlex.join([str(case), *chain.from_iterable(("--set", one) for one in sets or ())])
            parts = preview(read, seconds, jobs, wanted, nullcontext if as_json else Progress, source)
            if as_json:
                print_json(dict(chain.from_iterable(one.data.items() for one in parts)))
            for one in parts:
                show(one)
            return

        options: dict[str, Any] = {"out": out, "budget": seconds, "jobs": jobs, "resume": resume}
        found: AccuracyResult | EffectsResult
        with nullcontext() if as_json else Progress() as progress:
            if effects:
                found = effect_contributions(read, **options, progress=progress)
            else:
                found = measure_accuracy(read, **options, targets=wanted, progress=progress)
        show(found.report(), as_json)


def design(
    file: opt.DesignSource,
    vary: opt.Vary = None,
    target: opt.Target = None,
    like: opt.Like = None,
    runs: opt.Runs = 0,
    within: opt.Within = None,
    out: opt.Out = None,
    sets: opt.Sets = None,
    threads: opt.Threads = None,
    as_json: opt.AsJson = False,
    trust_scripts: opt.TrustScripts = False,
) -> None:
    """Find the value of one key that gives a wanted torque."""
    with explained():
        check_threads(threads)
        if not runs:
            refuse_without("--runs", {"--within": within is not None, "--threads": threads is not None})
        asked = search(file, vary, target, sets, trust_scripts)
        tolerance = read_share(within or opt.USUAL_WITHIN, "--within")
        from emclutch.results import Progress
        from emclutch.studies import design_search

        with nullcontext() if as_json else Progress() as progress:
            found = design_search.design(
                asked, like=like, out=out, runs=runs, tolerance=tolerance, threads=threads, progress=progress
            )
        show(found.report(), as_json)


def map(
    ctx: typer.Context,
    case: opt.CaseFile,
    current: opt.MapCurrents = None,
    voltage: opt.MapVoltages = None,
    gap: opt.MapGaps = None,
    speed: opt.MapSpeeds = None,
    fill: opt.MapFills = None,
    repose: opt.MapRepose = None,
    temperature: opt.MapTemperatures = None,
    vary: opt.MapVary = None,
    measured: opt.Catalogue = None,
    out: opt.Out = None,
    sets: opt.Sets = None,
    as_json: opt.AsJson = False,
    trust_scripts: opt.TrustScripts = False,
) -> None:
    """Compute the expected torque over one or two quantities, such as current and gap."""
    with explained():
        given = map_axes(ctx.params, vary)
        read = load(case, sets, trust_scripts)
        from emclutch.results import Progress
        from emclutch.scene.map_axes import axes_of
        from emclutch.studies.torque_map import map_over

        axes = axes_of(read, given, "--")
        if both := sorted({one.key for one in axes} & assignments(sets).keys()):
            raise SceneError([Fault("--set", both[0], "is a key of an axis, which sets it; remove it")], "command line")
        with nullcontext() if as_json else Progress() as progress:
            found = map_over(read, axes, measured=measured, out=out, progress=progress)
        show(found.report(), as_json)


def powder_law(
    case: opt.CaseFile,
    budget: opt.BudgetOfCells = None,
    field: opt.CellFields = None,
    fill: opt.CellFills = None,
    walls: opt.CellWalls = "steel",
    out: opt.Out = None,
    resume: opt.ResumeLaw = False,
    jobs: opt.CellsAtATime = None,
    dask: opt.DaskAddress = None,
    sets: opt.Sets = None,
    as_json: opt.AsJson = False,
    trust_scripts: opt.TrustScripts = False,
) -> None:
    """Measure the law of a powder in simulated cells, if no shipped law covers it."""
    with explained():
        refuse_to_resume_nothing("law", resume, out)
        if dask is not None:
            refuse_beside("--dask", {"--jobs": jobs is not None})
        seconds, read = read_budget(budget), load(case, sets, trust_scripts)
        from emclutch.results import Progress
        from emclutch.studies import powder_law as study
        from emclutch.studies.dask_executor import dask_executor

        fields, fills = study.chosen_cells(field, fill)
        if (field is None) != (fill is None):
            given, missing = ("--field", "--fill")[:: 1 if fill is None else -1]
            message = f"chooses the cells together with {missing} only; add that, or leave both out"
            raise SceneError([Fault(given, field or fill or "", message)], "command line")
        with nullcontext() if dask is None else dask_executor(dask) as executor, Progress() as progress:
            found = study.powder_law(
                read, budget=seconds, walls=walls, fields=fields, fills=fills, out=out, resume=resume, jobs=jobs,
                executor=executor, progress=progress,
            )  # fmt: skip
        show(found.report(), as_json)


def fit(
    case: opt.CaseFile,
    to: opt.MeasuredCurve,
    friction: opt.FrictionRange = "0.2:0.7",
    rolling_friction: opt.RollingRange = "0:0.6",
    fill: opt.FillRange = None,
    over: opt.Over = "coil.current",
    repose: opt.Repose = None,
    uncertainty: opt.AngleUncertainty = None,
    common_error: opt.CommonError = None,
    out: opt.Out = None,
    sets: opt.Sets = None,
    as_json: opt.AsJson = False,
    trust_scripts: opt.TrustScripts = False,
) -> None:
    """Find the friction, rolling friction and fill of a powder from a measured torque curve."""
    with explained():
        read = load(case, sets, trust_scripts)
        from emclutch.cli.fit import angle_of, ends_of
        from emclutch.results import Progress
        from emclutch.studies import fit as study

        ranges = [ends_of(text, option) for text, option in
                  ((friction, "--friction"), (rolling_friction, "--rolling-friction"))]  # fmt: skip
        with nullcontext() if as_json else Progress() as progress:
            found = study.fit(
                read, to, friction=ranges[0], rolling_friction=ranges[1],
                fill=None if fill is None else ends_of(fill, "--fill"), over=over, repose=angle_of(repose, uncertainty),
                common_error=0.0 if common_error is None else read_share(common_error, "--common-error"), out=out,
                progress=progress,
            )  # fmt: skip
        show(found.report(), as_json)
