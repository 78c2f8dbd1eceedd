"""What makes the tree hard to follow: circles of imports, and tuples without names that travel through kernels."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("geometry", "field", "particles", "coupling", "emclutch")
MODULES = {
    ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__"): path
    for package in PACKAGES
    for path in sorted((ROOT / package).rglob("*.py"))
}
NAMELESS = {"particles/dvi/gauss_seidel.py::_visit_shaft"}  # a velocity
"""Functions that gather three values or more in a tuple without names, to pass them on."""


def imported(path: Path) -> Iterator[str]:
    """Modules that a file imports while it is imported, without those for types alone."""
    for node in ast.parse(path.read_text(encoding="utf-8")).body:
        if isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            for alias in node.names:
                inside = f"{node.module}.{alias.name}"
                yield inside if inside in MODULES else node.module


def circles() -> list[set[str]]:
    """Strongly connected modules (R. Tarjan, SIAM J. Comput. 1 (1972) 146), each set of more than one."""
    arrows = {name: [one for one in imported(path) if one in MODULES] for name, path in MODULES.items()}
    index: dict[str, int] = {}
    low: dict[str, int] = {}
    stack: list[str] = []
    found = []

    def visit(name: str) -> None:
        index[name] = low[name] = len(index)
        stack.append(name)
        for other in arrows[name]:
            if other not in index:
                visit(other)
                low[name] = min(low[name], low[other])
            elif other in stack:
                low[name] = min(low[name], index[other])
        if low[name] == index[name]:
            component = set(stack[stack.index(name) :])
            del stack[stack.index(name) :]
            if len(component) > 1:
                found.append(component)

    for name in arrows:
        if name not in index:
            visit(name)
    return found


def test_no_modules_import_each_other_in_a_circle():
    assert circles() == []


def gathered(path: Path) -> Iterator[str]:
    """Functions of a file that put three names or more into a tuple which they pass on whole."""
    for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
        if not isinstance(node, ast.FunctionDef) or not node.decorator_list:
            continue
        tuples = {
            statement.targets[0].id
            for statement in ast.walk(node)
            if isinstance(statement, ast.Assign)
            and isinstance(statement.targets[0], ast.Name)
            and isinstance(statement.value, ast.Tuple)
            and sum(isinstance(one, ast.Name) for one in statement.value.elts) >= 3
        }
        passed = {
            one.id
            for call in ast.walk(node)
            if isinstance(call, ast.Call)
            for one in call.args
            if isinstance(one, ast.Name)
        }
        if tuples & passed:
            yield f"{path.relative_to(ROOT).as_posix()}::{node.name}"


def test_kernels_pass_no_tuples_without_names():
    found = {name for path in MODULES.values() for name in gathered(path)}
    assert found <= NAMELESS, found - NAMELESS
