"""Effect `dipoles`: near grains attract one another.

Model `fixed`: point dipoles with the moment of their law; `mutual` and `near_field`: `coupling.mutual_moments`.
"""

from __future__ import annotations

import numpy as np

from coupling.dipoles import add_dipole_forces
from coupling.effects.effect import Effect
from particles import DVI


class FixedDipoles(Effect):
    """Pair forces inside `cutoff` [m]; the torque m x B of the pairs is booked as the field's reaction."""

    name = "dipoles"
    of_the_field = True

    def __init__(self, cutoff: float):
        self.cutoff = cutoff

    def add_forces(self, simulation, force):
        grains = simulation.motion.grains
        reaction, _energy = add_dipole_forces(
            grains.position, grains.magnetic_moment, grains.radius, simulation.rows(self.cutoff), self.cutoff, force
        )
        return {"dipoles": reaction}


class MutualDipoles(Effect):
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
