"""Compiled force of one contact, whoever the partner is: a grain, a smooth wall, a triangle.

Written without branches, for scalars and for SIMD vectors of eight contacts (`geometry.kernels.simd`): "float" below
means either.

The normal spring and the dashpots come from the scene's law, a number in its table (`particles.laws.springs`). What all
laws share stands here: the clip (an impact never pulls), cohesion, the tangential spring with its slider, rolling
and twisting, and where the energy goes.

**Tangential.** A spring xi and a dashpot in parallel, in series with a slider that yields at mu |F_rep|
(`particles.laws.linear`): the return mapping of an implicit step. The spring turns with its pair. Where the stiffness
follows the overlap, a contact that closes must not stretch the spring's force (that would create energy, Elata &
Berryman, Mech. Mater. 24 (1996) 229): xi shrinks by k_old/k_new then, and keeps its length when the contact opens.

**Energy, second order in dt.** Velocities belong to the drift between the last force and this one. So a mechanism loses
in a step the mean of its last and its present force times that drift (trapezoidal rule); the last forces are kept
with the spring, in a step that keeps the energy budget (``energy_column``) only.

Columns of a contact's history: 0-2 spring xi [m]; with any law but the linear one 3 its memory, 4 its last k_t [N/m],
5 its last stored energy [J]; then 3 rolling angles [rad] and the twisting angle [rad] (`Resistance`); from
``energy_column`` on the last forces: normal dashpot, tangential force (3), rolling torque (3), twisting torque.
"""

from __future__ import annotations

from typing import NamedTuple

from geometry.kernels.device_functions import device_function, njit_without_refcounts
from geometry.kernels.simd import any_lane, maximum, select
from geometry.kernels.simd_math import sqrt
from particles.laws.columns import COHESION_0, COHESION_1, COHESIVE, DAMPING_ROLLING, MU, MU_ROLLING, MU_TWISTING
from particles.laws.springs import remembers, spring, varies

MEMORY, LAST_STIFFNESS, LAST_STORED = 3, 4, 5
TINY = 1e-300  # N^2: the inverse of less may be no number
LAST_TANGENTIAL, LAST_ROLLING, LAST_TWISTING = 1, 4, 7  # after the column of the energy budget


class Resistance(NamedTuple):
    """First columns of the rolling angles and of the twisting angle in a contact's history; -1 where there is none."""

    rolling: int
    twisting: int


class ContactKinematics(NamedTuple):
    """Kinematics of a contact: grain i and its partner.

    Attributes
    ----------
    delta : float
        Overlap [m].
    normal : tuple of 3 floats
        Unit vector n from i to its partner.
    velocity : tuple of 3 floats
        Of i relative to its partner where they touch [m/s].
    rotation : tuple of 3 floats, or None
        How far n has turned in the drift that has just ended, between grains; None at a wall (`rotate_spring`).
    spin : float
        Mean spin of both about n [rad/s].
    """

    delta: float
    normal: tuple[float, float, float]
    velocity: tuple[float, float, float]
    rotation: tuple[float, float, float] | None
    spin: float


class ContactForce(NamedTuple):
    """Results of one step of a contact.

    Attributes
    ----------
    x, y, z : float
        Force on grain i [N].
    repulsion, dashpot, pull : float
        The repulsive part of the normal force, which friction scales with, its dashpot, and cohesion [N].
    k_t, last_k_t : float
        Tangential stiffness of this step and of the last one [N/m].
    stored : float
        Energy of the springs [J].
    lost_n, lost_t, lost_s : float
        Lost in this step to normal damping, tangential damping and sliding [J]; 0 without an energy budget.
    """

    x: float
    y: float
    z: float
    repulsion: float
    dashpot: float
    pull: float
    k_t: float
    stored: float
    lost_n: float
    lost_t: float
    lost_s: float
    last_k_t: float


