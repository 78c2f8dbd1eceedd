"""A wheel holds what the source tree has: every module, every table, the scenes that ship, and nothing else."""

import subprocess
import sys
import tomllib
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("emclutch", "geometry", "field", "particles", "coupling")
MADE = "__pycache__"
"""What a run leaves beside the sources: compiled modules and kernels, and the locks under which they are compiled."""


def tree() -> set[str]:
    """Files of the packages and of `cases`, where an installation has them."""
    places = {package: package for package in PACKAGES} | {"cases": "emclutch/cases"}
    return {
        f"{place}/{path.relative_to(ROOT / folder).as_posix()}"
        for folder, place in places.items()
        for path in (ROOT / folder).rglob("*")
        if path.is_file() and MADE not in path.parts
    }


def test_the_wheel_holds_the_tree(tmp_path):
    """What `build_py` collects is what goes into the wheel; it takes a second, the rest of a build is packing."""
    pytest.importorskip("setuptools", minversion="77", reason="pyproject.toml needs it; make setup installs it")
    commands = ["egg_info", "-e", str(tmp_path), "build_py", "-d", str(tmp_path / "wheel")]
    code = f"import sys; from setuptools import setup; sys.argv = ['setup.py', '-q', *{commands!r}]; setup()"
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    wheel = {
        path.relative_to(tmp_path / "wheel").as_posix() for path in (tmp_path / "wheel").rglob("*") if path.is_file()
    }
    assert wheel - tree() == set(), "in the wheel, not in the packages"
    assert tree() - wheel == set(), "not in the wheel: name its package, or its data, in pyproject.toml"


def test_citation_and_changelog_are_of_this_version():
    version = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
    assert f"version: {version}\n" in (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert version in (ROOT / "CHANGELOG.md").read_text(encoding="utf-8")


def test_gpl_extras_are_named_as_such():
    """gmsh and the packages of `fast` are under the GPL; whoever installs them is informed where they are asked for."""
    for page in ("README.md", "docs/how_to/licences.md"):
        text = (ROOT / page).read_text(encoding="utf-8")
        assert "GPL" in text and "gmsh" in text and "cvxopt" in text, page
