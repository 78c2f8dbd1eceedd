"""Linear solves of the scalar potential: a factorisation while it fits, else conjugate gradients.

The preconditioner for quadratic elements works on two orders: a Gauss-Seidel sweep on the quadratic unknowns,
a correction in the space of the linear elements (their Galerkin matrix), and the sweep backwards.  Linear
elements' systems are what algebraic multigrid was made for (Ruge and Stueben 1987); the sweeps take care of
the edge unknowns, whose errors are all short waves.  The coarse solve is, in this order,

    a V-cycle of pyamg's classical multigrid;  without pyamg a factorisation of the linear elements' matrix
    while it has at most `DIRECT_CORNERS` unknowns;  else nothing: symmetric Gauss-Seidel alone.
"""

from __future__ import annotations

import importlib.util
import math
from collections.abc import Callable
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp
from numba import njit

from field.factorisation import Backend, SymmetricSolver, available_backends, describe_backend

if TYPE_CHECKING:
    from .elements_3d import Elements3D

DIRECT_UNKNOWNS: dict[Backend, int] = {"cholmod": 25_000, "superlu": 8_000}
"""Up to so many unknowns "auto" factorises; above, conjugate gradients are faster, or take up to half as long again.

Processor time [s] of a nonlinear solve from zero, in steel, P1 or P2 (two cores of 2.1 GHz, CHOLMOD of cvxopt 1.3.3,
pyamg 5.4.1):

=============================  ========  =======  =======  =========
mesh                           unknowns  CHOLMOD  SuperLU  multigrid
=============================  ========  =======  =======  =========
pot core, a quarter, P1           2 634     0.30     0.48        1.6
the same                          8 189      1.4      2.9        1.5
the same                         14 490      2.7       15        3.8
the same, P2                      8 426     0.87      2.3        2.4
the same                         18 726      2.4       11        2.4
the same                         32 756      6.9                 4.3
the same                         60 752       18                 8.0
slotted disc, 1/120, P1           7 256      1.1      2.4        2.5
the same, P2                     12 532     0.88       10        2.4
the same                         51 966      8.1                  12
=============================  ========  =======  =======  =========

A thin sector is nearly two-dimensional: its factors stay small, and its stretched elements take 50 to 148 iterations
where the quarter takes 6 to 60. They are the cost: setting up the preconditioner takes 0.03 s of a linear solve of
2.3 s, and with the linear elements' matrix factorised it takes 106 iterations instead of 148, with three sweeps 88.
"""

# Without pyamg: the largest linear system whose factors are still cheap in time and memory.
DIRECT_CORNERS = 40_000
_MAX_ITERATIONS = 500


