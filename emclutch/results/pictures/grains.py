"""The grains as an engineer wants to see them: unrolled along the gap, and in the (r, z) plane.

A cyclic sector of a thin gap is a narrow curved strip; unrolled, with R0 theta to the right, shear and
chains are seen at once. Chains are the contacts, drawn as wide as their force.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.pictures.figure import (
    BODY_COLOURS,
    MM,
    OTHER_BODY,
    STRONGEST,
    colour_limits,
    draw_chains,
    draw_circles,
    label_panel,
    new_figure,
    save_picture,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

PAGE_WIDTH, PAGE_HEIGHT = 9.0, 7.0  # of the panels together, at most [in]
THINNEST = 0.06  # height over width of the unrolled view, at least
FINE = 3000  # grains: of more in a panel no edges are drawn


def grains_picture(
    path: str | Path,
    position: np.ndarray,
    radius: np.ndarray,
    colour: np.ndarray,
    *,
    walls: Sequence[Any] = (),
    chains: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None,
    sector_angle: float | None = None,
    title: str | None = None,
) -> Path:
    """Draw the unrolled gap and the meridional projection, below or next to each other, whichever fills the page.

    Up in the unrolled view is the coordinate across the gap in which disc and rotor enclose more grains; without such
    walls, the one in which the grains spread less. It shows the layer of two diameters that carries most (without
    chains: holds most grains), or all where that holds fewer than 20 grains.

    Parameters
    ----------
    path : PNG to write.
    position : (n, 3) [m]; z is the shaft's axis.
    radius : (n,) [m].
    colour : (n,) speed [m/s].
    walls : revolved walls with `body`, `start`, `end` (r, z) [m]; others are left out.
    chains : start (k, 3), end (k, 3) [m] and force (k,) [N] of the contacts.
    sector_angle : of the cyclic sector [rad]; its faces are marked.
    """
    from matplotlib.lines import Line2D

    position, radius, colour = np.asarray(position), np.asarray(radius), np.asarray(colour, dtype=np.float64)
    r, theta, z = np.hypot(position[:, 0], position[:, 1]), _azimuth(position), position[:, 2]
    outlines = [wall for wall in walls if hasattr(wall, "start")]
    gaps = _gaps(r, z, outlines)
    across = _across(gaps, r, z)
    up, other = (r, z) if across == "r" else (z, r)
    # Of gaps beside each other, as at both faces of a disc, the one with most grains: what is between them is empty.
    chosen = max(gaps.get(across, []), key=np.count_nonzero, default=np.ones(len(r), dtype=bool))
    shown = chosen if across == "z" else np.ones(len(r), dtype=bool)
    reference = float(np.median(r)) if len(r) else 1.0
    layer = _loaded_layer(other[shown], radius[shown], chains, across)
    drawn = (other >= layer[0]) & (other <= layer[1]) & shown

    views = (
        _view(reference * theta[drawn], up[drawn], radius[drawn]),
        _view(other[shown], up[shown], radius[shown]),
    )
    part = (views[0][3] - views[0][2]) < THINNEST * (views[0][1] - views[0][0])
    if part:  # a whole turn would be a hair's breadth high: show its beginning
        x0, _, y0, y1 = views[0]
        views = ((x0, x0 + (y1 - y0) / THINNEST, y0, y1), views[1])
    figure, unrolled, plane = _panels(views, title)
    limits = colour_limits(colour, STRONGEST)
    style = {"clim": limits, "linewidths": 0.3 if len(r) < FINE else 0.0}
    draw_circles(unrolled, reference * theta[drawn], up[drawn], radius[drawn], array=colour[drawn], **style)
    order = np.argsort(theta)  # the meridional view looks along the azimuth: near grains over far ones
    order = order[shown[order]]
    circles = draw_circles(plane, other[order], up[order], radius[order], array=colour[order], **style)
    has_chains = chains is not None and _draw_chains(unrolled, chains, across, layer, reference, sector_angle)

    for body in dict.fromkeys(wall.body for wall in outlines):
        own = [wall for wall in outlines if wall.body == body]
        _draw_meridional_walls(plane, own, body, across)
        _draw_unrolled_walls(unrolled, own, body, across, layer)
    if sector_angle is not None:
        for face in (0.0, reference * sector_angle):
            unrolled.axvline(MM * face, color="black", lw=0.8, ls="--")
    between = "z" if across == "r" else "r"
    of_turn = " (part of the turn)" if part else ""
    unrolled.set(xlabel=f"R0·θ [mm], R0 = {MM * reference:.4g} mm{of_turn}", ylabel=f"{across} [mm]")
    where = f"{between} = {MM * layer[0]:.3g} … {MM * layer[1]:.3g} mm"
    label_panel(unrolled, f"unrolled: {np.count_nonzero(drawn)} of {len(r)} grains,\n{where}")
    plane.set(xlabel=f"{between} [mm]", ylabel=f"{across} [mm]")
    count = f"all {len(r)}" if shown.all() else f"{np.count_nonzero(shown)} of {len(r)}"
    label_panel(plane, f"{count} grains{'' if shown.all() else ', one of the gaps,'}\nin the (r, z) plane")
    handles, labels = plane.get_legend_handles_labels()
    if has_chains:
        handles.append(Line2D([], [], color="crimson", lw=2.0))
        labels.append("force chain, width ~ force")
    if sector_angle is not None:
        handles.append(Line2D([], [], color="black", lw=0.8, ls="--"))
        labels.append("edges of the sector, which repeats")
    if handles:
        figure.legend(handles, labels, loc="outside lower left", ncols=4, frameon=False, fontsize=9)
    extend = "max" if np.max(colour, initial=limits[1]) > limits[1] else "neither"
    figure.colorbar(circles, ax=[unrolled, plane], label="speed [m/s]", shrink=0.8, extend=extend)
    return save_picture(figure, path)


def _is_level(wall: Any, up: int) -> bool:
    """True if a revolved wall keeps its coordinate `up` (0: r, 1: z)."""
    return abs(wall.start[up] - wall.end[up]) <= 1e-9 + 1e-6 * abs(wall.start[up])


def _gaps(r: np.ndarray, z: np.ndarray, walls: Sequence[Any]) -> dict[str, list[np.ndarray]]:
    """Return which grains are in each gap, by the coordinate across it: a wall of the disc faces one of the rotor."""
    found: dict[str, dict[tuple[float, ...], np.ndarray]] = {}
    for name, up, along in (("r", 0, 1), ("z", 1, 0)):
        discs, rotors = ([w for w in walls if w.body == body and _is_level(w, up)] for body in ("disc", "rotor"))
        for pair in product(discs, rotors):
            low = max(min(wall.start[along], wall.end[along]) for wall in pair)
            high = min(max(wall.start[along], wall.end[along]) for wall in pair)
            if low < high:
                bottom, top = sorted(wall.start[up] for wall in pair)
                height, place = (r, z)[up], (r, z)[along]
                inside = (height >= bottom) & (height <= top) & (place >= low) & (place <= high)
                known = found.setdefault(name, {})
                known[bottom, top] = known.get((bottom, top), False) | inside
    return {name: list(known.values()) for name, known in found.items()}


def _across(gaps: dict[str, list[np.ndarray]], r: np.ndarray, z: np.ndarray) -> str:
    """Return the coordinate across the gaps with more grains; without gaps, that in which the grains spread less."""
    if gaps:
        return max(gaps, key=lambda name: np.count_nonzero(np.any(gaps[name], axis=0)))
    return "z" if len(r) and np.ptp(z) < np.ptp(r) else "r"


def _view(x: np.ndarray, y: np.ndarray, radius: np.ndarray) -> tuple[float, float, float, float]:
    """Limits x0, x1, y0, y1 [m] around the grains."""
    if not len(x):
        return 0.0, 1e-3, 0.0, 1e-3
    edge = 1.5 * float(radius.max())
    return float(x.min()) - edge, float(x.max()) + edge, float(y.min()) - edge, float(y.max()) + edge


def _panels(views: Sequence[tuple[float, float, float, float]], title: str | None) -> tuple[Figure, Axes, Axes]:
    """Return a figure with two panels true to scale, below or next to each other, whichever makes them larger."""
    aspects = [(y1 - y0) / (x1 - x0) for x0, x1, y0, y1 in views]
    stretch = sum(1.0 / a for a in aspects)
    width = min(PAGE_WIDTH, PAGE_HEIGHT / sum(aspects))  # of panels in rows
    height = min(0.75 * PAGE_HEIGHT, PAGE_WIDTH / stretch)  # of panels next to each other
    beside = height**2 * stretch > width**2 * sum(aspects)
    figure, panels = new_figure(
        max(6.5, (height * stretch if beside else width) + 2.5),
        (height if beside else width * sum(aspects) + 1.0) + 2.0,
        title,
        rows=1 if beside else 2,
        columns=2 if beside else 1,
        layout="compressed",
        width_ratios=[1.0 / a for a in aspects] if beside else None,
        height_ratios=None if beside else aspects,
    )
    for axis, (x0, x1, y0, y1) in zip(panels, views, strict=True):
        axis.set(xlim=(MM * x0, MM * x1), ylim=(MM * y0, MM * y1), aspect="equal")
        broad = height * (x1 - x0) / (y1 - y0) if beside else width
        axis.locator_params(axis="x", nbins=max(3, int(1.7 * broad)))
    return figure, panels[0], panels[1]


def _azimuth(position: np.ndarray) -> np.ndarray:
    """Azimuth in [0, 2 pi): sectors start at 0. A grain just below the sector's first face stays there."""
    theta = np.mod(np.arctan2(position[:, 1], position[:, 0]), 2.0 * np.pi)
    if len(theta) and theta.max() > 1.9 * np.pi and np.median(theta) < 0.9 * np.pi:
        theta = np.where(theta > 1.9 * np.pi, theta - 2.0 * np.pi, theta)
    return theta


