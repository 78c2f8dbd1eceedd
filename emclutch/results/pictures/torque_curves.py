"""Pictures of torque curves: against current with the linear range, against speed and grain size with their laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from emclutch.results.fits import NORMAL, power_law
from emclutch.results.grain_size_law import EXPONENT, GrainSizeLaw
from emclutch.results.linear_range import LinearRange
from emclutch.results.pictures.figure import (
    BODY_COLOURS,
    draw_measured,
    legend_below,
    legend_beside,
    make_logarithmic,
    new_figure,
    save_picture,
)
from emclutch.results.quantity import RPM
from emclutch.results.torque_curves import TorqueCurve

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

COLOURS = ("#0b5fa5", "#2a8c3f", "#8a1c7c", "#b8860b", "#00868b", "#a52a2a", "#6a6a6a", "#4b3fbf")
LAW = BODY_COLOURS["rotor"]
BAND = "#4b3fbf"
BEST = "best estimate, corrected for the settings"
LONG = 40  # letters of a legend that has room for one column


def torque_against_current_picture(
    path: str | Path,
    curves: Sequence[TorqueCurve],
    ranges: Sequence[LinearRange] = (),
    *,
    measured: Mapping[str, np.ndarray] | None = None,
    band: np.ndarray | None = None,
    over_rated: bool = False,
    title: str | None = None,
) -> Path:
    """Draw the torque that each current transmits, with its 95 % interval.

    Parameters
    ----------
    path : PNG to write.
    curves : over the current [A]; points that are not converged are drawn hollow, those of unknown error as hollow
        diamonds without a bar.
    ranges : of each curve; a thin line is drawn through a linear range, with a mark at its knee; dashed where some of
        its torques are not converged.
    measured : name -> (n, 2) current [A] and torque [N m], or (n, 3) with errors, as `read_measured` returns them.
    band : (n, 4) current [A], and low, middle and high torque [N m] of a prediction; shaded, its middle dashed.
    over_rated : whether curves, measured ones and band are current and torque over the rated ones, as
        `TorqueCurve.over_rated` makes them; then a second panel has logarithmic axes, where a power law is a line.
    """
    figure, axes = _torque_axes(curves, title, joined=True, panels=2 if over_rated else 1)
    for axis in axes:
        if band is not None:
            axis.fill_between(band[:, 0], band[:, 1], band[:, 3], color=BAND, alpha=0.18, lw=0.0, zorder=0.5,
                              label="predicted, low to high")  # fmt: skip
            axis.plot(band[:, 0], band[:, 2], color=BAND, ls="--", lw=1.0, zorder=1.0, label="predicted, middle")
        for curve, found in zip(curves, ranges, strict=False):
            _draw_range(axis, curve, found)
        draw_measured(axis, measured, joined=True)
        axis.set_xlabel("coil current over rated current" if over_rated else "coil current [A]")
    if over_rated:
        for axis in axes:
            axis.set_ylabel("torque over torque at rated current")
        make_logarithmic(axes[1])
        legend_beside(axes[1])
    else:
        labels = axes[0].get_legend_handles_labels()[1]
        narrow = any(len(label) > LONG for label in labels)
        figure.set_figheight(4.8 + (0.2 * len(labels) if narrow else 0.0))
        legend_below(axes[0], 1 if narrow else 2)
    return save_picture(figure, path)


def torque_against_speed_picture(path: str | Path, curves: Sequence[TorqueCurve], *, title: str | None = None) -> Path:
    """Draw the torque that is transmitted at each speed of the motor, and the power law through it.

    Parameters
    ----------
    path : PNG to write.
    curves : over the speed [rad/s]; drawn as for currents.
    """
    in_rpm = [curve.along(RPM * np.abs(curve.x)) for curve in curves]
    figure, (axis,) = _torque_axes(in_rpm, title, joined=False)
    for curve in curves:
        speed = np.abs(curve.x)
        law = power_law(speed, np.abs(curve.torque), curve.error)
        if law is not None:
            factor, exponent = law
            along = np.linspace(0.0, float(speed.max()), 201)[1:]
            power = f"{exponent.value:.2f} ± {exponent.half_width():.2f}, 95 %"
            label = f"{factor * (1000.0 / RPM) ** exponent.value:.3g} N m · (rpm/1000)^({power})"
            sign = np.sign(np.nansum(curve.torque))
            axis.plot(RPM * along, sign * factor * along**exponent.value, color=LAW, lw=1.2, label=label)
    axis.set_xlabel("speed of the motor [rpm]")
    axis.set_xlim(left=0.0)
    legend_below(axis, 2)
    return save_picture(figure, path)


def torque_against_grain_size_picture(
    path: str | Path, curves: Sequence[TorqueCurve], laws: Sequence[GrainSizeLaw | None], *, title: str | None = None
) -> Path:
    """Draw torque over 1/n^2 with n grains per gap, and the law of the grain size with its 95 % band.

    Parameters
    ----------
    path : PNG to write.
    curves : over n; drawn as for currents.
    laws : of each curve; None: no line. A mark with its interval lies at the size of the real powder and at zero.
    """
    figure, (axis,) = _torque_axes(
        [replace(curve.along(curve.x**-EXPONENT), best=None) for curve in curves], title, joined=False
    )
    for number, law in enumerate(laws):
        if law is None:
            continue
        colour = COLOURS[number % len(COLOURS)]
        along = np.linspace(0.0, 1.05 * law.coarsest**-EXPONENT, 101)
        with np.errstate(divide="ignore"):
            mean, (low, high) = law.torque(along ** (-1.0 / EXPONENT))
        order = f"p = {law.order.value:.2g} ({law.order.low:.2g} to {law.order.high:.2g})"
        axis.plot(along, mean, color=colour, lw=1.2, label=f"T = {law.limit.value:.3g} N m (1 + a/n^p), {order}")
        axis.fill_between(along, low, high, color=colour, alpha=0.15, lw=0.0)
        if law.real_across is not None and law.real_torque is not None:
            real = law.real_torque
            bar = [[real.value - real.low], [real.high - real.value]]
            axis.errorbar(law.real_across**-EXPONENT, real.value, bar, fmt="s", mfc="white", ms=6, capsize=4,
                          color=colour, label=f"the real powder: {law.real_torque.in_words('N m')}")  # fmt: skip
    sizes = {f"{round(float(x), 1):g}": float(x) for curve in curves for x in curve.x}
    upper = axis.secondary_xaxis("top")
    upper.set_xticks([n**-EXPONENT for n in sizes.values()], list(sizes), fontsize=8)
    upper.set_xlabel("grains per gap, n", fontsize=9)
    axis.set_xlabel(f"1/n^{EXPONENT:g}")
    axis.set_xlim(left=0.0)
    legend_below(axis, 1)
    return save_picture(figure, path)


def _draw_range(axis: Axes, curve: TorqueCurve, found: LinearRange) -> None:
    """The line over its range and to its offset, dashed with torques not converged; of an unknown range, no line."""
    is_known = found.is_tested or found.unconverged > 0
    if found.slope is None or found.offset is None or found.slope_error is None or not is_known:
        return
    end = found.last if found.knee is None else found.knee
    sign = -1.0 if np.nanmean(curve.x) < 0.0 else 1.0
    along = np.array([max(found.offset, 0.0), end])
    label = f"{found.slope:.3g} ± {NORMAL * found.slope_error:.2g} N m/A"
    if found.knee is not None:
        label += f", knee at {found.knee:.3g} ± {NORMAL * (found.knee_error or 0.0):.2g} A"
        axis.plot(sign * found.knee, found.slope * (found.knee - found.offset), "|", ms=12, color=LAW)
    label += " (95 %)"
    line = "-"
    if found.unconverged:
        line, label = "--", f"{label}, {found.unconverged} of {found.points} points not converged"
    axis.plot(sign * along, found.slope * (along - found.offset), color=LAW, lw=0.9, ls=line, label=label)


def _torque_axes(
    curves: Sequence[TorqueCurve], title: str | None, *, joined: bool, panels: int = 1
) -> tuple[Figure, np.ndarray]:
    """Return a figure and its panels, in each the torques with their error bars, as `_draw_torques` draws them."""
    figure, axes = new_figure(7.0 if panels == 1 else 13.0, 4.8, title, columns=panels)
    for axis in axes:
        _draw_torques(axis, curves, joined=joined)
        axis.grid(alpha=0.25)
    axes[0].axhline(0.0, color="black", lw=0.6)
    axes[0].set_ylabel("torque on the disc [N m]")
    return figure, axes


def _draw_torques(axis: Axes, curves: Sequence[TorqueCurve], *, joined: bool) -> None:
    """Draw torques with their error bars; hollow where not converged, without a bar where the error is unknown."""
    labelled: set[str] = set()

    def once(label: str) -> str:
        """Return the label of a mark for the first curve that has it."""
        first = label not in labelled
        labelled.add(label)
        return label if first else "_nolegend_"

    for number, curve in enumerate(curves):
        colour = COLOURS[number % len(COLOURS)]
        bars = NORMAL * curve.error
        known = np.isfinite(bars)
        if joined or len(curves) > 1:
            axis.plot(curve.x, curve.torque, color=colour, lw=0.8, alpha=0.6, label=curve.label or "_nolegend_")
        for chosen, fill, label in (
            (known & curve.converged, colour, "95 % interval"),
            (known & ~curve.converged, "white", "95 % interval, not converged"),
        ):
            if chosen.any():
                axis.errorbar(curve.x[chosen], curve.torque[chosen], bars[chosen], fmt="o", ms=6, mfc=fill, capsize=4,
                              color=colour, lw=1.2, label=once(label))  # fmt: skip
        if curve.best is not None and np.isfinite(curve.best).any():
            axis.plot(curve.x, curve.best, "x--", ms=7, lw=1.2, color=colour, label=once(BEST))
        if not known.all():
            axis.plot(curve.x[~known], curve.torque[~known], "D", ms=6, mfc="white", color=colour,
                      label=once("error unknown"))  # fmt: skip
