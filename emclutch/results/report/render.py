"""A report as lines of the terminal, as one page of HTML that needs nothing else, or as Markdown.

The HTML opens without a network, on a telephone and on paper: pictures are inside it, nothing is fetched. Text of
scenes is untrusted: every value is escaped by the templates, and the page's own policy forbids scripts and anything
from elsewhere. A result that prints itself is a `Reported`.
"""

from __future__ import annotations

import base64
import datetime
import io
import itertools
import os
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Sequence
from html import escape as escape_html
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from markupsafe import Markup

from emclutch import __version__
from emclutch.results.atomic_file import replace_text
from emclutch.results.errors import OutputError
from emclutch.results.report.report import Picture, Report, Shown, Statements, Table, Text
from emclutch.results.run_folder import INDEX

if TYPE_CHECKING:
    from jinja2 import Environment

TEMPLATES = Path(__file__).parent / "templates"
MAX_WIDTH = 120
CLASSES = {"on": "good", "off": "soft", "YES": "poor", "not converged": "poor", "failed": "poor"}
"""Colours of cells that have these words."""


def terminal(report: Report, details: bool = False) -> str:
    """Return a report as text for the terminal: the sections for it, with `details` all; the page to open comes last.

    A note follows the statement above it, so that it is indented and has no sign. With `details` there is no closing
    line, which says where the details are.
    """
    lines: list[str] = []
    for section in report.sections if details else report.up_to(Shown.TERMINAL).sections:
        for block in section.blocks:
            if isinstance(block, Statements):
                lines += [f"{one.mark.sign} {one.text}" for one in block.lines]
            elif isinstance(block, Table):
                title = block.folded or (section.heading if details else "")
                lines += [*([title] if title else []), *table_lines(block)]
            elif isinstance(block, Text):
                lines += block.text.splitlines()
    page = "" if report.folder is None else f"Page: {report.folder / INDEX}"
    return "\n".join(filter(None, [*lines, page if details else report.closing or page]))


def table_lines(table: Table) -> list[str]:
    """Return a table as lines of the terminal's width; wider ones where words and numbers would be broken.

    A row of a `stacked` table is a paragraph: its first two cells are the label, the last one has lines of its own.
    """
    from rich import box  # local: rich takes a while to import
    from rich.console import Console
    from rich.markup import escape
    from rich.measure import Measurement
    from rich.table import Table as Grid

    if table.stacked:
        return table_lines(Table([_paragraph(table.head, row) for row in table.rows]))
    grid = Grid(box=box.SIMPLE_HEAD, show_header=bool(table.head), pad_edge=False, show_edge=False)
    for number, name in enumerate(table.head or table.rows[0]):
        is_number = number in table.numbers
        words = " ".join([name, *(str(row[number]) for row in table.rows)]).split() if is_number else [""]
        least = max(map(len, words))
        grid.add_column(escape(name), justify="right" if is_number else "left", overflow="fold", min_width=least)
    for row in table.rows:
        grid.add_row(*(escape(str(cell)) for cell in row))
    stream = io.StringIO()
    widest = Console(width=MAX_WIDTH)
    width = max(Console().width, Measurement.get(widest, widest.options, grid).minimum)
    Console(file=stream, width=width, no_color=True).print(grid, crop=False)
    return [line.rstrip() for line in stream.getvalue().rstrip().splitlines()]


def _paragraph(head: Sequence[str], row: Sequence[str]) -> tuple[str, str]:
    """Return the label and the lines of a row of a stacked table; empty cells are left out."""
    name, state, what, *middle, last = row
    named = "; ".join(f"{label.rstrip('?')}: {cell}" for label, cell in zip(head[3:-1], middle, strict=True) if cell)
    return f"{name}: {state}", "\n".join(filter(None, (what, named, last)))


