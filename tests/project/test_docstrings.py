"""Parameters that a docstring documents are those of the function, and attributes those of the class."""

import ast
import re
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
PACKAGES = ("geometry", "field", "particles", "coupling", "emclutch")
ENTRY = re.compile(r"^(\*{0,2}[A-Za-z_]\w*(?:, \*{0,2}[A-Za-z_]\w*)*)(?: :|$)")


def documented(text, section):
    """Names of the entries of a numpydoc section."""
    lines = text.expandtabs().splitlines()
    for start, line in enumerate(lines):
        if line.strip() == section and start + 1 < len(lines) and set(lines[start + 1].strip()) == {"-"}:
            indent = len(line) - len(line.lstrip())
            for number, entry in enumerate(lines[start + 2 :], start + 2):
                following = lines[number + 1].strip() if number + 1 < len(lines) else ""
                if set(following) == {"-"} and following:
                    return
                level, found = len(entry) - len(entry.lstrip()), ENTRY.match(entry.strip())
                if entry.strip() and level == indent and found:
                    yield from (name.lstrip("*") for name in found[1].split(", "))


def arguments(function):
    a = function.args
    return {one.arg for one in [*a.posonlyargs, *a.args, *a.kwonlyargs, a.vararg, a.kwarg] if one is not None}


def faults():
    for package in PACKAGES:
        for path in sorted((ROOT / package).rglob("*.py")):
            for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
                if isinstance(node, (ast.FunctionDef, ast.ClassDef)):
                    text = ast.get_docstring(node) or ""
                    function = node
                    if isinstance(node, ast.ClassDef):
                        made = [n for n in node.body if isinstance(n, ast.FunctionDef) and n.name == "__init__"]
                        function = made[0] if made else None
                        fields = {n.target.id for n in node.body if isinstance(n, ast.AnnAssign)
                                  and isinstance(n.target, ast.Name)}  # fmt: skip
                    known = arguments(function) if function is not None else fields
                    for name in documented(text, "Parameters"):
                        if name not in known:
                            yield f"{path.relative_to(ROOT)}: {node.name} documents `{name}`"


def test_documented_parameters_exist():
    assert list(faults()) == []


def test_a_parameter_that_does_not_exist_is_found():
    section = "Parameters\n    ----------\n    a : int\n    c, b : int"
    tree = ast.parse(f'def f(a, *, b):\n    """Do.\n\n    {section}\n    """')
    function = tree.body[0]
    names = set(documented(ast.get_docstring(function), "Parameters"))
    assert names - arguments(function) == {"c"}
