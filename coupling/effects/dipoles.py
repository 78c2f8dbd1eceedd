"""Effect `dipoles`: magnetised grains attract one another (`coupling.mutual_moments`).

The forces hold that of the applied field on the charges of the necks, mu_0 Q H, which turns a pair oblique to it. A
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
    """Forces of moments that `MutuallyMagnetisedGrains` has found, on each other and on their images in steel."""

    name = "dipoles"
    of_the_field = True

    def add_forces(self, simulation, force):
        grains, magnetised, motion = simulation.motion.grains, simulation.magnetised, simulation.motion
        solver, found = magnetised.solver, magnetised.found
        pairs = images = charges = 0.0
        if found.moment.any():  # without a current: nothing pulls
            held_by_dvi = isinstance(motion, DVI) and not magnetised.pulls_follow_gaps(simulation)
            ahead = motion.dt * simulation.held_steps if held_by_dvi else 0.0
            held = solver.forces(
                grains.position, grains.radius, simulation.rows(solver.reach), found,
                velocity=np.ascontiguousarray(grains.velocity), ahead=ahead, virial=magnetised.all_is_held(simulation),
            )  # fmt: skip
            force += held.force
            magnetised.take_virial(held, motion)
            pairs, images = held.torque_pairs, held.torque_walls
            x, H = grains.position, found.applied
            # no inner product of the library's, whose bits depend on threads
            charges = MU_0 * float((found.charge * (x[:, 0] * H[:, 1] - x[:, 1] * H[:, 0])).sum())
        else:
            magnetised.held_stress = np.zeros((3, 3))
        carrier = simulation.field_carrier
        if carrier is not None:
            return {carrier.name: pairs + images + charges}
        booked = {"dipoles": pairs + charges}
        return booked if magnetised.mirrors is None else booked | {"images": images}
