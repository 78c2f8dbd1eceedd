"""Sections on tensor grids for the tests of the field: exact geometry, refinement by a factor of two."""

import numpy as np

from geometry.section import SectionMesh


def section_grid(r_lines, z_lines, regions, *, jiggle=0.0, seed=0):
    """Triangles of a tensor grid, diagonals alternating.

    regions : {name: (r0, r1, z0, z1)}, later ones on top, everything else `air`; their edges must be lines.
    jiggle : interior points are moved at random by this fraction of the local spacing, region edges excepted.
    """
    r, z = np.unique(r_lines), np.unique(z_lines)
    grid_r, grid_z = np.meshgrid(r, z, indexing="ij")
    if jiggle:
        random = np.random.default_rng(seed)
        fixed_r, fixed_z = np.zeros(r.size, bool), np.zeros(z.size, bool)
        fixed_r[[0, -1]] = fixed_z[[0, -1]] = True
        for r0, r1, z0, z1 in regions.values():
            fixed_r |= np.isclose(r, r0, rtol=0, atol=1e-12) | np.isclose(r, r1, rtol=0, atol=1e-12)
            fixed_z |= np.isclose(z, z0, rtol=0, atol=1e-12) | np.isclose(z, z1, rtol=0, atol=1e-12)
        step_r = np.minimum(np.r_[np.diff(r), np.inf], np.r_[np.inf, np.diff(r)])
        step_z = np.minimum(np.r_[np.diff(z), np.inf], np.r_[np.inf, np.diff(z)])
        move = random.uniform(-jiggle, jiggle, (2, r.size, z.size))
        grid_r = grid_r + move[0] * np.where(fixed_r, 0.0, step_r)[:, None]
        grid_z = grid_z + move[1] * np.where(fixed_z, 0.0, step_z)[None, :]
    number = np.arange(r.size * z.size).reshape(r.size, z.size)
    a, b, c, d = number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]
    even = (np.add.outer(np.arange(r.size - 1), np.arange(z.size - 1)) % 2 == 0)[..., None]
    first = np.where(even, np.stack((a, b, c), -1), np.stack((a, b, d), -1))
    second = np.where(even, np.stack((a, c, d), -1), np.stack((b, c, d), -1))
    triangles = np.stack((first, second), axis=2).reshape(-1, 3)
    centre_r, centre_z = 0.5 * (r[:-1] + r[1:]), 0.5 * (z[:-1] + z[1:])
    owner = np.zeros((r.size - 1, z.size - 1), dtype=int)
    names = ["air", *regions]
    for k, (r0, r1, z0, z1) in enumerate(regions.values(), start=1):
        owner[np.ix_((centre_r > r0) & (centre_r < r1), (centre_z > z0) & (centre_z < z1))] = k
    owner = np.repeat(owner.ravel(), 2)

    def edges(nodes):
        return np.column_stack((nodes[:-1], nodes[1:]))

    outer = np.concatenate((edges(number[:, 0]), edges(number[-1, :]), edges(number[:, -1])))
    boundaries = {"outer": outer}
    if r[0] == 0.0:
        boundaries["axis"] = edges(number[0, :])
    return SectionMesh(
        np.column_stack((grid_r.ravel(), grid_z.ravel())),
        triangles.astype(np.int64),
        {names[k]: np.flatnonzero(owner == k) for k in np.unique(owner)},
        boundaries,
    )
