"""No file of the product is longer than can be read in one go, and no function takes more than can be kept in mind."""

import ast
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("geometry", "field", "particles", "coupling", "emclutch")
SOURCES = [path for package in PACKAGES for path in sorted((ROOT / package).rglob("*.py"))]

LONGEST = 400
REASON = "in one file"
"""Words of the module's docstring that give the reason why it is longer."""

MAX_ARGUMENTS = 12


def functions(tree: ast.AST, prefix: str) -> Iterator[tuple[str, int]]:
    """``file.py::Class.name`` of each function in a tree, and how many arguments it takes by position."""
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            inside = f"{prefix}{node.name}"
            if isinstance(node, ast.FunctionDef):
                taken = [argument.arg for argument in (*node.args.posonlyargs, *node.args.args)]
                yield inside, len(taken) - (taken[:1] in (["self"], ["cls"]))
            yield from functions(node, f"{inside}.")
        else:
            yield from functions(node, prefix)


def test_functions_take_few_arguments_by_position():
    """Beyond twelve, those of kernels included, a tuple with names says what belongs together."""
    counted = {
        name: number
        for path in SOURCES
        for name, number in functions(ast.parse(path.read_text("utf-8")), f"{path.relative_to(ROOT).as_posix()}::")
    }
    assert len(counted) > 1000
    assert max(counted.values()) > 10  # a count that finds nothing would pass
    assert {name: number for name, number in counted.items() if number > MAX_ARGUMENTS} == {}


def test_files_are_short_or_say_why_not():
    """A concept a file; one that is longer says in its docstring what has to stand in one file, and why."""
    for path in SOURCES:
        text = path.read_text("utf-8")
        if (lines := text.count("\n")) > LONGEST:
            said = " ".join((ast.get_docstring(ast.parse(text)) or "").split())
            assert REASON in said, f"{path.relative_to(ROOT)} has {lines} lines, and its docstring does not say why"
