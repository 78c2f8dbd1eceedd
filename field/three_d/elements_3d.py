"""Nodal finite elements on tetrahedra: numbering, fields at quadrature points, residual and tangent.

Linear or quadratic Lagrange elements; the quadratic ones are isoparametric where the mesh brings its second
order nodes (curved faces).  A node is a corner or the middle of an edge; an unknown is a node that is not
held at zero, slaves of a periodic pair sharing their master's.  The element kernels run over the elements
once, with two quadrature rules: four points where that is exact (straight, linear material, no current),
fourteen elsewhere; both have positive weights.  The forms stand in scikit-fem's notation in
`field.three_d.weak_forms`.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from geometry.mesh_3d import Mesh3D

from . import element_kernels as kernels
from .element_kernels import Pattern, Quadrature, Tetrahedra
from .quadratic_tetrahedron import (
    EDGES,
    face_shape,
    fifth_order_rule,
    second_order_rule,
    shape,
    shape_slopes,
    triangle_rule,
)

_FACE_EDGES = np.array([(0, 1), (1, 2), (0, 2)])


class Elements3D:
    """Lagrange elements of order 1 or 2 on a solid mesh.

    Parameters
    ----------
    mesh : Mesh3D
    order : int
        1 or 2.
    fixed : sequence of str
        Boundaries on which the potential is zero.
    careful : ndarray (n_elements,) of bool
        Elements that need the rule of fourteen points besides the curved ones.
    hold_one : bool
        Hold the first corner at zero as well, to fix the potential's constant.

    Attributes
    ----------
    node_points : ndarray (n_nodes, 3)
        Corners first, then the middles of edges [m].
    element_nodes : ndarray (n_elements, 4 or 10)
    master : ndarray (n_nodes,)
        The node that carries each node's value: itself, or its periodic partner.
    number : ndarray (n_nodes,)
        Unknown of each node, -1 where it is held at zero.
    n_free, n_free_corners : int
        Unknowns; those of corners come first.
    start : ndarray (n_elements + 1,)
        First quadrature point of each element.
    weight : ndarray (n_quadrature,)
        [m^3]
    quadrature_points : ndarray (n_quadrature, 3)
        [m]
    """

    def __init__(
        self,
        mesh: Mesh3D,
        order: int = 2,
        *,
        fixed: Sequence[str] = (),
        careful: np.ndarray | None = None,
        hold_one: bool = False,
    ) -> None:
        if order not in (1, 2):
            raise ValueError(f"`order` = {order} of the solid elements must be 1 or 2; 2 is the default")
        self.mesh = mesh
        self.order = order
        self.n_corners = mesh.n_corners
        tetrahedra = np.asarray(mesh.tetrahedra, dtype=np.int64)
        corner_points = np.asarray(mesh.points[: self.n_corners], dtype=float)
        self._edge_keys = np.zeros(0, dtype=np.int64)
        curved = np.zeros(len(tetrahedra), dtype=bool)
        if order == 1:
            self.element_nodes = np.ascontiguousarray(tetrahedra)
            self.node_points = np.ascontiguousarray(corner_points)
        else:
            keys, edge = np.unique(self._edge_key(tetrahedra[:, EDGES]), return_inverse=True)
            self._edge_keys = keys
            self.element_nodes = np.ascontiguousarray(
                np.concatenate((tetrahedra, self.n_corners + edge.reshape(-1, 6)), axis=1)
            )
            straight = 0.5 * (corner_points[keys // self.n_corners] + corner_points[keys % self.n_corners])
            middle = straight.copy()
            if mesh.second_order is not None:
                middle[edge.reshape(-1)] = mesh.points[mesh.second_order[:, 4:].ravel()]
            self.node_points = np.concatenate((corner_points, middle))
            length = np.linalg.norm(
                corner_points[keys // self.n_corners] - corner_points[keys % self.n_corners], axis=1
            )
            bent = np.linalg.norm(middle - straight, axis=1) > 1e-9 * length
            curved = bent[edge.reshape(-1, 6)].any(axis=1)
        self.curved = curved
        self.n_nodes = len(self.node_points)
        self._number(fixed, hold_one)
        self._prepare_quadrature(curved if careful is None else curved | careful)
        self.indptr, self.indices = self._pattern()

    def _edge_key(self, ends: np.ndarray) -> np.ndarray:
        ends = np.sort(ends, axis=-1)
        return ends[..., 0] * self.n_corners + ends[..., 1]

    def _edges(self, ends: np.ndarray) -> np.ndarray:
        """Nodes in the middle of edges given by their corners (..., 2); -1 where there is no such edge."""
        key = self._edge_key(ends)
        at = np.minimum(np.searchsorted(self._edge_keys, key), len(self._edge_keys) - 1)
        return np.where(self._edge_keys[at] == key, self.n_corners + at, -1)

    def face_nodes(self, corners: np.ndarray) -> np.ndarray:
        """Nodes (k, 3 or 6) of faces given by their corners (k, 3)."""
        corners = np.asarray(corners, dtype=np.int64)
        if self.order == 1:
            return corners
        return np.concatenate((corners, self._edges(corners[:, _FACE_EDGES])), axis=1)

    @property
    def edge_ends(self) -> np.ndarray:
        """Corners of the edges, shape (n_edges, 2), in the order of the nodes in their middles."""
        return np.column_stack((self._edge_keys // self.n_corners, self._edge_keys % self.n_corners))

    def positions(self, element: np.ndarray, local: np.ndarray) -> np.ndarray:
        """Points (k, 3) [m] at reference coordinates (k, 3) of elements (k,)."""
        return np.einsum("kn,kna->ka", shape(local, self.order), self.node_points[self.element_nodes[element]])

    def boundary(self, name: str) -> np.ndarray:
        """Nodes (k, 3 or 6) of the faces of a named boundary."""
        if name not in self.mesh.boundaries:
            raise ValueError(f"the mesh has no boundary {name!r}; it has {', '.join(sorted(self.mesh.boundaries))}")
        return self.face_nodes(self.mesh.boundaries[name])

    def _number(self, fixed: Sequence[str], hold_one: bool) -> None:
        master = np.arange(self.n_nodes)
        if self.mesh.periodic is not None:
            pairs = np.asarray(self.mesh.periodic, dtype=np.int64)
            pairs = pairs[pairs[:, 0] != pairs[:, 1]]
            master[pairs[:, 0]] = pairs[:, 1]
            if self.order == 2:
                self._pair_edges(master, pairs[:, 0])
        held = np.zeros(self.n_nodes, dtype=bool)
        for name in fixed:
            held[self.boundary(name)] = True
        held |= held[master]
        np.logical_or.at(held, master, held.copy())
        if hold_one:
            held[master[0]] = True
        self.master = master
        free = np.flatnonzero((master == np.arange(self.n_nodes)) & ~held)
        number = np.full(self.n_nodes, -1, dtype=np.int64)
        number[free] = np.arange(free.size)
        self.number = np.where(held[master], -1, number[master])
        self.n_free = int(free.size)
        self.n_free_corners = int(np.count_nonzero(free < self.n_corners))
        self.element_unknowns = np.ascontiguousarray(self.number[self.element_nodes])
        self.free_nodes = free

    def _pair_edges(self, master: np.ndarray, slaves: np.ndarray) -> None:
        """Edges on the slave's face follow the edge of the master's face between the paired corners."""
        ends = self.edge_ends
        is_slave = np.zeros(self.n_corners, dtype=bool)
        is_slave[slaves] = True
        radius = np.hypot(self.node_points[: self.n_corners, 0], self.node_points[: self.n_corners, 1])
        on_face = is_slave | (radius <= 1e-9 * radius.max())  # the axis belongs to both faces
        paired = np.flatnonzero(on_face[ends].all(axis=1) & is_slave[ends].any(axis=1))
        image = self._edges(master[ends[paired]])
        if np.any(image < 0):
            raise ValueError(f"{np.count_nonzero(image < 0)} edge(s) of the slave face have no partner on the master's")
        master[self.n_corners + paired] = image

    def _prepare_quadrature(self, careful: np.ndarray) -> None:
        low, high = second_order_rule(), fifth_order_rule()
        # both rules behind one another; an element's rule is where its points begin, and how many
        xi = np.vstack((low[0], high[0]))
        slopes = np.ascontiguousarray(shape_slopes(xi, self.order))
        n_low = len(low[1])
        count = np.where(careful, len(high[1]), n_low)
        self.start = np.concatenate(([0], np.cumsum(count))).astype(np.int64)
        self.weight = np.empty(self.start[-1])
        self.quadrature_points = np.empty((self.start[-1], 3))
        self._elements = Tetrahedra(self.node_points, self.element_nodes, self.element_unknowns)
        self._quadrature = Quadrature(slopes, np.where(careful, n_low, 0).astype(np.int64), self.start, self.weight)
        worst = kernels.measure(
            self._elements, self._quadrature, np.ascontiguousarray(shape(xi, self.order)),
            np.concatenate((low[1], high[1])), self.quadrature_points,
        )  # fmt: skip
        if worst <= 0.0:
            raise ValueError("an element of the mesh is folded: its Jacobian is not positive everywhere; refine it")

    @property
    def element_of_quadrature(self) -> np.ndarray:
        """Element of each quadrature point, shape (n_quadrature,)."""
        return np.repeat(np.arange(len(self.element_nodes)), np.diff(self.start))

    def _pattern(self) -> tuple[np.ndarray, np.ndarray]:
        unknowns = self.element_unknowns
        owner = np.repeat(np.arange(len(unknowns), dtype=np.int32), unknowns.shape[1])
        flat = unknowns.ravel()
        kept = flat >= 0
        touches = sp.csr_matrix(
            (np.ones(np.count_nonzero(kept), dtype=np.int8), (flat[kept], owner[kept])),
            shape=(self.n_free, len(unknowns)),
        )
        indptr = np.zeros(self.n_free + 1, dtype=np.int64)
        marker = np.full(self.n_free, -1, dtype=np.int64)
        kernels.count_rows(touches.indptr, touches.indices, unknowns, marker, indptr)
        np.cumsum(indptr, out=indptr)
        indices = np.empty(indptr[-1], dtype=np.int32)
        marker[:] = -1
        kernels.fill_rows(touches.indptr, touches.indices, unknowns, marker, indptr, indices)
        return indptr.astype(np.int32), indices

    def whole(self, x: np.ndarray) -> np.ndarray:
        """Potential of all nodes from that of the unknowns."""
        return np.where(self.number >= 0, x[self.number], 0.0)

    def gradient(self, phi: np.ndarray) -> np.ndarray:
        """grad phi at the quadrature points, shape (n_quadrature, 3); phi of all nodes."""
        out = np.empty((len(self.weight), 3))
        kernels.gradient(self._elements, self._quadrature, phi, out)
        return out

    def divergence(self, flow: np.ndarray) -> np.ndarray:
        """Integral of flow . grad v for every unknown's v; flow (n_quadrature, 3)."""
        out = np.zeros(self.n_free)
        kernels.divergence(self._elements, self._quadrature, np.ascontiguousarray(flow), out)
        return out

    def tangent(self, isotropic: np.ndarray, along: np.ndarray, field: np.ndarray) -> np.ndarray:
        """Data of the pattern's matrix  integral of  a grad u . grad v + c (d . grad u)(d . grad v).

        Parameters
        ----------
        isotropic, along : ndarray (n_quadrature,)
            a and c.
        field : ndarray (n_quadrature, 3)
            Any vector along d; where it is zero, c has no effect.
        """
        data, field = np.zeros(self.indices.size), np.ascontiguousarray(field)
        n = self.element_nodes.shape[1]
        scratch = np.empty((n, 3)), np.empty((n, 3)), np.empty((n, n))
        pattern = Pattern(self.indptr, self.indices)
        kernels.tangent(self._elements, self._quadrature, pattern, isotropic, along, field, scratch, data)
        return data

    def matrix(self, data: np.ndarray) -> sp.csc_matrix:
        """The symmetric matrix of the pattern's data."""
        return sp.csc_matrix((data, self.indices, self.indptr), shape=(self.n_free, self.n_free))

    def add_blocks(self, nodes: np.ndarray, blocks: np.ndarray, data: np.ndarray) -> None:
        """Add small matrices (k, n, n) between nodes (k, n) to the pattern's data."""
        kernels.scatter(self.number[nodes], np.ascontiguousarray(blocks), Pattern(self.indptr, self.indices), data)

    def faces(self, nodes: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Quadrature on faces of the mesh's surface, nodes (k, 3 or 6).

        Returns
        -------
        points : ndarray (k, q, 3)
            [m]
        normal : ndarray (k, q, 3)
            Outward normal times the weight [m^2].
        shape : ndarray (q, 3 or 6)
        """
        xi, weight = triangle_rule()
        function, slopes = face_shape(xi, self.order)
        X = self.node_points[nodes]
        points = np.einsum("qn,kna->kqa", function, X)
        tangents = np.einsum("qnd,kna->kqda", slopes, X)
        normal = np.cross(tangents[:, :, 0], tangents[:, :, 1]) * weight[:, None]
        inward = self.node_points[self._apex(nodes[:, :3])] - X[:, 0]
        normal *= -np.sign(np.einsum("ka,ka->k", normal.sum(axis=1), inward))[:, None, None]
        return points, normal, function

    def _apex(self, corners: np.ndarray) -> np.ndarray:
        """The corner opposite to each face (k, 3) in its element."""
        tetrahedra = self.element_nodes[:, :4]
        on_surface = np.zeros(self.n_corners, dtype=bool)
        on_surface[corners] = True
        element, apex = np.nonzero(on_surface[tetrahedra].sum(axis=1, keepdims=True) >= 3 + on_surface[tetrahedra])
        others = np.array([(1, 2, 3), (0, 2, 3), (0, 1, 3), (0, 1, 2)])
        faces = np.sort(tetrahedra[element[:, None], others[apex]], axis=1)
        rows, label = np.unique(np.concatenate((np.sort(corners, axis=1), faces)), axis=0, return_inverse=True)
        label = label.reshape(-1)
        opposite = np.zeros(len(rows), dtype=np.int64)
        opposite[label[len(corners) :]] = tetrahedra[element, apex]
        return opposite[label[: len(corners)]]
