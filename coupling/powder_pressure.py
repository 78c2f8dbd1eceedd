"""Pressure of magnetised powder between pole faces, from the magnetisation of its grains.

Flux crosses the gap through the grains: on the fraction phi of its area they press with mu_0 M^2/2, M their own
magnetisation. Measured on pole faces: docs/explanation/theory.md.
"""

from __future__ import annotations

import numpy as np

from field import MU_0


def magnetic_pressure(fill: float, M: np.ndarray, volume: np.ndarray | None = None) -> float:
    """Return phi mu_0 <M^2>/2 [Pa] of a solid fraction [-] and magnetisations (n,) [A/m]; 0 without any.

    The mean is that over the volumes (n,) [m^3] of the grains, or of the points, where they are given.
    """
    return 0.5 * MU_0 * fill * float(np.average(np.square(M), weights=volume)) if len(M) else 0.0
