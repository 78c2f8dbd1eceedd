"""Diffusion time of a field in solid conductors, from its static solution alone.

A field psi = r A_phi left to itself decays as exp(-t/tau) in its slowest mode, curl(nu curl A) = sigma A/tau.
Rayleigh's quotient with the static field of the coil as the trial function,

    tau >= integral sigma A^2 dV / integral nu B^2 dV,

needs no further solve. It is a lower bound for a linear material, and near it, because the coil's field is smooth: of a
long cylinder in an even axial field it gives mu sigma a^2/8, and its slowest mode has mu sigma a^2/5.78 (Woodson and
Melcher, Electromechanical Dynamics, 1968, sec. 7.1). In steel the chord permeability of the static field stands for mu:
an order of magnitude where the steel saturates.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from field.section.magnetic_field import MagneticField


def diffusion_time(solution: MagneticField, conductivity: Mapping[str, float]) -> float:
    """Rayleigh's estimate of tau [s] for a field with a current, and the conductivities [S/m] of its regions."""
    problem = solution.problem
    elements = problem.elements
    psi = solution.psi[elements.element_dofs] @ elements.shape.T  # at the quadrature points
    sigma = np.zeros(len(problem.mesh.triangles))
    for region, value in conductivity.items():
        sigma[problem.mesh.regions[region]] = value
    squared = 2.0 * np.pi * (sigma[:, None] * psi**2 * elements.weight / elements.radius).sum()
    return float(squared / (solution.energy + solution.coenergy))  # their sum is the integral of H B
