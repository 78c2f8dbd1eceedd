"""Coercivity of the named materials, for hysteresis of the steel.

Of low-carbon steel it depends on the anneal more than on the grade: 80 A/m (1 oersted) annealed, 140 A/m as rolled, 200
to 400 A/m after cold work. All values here are orders of magnitude; a measured one belongs in the scene.

They are of the grade, not of the steel whose magnetisation curve the library has. A curve has its largest permeability
near 1.3 coercivities of its steel (rule of thumb, as mu_max = B_r/(2 H_c) of Bozorth is); six of the eleven curves have
it at 3.8 to 10 of these ones. The remanence that follows from both is then 0.14 to 0.42 T, where steels have 0.6 to 1.2
T. A residual flux across an air gap follows the coercivity, one in a closed path the remanence.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from field.laws.materials import entry_of
from field.laws.pinning import Pinning
from field.laws.reluctivity import Law

_PEAK = 1.3
"""Field strength of a steel's largest permeability, in coercivities."""
_FAR = 3.0
"""Times the coercivity, beyond which the curve counts as that of another steel."""
_B = np.geomspace(1e-4, 3.0, 2000)


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


def misfit_of_curve(law: Law, pinning: Pinning) -> str:
    """Warning where a curve's largest permeability lies too far beyond the coercivity; else empty."""
    H_c = pinning.coercivity
    H = law.H_of_B(_B)[0]
    peak = float(H[np.argmax(_B / H)])
    if H_c == 0.0 or peak <= _FAR * H_c:
        return ""
    return (
        f"with hysteresis the remanence, {pinning.remanence(law):.2g} T (real steels: 0.6 to 1.2 T), and the residual "
        f"flux without an air gap are too low. The coercivity H_c = {H_c:.3g} A/m does not match the magnetisation "
        f"curve: the permeability is largest at {peak / H_c:.2g} H_c (real steels: near {_PEAK:g} H_c). Give a "
        "measured loop"
    )


def coercivity(name: str) -> Coercivity:
    """Coercivity of a named material.

    Raises
    ------
    ValueError
        Unknown name; the message of `materials.material`.
    """
    return entry_of(_COERCIVITIES, name)
