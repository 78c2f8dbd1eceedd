"""The sparsity pattern of a symmetric finite element matrix, computed once: element matrices go straight to CSC."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numba import njit

from geometry.kernels.device_functions import device_function


class FixedPattern:
    """Pattern of the free unknowns; the staggered loop solves on the same mesh again and again.

    Parameters
    ----------
    element_dofs : ndarray (n_elements, n_basis)
    free : ndarray (n_free,)
        Unknowns that are solved for, in the order of the matrix's columns.
    n_dofs : int
    clique : ndarray (k,) or None
        Unknowns that are all coupled with one another besides (a dense operator on a boundary).
    """

    def __init__(
        self, element_dofs: np.ndarray, free: np.ndarray, n_dofs: int, clique: np.ndarray | None = None
    ) -> None:
        self.size = free.size
        self._number = np.full(n_dofs, -1, dtype=np.int64)
        self._number[free] = np.arange(free.size)
        self._local = np.ascontiguousarray(self._number[element_dofs])
        self._clique = np.zeros(0, dtype=np.int64) if clique is None else self._number[clique]
        self._indptr, self._indices, self._mirror = self._full_pattern()
        self._slot = np.empty((len(element_dofs), _packed_size(element_dofs.shape[1])), dtype=np.int32)
        _find_slots(self._local, self._indptr, self._indices, self._slot)

    def _full_pattern(self) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """CSC of both triangles, and for every entry the place of its partner below the diagonal."""
        n_elements, n_basis = self._local.shape
        start = np.zeros(self.size + 1, dtype=np.int64)
        owner = np.empty(n_elements * n_basis, dtype=np.int64)
        _elements_of_dofs(self._local, start, owner)
        count = np.zeros(self.size, dtype=np.int64)
        mark = np.full(self.size, -1, dtype=np.int64)
        nothing = np.zeros(0, dtype=np.int32)
        in_clique = np.zeros(self.size, dtype=np.bool_)
        clique = self._clique[self._clique >= 0]
        in_clique[clique] = True
        _columns(self._local, start, owner, in_clique, clique, mark, count, nothing, nothing, False)
        indptr = np.zeros(self.size + 1, dtype=np.int32)
        np.cumsum(count, out=indptr[1:])
        indices = np.empty(indptr[-1], dtype=np.int32)
        mark[:] = -1
        _columns(self._local, start, owner, in_clique, clique, mark, count, indptr, indices, True)
        mirror = np.empty(indices.size, dtype=np.int32)
        _partners(indptr, indices, mirror)
        return indptr, indices, mirror

    def assemble(self, packed: np.ndarray, dense: np.ndarray | None = None) -> sp.csc_matrix:
        """Sum lower triangles of element matrices (n_elements, n_basis (n_basis + 1)/2) into CSC.

        `dense` (k, k) is added on the clique's unknowns.
        """
        data = np.zeros(self._indices.size)
        _sum_packed(packed, self._slot, data)
        if dense is not None:
            _add_dense(dense, self._clique, self._indptr, self._indices, data)
        return sp.csc_matrix((data[self._mirror], self._indices, self._indptr), shape=(self.size, self.size))

    def matrix(self, blocks: np.ndarray) -> sp.csc_matrix:
        """Sum symmetric element matrices (n_elements, n_basis, n_basis) into CSC."""
        rows, columns = np.tril_indices(blocks.shape[1])
        return self.assemble(np.ascontiguousarray(blocks[:, rows, columns]))


def _packed_size(n_basis: int) -> int:
    return n_basis * (n_basis + 1) // 2


@njit(cache=True, nogil=True)
def _elements_of_dofs(local, start, owner):
    n_elements, n_basis = local.shape
    for e in range(n_elements):
        for i in range(n_basis):
            if local[e, i] >= 0:
                start[local[e, i] + 1] += 1
    for k in range(start.size - 1):
        start[k + 1] += start[k]
    place = start[:-1].copy()
    for e in range(n_elements):
        for i in range(n_basis):
            k = local[e, i]
            if k >= 0:
                owner[place[k]] = e
                place[k] += 1


@njit(cache=True, nogil=True)
def _columns(local, start, owner, in_clique, clique, mark, count, indptr, indices, fill):
    n_basis = local.shape[1]
    for column in range(start.size - 1):
        n = 0
        for s in range(start[column], start[column + 1]):
            e = owner[s]
            for i in range(n_basis):
                row = local[e, i]
                if row >= 0 and mark[row] != column:
                    mark[row] = column
                    if fill:
                        indices[indptr[column] + n] = row
                    n += 1
        if in_clique[column]:
            for row in clique:
                if row >= 0 and mark[row] != column:
                    mark[row] = column
                    if fill:
                        indices[indptr[column] + n] = row
                    n += 1
        count[column] = n
        if fill:
            indices[indptr[column] : indptr[column] + n].sort()


@device_function()
def _place(indptr, indices, row, column):
    low, high = indptr[column], indptr[column + 1] - 1
    while low < high:
        middle = (low + high) >> 1
        if indices[middle] < row:
            low = middle + 1
        else:
            high = middle
    return low


@njit(cache=True, nogil=True)
def _partners(indptr, indices, mirror):
    for column in range(indptr.size - 1):
        for s in range(indptr[column], indptr[column + 1]):
            row = indices[s]
            mirror[s] = s if row >= column else _place(indptr, indices, column, row)


@njit(cache=True, nogil=True)
def _find_slots(local, indptr, indices, slot):
    n_elements, n_basis = local.shape
    for e in range(n_elements):
        p = 0
        for i in range(n_basis):
            for j in range(i + 1):
                a, b = local[e, i], local[e, j]
                slot[e, p] = _place(indptr, indices, max(a, b), min(a, b)) if a >= 0 and b >= 0 else -1
                p += 1


@njit(cache=True, nogil=True)
def _sum_packed(packed, slot, data):
    for e in range(packed.shape[0]):
        for p in range(packed.shape[1]):
            s = slot[e, p]
            if s >= 0:
                data[s] += packed[e, p]


@njit(cache=True, nogil=True)
def _add_dense(dense, clique, indptr, indices, data):
    for i in range(clique.size):
        for j in range(clique.size):
            a, b = clique[i], clique[j]
            if a >= b and b >= 0:
                data[_place(indptr, indices, a, b)] += dense[i, j]
