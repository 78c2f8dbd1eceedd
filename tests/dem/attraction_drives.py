"""A table of near pulls for tests of both engines, its drives, and grains that have given gaps.

Drives are alike for all pairs, or follow from a vector and a number of each grain.
"""

import numpy as np

from geometry.walls import Plane, cylinder
from particles import Attraction

RADIUS, DENSITY = 0.5e-3, 7850.0
X = np.linspace(np.log(2e-3), np.log(0.3), 40)  # ln gap
COLUMNS = np.linspace(0.5, 1.5, 5)
VALUES = (0.3 - np.exp(X))[:, None] ** 2 / (np.exp(X)[:, None] + 0.02 * COLUMNS)
ACROSS = 0.2 * (0.3 - np.exp(X))
SMALLEST = 3e-3
ALONG = np.array([0.6, 0.0, 0.8])  # the line of the pairs
OUT = np.array([np.cos(0.3), -np.sin(0.3), 0.0])  # of the bore


def table(drives, **more):
    return Attraction(X[0], X[1] - X[0], VALUES, ACROSS, SMALLEST, drives, **more)


def pull(gap, column, amplitude, across=0.0):
    """The formula of `particles.attraction`, by other means."""
    x, k = np.log(np.maximum(gap, SMALLEST)), np.arange(len(COLUMNS))
    at = np.array([np.interp(column, k, [np.interp(one, X, VALUES[:, j]) for j in k]) for one in np.atleast_1d(x)])
    found = amplitude * at + across * np.interp(x, X, ACROSS)
    return np.where(gap < np.exp(X[-1]), found, 0.0).reshape(np.shape(gap))[()]


def at_gaps(gap, first, second):
    """Places (4 n, 3) and radii of four grains for each gap (n,) [radii], and the plane and the bore that they need."""
    n, a = len(gap), 2.0 * first * second / (first + second)
    place = 10.0 * RADIUS * np.arange(n)
    x = np.stack([place, np.zeros(n), np.full(n, 20.0 * RADIUS)], axis=1)
    there = x + (first + second + a * gap)[:, None] * ALONG
    on_plane = np.stack([place, np.full(n, 20.0 * RADIUS), first * (1.0 + 0.5 * gap)], axis=1)
    bore = 200.0 * RADIUS
    in_bore = (bore - second * (1.0 + 0.5 * gap))[:, None] * OUT
    in_bore[:, 2] = 60.0 * RADIUS + place
    walls = [
        Plane("plane", "housing", np.zeros(3), np.array([0.0, 0.0, 1.0])),
        cylinder("bore", "housing", bore, 20.0 * RADIUS, 1.0),
    ]
    return np.concatenate([x, there, on_plane, in_bore]), np.repeat([first, second, first, second], n), walls


def alike(amplitude, column=1.7, across=0.0, walls=0.0):
    """Drives that are the same for all pairs and all smooth walls."""

    def drives(motion):
        slots = motion.listed_walls
        at_walls = np.column_stack([np.full(len(slots.wall), column), walls * slots.smooth])
        return np.tile([column, amplitude, across], (motion.listed_pairs.count, 1)), at_walls

    return drives


def from_moments(strength):
    """Drives that follow from a vector and a number of each grain, as magnetic ones do."""

    def drives(motion):
        held, pairs, walls = motion.attraction.per_grain, motion.listed_pairs, motion.listed_walls
        moment, share, i = held["moment"], held["share"], pairs.rows()
        there = moment[pairs.other]
        if motion.sector is not None:
            there = motion.sector.turn(there, pairs.shift)
        along = np.einsum("ij,ij->i", moment[i], there)
        place = 2.0 + share[i] + share[pairs.other]
        row = np.repeat(np.arange(len(moment)), np.diff(walls.start))
        at_wall = strength * walls.smooth * (1.0 + moment[row, 2] ** 2)
        return np.column_stack([place, strength * along**2, strength * np.abs(along)]), np.column_stack(
            [2.0 + share[row], at_wall]
        )

    return drives
