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
from numba import njit, prange

from coupling.neighbour_rows import NeighbourRows


@njit(cache=True, parallel=True, error_model="numpy", fastmath={"contract"})
def _dipole_rows(position, moment, radius, start, other, shift, turn_cos, turn_sin, cutoff, force, torque, energy):
    """One grain a row: force [N], z-component of m x B of its neighbours [N m], half of its pair energies [J]."""
    mu_0_4pi = 1e-7
    inner = 0.9 * cutoff
    for i in prange(position.shape[0]):
        xi, yi, zi = position[i, 0], position[i, 1], position[i, 2]
        ax, ay, az = moment[i, 0], moment[i, 1], moment[i, 2]
        fx = fy = fz = tz = u = 0.0
        for p in range(start[i], start[i + 1]):
            j = other[p]
            c, s = turn_cos[shift[p]], turn_sin[shift[p]]
            dx = xi - (c * position[j, 0] - s * position[j, 1])
            dy = yi - (s * position[j, 0] + c * position[j, 1])
            dz = zi - position[j, 2]
            r2 = dx * dx + dy * dy + dz * dz
            if r2 >= cutoff * cutoff:
                continue
            bx = c * moment[j, 0] - s * moment[j, 1]
            by = s * moment[j, 0] + c * moment[j, 1]
            bz = moment[j, 2]
            true_distance = np.sqrt(r2)
            dx /= true_distance
            dy /= true_distance
            dz /= true_distance
            r = max(true_distance, radius[i] + radius[j])
            w3 = mu_0_4pi / (r * r * r)
            ar = ax * dx + ay * dy + az * dz
            br = bx * dx + by * dy + bz * dz
            ab = ax * bx + ay * by + az * bz
            switch, slope = 1.0, 0.0
            if r > inner:
                t = (r - inner) / (cutoff - inner)
                switch = 1.0 - t * t * (3.0 - 2.0 * t)
                slope = -6.0 * t * (1.0 - t) / (cutoff - inner)
            pair_energy = w3 * (ab - 3.0 * ar * br)
            w4 = 3.0 * w3 / r * switch
            along = w4 * (ab - 5.0 * ar * br) - slope * pair_energy
            fx += w4 * (br * ax + ar * bx) + along * dx
            fy += w4 * (br * ay + ar * by) + along * dy
            fz += w4 * (br * az + ar * bz) + along * dz
            u += 0.5 * switch * pair_energy
            # clamped pairs act at their true distance: the lever is shorter by true/r
            field_x = w3 * switch * (3.0 * br * dx - bx) * (true_distance / r)
            field_y = w3 * switch * (3.0 * br * dy - by) * (true_distance / r)
            tz += ax * field_y - ay * field_x
        force[i, 0] += fx
        force[i, 1] += fy
        force[i, 2] += fz
        torque[i] = tz
        energy[i] = u


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
        sum(x x F)_z over the same pairs, which a ledger computes from forces.
    energy : float
        Interaction energy at fixed moments [J].
    """
    n = position.shape[0]
    torque, energy = np.empty(n), np.empty(n)
    _dipole_rows(
        position,
        moment,
        radius,
        rows.start,
        rows.other,
        rows.shift,
        rows.turn_cos,
        rows.turn_sin,
        cutoff,
        force,
        torque,
        energy,
    )
    return -float(torque.sum()), float(energy.sum())
