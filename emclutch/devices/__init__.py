"""The kinds of devices of a scene, one module each: keys, checks, shape, meshes, measures of the gap, pictures.

To add one: a module here with a subclass of `GeometrySection`, its import and its place in `GEOMETRIES`; its shape is a
module of `geometry` (docs/how_to/extend.md).
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Union

from pydantic import Field

from emclutch.devices.box import BoxGeometry
from emclutch.devices.cad import CadGeometry
from emclutch.devices.centrifugal import CentrifugalGeometry
from emclutch.devices.clutch import ClutchGeometry
from emclutch.devices.drum import DrumGeometry
from emclutch.devices.geometry_section import GeometrySection
from emclutch.devices.shear_cell import ShearCellGeometry
from emclutch.devices.sheared_box import ShearedBoxGeometry

GEOMETRIES: tuple[type[GeometrySection], ...] = (
    ClutchGeometry,
    DrumGeometry,
    CentrifugalGeometry,
    ShearCellGeometry,
    BoxGeometry,
    ShearedBoxGeometry,
    CadGeometry,
)

if TYPE_CHECKING:
    Geometry = GeometrySection
else:
    Geometry = Annotated[Union[GEOMETRIES], Field(discriminator="kind")]  # noqa: UP007 (of a tuple)


def kinds_in_words(**of: bool) -> str:
    """Return "'clutch', 'drum' or 'cad'": the kinds whose attributes have the values given."""
    names = [f"'{one.name()}'" for one in GEOMETRIES if all(getattr(one, key) == value for key, value in of.items())]
    return " or ".join(part for part in (", ".join(names[:-1]), *names[-1:]) if part) or "none of this version"


__all__ = ["GEOMETRIES", "Geometry", "GeometrySection", "kinds_in_words"]
