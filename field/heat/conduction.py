"""Conduction of heat in the half-plane (r, z), cooled at the outside, heated in some of its parts.

With temperatures T in degrees C, conductivity k [W/(m K)], heat capacity C [J/(m^3 K)] and heat q [W/m^3],

    C dT/dt = (1/r) d/dr (r k dT/dr) + d/dz (k dT/dz) + q,
    -k dT/dn = h (T - T_o) + epsilon sigma ((T + 273.15)^4 - (T_o + 273.15)^4)

on the outside, n outwards, no flux on the axis (H. S. Carslaw and J. C. Jaeger, Conduction of Heat in Solids, 1959, ch.
1). Multiplied by 2 pi r v and integrated over the section with scikit-fem, elements of order 1 or 2. All integrals are
those of the whole turn, so that every entry of the equations is a power [W]:

    M dT/dt + K T + S(T) = sum over sources j of P_j b_j,

b_j the volume mean over source j: it spreads 1 W evenly over the source's volume, and b_j . T is its mean temperature.
The power of a source may depend on that mean (copper's resistance grows, powder fades), which adds matrices of rank 1
to the tangent; they are inverted by the formula of Sherman, Morrison and Woodbury.

**Runaway.** A coil at a given current I makes I^2 R(T), R(T) = R_0 (1 + alpha (T - T_0)). Where a watt more warms it by
R_th kelvins it has a steady temperature only for alpha R_0 I^2 R_th < 1; beyond, the tangent has a negative eigenvalue.
At a given voltage its power falls with T and it always has one.

**A body behind a surface**, as a shaft: a conductance of h per area to the outside with a heat capacity C_b, shared by
area, in its middle, 2 h before and behind it. At each place of the surface A, (C_b/A) dT_b/dt = 2 h (T - T_b) -
2 h (T_b - T_o), so that no heat passes along or across surfaces through the body. Steady temperatures are those without
C_b.
"""

from __future__ import annotations

import copy
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from field.factorisation import SymmetricSolver
from geometry.section import SectionMesh

STEFAN_BOLTZMANN = 5.670374e-8
"""sigma [W/(m^2 K^4)] (CODATA)."""

KELVIN = 273.15
"""0 degrees C [K]."""

ORDERS = (1, 2)
MOLTEN = 2000.0
"""Temperature [degrees C] above which nothing is solid."""

_NEWTON_STEPS = 100
_HALVINGS = 6
_CLOSE = 1e-10
"""Largest change of a temperature, relative to the largest difference to the outside, at which Newton ends."""
_ROUND_OFF = 1e-6
"""The same of steps that shrink no more: they are round-off, of bodies that conduct far better than they are cooled."""

Powers = Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Mean temperatures of the sources (m,) [degrees C] to their powers (m,) [W] and derivatives (m,) [W/K]."""


class ThermalRunaway(ArithmeticError):
    """The sources' power grows faster with the temperature than the heat that leaves."""


class HeatNotConverged(ArithmeticError):
    """Newton's method found no temperatures."""


@dataclass(frozen=True, slots=True)
class CooledSurface:
    """A part of the outside.

    Attributes
    ----------
    name : str
    edges : ndarray (k, 2), int
        Pairs of the mesh's points.
    film : float
        Heat transfer coefficient h [W/(m^2 K)], >= 0.
    emissivity : float
        epsilon [-], 0 to 1.
    outside : float
        T_o [degrees C].
    capacity : float
        Heat capacity [J/K], shared by area, of a body in the middle of the film, >= 0; with one, emissivity must be 0.
    """

    name: str
    edges: np.ndarray
    film: float
    emissivity: float
    outside: float
    capacity: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 <= self.capacity < np.inf or (self.capacity > 0.0 and (self.emissivity > 0.0 or self.film == 0.0)):
            raise ValueError(
                f"`capacity` = {self.capacity} J/K behind the surface {self.name} must be 0 or more, with a film above "
                "0 and no emissivity"
            )


