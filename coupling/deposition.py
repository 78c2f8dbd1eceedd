"""From grains to a solid fraction on the mesh's powder elements, conserving every cubic metre.

Each grain's volume is spread over the elements whose centroids lie within 1.5 diameters in the (r, z) section,
with the weight w(s) = (1 - s^2)^2 times the element's volume, normalised to one a grain: so sum(fill V_e) equals the
grains' volume to round-off, whatever the mesh. The section is binned (bins of a quarter diameter, or of the smallest
element if that is larger) and the weights of a bin are computed once, as one sparse matrix: a deposition is a
histogram and a sparse product.

A grain whose centre lies outside the region by more than a bin belongs to no element: it is left out of the fill (and
sees none), and `outside` names it. Put into the nearest element it would raise the permeability of a place where no
powder is.
"""

from __future__ import annotations

import numpy as np
from scipy.sparse import coo_array
from scipy.spatial import cKDTree

from geometry import SectionMesh

SPREAD = 1.5  # diameters: the powder is a continuum only over more than a grain


class FillDeposition:
    """Grains -> solid fraction an element of region `region`; and back, fraction at the grains.

    Parameters
    ----------
    mesh : SectionMesh
    diameter : float
        Largest grain's diameter [m].
    angle : float
        Angle of the simulated sector [rad], 2 pi for a full ring.
    """

    def __init__(self, mesh: SectionMesh, diameter: float, angle: float, region: str = "powder"):
        corners = mesh.points[mesh.triangles[mesh.regions[region]]]  # (e, 3, 2)
        centroid = corners.mean(axis=1)
        edge_1, edge_2 = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
        area = 0.5 * np.abs(edge_1[:, 0] * edge_2[:, 1] - edge_1[:, 1] * edge_2[:, 0])
        self.volume = area * centroid[:, 0] * angle  # Pappus
        self._low = corners.min(axis=(0, 1))
        size = corners.max(axis=(0, 1)) - self._low
        bins = np.maximum(1, np.ceil(size / (0.25 * diameter)).astype(int))
        self._shape = bins
        self._width = size / bins
        r = self._low[0] + (np.arange(bins[0]) + 0.5) * self._width[0]
        z = self._low[1] + (np.arange(bins[1]) + 0.5) * self._width[1]
        centre = np.stack(np.meshgrid(r, z, indexing="ij"), axis=-1).reshape(-1, 2)
        reach = SPREAD * diameter
        tree = cKDTree(centroid)
        near = tree.query_ball_point(centre, reach)
        nearest = tree.query(centre)[1]
        self._held = self._bins_of(corners)
        # a coarse mesh: the volume of a bin without a centroid near goes to the nearest element, never lost
        near = [np.asarray((e or [nearest[b]]) if self._held[b] else [], dtype=int) for b, e in enumerate(near)]
        element = np.concatenate(near)
        bin_index = np.repeat(np.arange(len(centre)), [len(e) for e in near])
        s2 = ((centroid[element] - centre[bin_index]) ** 2).sum(axis=1) / reach**2
        weight = np.maximum(1.0 - s2, 1e-6) ** 2 * self.volume[element]
        weight /= np.bincount(bin_index, weights=weight, minlength=len(centre))[bin_index]
        self._weight = coo_array((weight, (element, bin_index)), shape=(len(centroid), len(centre))).tocsr()
        self._back = self._weight.T.tocsr()

    def _bins_of(self, corners: np.ndarray) -> np.ndarray:
        """Bins (b,) that the region reaches into: those under the bounding box of any of its elements (e, 3, 2)."""
        first = np.clip(((corners.min(axis=1) - self._low) / self._width).astype(int), 0, self._shape - 1)
        last = np.clip(((corners.max(axis=1) - self._low) / self._width).astype(int), 0, self._shape - 1) + 1
        # each box as four steps of a two-dimensional sum: +1 where it begins, -1 where it has ended
        steps = np.zeros(self._shape + 1, dtype=int)
        for i, j, step in ((first, first, 1), (last, last, 1), (first, last, -1), (last, first, -1)):
            np.add.at(steps, (i[:, 0], j[:, 1]), step)
        return (steps.cumsum(axis=0).cumsum(axis=1)[:-1, :-1] > 0).ravel()

    def _bin(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Bin of each grain (n,), and whether it lies in the region (n,): the bin of one that does not is any."""
        rz = np.column_stack([np.hypot(position[:, 0], position[:, 1]), position[:, 2]])
        place = (rz - self._low) / self._width
        inside = np.all((place > -1.0) & (place < self._shape + 1.0), axis=1)
        index = np.clip(np.where(inside[:, None], place, 0.0).astype(int), 0, self._shape - 1)
        found = index[:, 0] * self._shape[1] + index[:, 1]
        return found, inside & self._held[found]

    def outside(self, position: np.ndarray) -> np.ndarray:
        """Which grains at (n, 3) [m] have their centre outside the region, bool (n,)."""
        return ~self._bin(position)[1]

    def fill(self, position: np.ndarray, volume: np.ndarray) -> np.ndarray:
        """Solid fraction (e,) [-] of the powder's elements from grains at (n, 3) [m] with volumes (n,) [m^3]."""
        found, inside = self._bin(position)
        histogram = np.bincount(found, weights=np.where(inside, volume, 0.0), minlength=int(np.prod(self._shape)))
        return (self._weight @ histogram) / self.volume

    def at(self, position: np.ndarray, fill: np.ndarray) -> np.ndarray:
        """Solid fraction (n,) [-] that grains at (n, 3) [m] are surrounded by, given the elements' (e,)."""
        found, inside = self._bin(position)
        return np.where(inside, (self._back @ fill)[found], 0.0)
