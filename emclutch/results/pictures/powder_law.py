"""Picture of the law of a powder: shear stress over flux density, a colour for each solid fraction."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np

from emclutch.results.fits import NORMAL
from emclutch.results.pictures.figure import (
    COLOURS,
    MARKERS,
    legend_below,
    make_logarithmic,
    new_figure,
    save_picture,
)

KILO = 1e-3
Stress = Callable[[np.ndarray, float, float], np.ndarray]
"""Shear stress [Pa] of a law at flux densities (n,) [T], a solid fraction, and grains per gap."""


def powder_law_picture(path: Path, cells: Mapping[str, np.ndarray], law: Stress | None, title: str) -> Path:
    """Draw the stresses of cells with their 95 % intervals, and the law through those of one size of the gap.

    Parameters
    ----------
    path : PNG to write.
    cells : columns `solid_fraction`, `grains_per_gap`, `flux_density` [T], `shear_stress` and `standard_error` [Pa].
    law : None without one.
    title : of the figure.
    """
    figure, (axis,) = new_figure(7.0, 5.2, title)
    B, fills, sizes = cells["flux_density"], cells["solid_fraction"].round(2), cells["grains_per_gap"].round(1)
    at = np.geomspace(0.7 * B.min(), 1.3 * B.max(), 100)
    usual = max(np.unique(sizes), key=lambda n: np.count_nonzero(sizes == n))
    for number, fill in enumerate(np.unique(fills)):
        colour = COLOURS[number % len(COLOURS)]
        for shape, n in enumerate(np.unique(sizes[fills == fill])):
            own = (fills == fill) & (sizes == n)
            label = f"cells, fill {fill:g}" + ("" if n == usual or law is None else f", {n:g} grains per gap")
            axis.errorbar(B[own], KILO * cells["shear_stress"][own], NORMAL * KILO * cells["standard_error"][own],
                          fmt=MARKERS[0 if n == usual else 1 + shape], mfc=colour if n == usual else "white", ms=5.0,
                          color=colour, lw=0.8, capsize=2.0, label=label)  # fmt: skip
        if law is not None:
            axis.plot(at, KILO * law(at, float(cells["solid_fraction"][fills == fill].mean()), usual),
                      color=colour, lw=1.2, label=f"law, fill {fill:g}, {usual:g} grains per gap")  # fmt: skip
    axis.set(xlabel="flux density across the gap [T]", ylabel="shear stress [kPa]")
    axis.grid(alpha=0.25)
    make_logarithmic(axis)
    legend_below(axis, 2)
    return save_picture(figure, path)
