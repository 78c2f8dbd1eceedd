"""A pot core of steel around a slit of powder, coarse: a coil's field that takes milliseconds to solve."""

import numpy as np
from graded_lines import graded_lines
from section_grid import section_grid

from field import AxisymmetricProblem, LinearLaw, PowderLaw, material


def pot_core(powder_law: PowderLaw | None = None) -> AxisymmetricProblem:
    """Core, coil of 8 to 16 mm, slit of 1 mm for powder, and a pin that is not magnetic on the axis."""
    r = np.unique(np.round(np.concatenate((graded_lines(2e-3, (0.0, 20e-3), (0.0, 0.1)), [8e-3, 16e-3, 20e-3])), 9))
    z = np.unique(np.round(np.concatenate((graded_lines(2e-3, (0.0, 16e-3), (0.0, 0.1)), [0.5e-3, 12e-3])), 9))
    regions = {
        "core": (0.0, 20e-3, -16e-3, 16e-3),
        "coil": (8e-3, 16e-3, -12e-3, 12e-3),
        "powder": (2e-3, 8e-3, -0.5e-3, 0.5e-3),
        "pin": (0.0, 2e-3, -0.5e-3, 0.5e-3),
    }
    mesh = section_grid(r, np.concatenate((-z, z)), regions)
    laws = {"core": material("steel_1010"), "pin": LinearLaw()}
    return AxisymmetricProblem(mesh, laws, powder_law=powder_law)
