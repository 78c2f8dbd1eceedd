"""Cross-section with |B| in colour, flux lines, region outlines, and the gap with its grains enlarged."""

from __future__ import annotations

import math
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.pictures.figure import MM, draw_circles, label_panel, new_figure, save_picture
from emclutch.results.text import in_words

if TYPE_CHECKING:
    from collections.abc import Sequence

    from matplotlib.axes import Axes

    from field.section.smooth_field import SmoothField
    from geometry import AnnularBox

SMALL_TRIANGLES = 30_000  # to draw in a panel: a quarter of a second
FLUX_LINES = 16
SMALLEST_NAMED = 0.006  # of the area of a panel
NAME_SIZE = 10  # [pt]
NAME_ROOM = 5.0  # [pixels] around a name: closer ones read as one word
PARTS = (2, 16)  # of an element's edge, at least and at most


def section_picture(
    path: str | Path,
    field: SmoothField,
    *,
    grains: np.ndarray | None = None,
    filled: Sequence[AnnularBox] = (),
    title: str | None = None,
) -> Path:
    """Draw the field in the (r, z) half-plane, and the powder where |B| is largest once more, enlarged.

    The axis lies at the bottom, r points up.

    Parameters
    ----------
    path : PNG to write.
    field : on a section with `points` (n, 2) r, z [m], `triangles` (k, 3) and `regions` by name.
    grains : (m, 3) r, z, radius [m] of the grains to draw: those near one half-plane show a slice.
    filled : the parts of the powder's region that are filled: the enlarged part lies in the one with the largest |B|.
    title : may have several lines.
    """

    mesh = field.elements.mesh
    points, triangles = np.asarray(mesh.points), np.asarray(mesh.triangles)
    magnitude = field.central_magnitude()
    solid = [elements for name, elements in mesh.regions.items() if name != "air"]
    device = points[triangles[np.concatenate(solid)]].reshape(-1, 2) if solid else points
    (r0, z0), (r1, z1) = device.min(axis=0), device.max(axis=0)
    zoom = None
    if len(mesh.regions.get("powder", ())):
        powder = mesh.regions["powder"]
        centres = points[triangles[powder]].mean(axis=1)
        part = _strongest_part(centres, magnitude[powder], filled)
        there = grains
        if part is not None:
            powder = powder[_inside(centres, part)]
            there = None if grains is None else grains[_inside(grains, part)]
        zoom = _gap_window(points, triangles, powder, magnitude, there)

    margin = 0.08 * max(r1 - r0, z1 - z0)
    bottom = max(0.0, r0 - margin)
    windows = [(bottom, r1 + margin, z0 - margin, z1 + margin)] + ([zoom] if zoom else [])
    # Panels of one height, each as wide as what it shows: else an equal aspect leaves a narrow device in a blank slot.
    widths = [(high - low) / (outer - inner) for inner, outer, low, high in windows]
    # Small, so that its texts can be read where it is shown 600 pixels wide.
    height = float(np.clip(6.5 / sum(widths), 2.4, 4.0))
    figure, axes = new_figure(
        height * sum(widths) + 2.2, height + 1.6, title, columns=len(windows), layout="compressed", width_ratios=widths
    )
    r, z = points[triangles].mean(axis=1).T
    inside = (r >= r0) & (r <= r1) & (z >= z0) & (z <= z1)
    # The 99.5th percentile, not the largest: iron corners are singular and would darken all the rest.
    top = float(np.percentile(magnitude[inside], 99.5)) or 1.0
    levels = flux_levels(field, FLUX_LINES)
    for axis, window in zip(axes, windows, strict=True):
        colours = _draw_field(axis, field, window, levels, top)
        axis.set(xlabel="z [mm]", aspect="equal")
        axis.set(xlim=(MM * window[2], MM * window[3]), ylim=(MM * window[0], MM * window[1]))
    draw_outlines(axes[0], mesh, "black", 0.7)
    axes[0].set_ylabel("r [mm]")
    if len(levels):
        flux = 2.0 * math.pi * (levels[1] - levels[0])
        label_panel(axes[0], f"white: flux lines,\n{1e6 * flux:.3g} µWb between them")
    if zoom:
        draw_outlines(axes[1], mesh, "black", 1.2)
        _draw_zoom(axes[1], axes[0], zoom, grains)
    figure.colorbar(colours, ax=list(axes), label="|B| [T]", extend="max", shrink=0.9)
    figure.draw_without_rendering()  # lays out the panels
    for axis, window in zip(axes, windows, strict=True):
        _names_beside(axis, _region_names(axis, mesh, window))
    return save_picture(figure, path)


def flux_levels(field: SmoothField, count: int) -> np.ndarray:
    """psi [Wb/rad] of the flux lines, (count,), evenly: equal flux between neighbours; none without a field."""
    low, high = field.range
    return np.linspace(low, high, count + 2)[1:-1] if high > low else np.empty(0)


