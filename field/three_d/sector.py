"""From anywhere in a machine into the one sector that is meshed, and the field back.

A periodic sector is copied by turns.  A half sector is mirrored at its two meridional planes: H lies in them
(see `scalar_potential`), so H of the mirrored point is the mirrored vector.
"""

from __future__ import annotations

import numpy as np

from geometry.mesh_3d import Mesh3D

from .tetrahedron_kernels import Copies


class SectorFold:
    """Turns and mirrors points about z into the angle that a mesh spans."""

    def __init__(self, mesh: Mesh3D) -> None:
        self.angle = float(mesh.sector_angle)
        self.whole = self.angle > 2.0 * np.pi - 1e-9
        self.mirrored = not self.whole and mesh.periodic is None
        radius = np.hypot(mesh.points[:, 0], mesh.points[:, 1])
        off_axis = radius > 1e-6 * radius.max()
        u = mesh.points[off_axis, :2] / radius[off_axis, None]
        middle = np.arctan2(*u.mean(axis=0)[::-1])
        spread = np.remainder(np.arctan2(u[:, 1], u[:, 0]) - middle + np.pi, 2.0 * np.pi) - np.pi
        self.first = 0.0 if self.whole else float(middle + spread.min())

        self.copies = self._copies()

    def _copies(self) -> Copies:
        """For the sampling kernel."""
        if self.whole:
            return Copies(0.0, 0.0, 0, np.zeros((1, 4)))
        lowest = int(np.floor((-np.pi - self.first) / self.angle)) - 1
        copy = np.arange(lowest, int(np.floor((np.pi - self.first) / self.angle)) + 2)
        middle = self.first + (copy + 0.5) * self.angle
        _, matrix = self.into_mesh(np.column_stack((np.cos(middle), np.sin(middle), 0.0 * middle)))
        assert matrix is not None
        return Copies(self.first, self.angle, lowest, np.ascontiguousarray(matrix[:, :2, :2].reshape(-1, 4)))

    def angles(self, number: int) -> np.ndarray:
        """Angles (number,) [rad] evenly over a period of the field: the mesh's sector, and its mirror image if any."""
        period = (2.0 if self.mirrored else 1.0) * self.angle
        return self.first + (np.arange(number) + 0.5) / number * period

    def into_mesh(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray | None]:
        """Points (n, 3) [m] moved into the sector, and the orthogonal matrices (n, 3, 3) that brought them there.

        The matrices are None where nothing was done.
        """
        points = np.ascontiguousarray(points, dtype=float)
        if self.whole:
            return points, None
        angle = np.arctan2(points[:, 1], points[:, 0]) - self.first
        finite = np.isfinite(angle)
        copy = np.floor(np.where(finite, angle, 0.0) / self.angle)
        odd = self.mirrored & (np.remainder(copy, 2.0) == 1.0)
        # turned back by `copy` sectors; an odd copy of a half sector is then mirrored at the sector's middle
        cos, sin = np.cos(copy * self.angle), np.sin(copy * self.angle)
        matrix = np.zeros((len(points), 3, 3))
        matrix[:, 0, 0], matrix[:, 0, 1], matrix[:, 1, 0], matrix[:, 1, 1] = cos, sin, -sin, cos
        matrix[:, 2, 2] = 1.0
        if odd.any():
            double = 2.0 * self.first + self.angle
            mirror = np.array(
                [[np.cos(double), np.sin(double), 0.0], [np.sin(double), -np.cos(double), 0.0], [0.0, 0.0, 1.0]]
            )
            matrix[odd] = mirror @ matrix[odd]
        return np.einsum("nij,nj->ni", matrix, points), matrix

    @staticmethod
    def out_of_mesh(
        matrix: np.ndarray | None, vector: np.ndarray, gradient: np.ndarray | None = None
    ) -> tuple[np.ndarray, np.ndarray | None]:
        """A vector (n, 3) and its gradient (n, 3, 3), evaluated in the sector, at the given points."""
        if matrix is None:
            return vector, gradient
        back = matrix.transpose(0, 2, 1)
        turned = np.einsum("nij,nj->ni", back, vector)
        return turned, None if gradient is None else back @ gradient @ matrix
