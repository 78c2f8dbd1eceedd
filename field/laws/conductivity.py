"""Electrical conductivity of the named materials at 20 degrees C, for eddy currents and the coil's loss.

Of steels it is known to some ten per cent at best: composition and cold work decide, and in use a coil of 100
degrees C has three quarters of its cold conductivity.
"""

from __future__ import annotations

from dataclasses import dataclass

from field.laws.materials import entry_of


@dataclass(frozen=True, slots=True)
class Conductivity:
    """Conductivity of a material.

    Attributes
    ----------
    sigma : float
        Conductivity [S/m].
    source : str
    rough : bool
        An order of magnitude (some ten per cent) rather than a value of a standard.
    temperature : float
        At which it holds [degrees C].
    """

    sigma: float
    source: str
    rough: bool = False
    temperature: float = 20.0


_CONDUCTIVITIES = {
    "air": Conductivity(0.0, "insulator"),
    "copper": Conductivity(5.80e7, "IEC 60028, 100 % IACS"),
    "aluminium": Conductivity(3.5e7, "commercially pure, 61 % IACS (IEC 60889: 0.02826 ohm mm2/m); alloys 2e7 to 3e7"),
    "stainless_304": Conductivity(1.37e6, "EN 10088-1: 0.73 ohm mm2/m"),
    "stainless_430": Conductivity(1.67e6, "EN 10088-1: 0.60 ohm mm2/m", rough=True),
    "steel_1008": Conductivity(7.0e6, "low-carbon steel, 0.14 ohm mm2/m", rough=True),
    "steel_1010": Conductivity(7.0e6, "low-carbon steel, 0.14 ohm mm2/m", rough=True),
    "steel_1018": Conductivity(5.8e6, "FEMM distribution", rough=True),
    "steel_1020": Conductivity(5.8e6, "FEMM distribution", rough=True),
    "stainless_416": Conductivity(1.67e6, "1.4005, EN 10088-1: 0.60 ohm mm2/m", rough=True),
    "steel_11smn30": Conductivity(5.9e6, "free-cutting steel, 0.17 ohm mm2/m", rough=True),
    "steel_11smnpb30": Conductivity(5.9e6, "free-cutting steel, 0.17 ohm mm2/m", rough=True),
    "dc01": Conductivity(6.5e6, "low-carbon sheet, 0.15 ohm mm2/m", rough=True),
    "vacofer_s2": Conductivity(1.0e7, "iron of 99.9 %, 0.10 ohm mm2/m", rough=True),
    "team_steel": Conductivity(7.505e6, "TEAM workshop problem 10, the plates of problem 13"),
}


def conductivity(name: str) -> Conductivity:
    """Electrical conductivity of a named material.

    Raises
    ------
    ValueError
        Unknown name; the message of `materials.material`.
    """
    return entry_of(_CONDUCTIVITIES, name)
