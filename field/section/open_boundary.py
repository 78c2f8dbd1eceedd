"""Open boundary: the air outside the mesh, exactly, as a quadratic form of psi on `outer`.

Outside there is air alone, and the field dies away.  With rho, theta the polar coordinates about a point of
the axis, the solutions of  div((1/r) grad psi) = 0  are

    v_n = (a/rho)^n sin(theta) P_n^1(cos theta) = (a/rho)^n (1 - x^2) P_n'(x),    x = cos theta, n = 1, 2, ...

(sign of P_n^1 without the Condon-Shortley phase; Jackson, Classical Electrodynamics, 3rd ed., sec. 5.5).
psi = sum of a_n v_n holds up to the smallest circle around currents and iron, so on `outer` too, whatever
its shape.  The energy of the air outside is a^T S a/2 with

    S_nm = integral over `outer` of (nu_0/r) (-dv_n/dnu) v_m ds,        nu the normal away from the mesh,

and for a trace u of the elements the greatest value of  a^T T u - a^T S a/2,  T_ni = integral over `outer`
of (nu_0/r) (-dv_n/dnu) phi_i ds,  is u^T K u/2 with  K = T^T S^-1 T: symmetric, positive semidefinite, and
exact (to the tail of the series) where u is the trace of a decaying field.  On a circle of radius a, S is
diagonal, (nu_0/a) 2 n^2 (n+1)/(2n+1), and K the Dirichlet-to-Neumann operator.  All integrals are taken over
the edges as they are, straight: the polygon is the interface, not the circle around it, and the elements keep
their order of convergence.

A mesh of the upper half of a device that is its own mirror image, its currents too, names the plane between `mirror`:
the field stands at right angles to it, dpsi/dz = 0, the natural condition.  `outer` then ends on that plane, which
holds the origin of the multipoles, and of these only the odd ones, even in z, are there.

References: D. Givoli, Numerical Methods for Problems in Infinite Domains, 1992 (Dirichlet-to-Neumann);
J. Jirousek and A. Venkatesh, Int. J. Numer. Methods Eng. 35, 1992 (hybrid Trefftz elements).
"""

from __future__ import annotations

import math
from typing import Protocol

import numpy as np

from field.laws.reluctivity import NU_0
from geometry.section import SectionMesh

# Remainder of a mode's energy, relative to the greatest, that is round-off.
_NEGLIGIBLE = 1e-12
# The tail of the series falls like (reach/radius)^n.
_MAX_REACH = 0.95
_TAIL = 1e-12
_FEWEST_MODES = 16
# A distance from the axis that is one of rounding, relative to the radius of the boundary.
_ON_AXIS = 1e-9


class Elements(Protocol):
    """Data of the finite elements for the operator."""

    mesh: SectionMesh
    order: int
    dof_points: np.ndarray
    element_dofs: np.ndarray


