"""A report as one page of HTML that needs nothing else, or as Markdown.

The HTML opens without a network, on a telephone and on paper: pictures are inside it, nothing is fetched. Text of
scenes is untrusted: every value is escaped by the templates, and the page's own policy forbids scripts and anything
from elsewhere.
"""

from __future__ import annotations

import base64
import io
import itertools
import os
import textwrap
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import quote

from jinja2 import Environment, FileSystemLoader, StrictUndefined, Template
from markupsafe import Markup

from emclutch import __version__
from emclutch.results import OutputError, Result, RunFolder
from emclutch.results.atomic_file import replace_text
from emclutch.results.report.content import Block, Links, Page, Picture, Table, run_page
from emclutch.results.report.verdict import verdict

if TYPE_CHECKING:
    import pandas

TEMPLATES = Path(__file__).parent / "templates"
CLASSES = {"on": "good", "off": "soft", "YES": "poor", "NO": "poor"}
"""Colours of cells that have these words."""


def html(page: Page, small: bool = False) -> str:
    """Return a page of HTML with its pictures inside; `small`: in fewer colours, for a file of some 300 kB."""
    environment = _environment(autoescape=True)
    environment.filters["embedded"] = (lambda one: embed_small(one.png())) if small else _embed
    return environment.get_template("report.html.j2").render(page=page, classes=CLASSES, version=__version__)


def fragment(page: Page) -> str:
    """Return a page as HTML to be shown in another one, as in a notebook."""
    environment = _environment(autoescape=True)
    environment.filters["embedded"] = lambda one: embed_small(one.png())
    return environment.get_template("fragment.html.j2").render(page=page, classes=CLASSES)


def folder_fragment(folder: Path, frame: pandas.DataFrame, units: Mapping[str, str]) -> str:
    """Return the table of a study as HTML for a notebook, with its folder; columns without a unit are pure numbers."""
    head = [f"{name} [{units[name]}]" if units.get(name) else name for name in map(str, frame.columns)]
    rows = [[f"{one:.4g}" if isinstance(one, float) else str(one) for one in row] for row in frame.to_numpy(object)]
    return fragment(Page(folder, folder.name, str(folder), {"Results": [Table(rows, head)]}))


def write_index(result: Result) -> Path:
    """Write a run's ``index.html``, the short form of its report, and the verdict into its summary; return the page."""
    folder = result.folder
    lines = [{"mark": one.mark.value, "text": one.text} for one in verdict(result)]
    folder.write_summary(result.summary | {"verdict": lines})
    replace_text(folder.index, html(run_page(result, lambda run: ()).short(), small=True))
    return folder.index


def write_failed_index(folder: RunFolder, reason: str) -> None:
    """Write that a run fails for its scene, and an ``index.html`` that says so: what, at which time, what to do."""
    folder.write_failure(reason)
    with suppress(OSError, OutputError):  # what it failed of is reported all the same
        if (found := folder.read_failure()) is not None:
            title = folder.read_scene().get("scene", {}).get("title") or folder.path.name
            sections: dict[str, list[Block]] = {"Log": [Links([(folder.log.name, "log of the run")])]}
            replace_text(folder.index, html(Page(folder.path, f"{title}: failed", found.in_words(), sections)))


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
