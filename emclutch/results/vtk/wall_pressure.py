"""``wall_pressure.vtp``: the walls in bins with the mean pressure and shear stress of a run, for ParaView."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.vtk.data_set import poly_data, write_data_set
from emclutch.results.vtk.wall_surface import plane_polygon, reach_of, revolved_surface, triangle_surface

if TYPE_CHECKING:
    from particles.diagnostics.wall_pressure import WallPressure


def write_wall_pressure_surfaces(
    folder: str | Path, load: WallPressure, walls: Sequence[Any], sector_angle: float | None, time: float
) -> Path:
    """Write the surfaces of all bins, of a cyclic sector its own part.

    Parameters
    ----------
    folder : of the run.
    load, walls : as of `WallPressure`.
    sector_angle : [rad]; None draws full rings.
    time : [s].

    Returns
    -------
    Path
        The file. Its cells have `pressure`, `shear_stress` [Pa], `wall` and `body` (its number among the names in the
        field data `bodies`).
    """
    bodies = list(dict.fromkeys(wall.body for wall in walls))
    planes = [wall for wall in walls if hasattr(wall, "normal")]
    reach = reach_of(walls)
    points, polygons, rows, count = [np.zeros((0, 3))], [], [], 0
    for b, number in enumerate(load.bins.wall):
        wall, k = walls[number], load.bins.coordinate[number]
        if k >= 0:
            start, end = np.array(wall.start), np.array(wall.end)
            low, high = (start + (s - start[k]) / (end[k] - start[k]) * (end - start)
                         for s in (load.bins.low[b], load.bins.high[b]))  # fmt: skip
            corners, faces, _ = revolved_surface(tuple(low), tuple(high), angle=sector_angle, turned=0.0)
        elif hasattr(wall, "normal"):
            corners = plane_polygon(wall, planes, reach)
            faces = np.arange(len(corners))[None]
        else:
            corners, faces, _ = triangle_surface(wall.vertices, wall.triangles, turned=0.0)
        if len(corners) < 3:  # the other planes leave nothing of this one
            continue
        points.append(corners)
        polygons += list(faces + count)
        count += len(corners)
        rows += [(load.pressure[b], load.shear_stress[b], number, bodies.index(wall.body))] * len(faces)
    columns = np.array(rows, dtype=float).reshape(-1, 4).T
    path = Path(folder) / "wall_pressure.vtp"
    arrays = {"pressure": columns[0], "shear_stress": columns[1], "wall": columns[2].astype("i4"),
              "body": columns[3].astype("i4")}  # fmt: skip
    data = poly_data(np.vstack(points), polygons=polygons)
    write_data_set(path, data, time=time, cell_arrays=arrays, texts={"bodies": bodies})
    return path
