"""geometry.kind = "shear_cell": grains between two coaxial cylinders (`geometry.annular_cell`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Literal

from pydantic import Field

from emclutch.devices.geometry_section import NO_MATERIALS, GeometrySection
from emclutch.scene.units import Length

if TYPE_CHECKING:
    from emclutch.device_model.pole_zone import GapZone
    from emclutch.scene.materials import Material
    from geometry.annular_cell import ShearCell
    from geometry.dimensioned_views import View


class ShearCellGeometry(GeometrySection):
    """The annulus between two cylinders: body `disc` inside, `rotor` outside, floor and ceiling at rest."""

    is_annulus = True

    kind: Literal["shear_cell"]
    inner_radius: Length = Field(description="radius of the inner cylinder")
    outer_radius: Length = Field(description="radius of the outer cylinder")
    height: Length = Field(description="axial height")

    def shape(self, own: Mapping[str, Material] = NO_MATERIALS) -> ShearCell:
        """Return the shape for walls and volumes."""
        from geometry.annular_cell import ShearCell

        return ShearCell(self.inner_radius, self.outer_radius, self.height)

    def dimension_views(self, shape: ShearCell) -> list[View]:
        """See `GeometrySection.dimension_views`."""
        from geometry.dimensioned_views import cell_views

        return cell_views(shape)

    def gap_zone(self, shape: ShearCell, region: str) -> GapZone:
        """All of the annulus."""
        from emclutch.device_model.pole_zone import GapZone

        (box,) = shape.fill_boxes().values()
        return GapZone.between_cylinders(box, shape.sheared_gap(region).radius)