class NodalSolver:
    """Symmetric positive definite systems of one sparsity pattern.

    Parameters
    ----------
    prolongation : csr_matrix (n, n_corners) or None
        From linear to quadratic unknowns; None for linear elements.
    method : str
        `auto`, `direct` or `multigrid`.

    Attributes
    ----------
    floor : float
        Absolute residual at which an iterative solve may stop, whatever its right-hand side.
    scale : float or None
        None: solve down to `floor`, or to 1e-10 of the right-hand side if that is more. Else Newton's scale:
        the residual's reduction follows its size, min(0.01, |right|/scale), which keeps Newton quadratic and
        wastes nothing on its first steps.
    iterations : list of int
        Of every iterative solve so far.
    """

    def __init__(self, prolongation: sp.csr_matrix | None, size: int, method: str = "auto") -> None:
        if method not in ("auto", "direct", "multigrid"):
            raise ValueError(f"`method` = {method!r} of the linear solver must be 'auto', 'direct' or 'multigrid'")
        self._prolongation = prolongation
        n_coarse = size if prolongation is None else prolongation.shape[1]
        small = size <= DIRECT_UNKNOWNS[available_backends()[0]]
        self._direct = SymmetricSolver() if method == "direct" or (method == "auto" and small) else None
        if self._direct is not None:
            self._coarse = "factorisation"
        elif importlib.util.find_spec("pyamg") is not None:
            self._coarse = "pyamg"
        else:
            self._coarse = "factorised" if n_coarse <= DIRECT_CORNERS else "none"
        self.floor = 0.0
        self.scale: float | None = None
        self.iterations: list[int] = []
        self._last: tuple[sp.csr_matrix, Callable[[np.ndarray], np.ndarray]] | None = None

    @property
    def again_is_cheap(self) -> bool:
        """Only a factorisation's second solve is."""
        return self._direct is not None

    def description(self) -> str:
        """One line that says what is in use."""
        if self._direct is not None:
            return describe_backend()
        return (
            "conjugate gradients, "
            + {
                "pyamg": "two-order Gauss-Seidel over classical algebraic multigrid (pyamg)",
                "factorised": "two-order Gauss-Seidel over a factorised linear system (install pyamg for larger ones)",
                "none": "symmetric Gauss-Seidel only: slow; install pyamg",
            }[self._coarse]
        )

    def solve(self, matrix: sp.csc_matrix, right: np.ndarray) -> np.ndarray:
        """Solve for one right-hand side.

        Raises
        ------
        RuntimeError
            Conjugate gradients did not reach the tolerance.
        """
        if self._direct is not None:
            return self._direct.solve(matrix, right)
        # symmetric: the columns are the rows
        rows = sp.csr_matrix((matrix.data, matrix.indices, matrix.indptr), shape=matrix.shape)
        self._last = (rows, self._preconditioner(rows))
        return self.solve_again(right)

    def solve_again(self, right: np.ndarray) -> np.ndarray:
        """Solve for another right-hand side with the matrix of the last call of `solve`."""
        if self._direct is not None:
            return self._direct.solve_again(right)
        if self._last is None:
            raise RuntimeError("`solve` comes first: there is no matrix yet")
        return self._conjugate_gradients(self._last[0], right, self._last[1])

    def _preconditioner(self, A: sp.csr_matrix) -> Callable[[np.ndarray], np.ndarray]:
        P = self._prolongation
        coarse_matrix = A if P is None else (P.T @ (A @ P)).tocsr()
        coarse = self._coarse_solve(coarse_matrix)
        if P is None and coarse is not None:
            return coarse
        indptr, indices, data = A.indptr, A.indices, A.data
        PT = None if P is None else P.T.tocsr()

        def apply(residual: np.ndarray) -> np.ndarray:
            x = np.zeros_like(residual)
            _sweep(indptr, indices, data, residual, x, False)
            if coarse is not None and P is not None and PT is not None:
                x += P @ coarse(PT @ (residual - A @ x))
            _sweep(indptr, indices, data, residual, x, True)
            return x

        return apply

    def _coarse_solve(self, matrix: sp.csr_matrix) -> Callable[[np.ndarray], np.ndarray] | None:
        if self._coarse == "pyamg":
            import pyamg

            # 0.5: in stretched elements only the strongest neighbours make a good coarse grid;
            # splu: the pseudo-inverse that pyamg takes otherwise costs more than the rest of the set-up
            strength = ("classical", {"theta": 0.5})
            levels = pyamg.ruge_stuben_solver(matrix, strength=strength, max_coarse=200, coarse_solver="splu")
            return levels.aspreconditioner(cycle="V").matvec
        if self._coarse == "factorised":
            solver = SymmetricSolver()
            solver.factorise(matrix.tocsc())
            return solver.solve_again
        return None

    def _conjugate_gradients(
        self, A: sp.csr_matrix, right: np.ndarray, precondition: Callable[[np.ndarray], np.ndarray]
    ) -> np.ndarray:
        size = math.sqrt(float((right * right).sum()))
        if self.scale is None:
            goal = self.floor if self.floor > 0.0 else 1e-10 * size
        else:
            goal = max(min(0.01, size / self.scale) * size, self.floor)
        x = np.zeros_like(right)
        r = right.copy()
        z = precondition(r)
        p = z.copy()
        rz = float((r * z).sum())
        for iteration in range(1, _MAX_ITERATIONS + 1):
            Ap = A @ p
            length = rz / float((p * Ap).sum())
            x += length * p
            r -= length * Ap
            if math.sqrt(float((r * r).sum())) <= goal:
                self.iterations.append(iteration)
                return x
            z = precondition(r)
            new = float((r * z).sum())
            p = z + (new / rz) * p
            rz = new
        raise RuntimeError(
            f"conjugate gradients ({self.description()}) left a residual of "
            f"{math.sqrt(float((r * r).sum())):.2e}, above {goal:.2e}, after {_MAX_ITERATIONS} iterations: "
            "install pyamg, or look for nearly flat elements in the mesh"
        )


def linear_to_quadratic(elements: Elements3D) -> sp.csr_matrix | None:
    """Interpolation (n_free, n_free_corners) from the unknowns of linear elements; None: the elements are linear."""
    if elements.order == 1:
        return None
    number = elements.number[: elements.n_corners]
    kept = np.flatnonzero(number >= 0)
    corners = sp.csr_matrix(
        (np.ones(kept.size), (kept, number[kept])), shape=(elements.n_corners, elements.n_free_corners)
    )
    ends = elements.edge_ends
    halves = sp.csr_matrix(
        (np.full(ends.size, 0.5), ends.ravel(), np.arange(0, ends.size + 1, 2)), shape=(len(ends), elements.n_corners)
    )
    return sp.vstack((corners, halves @ corners)).tocsr()[elements.free_nodes]


@njit(cache=True, error_model="numpy", nogil=True)
def _sweep(indptr, indices, data, right, x, backwards):
    """One Gauss-Seidel sweep, in place."""
    n = right.size
    for k in range(n):
        i = n - 1 - k if backwards else k
        value, diagonal = right[i], 1.0
        for s in range(indptr[i], indptr[i + 1]):
            j = indices[s]
            if j == i:
                diagonal = data[s]
            else:
                value -= data[s] * x[j]
        x[i] = value / diagonal
