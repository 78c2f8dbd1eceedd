"""``run.h5``: the record of a run, laid out like H5MD.

::

    /h5md                    version, author, creator
    /particles/grains/box    dimension, boundary
    /particles/grains/NAME   step (k,), time (k,), value (k, n, …)    unit in `value`'s attribute
    /observables/COLUMN      step (k,), time (k,), value (k,)
    /parameters              case (TOML text), provenance (JSON text)

The grains of a frame are in the order of their ids, so ``value[:, i]`` is the path of one grain
although the program sorts the grains by cell. HDF5 changes a file in many places at once, so each change is made
to a copy that is then moved into place: a run that is killed at any moment, and a disk that is full, leave a
record that can be read and continued, and the disk needs room for the copy. Checkpoints have their own file
(`checkpoint`).

P. de Buyl, P. H. Colberg, F. Höfling, "H5MD: a structured, efficient, and portable file format for
molecular data", Comput. Phys. Commun. 185 (2014) 1546-1553.
"""

from __future__ import annotations

import io
import logging
import os
import shutil
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from types import TracebackType
from typing import Any

import h5py
import numpy as np

from emclutch.results.array_units import ARRAY_UNITS
from emclutch.results.atomic_file import replace_bytes, replaced
from emclutch.results.column_table import COLUMNS
from emclutch.results.columns import TIME
from emclutch.results.errors import OutputError
from emclutch.results.hdf5_file import DAMAGED, reading, refuse_links

logger = logging.getLogger(__name__)

GRAINS = "particles/grains"


