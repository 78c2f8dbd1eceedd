"""H and grad H at grains: the recovered field of a solve, and the two uniform sources.

Positions and results are Cartesian; grad_H[:, i, j] = dH_i/dx_j.  An axisymmetric field (H_r, H_z)(r, z)
turns with the angle, so grad H has the hoop term H_r/r: with e_r = (c, s, 0)

    dH_x/dx = c^2 dH_r/dr + s^2 H_r/r,      dH_x/dy = c s (dH_r/dr - H_r/r),      and so on.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Protocol

import numpy as np
from numba import njit

from .locate import PointOutside
from .powder_law import PowderLaw

if TYPE_CHECKING:
    from .magnetic_field import MagneticField
    from .recovery import RegionRecovery


class FieldSampler(Protocol):
    """The macroscopic field at points."""

    def sample(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
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

    def sample(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `FieldSampler.sample`."""
        n = len(position)
        return np.tile(np.asarray(self.H, dtype=float), (n, 1)), np.zeros((n, 3, 3))


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

    def sample(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `FieldSampler.sample`."""
        x, y = np.asarray(position, dtype=float)[:, :2].T
        r2 = x * x + y * y
        if np.any(r2 == 0.0):
            on_axis = np.asarray(position, dtype=float)[r2 == 0.0]
            raise PointOutside(on_axis[:, [0, 2]], "a radial field, which needs r > 0")
        a = self.H0 * self.R0
        H, grad = np.zeros((len(x), 3)), np.zeros((len(x), 3, 3))
        H[:, 0], H[:, 1] = a * x / r2, a * y / r2
        grad[:, 0, 0] = a * (y * y - x * x) / r2**2
        grad[:, 1, 1] = -grad[:, 0, 0]
        grad[:, 0, 1] = grad[:, 1, 0] = -2.0 * a * x * y / r2**2
        return H, grad


class RecoveredSampler:
    """H and grad H of a solved field inside one region, recovered at its nodes and interpolated between.

    Attributes
    ----------
    nodal : ndarray (n_nodes, 6)
        H_r, H_z [A/m], dH_r/dr, dH_r/dz, dH_z/dr, dH_z/dz [A/m^2] at `recovery.nodes`.
    """

    def __init__(self, field: MagneticField, region: str) -> None:
        self.region = region
        self.recovery = field.problem.recovery(region)
        self.nodal = _nodal_values(field, region, self.recovery)

    def sample(self, position: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `FieldSampler.sample`.

        Raises
        ------
        PointOutside
            A point outside the region.
        """
        position = np.ascontiguousarray(position, dtype=float)
        section = np.column_stack((np.hypot(position[:, 0], position[:, 1]), position[:, 2]))
        element, barycentric = self.recovery.locator.find(section)
        if element.size and element.min() < 0:
            raise PointOutside(section[element < 0], f"region {self.region!r}")
        H, grad = np.empty((len(position), 3)), np.empty((len(position), 3, 3))
        _interpolate(position, section, element, barycentric, self.recovery.connectivity, self.nodal, H, grad)
        return H, grad


def _nodal_values(field: MagneticField, region: str, recovery: RegionRecovery) -> np.ndarray:
    """H and grad H at the nodes from the derivatives of psi.

    B_r = -psi_z/r, B_z = psi_r/r;  H = h(|B|, phi) b  with b = B/|B|, so that
    dH_i = nu dB_i + (dh/dB - nu) b_i (b . dB) + dh/dphi b_i dphi.
    """
    problem = field.problem
    psi_r, psi_z, psi_rr, psi_rz, psi_zz = recovery.derivatives(field.psi)
    r = recovery.nodes[:, 0]
    B = np.array([-psi_z, psi_r]) / r
    dB = np.array([[-psi_rz + psi_z / r, -psi_zz], [psi_rr - psi_r / r, psi_rz]]) / r
    size = np.hypot(B[0], B[1])
    b = B / np.where(size > 0.0, size, 1.0)
    law = problem.law_of(region)
    along_fill = np.zeros((2, r.size))
    if isinstance(law, PowderLaw):
        if field.fill is None:
            h, slope = law.H_of_B(size, 0.0)
        else:
            phi, dphi = recovery.smooth_fill(field.fill)
            h, slope = law.H_of_B(size, phi)
            along_fill = law.dH_dphi(size, phi) * dphi
    else:
        h, slope = law.H_of_B(size)
    nu = np.where(size > 0.0, h / np.where(size > 0.0, size, 1.0), slope)
    change = (slope - nu) * np.einsum("in,ijn->jn", b, dB) + along_fill
    dH = nu * dB + b[:, None, :] * change[None, :, :]
    return np.ascontiguousarray(np.vstack((nu * B, dH.reshape(4, -1))).T)


@njit(cache=True, error_model="numpy", nogil=True)
def _interpolate(position, section, element, barycentric, connectivity, nodal, H, grad):
    for k in range(position.shape[0]):
        a, b, c = barycentric[k, 0], barycentric[k, 1], barycentric[k, 2]
        shape = (a * (2.0 * a - 1.0), b * (2.0 * b - 1.0), c * (2.0 * c - 1.0), 4.0 * a * b, 4.0 * b * c, 4.0 * c * a)
        e = element[k]
        h_r = h_z = rr = rz = zr = zz = 0.0
        for i in range(6):
            n, w = connectivity[e, i], shape[i]
            h_r += w * nodal[n, 0]
            h_z += w * nodal[n, 1]
            rr += w * nodal[n, 2]
            rz += w * nodal[n, 3]
            zr += w * nodal[n, 4]
            zz += w * nodal[n, 5]
        r = section[k, 0]
        cos, sin = position[k, 0] / r, position[k, 1] / r
        hoop = h_r / r
        H[k, 0], H[k, 1], H[k, 2] = cos * h_r, sin * h_r, h_z
        grad[k, 0, 0] = cos * cos * rr + sin * sin * hoop
        grad[k, 1, 1] = sin * sin * rr + cos * cos * hoop
        grad[k, 0, 1] = grad[k, 1, 0] = cos * sin * (rr - hoop)
        grad[k, 0, 2], grad[k, 1, 2] = cos * rz, sin * rz
        grad[k, 2, 0], grad[k, 2, 1] = cos * zr, sin * zr
        grad[k, 2, 2] = zz
