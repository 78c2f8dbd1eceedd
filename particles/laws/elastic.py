"""Elastic constants of a grain's or a wall's material, and those of two bodies in contact.

    1/E* = (1 - nu_1^2)/E_1 + (1 - nu_2^2)/E_2          (Hertz 1882)
    1/G* = (2 - nu_1)/G_1 + (2 - nu_2)/G_2              (Mindlin 1949)

(Johnson, Contact Mechanics, eqs. 4.22 and 7.42).
"""

from __future__ import annotations

import math
from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class Elastic:
    """Young's modulus E [Pa], Poisson's ratio nu [-] and the shear modulus G [Pa], E/(2 (1 + nu)) unless given."""

    youngs_modulus: float
    poisson_ratio: float
    shear_modulus: float | None = None

    def __post_init__(self) -> None:
        for name in ("youngs_modulus", "shear_modulus"):
            value = getattr(self, name)
            if value is not None and not 0.0 < value < math.inf:
                raise ValueError(f"{name} = {value:g} Pa; allowed: more than 0 (1e6 to 1e12 is usual)")
        if not -1.0 < self.poisson_ratio <= 0.5:
            raise ValueError(f"poisson_ratio = {self.poisson_ratio:g}; allowed: above -1, at most 0.5 (0.3 is usual)")

    @property
    def G(self) -> float:
        """Shear modulus [Pa]."""
        if self.shear_modulus is not None:
            return self.shear_modulus
        return 0.5 * self.youngs_modulus / (1.0 + self.poisson_ratio)


def effective_modulus(first: Elastic, second: Elastic) -> float:
    """E* [Pa] of two bodies."""
    return 1.0 / sum((1.0 - body.poisson_ratio**2) / body.youngs_modulus for body in (first, second))


def effective_shear_modulus(first: Elastic, second: Elastic) -> float:
    """G* [Pa] of two bodies."""
    return 1.0 / sum((2.0 - body.poisson_ratio) / body.G for body in (first, second))


def rayleigh_time(material: Elastic, density: float, radius: float) -> float:
    """Time [s] in which a Rayleigh wave runs half around a sphere, pi R sqrt(rho/G)/(0.1631 nu + 0.8766).

    Thornton & Randall (1988); Li, Xu & Thornton, Powder Technology 160 (2005) 219, eq. 6. ``density`` in kg/m^3.
    """
    speed = (0.1631 * material.poisson_ratio + 0.8766) * math.sqrt(material.G / density)
    return math.pi * radius / speed
