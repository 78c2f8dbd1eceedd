"""Input of commands: the scene with the values that were set, the folder of a run."""

from __future__ import annotations

import tomllib
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from emclutch.scene.errors import Fault, SceneError, shown
from emclutch.scene.value_list import number_or_text, read_all, split_list

if TYPE_CHECKING:
    from emclutch.scene.case import Case
    from emclutch.scene.design import Search
    from emclutch.scene.study import StudySection


def load(path: Path, sets: list[str] | None = None, trust_scripts: bool = False, warns: bool = True) -> Case:
    from emclutch.scene.case import load_case

    case = load_case(path, assignments(sets), trust_scripts=trust_scripts)
    if warns:
        warn(case.warnings)
    return case


def warn(texts: Iterable[str]) -> None:
    """Print warnings, aside from the output."""
    for text in texts:
        typer.echo(f"warning: {text}", err=True)


def study_to_check(
    path: Path, sets: list[str] | None, jobs: int, details: bool, trust_scripts: bool
) -> StudySection | None:
    """The study in a file; None where it holds a scene."""
    from emclutch.scene.case import read_toml
    from emclutch.scene.study import read_study

    if "study" not in read_toml(path):
        if jobs != 1:
            raise SceneError([Fault("--jobs", str(jobs), "is for studies; remove it for a scene")], "command line")
        return None
    if sets:
        raise SceneError([Fault("--set", sets[0], "is for scenes; a study has study.set for it")], "command line")
    if details:
        message = "is for scenes; all that follows from a point is printed by emclutch check CASE --details --set ..."
        raise SceneError([Fault("--details", "", message)], "command line")
    study = read_study(path, trust_scripts=trust_scripts)
    warn(study.warnings())
    return study


def assignments(sets: list[str] | None) -> dict[str, Any]:
    """Read ``key=value`` pairs; a value is read as TOML (numbers, lists, true), otherwise as text.

    A bare ``none`` is None, which removes the key, as a bare ``off`` removes ``effects.NAME``.
    """
    from emclutch.scene.case import removes

    values: dict[str, Any] = {}
    for text in sets or ():
        key, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not key:
            message = "is not KEY=VALUE; write it as in --set coil.current='0.8 A'"
            raise SceneError([Fault("--set", shown(text), message)], "command line")
        if key in values:
            message = f"sets {key} a second time; give it once"
            raise SceneError([Fault("--set", shown(text), message)], "command line")
        if removes(key, value):
            values[key] = None
            continue
        try:
            values[key] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            values[key] = value
    return values


def search(
    file: Path, vary: str | None, target: str | None, sets: list[str] | None = None, trust_scripts: bool = False
) -> Search:
    """Question of a design search, from a design file or from a scene with options."""
    from emclutch.scene.case import read_toml
    from emclutch.scene.design import read_design, search_of

    if "design" in read_toml(file):
        given = {"--vary": vary, "--target": target, "--set": sets}
        message = f"is given in {file} already; remove the option"
        if faults := [Fault(name, "", message) for name, one in given.items() if one]:
            raise SceneError(faults, "command line")
        return read_design(file, trust_scripts=trust_scripts)
    key, equals, ends = (part.strip() for part in (vary or "").partition("="))
    between = [number_or_text(part) for part in ends.split(":")]
    faults = []
    if not equals or len(between) != 2:
        shown_entry = shown(vary) if vary else ""
        faults.append(Fault("--vary", shown_entry, "is needed as KEY=A:B, e.g. --vary geometry.gap='0.5 mm:2 mm'"))
    if target is None:
        faults.append(Fault("--target", "", "is missing; e.g. --target 'torque 12 N m'"))
    if key and key in assignments(sets):
        faults.append(Fault("--set", key, "is the key of --vary, whose values would be taken; remove it"))
    if faults or target is None:
        raise SceneError(faults, "command line")
    return search_of(load(file, sets, trust_scripts), key, (between[0], between[1]), target, "--")


