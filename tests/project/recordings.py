"""What the program prints and writes for twelve cases at toy size, and how that differs between two versions.

    python tests/project/recordings.py record FOLDER [--only NAME ...]
    python tests/project/recordings.py compare OLD NEW [--renamed OLD=NEW ...] [--text]

`record` runs the commands of each case with the program of the tree that it is in, on one thread and one replica, and
keeps what they print and write, 2 to 3 minutes of processor time in all. `compare` lists the keys of JSON files and
the columns of CSV tables that only one of two recordings has, the values that differ by more than 1e-9 of themselves,
and, with `--text`, the lines that are printed otherwise. Times of the machine are not compared, and of a study that
decides by them (an accuracy study) keys alone. `--renamed` names a part of a key that has another name since.
"""

from __future__ import annotations

import argparse
import csv
import difflib
import json
import math
import os
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple

ROOT = Path(__file__).resolve().parents[2]
CASES = ROOT / "cases"
MACHINE = re.compile(
    "seconds|processor|figure_of_merit|memory|provenance|created|started|written|predicted|cost|versions|machine|"
    "schema|earliest|disk|wall_time|threads|kernels|path|folder|digest|commit|device$|uuid"
)
"""Keys of which the values are of the machine, of the hour or of the tree."""
TOLERANCE = 1e-9
NUMBER = re.compile(r"[-+]?\d+(\.\d+)?(e[-+]?\d+)?")
QUIET = {"output.pictures": False, "output.snapshots": 0, "accuracy.replicas": 1, "time.until": "none"}
NO_ATTRACTION = {"effects.dipoles": "none", "effects.wall_images": "none", "effects.back_reaction": "none"}
TOY = QUIET | {"time.end": "0.1 ms", "time.window": "10 us", "particles.sector": "3.75 deg", "field.size_factor": 2.0}
SHOT = QUIET | {
    "particles.count": 24, "time.end": "40 ms", "time.window": "2 ms", "motion.disc.free.inertia": "0.01 kg m^2",
    "motion.rotor.speed": '{times = ["0 s", "10 ms"], values = ["0 rpm", "1000 rpm"]}',
}  # fmt: skip


class Recording(NamedTuple):
    """A case: what it is made from, the values that make it small, and the commands, OUT being its folder."""

    base: str
    values: dict[str, Any]
    commands: tuple[str, ...]
    study: str = ""
    exact: bool = True  # whether values are compared


RUN = ("check SCENE", "check SCENE --json", "check SCENE --details", "run SCENE --out OUT/run --threads 1",
       "report OUT/run")  # fmt: skip
