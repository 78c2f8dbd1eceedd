"""particles.sizes: how the diameters of the grains are distributed, by number."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, Self

from pydantic import Discriminator, Field, Tag, ValidationInfo, field_validator, model_validator

from emclutch.scene.errors import reason_of
from emclutch.scene.section import Choice, Section, refuse, value_or_table
from emclutch.scene.units import Length, number

if TYPE_CHECKING:
    from particles.packing.sizes import GrainSizes

_GeometricSpread = Annotated[float, number("1.2", 1.0, 10.0, above=True)]
_Weight = Annotated[float, number("0.2", 0.0)]


class _Distribution(Section):
    """Base of all kinds: valid if the distribution can be made."""

    @model_validator(mode="after")
    def _can_be_drawn(self) -> Self:
        self._check()
        try:
            self.distribution()
        except (ValueError, OSError) as error:
            raise refuse(str(error)) from None
        return self

    def _check(self) -> None:
        """Refuse what can be assigned to a key."""

    def _check_limits(self, middle: str, width: str, smallest: float, largest: float) -> None:
        """Refuse limits that are not positive and ascending, or that do not enclose the key ``middle``."""
        given = self.model_fields_set
        if smallest <= 0.0:
            raise refuse(
                f"is missing, and three deviations below {middle} is {1e3 * smallest:.4g} mm, which is not a diameter; "
                f"give it, or lower {width}",
                key="min",
            )
        if smallest >= largest:
            key, other = ("min", f"max = {1e3 * largest:.4g} mm") if "min" in given else ("max", "the smallest")
            side = "not below" if key == "min" else "not above"
            raise refuse(f"is {side} {other}; the smallest diameter must be below the largest", key=key)
        if not smallest <= getattr(self, middle) <= largest:
            raise refuse(
                f"is not between the limits {1e3 * smallest:.4g} and {1e3 * largest:.4g} mm; move it, or min and max",
                key=middle,
            )

    def distribution(self) -> GrainSizes:
        """Return the distribution, in SI."""
        raise NotImplementedError


class UniformDiameters(_Distribution):
    """Every diameter between two limits is as likely."""

    kind: Literal["uniform"]
    min: Length = Field(description="smallest diameter")
    max: Length = Field(description="largest diameter")

    def _check(self) -> None:
        if self.min >= self.max:
            raise refuse(f"is not below max = {1e3 * self.max:.4g} mm; the smallest diameter comes first", key="min")

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

    def _check(self) -> None:
        smallest = self.mean - 3.0 * self.deviation if self.min is None else self.min
        largest = self.mean + 3.0 * self.deviation if self.max is None else self.max
        self._check_limits("mean", "deviation", smallest, largest)

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

    def _check(self) -> None:
        smallest = self.median / self.spread**3 if self.min is None else self.min
        largest = self.median * self.spread**3 if self.max is None else self.max
        self._check_limits("median", "spread", smallest, largest)

    def distribution(self) -> GrainSizes:
        """Return the distribution, in SI."""
        from particles.packing.sizes import LogNormalSizes

        return LogNormalSizes(self.median, self.spread, self.min, self.max)


class PercentileDiameters(_Distribution):
    """The diameters that 10, 50 and 90 % of the powder are finer than, as makers give them."""

    kind: Literal["percentiles"] = "percentiles"
    d10: Length = Field(description="10 % of the powder are finer")
    d50: Length = Field(description="half of it is finer")
    d90: Length = Field(description="90 % are finer")
    min: Length | None = Field(default=None, description="smallest diameter; default: d10^2 / d50")
    max: Length | None = Field(default=None, description="largest diameter; default: d90^2 / d50")
    by: Annotated[str, Choice(("mass", "number"))] = Field(
        default="mass",
        description="percentages of what: mass (sieves; volume, as by laser diffraction, is the same) or number",
    )

    def _check(self) -> None:
        keys = ("min", "d10", "d50", "d90", "max")
        given = [(key, value) for key in keys if (value := getattr(self, key)) is not None]
        for (below, smaller), (key, larger) in pairwise(given):
            if not smaller < larger:
                raise refuse(
                    f"is not above {below} = {1e3 * smaller:.4g} mm; percentiles ascend: min < d10 < d50 < d90 < max",
                    key=key,
                )

    def distribution(self) -> GrainSizes:
        """Return the distribution, in SI."""
        from particles.packing.sizes import PercentileSizes

        return PercentileSizes(self.d10, self.d50, self.d90, self.min, self.max, by_mass=self.by == "mass")


class ListedDiameters(_Distribution):
    """Some diameters with their shares, as sieves give them."""

    kind: Literal["list"]
    diameters: tuple[Length, ...] = Field(min_length=1, description="diameters")
    shares: tuple[_Weight, ...] | None = Field(default=None, description="fraction of each, any scale; default: alike")
    by: Annotated[str, Choice(("number", "mass"))] = Field(default="number", description="shares of what")

    def _check(self) -> None:
        from particles.packing.sizes import refuse_cumulative

        if self.shares is None:
            return
        if len(self.shares) != len(self.diameters):
            raise refuse(
                f"has {len(self.shares)} entries, but diameters {len(self.diameters)}; give a fraction for each",
                key="shares",
            )
        if not any(self.shares):
            raise refuse("are all 0; at least one must be positive", key="shares")
        try:
            refuse_cumulative(self.shares)
        except ValueError as error:
            raise refuse(f"cannot be used: {error}", key="shares") from None

    def distribution(self) -> GrainSizes:
        """Return the distribution, in SI."""
        from particles.packing.sizes import ListedSizes

        return ListedSizes(self.diameters, self.shares, by_mass=self.by == "mass")


class DiametersOfFile(_Distribution):
    """A table with a column diameter and perhaps shares by number, mass, weight or volume; each has its unit."""

    kind: Literal["file"]
    file: str = Field(min_length=1, description="CSV such as 'diameter [um], mass [%]', from the scene's folder")

    @field_validator("file")
    @classmethod
    def _from_the_scenes_folder(cls, given: str, info: ValidationInfo) -> str:
        return from_the_scenes_folder(given, info.context)

    def _check(self) -> None:
        try:
            self.distribution()
        except ValueError as error:
            raise refuse(reason_of(error), key="file") from None

    def distribution(self) -> GrainSizes:
        """Return the distribution, in SI."""
        from particles.packing.sizes import read_sizes

        return read_sizes(self.file)


def from_the_scenes_folder(given: str, context: dict[str, Any] | None) -> str:
    """Make a path absolute, so that a resolved scene finds the file from anywhere."""
    return str(((context or {}).get("folder", Path()) / given).resolve())


RealSize = Annotated[
    Annotated[Length, Tag("value")] | Annotated[PercentileDiameters, Tag("table")], Discriminator(value_or_table)
]
Sizes = Annotated[
    UniformDiameters | NormalDiameters | LogNormalDiameters | PercentileDiameters | ListedDiameters | DiametersOfFile,
    Field(discriminator="kind"),
]
