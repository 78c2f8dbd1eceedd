"""[materials.NAME]: the user's own magnetic materials, and the names that are built in."""

from __future__ import annotations

import csv
from itertools import pairwise
from pathlib import Path
from typing import Annotated, Any, Literal, Self

from pydantic import Field, ValidationInfo, model_validator

from emclutch.scene.section import Section, refuse
from emclutch.units import CurveFieldStrength, Density, FluxDensity, Magnetisation, number


class LinearMaterial(Section):
    """B = mu_0 mu_r H."""

    law: Literal["linear"]
    relative_permeability: Annotated[float, number("1000", 1.0, 1e7)] = Field(description="mu_r")
    density: Density | None = None


class FroehlichMaterial(Section):
    """Froehlich-Kennelly: M = chi Ms H/(Ms + chi H)."""

    law: Literal["froehlich"]
    susceptibility: Annotated[float, number("200", 0.0, 1e7)] = Field(description="chi, initial")
    saturation: Magnetisation = Field(description="Ms")
    density: Density | None = None


class TableMaterial(Section):
    """B(H) through measured points: lists in the scene, or a CSV file with the columns H [A/m] and B [T]."""

    law: Literal["table"]
    H: tuple[CurveFieldStrength, ...] = Field(min_length=2, description="field strength, increasing from 0")
    B: tuple[FluxDensity, ...] = Field(min_length=2, description="flux density, increasing from 0")
    density: Density | None = None

    @model_validator(mode="before")
    @classmethod
    def _read_file(cls, given: Any, info: ValidationInfo) -> Any:
        """Put a file's columns in place of its name, so that a resolved scene stands alone."""
        if not isinstance(given, dict) or "file" not in given:
            return given
        if "H" in given or "B" in given:
            raise refuse("stands beside H or B; give either the file or the two lists", key="file")
        folder = (info.context or {}).get("folder", Path())
        H, B = _columns(folder / str(given["file"]))
        return {**{key: value for key, value in given.items() if key != "file"}, "H": H, "B": B}

    @model_validator(mode="after")
    def _is_a_curve(self) -> Self:
        if len(self.H) != len(self.B):
            raise refuse(f"has {len(self.H)} values of H and {len(self.B)} of B; give as many of one as of the other")
        for key, values in (("H", self.H), ("B", self.B)):
            if values[0] != 0.0 or any(later <= earlier for earlier, later in pairwise(values)):
                raise refuse("must start at 0 and increase from each point to the next", key=key)
        return self


Material = Annotated[LinearMaterial | FroehlichMaterial | TableMaterial, Field(discriminator="law")]


def _columns(path: Path) -> tuple[list[float], list[float]]:
    """Read two columns H [A/m], B [T]; a first line of words is skipped."""
    try:
        with open(path, newline="", encoding="utf-8") as stream:
            rows = [row for row in csv.reader(stream) if row and not row[0].lstrip().startswith("#")]
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "it is not text"
        raise refuse(f"cannot be read ({reason}); a path is relative to the scene's folder", key="file") from None
    try:
        start = 0 if _is_number(rows[0][0]) else 1
        points = [(float(row[0]), float(row[1])) for row in rows[start:]]
    except (IndexError, ValueError):
        raise refuse("is not a table of two columns, H in A/m and B in T, with commas between", key="file") from None
    return [H for H, _ in points], [B for _, B in points]


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True
