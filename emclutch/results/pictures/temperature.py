"""Temperature in the section, and temperatures through a duty with the permitted slip power."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.pictures.figure import MM, label_panel, legend_below, make_logarithmic, new_figure, save_picture
from emclutch.results.pictures.section import draw_outlines
from emclutch.results.quantity import RPM

if TYPE_CHECKING:
    from field.heat.conduction import HeatProblem

NAMES = {
    "coil_hottest": ("coil, hottest", "#c4540a"),
    "powder_hottest": ("powder, hottest", "#8a1c7c"),
    "surface": ("surface, hottest", "#0b5fa5"),
}
OUTLINE = "#58c4e8"  # seen on black and on yellow
STEPS = (1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
"""Between isotherms [K]."""


def temperature_picture(path: str | Path, problem: HeatProblem, temperature: np.ndarray, *, title: str | None) -> Path:
    """Draw temperatures (n_dofs,) [degrees C] of the conducting part, with isotherms and the regions' outlines.

    The axis lies at the bottom, r points up.
    """
    from matplotlib.tri import Triangulation

    corners = temperature[: problem.corners.max() + 1]
    points = problem.points[: len(corners)]
    (r0, z0), (r1, z1) = points.min(axis=0), points.max(axis=0)
    shape = (r1 - r0) / (z1 - z0)
    figure, (axis,) = new_figure(9.0, float(np.clip(6.0 * shape, 3.0, 6.5)) + 1.2, title)
    section = Triangulation(MM * points[:, 1], MM * points[:, 0], problem.corners)
    drawn = axis.tripcolor(section, corners, cmap="inferno", shading="gouraud", rasterized=True)
    span = float(np.ptp(corners))
    step = next((one for one in STEPS if span / one <= 12.0), STEPS[-1])
    levels = np.arange(np.ceil(corners.min() / step) * step, corners.max(), step)
    if len(levels) and span > 0.0:
        axis.tricontour(section, corners, levels=levels, colors="white", linewidths=0.6, alpha=0.8)
        label_panel(axis, f"white: isotherms, {step:g} K between them")
    draw_outlines(axis, problem.mesh, OUTLINE)
    axis.set(xlabel="z [mm]", ylabel="r [mm]", aspect="equal")
    margin = 0.03 * (z1 - z0)
    axis.set(xlim=(MM * (z0 - margin), MM * (z1 + margin)), ylim=(MM * r0, MM * (r1 + margin)))
    figure.colorbar(drawn, ax=axis, label="temperature [°C]", shrink=0.9)
    return save_picture(figure, path)


def duty_picture(path: str | Path, table: Any, permitted: Any, limits: dict[str, float], *, title: str | None) -> Path:
    """Draw temperatures against time, and the permitted slip power against the slip speed.

    Parameters
    ----------
    path : PNG to write.
    table : columns `time` [s] and those of `NAMES` [degrees C].
    permitted : columns `speed` [rad/s], `by_surface`, `by_coil` [W] and so on, one for each limit.
    limits : temperature [degrees C] by column.
    title : may have several lines.
    """
    figure, (left, right) = new_figure(10.0, 4.4, title, columns=2)
    time = np.asarray(table["time"])
    unit, per = ("h", 3600.0) if time[-1] >= 7200.0 else ("min", 60.0) if time[-1] >= 120.0 else ("s", 1.0)
    for column, (name, colour) in NAMES.items():
        left.plot(time / per, table[column], color=colour, lw=1.2, label=name)
        if column in limits:
            left.axhline(limits[column], color=colour, lw=0.8, ls=":", label=f"its limit, {limits[column]:g} °C")
    left.set(xlabel=f"time [{unit}]", ylabel="temperature [°C]")
    left.grid(alpha=0.25)
    left.margins(x=0.0)
    legend_below(left, columns=2)
    speed = RPM * np.asarray(permitted["speed"])
    for of in limits:
        name, colour = NAMES[of]
        powers = np.asarray(permitted[f"by_{of.removesuffix('_hottest')}"])
        right.plot(speed, np.where(powers > 0.0, powers, np.nan), "o-", ms=4, color=colour,
                   label=f"{name} at {limits[of]:g} °C")  # fmt: skip
    if np.any(permitted.filter(like="by_").to_numpy() > 0.0):
        make_logarithmic(right)
    right.set(xlabel="slip speed [rpm]", ylabel="permitted slip power [W]")
    right.grid(alpha=0.25)
    legend_below(right)
    return save_picture(figure, path)
