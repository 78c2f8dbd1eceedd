"""A key or table that stands twice in a text of TOML, with both lines: the parser names only where it stops."""

from __future__ import annotations

import re
import tomllib

_TABLE = re.compile(r"\s*\[([^\[\]]+)\]\s*(?:#.*)?")
_ENTRY = re.compile(r"""\s*((?:[\w-]+|"[^"]*"|'[^']*')(?:\s*\.\s*(?:[\w-]+|"[^"]*"|'[^']*'))*)\s*=.*""")
_STEP = re.compile(r"""[\w-]+|"[^"]*"|'[^']*'""")


def repeated_key(text: str) -> str:
    """Return what is wrong with a text that is not TOML because of a key given twice; empty where that is not why."""
    lines, table = text.splitlines(), tuple[str, ...]()
    first: dict[tuple[str, ...], int] = {}
    for number, line in enumerate(lines, 1):
        header = _TABLE.fullmatch(line)
        if (named := header or _ENTRY.fullmatch(line)) is None:
            continue
        steps = tuple(step.strip("\"'") for step in _STEP.findall(named[1]))
        path = steps if header else (*table, *steps)
        table = path if header else table
        earlier = first.setdefault(path, number)
        # what is inside a text of several lines is no key: its lines before it are not TOML
        if earlier != number and _is_toml(lines[: number - 1]) and not _is_toml(lines[:number]):
            name = f"the table [{'.'.join(path)}]" if header else f"the key {'.'.join(path)}"
            return f"gives {name} twice, in lines {earlier} and {number}; keep one of them"
    return ""


def _is_toml(lines: list[str]) -> bool:
    try:
        tomllib.loads("\n".join(lines))
    except tomllib.TOMLDecodeError:
        return False
    return True
