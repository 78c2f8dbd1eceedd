"""Full neighbour rows (every pair seen from both grains) out of the half list of `particles`.

Rows hold every pair closer than their reach at the moment when they were made. Until a grain has moved by half of what
the reach has over a cut-off, no pair within that cut-off is missing; then they must be rebuilt, see
`NeighbourRows.is_complete`. The grains' own contact list is no measure of that: it may last longer (fast rigid grains
have a wider one), it may be older than the rows, and it is renewed only after the step in which a grain went too far.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from numba import njit

from coupling.kernel_state import Rows
from particles import Periodicity, find_pairs
from particles.periodicity import images_of


@dataclass(frozen=True, slots=True)
class NeighbourRows:
    """CSR rows: grain i sees the grains `other[start[i]:start[i+1]]`, each in one of its periodic images.

    Row `image[q]` of `images` holds cosine and sine of an image's turn about z and its translation [m]; the middle one
    is the grain itself. `position` (n, 3) [m] is where the grains were when the rows were made out to `reach` [m].
    `strain` and `height` [m] are those of the periodic space then. `twin` is where each entry's pair stands in the
    other grain's row; None: not every pair does.
    """

    start: np.ndarray  # (n+1,) int64
    other: np.ndarray  # (p,) int32
    image: np.ndarray  # (p,) uint8
    images: np.ndarray  # (k, 6) float64
    position: np.ndarray  # (n, 3) float64
    reach: float
    twin: np.ndarray | None = None  # (p,) int32
    strain: float = 0.0
    height: float = 1.0

    @property
    def arrays(self) -> Rows:
        """The arrays that kernels read."""
        return Rows(self.start, self.other, self.image, self.images)

    def is_complete(self, position: np.ndarray, cutoff: float, periodicity: Periodicity | None = None) -> bool:
        """True if no pair of grains at `position` (n, 3) [m] that is closer than `cutoff` [m] can be missing.

        The grains must be in the same order, and on the same sides of the faces of periodic space, as when the rows
        were made.
        """
        spare = max(self.reach - cutoff, 0.0)
        if periodicity is not None:
            middle = 0.5 * (self.reach + cutoff)
            return periodicity.approach(position, self.position, self.strain, self.height, middle) <= spare
        moved = position - self.position
        farthest = float(np.einsum("ij,ij->i", moved, moved).max(initial=0.0))
        return farthest <= (0.5 * spare) ** 2

    def at_present(self, periodicity: Periodicity | None) -> NeighbourRows:
        """Return the rows with the images where they stand at the present time, which those of a sheared box leave."""
        images = images_of(periodicity)
        return self if np.array_equal(images, self.images) else replace(self, images=images)


def neighbour_rows(position: np.ndarray, reach: float, periodicity: Periodicity | None = None) -> NeighbourRows:
    """All neighbours of all grains closer than `reach` [m]; positions (n, 3) [m]; periodic images included.

    The order within a row is fixed by the grains' order alone, so that sums over it are reproducible.
    """
    pairs = find_pairs(position, reach, periodicity)
    images = images_of(periodicity)
    start = np.empty(len(position) + 1, dtype=np.int64)
    other, twin = np.empty((2, 2 * pairs.count), dtype=np.int32)
    image = np.empty(2 * pairs.count, dtype=np.uint8)
    fill_rows(pairs.start, pairs.other, pairs.shift, len(images) // 2, start, other, image, twin)
    sheared = (0.0, 1.0) if periodicity is None else (periodicity.strain, periodicity.height)
    return NeighbourRows(start, other, image, images, position.copy(), reach, twin, *sheared)


@njit(cache=True, error_model="numpy")
def fill_rows(half_start, half_other, shift, none, start, other, image, twin):
    """Fill full rows from half ones: of a grain first the pairs that its half row holds, then those of the others'."""
    n = half_start.shape[0] - 1
    start[:] = 0
    for q in range(half_other.shape[0]):
        start[half_other[q] + 1] += 1
    place = np.empty(n, np.int64)  # of the next pair that comes from another grain's row
    for i in range(n):
        own = half_start[i + 1] - half_start[i]
        start[i + 1] += start[i] + own
        place[i] = start[i] + own
    for i in range(n):
        first = start[i] - half_start[i]
        for q in range(half_start[i], half_start[i + 1]):
            j = np.int64(half_other[q])
            here, there = first + q, place[j]
            place[j] = there + 1
            other[here], image[here], twin[here] = j, none + shift[q], there
            other[there], image[there], twin[there] = i, none - shift[q], here
