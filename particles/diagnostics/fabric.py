"""Fabric: in which directions the contacts point.

    F_ab = sum_c w_c n_a n_b / sum_c w_c

over the contacts between grains (Satake 1982), with w = 1, or w = normal force for the force-weighted fabric; the trace
is 1 and an isotropic bed has F = 1/3. Every contact counts once: n and -n are the same. Contacts with walls all point
along the wall's normal and would hide the bed's own fabric, so they are left out unless asked for.

A ring has no direction in common but its own: there the components along (e_r, e_phi, e_z) at the contact's point are
averaged; the Cartesian tensor of a cyclic sector is that of its full ring.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from particles.diagnostics.contact_geometry import contact_geometry
from particles.diagnostics.tensors import cylindrical_frame, deviator, in_frame, ring_average
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable
from particles.periodicity import Periodicity
from particles.sector import CyclicSector


@dataclass(frozen=True, slots=True)
class Fabric:
    """The second-order fabric of the contact normals; nan where there is no contact.

    Attributes
    ----------
    cartesian, cylindrical : ndarray, shape (3, 3)
        Components along (x, y, z) and (r, phi, z) [-]; trace 1.
    contacts : int
        Contacts that were counted, in what is simulated.
    """

    cartesian: np.ndarray
    cylindrical: np.ndarray
    contacts: int

    @property
    def anisotropy(self) -> float:
        """sqrt(3/2 D:D), D the Cartesian deviator [-]: 0 isotropic, 1 all contacts parallel."""
        return deviator(self.cartesian)

    @property
    def ring_anisotropy(self) -> float:
        """Anisotropy of the cylindrical tensor [-], which has a meaning in a ring."""
        return deviator(self.cylindrical)


def fabric(
    grains: Grains,
    contacts: ContactTable,
    periodicity: Periodicity | None = None,
    *,
    force_weighted: bool = False,
) -> Fabric:
    """Fabric of the contacts (module docstring); pulling contacts weigh nothing in the force-weighted one."""
    geometry = contact_geometry(grains, contacts, periodicity)
    used = geometry.is_pair
    n, point = geometry.normal[used], contacts.point[used]
    weight = np.maximum(geometry.normal_force[used], 0.0) if force_weighted else np.ones(len(n))
    total = float(weight.sum())
    if total == 0.0:
        nothing = np.full((3, 3), np.nan)
        return Fabric(nothing, nothing, len(n))
    local = in_frame(cylindrical_frame(point), n)
    cartesian, cylindrical = ((weight * v.T) @ v / total for v in (n, local))
    sector = periodicity if isinstance(periodicity, CyclicSector) else None
    return Fabric(ring_average(cartesian, sector), cylindrical, len(n))
