"""Effect `back_reaction`: the powder's fill is fed back to the field as its permeability.

With model = 'fixed' only; grains' own moments go by `coupling.powder_feedback`, without an effect object.
"""

from __future__ import annotations

from coupling.deposition import FillDeposition
from coupling.effects.effect import Effect


class BackReaction(Effect):
    """Deposits the grains at each window; the field source decides whether that calls for a new solve."""

    name = "back_reaction"

    def __init__(self, deposition: FillDeposition):
        self.deposition = deposition

    def begin_window(self, simulation):
        grains = simulation.motion.grains
        simulation.fill = self.deposition.fill(grains.position, grains.volume)
