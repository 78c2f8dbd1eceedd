"""Point-dipole forces between magnetised grains inside a cut-off.

Force on grain i from grain j, r = x_i - x_j, rh = r/|r| (Jackson, Classical Electrodynamics, 3rd ed., §5.7)::

    F_i = 3 mu_0/(4 pi r^4) [ (m_j.rh) m_i + (m_i.rh) m_j + (m_i.m_j) rh - 5 (m_i.rh)(m_j.rh) rh ]
    U   =   mu_0/(4 pi r^3) [ m_i.m_j - 3 (m_i.rh)(m_j.rh) ]
    B_j(x_i) = mu_0/(4 pi r^3) [ 3 (m_j.rh) rh - m_j ]

Between 0.9 and 1 times the cut-off the pair energy is multiplied by a cubic switch s(r), so that the force
stays the gradient of an energy at fixed moments and no pair pops in or out. |r| is clamped from below at the
sum of the radii (overlapping grains: the field of a sphere ends at its surface).

For every pair r x F = -(m_i x B_j + m_j x B_i): the pair does not conserve angular momentum by itself. Isotropic
grains are not spun by m x B of their neighbours; that torque is booked here, pair by pair and from m and B alone,
as the field's reaction (the poles and the coil take it).

Every pair is computed from both sides, so that a grain's force is one sum in a fixed order: the result does not
depend on the number of threads, bit for bit.
"""

from __future__ import annotations

import numpy as np

from coupling.dipole_kernels import dipole_rows
from coupling.neighbour_rows import NeighbourRows


def add_dipole_forces(position, moment, radius, rows: NeighbourRows, cutoff: float, force):
    """Add the pair forces of all near dipoles to `force`.

    Parameters
    ----------
    position, moment : (n, 3) float64
        Grain centres [m] and moments [A m^2].
    radius : (n,) float64
        [m].
    rows : NeighbourRows
        Every neighbour of every grain out to at least `cutoff`.
    cutoff : float
        [m].
    force : (n, 3) float64
        Added to in place [N].

    Returns
    -------
    reaction : float
        -sum(m_i x B_j)_z [N m], the torque of the pairs on the grains, from moments and fields; it equals
        sum(x x F)_z over the same pairs, which the window's budget computes from forces.
    energy : float
        Interaction energy at fixed moments [J].
    """
    n = position.shape[0]
    torque, energy = np.empty(n), np.empty(n)
    dipole_rows(position, moment, radius, rows.arrays, cutoff, force, torque, energy)
    return -float(torque.sum()), float(energy.sum())
