"""Imposed pressure: the height of a sheared box follows the normal stress across the flow, between runs of steps.

    dLz/dt = Lz (sigma_zz - P)/g,

with a damping g [Pa s] that sets how fast: much slower than the grains' collisions, much faster than the shear (da Cruz
et al., Phys. Rev. E 72 (2005) 021309, with the wall's equation for a box). Centres move with the box; grains keep their
size and their peculiar velocity. Its work is that of a wall that yields, and not in the budget of a run.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

from particles.step_totals import StepTotals

if TYPE_CHECKING:
    from particles.grain_motion import GrainMotion

MOST = 1e-3
"""Largest |ln| of a change of the height at once: neighbours then come nearer by less than a grain's usual overlap."""

SLOWER = 0.1
"""The same over the shear strain since the last change, where that is more: of the long steps of rigid grains."""


@dataclass(frozen=True, slots=True)
class Barostat:
    """See the module.

    Attributes
    ----------
    pressure : float
        P [Pa].
    damping : float
        g [Pa s].
    """

    pressure: float
    damping: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.pressure) and 0.0 < self.damping < math.inf):
            raise ValueError(
                f"pressure = {self.pressure} Pa, damping = {self.damping} Pa s; allowed: finite, and more than 0"
            )

    def follow(self, motion: GrainMotion, totals: StepTotals, lagged: float = 0.0) -> float:
        """Stretch the box of ``motion`` by what the mean stress of its last run asks for; the factor.

        ``lagged`` is sigma_zz of forces that the grains' engine does not know [Pa], such as lagged magnetic ones.

        Raises
        ------
        ValueError
            The grains are in no sheared box.
        """
        if totals.stress is None:
            raise ValueError("the grains are in no sheared box; a barostat needs one")
        excess = float(totals.stress.total[2, 2]) + lagged - self.pressure
        rate = 0.0 if motion.box is None else abs(motion.box.rate)
        most = max(MOST, SLOWER * rate * totals.duration)
        factor = math.exp(min(max(totals.duration * excess / self.damping, -most), most))
        motion.stretch(factor)
        return factor
