"""The energy of a section's field as a function of the free unknowns: what Newton's method minimises."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from field.newton import scalar_product
from field.section.powder_state import PowderState
from field.section.steel_history import HistoryStep, SteelHistory

if TYPE_CHECKING:
    from field.section.axisymmetric import AxisymmetricProblem

# A cold start takes each material's chord H/B at this flux density, a loaded iron circuit's.
_START_B = 1.0


class SectionEnergy:
    """W(psi) = integral of r w(|grad psi|/r) - r M . B - J psi over the section, of the free unknowns.

    M is the powder's source, the part of its magnetisation that is no function of B. Where steel has a history, w is
    the work of the step from it, whose derivative H is as well.
    """

    def __init__(
        self,
        problem: AxisymmetricProblem,
        powder: PowderState | None,
        source: np.ndarray,
        boundary: np.ndarray,
        history: SteelHistory | None = None,
    ) -> None:
        self._problem = problem
        self._history = history
        self._step: HistoryStep | None = None
        self._elements = problem.elements
        self._powder = powder
        self._boundary = boundary
        self.source = source
        if powder is not None and powder.source is not None:
            self.source = source + problem.magnetisation_load(powder.source)
        self._point: tuple[np.ndarray, np.ndarray, np.ndarray] | None = None
        self._law: tuple[np.ndarray, np.ndarray] | None = None

    def expand(self, x: np.ndarray) -> np.ndarray:
        """psi of all unknowns."""
        psi = self._boundary.copy()
        psi[self._problem._free] = x
        return psi

    def _flux(self, x: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        # the line search evaluates value and gradient at the same point
        if self._point is None or self._point[0] is not x:
            self._point = (x, *self._elements.flux(self.expand(x)))
            if self._history is not None:
                self._step = self._history.step(self._elements, self._point[1])
        return self._point[1:]

    def value(self, x: np.ndarray) -> tuple[float, float]:
        _, B = self._flux(x)
        w = self._problem.energy_density(B, self._powder)
        stored = float((w * self._elements.radius * self._elements.weight).sum())
        if self._step is not None:
            stored += self._step.work
        if self._problem.exterior is not None:
            stored += self._problem.exterior.energy(self.expand(x))
        work = scalar_product(self.source, self.expand(x))
        return stored - work, stored + abs(work)

    def gradient(self, x: np.ndarray) -> np.ndarray:
        gradient, B = self._flux(x)
        H, slope = self._problem.H_of_B(B, self._powder)
        here = B > 0.0
        nu = np.where(here, H / np.where(here, B, 1.0), slope)
        self._law = (nu, slope)
        internal = self._elements.field_force(gradient, nu)
        if self._step is not None:
            internal += self._elements.divergence(self._step.flow)
        if (exterior := self._problem.exterior) is not None:
            internal[exterior.dofs] += exterior.force(self.expand(x))
        return (internal - self.source)[self._problem._free]

    def hessian(self, x: np.ndarray) -> sp.csc_matrix:
        assert self._law is not None, "gradient(x) comes first"
        gradient, B = self._flux(x)
        return self._matrix(gradient, B, *self._law, self._step)

    def chord_hessian(self, x: np.ndarray) -> sp.csc_matrix:
        """The tangent with dH/dB of at least half the chord H/B: steel with a long toe (DC01) else takes cut steps."""
        assert self._law is not None, "gradient(x) comes first"
        nu, slope = self._law
        return self._matrix(*self._flux(x), nu, np.maximum(slope, 0.5 * nu), self._step)

    def _matrix(
        self, gradient: np.ndarray, B: np.ndarray, nu: np.ndarray, slope: np.ndarray, step: HistoryStep | None = None
    ) -> sp.csc_matrix:
        exterior = self._problem.exterior
        dense = None if exterior is None else exterior.matrix
        packed = self._elements.field_tangent(gradient, B, nu, slope)
        if step is not None:
            for steel, tangent in step.tangents:
                packed[steel] += self._elements.packed_tangent(steel, tangent)
        return self._problem._pattern.assemble(packed, dense)

    def chord_matrix(self) -> sp.csc_matrix:
        """The matrix with nu = H/B of each material at a typical flux density."""
        B = np.full_like(self._elements.radius, _START_B)
        H, _ = self._problem.H_of_B(B, self._powder)
        nu = H / B
        gradient = np.zeros((len(B), 2, B.shape[1]))
        return self._matrix(gradient, 0.0 * B, nu, nu)
