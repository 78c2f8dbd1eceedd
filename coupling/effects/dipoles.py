"""Effect `dipoles`: magnetised grains attract one another (`coupling.mutual_moments`).

The forces include that of the applied field on the charges of the necks, mu_0 Q H, which turns a pair oblique to it. A
field of revolution turns no charge about its axis. Where a slotted body carries the field round, grains and field turn
nothing but that body: sum x x F of pairs, images and charges is then what the field turns the moments with, mu_0 m x H,
and has its reaction there.
"""

from __future__ import annotations

import numpy as np

from coupling.effects.effect import Effect
from field import MU_0
from particles import DVI


class Dipoles(Effect):
    """Forces of the moments of `MutuallyMagnetisedGrains`, on each other and on their images in steel."""

    name = "dipoles"
    of_the_field = True

    def add_forces(self, simulation, force):
        grains, magnetised, motion = simulation.motion.grains, simulation.magnetised, simulation.motion
        solver, magnetisation = magnetised.solver, magnetised.magnetisation
        pairs = images = charges = 0.0
        if magnetisation.moment.any():  # without a current: nothing pulls
            lagged_in_dvi = isinstance(motion, DVI) and not magnetised.pulls_follow_gaps(simulation)
            ahead = motion.dt * simulation.lagged_steps if lagged_in_dvi else 0.0
            lagged = solver.forces(
                grains.position, grains.radius, simulation.rows(solver.reach), magnetisation, ahead=ahead,
                velocity=np.ascontiguousarray(grains.velocity), virial=magnetised.all_is_lagged(simulation),
            )  # fmt: skip
            force += lagged.force
            magnetised.set_lagged_stress(lagged, motion)
            pairs, images = lagged.torque_pairs, lagged.torque_walls
            x, H = grains.position, magnetisation.applied
            # no inner product of the library's, whose bits depend on threads
            charges = MU_0 * float((magnetisation.charge * (x[:, 0] * H[:, 1] - x[:, 1] * H[:, 0])).sum())
        else:
            magnetised.lagged_stress = np.zeros((3, 3))
        carrier = simulation.field_carrier
        if carrier is not None:
            return {carrier.name: pairs + images + charges}
        torques = {"dipoles": pairs + charges}
        return torques if magnetised.mirrors is None else torques | {"images": images}
