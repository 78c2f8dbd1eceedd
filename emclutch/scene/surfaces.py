"""[surfaces.NAME]: a wall of triangles from a file, in addition to those of the geometry; NAME is the wall's."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from emclutch.scene.section import Choice, Section, refuse
from emclutch.scene.units import Length, number

if TYPE_CHECKING:
    from geometry.triangle_wall import TriangleWall

WIDE, TOO_WIDE = 3.0, 10.0
"""Times the space of the grains: a surface with a longer side has likely, or surely, the wrong unit of length."""
TOO_SMALL = 0.1
"""Of a grain's diameter: a surface that is smaller has the wrong unit of length."""
_UNITS = (("millimetres", 1e-3), ("inches", 25.4e-3), ("centimetres", 1e-2))


class SurfaceSection(Section):
    """A surface that grains touch from either side, in the place that its file says, the device's axis being z.

    Meshes are read in metres times `scale`, CAD files in their own unit. It has no material: the field is solved
    without it, and it mirrors no dipoles (`wall_images`), so that it stands for a part that is not magnetic.

    A face with more than four corners has to be flat and convex. A part that looks solid and has an opening gives a
    warning. A surface more than ten times as wide as the grains' space is refused, since its file is likely in
    millimetres or inches; so is one that is smaller than a tenth of a grain.
    """

    file: str = Field(
        min_length=1,
        description="STL, OBJ, PLY, VTK (.vtk, .vtu, .vtp), MSH, STEP, IGES or BREP, from the scene's folder",
    )
    body: Annotated[str, Choice(("rotor", "disc", "housing"))] = Field(
        default="housing", description="body that it turns with"
    )
    scale: Annotated[float, number("0.001", 1e-9, 1e9)] = Field(default=1.0, description="factor on the file's lengths")
    size: Length | None = Field(
        default=None, description="largest side of a triangle, for CAD files; default: what curved faces need"
    )

    @field_validator("file")
    @classmethod
    def _from_the_scenes_folder(cls, given: str, info: ValidationInfo) -> str:
        """Make the path absolute, so that a resolved scene finds the file from anywhere."""
        return str(((info.context or {}).get("folder", Path()) / given).resolve())

    @model_validator(mode="after")
    def _is_a_surface(self) -> Self:
        """Read the file once, so that what is wrong with it is reported with the scene's other faults."""
        try:
            self.wall("surface")
        except (ValueError, OSError) as error:
            raise refuse(str(error).removeprefix(self.file).lstrip(": "), key="file") from None
        return self

    def wall(self, name: str) -> TriangleWall:
        """Return the wall that grains touch."""
        path = Path(self.file)
        changed = path.stat().st_mtime_ns if path.is_file() else 0
        return _read_wall(self.file, changed, name, self.body, self.scale, self.size)

    def longest_side(self, name: str) -> float:
        """Longest side [m] of the box around the wall."""
        low, high = self.wall(name).bounds
        return float((high - low).max())

    def too_wide_in_words(self, name: str, space: float, grain: float) -> str:
        """Return how wide it is beside the longest side of the grains' `space` [m], and the factors that may be meant.

        These are the usual units in which it is neither smaller than a `grain` [m] nor much larger than the space.
        """
        side = self.longest_side(name)
        number = side / self.scale  # in the file
        meant = [unit for unit in _UNITS if grain <= unit[1] * number <= WIDE * space] or _UNITS
        factors = ", ".join(
            f"{factor:g} makes it {1e3 * factor * number:.4g} mm (a file in {unit})" for unit, factor in meant
        )
        return (
            f"measures {1e3 * side:.4g} mm, {side / space:.3g} times the grains' space ({1e3 * space:.4g} mm); a mesh "
            f"carries no unit of length: surfaces.{name}.scale = {factors}"
        )


def surface_walls(surfaces: Mapping[str, SurfaceSection]) -> list[TriangleWall]:
    """Return the walls of the tables [surfaces.NAME], in their order."""
    return [surface.wall(name) for name, surface in surfaces.items()]


def extent_in_words(low: Iterable[float], high: Iterable[float]) -> str:
    """The box between two corners [m] as text, in mm."""
    sides = zip("xyz", low, high, strict=True)
    return ", ".join(f"{axis} {1e3 * a:.4g} to {1e3 * b:.4g}" for axis, a, b in sides)


@lru_cache(maxsize=16)
def _read_wall(file: str, changed: int, name: str, body: str, scale: float, size: float | None) -> TriangleWall:
    """Read a file once for the many that ask; `changed` is its time, so that a new export is seen."""
    from geometry.surface_import import triangle_wall_from_file  # local: the schema itself needs no shapes

    return triangle_wall_from_file(file, name, body, scale=scale, size=size)
