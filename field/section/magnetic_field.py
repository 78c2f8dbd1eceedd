"""The solved field of a device: flux density, energies, flux linkage, and the sampler for grains."""

from __future__ import annotations

from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from field.laws.reluctivity import NU_0
from field.newton import scalar_product
from field.sampling.locate import PointOutside
from field.section.powder_state import Powder, powder_state

if TYPE_CHECKING:
    from field.sampling.sampler import RecoveredSampler
    from field.section.axisymmetric import AxisymmetricProblem
    from field.section.steel_history import SteelHistory


class MagneticField:
    """One solution psi = r A_phi of an `AxisymmetricProblem`.

    Attributes
    ----------
    problem : AxisymmetricProblem
    psi : ndarray (n_dofs,)
        r A_phi [Wb/rad]; the first `n_points` entries belong to the mesh's points, and its level lines in
        the section are flux lines (2 pi psi is the flux through the circle).
    ampere_turns : float
        N I of the coil [A].
    powder : PowderState or None
        What the field was solved for.
    newton : list of (relative residual, step length)
        History of the iteration, the start first.
    boundary_field : float
        Uniform axial flux density of sources far away that it was solved with [T].
    history : SteelHistory or None
        What the steel remembered when the step began that led here; None: no hysteresis.
    is_static : bool
        Whether it follows from the current alone; else eddy currents delay it.
    """

    def __init__(
        self,
        problem: AxisymmetricProblem,
        psi: np.ndarray,
        ampere_turns: float,
        fill: Powder,
        newton: list[tuple[float, float]],
        boundary_field: float = 0.0,
        history: SteelHistory | None = None,
        is_static: bool = True,
    ) -> None:
        self.problem = problem
        self.psi = psi
        self.ampere_turns = ampere_turns
        self.powder = powder_state(fill)
        self.newton = newton
        self.boundary_field = boundary_field
        self.history = history
        self.is_static = is_static

    @cached_property
    def later_history(self) -> SteelHistory | None:
        """What the steel remembers after this field: what the next solve begins with."""
        if self.history is None:
            return None
        return self.history.later(self.problem.elements, self.problem.elements.gradient(self.psi))

    @property
    def hysteresis_loss(self) -> float:
        """Heat of hysteresis in the step that led here [J], >= 0."""
        if self.history is None or self.later_history is None:
            return 0.0
        return 2.0 * np.pi * self.history.loss(self.problem.elements, self.later_history)

    def history_field_strength(self) -> np.ndarray | None:
        """What the steel's history adds to H, mean over each element, r and z, (n_elements, 2) [A/m]; None: none."""
        if self.history is None:
            return None
        elements = self.problem.elements
        flow = self.history.step(elements, elements.gradient(self.psi)).flow.mean(axis=2)
        return np.column_stack((-flow[:, 1], flow[:, 0]))

    @property
    def fill(self) -> np.ndarray | None:
        """Solid fraction (n powder elements,) that the field was solved for."""
        return None if self.powder is None else self.powder.fill

    def _B_at_quadrature(self) -> np.ndarray:
        elements = self.problem.elements
        gradient = elements.gradient(self.psi)
        return np.hypot(gradient[:, 0], gradient[:, 1]) / elements.radius

    def _volume_integral(self, density: np.ndarray) -> float:
        elements = self.problem.elements
        return float(2.0 * np.pi * (density * elements.radius * elements.weight).sum())

    def _exterior_energy(self) -> float:
        exterior = self.problem.exterior
        if exterior is not None and self.boundary_field != 0.0:
            raise ValueError(
                "a uniform field of sources far away has no finite energy beyond an open boundary; "
                "solve with open_boundary=False for the energy inside"
            )
        return 0.0 if exterior is None else 2.0 * np.pi * exterior.energy(self.psi)

    @property
    def energy(self) -> float:
        """Stored energy, integral of w(B) over the volume [J]; of steel with hysteresis the reversible part."""
        inside = self._volume_integral(self.problem.energy_density(self._B_at_quadrature(), self.powder))
        if self.history is not None:
            elements = self.problem.elements
            inside += 2.0 * np.pi * self.history.stored(elements, elements.gradient(self.psi))
        return inside + self._exterior_energy()

    @property
    def coenergy(self) -> float:
        """Co-energy, integral of H B - w over the volume [J]; equals the energy when all is linear.

        Raises ValueError with hysteresis, where it is no function of the field.
        """
        if self.history is not None:
            raise ValueError("steel with hysteresis has no co-energy: it depends on the way to the field; use `energy`")
        B = self._B_at_quadrature()
        H, _ = self.problem.H_of_B(B, self.powder)
        inside = self._volume_integral(H * B - self.problem.energy_density(B, self.powder))
        return inside + self._exterior_energy()

    @property
    def flux_linkage_per_turn(self) -> float:
        """Flux through a mean turn of the coil, 2 pi times the mean of psi over its section [Wb].

        Times N it is the linkage, and N^2/(N I) times it the inductance.
        """
        return 2.0 * np.pi * scalar_product(self.problem.coil_load, self.psi)

    def flux_linkage(self, turns: float) -> float:
        """Flux linkage of the coil, N times `flux_linkage_per_turn` [Wb]."""
        return turns * self.flux_linkage_per_turn

    @property
    def point_psi(self) -> np.ndarray:
        """psi at the mesh's points, shape (n_points,) [Wb/rad]; its level lines are flux lines."""
        return self.psi[: len(self.problem.mesh.points)]

    def flux_density(self, points: np.ndarray | None = None) -> np.ndarray:
        """B of the finite element solution itself (not recovered).

        Parameters
        ----------
        points : ndarray (k, 2) or None
            (r, z) [m]; None: the centroid of every element.

        Returns
        -------
        ndarray (k, 2)
            B_r, B_z [T].

        Raises
        ------
        PointOutside
            A point outside the mesh.
        """
        mesh = self.problem.mesh
        if points is None:
            points, element = mesh.centroid(), np.arange(len(mesh.triangles))
        else:
            points = np.ascontiguousarray(np.atleast_2d(np.asarray(points, dtype=float)))
            element = self.problem.find(points)
            if np.any(element < 0):
                raise PointOutside(points[element < 0], "the mesh")
        return self.problem.elements.flux_density_at(self.psi, element, points)

    def B_along(self, points: np.ndarray) -> np.ndarray:
        """B_r, B_z [T], shape (k, 2), at the points (r, z) [m] of a polyline, shape (k, 2)."""
        return self.flux_density(points)

    def mean_flux_density(self, line: np.ndarray) -> float:
        """Mean |B| [T] at the points (r, z) [m] of a line, shape (k, 2)."""
        return float(np.linalg.norm(self.B_along(line), axis=1).mean())

    def estimated_errors(self) -> dict[str, float] | None:
        """Relative errors by `field.estimate_error` of linkage and powder.

        None without current, with hysteresis or with eddy currents: the finer static field is then another one.
        """
        from field.section.error_estimate import FluxLinkage, MeanFluxDensity, estimate_error

        if self.ampere_turns == 0.0 or self.history is not None or not self.is_static:
            return None
        estimate = estimate_error(self, (FluxLinkage(), MeanFluxDensity("powder")))
        return {goal.goal: goal.relative for goal in estimate.goals}

    def corner_flux_density(self) -> np.ndarray:
        """B_r, B_z [T] of each element at its corners in `triangles`' order, shape (n_elements, 3, 2)."""
        mesh = self.problem.mesh
        element, corner = np.repeat(np.arange(len(mesh.triangles)), 3), mesh.points[mesh.triangles.ravel()]
        return self.problem.elements.flux_density_at(self.psi, element, corner).reshape(-1, 3, 2)

    def relative_permeability(self) -> np.ndarray:
        """mu_r = B/(mu_0 H) at the centroid of every element, shape (n_elements,) [-]; of steel that of its curve."""
        B = np.linalg.norm(self.flux_density(), axis=1)[:, None]
        H, slope = self.problem.H_of_B(B, self.powder)
        here = B > 0.0
        return (NU_0 / np.where(here, H / np.where(here, B, 1.0), slope))[:, 0]

    def sampler(self, region: str | None = None) -> RecoveredSampler:
        """Recovered H and grad H inside a region, by default the powder's."""
        from field.sampling.sampler import RecoveredSampler

        return RecoveredSampler(self, region or self.problem.powder_region)
