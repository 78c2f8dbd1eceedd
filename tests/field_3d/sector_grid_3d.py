"""Structured tetrahedra of a sector, or of the whole turn, for tests: rings x angles x layers, without a mesher.

No test itself.
"""

import numpy as np

from geometry.mesh_3d import EDGES, Mesh3D


def sector_grid(r_lines, n_angles, z_lines, regions, angle=2 * np.pi, mirrored=False, curved=True):
    """A Mesh3D of the sector 0 <= phi <= angle.

    Parameters
    ----------
    r_lines, z_lines : ndarray
        Lines of the grid [m], r from 0.
    regions : dict of str to (r0, r1, z0, z1)
        The later ones win; everything else is `air`.  A fifth and sixth entry limit the angle [rad].
    mirrored : bool
        A half sector between mirror planes instead of a periodic one.
    """
    r, z = np.asarray(r_lines, dtype=float), np.asarray(z_lines, dtype=float)
    whole = angle > 2 * np.pi - 1e-9
    n_phi = n_angles if whole else n_angles + 1
    phi = angle * np.arange(n_phi) / n_angles
    column = np.zeros((r.size, n_phi), dtype=np.int64)  # the axis is column 0 at every angle
    column[1:] = 1 + np.arange((r.size - 1) * n_phi).reshape(-1, n_phi)
    n_columns = int(column.max()) + 1
    after = (np.arange(n_angles) + 1) % n_phi
    here = np.arange(n_angles)
    triangles, middles = [], []
    step = 0.5 * angle / n_angles
    for i in range(r.size - 1):
        a, b, c, d = column[i, here], column[i + 1, here], column[i + 1, after], column[i, after]
        middle = np.column_stack((np.full(n_angles, 0.5 * (r[i] + r[i + 1])), phi[here] + step))
        if i > 0:
            even = ((i + here) % 2 == 0)[:, None]
            triangles += [
                np.where(even, np.column_stack((a, b, c)), np.column_stack((a, b, d))),
                np.where(even, np.column_stack((a, c, d)), np.column_stack((b, c, d))),
            ]
            middles += [middle, middle]
        else:
            triangles.append(np.column_stack((a, b, c)))
            middles.append(middle)
    flat = np.sort(np.concatenate(triangles), axis=1)
    middle = np.concatenate(middles)
    layers = []
    for k in range(z.size - 1):
        low, high = flat + k * n_columns, flat + (k + 1) * n_columns
        a, b, c = low.T
        A, B, C = high.T
        layers += [np.column_stack(t) for t in ((a, b, c, C), (a, b, B, C), (a, A, B, C))]
    tetrahedra = np.concatenate(layers)
    centre = np.concatenate(
        [
            np.tile(np.column_stack((middle, np.full(len(middle), 0.5 * (z[k] + z[k + 1])))), (3, 1))
            for k in range(z.size - 1)
        ]
    )
    polar = np.zeros((n_columns, 2))
    for i in range(r.size):
        polar[column[i], 0], polar[column[i], 1] = r[i], phi
    polar = np.column_stack((np.tile(polar, (z.size, 1)), np.repeat(z, n_columns)))
    points = cartesian(polar)
    x = points[tetrahedra]
    negative = np.einsum("ei,ei->e", np.cross(x[:, 1] - x[:, 0], x[:, 2] - x[:, 0]), x[:, 3] - x[:, 0]) < 0
    tetrahedra[negative] = tetrahedra[negative][:, [0, 2, 1, 3]]

    owner = np.zeros(len(tetrahedra), dtype=int)
    names = ["air", *regions]
    for k, box in enumerate(regions.values(), start=1):
        r0, r1, z0, z1 = box[:4]
        inside = (centre[:, 0] > r0) & (centre[:, 0] < r1) & (centre[:, 2] > z0) & (centre[:, 2] < z1)
        if len(box) == 6:
            inside &= (centre[:, 1] > box[4]) & (centre[:, 1] < box[5])
        owner[inside] = k

    def rows(columns):
        return (np.asarray(columns)[None, :] + n_columns * np.arange(z.size)[:, None]).ravel()

    n_corners = len(points)
    outer = (polar[:, 0] >= r[-1] * (1 - 1e-12)) | (polar[:, 2] <= z[0]) | (polar[:, 2] >= z[-1])
    faces = np.concatenate([tetrahedra[:, f] for f in ([1, 2, 3], [0, 3, 2], [0, 1, 3], [0, 2, 1])])
    key = np.sort(faces, axis=1)
    _, first, count = np.unique(key, axis=0, return_index=True, return_counts=True)
    boundary = faces[first[count == 1]]
    on = {
        "outer": (polar[boundary, 0] >= r[-1] * (1 - 1e-12)).all(axis=1)
        | (polar[boundary, 2] <= z[0]).all(axis=1)
        | (polar[boundary, 2] >= z[-1]).all(axis=1)
    }
    assert outer[boundary[on["outer"]]].all()
    on["bottom"] = (polar[boundary, 2] <= z[0]).all(axis=1)
    periodic = None
    if not whole and not mirrored:
        periodic = np.column_stack((rows(column[1:, -1]), rows(column[1:, 0])))
    second = None
    if curved:
        ends = np.sort(tetrahedra[:, EDGES], axis=2)
        keys, edge = np.unique(ends[..., 0] * n_corners + ends[..., 1], return_inverse=True)
        p, q = polar[keys // n_corners], polar[keys % n_corners]
        # an edge from the axis is straight, at the angle of its other end
        p_angle = np.where(p[:, 0] > 0, p[:, 1], q[:, 1])
        q_angle = np.where(q[:, 0] > 0, q[:, 1], p[:, 1])
        turn = np.remainder(q_angle - p_angle + np.pi, 2 * np.pi) - np.pi
        points = np.concatenate(
            (
                points,
                cartesian(
                    np.column_stack((0.5 * (p[:, 0] + q[:, 0]), p_angle + 0.5 * turn, 0.5 * (p[:, 2] + q[:, 2])))
                ),
            )
        )
        second = np.concatenate((tetrahedra, n_corners + edge.reshape(-1, 6)), axis=1)
    return Mesh3D(
        points,
        tetrahedra,
        second,
        {names[k]: np.flatnonzero(owner == k) for k in np.unique(owner)},
        {name: boundary[chosen] for name, chosen in on.items()},
        periodic,
        float(angle),
        round(2 * np.pi / angle),
    )


def cartesian(polar):
    """(r, phi, z) to (x, y, z)."""
    return np.column_stack((polar[:, 0] * np.cos(polar[:, 1]), polar[:, 0] * np.sin(polar[:, 1]), polar[:, 2]))
