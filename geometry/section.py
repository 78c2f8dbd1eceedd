"""The meshed cross-section of an axisymmetric device in the half-plane (r, z), r >= 0.

Regions and boundaries are addressed by name from here on; no tag number of the mesher gets any further.
Solids follow from the section by Pappus' second theorem: V = 2 pi r_c A, r_c the centroid's radius.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from geometry.curved_edges import CurvedEdges
from geometry.named_mesh import NamedMesh
from geometry.walls import AnnularBox


@dataclass(frozen=True, slots=True, eq=False)
class SectionMesh(NamedMesh):
    """Triangles of an axisymmetric cross-section, with regions and boundaries by name.

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
    curved : CurvedEdges or None
        Edges inside the mesh that lie on curves; areas and volumes here are those of the straight triangles.

    Raises
    ------
    ValueError
        If a node has r < 0, a triangle is flat or clockwise, or the regions are not a partition.
    """

    points: np.ndarray
    triangles: np.ndarray
    regions: dict[str, np.ndarray]
    boundaries: dict[str, np.ndarray]
    curved: CurvedEdges | None = None

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 2 or self.points[:, 0].min(initial=0.0) < 0.0:
            raise ValueError("points must be an (n, 2) array of (r, z) with r >= 0")
        if self.element_area().min(initial=1.0) <= 0.0:
            raise ValueError("triangles must be counter-clockwise and not flat")
        self._check_partition(len(self.triangles))

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
        return float(self.element_area()[self.elements_of(region)].sum())

    def volume(self, region: str) -> float:
        """Volume [m^3] that a region sweeps in a full turn (Pappus; exact for straight triangles)."""
        elements = self.elements_of(region)
        return float(2.0 * np.pi * (self.element_area() * self.centroid()[:, 0])[elements].sum())

    def boundary_length(self, boundary: str) -> float:
        """Length [m] of a boundary's polyline in the section."""
        edges = self.points[self.boundaries[boundary]]
        return float(np.linalg.norm(edges[:, 1] - edges[:, 0], axis=1).sum())

    def hash(self) -> str:
        """SHA-256 (hex) of all arrays and names: equal meshes, equal hash."""
        arrays = {"points": self.points, "triangles": self.triangles}
        if self.curved is not None:
            arrays |= {"curved": self.curved.nodes, "bulge": self.curved.bulge()}
        return self._hash_with(arrays)

    def tangled(self) -> np.ndarray:
        """Triangles (k,) whose curved edges bend too much for their corners: `refine` must divide them."""
        return np.zeros(0, dtype=np.int64) if self.curved is None else self.curved.tangled(self.points, self.triangles)

    def fraction_in_boxes(self, region: str, boxes: Sequence[AnnularBox]) -> np.ndarray:
        """Fraction of each triangle's volume of revolution inside boxes that do not overlap, shape (k,), 0 to 1."""
        corners = self.points[self.triangles[self.elements_of(region)]]
        fraction = np.zeros(len(corners))
        for box in boxes:
            low, high = np.array([box.r0, box.z0]), np.array([box.r1, box.z1])
            slack = 1e-9 * (high - low)
            inside = np.all((corners >= low - slack) & (corners <= high + slack), axis=(1, 2))
            apart = np.any((corners.max(axis=1) <= low + slack) | (corners.min(axis=1) >= high - slack), axis=1)
            fraction[inside] += 1.0
            for k in np.flatnonzero(~inside & ~apart):
                fraction[k] += _moment(_clip(corners[k], low, high)) / _moment(corners[k])
        return np.minimum(fraction, 1.0)

    def write(self, path: str | Path) -> None:
        """Write the mesh as .msh of gmsh (format 2.2, metres), with regions and boundaries as physical groups.

        `geometry.section_import.read_section_mesh` reads it back. Its edges are straight.

        Raises
        ------
        ValueError
            For a file name that does not end in ``.msh``.
        OSError
            If the file cannot be written; FileNotFoundError if its folder is missing.
        """
        import meshio

        path = Path(path)
        if path.suffix != ".msh":
            raise ValueError(f"`path` = {path}: a mesh is written as .msh; change the file's ending")
        if not path.parent.is_dir():
            raise FileNotFoundError(f"cannot write {path}: there is no folder {path.parent}; create it first")
        regions = {name: self.triangles[elements] for name, elements in self.regions.items()}
        cells: list[tuple[str, np.ndarray]] = []
        tags: list[np.ndarray] = []
        names: dict[str, np.ndarray] = {}
        for kind, dim, blocks in (("line", 1, self.boundaries), ("triangle", 2, regions)):
            for tag, (name, block) in enumerate(blocks.items(), 1):
                cells.append((kind, block))
                tags.append(np.full(len(block), tag))
                names[name] = np.array([tag, dim])
        points = np.column_stack((self.points, np.zeros(len(self.points))))
        data = {"gmsh:physical": tags, "gmsh:geometrical": tags}
        meshio.Mesh(points, cells, cell_data=data, field_data=names).write(path, file_format="gmsh22", binary=False)


def _moment(polygon: np.ndarray) -> float:
    """Integral of r over a polygon (m, 2), by its absolute value: 1/(2 pi) of the volume of revolution (Pappus)."""
    if len(polygon) < 3:
        return 0.0
    (r, z), (r1, z1) = polygon.T, np.roll(polygon, -1, axis=0).T
    return abs(float(((r + r1) * (r * z1 - r1 * z)).sum())) / 6.0


def _clip(polygon: np.ndarray, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Return the part of a convex polygon inside a rectangle (Sutherland and Hodgman 1974)."""
    for axis, bound, sign in ((0, low[0], 1.0), (0, high[0], -1.0), (1, low[1], 1.0), (1, high[1], -1.0)):
        kept: list[np.ndarray] = []
        for here, following in zip(polygon, np.roll(polygon, -1, axis=0), strict=True):
            a, b = sign * (here[axis] - bound), sign * (following[axis] - bound)
            if a >= 0.0:
                kept.append(here)
            if a * b < 0.0:
                kept.append(here + (following - here) * (a / (a - b)))
        if not kept:
            return np.empty((0, 2))
        polygon = np.array(kept)
    return polygon
