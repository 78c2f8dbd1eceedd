"""H, grad H and the moments of the grains, the input of every magnetic effect.

The moment is that of a lone sphere in the field, M(H, phi = 0) of `field.laws.powder_law`, parallel to H; with effect
`dipoles` that of `coupling.mutually_magnetised_grains`.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from coupling.finite_grains import refuse_not_finite
from field import FieldSampler, ParticleLaw
from particles import GrainMotion


@dataclass(frozen=True, slots=True)
class MomentRow:
    """Moments in a window.

    Attributes
    ----------
    moment_residual : float
        Worst, relative to the magnetisation.
    moment_sweeps : float
        Over all grains.
    """

    moment_residual: float
    moment_sweeps: float


@dataclass(slots=True)
class MagnetisedGrains:
    """Service object; `update` is called once before the magnetic forces of a sub-cycle.

    Attributes
    ----------
    sampler : FieldSampler
        None until the first solve.
    law : ParticleLaw
    lagged_stress : ndarray, shape (3, 3)
        In a sheared box the stress [Pa] of the lagged forces, as `particles.BoxStress` counts it.
    """

    sampler: FieldSampler | None
    law: ParticleLaw
    H: np.ndarray = field(default_factory=lambda: np.zeros((0, 3)))
    grad_H: np.ndarray = field(default_factory=lambda: np.zeros((0, 3, 3)))
    lagged_stress: np.ndarray = field(default_factory=lambda: np.zeros((3, 3)))

    def update(self, simulation) -> None:
        """Sample the field at the simulation's grains and set their `magnetic_moment` [A m^2]."""
        assert self.sampler is not None  # the loop refreshes the source first
        grains = simulation.motion.grains
        self.H, self.grad_H = self.sampler.sample(grains.position)
        refuse_not_finite(grains.position, self.H, grains.particle_id)
        grains.magnetic_moment = moments(self.law, self.H, grains.volume)

    def freeze(self, simulation, force: np.ndarray) -> None:
        """Keep the sum of all lagged forces (n, 3) [N] of this update: there is nothing to add to it."""

    def resume(self, motion: GrainMotion) -> None:
        """Give the motion what the state of a checkpoint refers to, before it is restored: nothing."""

    def state(self) -> dict[str, Any] | None:
        """Return what a checkpoint needs beside the grains' own moments: nothing."""
        return None

    def restore(self, saved: dict[str, Any] | None) -> None:
        """Take up the state of a checkpoint."""

    def energy(self) -> float | None:
        """Return the energy of the grains in the field at the last evaluation [J]; None where it is not known."""
        return None

    def window_part(self) -> MomentRow | None:
        """Convergence of the moments, once a window; None where they follow from the field."""
        return None


def moments(law: ParticleLaw, H: np.ndarray, volume: np.ndarray) -> np.ndarray:
    """Moments V M(|H|) H/|H| (n, 3) [A m^2] of lone grains in H (n, 3) [A/m]; zero where H is zero."""
    strength = np.sqrt((H * H).sum(axis=1))
    M = law.magnetisation(strength, np.zeros_like(strength))
    ratio = np.divide(M, strength, out=np.zeros_like(strength), where=strength > 0.0)
    return (volume * ratio)[:, None] * H
