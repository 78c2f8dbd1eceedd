"""Time series for ParaView: ``NAME.pvd`` and its numbered files in the folder ``NAME/``.

The ``.pvd`` is replaced after every file, so that a run that was cut off can be opened as far as it got.
Array names are snake_case without units; the units stand in ``UNITS_LABEL``, once as key of each array
and once as the list «name=unit» in the field data. ``.pvd`` rather than temporal VTKHDF, because
ParaView 5.11 shows only the first step of the latter, without a word.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np

from emclutch.results.atomic_file import replace_text
from emclutch.results.output_error import OutputError
from emclutch.results.vtk.wall_surface import plane_polygon, revolved_surface, stripes, triangle_surface
from emclutch.results.vtk.xml import write_poly_data, write_simplices


class PvdSeries:
    """One series of a run's folder: particles, field, walls or contacts.

    Parameters
    ----------
    folder : the run's folder.
    name : of the series.
    resume_time : time of the checkpoint that a run resumes from [s]: later files are removed.
    """

    def __init__(self, folder: str | Path, name: str, *, resume_time: float | None = None) -> None:
        self.path = Path(folder) / f"{name}.pvd"
        self.files = Path(folder) / name
        self.name = name
        self.entries: list[tuple[float, str]] = []
        if resume_time is not None and self.path.is_file():
            limit = resume_time + 1e-12 * abs(resume_time)
            written = read_pvd(self.path)
            self.entries = [
                (time, file.relative_to(self.path.parent).as_posix()) for time, file in written if time <= limit
            ]
            self._write_pvd()  # first: what the list names is there at every moment
            for time, file in written:
                if time > limit:
                    file.unlink(missing_ok=True)

    def write_particles(self, time: float, position: np.ndarray, arrays: Mapping[str, np.ndarray]) -> Path:
        """Grains as points: position (n, 3) [m], arrays (n,) or (n, 3) by name.

        `diameter` is added where `radius` is given: it scales the sphere glyphs.
        """
        arrays = dict(arrays)
        if "radius" in arrays and "diameter" not in arrays:
            arrays["diameter"] = 2.0 * np.asarray(arrays["radius"])
        path = self._next("vtp")
        write_poly_data(path, position, time=time, vertices=True, point_arrays=arrays)
        return self._written(time, path)

    def write_field(
        self,
        time: float,
        points: np.ndarray,
        triangles: np.ndarray,
        *,
        point_arrays: Mapping[str, np.ndarray] | None = None,
        cell_arrays: Mapping[str, np.ndarray] | None = None,
        region_names: Sequence[str] = (),
    ) -> Path:
        """The field's cross-section, in the half-plane y = 0 of the device: x = r, z = z.

        Parameters
        ----------
        points : (n, 2) r, z [m].
        triangles : (k, 3).
        point_arrays, cell_arrays : (n,) or (n, 2); columns of the latter are the r and z components,
            written as 3D vectors (r, 0, z).
        region_names : names that the numbers of the cell array `region` stand for, as field data.
        """
        r, z = np.asarray(points).T
        path = self._next("vtu")
        write_simplices(
            path,
            np.column_stack([r, np.zeros_like(r), z]),
            triangles,
            time=time,
            point_arrays=_meridional(point_arrays),
            cell_arrays=_meridional(cell_arrays),
            texts={"region_names": list(region_names)} if region_names else None,
        )
        return self._written(time, path)

    def write_field_3d(
        self,
        time: float,
        points: np.ndarray,
        tetrahedra: np.ndarray,
        cell_arrays: Mapping[str, np.ndarray],
        *,
        turned: float = 0.0,
        region_names: Sequence[str] = (),
    ) -> Path:
        """A field in 3D: points (n, 3) [m], tetrahedra (k, 4), arrays (k,) or (k, 3) by name.

        `turned` is the angle [rad] of the body that carries the field: points and vectors are turned by it.
        """
        cos, sin = math.cos(turned), math.sin(turned)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        path = self._next("vtu")
        write_simplices(
            path,
            points @ turn.T,
            tetrahedra,
            time=time,
            cell_arrays={n: a @ turn.T if np.ndim(a) == 2 else a for n, a in cell_arrays.items()},
            texts={"region_names": list(region_names)} if region_names else None,
        )
        return self._written(time, path)

    def write_walls(
        self,
        time: float,
        walls: Sequence[Any],
        *,
        angles: Mapping[str, float] | None = None,
        speeds: Mapping[str, float] | None = None,
        sector_angle: float | None = None,
    ) -> Path:
        """Walls as surfaces.

        Parameters
        ----------
        walls : revolved walls (`start`, `end`), planes (`point`, `normal`) and triangle walls (`vertices`,
            `triangles`), each with `name`, `body`.
        angles, speeds : of the bodies by name [rad], [rad/s]; 0 where missing.
        sector_angle : of the cyclic sector [rad]; None draws full rings. A sector's walls stay over its
            grains; that they turn is seen by the marks of the cell array `stripe`, which turn with the body.
        """
        angles, speeds = angles or {}, speeds or {}
        bodies = list(dict.fromkeys(wall.body for wall in walls))
        planes = [wall for wall in walls if hasattr(wall, "normal")]
        reach = _reach(walls)
        points: list[np.ndarray] = []
        polygons: list[np.ndarray] = []
        rows: list[tuple[int, int, float, float, int]] = []
        count = 0
        for number, wall in enumerate(walls):
            turned, speed = angles.get(wall.body, 0.0), speeds.get(wall.body, 0.0)
            marked = None
            if hasattr(wall, "normal"):
                corners = plane_polygon(wall, planes, reach)
                if len(corners) < 3:
                    continue
                cells, material = [np.arange(len(corners))], np.zeros(1)
            elif hasattr(wall, "triangles"):
                corners, faces, material = triangle_surface(wall.vertices, wall.triangles, turned=turned)
                cells = list(faces)
            else:
                corners, quads, material = revolved_surface(wall.start, wall.end, angle=sector_angle, turned=turned)
                cells, marked = list(quads), stripes(material, sector_angle)
            points.append(corners)
            polygons += [cell + count for cell in cells]
            marked = np.zeros(len(material), dtype=np.int32) if marked is None else marked
            number_of_body = bodies.index(wall.body)
            rows += [(number_of_body, number, speed, float(a), int(s)) for a, s in zip(material, marked, strict=True)]
            count += len(corners)
        at = np.vstack(points) if points else np.zeros((0, 3))
        body = np.array([row[0] for row in rows], dtype=np.int32)
        speed_of_point = np.zeros(len(at))
        for polygon, row in zip(polygons, rows, strict=True):
            speed_of_point[polygon] = row[2]
        velocity = np.column_stack([-speed_of_point * at[:, 1], speed_of_point * at[:, 0], np.zeros(len(at))])
        path = self._next("vtp")
        write_poly_data(
            path,
            at,
            time=time,
            polygons=polygons,
            point_arrays={"velocity": velocity},
            cell_arrays={
                "body": body,
                "wall": np.array([row[1] for row in rows], dtype=np.int32),
                "angular_speed": np.array([row[2] for row in rows]),
                "material_angle": np.array([row[3] for row in rows]),
                "stripe": np.array([row[4] for row in rows], dtype=np.int32),
            },
            texts={"body_names": bodies, "wall_names": [wall.name for wall in walls]},
        )
        return self._written(time, path)

    def write_contacts(
        self,
        time: float,
        start: np.ndarray,
        end: np.ndarray,
        force: np.ndarray,
        *,
        force_normal: np.ndarray | None = None,
        cell_arrays: Mapping[str, np.ndarray] | None = None,
    ) -> Path:
        """Force chains: a line a contact.

        Parameters
        ----------
        start, end : (k, 3) centre of the grain and of its partner, or the point on the wall [m].
        force : (k, 3) on the grain at `start` [N].
        force_normal : (k,) along the line [N], pushing positive; None takes it from `force`.
        """
        start, end, force = (np.asarray(a, dtype=np.float64).reshape(-1, 3) for a in (start, end, force))
        k = len(start)
        if force_normal is None:
            line = start - end
            length = np.maximum(np.linalg.norm(line, axis=1), np.finfo(float).tiny)
            force_normal = np.einsum("ij,ij->i", force, line) / length
        i = np.arange(k)
        path = self._next("vtp")
        write_poly_data(
            path,
            np.vstack([start, end]),
            time=time,
            lines=np.column_stack([i, i + k]),
            cell_arrays={"force": force, "force_normal": force_normal, **(cell_arrays or {})},
        )
        return self._written(time, path)

    def _next(self, extension: str) -> Path:
        self.files.mkdir(exist_ok=True)
        return self.files / f"{self.name}_{len(self.entries):06d}.{extension}"

    def _written(self, time: float, path: Path) -> Path:
        self.entries.append((float(time), f"{self.name}/{path.name}"))
        self._write_pvd()
        return path

    def _write_pvd(self) -> None:
        lines = [
            '<?xml version="1.0"?>',
            '<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">',
        ]
        lines.append("<Collection>")
        lines += [
            f'<DataSet timestep="{time!r}" group="" part="0" file={quoteattr(file)}/>' for time, file in self.entries
        ]
        lines += ["</Collection>", "</VTKFile>", ""]
        replace_text(self.path, "\n".join(lines))


def read_pvd(path: str | Path) -> list[tuple[float, Path]]:
    """Times [s] and files of a series, in time order as written; OutputError where the file is damaged."""
    path = Path(path)
    try:
        data_sets = ElementTree.parse(path).getroot().iter("DataSet")
        return [(float(entry.attrib["timestep"]), path.parent / entry.attrib["file"]) for entry in data_sets]
    except (ElementTree.ParseError, KeyError, ValueError) as error:
        raise OutputError(f"{path} is no series that a run wrote ({error}); move it elsewhere, then go on") from error


def _meridional(arrays: Mapping[str, np.ndarray] | None) -> dict[str, np.ndarray]:
    """Vectors (n, 2) of r and z components as (r, 0, z); scalars as they are."""
    vectors = {}
    for name, values in (arrays or {}).items():
        array = np.asarray(values)
        if array.ndim == 2 and array.shape[1] == 2:
            array = np.column_stack([array[:, 0], np.zeros(len(array)), array[:, 1]])
        vectors[name] = array
    return vectors


def _reach(walls: Sequence[Any]) -> float:
    """Half the edge of an unbounded plane's square: twice the size of what the walls enclose [m]."""
    points = [np.asarray(wall.point, dtype=np.float64) for wall in walls if hasattr(wall, "normal")]
    points += [np.array([math.hypot(*wall.start), 0.0, wall.start[1]]) for wall in walls if hasattr(wall, "start")]
    points += [corner for wall in walls if hasattr(wall, "triangles") for corner in wall.bounds]
    if not points:
        return 1.0
    spread = float(np.ptp(np.array(points), axis=0).max())
    return 2.0 * (spread or float(np.abs(points).max()) or 0.5)
