"""Random packings without overlap: grains are thrown in at random and pushed apart.

Each sweep visits the pairs in the order of the neighbour list and moves both partners apart by half their
overlap (Gauss-Seidel on positions; no forces, no time), then pushes grains out of the walls. Grains start
small and grow to full size, so that deep random overlaps open without tearing neighbours through walls. The
same seed gives the same packing. Random close packing is at a solid fraction of 0.64; the method stalls
somewhat below, and walls a few diameters apart lower what fits, hence the refusal above 0.60.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
from numba import njit

from geometry.box import Box
from geometry.walls import AnnularBox, Wall
from particles.dem.step_kernel import push_off_walls
from particles.faults import PackingError
from particles.lists.neighbours import cell_order, find_pairs
from particles.sector import CyclicSector
from particles.walls.wall_table import wall_rows

DENSEST = 0.60  # solid fraction
TOLERANCE = 0.01  # overlap as a share of the diameter
GROWTH = (0.7, 0.85, 0.95, 1.0)  # sizes that the grains go through
SWEEPS = (30, 30, 60, 3000)  # the most sweeps at each size


def pack(
    boxes: Sequence[AnnularBox] | AnnularBox | Box,
    walls: Sequence[Wall],
    count: int,
    radius: float | np.ndarray,
    *,
    seed: int,
    sector: CyclicSector | None = None,
) -> np.ndarray:
    """Centres of ``count`` grains, sorted by cells, shape (count, 3) [m].

    Parameters
    ----------
    boxes
        Where to throw grains in: rings (each gets its share by volume; within ``sector`` where there is
        one) or a box.
    walls
        Kept clear of.
    radius : float or ndarray, shape (count,)
        [m]
    seed : int
        Of the random positions.

    Raises
    ------
    PackingError
        If the grains would fill more than 0.60 of the boxes, a box is thinner than a grain, or overlaps stay.
    """
    size = np.array(np.broadcast_to(np.asarray(radius, dtype=float), (count,)))
    if count < 1 or not (np.isfinite(size) & (size > 0.0)).all():
        raise PackingError(f"{count} grains of radius {radius} m cannot be packed; both must be positive")
    places: list[AnnularBox | Box] = [boxes] if isinstance(boxes, AnnularBox | Box) else list(boxes)
    angle = 2.0 * math.pi if sector is None else sector.angle
    volumes = np.array([box.volume if isinstance(box, Box) else box.volume(angle) for box in places])
    fraction = float(np.sum(4.0 / 3.0 * np.pi * size**3) / volumes.sum())
    if fraction > DENSEST:
        raise PackingError(
            f"{count} grains would fill {fraction:.3f} of the space of {volumes.sum() * 1e9:.4g} mm^3; "
            f"allowed: at most {DENSEST:.2f} (random close packing is 0.64); at this size at most "
            f"{int(count * DENSEST / fraction)} grains fit: lower their number"
        )
    rng = np.random.default_rng(seed)
    shares = _shares(volumes, count)
    owner = np.repeat(np.arange(len(places)), shares)
    position = np.concatenate(
        [_throw(rng, place, size[owner == k], angle) for k, place in enumerate(places) if shares[k]]
    )
    return _push_apart(position, size, wall_rows(walls), sector)


def _shares(volumes: np.ndarray, count: int) -> np.ndarray:
    """Whole numbers in proportion to ``volumes`` that add up to ``count`` (largest remainders)."""
    exact = count * volumes / volumes.sum()
    shares = np.floor(exact).astype(int)
    shares[np.argsort(shares - exact, kind="stable")[: count - shares.sum()]] += 1
    return shares


def _throw(rng: np.random.Generator, place: AnnularBox | Box, radius: np.ndarray, angle: float) -> np.ndarray:
    """Uniform random centres in ``place``, a radius away from its faces (not from those of the sector)."""
    u = rng.random((len(radius), 3))
    thickest = 2.0 * float(radius.max())
    if isinstance(place, Box):
        thinnest = min(place.size)
        low, high = place.lower + radius[:, None], place.upper - radius[:, None]
        found = low + u * (high - low)
    else:
        thinnest = min(place.r1 - place.r0, place.z1 - place.z0)
        inner, outer = place.r0 + radius, place.r1 - radius
        r = np.sqrt(inner**2 + u[:, 0] * (outer**2 - inner**2))
        found = np.stack([
            r * np.cos(angle * u[:, 1]), r * np.sin(angle * u[:, 1]),
            place.z0 + radius + u[:, 2] * (place.z1 - place.z0 - 2.0 * radius),
        ], axis=1)  # fmt: skip
    if thinnest < thickest:
        raise PackingError(
            f"the space is {thinnest * 1e3:.4g} mm thin, a grain is {thickest * 1e3:.4g} mm thick: none "
            "fits; lower the diameter or widen the gap"
        )
    return found


def _push_apart(position: np.ndarray, radius: np.ndarray, walls: np.ndarray, sector: CyclicSector | None) -> np.ndarray:
    smallest = 2.0 * float(radius.min())
    skin = 0.3 * smallest
    turn = np.array([1.0, 0.0] if sector is None else [math.cos(sector.angle), math.sin(sector.angle)])
    worst = math.inf
    for scale, sweeps in zip(GROWTH, SWEEPS, strict=True):
        r = scale * radius
        reference = None
        for _ in range(sweeps):
            moved = np.inf if reference is None else np.sqrt(np.max(np.sum((position - reference) ** 2, axis=1)))
            if moved > 0.5 * skin:
                if sector is not None:
                    position = sector.turn(position, sector.wraps(position))
                order = cell_order(position, 2.0 * float(radius.max()))
                position, radius, r = np.ascontiguousarray(position[order]), radius[order], r[order]
                pairs = find_pairs(position, 2.0 * float(r.max()) + skin, sector, r + 0.5 * skin)
                reference = position.copy()
            _sweep(pairs.start, pairs.other, pairs.shift, position, r, turn, 1.0)
            for _ in range(4):  # corners: one wall pushes a grain into the other
                if push_off_walls(position, r, walls) <= 1e-6 * smallest:
                    break
            worst = _sweep(pairs.start, pairs.other, pairs.shift, position, r, turn, 0.0)
            if worst < 0.9 * TOLERANCE:
                break
    if not worst < TOLERANCE:
        raise PackingError(
            f"the grains cannot be pushed apart: an overlap of {100.0 * worst:.2g} % of the diameter is left "
            f"(allowed: {100.0 * TOLERANCE:g} %); lower the number of grains, or take smaller ones where "
            "walls are only a few diameters apart",
            worst,
        )
    return position if sector is None else sector.turn(position, sector.wraps(position))


@njit(cache=True, error_model="numpy")
def _sweep(start, other, shift, position, radius, turn, push):
    """Push pairs apart by ``push`` of their overlap; returns the largest met, as a share of the diameter."""
    worst = 0.0
    for i in range(radius.shape[0]):
        for k in range(start[i], start[i + 1]):
            j = other[k]
            jx, jy = position[j, 0], position[j, 1]
            if shift[k] != 0:
                jx, jy = turn[0] * jx - turn[1] * jy, turn[1] * jx + turn[0] * jy
            dx, dy, dz = jx - position[i, 0], jy - position[i, 1], position[j, 2] - position[i, 2]
            d = np.sqrt(dx * dx + dy * dy + dz * dz)
            depth = radius[i] + radius[j] - d
            if depth <= 0.0:
                continue
            worst = max(worst, depth / (2.0 * min(radius[i], radius[j])))
            if d == 0.0:
                dx, d = 1.0, 1.0  # two on one spot: any direction parts them
            # overlapping grains move by half the overlap, never by more than a third of a radius at once
            step = min(0.5 * push * depth, 0.33 * min(radius[i], radius[j])) / d
            dx, dy, dz = step * dx, step * dy, step * dz
            position[i, 0] -= dx
            position[i, 1] -= dy
            position[i, 2] -= dz
            if shift[k] != 0:
                dx, dy = turn[0] * dx + turn[1] * dy, turn[0] * dy - turn[1] * dx
            position[j, 0] += dx
            position[j, 1] += dy
            position[j, 2] += dz
    return worst
