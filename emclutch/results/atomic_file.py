"""Files that are either the old or the new one, never half of one."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np

UNFINISHED = ".new"
"""Ending of a file that is being written; what a killed process leaves of it is of no use to anybody."""


@contextmanager
def replaced(path: Path) -> Iterator[Path]:
    """Hand out a name next to a file, for its new content, and move that to its place in one step after the block.

    Safe against a crash and a full disk: an error in the block leaves the former file, and removes the new one.
    """
    new = path.with_name(f"{path.name}.{os.getpid()}{UNFINISHED}")  # two runs may write one file at the same time
    try:
        yield new
        with new.open("rb") as file:
            os.fsync(file.fileno())
        os.replace(new, path)
    except BaseException as error:
        if isinstance(error, OSError) and error.errno is not None:
            error.filename = str(path)  # a full disk says no name by itself
        with suppress(OSError):  # a folder that is gone, or may not be written any more
            new.unlink(missing_ok=True)
        raise


def replace_bytes(path: Path, content: bytes | memoryview) -> None:
    """Write a file in one step, see `replaced`."""
    with replaced(path) as new:
        new.write_bytes(content)


def remove_unfinished(folder: Path) -> None:
    """Remove what killed processes have left of files that they were writing into a folder.

    Only for who holds the folder's lock: the file of a process that writes looks alike.
    """
    for left in folder.glob(f"*.[0-9]*{UNFINISHED}"):
        left.unlink(missing_ok=True)


def is_unfinished(path: Path) -> bool:
    """True if a file is one that was being written."""
    return path.match(f"*.[0-9]*{UNFINISHED}")


def replace_text(path: Path, text: str) -> None:
    """Write a text in UTF-8 in one step."""
    replace_bytes(path, text.encode())


def replace_json(path: Path, values: Any) -> None:
    """Write JSON that every parser reads in one step: what is not a finite number becomes null."""
    replace_text(path, json.dumps(json_values(values), indent=2, allow_nan=False) + "\n")


def json_values(value: Any) -> Any:
    """Return the same nested values as plain Python: numpy arrays as lists, nan and infinities as None."""
    if isinstance(value, dict):
        return {str(key): json_values(entry) for key, entry in value.items()}
    if isinstance(value, (list, tuple, set)):
        return [json_values(entry) for entry in value]
    if isinstance(value, np.ndarray):
        return json_values(value.tolist())
    if isinstance(value, np.generic):
        return json_values(value.item())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if value is None or isinstance(value, (bool, int, str)):
        return value
    return str(value)
