"""Pull of near grains in a step of rigid grains: lagged drives, its mean over the way that the gap goes in the step.

The pull is that of `particles.attraction`. A neck's falls within a few hundredths of a radius, which grains cross in a
step or two. So what a step of h adds to the velocities is not the pull of its beginning, but its mean over the gaps
from g to g + h u_n/a, u_n the present opening speed and W' = F over a gap in radii:

    F = (W(g + h u_n/a) - W(g))/(h u_n/a),

in closed form, since F is linear in ln g between the nodes of the table. A way that would end in the contact ends at
-smallest_gap, and of a short one the pull in its middle is the mean (tests/dvi/test_near_pulls.py).
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import prange

from geometry.kernels.device_functions import device_function
from particles.attraction import Attraction
from particles.dem.attraction_kernel import ACROSS, AMPLITUDE, COLUMN
from particles.dvi.flow_in_box import add_pulls
from particles.periodic_images import pair_place_to_image, pair_vector_from_image, pair_velocity_to_image
from particles.walls.wall_kernels import _wall_gap

SHORT = 0.02  # of the gap: ways below it have the pull at their middle, the mean to 1e-4


class NearPulls(NamedTuple):
    """Table, drives, and what they add to.

    Attributes
    ----------
    gap_start, gap_step : float
        Natural logarithm of the first gap [radii], and step of the grid.
    smallest_gap, last_gap : float
        Where pulls are constant below, and 0 above [radii].
    gap, across, across_work : ndarray, shape (ng,)
        Gaps of the nodes [radii], pull across, its integral over the gap from the first one.
    values, work : ndarray, shape (ng, nh)
        Pull along, its integral.
    pair, wall : ndarray, shapes (p, 3), (s, 2)
        Drives of the slots: column, amplitude [N], amplitude across [N].
    lagged : ndarray, shape (n, 3) or (0, 3)
        The forces that do not follow the gaps [N]; no rows: nothing attracts, and nothing is done.
    pull : ndarray, shape (p, 3)
        Scratch: on the first grain of each slot [N].
    """

    gap_start: float
    gap_step: float
    smallest_gap: float
    last_gap: float
    gap: np.ndarray
    across: np.ndarray
    across_work: np.ndarray
    values: np.ndarray
    work: np.ndarray
    pair: np.ndarray
    wall: np.ndarray
    lagged: np.ndarray
    pull: np.ndarray


def near_pulls(attraction: Attraction | None, lagged: np.ndarray) -> NearPulls:
    """The argument of a step: present drives and ``lagged`` forces (n, 3) [N]; without rows if nothing attracts."""
    if attraction is None or attraction.pair_drive is None or attraction.wall_drive is None:
        row, table = np.zeros(0), np.zeros((0, 0))
        none, walls = np.zeros((0, 3)), np.zeros((0, 2))
        return NearPulls(0.0, 1.0, 1.0, 0.0, row, row, row, table, table, none, walls, none, none)
    gap = np.exp(attraction.gap_start + attraction.gap_step * np.arange(len(attraction.across)))
    smallest = max(attraction.smallest_gap, float(gap[0]))
    across_work, work = (_work(attraction.gap_step, gap, of) for of in (attraction.across[:, None], attraction.values))
    return NearPulls(
        float(attraction.gap_start), float(attraction.gap_step), smallest, attraction.last_gap, gap, attraction.across,
        across_work[:, 0].copy(), attraction.values, work, attraction.pair_drive, attraction.wall_drive, lagged,
        np.zeros((len(attraction.pair_drive), 3)),
    )  # fmt: skip


def _work(step: float, gap: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """Integral over the gap (ng,) of pulls (ng, k) that are linear in its logarithm between the nodes."""
    rise, factor = np.diff(pull, axis=0) / step, np.exp(step)
    each = gap[:-1, None] * (pull[:-1] * (factor - 1.0) + rise * (factor * (step - 1.0) + 1.0))
    return np.concatenate([np.zeros((1, pull.shape[1])), np.cumsum(each, axis=0)])


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _at(near, gap, column, amplitude, across, with_work):
    """Pull [N] at a gap [radii], and its integral from the first one [N] where it is asked for."""
    values, work, last = near.values, near.work, near.gap.shape[0] - 1
    clipped = max(gap, near.smallest_gap)
    x = (np.log(clipped) - near.gap_start) / near.gap_step
    x = x if x > 0.0 else 0.0
    column = column if column > 0.0 else 0.0
    j = min(np.int64(column), values.shape[1] - 2)
    y = column - j
    if not x < last:  # also of NaN, which is no index
        whole = work[last, j] + y * (work[last, j + 1] - work[last, j])
        return 0.0, amplitude * whole + across * near.across_work[last]
    i = np.int64(x)
    low = amplitude * (values[i, j] + y * (values[i, j + 1] - values[i, j])) + across * near.across[i]
    high = amplitude * (values[i + 1, j] + y * (values[i + 1, j + 1] - values[i + 1, j])) + across * near.across[i + 1]
    pull = low + (x - i) * (high - low)
    if not with_work:
        return pull, 0.0
    t, rise = (x - i) * near.gap_step, (high - low) / near.gap_step
    factor = clipped / near.gap[i]
    whole = amplitude * (work[i, j] + y * (work[i, j + 1] - work[i, j])) + across * near.across_work[i]
    whole += near.gap[i] * (low * (factor - 1.0) + rise * (factor * (t - 1.0) + 1.0))
    return pull, whole + pull * (max(gap, -near.smallest_gap) - clipped)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def mean_near_pull(near, gap, way, column, amplitude, across):
    """Mean of the pull [N] over gaps from ``gap`` on, by ``way`` [radii]; 0 where it begins beyond the table."""
    if not gap < near.last_gap:
        return 0.0
    least = near.smallest_gap
    begin, end = max(gap, -least), max(gap + way, -least)
    way = end - begin
    if abs(way) <= SHORT * max(min(begin, end), least):
        pull, _ = _at(near, begin + 0.5 * way, column, amplitude, across, False)
        return pull
    pull, before = _at(near, begin, column, amplitude, across, True)
    _, after = _at(near, end, column, amplitude, across, True)
    return (after - before) / way


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _pull_rows(lo, hi, h, near, grains, pairs, pull):
    """Fill the pulls of the pairs of the rows lo <= i < hi."""
    position, velocity, radius, drive = grains.position, grains.velocity, grains.radius, near.pair
    images, shift = pairs.images, pairs.shift
    for i in range(lo, hi):
        for k in range(pairs.start[i], pairs.start[i + 1]):
            pull[k, 0] = pull[k, 1] = pull[k, 2] = 0.0
            if drive[k, AMPLITUDE] == 0.0 and drive[k, ACROSS] == 0.0:
                continue
            j = pairs.other[k]
            x, y, z = pair_place_to_image(images, shift, k, position[j, 0], position[j, 1], position[j, 2])
            x, y, z = position[i, 0] - x, position[i, 1] - y, position[i, 2] - z
            d, both = np.sqrt(x * x + y * y + z * z), radius[i] + radius[j]
            per_a = 0.5 * both / (radius[i] * radius[j])
            gap = (d - both) * per_a
            if not (gap < near.last_gap and d > 0.0):
                continue
            x, y, z = x / d, y / d, z / d
            ux, uy = pair_velocity_to_image(images, shift, k, velocity[j, 0], velocity[j, 1])
            opening = (velocity[i, 0] - ux) * x + (velocity[i, 1] - uy) * y + (velocity[i, 2] - velocity[j, 2]) * z
            way = h * opening * per_a
            force = -mean_near_pull(near, gap, way, drive[k, COLUMN], drive[k, AMPLITUDE], drive[k, ACROSS])
            pull[k, 0], pull[k, 1], pull[k, 2] = force * x, force * y, force * z


@device_function(parallel=True, error_model="numpy", fastmath={"contract"})
def _pull_chunks(h, near, grains, pairs, pull, chunk):
    """`_pull_rows` by chunks."""
    rows = chunk.rows
    for c in prange(rows.shape[0] - 1):
        _pull_rows(rows[c], rows[c + 1], h, near, grains, pairs, pull)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _pull_to_walls(h, near, grains, slots, walls, force):
    """Add the pulls of walls."""
    position, velocity, radius, drive = grains.position, grains.velocity, grains.radius, near.wall
    for i in range(radius.shape[0]):
        for k in range(slots.start[i], slots.start[i + 1]):
            if slots.other[k] >= walls.smooth.shape[0]:  # triangles
                break
            if drive[k, AMPLITUDE] == 0.0:
                continue
            distance, nx, ny, nz, owned = _wall_gap(
                walls.smooth, slots.other[k], position[i, 0], position[i, 1], position[i, 2]
            )
            if not owned:
                continue
            per_a = 2.0 / radius[i]
            way = -h * per_a * (velocity[i, 0] * nx + velocity[i, 1] * ny + velocity[i, 2] * nz)
            gap = (distance - radius[i]) * per_a
            pull = mean_near_pull(near, gap, way, drive[k, COLUMN], drive[k, AMPLITUDE], 0.0)
            force[i, 0] += pull * nx
            force[i, 1] += pull * ny
            force[i, 2] += pull * nz


@device_function(error_model="numpy", fastmath={"contract"})
def set_lagged_forces(h, near, grains, pairs, slots, walls, chunk, serial, box):
    """Set the lagged forces of a step of h [s] to those of ``near``, and its pulls; their stress of a sheared box."""
    force, pull = grains.external, near.pull
    if serial is not None:
        _pull_rows(np.int64(0), grains.radius.shape[0], h, near, grains, pairs, pull)
    if chunk is not None:
        _pull_chunks(h, near, grains, pairs, pull, chunk)
    force[:] = near.lagged
    images, shift = pairs.images, pairs.shift
    for i in range(force.shape[0]):
        for k in range(pairs.start[i], pairs.start[i + 1]):
            x, y, z = pull[k, 0], pull[k, 1], pull[k, 2]
            j = pairs.other[k]
            force[i, 0] += x
            force[i, 1] += y
            force[i, 2] += z
            x, y = pair_vector_from_image(images, shift, k, x, y)
            force[j, 0] -= x
            force[j, 1] -= y
            force[j, 2] -= z
    _pull_to_walls(h, near, grains, slots, walls, force)
    if box.shape[0] > 0:
        add_pulls(h, grains, pairs, pull, box)
