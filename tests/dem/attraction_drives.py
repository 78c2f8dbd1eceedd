"""Drives of near pulls for tests of both engines: alike for all pairs, or by a vector and a number of each grain."""

import numpy as np


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
