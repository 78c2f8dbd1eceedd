"""Pictures of a field study: what saturates along a sweep of the current, the field along a line, a coil in time."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from emclutch.results.pictures.figure import legend_below, legend_beside, new_figure, save_picture
from emclutch.results.text import time_unit

BLUE, ORANGE, GREY = "#0b5fa5", "#d9730d", "#808080"


def saturation_picture(path: str | Path, table: Any, *, title: str | None = None) -> Path:
    """Draw flux linkage (with the magnetic circuit's estimate) and gap field, and both inductances, against current.

    Parameters
    ----------
    path : PNG to write.
    table : columns `current` [A], `flux_linkage` [Wb], `apparent_inductance`, `incremental_inductance` [H]; where
        known `circuit_flux_linkage` [Wb] and `gap_flux_density` [T].
    """
    figure, (left, right) = new_figure(9.5, 4.2, title, columns=2)
    current = np.asarray(table["current"], dtype=float)
    left.plot(current, table["flux_linkage"], "o-", color=BLUE, ms=4, label="flux linkage, finite elements")
    if "circuit_flux_linkage" in table:
        left.plot(current, table["circuit_flux_linkage"], "--", color=GREY, label="flux linkage, magnetic circuit")
    left.set_ylabel("flux linkage [Wb]")
    if current.min() >= 0.0:
        left.set_ylim(bottom=0.0)
    if "gap_flux_density" in table:
        gap = left.twinx()
        gap.plot(current, table["gap_flux_density"], "s-", color=ORANGE, ms=4)
        left.plot([], [], "s-", color=ORANGE, ms=4, label="|B| under the poles, right axis")
        gap.set_ylabel("|B| under the poles [T]", color=ORANGE)
        gap.set_ylim(bottom=0.0)
    legend_below(left)
    right.plot(current, table["apparent_inductance"], "o-", color=BLUE, ms=4, label="apparent, linkage/current")
    right.plot(current, table["incremental_inductance"], "s-", color=ORANGE, ms=4, label="incremental, its slope")
    right.set_ylabel("inductance [H]")
    right.set_ylim(bottom=0.0)
    legend_below(right)
    for axis in (left, right):
        axis.set_xlabel("coil current [A]")
        axis.grid(alpha=0.25)
    return save_picture(figure, path)


def line_picture(path: str | Path, along: Any, *, title: str | None = None) -> Path:
    """Draw B and H along a line, with the regions that it crosses.

    Parameters
    ----------
    path : PNG to write.
    along : `distance` (k,) [m], `B` (k, 2) [T], `H` (k, 2) [A/m], `region` (k,) names.
    """
    figure, axes = new_figure(8.0, 5.0, title, rows=2, sharex=True)
    mm = 1e3 * np.asarray(along.distance)
    for axis, vector, symbol, unit, scale in ((axes[0], along.B, "B", "T", 1.0), (axes[1], along.H, "H", "kA/m", 1e-3)):
        for component, (name, colour) in enumerate((("r", BLUE), ("z", ORANGE))):
            axis.plot(mm, scale * vector[:, component], color=colour, label=f"{symbol}_{name}")
        axis.plot(mm, scale * np.linalg.norm(vector, axis=1), color="black", lw=0.8, ls=":", label=f"|{symbol}|")
        axis.set_ylabel(f"{symbol} [{unit}]")
        axis.grid(alpha=0.25)
        legend_beside(axis)
    changes = np.flatnonzero(np.asarray(along.region)[1:] != np.asarray(along.region)[:-1])
    starts, ends = np.concatenate(([0], changes + 1)), np.concatenate((changes, [len(mm) - 1]))
    for start, end in zip(starts, ends, strict=True):
        for axis in axes:
            axis.axvline(mm[start], color=GREY, lw=0.5)
        if mm[end] - mm[start] > 0.05 * mm[-1]:
            axes[0].text(
                0.5 * (mm[start] + mm[end]), 1.01, str(along.region[start]), ha="center", fontsize=8,
                transform=axes[0].get_xaxis_transform(),
            )  # fmt: skip
    axes[1].set_xlabel("distance along the line [mm]")
    return save_picture(figure, path)


def transient_picture(path: str | Path, table: Any, summary: Any, *, title: str | None = None) -> Path:
    """Draw current, gap field and powers of a coil against time, with the instants of 63 and 90 % of the change.

    Parameters
    ----------
    path : PNG to write.
    table, summary : of `emclutch.studies.field_transient.TransientResult`.
    """
    shown = [("current", "current [A]", BLUE), ("gap_flux_density", "B in the gap [T]", ORANGE)]
    shown = [one for one in shown if one[0] in table]
    unit, factor = time_unit(float(table["time"].iloc[-1]))
    time = factor * np.asarray(table["time"])
    figure, axes = new_figure(8.0, 2.2 * (len(shown) + 1), title, rows=len(shown) + 1, sharex=True)
    for axis, (name, label, colour) in zip(axes, shown, strict=False):
        axis.plot(time, table[name], color=colour)
        axis.axhline(summary["final"][name], color=GREY, lw=0.8, ls=":", label="final value")
        for share, suffix, style in (("63 %", "", "o"), ("90 %", "_90", "s")):
            after = summary[f"{name}_rise_time{suffix}"]
            if after is not None:
                at = factor * (summary["changes_at"] + after)
                mark = np.interp(at, time, table[name])
                axis.plot(at, mark, style, color=colour, label=f"{share} after {factor * after:.3g} {unit}")
        axis.set_ylabel(label)
    for name, label, colour in (("copper_loss", "copper", BLUE), ("eddy_loss", "eddy currents", ORANGE)):
        if name == "copper_loss" or summary["eddy_currents"]:
            axes[-1].plot(time, table[name], color=colour, label=label)
    axes[-1].set(xlabel=f"time [{unit}]", ylabel="heat [W]")
    for axis in axes:
        axis.grid(alpha=0.25)
        axis.margins(x=0.0)
        legend_beside(axis)
    return save_picture(figure, path)


def transient_overlay_picture(path: str | Path, tables: Mapping[str, Any]) -> Path:
    """Draw current and gap field of several transients over one another, against time from 0.

    Parameters
    ----------
    path : PNG to write.
    tables : by their names, of `emclutch.studies.field_transient.TransientResult`.
    """
    shown = [("current", "current [A]"), ("gap_flux_density", "B in the gap [T]")]
    shown = [one for one in shown if any(one[0] in table for table in tables.values())]
    unit, factor = time_unit(max(float(table["time"].iloc[-1]) for table in tables.values()))
    figure, axes = new_figure(8.0, 2.8 * len(shown), "Coil in time", rows=len(shown), sharex=True)
    for axis, (name, label) in zip(axes, shown, strict=True):
        for of, table in tables.items():
            if name in table:
                axis.plot(factor * np.asarray(table["time"]), table[name], label=of)
        axis.set_ylabel(label)
        axis.grid(alpha=0.25)
        axis.margins(x=0.0)
        legend_beside(axis)
    axes[-1].set_xlabel(f"time [{unit}]")
    return save_picture(figure, path)


def gap_map_picture(
    path: str | Path, angle: np.ndarray, z: np.ndarray, B_r: np.ndarray, *, title: str | None = None
) -> Path:
    """Draw the radial flux density on the gap's middle cylinder, unrolled.

    Parameters
    ----------
    path : PNG to write.
    angle : (n,) [rad]; z : (m,) [m]; B_r : (m, n) [T].
    """
    figure, (axis,) = new_figure(9.0, 4.2, title)
    limit = float(np.abs(B_r).max()) or 1.0
    shown = axis.pcolormesh(np.degrees(angle), 1e3 * z, B_r, cmap="RdBu_r", vmin=-limit, vmax=limit, shading="gouraud")
    figure.colorbar(shown, ax=axis, label="B_r in the middle of the rim gap [T]")
    axis.set_xlabel("angle [°]")
    axis.set_ylabel("z [mm]")
    return save_picture(figure, path)
