"""Models of FEMM 4 (.fem): the text of a file as records, lengths in metres.

A file has lines ``[Key] = value``; properties of materials, boundaries, circuits and points, lines ``<Key> = value``
between ``<BeginBlock>`` and ``<EndBlock>``, say; and lists of points, segments, arcs, holes and labels, whose
``[NumPoints] = n`` is followed by n lines of numbers. Numbers of properties count from 1, 0 is none; those of points
count from 0. An arc runs counterclockwise from its first point. Nothing is judged here: what has no counterpart is
refused where a scene is made of the model.

Reference: D. Meeker, Finite Element Method Magnetics, User's Manual, 2015.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

import numpy as np

from geometry.table_file import MAX_FILE, FileFault

UNITS = {"inches": 25.4e-3, "millimeters": 1e-3, "centimeters": 1e-2, "meters": 1.0, "mils": 25.4e-6,
         "microns": 1e-6, "micrometers": 1e-6}  # fmt: skip
"""Metres per unit of length."""

_HEAD = re.compile(r"\s*\[(\w+)\]\s*=\s*(.*?)\s*$")
_ENTRY = re.compile(r"\s*<(\w+)>\s*(?:=\s*(.*?))?\s*$")
_KINDS = {"beginbdry": "boundary", "beginblock": "material", "begincircuit": "circuit"}
_LISTS = {"numpoints": 2, "numsegments": 2, "numarcsegments": 3, "numholes": 2, "numblocklabels": 8}
_WIRE = 3  # first LamType of wire
_DECIMAL_POINT = "write it with a decimal point"
_ON_AXIS = 1e-9  # of the model's size

_Lines = Iterator[tuple[int, str]]
_Rows = list[tuple[int, list[float]]]


@dataclass(frozen=True, slots=True, eq=False)
class FemmProperty:
    """A material, boundary or circuit with its first line; `curve`: B [T] and H [A/m] of a material, shape (n, 2)."""

    name: str
    line: int
    entries: Mapping[str, float]
    curve: np.ndarray

    def __getitem__(self, key: str) -> float:
        """Return the number at a key; where the file has none, 1 for permeability and fill, else 0."""
        return self.entries.get(key, 1.0 if key in ("mu_x", "mu_y", "lamfill") else 0.0)


@dataclass(frozen=True, slots=True)
class FemmEdge:
    """A segment, or an arc of `angle` [rad]; `start` and `end` are points, `boundary` is a property."""

    start: int
    end: int
    angle: float
    boundary: int
    line: int

    def ends(self, points: np.ndarray) -> str:
        """Return the edge by its ends, in words."""
        return f"the edge from {_at(*points[self.start])} to {_at(*points[self.end])}"

    def middle(self, points: np.ndarray) -> np.ndarray:
        """Return its middle (r, z), shape (2,): a chord c of an arc has the sagitta c/2 tan(angle/4) on its right."""
        a, b = points[self.start], points[self.end]
        return 0.5 * (a + b) + 0.5 * math.tan(0.25 * self.angle) * np.array([b[1] - a[1], a[0] - b[0]])


@dataclass(frozen=True, slots=True, eq=False)
class FemmLabel:
    """Material of the region around (r, z) [m], the circuit of its winding (None: none), and what it moves with."""

    place: tuple[float, float]
    material: FemmProperty
    circuit: FemmProperty | None
    group: int
    turns: float
    is_external: bool
    line: int

    def at(self) -> str:
        """Return its place in words."""
        return _at(*self.place)

    @property
    def current(self) -> float:
        """Current [A] of each turn, negative where they are wound backwards."""
        return 0.0 if self.circuit is None else self.circuit["totalamps_re"] * float(np.sign(self.turns))

    @property
    def is_wound(self) -> bool:
        """True for windings and wire, false for what conducts as a whole."""
        return self.material["lamtype"] >= _WIRE or (self.circuit is not None and abs(self.turns) != 1.0)


@dataclass(frozen=True, slots=True)
class FemmModel:
    """The content of a file: points (n, 2) [m]; text and line of the head's entries by key in lower case."""

    path: Path
    head: Mapping[str, tuple[str, int]]
    boundaries: list[FemmProperty]
    circuits: list[FemmProperty]
    points: np.ndarray
    edges: list[FemmEdge]
    labels: list[FemmLabel]
    holes: list[int]
    marked_points: list[int]


def read_femm(path: str | Path) -> FemmModel:
    """Read a magnetic model.

    Raises
    ------
    FileFault
        A file that is missing, too large, no magnetic model, or cut off; an entry that is no number, or names a point
        or a property that is not there; an unknown unit of length.
    """
    path = Path(path)
    if not path.is_file():
        raise FileFault(path, "is no file; check the path")
    if path.stat().st_size > MAX_FILE:
        raise FileFault(path, f"is larger than {MAX_FILE // 1_000_000} MB, which no model is; check the path")
    content = path.read_bytes()
    try:
        text = content.decode("utf-8-sig")
    except UnicodeDecodeError:
        text = content.decode("latin-1")  # as FEMM writes names under Windows
    try:
        return _model(path, enumerate(text.splitlines(), 1))
    except ValueError as error:
        commas = len(re.findall(r'(?m)^[^"\n]*?\d,\d', text)) if _DECIMAL_POINT in str(error) else 0
        more = "1 more line has" if commas == 2 else f"{commas - 1} more lines have"
        raise FileFault(path, f"{error}; {more} a decimal comma" if commas > 1 else str(error)) from None


