"""Grains of a cyclic sector on their way round, through its faces, and the full ring that is made of its copies."""

import math

import numpy as np

from geometry.annular_cell import ShearCell
from particles import CyclicSector, Grains, pack

PARTS = 6
SECTOR = CyclicSector(2.0 * math.pi / PARTS)
CELL = ShearCell(0.006, 0.0085, 0.003)
OMEGA = 60.0


def wedge_of(radius, spacing, fraction):
    """Grains of one sector. The common rotation carries them, and their contacts, through its faces.

    They are packed a little larger: at zero overlap they would start with or without a dashpot by round-off.
    """
    box, rng = CELL.fill_boxes()["annulus"], np.random.default_rng(4)
    count = int(fraction * box.volume(SECTOR.angle) / (4 / 3 * np.pi * radius**3))
    x = pack([box], CELL.walls(), count, spacing * radius, seed=1, sector=SECTOR)
    v = OMEGA * np.stack([-x[:, 1], x[:, 0], 0.0 * x[:, 0]], axis=1) + 0.2 * rng.normal(size=x.shape)
    return Grains.create(x, radius, 7850.0, velocity=v, angular_velocity=100.0 * rng.normal(size=x.shape))


def ring_of(wedge):
    copies = [[np.asarray(a) @ SECTOR.rotation(k).T for k in range(PARTS)] for a in
              (wedge.position, wedge.velocity, wedge.angular_velocity)]  # fmt: skip
    x, v, w = (np.concatenate(part) for part in copies)
    return Grains.create(x, wedge.radius[0], 7850.0, velocity=v, angular_velocity=w)
