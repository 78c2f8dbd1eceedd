"""[particles]: the grains, how they are packed, and how they magnetise."""

from __future__ import annotations

import math
from contextlib import suppress
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Self

from pydantic import Field, ValidationInfo, field_validator, model_validator

from emclutch.scene.errors import reason_of
from emclutch.scene.scaled import Scaled, SectorAngle
from emclutch.scene.section import Choice, Integer, Section, not_one_of, refuse
from emclutch.scene.sizes import RealSize, Sizes, from_the_scenes_folder
from emclutch.scene.units import Density, Length, Magnetisation, Mass, ReposeAngle, Time, number

if TYPE_CHECKING:
    from particles.packing.packing import Packing
    from particles.packing.sizes import GrainSizes

MAX_SOLID_FRACTION = 0.60
"""Fill beyond which equal spheres are not packed at random without pressing them (close packing: 0.64)."""

MAX_GRAINS = 10_000_000
"""That are simulated: 40 GB of them; their sizes alone are drawn in a second."""

_LATTICE_DENSITY = {"sc": math.pi / 6.0, "fcc": math.pi / math.sqrt(18.0), "hcp": math.pi / math.sqrt(18.0)}
_AMOUNTS = ("mass", "solid_fraction", "count")


class ParticlesSection(Section):
    """Spheres; their amount: mass or solid fraction of the whole device, or the simulated count.

    Without this section, and without effects, the scene is of the coil's field alone: `emclutch check`, `field` and
    `mesh` take it, with `[geometry]`, `[coil]` and `[field]`; a run refuses it.
    """

    diameter: Length | None = Field(
        default=None, description="diameter of equal grains; or sizes", examples=["0.25 mm"]
    )
    sizes: Sizes | None = Field(default=None, description="distribution of diameters, instead of diameter")
    stands_for: RealSize | None = Field(
        default=None,
        description="size of the real powder, if the simulated grains are coarser: a diameter, or "
        "percentiles as in sizes; without it the grains have their real size",
        examples=["60 um"],
    )
    mass: Mass | None = Field(default=None, description="mass of powder in the whole device, not only in the sector")
    solid_fraction: Annotated[float, number("0.4", 0.0, 1.0, above=True)] | None = Field(
        default=None,
        description="volume of grains / volume of the region; at most 0.60 for a random packing, 0.58 in a sheared_box",
    )
    count: Annotated[int, Integer(1, MAX_GRAINS, "1000")] | None = Field(
        default=None, description="number of simulated grains (in the sector, if there is one)"
    )
    material: str | None = Field(
        default=None,
        min_length=1,
        description="name of the material of the grains, in place of density, susceptibility and saturation; emclutch "
        "materials lists the names",
        examples=["carbonyl_iron"],
    )
    density: Density = Field(default=7700.0, description="density of the grain's material")
    region: Annotated[str, Choice(("cavity", "rim", "poles", "faces"))] = Field(
        default="cavity",
        description="where the powder is at the start: rim: radial gap; poles: the part of the rim between "
        "the pole faces, as after running in; faces: both axial gaps; cavity: rim and faces",
    )
    sector: SectorAngle | None = Field(
        default=None,
        description="simulate only a sector of the ring: an angle that divides 360 deg, or its width at the smallest "
        "radius of a grain's centre, rounded up to a whole number of sectors",
    )
    packing: Annotated[str, Choice(("random", "grow", "lattice", "pour", "file"))] = Field(
        default="random",
        description="initial positions: random (fill up to 0.60), grow (denser, slower), lattice (in rows), "
        "pour (loose fall), file (from packing_file)",
    )
    lattice: Annotated[str, Choice(("sc", "fcc", "hcp"))] = Field(default="fcc", description="for packing = 'lattice'")
    noise: Annotated[float, number("0.5", 0.0, 1.0)] = Field(
        default=0.0, description="for packing = 'lattice': random displacement / play between neighbours"
    )
    packing_file: str | None = Field(
        default=None,
        min_length=1,
        description="for packing = 'file': a table (.csv, .txt), npz or vtp, from the scene's folder",
    )
    settle: bool = Field(default=False, description="let the grains come to rest before time 0; pour always does")
    settle_kinetic: Annotated[float, number("1e-6", 1e-15, 0.1)] = Field(
        default=1e-6,
        description="kinetic energy at which grains are at rest, / m g d (without gravity / energy of the contacts)",
    )
    settle_longest: Time | None = Field(
        default=None, description="longest simulated time to rest; default: 100 falls", examples=["1 s"]
    )
    initial_velocity: Annotated[str, Choice(("rest", "sheared"))] = Field(
        default="rest",
        description="velocities at time 0: none, or those of a steady shear between the shafts, as in powder that has "
        "run for a while",
    )
    repose: ReposeAngle | None = Field(
        default=None,
        description="angle of repose of the powder without a field: sets `contact.friction` and the rolling friction, "
        "in place of both",
    )
    susceptibility: Annotated[float, number("200", 0.0, 1e6, above=True)] = Field(
        default=200.0, description="initial susceptibility of the grain's material"
    )
    saturation: Magnetisation = Field(default=1.3e6, description="saturation magnetisation of the grain's material")
    powder_law: str | None = Field(
        default=None,
        min_length=1,
        description="measured law of this powder for expected torques: powder_law.json of `emclutch powder-law`, from "
        "the scene's folder; default: the shipped laws",
    )
    law: Annotated[str, Choice(("sphere", "thesis"))] = Field(
        default="sphere",
        description="sphere: a sphere with its own demagnetising field, in the Lorentz field of its neighbours; "
        "thesis: M = chi H, without both fields",
    )

    @field_validator("packing_file", "powder_law")
    @classmethod
    def _from_the_scenes_folder(cls, given: str | None, info: ValidationInfo) -> str | None:
        return None if given is None else from_the_scenes_folder(given, info.context)

    @field_validator("material")
    @classmethod
    def _is_known(cls, given: str | None) -> str | None:
        if given is not None:
            try:
                _of_material(given)
            except ValueError:
                from field.laws.materials import grain_names

                words = "; or remove it, and give density, susceptibility and saturation"
                raise refuse(not_one_of(given, tuple(grain_names())) + words) from None
        return given

    @model_validator(mode="before")
    @classmethod
    def _take_values_of_material(cls, given: Any) -> Any:
        with suppress(ValueError, KeyError, TypeError, AttributeError):  # reported with the keys
            return _of_material(given["material"]) | given
        return given

    @model_validator(mode="after")
    def _has_values_of_material(self) -> Self:
        for key, value in ({} if self.material is None else _of_material(self.material)).items():
            if getattr(self, key) != value:  # a resolved scene has both
                message = f"conflicts with material = '{self.material}', which says {value:.6g}; remove one of the two"
                raise refuse(message, key=key)
        return self

    @model_validator(mode="after")
    def _has_one_amount(self) -> Self:
        given = [key for key in _AMOUNTS if getattr(self, key) is not None]
        if self.packing == "file":
            if given:
                raise refuse(
                    "conflicts with packing = 'file', which says how many grains there are; remove it", given[0]
                )
        elif not given:
            raise refuse("is missing; give one of mass, solid_fraction, count, e.g. mass = '20 g'", key="mass")
        if len(given) > 1:
            raise refuse(
                f"conflicts with {' and '.join(given[:-1])}; keep exactly one of mass, solid_fraction, count",
                key=given[-1],
            )
        if self.sector is not None and not isinstance(self.sector, Scaled):
            n = round(2.0 * math.pi / self.sector)
            if n < 2 or abs(n * self.sector / (2.0 * math.pi) - 1.0) > 1e-6:
                near = 360.0 / max(n, 2)
                raise refuse(
                    "does not divide 360 deg into equal sectors, two or more; take 360 deg / n, "
                    f"e.g. '{near:.10g} deg'",
                    key="sector",
                )
        return self

    @model_validator(mode="after")
    def _has_sizes(self) -> Self:
        if self.packing != "file":
            if self.packing_file is not None:
                raise refuse(f"is not used by packing = '{self.packing}'; remove it, or take packing = 'file'",
                             key="packing_file")  # fmt: skip
            if self.diameter is None and self.sizes is None:
                raise refuse("is missing; a length is needed, e.g. diameter = '1 mm', or sizes = "
                             "{ kind = 'uniform', min = '0.8 mm', max = '1 mm' }", key="diameter")  # fmt: skip
            if self.diameter is not None and self.sizes is not None:
                raise refuse("conflicts with diameter; keep one of the two", key="sizes")
        else:
            if self.packing_file is None:
                raise refuse("is missing, but packing = 'file'; name a CSV, npz or vtp file", key="packing_file")
            if self.sizes is not None:
                raise refuse("conflicts with packing = 'file'; the file has the diameters, or diameter gives one for "
                             "all: remove it", key="sizes")  # fmt: skip
            try:
                self.packing_in_file()
            except (ValueError, OSError) as error:
                raise refuse(reason_of(error), key="packing_file") from None
        if self.packing != "lattice":
            for key in ("lattice", "noise"):
                if key in self.model_fields_set and getattr(self, key) != type(self).model_fields[key].default:
                    raise refuse(f"is not used by packing = '{self.packing}'; remove it, or take packing = 'lattice'",
                                 key=key)  # fmt: skip
        return self

    @model_validator(mode="after")
    def _begins_at_rest_or_in_flow(self) -> Self:
        if self.initial_velocity == "sheared":
            if self.packing == "file":
                raise refuse("conflicts with packing = 'file', whose velocities are in the file; remove it",
                             key="initial_velocity")  # fmt: skip
            if self.settles:
                raise refuse("conflicts with grains that come to rest before time 0 (settle, packing = 'pour'); keep "
                             "one of the two", key="initial_velocity")  # fmt: skip
        return self

    @model_validator(mode="after")
    def _stand_for_finer_grains(self) -> Self:
        real = self.real_diameter
        if real is not None and real > self.mean_diameter * (1.0 + 1e-9):
            raise refuse(
                f"is larger than the grains that stand for it, of {1e3 * self.mean_diameter:.4g} mm on "
                "average by volume; a powder is simulated with its own grains or with coarser ones: lower it, or raise "
                "the grains' diameter",
                key="stands_for",
            )
        return self

    @property
    def n_sectors(self) -> int:
        """Sectors in the ring; 1 where the whole ring is simulated."""
        return 1 if self.sector is None else round(2.0 * math.pi / self.sector)

    @property
    def settles(self) -> bool:
        """True if the grains come to rest before time 0."""
        return self.settle or self.packing == "pour"

    @property
    def mean_diameter(self) -> float:
        """Mean diameter by volume [m], which has the powder's inertial number and its grains per gap."""
        return self.distribution().mean_by_volume if self.diameter is None else self.diameter

    @property
    def smallest_diameter(self) -> float:
        """Diameter of the smallest grain that there may be [m]."""
        return self.distribution().limits[0] if self.diameter is None else self.diameter

    @property
    def largest_diameter(self) -> float:
        """Diameter of the largest grain that there may be [m]."""
        return self.distribution().limits[1] if self.diameter is None else self.diameter

    @property
    def grain_volume(self) -> float:
        """Mean volume of a grain [m^3]."""
        return self.distribution().mean_volume if self.diameter is None else math.pi / 6.0 * self.diameter**3

    @property
    def real_diameter(self) -> float | None:
        """Mean diameter by volume [m] of the powder that the grains stand for; None where they are of real size."""
        if self.stands_for is None or isinstance(self.stands_for, float):
            return self.stands_for
        return self.stands_for.distribution().mean_by_volume

    @property
    def real_grain_volume(self) -> float:
        """Mean volume [m^3] of a grain of the powder that the grains stand for; their own where they are real."""
        if self.stands_for is None:
            return self.grain_volume
        if isinstance(self.stands_for, float):
            return math.pi / 6.0 * self.stands_for**3
        return self.stands_for.distribution().mean_volume

    @property
    def largest_solid_fraction(self) -> float:
        """Fill of the region that the packing cannot exceed, wherever its walls are."""
        if self.packing == "file":
            return 1.0  # the file is judged by its overlaps
        if self.packing == "lattice":
            largest = math.pi / 6.0 * self.largest_diameter**3
            return _LATTICE_DENSITY[self.lattice] * self.grain_volume / largest
        if self.packing == "grow":
            from particles.packing.grown_packing import close_packing_of_moments  # local: see `distribution`

            return close_packing_of_moments(self.distribution().moment)
        return MAX_SOLID_FRACTION

    def distribution(self) -> GrainSizes:
        """Return the distribution of diameters."""
        from particles.packing.sizes import EqualSizes, ListedSizes  # local: scenes of equal grains load without numba

        if self.sizes is not None:
            return self.sizes.distribution()
        if self.diameter is not None:
            return EqualSizes(self.diameter)
        return ListedSizes(2.0 * self.packing_in_file().radius)

    def packing_in_file(self) -> Packing:
        """Return the grains of `packing_file`, as they stand there."""
        assert self.packing_file is not None  # by the checks above
        path = Path(self.packing_file)
        changed = path.stat().st_mtime_ns if path.is_file() else 0
        return _read_packing(self.packing_file, changed, self.diameter)


def _of_material(name: str) -> dict[str, float | None]:
    """Return density, susceptibility and saturation of a named material [SI]; ValueError for an unknown one."""
    from field.laws.materials import grain_material  # local: only scenes that name one load the library

    of = grain_material(name)
    return {"density": of.density, "susceptibility": of.law.chi, "saturation": of.law.Ms}


@lru_cache(maxsize=4)
def _read_packing(file: str, changed: int, diameter: float | None) -> Packing:
    """Read a file once for the many that ask; `changed` is its time, so that a new one is seen."""
    from particles.packing.file_packing import read_packing

    return read_packing(file, radius=None if diameter is None else 0.5 * diameter)
