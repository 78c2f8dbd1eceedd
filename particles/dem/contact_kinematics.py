"""Kinematics and loads of a contact, of grain pairs and of grains at walls: `ContactKinematics`, lever arms, torques.

The partner of a grain is another grain or a wall. A wall is a partner of infinite mass and radius whose surface moves
with its body: m_eff and r_eff are those of the grain, and the lever arm to its centre is taken by the body about its
own axis (`particles.dem.wall_contacts`). How much the normal turns in a step is known between grains alone; at a wall,
whose curvature is not, springs keep their length instead (`particles.dem.contact_kernel.rotate_spring`).

Lever arms of two grains sum to the distance of their centres, and the two torques are l_i n x F and l_j n x F: angular
momentum is conserved to round-off. Scalars and SIMD vectors alike, except for `contact_loads` (vectors).
"""

from __future__ import annotations

from typing import Any, NamedTuple

from geometry.kernels.device_functions import device_function
from geometry.kernels.simd import LANES, reduce_add, reduce_max, select, splat, to_tuple
from geometry.kernels.simd_tables import WIDE, gather_columns, scatter_columns
from particles.dem.contact_kernel import ContactForce, ContactKinematics, contact_force, rolling_torque, twisting_torque

MAX_REMEMBERED = 20  # columns of a history, 18 and two empty ones (`particles.dem.contact_columns`)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def pair_kinematics(overlap, normal, inverse, velocity, surface_velocity, spin, dt):
    """Return the `ContactKinematics` of grains i and j.

    Parameters
    ----------
    overlap : float
        [m]
    normal : tuple of 3 floats
        Unit vector n from i to j.
    inverse : float
        1 over the distance of the centres [1/m].
    velocity : tuple of 3 floats
        Of the centre of i relative to that of j [m/s].
    surface_velocity : tuple of 3 floats
        l_i omega_i + l_j omega_j [m/s], with the lever arms l to the point where they touch.
    spin : tuple of 3 floats
        omega_i + omega_j [rad/s].
    dt : float
        Step [s].
    """
    nx, ny, nz = normal
    ux, uy, uz = velocity
    ax, ay, az = surface_velocity
    sx, sy, sz = spin
    # by how much n has turned in the drift that has just ended
    hx, hy, hz = -ux * dt * inverse, -uy * dt * inverse, -uz * dt * inverse
    along = hx * nx + hy * ny + hz * nz
    inverse_last = 1.0 + along  # d/d_last
    return ContactKinematics(
        overlap,
        normal,
        (ux + ay * nz - az * ny, uy + az * nx - ax * nz, uz + ax * ny - ay * nx),
        ((hx - along * nx) * inverse_last, (hy - along * ny) * inverse_last, (hz - along * nz) * inverse_last),
        0.5 * (sx * nx + sy * ny + sz * nz),
    )


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def wall_kinematics(overlap, normal, arm, velocity, spin, omega, point):
    """Return the `ContactKinematics` of a grain and a wall that turns about z.

    Parameters
    ----------
    overlap, normal
        As of `pair_kinematics`, n towards the wall.
    arm : float
        Distance of the grain's centre from the wall [m].
    velocity, spin : tuples of 3 floats
        Of the grain [m/s], [rad/s].
    omega : float
        Angular speed of the wall's body [rad/s].
    point : tuple of 2 floats
        Where they touch, x and y [m].
    """
    nx, ny, nz = normal
    vx, vy, vz = velocity
    wx, wy, wz = spin
    px, py = point
    sliding = (
        vx + arm * (wy * nz - wz * ny) + omega * py,
        vy + arm * (wz * nx - wx * nz) - omega * px,
        vz + arm * (wx * ny - wy * nx),
    )
    return ContactKinematics(overlap, normal, sliding, None, 0.5 * (wx * nx + wy * ny + (wz + omega) * nz))


