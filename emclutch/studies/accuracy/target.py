"""`accuracy.target`: a scene gets the cheapest settings by which its torque is known as well as it asks for.

They follow from the accuracy study of its device (`emclutch.results.recommended`), which is run within
`accuracy.budget` where there is none. The scene that is run has these settings in place of the target, and ends
(`time.until`) as soon as statistics and discretisation together, in quadrature, are as small as the target; so a run's
folder can be resumed, and repeated, without the study.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from emclutch.results import Result, RunFolder
from emclutch.results.accuracy_studies import accuracy_study_folder
from emclutch.results.errors import OutputError
from emclutch.results.progress import SHOWN, Progress, someone_looks
from emclutch.results.recommended import STATISTICS, Choice, LimitingError, budget_option, comfortable_budget
from emclutch.results.text import format_percent
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.input_files import file_contents
from emclutch.scene.replica_count import cores_at_hand
from emclutch.scene.scaled import STRAIN
from emclutch.scene.start_up import start_up_strain
from emclutch.scene.study import StudySection
from emclutch.settings import settings_of
from emclutch.simulation.discretisation_error import accuracy_study_of_device
from emclutch.simulation.recommended_case import cheapest_case
from emclutch.simulation.run import refuse_unshown
from emclutch.simulation.run import run as run_scene
from emclutch.simulation.window_state import WindowState
from emclutch.studies.accuracy.budgeted_study import VERSION
from emclutch.studies.accuracy.study import BUDGET_OPTION, accuracy

KEY, BUDGET_KEY = "accuracy.target", "accuracy.budget"


@dataclass(frozen=True, slots=True)
class Settled:
    """A case whose settings reach a target.

    Attributes
    ----------
    case : Case
        Without the target.
    choice : Choice
    study : Path
        Where they follow from.
    """

    case: Case
    choice: Choice
    study: Path


def run(
    case: Case | str | Path,
    *,
    out: str | Path | None = None,
    threads: int | None = None,
    resume: bool = False,
    progress: Any = SHOWN,
    start: str | Path | None = None,
    force: bool = False,
    callback: Callable[[WindowState], object] | None = None,
    measured: str | Path | None = None,
) -> Result:
    """Run a scene and return its result: the first of its replicas, with the torque of all of them.

    The other replicas (`accuracy.replicas`, and with `time.until` as many more as its rule asks for) are processes
    in addition to this one, as many at a time as there are cores for; their folders lie under its own.

    A scene with `accuracy.target` is run with the settings of the accuracy study of its device. Where there is none it
    is run first, in processes of its own.

    Parameters
    ----------
    case : Case, or the path of a scene file
    out : folder of the run; default: the scene's `output.folder`, or the next free runs/<case>-<nnn>.
    threads : of the kernels of each replica; default: ``OMP_NUM_THREADS``, or what a trial in the first windows finds
        to pay of the cores, shared out among the replicas. The result does not depend on it.
    resume : continue from the checkpoint in `out`; a run that was killed before it wrote one starts again there.
    progress : object with update(fraction, text), or None for none; default: a bar on a terminal or in a notebook.
        If it has status(text) too, what is being compiled, and how long it has to go; if
        it has stop_asked, and that is true after a window, the run ends there as after Ctrl-C.
    start : folder of a finished run whose grains this one begins with (`emclutch.simulation.warm_start`), in place of
        a packing; it says nothing more where a run is resumed from a checkpoint.
    force : run also where more memory or disk is needed than is free.
    callback : called with the `emclutch.WindowState` after every window of the first replica; where it returns true,
        all replicas end with a checkpoint, and the result, of what was run, says so (`Result.stopped`).
    measured : table of current [A] and torques [N m] to draw the run's torque over, as `read_measured` takes it
        (`emclutch.results.measured_table`); the folder keeps it as ``measured.csv``.

    Raises
    ------
    SceneError
        The scene has faults, no settings reach its target, or no picture would show the measured table.
    CallbackError
        The callback raised an error.
    OutputError
        The folder is in use or cannot be written; what is to be resumed belongs to another scene, or a file that the
        scene names has changed; the run to start from has no checkpoint, or other grains; the study is damaged.
    RunError
        More memory or disk is needed than is free, a solver did not converge, grains do not fit, a contact failed;
        `Interrupted` after Ctrl-C.
    """
    if progress == SHOWN:
        with Progress() if someone_looks() else nullcontext() as bar:
            return run(
                case, out=out, threads=threads, resume=resume, progress=bar, start=start, force=force,
                callback=callback, measured=measured,
            )  # fmt: skip
    case = as_case(case)
    target = case.scene.accuracy.target
    if measured is not None:
        refuse_unshown(case, measured)
    if resume and (folder := out or case.scene.output.folder) is not None:
        RunFolder(folder).has_checkpoint()  # raises where there is nothing to continue, before a study is run
    return run_scene(
        with_target(case, progress), out=out, threads=threads, resume=resume, progress=progress, start=start,
        force=force, callback=callback, measured=measured, accuracy_target=target,
    )  # fmt: skip


def with_target(case: Case, progress: Any = None) -> Case:
    """Return a case in which settings stand for `accuracy.target`; one without a target as it is.

    Raises
    ------
    SceneError
        No settings reach it: by what it is limited, and what to do.
    OutputError
        The accuracy study is damaged.
    RunError
        The accuracy study could not be run; `Interrupted` after Ctrl-C: it is continued by the next call.
    """
    if case.scene.accuracy.target is None:
        return case
    found = settled(case)
    if found is None:
        _measure(case, progress)
        found = settled(case)
        assert found is not None  # the study has written it, or failed
    announce = getattr(progress, "announce", None)
    if announce is not None:
        announce(f"{KEY} = {case.scene.accuracy.target}: {found.choice.in_words()} (by {found.study})")
    return found.case


def settled(case: Case) -> Settled | None:
    """Return the settings that a case's target needs, by the study of its device; None where there is no study.

    Raises as `with_target`.
    """
    target = case.scene.accuracy.target
    assert target is not None
    known = accuracy_study_of_device(case)
    if known is None:
        return None
    study, path = known
    found = cheapest_case(case, study, target)
    if isinstance(found, LimitingError):
        raise _unreachable(case, found)
    choice, changed = found
    return Settled(changed, choice, path)


def cases_of(
    study: StudySection, progress: Any = None, *, measure: bool = False, numbers: Sequence[int] | None = None
) -> Iterator[tuple[dict[str, Any], Case]]:
    """Yield the values and the case of each point of a study, with settings for its target.

    `measure`: also run a study that is missing; else such a case is left as it is. `numbers`: of these points alone.
    """
    for values, case in study.cases(numbers):
        if case.scene.accuracy.target is not None:
            if measure:
                case = with_target(case, progress)
            elif (found := settled(case)) is not None:
                case = found.case
        yield values, case


def _measure(case: Case, progress: Any) -> None:
    """Run the accuracy study of a case within its budget, in a folder by which the same case finds it again."""
    contents = "".join(file_contents(case.scene).values())  # of the files that the scene names
    name = hashlib.sha256((f"{VERSION} " + case.toml() + contents).encode()).hexdigest()[:16]
    folder = accuracy_study_folder() / f"study-{name}"
    begun = (folder / "plan.json").is_file()
    if folder.is_dir() and not begun and any(folder.iterdir()):
        raise OutputError(f"{folder} holds no study of this version; remove it, and run again")
    target = float(case.scene.accuracy.target or 0.0)
    try:
        accuracy(
            case, out=folder, budget=case.scene.accuracy.budget, resume=begun, targets=(target,), progress=progress
        )  # fmt: skip
    except SceneError as error:  # what is an option there is a key here
        raise SceneError(
            [replace(one, key=BUDGET_KEY) if one.key == BUDGET_OPTION else one for one in error.faults], error.source
        ) from None


def _unreachable(case: Case, found: LimitingError) -> SceneError:
    command, ways = f"emclutch accuracy {case.path or 'CASE'}", []
    budget = found.budget(cores_at_hand(), comfortable_budget(2.0 * case.scene.accuracy.budget))
    if found.setting == STATISTICS:
        ways.append(f"measure longer replicas: {command} --set accuracy.time_end={_longer_end(case)}")
    elif budget is not None:
        ways.append(f"run a longer accuracy study: {command} --budget {budget_option(budget)}")
    elif found.setting in (one.name for one in settings_of(case.scene)):
        ways.append(f"list other values in accuracy.values.{found.setting}, and measure again: {command}")
    if found.best is not None:
        ways.append(f"ask for {format_percent(1.05 * found.best.half_width)}")
    message = "; ".join([f"is not reached. {found.in_words(cores_at_hand())}", ", or ".join(ways)]).removesuffix("; ")
    fault = Fault(KEY, f"'{case.scene.accuracy.target}'", message)
    return SceneError([fault], "scene" if case.path is None else str(case.path))


def _longer_end(case: Case) -> str:
    """Return an end of the study's replicas by which they scatter less, as an entry of a scene."""
    end = case.scene.accuracy.time_end
    if isinstance(end, float):
        return f"'{4e3 * end:.4g} ms'"
    strain = 2.0 * start_up_strain(case.scene) if end is None else end.value
    return f"'{STRAIN.format(f'{4.0 * strain:.4g}')}'"
