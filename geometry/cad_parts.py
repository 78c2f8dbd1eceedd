"""Named parts of a device from elsewhere: which region a name stands for, and what is wrong with names and sizes.

A part's region is its name in the file (the STEP product, or the instance, of the tree that a CAD program shows; the
physical group or the cell set of a mesh), without regard to case and without the counter that CAD programs append
(«cover:2», «cover-1» are ``cover``); other names are translated by the caller.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import get_close_matches
from pathlib import Path

from geometry.file_content import CadError

# Outside of it a unit is wrong by a thousand: the devices meant here measure 5 mm to 5 m.
SMALLEST, LARGEST = 2e-3, 10.0
_ROUNDED = 1e-8  # m; coordinates in a STEP file are rounded to 1e-9 or better
# Part names that a translator makes up where the file has none.
_MADE_UP = re.compile(r"open cascade.*|shape\d*|solid\d*|compound\d*|\d*|=>\[.*|component\d*|body\d*", re.IGNORECASE)
_NUMBERED = re.compile(r"part[1-9]\d*")
_COUNTER = re.compile(r"[:<#._ -]+v?\d+>?$")


@dataclass(frozen=True, slots=True)
class CadPart:
    """One part of a file: a face of the section, with lengths along r and z, or a solid, along x, y and z.

    Attributes
    ----------
    name : str
        As it stands in the file; ``part3`` for the third part where it has none.
    region : str
        What it was taken for.
    size : float
        Area [m^2] of a face, volume [m^3] of a solid.
    lower, upper : tuple of float
        Corners of its bounding box [m].
    radius : float
        Where the centroid of a face lies [m].
    """

    name: str
    region: str
    size: float = 0.0
    lower: tuple[float, ...] = (0.0, 0.0)
    upper: tuple[float, ...] = (0.0, 0.0)
    radius: float = 0.0

    def __str__(self) -> str:
        solid = len(self.lower) == 3
        sides = zip("xyz" if solid else "rz", self.lower, self.upper, strict=True)
        turned = "" if solid else f", turned {2e6 * math.pi * self.radius * self.size:.4g} cm3"
        place = ", ".join(f"{axis} {1e3 * a:.4g} to {1e3 * b:.4g}{'' if solid else ' mm'}" for axis, a, b in sides)
        size = f"{1e9 * self.size:.4g} mm3" if solid else f"{1e6 * self.size:.4g} mm2"
        region_text = "no name in the file" if is_number(self.region) else f"taken for {self.region!r}"
        return f"{self.name}: {size}, {place}{' mm' if solid else ''}{turned}, {region_text}"


@dataclass(frozen=True, slots=True)
class CadFile:
    """A file of named parts, and what its names and lengths mean.

    Attributes
    ----------
    path : Path
    names : mapping
        Region of a name in the file, where they differ.
    needed : sequence of str
        Regions that must be there.
    known : sequence of str, optional
        All regions that may be there; None: any.
    axis : {"x", "y", "z"}
        Axis of revolution of solids; sections of faces say it by their plane, meshes have it along y or z.
    scale : float
        Factor on all lengths.
    trust_scripts : bool
        Whether a .geo file may be run; it can run any command.
    any_shape : bool
        Whether solids may be of any shape.
    """

    path: Path
    names: Mapping[str, str] = field(default_factory=dict)
    needed: Sequence[str] = ()
    known: Sequence[str] | None = None
    axis: str = "z"
    scale: float = 1.0
    trust_scripts: bool = False
    any_shape: bool = False

    def region_of(self, label: str) -> str:
        """Return the region of a label: a translated or known name on its path, the last first; else its last name."""
        translated = {plain_name(name): region for name, region in self.names.items()}
        steps = [step for step in reversed(label.split("/")) if step and not _MADE_UP.fullmatch(step.strip())]
        for step in steps:
            for given in (step, plain_name(step)):
                if given in self.names or given in translated:
                    return self.names.get(given) or translated[given]
        for step in steps:
            for given in (_spell(step), plain_name(step)):  # «shaft_1» may be a region's own name
                if self.expects(given):
                    return given
        return plain_name(own_name(label))

    def expects(self, region: str) -> bool:
        """True if a region is one that is needed or known."""
        return region in self.needed or region in (self.known or ())

    def check_size(self, size: float, remedy: str) -> None:
        """Refuse a device whose largest side [m] says that the file's unit of length was misread.

        `remedy` is a text with ``{factor}`` where the factor on the lengths belongs.
        """
        if not SMALLEST <= size <= LARGEST:
            factor = "0.001" if size > LARGEST else "1000"
            raise CadError(
                f"{self.path}: the device measures {size:.4g} m, which is none of a clutch ({SMALLEST:g} to "
                f"{LARGEST:g} m): the file's unit of length is likely wrong; {remedy.format(factor=factor)}"
            )

    def check_parts(self, parts: Sequence[CadPart]) -> None:
        """Refuse parts without a name or beyond the axis, and regions that are missing or mean nothing."""
        part_list = list_of(parts)
        unnamed = [part.name for part in parts if is_number(part.region) and not self.expects(part.region)]
        if unnamed:
            raise CadError(
                f"{self.path}: {len(unnamed)} of {len(parts)} parts have no name; name them in the CAD program as the "
                "regions are called, and export STEP, or translate their numbers with `names`, as in "
                f'{{ {unnamed[0]} = "disc" }}\n{part_list}'
            )
        there = {part.region for part in parts}
        missing = [name for name in self.needed if name not in there]
        if missing:
            close = {name: get_close_matches(name, sorted(there), n=1, cutoff=0.65) for name in missing}
            hints = "".join(f"is {near[0]!r} the {name}? " for name, near in close.items() if near)
            raise CadError(
                f"{self.path} has no part named {', '.join(map(repr, missing))}; {hints}rename the part, or translate "
                f"its name with `names`\n{part_list}"
            )
        strange = [] if self.known is None else sorted(repr(name) for name in there if not self.expects(name))
        if strange:
            raise CadError(
                f"{self.path} has parts whose name means nothing here: {', '.join(strange)}; give each a material "
                f"(known: {', '.join(self.known or ())}), or translate the name with `names`\n{part_list}"
            )
        beyond = [part for part in parts if len(part.lower) == 2 and part.lower[0] < -_ROUNDED]
        if beyond:
            raise CadError(
                f"{self.path}: {', '.join(part.region for part in beyond)} reach to r = {1e3 * beyond[0].lower[0]:.4g} "
                f"mm, beyond the axis; keep the half with x > 0 of the section\n{part_list}"
            )


def is_number(name: str) -> bool:
    """True for ``part3``, as the third part of a file is called that has no name there."""
    return _NUMBERED.fullmatch(name) is not None


def list_of(parts: Sequence[CadPart]) -> str:
    """Parts found in a file, a line each."""
    return "\n".join(["found in the file:", *(f"  {part}" for part in parts)])


def plain_name(name: str) -> str:
    """Return a name as regions are written: lower case, no counter, underscores."""
    return _spell(_COUNTER.sub("", name.strip()))


def own_name(label: str) -> str:
    """Return the last part of a tree's path that a person wrote; empty where none was."""
    steps = [step for step in label.split("/") if step and not _MADE_UP.fullmatch(step.strip())]
    return steps[-1] if steps and steps != ["Shapes"] else ""


def _spell(name: str) -> str:
    return re.sub(r"[\s-]+", "_", name.strip().lower())