def _loaded_layer(
    other: np.ndarray,
    radius: np.ndarray,
    chains: tuple[np.ndarray, np.ndarray, np.ndarray] | None,
    across: str,
) -> tuple[float, float]:
    """Limits of the layer whose contacts carry most in sum; without contacts, of that with most grains."""
    if not len(other):
        return 0.0, 0.0
    half = 2.0 * float(radius.max())
    where, weight = other, np.ones(len(other))
    if chains is not None and np.any(chains[2]):
        start = np.asarray(chains[0])
        where = start[:, 2] if across == "r" else np.hypot(start[:, 0], start[:, 1])
        weight = np.abs(chains[2])
    bins = max(1, min(50, int(np.ptp(other) / half)))
    load, edges = np.histogram(where, bins=bins, range=(other.min(), other.max()), weights=weight)
    best = int(np.argmax(load))
    middle = 0.5 * float(edges[best] + edges[best + 1])
    low, high = middle - half, middle + half
    if np.count_nonzero((other >= low) & (other <= high)) < min(20, len(other)):
        return float(other.min()), float(other.max())
    return low, high


def _draw_chains(
    axis: Axes,
    chains: tuple[np.ndarray, np.ndarray, np.ndarray],
    across: str,
    layer: tuple[float, float],
    reference: float,
    sector_angle: float | None,
) -> bool:
    """Draw the contacts inside the layer; False where there are none."""
    ends, inside = [], np.ones(len(chains[2]), dtype=bool)
    for point in (np.asarray(chains[0]), np.asarray(chains[1])):
        r, z = np.hypot(point[:, 0], point[:, 1]), point[:, 2]
        up, other = (r, z) if across == "r" else (z, r)
        inside &= (other >= layer[0]) & (other <= layer[1])
        ends.append([_azimuth(point), up])
    # A contact through the sector's faces joins a grain with the image of another: keep the short connection.
    period = 2.0 * np.pi if sector_angle is None else sector_angle
    ends[1][0] = ends[1][0] - period * np.round((ends[1][0] - ends[0][0]) / period)
    a, b = (np.column_stack([reference * theta, up]) for theta, up in ends)
    if not inside.any():
        return False
    draw_chains(axis, a[inside], b[inside], chains[2][inside])
    return True


def _draw_meridional_walls(axis: Axes, walls: Sequence[Any], body: str, across: str) -> None:
    colour = BODY_COLOURS.get(body, OTHER_BODY)
    for number, wall in enumerate(walls):
        (r0, z0), (r1, z1) = wall.start, wall.end
        label = body if number == 0 else None
        right, up = ((z0, z1), (r0, r1)) if across == "r" else ((r0, r1), (z0, z1))
        axis.plot(
            MM * np.array(right), MM * np.array(up), color=colour, lw=2.0, label=label, scalex=False, scaley=False
        )


def _draw_unrolled_walls(axis: Axes, walls: Sequence[Any], body: str, across: str, layer: tuple[float, float]) -> None:
    """A wall along the gap that passes through the layer is a horizontal line."""
    for wall in walls:
        up, other = (0, 1) if across == "r" else (1, 0)
        low, high = sorted((wall.start[other], wall.end[other]))
        if _is_level(wall, up) and low < high and high >= layer[0] and low <= layer[1]:
            axis.axhline(MM * wall.start[up], color=BODY_COLOURS.get(body, OTHER_BODY), lw=2.0)
