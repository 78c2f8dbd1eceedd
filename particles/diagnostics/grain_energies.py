"""Mechanical energy of the grains by kind, of the whole device.

Elastic energy needs the contact law and its history, so it comes from the step itself (`StepTotals.elastic_energy`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from particles.grains import Grains
from particles.sector import CyclicSector


@dataclass(frozen=True, slots=True)
class GrainEnergies:
    """Energies [J]; gravity's is zero at z = 0; elastic is None where nobody gave it."""

    translation: float
    spin: float
    gravity: float
    elastic: float | None = None


def grain_energies(
    grains: Grains,
    gravity: np.ndarray | None = None,
    sector: CyclicSector | None = None,
    *,
    elastic: float | None = None,
) -> GrainEnergies:
    """Energies of the grains, times the number of sectors; velocities lag positions by half a step.

    ``gravity`` [m/s^2], shape (3,): in a ring of sectors what acts across the axis cancels. ``elastic`` [J] is kept.
    """
    n = 1 if sector is None else sector.n_sectors
    translation = 0.5 * float(np.sum(grains.mass[:, None] * grains.velocity**2))
    spin = 0.5 * float(np.sum(grains.inertia[:, None] * grains.angular_velocity**2))
    potential = 0.0
    if gravity is not None:
        g = np.asarray(gravity, dtype=float)
        acting = g if sector is None else np.array([0.0, 0.0, g[2]])
        potential = -float(grains.mass @ (grains.position @ acting))
    return GrainEnergies(n * translation, n * spin, n * potential, elastic)
