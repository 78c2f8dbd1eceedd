"""Regular packings: simple cubic (sc), face-centred cubic (fcc), hexagonal close (hcp), with noise.

All three are stacks of rows, at spacing a of the sites (densities at a = d, the diameter, far from walls):

    kind  rows apart   layers apart   stacked          density
    sc    a            a              straight         pi/6 = 0.5236
    hcp   a sqrt(3)/2  a sqrt(2/3)    A B A B ...      pi/(3 sqrt 2) = 0.7405
    fcc   a sqrt(3)/2  a sqrt(2/3)    A B C A B C ...  pi/(3 sqrt 2) = 0.7405

with every other row, and layers B and C, shifted by half a step along the row and by one and two times a/(2 sqrt 3)
across. In a box rows run along x, across is y. In a ring they are bent: rows are circles about the axis, across is the
radius, and a whole number of steps closes each row, also in a sector of the ring. Bending only moves sites apart, if
the steps are a on the innermost row: a ring of close-packed rows loses (r1 - r0)/(2 r0) of its density to that. Rows
of sc need not match and have their own number of steps. A full ring, or a chamber between two vanes, is also cut out
of the straight lattice, and the one with more sites is used.

The lattice is stretched until it has as many sites as there are grains; where one step more or less leaves sites over,
seeded chance says which stay empty. Noise moves each grain by up to its part of the play (a - d)/2, so that
grains never overlap, whatever the noise. Grains of different sizes share one lattice, that of the largest.
"""

from __future__ import annotations

import math

import numpy as np

from geometry.box import Box
from geometry.centrifugal import Chamber
from geometry.walls import AnnularBox
from particles.errors import PackingError
from particles.packing.packing import Packing
from particles.packing.space import Place, Space, opening

KINDS = ("sc", "fcc", "hcp")
_HALVINGS = 30  # of the interval in which the spacing is searched
_CLOSE = 1e-9  # sites that miss the last place by round-off alone belong to the space


def lattice_packing(
    space: Space, radius: np.ndarray, *, kind: str = "fcc", noise: float = 0.0, seed: int = 1
) -> Packing:
    """Grains of ``radius`` (n,) [m] on the sites of a lattice.

    Parameters
    ----------
    kind
        One of `KINDS`.
    noise : float
        Of the play between neighbours, 0 to 1.
    seed : int
        Of the noise, of who sits where, and of the sites that stay empty.

    Raises
    ------
    ValueError
        For another kind, or noise out of range.
    PackingError
        If there are more grains than sites.
    """
    if kind not in KINDS:
        raise ValueError(f"lattice = {kind!r}; available: {', '.join(KINDS)}")
    if not 0.0 <= noise <= 1.0:
        raise ValueError(f"noise = {noise:g} of the play between neighbours; allowed: 0 to 1")
    size = space.require_positive(radius)
    diameter = 2.0 * float(size.max())
    sites, spacing = _stretched(space, kind, diameter, len(size))
    rng = np.random.default_rng(seed)
    chosen = np.sort(rng.choice(len(sites), len(size), replace=False))
    moved = rng.standard_normal((len(size), 3))
    moved *= (rng.random(len(size)) ** (1.0 / 3.0) / np.sqrt(np.sum(moved**2, axis=1)))[:, None]  # even in a ball
    position = sites[chosen] + 0.5 * noise * (spacing - diameter) * moved
    if space.sector is not None:
        position = space.sector.turn(position, space.sector.wraps(position))
    return Packing(position, rng.permutation(size))


def lattice_sites(space: Space, kind: str, spacing: float) -> np.ndarray:
    """Every site whose distance to the walls and faces of the boxes is half a ``spacing`` [m] at least, (n, 3) [m]."""
    sites = np.concatenate([_sites_in(place, kind, spacing, space) for place in space.places])
    if not len(sites):
        return sites
    half = np.full(len(sites), 0.5 * spacing * (1.0 - 1e3 * _CLOSE))
    return sites[(space.wall_overlap(sites, half) == 0.0) & ~space.in_solids(sites)]


def _stretched(space: Space, kind: str, diameter: float, count: int) -> tuple[np.ndarray, float]:
    """Sites of the widest lattice that has ``count`` at least, and its spacing [m]."""
    sites, spacing = lattice_sites(space, kind, diameter), diameter
    if len(sites) < count:
        raise PackingError(
            f"the {kind} lattice has {len(sites)} sites {diameter * 1e3:.4g} mm apart in the space of "
            f"{space.volume * 1e9:.4g} mm^3, {count} grains are wanted; lower their number or the largest diameter"
        )
    low, high = diameter, max(diameter, 1.5 * (space.volume / count) ** (1.0 / 3.0))
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        trial = lattice_sites(space, kind, middle)
        if len(trial) >= count:
            low, sites, spacing = middle, trial, middle
        else:
            high = middle
    return sites, spacing


