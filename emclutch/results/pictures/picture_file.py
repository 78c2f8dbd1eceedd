"""A picture on disk is whole: one that a killed process was writing is not there."""

from __future__ import annotations

import io
from pathlib import Path
from typing import TYPE_CHECKING

from emclutch.results.atomic_file import replace_bytes
from emclutch.results.errors import OutputError

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def save_picture(figure: Figure, path: str | Path) -> Path:
    """Write a figure in one step, in the format that the file's ending names, PNG without one.

    Raises
    ------
    OutputError
        The ending is that of no picture.
    """
    path = Path(path)
    content, kind = io.BytesIO(), path.suffix.removeprefix(".").lower() or "png"
    known = figure.canvas.get_supported_filetypes()
    if kind not in known:
        raise OutputError(f"{path} ends in no picture's format; allowed: {', '.join(f'.{one}' for one in known)}")
    figure.savefig(content, format=kind)
    replace_bytes(path, content.getbuffer())
    return path
