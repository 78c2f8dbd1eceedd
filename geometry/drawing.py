"""A picture of the cross-section: regions in colour with their names, and the mesh around the gap.

Drawn as engineers draw a shaft: z to the right, r upwards, the upper half only. Matplotlib's object
interface with the Agg canvas is used: no display is needed and nobody's pyplot state is touched.
"""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.section import SectionMesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.tri import Triangulation

# Steel in blues and greys, conductors copper, non-magnetic parts light, the powder dark red.
_COLOURS = {
    "air": "#f4f8fb", "disc": "#7f9bb3", "rotor": "#a3b7c7", "housing": "#8a949c", "coil": "#d98f4e",
    "ring": "#f2e3a8", "cover": "#c9d2c0", "seal": "#e9e4da", "powder": "#8e2f3c", "shaft_in": "#b9bec4",
    "shaft_out": "#5f7f9b",
}  # fmt: skip
_OTHERS = ("#b5a7c9", "#9cc5a1", "#e0a9b4", "#88b7b5", "#c7b58b", "#a9a9d4")
_FONT = 9.0  # points
_INCH = 72.0  # points
_MM = 1e3


def draw_section(mesh: SectionMesh, path: str | Path, title: str | None = None, *, dpi: int = 150) -> Path:
    """Write a PNG of the device (left) and, where the mesh has a rim gap, of the mesh at its corner (right).

    Parameters
    ----------
    mesh : SectionMesh
        Its region ``air`` is shown as far as the frame around all other regions reaches.
    path : str or Path
        The file to write; its ending names the format.
    title : str, optional
        A line above the picture.
    dpi : int
        Resolution.

    Returns
    -------
    Path
        The file.
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from matplotlib.tri import Triangulation

    triangulation = Triangulation(mesh.points[:, 1] * _MM, mesh.points[:, 0] * _MM, mesh.triangles[:, ::-1])
    views = [_device_view(mesh)]
    gap = _gap_view(mesh)
    if gap is not None:
        views.append(gap)
    height = 6.6
    shapes = [(right - left) / (top - bottom) for left, right, bottom, top in views]
    figure = Figure(figsize=(sum(shapes) * (height - 1.1) + 1.0 * len(views), height), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(views), squeeze=False, width_ratios=shapes)[0]
    for panel, view in zip(panels, views, strict=True):
        panel.set(xlim=view[:2], ylim=view[2:], xlabel="z [mm]", ylabel="r [mm]", aspect="equal")
    figure.draw_without_rendering()  # the panels get their final scale, which the names are fitted to
    for number, (panel, view) in enumerate(zip(panels, views, strict=True)):
        _paint(panel, mesh, triangulation, with_mesh=number > 0)
        _write_names(panel, mesh, triangulation, view, leaders=number == 0)
    count = f"{len(mesh.triangles)} triangles, {len(mesh.points)} nodes"
    panels[0].set_title(f"cross-section ({count})", fontsize=_FONT)
    if gap is not None:
        panels[1].set_title("mesh at the corner of the disc", fontsize=_FONT)
    if title:
        figure.suptitle(title)
    figure.savefig(path, dpi=dpi)
    return Path(path)


View = tuple[float, float, float, float]  # left, right (z), bottom, top (r) [mm]


def _device_view(mesh: SectionMesh) -> View:
    solid = [elements for name, elements in mesh.regions.items() if name != "air"]
    nodes = mesh.triangles[np.concatenate(solid)] if solid else mesh.triangles
    z, r = mesh.points[nodes, 1] * _MM, mesh.points[nodes, 0] * _MM
    margin = 0.12 * max(np.ptp(z), np.ptp(r))
    return z.min() - margin, z.max() + margin, 0.0, r.max() + 0.6 * margin


def _gap_view(mesh: SectionMesh) -> View | None:
    """The corner of disc, rim gap and face gap at z > 0, some gaps wide."""
    if not {"disc_rim", "rotor_bore"} <= mesh.boundaries.keys():
        return None
    rim, bore = (mesh.points[mesh.boundaries[name]].reshape(-1, 2) * _MM for name in ("disc_rim", "rotor_bore"))
    r, z = rim[:, 0].mean(), rim[:, 1].max()
    reach = max(bore[:, 0].mean() - r, bore[:, 1].max() - z)
    return z - 3.5 * reach, z + 2.5 * reach, r - 3.5 * reach, r + 3.5 * reach


def _paint(panel: Axes, mesh: SectionMesh, triangulation: Triangulation, with_mesh: bool) -> None:
    from matplotlib.colors import ListedColormap

    colours = list(_colours(mesh).values())
    number = np.empty(len(mesh.triangles))
    for i, elements in enumerate(mesh.regions.values()):
        number[elements] = i
    lines: dict[str, Any] = {"edgecolors": "#00000060", "linewidth": 0.5} if with_mesh else {"edgecolors": "face"}
    panel.tripcolor(
        triangulation,
        facecolors=number,
        cmap=ListedColormap(colours),
        vmin=-0.5,
        vmax=len(colours) - 0.5,
        **lines,
    )
    for elements in mesh.regions.values():
        z, r = (mesh.points[_outline(mesh.triangles[elements])] * _MM).T[::-1]
        panel.plot(z, r, color="#303030", linewidth=0.6)


def _colours(mesh: SectionMesh) -> dict[str, str]:
    spare = iter(_OTHERS * (1 + len(mesh.regions)))
    return {name: _COLOURS.get(name) or next(spare) for name in mesh.regions}


def _outline(triangles: np.ndarray) -> np.ndarray:
    """Edges of only one of the triangles, shape (k, 2)."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    _, first, uses = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    return edges[first[uses == 1]]


