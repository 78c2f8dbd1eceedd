"""A field that stands still in the frame of a body, for devices with slots or teeth in one of their bodies.

The slotted body is the only part that is not a body of revolution: seen from it, the field of the coil stands still
while the rest turns. So one solve per current is enough; grains sample it in the frame that turns with that body. The
torque that this field exerts on the grains has its reaction on the slotted body alone, because an isotropic body of
revolution without hysteresis takes no torque about its axis: it acts there, and drives a free shaft.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from field import FieldSampler
from particles import Body


def turn_of(body: Body) -> np.ndarray:
    """Matrix (3, 3) from a body's frame, whose angle is 0 at the start, to that of the device."""
    cos, sin = np.cos(body.angle), np.sin(body.angle)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])


@dataclass(frozen=True, slots=True)
class TurningSampler:
    """A field that turns with a body.

    Parameters
    ----------
    sampler : FieldSampler
        The field in the body's frame.
    carrier : Body
        The body; its present angle is taken at every call.
    """

    sampler: FieldSampler
    carrier: Body

    def sample(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `FieldSampler.sample`."""
        turn = turn_of(self.carrier)
        H, grad = self.sampler.sample(np.asarray(position, dtype=float) @ turn)
        return H @ turn.T, turn @ grad @ turn.T