def map_axes(options: Mapping[str, Any], vary: list[str] | None) -> dict[str, str]:
    """Ranges of a torque map by the names of their axes or their keys, in the order of the command line."""
    from emclutch.scene.map_axes import KEYS

    given: dict[str, str] = {}
    for name, entry in options.items():  # click has the options that are given first, in their order
        if name == "vary":
            for text in vary or ():
                key, equals, values = (part.strip() for part in text.partition("="))
                if not equals or not key or key in given:
                    message = "is not one KEY=RANGE; write it as in --vary geometry.clearance='0.1 mm:0.5 mm'"
                    raise SceneError([Fault("--vary", shown(text), message)], "command line")
                given[key] = values
        elif name in KEYS and entry is not None:
            given[name] = entry
    return given


def read_budget(text: str | None) -> float | None:
    """Return a wall-clock time [s] of ``20min``; SceneError for what is none."""
    from emclutch.scene.units import Time, quantity_of

    return None if text is None else read_all([text], quantity_of(Time), "--budget")[0]


def read_share(text: str, option: str) -> float:
    """Return the one share of ``3 %``."""
    found = read_shares(text, option)
    if len(found) > 1:
        message = f"has {len(found)} entries; give one, e.g. '3 %'"
        raise SceneError([Fault(option, shown(text), message)], "command line")
    return found[0]


def read_shares(text: str, option: str) -> list[float]:
    """Return the shares of ``10 %, 5 %, 3 %``; SceneError with every entry that is none."""
    from emclutch.scene.fraction import FractionEntry

    found, faults = [], []
    for entry in split_list(text, option):
        try:
            found.append(float(FractionEntry().read(entry.strip())))
        except ValueError as error:
            faults.append(Fault(option, shown(entry.strip()), str(error)))
    if faults:
        raise SceneError(faults, "command line")
    return found


def read_line(text: str) -> tuple[float, ...]:
    """Return the ends of a line [m] from ``44 mm, 0 mm, 46 mm, 0 mm``, or of six lengths; SceneError otherwise."""
    parts = split_list(text, "--line")
    if len(parts) not in (4, 6):
        message = (
            "is not a line; write r0, z0, r1, z1, e.g. '44 mm, 0 mm, 46 mm, 0 mm' (for a field in 3D x0, y0, z0, "
            "x1, y1, z1)"
        )
        raise SceneError([Fault("--line", shown(text), message)], "command line")
    from emclutch.scene.units import Quantity

    return tuple(read_all(parts, Quantity("a length", "m", "44 mm"), "--line"))


def check_threads(threads: int | None) -> None:
    if threads is None:
        return
    from emclutch.cli.doctor import most_threads  # local: it imports numba

    most = most_threads()
    if not 1 <= threads <= most:
        message = f"is out of range; allowed: 1 to {most} (this machine's cores, or NUMBA_NUM_THREADS where it is set)"
        raise SceneError([Fault("--threads", str(threads), f"{message}; change it or leave it out")], "command line")


def refuse_beside(option: str, others: dict[str, bool]) -> None:
    """SceneError with every given option that cannot be combined with another one."""
    _refuse(others, f"cannot be combined with {option}; remove one of them")


def refuse_without(option: str, others: dict[str, bool]) -> None:
    """SceneError with every given option that needs another one."""
    _refuse(others, f"needs {option}; add that, or remove this")


def _refuse(options: dict[str, bool], why: str) -> None:
    if faults := [Fault(name, "", why) for name, given in options.items() if given]:
        raise SceneError(faults, "command line")


def refuse_to_resume_nothing(what: str, resume: bool, out: Path | None) -> None:
    """SceneError with --resume and no folder of what was begun."""
    if resume and out is None:
        message = f"needs a {what} that was begun; name its folder with --out"
        raise SceneError([Fault("--resume", "", message)], "command line")


def run_to_resume(folder: Path, out: Path | None) -> tuple[Path, Path]:
    """Return the scene and the folder of a run that is to continue; SceneError where `folder` is none of a run."""
    if folder.is_file():
        message = f"is a file; --resume takes the run's folder: emclutch run {folder.parent} --resume"
        raise SceneError([Fault(str(folder), "", message)], "command line")
    if out is not None and out.resolve() != folder.resolve():
        message = f"is another folder than the run's, {folder}; remove --out"
        raise SceneError([Fault("--out", str(out), message)], "command line")
    scene = folder / "case.toml"
    if not scene.is_file():
        message = "has no case.toml and so no run to resume; name the folder of a run"
        raise SceneError([Fault(str(folder), "", message)], "command line")
    return scene, folder
