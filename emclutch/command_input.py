"""What a command reads: the scene with the values that were set, the folder of a run."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Any

import typer

from emclutch.case import Case, load_case, read_toml
from emclutch.faults import Fault, SceneError, shown


def load(path: Path, sets: list[str] | None = None, trust_scripts: bool = False) -> Case:
    values = assignments(sets)
    if any(value == {} for value in values.values()):
        # an effect that is switched on keeps the entries that it has, in the file or by other settings
        effects = read_toml(path).get("effects", {})
        adding: dict[str, Any] = {key: {} for key, value in values.items() if value == {}}
        kept = {key for key in adding if isinstance(effects, dict) and key.removeprefix("effects.") in effects}
        others = {key: value for key, value in values.items() if key not in adding}
        values = {key: {} for key in adding if key not in kept} | others
    case = load_case(path, values, trust_scripts=trust_scripts)
    for warning in case.warnings:
        typer.echo(f"warning: {warning}", err=True)
    return case


def assignments(sets: list[str] | None) -> dict[str, Any]:
    """Read ``key=value`` pairs; a value is read as TOML (numbers, lists, true), otherwise as text.

    A bare ``none`` is None, which removes the key. For ``effects.NAME`` a bare ``off`` is None too, ``on`` an empty
    table.
    """
    values: dict[str, Any] = {}
    for text in sets or ():
        key, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not key:
            message = "is not KEY=VALUE; write it as in --set coil.current='0.8 A'"
            raise SceneError([Fault("--set", shown(text), message)], "command line")
        is_effect = key.startswith("effects.") and key.count(".") == 1
        if value == "none" or (is_effect and value == "off"):
            if reason := _unknown(key):
                raise SceneError([Fault(key, value, reason)], "command line")
            values[key] = None
            continue
        if is_effect and value == "on":
            values[key] = {}
            continue
        try:
            values[key] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            values[key] = value
    return values


def check_threads(threads: int | None) -> None:
    if threads is None:
        return
    from emclutch.doctor import most_threads  # local: it imports numba

    most = most_threads()
    if not 1 <= threads <= most:
        message = f"is out of range; allowed: 1 to {most} (this machine's cores, or NUMBA_NUM_THREADS where it is set)"
        raise SceneError([Fault("--threads", str(threads), f"{message}; change it or leave it out")], "command line")


def run_to_resume(folder: Path, out: Path | None) -> tuple[Path, Path]:
    """The scene and the folder of a run that is to go on."""
    if out is not None and out.resolve() != folder.resolve():
        message = f"is another folder than the run's, {folder}; leave --out away"
        raise SceneError([Fault("--out", str(out), message)], "command line")
    scene = folder / "case.toml"
    if not scene.is_file():
        message = "has no case.toml and so no run to resume; name the folder of a run"
        raise SceneError([Fault(str(folder), "", message)], "command line")
    return scene, folder


def _unknown(key: str) -> str:
    """Say why a key cannot be removed; empty where a scene may have it."""
    from emclutch.scene.fault_report import key_fault
    from emclutch.scene.model import Scene

    return key_fault(key, Scene)