RECORDINGS = {
    "quickstart": Recording("quickstart.toml", TOY | {"output.pictures": True}, RUN),
    "brake": Recording(
        "powder_clutch.toml",
        QUIET | {
            "time.end": "strain 0.02", "accuracy.inertial_number": 0.03, "particles.sector": "1.5 deg",
            "particles.diameter": "0.2 mm", "field.size_factor": 2.0, "output.profiles": True,
        },
        RUN,
    ),
    "disc_clutch": Recording(
        "clutch",
        QUIET | {"time.end": "0.1 ms", "time.window": "20 us", "particles.sector": "2.5 deg", "field.size_factor": 2.0},
        RUN,
    ),
    "switch_on": Recording(
        "switch_on.toml",
        QUIET | NO_ATTRACTION | {
            "time.end": "60 ms", "time.window": "1 ms", "field.size_factor": 3.0, "particles.solid_fraction": 0.01,
        },
        RUN,
    ),
    "lock_up": Recording(
        "lock_up.toml",
        QUIET | {
            "effects.dipoles.model": "mutual", "particles.sector": "5 deg", "particles.diameter": "0.3 mm",
            "field.size_factor": 2.0, "motion.disc.free.inertia": "1.5e-6 kg m^2",
            "motion.disc.free.load_torque": "0.02 N m", "time.end": "1.2 ms", "time.average_from": "0.6 ms",
            "coil.current": '{times = ["0 ms", "0.25 ms", "0.5 ms"], values = ["0 A", "0 A", "1 A"]}',
        },
        RUN,
    ),
    "slotted_disc": Recording(
        "slotted_disc.toml", QUIET | {"time.end": "0.02 ms", "field.size_factor": 4.0, "field.gap_layers": 3}, RUN
    ),
    "hysteresis": Recording(
        "hysteresis.toml",
        QUIET | NO_ATTRACTION | {
            "coil.current": '{times = ["0 ms", "0.3 ms", "0.6 ms"], values = ["0 mA", "100 mA", "0 mA"]}',
            "time.end": "0.63 ms", "motion.rotor.speed": "10000 rpm", "particles.solid_fraction": 0.05,
            "field.size_factor": 4.0,
        },
        RUN,
    ),
    "sheared_box": Recording("sheared_box", QUIET | {"time.end": "strain 0.2"}, RUN),
    "centrifugal_dem": Recording("thesis/centrifugal.toml", SHOT, RUN),
    "centrifugal_dvi": Recording("thesis/centrifugal.toml", SHOT | {"contact.method": "dvi"}, RUN),
    "heat": Recording(
        "heat.toml",
        {"field.size_factor": 4.0, "effects.heat.duty.end": "4 min", "effects.heat.tolerance": 1.0},
        ("heat SCENE --out OUT/heat", "heat SCENE --out OUT/heat-2 --json", "field SCENE --out OUT/field"),
    ),
    "study": Recording(
        "quickstart.toml",
        TOY,
        ("check STUDY", "check STUDY --json", "sweep STUDY --out OUT/study --threads 1", "report OUT/study"),
        study='[study]\ntitle = "Two currents"\ncase = "scene.toml"\n[study.values]\n'
        '"coil.current" = ["0.4 A", "0.8 A"]\n"scene.seed" = [1, 2]\n',
    ),
    "accuracy": Recording(
        "quickstart.toml",
        TOY | {"time.end": "0.2 ms", "accuracy.time_end": "0.2 ms"},
        ("accuracy SCENE --dry-run --budget 1min", "accuracy SCENE --out OUT/accuracy --jobs 1 --budget 1min"),
        exact=False,
    ),
    "design": Recording("which_current.toml", {}, ("design SCENE", "design SCENE --json")),
    "failures": Recording(
        "quickstart.toml",
        TOY | {"contact.stiffness": "1 N/m"},
        ("run SCENE --out OUT/run --threads 1", "run SCENE --out OUT/run", "check missing.toml", "report OUT"),
        exact=False,
    ),
}  # fmt: skip


def emclutch(*arguments: str, at: Path) -> tuple[int, str, str]:
    """Return exit status, standard output and standard error of a command in a folder."""
    own = {"PYTHONPATH": str(ROOT), "COLUMNS": "160", "NO_COLOR": "1", "EMCLUTCH_ACCURACY_STUDIES": "none"}
    environment = {**os.environ, **own}
    command = [sys.executable, "-c", "from emclutch.cli.main import main; main()", *arguments]
    done = subprocess.run(command, cwd=at, env=environment, capture_output=True, text=True, check=False)
    return done.returncode, done.stdout, done.stderr


def record(name: str, folder: Path) -> None:
    """Run the commands of a case; write what each prints into ``N-command.txt`` beside the folders that it writes."""
    case, out = RECORDINGS[name], (folder / name).resolve()
    out.mkdir(parents=True)
    scene = CASES / case.base
    if scene.suffix != ".toml":
        scene = out / "scene.toml"
        emclutch("new", str(scene), "--kind", case.base, at=out)
    (out / "study.toml").write_text(case.study.replace("scene.toml", str(scene)) + _study_values(case), "utf-8")
    sets = [word for key, value in case.values.items() for word in ("--set", f"{key}={_toml(value)}")]
    places = {"SCENE": [str(scene), *sets], "STUDY": ["study.toml"], "OUT": ["."]}
    for number, command in enumerate(case.commands):
        words = [each for word in command.split() for each in places.get(word, [word.replace("OUT", ".")])]
        if command.startswith("report"):  # takes no values of a scene
            words = [word for word in words if word not in sets]
        status, output, error = emclutch(*words, at=out)
        text = f"$ emclutch {command}\nexit status {status}\n--- output\n{output}--- error\n{error}"
        text = text.replace(str(out), "OUT").replace(str(ROOT), "TREE")
        (out / f"{number}-{command.split()[0]}.txt").write_text(text, "utf-8")
        print(f"{name}: {command}: exit status {status}", flush=True)


def _toml(value: Any) -> str:
    return str(value).lower() if isinstance(value, bool) else str(value)


def _study_values(case: Recording) -> str:
    """Return the table [study.set] of a study's points."""
    lines = [f"{json.dumps(key)} = {json.dumps(value)}" for key, value in case.values.items()]
    return "\n".join(["[study.set]", *lines, ""]) if case.study else ""


