"""A report as one page of HTML that needs nothing else, or as Markdown.

The HTML opens without a network, on a telephone and on paper: pictures are inside it, nothing is fetched. Text of
scenes is untrusted: every value is escaped by the templates, and the page's own policy forbids scripts and anything
from elsewhere.
"""

from __future__ import annotations

import base64
import itertools
import os
import textwrap
from pathlib import Path
from typing import Any
from urllib.parse import quote

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from emclutch import __version__
from emclutch.results import OutputError
from emclutch.results.report.content import Page, Picture

TEMPLATES = Path(__file__).parent / "templates"
CLASSES = {"on": "good", "off": "soft", "YES": "poor", "NO": "poor"}
"""Colours of cells that have these words."""


def html(page: Page) -> str:
    """Return a page of HTML with its pictures inside."""
    environment = _environment(autoescape=True)
    environment.filters["embedded"] = _embed
    return environment.get_template("report.html.j2").render(page=page, classes=CLASSES, version=__version__)


def markdown(page: Page, place: Path) -> str:
    """Return Markdown; `place` is the folder in which it will be, from which its links to pictures count."""
    environment = _environment(finalize=_escape)
    folder = Path(os.path.relpath(page.folder.resolve(), place.resolve()))
    environment.filters["link"] = lambda path: quote((folder / path.name).as_posix())
    environment.filters["code"] = lambda text: Markup(textwrap.indent(text, "    "))
    return environment.get_template("report.md.j2").render(page=page)


def write_page(page: Page, out: Path | None = None) -> Path:
    """Write a page of HTML and return its file.

    Parameters
    ----------
    out : new file; default: the next free report.html, report-1.html, ... in the folder.
    """
    if out is None:
        names = itertools.chain(["report.html"], (f"report-{number}.html" for number in itertools.count(1)))
        out = next(page.folder / name for name in names if not (page.folder / name).exists())
    return write_new(out, html(page))


def write_new(path: Path, text: str) -> Path:
    """Write a new file and return it; OutputError where there is one."""
    try:
        with open(path, "x", encoding="utf-8") as stream:
            stream.write(text)
    except FileExistsError as error:
        raise OutputError(f"{path} exists; name another file with --out") from error
    return path


def page_template(name: str) -> Template:
    """Return a template of HTML; what is put into it is escaped."""
    return _environment(autoescape=True).get_template(name)


def _environment(**options: Any) -> Environment:
    return Environment(
        loader=FileSystemLoader(TEMPLATES), undefined=StrictUndefined, trim_blocks=True, lstrip_blocks=True, **options
    )


def _embed(picture: Picture) -> str:
    return f"data:image/png;base64,{base64.b64encode(picture.png()).decode()}"


def _escape(value: Any) -> str:
    """Return a value in which Markdown finds no element, table or link: text of a scene is only shown."""
    if isinstance(value, Markup):
        return value
    text = " ".join(str(value).split())
    for mark, shown in (("&", "&amp;"), ("<", "&lt;"), ("|", "\\|"), ("](", "]\\("), ("`", "\\`")):
        text = text.replace(mark, shown)
    return text