def _model(path: Path, lines: _Lines) -> FemmModel:
    head: dict[str, tuple[str, int]] = {}
    properties: dict[str, list[FemmProperty]] = {kind: [] for kind in _KINDS.values()}
    rows: dict[str, _Rows] = {}
    for n, line in lines:
        if found := _HEAD.match(line):
            head[found[1].lower()] = (found[2], n)
            if found[1].lower() in _LISTS:
                rows[found[1].lower()] = _rows(lines, found[2], n, _LISTS[found[1].lower()])
        elif (found := _ENTRY.match(line)) and (kind := _KINDS.get(found[1].lower())):
            properties[kind].append(_property(lines, n))
    if "frequency" not in head or not rows.keys() >= {"numpoints", "numsegments", "numblocklabels"}:
        raise ValueError("is not a whole magnetic model of FEMM 4: [Frequency], points, segments or labels are missing")
    unit, at = head.get("lengthunits", ("inches", 1))
    if unit.lower() not in UNITS:
        raise ValueError(f"line {at}: [LengthUnits] = {unit}: known are {', '.join(UNITS)}")
    scale = UNITS[unit.lower()]
    points = scale * np.array([row[:2] for _, row in rows["numpoints"]]).reshape(-1, 2)
    points[np.abs(points[:, 0]) < _ON_AXIS * np.abs(points).max(initial=0.0), 0] = 0.0
    boundaries, edges = properties["boundary"], []
    for key, column in (("numsegments", 3), ("numarcsegments", 4)):
        for n, row in rows.get(key, []):
            start, end = (_place(x, len(points) - 1, n) for x in row[:2])
            angle = math.radians(row[2]) if column == 4 else 0.0
            if start == end or not 0.0 <= angle <= math.pi:
                raise ValueError(f"line {n}: an edge needs two points, and an arc 0 to 180 degrees; correct it in FEMM")
            edges.append(FemmEdge(start, end, angle, _place((row + 3 * [0.0])[column], len(boundaries), n), n))
    labels = []
    for n, row in rows["numblocklabels"]:
        material, circuit = (_place(row[k], len(properties[kind]), n) for k, kind in ((2, "material"), (4, "circuit")))
        if material == 0:
            raise ValueError(f"line {n}: the label has no material; give it one in FEMM")
        wound = properties["circuit"][circuit - 1] if circuit else None
        external = len(row) > 8 and row[8] % 2 == 1  # 2: FEMM's default label
        labels.append(FemmLabel((scale * row[0], scale * row[1]), properties["material"][material - 1], wound,
                                int(row[6]), row[7], external, n))  # fmt: skip
    marked = [n for n, row in rows["numpoints"] if any(row[2:3])]
    holes = [n for n, _ in rows.get("numholes", [])]
    return FemmModel(path, head, boundaries, properties["circuit"], points, edges, labels, holes, marked)


def _rows(lines: _Lines, count: str, head: int, least: int) -> _Rows:
    """Numbers of the lines of a list, without a direction of magnetisation in quotes."""
    wanted = int(_number(count, head))
    rows = [(n, [_number(x, n) for x in line.partition('"')[0].split()]) for n, line in islice(lines, wanted)]
    if short := [n for n, row in rows if len(row) < least] or [head] * (len(rows) < wanted):
        raise ValueError(f"line {short[0]}: the list is not complete; the file is cut off: save it again in FEMM")
    return rows


def _property(lines: _Lines, begin: int) -> FemmProperty:
    entries: dict[str, float] = {}
    name, curve = "", np.zeros((0, 2))
    for n, line in lines:
        if (found := _ENTRY.match(line)) is None:
            continue
        key, text = found[1].lower(), found[2] or ""
        if key.startswith("end"):
            return FemmProperty(name, begin, entries, curve)
        if key.endswith("name"):
            name = text.strip('"')
        elif key == "bhpoints":
            curve = np.array([row[:2] for _, row in _rows(lines, text, n, 2)]).reshape(-1, 2)
        else:
            entries[key] = _number(text, n)
    raise ValueError(f"line {begin}: the property has no end; the file is cut off: save it again in FEMM")


def _at(r: float, z: float) -> str:
    r, z = (round(1e3 * x, 6) + 0.0 for x in (r, z))  # no rest of a conversion of units, no -0
    return f"r = {r:.4g} mm, z = {z:.4g} mm"


def _number(text: str, line: int) -> float:
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        remedy = _DECIMAL_POINT if "," in text else "if the file is cut off, save it again in FEMM"
        raise ValueError(f"line {line}: {text!r} is no number; {remedy}")
    return value


def _place(value: float, last: int, line: int) -> int:
    """Place of a point or a property in its list."""
    if value != int(value) or not 0 <= value <= last:
        raise ValueError(f"line {line}: {value:g} is none of 0 to {last}; save the model again in FEMM")
    return int(value)
