"""What a result says, once, in sections: the terminal, a page of HTML, Markdown, JSON and a notebook render them.

The text of a scene in it is untrusted: each renderer escapes it.
"""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from enum import Enum, IntEnum
from importlib import import_module
from pathlib import Path
from typing import Any, ClassVar


class Mark(Enum):
    """Rating of a statement."""

    GOOD = "good"
    NOTE = "note"
    WARNING = "warning"
    UNUSABLE = "unusable"

    @property
    def sign(self) -> str:
        """The mark as one character; a note has none."""
        return {"good": "✓", "note": " ", "warning": "!", "unusable": "✗"}[self.value]


@dataclass(frozen=True, slots=True)
class Statement:
    """A sentence with its rating; `mark` is UNUSABLE only where the number that is asked for cannot be used."""

    mark: Mark
    text: str


def note(text: str) -> Statement:
    """Return a statement without a rating."""
    return Statement(Mark.NOTE, text)


def warning(text: str) -> Statement:
    """Return a statement that warns, as a sentence."""
    return Statement(Mark.WARNING, sentence(text))


def sentence(text: str) -> str:
    """Return a text with a capital letter, unless a key of the scene begins it, and a full stop."""
    is_key = "." in text.partition(" ")[0].rstrip(".")
    found = text if is_key else text[:1].upper() + text[1:]
    return found if found.endswith("?") else f"{found.rstrip('.')}."


class Link(str):
    """Text of a cell that leads to a file beside the page."""

    href: str

    def __new__(cls, text: str, href: str) -> Link:
        found = super().__new__(cls, text)
        found.href = href
        return found


@dataclass(frozen=True, slots=True)
class Table:
    """Rows of cells under a head; without one the first cell is the label of the row.

    `numbers` are the columns to be aligned to the right. A block with a text in `folded` opens on demand under it.
    `stacked`: on a narrow screen a row becomes a paragraph; `page.html.j2` names the columns of the effects in it.
    """

    rows: Sequence[Sequence[str]]
    head: Sequence[str] = ()
    numbers: Sequence[int] = ()
    folded: str = ""
    stacked: bool = False
    kind: ClassVar[str] = "table"


@dataclass(frozen=True, slots=True)
class Statements:
    """Sentences with their ratings."""

    lines: Sequence[Statement]
    folded: str = ""
    kind: ClassVar[str] = "statements"


@dataclass(frozen=True, slots=True)
class Text:
    """Text that is shown as it is."""

    text: str
    folded: str = ""
    kind: ClassVar[str] = "text"


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture in the folder, or one that `draw` writes for a page that has its pictures inside."""

    what: str
    path: Path | None = None
    draw: Callable[[Path], Path] | None = None
    folded: ClassVar[str] = ""
    kind: ClassVar[str] = "picture"

    def png(self) -> bytes:
        """Return the picture's bytes."""
        if self.path is not None:
            return self.path.read_bytes()
        assert self.draw is not None
        with tempfile.TemporaryDirectory() as place:
            return self.draw(Path(place) / "picture.png").read_bytes()


@dataclass(frozen=True, slots=True)
class Links:
    """Files beside the page, and what is in them."""

    files: Sequence[tuple[str, str]]
    folded: ClassVar[str] = ""
    kind: ClassVar[str] = "links"


Block = Table | Statements | Text | Picture | Links


class Shown(IntEnum):
    """Where a section is shown: in the terminal and everywhere, from the page in the folder on, in the report alone."""

    TERMINAL = 1
    PAGE = 2
    REPORT = 3


@dataclass(frozen=True, slots=True)
class Section:
    """Blocks under a heading."""

    heading: str
    blocks: Sequence[Block]
    shown: Shown = Shown.REPORT


@dataclass(frozen=True, slots=True)
class Report:
    """A result as people and programs read it.

    Attributes
    ----------
    title, subtitle : str
    sections : list of Section
        In their order; `add` leaves out what is empty.
    data : mapping
        What a program reads: the values of the result, by their names.
    folder : Path or None
        In which the pictures and files lie.
    reload : int
        Seconds after which a browser loads the page again; 0: never.
    closing : str
        Last line of the terminal, but with all details; default: the page to open, where there is a folder.
    """

    title: str
    subtitle: str = ""
    sections: list[Section] = field(default_factory=list)
    data: Mapping[str, Any] = field(default_factory=dict)
    folder: Path | None = None
    reload: int = 0
    closing: str = ""

    def __str__(self) -> str:
        """The text of the terminal; `emclutch.results.report.render` imports this module."""
        text: str = import_module("emclutch.results.report.render").terminal(self)
        return text

    def add(self, heading: str, blocks: Iterable[Block | None] | Block | None, shown: Shown = Shown.REPORT) -> Report:
        """Add a section, unless all its blocks are empty; return the report."""
        several = [blocks] if blocks is None or isinstance(blocks, Block) else blocks
        if kept := [one for one in several if one is not None and not _is_empty(one)]:
            self.sections.append(Section(heading, kept, shown))
        return self

    def up_to(self, shown: Shown) -> Report:
        """Return the report with the sections that are shown there; without pictures that would have to be drawn."""
        kept = [
            replace(one, blocks=[block for block in one.blocks if not isinstance(block, Picture) or block.path])
            for one in self.sections
            if one.shown <= shown
        ]
        return replace(self, sections=[one for one in kept if one.blocks])

    def statements(self) -> list[Statement]:
        """Return the statements of the terminal."""
        blocks = [block for one in self.sections if one.shown is Shown.TERMINAL for block in one.blocks]
        return [line for block in blocks if isinstance(block, Statements) for line in block.lines]


def _is_empty(block: Block) -> bool:
    content = {"table": "rows", "statements": "lines", "text": "text", "links": "files"}.get(block.kind)
    return content is not None and not getattr(block, content)
