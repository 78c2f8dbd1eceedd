"""Axisymmetric nonlinear magnetostatics of a device with one coil.

    integral (nu/r) grad psi . grad v dr dz = integral J v dr dz        for all v,      psi = r A_phi,

with nu = H(|B|)/|B| of each region's law, |B| = |grad psi|/r, psi = 0 on the axis.  On `outer` either psi = 0
(a flux wall: take the air box about three times as large as the device), or the air outside stands in the
system exactly (`open_boundary`; the box may then be as small as the device).  The powder's reluctivity depends
on its fill, phi per element, and stands with its tangent in the same Newton iteration as the steel's.
Neglected: eddy currents, hysteresis, displacement current.
"""

from __future__ import annotations

from collections.abc import Mapping
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from field.factorisation import Backend, SymmetricSolver
from field.laws.powder_law import PowderLaw
from field.laws.region_laws import complete_laws
from field.laws.reluctivity import Law
from field.newton import minimise, norm, scalar_product
from field.section.magnetic_field import MagneticField
from field.section.powder_state import Powder, PowderState
from field.section.section_elements import SectionElements
from field.section.sparse_pattern import FixedPattern
from geometry.section import SectionMesh

if TYPE_CHECKING:
    from field.sampling.locate import TriangleLocator
    from field.sampling.recovery import RegionRecovery
    from field.section.open_boundary import OpenBoundary

# A cold start takes each material's chord H/B at this flux density, a loaded iron circuit's.
_START_B = 1.0


