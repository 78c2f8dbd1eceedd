"""Symmetric and general 3 x 3 tensors: cylindrical components, averages round a ring, invariants."""

from __future__ import annotations

import numpy as np

from particles.sector import CyclicSector


def cylindrical_frame(position: np.ndarray) -> np.ndarray:
    """Rows e_r, e_phi, e_z at each point, shape (n, 3, 3); on the axis e_r = x."""
    x, y = position[:, 0], position[:, 1]
    r = np.hypot(x, y)
    safe = np.where(r > 0.0, r, 1.0)
    c, s, o, e = np.where(r > 0.0, x / safe, 1.0), y / safe, np.zeros_like(r), np.ones_like(r)
    return np.stack([np.stack([c, s, o], -1), np.stack([-s, c, o], -1), np.stack([o, o, e], -1)], -2)


def in_frame(frame: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    """Components of each vector along the rows of its frame, shape (n, 3)."""
    return np.einsum("kab,kb->ka", frame, vectors)


def ring_average(tensor: np.ndarray, sector: CyclicSector | None) -> np.ndarray:
    """Mean of R^k T R^-k over the images of a sector: the Cartesian tensor of the full ring, shape (3, 3)."""
    if sector is None:
        return tensor
    turn = sector.rotation(np.arange(sector.n_sectors))
    return np.mean(turn @ tensor @ turn.transpose(0, 2, 1), axis=0)


def principal(tensor: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Principal values, largest first, and their directions as rows, of the symmetric part; shapes (..., 3, ...)."""
    value, vector = np.linalg.eigh(0.5 * (tensor + np.swapaxes(tensor, -1, -2)))
    return value[..., ::-1], np.swapaxes(vector, -1, -2)[..., ::-1, :]


def deviator(tensor: np.ndarray) -> float:
    """sqrt(3/2 D:D), D the symmetric part without its mean: q for a stress, 0 where it is isotropic."""
    symmetric = 0.5 * (tensor + tensor.T)
    part = symmetric - np.trace(symmetric) / 3.0 * np.eye(3)
    return float(np.sqrt(1.5 * np.sum(part**2)))
