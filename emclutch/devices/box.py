"""geometry.kind = "box": a closed box at rest (`geometry.box`)."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Literal

from pydantic import Field

from emclutch.devices.geometry_section import NO_MATERIALS, GeometrySection
from emclutch.scene.units import Length

if TYPE_CHECKING:
    from emclutch.device_model.device import Device
    from emclutch.scene.materials import Material
    from emclutch.simulation.forecast.expected_torque import ExpectedTorque
    from geometry.box import Box
    from geometry.dimensioned_views import View


class BoxGeometry(GeometrySection):
    """A closed box at rest, x and y centred on the axis, its floor at z = 0."""

    has_axis = False
    measured = ""
    why_no_sector = "needs a shape with an axis; remove it, or take another geometry.kind than 'box'"

    kind: Literal["box"]
    size: tuple[Length, Length, Length] = Field(description="lengths along x, y and z")

    def shape(self, own: Mapping[str, Material] = NO_MATERIALS) -> Box:
        """Return the shape for walls and volumes."""
        from geometry.box import Box

        return Box(self.size)

    def dimension_views(self, shape: Box) -> list[View]:
        """See `GeometrySection.dimension_views`."""
        from geometry.dimensioned_views import box_views

        return box_views(shape.size)

    def friction_torque(self, scene: Any, device: Device) -> ExpectedTorque:
        """None: nothing turns."""
        from emclutch.simulation.forecast.expected_torque import ExpectedTorque

        return ExpectedTorque(None, "a box has no shaft")
