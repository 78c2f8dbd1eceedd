"""Named parts of a device from elsewhere: which region a name stands for, and what is wrong with names and sizes.

A part's region is its name in the file (the STEP product, or the instance, of the tree that a CAD program shows; the
physical group or the cell set of a mesh), without regard to case and without the counter that CAD programs append
(«cover:2», «cover-1» are ``cover``); other names are translated by the caller.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path

# Outside of it a unit is wrong by a thousand: the devices meant here measure 5 mm to 5 m.
SMALLEST, LARGEST = 2e-3, 10.0
_ROUNDED = 1e-8  # m; coordinates in a STEP file are rounded to 1e-9 or better
# Part names that a translator makes up where the file has none.
_MADE_UP = re.compile(r"open cascade.*|shape\d*|solid\d*|compound\d*|\d*|=>\[.*|component\d*|body\d*", re.IGNORECASE)
_COUNTER = re.compile(r"[:<#._ -]+v?\d+>?$")


class CadError(ValueError):
    """A CAD file that cannot be taken as a device; says what was found in it and what to do."""


@dataclass(frozen=True, slots=True)
class CadPart:
    """One part of the file, as it lies in the section.

    Attributes
    ----------
    name : str
        As it stands in the file; empty where it has none.
    region : str
        What it was taken for.
    area, radius : float
        Of its section [m^2], and where its centroid lies [m].
    r0, r1, z0, z1 : float
        Its bounding box [m].
    """

    name: str
    region: str
    area: float
    radius: float
    r0: float
    r1: float
    z0: float
    z1: float

    def __str__(self) -> str:
        place = f"r {1e3 * self.r0:.4g} to {1e3 * self.r1:.4g} mm, z {1e3 * self.z0:.4g} to {1e3 * self.z1:.4g} mm"
        taken = f"taken for {self.region!r}" if self.region else "not taken: no name"
        return f"{self.name or '(no name)'}: {1e6 * self.area:.4g} mm2, {place}, {taken}"


def list_of(parts: Sequence[CadPart] | Sequence[CadSolid]) -> str:
    """Return what was found in a file, a line a part."""
    return "\n".join(["found in the file:", *(f"  {part}" for part in parts)])


@dataclass(frozen=True, slots=True)
class CadSolid:
    """One solid of the file: `name` in it, `region` it was taken for, volume [m^3], corners of its box [m]."""

    name: str
    region: str
    volume: float
    lower: tuple[float, float, float]
    upper: tuple[float, float, float]

    def __str__(self) -> str:
        sides = (
            f"{axis} {1e3 * a:.4g} to {1e3 * b:.4g}" for axis, a, b in zip("xyz", self.lower, self.upper, strict=True)
        )
        taken = f"taken for {self.region!r}" if self.region else "not taken: no name"
        return f"{self.name or '(no name)'}: {1e9 * self.volume:.4g} mm3, {', '.join(sides)} mm, {taken}"


def plain_name(name: str) -> str:
    """A name as regions are written: lower case, no counter, underscores."""
    return _spelt(_COUNTER.sub("", name.strip()))


def _spelt(name: str) -> str:
    return re.sub(r"[\s-]+", "_", name.strip().lower())


def own_name(label: str) -> str:
    """The last part of a tree's path that a person wrote; empty where none was."""
    steps = [step for step in label.split("/") if step and not _MADE_UP.fullmatch(step.strip())]
    return steps[-1] if steps and steps != ["Shapes"] else ""


def region_of(label: str, names: Mapping[str, str], expected: Sequence[str]) -> str:
    """The region of a label: a translated or an expected name on its path, the last one first; else its last name."""
    translated = {plain_name(name): region for name, region in names.items()}
    steps = [step for step in reversed(label.split("/")) if step and not _MADE_UP.fullmatch(step.strip())]
    for step in steps:
        for given in (step, plain_name(step)):
            if given in names or given in translated:
                return names.get(given) or translated[given]
    for step in steps:
        for given in (_spelt(step), plain_name(step)):  # «shaft_1» may be a region's own name
            if given in expected:
                return given
    return plain_name(own_name(label))


def check_size(path: Path, size: float, remedy: str) -> None:
    """Refuse a device whose largest side [m] says that the file's unit of length was misread.

    `remedy` is a text with ``{factor}`` where the factor on the lengths belongs.
    """
    if not SMALLEST <= size <= LARGEST:
        factor = "0.001" if size > LARGEST else "1000"
        raise CadError(
            f"{path}: the device measures {size:.4g} m, which is none of a clutch ({SMALLEST:g} to {LARGEST:g} m): the "
            f"file's unit of length is likely wrong; {remedy.format(factor=factor)}"
        )


def check_names(
    path: Path, parts: list[CadPart] | list[CadSolid], needed: Sequence[str], known: Sequence[str] | None
) -> None:
    """Refuse parts without a name, a needed region that is not there, and one that is not known (None: any is)."""
    unnamed = sum(not part.region for part in parts)
    found = list_of(parts)
    if unnamed:
        raise CadError(
            f"{path}: {unnamed} of {len(parts)} parts have no name; name the parts in the CAD program as the "
            f"regions are called, and export STEP\n{found}"
        )
    there = {part.region for part in parts}
    missing = [name for name in needed if name not in there]
    if missing:
        close = {name: get_close_matches(name, sorted(there), n=1, cutoff=0.65) for name in missing}
        hints = [f"is {near[0]!r} the {name}?" for name, near in close.items() if near]
        raise CadError(
            f"{path} has no part named {', '.join(map(repr, missing))}; "
            f"{' '.join(hints)}{' ' if hints else ''}rename the part, or translate its name with `names`\n{found}"
        )
    if known is not None and not there <= {*known, *needed}:
        strange = ", ".join(sorted(map(repr, there - {*known, *needed})))
        raise CadError(
            f"{path} has parts whose name means nothing here: {strange}; give each a material (known: "
            f"{', '.join(known)}), or translate the name with `names`\n{found}"
        )


def check_side(path: Path, parts: list[CadPart]) -> None:
    """Refuse parts beyond the axis."""
    beyond = [part for part in parts if part.r0 < -_ROUNDED]
    if beyond:
        raise CadError(
            f"{path}: {', '.join(part.region for part in beyond)} reach to r = {1e3 * beyond[0].r0:.4g} mm, beyond the "
            f"axis; keep the half with x > 0 of the section\n{list_of(parts)}"
        )
