"""``checkpoint.h5``: the complete state of a run, bit for bit.

A file of its own that is written under a temporary name and then moved into place: at every moment there is one whole
checkpoint. Inside ``run.h5`` a crash while writing could take the record and the checkpoint with it.

Values are nested dictionaries and lists of numpy arrays, numbers, strings, bytes, booleans and None; each
comes back with its type, dtype and shape. Integers may have any size (states of random generators have
128 bits). Floats are stored as IEEE 754 doubles, so infinities, nan and -0.0 survive.
"""

from __future__ import annotations

import io
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from emclutch.results.atomic_file import replace_bytes
from emclutch.results.errors import OutputError
from emclutch.results.hdf5_file import reading

VERSION = 2  # of the layout: 1 had other names of the grains' arrays


def write_checkpoint(path: str | Path, state: dict[str, Any]) -> None:
    """Replace the checkpoint in one step.

    Raises
    ------
    TypeError : a value of a type that cannot be stored, named by its place.
    OSError : the disk does not take it; the former checkpoint is untouched.
    """
    content = io.BytesIO()  # a full disk is reported by Python, at once and in words
    with h5py.File(content, "w") as file:
        file.attrs["version"] = VERSION
        _write(file, "state", state, "state")
    replace_bytes(Path(path), content.getbuffer())


def read_checkpoint(path: str | Path) -> dict[str, Any]:
    """Return the state as it was given to `write_checkpoint`.

    Raises
    ------
    OutputError : the file cannot be read, is damaged, is no checkpoint, or one of another layout.
    """
    path = Path(path)
    remedy = "put a good one there, or start again, without --resume and elsewhere with --out"
    with reading(path, remedy) as file:
        version = file.attrs.get("version")
        if version is None or "state" not in file:
            raise OutputError(
                f"{path} is an HDF5 file, but no checkpoint that this program wrote; name the right folder, or "
                "start the run again, without --resume and elsewhere with --out"
            )
        if version != VERSION:
            raise OutputError(
                f"{path} has layout {version}, this program reads {VERSION}; resume with the program that wrote it"
            )
        state = _read(file["state"], path.stat().st_size)
    if not isinstance(state, dict):
        raise OutputError(
            f"{path} holds no state of a run; start the run again, without --resume and elsewhere with --out"
        )
    return state


def _write(parent: h5py.Group, name: str, value: Any, where: str) -> None:
    if isinstance(value, (dict, list, tuple)):
        group = parent.create_group(name, track_order=True)
        group.attrs["kind"] = type(value).__name__
        items = value.items() if isinstance(value, dict) else ((str(i), v) for i, v in enumerate(value))
        for key, entry in items:
            if not isinstance(key, str) or "/" in key or key in ("", "."):
                raise TypeError(f"{where}: a checkpoint's keys are strings without '/', not {key!r}")
            _write(group, key, entry, f"{where}.{key}")
        return
    data: Any
    if isinstance(value, np.ndarray):
        if value.dtype.kind not in "biufc":
            raise TypeError(f"{where}: an array of {value.dtype} cannot be stored in a checkpoint")
        kind, data = "array", value
    elif isinstance(value, np.generic) and value.dtype.kind in "biufc":
        kind, data = "scalar", np.asarray(value)
    elif value is None:
        kind, data = "none", np.int8(0)
    elif isinstance(value, bool):
        kind, data = "bool", np.int8(value)
    elif isinstance(value, int):
        kind, data = "int", str(value)
    elif isinstance(value, float):
        kind, data = "float", np.float64(value)
    elif isinstance(value, str):
        kind, data = "str", np.frombuffer(value.encode("utf-8", "surrogatepass"), dtype=np.uint8)
    elif isinstance(value, bytes):
        kind, data = "bytes", np.frombuffer(value, dtype=np.uint8)
    else:
        raise TypeError(f"{where}: a {type(value).__name__} cannot be stored in a checkpoint")
    parent.create_dataset(name, data=data).attrs["kind"] = kind


def _read(node: h5py.Group | h5py.Dataset, most: int) -> Any:
    """Return the value of a node of at most `most` bytes, those of the file, in which nothing is compressed."""
    kind = node.attrs["kind"]
    if kind == "dict":
        return {name: _read(entry, most) for name, entry in node.items()}
    if kind in ("list", "tuple"):
        entries = [_read(node[str(i)], most) for i in range(len(node))]
        return entries if kind == "list" else tuple(entries)
    if node.nbytes > most:
        raise ValueError(f"{node.name} is to have {node.nbytes} bytes, in a file of {most}")
    data = node[()]
    if kind == "array":
        return np.asarray(data)
    if kind == "scalar":
        return data
    if kind == "none":
        return None
    if kind == "bool":
        return bool(data)
    if kind == "int":
        return int(data)
    if kind == "float":
        return float(data)
    return data.tobytes().decode("utf-8", "surrogatepass") if kind == "str" else data.tobytes()
