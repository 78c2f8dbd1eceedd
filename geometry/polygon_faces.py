"""Triangles of faces with any number of corners."""

from __future__ import annotations

import numpy as np

FLAT = 1e-3
"""Of a face's size: a face that leaves its plane, or whose corner points inwards, by less is flat and convex."""


class FaceFault(ValueError):
    """Faces that no fan of triangles covers; says how many, and what to do."""


def fans(vertices: np.ndarray, faces: np.ndarray) -> np.ndarray:
    """Triangles (t, 3) of faces (m, k) that have k >= 3 corners each.

    A quadrilateral is halved along the diagonal that lies within it, and may be warped: its halves are the surface. A
    face with more corners has to be flat and convex, and becomes the fan of its first corner.

    Raises
    ------
    FaceFault
        With the number of the faces that are concave, warped, or cross themselves.
    """
    k = faces.shape[1]
    if k == 4:
        faces = np.where(_folds(vertices[faces])[:, None], np.roll(faces, -1, axis=1), faces)
        bad = _folds(vertices[faces])
    else:
        bad = _no_fan(vertices[faces]) if k > 4 else np.zeros(len(faces), dtype=bool)
    if bad.any():
        x, y, z = vertices[faces[bad][0]].mean(axis=0)
        raise FaceFault(
            f"{np.count_nonzero(bad)} of its faces with {k} corners are concave, warped by more than {100 * FLAT:g} % "
            f"of their size, or cross themselves, the first near ({x:.6g}, {y:.6g}, {z:.6g}) in the file's unit; "
            "export triangles ('triangulate')"
        )
    return faces[:, [[0, i, i + 1] for i in range(1, k - 1)]].reshape(-1, 3)


def _folds(corners: np.ndarray) -> np.ndarray:
    """True where the halves (0, 1, 2) and (0, 2, 3) of a quadrilateral (m, 4, 3) lie on each other; bool (m,)."""
    a, b, c, d = np.moveaxis(corners, 1, 0)
    return np.einsum("ij,ij->i", np.cross(b - a, c - a), np.cross(c - a, d - a)) < 0.0


def _no_fan(corners: np.ndarray) -> np.ndarray:
    """True where faces (m, k, 3) are not covered once by the fan of their first corner, or are concave; bool (m,)."""
    corners = corners - corners.mean(axis=1, keepdims=True)
    size = 2.0 * np.linalg.norm(corners, axis=2).max(axis=1)
    arm = corners[:, 1:] - corners[:, :1]
    doubled = np.cross(arm[:, :-1], arm[:, 1:])  # of each triangle of the fan
    total = doubled.sum(axis=1)
    length = np.linalg.norm(total, axis=1)
    normal = np.divide(total, length[:, None], out=np.zeros_like(total), where=length[:, None] > 0.0)
    warp = np.abs(np.einsum("mki,mi->mk", corners, normal)).max(axis=1)
    before, after = np.roll(corners, 1, axis=1), np.roll(corners, -1, axis=1)
    turn = np.einsum("mki,mi->mk", np.cross(corners - before, after - corners), normal)
    chord = np.linalg.norm(after - before, axis=2)
    inwards = np.divide(-turn, chord, out=np.zeros_like(turn), where=chord > 0.0).max(axis=1)
    overlap = np.linalg.norm(doubled, axis=2).sum(axis=1) - length
    return (np.maximum(warp, inwards) > FLAT * size) | (overlap > FLAT * (length + FLAT * size**2))
