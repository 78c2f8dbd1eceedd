"""Each effect, device and source is one module: without its file and its lines the rest imports, checks and runs."""

import io
import os
import re
import shutil
import subprocess
import sys
import tokenize
from pathlib import Path

import pytest

from emclutch.devices import GEOMETRIES
from emclutch.effects import EFFECTS
from emclutch.sources import SOURCES

ROOT = Path(__file__).resolve().parents[2]
MAX_MODULES = 5

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
MAGNETIC_EFFECTS = ("magnetic_force", "dipoles", "saturation")
IN_A_BOX = 'kind = "box"\nsize = ["4 mm", "4 mm", "4 mm"]\n'
BOX = re.sub(r"kind = .*?(?=\[particles\])", IN_A_BOX, MECHANICAL, flags=re.DOTALL)
BOX = re.sub(r"\[motion.*?(?=\[time)", "[effects.gravity]\n", BOX, flags=re.DOTALL)

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


def without(tree: Path, thing) -> None:
    """Remove the thing's module, its import and its place in the list."""
    module = Path(*thing.__module__.split(".")).with_suffix(".py")
    (tree / module).unlink()
    registry = tree / module.parent / "__init__.py"
    lines = registry.read_text().splitlines(keepends=True)
    kept = [line for line in lines if not re.search(rf"\b{thing.__name__}\b", line)]
    assert len(lines) - len(kept) == 2
    registry.write_text("".join(kept))


def runs_without(things, scene: str, tmp_path: Path) -> str:
    """Run a scene in a copy of the package `emclutch`; the kernels stand in the four others. Return what is left."""
    copy = tmp_path / "copy"
    shutil.copytree(ROOT / "emclutch", copy / "emclutch", ignore=shutil.ignore_patterns("__pycache__"))
    for package in ("geometry", "field", "particles", "coupling"):
        (copy / package).symlink_to(ROOT / package)
    front = copy / "emclutch" / "__init__.py"  # refuses packages that do not lie beside it
    front.write_text(re.sub(r"^check_siblings\(\)$", "", front.read_text(), flags=re.MULTILINE))
    for thing in things:
        without(copy, thing)
    path = tmp_path / "scene.toml"
    path.write_text(scene)
    done = subprocess.run(
        [sys.executable, "-P", "-c", RUN, str(path), str(copy), str(tmp_path / "run")],
        env=os.environ | {"PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "RAN" in done.stdout
    return done.stdout


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda one: one.name)
def test_the_rest_runs_without_an_effect(effect, tmp_path):
    left = runs_without([effect], MECHANICAL if effect.name in MAGNETIC_EFFECTS else MAGNETIC, tmp_path)
    assert effect.name not in left


@pytest.mark.parametrize("kind", GEOMETRIES, ids=lambda one: one.name())
def test_the_rest_runs_without_a_kind_of_device(kind, tmp_path):
    """With a kind those that vary it go too, as the drum varies the clutch."""
    gone = [one for one in GEOMETRIES if issubclass(one, kind)]
    left = runs_without(gone, BOX if kind.name() == "shear_cell" else MAGNETIC, tmp_path)
    assert not {one.name() for one in gone} & set(left.split())


@pytest.mark.parametrize("source", SOURCES, ids=lambda one: one.name())
def test_the_rest_runs_without_a_source(source, tmp_path):
    left = runs_without([source], MECHANICAL if source.name() == "uniform" else MAGNETIC, tmp_path)
    assert source.name() not in left.split()


def modules_of_the_face():
    return {path.relative_to(ROOT): path.read_text(encoding="utf-8") for path in (ROOT / "emclutch").rglob("*.py")}


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda one: one.name)
def test_few_modules_name_an_effect(effect):
    """In code: as an attribute or key of the effects, not as a word of a text or a quantity of that name."""
    found = []
    for path, text in modules_of_the_face().items():
        if re.search(rf"effects\.{effect.name}\b(?!\.[a-z_]+`)", without_docstrings(text)) or re.search(
            rf"(?<![\w.]){effect.__name__}\b", text
        ):
            found.append(path.as_posix())
    assert len(found) <= MAX_MODULES, found


@pytest.mark.parametrize("thing", (*GEOMETRIES, *SOURCES), ids=lambda one: one.name())
def test_only_its_room_knows_a_device_or_a_source(thing):
    """Neither its class, nor that of its shape, nor a comparison with its name stands in another room."""
    shape = [thing.shape.__annotations__["return"]] if hasattr(thing, "shape") else []
    names = [thing.__name__, *shape]
    known = rf"(?<![\w.\"'])({'|'.join(names)})\b|\b(kind|source) *[!=]= *[\"']{thing.name()}[\"']"
    room = Path(*thing.__module__.split(".")[:-1])
    strangers = {path for path, text in modules_of_the_face().items() if re.search(known, without_docstrings(text))}
    assert not {path.as_posix() for path in strangers if not path.is_relative_to(room)}


def without_docstrings(text: str) -> str:
    """Code and the texts of messages."""
    kept = []
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT or (token.type == tokenize.STRING and token.string.startswith('"""')):
            continue
        kept.append(token.string)
    return " ".join(kept).replace(" . ", ".")
