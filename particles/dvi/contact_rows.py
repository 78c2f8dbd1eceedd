"""Rows of the contacts of a step by DVI: geometry, masses and law of a pair, a smooth wall, a triangle."""

from __future__ import annotations

from geometry.kernels.device_functions import device_function
from particles.dvi.compliance import apply_restitution, set_springs
from particles.dvi.gauss_seidel import ARM, EX, EY, EZ, IJ, IM, IWN, IWT, LX, LY, MU, B


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
def set_law(kind, h, slop, law, compliance, gap, before, row, offset):
    """Put friction, gap, springs and restitution into a row that has geometry, masses and last impulse.

    Parameters
    ----------
    kind : int
        PAIRS or WALLS (`particles.dvi.gauss_seidel`).
    h : float
        Step [s].
    slop : float
        Gap that counts as closed [m].
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
    if compliance is None:
        row[B] = gap / h if gap > slop else 0.0
    else:
        compliant = set_springs(h, compliance, kind, gap, row, offset)
    if law[kind, 1] > 0.0 and compliant >= 0.0:
        if before < -law[kind, 2] and gap + h * before < 0.0:
            row[B] = law[kind, 1] * before
            if compliance is not None:
                apply_restitution(law[kind, 1], before, compliant, row, offset)
