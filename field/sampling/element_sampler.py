"""H and grad H in a region of any shape: recovered at the nodes of its elements, interpolated inside them."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from field.laws.powder_law import PowderLaw
from field.laws.reluctivity import NU_0, LinearLaw
from field.sampling import element_kernels
from field.sampling.locate import PointOutside
from field.sampling.patch_fit import falling_powers
from field.sampling.recovery import RegionRecovery, lattice
from field.sampling.result_arrays import result_arrays
from field.sampling.thread_count import limit_threads

if TYPE_CHECKING:
    from field.section.magnetic_field import MagneticField


class RecoveredSampler:
    """H and grad H of a solved field inside one region, recovered at its nodes and interpolated between.

    H and grad H are interpolated separately, each as well as it was recovered: grad H is the gradient of the
    sampled H, and the force of a grain conservative, only to the discretisation's error.  The element of each
    row of `position` is remembered for the next call (a grain seldom changes it); the result does not depend
    on that.

    Attributes
    ----------
    nodal : ndarray (n_nodes, 6)
        H_r, H_z [A/m], dH_r/dr, dH_r/dz, dH_z/dr, dH_z/dz [A/m^2] at `recovery.nodes`.
    """

    def __init__(self, field: MagneticField, region: str, magnetisation: np.ndarray | None = None) -> None:
        """``magnetisation``: (6, n_nodes) M_r, M_z and dM_r/dr, dM_r/dz, dM_z/dr, dM_z/dz; None: by its law."""
        self.region = region
        self.recovery = field.problem.recovery(region)
        self.nodal = _nodal_values(field, region, self.recovery, magnetisation)
        self._powers = _power_coefficients(self.nodal[self.recovery.connectivity], self.recovery.order)
        self._hint = np.zeros(0, dtype=np.int64)

    def sample(
        self, position: np.ndarray, out: tuple[np.ndarray, np.ndarray] | None = None, threads: int | None = None
    ) -> tuple[np.ndarray, np.ndarray]:
        """See `FieldSampler.sample`.

        Raises
        ------
        PointOutside
            A point outside the region.
        """
        position = np.ascontiguousarray(position, dtype=float)
        H, grad = result_arrays(len(position), out)
        if len(self._hint) != len(position):
            self._hint = np.full(len(position), -1, dtype=np.int64)
        with limit_threads(threads, len(position)):
            element_kernels.sample(
                position, self._hint, self.recovery.locator.search, self.recovery.order, self._powers, H, grad
            )
        if len(position) and self._hint.min() < 0:
            raise PointOutside.at(position[self._hint < 0], f"region {self.region!r}")
        return H, grad


def _nodal_values(
    field: MagneticField, region: str, recovery: RegionRecovery, magnetisation: np.ndarray | None
) -> np.ndarray:
    """H and grad H at the nodes from the derivatives of psi: B/mu_0 - M where M is given, else by the law.

    B_r = -psi_z/r, B_z = psi_r/r;  H = h(|B|, phi) b  with b = B/|B|, so that
    dH_i = nu dB_i + (dh/dB - nu) b_i (b . dB) + dh/dphi b_i dphi.
    """
    problem = field.problem
    law = problem.law_of(region)
    empty = isinstance(law, PowderLaw) and field.fill is None
    vacuum = region != problem.coil_region and (empty or isinstance(law, LinearLaw))
    psi_r, psi_z, psi_rr, psi_rz, psi_zz = recovery.derivatives(field.psi, vacuum=vacuum)
    r = recovery.nodes[:, 0]
    B = np.array([-psi_z, psi_r]) / r
    dB = np.array([[-psi_rz + psi_z / r, -psi_zz], [psi_rr - psi_r / r, psi_rz]]) / r
    if magnetisation is not None:
        return np.ascontiguousarray((NU_0 * np.vstack((B, dB.reshape(4, -1))) - magnetisation).T)
    size = np.hypot(B[0], B[1])
    b = B / np.where(size > 0.0, size, 1.0)
    along_fill = np.zeros((2, r.size))
    if isinstance(law, PowderLaw):
        if field.fill is None:
            h, slope = law.H_of_B(size, 0.0)
        else:
            phi, dphi = recovery.smooth_fill(field.fill[: len(recovery.centroids)])
            h, slope = law.H_of_B(size, phi)
            along_fill = law.dH_dphi(size, phi) * dphi
    else:
        h, slope = law.H_of_B(size)
    nu = np.where(size > 0.0, h / np.where(size > 0.0, size, 1.0), slope)
    change = (slope - nu) * np.einsum("in,ijn->jn", b, dB) + along_fill
    dH = nu * dB + b[:, None, :] * change[None, :, :]
    return np.ascontiguousarray(np.vstack((nu * B, dH.reshape(4, -1))).T)


def _power_coefficients(values: np.ndarray, order: int) -> np.ndarray:
    """Interpolants as polynomials in the last two barycentric coordinates, for the kernel's Horner scheme.

    Parameters
    ----------
    values : ndarray (m, n_lattice, c)
        At the nodes of each element.

    Returns
    -------
    ndarray (m, n_lattice, c)
        Coefficients of l1^i l2^j in the order of `falling_powers`.
    """
    _, l1, l2 = lattice(order).T / order
    inverse = np.linalg.inv(np.stack([l1**i * l2**j for i, j in falling_powers(order)], axis=1))
    return np.ascontiguousarray(np.einsum("pn,enc->epc", inverse, values))
