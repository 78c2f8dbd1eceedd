"""Directive `gallery`: the shipped scenes with the question, the expectation and the time that their headers have.

The header of a scene is its first comment: a question, then paragraphs that begin with ``Run:``, ``Expect:``,
``Takes:`` and ``Note:``. The picture is given in the directive's body, a line ``scene picture`` each.
"""

from __future__ import annotations

import re
from pathlib import Path

from docutils import nodes
from sphinx.application import Sphinx
from sphinx.util.docutils import SphinxDirective

CASES = Path(__file__).resolve().parents[2] / "cases"
FIRST = ("thesis/electromagnetic_study", "disc_clutch", "quickstart", "powder_clutch")
PARTS = ("Run", "Expect", "Takes", "Note")


def header(scene: Path) -> dict[str, str]:
    """The parts of a scene's header by their names; the question is ``Question``."""
    comment = re.match(r"(?:#.*\n)+", scene.read_text(encoding="utf-8"))
    if comment is None:
        raise ValueError(f"{scene} has no header; begin with its question, then Run:, Expect:, Takes:")
    parts = {"Question": ""}
    name = "Question"
    for line in comment[0].splitlines():
        text = line.removeprefix("#").strip()
        begun = re.match(rf"({'|'.join(PARTS)}):\s*(.*)", text)
        if begun is not None:
            name, text = begun[1], begun[2]
        parts[name] = f"{parts.get(name, '')} {text}".strip()
    return parts


def scenes() -> list[Path]:
    """Scenes and studies of the gallery: those of `cases` and of `cases/thesis`."""
    first = [CASES / f"{name}.toml" for name in FIRST]
    others = [*sorted(CASES.glob("*.toml")), *sorted(CASES.glob("thesis/*.toml"))]
    return first + [one for one in others if one not in first]


def plain(text: str) -> str:
    """A header's text, which is no markup but for its backticks, as Markdown."""
    parts = text.split("`")
    parts[::2] = [re.sub(r"([*_<>|\[\]$])", r"\\\1", part) for part in parts[::2]]
    return "`".join(parts)


def gallery_page(pictures: dict[str, str]) -> str:
    """Markdown: a section a scene; `pictures` by the scene's path below `cases`."""
    lines: list[str] = []
    for scene in scenes():
        name, parts = scene.relative_to(CASES).as_posix(), header(scene)
        lines += [f"## {name}", "", f"**{plain(parts['Question'])}**", ""]
        if name in pictures:
            lines += [f"![{name}]({pictures[name]})", ""]
        for part in PARTS[1:]:
            if part in parts:
                lines += [f"{part}: {plain(parts[part])}", ""]
        lines += [f"[The scene](../cases/{name})", ""]
    return "\n".join(lines)


class Gallery(SphinxDirective):
    has_content = True

    def run(self) -> list[nodes.Node]:
        pictures = dict(line.split() for line in self.content)
        unknown = set(pictures) - {scene.relative_to(CASES).as_posix() for scene in scenes()}
        if unknown:
            raise self.error(f"no scenes of cases/: {', '.join(sorted(unknown))}")
        for scene in scenes():
            self.env.note_dependency(str(scene))
        return self.parse_text_to_nodes(gallery_page(pictures), allow_section_headings=True)


def setup(app: Sphinx) -> dict[str, bool]:
    app.add_directive("gallery", Gallery)
    return {"parallel_read_safe": True}