def _write_names(panel: Axes, mesh: SectionMesh, triangulation: Triangulation, view: View, leaders: bool) -> None:
    """A name goes where it fits into its region, level or upright; else to the right, with a leader line."""
    find = triangulation.get_trifinder()
    region_of = np.full(len(mesh.triangles) + 1, -1)
    for i, elements in enumerate(mesh.regions.values()):
        region_of[elements] = i
    width, height = panel.get_window_extent().size
    point = max((view[1] - view[0]) / width, (view[3] - view[2]) / height) * panel.figure.dpi / _INCH  # [mm]
    colours = _colours(mesh)
    low, high = np.array(view[::2]), np.array(view[1::2])
    led: list[tuple[float, float, str]] = []
    for i, name in enumerate(mesh.regions):
        centres = mesh.centroid()[mesh.regions[name]][:, ::-1] * _MM
        inside = (centres[:, 0] > view[0]) & (centres[:, 0] < view[1])
        if name == "air":  # its right half is for the names with leader lines
            inside &= centres[:, 0] < 0.5 * (view[0] + view[1])
        centres = centres[inside & (centres[:, 1] > view[2]) & (centres[:, 1] < view[3])]
        if len(centres) == 0:
            continue
        depth = _depth(centres, mesh.points[_outline(mesh.triangles[mesh.regions[name]])][..., ::-1] * _MM, view)
        # Along a strip many points are equally deep: the name goes to the middle of it.
        middle = np.linalg.norm(centres - centres.mean(axis=0), axis=1)
        order = np.argsort(0.1 * middle - depth, kind="stable")
        text = np.array([0.62 * len(name) + 0.8, 1.6]) * _FONT * point
        for upright in (False, True):
            box = 0.5 * (text[::-1] if upright else text)
            grid = np.array([(x, y) for x in np.linspace(-1, 1, 9) for y in np.linspace(-1, 1, 9)]) * box
            corners = centres[order][:, None, :] + grid
            fits = np.all(region_of[np.asarray(find(corners[..., 0], corners[..., 1]), dtype=np.int64)] == i, axis=1)
            fits &= np.all((centres[order] - box > low) & (centres[order] + box < high), axis=1)
            if fits.any():
                z, r = centres[order][np.argmax(fits)]
                dark = name in ("powder", "shaft_out")
                panel.text(
                    z, r, name, ha="center", va="center", fontsize=_FONT, rotation=90.0 * upright,
                    color="white" if dark else "black",
                    bbox={"facecolor": colours[name], "edgecolor": "none", "pad": 0.5},
                )  # fmt: skip
                break
        else:
            # High up and to the right, so that the line is short and leaves the names of others alone.
            z, r = centres[np.argmax(depth + 0.02 * centres.sum(axis=1))]
            led.append((z, r, name))
    level = np.inf
    for z, r, name in sorted(led, key=lambda item: -item[1]) if leaders else ():
        level = min(r + 0.5 * _FONT * point, level - 1.8 * _FONT * point)
        panel.annotate(
            name, (z, r), (view[1] - 0.5 * _FONT * point, level), ha="right", va="center", fontsize=_FONT,
            arrowprops={"arrowstyle": "-", "linewidth": 0.8, "shrinkA": 1.0, "shrinkB": 0.0},
        )  # fmt: skip


def _depth(points: np.ndarray, edges: np.ndarray, view: View) -> np.ndarray:
    """Distance of points, shape (n, 2), to the nearest of the edges, shape (k, 2, 2), or of the frame."""
    start, along = edges[:, 0], edges[:, 1] - edges[:, 0]
    to = points[:, None, :] - start
    t = np.clip((to * along).sum(2) / (along**2).sum(1), 0.0, 1.0)
    nearest = np.linalg.norm(to - t[..., None] * along, axis=2).min(axis=1)
    frame = np.minimum(points - np.array(view[::2]), np.array(view[1::2]) - points).min(axis=1)
    return np.minimum(nearest, frame)
