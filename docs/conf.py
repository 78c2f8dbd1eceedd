"""Sphinx: `make docs` builds the pages of this folder into docs/_build/html, with every warning an error."""

import logging
import sys
import tomllib
from pathlib import Path

HERE = Path(__file__).resolve().parent
sys.path[:0] = [str(HERE / "extensions"), str(HERE.parent)]

project = "emclutch"
author = "The emclutch developers"
release = tomllib.loads((HERE.parent / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]
version = release

extensions = [
    "myst_parser",          # the pages are Markdown
    "sphinx.ext.autodoc",   # reference of the Python packages from their docstrings
    "sphinx.ext.napoleon",  # which are in numpy's style
    "mathml",               # the four below are in docs/extensions
    "plain_docstrings",
    "command_reference",
    "gallery",
]  # fmt: skip
exclude_patterns = ["_build", "extensions"]

myst_enable_extensions = ["dollarmath", "deflist", "colon_fence"]
myst_heading_anchors = 3

nitpicky = True
# the types in signatures are numpy's, scipy's and the standard library's; their inventories would need a network
nitpick_ignore_regex = [("py:.*", ".*")]
suppress_warnings = ["ref.python"]  # a word in a docstring's list of attributes may be the name of several

smartquotes = False  # two dashes begin an option

autodoc_typehints = "none"  # docstrings say type, shape and unit
autodoc_member_order = "alphabetical"
napoleon_google_docstring = False
napoleon_use_rtype = False

html_theme = "furo"
html_static_path = ["style"]
html_css_files = ["formulas.css"]
html_title = f"emclutch {release}"
html_math_renderer = "mathml"
html_copy_source = False
html_show_sphinx = False
html_show_copyright = False


def setup(app):
    """A pattern in the table of contents may have no page yet; Sphinx gives that warning no name to suppress it by."""
    toctree = logging.getLogger("sphinx.sphinx.directives.other")
    toctree.addFilter(lambda record: getattr(record, "subtype", None) != "empty_glob")
