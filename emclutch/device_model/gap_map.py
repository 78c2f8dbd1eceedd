"""The field along the gap of a device in 3D, as a map over angle and z."""

from __future__ import annotations

import numpy as np

from emclutch.device_model.device_3d import CoilDevice3D
from field import MU_0
from field.three_d import Field3D


def gap_map(
    device: CoilDevice3D, solution: Field3D, pitches: float = 2.0, count: int = 200
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Recovered B_r (m, count) [T] on the gap's middle cylinder, free of powder; at angles [rad] and z (m,) [m].

    Over some pitches of a slotted clutch, or all around.
    """
    angle = np.linspace(0.0, 2.0 * np.pi if device.pitch is None else pitches * device.pitch, count)
    line = device.shape.gap_midline(80)
    r, z = line.T
    points = np.stack(
        [np.outer(r, np.cos(angle)), np.outer(r, np.sin(angle)), np.broadcast_to(z[:, None], (len(z), count))], axis=-1
    )
    H = solution.sampler("powder").sample(points.reshape(-1, 3))[0].reshape(len(z), count, 3)
    return angle, z, MU_0 * (H[..., 0] * np.cos(angle) + H[..., 1] * np.sin(angle))
