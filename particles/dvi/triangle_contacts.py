"""Rigid grains at triangles: which contacts may close within a step, and what overlaps.

What counts as one contact is decided as for grains that deform (`particles.walls.triangle_kernels`), only for a larger
sphere: radius, and the distance that grain and wall can approach within the step. What the rule hides lies behind the
plane of a contact that is there, which cannot be crossed in the step.

**Pushed grains.** A vane strikes a grain at rest to its own speed, and that one the next. So that these also find what
they meet within the same step, the distance that a grain is looked ahead is made as long as the wall's (`search`) and
passed on through the neighbours: over a gap g, a speed v pushes at v - g/h (`pass_on`).

**Impulses** belong to the slot of a triangle. One of a slot that another now hides goes to the contact that hides it;
all turn with the body from step to step.
"""

from __future__ import annotations

import numpy as np

from geometry.kernels.device_functions import device_function
from particles.dvi.contact_rows import set_law, set_wall_geometry
from particles.dvi.gauss_seidel import N_WALL_CONTACT, RX, RY, RZ, SPEED, WALLS
from particles.periodic_images import pair_place_to_image
from particles.walls.triangle_kernels import (
    DISTANCE,
    LEADER,
    SLOT,
    TOWARDS_X,
    TOWARDS_Y,
    TOWARDS_Z,
    triangle_contacts,
)  # fmt: skip

