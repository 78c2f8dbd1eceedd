"""An isolated near pair in a field h along its axis: how the pull of its neck follows the gap.

The pull of a neck changes within a few hundredths of a radius, and moments and mmfs are solved only every few steps of
the grains. In between the mmf is not known: the flux through a closing neck lowers it, and at a constant mmf the
pull would grow up to twice too much. So the drive is frozen: the field h in which an isolated pair at the gap of
the last evaluation has the neck's mmf, over its capacity. From there on the pull varies with the gap as that of the
isolated pair in this field. Measured where an evaluation's gap of 0.1 radii closes to 0.003: the force of a pair, of
pairs in chains and beside side grains is within 7 % at 18 to 200 kA/m (1.1 to 2.1 times at a constant mmf).

The pair is the stationary point of the functional of `coupling.mutual_moments`. In units of radius, saturation and
mu_0, with R = 2 + g, z = D/(1 - M) and the neck's energy w = D^2 y(g, z),

    q = -D (2 y + y'),    D = h R - 2 M/(3 R^2) - (1 - 1/R) q/(2 pi),
    H_s(M) = h + 2 M/(3 R^3) - q/(4 pi R^2) - D^2 y'/(2 V (1 - M)),

H_s the field in which a lone sphere has M, ' = d/d ln z. At every node of the neck's table these are two equations for
M and h; the pull is z^2 (1 - M)^2 dy/dg.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

VOLUME = 4.0 / 3.0 * np.pi
HALVINGS = 60  # of the interval of M: to round-off


class IsolatedPull(NamedTuple):
    """On the gaps of the neck's table, see the module.

    Attributes
    ----------
    drive : ndarray, shape (n_gap, n_mmf)
        The column of ``pull`` for h, at the nodes of gap and mmf.
    pull : ndarray, shape (n_gap, n_mmf)
        Of the neck over h^2, in columns that are even in ln h; 0 at the last gap.
    work : ndarray, shape (n_gap, n_mmf)
        Its integral over the gap from the first one, ``pull`` linear in ln g between the nodes.
    """

    drive: np.ndarray
    pull: np.ndarray
    work: np.ndarray


def isolated_pull(H: np.ndarray, M: np.ndarray, log_gap: np.ndarray, log_mmf: np.ndarray, y: np.ndarray,
                  y_slope: np.ndarray, y_rise: np.ndarray) -> IsolatedPull:  # fmt: skip
    """Pull of the isolated pair.

    Parameters
    ----------
    H, M : ndarray, shape (s,)
        Field and magnetisation of a lone sphere, both rising [saturation].
    log_gap, log_mmf : ndarray, shapes (n_gap,), (n_mmf,)
        ln g and ln z at the nodes.
    y, y_slope, y_rise : ndarray, shape (n_gap, n_mmf)
        y, dy/d ln z and dy/dg there.
    """
    z, R = np.exp(log_mmf), 2.0 + np.exp(log_gap)[:, None]
    low, high = np.zeros(y.shape), np.ones(y.shape)
    for _ in range(HALVINGS):
        m = 0.5 * (low + high)
        mmf = z * (1.0 - m)
        q = -mmf * (2.0 * y + y_slope)
        h = (mmf + 2.0 * m / (3.0 * R**2) + (1.0 - 1.0 / R) * q / (2.0 * np.pi)) / R
        inside = h + 2.0 * m / (3.0 * R**3) - q / (4.0 * np.pi * R**2) - mmf * z * y_slope / (2.0 * VOLUME)
        less = np.interp(m, M, H) < inside
        low, high = np.where(less, m, low), np.where(less, high, m)
    log_h = np.maximum.accumulate(np.log(h), axis=1)
    pull = (z * (1.0 - m)) ** 2 * y_rise
    grid = np.linspace(log_h[:, 0].min(), log_h[:, -1].max(), len(z))
    per_square, drive = np.empty(y.shape), np.empty(y.shape)
    for i, row in enumerate(log_h):
        # below the first node the neck is linear, beyond the last one its flux and pull are those of saturation
        beyond = np.exp(2.0 * np.minimum(row[-1] - grid, 0.0))
        per_square[i] = np.interp(grid, row, pull[i] / np.exp(2.0 * row)) * beyond
        drive[i] = (row - grid[0]) / (grid[1] - grid[0])
    return IsolatedPull(drive, per_square, _integral(log_gap, per_square))


def _integral(log_gap: np.ndarray, pull: np.ndarray) -> np.ndarray:
    """Integral over the gap from the first one at the nodes (n_gap, n_mmf), ``pull`` linear in ln g between them."""
    gap, step = np.exp(log_gap[:-1])[:, None], log_gap[1] - log_gap[0]
    rise = (pull[1:] - pull[:-1]) / step
    part = gap * (pull[:-1] * np.expm1(step) + rise * (np.exp(step) * (step - 1.0) + 1.0))
    return np.concatenate((np.zeros((1, pull.shape[1])), np.cumsum(part, axis=0)))
