"""Image dipoles of grains in steel walls.

A magnetic charge q at height h over a half-space of permeability mu_r has the image -k q at depth h,
k = (mu_r - 1)/(mu_r + 1) (Jackson §4.4 with charges for poles). A dipole m = m_n n + m_t therefore has the image
k (m_n n - m_t) at the mirrored place. A grain is pulled by its own image with
3 mu_0 k (m_t^2 + 2 m_n^2)/(64 pi h^4) and feels the images of its neighbours; the field of an image at fixed
moment gives the force F = grad(m_i . B_image) directly (no factor 1/2: the induced poles follow the grain).

Where it is valid: the mirror is the wall's tangent plane under each grain, so the cut-off must be small against
the wall's radius of curvature; only grains that face the wall (foot of the perpendicular on the wall) have an image;
one image a wall, no images of images, so the cut-off should not exceed about the gap. Steel far from
saturation has k close to 1.
"""

from __future__ import annotations

import numpy as np

from coupling.dipole_kernels import image_rows
from coupling.neighbour_rows import NeighbourRows
from geometry import RevolvedWall


def magnetic_wall_table(walls) -> np.ndarray:
    """(w, 5) rows r0, z0, tangent r, tangent z, length [m] of the steel surfaces of revolution among `walls`."""
    rows = []
    for wall in walls:
        if isinstance(wall, RevolvedWall) and wall.magnetic:
            start, end = np.asarray(wall.start), np.asarray(wall.end)
            length = float(np.hypot(*(end - start)))
            rows.append([*start, *((end - start) / length), length])
    return np.array(rows, dtype=float).reshape(-1, 5)


def add_image_forces(
    position, moment, radius, rows: NeighbourRows, walls: np.ndarray, reflection: float, cutoff: float, force
) -> float:
    """Add the forces [N] of all images within `cutoff` [m] to `force` (n, 3), in place.

    `walls` is `magnetic_wall_table(...)`, `reflection` is k [-]; other arguments as in `add_dipole_forces`.
    Returns the torque about z of these forces on the grains [N m]; the walls' bodies take its opposite.
    """
    n = position.shape[0]
    torque = np.empty(n)
    height = np.empty((n, len(walls)))
    image_rows(position, moment, radius, rows.arrays, walls, reflection, cutoff, height, force, torque)
    return float(torque.sum())