class OpenBoundary:
    """The air outside `outer`.

    Parameters
    ----------
    elements : SectionElements
        Lagrange elements of any order; `outer` is one line from axis to axis that every ray from the middle
        of its two ends on the axis meets once (a half-circle, a half-ellipse, a rectangle); where the mesh has
        a boundary `mirror`, the upper half of such a line.
    modes : int or None
        Largest n of the modes; None: as many modes as unknowns on `outer`, or less where the rest is below 1e-12.

    Attributes
    ----------
    dofs : ndarray (k,), int64
        Unknowns on `outer`, those on the axis excepted.
    matrix : ndarray (k, k)
        K, in the units of the elements' integral of (nu/r) grad u . grad v dr dz.
    uniform_load : ndarray (k,)
        Load of a uniform axial flux density of 1 T imposed from far away, psi_0 = r^2/2:
        integral of (nu_0/r) dpsi_0/dnu phi_i ds + K psi_0, since the operator acts on psi - psi_0.
    centre, radius : float
        z of the origin of the multipoles, and the mesh's least reach around it [m].

    Raises
    ------
    ValueError
        `outer` is missing, is not such a line, or anything but air comes too close to it.
    """

    def __init__(self, elements: Elements, modes: int | None = None) -> None:
        mesh = elements.mesh
        edges, self.centre = _outline(mesh)
        self._stride = 2 if "mirror" in mesh.boundaries else 1
        dofs, position = _edge_dofs(elements, edges)
        number, column = np.unique(dofs, return_inverse=True)
        column = column.reshape(dofs.shape)
        inside = elements.dof_points[number, 0] > _ON_AXIS * mesh.points[:, 0].max()
        self.dofs = number[inside].astype(np.int64)
        self.radius = _distance(mesh.points[edges], self.centre)
        n_modes = modes or min(
            self._stride * self.dofs.size, _modes_that_matter(_reach(mesh, self.centre, self.radius))
        )

        start, end = mesh.points[edges[:, 0]], mesh.points[edges[:, 1]]
        # enough points for the product of the two finest modes over the edge of the widest angle
        widest = np.abs(np.diff(_angle(mesh.points[edges], self.centre), axis=1)).max()
        node, weight = np.polynomial.legendre.leggauss(8 + math.ceil(n_modes * widest))
        node, weight = 0.5 * (1.0 + node), 0.5 * weight
        where = start[:, None] + (end - start)[:, None] * node[:, None]
        # from the lower end of the axis upwards, the normal away from the mesh is on the right
        area = np.column_stack((end[:, 1] - start[:, 1], start[:, 0] - end[:, 0]))  # nu ds

        value, flux = self._modes(where, area, n_modes)
        shape = weight[:, None] * _lagrange(position, node)
        # einsum, not BLAS: sums in an order that does not depend on the number of threads
        S = np.einsum("neq,meq->nm", flux * weight, value)
        local = np.einsum("neq,qi->nei", flux, shape)
        gather = np.zeros((number.size, len(S)))
        np.add.at(gather, column.ravel(), local.reshape(len(S), -1).T)
        root = _inverse_root(0.5 * (S + S.T))
        half = np.einsum("mn,kn->mk", root, gather[inside])
        self.matrix = np.einsum("mk,ml->kl", half, half)
        self._amplitudes = np.einsum("mn,mk->nk", root, half)
        imposed = np.einsum("neq,eq->n", flux * weight, 0.5 * where[..., 0] ** 2)
        through = np.zeros(number.size)
        np.add.at(through, column, NU_0 * area[:, :1] * shape.sum(axis=0))
        self.uniform_load = through[inside] + np.einsum("nk,n->k", self._amplitudes, imposed)

    def force(self, psi: np.ndarray) -> np.ndarray:
        """K psi (k,) on `dofs`, psi (n_dofs,) of all unknowns: the derivative of `energy`."""
        return np.einsum("kl,l->k", self.matrix, psi[self.dofs])

    def energy(self, psi: np.ndarray) -> float:
        """Energy of the air outside over 2 pi, psi (n_dofs,) of all unknowns [J/rad]."""
        return float(0.5 * (psi[self.dofs] * self.force(psi)).sum())

    def flux_density(self, psi: np.ndarray, points: np.ndarray) -> np.ndarray:
        """B_r, B_z [T], shape (m, 2), of psi (n_dofs,) at points (r, z) [m] outside the mesh, shape (m, 2)."""
        amplitude = np.einsum("nk,k->n", self._amplitudes, psi[self.dofs])
        last = self._stride * amplitude.size
        points = np.atleast_2d(np.asarray(points, dtype=float))[:, None]
        # B_z = (1/r) dpsi/dr, B_r = -(1/r) dpsi/dz: fluxes through unit areas along r and along -z
        through = [
            -np.tensordot(amplitude, self._modes(points, np.full((len(points), 2), along), last)[1], 1)
            for along in ((0.0, -1.0), (1.0, 0.0))
        ]
        return np.column_stack([flux[:, 0] / NU_0 for flux in through])

    def _modes(self, where: np.ndarray, area: np.ndarray, n_modes: int) -> tuple[np.ndarray, np.ndarray]:
        """v_n and -(nu_0/r) dv_n/dnu ds, shape (k, e, q), at points (e, q, 2) with nu ds (e, 2), n up to n_modes.

        d/dx (1 - x^2) P_n' = -n (n + 1) P_n makes every term finite on the axis: with (1 - x^2) P_n' =
        n (P_(n-1) - x P_n) the gradient over r is (a/rho)^n n/rho^2 times -(1 - x^2) P_n'/sin(theta) along
        rho and (n + 1) P_n along theta.  Scaled so that S is the unit matrix on a circle of radius a.
        """
        r, z = where[..., 0], where[..., 1] - self.centre
        rho = np.hypot(r, z)
        x, sine = z / rho, r / rho
        along_rho = area[:, None, 0] * sine + area[:, None, 1] * x
        along_theta = area[:, None, 0] * x - area[:, None, 1] * sine
        value, flux = np.empty((2, -(-n_modes // self._stride), *r.shape))
        before, here = np.ones_like(x), x  # P_0, P_1
        decay = np.ones_like(x)
        for n in range(1, n_modes + 1):
            decay = decay * (self.radius / rho)
            if (n - 1) % self._stride:
                before, here = here, ((2 * n + 1) * x * here - n * before) / (n + 1)
                continue
            scaled = math.sqrt((2 * n + 1) * self.radius / (NU_0 * 2.0 * n * n * (n + 1))) * decay
            derivative = n * (before - x * here)
            k = (n - 1) // self._stride
            value[k] = scaled * derivative
            over_sine = derivative / np.where(sine > 0.0, sine, 1.0)
            flux[k] = NU_0 * n * scaled / rho**2 * (over_sine * along_rho - (n + 1) * here * along_theta)
            before, here = here, ((2 * n + 1) * x * here - n * before) / (n + 1)
        return value, flux


def check_reach(mesh: SectionMesh) -> None:
    """Refuse a mesh that an open boundary cannot close, as `OpenBoundary` does, without its integrals.

    Raises
    ------
    ValueError
    """
    edges, centre = _outline(mesh)
    _reach(mesh, centre, _distance(mesh.points[edges], centre))


def _angle(points: np.ndarray, centre: float) -> np.ndarray:
    """theta of points (..., 2) about the centre, 0 on the upper axis."""
    return np.arctan2(points[..., 0], points[..., 1] - centre)


def _outline(mesh: SectionMesh) -> tuple[np.ndarray, float]:
    """Edges of `outer` (e, 2) from the lower end of the axis (or the mirror) to the upper, and z of the origin."""
    if "outer" not in mesh.boundaries:
        raise ValueError(f"the mesh has no boundary 'outer'; it has {', '.join(sorted(mesh.boundaries))}")
    edges = np.asarray(mesh.boundaries["outer"], dtype=np.int64)
    nodes, uses = np.unique(edges, return_counts=True)
    ends = nodes[uses == 1]
    reach = mesh.points[:, 0].max()
    on_axis = mesh.points[ends, 0] <= _ON_AXIS * reach
    mirror = mesh.boundaries.get("mirror")
    on_mirror = np.zeros(ends.size, dtype=bool) if mirror is None else np.isin(ends, mirror) & ~on_axis
    due = (2, 0) if mirror is None else (1, 1)
    if ends.size != 2 or (on_axis.sum(), on_mirror.sum()) != due or np.any(uses > 2):
        where = "from the axis to the axis" if mirror is None else "from the plane 'mirror' to the axis"
        raise ValueError(
            f"the open boundary needs `outer` to be one line {where}; it has "
            f"{ends.size} ends; mesh the whole half-plane section, or take `open_boundary` = false"
        )
    centre = float(mesh.points[ends if mirror is None else ends[on_mirror], 1].mean())
    theta = _angle(mesh.points[edges], centre)
    edges = np.where((theta[:, :1] > theta[:, 1:]), edges, edges[:, ::-1])
    edges = edges[np.argsort(-theta.max(axis=1))]
    if np.any(edges[1:, 0] != edges[:-1, 1]) or np.any(theta[:, 0] == theta[:, 1]):
        raise ValueError(
            f"the open boundary needs an `outer` that every ray from (r, z) = (0, {centre:g} m) meets once; "
            "give the air a half-disc or a rectangle, or take `open_boundary` = false"
        )
    return edges, centre


def _distance(edges: np.ndarray, centre: float) -> float:
    """Least distance of edges (e, 2, 2) from a point of the axis [m]."""
    start, along = edges[:, 0] - (0.0, centre), edges[:, 1] - edges[:, 0]
    foot = np.clip(-(start * along).sum(axis=1) / (along**2).sum(axis=1), 0.0, 1.0)
    return float(np.linalg.norm(start + foot[:, None] * along, axis=1).min())


def _reach(mesh: SectionMesh, centre: float, radius: float) -> float:
    """Largest distance from the centre of anything but air, over `radius`, beyond which the multipoles converge."""
    largest = 0.0
    for name, elements in mesh.regions.items():
        if name == "air":
            continue
        points = mesh.points[mesh.triangles[elements].ravel()]
        reach = float(np.hypot(points[:, 0], points[:, 1] - centre).max())
        if reach > _MAX_REACH * radius:
            raise ValueError(
                f"region {name!r} reaches {1e3 * reach:.4g} mm from (r, z) = (0, {1e3 * centre:.4g} mm), the open "
                f"boundary is {1e3 * radius:.4g} mm away; it allows at most {_MAX_REACH:g} of that: "
                "enlarge the air (`air_factor`, or in a finished mesh), or take `open_boundary` = false"
            )
        largest = max(largest, reach / radius)
    return largest


def _modes_that_matter(reach: float) -> int:
    """Modes until reach^n, the size of the rest, is below the tail that is left out."""
    return max(_FEWEST_MODES, math.ceil(math.log(_TAIL) / math.log(max(reach, 1e-3))))


def _edge_dofs(elements: Elements, edges: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Unknowns on each edge (e, order + 1) from its start to its end, and where they lie, 0 to 1."""
    points, triangles = elements.mesh.points, elements.mesh.triangles
    sides = np.sort(triangles[:, [[0, 1], [1, 2], [2, 0]]], axis=2).reshape(-1, 2)
    key, ends = sides[:, 0] * len(points) + sides[:, 1], np.sort(edges, axis=1)
    order = np.argsort(key)
    owner = order[np.searchsorted(key[order], ends[:, 0] * len(points) + ends[:, 1])] // 3
    dofs = elements.element_dofs[owner]
    start, along = points[edges[:, 0]], points[edges[:, 1]] - points[edges[:, 0]]
    offset = elements.dof_points[dofs] - start[:, None]
    square = (along**2).sum(axis=1)[:, None]
    position = (offset * along[:, None]).sum(axis=2) / square
    distance = np.abs(offset[..., 0] * along[:, None, 1] - offset[..., 1] * along[:, None, 0]) / square
    # those on the edge, in the order along it
    rank = np.argsort(np.where(distance < 1e-6, position, np.inf), axis=1)[:, : elements.order + 1]
    return np.take_along_axis(dofs, rank, axis=1), np.take_along_axis(position, rank, axis=1)[0]


def _lagrange(nodes: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Lagrange polynomials of the nodes (n,) at x (q,), shape (q, n)."""
    others = [np.delete(nodes, i) for i in range(nodes.size)]
    return np.column_stack(
        [np.prod((x[:, None] - other) / (node - other), axis=1) for node, other in zip(nodes, others, strict=True)]
    )


def _inverse_root(S: np.ndarray) -> np.ndarray:
    """R (m, n) with R^T R = S^-1 on the combinations of modes that the boundary can distinguish.

    Gram and Schmidt's procedure with the largest remainder first (Cholesky with pivots): ends where what is
    left of every mode is round-off, as happens on outlines that are far from round.
    """
    left, combination = S.copy(), np.eye(len(S))
    rows = []
    for _ in range(len(S)):
        largest = int(np.argmax(np.diagonal(left)))
        size = left[largest, largest]
        if size <= _NEGLIGIBLE * S.diagonal().max():
            break
        along = left[:, largest] / math.sqrt(size)
        rows.append(combination[largest] / math.sqrt(size))
        left -= along[:, None] * along
        combination -= along[:, None] * rows[-1]
    return np.array(rows)
