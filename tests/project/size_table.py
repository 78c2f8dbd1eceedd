"""How large the program is: statements, functions and record types by package, beside those of an earlier commit.

`make test` prints it last, so that a change that lets the program grow is seen. A statement is an `ast.stmt`, a record
type a class with a decorator of `dataclasses`.
"""

from __future__ import annotations

import ast
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
COMMIT = "d747dd26"
THEN = {  # statements, functions, record types at COMMIT
    "emclutch": (24560, 2275, 150),
    "geometry": (3953, 491, 23),
    "field": (6695, 679, 58),
    "particles": (9810, 832, 52),
    "coupling": (4155, 338, 34),
    "tests": (36772, 3854, 28),
}
Counts = tuple[int, ...]


def counts(source: str) -> Counts:
    """Statements, functions and record types of a file."""
    nodes = list(ast.walk(ast.parse(source)))
    records = [
        node
        for node in nodes
        if isinstance(node, ast.ClassDef) and any("dataclass" in ast.unparse(one) for one in node.decorator_list)
    ]
    functions = sum(isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef) for node in nodes)
    return sum(isinstance(node, ast.stmt) for node in nodes), functions, len(records)


def total(each: list[Counts]) -> Counts:
    """Sum of counts."""
    return tuple(sum(column) for column in zip(*each, strict=True))


def main() -> None:
    """Print the table."""
    now = {
        package: total([counts(path.read_text(encoding="utf-8")) for path in (ROOT / package).rglob("*.py")])
        for package in THEN
    }
    print(" " * 10 + "".join(f"{title:>28}" for title in ("statements", "functions", "record types")))
    print(" " * 10 + f"{'now':>10}{COMMIT:>10}{'change':>8}" * 3)
    for name, new, old in (
        *((name, now[name], THEN[name]) for name in THEN),
        ("all", total(list(now.values())), total(list(THEN.values()))),
    ):
        print(f"{name:10}" + "".join(f"{n:10}{o:10}{n - o:+8}" for n, o in zip(new, old, strict=True)))


if __name__ == "__main__":
    main()
