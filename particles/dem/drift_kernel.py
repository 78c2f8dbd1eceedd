"""Compiled kick and drift of eight grains at a time (SIMD), whose forces are complete.

Velocities are half a step behind positions (`particles.dem.step_kernel`).
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import maximum, reduce_add, reduce_max, select, splat
from geometry.kernels.simd_tables import (
    gather,
    gather_column,
    gather_columns,
    gather_two_columns,
    scatter_column,
    scatter_columns,
    scatter_two_columns,
)
from particles.dem import total_columns as total
from particles.dem.box_kernel import add_motion, no_motion, peculiar_displacement, peculiar_velocity, store_motion
from particles.dem.motion_columns import FORCE, SPIN, TORQUE, VELOCITY
from particles.laws.springs import equal


class Drifted(NamedTuple):
    """Sums over the drifted grains of a chunk, as SIMD vectors.

    Attributes
    ----------
    squared_travel, squared_speed : lanes
        Largest squared displacement from ``reference`` [m^2] and squared speed [m^2/s^2].
    contact, gravity, external : tuples of 2 lanes
        Works [J] of half a kick with the velocities of the drift before it, and with those of the drift after it.
    kinetic : lanes
        [J], of the last step.
    motion : tuple of 8 lanes
        Of `particles.dem.box_kernel.add_motion`, 0 outside of a sheared box. In one all velocities and displacements
        here are peculiar.
    """

    squared_travel: Any
    squared_speed: Any
    contact: tuple[Any, Any]
    gravity: tuple[Any, Any]
    external: tuple[Any, Any]
    kinetic: Any
    motion: Any


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def none_drifted():
    """`Drifted` of no grain."""
    none = splat(0.0)
    return Drifted(none, none, (none, none), (none, none), (none, none), none, no_motion())


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def drift_eight(rows, active, now, law, energy_column, attraction, grains, drifted):
    """Kick and drift of the grains ``rows`` under what lies at their places, which is cleared for the next step.

    ``active`` says which of the eight count; the others repeat one that does. Returns ``drifted`` with theirs.
    """
    motion, gravity, external = grains.velocity_force, grains.gravity, grains.external
    vx, vy, vz, wx = gather_columns(motion, rows, VELOCITY)
    wy, wz = gather_two_columns(motion, rows, SPIN + 1)
    fx, fy, fz, tx = gather_columns(motion, rows, FORCE)
    ty, tz = gather_two_columns(motion, rows, TORQUE + 1)
    x, y, z, radius = gather_columns(grains.position_radius, rows, 0)
    dt = now.dt
    m = splat(grains.mass[0]) if equal(law) else gather(grains.mass, rows)
    kick = dt / m
    turn = kick / (0.4 * radius * radius)
    ax, ay, az = fx, fy, fz
    g = min(now.step, gravity.shape[0] - 1)
    if gravity.shape[0] > 0:
        ax, ay, az = ax + m * gravity[g, 0], ay + m * gravity[g, 1], az + m * gravity[g, 2]
    none = splat(0.0)
    px = py = pz = hx = hy = hz = none
    if external.shape[0] > 0:
        hx, hy = gather_two_columns(external, rows, 0)
        hz = gather_column(external, rows, 2)
    if attraction is not None:
        px, py, pz, _ = gather_columns(attraction.force, rows, 0)
        scatter_columns(attraction.force, rows, 0, none, none, none, none)
        hx, hy, hz = hx + px, hy + py, hz + pz  # forces of no contact: one sum of their work
    ax, ay, az = ax + hx, ay + hy, az + hz
    bx, by, bz = vx + kick * ax, vy + kick * ay, vz + kick * az
    ox, oy, oz = wx + turn * tx, wy + turn * ty, wz + turn * tz
    scatter_columns(motion, rows, VELOCITY, bx, by, bz, ox)
    scatter_two_columns(motion, rows, SPIN + 1, oy, oz)
    scatter_columns(motion, rows, FORCE, none, none, none, none)
    scatter_two_columns(motion, rows, TORQUE + 1, none, none)
    contact, weight, work, kinetic = drifted.contact, drifted.gravity, drifted.external, drifted.kinetic
    sx, ex = peculiar_velocity(grains.flow, vx, vz, z, -0.5 * dt), peculiar_velocity(grains.flow, bx, bz, z, 0.5 * dt)
    motion_sums = add_motion(grains.flow, drifted.motion, active, dt, m, (sx, vy, vz), (ex, by, bz))
    if energy_column is not None:
        # half a kick with the velocities of the drift before it, half with those of the drift after it: the mean closes
        # the balance of kinetic energy exactly, and by drifts it is the trapezoidal rule
        half = select(active, 0.5 * dt, none)
        contact = (
            contact[0] + half * (fx * sx + fy * vy + fz * vz + tx * wx + ty * wy + tz * wz),
            contact[1] + half * (fx * ex + fy * by + fz * bz + tx * ox + ty * oy + tz * oz),
        )
        if gravity.shape[0] > 0:
            gx, gy, gz = gravity[g, 0], gravity[g, 1], gravity[g, 2]
            weight = (
                weight[0] + half * m * (gx * sx + gy * vy + gz * vz),
                weight[1] + half * m * (gx * ex + gy * by + gz * bz),
            )
        if external.shape[0] > 0 or attraction is not None:
            work = (
                work[0] + half * (hx * sx + hy * vy + hz * vz),
                work[1] + half * (hx * ex + hy * by + hz * bz),
            )
        if now.last:  # at the time of the positions that the forces belong to
            moving = sx * ex + vy * by + vz * bz + 0.4 * radius * radius * (wx * ox + wy * oy + wz * oz)
            kinetic = kinetic + select(active, 0.5 * m * moving, none)
    x, y, z = x + dt * bx, y + dt * by, z + dt * bz
    scatter_columns(grains.position_radius, rows, 0, x, y, z, radius)
    if now.last:
        scatter_column(grains.net, rows, 0, fx)
        scatter_column(grains.net, rows, 1, fy)
        scatter_column(grains.net, rows, 2, fz)
    at_x, at_y = gather_two_columns(grains.reference, rows, 0)
    at_z = gather_column(grains.reference, rows, 2)
    dx, dy, dz = x - at_x, y - at_y, z - at_z
    dx = peculiar_displacement(grains.flow, dt, dx, dz, at_z)
    travel2 = dx * dx + dy * dy + dz * dz + 0.0 * (ox + oy + oz)  # a spin that is not finite shows here too
    travel2 = select(travel2 < np.inf, travel2, np.inf)
    return Drifted(
        maximum(drifted.squared_travel, travel2),
        maximum(drifted.squared_speed, ex * ex + by * by + bz * bz),
        contact,
        weight,
        work,
        kinetic,
        motion_sums,
    )


@device_function(without_refcounts=True, error_model="numpy")
def add_drifted(chunk, drifted, energy_column, grains, row):
    """Add what has drifted to the chunk's sums ``row``."""
    store_motion(grains.virial, chunk, drifted.motion)
    row[total.MAX_SQUARED_TRAVEL] = max(row[total.MAX_SQUARED_TRAVEL], reduce_max(drifted.squared_travel))
    row[total.MAX_SQUARED_SPEED] = max(row[total.MAX_SQUARED_SPEED], reduce_max(drifted.squared_speed))
    if energy_column is not None:
        row[total.CONTACT_WORK] += reduce_add(drifted.contact[0])
        row[total.CONTACT_LATER] += reduce_add(drifted.contact[1])
        row[total.GRAVITY_WORK] += reduce_add(drifted.gravity[0])
        row[total.GRAVITY_LATER] += reduce_add(drifted.gravity[1])
        row[total.EXTERNAL_WORK] += reduce_add(drifted.external[0])
        row[total.EXTERNAL_LATER] += reduce_add(drifted.external[1])
        row[total.KINETIC] += reduce_add(drifted.kinetic)
