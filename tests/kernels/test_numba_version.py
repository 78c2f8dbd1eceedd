"""The kernels are for one minor version of numba, and the page on it lists all that they use of its internals."""

import ast
import re
import tomllib
from pathlib import Path

import numba
import pytest

from geometry.kernels.numba_version import TESTED, NumbaVersionError, require_tested_version

ROOT = Path(__file__).resolve().parents[2]
PAGE = (ROOT / "geometry" / "kernels" / "README.md").read_text(encoding="utf-8")
PUBLIC = {"numba", "numba.extending", "numba.typed"}
INFRASTRUCTURE = ("simd", "simd_math", "simd_tables", "atomics", "device_functions", "cache", "stamp", "machine_code")
PYTHON = {"_fields", "_replace"}  # of named tuples


def test_another_version_is_refused_with_the_remedy():
    require_tested_version(numba.__version__)
    for other in ("0.69.0", "0.67.3", "1.68.0", "0.680.1"):
        words = rf"numba {re.escape(other)} is installed.*pip install 'numba=={TESTED}"
        with pytest.raises(NumbaVersionError, match=words):
            require_tested_version(other)


def test_the_package_allows_the_tested_version_alone():
    asked = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["dependencies"]
    (line,) = (one for one in asked if one.startswith("numba"))
    major, minor = TESTED.split(".")
    assert line == f"numba>={TESTED},<{major}.{int(minor) + 1}"
    assert re.search(rf"^numba=={re.escape(TESTED)}\.\d+$", (ROOT / "constraints.txt").read_text(), re.MULTILINE)


def modules():
    """Path and syntax of every module of the product."""
    for package in ("geometry", "field", "particles", "coupling", "emclutch"):
        for path in sorted((ROOT / package).rglob("*.py")):
            yield path, ast.parse(path.read_text(encoding="utf-8"))


def test_the_page_lists_every_internal_module_and_no_other():
    used = {}
    for path, tree in modules():
        for node in ast.walk(tree):
            if isinstance(node, ast.ImportFrom) and node.module and node.module.split(".")[0] == "numba":
                inside = [f"{node.module}.{a.name}" for a in node.names]
                names = inside if node.module == "numba.core" else [node.module]
                for name in names:
                    if name not in PUBLIC:
                        used.setdefault(name, set()).add(path.relative_to(ROOT).as_posix())
    missing = {name: places for name, places in used.items() if f"`{name}" not in PAGE}
    assert not missing
    listed = set(re.findall(r"`(numba\.(?:core|np|cpython)[a-z_.]*[a-z])", PAGE))
    assert all(any(name.startswith(one) for name in used) for one in listed)
    assert all(path in PAGE for places in used.values() for path in places)


def test_the_page_lists_every_private_attribute():
    listed = set(re.findall(r"[`.](_[a-z_]+)`", PAGE))
    used = set()
    for path, tree in modules():
        if path.parent.name != "kernels" or path.stem not in INFRASTRUCTURE:
            continue
        own = {n.name for n in ast.walk(tree) if isinstance(n, (ast.FunctionDef, ast.ClassDef))}
        own |= {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute) and isinstance(n.ctx, ast.Store)
                and isinstance(n.value, ast.Name) and n.value.id in ("self", "ProcessFolder")}  # fmt: skip
        found = {n.attr for n in ast.walk(tree) if isinstance(n, ast.Attribute) and re.match(r"_[a-z]", n.attr)}
        found |= {n.args[1].value for n in ast.walk(tree) if isinstance(n, ast.Call) and isinstance(n.func, ast.Name)
                  and n.func.id in ("getattr", "hasattr") and isinstance(n.args[1], ast.Constant)
                  and re.match(r"_[a-z]", n.args[1].value)}  # fmt: skip
        used |= found - own
    assert used - listed - PYTHON == set()
    text = "".join((ROOT / "geometry" / "kernels" / f"{name}.py").read_text() for name in INFRASTRUCTURE)
    assert all(name in text for name in listed)
