"""Load of the walls by the grains: pressure, shear stress and their ratio along each face."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.pictures.figure import (
    BODY_COLOURS,
    LINES,
    MM,
    OTHER_BODY,
    legend_beside,
    new_figure,
    save_picture,
)

if TYPE_CHECKING:
    from particles.diagnostics.wall_pressure import WallPressure


def wall_pressure_picture(
    path: str | Path, load: WallPressure, walls: Sequence[Any], *, title: str | None = None
) -> Path:
    """Draw pressure, shear stress and tau/P of the walls of revolution that grains touch, against z and against r.

    Walls of one bin (planes, triangles) are bars in a panel of their own.
    """
    bins = load.bins
    touched = [k for k in range(len(walls)) if load.contacts[bins.wall == k].any()]
    groups = [(along, [k for k in touched if bins.coordinate[k] == axis]) for axis, along in ((1, "z"), (0, "r"))]
    groups = [group for group in groups if group[1]]
    whole = [k for k in touched if bins.coordinate[k] < 0 and np.isfinite(load.pressure[bins.wall == k]).all()]
    rows = len(groups) + bool(whole)
    figure, axes = new_figure(12.0, 3.4 * max(rows, 1) + 0.4, title, rows=max(rows, 1), columns=3)
    grid = axes.reshape(-1, 3)
    largest = float(np.nanmax(np.abs(load.pressure), initial=0.0))
    unit, factor = ("kPa", 1e-3) if largest >= 1e3 else ("Pa", 1.0)
    for panels, (along, members) in zip(grid, groups, strict=False):
        _draw_along(panels, load, walls, members, factor)
        for panel in panels:
            panel.set_xlabel(f"{along} [mm]")
    if whole:
        names = [walls[k].name for k in whole]
        picked = np.array([int(np.flatnonzero(bins.wall == k)[0]) for k in whole])
        for panel, values in zip(grid[len(groups)], _values(load, picked, factor), strict=True):
            panel.barh(names, values, color=[BODY_COLOURS.get(walls[k].body, OTHER_BODY) for k in whole])
    for panels in grid:
        pressure = f"pressure [{unit}], mean of {load.moments} moments"
        titles = (pressure, f"shear stress [{unit}]", "|shear stress| / pressure")
        for panel, name in zip(panels, titles, strict=True):
            panel.set_title(name, loc="left", fontsize=10)
            panel.grid(alpha=0.25)
        legend_beside(panels[-1])
    return save_picture(figure, path)


def _draw_along(panels: Any, load: WallPressure, walls: Sequence[Any], members: Sequence[int], factor: float) -> None:
    styles: dict[str, int] = {}
    for k in members:
        own, body = np.flatnonzero(load.bins.wall == k), walls[k].body
        style = LINES[styles.setdefault(body, 0) % len(LINES)]
        styles[body] += 1
        edges = MM * np.append(load.bins.low[own], load.bins.high[own[-1]])
        for panel, values in zip(panels, _values(load, own, factor), strict=True):
            panel.stairs(
                values, edges, baseline=None, color=BODY_COLOURS.get(body, OTHER_BODY), ls=style, lw=1.3,
                label=walls[k].name,
            )  # fmt: skip
    panels[2].set_ylim(bottom=0.0)


def _values(load: WallPressure, own: np.ndarray, factor: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    pressure, shear = load.pressure[own], load.shear_stress[own]
    pressed = pressure > 0.02 * np.nanmax(np.abs(load.pressure))  # the ratio of two noises says nothing
    ratio = np.divide(np.abs(shear), pressure, out=np.full(len(own), np.nan), where=pressed)
    return factor * pressure, factor * shear, ratio
