"""The compiled steps of grains in a sheared cell: contacts, the attraction of near pairs, kick, drift.

Leapfrog as in `particles.dem.step_kernel`, with velocities half a step behind positions; the law of contacts and its
energy budget are the same functions. Everything runs in the order of the pairs on one thread, so no bit depends on
threads.

Stress counts r_a F_b with F on the grain at r from its partner, over the pairs; the energy budget follows the
trapezoidal rule by drifts (`particles.dem.contact_kernel`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np
from numba import njit

from coupling.sheared_cell.near_pull import held_pull
from particles.dem.contact_kernel import contact_force, stored_in_springs
from particles.dem.contact_kinematics import pair_touch

# Columns of the sums over steps; those of the first line are sums over the steps
CONTACT_ZX, CONTACT_XZ, CONTACT_ALL, NEAR_ZX, NEAR_ALL, KINETIC_ZX, CONTACTS = range(7)
LOST_NORMAL, LOST_TANGENTIAL, LOST_SLIDING = 7, 8, 9
ELASTIC, KINETIC, DEEPEST, FASTEST = 10, 11, 12, 13  # the last two steps' energies; largest of all steps
N_SUMS = 14
N_HISTORY = 7  # spring (3), last dashpot, last tangential force (3)
ENERGY_COLUMN = 3  # of a history: the first of the last forces


class Flow(NamedTuple):
    """The cell: its edges (3,) [m], how far the one above has moved on [m], the shear rate [1/s]."""

    lengths: np.ndarray
    offset: float
    rate: float


class CellGrains(NamedTuple):
    """Equal grains: position [m], velocity [m/s], spin [rad/s], held force [N], (n, 3) each; radius [m], mass [kg]."""

    position: np.ndarray
    velocity: np.ndarray
    spin: np.ndarray
    held: np.ndarray
    radius: float
    mass: float


class FollowedPairs(NamedTuple):
    """The pairs whose gaps are followed from step to step.

    Attributes
    ----------
    first, second : ndarray, shape (p,)
    image : ndarray, shape (p, 3)
        In which image of the cell the second grain is met.
    history, touching : ndarray, shapes (p, N_HISTORY), (p,)
        What the contact remembers.
    grip : ndarray, shape (p, N_GRIP)
        Of the attraction (`coupling.sheared_cell.near_pull`).
    """

    first: np.ndarray
    second: np.ndarray
    image: np.ndarray
    history: np.ndarray
    touching: np.ndarray
    grip: np.ndarray


class NearPull(NamedTuple):
    """The attraction of near pairs: its table, whether there is one, the smallest gap [radii]."""

    table: Any
    near: bool
    smallest_gap: float


@njit(cache=True, error_model="numpy", fastmath={"contract"})
def shear_steps(n_steps, dt, flow, grains, pairs, law, attraction, sums):
    """``n_steps`` steps; grains, history, touching and sums are brought forward."""
    lengths, offset, rate = flow
    position, velocity, spin, held, radius, mass = grains
    first, second, image, history, touching, grip = pairs
    table, near, smallest_gap = attraction
    n = position.shape[0]
    force, torque = np.empty((n, 3)), np.empty((n, 3))
    reach2 = 4.0 * radius * radius
    most = 2.0 * radius + 1.2 * radius
    jump = rate * lengths[2]
    kick, turn = dt / mass, dt / (0.4 * mass * radius * radius)
    contact_zx = contact_xz = contact_all = near_zx = near_all = kinetic_zx = contacts = 0.0
    lost_normal = lost_tangential = lost_sliding = elastic = kinetic = 0.0
    deepest, fastest = sums[DEEPEST], sums[FASTEST]
    for _ in range(n_steps):
        elastic = kinetic = 0.0
        for i in range(n):
            for a in range(3):
                force[i, a], torque[i, a] = held[i, a], 0.0
        for k in range(first.shape[0]):
            i, j = first[k], second[k]
            sx, sy, sz = image[k, 0], image[k, 1], image[k, 2]
            # from i to j, as the law counts it
            dx = position[j, 0] + (sx * lengths[0] + sz * offset) - position[i, 0]
            dy = position[j, 1] + sy * lengths[1] - position[i, 1]
            dz = position[j, 2] + sz * lengths[2] - position[i, 2]
            d2 = dx * dx + dy * dy + dz * dz
            if d2 >= most * most:
                continue
            d = np.sqrt(d2)
            inverse = 1.0 / d
            nx, ny, nz = dx * inverse, dy * inverse, dz * inverse
            fx = fy = fz = 0.0
            if near:
                gap = max((d - 2.0 * radius) / radius, smallest_gap)
                pull = held_pull(table, gap, grip, k)
                fx, fy, fz = pull * nx, pull * ny, pull * nz
                near_zx -= dz * fx
                near_all -= pull * d
            vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
            ux, uy, uz = velocity[j, 0] + sz * jump, velocity[j, 1], velocity[j, 2]
            if d2 < reach2:
                touching[k] = 1
                wx, wy, wz = spin[i, 0], spin[i, 1], spin[i, 2]
                qx, qy, qz = spin[j, 0], spin[j, 1], spin[j, 2]
                arm = 0.5 * d
                both = wx + qx, wy + qy, wz + qz
                swing = arm * (wx + qx), arm * (wy + qy), arm * (wz + qz)
                between = vx - ux, vy - uy, vz - uz
                touch = pair_touch(2.0 * radius - d, (nx, ny, nz), inverse, between, swing, both, dt)
                contact = contact_force(law, 0, ENERGY_COLUMN, 0.5 * mass, 0.5 * radius, dt, touch, history, k)
                gx, gy, gz = contact.x, contact.y, contact.z
                mx, my, mz = arm * (ny * gz - nz * gy), arm * (nz * gx - nx * gz), arm * (nx * gy - ny * gx)
                torque[i, 0] += mx
                torque[i, 1] += my
                torque[i, 2] += mz
                torque[j, 0] += mx
                torque[j, 1] += my
                torque[j, 2] += mz
                contact_zx -= dz * gx
                contact_xz -= dx * gz
                contact_all -= dx * gx + dy * gy + dz * gz
                contacts += 1.0
                lost_normal += contact.lost_n
                lost_tangential += contact.lost_t
                lost_sliding += contact.lost_s
                elastic += contact.stored
                deepest = max(deepest, 2.0 * radius - d)
                fx, fy, fz = fx + gx, fy + gy, fz + gz
            elif touching[k] != 0:
                touching[k] = 0
                closing = (vx - ux) * nx + (vy - uy) * ny + (vz - uz) * nz
                lost_n, lost_s, _, _ = stored_in_springs(
                    law, 0, None, ENERGY_COLUMN, 0.5 * radius, closing * dt, history, k
                )
                lost_normal += lost_n
                lost_sliding += lost_s
                for a in range(history.shape[1]):
                    history[k, a] = 0.0
            force[i, 0] += fx
            force[i, 1] += fy
            force[i, 2] += fz
            force[j, 0] -= fx
            force[j, 1] -= fy
            force[j, 2] -= fz
        for i in range(n):
            vx, vy, vz = velocity[i, 0], velocity[i, 1], velocity[i, 2]
            bx, by, bz = vx + kick * force[i, 0], vy + kick * force[i, 1], vz + kick * force[i, 2]
            wx, wy, wz = spin[i, 0], spin[i, 1], spin[i, 2]
            ox, oy, oz = wx + turn * torque[i, 0], wy + turn * torque[i, 1], wz + turn * torque[i, 2]
            z = position[i, 2]
            # energies at the time of the positions, less the flow rate z: a wrap does not change them
            px, qx = vx - rate * (z - 0.5 * dt * vz), bx - rate * (z + 0.5 * dt * bz)
            kinetic += (
                0.5 * mass * (px * qx + vy * by + vz * bz + 0.4 * radius * radius * (wx * ox + wy * oy + wz * oz))
            )
            kinetic_zx += mass * 0.5 * (px * vz + qx * bz)
            fastest = max(fastest, qx * qx + by * by + bz * bz)
            velocity[i, 0], velocity[i, 1], velocity[i, 2] = bx, by, bz
            spin[i, 0], spin[i, 1], spin[i, 2] = ox, oy, oz
            position[i, 0] += dt * bx
            position[i, 1] += dt * by
            position[i, 2] = z + dt * bz
        offset += jump * dt
    sums[CONTACT_ZX] += contact_zx
    sums[CONTACT_XZ] += contact_xz
    sums[CONTACT_ALL] += contact_all
    sums[NEAR_ZX] += near_zx
    sums[NEAR_ALL] += near_all
    sums[KINETIC_ZX] += kinetic_zx
    sums[CONTACTS] += contacts
    sums[LOST_NORMAL] += lost_normal
    sums[LOST_TANGENTIAL] += lost_tangential
    sums[LOST_SLIDING] += lost_sliding
    sums[ELASTIC], sums[KINETIC], sums[DEEPEST], sums[FASTEST] = elastic, kinetic, deepest, fastest