def html(report: Report, small: bool = False) -> str:
    """Return a page of HTML with its pictures inside; `small`: in fewer colours, for a file of some 300 kB."""
    environment = _environment(autoescape=True)
    environment.filters["embedded"] = (lambda one: embed_small(one.png())) if small else _embed
    written = datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M:%S")
    template = environment.get_template("page.html.j2")
    return template.render(page=report, classes=CLASSES, version=__version__, written=written)


def fragment(report: Report) -> str:
    """Return a report as HTML to be shown in another page, as in a notebook."""
    environment = _environment(autoescape=True)
    environment.filters["embedded"] = lambda one: embed_small(one.png())
    return environment.get_template("fragment.html.j2").render(page=report, classes=CLASSES)


class Reported(ABC):
    """Base of a result that prints itself: `report` is what `emclutch` prints, writes and shows in a notebook."""

    @abstractmethod
    def report(self) -> Report:
        """Return the report on the result."""

    def __repr__(self) -> str:
        """One line: the first statement of the report, which has the main result with its unit."""
        main = self.report().statements()[0].text.rstrip(".")
        return f"<{type(self).__name__}: {main}>"

    def _repr_html_(self) -> str:
        try:
            return fragment(self.report().up_to(Shown.PAGE))
        except OutputError as error:  # a notebook shows the object all the same
            return f"<p>{escape_html(str(error))}</p>"


def markdown(report: Report, place: Path) -> str:
    """Return Markdown; `place` is the folder in which it will be, from which its links to pictures count."""
    environment = _environment(finalize=_escape)
    folder = Path(os.path.relpath((report.folder or place).resolve(), place.resolve()))
    environment.filters["link"] = lambda path: quote((folder / path.name).as_posix())
    environment.filters["code"] = lambda text: Markup(textwrap.indent(text, "    "))
    return environment.get_template("page.md.j2").render(page=report)


def write_page(report: Report, out: Path | None = None) -> Path:
    """Write a page of HTML and return its file.

    Parameters
    ----------
    out : new file; default: the next free report.html, report-1.html, ... in the folder.
    """
    if out is None:
        folder = report.folder or Path()
        names = itertools.chain(["report.html"], (f"report-{number}.html" for number in itertools.count(1)))
        out = next(folder / name for name in names if not (folder / name).exists())
    return write_new(out, html(report))


def write_index(report: Report) -> Path:
    """Write the page of a report, ``index.html``, into its folder in one step, and return it."""
    assert report.folder is not None
    path = report.folder / INDEX
    replace_text(path, html(report.up_to(Shown.PAGE), small=True))
    return path


def write_new(path: Path, text: str) -> Path:
    """Write a new file and return it; OutputError where there is one."""
    try:
        with open(path, "x", encoding="utf-8") as stream:
            stream.write(text)
    except FileExistsError as error:
        raise OutputError(f"{path} exists; name another file with --out") from error
    return path


def _environment(**options: Any) -> Environment:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined  # local: the terminal needs no templates

    return Environment(
        loader=FileSystemLoader(TEMPLATES), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, **options
    )


def _embed(picture: Picture) -> str:
    return f"data:image/png;base64,{base64.b64encode(picture.png()).decode()}"


def embed_small(png: bytes) -> str:
    """Return a picture as an address that holds it, at most 1400 pixels wide, in 128 colours: a fifth of the bytes."""
    from PIL import Image  # local: pages without pictures do not need it

    image = Image.open(io.BytesIO(png)).convert("RGB")
    image.thumbnail((1400, 1400))
    content = io.BytesIO()
    image.quantize(128, Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE).save(content, "png")
    return f"data:image/png;base64,{base64.b64encode(content.getvalue()).decode()}"


def _escape(value: Any) -> str:
    """Return a value in which Markdown finds no element, table or link: text of a scene is only shown."""
    if isinstance(value, Markup):
        return value
    text = " ".join(str(value).split())
    for mark, shown in (("&", "&amp;"), ("<", "&lt;"), ("|", "\\|"), ("](", "]\\("), ("`", "\\`")):
        text = text.replace(mark, shown)
    return text
