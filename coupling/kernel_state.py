"""What the magnetic kernels read and write: tuples of arrays, named by what they belong to.

An array that a loop over `numba.prange` only writes to is an argument of its own: numba takes one out of a tuple for a
local array, and leaves out what fills it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np


class PairModel(NamedTuple):
    """How two grains see each other.

    Attributes
    ----------
    reach : float
        How far [m].
    smear : bool
        Less the part of a dipole that is spread out, which the mean field holds (`coupling.pair_fields`).
    near : bool
        Near pairs are more than mutual dipoles.
    smallest_gap : float
        Of near pairs [radii].
    """

    reach: float
    smear: bool
    near: bool
    smallest_gap: float


class Rows(NamedTuple):
    """The arrays of `coupling.neighbour_rows.NeighbourRows`, or of a half list with the same turns."""

    start: np.ndarray
    other: np.ndarray
    shift: np.ndarray
    turn_cos: np.ndarray
    turn_sin: np.ndarray


class MagneticGrains(NamedTuple):
    """Grains at one instant, with w walls: all that is known of them (`coupling.mutual_moments.Magnetisation`).

    Attributes
    ----------
    position, moment : ndarray, shape (n, 3)
        Centres [m], moments [A m^2].
    radius, volume : ndarray, shape (n,)
        [m], [m^3]; ``volume`` and ``share`` (0,) where only drives are found.
    applied, field : ndarray, shape (n, 3)
        Field without grains and with the others' [A/m].
    slope : ndarray, shape (n, 4)
        Of the applied field [A/m^2].
    potential : ndarray, shape (n,)
        Of the others [A].
    share, contrast : ndarray, shape (n,)
        What a grain takes of its pairs' excess moments; what saturation leaves of its answer across.
    height, own_image : ndarray, shape (n, w)
        Over the walls [m] (`coupling.mirror`); the part of the potential that a grain's own image makes [A].
    """

    position: np.ndarray
    radius: np.ndarray
    volume: np.ndarray
    moment: np.ndarray
    applied: np.ndarray
    slope: np.ndarray
    field: np.ndarray
    potential: np.ndarray
    share: np.ndarray
    contrast: np.ndarray
    height: np.ndarray
    own_image: np.ndarray


class Influence(NamedTuple):
    """What `coupling.influence_kernels` finds from places alone, and the applied field in near pairs.

    Attributes
    ----------
    block : ndarray, shape (p + n, 3, 4)
        [1/m^3] and [1/m^2].
    image_potential : ndarray, shape (n, w, 3)
        [1/m^2]
    near_start, near_row : ndarray of int64, shapes (n + 1,), (k,)
    near_pair : ndarray, shape (k, 7)
    """

    block: np.ndarray
    image_potential: np.ndarray
    near_start: np.ndarray
    near_row: np.ndarray
    near_pair: np.ndarray
