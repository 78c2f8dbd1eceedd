"""H and grad H at grains: which sampler a region gets, and the two uniform sources.

Positions and results are Cartesian; grad_H[:, i, j] = dH_i/dx_j.  An axisymmetric field (H_r, H_z)(r, z)
turns with the angle, so grad H has the hoop term H_r/r: with e_r = (c, s, 0)

    dH_x/dx = c^2 dH_r/dr + s^2 H_r/r,      dH_x/dy = c s (dH_r/dr - H_r/r),      and so on.

A solved field is sampled by the element kernel (`RecoveredSampler`: any region, as accurate as the recovery)
or, in a smooth gap, from a table of the scalar potential (`TableSampler`: forces conservative to round-off).
`field_sampler` chooses.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np

from field.sampling.element_sampler import RecoveredSampler as RecoveredSampler
from field.sampling.locate import PointOutside
from field.sampling.potential_table import TableSampler
from field.sampling.result_arrays import result_arrays
from field.sampling.table_grid import NoTable

if TYPE_CHECKING:
    from field.section.magnetic_field import MagneticField

# The table is taken where its grad H differs on average by less than this from the element kernel's: below
# the error of the recovered grad H itself on a usual mesh.  Beside sharp steel corners and in a granular
# fill, where grad H jumps from element to element, it differs by 0.1 and more.
TABLE_TOLERANCE = 1e-2

Sampled = tuple[np.ndarray, np.ndarray]


class FieldSampler(Protocol):
    """The macroscopic field at points.

    The samplers of an axisymmetric field take two arguments more: `out`, the pair of C-contiguous arrays to write
    the results into, and `threads`, at most how many to use (the results do not depend on it).
    """

    def sample(self, position: np.ndarray) -> Sampled:
        """H and its gradient.

        Parameters
        ----------
        position : ndarray (n, 3)
            Cartesian [m], z along the shaft.

        Returns
        -------
        H : ndarray (n, 3)
            Field strength [A/m].
        grad_H : ndarray (n, 3, 3)
            dH_i/dx_j [A/m^2].
        """


@dataclass(frozen=True, slots=True)
class UniformField:
    """The same H everywhere.

    Parameters
    ----------
    H : tuple of float
        Cartesian components [A/m].
    """

    H: tuple[float, float, float]

    def sample(self, position: np.ndarray, out: Sampled | None = None, threads: int | None = None) -> Sampled:
        """See `FieldSampler.sample`."""
        H, grad = result_arrays(len(position), out)
        H[:], grad[:] = self.H, 0.0
        return H, grad


@dataclass(frozen=True, slots=True)
class RadialField:
    """H_r = H0 R0/r, the field of an ideal radial gap (curl- and divergence-free).

    Parameters
    ----------
    H0 : float
        Field strength at the radius R0 [A/m].
    R0 : float
        [m]
    """

    H0: float
    R0: float

    def sample(self, position: np.ndarray, out: Sampled | None = None, threads: int | None = None) -> Sampled:
        """See `FieldSampler.sample`."""
        x, y = np.asarray(position, dtype=float)[:, :2].T
        r2 = x * x + y * y
        if np.any(r2 == 0.0):
            on_axis = np.asarray(position, dtype=float)[r2 == 0.0]
            raise PointOutside.at(on_axis, "a radial field, which needs r > 0")
        a = self.H0 * self.R0
        H, grad = result_arrays(len(x), out)
        H[:, 2], grad[:] = 0.0, 0.0
        H[:, 0], H[:, 1] = a * x / r2, a * y / r2
        grad[:, 0, 0] = a * (y * y - x * x) / r2**2
        grad[:, 1, 1] = -grad[:, 0, 0]
        grad[:, 0, 1] = grad[:, 1, 0] = -2.0 * a * x * y / r2**2
        return H, grad


def field_sampler(
    field: MagneticField, region: str, *, table_tolerance: float = TABLE_TOLERANCE
) -> RecoveredSampler | TableSampler:
    """The sampler of a solved field inside one region.

    Parameters
    ----------
    field : MagneticField
    region : str
        Without current.
    table_tolerance : float
        Largest mean difference of grad H between table and element kernel, relative to the mean of |grad H|
        over the region's section, at which the table is taken; 0: never.
    """
    recovered = RecoveredSampler(field, region)
    if table_tolerance <= 0.0:
        return recovered
    try:
        table = TableSampler(recovered, recovered.recovery.table_grid)
    except NoTable:
        return recovered
    return table if table.difference[1] <= table_tolerance else recovered
