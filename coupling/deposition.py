"""From grains to a solid fraction on the mesh's powder elements, conserving every cubic metre.

Each grain's volume is spread over the elements whose centroids lie within 1.5 diameters in the (r, z) section,
with the weight w(s) = (1 - s^2)^2 times the element's volume, normalised to one a grain: so sum(fill V_e) equals the
grains' volume to round-off, whatever the mesh. The section is binned (bins of a quarter diameter, or of the smallest
element if that is larger) and the weights of a bin are computed once, as one sparse matrix: a deposition is a
histogram and a sparse product.
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
        # a coarse mesh or a bin outside the region: its volume goes to the nearest element, never lost
        near = [np.asarray(e if e else [nearest[b]]) for b, e in enumerate(near)]
        element = np.concatenate(near)
        bin_index = np.repeat(np.arange(len(centre)), [len(e) for e in near])
        s2 = ((centroid[element] - centre[bin_index]) ** 2).sum(axis=1) / reach**2
        weight = np.maximum(1.0 - s2, 1e-6) ** 2 * self.volume[element]
        weight /= np.bincount(bin_index, weights=weight)[bin_index]
        self._weight = coo_array((weight, (element, bin_index)), shape=(len(centroid), len(centre))).tocsr()
        self._back = self._weight.T.tocsr()

    def _bin(self, position: np.ndarray) -> np.ndarray:
        rz = np.column_stack([np.hypot(position[:, 0], position[:, 1]), position[:, 2]])
        index = np.clip(((rz - self._low) / self._width).astype(int), 0, self._shape - 1)
        return index[:, 0] * self._shape[1] + index[:, 1]

    def fill(self, position: np.ndarray, volume: np.ndarray) -> np.ndarray:
        """Solid fraction (e,) [-] of the powder's elements from grains at (n, 3) [m] with volumes (n,) [m^3]."""
        histogram = np.bincount(self._bin(position), weights=volume, minlength=int(np.prod(self._shape)))
        return (self._weight @ histogram) / self.volume

    def at(self, position: np.ndarray, fill: np.ndarray) -> np.ndarray:
        """Solid fraction (n,) [-] that grains at (n, 3) [m] are surrounded by, given the elements' (e,)."""
        return (self._back @ fill)[self._bin(position)]
