"""Axisymmetric nonlinear magnetostatics of a device with one coil.

    integral (nu/r) grad psi . grad v dr dz = integral J v dr dz        for all v,      psi = r A_phi,

with nu = H(|B|)/|B| of each region's law, |B| = |grad psi|/r, psi = 0 on the axis.  On `outer` either psi = 0
(a flux wall: take the air box about three times as large as the device), or the air outside stands in the
system exactly (`open_boundary`; the box may then be as small as the device).  The powder's reluctivity depends
on its fill, phi per element, and stands with its tangent in the same Newton iteration as the steel's.
Steel may have a history (`steel_history`). Neglected: eddy currents, displacement current.
"""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np

from field.factorisation import Backend, SymmetricSolver
from field.laws.powder_law import PowderLaw
from field.laws.region_laws import complete_laws
from field.laws.reluctivity import Law, LinearLaw
from field.newton import minimise, norm
from field.section.magnetic_field import MagneticField
from field.section.powder_state import Powder, PowderState, checked_powder
from field.section.section_elements import SectionElements
from field.section.section_energy import SectionEnergy
from field.section.steel_history import SteelHistory
from field.sparse_pattern import FixedPattern
from geometry.section import SectionMesh

if TYPE_CHECKING:
    from field.sampling.locate import TriangleLocator
    from field.sampling.recovery import RegionRecovery
    from field.section.open_boundary import OpenBoundary


