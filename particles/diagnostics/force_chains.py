"""Force chains: the lines of grains along which the load runs.

Chains follow Peters, Muthuswamy, Wibowo & Tordesillas, Phys. Rev. E 72 (2005) 041307: a grain is highly stressed
where its major principal stress is above the mean of all grains; two of them that touch are linked where the line
between their centres is within ``angle`` (45 degrees) of the direction of the major principal stress of both; a chain
has three grains or more. Here a chain does not branch: every grain keeps one link in each sense of its direction, the
best aligned one, and a link counts when both grains keep it. So the chains do not depend on the order of the grains.

A chain through the faces of a cyclic sector is one chain; the full ring has n times as many.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from particles.diagnostics.contact_geometry import contact_geometry
from particles.diagnostics.stress import grain_stress
from particles.diagnostics.tensors import principal
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable
from particles.periodicity import Periodicity

SHORTEST = 3  # grains


@dataclass(frozen=True, slots=True)
class ForceChains:
    """Chains of highly stressed grains.

    Attributes
    ----------
    chain : ndarray of int64, shape (n,)
        Number of the chain of each grain, -1 where it is in none.
    lengths : ndarray of int64, shape (chains,)
        Grains in each chain.
    links : ndarray of int64
        Rows of the contact table that join neighbours in a chain.
    major_stress : ndarray, shape (n,)
        Major principal stress of each grain [Pa], compression positive.
    direction : ndarray, shape (n, 3)
        Its direction (a unit vector, of either sign).
    """

    chain: np.ndarray
    lengths: np.ndarray
    links: np.ndarray
    major_stress: np.ndarray
    direction: np.ndarray

    @property
    def fraction(self) -> float:
        """Fraction of the grains that stand in a chain [-]."""
        return float(np.mean(self.chain >= 0))


def force_chains(
    grains: Grains, contacts: ContactTable, periodicity: Periodicity | None = None, *, angle: float = 0.25 * np.pi
) -> ForceChains:
    """Find the chains; ``angle`` [rad] is the largest between a link and the stress of its two grains.

    Raises
    ------
    ValueError
        For an angle that is not between 0 and 90 degrees.
    """
    if not 0.0 < angle < 0.5 * np.pi:
        raise ValueError(f"angle = {np.degrees(angle):g} degrees; allowed: between 0 and 90 (45 is usual)")
    value, direction = principal(grain_stress(grains, contacts, periodicity))
    major, axis = value[:, 0], direction[:, 0]
    high = major > major.mean()

    rows = np.flatnonzero((contacts.j >= 0) & high[contacts.i] & high[np.maximum(contacts.j, 0)])
    i, j = contacts.i[rows], contacts.j[rows]
    normal = contact_geometry(grains, contacts, periodicity).normal[rows]
    axis_j = axis[j] if periodicity is None else periodicity.turn(axis[j], contacts.shift[rows])
    along_i, along_j = (np.einsum("ka,ka->k", normal, a) for a in (axis[i], axis_j))
    worse = np.minimum(np.abs(along_i), np.abs(along_j))
    kept = worse >= np.cos(angle)
    rows, i, j, worse, along_i, along_j = (a[kept] for a in (rows, i, j, worse, along_i, along_j))

    # a grain's two ends: 2 i + 1 along its axis, 2 i against it; seen from j the link points along -normal
    end_i, end_j = 2 * i + (along_i > 0.0), 2 * j + (along_j < 0.0)
    best = np.zeros(2 * grains.count)
    for end in (end_i, end_j):
        np.maximum.at(best, end, worse)
    mutual = (worse == best[end_i]) & (worse == best[end_j])
    rows, i, j = rows[mutual], i[mutual], j[mutual]

    graph = coo_array((np.ones(len(i)), (i, j)), shape=(grains.count, grains.count))
    _, label = connected_components(graph, directed=False)
    size = np.bincount(label)
    long_ = size >= SHORTEST
    number = np.where(long_, np.cumsum(long_) - 1, -1)
    chain = number[label]
    return ForceChains(chain, size[long_], rows[chain[i] >= 0], major, axis)
