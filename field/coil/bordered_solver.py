"""Newton steps of a field whose coil current is an unknown too.

A coil couples to all of the field through one vector c (its load per ampere-turn), so that the tangent is
that of the field, A, with a rank-one term or with one constraint; both cost one right-hand side more of the
same factorisation (Sherman and Morrison 1950; Golub and Van Loan, Matrix Computations, 4th ed., sec. 2.1.4):

    (A + a c c^T) x = b                          x = y - z a c.y/(1 + a c.z)
    A x + c s = b,  c.x = 0                      x = y - z c.y/(c.z)              A y = b,  A z = c.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from field.factorisation import SymmetricSolver
from field.newton import scalar_product


class RankOneSolver(SymmetricSolver):
    """Solves with A + a c c^T, a >= 0; the solver it is built on keeps its analysis of the pattern of A.

    Parameters
    ----------
    solver : SymmetricSolver
    vector : ndarray (n,)
        c.
    factor : float
        a; infinite for the constraint c.x = 0.
    """

    def __init__(self, solver: SymmetricSolver, vector: np.ndarray, factor: float) -> None:
        self.backend = solver.backend
        self._solver = solver
        self._vector = vector
        self._weight = factor
        self._response = np.zeros(0)

    def factorise(self, matrix: sp.csc_matrix) -> None:
        """See `SymmetricSolver.factorise`."""
        self._solver.factorise(matrix)
        if self._weight != 0.0:
            self._response = self._solver.solve_again(self._vector)

    def solve_again(self, right: np.ndarray) -> np.ndarray:
        """See `SymmetricSolver.solve_again`; one right-hand side (n,)."""
        y = self._solver.solve_again(right)
        if self._weight == 0.0:
            return y
        # an infinite weight is the constraint: 1/a is then nothing
        bottom = 1.0 / self._weight + scalar_product(self._vector, self._response)
        return y - self._response * (scalar_product(self._vector, y) / bottom)
