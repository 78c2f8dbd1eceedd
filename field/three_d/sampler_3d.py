"""H and grad H of a solved 3D field inside one region, interpolated between recovered nodal values."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from field.sampling.thread_count import limit_threads
from geometry.mesh_3d import EDGES

from . import tetrahedron_kernels
from .tetrahedron_locator import PointOutside3D, quadratic_form

if TYPE_CHECKING:
    from .field_3d import Field3D

# Of the nodal values, H and the upper triangle of grad H: it is a second derivative.
_UPPER = np.array([0, 1, 2, 3, 4, 5, 7, 8, 11])


class Sampler3D:
    """H and grad H of a solved 3D field inside one region, anywhere in the machine: a `FieldSampler`.

    The element of each row of `position` is remembered for the next call (a grain seldom changes it); the result
    does not depend on that.

    Attributes
    ----------
    nodal : ndarray (n_nodes, 12)
        H [A/m], then dH_i/dx_j [A/m^2] row by row, at `recovery.nodes`.
    """

    def __init__(self, field: Field3D, region: str) -> None:
        self.region = region
        self.recovery = field.problem.recovery(region)
        self.nodal = self.recovery.nodal(field)
        self._fold = field.problem.fold
        self._powers = _power_coefficients(self.nodal[:, _UPPER], self.recovery.connectivity)
        self._hint = np.zeros(0, dtype=np.int64)

    def sample(
        self, position: np.ndarray, out: tuple[np.ndarray, np.ndarray] | None = None, threads: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `FieldSampler.sample`; `out` and `threads` as of the axisymmetric samplers.

        Raises
        ------
        PointOutside3D
            A point outside the region.
        """
        position = np.ascontiguousarray(position, dtype=float)
        H, grad = out or (np.empty((len(position), 3)), np.empty((len(position), 3, 3)))
        if len(self._hint) != len(position):
            self._hint = np.full(len(position), -1, dtype=np.int64)
        with limit_threads(threads, len(position)):
            tetrahedron_kernels.sample(
                position, self._hint, self._fold.copies, self.recovery.locator.search, self._powers, H, grad
            )
        if len(position) and self._hint.min() < 0:
            raise PointOutside3D(position[self._hint < 0], f"region {self.region!r}")
        return H, grad


def _power_coefficients(nodal: np.ndarray, connectivity: np.ndarray) -> np.ndarray:
    """Interpolants of nodal values (n_nodes, c) as polynomials, coefficients of 1 u v w uu uv uw vv vw ww.

    Returns
    -------
    ndarray (m, c, 10)
    """
    powers = np.zeros((len(connectivity), nodal.shape[1], 10))
    corner = nodal[connectivity[:, :4]].transpose(0, 2, 1)
    powers[:, :, 0] = corner[:, :, 0]
    powers[:, :, 1:4] = corner[:, :, 1:] - corner[:, :, :1]
    if connectivity.shape[1] == 10:
        middle = nodal[connectivity[:, 4:]].transpose(0, 2, 1)
        powers[:, :, 1:] += quadratic_form(middle - corner[:, :, EDGES].mean(axis=3))
    return powers
