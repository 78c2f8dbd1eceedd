"""A device, or one periodic sector of it, meshed in 3D by tetrahedra with flat or curved faces.

Regions and boundaries are addressed by name, as in `geometry.section`. A curved tetrahedron is the image of
the reference one under the quadratic map x(xi) = sum of N_i(xi) x_i over its ten nodes; its Jacobian is a
cubic polynomial, which the rule below integrates exactly.

A mesh of a sector stands for the whole machine: `n_sectors` is the number of copies (turned, or mirrored
at the planes that cut a half sector) that fill it, and integrals over the machine are that many times those
over the mesh.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from geometry.named_mesh import NamedMesh

# Edges of the tetrahedron that carry the middle nodes 4 to 9 (the order of scikit-fem's MeshTet2; that of
# gmsh has the last two in turn).
EDGES = np.array([(0, 1), (1, 2), (0, 2), (0, 3), (1, 3), (2, 3)])


@dataclass(frozen=True, slots=True, eq=False)
class Mesh3D(NamedMesh):
    """Tetrahedra of a device or of one sector of it, with regions and boundaries by name.

    Attributes
    ----------
    points : ndarray, shape (n_points, 3), float64
        Nodes [m]: first the corners, then, in a second-order mesh, the middles of the edges.
    tetrahedra : ndarray, shape (n_tetrahedra, 4), int64
        Corner nodes, positively oriented: (x1 - x0) x (x2 - x0) . (x3 - x0) > 0.
    second_order : ndarray, shape (n_tetrahedra, 10), int64, or None
        All nodes of each element: its corners as in `tetrahedra`, then the middles of the edges (0,1), (1,2),
        (0,2), (0,3), (1,3), (2,3). None: flat faces.
    regions : dict of str to ndarray, shape (k,), int64
        Element indexes in ascending order; every element is in exactly one region.
    boundaries : dict of str to ndarray, shape (k, 3), int64
        Corner triples of the faces.
    periodic : ndarray, shape (k, 2), int64, or None
        Pairs of corners (slave, master): the slave is the master turned by `sector_angle` about z.
    sector_angle : float
        Angle about z that the mesh spans [rad].
    n_sectors : int
        Copies of the mesh that make up the whole machine.

    Raises
    ------
    ValueError
        If an element is flat, inverted or folded, the regions are not a partition, an index does not exist,
        or periodic pairs do not match.
    """

    points: np.ndarray
    tetrahedra: np.ndarray
    second_order: np.ndarray | None
    regions: dict[str, np.ndarray]
    boundaries: dict[str, np.ndarray]
    periodic: np.ndarray | None = None
    sector_angle: float = 2.0 * np.pi
    n_sectors: int = 1

    def __post_init__(self) -> None:
        if self.points.ndim != 2 or self.points.shape[1] != 3 or not np.all(np.isfinite(self.points)):
            raise ValueError("points must be an (n, 3) array of finite coordinates")
        if self.tetrahedra.ndim != 2 or self.tetrahedra.shape[1] != 4:
            raise ValueError("tetrahedra must be an (m, 4) array of corner nodes")
        if self.second_order is not None and (
            self.second_order.shape != (len(self.tetrahedra), 10)
            or not np.array_equal(self.second_order[:, :4], self.tetrahedra)
        ):
            raise ValueError("second_order must be an (m, 10) array that begins with the corners of `tetrahedra`")
        self._check_indexes()
        self._check_partition(len(self.tetrahedra))
        bad = np.count_nonzero(self.jacobian().min(axis=1, initial=np.inf) <= 0.0)
        if bad:
            raise ValueError(f"{bad} of {len(self.tetrahedra)} tetrahedra are flat, inverted or folded")
        self._check_periodic()

    def _check_indexes(self) -> None:
        nodes = self.tetrahedra if self.second_order is None else self.second_order
        for what, index in {"tetrahedra": nodes, **self.boundaries}.items():
            if index.size and not 0 <= index.min() <= index.max() < len(self.points):
                raise ValueError(f"{what}: a node index lies outside 0 to {len(self.points) - 1}")
        if self.tetrahedra.size and self.tetrahedra.max() + 1 != np.unique(self.tetrahedra).size:
            raise ValueError("the corners must be the first nodes of `points`, each used by an element")

    def _check_periodic(self) -> None:
        if self.periodic is None:
            return
        slave, master = (self.points[self.periodic[:, i]] for i in range(2))
        cos, sin = np.cos(self.sector_angle), np.sin(self.sector_angle)
        turned = np.column_stack(
            (cos * master[:, 0] - sin * master[:, 1], sin * master[:, 0] + cos * master[:, 1], master[:, 2])
        )
        # The mesher copies the faces: what is left is rounding of its coordinates.
        if np.abs(turned - slave).max(initial=0.0) > 1e-8 * np.ptp(self.points, axis=0).max():
            raise ValueError(f"periodic nodes are not {np.degrees(self.sector_angle):g} degrees apart")

    @property
    def n_corners(self) -> int:
        """Number of corner nodes: ``points[:n_corners]``."""
        return int(self.tetrahedra.max(initial=-1)) + 1

    def jacobian(self) -> np.ndarray:
        """Determinant of the map from the reference element [m^3], six times the volume of a flat element.

        Shape (n_tetrahedra, k): k = 1 for flat elements; of curved ones at the five points of the cubic rule,
        then at the ten nodes, where a folded element shows first.
        """
        if self.second_order is None:
            a, b, c, d = (self.points[self.tetrahedra[:, i]] for i in range(4))
            return np.einsum("ij,ij->i", np.cross(b - a, c - a), d - a)[:, None]
        return second_order_jacobian(self.points[self.second_order])

    def element_volume(self) -> np.ndarray:
        """Volume of every element [m^3], shape (n_tetrahedra,)."""
        determinant = self.jacobian()
        if self.second_order is None:
            return determinant[:, 0] / 6.0
        return determinant[:, : len(_CUBIC_WEIGHTS)] @ _CUBIC_WEIGHTS

    def centroid(self) -> np.ndarray:
        """Mean of the four corners of every element [m], shape (n_tetrahedra, 3)."""
        return self.points[self.tetrahedra].mean(axis=1)

    def volume(self, region: str) -> float:
        """Volume [m^3] of a region of the whole machine, `n_sectors` times that of the mesh."""
        return float(self.n_sectors * self.element_volume()[self.elements_of(region)].sum())

    def hash(self) -> str:
        """SHA-256 (hex) of all arrays and names: equal meshes, equal hash."""
        arrays = {"points": self.points, "tetrahedra": self.tetrahedra}
        optional = {"second_order": self.second_order, "periodic": self.periodic}
        arrays |= {name: array for name, array in optional.items() if array is not None}
        return self._hash_with(arrays, prefix=f"{self.n_sectors} {self.sector_angle!r}")


def second_order_jacobian(nodes: np.ndarray) -> np.ndarray:
    """Jacobian of ten-node elements, nodes (m, 10, 3) [m], at the points that `Mesh3D.jacobian` lists."""
    slopes = _quadratic_slopes(np.vstack((_CUBIC_POINTS, _NODES)))
    determinant = np.empty((len(nodes), len(slopes)))
    for k, slope in enumerate(slopes):  # one point at a time keeps the memory small
        u, v, w = (np.tensordot(nodes, slope[:, i], axes=(1, 0)) for i in range(3))
        determinant[:, k] = np.einsum("ij,ij->i", np.cross(u, v), w)
    return determinant


def _quadratic_slopes(xi: np.ndarray) -> np.ndarray:
    """Derivatives of the ten quadratic shape functions at reference points (k, 3); shape (k, 10, 3)."""
    value = np.column_stack((1.0 - xi.sum(axis=1), xi))  # barycentric coordinates
    slope = np.vstack((-np.ones(3), np.eye(3)))
    corner = (4.0 * value - 1.0)[:, :, None] * slope
    i, j = EDGES.T
    middle = 4.0 * (value[:, i, None] * slope[j] + value[:, j, None] * slope[i])
    return np.concatenate((corner, middle), axis=1)


# Exact for cubics (Zienkiewicz, The Finite Element Method, table of tetrahedra): centroid and four points.
_CUBIC_POINTS = np.vstack((np.full(3, 0.25), np.full(3, 1.0 / 6.0), np.eye(3) / 3.0 + 1.0 / 6.0))
_CUBIC_WEIGHTS = np.array([-0.8, 0.45, 0.45, 0.45, 0.45]) / 6.0
_CORNERS = np.vstack((np.zeros(3), np.eye(3)))
_NODES = np.vstack((_CORNERS, _CORNERS[EDGES].mean(axis=1)))
