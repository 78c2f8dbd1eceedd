"""The solved 3D field: H and B at points, energies, flux linkage, force and torque, and the sampler."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from field.laws.reluctivity import MU_0

from .body_force import BodyForce, body_force, current_force
from .tetrahedron_locator import PointOutside3D

if TYPE_CHECKING:
    from field.section.powder_state import PowderState

    from .sampler_3d import Sampler3D
    from .scalar_potential import Problem3D

AROUND = 61
"""Angles at which a mean around the axis is taken."""


class Field3D:
    """One solution phi of a `Problem3D`.  Integrals are those of the whole machine.

    Attributes
    ----------
    problem : Problem3D
    phi : ndarray (n_nodes,)
        Reduced scalar potential [A] at the elements' nodes.
    ampere_turns : float
        N I of the coil [A], or the strength of the applied field [A/m].
    powder : PowderState or None
        What the field was solved for; in `coenergy` and B its source is a magnet.
    newton : list of (relative residual, step length)
        History of the iteration, the start first.
    """

    def __init__(
        self,
        problem: Problem3D,
        phi: np.ndarray,
        ampere_turns: float,
        powder: PowderState | None,
        newton: list[tuple[float, float]],
    ) -> None:
        self.problem = problem
        self.phi = phi
        self.ampere_turns = ampere_turns
        self.powder = powder
        self.newton = newton

    @cached_property
    def H_at_quadrature(self) -> np.ndarray:
        """H [A/m] at the elements' quadrature points, shape (n_quadrature, 3)."""
        return self.ampere_turns * self.problem.unit_T0 - self.problem.elements.gradient(self.phi)

    @cached_property
    def B_at_quadrature(self) -> np.ndarray:
        """B [T] at the elements' quadrature points, shape (n_quadrature, 3)."""
        B = self.problem.materials_at(self.H_at_quadrature, self.powder)[0][:, None] * self.H_at_quadrature
        source = self.problem.source_at_quadrature(self.powder)
        return B if source is None else B + MU_0 * source

    def integral(self, density: np.ndarray) -> float:
        """Integral over the whole machine of a density given at the quadrature points, shape (n_quadrature,)."""
        return float(self.problem.mesh.n_sectors * (density * self.problem.elements.weight).sum())

    @property
    def _outside(self) -> float:
        """Energy [J] of the field beyond an open boundary: half the integral of phi B . n over it."""
        return self.problem.mesh.n_sectors * self.problem.outer_energy(self.phi)

    @property
    def coenergy(self) -> float:
        """Integral of B dH over the volume [J]."""
        density = self.problem.materials_at(self.H_at_quadrature, self.powder)[1]
        source = self.problem.source_at_quadrature(self.powder)
        if source is not None:
            density = density + MU_0 * np.einsum("qi,qi->q", source, self.H_at_quadrature)
        return self.integral(density) + self._outside

    @property
    def energy(self) -> float:
        """Integral of H dB over the volume [J]; equals the co-energy when all is linear."""
        mu, density = self.problem.materials_at(self.H_at_quadrature, self.powder)
        return self.integral(mu * np.einsum("qi,qi->q", self.H_at_quadrature, self.H_at_quadrature) - density) + (
            self._outside
        )

    @property
    def flux_linkage_per_turn(self) -> float:
        """Flux through a mean turn, integral of T0 . B for one ampere-turn [Wb]; equals dW*/d(N I)."""
        return self.integral(np.einsum("qi,qi->q", self.problem.unit_T0, self.B_at_quadrature))

    @cached_property
    def flux_slope(self) -> float:
        """d flux_linkage_per_turn/d(N I) at constant powder [H]."""
        return self.problem.flux_slope(self)

    def field_strength(self, points: np.ndarray | None = None) -> np.ndarray:
        """H of the finite element solution itself (not recovered).

        Parameters
        ----------
        points : ndarray (k, 3) or None
            Anywhere in the machine [m]; None: the middle of every element of the mesh.

        Returns
        -------
        ndarray (k, 3)
            [A/m]

        Raises
        ------
        PointOutside3D
            A point outside the mesh.
        """
        return self._at(points)[0]

    def flux_density(self, points: np.ndarray | None = None) -> np.ndarray:
        """B [T] of the finite element solution itself, see `field_strength`."""
        return self._at(points)[1]

    def mean_flux_density(self, line: np.ndarray) -> float:
        """Mean |B| [T] at the points (r, z) [m] of a line, shape (k, 2), over the angle of the mesh's sector."""
        fold = self.problem.fold
        angle = fold.first + fold.angle * (np.arange(AROUND) + 0.5) / AROUND
        r, z = line.T
        points = np.stack(
            [np.outer(np.cos(angle), r), np.outer(np.sin(angle), r), np.broadcast_to(z, (AROUND, len(r)))], axis=-1
        ).reshape(-1, 3)
        return float(np.linalg.norm(self.flux_density(points), axis=1).mean())

    def estimated_errors(self) -> dict[str, float] | None:
        """Not estimated."""
        return None

    def _at(self, points: np.ndarray | None) -> tuple[np.ndarray, np.ndarray]:
        elements = self.problem.elements
        matrix = None
        if points is None:
            element = np.arange(len(elements.element_nodes))
            local = np.full((len(element), 3), 0.25)
        else:
            points = np.ascontiguousarray(np.atleast_2d(np.asarray(points, dtype=float)))
            inside, matrix = self.problem.fold.into_mesh(points)
            element, local = self.problem.locator.find(inside)
            if np.any(element < 0):
                raise PointOutside3D(points[element < 0], "the mesh")
        H = self._field_strength_in(element, local)
        B = self.problem.permeability_in(element, H, self.powder)[:, None] * H
        source = self.problem.source_in(element, self.powder)
        if source is not None:
            B = B + MU_0 * source
        fold = self.problem.fold
        return fold.out_of_mesh(matrix, H)[0], fold.out_of_mesh(matrix, B)[0]

    def _field_strength_in(self, element: np.ndarray, local: np.ndarray) -> np.ndarray:
        """H at reference coordinates (k, 3) of elements (k,)."""
        elements = self.problem.elements
        function, slopes = elements.reference(local)
        nodes = elements.element_nodes[element]
        X = elements.node_points[nodes]
        jacobian = np.einsum("kna,knd->kad", X, slopes)
        on_reference = np.einsum("kn,knd->kd", self.phi[nodes], slopes)
        gradient = np.linalg.solve(jacobian.transpose(0, 2, 1), on_reference[..., None])[..., 0]
        where = np.einsum("kn,kna->ka", function, X)
        where += 1e-9 * (X[:, :4].mean(axis=1) - where)
        return self.ampere_turns * self.problem.source.T0(where) - gradient

    def body_force(self, body: str) -> BodyForce:
        """Force and torque on a body in air: Maxwell's stress and virtual work, see `field.three_d.body_force`."""
        return body_force(self, body)

    def current_force(self) -> tuple[np.ndarray, np.ndarray]:
        """Force [N] and torque about the origin [N m] on the coil, integrals of J x B and r x (J x B)."""
        return current_force(self)

    def relative_permeability(self) -> np.ndarray:
        """mu_r = B/(mu_0 H) in the middle of every element, shape (n_elements,) [-]."""
        every = np.arange(len(self.problem.mesh.tetrahedra))
        return self.problem.permeability_in(every, self.field_strength(), self.powder) / MU_0

    def sampler(self, region: str = "powder") -> Sampler3D:
        """Recovered H and grad H inside a region without current."""
        from .sampler_3d import Sampler3D

        return Sampler3D(self, region)
