"""Stress of the grains, compression positive.

Contacts carry (Love 1927; Weber 1966; Christoffersen, Mehrabadi & Nemat-Nasser, J. Appl. Mech. 48 (1981) 339)

    sigma_ab = -(1/V) sum_c f_a l_b,

f the force on grain i, l the branch from its centre to its partner's centre or to the point on a wall; a pushing
contact has f against l, hence the sign. The first index is the direction of the force, the second that of the face. For
grains at rest this is, to round-off, the moment of what acts from outside:

    V sigma_ab = -(sum_walls f_a x_b + sum_i b_a x_b),    b the body force on a grain.

Motion adds (1/V) sum_i m c_a c_b with c the velocity relative to the mean one; `particles.diagnostics.profiles` has
that part. Grains that spin up are not at rest: their sigma is not symmetric.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from particles.diagnostics.contact_geometry import contact_geometry
from particles.diagnostics.tensors import cylindrical_frame, in_frame, ring_average
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable
from particles.sector import CyclicSector


@dataclass(frozen=True, slots=True)
class Stress:
    """A mean stress [Pa], compression positive; (3, 3) along (x, y, z) and along (r, phi, z)."""

    cartesian: np.ndarray
    cylindrical: np.ndarray

    @property
    def pressure(self) -> float:
        """A third of the trace [Pa]."""
        return float(np.trace(self.cartesian)) / 3.0

def contact_stress(grains: Grains, contacts: ContactTable, volume: float, sector: CyclicSector | None = None) -> Stress:
    """Love-Weber stress of all contacts, walls included, over ``volume`` [m^3] (that of the sector where there is one).

    The cylindrical components are taken at each contact's point.
    """
    _require_volume(volume)
    branch = contact_geometry(grains, contacts, sector).branch
    frame = cylindrical_frame(contacts.point)
    local = in_frame(frame, contacts.force).T @ in_frame(frame, branch)
    return Stress(ring_average(-contacts.force.T @ branch / volume, sector), -local / volume)


def grain_stress(grains: Grains, contacts: ContactTable, sector: CyclicSector | None = None) -> np.ndarray:
    """Stress in each grain [Pa], compression positive: -(1/V_i) sum_c f (x_c - x_i), shape (n, 3, 3).

    x_c are the points of the grain's contacts, V_i its own volume.
    """
    x = grains.position
    total = np.zeros((grains.count, 3, 3))
    np.add.at(total, contacts.i, -contacts.force[:, :, None] * (contacts.point - x[contacts.i])[:, None, :])
    pairs = contacts.j >= 0
    j, force, point = contacts.j[pairs], -contacts.force[pairs], contacts.point[pairs]
    if sector is not None:  # back into the frame of j itself
        back = -contacts.shift[pairs]
        force, point = sector.turn(force, back), sector.turn(point, back)
    np.add.at(total, j, -force[:, :, None] * (point - x[j])[:, None, :])
    return total / grains.volume[:, None, None]


def _require_volume(volume: float) -> None:
    if not 0.0 < volume < np.inf:
        raise ValueError(
            f"volume of a mean stress = {volume:g} m^3; allowed: more than 0; give the space that is meant"
        )