def _sites_in(place: Place, kind: str, a: float, space: Space) -> np.ndarray:
    if isinstance(place, Box):
        return _stack(kind, a, np.asarray(place.size) - a) + place.lower + 0.5 * a
    bent = _bent(place, kind, a, opening(place, space.angle))
    return bent if space.sector is not None else max(bent, _cut(place, kind, a), key=len)


def _layers(kind: str, a: float, height: float) -> list[tuple[float, int]]:
    """Height [m] and shift (0, 1 or 2: A, B, C) of each layer."""
    rise, letters = (a, 1) if kind == "sc" else (a * math.sqrt(2.0 / 3.0), 2 if kind == "hcp" else 3)
    return [(k * rise, k % letters) for k in range(_fitting(height, rise))]


def _rows(kind: str, a: float, width: float, shift: int) -> list[tuple[float, float]]:
    """Distance across [m] and offset along, in steps, of each row of a layer."""
    if kind == "sc":
        return [(j * a, 0.0) for j in range(_fitting(width, a))]
    first = shift * a / (2.0 * math.sqrt(3.0))
    step = 0.5 * math.sqrt(3.0) * a
    return [(first + j * step, 0.5 * ((j + shift) % 2)) for j in range(_fitting(width - first, step))]


def _fitting(length: float, step: float) -> int:
    """Points 0, step, 2 step, ... up to ``length``."""
    return 0 if length < -_CLOSE * step else int(length / step + _CLOSE) + 1


def _stack(kind: str, a: float, size: np.ndarray) -> np.ndarray:
    """Straight rows in 0 <= x, y, z <= ``size`` [m]."""
    rows = [
        np.stack(np.broadcast_arrays((offset + np.arange(_fitting(size[0] - offset * a, a))) * a, y, z), axis=1)
        for z, shift in _layers(kind, a, size[2])
        for y, offset in _rows(kind, a, size[1], shift)
    ]
    return np.concatenate([*rows, np.zeros((0, 3))])


def _bent(place: AnnularBox, kind: str, a: float, between: tuple[float, float]) -> np.ndarray:
    """Rows about the axis, closed in a ring or sector, with ends half a step off the faces of a chamber."""
    inner, closed = place.r0 + 0.5 * a, not isinstance(place, Chamber)
    first, angle = between[0], between[1] - between[0]
    rows = []
    for z, shift in _layers(kind, a, place.z1 - place.z0 - a):
        for across, offset in _rows(kind, a, place.r1 - place.r0 - a, shift):
            r = inner + across
            # a chord of a between neighbours, on this row or (close-packed: all rows in step) on the innermost
            step = 2.0 * math.asin(0.5 * a / (r if kind == "sc" else inner))
            if closed:
                n = int(angle / step + _CLOSE)
                theta = (np.arange(n) + offset) * (angle / max(n, 1))
            else:
                n = _fitting(angle - (1.0 + offset) * step, step)
                theta = (np.arange(n) + 0.5 + offset) * step + first
            rows.append(np.stack([r * np.cos(theta), r * np.sin(theta), np.full(n, place.z0 + 0.5 * a + z)], 1))
    return np.concatenate([*rows, np.zeros((0, 3))])


def _cut(place: AnnularBox, kind: str, a: float) -> np.ndarray:
    """Sites of the straight lattice within the full ring."""
    width = 2.0 * place.r1 - a
    corner = np.array([-0.5 * width, -0.5 * width, place.z0 + 0.5 * a])
    sites = corner + _stack(kind, a, np.array([width, width, place.z1 - place.z0 - a]))
    r = np.hypot(sites[:, 0], sites[:, 1])
    inside = (r >= place.r0 + 0.5 * a) & (r <= place.r1 - 0.5 * a)
    if isinstance(place, Chamber):
        theta = np.mod(np.arctan2(sites[:, 1], sites[:, 0]) - place.theta0, 2.0 * math.pi)
        side = np.arcsin(np.minimum(0.5 * a / np.maximum(r, a), 1.0))
        inside &= (theta >= side) & (theta <= place.theta1 - place.theta0 - side)
    return sites[inside]
