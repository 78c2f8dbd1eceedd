"""Nodal finite elements on tetrahedra by scikit-fem, their unknowns and boundaries.

Linear or quadratic Lagrange elements; the quadratic ones are isoparametric where the mesh brings its second
order nodes (curved faces).  A node is a corner or the middle of an edge; an unknown is a node that is not
fixed at zero, slaves of a periodic pair sharing their master's.  Two quadrature rules, both with positive weights:
four points where that is exact (straight, linear material, no current), fourteen, exact for quintics, elsewhere.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from field.sparse_pattern import FixedPattern
from geometry.mesh_3d import Mesh3D

_SIMPLE_RULE, _FACE_RULE = 2, 6  # orders of scikit-fem's rules


class Elements3D:
    """Lagrange elements of order 1 or 2 on a solid mesh.

    Parameters
    ----------
    mesh : Mesh3D
    order : int
        1 or 2.
    fixed : sequence of str
        Boundaries on which the potential is zero.
    group : ndarray (n_elements,) of int or None
        Elements with the same number share a basis and a rule; None: all of them.
    careful : ndarray (n_elements,) of bool or None
        Elements that need the rule of fourteen points besides the curved ones.
    fix_one : bool
        Hold the first corner at zero as well, to fix the potential's constant.

    Attributes
    ----------
    solid : skfem.MeshTet or skfem.MeshTet2
    bases : list of skfem.CellBasis
        Together they hold every element once; arrays over quadrature points follow their order.
    groups : list of int
        The group of each basis.
    node_points : ndarray (n_nodes, 3)
        Corners first, then the middles of edges [m].
    element_nodes : ndarray (n_elements, 4 or 10)
    curved : ndarray (n_elements,) of bool
    master : ndarray (n_nodes,)
        The node that carries each node's value: itself, or its periodic partner.
    number : ndarray (n_nodes,)
        Unknown of each node, -1 where it is fixed at zero.
    free_nodes : ndarray (n_free,)
        Node of each unknown; those of corners come first.
    pattern : FixedPattern
        Of the matrices of the unknowns.
    element_of_quadrature : ndarray (n_quadrature,)
        Element of each quadrature point.
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
        group: np.ndarray | None = None,
        careful: np.ndarray | None = None,
        fix_one: bool = False,
    ) -> None:
        import skfem  # here, because importing it costs a third of a second

        if order not in (1, 2):
            raise ValueError(f"`order` = {order} of the solid elements must be 1 or 2; 2 is the default")
        self.mesh = mesh
        self.order = order
        self.n_corners = mesh.n_corners
        corners = np.ascontiguousarray(mesh.points[: self.n_corners].T, dtype=float)
        self.solid: Any = skfem.MeshTet(corners, np.ascontiguousarray(mesh.tetrahedra.T))
        self.element: Any = (skfem.ElementTetP1, skfem.ElementTetP2)[order - 1]()
        self.curved = np.zeros(len(mesh.tetrahedra), dtype=bool)
        if order == 2:
            self._bend(skfem.MeshTet2.from_mesh(self.solid))
        self.node_points = np.ascontiguousarray(self.solid.doflocs.T)
        self.element_nodes = np.ascontiguousarray(self.solid.dofs.element_dofs.T.astype(np.int64))
        self.n_nodes = len(self.node_points)
        self._number(fixed, fix_one)
        self._integrate(
            np.zeros(len(self.curved), dtype=np.int64) if group is None else group,
            self.curved if careful is None else self.curved | careful,
        )

    def _bend(self, solid: Any) -> None:
        """Take the mesh's middles of edges, where it has them."""
        mesh, edges = self.mesh, solid.dofs.element_dofs[4:]
        if mesh.second_order is not None:
            straight = solid.doflocs.copy()
            solid.doflocs[:, edges] = mesh.points[mesh.second_order[:, 4:]].transpose(2, 1, 0)
            bulge = np.linalg.norm(solid.doflocs - straight, axis=0)
            length = np.linalg.norm(np.diff(solid.p[:, solid.edges], axis=1)[:, 0], axis=0)
            self.curved = np.any(bulge[edges] > 1e-9 * length[edges - self.n_corners], axis=0)
        self.solid = solid

    @property
    def edge_ends(self) -> np.ndarray:
        """Corners of the edges, shape (n_edges, 2), in the order of the nodes in their middles."""
        return self.solid.edges.T

    def facets(self, name: str) -> np.ndarray:
        """Numbers (k,) of the faces of a named boundary among those of `solid`."""
        if name not in self.mesh.boundaries:
            raise ValueError(f"the mesh has no boundary {name!r}; it has {', '.join(sorted(self.mesh.boundaries))}")
        return _positions(self.solid.facets, self.mesh.boundaries[name].T)

    def reference(self, local: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Shape functions (k, n) and their slopes (k, n, 3) at reference coordinates (k, 3)."""
        parts = [self.element.lbasis(np.ascontiguousarray(local.T), i) for i in range(self.element_nodes.shape[1])]
        value = np.column_stack([np.broadcast_to(one, len(local)) for one, _ in parts])
        return value, np.stack([np.broadcast_to(slope, (3, len(local))).T for _, slope in parts], axis=1)

    def positions(self, element: np.ndarray, local: np.ndarray) -> np.ndarray:
        """Points (k, 3) [m] at reference coordinates (k, 3) of elements (k,)."""
        return np.einsum("kn,kna->ka", self.reference(local)[0], self.node_points[self.element_nodes[element]])

    def _number(self, fixed: Sequence[str], fix_one: bool) -> None:
        master = np.arange(self.n_nodes)
        if self.mesh.periodic is not None:
            pairs = np.asarray(self.mesh.periodic, dtype=np.int64)
            pairs = pairs[pairs[:, 0] != pairs[:, 1]]
            master[pairs[:, 0]] = pairs[:, 1]
            if self.order == 2:
                self._pair_edges(master, pairs[:, 0])
        constrained = np.zeros(self.n_nodes, dtype=bool)
        for name in fixed:
            constrained[self.solid.dofs.get_facet_dofs(self.facets(name)).flatten()] = True
        constrained |= constrained[master]
        np.logical_or.at(constrained, master, constrained.copy())
        if fix_one:
            constrained[master[0]] = True
        self.master = master
        self.free_nodes = np.flatnonzero((master == np.arange(self.n_nodes)) & ~constrained)
        self.n_free = self.free_nodes.size
        self.n_free_corners = int(np.count_nonzero(self.free_nodes < self.n_corners))
        number = np.full(self.n_nodes, -1, dtype=np.int64)
        number[self.free_nodes] = np.arange(self.n_free)
        self.number = number[master]
        self.pattern = FixedPattern(master[self.element_nodes], self.free_nodes, self.n_nodes)

    def _pair_edges(self, master: np.ndarray, slaves: np.ndarray) -> None:
        """Edges on the slave's face follow the edge of the master's face between the paired corners."""
        ends = self.edge_ends
        is_slave = np.zeros(self.n_corners, dtype=bool)
        is_slave[slaves] = True
        radius = np.hypot(*self.node_points[: self.n_corners, :2].T)
        on_face = is_slave | (radius <= 1e-9 * radius.max())  # the axis belongs to both faces
        paired = np.flatnonzero(on_face[ends].all(axis=1) & is_slave[ends].any(axis=1))
        image = _positions(self.solid.edges, master[ends[paired]].T)
        if np.any(image < 0):
            raise ValueError(f"{np.count_nonzero(image < 0)} edge(s) of the slave face have no partner on the master's")
        master[self.n_corners + paired] = self.n_corners + image

    def _integrate(self, group: np.ndarray, careful: np.ndarray) -> None:
        import skfem

        self.bases: list[Any] = []
        self.groups: list[int] = []
        simple = skfem.quadrature.get_quadrature(self.element, _SIMPLE_RULE)
        for number in np.unique(group):
            for rule, selected in ((simple, ~careful), (_fifth_order_rule(), careful)):
                elements = np.flatnonzero((group == number) & selected)
                if elements.size:
                    options = {"dofs": self.solid.dofs, "disable_doflocs": True, "elements": elements}
                    self.bases.append(skfem.CellBasis(self.solid, self.element, quadrature=rule, **options))
                    self.groups.append(int(number))
        self.element_of_quadrature = np.concatenate([np.repeat(b.tind, b.dx.shape[1]) for b in self.bases])
        self.weight = np.concatenate([b.dx.ravel() for b in self.bases])
        self.quadrature_points = np.concatenate([rows(b.global_coordinates()) for b in self.bases])

    def expand(self, x: np.ndarray) -> np.ndarray:
        """Potential of all nodes from that of the unknowns."""
        return np.where(self.number >= 0, x[self.number], 0.0)

    def restrict(self, load: np.ndarray) -> np.ndarray:
        """Load of the unknowns (n_free,) from that of all nodes."""
        constrained = self.number < 0
        return np.bincount(self.number[~constrained], load[~constrained], self.n_free)

    def split(self, values: np.ndarray) -> list[np.ndarray]:
        """Vectors (n_quadrature, 3) by basis, each as (3, n_elements, n_points)."""
        ends = np.cumsum([b.dx.size for b in self.bases])[:-1]
        return [
            np.ascontiguousarray(part.T).reshape(3, *b.dx.shape)
            for b, part in zip(self.bases, np.split(values, ends), strict=True)
        ]

    def gradient(self, phi: np.ndarray) -> np.ndarray:
        """grad phi at the quadrature points, shape (n_quadrature, 3); phi of all nodes."""
        return np.concatenate([rows(b.interpolate(phi).grad) for b in self.bases])

    def divergence(self, flow: np.ndarray) -> np.ndarray:
        """Integral of flow . grad v for every unknown's v; flow (n_quadrature, 3)."""
        from . import weak_forms

        parts = zip(self.bases, self.split(flow), strict=True)
        return self.restrict(sum(weak_forms.divergence.assemble(b, flow=part) for b, part in parts))

    def faces(self, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
        """Quadrature on a named boundary on the mesh's surface.

        Returns
        -------
        nodes : ndarray (k, 3 or 6)
            Of the faces.
        points : ndarray (k, q, 3)
            [m]
        normal : ndarray (k, q, 3)
            Outward normal times the weight [m^2].
        shape : ndarray (q, 3 or 6)
        """
        import skfem

        facet = self.facets(name)
        nodes = self.solid.facets[:, facet].T
        triangle: Any = (skfem.ElementTriP1, skfem.ElementTriP2)[self.order - 1]()
        if self.order == 2:
            nodes = np.concatenate((nodes, self.solid.dofs.edge_dofs[0, self.solid.f2e[:, facet]].T), axis=1)
        xi, weight = skfem.quadrature.get_quadrature(triangle, _FACE_RULE)
        parts = [triangle.lbasis(xi, i) for i in range(nodes.shape[1])]
        function = np.column_stack([value for value, _ in parts])
        slopes = np.stack([np.broadcast_to(slope, xi.shape).T for _, slope in parts], axis=1)
        X = self.node_points[nodes]
        points = np.einsum("qn,kna->kqa", function, X)
        tangents = np.einsum("qnd,kna->kqda", slopes, X)
        normal = np.cross(tangents[:, :, 0], tangents[:, :, 1]) * weight[:, None]
        middle = self.solid.p[:, self.solid.t[:, self.solid.f2t[0, facet]]].mean(axis=1).T
        inward = middle - X[:, :3].mean(axis=1)
        normal *= -np.sign(np.einsum("ka,ka->k", normal.sum(axis=1), inward))[:, None, None]
        return nodes, points, normal, function


def _fifth_order_rule() -> tuple[np.ndarray, np.ndarray]:
    """Fourteen points (3, 14), exact for quintics (Walkington 2000), and their weights.

    All lie inside, where scikit-fem's rules of order 5 and 6 have some on faces: there current and source jump.
    """
    orbits = [
        np.where(np.eye(4, dtype=bool), 1.0 - 3.0 * a, a) for a in (0.31088591926330060980, 0.092735250310891226402)
    ]
    pairs = np.array([(i, j) for j in range(4) for i in range(j)])
    edges = np.full((6, 4), 0.045503704125649649492)
    np.put_along_axis(edges, pairs, 0.5 - edges[:, :2], axis=1)
    weights = np.repeat((0.018781320953002641800, 0.012248840519393658257, 0.0070910034628469110730), (4, 4, 6))
    return np.ascontiguousarray(np.vstack((*orbits, edges))[:, 1:].T), weights


def rows(vectors: np.ndarray) -> np.ndarray:
    """Vectors (3, n_elements, n_points), as scikit-fem has them, one a row."""
    return np.ascontiguousarray(np.asarray(vectors).reshape(3, -1).T)


def _positions(known: np.ndarray, given: np.ndarray) -> np.ndarray:
    """Column of `known` (n, m), each in ascending order, with the same corners as each of `given` (n, k); -1: none."""
    base = int(known.max()) + 1
    key, target = (
        sum(part.astype(np.int64) * base**i for i, part in enumerate(c)) for c in (known, np.sort(given, 0))
    )
    order = np.argsort(key)
    at = order[np.minimum(np.searchsorted(key, target, sorter=order), len(key) - 1)]
    return np.where(key[at] == target, at, -1)
