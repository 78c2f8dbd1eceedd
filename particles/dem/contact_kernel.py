"""Compiled force of one contact, whoever the partner is: a grain, a smooth wall, a triangle.

The normal spring and the dashpots come from the scene's law (`particles.laws`); its flag is the only one of
``linear``, ``hertz_mindlin``, ``hertz``, ``thesis``, ``walton_braun`` that is not None, and numba leaves the others out
of the compiled code. What all laws share stands here: the clip (an impact never pulls), cohesion, the tangential spring
with its slider, rolling and twisting, and where the energy goes.

**Tangential.** A spring xi and a dashpot in parallel, in series with a slider that yields at mu |F_rep|
(`particles.laws.linear`): the return mapping of an implicit step. The spring turns with its pair. Where the stiffness
follows the overlap, a contact that closes must not stretch the spring's force (that would create energy, Elata &
Berryman, Mech. Mater. 24 (1996) 229): xi shrinks by k_old/k_new then, and keeps its length when the contact opens.

**Energy, second order in dt.** Velocities belong to the drift between the last force and this one. So a mechanism loses
in a step the mean of its last and its present force times that drift (trapezoidal rule); the last forces are kept
beside the spring, in a step that keeps the books (``ledger``) only.

Columns of a contact's history: 0-2 spring xi [m]; with any law but the linear one 3 its memory, 4 its last k_t [N/m],
5 its last stored energy [J]; from ``columns[0]`` 3 rolling angles [rad]; from ``columns[1]`` the twisting angle [rad];
from ``columns[2]`` the last forces: normal dashpot, tangential force (3), rolling couple (3), twisting couple.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from geometry.inner_functions import inner
from particles.laws.columns import COHESION_0, COHESION_1, MU, MU_ROLLING, MU_TWISTING
from particles.laws.hertz import hertz_spring
from particles.laws.hertz_mindlin import hertz_mindlin_spring
from particles.laws.linear import linear_spring
from particles.laws.thesis import thesis_spring
from particles.laws.walton_braun import walton_braun_spring

MEMORY, LAST_STIFFNESS, LAST_STORED = 3, 4, 5
LAST_TANGENTIAL, LAST_ROLLING, LAST_TWISTING = 1, 4, 7  # after columns[2]


@njit(error_model="numpy", fastmath={"contract"}, forceinline=True)
def turned(pair, history, slot, first, nx, ny, nz, wx, wy, wz, phi):
    """The spring in columns ``first`` .. first + 2 of ``history[slot]``, turned with its pair at unchanged length.

    It lay in the tangent plane of the last step; it is laid into that of ``n`` and turned about n by the mean spin
    ``phi`` of this step. Between grains n has turned by the vector w = n - n_last (tangential part), known from the
    drift; then n_last -> n is the turn xi - (xi.n) n + (xi.n) w/2, with cos and sin of phi as series: no root, no
    division, lengths right to fourth order in a step's turn and never longer (1 - w^4/8, 1 - phi^6/72 up to 2.8 rad a
    step). At curved walls (``pair`` None), whose curvature is not known here, the length is restored by a root.
    """
    x, y, z = history[slot, first], history[slot, first + 1], history[slot, first + 2]
    along = x * nx + y * ny + z * nz
    if pair is not None:
        half = 0.5 * along
        x, y, z = x - along * nx + half * wx, y - along * ny + half * wy, z - along * nz + half * wz
    else:
        before = x * x + y * y + z * z
        x, y, z = x - along * nx, y - along * ny, z - along * nz
        if along * along > 1e-14 * before:  # never on a plane
            after = max(before - along * along, 0.0)
            scale = np.sqrt(before / after) if after > 0.0 else 0.0
            x, y, z = x * scale, y * scale, z * scale
    square = phi * phi
    cos = 1.0 - square * (0.5 - square * (1.0 / 24.0))
    sin = phi * (1.0 - square * (1.0 / 6.0))
    cx, cy, cz = ny * z - nz * y, nz * x - nx * z, nx * y - ny * x
    return cos * x + sin * cx, cos * y + sin * cy, cos * z + sin * cz


@njit(error_model="numpy", fastmath={"contract"}, forceinline=True)
def contact_force(
    linear, hertz_mindlin, hertz, thesis, walton_braun, law, kind, equal, cohesive, ledger, pair,
    m_eff, r_eff, dt, inv_dt, delta, nx, ny, nz, ux, uy, uz, wx, wy, wz, spin_n, history, slot, books,
):  # fmt: skip
    """Force on grain i; n points from i to its partner, u is the velocity of i relative to it at the contact.

    ``pair`` and w are those of `turned`.

    ``history[slot]`` is updated; ``books`` is the first column of the last forces. Returns the force (3), the
    repulsive part of the normal force (what friction scales with), its dashpot, the pull of cohesion, the tangential
    stiffness, the stored energy [J], the energy lost in this step [J] to normal damping, tangential damping and
    sliding (these four are 0 without a ledger), and the tangential stiffness of the last step.
    """
    closing = ux * nx + uy * ny + uz * nz
    if linear is not None:
        if equal is not None:  # grains of one size and mass: the dashpots are constants
            f_el, k_t, gamma_n, gamma_t = law[kind, 0] * delta, law[kind, 1], equal[kind, 0], equal[kind, 1]
            stored = 0.5 * f_el * delta
        else:
            f_el, k_t, gamma_n, gamma_t, stored, _ = linear_spring(law, kind, delta, m_eff, r_eff, 0.0)
    elif hertz_mindlin is not None:
        f_el, k_t, gamma_n, gamma_t, stored, _ = hertz_mindlin_spring(law, kind, delta, m_eff, r_eff, 0.0)
    elif hertz is not None:
        f_el, k_t, gamma_n, gamma_t, stored, _ = hertz_spring(law, kind, delta, m_eff, r_eff, 0.0)
    elif thesis is not None:
        f_el, k_t, gamma_n, gamma_t, stored, _ = thesis_spring(law, kind, delta, m_eff, r_eff, 0.0)
    else:
        f_el, k_t, gamma_n, gamma_t, stored, memory = walton_braun_spring(
            law, kind, delta, m_eff, r_eff, history[slot, MEMORY]
        )
        history[slot, MEMORY] = memory
    f_rep = max(f_el + gamma_n * closing, 0.0)  # an impact never pulls
    f_n = f_rep
    pull = 0.0
    if cohesive:
        pull = law[kind, COHESION_0] + law[kind, COHESION_1] * r_eff
        f_n -= pull

    xi_x, xi_y, xi_z = turned(pair, history, slot, 0, nx, ny, nz, wx, wy, wz, spin_n * dt)
    lost_n = lost_t = lost_s = 0.0
    last = k_t
    if linear is None:
        last = history[slot, LAST_STIFFNESS]
        held = 0.5 * (xi_x * xi_x + xi_y * xi_y + xi_z * xi_z)
        lost_s = (last - k_t) * held
        if k_t > last:
            share = last / k_t
            xi_x, xi_y, xi_z = xi_x * share, xi_y * share, xi_z * share
            lost_s = last * (1.0 - share) * held
        history[slot, LAST_STIFFNESS] = k_t

    # trial: the whole sliding distance stretches spring and dashpot
    sx, sy, sz = (ux - closing * nx) * dt, (uy - closing * ny) * dt, (uz - closing * nz) * dt
    rate = gamma_t * inv_dt
    both = k_t + rate
    tx, ty, tz = k_t * xi_x + both * sx, k_t * xi_y + both * sy, k_t * xi_z + both * sz
    trial2 = tx * tx + ty * ty + tz * tz
    limit = law[kind, MU] * f_rep
    slip_x = slip_y = slip_z = 0.0
    if trial2 > limit * limit:
        trial = np.sqrt(trial2)
        share = limit / trial
        slip = (1.0 - share) / both  # trial > 0 needs k_t + rate > 0
        slip_x, slip_y, slip_z = slip * tx, slip * ty, slip * tz
        sx, sy, sz = sx - slip_x, sy - slip_y, sz - slip_z
        tx, ty, tz = tx * share, ty * share, tz * share
    if ledger is not None:
        # last forces; that of the tangential dashpot is the last force less its spring's
        if walton_braun is not None:  # no dashpot: what the spring has taken and does not hold
            lost_n = 0.5 * (history[slot, books] + f_rep) * closing * dt - (stored - history[slot, LAST_STORED])
            history[slot, LAST_STORED] = stored
            history[slot, books] = f_rep
        else:
            lost_n = 0.5 * (history[slot, books] + f_rep - f_el) * closing * dt
            history[slot, books] = f_rep - f_el
        q = books + LAST_TANGENTIAL
        px, py, pz = turned(pair, history, slot, q, nx, ny, nz, wx, wy, wz, spin_n * dt)
        lost_t = 0.5 * (
            (px - k_t * xi_x + rate * sx) * sx + (py - k_t * xi_y + rate * sy) * sy + (pz - k_t * xi_z + rate * sz) * sz
        )
        lost_s += 0.5 * ((px + tx) * slip_x + (py + ty) * slip_y + (pz + tz) * slip_z)
        history[slot, q], history[slot, q + 1], history[slot, q + 2] = tx, ty, tz
    xi_x, xi_y, xi_z = xi_x + sx, xi_y + sy, xi_z + sz
    history[slot, 0], history[slot, 1], history[slot, 2] = xi_x, xi_y, xi_z
    if ledger is not None:
        stored += 0.5 * k_t * (xi_x * xi_x + xi_y * xi_y + xi_z * xi_z) - pull * delta
    return (
        -f_n * nx - tx, -f_n * ny - ty, -f_n * nz - tz, f_rep, f_rep - f_el, pull, k_t, stored,
        lost_n, lost_t, lost_s, last,
    )  # fmt: skip


@inner(error_model="numpy", fastmath={"contract"})
def rolling_couple(
    law, kind, ledger, pair, arm, inertia, k_t, last, damping, dt, f_rep, nx, ny, nz, px, py, pz, wx, wy, wz, spin_n,
    history, slot, first, books,
):  # fmt: skip
    """Rolling resistance on grain i (`particles.laws.rolling_friction`); p is its spin relative to the partner's.

    ``damping`` is a share of critical damping; ``history[slot, first:]`` the rolling angle [rad], updated. Returns the
    couple (3) [N m], the stored energy [J] and the energy lost in this step [J].
    """
    k = k_t * arm * arm
    rate = 2.0 * damping * np.sqrt(k * inertia) / dt
    x, y, z = turned(pair, history, slot, first, nx, ny, nz, wx, wy, wz, spin_n * dt)
    # a spring that stiffens while the contact closes keeps its couple, one that softens its angle (module docstring)
    held = 0.5 * arm * arm * (x * x + y * y + z * z)
    lost = (last - k_t) * held
    if k_t > last:
        share = last / k_t
        x, y, z = x * share, y * share, z * share
        lost = last * (1.0 - share) * held
    along = px * nx + py * ny + pz * nz
    sx, sy, sz = (px - along * nx) * dt, (py - along * ny) * dt, (pz - along * nz) * dt
    both = k + rate
    tx, ty, tz = k * x + both * sx, k * y + both * sy, k * z + both * sz
    trial = np.sqrt(tx * tx + ty * ty + tz * tz)
    limit = law[kind, MU_ROLLING] * arm * f_rep
    slip_x = slip_y = slip_z = 0.0
    if trial > limit:
        share = limit / trial
        slip = (1.0 - share) / both
        slip_x, slip_y, slip_z = slip * tx, slip * ty, slip * tz
        sx, sy, sz = sx - slip_x, sy - slip_y, sz - slip_z
        tx, ty, tz = tx * share, ty * share, tz * share
    if ledger is not None:
        q = books + LAST_ROLLING
        lx, ly, lz = turned(pair, history, slot, q, nx, ny, nz, wx, wy, wz, spin_n * dt)
        lost += 0.5 * (
            (lx - k * x + rate * sx) * sx + (ly - k * y + rate * sy) * sy + (lz - k * z + rate * sz) * sz
            + (lx + tx) * slip_x + (ly + ty) * slip_y + (lz + tz) * slip_z
        )  # fmt: skip
        history[slot, q], history[slot, q + 1], history[slot, q + 2] = tx, ty, tz
    x, y, z = x + sx, y + sy, z + sz
    history[slot, first], history[slot, first + 1], history[slot, first + 2] = x, y, z
    return -tx, -ty, -tz, 0.5 * k * (x * x + y * y + z * z), lost


@inner(error_model="numpy", fastmath={"contract"})
def twisting_couple(
    law, kind, ledger, arm, inertia, k_t, last, damping, dt, f_rep, spin, history, slot, first, books
):  # fmt: skip
    """Twisting resistance about the normal on grain i (`particles.laws.twisting_friction`).

    ``spin`` is its spin about n relative to the partner's. Returns the couple along n [N m], the stored energy [J] and
    the energy lost in this step [J].
    """
    k = k_t * arm * arm
    rate = 2.0 * damping * np.sqrt(k * inertia) / dt
    angle, step = history[slot, first], spin * dt
    held = 0.5 * arm * arm * angle * angle
    lost = (last - k_t) * held
    if k_t > last:
        share = last / k_t
        angle *= share
        lost = last * (1.0 - share) * held
    couple = k * angle + (k + rate) * step
    limit = law[kind, MU_TWISTING] * arm * f_rep
    slip = 0.0
    if abs(couple) > limit:
        capped = limit if couple > 0.0 else -limit
        slip = (couple - capped) / (k + rate)
        couple = capped
        step -= slip
    if ledger is not None:
        before = history[slot, books + LAST_TWISTING]
        lost += 0.5 * ((before - k * angle + rate * step) * step + (before + couple) * slip)
        history[slot, books + LAST_TWISTING] = couple
    angle += step
    history[slot, first] = angle
    return -couple, 0.5 * k * angle * angle, lost


@inner(error_model="numpy", fastmath={"contract"})
def left_in_springs(linear, walton_braun, resisting, law, kind, arm, closed, history, slot, columns):
    """What a contact that has just parted still held, by the mechanism that it is lost to [J].

    ``closed`` is the distance by which its last drift closed it (negative: opened) [m]. Returns the losses to normal
    damping, sliding, rolling and twisting.
    """
    k_t = law[kind, 1]
    if linear is None:
        k_t = history[slot, LAST_STIFFNESS]
    books = columns[2]
    # the last normal force worked for half a drift more; the spring's part of it is in the change of stored energy
    lost_n = 0.5 * history[slot, books] * closed
    if walton_braun is not None:
        lost_n += history[slot, LAST_STORED]
    lost_s = 0.5 * k_t * (history[slot, 0] ** 2 + history[slot, 1] ** 2 + history[slot, 2] ** 2)
    lost_r = lost_w = 0.0
    k = k_t * arm * arm
    if resisting is not None:
        if columns[0] >= 0:
            r = columns[0]
            lost_r = 0.5 * k * (history[slot, r] ** 2 + history[slot, r + 1] ** 2 + history[slot, r + 2] ** 2)
        if columns[1] >= 0:
            lost_w = 0.5 * k * history[slot, columns[1]] ** 2
    return lost_n, lost_s, lost_r, lost_w
