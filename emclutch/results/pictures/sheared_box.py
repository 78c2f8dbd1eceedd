"""A sheared periodic box: its stress against the strain, and the grains as the flow and the gradient show them."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.columns import (
    CONTACTS_PER_GRAIN,
    NORMAL_STRESS_Z,
    RELATIVE_PERMEABILITY,
    SHEAR_STRAIN,
    SHEAR_STRESS,
    SOLID_FRACTION,
    TIME,
)
from emclutch.results.pictures.figure import (
    COLOURS,
    MM,
    colour_limits,
    draw_chains,
    draw_circles,
    label_panel,
    legend_beside,
    new_figure,
    save_picture,
)
from emclutch.results.text import format_stress

if TYPE_CHECKING:
    from emclutch.results.statistics import Estimate

LAYER = 2.0  # mean diameters: thickness of the drawn slices
BELOW = (
    (CONTACTS_PER_GRAIN, "contacts of a grain"),
    (SOLID_FRACTION, "solid fraction"),
    (RELATIVE_PERMEABILITY, "relative permeability"),
)


def stress_picture(
    path: str | Path, history: Any, estimate: Estimate, others: Sequence[Any] = (), *, title: str | None = None
) -> Path:
    """Draw shear and normal stress against the strain, and below what else changes: contacts, fill, permeability.

    Parameters
    ----------
    path : PNG to write.
    history : table with the columns of `emclutch.results.COLUMNS`.
    estimate : of the shear stress; its steady part is shaded and its mean drawn with its 95 % interval.
    others : histories of the other replicas, whose shear stress is drawn thin.
    """
    strain, time = (np.asarray(history[name], dtype=np.float64) for name in (SHEAR_STRAIN, TIME))
    below = [one for one in BELOW if one[0] in history and np.ptp(np.asarray(history[one[0]])) > 1e-9]
    rows = 1 + len(below)
    figure, axes = new_figure(
        9.0, 4.6 + 1.3 * len(below), title, rows=rows, sharex=True, height_ratios=[2.6, *[1.0] * len(below)]
    )
    axis = axes[0]
    unit, factor = ("kPa", 1e-3) if float(np.max(np.abs(history[SHEAR_STRESS]))) >= 1e3 else ("Pa", 1.0)
    axis.plot(strain, factor * np.asarray(history[NORMAL_STRESS_Z]), color=COLOURS[7], lw=0.9,
              label="normal, along the gradient")  # fmt: skip
    for number, other in enumerate(others):
        label = None if number else "shear, other replicas"
        axis.plot(other[SHEAR_STRAIN], factor * np.asarray(other[SHEAR_STRESS]), color="#7fb2dd", lw=0.6, zorder=1,
                  label=label)  # fmt: skip
    axis.plot(strain, factor * np.asarray(history[SHEAR_STRESS]), color=COLOURS[0], lw=1.1, label="shear")
    axis.axhline(0.0, color="black", lw=0.6)
    if estimate.mean is not None and estimate.start is not None:
        start = float(np.interp(estimate.start, time, strain))
        axis.axvspan(start, strain[-1], color=COLOURS[0], alpha=0.07, lw=0, label="averaged part")
        if estimate.known:
            limits = axis.get_ylim()
            low, high = (factor * end for end in estimate.interval())
            axis.fill_between([start, strain[-1]], low, high, color=COLOURS[0], alpha=0.25, lw=0, label="95 % interval")
            axis.set_ylim(limits)  # of few replicas it is wider than the picture
        label = format_stress(estimate) + ("" if estimate.converged else ", not converged")
        mean = 2 * [factor * estimate.mean]
        axis.plot([start, strain[-1]], mean, color="black", lw=1.4, ls="--", label=label, zorder=4)
    if not estimate.converged:
        figure.supxlabel(estimate.reason, x=0.01, ha="left", fontsize=8, color="crimson", parse_math=False)
    axis.set_ylabel(f"stress [{unit}]")
    legend_beside(axis)
    axis.margins(x=0.0)
    for panel, (name, what) in zip(axes[1:], below, strict=True):
        panel.plot(strain, np.asarray(history[name]), color=COLOURS[2], lw=1.0)
        panel.set_ylabel(what.replace(" ", "\n", 1), fontsize=9)
    axes[-1].set_xlabel("shear strain")
    return save_picture(figure, path)


def sheared_box_picture(
    path: str | Path,
    position: np.ndarray,
    radius: np.ndarray,
    velocity: np.ndarray,
    *,
    lengths: np.ndarray,
    chains: tuple[np.ndarray, np.ndarray, np.ndarray],
    faces: bool = False,
    title: str | None = None,
) -> Path:
    """Draw a slice through the middle along flow and gradient, and one along vorticity and gradient.

    Parameters
    ----------
    path : PNG to write.
    position, radius, velocity : (n, 3) [m] inside the box, (n,) [m], (n, 3) [m/s].
    lengths : (3,) edges of the box [m].
    faces : whether it ends at faces below and above, which are drawn.
    chains : start (k, 3), end (k, 3) [m] and force (k,) [N] of the contacts.
    """
    from matplotlib.patches import Rectangle

    figure, axes = new_figure(10.0, 5.2, title, columns=2, layout="compressed", subplot_kw={"aspect": "equal"})
    speed = np.asarray(velocity)[:, 0]
    thickness, limits = LAYER * 2.0 * float(np.mean(radius)), colour_limits(speed)
    for axis, along, across in zip(axes, (0, 1), (1, 0), strict=True):
        middle = 0.5 * lengths[across]
        drawn = np.flatnonzero(np.abs(position[:, across] - middle) <= 0.5 * thickness)
        drawn = drawn[np.argsort(-position[drawn, across] if across else position[drawn, across])]
        circles = draw_circles(
            axis, position[drawn, along], position[drawn, 2], radius[drawn], array=speed[drawn], clim=limits,
            linewidths=0.3,
        )  # fmt: skip
        start, end, force = chains
        inside = np.abs(start[:, across] - middle) <= 0.5 * thickness
        if np.any(force[inside]):
            draw_chains(axis, start[inside][:, [along, 2]], end[inside][:, [along, 2]], force[inside])
        edges = MM * lengths
        axis.add_patch(Rectangle((0.0, 0.0), edges[along], edges[2], fill=False, ls="--", lw=1.0, color="black"))
        if faces:
            axis.hlines([0.0, edges[2]], 0.0, edges[along], color="black", lw=2.5)
        edge = 1.5 * MM * float(radius.max())
        axis.set(
            xlim=(-edge, edges[along] + edge), ylim=(-edge, edges[2] + edge),
            xlabel=("x [mm], along the flow", "y [mm], along the vorticity")[along],
            ylabel="z [mm], along the gradient",
        )  # fmt: skip
        label_panel(axis, f"{len(drawn)} of {len(radius)} grains, a slice {MM * thickness:.3g} mm thick")
    figure.colorbar(circles, ax=list(axes), label="velocity along the flow [m/s]", shrink=0.8)
    return save_picture(figure, path)
