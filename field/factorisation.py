"""Sparse symmetric positive definite systems by a direct factorisation whose ordering is computed once.

Two backends solve the same system to round-off:

- CHOLMOD (supernodal Cholesky with AMD ordering, through the wheels of cvxopt, the extra `fast`): the
  symbolic analysis is kept for a pattern, each matrix costs one numerical factorisation.
- SuperLU of scipy in symmetric mode, always there: minimum degree on A + A^T, its permutation kept for a
  pattern, diagonal pivots.  COLAMD, SuperLU's default, ignores the symmetry and takes some fifteen times
  longer here.

Sources: Chen, Davis, Hager, Rajamanickam, ACM TOMS 35 (2008) 22; Li, Demmel, ACM TOMS 29 (2003) 110.
"""

from __future__ import annotations

from typing import Literal, Protocol

import numpy as np
import scipy.sparse as sp
from scipy.sparse.linalg import splu

Backend = Literal["cholmod", "superlu"]


class NotPositiveDefinite(ArithmeticError):
    """The matrix is singular or indefinite."""


def available_backends() -> list[Backend]:
    """Backends that can be used here, the fastest first."""
    try:
        import cvxopt.cholmod  # noqa: F401
    except ImportError:
        return ["superlu"]
    return ["cholmod", "superlu"]


def describe_backend(backend: Backend | None = None) -> str:
    """One line on the factorisation in use (the default one if not named)."""
    chosen = backend or available_backends()[0]
    if chosen == "cholmod":
        import cvxopt

        return f"sparse factorisation: CHOLMOD (cvxopt {cvxopt.__version__})"
    missing = (
        "" if "cholmod" in available_backends() else "; the extra `fast` (cvxopt) brings CHOLMOD, 5 to 7 times faster"
    )
    return f"sparse factorisation: SuperLU in symmetric mode{missing}"


class SymmetricSolver:
    """Factorises matrices of one sparsity pattern again and again.

    Parameters
    ----------
    backend : "cholmod", "superlu" or None
        None: the fastest that is installed.

    Attributes
    ----------
    factorisations : int
        How many were made so far.

    Raises
    ------
    ValueError
        A backend that is not installed.
    """

    again_is_cheap = True

    def __init__(self, backend: Backend | None = None) -> None:
        here = available_backends()
        if backend is not None and backend not in here:
            raise ValueError(f"`backend` = {backend!r} is not available; choose one of {', '.join(here)}")
        self.backend: Backend = backend or here[0]
        self._factor: _Factor | None = None
        self.factorisations = 0

    def solve(self, matrix: sp.csc_matrix, right: np.ndarray) -> np.ndarray:
        """Solve for one right-hand side (n,) or several (n, k); every call must bring the same pattern.

        Parameters
        ----------
        matrix : csc_matrix (n, n)
            Symmetric positive definite, both triangles stored, indices sorted.

        Raises
        ------
        NotPositiveDefinite
            With CHOLMOD always, with SuperLU only for an exactly singular matrix.
        """
        self.factorise(matrix)
        return self.solve_again(right)

    def factorise(self, matrix: sp.csc_matrix) -> None:
        """Factorise; `solve_again` then solves with it."""
        if self._factor is None:
            self._factor = _Cholmod(matrix) if self.backend == "cholmod" else _SuperLU(matrix)
        self._factor.factorise(matrix)
        self.factorisations += 1

    def solve_again(self, right: np.ndarray) -> np.ndarray:
        """Solve with the matrix that was factorised last."""
        assert self._factor is not None, "factorise(matrix) comes first"
        return self._factor.solve(right)


class _Factor(Protocol):
    def factorise(self, matrix: sp.csc_matrix) -> None: ...
    def solve(self, right: np.ndarray) -> np.ndarray: ...


class _Cholmod:
    def __init__(self, matrix: sp.csc_matrix) -> None:
        from cvxopt import cholmod, spmatrix
        from cvxopt import matrix as dense

        self._cholmod = cholmod
        column = np.repeat(np.arange(matrix.shape[1]), np.diff(matrix.indptr))
        self._lower = np.flatnonzero(matrix.indices >= column)
        rows, columns = matrix.indices[self._lower], column[self._lower]
        # spmatrix drops nothing and keeps the order of a sorted CSC pattern
        self._matrix = spmatrix(1.0, dense(rows.astype(np.int64)), dense(columns.astype(np.int64)), matrix.shape)
        self._symbolic = cholmod.symbolic(self._matrix)

    def factorise(self, matrix: sp.csc_matrix) -> None:
        from cvxopt import matrix as dense

        self._matrix.V = dense(matrix.data[self._lower])
        try:
            self._cholmod.numeric(self._matrix, self._symbolic)
        except ArithmeticError as error:
            raise NotPositiveDefinite(f"pivot {error.args[0]} is not positive") from error

    def solve(self, right: np.ndarray) -> np.ndarray:
        from cvxopt import matrix as dense

        x = dense(np.asfortranarray(right, dtype=float))
        self._cholmod.solve(self._symbolic, x)
        return np.array(x).reshape(right.shape)


class _SuperLU:
    _OPTIONS = {"SymmetricMode": True}

    def __init__(self, matrix: sp.csc_matrix) -> None:
        try:
            first = splu(matrix, permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options=self._OPTIONS)
        except RuntimeError as error:
            raise NotPositiveDefinite(str(error)) from error
        self._order = np.argsort(first.perm_c)
        # the entries' own positions travel through the permutation and say where each one goes
        numbered = sp.csc_matrix((np.arange(1.0, matrix.nnz + 1.0), matrix.indices, matrix.indptr), shape=matrix.shape)
        numbered = numbered[self._order][:, self._order].tocsc()
        numbered.sort_indices()
        self._gather = numbered.data.astype(np.int64) - 1
        self._indices, self._indptr = numbered.indices, numbered.indptr

    def factorise(self, matrix: sp.csc_matrix) -> None:
        ordered = sp.csc_matrix((matrix.data[self._gather], self._indices, self._indptr), shape=matrix.shape)
        try:
            self._factor = splu(ordered, permc_spec="NATURAL", diag_pivot_thresh=0.0, options=self._OPTIONS)
        except RuntimeError as error:
            raise NotPositiveDefinite(str(error)) from error

    def solve(self, right: np.ndarray) -> np.ndarray:
        x = np.empty_like(right, dtype=float)
        x[self._order] = self._factor.solve(np.ascontiguousarray(right[self._order]))
        return x
