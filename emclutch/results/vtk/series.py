"""Time series for ParaView: ``NAME.pvd`` and its numbered files in the folder ``NAME/``.

The ``.pvd`` is replaced after every file, so that a run that was cut off can be opened as far as it got.
Array names are snake_case without units; the units are in ``UNITS_LABEL``, once as key of each array
and once as the list «name=unit» in the field data. ``.pvd`` rather than temporal VTKHDF, because
ParaView 5.11 shows only the first step of the latter, without a warning.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any
from xml.etree import ElementTree
from xml.sax.saxutils import quoteattr

import numpy as np

from emclutch.results.atomic_file import replace_text
from emclutch.results.errors import OutputError
from emclutch.results.vtk.data_set import poly_data, simplices, write_data_set
from emclutch.results.vtk.wall_surface import wall_surfaces

if TYPE_CHECKING:
    from emclutch.results.vtk.field_arrays import SectionArrays


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
        """Write grains as points: position (n, 3) [m], arrays (n,) or (n, 3) by name.

        `diameter` is added where `radius` is given: it scales the sphere glyphs.
        """
        if "radius" in arrays:
            arrays = {**arrays, "diameter": 2.0 * np.asarray(arrays["radius"])}
        return self._write(time, poly_data(position, vertices=True), point_arrays=arrays)

    def write_field(self, time: float, section: SectionArrays) -> Path:
        """Write the field's cross-section, in the half-plane y = 0 of the device: x = r, z = z.

        Arrays (n, 2) of the components along r and z are written as 3D vectors (r, 0, z).
        """
        return self._write(
            time,
            simplices(_meridional(section.points), section.triangles),
            point_arrays={name: _meridional(values) for name, values in section.point_arrays.items()},
            cell_arrays={name: _meridional(values) for name, values in section.cell_arrays.items()},
            texts={"region_names": section.region_names},
        )

    def write_flux_lines(self, time: float, segments: np.ndarray, flux: np.ndarray) -> Path:
        """Write lines of a section, in its half-plane: segments (k, 2, 2) r, z [m] and `flux_function` (k,) [Wb]."""
        ends = _meridional(segments.reshape(-1, 2))
        data = poly_data(ends, lines=np.arange(len(ends)).reshape(-1, 2))
        return self._write(time, data, cell_arrays={"flux_function": flux})

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
        """Write a field in 3D: points (n, 3) [m], tetrahedra (k, 4), arrays (k,) or (k, 3) by name.

        `turned` is the angle [rad] of the body that carries the field: points and vectors are turned by it.
        """
        cos, sin = math.cos(turned), math.sin(turned)
        turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
        return self._write(
            time,
            simplices(points @ turn.T, tetrahedra),
            cell_arrays={n: a @ turn.T if np.ndim(a) == 2 else a for n, a in cell_arrays.items()},
            texts={"region_names": region_names} if region_names else None,
        )

    def write_walls(
        self,
        time: float,
        walls: Sequence[Any],
        *,
        angles: Mapping[str, float] | None = None,
        speeds: Mapping[str, float] | None = None,
        sector_angle: float | None = None,
    ) -> Path:
        """Write walls as surfaces; the parameters are those of `wall_surfaces`."""
        surfaces = wall_surfaces(walls, angles or {}, speeds or {}, sector_angle)
        return self._write(
            time,
            poly_data(surfaces.points, polygons=surfaces.polygons),
            point_arrays={"velocity": surfaces.velocity},
            cell_arrays=surfaces.cell_arrays,
            texts={"body_names": surfaces.bodies, "wall_names": [wall.name for wall in walls]},
        )

    def write_contacts(self, time: float, start: np.ndarray, end: np.ndarray, force: np.ndarray) -> Path:
        """Write force chains: a line a contact.

        Parameters
        ----------
        start, end : (k, 3) centre of the grain and of its partner, or the point on the wall [m].
        force : (k, 3) on the grain at `start` [N]; its part along the line, pushing positive, is `force_normal`.
        """
        start, end, force = (np.asarray(a, dtype=np.float64).reshape(-1, 3) for a in (start, end, force))
        line = start - end
        length = np.maximum(np.linalg.norm(line, axis=1), np.finfo(float).tiny)
        force_normal = np.einsum("ij,ij->i", force, line) / length
        i = np.arange(len(start))
        return self._write(
            time,
            poly_data(np.vstack([start, end]), lines=np.column_stack([i, i + len(start)])),
            cell_arrays={"force": force, "force_normal": force_normal},
        )

    def _write(self, time: float, data: Any, **arrays: Any) -> Path:
        """Write the next file and name it in the ``.pvd``."""
        self.files.mkdir(exist_ok=True)
        extension = "vtp" if data.IsA("vtkPolyData") else "vtu"
        path = self.files / f"{self.name}_{len(self.entries):06d}.{extension}"
        write_data_set(path, data, time=time, **arrays)
        self.entries.append((float(time), f"{self.name}/{path.name}"))
        self._write_pvd()
        return path

    def _write_pvd(self) -> None:
        head = '<?xml version="1.0"?>\n<VTKFile type="Collection" version="0.1" byte_order="LittleEndian">\n'
        files = [f'<DataSet timestep="{t!r}" group="" part="0" file={quoteattr(file)}/>\n' for t, file in self.entries]
        replace_text(self.path, f"{head}<Collection>\n{''.join(files)}</Collection>\n</VTKFile>\n")


def read_pvd(path: str | Path) -> list[tuple[float, Path]]:
    """Return times [s] and files of a series, in time order as written.

    Raises
    ------
    OutputError
        The file is damaged, or names a file outside its folder: a run that is resumed removes later files.
    """
    path = Path(path)
    try:
        data_sets = ElementTree.parse(path).getroot().iter("DataSet")
        found = [(float(entry.attrib["timestep"]), path.parent / entry.attrib["file"]) for entry in data_sets]
        for _, file in found:
            if not file.resolve().is_relative_to(path.parent.resolve()):
                raise ValueError(f"{file} is outside its folder")
    except (ElementTree.ParseError, KeyError, ValueError) as error:
        raise OutputError(f"{path} is not a series of a run ({error}); move it elsewhere, then continue") from error
    return found


def _meridional(values: np.ndarray) -> np.ndarray:
    """Return vectors (n, 2) of r and z components as (r, 0, z); scalars as they are."""
    values = np.asarray(values)
    if values.ndim == 1:
        return values
    return np.column_stack([values[:, 0], np.zeros(len(values)), values[:, 1]])