def _draw_field(
    axis: Axes, field: SmoothField, window: tuple[float, float, float, float], levels: np.ndarray, top: float
) -> Any:
    """|B| in colour, up to `top` [T], and the flux lines in r0, r1, z0, z1 [m]; the colours are returned."""
    from matplotlib.patheffects import withStroke
    from matplotlib.tri import Triangulation

    mesh = field.elements.mesh
    corners = np.asarray(mesh.points)[mesh.triangles]
    low, high = corners.min(axis=1), corners.max(axis=1)
    r0, r1, z0, z1 = window
    shown = np.flatnonzero((high[:, 0] >= r0) & (low[:, 0] <= r1) & (high[:, 1] >= z0) & (low[:, 1] <= z1))
    parts = int(np.clip(math.sqrt(SMALL_TRIANGLES / max(1, len(shown))), *PARTS))
    fine = field.subdivide(shown, parts)
    half_plane = Triangulation(MM * fine.points[:, 1], MM * fine.points[:, 0], fine.triangles)
    magnitude = np.linalg.norm(fine.B, axis=1)
    colours = axis.tripcolor(
        half_plane, magnitude, cmap="viridis", vmin=0.0, vmax=top, shading="gouraud", rasterized=True
    )
    if len(levels):
        lines = axis.tricontour(half_plane, fine.psi, levels=levels, colors="white", linewidths=0.6, alpha=0.9)
        lines.set(path_effects=[withStroke(linewidth=1.2, foreground="#00000070")])  # white is not seen on yellow
    return colours


def _draw_zoom(
    axis: Axes,
    whole: Axes,
    zoom: tuple[float, float, float, float],
    grains: np.ndarray | None,
) -> None:
    from matplotlib.patches import Rectangle

    r0, r1, z0, z1 = zoom
    has_grains = grains is not None and len(grains) > 0
    if grains is not None and has_grains:
        r, z, radius = np.asarray(grains).T
        draw_circles(axis, z, r, radius, facecolors="#d9d2c5", linewidths=0.5)
    label_panel(axis, f"{'slice through the grains' if has_grains else 'powder gap'}, enlarged")
    frame = Rectangle((MM * z0, MM * r0), MM * (z1 - z0), MM * (r1 - r0), fill=False, ec="crimson", lw=1.2)
    whole.add_patch(frame)
    for spine in axis.spines.values():
        spine.set_edgecolor("crimson")


def draw_outlines(axis: Axes, mesh: Any, colour: str, width: float = 0.9) -> None:
    """Draw the borders between the regions of a mesh on axes in mm, z to the right."""
    from matplotlib.collections import LineCollection

    region = np.empty(len(mesh.triangles), dtype=np.int64)
    for number, elements in enumerate(mesh.regions.values()):
        region[elements] = number
    borders = np.asarray(mesh.points)[_outline(np.asarray(mesh.triangles), region)]
    axis.add_collection(LineCollection(MM * borders[:, :, ::-1], colors=colour, linewidths=width))


def _outline(triangles: np.ndarray, region: np.ndarray) -> np.ndarray:
    """Edges (k, 2) between triangles of different regions."""
    edges = np.sort(np.vstack([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]]), axis=1)
    owner = np.tile(region, 3)
    order = np.lexsort((edges[:, 1], edges[:, 0]))
    edges, owner = edges[order], owner[order]
    same = (edges[1:] == edges[:-1]).all(axis=1)
    return edges[1:][same & (owner[1:] != owner[:-1])]


