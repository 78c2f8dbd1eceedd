"""[materials.NAME]: the user's own magnetic materials; those that are built in are in `field.laws.materials`."""

from __future__ import annotations

from importlib import import_module
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self

from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from emclutch.scene.section import Section, refuse
from emclutch.scene.units import Coercivity, CurveFieldStrength, Density, FluxDensity, Magnetisation, Quantity, number

if TYPE_CHECKING:
    from field import Law

# upper bounds only catch slips of unit: reluctivity of vacuum 8e5 m/H, conductivity of silver 6e7 S/m
_Reluctivity = Annotated[float, Quantity("a reluctivity", "m/H", "400 m/H", 0.0, 1e6)]
_GrowingReluctivity = Annotated[float, Quantity("a reluctivity", "m/H", "0.4 m/H", 0.0, 1e6, open_minimum=True)]
_LoopFieldStrength = Annotated[float, Quantity("a field strength", "A/m", "-100 A/m", -1e9, 1e9)]
_LoopFluxDensity = Annotated[float, Quantity("a flux density", "T", "-1.2 T", -100.0, 100.0)]
_Conductivity = Annotated[float, Quantity("a conductivity", "S/m", "7e6 S/m", 0.0, 1e8)]


class _OwnMaterial(Section):
    """Keys of every user-defined material besides its law."""

    law_class: ClassVar[str]
    """Dotted name of the law's class, whose arguments are the keys of the material in their order."""
    density: Density | None = None
    conductivity: _Conductivity | None = Field(default=None, description="electrical, at 20 degrees C; default: none")
    coercivity: Coercivity | None = Field(default=None, description="for [effects.hysteresis]; default: none")

    def magnetic_law(self, name: str) -> Law:
        """Return the law for the solver, under the material's name."""
        import numpy as np  # local: most scenes have no curve

        module, _, of_law = self.law_class.rpartition(".")
        own = [key for key in type(self).model_fields if key not in (*_OwnMaterial.model_fields, "law")]
        values = [np.array(one) if isinstance(one := getattr(self, key), tuple) else one for key in own]
        return getattr(import_module(module), of_law)(*values, name, "the scene")

    @model_validator(mode="after")
    def _has_a_law(self) -> Self:
        """Let the law itself say what is wrong with its numbers, before anything is built on it."""
        try:
            self.magnetic_law("this material")
        except ValueError as error:
            from geometry.fault import with_keys  # local: the schema itself needs no shapes

            raise refuse(f"is not a material: {with_keys(str(error), str)}") from None
        return self


class LinearMaterial(_OwnMaterial):
    """B = mu_0 mu_r H."""

    law_class = "field.LinearLaw"
    law: Literal["linear"]
    relative_permeability: Annotated[float, number("1000", 1.0, 1e7)] = Field(description="mu_r")


class FroehlichMaterial(_OwnMaterial):
    """Froehlich-Kennelly: M = chi Ms H/(Ms + chi H)."""

    law_class = "field.FroehlichLaw"
    law: Literal["froehlich"]
    susceptibility: Annotated[float, number("200", 0.0, 1e7, above=True)] = Field(description="chi, initial")
    saturation: Magnetisation = Field(description="Ms")


class LangevinMaterial(_OwnMaterial):
    """Langevin: M = Ms (coth a - 1/a), a = 3 chi H/Ms."""

    law_class = "field.laws.langevin.LangevinLaw"
    law: Literal["langevin"]
    susceptibility: Annotated[float, number("200", 0.0, 1e7, above=True)] = Field(description="chi, initial")
    saturation: Magnetisation = Field(description="Ms")


class BrauerMaterial(_OwnMaterial):
    """Brauer: H = (k1 exp(k2 B^2) + k3) B, continued with the slope of vacuum from where it reaches that."""

    law_class = "field.laws.brauer.BrauerLaw"
    law: Literal["brauer"]
    k1: _GrowingReluctivity
    k2: Annotated[float, number("2.2", 0.0, 100.0, above=True)] = Field(description="per T^2")
    k3: _Reluctivity


class PermeabilityMaterial(_OwnMaterial):
    """Fitted permeability: mu_r = 1 + (mu_i - 1 + c_a b)/(1 + c_b b + b^n), b = B/B_m, held M from its maximum on."""

    law_class = "field.PermeabilityLaw"
    law: Literal["permeability"]
    initial_permeability: Annotated[float, number("200", 1.0, 1e6, above=True)] = Field(description="mu_i")
    scale: Annotated[float, Quantity("a flux density", "T", "1.1 T", 0.0, 10.0, open_minimum=True)] = Field(
        description="B_m, the flux density that scales the fit"
    )
    c_a: Annotated[float, number("8100", 0.0, 1e7)]
    c_b: Annotated[float, number("2.6", 0.0, 1e4)]
    n: Annotated[float, number("10", 1.0, 100.0, above=True)]


