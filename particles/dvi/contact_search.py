"""Free velocities of rigid grains, and the contacts that may close within a step, with their records."""

from __future__ import annotations

import numpy as np
from numba import prange

from geometry.kernels.device_functions import device_function
from particles.dvi.contact_rows import set_law, set_wall_geometry
from particles.dvi.gauss_seidel import (
    ARM,
    EX,
    EY,
    EZ,
    IM,
    IWN,
    IWT,
    N_PAIR,
    N_WALL_CONTACT,
    PAIRS,
    PX,
    PY,
    PZ,
    RX,
    RY,
    RZ,
    VX,
    VY,
    VZ,
    WALLS,
)
from particles.dvi.triangle_contacts import find_triangle_contacts, search
from particles.periodic_images import pair_place_to_image, pair_velocity_to_image
from particles.walls.wall_kernels import _wall_gap


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def free_velocities(h, step, grains, grain):
    """Fill the records of the grains with v + h F/m; their bounds: the larger speed of before and after."""
    gravity, external, velocity, spin = grains.gravity, grains.external, grains.velocity, grains.spin
    radius, mass, bound = grains.radius, grains.mass, grains.bound
    g = min(step, gravity.shape[0] - 1)
    fastest = 0.0
    for i in range(mass.shape[0]):
        x, y, z = velocity[i, 0], velocity[i, 1], velocity[i, 2]
        before = x * x + y * y + z * z
        if gravity.shape[0] > 0:
            x, y, z = x + h * gravity[g, 0], y + h * gravity[g, 1], z + h * gravity[g, 2]
        if external.shape[0] > 0:
            a = h / mass[i]
            x, y, z = x + a * external[i, 0], y + a * external[i, 1], z + a * external[i, 2]
        grain[i, VX], grain[i, VY], grain[i, VZ] = x, y, z
        grain[i, IM] = 1.0 / mass[i]
        r = radius[i]
        grain[i, PX], grain[i, PY], grain[i, PZ] = r * spin[i, 0], r * spin[i, 1], r * spin[i, 2]
        bound[i] = np.sqrt(max(before, x * x + y * y + z * z))
        fastest = max(fastest, bound[i])
    return fastest


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def find_contacts(rows, numbers, near, horizon, compliance, grains, pair_slots, slots, walls, old_speed, records):
    """Fill the records of contacts, from the ``numbers`` of a pair and a wall on, of the rows[0] <= i < rows[1].

    These are the slots whose gap may close within the step; ``near`` says of which pairs it is already known. Returns
    the numbers behind the last ones.
    """
    h, margin, slop, law = horizon
    position, velocity, radius, bound = grains.position, grains.velocity, grains.radius, grains.bound
    pair_start, pair_other = pair_slots.start, pair_slots.other
    pair_impulse, pair_slot = pair_slots.impulse, pair_slots.contact_slot
    images, shift = pair_slots.images, pair_slots.shift
    wall_start, wall_other, wall_impulse, wall_slot = slots.start, slots.other, slots.impulse, slots.contact_slot
    grain, body, pair_index, pair, wall_index, wall_row = records[:6]
    wall, wall_body = walls.smooth, walls.body
    pairs, at_walls = numbers
    for i in range(rows[0], rows[1]):
        x, y, z, ri = position[i, 0], position[i, 1], position[i, 2], radius[i]
        for k in range(pair_start[i], pair_start[i + 1]):
            j = pair_other[k]
            dx, dy, dz = pair_place_to_image(images, shift, k, position[j, 0], position[j, 1], position[j, 2])
            dx, dy, dz = x - dx, y - dy, z - dz
            reach = ri + radius[j]
            d2 = dx * dx + dy * dy + dz * dz
            far = reach + h * (bound[i] + bound[j]) + margin + slop * ri  # a touch at rest is a contact
            apart = d2 >= far * far
            if near is not None:
                apart = near[k] == 0
            if apart:
                pair_impulse[k, 0] = pair_impulse[k, 1] = pair_impulse[k, 2] = 0.0
                continue
            d = np.sqrt(d2)
            inverse = 1.0 / d if d > 0.0 else 0.0
            ex, ey, ez = dx * inverse, dy * inverse, dz * inverse
            row = pair[pairs]
            row[EX], row[EY], row[EZ], row[ARM] = ex, ey, ez, d / reach
            row[RX], row[RY], row[RZ] = pair_impulse[k, 0], pair_impulse[k, 1], pair_impulse[k, 2]
            w_n = grain[i, IM] + grain[j, IM]
            row[IWN] = 1.0 / w_n
            row[IWT] = 1.0 / (w_n * (1.0 + 2.5 * row[ARM] * row[ARM]))
            ux, uy = pair_velocity_to_image(images, shift, k, velocity[j, 0], velocity[j, 1])
            ux, uy, uz = velocity[i, 0] - ux, velocity[i, 1] - uy, velocity[i, 2] - velocity[j, 2]
            before = ux * ex + uy * ey + uz * ez
            set_law(PAIRS, h, min(ri, radius[j]), slop, law, compliance, d - reach, before, row, N_PAIR)
            pair_index[pairs, 0], pair_index[pairs, 1], pair_slot[pairs] = i, j, k
            if images.shape[0] > 1:
                records.pair_shift[pairs] = shift[k]
            pairs += 1
        for k in range(wall_start[i], wall_start[i + 1]):
            if wall_other[k] >= wall.shape[0]:  # triangles
                break
            distance, nx, ny, nz, owned = _wall_gap(wall, wall_other[k], x, y, z)
            b = wall_body[wall_other[k]]
            if not owned or distance >= ri + h * 2.0 * bound[i] + margin + slop * ri:
                wall_impulse[k, 0] = wall_impulse[k, 1] = wall_impulse[k, 2] = 0.0
                continue
            row = wall_row[at_walls]
            point = x + distance * nx, y + distance * ny
            along = set_wall_geometry((nx, ny, nz), distance / ri, point, grain[i], body[b], row)
            row[RX], row[RY], row[RZ] = wall_impulse[k, 0], wall_impulse[k, 1], wall_impulse[k, 2]
            before = -(velocity[i, 0] * nx + velocity[i, 1] * ny + velocity[i, 2] * nz) - old_speed[b] * along
            set_law(WALLS, h, ri, slop, law, compliance, distance - ri, before, row, N_WALL_CONTACT)
            wall_index[at_walls, 0], wall_index[at_walls, 1], wall_slot[at_walls] = i, b, k
            at_walls += 1
    return pairs, at_walls


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def _near(lo, hi, horizon, grains, pair_slots, near):
    """Mark the pairs of rows lo <= i < hi whose gap may close within the step; returns how many."""
    h, margin, slop, _ = horizon
    position, radius, bound = grains.position, grains.radius, grains.bound
    pair_start, pair_other = pair_slots.start, pair_slots.other
    images, shift = pair_slots.images, pair_slots.shift
    count = 0
    for i in range(lo, hi):
        x, y, z, ri = position[i, 0], position[i, 1], position[i, 2], radius[i]
        for k in range(pair_start[i], pair_start[i + 1]):
            j = pair_other[k]
            dx, dy, dz = pair_place_to_image(images, shift, k, position[j, 0], position[j, 1], position[j, 2])
            dx, dy, dz = x - dx, y - dy, z - dz
            far = ri + radius[j] + h * (bound[i] + bound[j]) + margin + slop * ri
            near[k] = 1 if dx * dx + dy * dy + dz * dz < far * far else 0
            count += near[k]
    return count


