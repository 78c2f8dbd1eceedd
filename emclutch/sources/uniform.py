"""field.source = "uniform": a prescribed field, uniform or radial, as the field without grains or as the mean one."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from emclutch.scene.errors import Fault
from emclutch.scene.grain_smear import layers_change_the_field, smear_width
from emclutch.scene.partial_scene import PartialScene
from emclutch.scene.section import Choice
from emclutch.scene.units import FieldStrength
from emclutch.scene.usual_ranges import FLUX_DENSITY
from emclutch.sources.source_section import SourceSection

if TYPE_CHECKING:
    from field import RadialField, UniformField

_MU_0 = 4e-7 * math.pi  # [H/m]; the field's own constant would load the field


def _radial_in_an_annulus(partial: PartialScene) -> Iterator[Fault]:
    """A radial field needs two cylinders."""
    from emclutch.devices import kinds_in_words  # local: the list names this module

    if partial.scene.field.direction == "radial" and not partial.scene.geometry.is_annulus:
        yield partial.fault(
            "field.direction",
            f"needs geometry.kind = {kinds_in_words(is_annulus=True)}, whose mid radius is that of "
            "field_strength; take another direction, e.g. 'axial'",
        )


def _alike_in_every_sector(partial: PartialScene) -> Iterator[Fault]:
    """A uniform field across the axis differs from sector to sector."""
    if partial.scene.particles.sector is not None and partial.scene.field.direction in ("x", "y"):
        yield partial.fault(
            "field.direction",
            "turns from sector to sector; with particles.sector take 'axial' or 'radial', or remove particles.sector",
        )


class UniformFieldSection(SourceSection):
    """A prescribed field for tests of grains: uniform, or radial, H_r = H0 R0/r, R0 in mid gap."""

    CHECKS: ClassVar = (
        (_radial_in_an_annulus, ("geometry.kind",)),
        (_alike_in_every_sector, ("particles",)),
    )

    source: Literal["uniform"]
    field_strength: FieldStrength = Field(description="H0")
    direction: Annotated[str, Choice(("x", "y", "z", "axial", "radial"))] = Field(description="of H; axial is z")
    means: Annotated[str, Choice(("applied", "macroscopic"))] = Field(
        default="applied",
        description="applied: the field without grains; macroscopic: the mean field of an even powder, which holds "
        "the grains spread out over the dipoles' cut-off (models mutual and near_field); between the steel faces of a "
        "sheared_box (effect wall_images) layers of grains change it",
    )

    @property
    def is_macroscopic(self) -> bool:
        """True if it is the mean field of an even powder, and not that without grains."""
        return self.means == "macroscopic"

    def usual_entries(self):
        """Yield the flux density in air [T]."""
        yield FLUX_DENSITY, "mu_0 field.field_strength", abs(_MU_0 * self.field_strength)

    def imposed_field(self, shape: Any) -> UniformField | RadialField:
        """Return the field in a shape; a radial one in that of an annulus."""
        from field import RadialField, UniformField

        if self.direction == "radial":
            return RadialField(self.field_strength, 0.5 * (shape.inner_radius + shape.outer_radius))
        axis = {"x": 0, "y": 1, "z": 2, "axial": 2}[self.direction]
        return UniformField(self.field_strength * np.eye(3)[axis])

    def equip(self, device, scene):
        """Give the device its field; it needs no mesh."""
        return replace(device, imposed=self.imposed_field(device.shape))

    def build(self, scene, device, bodies, walls, peak):
        """Build the field as it is, or with the layers of grains that change it between steel faces."""
        from coupling import ImposedField, LayeredField

        if not layers_change_the_field(scene):
            return ImposedField(device.imposed)
        length, width, height = device.shape.size
        return LayeredField(float(device.imposed.H[2]), height, length * width, smear_width(scene))
