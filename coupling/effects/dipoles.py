"""Effect `dipoles`: magnetised grains attract one another (`coupling.mutual_moments`)."""

from __future__ import annotations

import numpy as np

from coupling.effects.effect import Effect
from particles import DVI


class Dipoles(Effect):
    """Forces of moments that `MutuallyMagnetisedGrains` has found, on each other and on their images in steel."""

    name = "dipoles"
    of_the_field = True

    def add_forces(self, simulation, force):
        grains, magnetised = simulation.motion.grains, simulation.magnetised
        solver = magnetised.solver
        motion = simulation.motion
        if not magnetised.found.moment.any():  # without a current: nothing pulls
            return {"dipoles": 0.0} if magnetised.mirrors is None else {"dipoles": 0.0, "images": 0.0}
        ahead = motion.dt * simulation.steps_per_update if isinstance(motion, DVI) else 0.0
        found, pairs, walls = solver.forces(
            grains.position, grains.radius, simulation.rows(solver.reach), magnetised.found,
            velocity=np.ascontiguousarray(grains.velocity), ahead=ahead,
        )  # fmt: skip
        force += found
        return {"dipoles": pairs} if magnetised.mirrors is None else {"dipoles": pairs, "images": walls}
