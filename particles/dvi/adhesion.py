"""Adhesion of rigid grains: contacts that are closed pull with the force of `particles.laws.cohesion`.

With the pull-off force F_c > 0 (constant, DMT, or that of JKR alone) and p the impulse on the first grain in a step h,
normal part positive where it presses, a contact that is closed in the middle of the step obeys

    0 <= u_n  _|_  p_n + h F_c >= 0,     |p_t| <= mu (p_n + h F_c).

For r_n = p_n + h F_c, the repulsion, these are the laws of a contact that does not adhere; the rest of p, -h F_c along
the normal, is known before the sweeps, and is added to the free velocities. So sweeps and residual know nothing of it,
friction, rolling and twisting scale with the repulsion as they do by DEM, and a contact parts where it is pulled with
more than F_c, at any step. Closed is a gap of no more than the slop (`particles.dvi.step_kernel`) between rigid grains,
and of no more than 0 on springs; in the step in which grains meet nothing pulls yet.

On springs the overlap delta that F_c holds stores -F_c delta. Without, a pull does no work while its contact holds;
what it does until the gap is more than the slop is lost, and counts as impact.

**Step.** The force that parts a contact at rest is F_c at every step. Grains that a blow parts with the speed v are
held back for a step at least, by the impulse h F_c; on springs by DEM it is less than F_c sqrt(m/k). So a long step
sticks more (A. Abramian, L. Staron, P.-Y. Lagree, J. Rheol. 64 (2020) 1227), unless h F_c/m is small against v.
"""

from __future__ import annotations

from geometry.kernels.device_functions import device_function
from particles.dvi.gauss_seidel import (
    ARM,
    EX,
    EY,
    EZ,
    IJ,
    IM,
    LX,
    LY,
    PAIRS,
    SPEED,
    VX,
    VY,
    VZ,
    WALLS,
)
from particles.periodic_images import pair_vector_from_image

FORCE, PER_RADIUS = 3, 4  # columns of the law: F_c = force [N] + per_radius [N/m] times the effective radius


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def pull_together(call, compliance, radius, pairs, slots, records):
    """Find the pulls of a step, keep them in the slots of their contacts, and let them act on the velocities."""
    h, law, first, slop = call.h, call.law, call.pull, 0.0
    if compliance is None:
        slop = call.slop
    grain, body, pair_index, pair, wall_index, wall = records[:6]
    impulse, slot = pairs.impulse, pairs.contact_slot
    impulse[:, first:] = 0.0
    for k in range(pair.shape[0]):
        i, j, s = pair_index[k, 0], pair_index[k, 1], slot[k]
        ri, rj = radius[i], radius[j]
        if (pair[k, ARM] - 1.0) * (ri + rj) > slop * min(ri, rj):
            continue
        pull = -h * (law[PAIRS, FORCE] + law[PAIRS, PER_RADIUS] * ri * rj / (ri + rj))
        x, y, z = pull * pair[k, EX], pull * pair[k, EY], pull * pair[k, EZ]
        impulse[s, first], impulse[s, first + 1], impulse[s, first + 2] = x, y, z
        a, b = grain[i, IM], grain[j, IM]
        grain[i, VX] += a * x
        grain[i, VY] += a * y
        grain[i, VZ] += a * z
        x, y = pair_vector_from_image(records.images, records.pair_shift, k, x, y)
        grain[j, VX] -= b * x
        grain[j, VY] -= b * y
        grain[j, VZ] -= b * z
    impulse, slot = slots.impulse, slots.contact_slot
    impulse[:, first:] = 0.0
    for k in range(wall.shape[0]):
        i, b, s = wall_index[k, 0], wall_index[k, 1], slot[k]
        if wall[k, ARM] - 1.0 > slop:
            continue
        pull = -h * (law[WALLS, FORCE] + law[WALLS, PER_RADIUS] * radius[i])
        x, y, z = pull * wall[k, EX], pull * wall[k, EY], pull * wall[k, EZ]
        impulse[s, first], impulse[s, first + 1], impulse[s, first + 2] = x, y, z
        a = grain[i, IM]
        grain[i, VX] += a * x
        grain[i, VY] += a * y
        grain[i, VZ] += a * z
        body[b, SPEED] -= body[b, IJ] * (wall[k, LX] * x + wall[k, LY] * y)
