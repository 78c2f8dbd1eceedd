"""Each effect is one module: without its file and its import the rest imports, checks and runs."""

import io
import os
import re
import shutil
import subprocess
import sys
import tokenize
from pathlib import Path

import pytest

from emclutch.effects import EFFECTS

ROOT = Path(__file__).resolve().parents[2]
MAX_MODULES = 5

# Scenes of a few grains; of each effect the first that does not use it is run
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

RUN = """
import sys
import emclutch
case = emclutch.load_case(sys.argv[1])
from emclutch.simulation.check import check
assert check(case).effects == case.scene.effects.active
assert emclutch.__file__.startswith(sys.argv[2])
result = emclutch.run(case, out=sys.argv[3])
assert len(result.history) >= 2
print("RAN", *case.scene.effects.names())
"""


def without(tree: Path, effect) -> None:
    """Remove the effect's module, its import and its place in the list."""
    module = Path(*effect.__module__.split(".")).with_suffix(".py")
    (tree / module).unlink()
    registry = tree / "emclutch" / "effects" / "__init__.py"
    lines = registry.read_text().splitlines(keepends=True)
    kept = [line for line in lines if not re.search(rf"\b{effect.__name__}\b", line)]
    assert len(lines) - len(kept) == 2
    registry.write_text("".join(kept))


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda one: one.name)
def test_the_rest_runs_without_it(effect, tmp_path):
    """In a copy of the package `emclutch`; the kernels stand in the four others."""
    copy = tmp_path / "copy"
    shutil.copytree(ROOT / "emclutch", copy / "emclutch", ignore=shutil.ignore_patterns("__pycache__"))
    for package in ("geometry", "field", "particles", "coupling"):
        (copy / package).symlink_to(ROOT / package)
    front = copy / "emclutch" / "__init__.py"  # refuses packages that do not lie beside it
    front.write_text(re.sub(r"^check_siblings\(\)$", "", front.read_text(), flags=re.MULTILINE))
    without(copy, effect)
    scene = tmp_path / "scene.toml"
    scene.write_text(MECHANICAL if effect.name in MAGNETIC_EFFECTS else MAGNETIC)
    done = subprocess.run(
        [sys.executable, "-P", "-c", RUN, str(scene), str(copy), str(tmp_path / "run")],
        env=os.environ | {"PYTHONPATH": str(copy)},
        capture_output=True,
        text=True,
        cwd=tmp_path,
    )
    assert done.returncode == 0, done.stderr
    assert "RAN" in done.stdout and effect.name not in done.stdout


@pytest.mark.parametrize("effect", EFFECTS, ids=lambda one: one.name)
def test_few_modules_name_it(effect):
    """In code: as an attribute or key of the effects, not as a word of a text or a quantity of that name."""
    found = []
    for path in sorted((ROOT / "emclutch").rglob("*.py")):
        text = path.read_text(encoding="utf-8")
        if re.search(rf"effects\.{effect.name}\b(?!\.[a-z_]+`)", without_docstrings(text)) or re.search(
            rf"(?<![\w.]){effect.__name__}\b", text
        ):
            found.append(path.relative_to(ROOT).as_posix())
    assert len(found) <= MAX_MODULES, found


def without_docstrings(text: str) -> str:
    """Code and the texts of messages."""
    kept = []
    for token in tokenize.generate_tokens(io.StringIO(text).readline):
        if token.type == tokenize.COMMENT or (token.type == tokenize.STRING and token.string.startswith('"""')):
            continue
        kept.append(token.string)
    return " ".join(kept).replace(" . ", ".")
