"""Effect `magnetic_force`: the field's pull on the dipole of each grain, F = mu_0 (m . grad) H and T = mu_0 m x H.

Where flux leaves a grain through its contacts m is the dipole part of its moment alone; the field's force on the
charges of that flux belongs to effect `dipoles` (`coupling.mutual_moments`). Jackson §5.7 with B = mu_0 H outside the
grain; (m . grad) H equals grad(m . H) at fixed m because curl H = 0 in the powder. The sampler's gradient is Cartesian
and has the hoop terms of an axisymmetric field (-M_phi H_phi/r in F_r, M_phi H_r/r in F_phi).

With moments that are fed back (`coupling.powder_feedback`) H contains every grain spread out over a width, and the pair
forces are those of dipoles less their smear: each pair counts once, and H is smooth over that width whatever the mesh.
"""

from __future__ import annotations

import numpy as np

from coupling.effects.effect import Effect
from field import MU_0


def gradient_force(moment: np.ndarray, grad_H: np.ndarray) -> np.ndarray:
    """F_i = mu_0 m_j dH_i/dx_j (n, 3) [N]; moment (n, 3) [A m^2], grad_H[:, i, j] = dH_i/dx_j [A/m^2]."""
    return MU_0 * (grad_H @ moment[:, :, None])[:, :, 0]


def body_torque(moment: np.ndarray, H: np.ndarray) -> np.ndarray:
    """T = mu_0 m x H (n, 3) [N m]; zero for isotropic grains, whose moment is parallel to H."""
    return MU_0 * np.cross(moment, H)


class MagneticForce(Effect):
    """Adds the gradient force. The body torque of the isotropic grain laws is zero and is not computed.

    Where a slotted body carries the field round, the reaction of the grains' torque is on that body.
    """

    name = "magnetic_force"
    of_the_field = True

    def add_forces(self, simulation, force):
        grains = simulation.motion.grains
        dipole = grains.magnetic_moment if grains.dipole is None else grains.dipole
        pull = gradient_force(dipole, simulation.magnetised.grad_H)
        force += pull
        x = grains.position
        torque = float((x[:, 0] * pull[:, 1] - x[:, 1] * pull[:, 0]).sum())
        carrier = simulation.field_carrier
        return {"gradient" if carrier is None else carrier.name: torque}