class AxisymmetricProblem:
    """One mesh, one set of materials; solved for any number of currents and fills.

    Parameters
    ----------
    mesh : SectionMesh
        Section with named regions, boundary `outer` (and the axis, found by r = 0).
    laws : dict of str to Law
        Law of each region; `air`, the coil and the powder's region are air where they are not given.
    coil_region, powder_region : str
    powder_law : PowderLaw or None
        None: the powder's region follows `laws`.
    powder_beyond : ndarray (k,) or None
        Elements of other regions, non-magnetic ones, that magnetisation reaches into: they follow the powder's law too.
    order : int
        Order of the elements for psi, 1 to 4.
    open_boundary : bool
        Whether the air continues beyond `outer`; otherwise `outer` is a flux wall.

    Raises
    ------
    ValueError
        A region without a law, a law without a region, a mesh without coil or outer boundary.
    """

    def __init__(
        self,
        mesh: SectionMesh,
        laws: Mapping[str, Law],
        *,
        coil_region: str = "coil",
        powder_region: str = "powder",
        powder_law: PowderLaw | None = None,
        powder_beyond: np.ndarray | None = None,
        order: int = 2,
        open_boundary: bool = False,
    ) -> None:
        self.mesh = mesh
        self.laws = _complete_laws(mesh, laws, coil_region, powder_region, powder_law)
        self.coil_region = coil_region
        self.powder_region = powder_region
        self.powder_law = powder_law
        self.powder_beyond = np.zeros(0, dtype=np.int64) if powder_beyond is None else np.asarray(powder_beyond)
        self.elements = SectionElements(mesh, order)
        linear = {name for name, law in self.laws.items() if isinstance(law, LinearLaw)}
        self.elements.curl_free = frozenset(linear - {coil_region} - ({powder_region} if powder_law else set()))
        self.exterior: OpenBoundary | None = None
        fixed = self.elements.axis_dofs()
        if open_boundary:
            from field.section.open_boundary import OpenBoundary

            self.exterior = OpenBoundary(self.elements)
        else:
            fixed = np.union1d(fixed, self.elements.boundary_dofs("outer"))
        self._free = np.setdiff1d(np.arange(self.elements.n_dofs), fixed)
        self._fixed = fixed
        self._pattern = FixedPattern(
            self.elements.element_dofs,
            self._free,
            self.elements.n_dofs,
            clique=None if self.exterior is None else self.exterior.dofs,
        )
        self._solver = SymmetricSolver()
        self._spread_current()
        self._by_law = self._elements_by_law()
        self._recoveries: dict[str, RegionRecovery] = {}

    def _spread_current(self) -> None:
        in_coil = np.zeros(len(self.mesh.triangles))
        if self.coil_region in self.mesh.regions:
            in_coil[self.mesh.regions[self.coil_region]] = 1.0
        self.coil_area = float((self.elements.weight.sum(axis=1) * in_coil).sum())
        # integral of v over the coil per area: load of one ampere-turn, and mean of psi over the coil
        self.coil_load = (
            self.elements.load(in_coil / self.coil_area) if self.coil_area > 0.0 else (np.zeros(self.elements.n_dofs))
        )

    def with_points(self, points: np.ndarray) -> AxisymmetricProblem:
        """The same problem with the mesh's points elsewhere, (n_points, 2) [m]; those on `outer` must stay.

        It shares the unknowns, the pattern of the matrix and the last factorisation with this one.
        """
        other = copy.copy(self)
        other.__dict__.pop("locator", None)
        other._recoveries = {}
        other.mesh = dataclasses.replace(self.mesh, points=points)
        other.elements = self.elements.with_mesh(other.mesh)
        other._spread_current()
        return other

    @property
    def n_dofs(self) -> int:
        """Number of unknowns, boundary included."""
        return self.elements.n_dofs

    @property
    def factorisation_backend(self) -> Backend:
        """Name of the sparse factorisation in use."""
        return self._solver.backend

    @property
    def powder_elements(self) -> np.ndarray:
        """Elements of the powder's region, then those beyond it: the order of `fill`."""
        own = self.mesh.regions.get(self.powder_region, np.zeros(0, dtype=np.int64))
        return np.concatenate((own, self.powder_beyond)) if self.powder_beyond.size else own

    @cached_property
    def locator(self) -> TriangleLocator:
        """Finds the straight triangle of a point anywhere in the section."""
        from field.sampling.locate import TriangleLocator

        return TriangleLocator(self.mesh.points, self.mesh.triangles)

    def find(self, points: np.ndarray) -> np.ndarray:
        """Element (k,) of points (r, z) [m], shape (k, 2), on the right side of curved edges; -1 outside."""
        return self.elements.beyond_curves(self.locator.find(points)[0], points)

    def recovery(self, region: str) -> RegionRecovery:
        """The recovery operator of a region, built on the first call."""
        if region not in self._recoveries:
            from field.sampling.recovery import RegionRecovery

            if region not in self.mesh.regions:
                raise ValueError(
                    f"the mesh has no region {region!r} to sample; it has {', '.join(sorted(self.mesh.regions))}"
                )
            self._recoveries[region] = RegionRecovery(self.elements, self.mesh.regions[region])
        return self._recoveries[region]

    def law_of(self, region: str) -> Law | PowderLaw:
        """The law in force in a region: the powder's where there is one."""
        if self.powder_law is not None and region == self.powder_region:
            return self.powder_law
        return self.laws[region]

    def solve(
        self,
        ampere_turns: float,
        fill: Powder = None,
        guess: MagneticField | np.ndarray | None = None,
        *,
        tolerance: float = 1e-8,
        max_iterations: int = 100,
        boundary_field: float = 0.0,
        factorised: bool = False,
        history: SteelHistory | None = None,
    ) -> MagneticField:
        """The field of a coil current and a powder fill.

        Parameters
        ----------
        ampere_turns : float
            N I of the coil [A], spread evenly over its section.
        fill : ndarray (n powder elements,), PowderState or None
            Solid fraction of each element of `powder_elements` [-], in [0, 1), or the powder's whole state; None: no
            powder.
        guess : MagneticField or ndarray (n_dofs,) or None
            Start of the iteration; None: a cold start.
        tolerance : float
            Residual relative to the drive.
        boundary_field : float
            Uniform axial flux density [T] of sources far away: with an open boundary the field that would be
            there without the device, otherwise imposed on `outer`, psi = B r^2/2 there.
        factorised : bool
            Whether the last factorisation, `factorise_tangent`'s say, was of a tangent near that at the guess.
        history : SteelHistory or None
            Of the steel up to this step: the `later_history` of the field before; None: no hysteresis.

        Raises
        ------
        ValueError
            A fill outside [0, 1) or of the wrong length, a current without a coil.
        ConvergenceError
            The iteration did not reach the tolerance.
        """
        powder = self.check_powder(fill)
        if not np.isfinite(ampere_turns) or not np.isfinite(boundary_field):
            raise ValueError(
                f"`ampere_turns` = {ampere_turns} A and `boundary_field` = {boundary_field} T must be finite numbers"
            )
        if ampere_turns != 0.0 and self.coil_area == 0.0:
            raise ValueError(
                f"{ampere_turns:g} ampere-turns, but the mesh has no coil region "
                f"{self.coil_region!r}; it has {', '.join(sorted(self.mesh.regions))}"
            )
        boundary = np.zeros(self.n_dofs)
        boundary[self._fixed] = 0.5 * boundary_field * self.elements.dof_points[self._fixed, 0] ** 2
        remanent = 0.0
        if history is not None:
            still = np.zeros((len(self.mesh.triangles), 2, self.elements.n_quadrature))
            remanent = norm(self.elements.divergence(history.step(self.elements, still).flow)[self._free])
        if (
            ampere_turns == 0.0
            and boundary_field == 0.0
            and (powder is None or powder.source is None)
            and remanent == 0.0
        ):
            return MagneticField(self, boundary, 0.0, powder, [(0.0, 0.0)], history=history)

        source = ampere_turns * self.coil_load
        if self.exterior is not None:
            source[self.exterior.dofs] += boundary_field * self.exterior.uniform_load
        energy = SectionEnergy(self, powder, source, boundary, history)
        scale = norm(energy.source[self._free]) + remanent
        if boundary_field != 0.0 and self.exterior is None:
            scale += norm(energy.gradient(np.zeros(self._free.size)))
        if guess is None:
            start, first = np.zeros(self._free.size), energy.chord_matrix
        else:
            psi = guess.psi if isinstance(guess, MagneticField) else np.asarray(guess, dtype=float)
            if psi.shape != (self.n_dofs,):
                raise ValueError(
                    f"`guess` has {psi.size} unknowns, the mesh {self.n_dofs}: start from a field of the same problem"
                )
            if not np.all(np.isfinite(psi)):
                raise ValueError("`guess` holds a value that is not a finite number; start from another field, or None")
            start, first = psi[self._free], None
        x, newton = minimise(
            energy,
            start,
            scale,
            solver=self._solver,
            tolerance=tolerance,
            max_iterations=max_iterations,
            first_matrix=first,
            factorised=factorised,
        )
        return MagneticField(
            self, energy.expand(x), float(ampere_turns), powder, newton, float(boundary_field), history=history
        )

    def factorise_tangent(self, solution: MagneticField) -> SymmetricSolver:
        """The solver of the free unknowns, holding the tangent at a solution."""
        boundary = np.zeros(self.n_dofs)
        boundary[self._fixed] = solution.psi[self._fixed]
        # whatever the source, the tangent is the same
        energy = SectionEnergy(self, solution.powder, boundary, boundary, solution.history)
        x = solution.psi[self._free]
        energy.gradient(x)
        self._solver.factorise(energy.hessian(x))
        return self._solver

    def check_powder(self, powder: Powder) -> PowderState | None:
        """The state that a solve takes; raises ValueError, see `solve`."""
        if powder is not None and self.powder_law is None:
            raise ValueError("a `fill` was given, but the problem has no `powder_law` to turn it into permeability")
        return checked_powder(powder, self.powder_elements.size, (2, self.elements.n_quadrature))

    def _elements_by_law(self) -> list[tuple[Law | PowderLaw, np.ndarray]]:
        """Elements that share a law, so that each is evaluated once; the powder's in the fill's order."""
        groups: dict[int, tuple[Law | PowderLaw, list[np.ndarray]]] = {}
        for region, elements in self.mesh.regions.items():
            law = self.law_of(region)
            if self.powder_beyond.size:
                own = isinstance(law, PowderLaw)
                elements = self.powder_elements if own else np.setdiff1d(elements, self.powder_beyond)
            groups.setdefault(id(law), (law, []))[1].append(elements)
        return [(law, np.concatenate(parts)) for law, parts in groups.values()]

    def magnetisation_load(self, source: np.ndarray) -> np.ndarray:
        """Integral of r M . B(v) for every v: load (n_dofs,) of M (n powder elements, 2, n_quadrature) [A/m]."""
        flow = np.zeros((len(self.mesh.triangles), 2, self.elements.n_quadrature))
        own = self.powder_elements
        flow[own, 0], flow[own, 1] = source[:, 1], -source[:, 0]  # r B = (-psi_z, psi_r)
        return self.elements.divergence(flow)

    def H_of_B(self, B: np.ndarray, powder: PowderState | None) -> tuple[np.ndarray, np.ndarray]:
        """H [A/m] and dH/dB at |B| [T], shape (n_elements, k), by each element's law, without the powder's source."""
        H, slope = np.empty_like(B), np.empty_like(B)
        for law, elements in self._by_law:
            if isinstance(law, PowderLaw):
                state = (0.0, None) if powder is None else powder.arguments
                H[elements], slope[elements] = law.H_of_B(B[elements], *state)
            else:
                H[elements], slope[elements] = law.H_of_B(B[elements])
        return H, slope

    def energy_density(self, B: np.ndarray, powder: PowderState | None) -> np.ndarray:
        """Energy density [J/m^3] at |B| [T], shape (n_elements, k), without the powder's source."""
        w = np.empty_like(B)
        for law, elements in self._by_law:
            if isinstance(law, PowderLaw):
                w[elements] = law.energy_density(B[elements], *((0.0, None) if powder is None else powder.arguments))
            else:
                w[elements] = law.energy_density(B[elements])
        return w


def _complete_laws(
    mesh: SectionMesh, laws: Mapping[str, Law], coil_region: str, powder_region: str, powder_law: PowderLaw | None
) -> dict[str, Law]:
    complete = complete_laws(mesh.regions, laws, ("air", coil_region, powder_region))
    if powder_law is not None and powder_region in laws:
        raise ValueError(f"region {powder_region!r} has both a law and a `powder_law`; give one of them")
    if powder_law is not None and powder_region not in mesh.regions:
        raise ValueError(
            f"a `powder_law`, but the mesh has no region {powder_region!r}; it has {', '.join(sorted(mesh.regions))}"
        )
    return complete
