"""What finding neighbours costs: time a grain and a pair, and memory a grain, from 1e3 to 1e6 grains.

Four clouds of grains at random places, with a skin of a quarter of the smallest diameter: equal ones at a solid
fraction of 0.58, equal ones at 0.05, two sizes 10:1 of equal volumes at 0.6 together (about a thousand small
grains a large one, none of them in a large one), and diameters spread 10:1 with equal volumes in equal steps of
log d. The grains are sorted as DEM keeps them; `shuffled` is the same list for grains in random order.

    python tests/benchmarks/neighbour_cost.py [--most 1000000] [STATE.npz ...]    # states of scene A beside them

On one thread unless NUMBA_NUM_THREADS says otherwise. Only ratios on one machine mean something.
"""

from __future__ import annotations

import argparse
import time
import tracemalloc
from collections.abc import Callable
from pathlib import Path

import numba
import numpy as np

from particles.neighbours.neighbour_list import cell_order, find_pairs, finest_cell

RATIO = 10.0


def equal(n: int, fraction: float, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Centres (n, 3) and radii (n,) of equal grains of diameter 1."""
    return rng.random((n, 3)) * (n * np.pi / 6.0 / fraction) ** (1.0 / 3.0), np.full(n, 0.5)


def two_sizes(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Large grains on a shaken lattice at a solid fraction of 0.3, as much volume of small ones between them."""
    large = max(round(n / (1.0 + RATIO**3)), 1)
    spacing = RATIO * (np.pi / 6.0 / 0.3) ** (1.0 / 3.0)
    side = int(np.ceil(large ** (1.0 / 3.0)))
    lattice = np.stack(np.meshgrid(*3 * [np.arange(side)], indexing="ij"), axis=-1).reshape(-1, 3)[:large]
    centres = spacing * (lattice + 0.5) + 0.4 * (spacing - RATIO) * (rng.random((large, 3)) - 0.5)
    box = spacing * (lattice.max(axis=0) + 1.0)
    small: list[np.ndarray] = []
    while sum(map(len, small)) < n - large:
        place = rng.random((n, 3)) * box
        cell = np.minimum((place / spacing).astype(int), lattice.max(axis=0))
        index = (cell[:, 0] * side + cell[:, 1]) * side + cell[:, 2]
        inside = index < large  # the lattice is filled slab by slab; the last one may end early
        near = centres[np.minimum(index, large - 1)]
        small.append(place[inside & (np.linalg.norm(place - near, axis=1) > 0.5 * (RATIO + 1.0))])
    position = np.concatenate([centres, np.concatenate(small)[: n - large]])
    return position, np.repeat([0.5 * RATIO, 0.5], [large, n - large])


def spread(n: int, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
    """Diameters from 1 to 10 with equal volumes in equal steps of log d, anywhere, 0.58 of the space."""
    # number density d^-4 dd, inverted
    radius = 0.5 * (1.0 - rng.random(n) * (1.0 - RATIO**-3)) ** (-1.0 / 3.0)
    return rng.random((n, 3)) * (np.sum(4.0 / 3.0 * np.pi * radius**3) / 0.58) ** (1.0 / 3.0), radius


def best(work: Callable[[], object], seconds: float = 1.5) -> float:
    """Shortest time [s] of a call, first one apart, tried for about so many seconds."""
    work()
    shortest, until = np.inf, time.perf_counter() + seconds
    while time.perf_counter() < until:
        begin = time.perf_counter()
        work()
        shortest = min(shortest, time.perf_counter() - begin)
    return float(shortest)


def peak(work: Callable[[], object]) -> float:
    """The most bytes that stand at once during a call, its result included."""
    tracemalloc.start()
    work()
    most = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    return float(most)


def report(name: str, position: np.ndarray, radius: np.ndarray) -> None:
    """A line of the table."""
    n, reach = len(position), radius + 0.25 * float(radius.min())
    size = finest_cell(reach)
    order = cell_order(position, size)
    position, reach = np.ascontiguousarray(position[order]), reach[order]
    mixed = np.random.default_rng(0).permutation(n)
    there, far = np.ascontiguousarray(position[mixed]), reach[mixed]
    pairs = find_pairs(position, reach=reach).count
    sort, sorted_list = best(lambda: cell_order(position, size)), best(lambda: find_pairs(position, reach=reach))
    shuffled = best(lambda: find_pairs(there, reach=far))
    memory = peak(lambda: find_pairs(position, reach=reach))
    print(
        f"{name:16s}{n:9d}{pairs / n:8.2f}{sort / n * 1e9:9.1f}{sorted_list / n * 1e9:9.1f}"
        f"{(sort + sorted_list) / pairs * 1e9:10.1f}{shuffled / n * 1e9:10.1f}{memory / n:10.0f}"
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0] if __doc__ else None)
    parser.add_argument("states", nargs="*", type=Path, help="states of scene A")
    parser.add_argument("--most", type=float, default=1e6, help="grains of the largest cloud")
    asked = parser.parse_args()
    print(f"{numba.get_num_threads()} thread(s)")
    print(
        f"{'cloud':16s}{'grains':>9s}{'pairs':>8s}{'sort':>9s}{'list':>9s}{'both':>10s}{'shuffled':>10s}{'peak':>10s}"
    )
    print(
        f"{'':16s}{'':9s}{'/grain':>8s}{'ns/grain':>9s}{'ns/grain':>9s}{'ns/pair':>10s}{'ns/grain':>10s}{'B/grain':>10s}"
    )
    for path in asked.states:
        position = np.load(path)["position"] / 1e-3
        report(path.stem, position, np.full(len(position), 0.5))
    sizes = [n for n in (10**3, 10**4, 10**5, 10**6) if n <= asked.most]
    clouds: dict[str, Callable[[int, np.random.Generator], tuple[np.ndarray, np.ndarray]]] = {
        "equal, 0.58": lambda n, rng: equal(n, 0.58, rng),
        "equal, 0.05": lambda n, rng: equal(n, 0.05, rng),
        "10:1": two_sizes,
        "spread 10:1": spread,
    }
    for name, cloud in clouds.items():
        for n in sizes:
            report(name, *cloud(n, np.random.default_rng(n)))


if __name__ == "__main__":
    main()
