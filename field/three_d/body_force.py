"""Force and torque on a body in air: Maxwell's stress over a shell, and virtual work.

With a weight gamma that is 1 on the body and 0 on everything else that is magnetic or carries current,

    F = - integral of T . grad gamma,      M = - integral of r x (T . grad gamma),
    T = mu_0 (H H - H^2/2),

over the air between.  It is the surface integral of T averaged over all shells (Henrotte, Deliege and Hameyer,
COMPEL 23 (2004)) and, whatever gamma, the exact derivative of the discrete co-energy at fixed potential when
the mesh moves with gamma (Coulomb, IEEE Trans. Magn. 19 (1983)): Maxwell's stress and virtual work differ in
gamma alone.  Here gamma falls evenly over the whole air gap for the stress, and within the one layer of
elements around the body for the virtual work; the two agree to the error of the discretisation, and their
difference is given as its estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from scipy.sparse.csgraph import dijkstra

from field.laws.reluctivity import MU_0, LinearLaw

if TYPE_CHECKING:
    from .field_3d import Field3D
    from .scalar_potential import Problem3D


@dataclass(frozen=True, slots=True)
class BodyForce:
    """Force and torque of the field on a body of the whole machine.

    Attributes
    ----------
    force, torque : ndarray (3,)
        By Maxwell's stress, torque about the origin [N], [N m].  Of a sector only the axial components differ
        from zero, of a mirrored half sector only the axial force.
    virtual_force, virtual_torque : ndarray (3,)
        By virtual work.
    """

    force: np.ndarray
    torque: np.ndarray
    virtual_force: np.ndarray
    virtual_torque: np.ndarray

    @property
    def force_error(self) -> float:
        """Estimate of the discretisation's error [N]."""
        return float(np.linalg.norm(self.force - self.virtual_force))

    @property
    def torque_error(self) -> float:
        """Estimate of the discretisation's error [N m]."""
        return float(np.linalg.norm(self.torque - self.virtual_torque))


def body_force(field: Field3D, body: str) -> BodyForce:
    """Force and torque on the region `body`, which must stand in air on all sides.

    Raises
    ------
    ValueError
        No such region, or one that touches another magnetic region or a current.
    """
    near, wide = shell_weights(field.problem, body)
    force, torque = _shell_integral(field, wide)
    virtual_force, virtual_torque = _shell_integral(field, near)
    return BodyForce(force, torque, virtual_force, virtual_torque)


def current_force(field: Field3D) -> tuple[np.ndarray, np.ndarray]:
    """Force [N] and torque [N m] on the source's current, integrals of J x B and r x (J x B)."""
    elements = field.problem.elements
    owner = elements.element_of_quadrature
    chosen = np.flatnonzero(field.problem.carries_current[owner])
    points = elements.quadrature_points[chosen]
    J = field.ampere_turns * field.problem.source.current_density(points)
    density = np.cross(J, field.B_at_quadrature[chosen]) * elements.weight[chosen, None]
    return _of_machine(field, density.sum(axis=0), np.cross(points, density).sum(axis=0))


def shell_weights(problem: Problem3D, body: str) -> tuple[np.ndarray, np.ndarray]:
    """gamma at all nodes, falling within one layer of elements and over the whole air; each (n_nodes,)."""
    mesh, elements = problem.mesh, problem.elements
    if body not in mesh.regions:
        raise ValueError(f"the mesh has no region {body!r}; it has {', '.join(sorted(mesh.regions))}")
    is_air = ~problem.carries_current
    for name, region in mesh.regions.items():
        law = problem.laws[name]
        if not (isinstance(law, LinearLaw) and law.mu_r == 1.0):
            is_air[region] = False
    in_body = np.zeros(len(mesh.tetrahedra), dtype=bool)
    in_body[mesh.regions[body]] = True
    corners = elements.master[mesh.tetrahedra]  # periodic partners count as one corner
    ours, others = np.zeros(elements.n_nodes, dtype=bool), np.zeros(elements.n_nodes, dtype=bool)
    ours[corners[in_body]] = True
    others[corners[~is_air & ~in_body]] = True
    if np.any(ours & others):
        touching = sorted(
            name
            for name, region in mesh.regions.items()
            if name != body and not is_air[region].all() and ours[corners[region]].any()
        )
        raise ValueError(
            f"region {body!r} touches {', '.join(touching)}: the force on a body needs air (at least one layer of "
            "elements) between it and everything else that is magnetic or carries current"
        )
    if "outer" in mesh.boundaries:
        others[elements.master[mesh.boundaries["outer"]]] = True
        others &= ~ours
    near = ours.astype(float)
    shell = corners[is_air & ~in_body]
    pairs = np.concatenate([shell[:, [i, j]] for i in range(4) for j in range(i)])
    graph = sp.csr_matrix(
        (np.ones(len(pairs), dtype=np.int8), (pairs[:, 0], pairs[:, 1])), shape=(elements.n_nodes,) * 2
    )
    from_body, from_others = (
        dijkstra(graph, directed=False, indices=np.flatnonzero(start), unweighted=True, min_only=True)
        for start in (ours, others)
    )
    # corners that see only the body stay with it; isolated ones are inside a region
    reached = np.isfinite(from_body) & np.isfinite(from_others)
    wide = np.where(np.isfinite(from_body), 1.0, 0.0)
    wide[reached] = from_others[reached] / np.maximum(from_body[reached] + from_others[reached], 1.0)
    wide[others], wide[ours] = 0.0, 1.0
    return _spread(problem, near), _spread(problem, wide)


def _spread(problem: Problem3D, gamma: np.ndarray) -> np.ndarray:
    """Values of merged corners to all nodes; on edges the mean, so that gamma is linear in every element."""
    elements = problem.elements
    corner = gamma[elements.master[: elements.n_corners]]
    if elements.order == 1:
        return corner
    return np.concatenate((corner, 0.5 * corner[elements.edge_ends].sum(axis=1)))


def _shell_integral(field: Field3D, gamma: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    elements = field.problem.elements
    slope = elements.gradient(gamma)
    shell = np.flatnonzero(np.abs(slope).max(axis=1) > 1e-12 * np.abs(slope).max())
    slope, H, points = slope[shell], field.H_at_quadrature[shell], elements.quadrature_points[shell]
    along = np.einsum("qi,qi->q", H, slope)
    square = np.einsum("qi,qi->q", H, H)
    density = -MU_0 * (H * along[:, None] - 0.5 * square[:, None] * slope) * elements.weight[shell, None]
    return _of_machine(field, density.sum(axis=0), np.cross(points, density).sum(axis=0))


def _of_machine(field: Field3D, force: np.ndarray, torque: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Sum over the copies of a sector: what turns with them, or changes sign in a mirror, cancels."""
    fold = field.problem.fold
    if not fold.whole:
        n = field.problem.mesh.n_sectors
        force = np.array([0.0, 0.0, n * force[2]])
        torque = np.array([0.0, 0.0, 0.0 if fold.mirrored else n * torque[2]])
    return force, torque
