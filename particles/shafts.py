"""Bodies and what drives them, as the compiled steps take them; both engines read the same tables."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from geometry.time_profile import TimeProfile
from particles.bodies import Body, FreeShaft

# a body's entries in the table of its drives, one row a step: speed where it is prescribed, torques where it is free
SPEED, DRIVE, LOAD, DRIVE_SLOPE = range(4)
# a body's constants: whether it is free, its inertia
FREE, INERTIA = range(2)


class Shafts(NamedTuple):
    """Bodies and what drives them.

    Attributes
    ----------
    drives : ndarray, shape (n_steps, n_bodies, 4)
        Speeds and torques at the coming steps (`drives_at`).
    constants : ndarray, shape (n_bodies, 2)
        Whether the body is free, and its inertia [kg m^2].
    angle, speed : ndarray, shape (n_bodies,)
        [rad], [rad/s]
    reach, list_angle : ndarray, shape (n_bodies,)
        Largest radius of its triangles [m]; its angle when the list was made [rad].
    n_sectors : float
        Sectors in the ring: a shaft feels all of them.
    """

    drives: np.ndarray
    constants: np.ndarray
    angle: np.ndarray
    speed: np.ndarray
    reach: np.ndarray
    list_angle: np.ndarray
    n_sectors: float


def drives_at(
    bodies: Sequence[Body], times: np.ndarray, speeds_at: np.ndarray | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """``drives`` and ``constants`` of `Shafts` for steps at ``times`` (n_steps,) [s].

    Prescribed speeds are taken at ``speeds_at`` (n_steps,) [s], by default the same times.
    """
    drives, constants = np.zeros((len(times), len(bodies), 4)), np.zeros((len(bodies), 2))
    for b, body in enumerate(bodies):
        if isinstance(body.motion, TimeProfile):
            drives[:, b, SPEED] = body.motion.at(times if speeds_at is None else speeds_at)
        elif isinstance(body.motion, FreeShaft):
            motion = body.motion
            constants[b] = 1.0, motion.inertia
            on = times >= motion.switched_on
            drives[:, b, DRIVE] = on * motion.drive_torque + body.external_torque
            drives[:, b, DRIVE_SLOPE] = on * motion.drive_slope
            drives[:, b, LOAD] = motion.load_torque.at(times)
    return drives, constants