class Record:
    """Writer and reader of a run's record; use `open`."""

    def __init__(self, path: Path, *, writable: bool) -> None:
        self.path = path
        self.writable = writable
        self._rows: list[tuple[int, float, dict[str, Any]]] = []

    @classmethod
    def open(
        cls,
        path: str | Path,
        mode: str = "r",
        *,
        case_text: str = "",
        provenance_text: str = "",
        resume_time: float | None = None,
    ) -> Record:
        """Open a record.

        Parameters
        ----------
        mode : "w" starts a new one, "a" continues one, "r" reads.
        case_text, provenance_text : kept in /parameters, so that the record alone says what it is of.
        resume_time : with "a": frames after this time [s] are removed.

        With "a", a record that a crash left unreadable is kept under another name and a new one started:
        a run must be able to continue from its checkpoint.

        Raises
        ------
        OutputError : with "r", the file is missing, cannot be read or is no record.
        """
        record = cls(Path(path), writable=mode != "r")
        if mode not in ("r", "a", "w"):
            raise ValueError(f"mode {mode!r} is none of 'r', 'a', 'w'")
        if mode == "r":
            if not record.path.is_file():
                raise OutputError(f"{path} does not exist; name a run's folder that has a run.h5")
            with record._reading():
                return record
        if mode == "a" and record.path.is_file():
            try:
                with _changed(record.path) as file:
                    refuse_links(file, record.path)
                    if resume_time is not None:
                        _cut_back(file, resume_time)
                return record
            except (OSError, *DAMAGED) as error:
                if isinstance(error, OSError) and error.errno is not None:  # the disk's, not the content's
                    raise
                number = 1
                while (broken := record.path.with_name(f"run-broken-{number}.h5")).exists():
                    number += 1
                os.replace(record.path, broken)
                logger.warning(
                    "%s cannot be read (%s): kept as %s; a new one begins here, what was before stands in history.csv",
                    path,
                    error,
                    broken.name,
                )
        elif mode == "a":
            logger.warning("%s is not there: it begins here, what was before stands in history.csv", path)
        begun = io.BytesIO()
        with h5py.File(begun, "w") as file:
            head = file.create_group("h5md")
            head.attrs["version"] = np.array([1, 1], dtype=np.int32)
            head.create_group("author").attrs["name"] = "emclutch"
            creator = head.create_group("creator")
            creator.attrs["name"] = "emclutch"
            creator.attrs["version"] = _own_version()
            box = file.create_group(f"{GRAINS}/box")
            box.attrs["dimension"] = 3
            box.attrs["boundary"] = ["none", "none", "none"]
            file.create_group("observables")
            parameters = file.create_group("parameters")
            parameters["case"] = case_text
            parameters["provenance"] = provenance_text
        replace_bytes(record.path, begun.getbuffer())
        return record

    def append_grains(self, step: int, time: float, arrays: Mapping[str, np.ndarray]) -> None:
        """Add a frame of the grains.

        Parameters
        ----------
        step, time : of the frame; [s].
        arrays : (n,) or (n, k) each, by name as in `ARRAY_UNITS`. Where one is called `id` or
            `particle_id`, it sorts the others and is stored as `id`.
        """
        self._must_write()
        named = {("id" if name == "particle_id" else name): np.asarray(a) for name, a in arrays.items()}
        order = np.argsort(named["id"], kind="stable") if "id" in named else slice(None)
        with _changed(self.path) as file:
            for name, array in named.items():
                if array.dtype.kind == "f" and not np.isfinite(array).all():
                    raise OutputError(f"{name} of the grains at t = {time:g} s is not finite: broken run")
                _append(file, f"{GRAINS}/{name}", step, time, array[order], ARRAY_UNITS.get(name))

    def append_observables(self, row: Mapping[str, Any], step: int | None = None) -> None:
        """Add a row of the history: every column but `time` and cells without a value; `flush` writes it.

        `step` defaults to the number of the row.
        """
        self._must_write()
        if step is None:
            step = self._n_rows() if not self._rows else self._rows[-1][0] + 1
        values = {name: value for name, value in row.items() if name != TIME and value is not None}
        self._rows.append((step, float(row[TIME]), values))

    def flush(self) -> None:
        """Write the rows that were kept back; call before a checkpoint."""
        if not self._rows:
            return
        with _changed(self.path) as file:
            names = dict.fromkeys(name for _, _, values in self._rows for name in values)
            for name in names:
                rows = [(step, time, values[name]) for step, time, values in self._rows if name in values]
                steps, times, column = zip(*rows, strict=True)
                unit = COLUMNS[name].unit if name in COLUMNS else None
                _append_many(
                    file,
                    f"observables/{name}",
                    np.array(steps),
                    np.array(times),
                    np.array(column, dtype=np.float64),
                    unit,
                )
        self._rows.clear()

    def frames(self) -> np.ndarray:
        """Return the times of the frames of grains, (k,) [s]."""
        with self._reading() as file:
            group = file[GRAINS]
            names = [name for name in group if "time" in group[name]]
            return group[names[0]]["time"][:] if names else np.zeros(0)

    def grains(self, frame: int = -1) -> dict[str, np.ndarray]:
        """Return the arrays of one frame by name, in the order of the ids; negative numbers count from the end."""
        times = self.frames()
        if not -len(times) <= frame < len(times):
            raise OutputError(f"{self.path} has {len(times)} frames of grains, none of number {frame}")
        with self._reading() as file:
            group = file[GRAINS]
            return {name: group[name]["value"][frame] for name in group if "value" in group[name]}

    def observable(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Return times [s] and values of one column."""
        with self._reading() as file:
            if f"observables/{name}" not in file:
                known = ", ".join(file["observables"])
                raise OutputError(f"{self.path} has no observable {name}; it has {known}")
            group = file[f"observables/{name}"]
            return group["time"][:], group["value"][:]

    @contextmanager
    def _reading(self) -> Iterator[h5py.File]:
        """Open a record for reading in the block; OutputError where it is none, or damaged."""
        remedy = "it is not an HDF5 file, was cut off or is being written; history.csv has the history, too"
        with reading(self.path, remedy) as file:
            missing = [name for name in (GRAINS, "observables") if name not in file]
            if missing:
                raise OutputError(
                    f"{self.path} is an HDF5 file, but no record that this program wrote: it lacks "
                    f"{' and '.join(missing)}; name the folder of a run"
                )
            yield file

    def close(self) -> None:
        self.flush()

    def __enter__(self) -> Record:
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    def _must_write(self) -> None:
        if not self.writable:
            raise OutputError(f"{self.path} is open for reading only; open it with mode 'a'")

    def _n_rows(self) -> int:
        with self._reading() as file:
            return max((g["step"][-1] + 1 for g in file["observables"].values() if g["step"].size), default=0)


class _Copy(io.FileIO):
    """A file that HDF5 writes; HDF5 does not learn of a write that fails, for it would take the process with it."""

    def __init__(self, path: Path) -> None:
        super().__init__(path, "r+")
        self.error: OSError | None = None

    def write(self, content: Any) -> int:
        """Write all of it, unless a write has failed: `error` is why."""
        data = memoryview(content).cast("B")
        done = 0
        while done < len(data) and self.error is None:
            try:
                done += super().write(data[done:])
            except OSError as error:
                self.error = error
        return len(data)


@contextmanager
def _changed(path: Path) -> Iterator[h5py.File]:
    """Open a record in the block; its changes arrive when the block is left without an error."""
    with replaced(path) as new:
        shutil.copyfile(path, new)
        with _Copy(new) as copy:
            try:
                with h5py.File(copy, "r+") as file:
                    yield file
            finally:
                if copy.error is not None:
                    raise copy.error


def _append(file: h5py.File, where: str, step: int, time: float, value: np.ndarray, unit: str | None) -> None:
    _append_many(file, where, np.array([step]), np.array([time]), np.asarray(value)[None], unit)


def _append_many(
    file: h5py.File, where: str, step: np.ndarray, time: np.ndarray, value: np.ndarray, unit: str | None
) -> None:
    """Add k entries to an H5MD element, which is made when it is missing."""
    new = {"step": step.astype(np.int64), "time": time.astype(np.float64), "value": value}
    if where not in file:
        for name, array in new.items():
            shape = array.shape[1:]
            frame = max(1, int(np.prod(shape)))
            chunk = (max(1, 1024 // frame), *(max(1, extent) for extent in shape))
            squeeze = {"compression": "gzip", "compression_opts": 1, "shuffle": True} if shape else {}
            data = file.create_dataset(
                f"{where}/{name}",
                (0, *shape),
                maxshape=(None, *shape),
                dtype=array.dtype,
                chunks=chunk,
                **squeeze,
            )
            if name == "time":
                data.attrs["unit"] = "s"
            if name == "value" and unit is not None:
                data.attrs["unit"] = unit
    group = file[where]
    if group["value"].shape[1:] != value.shape[1:]:
        raise OutputError(
            f"{where} has shape {value.shape[1:]} but {group['value'].shape[1:]} in earlier frames; "
            "the number of grains must not change within a run"
        )
    for name, array in new.items():
        data = group[name]
        old = data.shape[0]
        data.resize(old + len(array), axis=0)
        data[old:] = array


def _cut_back(file: h5py.File, time: float) -> None:
    limit = time + 1e-12 * abs(time)
    for parent in (GRAINS, "observables"):
        for group in file[parent].values():
            if "time" in group:
                keep = int(np.searchsorted(group["time"][:], limit, side="right"))
                for name in ("step", "time", "value"):
                    group[name].resize(keep, axis=0)


def _own_version() -> str:
    from importlib import metadata

    try:
        return metadata.version("emclutch")
    except metadata.PackageNotFoundError:
        return "unknown"
