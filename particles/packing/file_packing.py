"""A packing from a file: a table of text (.csv, .txt, .tsv, .tab), npz or VTK PolyData (.vtp).

What is read, by name: positions, and where they are there, radii or diameters, velocities and spins.

    text  columns x, y, z; radius or diameter; vx, vy, vz; wx, wy, wz, each with its unit in brackets
    npz   arrays position (n, 3); radius or diameter (n,); velocity, angular_velocity (n, 3), all in SI
    vtp   the points [m], and point arrays of the same names as in npz, in SI: what a run writes as particles_*.vtp

Diameters are needed somewhere: in the file, or given by the caller. A warning names the columns and arrays that are not
used.
"""

from __future__ import annotations

import mmap
import re
import warnings
import zlib
from collections.abc import Mapping
from pathlib import Path
from zipfile import BadZipFile

import numpy as np

from geometry.table_file import FileFault, is_unit_of, read_table, warn_of_unused
from particles.packing.packing import Packing

MAX_BYTES = 2_000_000_000
"""Of a file's arrays, unpacked: 10 million grains with all that there is of them; more is refused unread."""
OVERLAP_LIMIT = 0.05  # of a diameter: beds at rest have a few tenths of a per cent, wrong units far more
_VECTORS = {
    "position": (("x", "y", "z"), "m"),
    "velocity": (("vx", "vy", "vz"), "m/s"),
    "angular_velocity": (("wx", "wy", "wz"), "rad/s"),
}
_UNITS = {"radius": "m", "diameter": "m"} | {part: unit for parts, unit in _VECTORS.values() for part in parts}
_NUMBER_OF_POINTS = re.compile(rb"NumberOfPoints\s*=\s*[\"'](\d{1,18})")
_MIN_BYTES_OF_A_POINT = 24


def read_packing(path: str | Path, *, radius: float | None = None) -> Packing:
    """The grains of a file, in its order.

    Parameters
    ----------
    radius : float, optional
        Of all grains [m], for a file without radii and diameters.

    Raises
    ------
    ValueError
        If the file is of another kind, lacks what is needed, or a number in it is not finite; or if radii are both in
        the file and given.
    """
    path = Path(path)
    readers = {**dict.fromkeys((".csv", ".txt", ".tsv", ".tab"), _from_csv), ".npz": _from_npz, ".vtp": _from_vtp}
    reader = readers.get(path.suffix.lower())
    if reader is None:
        raise FileFault(path, f"has the suffix '{path.suffix}'; a packing is read from {', '.join(readers)}")
    if not path.is_file():
        raise FileFault(path, "does not exist; check the path")
    arrays = reader(path)
    position = _array(path, arrays, "position", 3)
    if position is None:
        raise FileFault(path, f"has no positions; it has {', '.join(arrays) or 'nothing'}")
    own = _array(path, arrays, "radius", 0)
    diameter = _array(path, arrays, "diameter", 0)
    if own is not None and diameter is not None:
        raise FileFault(path, "has both radius and diameter; keep one of the two")
    if own is None and diameter is not None:
        own = 0.5 * diameter
    if own is None and radius is None:
        raise FileFault(path, "has neither radius nor diameter; add one of them, or give the grains' diameter")
    if own is not None and radius is not None:
        raise FileFault(path, "has the grains' sizes, and a diameter is given as well; keep one of the two")
    size = np.full(len(position), radius) if own is None else own
    velocity, spin = (_array(path, arrays, name, 3) for name in ("velocity", "angular_velocity"))
    for name, value in (("radius", size), ("velocity", velocity), ("angular_velocity", spin)):
        if value is not None and len(value) != len(position):
            raise FileFault(path, f"{len(position)} positions but {len(value)} of {name}; give as many")
    if unused := arrays.keys() - {"position", "radius", "diameter", "velocity", "angular_velocity"}:
        warn_of_unused(path, sorted(unused))
    if not (size > 0.0).all():
        k = int(np.flatnonzero(~(size > 0.0))[0])
        raise FileFault(path, f"the radius of grain {k} is {size[k] * 1e3:g} mm; it must be positive")
    return Packing(position, size, velocity, spin)


