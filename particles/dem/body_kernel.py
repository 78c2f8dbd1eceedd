"""Compiled motion of the bodies: prescribed speeds, free shafts under drive, load and contacts (`particles.bodies`)."""

from __future__ import annotations

import numpy as np

from geometry.kernels.device_functions import device_function
from particles.dem.total_columns import (
    BODY_WORK,
    DRIVE_WORK,
    LAST_TORQUE,
    LOAD_WORK,
    N_CHUNK_BODY,
    SHAFT_CONTACT_WORK,
    TORQUE_T,
)
from particles.shafts import DRIVE, DRIVE_SLOPE, FREE, INERTIA, LOAD, SPEED


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def drive_bodies(step, shafts, walls):
    """Set the speeds of driven bodies for a step, and the frames of their triangles."""
    for b in range(shafts.speed.shape[0]):
        if shafts.constants[b, FREE] == 0.0:
            shafts.speed[b] = shafts.drives[step, b, SPEED]
        if walls.triangle.shape[0] > 0:
            walls.turn[b, 0], walls.turn[b, 1] = np.cos(shafts.angle[b]), np.sin(shafts.angle[b])


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def turn_bodies(dt, step, shafts, totals):
    """Add the loads of the chunks in their order; kick and drift of the bodies."""
    drives, constants, angle, speed = shafts.drives, shafts.constants, shafts.angle, shafts.speed
    chunk_bodies, bodies, n_sectors = totals.chunk_bodies, totals.bodies, shafts.n_sectors
    for b in range(speed.shape[0]):
        torque = 0.0
        for column in range(N_CHUNK_BODY):
            total = 0.0
            for c in range(chunk_bodies.shape[0]):
                total += chunk_bodies[c, b, column]
            bodies[b, column] += total
            if column <= TORQUE_T:
                torque += total
        mean = before = speed[b]
        if constants[b, FREE] != 0.0:
            old = speed[b]
            per = dt / constants[b, INERTIA]
            # the drive falls with speed: taken at the mean of old and new
            slope = 0.5 * per * drives[step, b, DRIVE_SLOPE]
            new = (old * (1.0 - slope) + per * (n_sectors * torque + drives[step, b, DRIVE])) / (1.0 + slope)
            limit = per / (1.0 + slope) * drives[step, b, LOAD]
            # dry friction: shrink the speed, never reverse it
            brake = min(max(new, -limit), limit)
            new -= brake
            mean = 0.5 * (old + new)
            drive = drives[step, b, DRIVE] - drives[step, b, DRIVE_SLOPE] * mean
            bodies[b, DRIVE_WORK] += drive * mean * dt
            bodies[b, SHAFT_CONTACT_WORK] += n_sectors * torque * mean * dt
            bodies[b, LOAD_WORK] += brake * (1.0 + slope) / per * mean * dt
            speed[b] = new
        # by drifts, as the works on the grains: the mean of the last and this torque, at the speed between them
        bodies[b, BODY_WORK] -= 0.5 * (bodies[b, LAST_TORQUE] + torque) * before * dt
        bodies[b, LAST_TORQUE] = torque
        angle[b] += speed[b] * dt


@device_function(without_refcounts=True, error_model="numpy", fastmath={"contract"})
def wall_travel(shafts):
    """Return the largest displacement of a triangle since the list was made [m]."""
    travel = 0.0
    for b in range(shafts.speed.shape[0]):
        travel = max(travel, abs(shafts.angle[b] - shafts.list_angle[b]) * shafts.reach[b])
    return travel
