"""Docstrings are plain text with formulas: |B| and F* are not markup, indented lines are formulas, kept as they are."""

from __future__ import annotations

import re

from sphinx.application import Sphinx

COLON = "\ue000"
ENTRY = re.compile(r"([\w, ]+?) : (.*)")
NAME_IN_BACKTICKS = re.compile(r"(`+[^`]+`+)")


def literal(text: str) -> str:
    """Escape what reStructuredText would take for markup outside of backticks; single backticks are code."""
    parts = NAME_IN_BACKTICKS.split(text)
    for k, part in enumerate(parts):
        if k % 2:
            parts[k] = f"``{part.strip('`')}``"
        else:
            parts[k] = re.sub(r"([*|\\]|(?<=\w)_(?=\W|$))", r"\\\1", part)
    return "".join(parts)


def clean(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Docstring `lines` in place, before napoleon reads their sections."""
    cleaned: list[str] = []
    formula = False
    section = False
    for k, line in enumerate(lines):
        following = lines[k + 1] if k + 1 < len(lines) else ""
        if following and set(following) == {"-"} and len(following) > 3:
            section, formula = True, False
        if section:
            entry = ENTRY.fullmatch(line)
            if set(line) == {"-"}:
                cleaned.append(line)
            elif entry is not None and not following.startswith(" "):  # its meaning is where others have their type
                cleaned += [entry[1], f"    {literal(entry[2])}"]
            else:
                cleaned.append(literal(line))
            continue
        indented = line.startswith("    ")
        if indented and not formula and (not cleaned or not cleaned[-1]):
            cleaned += ["::", ""]
            formula = True
        elif line and not indented:
            formula = False
        cleaned.append(line if formula else literal(line))
    if what == "property":  # napoleon would take what is before a colon for its type
        cleaned = [line.replace(":", COLON) for line in cleaned]
    lines[:] = cleaned


def with_colons(app: Sphinx, what: str, name: str, obj: object, options: object, lines: list[str]) -> None:
    """Put back, after napoleon, what `clean` has hidden from it."""
    lines[:] = [line.replace(COLON, ":") for line in lines]


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("autodoc-process-docstring", clean, priority=400)
    app.connect("autodoc-process-docstring", with_colons, priority=600)
    return {"parallel_read_safe": True}
