"""The rest runs without any one effect, device or source: `python tests/hard/take_away.py FOLDER [NAME ...]`.

Each is one module. Its file, its import and its place in the list are removed from a copy of `emclutch`, with a device
also those derived from it, as the drum from the clutch; the rest must import, check and run a scene of a few grains.

The table (name, list, broken, what was wrong, processor seconds) is printed, and stored as FOLDER/take_away.csv. Exit
code 1: something does not run.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas

from emclutch.devices import GEOMETRIES
from emclutch.effects import EFFECTS
from emclutch.sources import SOURCES

ROOT = Path(__file__).resolve().parents[2]

# Scenes of a few grains; the first that does not use what is taken away is run
MAGNETIC = """
[scene]
title = "Grains in a uniform field"
[geometry]
kind = "shear_cell"
inner_radius = "10 mm"
outer_radius = "12 mm"
height = "2 mm"
[field]
source = "uniform"
field_strength = "50 kA/m"
direction = "radial"
[particles]
diameter = "0.4 mm"
count = 30
density = "7800 kg/m^3"
[contact]
stiffness = "50 kN/m"
[effects.magnetic_force]
[effects.dipoles]
model = "mutual"
[effects.saturation]
[motion.rotor]
speed = "60 rpm"
[time]
end = "20 us"
window = "10 us"
[accuracy]
replicas = 1
[output]
snapshots = 1
pictures = false
"""
MECHANICAL = re.sub(r"\[field\].*?(?=\[particles\])|\[effects\..*?(?=\[motion)", "", MAGNETIC, flags=re.DOTALL)
IN_A_BOX = 'kind = "box"\nsize = ["4 mm", "4 mm", "4 mm"]\n'
BOX = re.sub(r"kind = .*?(?=\[particles\])", IN_A_BOX, MECHANICAL, flags=re.DOTALL)
BOX = re.sub(r"\[motion.*?(?=\[time)", "[effects.gravity]\n", BOX, flags=re.DOTALL)
SCENES = dict.fromkeys(("magnetic_force", "dipoles", "saturation", "uniform"), MECHANICAL) | {"shear_cell": BOX}

RUN = """
import sys
import emclutch
case = emclutch.load_case(sys.argv[1])
from emclutch.simulation.check import check
assert check(case).effects == case.scene.effects.active
assert emclutch.__file__.startswith(sys.argv[2])
result = emclutch.run(case, out=sys.argv[3])
assert len(result.history) >= 2
from emclutch.devices import GEOMETRIES
from emclutch.sources import SOURCES
print("RAN", *case.scene.effects.names(), *(one.name() for one in (*GEOMETRIES, *SOURCES)))
"""


def name_of(thing: Any) -> str:
    """Name of an effect, a device or a source, as a scene has it."""
    return thing.name if isinstance(thing.name, str) else thing.name()


def without(tree: Path, thing: Any) -> None:
    """Remove the module of a thing, its import and its place in the list."""
    module = Path(*thing.__module__.split(".")).with_suffix(".py")
    (tree / module).unlink()
    registry = tree / module.parent / "__init__.py"
    lines = registry.read_text().splitlines(keepends=True)
    kept = [line for line in lines if not re.search(rf"\b{thing.__name__}\b", line)]
    assert len(lines) - len(kept) == 2, f"{thing.__name__} is in {len(lines) - len(kept)} lines of {registry.name}"
    registry.write_text("".join(kept))


def run_without(things: Sequence[Any], scene: str, folder: Path) -> None:
    """Run a scene in a copy of `emclutch` without some things; AssertionError where it does not run."""
    copy = folder / "copy"
    shutil.copytree(ROOT / "emclutch", copy / "emclutch", ignore=shutil.ignore_patterns("__pycache__"))
    for package in ("geometry", "field", "particles", "coupling"):  # the kernels are there
        (copy / package).symlink_to(ROOT / package)
    front = copy / "emclutch" / "__init__.py"  # refuses packages that do not lie beside it
    front.write_text(re.sub(r"^check_siblings\(\)$", "", front.read_text(), flags=re.MULTILINE))
    for thing in things:
        without(copy, thing)
    path = folder / "scene.toml"
    path.write_text(scene)
    done = subprocess.run(
        [sys.executable, "-P", "-c", RUN, str(path), str(copy), str(folder / "run")],
        env=os.environ | {"PYTHONPATH": str(copy)}, capture_output=True, text=True, cwd=folder,
    )  # fmt: skip
    assert done.returncode == 0 and "RAN" in done.stdout, done.stderr
    assert not {name_of(thing) for thing in things} & set(done.stdout.partition("RAN")[2].split())


def main(folder: Path, names: list[str]) -> int:
    """Take away those of that name, each by itself, all if there is none; the exit code."""
    folder.mkdir(parents=True, exist_ok=True)
    rows: list[dict[str, Any]] = []
    for kind, things in (("effects", EFFECTS), ("devices", GEOMETRIES), ("sources", SOURCES)):
        for thing in things:
            if names and name_of(thing) not in names:
                continue
            gone = [one for one in things if issubclass(one, thing)]
            begin, wrong = os.times(), ""
            with tempfile.TemporaryDirectory() as scratch:
                try:
                    run_without(gone, SCENES.get(name_of(thing), MAGNETIC), Path(scratch))
                except AssertionError as error:
                    wrong = (str(error).strip() or "it is still there").splitlines()[-1]
            spent = sum(after - before for after, before in zip(os.times()[:4], begin[:4], strict=True))
            row = {"name": name_of(thing), "list": kind, "broken": int(bool(wrong)), "wrong": wrong}
            rows.append(row | {"seconds": round(spent)})
            print(pandas.DataFrame(rows[-1:]).to_string(index=False, max_colwidth=None), flush=True)
            pandas.DataFrame(rows).to_csv(folder / "take_away.csv", index=False)
    broken = sum(row["broken"] for row in rows)
    print(f"{len(rows)} taken away, each by itself; without {broken} of them the rest does not run")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