@njit_without_refcounts(error_model="numpy", fastmath={"contract"}, forceinline=True)
def rotate_spring(rotation, phi, n, history, slot, first):
    """Return the spring in columns ``first`` .. first + 2 of ``history[slot]``, turned with its pair, its length kept.

    It lay in the tangent plane of the last step; it is laid into that of ``n`` and turned about n by the mean spin
    ``phi`` of this step. Between grains n has turned by the vector w = n - n_last (its tangential part ``rotation``),
    known from the drift; then n_last -> n is the turn xi - (xi.n) n + (xi.n) w/2, with cos and sin of phi as series: no
    root, no division, lengths right to fourth order in a step's turn and never longer (1 - w^4/8, 1 - phi^6/72 up to
    2.8 rad a step). At curved walls (``rotation`` None), whose curvature is not known here, a root restores the length.
    """
    nx, ny, nz = n
    x, y, z = history[slot, first], history[slot, first + 1], history[slot, first + 2]
    along = x * nx + y * ny + z * nz
    if rotation is not None:
        wx, wy, wz = rotation
        half = 0.5 * along
        x, y, z = x - along * nx + half * wx, y - along * ny + half * wy, z - along * nz + half * wz
    else:
        before = x * x + y * y + z * z
        x, y, z = x - along * nx, y - along * ny, z - along * nz
        after = maximum(before - along * along, 0.0)
        scale = select(after > 0.0, sqrt(before / after), 0.0)
        scale = select(along * along > 1e-14 * before, scale, 1.0)  # never on a plane
        x, y, z = x * scale, y * scale, z * scale
    square = phi * phi
    cos = 1.0 - square * (0.5 - square * (1.0 / 24.0))
    sin = phi * (1.0 - square * (1.0 / 6.0))
    cx, cy, cz = ny * z - nz * y, nz * x - nx * z, nx * y - ny * x
    return cos * x + sin * cx, cos * y + sin * cy, cos * z + sin * cz


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def rescale_spring(k_t, last, half_square):
    """Return the factor by which a spring of last stiffness ``last`` shrinks, and what is lost.

    ``half_square`` is half of its squared length.

    One that stiffens while the contact closes keeps its force, one that softens its length (module docstring).
    """
    stiffer = k_t > last
    factor = select(stiffer, last / k_t, 1.0)
    return factor, select(stiffer, last * (1.0 - factor), last - k_t) * half_square


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def coulomb_return_map(trial2, limit, compliance):
    """Return the factor by which a trial force yields to its limit, and how far the slider slips by unit of that force.

    ``trial2`` is the square of that force, ``compliance`` the displacement by unit of force of
    what stretches (spring and dashpot).
    """
    slides = trial2 > maximum(limit * limit, TINY)  # trial > 0 needs a finite ``compliance``
    factor = select(slides, limit * sqrt(trial2) * (1.0 / trial2), 1.0)  # a quotient in parallel with the root
    return factor, select(slides, (1.0 - factor) * compliance, 0.0)


