"""State of the magnetic kernels: named tuples of arrays.

An array that a loop over `numba.prange` only writes to is an argument of its own: numba takes one out of a tuple for a
local array, and leaves out what fills it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

FIRST, SECOND, IMAGE, ENTRY, TWIN, N_PAIR = range(6)  # of a pair: its grains, and see `PairSubset`


class PairModel(NamedTuple):
    """Relative position of two grains.

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
    """The arrays of `coupling.neighbour_rows.NeighbourRows`, or of a half list with the same images."""

    start: np.ndarray
    other: np.ndarray
    image: np.ndarray
    images: np.ndarray


class MagneticGrains(NamedTuple):
    """Grains at one instant, with w walls: all that is known of them (`coupling.mutual_moments.Magnetisation`).

    Attributes
    ----------
    position : ndarray, shape (n, 3)
        Centres [m].
    radius, volume : ndarray, shape (n,)
        [m], [m^3].
    dipole : ndarray, shape (n, 3)
        Dipole parts of the moments [A m^2].
    charge : ndarray, shape (n,)
        Excess flux that leaves through the necks, over mu_0 [A m].
    applied, field : ndarray, shape (n, 3)
        Field without grains and with the others' [A/m].
    slope : ndarray, shape (n, 4)
        Of the applied field [A/m^2].
    potential : ndarray, shape (n,)
        Of all grains, at the centre [A].
    contrast : ndarray, shape (n, 3)
        c [-] and dc/dM [m/A], what saturation leaves of the response across, and dM/dh [-] of a lone sphere
        (`coupling.grain_law_table`).
    height : ndarray, shape (n, w)
        Over the walls [m] (`coupling.mirror`).
    """

    position: np.ndarray
    radius: np.ndarray
    volume: np.ndarray
    dipole: np.ndarray
    charge: np.ndarray
    applied: np.ndarray
    slope: np.ndarray
    field: np.ndarray
    potential: np.ndarray
    contrast: np.ndarray
    height: np.ndarray


class PairSubset(NamedTuple):
    """Entries of the rows that are of one kind, in their order, and the pairs that they are of.

    Attributes
    ----------
    start : ndarray of int64, shape (n + 1,)
        Those of grain i are start[i] to start[i + 1].
    entry, twin : ndarray of int32, shape (k,)
        Of the rows; and where the pair stands here seen from the other grain (-1: nowhere).
    unique : ndarray of int32, shape (blocks, N_PAIR, 8)
        Every pair once, eight in a block: both grains, the image of the second, where it stands here, and its twin;
        the last pair fills the last block.
    pairs : int
        How many.
    """

    start: np.ndarray
    entry: np.ndarray
    twin: np.ndarray
    unique: np.ndarray
    pairs: int


class Influence(NamedTuple):
    """Results of `coupling.influence_kernels` from positions alone, and the applied field in near pairs.

    Numba takes no tuple within a tuple into a loop over `numba.prange`: both `PairSubset` stand here by their fields.

    Attributes
    ----------
    itself : ndarray, shape (n, 4, 4), of dipoles alone (n, 3, 4)
        Field (3) [A/m] and potential [A] at a grain of its own moment (3) [A m^2] and charge [A m], by its spread
        contribution to the mean field and by its images.
    image_start, image_entry, image_twin, image_unique, image_pairs
        Entries that also see their partner's images, see `PairSubset`.
    image : ndarray, shape (those or more, 4 or 3, 4)
        Those images, as `itself`.
    near_start, near_entry, near_twin, near_unique, near_pairs
        Near pairs, see `PairSubset`.
    near_pair : ndarray, shape (blocks of ``near_unique`` or more, N_NEAR, 8)
    """

    itself: np.ndarray
    image_start: np.ndarray
    image_entry: np.ndarray
    image_twin: np.ndarray
    image_unique: np.ndarray
    image_pairs: int
    image: np.ndarray
    near_start: np.ndarray
    near_entry: np.ndarray
    near_twin: np.ndarray
    near_unique: np.ndarray
    near_pairs: int
    near_pair: np.ndarray