class AxisymmetricProblem:
    """One mesh, one set of materials; solved for as many currents and fills as wanted.

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
        Whether the air goes on beyond `outer`; otherwise `outer` is a flux wall.

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
        in_coil = np.zeros(len(mesh.triangles))
        if coil_region in mesh.regions:
            in_coil[mesh.regions[coil_region]] = 1.0
        self.coil_area = float((self.elements.weight.sum(axis=1) * in_coil).sum())
        # integral of v over the coil per area: load of one ampere-turn, and mean of psi over the coil
        self.coil_load = (
            self.elements.load(in_coil / self.coil_area) if self.coil_area > 0.0 else (np.zeros(self.elements.n_dofs))
        )
        self._by_law = self._elements_by_law()
        self._recoveries: dict[str, RegionRecovery] = {}

    @property
    def n_dofs(self) -> int:
        """Number of unknowns, boundary included."""
        return self.elements.n_dofs

    @property
    def factorisation_backend(self) -> Backend:
        """Which sparse factorisation is in use."""
        return self._solver.backend

    @property
    def powder_elements(self) -> np.ndarray:
        """Elements of the powder's region, then those beyond it: the order of `fill`."""
        own = self.mesh.regions.get(self.powder_region, np.zeros(0, dtype=np.int64))
        return np.concatenate((own, self.powder_beyond)) if self.powder_beyond.size else own

    @cached_property
    def locator(self) -> TriangleLocator:
        """Finds the element of a point anywhere in the section."""
        from field.sampling.locate import TriangleLocator

        return TriangleLocator(self.mesh.points, self.mesh.triangles)

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

        Raises
        ------
        ValueError
            A fill outside [0, 1) or of the wrong length, a current without a coil.
        ConvergenceError
            The iteration did not reach the tolerance.
        """
        powder = self.checked_powder(fill)
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
        if ampere_turns == 0.0 and boundary_field == 0.0 and (powder is None or powder.source is None):
            return MagneticField(self, boundary, 0.0, powder, [(0.0, 0.0)])

        source = ampere_turns * self.coil_load
        if self.exterior is not None:
            source[self.exterior.dofs] += boundary_field * self.exterior.uniform_load
        energy = SectionEnergy(self, powder, source, boundary)
        scale = norm(energy.source[self._free])
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
        x, history = minimise(
            energy,
            start,
            scale,
            solver=self._solver,
            tolerance=tolerance,
            max_iterations=max_iterations,
            first_matrix=first,
        )
        return MagneticField(self, energy.whole(x), float(ampere_turns), powder, history, float(boundary_field))

    def checked_powder(self, powder: Powder) -> PowderState | None:
        """The state that a solve takes; raises ValueError, see `solve`."""
        if powder is None:
            return None
        state = powder if isinstance(powder, PowderState) else PowderState(np.asarray(powder))
        fill = np.ascontiguousarray(state.fill, dtype=float)
        if self.powder_law is None:
            raise ValueError("a `fill` was given, but the problem has no `powder_law` to turn it into permeability")
        if fill.shape != (self.powder_elements.size,):
            raise ValueError(
                f"`fill` has shape {fill.shape}; region {self.powder_region!r} has {self.powder_elements.size} elements"
            )
        if not np.all((fill >= 0.0) & (fill < 1.0)):
            worst = fill[int(np.argmax(np.where(np.isfinite(fill), np.abs(fill - 0.5), np.inf)))]
            raise ValueError(
                f"`fill` holds {worst:g}; a solid fraction is at least 0 and below 1 (random packing: 0.55 to 0.64)"
            )
        if state.factor is not None and not (state.factor.shape == fill.shape and np.all(state.factor > -fill)):
            raise ValueError("`factor` must have the shape of `fill`, and N + phi must be above 0 everywhere")
        wanted = (fill.size, 2, self.elements.n_quadrature)
        if state.source is not None and not (state.source.shape == wanted and np.all(np.isfinite(state.source))):
            raise ValueError(f"`source` has shape {state.source.shape}: finite numbers of shape {wanted} are needed")
        return PowderState(fill.copy(), state.factor, state.source)

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


class SectionEnergy:
    """W(psi) = integral of r w(|grad psi|/r) - r M . B - J psi over the section, of the free unknowns.

    M is the powder's source, the part of its magnetisation that is no function of B.
    """

    def __init__(
        self, problem: AxisymmetricProblem, powder: PowderState | None, source: np.ndarray, boundary: np.ndarray
    ) -> None:
        self._problem = problem
        self._elements = problem.elements
        self._powder = powder
        self._boundary = boundary
        self.source = source
        if powder is not None and powder.source is not None:
            self.source = source + problem.magnetisation_load(powder.source)
        self._point: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self._law: tuple[np.ndarray, np.ndarray] | None = None

    def whole(self, x: np.ndarray) -> np.ndarray:
        """psi of all unknowns."""
        psi = self._boundary.copy()
        psi[self._problem._free] = x
        return psi

    def _flux(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # the line search asks for value and gradient at the same point
        if self._point is None or self._point[0] is not x:
            self._point = (x, *self._elements.flux(self.whole(x)))
        return self._point[1:]

    def value(self, x: np.ndarray) -> tuple[float, float]:
        _, B = self._flux(x)
        w = self._problem.energy_density(B, self._powder)
        stored = float((w * self._elements.radius * self._elements.weight).sum())
        if self._problem.exterior is not None:
            stored += self._problem.exterior.energy(self.whole(x))
        work = scalar_product(self.source, self.whole(x))
        return stored - work, stored + abs(work)

    def gradient(self, x: np.ndarray) -> np.ndarray:
        gradient, B = self._flux(x)
        H, slope = self._problem.H_of_B(B, self._powder)
        here = B > 0.0
        nu = np.where(here, H / np.where(here, B, 1.0), slope)
        self._law = (nu, slope)
        internal = self._elements.field_force(gradient, nu)
        if (exterior := self._problem.exterior) is not None:
            internal[exterior.dofs] += exterior.force(self.whole(x))
        return (internal - self.source)[self._problem._free]

    def hessian(self, x: np.ndarray) -> sp.csc_matrix:
        assert self._law is not None, "gradient(x) comes first"
        gradient, B = self._flux(x)
        return self._matrix(gradient, B, *self._law)

    def cautious_hessian(self, x: np.ndarray) -> sp.csc_matrix:
        """The tangent with dH/dB of at least half the chord H/B: steel with a long toe (DC01) else takes cut steps."""
        assert self._law is not None, "gradient(x) comes first"
        nu, slope = self._law
        return self._matrix(*self._flux(x), nu, np.maximum(slope, 0.5 * nu))

    def _matrix(self, gradient: np.ndarray, B: np.ndarray, nu: np.ndarray, slope: np.ndarray) -> sp.csc_matrix:
        exterior = self._problem.exterior
        dense = None if exterior is None else exterior.matrix
        return self._problem._pattern.assemble(self._elements.field_tangent(gradient, B, nu, slope), dense)

    def chord_matrix(self) -> sp.csc_matrix:
        """The matrix with nu = H/B of each material at a typical flux density."""
        B = np.full_like(self._elements.radius, _START_B)
        H, _ = self._problem.H_of_B(B, self._powder)
        nu = H / B
        gradient = np.zeros((len(B), 2, B.shape[1]))
        return self._matrix(gradient, 0.0 * B, nu, nu)


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