class TableMaterial(_OwnMaterial):
    """B(H) through measured points: lists in the scene, or a text file whose header names columns and units.

    `table = "curve.csv"` alone is enough; its header is e.g. `H [A/m], B [T]`, or has J [T] for the polarisation.
    """

    law_class = "field.TableLaw"
    law: Literal["table"]
    file_keys = ("table", "file")
    H: tuple[CurveFieldStrength, ...] = Field(min_length=2, description="field strength, increasing from 0")
    B: tuple[FluxDensity, ...] = Field(min_length=2, description="flux density, increasing from 0")

    @model_validator(mode="after")
    def _is_a_curve(self) -> Self:
        if len(self.H) != len(self.B):
            raise refuse(f"has {len(self.H)} values of H and {len(self.B)} of B; give as many of one as of the other")
        for key, values in (("H", self.H), ("B", self.B)):
            if values[0] != 0.0 or any(later <= earlier for earlier, later in pairwise(values)):
                raise refuse("must start at 0 and increase from each point to the next", key=key)
        return self


class LoopMaterial(_OwnMaterial):
    """Steel fitted to a measured major loop: lists in the scene, or a text file named by `loop`, as tables are.

    Rows follow the loop: from the largest H down to the smallest, and back up if both branches are given. Coercivity
    and remanence come from it; the magnetisation curve is that of the fitted law.
    """

    law_class = "field.laws.major_loop.MajorLoopLaw"
    law: Literal["loop"]
    file_keys = ("loop",)
    coercivity: Coercivity | None = Field(default=None, description="not to be given: the loop has its own")
    H: tuple[_LoopFieldStrength, ...] = Field(min_length=6, description="field strength along the loop")
    B: tuple[_LoopFluxDensity, ...] = Field(min_length=6, description="flux density along the loop")

    @model_validator(mode="after")
    def _has_no_other_coercivity(self) -> Self:
        if self.coercivity is not None:
            raise refuse("conflicts with the loop, which has one; remove it", key="coercivity")
        return self


CURVE_FILES = ("table", "file", "loop")
"""Keys that name the file of a curve."""
ENDINGS = (".csv", ".txt", ".tsv", ".tab", ".dat", ".bh")


def _with_columns(given: Any, info: ValidationInfo) -> Any:
    """Put a file's columns in place of its name, so that a resolved scene stands alone."""
    if not isinstance(given, dict):
        return given
    keys = [key for key in CURVE_FILES if key in given]
    if not keys:
        files = [key for key, one in given.items() if isinstance(one, str) and Path(one).suffix.lower() in ENDINGS]
        if files and "law" not in given:
            raise refuse(f"is not a known key; write table = '{given[files[0]]}'", key=files[0])
        return given
    key, *others = keys
    law = "loop" if key == "loop" or given.get("law") == "loop" else "table"
    if others:
        raise refuse(f"conflicts with {key}; keep one of them", key=others[0])
    if given.get("law", law) != law:
        raise refuse(f"conflicts with law = {given['law']!r}; remove one of them", key=key)
    if "H" in given or "B" in given:
        raise refuse("conflicts with H or B; give either the file or the two lists", key=key)
    if not isinstance(given[key], str):
        raise refuse("is not a text; write the name of a file in quotes", key=key)
    from field.laws.magnetisation_table import TableFault, read_loop, read_table  # local: most scenes have no curve

    try:
        H, B = (read_loop if law == "loop" else read_table)((info.context or {}).get("folder", Path()) / given[key])
    except TableFault as fault:
        raise refuse(fault.reason, key=key) from None
    origin = [] if H[0] == 0.0 or law == "loop" else [0.0]
    kept = {name: value for name, value in given.items() if name != key}
    return {"law": law, **kept, "H": origin + H.tolist(), "B": origin + B.tolist()}


Material = Annotated[
    LinearMaterial
    | FroehlichMaterial
    | LangevinMaterial
    | BrauerMaterial
    | PermeabilityMaterial
    | TableMaterial
    | LoopMaterial,
    Field(discriminator="law"),
    BeforeValidator(_with_columns),
]
