"""particles.sizes: how the diameters of the grains are distributed, by number."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from emclutch.scene.section import Choice, Section, refuse
from emclutch.units import Length, number

if TYPE_CHECKING:
    from particles.packing.sizes import GrainSizes

_GeometricSpread = Annotated[float, number("1.2", 1.0, 10.0, above=True)]
_Weight = Annotated[float, number("0.2", 0.0)]


class _Distribution(Section):
    """What all kinds share: they are right if the distribution can be made."""

    @model_validator(mode="after")
    def _can_be_drawn(self) -> Self:
        try:
            self.distribution()
        except (ValueError, OSError) as error:
            raise refuse(str(error)) from None
        return self

    def distribution(self) -> GrainSizes:
        """Return the distribution, in SI."""
        raise NotImplementedError


class UniformDiameters(_Distribution):
    """Every diameter between two limits is as likely."""

    kind: Literal["uniform"]
    min: Length = Field(description="smallest diameter")
    max: Length = Field(description="largest diameter")

    def distribution(self) -> GrainSizes:
        """Return the distribution, in SI."""
        from particles.packing.sizes import UniformSizes  # local, as below: scenes of equal grains load without numba

        return UniformSizes(self.min, self.max)


class NormalDiameters(_Distribution):
    """Gaussian, cut off on both sides."""

    kind: Literal["normal"]
    mean: Length = Field(description="mean diameter, before the cut")
    deviation: Length = Field(description="standard deviation, before the cut")
    min: Length | None = Field(default=None, description="smallest diameter; default: mean - 3 deviations")
    max: Length | None = Field(default=None, description="largest diameter; default: mean + 3 deviations")

    def distribution(self) -> GrainSizes:
        """Return the distribution, in SI."""
        from particles.packing.sizes import NormalSizes

        return NormalSizes(self.mean, self.deviation, self.min, self.max)


class LogNormalDiameters(_Distribution):
    """Gaussian in the logarithm of the diameter, cut off on both sides."""

    kind: Literal["log_normal"]
    median: Length = Field(description="median diameter by number; of one by mass take median exp(-3 ln^2 spread)")
    spread: _GeometricSpread = Field(description="geometric standard deviation: 68 % within this factor of the median")
    min: Length | None = Field(default=None, description="smallest diameter; default: median / spread^3")
    max: Length | None = Field(default=None, description="largest diameter; default: median * spread^3")

    def distribution(self) -> GrainSizes:
        """Return the distribution, in SI."""
        from particles.packing.sizes import LogNormalSizes

        return LogNormalSizes(self.median, self.spread, self.min, self.max)


class ListedDiameters(_Distribution):
    """Some diameters with their shares, as sieves give them."""

    kind: Literal["list"]
    diameters: tuple[Length, ...] = Field(min_length=1, description="diameters")
    shares: tuple[_Weight, ...] | None = Field(default=None, description="share of each, any scale; default: alike")
    by: Annotated[str, Choice(("number", "mass"))] = Field(default="number", description="shares of what")

    def distribution(self) -> GrainSizes:
        """Return the distribution, in SI."""
        from particles.packing.sizes import ListedSizes

        return ListedSizes(self.diameters, self.shares, by_mass=self.by == "mass")


class DiametersOfFile(_Distribution):
    """A CSV file with a column diameter and perhaps its share, number or mass; units stand in the heads."""

    kind: Literal["file"]
    file: str = Field(min_length=1, description="CSV such as 'diameter [um], mass [%]', from the scene's folder")

    @field_validator("file")
    @classmethod
    def _from_the_scenes_folder(cls, given: str, info: ValidationInfo) -> str:
        return from_the_scenes_folder(given, info.context)

    def distribution(self) -> GrainSizes:
        """Return the distribution, in SI."""
        from particles.packing.sizes import read_sizes

        return read_sizes(self.file)


def from_the_scenes_folder(given: str, context: dict[str, Any] | None) -> str:
    """Make a path absolute, so that a resolved scene finds the file from anywhere."""
    return str(((context or {}).get("folder", Path()) / given).resolve())


Sizes = Annotated[
    UniformDiameters | NormalDiameters | LogNormalDiameters | ListedDiameters | DiametersOfFile,
    Field(discriminator="kind"),
]
