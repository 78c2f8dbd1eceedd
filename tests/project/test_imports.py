"""Imports run one way, the face is light, and nothing may hide the sibling packages."""

import ast
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
MAY_IMPORT = {
    "geometry": {"geometry"},
    "field": {"field", "geometry"},
    "particles": {"particles", "geometry"},
    "coupling": {"coupling", "field", "particles", "geometry"},
    "emclutch": {"emclutch", "coupling", "field", "particles", "geometry"},
}
ROOMS = ("scene", "device_model", "results", "simulation", "studies", "cli")
"""Of `emclutch`, from the ground up: a room imports from those before it. `THINGS` lie beside `scene`."""
THINGS = ("effects", "contact_laws", "devices", "sources", "knobs")
SOURCES = [path for package in MAY_IMPORT for path in sorted((ROOT / package).rglob("*.py"))]


def _imported(path: Path) -> set[str]:
    """Names of all modules that a file imports, wherever it does so."""
    names = set()
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if isinstance(node, ast.Import):
            names |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom) and node.level == 0:
            names.add(node.module or "")
    return names


@pytest.mark.parametrize("path", SOURCES, ids=lambda path: str(path.relative_to(ROOT)))
def test_imports_run_one_way(path):
    """geometry <- field, geometry <- particles, both <- coupling, all <- emclutch; field and particles never meet."""
    allowed = MAY_IMPORT[path.relative_to(ROOT).parts[0]]
    for name in _imported(path):
        package = name.partition(".")[0]
        assert package not in MAY_IMPORT or package in allowed, f"{path.name} imports {name}"


@pytest.mark.parametrize("room", ROOMS)
def test_rooms_import_downwards(room):
    """scene <- device_model <- results <- simulation <- studies <- cli."""
    for path in sorted((ROOT / "emclutch" / room).rglob("*.py")):
        for name in _imported(path):
            above = name.split(".")[1] if name.startswith("emclutch.") else room
            above = "scene" if above in THINGS else above
            assert ROOMS.index(above) <= ROOMS.index(room), f"{path.relative_to(ROOT)} imports {name}"


@pytest.mark.parametrize("things", THINGS)
def test_things_are_imported_with_the_schema(things):
    """While they are imported they need the schema alone; what they build with is imported when they build it."""
    for path in sorted((ROOT / "emclutch" / things).glob("*.py")):
        for node in ast.parse(path.read_text(encoding="utf-8")).body:
            if isinstance(node, ast.ImportFrom):
                package = ".".join((node.module or "").split(".")[:2])
                own = package.partition(".")[0] in MAY_IMPORT
                assert not own or package in ("emclutch.scene", f"emclutch.{things}"), (
                    f"{path.name} imports {node.module}"
                )


def test_every_module_of_emclutch_is_in_a_room():
    """Beside the rooms stand the face, its lazy imports and its guard."""
    folders = {path.name for path in (ROOT / "emclutch").iterdir() if path.is_dir() and path.name != "__pycache__"}
    assert folders == {*ROOMS, *THINGS}
    assert {path.stem for path in (ROOT / "emclutch").glob("*.py")} == {"__init__", "lazily", "siblings"}


def test_the_face_imports_nothing_heavy():
    code = (
        "import sys, emclutch; heavy = {'gmsh', 'pyvista', 'vtk', 'matplotlib', 'skfem', 'numba', 'pandas', 'pint'};"
        "print(*sorted(heavy & set(sys.modules)))"
    )
    found = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.strip() == ""


def test_a_file_that_hides_a_sibling_is_named(tmp_path):
    (tmp_path / "field.py").write_text("")
    code = "import sys; sys.path.insert(0, '.'); import emclutch"
    environment = {"PYTHONPATH": str(ROOT), "PATH": ""}
    found = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, env=environment)
    assert found.returncode != 0
    assert "ImportError" in found.stderr
    assert str(tmp_path / "field.py") in found.stderr
    assert "rename" in found.stderr


def test_the_face_offers_what_it_lists():
    import emclutch

    for name in emclutch.__all__:
        assert getattr(emclutch, name) is not None
    assert callable(emclutch.run)
