"""Packages import one way, results in no circle; `emclutch` loads nothing heavy; a file hiding a package is named."""

import ast
import re
import subprocess
import sys
from collections.abc import Iterator
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
WITHOUT_CIRCLE = ("results", "studies")  # of emclutch
IMPORT = re.compile(r"^ *(?:from|import) ([\w.]+)(?: import| as|$)", re.M)
LAZY = re.compile(r'"(\w+)": "(emclutch[\w.]*):(\w+)"')  # of `emclutch.lazily`


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


def imported_names(tree: ast.AST) -> Iterator[str]:
    """Yield the dotted names that a module imports, also inside functions; not those for type checkers alone."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.ImportFrom):
            yield from (f"{node.module}.{one.name}" for one in node.names)
        elif isinstance(node, ast.Import):
            yield from (one.name for one in node.names)
        elif not (isinstance(node, ast.If) and ast.unparse(node.test) == "TYPE_CHECKING"):
            yield from imported_names(node)


def import_graph() -> dict[str, set[str]]:
    """Return the modules of emclutch that each of them imports; a lazy attribute is the module that has it."""
    paths = {".".join(path.relative_to(ROOT).with_suffix("").parts): path for path in (ROOT / "emclutch").rglob("*.py")}
    texts = {name.removesuffix(".__init__"): path.read_text(encoding="utf-8") for name, path in paths.items()}
    lazy = {f"{name}.{key}": f"{module}.{of}" for name, text in texts.items() for key, module, of in LAZY.findall(text)}

    def module_of(name: str) -> str:
        while name in lazy:
            name = lazy[name]
        return name if name in texts else name.rpartition(".")[0]

    return {
        name: {module_of(one) for one in imported_names(ast.parse(text))} & set(texts) - {name}
        for name, text in texts.items()
    }


def test_results_and_studies_are_in_no_circle_of_imports():
    graph = import_graph()

    def imports_itself(module: str) -> bool:
        reached, new = set(), {module}
        while new := {each for one in new for each in graph[one]} - reached:
            reached |= new
        return module in reached

    checked = [name for name in graph if name.startswith(tuple(f"emclutch.{one}." for one in WITHOUT_CIRCLE))]
    assert checked and not {name for name in checked if imports_itself(name)}


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
