"""Each contact as a vector: from where to where, along which normal, with how much force.

Grain i pushes its partner along n, the unit vector from i towards it. ``ContactTable.force`` is the force on i, so that
-force . n is the normal force, positive where the contact presses. A partner across the faces of a cyclic sector or
a periodic box stands at its image by ``shift``, in the frame of i.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable
from particles.periodicity import Periodicity


@dataclass(frozen=True, slots=True)
class ContactGeometry:
    """Geometry of the m contacts of a table, in its order.

    Attributes
    ----------
    start, end : ndarray, shape (m, 3)
        Centre of grain i, and the partner's centre (its image) or the point on the wall [m].
    branch : ndarray, shape (m, 3)
        end - start [m].
    normal : ndarray, shape (m, 3)
        Unit vector along the branch; zero where a centre lies in the wall.
    normal_force : ndarray, shape (m,)
        -force . normal [N]: positive pushes, negative pulls.
    is_pair : ndarray of bool, shape (m,)
        Between two grains.
    """

    start: np.ndarray
    end: np.ndarray
    branch: np.ndarray
    normal: np.ndarray
    normal_force: np.ndarray
    is_pair: np.ndarray


def contact_geometry(grains: Grains, contacts: ContactTable, periodicity: Periodicity | None = None) -> ContactGeometry:
    """Geometry of the contacts."""
    x, is_pair = grains.position, contacts.j >= 0
    end = np.array(contacts.point, dtype=float)
    partner = x[contacts.j[is_pair]]
    end[is_pair] = partner if periodicity is None else periodicity.place(partner, contacts.shift[is_pair])
    start = x[contacts.i]
    branch = end - start
    length = np.linalg.norm(branch, axis=1)
    normal = branch / np.where(length > 0.0, length, 1.0)[:, None]
    normal_force = -np.einsum("ka,ka->k", contacts.force, normal)
    return ContactGeometry(start, end, branch, normal, normal_force, is_pair)
