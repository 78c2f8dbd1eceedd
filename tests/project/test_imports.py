"""Packages import one way, importing `emclutch` loads nothing heavy, and a file that hides a package is named."""

import re
import subprocess
import sys
from pathlib import Path

import emclutch

ROOT = Path(__file__).resolve().parents[2]
BELOW = {
    "geometry": {"geometry"},
    "field": {"field", "geometry"},
    "particles": {"particles", "geometry"},
    "coupling": {"coupling", "field", "particles", "geometry"},
    "emclutch": {"emclutch", "coupling", "field", "particles", "geometry"},
}
FOLDERS = ("scene", "device_model", "results", "simulation", "studies", "cli")  # of emclutch, each imports those before
IMPORT = re.compile(r"^ *(?:from|import) ([\w.]+)(?: import| as|$)", re.M)


def test_packages_import_one_way():
    wrong = []
    for package, below in BELOW.items():
        for path in (ROOT / package).rglob("*.py"):
            folder = path.relative_to(ROOT).parts[1]
            above = FOLDERS[FOLDERS.index(folder) + 1 :] if folder in FOLDERS else ()
            for name in IMPORT.findall(path.read_text(encoding="utf-8")):
                top, *inner = name.split(".")
                if top in set(BELOW) - below or (top == "emclutch" and inner[:1] and inner[0] in above):
                    wrong.append(f"{path.relative_to(ROOT)} imports {name}")
    assert wrong == []


def test_importing_emclutch_loads_nothing_heavy():
    heavy = "{'gmsh', 'pyvista', 'vtk', 'matplotlib', 'skfem', 'numba', 'pandas', 'pint'}"
    code = f"import sys, emclutch; assert not {heavy} & set(sys.modules); import emclutch.results.pictures; "
    code += "assert not {'matplotlib', 'pandas', 'vtkmodules', 'pyvista', 'rich', 'h5py'} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)
    assert all(getattr(emclutch, name) is not None for name in emclutch.__all__)


def test_a_file_that_hides_a_package_is_named(tmp_path):
    (tmp_path / "field.py").write_text("")
    code = "import sys; sys.path.insert(0, '.'); import emclutch"
    environment = {"PYTHONPATH": str(ROOT), "PATH": ""}
    found = subprocess.run([sys.executable, "-c", code], cwd=tmp_path, capture_output=True, text=True, env=environment)
    assert found.returncode != 0 and "ImportError" in found.stderr and str(tmp_path / "field.py") in found.stderr