@device_function(parallel=True, error_model="numpy", fastmath={"contract"})
def find_in_chunks(horizon, compliance, grains, pair_slots, slots, walls, old_speed, records, chunk, ends):
    """`find_contacts` and `find_triangle_contacts` by chunks.

    Pairs stand without gaps, walls from the first slot of each chunk to ``ends``. The number of contacts of the earlier
    chunks must be known before a chunk can fill its records. `particles.dvi.sweep_chunks.sort_walls` sorts the walls.
    """
    rows, pairs, near, first = chunk.rows, chunk.pairs, chunk.near, slots.start
    count = rows.shape[0] - 1
    for c in prange(count):
        pairs[c + 1] = _near(rows[c], rows[c + 1], horizon, grains, pair_slots, near)
    for c in range(count):
        pairs[c + 1] += pairs[c]
    for c in prange(count):
        own = rows[c], rows[c + 1]
        _, end = find_contacts(
            own, (pairs[c], first[rows[c]]), near, horizon, compliance, grains, pair_slots, slots, walls, old_speed,
            records,
        )  # fmt: skip
        if walls.triangle.shape[0] > 0:
            end = find_triangle_contacts(own, end, horizon, compliance, grains, slots, walls, old_speed, records)
        ends[c] = end


@device_function(parallel=True, error_model="numpy", fastmath={"contract"})
def search_in_chunks(horizon, grains, slots, walls, shafts, body, chunk):
    """`search` by chunks."""
    rows, sums = chunk.rows, chunk.sums
    count = rows.shape[0] - 1
    for c in prange(count):
        sums[c, 0] = search(rows[c], rows[c + 1], horizon, grains, slots, walls, shafts, body)
    raised = 0.0
    for c in range(count):
        raised = max(raised, sums[c, 0])
    return raised
