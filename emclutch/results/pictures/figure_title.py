"""Titles of figures that are laid out by hand, and legends that hide nothing."""

from __future__ import annotations

import textwrap
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LETTERS = 11.5  # to the inch, at 11 points
LINE = 0.2  # inches, of a line of the title


def title_lines(title: str | None, width: float) -> list[str]:
    """The lines of a title on a figure `width` [in] wide; its own line breaks are kept."""
    return [line for part in (title or "").split("\n") for line in textwrap.wrap(part, int(LETTERS * (width - 0.4)))]


def write_title(figure: Figure, lines: list[str]) -> None:
    """Write lines into the upper left corner; what looks like a formula is none."""
    if lines:
        width, height = figure.get_size_inches()
        text = figure.text(0.15 / width, 1.0 - 0.1 / height, "\n".join(lines), va="top", fontsize=11, fontweight="bold")
        text.set_parse_math(False)


def legend_beside(axis: Axes, *, away: float = 1.0, handles: Any = None, labels: Any = None) -> None:
    """A legend to the right of a panel, of what is drawn in it or of `handles` with their `labels`.

    `away`: where it begins, in widths of the panel. Nothing where nothing has a label.
    """
    if handles is None:
        handles, labels = axis.get_legend_handles_labels()
    if handles:
        axis.legend(
            handles=handles, labels=labels, loc="upper left", bbox_to_anchor=(away, 1.0), frameon=False, fontsize=9
        )


def legend_below(axis: Axes, columns: int = 1) -> None:
    """A legend below a panel and the name of its axis."""
    if axis.get_legend_handles_labels()[0]:
        axis.legend(
            loc="upper left", bbox_to_anchor=(0.0, -0.14), frameon=False, fontsize=9, ncols=columns, borderaxespad=0.0
        )
