"""[field]: where the magnetic field comes from."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import Field

from emclutch.scene.section import Choice, Section, Whole
from emclutch.scene.units import FieldStrength, number


class CoilFieldSection(Section):
    """The field of the coil in the device, by finite elements."""

    source: Literal["coil"]
    order: Annotated[int, Whole(1, 3, "2")] = Field(default=2, description="polynomial order of the elements")
    gap_layers: Annotated[int, Whole(3, 40, "4")] = Field(default=4, description="element layers across a gap")
    size_factor: Annotated[float, number("1", 0.1, 4.0)] = Field(default=1.0, description="scales the mesh size")
    tolerance: Annotated[float, number("1e-3", 1e-6, 0.1)] | None = Field(
        default=None, description="refine the mesh until flux linkage and gap field are this accurate; unset: as meshed"
    )
    open_boundary: bool = Field(default=True, description="air goes on beyond the mesh; false: a flux wall there")
    newton_tolerance: Annotated[float, number("1e-8", 1e-14, 1e-2)] = Field(
        default=1e-8, description="relative residual at which Newton stops"
    )


class UniformFieldSection(Section):
    """A prescribed field for tests of grains: uniform, or radial, H_r = H0 R0/r, R0 in mid gap."""

    source: Literal["uniform"]
    field_strength: FieldStrength = Field(description="H0")
    direction: Annotated[str, Choice(("x", "y", "z", "axial", "radial"))] = Field(description="of H; axial is z")
    means: Annotated[str, Choice(("applied", "macroscopic"))] = Field(
        default="applied",
        description="applied: the field without grains; macroscopic: the mean field of an even powder, which holds "
        "the grains spread out over the dipoles' cut-off (models mutual and near_field); across steel faces of a shear "
        "cell (direction radial, effect wall_images) layers of grains change it",
    )

    @property
    def is_macroscopic(self) -> bool:
        """True if it is the mean field of an even powder, and not that without grains."""
        return self.means == "macroscopic"


FieldSection = Annotated[CoilFieldSection | UniformFieldSection, Field(discriminator="source")]