# columns of a body's turn: cosine and sine of its angle, and of what it has turned since the last step
COS, SIN, COS_STEP, SIN_STEP = range(4)
N_TURN = 4


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def turn_bodies(h, theta, shafts, walls):
    """Half drift of the bodies, to the middle of the step, and the frames that the triangles are met in."""
    body_angle, body_speed, turn = shafts.angle, shafts.speed, walls.turn
    for b in range(body_angle.shape[0]):
        if theta < 1.0:
            body_angle[b] += (1.0 - theta) * h * body_speed[b]
        if turn.shape[0] > 0:
            turn[b, COS], turn[b, SIN] = np.cos(body_angle[b]), np.sin(body_angle[b])
            turn[b, COS_STEP], turn[b, SIN_STEP] = np.cos(h * body_speed[b]), np.sin(h * body_speed[b])


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def search(lo, hi, horizon, grains, slots, walls, shafts, body):
    """Find the contacts of grains lo <= i < hi with triangles; raise the bounds of grains that walls push.

    ``slots.triangle_contact`` (s, N_CONTACT): those of a grain with a body from its first slot of that body on,
    directions in world axes; ``slots.tally`` (s, 2), at that slot: the numbers of contacts and of candidates. Returns
    the largest bound that was raised.
    """
    h, margin, _, law = horizon
    bound, position, radius = grains.bound, grains.position, grains.radius
    triangle, n_smooth, wall_body, turn = walls.triangle, walls.smooth.shape[0], walls.body, walls.turn
    wall_start, wall_other, contact, tally = slots.start, slots.other, slots.triangle_contact, slots.tally
    old_speed, body_reach = shafts.speed, shafts.reach
    push, top = 1.0 + law[1, 1], 0.0
    for b in range(body_reach.shape[0]):
        top = max(top, push * max(abs(old_speed[b]), abs(body[b, SPEED])) * body_reach[b])
    raised = 0.0
    for i in range(lo, hi):
        k, end = wall_start[i], wall_start[i + 1]
        while k < end and wall_other[k] < n_smooth:
            k += 1
        x, y, z, ri, own = position[i, 0], position[i, 1], position[i, 2], radius[i], bound[i]
        while k < end:
            b = wall_body[wall_other[k]]
            begin = k
            while k < end and wall_body[wall_other[k]] == b:
                k += 1
            c, s = turn[b, COS], turn[b, SIN]
            speed = max(abs(old_speed[b]), abs(body[b, SPEED]))
            far = ri + h * (max(own, top) + speed * body_reach[b]) + margin
            part = contact[begin:k]
            count, tally[begin, 1] = triangle_contacts(
                triangle, wall_other, begin, k, c * x + s * y, c * y - s * x, z, far, part
            )
            tally[begin, 0] = count
            for a in range(count):
                nx, ny, d = part[a, TOWARDS_X], part[a, TOWARDS_Y], part[a, DISTANCE]
                nx, ny = c * nx - s * ny, s * nx + c * ny
                part[a, TOWARDS_X], part[a, TOWARDS_Y] = nx, ny
                if speed > 0.0:
                    px, py = x + d * nx, y + d * ny
                    if d < ri + h * (own + speed * np.sqrt(px * px + py * py)) + margin:
                        pushed = push * speed * abs(px * ny - py * nx)
                        if pushed > bound[i]:
                            bound[i] = pushed
                            raised = max(raised, pushed)
    return raised


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def pass_on(h, grains, pair_slots):
    """Raise the bounds of grains that others push: once down the list and once up it."""
    bound, position, radius = grains.bound, grains.position, grains.radius
    pair_start, pair_other = pair_slots.start, pair_slots.other
    n = radius.shape[0]
    for backward in range(2):
        for step in range(n):
            i = n - 1 - step if backward == 1 else step
            for k in range(pair_start[i], pair_start[i + 1]):
                j = pair_other[k]
                larger = max(bound[i], bound[j])
                touch = radius[i] + radius[j]
                reach = touch + h * (larger - min(bound[i], bound[j]))
                dx, dy, dz = pair_place_to_image(
                    pair_slots.images, pair_slots.shift, k, position[j, 0], position[j, 1], position[j, 2]
                )
                dx, dy, dz = position[i, 0] - dx, position[i, 1] - dy, position[i, 2] - dz
                d2 = dx * dx + dy * dy + dz * dz
                if d2 < reach * reach:
                    pushed = larger - max(np.sqrt(d2) - touch, 0.0) / h
                    bound[i], bound[j] = max(bound[i], pushed), max(bound[j], pushed)


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def find_triangle_contacts(rows, n_walls, horizon, compliance, grains, slots, walls, old_speed, records):
    """Fill the records of the contacts of rows[0] <= i < rows[1] that may close within the step, from ``n_walls`` on.

    Returns the number behind the last one.

    Impulses of slots that hold no contact any more are handed over, or forgotten.
    """
    h, margin, slop, law = horizon
    position, velocity, radius, bound = grains.position, grains.velocity, grains.radius, grains.bound
    wall_start, wall_other, wall_impulse, wall_slot, contact, tally = slots
    n_smooth, wall_body, turn = walls.smooth.shape[0], walls.body, walls.turn
    grain, body, wall_index, wall_row = records.grain, records.body, records.wall_index, records.wall
    for i in range(rows[0], rows[1]):
        k, end = wall_start[i], wall_start[i + 1]
        while k < end and wall_other[k] < n_smooth:
            k += 1
        x, y, ri = position[i, 0], position[i, 1], radius[i]
        while k < end:
            b = wall_body[wall_other[k]]
            begin, first = k, n_walls
            while k < end and wall_body[wall_other[k]] == b:
                k += 1
            part = contact[begin:k]
            for a in range(tally[begin, 0], tally[begin, 1]):
                old, new = int(part[a, SLOT]), int(part[int(part[a, LEADER]), SLOT])
                if wall_impulse[new, 0] == 0.0 and wall_impulse[new, 1] == 0.0 and wall_impulse[new, 2] == 0.0:
                    for q in range(wall_impulse.shape[1]):  # and its torque
                        wall_impulse[new, q] = wall_impulse[old, q]
            speed = max(abs(old_speed[b]), abs(body[b, SPEED]))
            for a in range(tally[begin, 0]):
                slot, d = int(part[a, SLOT]), part[a, DISTANCE]
                nx, ny, nz = part[a, TOWARDS_X], part[a, TOWARDS_Y], part[a, TOWARDS_Z]
                px, py = x + d * nx, y + d * ny
                if d >= ri + h * (bound[i] + speed * np.sqrt(px * px + py * py)) + margin:
                    continue
                row = wall_row[n_walls]
                along = set_wall_geometry((nx, ny, nz), d / ri, (px, py), grain[i], body[b], row)
                rx, ry = wall_impulse[slot, 0], wall_impulse[slot, 1]
                row[RX] = turn[b, COS_STEP] * rx - turn[b, SIN_STEP] * ry
                row[RY] = turn[b, SIN_STEP] * rx + turn[b, COS_STEP] * ry
                row[RZ] = wall_impulse[slot, 2]
                before = -(velocity[i, 0] * nx + velocity[i, 1] * ny + velocity[i, 2] * nz) - old_speed[b] * along
                set_law(WALLS, h, ri, slop, law, compliance, d - ri, before, row, N_WALL_CONTACT)
                wall_index[n_walls, 0], wall_index[n_walls, 1], wall_slot[n_walls] = i, b, slot
                n_walls += 1
            for q in range(begin, k):
                wall_impulse[q, 0] = wall_impulse[q, 1] = wall_impulse[q, 2] = 0.0
            for w in range(first, n_walls):  # the energy budget asks whether a contact has had an impulse
                for q in range(3):
                    wall_impulse[wall_slot[w], q] = wall_row[w, RX + q]
    return n_walls


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def overlapping(walls, other, first, last, x, y, z, radius, contact):
    """Triangles of one body that a grain overlaps, among slots first <= k < last; directions in world axes."""
    b = walls.body[other[first]]
    c, s = walls.turn[b, COS], walls.turn[b, SIN]
    count, _ = triangle_contacts(walls.triangle, other, first, last, c * x + s * y, c * y - s * x, z, radius, contact)
    for a in range(count):
        nx, ny = contact[a, TOWARDS_X], contact[a, TOWARDS_Y]
        contact[a, TOWARDS_X], contact[a, TOWARDS_Y] = c * nx - s * ny, s * nx + c * ny
    return count
