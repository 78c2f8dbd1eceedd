"""Region of the smeared moments: the elements that it reaches, and the points at which steel folds it back."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from scipy.spatial import cKDTree

from field import AxisymmetricProblem, Law, LinearLaw
from geometry import Mesh3D, SectionMesh


def mirror_points_in_steel(
    points: np.ndarray, walls: np.ndarray, problem: AxisymmetricProblem, reach: float
) -> np.ndarray:
    """True where a wall (w, 6) of `coupling.mirror` mirrors each point (p, 2) [m] within reach into steel; (p, w)."""
    in_steel = np.zeros((len(points), len(walls)), dtype=bool)
    steel = np.zeros(len(problem.mesh.triangles), dtype=bool)
    for region in magnetic_regions(problem.laws):
        steel[problem.mesh.regions[region]] = True
    for w, (r0, z0, t_r, t_z, length, _) in enumerate(walls):
        d_r, d_z = points[:, 0] - r0, points[:, 1] - z0
        along, h = d_r * t_r + d_z * t_z, -d_r * t_z + d_z * t_r
        mirrored = np.ascontiguousarray(points - 2.0 * h[:, None] * np.array([-t_z, t_r]))
        near = (along >= 0.0) & (along <= length) & (np.abs(h) < reach) & (mirrored[:, 0] > 0.0)
        element, _ = problem.locator.find(mirrored[near])
        in_steel[near, w] = (element >= 0) & steel[element]
    return in_steel


def magnetic_regions(laws: Mapping[str, Law]) -> list[str]:
    """Regions with a permeability above that of air; powder's own law is not among theirs."""
    return [name for name, law in laws.items() if not (isinstance(law, LinearLaw) and law.mu_r == 1.0)]


def elements_within(
    mesh: SectionMesh | Mesh3D, magnetic: list[str], width: float, region: str = "powder"
) -> np.ndarray:
    """Elements (k,) of non-magnetic regions that touch the powder's and lie within `width` [m] of it."""
    own = mesh.regions[region]
    nodes = mesh.tetrahedra if isinstance(mesh, Mesh3D) else mesh.triangles
    open_to = np.ones(len(nodes), dtype=bool)
    for name in magnetic:
        open_to[mesh.regions[name]] = False
    open_to[own] = False
    corners = mesh.points[nodes]
    edge = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    inside = corners[own].mean(axis=1)
    distance = cKDTree(inside).query(corners.mean(axis=1))[0]
    open_to &= distance < width + edge + edge[own].max()
    # from the powder outwards, over common corners: not through steel
    reached = np.zeros(len(mesh.points), dtype=bool)
    reached[nodes[own]] = True
    reachable = np.zeros(len(nodes), dtype=bool)
    while True:
        new = open_to & ~reachable & reached[nodes].any(axis=1)
        if not new.any():
            return np.flatnonzero(reachable)
        reachable |= new
        reached[nodes[new]] = True
