"""Torque over current of a clutch that does not exist: a power of the current, then saturation."""

import numpy as np

CURRENTS = np.geomspace(0.2, 2.0, 25)
"""Where the curve is wanted [A]."""


def torque(current):
    """Torque [N m] of a current [A]."""
    return 12.0 * current**1.7 / np.sqrt(1.0 + (current / 0.9) ** 2.2)


def replica(current, scatter, random):
    """Torque [N m] of one replica, whose relative standard deviation is `scatter`."""
    return torque(current) * np.exp(scatter * random.standard_normal(np.shape(current)))


def core_hours(current):
    """Cost of one replica [core-h]: stiffer contacts at a stronger field take more steps."""
    return 0.3 + 0.35 * current
