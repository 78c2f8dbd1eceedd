"""Overlap removed from the positions alone: no velocity is touched, no kinetic energy made."""

from __future__ import annotations

import numpy as np
from numba import prange

from geometry.kernels.device_functions import device_function
from particles.dvi.triangle_contacts import overlapping
from particles.periodic_images import pair_place_to_image, pair_vector_from_image
from particles.walls.triangle_kernels import DISTANCE, TOWARDS_X, TOWARDS_Y, TOWARDS_Z
from particles.walls.wall_kernels import _wall_gap


@device_function(error_model="numpy", fastmath={"contract"})
def project(slop, cap, step, grains, pair_slots, slots, walls, chunk=None, serial=True):
    """Push overlapping grains apart, positions only, by inverse masses, until none overlaps by more than slop*radius.

    Nonlinear Gauss-Seidel on the gaps; with an infinite ``slop``, that of springs, they are only looked at. Returns the
    deepest overlap met at first (fraction of the smaller diameter), the grain, the work of the lagged forces on the
    displacements [J], and the sweeps.
    """
    deepest, at, work, sweeps = 0.0, -1, 0.0, 0
    for sweep in range(cap):
        if serial is not None:
            worst, depth, where, done = _project_rows(
                0, grains.radius.shape[0], sweep == 0, slop, step, grains, pair_slots, slots, walls
            )
        if chunk is not None:
            worst, depth, where, done = _project_chunks(sweep == 0, slop, step, grains, pair_slots, slots, walls, chunk)
        if sweep == 0:
            deepest, at = depth, where
        work += done
        if worst <= (slop if sweep == 0 else 0.1 * slop):
            break
        sweeps += 1
    return deepest, at, work, sweeps


@device_function(parallel=True, error_model="numpy", fastmath={"contract"})
def _project_chunks(first, slop, step, grains, pair_slots, slots, walls, chunk):
    """`_project_rows` by chunks."""
    rows, sums = chunk.rows, chunk.sums
    count = rows.shape[0] - 1
    for odd in range(2):
        for half in prange((count + 1 - odd) // 2):
            c = 2 * half + odd
            sums[c, 0], sums[c, 1], sums[c, 2], sums[c, 3] = _project_rows(
                rows[c], rows[c + 1], first, slop, step, grains, pair_slots, slots, walls
            )
    worst, deepest, at, work = 0.0, 0.0, -1, 0.0
    for c in range(count):
        worst = max(worst, sums[c, 0])
        if sums[c, 1] > deepest:
            deepest, at = sums[c, 1], int(sums[c, 2])
        work += sums[c, 3]
    return worst, deepest, at, work


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _project_rows(lo, hi, first, slop, step, grains, pair_slots, slots, walls):
    """One sweep over the rows lo <= i < hi; returns the largest overlap as a fraction of the radius and, the first
    time, of the diameter, whose it is, and the work."""
    position, radius, mass = grains.position, grains.radius, grains.mass
    pair_start, pair_other = pair_slots.start, pair_slots.other
    images, shift = pair_slots.images, pair_slots.shift
    wall_start, wall_other, contact = slots.start, slots.other, slots.triangle_contact
    wall, triangle, wall_body = walls.smooth, walls.triangle, walls.body
    worst, deepest, at, work = 0.0, 0.0, -1, 0.0
    for i in range(lo, hi):
        for k in range(pair_start[i], pair_start[i + 1]):
            j = pair_other[k]
            dx, dy, dz = pair_place_to_image(images, shift, k, position[j, 0], position[j, 1], position[j, 2])
            dx, dy, dz = position[i, 0] - dx, position[i, 1] - dy, position[i, 2] - dz
            reach = radius[i] + radius[j]
            d2 = dx * dx + dy * dy + dz * dz
            if d2 >= reach * reach:
                continue
            d = np.sqrt(d2)
            small = min(radius[i], radius[j])
            depth = (reach - d) / small
            if first and 0.5 * depth > deepest:
                deepest, at = 0.5 * depth, i
            worst = max(worst, depth)
            if first and worst <= slop:
                continue
            fraction = (reach - d) / (max(d, 1e-300) * (mass[i] + mass[j]))
            a, b = fraction * mass[j], fraction * mass[i]
            work += _shift(step, grains, i, a * dx, a * dy, a * dz)
            dx, dy = pair_vector_from_image(images, shift, k, dx, dy)
            work += _shift(step, grains, j, -b * dx, -b * dy, -b * dz)
        for k in range(wall_start[i], wall_start[i + 1]):
            if wall_other[k] >= wall.shape[0]:  # triangles
                break
            distance, nx, ny, nz, owned = _wall_gap(wall, wall_other[k], position[i, 0], position[i, 1], position[i, 2])
            depth = 1.0 - distance / radius[i]
            if depth <= 0.0 or not owned:
                continue
            if first and 0.5 * depth > deepest:
                deepest, at = 0.5 * depth, i
            worst = max(worst, depth)
            if first and worst <= slop:
                continue
            depth *= radius[i]
            work += _shift(step, grains, i, -depth * nx, -depth * ny, -depth * nz)
        if triangle.shape[0] > 0:
            k, end = wall_start[i], wall_start[i + 1]
            while k < end and wall_other[k] < wall.shape[0]:
                k += 1
            while k < end:
                begin, b = k, wall_body[wall_other[k]]
                while k < end and wall_body[wall_other[k]] == b:
                    k += 1
                x, y, z = position[i, 0], position[i, 1], position[i, 2]
                count = overlapping(walls, wall_other, begin, k, x, y, z, radius[i], contact[begin:k])
                for a in range(begin, begin + count):
                    nx, ny, nz = contact[a, TOWARDS_X], contact[a, TOWARDS_Y], contact[a, TOWARDS_Z]
                    # what earlier pushes have already moved it away from this wall
                    moved = -(nx * (position[i, 0] - x) + ny * (position[i, 1] - y) + nz * (position[i, 2] - z))
                    depth = 1.0 - (contact[a, DISTANCE] + moved) / radius[i]
                    if depth <= 0.0:
                        continue
                    if first and 0.5 * depth > deepest:
                        deepest, at = 0.5 * depth, i
                    worst = max(worst, depth)
                    if first and worst <= slop:
                        continue
                    depth *= radius[i]
                    work += _shift(step, grains, i, -depth * nx, -depth * ny, -depth * nz)
    return worst, deepest, at, work


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _shift(step, grains, i, x, y, z):
    """Move grain i; returns the work of gravity and the lagged force on it."""
    position, gravity, external = grains.position, grains.gravity, grains.external
    position[i, 0] += x
    position[i, 1] += y
    position[i, 2] += z
    work = 0.0
    if gravity.shape[0] > 0:
        g = min(step, gravity.shape[0] - 1)
        work += grains.mass[i] * (gravity[g, 0] * x + gravity[g, 1] * y + gravity[g, 2] * z)
    if external.shape[0] > 0:
        work += external[i, 0] * x + external[i, 1] * y + external[i, 2] * z
    return work
