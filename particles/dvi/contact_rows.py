"""Rows of the contacts of a step by DVI: geometry, masses and law of a pair, a smooth wall, a triangle.

**Restitution** is Newton's law in Moreau's form (Moreau, in: Nonsmooth Mechanics and Applications, Springer 1988): with
the normal velocities u_n before and u_n' after the step

    u_n' + e u_n >= 0,    r_n >= 0,    r_n (u_n' + e u_n) = 0

where e acts: at contacts that meet faster than the threshold, and at those that part, whatever their speed. The latter
hold their partners only from an approach of e u_n on: a grain that is struck while it leaves another one is not held
there by a force that would make energy. With the largest e of the scene at parting contacts the energy changes by
sum r_n (u_n + u_n')/2 <= 0, for different e at walls and between grains too (r.W r = sum r_n (u_n' - u_n) >= 0, and
(1 - e)/(1 + e) falls with e). The approach, at most h e u_n and `MAX_APPROACH` radii of overlap, is removed in the next
step as any overlap; where `MAX_APPROACH` limits it, impacts of several contacts may make energy again.

**Friction** may make energy at such impacts (Kane & Levinson, Dynamics, McGraw-Hill 1985): e r_n |u_n| at most, summed
over the contacts that rebound. 90 000 random impacts of spinning spheres in corners of 30 to 150 degrees made up to
18 % of the grain's energy at e = 1, 7 % at 0.95, none at 0.9 or less. Springs with a step beyond 0.45 contact times
(`particles.dvi.compliance`) made up to 2 % at e = 1, none at 0.9; in a driven bed at e = 0.4 and three times the
default step, where an overlap that a parting contact was allowed pushes back, 0.05 %.
"""

from __future__ import annotations

from geometry.kernels.device_functions import device_function
from particles.dvi.compliance import HARD, apply_restitution, hard_restitution, set_springs
from particles.dvi.gauss_seidel import ARM, EX, EY, EZ, IJ, IM, IWN, IWT, LX, LY, MU, PAIRS, WALLS, B

MAX_APPROACH = 0.1  # overlap [radii] that a parting contact may make in a step in which another strikes its grain


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def set_wall_geometry(normal, arm, point, grain_row, body_row, row):
    """Put normal, lever arms and masses of a grain at a wall into the contact's row; returns the body's lever on it.

    ``normal`` points towards the wall; ``arm`` is the distance from it over the radius; ``point`` (x, y) [m] is where
    they touch.
    """
    nx, ny, nz = normal
    row[EX], row[EY], row[EZ], row[ARM] = -nx, -ny, -nz, arm
    row[LX], row[LY] = -point[1], point[0]
    along = row[LX] * row[EX] + row[LY] * row[EY]
    row[IWN] = 1.0 / (grain_row[IM] + body_row[IJ] * along * along)
    row[IWT] = 1.0 / (grain_row[IM] * (1.0 + 2.5 * row[ARM] * row[ARM]))
    return along


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def set_law(kind, h, radius, slop, law, compliance, gap, before, row, offset):
    """Put friction, gap, springs and restitution into a row that has geometry, masses and last impulse.

    Parameters
    ----------
    kind : int
        PAIRS or WALLS (`particles.dvi.gauss_seidel`).
    h : float
        Step [s].
    radius, slop : float
        Of the smaller grain [m]; the gap that counts as closed, in radii.
    law : ndarray, shape (2, 3)
        `particles.dvi.dvi_contact`.
    compliance : ndarray, or None
        Table of springs; None: rigid.
    gap, before : float
        Gap [m], and its rate at the velocities of the last step [m/s].
    offset : int
        Column of the tangential spring.
    """
    row[MU] = law[kind, 0]
    compliant = 0.0  # c_n/w_n, -1 where the springs have the restitution
    touches = gap <= slop * radius  # what counts as closed rebounds as what closes
    if compliance is None:
        row[B] = 0.0 if touches else gap / h
    else:
        compliant = set_springs(h, compliance, kind, gap, row, offset)
        touches = gap == 0.0  # an overlap has its spring
    most = max(law[PAIRS, 1], law[WALLS, 1])
    if most > 0.0 and compliant >= 0.0:
        if before > 0.0 and (touches or gap > 0.0):
            if compliance is not None:
                most = hard_restitution(most, HARD)
            row[B] = max(row[B], min(most * before, (gap + MAX_APPROACH * radius) / h))
        elif before < -law[kind, 2] and law[kind, 1] > 0.0 and (touches or gap + h * before < 0.0):
            row[B] = law[kind, 1] * before
            if compliance is not None:
                apply_restitution(law[kind, 1], before, compliant, row, offset)
