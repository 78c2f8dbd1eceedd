"""Compiled search for what a grain touches among the walls near it, and what may pull it."""

from __future__ import annotations

from geometry.kernels.device_functions import device_function
from particles.dem.contact_kernel import released_by_springs
from particles.walls.triangle_kernels import LEADER, SLOT, triangle_contacts
from particles.walls.wall_kernels import _wall_gap


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def add_released(law, kind, resistance, energy_column, radius, slots, slot, released):
    """Add the energy that the springs of a wall's slot release when the grain leaves to ``released`` (4) [J]."""
    a, b, c, d = released_by_springs(law, kind, resistance, energy_column, radius, 0.0, slots.history, slot)
    return released[0] + a, released[1] + b, released[2] + c, released[3] + d


@device_function(without_refcounts=True, error_model="numpy", forceinline=True)
def _note(row, slot, distance, nx, ny, nz, i):
    row[0], row[1], row[2], row[3], row[4], row[5] = slot, distance, nx, ny, nz, i


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"}, forceinline=True)
def touching_walls(
    i, law, resistance, energy_column, attraction, grains, slots, walls, contact, near, n_near, released
):
    """Find the walls that grain i touches, as rows of ``contact``: slot, distance, unit vector towards the wall, i.

    Smooth walls that it is near to go into such rows of ``near``, from row ``n_near`` on, where there is an attraction.
    A grain that rolls from one face of a body onto the next keeps its springs: they are moved to the new slot. Returns
    the number of contacts, ``n_near`` with the rows of ``near``, and ``released`` (4) [J] with the losses of those that
    ended.
    """
    kind_row = 0
    if grains.species.shape[0] > 0:
        kind_row = grains.species[i]
    position_radius, other, touching, history = grains.position_radius, slots.other, slots.touching, slots.history
    wall, body_of, law_row = walls.smooth, walls.body, walls.law_row
    x, y, z, radius = position_radius[i, 0], position_radius[i, 1], position_radius[i, 2], position_radius[i, 3]
    first, end = slots.start[i], slots.start[i + 1]
    n_walls = wall.shape[0]
    if end == first + 1 and other[first] < n_walls:  # most grains that have a wall have one
        distance, nx, ny, nz, owned = _wall_gap(wall, other[first], x, y, z)
        if attraction is not None:
            _note(near[n_near], first, distance, nx, ny, nz, i)
            n_near += 1 if owned else 0
        if distance < radius and owned:
            touching[first] = 1
            _note(contact[0], first, distance, nx, ny, nz, i)
            return 1, n_near, released
        if touching[first] != 0:
            touching[first] = 0
            if energy_column is not None:
                row = law_row[kind_row, other[first]]
                released = add_released(law, row, resistance, energy_column, radius, slots, first, released)
            for a in range(history.shape[1]):
                history[first, a] = 0.0
        return 0, n_near, released
    count = 0
    k = first
    while k < end:
        w = other[k]
        k += 1
        if w < n_walls:
            distance, nx, ny, nz, owned = _wall_gap(wall, w, x, y, z)
            if attraction is not None:
                _note(near[n_near], k - 1, distance, nx, ny, nz, i)
                n_near += 1 if owned else 0
            if distance < radius and owned:
                _note(contact[count], k - 1, distance, nx, ny, nz, i)
                count += 1
        else:  # all triangles of one body at once, in the frame that turns with it
            body = body_of[w]
            begin = k - 1
            while k < end and body_of[other[k]] == body:
                k += 1
            c, s = walls.turn[body, 0], walls.turn[body, 1]
            part = contact[count:]
            new_rows, candidates = triangle_contacts(
                walls.triangle, other, begin, k, c * x + s * y, c * y - s * x, z, radius, part
            )
            # a grain that goes over an edge changes its triangle, not its contact
            for a in range(new_rows, candidates):
                old, new = int(part[a, SLOT]), int(part[int(part[a, LEADER]), SLOT])
                if touching[old] != 0:
                    touching[old] = 0
                    if touching[new] != 0 and energy_column is not None:  # two contacts have become one
                        row = law_row[kind_row, other[old]]
                        released = add_released(law, row, resistance, energy_column, radius, slots, old, released)
                    if touching[new] == 0:
                        touching[new] = 1
                        for b in range(history.shape[1]):
                            history[new, b] = history[old, b]
                    for b in range(history.shape[1]):
                        history[old, b] = 0.0
            for a in range(new_rows):
                nx, ny = part[a, 2], part[a, 3]
                part[a, 2], part[a, 3], part[a, 5] = c * nx - s * ny, s * nx + c * ny, i
            count += new_rows
    for a in range(count):
        touching[int(contact[a, 0])] += 2  # 2: new, 3: as before; what is 1 now has separated
    for k in range(first, end):
        if touching[k] == 1:
            touching[k] = 0
            moved = False
            for a in range(count):
                new = int(contact[a, 0])
                if touching[new] == 2 and body_of[other[new]] == body_of[other[k]]:
                    for b in range(history.shape[1]):
                        history[new, b] = history[k, b]
                    touching[new] = 3
                    moved = True
                    break
            if energy_column is not None and not moved:
                row = law_row[kind_row, other[k]]
                released = add_released(law, row, resistance, energy_column, radius, slots, k, released)
            for b in range(history.shape[1]):
                history[k, b] = 0.0
    for a in range(count):
        touching[int(contact[a, 0])] = 1
    return count, n_near, released