class ContactLoads(NamedTuple):
    """Loads and energies of eight contacts; 0 in lanes that are masked, except for ``law``.

    Attributes
    ----------
    law : ContactForce
        What the law gives.
    force, torque : tuples of 3 vectors
        On grain i [N], [N m].
    reaction : tuple of 3 vectors
        Torque on the partner about its own centre [N m]; at a wall without the force's lever.
    energies : tuple of 6 vectors
        Energy of the springs, losses to normal and tangential damping, sliding, rolling, twisting [J].
    """

    law: ContactForce
    force: tuple[Any, Any, Any]
    torque: tuple[Any, Any, Any]
    reaction: tuple[Any, Any, Any]
    energies: tuple[Any, Any, Any, Any, Any, Any]


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def contact_loads(
    law, resistance, energy_column, m_eff, r_eff, inertia, dt, kinematics, arm, partner_arm, relative_spin, active,
    history,
):
    """Return the `ContactLoads` of eight contacts; their histories are updated.

    Parameters
    ----------
    law, history : tables with one row of vectors
        Parameters of the law, and what the contacts remember.
    resistance, energy_column
        As of `particles.dem.step_kernel.run_steps`.
    m_eff, r_eff, inertia : vectors
        Reduced mass [kg], radius [m] and moment of inertia [kg m^2]; of the grain at a wall.
    dt : float
        Step [s].
    kinematics : ContactKinematics
    arm, partner_arm : vectors; the second None at a wall
        Lever arms [m].
    relative_spin : tuple of 3 vectors
        omega_i - omega_j [rad/s].
    active : mask
        Lanes that count.
    """
    nx, ny, nz = kinematics.normal
    px, py, pz = relative_spin
    force = contact_force(law, 0, energy_column, m_eff, r_eff, dt, kinematics, history, 0)
    stored, rolled, twisted = force.stored, splat(0.0), splat(0.0)
    gx, gy, gz = select(active, force.x, 0.0), select(active, force.y, 0.0), select(active, force.z, 0.0)
    mx, my, mz = ny * gz - nz * gy, nz * gx - nx * gz, nx * gy - ny * gx
    tx, ty, tz = arm * mx, arm * my, arm * mz
    if partner_arm is not None:
        mx, my, mz = partner_arm * mx, partner_arm * my, partner_arm * mz
    else:
        mx, my, mz = splat(0.0), splat(0.0), splat(0.0)
    if resistance is not None:
        if resistance.rolling >= 0:
            (hx, hy, hz), energy, rolled = rolling_torque(
                law, 0, energy_column, r_eff, inertia, dt, force, kinematics, relative_spin, history, 0,
                resistance.rolling,
            )  # fmt: skip
            stored = stored + energy
            hx, hy, hz = select(active, hx, 0.0), select(active, hy, 0.0), select(active, hz, 0.0)
            tx, ty, tz = tx + hx, ty + hy, tz + hz
            mx, my, mz = mx - hx, my - hy, mz - hz
        if resistance.twisting >= 0:
            spin = px * nx + py * ny + pz * nz
            twist, energy, twisted = twisting_torque(
                law, 0, energy_column, r_eff, inertia, dt, force, spin, history, 0, resistance.twisting
            )
            stored = stored + energy
            twist = select(active, twist, 0.0)
            tx, ty, tz = tx + twist * nx, ty + twist * ny, tz + twist * nz
            mx, my, mz = mx - twist * nx, my - twist * ny, mz - twist * nz
    energies = (
        select(active, stored, 0.0), select(active, force.lost_n, 0.0), select(active, force.lost_t, 0.0),
        select(active, force.lost_s, 0.0), select(active, rolled, 0.0), select(active, twisted, 0.0),
    )  # fmt: skip
    return ContactLoads(force, (gx, gy, gz), (tx, ty, tz), (mx, my, mz), energies)


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def load_rows(table, rows, vectors):
    """Load eight whole rows of a table into ``vectors``, a `stack_table`."""
    for first in range(0, table.shape[1], WIDE):
        four = gather_columns(table, rows, first)
        vectors[0, first], vectors[0, first + 1], vectors[0, first + 2], vectors[0, first + 3] = four


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def store_rows(table, rows, vectors):
    """Store ``vectors`` where `load_rows` reads them."""
    for first in range(0, table.shape[1], WIDE):
        scatter_columns(
            table, rows, first, vectors[0, first], vectors[0, first + 1], vectors[0, first + 2], vectors[0, first + 3]
        )


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def add_sums(energies, vectors):
    """Add the sums of six vectors to six energies [J]."""
    return (
        energies[0] + reduce_add(vectors[0]), energies[1] + reduce_add(vectors[1]),
        energies[2] + reduce_add(vectors[2]), energies[3] + reduce_add(vectors[3]),
        energies[4] + reduce_add(vectors[4]), energies[5] + reduce_add(vectors[5]),
    )  # fmt: skip


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def lane_max(depth, i, max_overlap, argmax_overlap):
    """Return the largest of eight overlaps and ``max_overlap``, and the grain that has it."""
    if reduce_max(depth) > max_overlap:
        max_overlap, argmax_overlap = _lane_argmax(depth, i, max_overlap, argmax_overlap)
    return max_overlap, argmax_overlap


@device_function(without_refcounts=True, error_model="numpy")
def _lane_argmax(depth, i, max_overlap, argmax_overlap):
    depths = to_tuple(depth)
    for q in range(LANES):
        if depths[q] > max_overlap:
            max_overlap, argmax_overlap = depths[q], i[q]
    return max_overlap, argmax_overlap
