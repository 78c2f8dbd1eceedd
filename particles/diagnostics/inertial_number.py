"""The two numbers of dense flow: friction coefficient mu and inertial number I.

    I = |gamma| d sqrt(rho/p)

is the time in which the pressure p pushes a grain of diameter d and density rho into a hole over the time of shear
(GDR MiDi, Eur. Phys. J. E 14 (2004) 341). Below about 1e-3 the flow is quasi-static, above about 0.1 a collisional gas.
The pressure is the measured one where there is one. Before a run, and in one that does not measure its walls, it is for
powder that attracts itself `coupling.powder_pressure.magnetic_pressure`, for other powder tau/mu_wall, which is what
friction at the walls needs at least.
"""

from __future__ import annotations

import math

import numpy as np

MAGNETIC, FRICTION, MEASURED = "magnetic", "friction", "measured"
"""Names of the three pressures."""


def inertial_number(
    shear_rate: np.ndarray | float,
    diameter: np.ndarray | float,
    density: np.ndarray | float,
    pressure: np.ndarray | float,
) -> np.ndarray:
    """I [-] from [1/s], [m], [kg/m^3] (of the grains' material) and [Pa]; nan where nothing presses."""
    p = np.asarray(pressure, dtype=float)
    pressed = p > 0.0
    return np.where(pressed, np.abs(shear_rate) * diameter * np.sqrt(density / np.where(pressed, p, 1.0)), np.nan)


def shear_rate_of(inertial_number: float, diameter: float, density: float, pressure: float) -> float:
    """Shear rate [1/s] of an inertial number; the other way round."""
    return inertial_number / (diameter * math.sqrt(density / pressure))


def friction_coefficient(shear_stress: np.ndarray | float, pressure: np.ndarray | float) -> np.ndarray:
    """mu = |tau|/p [-]; nan where nothing presses."""
    p = np.asarray(pressure, dtype=float)
    return np.where(p > 0.0, np.abs(shear_stress) / np.where(p > 0.0, p, 1.0), np.nan)
