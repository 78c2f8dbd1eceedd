"""A picture of the cross-section: regions in colour, named in a legend, and the mesh around the gap.

Drawn as engineers draw a shaft: z to the right, r upwards, the upper half only. Matplotlib's object
interface with the Agg canvas is used: no display is needed and nobody's pyplot state is touched.
"""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from geometry.section import SectionMesh

if TYPE_CHECKING:
    from matplotlib.axes import Axes

# Steel in blues and greys, conductors copper, non-magnetic parts light, the powder dark red.
_COLOURS = {
    "air": "#f4f8fb", "disc": "#7f9bb3", "rotor": "#a3b7c7", "housing": "#8a949c", "coil": "#d98f4e",
    "ring": "#f2e3a8", "cover": "#c9d2c0", "seal": "#e9e4da", "powder": "#8e2f3c", "shaft_in": "#b9bec4",
    "shaft_out": "#5f7f9b",
}  # fmt: skip
_OTHERS = ("#b5a7c9", "#9cc5a1", "#e0a9b4", "#88b7b5", "#c7b58b", "#a9a9d4")
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
    from matplotlib.patches import Patch

    colours = part_colours(mesh.regions)
    gap = _gap_view(mesh)
    views = [_device_view(mesh), *([] if gap is None else [gap])]
    height = 6.6
    shapes = [(right - left) / (top - bottom) for left, right, bottom, top in views]
    figure = Figure(figsize=(sum(shapes) * (height - 1.1) + 1.0 * len(views) + 1.2, height), layout="constrained")
    FigureCanvasAgg(figure)
    panels = figure.subplots(1, len(views), squeeze=False, width_ratios=shapes)[0]
    count = f"{len(mesh.triangles)} triangles, {len(mesh.points)} nodes"
    headings = (f"cross-section ({count})", "mesh at the corner of the disc")
    for number, (panel, view) in enumerate(zip(panels, views, strict=True)):
        panel.set(xlim=view[:2], ylim=view[2:], xlabel="z [mm]", ylabel="r [mm]", aspect="equal")
        panel.set_title(headings[number], fontsize="medium")
        _paint(panel, mesh, list(colours.values()), with_mesh=number > 0)
    patches = [Patch(facecolor=colour, edgecolor="#303030", label=name.replace("_", " "))
               for name, colour in colours.items()]  # fmt: skip
    figure.legend(handles=patches, loc="outside right upper")
    if title:
        figure.suptitle(title)
    figure.savefig(path, dpi=dpi)
    return Path(path)


def part_colours(names: Iterable[str]) -> dict[str, str]:
    """Return a colour for each part of a device."""
    names = [*names]
    spare = iter(_OTHERS * (1 + len(names)))
    return {name: _COLOURS.get(name) or next(spare) for name in names}


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


def _paint(panel: Axes, mesh: SectionMesh, colours: list[str], with_mesh: bool) -> None:
    from matplotlib.colors import ListedColormap
    from matplotlib.tri import Triangulation

    number = np.empty(len(mesh.triangles))
    for i, elements in enumerate(mesh.regions.values()):
        number[elements] = i
    r, z = mesh.points.T * _MM
    lines: dict[str, Any] = {"edgecolors": "#00000060", "linewidth": 0.5} if with_mesh else {"edgecolors": "face"}
    panel.tripcolor(
        Triangulation(z, r, mesh.triangles[:, ::-1]),
        facecolors=number,
        cmap=ListedColormap(colours),
        vmin=-0.5,
        vmax=len(colours) - 0.5,
        **lines,
    )
    for elements in mesh.regions.values():
        nodes = _outline(mesh.triangles[elements])
        panel.plot(z[nodes].T, r[nodes].T, color="#303030", linewidth=0.6)


def _outline(triangles: np.ndarray) -> np.ndarray:
    """Edges of only one of the triangles, shape (k, 2)."""
    edges = np.concatenate([triangles[:, [0, 1]], triangles[:, [1, 2]], triangles[:, [2, 0]]])
    _, first, uses = np.unique(np.sort(edges, axis=1), axis=0, return_index=True, return_counts=True)
    return edges[first[uses == 1]]