def leaves(data: Any, key: str = "") -> Iterator[tuple[str, Any]]:
    """Yield the values of nested dicts and lists by their keys."""
    if isinstance(data, dict):
        for name, value in data.items():
            yield from leaves(value, f"{key}.{name}" if key else name)
    elif isinstance(data, list):
        for number, value in enumerate(data):
            yield from leaves(value, f"{key}[{number}]")
    else:
        yield key, data


def numbers(folder: Path) -> dict[str, Any]:
    """Return all values of the JSON files and CSV tables of a recording by file and key; of a column its sum."""
    found: dict[str, Any] = {}
    for path in sorted(folder.rglob("*.json")):
        if path.name != "provenance.json":
            for key, value in leaves(json.loads(path.read_text("utf-8"))):
                found[f"{path.relative_to(folder)}: {key}"] = value
    for path in sorted(folder.rglob("*.csv")):
        with path.open(encoding="utf-8", newline="") as stream:
            rows = list(csv.DictReader(line for line in stream if not line.startswith("#")))
        found[f"{path.relative_to(folder)}: rows"] = len(rows)
        for name in rows[0] if rows else ():
            found[f"{path.relative_to(folder)}: {name}"] = _sum([row[name] for row in rows])
    for path in sorted(folder.rglob("*.txt")):  # what --json prints
        output = path.read_text("utf-8").split("--- output\n")[-1].split("--- error\n")[0]
        if output.startswith("{"):
            for key, value in leaves(json.loads(output)):
                found[f"{path.relative_to(folder)}: {key}"] = value
    return found


def _sum(cells: list[str]) -> Any:
    try:
        return math.fsum(float(cell or "nan") for cell in cells if cell)
    except ValueError:
        return " ".join(cells)


def is_same(old: Any, new: Any) -> bool:
    """True of equal texts, and of numbers that differ by round-off."""
    if isinstance(old, int | float) and isinstance(new, int | float):
        return old == new or abs(old - new) <= TOLERANCE * max(abs(old), abs(new)) or (old != old and new != new)
    return old == new


def compare(old: Path, new: Path, renamed: dict[str, str], text: bool) -> Iterator[str]:
    """Yield the differences of two recordings, a line each."""
    for name, case in RECORDINGS.items():
        if not ((old / name).is_dir() and (new / name).is_dir()):
            continue
        before: dict[str, Any] = {}
        for key, value in numbers(old / name).items():
            for one, other in renamed.items():
                key = key.replace(one, other)
            before[key] = value
        after = numbers(new / name)
        yield from (f"{name}: - {key} = {before[key]}" for key in before.keys() - after.keys())
        yield from (f"{name}: + {key} = {after[key]}" for key in after.keys() - before.keys())
        for key in sorted(before.keys() & after.keys()) if case.exact else ():
            if not MACHINE.search(key) and not is_same(before[key], after[key]):
                yield f"{name}: ~ {key}: {before[key]} -> {after[key]}"
        for path in sorted((new / name).glob("*.txt")) if text else ():
            was, now = ((one / name / path.name).read_text("utf-8").splitlines() for one in (old, new))
            lines = [*difflib.unified_diff(was, now, lineterm="", n=0)][2:]
            changed = [line for line in lines if not line.startswith("@@")]
            same = {NUMBER.sub("#", line[1:]) for line in changed if line[0] == "-"}
            same &= {NUMBER.sub("#", line[1:]) for line in changed if line[0] == "+"}
            yield from (f"{name}/{path.stem}: {line}" for line in changed if NUMBER.sub("#", line[1:]) not in same)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    recording = commands.add_parser("record")
    recording.add_argument("folder", type=Path)
    recording.add_argument("--only", nargs="+", choices=RECORDINGS, default=list(RECORDINGS))
    comparison = commands.add_parser("compare")
    comparison.add_argument("folders", type=Path, nargs=2)
    comparison.add_argument("--renamed", nargs="*", default=[])
    comparison.add_argument("--text", action="store_true")
    asked = parser.parse_args()
    if asked.command == "record":
        for name in asked.only:
            record(name, asked.folder)
        return
    renamed = dict(pair.split("=", 1) for pair in asked.renamed)
    for line in compare(*asked.folders, renamed, asked.text):
        print(line)


if __name__ == "__main__":
    main()
