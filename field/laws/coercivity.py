"""Coercivity of the named materials, for hysteresis of the steel.

Of low-carbon steel it depends on the anneal more than on the grade: 80 A/m (1 oersted) annealed, 140 A/m as rolled, 200
to 400 A/m after cold work. All values here are orders of magnitude; a measured one belongs in the scene.
"""

from __future__ import annotations

from dataclasses import dataclass

from field.laws.materials import entry_of


@dataclass(frozen=True, slots=True)
class Coercivity:
    """Coercivity of a material.

    Attributes
    ----------
    H_c : float
        Half the width of the major loop at B = 0 [A/m].
    source : str
    """

    H_c: float
    source: str


_ROLLED = "cold-rolled low-carbon steel, 1.8 oersted (Bozorth, Ferromagnetism, table of magnetic materials)"
_NONE = "not ferromagnetic"

_COERCIVITIES = {
    "air": Coercivity(0.0, _NONE),
    "copper": Coercivity(0.0, _NONE),
    "aluminium": Coercivity(0.0, _NONE),
    "stainless_304": Coercivity(0.0, _NONE),
    "stainless_430": Coercivity(
        160.0, "annealed ferritic stainless 430F for relays, 2 oersted (the grades of ASTM A838)"
    ),
    "steel_1008": Coercivity(143.0, _ROLLED),
    "steel_1010": Coercivity(143.0, _ROLLED),
    "steel_1018": Coercivity(143.0, _ROLLED),
    "steel_1020": Coercivity(143.0, _ROLLED),
    "stainless_416": Coercivity(350.0, "assumed, an order of magnitude: annealed 13 % chromium steel, 4 to 5 oersted"),
    "steel_11smn30": Coercivity(143.0, _ROLLED),
    "steel_11smnpb30": Coercivity(143.0, _ROLLED),
    "dc01": Coercivity(143.0, _ROLLED),
    "vacofer_s2": Coercivity(10.0, "annealed pure iron: 6 to 12 A/m"),
    "team_steel": Coercivity(143.0, _ROLLED),
}


def coercivity(name: str) -> Coercivity:
    """Coercivity of a named material.

    Raises
    ------
    ValueError
        Unknown name; the message of `materials.material`.
    """
    return entry_of(_COERCIVITIES, name)
