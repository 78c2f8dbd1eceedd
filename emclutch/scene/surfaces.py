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


class SurfaceSection(Section):
    """A surface that grains touch from either side, in the place that its file says, the device's axis being z.

    Meshes are read in metres times `scale`, CAD files in their own unit. It has no material: the field is solved
    without it, and it mirrors no dipoles (`wall_images`), so that it stands for a part that is not magnetic.

    A face with more than four corners has to be flat and convex. A part that looks solid and has an opening gives a
    warning.
    """

    file: str = Field(
        min_length=1, description="STL, OBJ, PLY, VTK or MSH, or STEP, IGES or BREP, from the scene's folder"
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
