"""Nonlinear magnetostatics in 3D by the reduced scalar potential, H = T0 - grad phi with curl T0 = J.

    integral B(T0 - grad phi) . grad v = 0     for all v,

the stationary point of the co-energy W*(phi) = integral of w*(|T0 - grad phi|), w* = integral of B dH.  B grows
with H, so W* is convex in phi and Newton with a line search on it converges from anywhere.

Boundaries.  Natural is B . n = 0: right on a meridional plane in which a sector of a machine with a ring coil
is mirrored (J is normal to it, H lies in it), and on a flux wall.  On two faces of a periodic sector phi is
the same (T0 turns with the sector and its circulation around the axis is zero).  A plane z = const in which
coil and device are mirrored has tangential H = 0: phi = 0, name it in `fixed`.  The outer boundary is

    open       dphi/dn = -alpha phi with the alpha of an axial dipole at its centre: exact on a sphere for any
               dipole, on a cylinder for an axial one; what is outside is counted in energy and co-energy;
    flux_wall  B . n = 0;
    zero       phi = 0, H normal to it.

The errors of wall and zero are those of the dipole's images, -2 : 1 in a sphere; open has neither.
With a `powder_law` the powder's elements have B = mu_0 (H + phi M_grain(|H|; N) H/|H| + source), the state of
`field.section.powder_state` at the given H; a source is a magnet, whose load is -integral of mu_0 source . grad v.
Neglected: eddy currents, hysteresis.  Reference: Simkin and Trowbridge, Int. J. Numer. Methods Eng. 14 (1979);
Webb and Forghani, IEEE Trans. Magn. 29 (1993) for T0 with a single scalar potential.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Any

import numpy as np
import scipy.sparse as sp

from field.laws.powder_law import PowderLaw
from field.laws.region_laws import complete_laws
from field.laws.reluctivity import MU_0, Law, LinearLaw
from field.newton import ConvergenceError, minimise, norm, scalar_product
from field.section.powder_state import Powder, PowderState, checked_powder
from geometry.mesh_3d import Mesh3D

from .current_source import Source
from .elements_3d import Elements3D
from .field_3d import Field3D
from .inverse_law import InverseLaw
from .nodal_amg import NodalSolver, linear_to_quadratic

if TYPE_CHECKING:
    from .recovery_3d import Recovery3D
    from .sector import SectorFold
    from .tetrahedron_locator import TetrahedronLocator

# A cold start takes each material's chord B/H at this flux density [T], a loaded iron circuit's, and then every
# place's own chord at the B of the solution there: coils fix H in air and saturated iron, but B in an iron circuit.
_START_B = 1.0
_START_TOLERANCE = 3e-3  # of these two linear solves
# The line search continues until the slope is level to this fraction: a gradient costs a tenth of a linear solve.
_LEVEL = 0.3
_WITHOUT_IRON = ("air", "coil", "powder", "slots")
# Of the linear solve whose square the incremental inductance is, and of a flux linkage that is given.
_SLOPE_TOLERANCE, _LINKAGE_TOLERANCE = 1e-5, 1e-7
_MAX_LINKAGE_SOLVES = 20


class Problem3D:
    """One mesh, one set of materials and one source; solved for any number of currents.

    Parameters
    ----------
    mesh : Mesh3D
    laws : dict of str to Law
        Law of each region; `air`, `coil`, `powder` and `slots` are air where they are not given.
    source : Source
        Coil or applied field, for one ampere-turn.
    order : int
        Of the elements for phi, 1 or 2.
    outer : str
        `open`, `flux_wall` or `zero`, for the mesh's boundary `outer`.
    fixed : sequence of str
        Boundaries with phi = 0.
    centre_z : float
        Height of the device's middle [m], from where an open boundary sees its dipole.
    powder_law : PowderLaw or None
        Of the region `powder`; None: it is air.
    powder_beyond : ndarray (k,) of int or None
        Elements of other regions that hold powder too, which must be air.
    linear_solver : str
        `auto`, `direct` or `multigrid`.

    Raises
    ------
    ValueError
        A region without a law, a law without a region, a boundary that does not exist.
    """

    def __init__(
        self,
        mesh: Mesh3D,
        laws: Mapping[str, Law],
        source: Source,
        *,
        order: int = 2,
        outer: str = "open",
        fixed: Sequence[str] = (),
        centre_z: float = 0.0,
        powder_law: PowderLaw | None = None,
        powder_beyond: np.ndarray | None = None,
        linear_solver: str = "auto",
    ) -> None:
        if outer not in ("open", "flux_wall", "zero"):
            raise ValueError(f"`outer` = {outer!r} of the 3D field must be 'open', 'flux_wall' or 'zero'")
        self.mesh = mesh
        self.source = source
        self.laws = complete_laws(mesh.regions, laws, _WITHOUT_IRON)
        names = list(mesh.regions)
        self._material = np.empty(len(mesh.tetrahedra), dtype=np.int64)
        for k, name in enumerate(names):
            self._material[mesh.regions[name]] = k
        self._inverse = [InverseLaw.of(self.laws[name]) for name in names]
        bends = np.array([not isinstance(self.laws[name], LinearLaw) for name in names])
        self.powder_law = powder_law
        self.powder_elements = np.zeros(0, dtype=np.int64)
        if powder_law is not None:
            beyond = np.zeros(0, dtype=np.int64) if powder_beyond is None else powder_beyond
            self.powder_elements = np.union1d(mesh.regions["powder"], beyond)
        self._powder_row = np.full(len(mesh.tetrahedra), -1, dtype=np.int64)
        self._powder_row[self.powder_elements] = np.arange(self.powder_elements.size)
        self.linear = not bends.any() and powder_law is None
        centroid = mesh.centroid()
        self.carries_current = np.any(source.current_density(centroid) != 0.0, axis=1)
        fixed = (*fixed, "outer") if outer == "zero" else tuple(fixed)
        holds_powder = self._powder_row >= 0
        nonlinear = bends[self._material] | holds_powder
        self.elements = Elements3D(
            mesh,
            order,
            fixed=fixed,
            group=np.where(holds_powder, len(names), np.where(nonlinear, self._material, -1)),
            careful=nonlinear | self.carries_current,
            fix_one=outer == "flux_wall" and not fixed,
        )
        elements = self.elements
        # a hair towards the element's middle: round-off must not carry a point across a jump of T0
        owner = elements.element_of_quadrature
        self.unit_T0 = source.T0(elements.quadrature_points + 1e-9 * (centroid[owner] - elements.quadrature_points))
        self._linear_part()
        self._outer: tuple[np.ndarray, np.ndarray] | None = None
        if outer == "open":
            self._open_boundary(centre_z)
        self._linear_matrix = elements.pattern.assemble(self._packed)
        self._solver = NodalSolver(linear_to_quadratic(elements), elements.n_free, linear_solver)
        self._recoveries: dict[str, Recovery3D] = {}

    def _linear_part(self) -> None:
        """Matrix and load per ampere-turn of the regions of constant permeability, which are assembled once."""
        from . import weak_forms

        elements = self.elements
        n = elements.element_nodes.shape[1]
        self._packed = np.zeros((len(elements.element_nodes), n * (n + 1) // 2))
        self._unit_load = np.zeros(elements.n_free)
        permeability = np.array([float(law.B(0.0, 1)) for law in self._inverse])
        for basis, group, T0 in zip(elements.bases, elements.groups, elements.split(self.unit_T0), strict=True):
            if group >= 0:
                continue
            mu = np.broadcast_to(permeability[self._material[basis.tind], None], basis.dx.shape)
            self._packed[basis.tind] = packed(weak_forms.stiffness.elemental(basis, mu=mu).tolocal())
            self._unit_load += elements.restrict(weak_forms.divergence.assemble(basis, flow=mu * T0))
        vacuum = MU_0 * self.unit_T0
        # of a uniform T0, which has no load inside, a millionth of its size
        size = np.linalg.norm(vacuum, axis=1) * np.cbrt(elements.weight) ** 2
        self._unit_scale = max(norm(elements.divergence(vacuum)), 1e-6 * norm(size))

    def _open_boundary(self, centre_z: float) -> None:
        elements = self.elements
        nodes, points, normal, function = elements.faces("outer")
        centre = np.array([0.0, 0.0, centre_z])
        arm = points - centre
        area = np.linalg.norm(normal, axis=2)
        facing = np.einsum("kqa,kqa->kq", normal, arm) / (area * np.einsum("kqa,kqa->kq", arm, arm))
        height = np.where(np.abs(arm[..., 2]) > 0.0, arm[..., 2], np.inf)
        # of phi = z/r^3:  -(dphi/dn)/phi = 3 n.r/r^2 - n_z/z; the bounds hold on every face of a sphere or a
        # cylinder that is wider than it is high by less than sqrt(2), and keep the matrix positive elsewhere
        alpha = 3.0 * facing - np.clip(normal[..., 2] / area / height, 0.0, 2.0 * np.maximum(facing, 0.0))
        blocks = MU_0 * np.einsum("kq,qi,qj->kij", np.maximum(alpha, 0.0) * area, function, function)
        inward = points * (1.0 - 1e-9) + 1e-9 * centre
        T0 = self.source.T0(inward.reshape(-1, 3)).reshape(points.shape)
        load = np.zeros(elements.n_nodes)
        np.add.at(load, nodes, MU_0 * np.einsum("kqa,kqa,qi->ki", T0, normal, function))
        self._unit_load -= elements.restrict(load)
        self._outer = nodes, blocks
        element = elements.solid.f2t[0, elements.facets("outer")]
        place = (elements.element_nodes[element][:, None, :] == nodes[:, :, None]).argmax(axis=2)
        full = np.zeros((len(element), *2 * elements.element_nodes.shape[1:]))
        full[np.arange(len(element))[:, None, None], place[:, :, None], place[:, None, :]] = blocks
        np.add.at(self._packed, element, packed(full))

    def outer_energy(self, phi: np.ndarray) -> float:
        """Energy [J] beyond the mesh's open boundary for a potential (n_nodes,) [A]; 0 beyond another one."""
        if self._outer is None:
            return 0.0
        nodes, blocks = self._outer
        return float(0.5 * np.einsum("ki,kij,kj->", phi[nodes], blocks, phi[nodes]))

    @property
    def n_dofs(self) -> int:
        """Number of unknowns."""
        return self.elements.n_free

    @property
    def linear_solver(self) -> str:
        """One line: which linear solver is in use."""
        return self._solver.description()

    @property
    def linear_iterations(self) -> list[int]:
        """Iterations of every conjugate gradient solve so far."""
        return self._solver.iterations

    @cached_property
    def locator(self) -> TetrahedronLocator:
        """Finds the element of a point anywhere in the mesh."""
        from .tetrahedron_locator import TetrahedronLocator

        return TetrahedronLocator(self.elements, np.arange(len(self.mesh.tetrahedra)))

    @cached_property
    def fold(self) -> SectorFold:
        """Maps points of the whole machine into the meshed sector."""
        from .sector import SectorFold

        return SectorFold(self.mesh)

    def recovery(self, region: str) -> Recovery3D:
        """The recovery operator of a region, built on the first call."""
        if region not in self._recoveries:
            from .recovery_3d import Recovery3D

            if region not in self.mesh.regions:
                raise ValueError(
                    f"the mesh has no region {region!r} to sample; it has {', '.join(sorted(self.mesh.regions))}"
                )
            if self.carries_current[self.mesh.regions[region]].any():
                raise ValueError(
                    f"region {region!r} carries current: no scalar potential there to recover the field from"
                )
            self._recoveries[region] = Recovery3D(self.elements, self.mesh.regions[region], self.source)
        return self._recoveries[region]

    @property
    def powder_basis(self) -> Any:
        """The basis of the powder's elements, in the order of `powder_elements`."""
        return self.elements.bases[-1]  # the group of the highest number

    def materials_at(self, H: np.ndarray, powder: PowderState | None = None) -> tuple[np.ndarray, np.ndarray]:
        """mu = B/H [H/m] and w* [J/m^3], without a source, at H (n_quadrature, 3) [A/m] of the quadrature points."""
        return self._evaluate(self.elements.element_of_quadrature, H, powder)

    def permeability_in(self, element: np.ndarray, H: np.ndarray, powder: PowderState | None = None) -> np.ndarray:
        """mu = B/H [H/m] of one point in each listed element, H (k, 3) [A/m]."""
        return self._evaluate(element, H, powder)[0]

    def source_at_quadrature(self, powder: PowderState | None) -> np.ndarray | None:
        """The powder's source [A/m] at the quadrature points (n_quadrature, 3); None: there is none."""
        if powder is None or powder.source is None:
            return None
        source = np.zeros((len(self.elements.weight), 3))
        source[-powder.source[:, 0].size :] = powder.source.transpose(0, 2, 1).reshape(-1, 3)
        return source

    def source_in(self, element: np.ndarray, powder: PowderState | None) -> np.ndarray | None:
        """Mean of the powder's source [A/m] in each listed element (k, 3); None: there is none."""
        if powder is None or powder.source is None:
            return None
        weight = self.powder_basis.dx / self.powder_basis.dx.sum(axis=1, keepdims=True)
        mean, row = (powder.source * weight[:, None]).sum(axis=2), self._powder_row[element]
        return np.where((row >= 0)[:, None], mean[row], 0.0)

    def _evaluate(
        self, element: np.ndarray, H: np.ndarray, powder: PowderState | None
    ) -> tuple[np.ndarray, np.ndarray]:
        size = np.linalg.norm(H, axis=1)
        mu, coenergy = np.empty(len(H)), np.empty(len(H))
        material = self._material[element]
        for k, law in enumerate(self._inverse):
            here = material == k
            mu[here], _, coenergy[here] = law.evaluate(size[here])
        if powder is not None:
            row = self._powder_row[element]
            here = row >= 0
            factor = None if powder.factor is None else powder.factor[row[here]]
            assert self.powder_law is not None
            mu[here], _, coenergy[here] = self.powder_law.of_H(size[here], powder.fill[row[here]], factor)
        return mu, coenergy

    def solve(
        self,
        ampere_turns: float,
        fill: Powder = None,
        guess: Field3D | None = None,
        *,
        tolerance: float = 1e-8,
        max_iterations: int = 40,
    ) -> Field3D:
        """The field for a drive: N I [A], or the strength [A/m] of an applied field.

        Parameters
        ----------
        fill : ndarray (n powder elements,), PowderState or None
            Solid fraction of each of `powder_elements` [-], or the powder's whole state; None: no powder.
        guess : Field3D or None
            Start of the iteration, another solution of this problem; None: the field of constant permeability.
        tolerance : float
            Residual relative to that of the source in vacuum, or to that of magnetised powder where it is larger.

        Raises
        ------
        ConvergenceError
            The iteration did not reach the tolerance.
        """
        if not np.isfinite(ampere_turns):
            raise ValueError(f"`ampere_turns` = {ampere_turns} must be a finite number")
        powder = self._checked(fill)
        if ampere_turns == 0.0 and (powder is None or powder.source is None):
            return Field3D(self, np.zeros(self.elements.n_nodes), 0.0, powder, [(0.0, 0.0)])
        if guess is not None and guess.problem is not self:
            raise ValueError("`guess` belongs to another problem: start from a field of the same one")
        energy = _CoEnergy(self, ampere_turns, powder)
        scale = max(abs(ampere_turns) * self._unit_scale, norm(energy.source_load))
        self._solver.floor = 0.3 * tolerance * scale
        self._solver.scale = None
        start = self._linear_start(energy) if guess is None else guess.phi[self.elements.free_nodes]
        self._solver.floor = 0.3 * tolerance * scale
        self._solver.scale = None if self.linear else scale
        x, history = minimise(
            energy,
            start,
            scale,
            solver=self._solver,
            tolerance=tolerance,
            max_iterations=max_iterations,
            level=None if self.linear else _LEVEL,
        )
        return Field3D(self, self.elements.expand(x), float(ampere_turns), powder, history)

    def _checked(self, fill: Powder) -> PowderState | None:
        if fill is not None and self.powder_law is None:
            raise ValueError("a `fill` was given, but the problem has no `powder_law` to turn it into permeability")
        points = self.powder_basis.dx.shape[1] if self.powder_law is not None else 0
        return checked_powder(fill, self.powder_elements.size, (3, points))

    def flux_slope(self, field: Field3D) -> float:
        """Slope of the flux linkage a turn with N I at a solution and its powder [H], the tangent's energy.

        With H' = T0 - grad phi' of one ampere-turn in the tangent permeability it is the integral of H' . dB/dH . H',
        whose error is of second order in that of phi'.
        """
        energy = _CoEnergy(self, field.ampere_turns, field.powder)
        matrix = energy.hessian(field.phi[self.elements.free_nodes])
        unit = self.elements.split(self.unit_T0)
        flow = [energy.tangent_flow(k, unit[number]) for k, number in enumerate(energy.numbers)]
        right = self._unit_load + energy.load(flow)
        self._solver.scale, self._solver.floor = None, _SLOPE_TOLERANCE * norm(right)
        change = self.elements.expand(self._solver.solve(matrix, right))
        total = 0.0
        for number, basis in enumerate(self.elements.bases):
            H = unit[number] - basis.interpolate(change).grad
            if number in energy.numbers:
                B = energy.tangent_flow(energy.numbers.index(number), H)
            else:
                B = H * np.array([float(law.B(0.0, 1)) for law in self._inverse])[self._material[basis.tind], None]
            total += float(((H * B).sum(axis=0) * basis.dx).sum())
        return self.mesh.n_sectors * (total + 2.0 * self.outer_energy(change))

    def solve_at_flux_linkage(
        self, linkage: float, fill: Powder = None, guess: Field3D | None = None, *, tolerance: float = 1e-8
    ) -> Field3D:
        """The field whose coil links a given flux a turn [Wb], by Newton's method on N I; else as `solve`.

        Raises
        ------
        ConvergenceError
            A solve, or the iteration on N I, did not converge.
        """
        powder = self._checked(fill)
        if linkage == 0.0 and (powder is None or powder.source is None):
            return self.solve(0.0, powder)
        field = self.solve(0.0, powder) if guess is None else guess
        drive, low, high = field.ampere_turns, -np.inf, np.inf
        history = []
        for _ in range(_MAX_LINKAGE_SOLVES):
            # the linkage grows with N I: what is known on either side bounds it
            drive += (linkage - field.flux_linkage_per_turn) / field.flux_slope
            if not low < drive < high:
                drive = 0.5 * (low + high)
            field = self.solve(drive, powder, field if field.phi.any() else None, tolerance=tolerance)
            miss = linkage - field.flux_linkage_per_turn
            # the coil's own part is the scale where it takes away what magnetised powder links
            scale = max(abs(linkage), abs(drive * field.flux_slope))
            history.append((abs(miss) / scale, 1.0))
            if abs(miss) <= _LINKAGE_TOLERANCE * scale:
                return field
            low, high = (max(low, drive), high) if miss > 0.0 else (low, min(high, drive))
        remedy = "the current of this flux linkage was not found: lower the step in time, or newton_tolerance"
        raise ConvergenceError(history, remedy)

    def _linear_start(self, energy: _CoEnergy) -> np.ndarray:
        """The field with chord permeabilities: the solution itself if all are linear."""
        chord = [
            _START_B / law.H_of_B(np.full(basis.dx.shape, _START_B))[0]
            for basis, law in zip(energy.bases, energy.laws, strict=True)
        ]
        first = self._chord_field(energy, chord)
        if self.linear:
            return first
        local = []
        for mu, law, H in zip(chord, energy.laws, energy.field_strength(first), strict=True):
            B = mu * np.sqrt((H * H).sum(axis=0))
            strength = law.H_of_B(B)[0]
            local.append(np.where(strength > 0.0, B / np.where(strength > 0.0, strength, 1.0), mu))
        return min((first, self._chord_field(energy, local)), key=lambda x: energy.value(x)[0])

    def _chord_field(self, energy: _CoEnergy, mu: list[np.ndarray]) -> np.ndarray:
        right = energy.linear_load + energy.load([a * b for a, b in zip(mu, energy.T0, strict=True)])
        if not self.linear:
            self._solver.floor = _START_TOLERANCE * norm(right)
        return self._solver.solve(energy.matrix(mu), right)


