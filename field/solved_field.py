"""Interface of every solved field, in the section of a device of revolution or in 3D."""

from __future__ import annotations

from typing import Protocol

import numpy as np

from field.sampling.sampler import FieldSampler


class SolvedField(Protocol):
    """A solution of a device's field, such as `field.MagneticField` and `field.three_d.Field3D`.

    Attributes
    ----------
    ampere_turns : float
        N I of the coil [A].
    newton : list of (relative residual, step length)
        History of the iteration, the start first.
    """

    ampere_turns: float
    newton: list[tuple[float, float]]

    @property
    def energy(self) -> float:
        """Integral of H dB over the volume [J]."""

    @property
    def coenergy(self) -> float:
        """Integral of B dH over the volume [J]."""

    @property
    def flux_linkage_per_turn(self) -> float:
        """Flux through a mean turn of the coil [Wb]."""

    def mean_flux_density(self, line: np.ndarray) -> float:
        """Mean |B| [T] at the points (r, z) [m] of a line, shape (k, 2), and averaged about the axis."""

    def estimated_errors(self) -> dict[str, float] | None:
        """Relative errors of the discretisation, by what they are of; None where they are not estimated."""

    def sampler(self, region: str = "powder") -> FieldSampler:
        """Recovered H and grad H inside a region."""
