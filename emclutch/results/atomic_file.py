"""Files that are either the old or the new one, never half of one."""

from __future__ import annotations

import json
import math
import os
from pathlib import Path
from typing import Any

import numpy as np


def replace_text(path: Path, text: str) -> None:
    """Write a text file beside its place and move it there in one step, safe against a crash in between."""
    beside = path.with_name(f"{path.name}.{os.getpid()}.new")  # two runs may write one file at the same time
    try:
        with beside.open("w", encoding="utf-8") as file:
            file.write(text)
            file.flush()
            os.fsync(file.fileno())
        os.replace(beside, path)
    except BaseException:
        beside.unlink(missing_ok=True)
        raise


def replace_json(path: Path, values: Any) -> None:
    """`replace_text` of JSON that every parser reads: what is not a finite number becomes null."""
    replace_text(path, json.dumps(json_values(values), indent=2, allow_nan=False) + "\n")


def json_values(value: Any) -> Any:
    """The same nested values as plain Python: numpy arrays as lists, nan and infinities as None."""
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