class _CoEnergy:
    """W*(phi) of the unknowns; its gradient is -integral B . grad v, its second derivative the tangent.

    The regions of constant permeability and the open boundary are a quadratic form, assembled once; the lists run over
    the bases of the nonlinear regions.
    """

    def __init__(self, problem: Problem3D, ampere_turns: float, powder: PowderState | None = None) -> None:
        self._problem, self._elements = problem, problem.elements
        parts = zip(self._elements.bases, self._elements.groups, self._elements.split(problem.unit_T0), strict=True)
        nonlinear = [(basis, group, ampere_turns * T0) for basis, group, T0 in parts if group >= 0]
        self.bases, names = [basis for basis, _, _ in nonlinear], list(problem.mesh.regions)
        self.numbers = [number for number, group in enumerate(self._elements.groups) if group >= 0]
        of_powder = None if problem.powder_law is None else _PowderAt(problem.powder_law, powder)
        self.laws: list[Any] = [problem.laws[names[k]] if k < len(names) else of_powder for _, k, _ in nonlinear]
        self._inverse: list[Any] = [problem._inverse[k] if k < len(names) else of_powder for _, k, _ in nonlinear]
        self.T0 = [T0 for _, _, T0 in nonlinear]
        self.linear_load, self.source_load = ampere_turns * problem._unit_load, np.zeros(0)
        if powder is not None and powder.source is not None:
            flow = [np.zeros_like(T0) for T0 in self.T0]
            flow[-1] = MU_0 * powder.source.transpose(1, 0, 2)
            self.source_load = self.load(flow)
            self.linear_load = self.linear_load + self.source_load
        self._at: np.ndarray | None = None

    def field_strength(self, x: np.ndarray) -> list[np.ndarray]:
        """H [A/m], each (3, n_elements, n_points)."""
        phi = self._elements.expand(x)
        return [T0 - basis.interpolate(phi).grad for basis, T0 in zip(self.bases, self.T0, strict=True)]

    def load(self, flow: list[np.ndarray]) -> np.ndarray:
        """Integral of flow . grad v over the nonlinear regions for every unknown's v."""
        from . import weak_forms

        total = np.zeros(self._elements.n_nodes)
        for basis, part in zip(self.bases, flow, strict=True):
            total += weak_forms.divergence.assemble(basis, flow=part)
        return self._elements.restrict(total)

    def tangent_flow(self, k: int, H: np.ndarray) -> np.ndarray:
        """Change of B (3, n_elements, n_points) with that of H in basis k, at the state of the last evaluation."""
        size = np.sqrt((self._H[k] ** 2).sum(axis=0))
        direction = self._H[k] / np.where(size > 0.0, size, 1.0)
        return self._mu[k] * H + self._excess[k] * (direction * H).sum(axis=0) * direction

    def matrix(self, mu: list[np.ndarray], excess: list[np.ndarray] | None = None) -> sp.csc_matrix:
        """Tangent of these mu and excess [H/m] at the state of the last evaluation; None: no excess."""
        from . import weak_forms

        if not self.bases:
            return self._problem._linear_matrix
        data = self._problem._packed.copy()
        for k, basis in enumerate(self.bases):
            if excess is None:
                local = weak_forms.stiffness.elemental(basis, mu=mu[k])
            else:
                size = np.sqrt((self._H[k] ** 2).sum(axis=0))
                direction = self._H[k] / np.where(size > 0.0, size, 1.0)
                local = weak_forms.tangent.elemental(basis, mu=mu[k], excess=excess[k], direction=direction)
            data[basis.tind] += packed(local.tolocal())
        return self._elements.pattern.assemble(data)

    def _evaluate(self, x: np.ndarray) -> None:
        if self._at is not None and np.array_equal(self._at, x):
            return
        self._H = self.field_strength(x)
        states = [law.evaluate(np.sqrt((H * H).sum(axis=0))) for law, H in zip(self._inverse, self._H, strict=True)]
        self._mu, self._excess = [mu for mu, _, _ in states], [excess for _, excess, _ in states]
        self._inside = sum(float((w * basis.dx).sum()) for (_, _, w), basis in zip(states, self.bases, strict=True))
        self._flux = self._problem._linear_matrix @ x
        self._at = x.copy()

    def value(self, x: np.ndarray) -> tuple[float, float]:
        self._evaluate(x)
        square, linear = 0.5 * scalar_product(self._flux, x), scalar_product(self.linear_load, x)
        return self._inside + square - linear, self._inside + square + abs(linear)

    def gradient(self, x: np.ndarray) -> np.ndarray:
        self._evaluate(x)
        return self._flux - self.linear_load - self.load([a * b for a, b in zip(self._mu, self._H, strict=True)])

    def hessian(self, x: np.ndarray) -> sp.csc_matrix:
        self._evaluate(x)
        return self.matrix(self._mu, self._excess)

    def chord_hessian(self, x: np.ndarray) -> sp.csc_matrix:
        """Chord instead of tangent where the material saturates (Kachanov's iteration).

        There w* is concave in H^2 and lies below the parabola with mu = B/H: the full step cannot overshoot.
        """
        self._evaluate(x)
        return self.matrix(self._mu, [np.maximum(excess, 0.0) for excess in self._excess])


@dataclass(frozen=True, slots=True, eq=False)
class _PowderAt:
    """The powder's law at its state, with the methods of `InverseLaw` and `Law`."""

    law: PowderLaw
    powder: PowderState | None

    @property
    def _state(self) -> tuple[np.ndarray | float, np.ndarray | None]:
        return (0.0, None) if self.powder is None else self.powder.arguments

    def evaluate(self, H: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        return self.law.of_H(H, *self._state)

    def H_of_B(self, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.law.H_of_B(B, *self._state)


def packed(blocks: np.ndarray) -> np.ndarray:
    """Lower triangles by rows, (k, n (n + 1)/2), of symmetric matrices (k, n, n)."""
    row, column = np.tril_indices(blocks.shape[1])
    return blocks[:, row, column]
