"""Stress in each grain, compression positive: the moment of the contact forces on it.

    sigma_ab = -(1/V_i) sum_c f_a (x_c - x_i)_b

with f the force on grain i at the point x_c of contact c, V_i the volume of the grain (Love 1927; Weber 1966;
Christoffersen, Mehrabadi & Nemat-Nasser, J. Appl. Mech. 48 (1981) 339). The first index is the direction of the force,
the second that of the face. For grains at rest the sum of V_i sigma over the grains is, to round-off, the moment of
what acts from outside, -(sum_walls f_a x_b + sum_i b_a x_b) with b the body force on a grain. Grains that spin up are
not at rest: their sigma is not symmetric. `particles.diagnostics.profiles` has the mean stress in bins.
"""

from __future__ import annotations

import numpy as np

from particles.diagnostics.tensors import principal
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable
from particles.periodicity import Periodicity


def grain_stress(grains: Grains, contacts: ContactTable, periodicity: Periodicity | None = None) -> np.ndarray:
    """Stress in each grain [Pa], shape (n, 3, 3) (module docstring)."""
    x = grains.position
    total = np.zeros((grains.count, 3, 3))
    np.add.at(total, contacts.i, -contacts.force[:, :, None] * (contacts.point - x[contacts.i])[:, None, :])
    pairs = contacts.j >= 0
    j, force, point, shift = contacts.j[pairs], -contacts.force[pairs], contacts.point[pairs], contacts.shift[pairs]
    if periodicity is not None:  # back into the frame of j itself
        force, point = periodicity.turn(force, -shift), periodicity.place(point, -shift)
    np.add.at(total, j, -force[:, :, None] * (point - x[j])[:, None, :])
    return total / grains.volume[:, None, None]


def largest_shear_stress(stress: np.ndarray) -> np.ndarray:
    """Half the difference of the extreme principal stresses [Pa], shape (...), of stresses (..., 3, 3)."""
    value, _ = principal(stress)
    return 0.5 * (value[..., 0] - value[..., -1])
