"""A drawing of a shape with the keys and values of its dimensions (`geometry.dimensioned_views`)."""

from __future__ import annotations

import io
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.dimensioned_views import Dimension, View
from geometry.drawing import part_colours

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_HEIGHT = 7.0
_LINE: dict[str, Any] = {"color": "#202020", "linewidth": 0.8}
_FONT = 8.5
_TEXT: dict[str, Any] = {
    "fontsize": _FONT,
    "va": "center",
    "bbox": {"facecolor": "white", "edgecolor": "none", "pad": 0.6},
}
_LETTER = 0.6 * _FONT / 72.0 / (_HEIGHT - 1.0)
"""Width of a letter over the height of the view."""
_ARROW = 0.025
"""Length of an arrow outside of a short dimension, over the height of the view."""


def draw_dimensions(views: Sequence[View], title: str, *, dpi: int = 150) -> bytes:
    """Return a PNG with the views side by side: parts in colour, and lines of the dimensions with key and value."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.patches import Patch

    colours = part_colours(dict.fromkeys(name for view in views for name, _ in view.parts))
    frames = [_frame(view) for view in views]
    shapes = [float(np.divide(*np.ptp(frame, axis=0))) for frame in frames]
    figure = Figure(figsize=(max(6.5, sum(shapes) * (_HEIGHT - 1.0) + 2.0), _HEIGHT), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(views), squeeze=False, width_ratios=shapes)[0]
    for panel, view, (low, high) in zip(panels, views, frames, strict=True):
        panel.set(xlim=(low[0], high[0]), ylim=(low[1], high[1]), aspect="equal")
        panel.set_title(view.title, fontsize="medium", loc="left")
        panel.set(xlabel=view.x_label, ylabel=view.y_label, xticks=[], yticks=[])
        for name, outline in view.parts:
            panel.fill(*outline.T, facecolor=colours[name], edgecolor="#303030", linewidth=0.6)
        if view.y_label == "r":
            panel.axhline(0.0, color="#202020", linewidth=0.8, linestyle=(0, (12, 4, 2, 4)))
        for one in view.dimensions:
            _draw(panel, one, float(high[1] - low[1]))
        for text, at, stands in view.notes:
            panel.annotate(text, at, stands, **_TEXT, ha="center", arrowprops={"arrowstyle": "->", **_LINE})
    patches = [Patch(facecolor=colour, edgecolor="#303030", label=name.replace("_", " "))
               for name, colour in colours.items()]  # fmt: skip
    figure.legend(handles=patches, loc="outside right upper")
    figure.suptitle(title, x=0.01, ha="left")
    drawn = io.BytesIO()
    figure.savefig(drawn, format="png", dpi=dpi)
    return drawn.getvalue()


def _frame(view: View) -> np.ndarray:
    """Lower left and upper right corner [m], shape (2, 2), with room for what is written."""
    points = [outline for _, outline in view.parts] + [np.array(one.ends()) for one in view.dimensions]
    points += [np.array([stands]) for _, _, stands in view.notes]
    low, high = np.vstack(points).min(axis=0), np.vstack(points).max(axis=0)
    room = 0.05 * (high - low).max()
    height = float(high[1] - low[1]) + 2.0 * room
    left, right = [low[0]], [high[0]]
    for one in view.dimensions:
        x, _, ha, turned = _text_place(one, height)
        width = 0.0 if turned else len(one.text) * _LETTER * height
        left.append(x - width * {"left": 0.0, "center": 0.5, "right": 1.0}[ha])
        right.append(left[-1] + width)
    for text, _, (x, _) in view.notes:
        width = 0.5 * max(map(len, text.split("\n"))) * _LETTER * height
        left.append(x - width)
        right.append(x + width)
    return np.array([(min(left) - room, low[1] - room), (max(right) + room, high[1] + room)])


def _text_place(one: Dimension, height: float) -> tuple[float, float, str, bool]:
    """Where a dimension's text stands [m] in a view of a height [m], its alignment, and whether it is turned."""
    ends, arrow, width = np.array(one.ends()), _ARROW * height, len(one.text) * _LETTER * height
    length, (x, y) = float(np.linalg.norm(ends[1] - ends[0])), ends.mean(axis=0)
    if not one.along_x:
        is_left = one.line < min(one.start[0], one.end[0])
        return x + (-0.4 if is_left else 0.4) * arrow, y, "right" if is_left else "left", is_left and length > width
    if length > 1.2 * width:
        return x, y, "center", False
    return ends[:, 0].max() + (2.0 if length < 1.2 * arrow else 0.4) * arrow, y, "left", False


def _draw(panel: Axes, one: Dimension, height: float) -> None:
    """Draw extension lines, the line with its arrows, inside or, where it is short, from outside, and the text."""
    ends, arrow = np.array(one.ends()), _ARROW * height
    for point, end in zip((one.start, one.end), ends, strict=True):
        panel.plot(*np.array([point, end]).T, color="#606060", linewidth=0.5)
    length = float(np.linalg.norm(ends[1] - ends[0]))
    along, middle = (ends[1] - ends[0]) / length, ends.mean(axis=0)
    style: dict[str, Any] = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "mutation_scale": 7, **_LINE}
    is_short = length < 1.2 * arrow
    for tip, way in zip(ends, (-along, along), strict=True):
        panel.annotate("", tip, tip + way * 1.6 * arrow if is_short else middle, arrowprops=style)
    x, y, ha, turned = _text_place(one, height)
    panel.text(x, y, one.text, rotation=90 if turned else 0, ha=ha, **_TEXT)
