"""Header of a VTK XML file that `vtk_xml` wrote: names of arrays and lists of texts.

Read without the vtk package, whose import takes longer than all else that a run writes.
"""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass
from pathlib import Path
from xml.etree import ElementTree

from emclutch.results.output_error import OutputError

_BODY = b'<AppendedData encoding="raw">\n_'


@dataclass(frozen=True, slots=True)
class VtkHead:
    """Names of a file's arrays, and its lists of texts by name (`region_names`, `body_names`)."""

    point_arrays: tuple[str, ...]
    cell_arrays: tuple[str, ...]
    texts: dict[str, list[str]]


def read_head(path: str | Path) -> VtkHead:
    """The head of a ``.vtp`` or ``.vtu``; OutputError where the file is missing or none that a run wrote."""
    try:
        content = Path(path).read_bytes()
        head, _, body = content.partition(_BODY)
        root = ElementTree.fromstring(head + b"</VTKFile>")
        texts = {
            entry.attrib["Name"]: _strings(body, int(entry.attrib["offset"])) for entry in root.iterfind(".//Array")
        }
    except (OSError, ElementTree.ParseError, KeyError, ValueError, struct.error, zlib.error) as error:
        raise OutputError(f"{path} is no file that a run wrote ({error})") from error

    def names(section: str) -> tuple[str, ...]:
        return tuple(entry.attrib["Name"] for entry in root.iterfind(f".//{section}/DataArray"))

    return VtkHead(names("PointData"), names("CellData"), texts)


def _strings(body: bytes, offset: int) -> list[str]:
    """A list of texts, each closed by a zero byte, from its compressed blocks."""
    (count,) = struct.unpack_from("<Q", body, offset)
    sizes = struct.unpack_from(f"<{count}Q", body, offset + 24)
    start, text = offset + 24 + 8 * count, b""
    for size in sizes:
        text += zlib.decompress(body[start : start + size])
        start += size
    return [part.decode() for part in text.split(b"\0")[:-1]]
