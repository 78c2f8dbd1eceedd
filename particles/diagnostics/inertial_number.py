"""The two numbers of dense flow: friction coefficient mu and inertial number I.

    I = |gamma| d sqrt(rho/p)

is the time in which the pressure p pushes a grain of diameter d and density rho into a hole over the time of shear
(GDR MiDi, Eur. Phys. J. E 14 (2004) 341). Below about 1e-3 the flow is quasi-static, above about 0.1 a collisional gas.
"""

from __future__ import annotations

import numpy as np


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


def friction_coefficient(shear_stress: np.ndarray | float, pressure: np.ndarray | float) -> np.ndarray:
    """mu = |tau|/p [-]; nan where nothing presses."""
    p = np.asarray(pressure, dtype=float)
    return np.where(p > 0.0, np.abs(shear_stress) / np.where(p > 0.0, p, 1.0), np.nan)