def outer_edges(mesh: SectionMesh, elements: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Edges (k, 2) of exactly one of some elements, those on the axis excepted, and that element (k,) of each."""
    corners = mesh.triangles[elements]
    edges = np.sort(np.vstack([corners[:, [0, 1]], corners[:, [1, 2]], corners[:, [2, 0]]]), axis=1)
    owner = np.tile(elements, 3)
    _, first, count = np.unique(edges, axis=0, return_index=True, return_counts=True)
    single = first[count == 1]
    off_axis = np.any(mesh.points[edges[single], 0] > 0.0, axis=1)
    return edges[single][off_axis], owner[single][off_axis]


class HeatProblem:
    """The equations on a part of a section.

    Parameters
    ----------
    mesh : SectionMesh
    elements : ndarray (n,), int
        Those that conduct.
    conductivity, capacity : ndarray (n,)
        k [W/(m K)] and C [J/(m^3 K)] of each, > 0.
    surfaces : sequence of CooledSurface
        An edge of the outside in none of them is insulated.
    sources : mapping of str to ndarray, int
        Elements of the mesh that each source heats evenly.
    order : int
        1 or 2.

    Attributes
    ----------
    points : ndarray (n, 2)
        Where the unknowns live, (r, z) [m]; those of bodies behind surfaces follow, which are not among them.
    M, K : csc_matrix (n_dofs, n_dofs)
        [J/K] and [W/K].
    spread : ndarray (n_dofs, m)
        Columns b_j.
    names : tuple of str
        Of the sources.

    Raises
    ------
    ValueError
        An order, a property or a source that cannot be; nothing that cools.
    """

    def __init__(
        self,
        mesh: SectionMesh,
        elements: np.ndarray,
        conductivity: np.ndarray,
        capacity: np.ndarray,
        surfaces: Sequence[CooledSurface],
        sources: Mapping[str, np.ndarray],
        order: int = 1,
    ) -> None:
        import skfem  # here, because importing it costs a third of a second
        from skfem.helpers import dot, grad

        if order not in ORDERS:
            raise ValueError(f"`order` = {order} of the temperature's elements must be 1 or 2")
        for name, values in (("conductivity", conductivity), ("capacity", capacity)):
            if not (np.all(np.isfinite(values)) and np.all(values > 0.0)):
                raise ValueError(f"`{name}` of every element must be a finite number above 0")
        if not any(one.film > 0.0 or one.emissivity > 0.0 for one in surfaces if len(one.edges)):
            raise ValueError("`surfaces`: nothing cools; give a surface with a film or an emissivity above 0")
        used, local = np.unique(mesh.triangles[elements], return_inverse=True)
        number = np.full(len(mesh.points), -1)
        number[used] = np.arange(len(used))
        self.mesh, self.elements, self.order = mesh, elements, order
        self.corners = local.reshape(-1, 3)
        section = skfem.MeshTri(mesh.points[used].T.copy(), self.corners.T.copy())
        element = (skfem.ElementTriP1, skfem.ElementTriP2)[order - 1]()
        intorder = 2 * order + 1
        basis = skfem.Basis(section, element, intorder=intorder)
        self.points = np.ascontiguousarray(basis.doflocs.T)
        self.n_dofs = int(basis.N)

        @skfem.BilinearForm
        def conduction(u, v, w):
            return 2.0 * np.pi * w.x[0] * w.k * dot(grad(u), grad(v))

        @skfem.BilinearForm
        def storage(u, v, w):
            return 2.0 * np.pi * w.x[0] * w.k * u * v

        @skfem.LinearForm
        def volume(v, w):
            return 2.0 * np.pi * w.x[0] * w.k * v

        def each(values: np.ndarray) -> np.ndarray:
            return np.broadcast_to(np.asarray(values, float)[:, None], basis.dx.shape)

        self.K = sp.csc_matrix(conduction.assemble(basis, k=each(conductivity)))
        self.M = sp.csc_matrix(storage.assemble(basis, k=each(capacity)))
        place = np.full(len(mesh.triangles), -1)
        place[elements] = np.arange(len(elements))
        self.names = tuple(sources)
        columns = []
        for name, heated in sources.items():
            inside = place[np.asarray(heated, int)]
            if not len(inside) or np.any(inside < 0):
                raise ValueError(f"`sources`: {name} has no element of the conducting part, or one outside of it")
            marked = np.zeros(len(elements))
            marked[inside] = 1.0
            column = volume.assemble(basis, k=each(marked))
            columns.append(column / column.sum())
        self.spread = np.column_stack(columns) if columns else np.zeros((self.n_dofs, 0))
        self._heated_dofs = [np.unique(basis.element_dofs[:, place[np.asarray(own, int)]]) for own in sources.values()]
        films = [_Film(skfem, section, element, intorder, one, number) for one in surfaces if len(one.edges)]
        self._surfaces = [self._with_body(one) if one.surface.capacity else one for one in films]
        # one pattern for all matrices, so that the ordering of the factorisation is computed once
        pattern = abs(self.K) + abs(self.M)
        for surface in self._surfaces:
            pattern = pattern + abs(surface.tangent(np.zeros(self.n_dofs), self.n_dofs))
        self._pattern = sp.csc_matrix(pattern)
        self._pattern.data[:] = 0.0
        self._pattern.sort_indices()
        self._solver = SymmetricSolver()

    def _with_body(self, film: _Film) -> _Film:
        """Add the unknowns of the body behind a film, one for each of its own; the film that leads to the outside."""
        n, m = self.n_dofs, len(film.dofs)
        behind = film.behind(n)
        exchange = behind.tangent(np.zeros(n + m), n + m)[n:, n:]
        onto = sp.csc_matrix((np.ones(m), (film.dofs, np.arange(m))), shape=(n, m))
        to_body = onto @ exchange
        self.K = sp.csc_matrix(sp.bmat([[self.K + to_body @ onto.T, -to_body], [-to_body.T, exchange]]))
        self.M = sp.csc_matrix(sp.block_diag([self.M, (film.surface.capacity / exchange.sum()) * exchange]))
        self.spread = np.vstack((self.spread, np.zeros((m, len(self.names)))))
        self.n_dofs = n + m
        return behind

    @property
    def outside(self) -> float:
        """Lowest temperature [degrees C] of all that cools."""
        return min(one.surface.outside for one in self._surfaces)

    @property
    def heat_content(self) -> np.ndarray:
        """(n_dofs,) [J/K]: times temperatures, the energy [J] above 0 degrees C."""
        return np.asarray(self.M.sum(axis=0)).ravel()

    def with_films(self, films: Mapping[str, float]) -> HeatProblem:
        """The same with other heat transfer coefficients [W/(m^2 K)] of the surfaces named."""
        other = copy.copy(self)
        other._surfaces = [one.with_film(films.get(one.surface.name, one.surface.film)) for one in self._surfaces]
        return other

    def means(self, temperature: np.ndarray) -> np.ndarray:
        """Volume mean of each source [degrees C], (m,), of temperatures (n_dofs,)."""
        return self.spread.T @ temperature

    def largest(self, temperature: np.ndarray) -> np.ndarray:
        """Largest temperature in each source [degrees C], (m,)."""
        return np.array([temperature[dofs].max() for dofs in self._heated_dofs])

    def losses(self, temperature: np.ndarray) -> dict[str, float]:
        """Heat [W] that leaves through each surface."""
        return {one.surface.name: float(one.loss(temperature).sum()) for one in self._surfaces}

    def surface_temperatures(self, temperature: np.ndarray) -> dict[str, float]:
        """Largest temperature [degrees C] of each surface."""
        return {one.surface.name: float(temperature[one.dofs].max()) for one in self._surfaces}

    def loss(self, temperature: np.ndarray) -> np.ndarray:
        """S(T), (n_dofs,) [W]."""
        total = np.zeros(self.n_dofs)
        for one in self._surfaces:
            np.add.at(total, one.facet_dofs.ravel(), one.loss(temperature).ravel())
        return total

    def loss_tangent(self, temperature: np.ndarray) -> sp.csc_matrix:
        """dS/dT, (n_dofs, n_dofs) [W/K]."""
        return sum((one.tangent(temperature, self.n_dofs) for one in self._surfaces), self._pattern)

    def tangent(self, temperature: np.ndarray, rate: float = 0.0) -> sp.csc_matrix:
        """rate M + K + dS/dT in the common pattern; `rate` is 1 over a step of time [1/s], 0 steady."""
        return sp.csc_matrix(rate * self.M + self.K + self.loss_tangent(temperature) + self._pattern)

    def factorised(self, matrix: sp.csc_matrix, solver: SymmetricSolver | None = None) -> Factorised:
        """The matrix with the columns of the sources solved; a `solver` is used again, and forgets its last matrix."""
        solver = SymmetricSolver() if solver is None else solver
        matrix.sort_indices()
        solver.factorise(matrix)
        return Factorised(solver, self.spread, solver.solve_again(self.spread) if len(self.names) else self.spread)

    def steady(self, powers: Powers, start: float | np.ndarray = 250.0) -> np.ndarray:
        """Return the temperatures (n_dofs,) [degrees C] at which as much heat leaves as the sources make.

        Newton's method from a uniform temperature or a state (n_dofs,) [degrees C], best above the solution: with
        constant powers it then falls to it monotonically, as S is convex. Powers with kinks could make it jump between
        two of their pieces, and one whose derivative is only part of the true one makes it converge linearly: a step
        after which the residual is not smaller is halved.

        Raises
        ------
        ThermalRunaway
            At the start or on the way the sources' power grows faster with the temperature than the heat that leaves:
            from a hot start, there is no solution below it.
        HeatNotConverged
            It did not converge.
        """

        def residual_and_slope(temperature: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
            power, slope = powers(self.means(temperature))
            return self.K @ temperature + self.loss(temperature) - self.spread @ power, slope

        temperature = np.broadcast_to(np.asarray(start, float), (self.n_dofs,)).copy()
        residual, slope = residual_and_slope(temperature)
        last = np.inf
        for _ in range(_NEWTON_STEPS):
            step = self.factorised(self.tangent(temperature), self._solver).solve(residual, slope)
            if not np.all(np.isfinite(step)):
                break
            change = np.abs(step).max() / max(1.0, float(np.abs(temperature - step - self.outside).max()))
            if change <= _CLOSE or 0.5 * last < change <= _ROUND_OFF:
                return temperature - step
            last = change
            size, fraction = np.linalg.norm(residual), 1.0
            for _ in range(_HALVINGS + 1):
                tried = temperature - fraction * step
                residual, slope = residual_and_slope(tried)
                if np.linalg.norm(residual) <= (1.0 - 0.1 * fraction) * size:
                    break
                fraction *= 0.5
            temperature = tried
            if np.abs(temperature).max() > MOLTEN:
                raise ThermalRunaway(f"there are no steady temperatures below {MOLTEN:g} degrees C")
        raise HeatNotConverged(f"no steady temperatures within {_NEWTON_STEPS} steps of Newton's method")


@dataclass(frozen=True, slots=True)
class Factorised:
    """A factorised matrix A and the response A^-1 b of the sources, (n_dofs, m)."""

    solver: Any
    spread: np.ndarray
    response: np.ndarray

    def solve(self, right: np.ndarray, slope: np.ndarray) -> np.ndarray:
        """Solve (A - sum of slope_j b_j b_j^T) x = right, by Woodbury's formula.

        Raises
        ------
        ThermalRunaway
            The matrix is not positive definite.
        """
        x = self.solver.solve_again(right)
        if not np.any(slope):
            return x
        small = np.eye(len(slope)) - slope[:, None] * (self.spread.T @ self.response)
        # A is positive definite, so the sum is as long as no eigenvalue has passed 0
        if np.linalg.eigvals(small).real.min() <= 1e-9:
            raise ThermalRunaway("the sources' power grows faster with their temperature than the heat that leaves")
        return x + self.response @ np.linalg.solve(small, slope * (self.spread.T @ x))


class _Film:
    """The integrals over one surface."""

    def __init__(self, skfem: Any, section: Any, element: Any, intorder: int, surface: CooledSurface, number: Any):
        edges = np.sort(number[surface.edges], axis=1)
        if np.any(edges < 0):
            raise ValueError(f"`surfaces`: {surface.name} has an edge that is none of the conducting part")
        facets = {(int(a), int(b)): k for k, (a, b) in enumerate(np.sort(section.facets, axis=0).T)}
        basis = skfem.FacetBasis(
            section, element, facets=np.array([facets[int(a), int(b)] for a, b in edges]), intorder=intorder
        )
        self.surface = surface
        shape = np.array([np.broadcast_to(np.asarray(each[0]), basis.dx.shape) for each in basis.basis])
        shape = shape.transpose(1, 2, 0)  # (k, n_quadrature, of the facet's element)
        own = np.nonzero(np.any(np.abs(shape) > 1e-12, axis=1))[1].reshape(len(shape), -1)
        self.facet_dofs = np.take_along_axis(basis.element_dofs.T, own, axis=1)  # (k, n_basis)
        self._shape = np.take_along_axis(shape, own[:, None], axis=2)  # (k, n_quadrature, n_basis)
        self._weight = 2.0 * np.pi * np.asarray(basis.global_coordinates())[0] * basis.dx  # (k, n_quadrature) [m^2]
        self.dofs = np.unique(self.facet_dofs)

    def with_film(self, film: float) -> _Film:
        """The same with another heat transfer coefficient [W/(m^2 K)]; ValueError with a body behind the surface."""
        if self.surface.capacity and film != self.surface.film:
            raise ValueError(f"the film of {self.surface.name} leads into a body; make the problem again")
        other = copy.copy(self)
        other.surface = replace(self.surface, film=film)
        return other

    def behind(self, first: int) -> _Film:
        """The film from a body in its middle to the outside; the body's unknowns begin at ``first``."""
        other = copy.copy(self)
        other.surface = replace(self.surface, film=2.0 * self.surface.film)
        other.facet_dofs = first + np.searchsorted(self.dofs, self.facet_dofs)
        other.dofs = first + np.arange(len(self.dofs))
        return other

    def _at(self, temperature: np.ndarray) -> np.ndarray:
        return np.einsum("kqi,ki->kq", self._shape, temperature[self.facet_dofs])

    def loss(self, temperature: np.ndarray) -> np.ndarray:
        """The heat (k, n_basis) [W] that leaves, by unknown."""
        T, one = self._at(temperature), self.surface
        flux = one.film * (T - one.outside)
        flux += one.emissivity * STEFAN_BOLTZMANN * ((T + KELVIN) ** 4 - (one.outside + KELVIN) ** 4)
        return np.einsum("kqi,kq->ki", self._shape, flux * self._weight)

    def tangent(self, temperature: np.ndarray, n_dofs: int) -> sp.csc_matrix:
        """Its derivative [W/K]."""
        T, one = self._at(temperature), self.surface
        slope = one.film + 4.0 * one.emissivity * STEFAN_BOLTZMANN * (T + KELVIN) ** 3
        local = np.einsum("kqi,kqj,kq->kij", self._shape, self._shape, slope * self._weight)
        n = self.facet_dofs.shape[1]
        rows = np.repeat(self.facet_dofs, n, axis=1).ravel()
        columns = np.tile(self.facet_dofs, (1, n)).ravel()
        return sp.csc_matrix((local.ravel(), (rows, columns)), shape=(n_dofs, n_dofs))
