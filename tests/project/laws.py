"""Which law is tested in which file: the first line of every test file, by folder. `make laws` prints it."""

from __future__ import annotations

import ast
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1]


def law(path: Path) -> str:
    """The first line of a file's docstring; empty where it has none."""
    return (ast.get_docstring(ast.parse(path.read_text(encoding="utf-8"))) or "").partition("\n")[0]


def laws() -> dict[str, dict[str, str]]:
    """{folder: {file: law}} of all files of tests below `tests`."""
    folders: dict[str, dict[str, str]] = {}
    for path in sorted(TESTS.glob("*/test_*.py")):
        folders.setdefault(path.parent.name, {})[path.name] = law(path)
    return folders


def main() -> None:
    """Print them, a block for each folder."""
    for folder, files in laws().items():
        print(f"\ntests/{folder}")
        width = max(map(len, files))
        for name, said in files.items():
            print(f"  {name:{width}}  {said}")


if __name__ == "__main__":
    main()
