"""The device seen along its shaft: drum, hub, vanes and ribs where they stand, and the grains between them.

For devices whose walls are not all of revolution; `grains_picture` unrolls a thin gap.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from emclutch.results.pictures.figure import (
    BODY_COLOURS,
    MM,
    OTHER_BODY,
    colour_limits,
    draw_chains,
    draw_circles,
    new_figure,
    save_picture,
)


def axial_picture(
    path: str | Path,
    position: np.ndarray,
    radius: np.ndarray,
    colour: np.ndarray,
    *,
    colour_label: str = "speed [m/s]",
    walls: Sequence[Any] = (),
    angles: Mapping[str, float] | None = None,
    chains: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
    title: str | None = None,
) -> Path:
    """Draw the projection along z, the grains at greater z over the others.

    Parameters
    ----------
    path : PNG to write.
    position, radius : (n, 3), (n,) [m].
    colour : (n,) what the grains are coloured by.
    walls : revolved walls (with `start`, `end`) as circles, triangle walls (with `vertices`, `triangles`) as solids.
    angles : angle of each body [rad]; default: 0.
    chains : start (k, 3), end (k, 3) [m] and force (k,) [N] of the contacts.
    """
    from matplotlib.collections import PolyCollection
    from matplotlib.lines import Line2D

    figure, (axis,) = new_figure(7.6, 6.6, title, subplot_kw={"aspect": "equal"})
    reach = [float(np.max(np.hypot(position[:, 0], position[:, 1]) + radius, initial=0.0))]
    order = np.argsort(position[:, 2], kind="stable")
    x, y, values = position[order, 0], position[order, 1], np.asarray(colour, dtype=np.float64)[order]
    grains = draw_circles(axis, x, y, radius[order], array=values, clim=colour_limits(values))
    for wall in walls:
        shade = BODY_COLOURS.get(wall.body, OTHER_BODY)
        if hasattr(wall, "triangles"):
            turn = (angles or {}).get(wall.body, 0.0)
            c, s = np.cos(turn), np.sin(turn)
            corners = wall.vertices[wall.triangles][..., :2] @ np.array([[c, s], [-s, c]])
            axis.add_collection(PolyCollection(list(MM * corners), facecolors=shade, edgecolors=shade, linewidths=0.3))
        elif hasattr(wall, "start") and wall.start[0] == wall.end[0]:
            r = wall.start[0]
            theta = np.linspace(0.0, 2.0 * np.pi, 361)
            axis.plot(MM * r * np.cos(theta), MM * r * np.sin(theta), color=shade, lw=2.0)
            reach.append(r)
    if chains is not None and np.any(chains[2]):
        draw_chains(axis, chains[0][:, :2], chains[1][:, :2], chains[2])
    handles = [Line2D([], [], color=BODY_COLOURS.get(body, OTHER_BODY), lw=2.0, label=body)
               for body in dict.fromkeys(wall.body for wall in walls)]  # fmt: skip
    if handles:
        axis.legend(handles=handles, loc="upper left", bbox_to_anchor=(0.0, -0.1), ncols=4, frameon=False, fontsize=9)
    limit = 1.04 * MM * (max(reach) or 1e-3)
    axis.set(xlim=(-limit, limit), ylim=(-limit, limit), xlabel="x [mm]", ylabel="y [mm]")
    figure.colorbar(grains, ax=axis, label=colour_label, shrink=0.8)
    return save_picture(figure, path)
