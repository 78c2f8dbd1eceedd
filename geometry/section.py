"""The meshed cross-section of an axisymmetric device in the half-plane (r, z), r >= 0.

Regions and boundaries are addressed by name from here on; no tag number of the mesher gets any further.
Solids follow from the section by Pappus' second theorem: V = 2 pi r_c A, r_c the centroid's radius.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.mesh_hash import hash_of


@dataclass(frozen=True, slots=True, eq=False)
class SectionMesh:
    """Straight triangles of an axisymmetric cross-section, with regions and boundaries by name.

    Attributes
    ----------
    points : ndarray, shape (n_points, 2), float64
        Nodes [m], columns r and z, r >= 0 (exactly 0 on the axis).
    triangles : ndarray, shape (n_triangles, 3), int64
        Corner nodes, counter-clockwise in the (r, z) plane.
    regions : dict of str to ndarray, shape (k,), int64
        Element indexes in ascending order; every element is in exactly one region.
    boundaries : dict of str to ndarray, shape (k, 2), int64
        Node pairs of the edges.

    Raises
    ------
    ValueError
        If a node has r < 0, a triangle is flat or clockwise, or the regions are not a partition.
    """

    points: np.ndarray
    triangles: np.ndarray
    regions: dict[str, np.ndarray]
    boundaries: dict[str, np.ndarray]

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 2 or self.points[:, 0].min(initial=0.0) < 0.0:
            raise ValueError("points must be an (n, 2) array of (r, z) with r >= 0")
        if self.element_area().min(initial=1.0) <= 0.0:
            raise ValueError("triangles must be counter-clockwise and not flat")
        uses = np.zeros(len(self.triangles), dtype=np.int64)
        for elements in self.regions.values():
            np.add.at(uses, elements, 1)
        if not np.all(uses == 1):
            raise ValueError(f"{np.count_nonzero(uses != 1)} element(s) are not in exactly one region")

    def element_area(self) -> np.ndarray:
        """Signed area of every triangle [m^2], shape (n_triangles,); positive when counter-clockwise."""
        corner, second, third = (self.points[self.triangles[:, i]] for i in range(3))
        u, v = second - corner, third - corner
        return 0.5 * (u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])

    def centroid(self) -> np.ndarray:
        """Centroid (r, z) of every triangle [m], shape (n_triangles, 2)."""
        return self.points[self.triangles].mean(axis=1)

    def area(self, region: str) -> float:
        """Area of a region's section [m^2]."""
        return float(self.element_area()[self._elements(region)].sum())

    def volume(self, region: str) -> float:
        """Volume [m^3] that a region sweeps in a full turn (Pappus; exact for straight triangles)."""
        elements = self._elements(region)
        return float(2.0 * np.pi * (self.element_area() * self.centroid()[:, 0])[elements].sum())

    def region_of_element(self) -> np.ndarray:
        """Name of the region of every element, shape (n_triangles,), dtype str."""
        names = np.empty(len(self.triangles), dtype=f"<U{max(map(len, self.regions), default=1)}")
        for name, elements in self.regions.items():
            names[elements] = name
        return names

    def boundary_length(self, boundary: str) -> float:
        """Length [m] of a boundary's polyline in the section."""
        edges = self.points[self.boundaries[boundary]]
        return float(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1).sum())

    def hash(self) -> str:
        """SHA-256 (hex) of all arrays and names: equal meshes, equal hash."""
        return hash_of({"points": self.points, "triangles": self.triangles}, self.regions, self.boundaries)

    def _elements(self, region: str) -> np.ndarray:
        if region not in self.regions:
            raise KeyError(f"no region {region!r} in this mesh; it has {', '.join(sorted(self.regions))}")
        return self.regions[region]