@njit_without_refcounts(error_model="numpy", fastmath={"contract"}, forceinline=True)
def contact_force(law, kind, energy_column, m_eff, r_eff, dt, kinematics, history, slot):
    """Force on grain i in the contact ``kinematics``, and what it has cost: a `ContactForce`.

    ``law`` is the table of a spring (`particles.laws.springs`), ``kind`` its row. ``history[slot]`` is updated;
    ``energy_column`` is the first column of the last forces there, or None: then losses are not computed.
    """
    delta, inv_dt = kinematics.delta, 1.0 / dt
    nx, ny, nz = kinematics.normal
    ux, uy, uz = kinematics.velocity
    phi = kinematics.spin * dt
    closing = ux * nx + uy * ny + uz * nz
    f_el, k_t, gamma_n, gamma_t, stored, memory = spring(law, kind, delta, m_eff, r_eff, history[slot, MEMORY])
    if remembers(law):  # column MEMORY belongs to the rolling angle under the linear law
        history[slot, MEMORY] = memory
    f_rep = maximum(f_el + gamma_n * closing, 0.0)  # an impact never pulls
    pull = 0.0
    coheres = law.rows[kind, COHESIVE] > 0.0
    if any_lane(coheres):
        pull = select(coheres, law.rows[kind, COHESION_0] + law.rows[kind, COHESION_1] * r_eff, 0.0)
    f_n = f_rep - pull

    xi_x, xi_y, xi_z = rotate_spring(kinematics.rotation, phi, kinematics.normal, history, slot, 0)
    lost_n = lost_t = lost_s = 0.0
    last = k_t
    if varies(law):
        last = history[slot, LAST_STIFFNESS]
        factor, lost_s = rescale_spring(k_t, last, 0.5 * (xi_x * xi_x + xi_y * xi_y + xi_z * xi_z))
        xi_x, xi_y, xi_z = xi_x * factor, xi_y * factor, xi_z * factor
        history[slot, LAST_STIFFNESS] = k_t

    # trial: the whole sliding distance stretches spring and dashpot
    sx, sy, sz = (ux - closing * nx) * dt, (uy - closing * ny) * dt, (uz - closing * nz) * dt
    rate = gamma_t * inv_dt
    both = k_t + rate
    tx, ty, tz = k_t * xi_x + both * sx, k_t * xi_y + both * sy, k_t * xi_z + both * sz
    factor, slip = coulomb_return_map(tx * tx + ty * ty + tz * tz, law.rows[kind, MU] * f_rep, 1.0 / both)
    slip_x, slip_y, slip_z = slip * tx, slip * ty, slip * tz
    sx, sy, sz = sx - slip_x, sy - slip_y, sz - slip_z
    tx, ty, tz = tx * factor, ty * factor, tz * factor
    if energy_column is not None:
        # last forces; that of the tangential dashpot is the last force less its spring's
        if remembers(law):  # no dashpot: what the spring has taken and does not hold
            lost_n = 0.5 * (history[slot, energy_column] + f_rep) * closing * dt - (stored - history[slot, LAST_STORED])
            history[slot, LAST_STORED] = stored
            history[slot, energy_column] = f_rep
        else:
            lost_n = 0.5 * (history[slot, energy_column] + f_rep - f_el) * closing * dt
            history[slot, energy_column] = f_rep - f_el
        q = energy_column + LAST_TANGENTIAL
        px, py, pz = rotate_spring(kinematics.rotation, phi, kinematics.normal, history, slot, q)
        lost_t = 0.5 * (
            (px - k_t * xi_x + rate * sx) * sx + (py - k_t * xi_y + rate * sy) * sy + (pz - k_t * xi_z + rate * sz) * sz
        )
        lost_s = lost_s + 0.5 * ((px + tx) * slip_x + (py + ty) * slip_y + (pz + tz) * slip_z)
        history[slot, q], history[slot, q + 1], history[slot, q + 2] = tx, ty, tz
    xi_x, xi_y, xi_z = xi_x + sx, xi_y + sy, xi_z + sz
    history[slot, 0], history[slot, 1], history[slot, 2] = xi_x, xi_y, xi_z
    if energy_column is not None:
        stored = stored + 0.5 * k_t * (xi_x * xi_x + xi_y * xi_y + xi_z * xi_z) - pull * delta
    return ContactForce(
        -f_n * nx - tx, -f_n * ny - ty, -f_n * nz - tz, f_rep, f_rep - f_el, pull, k_t, stored,
        lost_n, lost_t, lost_s, last,
    )  # fmt: skip


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def rolling_torque(law, kind, energy_column, arm, inertia, dt, force, kinematics, p, history, slot, first):
    """Rolling resistance on grain i (`particles.laws.rolling_friction`); p is its spin relative to the partner's.

    ``history[slot, first:]`` is the rolling angle [rad], updated. Returns the torque (3) [N m], the stored energy [J]
    and the energy lost in this step [J].
    """
    k_t, last, phi = force.k_t, force.last_k_t, kinematics.spin * dt
    nx, ny, nz = kinematics.normal
    px, py, pz = p
    damping = law.rows[kind, DAMPING_ROLLING]
    k = k_t * arm * arm
    rate = 2.0 * damping * sqrt(k * inertia) * (1.0 / dt)
    x, y, z = rotate_spring(kinematics.rotation, phi, kinematics.normal, history, slot, first)
    lost = 0.0 * k
    if varies(law):
        factor, lost = rescale_spring(k_t, last, 0.5 * arm * arm * (x * x + y * y + z * z))
        x, y, z = x * factor, y * factor, z * factor
    along = px * nx + py * ny + pz * nz
    sx, sy, sz = (px - along * nx) * dt, (py - along * ny) * dt, (pz - along * nz) * dt
    both = k + rate
    tx, ty, tz = k * x + both * sx, k * y + both * sy, k * z + both * sz
    limit = law.rows[kind, MU_ROLLING] * arm * force.repulsion
    factor, slip = coulomb_return_map(tx * tx + ty * ty + tz * tz, limit, 1.0 / both)
    slip_x, slip_y, slip_z = slip * tx, slip * ty, slip * tz
    sx, sy, sz = sx - slip_x, sy - slip_y, sz - slip_z
    tx, ty, tz = tx * factor, ty * factor, tz * factor
    if energy_column is not None:
        q = energy_column + LAST_ROLLING
        lx, ly, lz = rotate_spring(kinematics.rotation, phi, kinematics.normal, history, slot, q)
        lost = lost + 0.5 * (
            (lx - k * x + rate * sx) * sx + (ly - k * y + rate * sy) * sy + (lz - k * z + rate * sz) * sz
            + (lx + tx) * slip_x + (ly + ty) * slip_y + (lz + tz) * slip_z
        )  # fmt: skip
        history[slot, q], history[slot, q + 1], history[slot, q + 2] = tx, ty, tz
    x, y, z = x + sx, y + sy, z + sz
    history[slot, first], history[slot, first + 1], history[slot, first + 2] = x, y, z
    return (-tx, -ty, -tz), 0.5 * k * (x * x + y * y + z * z), lost


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def twisting_torque(law, kind, energy_column, arm, inertia, dt, force, spin, history, slot, first):
    """Twisting resistance about the normal on grain i (`particles.laws.twisting_friction`).

    ``spin`` is its spin about n relative to the partner's. Returns the torque along n [N m], the stored energy [J] and
    the energy lost in this step [J].
    """
    k_t, last, damping = force.k_t, force.last_k_t, law.rows[kind, DAMPING_ROLLING]
    k = k_t * arm * arm
    rate = 2.0 * damping * sqrt(k * inertia) * (1.0 / dt)
    angle, step = history[slot, first], spin * dt
    lost = 0.0 * k
    if varies(law):
        factor, lost = rescale_spring(k_t, last, 0.5 * arm * arm * angle * angle)
        angle = angle * factor
    both = k + rate
    torque = k * angle + both * step
    factor, slip = coulomb_return_map(torque * torque, law.rows[kind, MU_TWISTING] * arm * force.repulsion, 1.0 / both)
    slip = slip * torque
    step = step - slip
    torque = torque * factor
    if energy_column is not None:
        before = history[slot, energy_column + LAST_TWISTING]
        lost = lost + 0.5 * ((before - k * angle + rate * step) * step + (before + torque) * slip)
        history[slot, energy_column + LAST_TWISTING] = torque
    angle = angle + step
    history[slot, first] = angle
    return -torque, 0.5 * k * angle * angle, lost


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def released_by_springs(law, kind, resistance, energy_column, arm, closing, history, slot):
    """Energy that the springs of a separated contact release [J], by the mechanism that it is lost to.

    ``closing`` is the distance by which its last drift closed it (negative: opened) [m]. Returns the losses to normal
    damping, sliding, rolling and twisting.
    """
    k_t = law.rows[kind, 1]
    if varies(law):
        k_t = history[slot, LAST_STIFFNESS]
    # the last normal force worked for half a drift more; the spring's part of it is in the change of stored energy
    lost_n = 0.5 * history[slot, energy_column] * closing
    if remembers(law):
        lost_n += history[slot, LAST_STORED]
    lost_s = 0.5 * k_t * (history[slot, 0] ** 2 + history[slot, 1] ** 2 + history[slot, 2] ** 2)
    lost_r = lost_w = 0.0
    k = k_t * arm * arm
    if resistance is not None:
        r = resistance.rolling
        if r >= 0:
            lost_r = 0.5 * k * (history[slot, r] ** 2 + history[slot, r + 1] ** 2 + history[slot, r + 2] ** 2)
        if resistance.twisting >= 0:
            lost_w = 0.5 * k * history[slot, resistance.twisting] ** 2
    return lost_n, lost_s, lost_r, lost_w