def _array(path: Path, arrays: Mapping[str, np.ndarray], name: str, width: int) -> np.ndarray | None:
    """The array of that name as floats (n, width), or (n,) for width 0; None where there is none."""
    if name not in arrays:
        return None
    try:
        value = np.array(arrays[name], dtype=float, order="C")
    except (TypeError, ValueError):
        raise FileFault(path, f"{name} is not an array of numbers") from None
    if value.ndim != (2 if width else 1) or (width and value.shape[1] != width):
        wanted = f"(n, {width})" if width else "(n,)"
        raise FileFault(path, f"{name} has shape {value.shape}; it must be {wanted}")
    if not len(value):
        raise FileFault(path, "holds no grain")
    bad = ~np.isfinite(value.reshape(len(value), -1)).all(axis=1)
    if bad.any():
        raise FileFault(path, f"{name} of grain {int(np.flatnonzero(bad)[0])} is not finite")
    return value


def _from_csv(path: Path) -> dict[str, np.ndarray]:
    table = read_table(path, lambda place, name, unit: _UNITS.get(name.lower()))
    names = {name for name, _ in table.unused}
    for name, unit in table.unused:
        is_component = any({name[:-1] + end for end in ends} <= names for ends in ("xyz", "XYZ", "012", "123"))
        is_force = unit.endswith("N") or is_unit_of(unit, "N m")
        if (is_component and not is_force) or any(is_unit_of(unit, goal) for goal in ("m", "m/s", "rad/s")):
            known = ", ".join(f"{known} [{goal}]" for known, goal in _UNITS.items())
            raise FileFault(path, f"has the column '{name}', which may be a place, size or motion; known: {known}")
    table.warn_of_unused()
    columns = {name.lower(): column for name, column in zip(table.names, table.values.T, strict=True)}
    for name, (parts, _) in _VECTORS.items():
        there = [part for part in parts if part in columns]
        if there and len(there) < 3:
            raise FileFault(path, f"has of {', '.join(parts)} only {', '.join(there)}; give all three")
        if there:
            columns[name] = np.stack([columns.pop(part) for part in parts], axis=1)
    return columns


def _from_npz(path: Path) -> dict[str, np.ndarray]:
    try:
        with open(path, "rb") as stream:  # numpy leaves the file open that is no archive
            archive = np.load(stream, allow_pickle=False)
            if not isinstance(archive, np.lib.npyio.NpzFile):
                raise ValueError("it holds one array without a name; write it by numpy.savez")
            with archive:
                assert archive.zip is not None  # it is open
                size = sum(int(entry.file_size) for entry in archive.zip.infolist())
                if size <= MAX_BYTES:
                    return dict(archive)
    # memory: of an array whose head says that it has more numbers than the file; not implemented: zipfile says so of a
    # compression that it lacks
    except (ValueError, OSError, EOFError, BadZipFile, zlib.error, NotImplementedError, MemoryError) as error:
        raise FileFault(path, f"is not an npz archive of arrays ({error})") from None
    raise _too_much(path, size)


def _too_much(path: Path, size: int) -> FileFault:
    return FileFault(
        path,
        f"holds {size:.2g} bytes of arrays; allowed: at most {MAX_BYTES:.2g}; keep positions and radii of the grains "
        "that are needed",
    )


def _from_vtp(path: Path) -> dict[str, np.ndarray]:
    import pyvista  # local: it takes a second to import

    with open(path, "rb") as stream:
        if b"<VTKFile" not in stream.read(1000):
            raise FileFault(path, "is not a VTK file in XML: it does not begin with <VTKFile; export it again")
        with mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
            points = max(map(int, _NUMBER_OF_POINTS.findall(content)), default=0)
    if (size := max(path.stat().st_size, points * _MIN_BYTES_OF_A_POINT)) > MAX_BYTES:
        raise _too_much(path, size)
    try:
        with pyvista.vtk_verbosity("off"), warnings.catch_warnings():
            # the reader's errors arrive as warnings, and the file as one without points
            warnings.filterwarnings("error", message="The VTK reader")
            mesh = pyvista.read(path)
    except Exception as error:  # VTK's and pyvista's readers fail each differently
        raise FileFault(path, f"cannot be read as VTK PolyData ({error}); export it again") from None
    if not isinstance(mesh, pyvista.PolyData):
        raise FileFault(path, f"holds {type(mesh).__name__}, not the points of a PolyData")
    return {
        "position": np.asarray(mesh.points),
        **{name: np.asarray(mesh.point_data[name]) for name in mesh.point_data},
    }