def _region_names(
    axis: Axes, mesh: Any, window: tuple[float, float, float, float]
) -> list[tuple[float, float, str]]:
    """Write the name of each region inside its largest connected part in a window r0, r1, z0, z1 [m].

    Those (r, z [m], name) that find no room there are returned. Of a part too small for a name there is none.
    """
    from matplotlib.patheffects import withStroke
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    points, (r0, r1, z0, z1) = np.asarray(mesh.points), window
    drawn: list[Any] = []
    beside: list[tuple[float, float, str]] = []
    for name, elements in mesh.regions.items():
        corners = np.asarray(mesh.triangles)[elements]
        r, z = points[corners].mean(axis=1).T
        corners = corners[(r >= r0) & (r <= r1) & (z >= z0) & (z <= z1)]
        if name == "air" or not len(corners):
            continue
        rows, columns = corners.ravel(), np.repeat(np.arange(len(corners)), 3)
        of_point = coo_array((np.ones(rows.size), (rows, columns)), shape=(len(points), len(corners))).tocsr()
        _, part = connected_components(of_point.T @ of_point, directed=False)
        a, b, c = (points[corners[:, i]] for i in range(3))
        area = 0.5 * np.abs((b - a)[:, 0] * (c - a)[:, 1] - (b - a)[:, 1] * (c - a)[:, 0])
        largest = part == np.argmax(np.bincount(part, weights=area))
        if area[largest].sum() < SMALLEST_NAMED * (r1 - r0) * (z1 - z0):
            continue
        centres = points[corners[largest]].mean(axis=1)
        middle = np.average(centres, axis=0, weights=area[largest])
        # The triangle nearest to the centroid of those well inside: the centroid of an L or a U lies outside of it.
        others = np.delete(np.asarray(mesh.triangles), elements, axis=0)
        depth = cKDTree(points[others].mean(axis=1)).query(centres)[0] if len(others) else np.ones(len(centres))
        depth = np.minimum(depth, np.abs(centres[:, [0, 0, 1, 1]] - window).min(axis=1))
        centres = centres[depth >= 0.7 * depth.max()]
        r, z = centres[np.argmin(((centres - middle) ** 2).sum(axis=1))]
        width, height = np.ptp(points[corners[largest]][:, :, 1]), np.ptp(points[corners[largest]][:, :, 0])
        turned = height > 2.5 * width
        text = axis.text(
            MM * z, MM * r, in_words(name), ha="center", va="center", fontsize=NAME_SIZE, rotation=90 if turned else 0,
            path_effects=[withStroke(linewidth=3.0, foreground="white")],
        )  # fmt: skip
        box = text.get_window_extent().padded(NAME_ROOM)
        if not all(axis.bbox.contains(x, y) for x, y in (box.min, box.max)):
            text.remove()  # a sliver at the edge of the panel
            continue
        if any(box.overlaps(other) for other in drawn):
            text.remove()
            beside.append((r, z, in_words(name)))
        else:
            drawn.append(box)
    return beside


def _names_beside(axis: Axes, names: list[tuple[float, float, str]]) -> None:
    """Write names (r, z [m], name) beside a panel's parts, at the nearer side, with lines to them that do not cross."""
    from matplotlib.patheffects import withStroke

    bottom, top = axis.get_ylim()
    step = 0.09 * (top - bottom)
    heights = {"left": np.inf, "right": np.inf}
    for r, z, name in sorted(names, reverse=True):
        side = "left" if MM * z < np.mean(axis.get_xlim()) else "right"
        heights[side] = min(MM * r, heights[side] - step)
        place = (0.01 if side == "left" else 0.99, heights[side])
        axis.annotate(
            name, (MM * z, MM * r), place, "data", ("axes fraction", "data"), ha=side, va="center",
            fontsize=NAME_SIZE, arrowprops={"arrowstyle": "-", "color": "white", "shrinkA": 0.0, "shrinkB": 0.0},
            path_effects=[withStroke(linewidth=3.0, foreground="white")],
        )  # fmt: skip


def _inside(rz: np.ndarray, box: AnnularBox) -> np.ndarray:
    """True where rows (r, z, ...) [m] lie in a box, bool (n,)."""
    r, z = rz[:, 0], rz[:, 1]
    return (r >= box.r0) & (r <= box.r1) & (z >= box.z0) & (z <= box.z1)


def _strongest_part(centres: np.ndarray, magnitude: np.ndarray, parts: Sequence[AnnularBox]) -> AnnularBox | None:
    """The part with the strongest field among elements at (k, 2) [m]; None where no element lies in any."""
    found = [(magnitude[held].max(), k) for k, box in enumerate(parts) if np.any(held := _inside(centres, box))]
    return parts[max(found)[1]] if found else None


def _gap_window(
    points: np.ndarray,
    triangles: np.ndarray,
    powder: np.ndarray,
    magnitude: np.ndarray,
    grains: np.ndarray | None,
) -> tuple[float, float, float, float]:
    """A square around the strongest powder field, a few gaps wide; over the grains where there are any."""
    corners = points[triangles[powder]]
    if grains is not None and len(grains):
        (r0, z0), (r1, z1) = grains[:, :2].min(axis=0), grains[:, :2].max(axis=0)
        side = 1.15 * max(min(r1 - r0, z1 - z0) * 4.0, 12.0 * float(grains[:, 2].max()))
        centres = grains[:, :2]
        extent = max(r1 - r0, z1 - z0, 10.0 * float(grains[:, 2].max()))  # a single grain has no extent
    else:
        centres = corners.mean(axis=1)
        extent = float(np.ptp(corners.reshape(-1, 2), axis=0).max())
        side = 0.3 * extent
    weight = corners.mean(axis=1)[np.argmax(magnitude[powder])]
    r, z = centres[np.argmin(((centres - weight) ** 2).sum(axis=1))]
    half = 0.5 * min(side, 1.2 * extent)
    return r - half, r + half, z - half, z + half
