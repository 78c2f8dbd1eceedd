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
    twin : ndarray of int32, shape (p,)
        Where the pair of an entry stands in the row of the other grain, or -1.
    pair : ndarray, shape (p or more, 6)
        Of each entry of the rows: n [-], and c1, c2 [1/m^3] and p [1/m^2] of `coupling.pair_fields` over 4 pi.
    itself : ndarray, shape (n, 3, 4)
        A grain's own share and its own images [1/m^3], and their potential [1/m^2].
    image_start, image_row : ndarray of int64, shapes (n + 1,), (e,)
        Entries that also see their partner's images.
    image : ndarray, shape (e or more, 3, 4)
        Those images, as `itself`.
    own_image : ndarray, shape (n, w, 3)
        [1/m^2]
    near_start, near_row, near_twin : ndarray of int64, shapes (n + 1,), (k,), (k,)
        Near pairs, the entry of each, and where it stands seen from the other grain (-1: nowhere).
    near_pair : ndarray, shape (k, 7)
    """

    twin: np.ndarray
    pair: np.ndarray
    itself: np.ndarray
    image_start: np.ndarray
    image_row: np.ndarray
    image: np.ndarray
    own_image: np.ndarray
    near_start: np.ndarray
    near_row: np.ndarray
    near_twin: np.ndarray
    near_pair: np.ndarray
