"""Thermal conductivity, density and specific heat of named materials, windings and powders, near 50 degrees C.

Of metals they are known to 5 to 10 per cent and change by as much up to 200 degrees C. Two mixtures:

- **winding** across its wires, round conductors of k_c that fill f of it in a binder of k_b: the lower bound of Hashin
  and Shtrikman (J. Mech. Phys. Solids 11 (1963) 127) for parallel fibres, for windings N. Simpson, R. Wrobel and P. H.
  Mellor, IEEE Trans. Ind. Appl. 49 (2013) 2505, k = k_b ((1 + f) k_c + (1 - f) k_b)/((1 - f) k_c + (1 + f) k_b);
- **powder** at rest in a gas, a solid fraction phi of spheres of k_s in gas of k_g: P. Zehner and E. U. Schluender,
  Chem. Ing. Tech. 42 (1970) 933, with kappa = k_s/k_g, B = 1.25 (phi/(1 - phi))^(10/9) and N = 1 - B/kappa

      k/k_g = 1 - sqrt(phi) + sqrt(phi) (2/N) (B (kappa - 1)/(N^2 kappa) ln(kappa/B) - (B + 1)/2 - (B - 1)/N),

  without radiation (small below 300 degrees C), flattened contacts, and the gas's free path in the gaps. Sheared powder
  mixes and conducts better. Measured packings of metal spheres scatter about it by some 30 per cent.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

from field.laws.materials import canonical_name, material


@dataclass(frozen=True, slots=True)
class HeatProperties:
    """Of a material.

    Attributes
    ----------
    conductivity : float
        k [W/(m K)].
    density : float
        [kg/m^3]
    specific_heat : float
        c [J/(kg K)].
    source : str
    """

    conductivity: float
    density: float
    specific_heat: float
    source: str = ""

    @property
    def capacity(self) -> float:
        """Heat capacity of a volume [J/(m^3 K)]."""
        return self.density * self.specific_heat


_INCROPERA = "Incropera and DeWitt, Fundamentals of Heat and Mass Transfer, table A.1"
_EN_10088 = "EN 10088-1"
_PLAIN_CARBON = f"plain carbon steel, 60.5 at 27 and 56.7 at 127 degrees C; {_INCROPERA}"

_PROPERTIES = {
    "air": HeatProperties(0.028, 1.09, 1007.0, "Incropera and DeWitt, table A.4, at 50 degrees C"),
    "copper": HeatProperties(398.0, 8930.0, 387.0, f"pure; {_INCROPERA}"),
    "aluminium": HeatProperties(220.0, 2700.0, 905.0, f"commercially pure; pure 237 at 27 degrees C, {_INCROPERA}"),
    "stainless_304": HeatProperties(15.0, 7900.0, 500.0, _EN_10088),
    "stainless_430": HeatProperties(25.0, 7700.0, 460.0, _EN_10088),
    "steel_1008": HeatProperties(62.0, 7850.0, 460.0, f"AISI 1010, 64 at 27 and 59 at 127 degrees C; {_INCROPERA}"),
    "steel_1010": HeatProperties(62.0, 7830.0, 450.0, f"AISI 1010, 64 at 27 and 59 at 127 degrees C; {_INCROPERA}"),
    "steel_1018": HeatProperties(58.0, 7854.0, 450.0, _PLAIN_CARBON),
    "steel_1020": HeatProperties(58.0, 7854.0, 450.0, _PLAIN_CARBON),
    "stainless_416": HeatProperties(30.0, 7700.0, 460.0, f"1.4005, {_EN_10088}"),
    "steel_11smn30": HeatProperties(55.0, 7850.0, 460.0, f"assumed as plain carbon steel, 1 % Mn; {_INCROPERA}"),
    "steel_11smnpb30": HeatProperties(55.0, 7850.0, 460.0, f"as 11SMn30, its lead left out; {_INCROPERA}"),
    "dc01": HeatProperties(60.0, 7850.0, 460.0, f"as AISI 1010; {_INCROPERA}"),
    "vacofer_s2": HeatProperties(76.0, 7870.0, 455.0, f"pure iron, 80 at 27 and 70 at 127 degrees C; {_INCROPERA}"),
    "team_steel": HeatProperties(60.0, 7850.0, 460.0, f"as AISI 1010; {_INCROPERA}"),
}

BINDER = HeatProperties(0.2, 1200.0, 1500.0, "varnish or epoxy resin without filler")
"""Of windings."""

IRON_HEAT = 450.0
"""Specific heat of iron grains [J/(kg K)]."""

GRAINS = 30.0
"""Conductivity of the grains of a powder [W/(m K)]: stainless 430 has 25, carbonyl iron 80; of little weight."""


def heat_properties(name: str) -> HeatProperties:
    """Properties of a named material.

    Raises
    ------
    ValueError
        Unknown name; the message of `materials.material`.
    """
    canonical = canonical_name(name)
    if canonical is None:
        material(name)  # raises, with the nearest name
        raise AssertionError("unreachable")
    return _PROPERTIES[canonical]


def winding_properties(fill_factor: float) -> HeatProperties:
    """Of a copper winding across its wires, copper filling `fill_factor` of it, 0 to 1."""
    copper, binder, f = _PROPERTIES["copper"], BINDER, fill_factor
    k_c, k_b = copper.conductivity, binder.conductivity
    k = k_b * ((1.0 + f) * k_c + (1.0 - f) * k_b) / ((1.0 - f) * k_c + (1.0 + f) * k_b)
    density = f * copper.density + (1.0 - f) * binder.density
    return HeatProperties(k, density, (f * copper.capacity + (1.0 - f) * binder.capacity) / density, "Hashin-Shtrikman")


def powder_conductivity(phi: float, grains: float = GRAINS, gas: float = _PROPERTIES["air"].conductivity) -> float:
    """k [W/(m K)] of a powder of solid fraction `phi`, 0 to 0.74, of grains and gas of k [W/(m K)].

    Raises
    ------
    ValueError
        A fraction out of range, a conductivity that is not above 0.
    """
    if not 0.0 <= phi <= 0.74:
        raise ValueError(f"`phi` = {phi:g} of the powder must be 0 to 0.74, that of densest spheres")
    if not (grains > 0.0 and gas > 0.0):
        raise ValueError(f"`grains` = {grains:g} and `gas` = {gas:g} W/(m K) of the powder must be above 0")
    if phi == 0.0 or grains == gas:
        return gas
    kappa, B = grains / gas, 1.25 * (phi / (1.0 - phi)) ** (10.0 / 9.0)
    N = 1.0 - B / kappa
    bracket = B * (kappa - 1.0) / (N * N * kappa) * math.log(kappa / B) - 0.5 * (B + 1.0) - (B - 1.0) / N
    return gas * (1.0 - math.sqrt(phi) + math.sqrt(phi) * 2.0 / N * bracket)


def turning_disc_film(speed: float) -> float:
    """h [W/(m^2 K)] of the face of a disc that turns in still air at `speed` [rad/s], in laminar flow.

    Nu = 0.36 Re^(1/2) with the radius, so that h = 0.36 k sqrt(omega/nu) at every radius (E. C. Cobb and O. A.
    Saunders, Proc. R. Soc. A 236 (1956) 343), to Re = omega R^2/nu of 2.4e5: 13 000 rpm at R = 50 mm. Air at 50 degrees
    C, nu = 1.8e-5 m^2/s.
    """
    return 0.36 * _PROPERTIES["air"].conductivity * math.sqrt(abs(speed) / 1.8e-5)
