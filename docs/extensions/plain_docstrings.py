"""Docstrings are plain text with formulas: |B| and F* are not markup, indented lines are formulas, kept as they are."""

from __future__ import annotations

import re

from sphinx.application import Sphinx

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
            cleaned.append(line if set(line) == {"-"} else literal(line))
            continue
        indented = line.startswith("    ")
        if indented and not formula and (not cleaned or not cleaned[-1]):
            cleaned += ["::", ""]
            formula = True
        elif line and not indented:
            formula = False
        cleaned.append(line if formula else literal(line))
    lines[:] = cleaned


def setup(app: Sphinx) -> dict[str, bool]:
    app.connect("autodoc-process-docstring", clean, priority=400)
    return {"parallel_read_safe": True}
