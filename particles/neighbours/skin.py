"""The skin of the Verlet list: how much further than touching it reaches, so that it lasts some steps.

A wide skin costs a look at pairs that do not touch, in every step; a narrow one costs new lists. With k the steps that
a list lasts for each metre of skin, B the price of these pairs for each metre and C that of a new list,

    price of a step = A + B s + C/(k s),      least at s = sqrt(C/(k B)).

k is measured from the last list, in steps and not in seconds: the choice is the same on every machine.
"""

from __future__ import annotations

import math

LIST_COST = 100.0  # C: a new list costs as much as a look at so many pairs, for each grain
NARROWEST, WIDEST = 0.2, 1.2  # of the mean radius
USUAL = 0.5


def next_skin(skin: float, steps: int, extra_pairs: float, mean_radius: float, widest: float = WIDEST) -> float:
    """Skin [m] of the next list, halfway between ``skin`` [m] and the best one.

    Parameters
    ----------
    steps : int
        Steps that the last list has lasted.
    extra_pairs : float
        Listed pairs that do not touch, for each grain.
    widest : float
        Limit in mean radii.
    """
    if steps < 1 or extra_pairs <= 0.0:
        return skin
    best = math.sqrt(LIST_COST * skin / steps * skin / extra_pairs)
    return min(max(0.5 * (skin + best), NARROWEST * mean_radius), widest * mean_radius)
