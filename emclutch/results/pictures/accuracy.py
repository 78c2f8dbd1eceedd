"""Cost against error: what each setting of a scene changes, and what the best combination of all costs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from emclutch.results.accuracy_study import INTERACTION, AccuracyStudy, MeasuredSetting, SettingError
from emclutch.results.pictures.figure import COLOURS, MARKERS, label_panel, new_figure, save_picture
from emclutch.results.recommended import (
    OWN_REPLICAS,
    STATISTICS,
    Choice,
    Combinations,
    LimitingError,
    choice_with,
    own_choice,
)
from emclutch.results.text import format_duration, format_time, in_words
from emclutch.settings import UNITS

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.text import Annotation

NAMED = 3
"""Lines with a name at most; the colours of all stand in the panel beside."""
MOVES = 1.05
"""Factor of the total error over the values of a setting from which on it has a name."""
MOVES_UP = 50
"""Of a label over others, by 2 points each."""
TIMES = (1, 3, 10, 30, 60, 180, 600, 1800, 3600, 3 * 3600, 10 * 3600, 30 * 3600, 100 * 3600, 300 * 3600, 1000 * 3600)
REACHED, NOT_REACHED = "#1d7a3a", "0.4"
_Line = list[tuple[float, float, float]]


def accuracy_picture(
    path: str | Path,
    study: AccuracyStudy,
    answers: Sequence[tuple[float, Choice | LimitingError]],
    *,
    title: str | None = None,
) -> Path:
    """Draw the total error against processor time, a line for each setting, and the parts of the scene's own error.

    Parameters
    ----------
    path : PNG to write.
    study : of a device. A line has the values of one setting, all others being the scene's own; values that failed
        are crosses at the top. The frontier has what no cheaper combination of all settings is as accurate as.
    answers : half width that is wanted, relative, and what reaches it: a circle; a dashed line for what nothing does.
    """
    figure, (cost, parts) = new_figure(13.0, 6.0, title, columns=2, width_ratios=(1.45, 1.0))
    own = own_choice(study, OWN_REPLICAS)
    looks = {
        setting.name: _Look(COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)])
        for number, setting in enumerate(study.settings)
    }
    seconds, half = Combinations(study).frontier()
    cost.plot(seconds, 100.0 * half, color="black", lw=5.0, alpha=0.16, drawstyle="steps-post", solid_capstyle="round")
    best = cost.annotate("best combination of settings and replicas", (seconds[0], 100.0 * half[0]), xytext=(8, 6),
                         textcoords="offset points", fontsize=9, color="0.35")  # fmt: skip
    lines = {setting.name: _line(study, setting) for setting in study.settings}
    named = sorted(lines, key=lambda name: _moves(lines[name]), reverse=True)[:NAMED]
    labels = [best]
    for setting in study.settings:
        is_named = setting.name in named and _moves(lines[setting.name]) >= MOVES
        labels += _draw_setting(cost, study, setting, lines[setting.name], looks[setting.name], is_named)
    cost.plot(own.seconds, 100.0 * own.half_width, "*", ms=17, mfc="gold", mec="black", zorder=6, gid="this scene")
    cost.annotate("this scene", (own.seconds, 100.0 * own.half_width), xytext=(12, 5), textcoords="offset points",
                  fontsize=9, fontweight="bold")  # fmt: skip
    fixed = [_draw_target(cost, target, found) for target, found in answers]
    label_panel(cost, f"Error against cost (lines: one setting changed, {OWN_REPLICAS} replicas)")
    _name_axes(cost)
    _draw_parts(parts, study, own, looks)
    figure.draw_without_rendering()  # the places of labels depend on the layout
    _move_apart(labels, fixed)
    return save_picture(figure, path)


@dataclass(frozen=True, slots=True)
class _Look:
    colour: str
    marker: str


def _line(study: AccuracyStudy, setting: MeasuredSetting) -> _Line:
    """Return value, processor time [s] and total half width [%] of the values of a setting, from coarse to fine."""
    return [
        (measured.value, choice.seconds, 100.0 * choice.half_width)
        for measured in sorted(setting.values, key=lambda one: -one.step_size)
        if (choice := choice_with(study, setting, measured, OWN_REPLICAS)) is not None
    ]


def _moves(line: _Line) -> float:
    """Return the factor over which the values of a setting move the total error."""
    half = [one[2] for one in line]
    return max(half) / min(half) if half else 1.0


def _draw_setting(
    axis: Axes, study: AccuracyStudy, setting: MeasuredSetting, line: _Line, look: _Look, is_named: bool
) -> list[Annotation]:
    """Draw the values of a setting, with their numbers and its name where it is one of those that count most."""
    labels = []
    if line:
        values, x, y = (np.array(one) for one in zip(*line, strict=True))
        axis.plot(x, y, color=look.colour, lw=1.3, marker=look.marker, ms=6)
        if is_named:
            own = int(np.argmin(np.abs(values / setting.own - 1.0)))
            end = int(np.argmax(np.abs(np.log(y / y[own]))))
            written = [own]
            for place in sorted(range(len(values)), key=lambda one: abs(one - end)):
                if any(abs(np.log(x[place] / x[one])) < 0.35 and abs(np.log(y[place] / y[one])) < 0.07
                       for one in written):  # fmt: skip
                    continue  # the numbers would overlap
                written.append(place)
                text = _named_value(setting.name, values[place]) if place == end else f"{values[place]:.3g}"
                labels.append(axis.annotate(text, (x[place], y[place]), xytext=(6, 5), textcoords="offset points",
                                            fontsize=9, color=look.colour))  # fmt: skip
    failed = [measured.cost * study.seconds * OWN_REPLICAS for measured in setting.values if measured.failure]
    above = axis.get_xaxis_transform()
    for seconds in failed:
        axis.plot(seconds, 0.96, color=look.colour, ls="", marker="x", ms=8, mew=2, transform=above)
        axis.annotate(f"{in_words(setting.name)} failed", (seconds, 0.96), xycoords=above, xytext=(8, 0), va="center",
                      textcoords="offset points", fontsize=9, color=look.colour)  # fmt: skip
    return labels


def _move_apart(labels: Sequence[Annotation], fixed: Sequence[Annotation]) -> None:
    """Move labels that overlap others or the fixed ones up, the lowest first."""
    free = [one.get_window_extent() for one in fixed]
    for label in sorted(labels, key=lambda one: one.xy[1]):
        for _ in range(MOVES_UP):
            if not any(label.get_window_extent().overlaps(other) for other in free):
                break
            x, y = label.xyann
            label.xyann = x, y + 2.0
        free.append(label.get_window_extent())


def _draw_target(axis: Axes, target: float, found: Choice | LimitingError) -> Annotation:
    reached = isinstance(found, Choice)
    colour = REACHED if reached else NOT_REACHED
    axis.axhline(100.0 * target, color=colour, lw=0.9, ls="-" if reached else (0, (6, 4)), zorder=1)
    words = f"{100.0 * target:g} %"
    if isinstance(found, Choice):
        axis.plot(found.seconds, 100.0 * found.half_width, "o", ms=12, mfc="none", mec=colour, mew=2.2, zorder=7)
        words += f": {format_duration(found.seconds)}"
    else:
        words += f": not reached, dominant error: {in_words(found.setting)}"
    side, place = ("right", 0.995) if reached else ("left", 0.005)
    return axis.annotate(words, (place, 100.0 * target), xycoords=axis.get_yaxis_transform(), ha=side, va="bottom",
                         fontsize=9, color=colour, xytext=(0, 2), textcoords="offset points")  # fmt: skip


def _draw_parts(axis: Axes, study: AccuracyStudy, own: Choice, looks: dict[str, _Look]) -> None:
    """Draw the error of each setting with its interval, the widest at the top, and their total at the bottom."""
    rows: list[tuple[str, SettingError, _Look, bool]] = []
    for name, half in own.parts.items():
        if name == INTERACTION:
            continue
        if name == STATISTICS:
            rows.append((f"{OWN_REPLICAS} replicas", SettingError(0.0, half), _Look("0.35", "o"), True))
        else:
            error, setting = own.total.parts[name], study.setting(name)
            text = in_words(name) if setting is None else _named_value(name, setting.own)
            rows.append((text, error, looks[name], error.is_significant))
    unknown = own.total.unknown
    for place in range(len(rows), len(rows) + len(unknown)):
        axis.annotate("not measured", (0.0, place), xytext=(6, 0), textcoords="offset points", va="center", fontsize=9,
                      color="0.4")  # fmt: skip
    labels = [*(row[0] for row in rows), *map(in_words, unknown)]
    places = [*range(len(rows)), len(labels)]
    labels.append("total of what was measured" if unknown else "total")
    rows.append(("", SettingError(own.total.bias, own.half_width), _Look("black", "*"), True))
    for place, (_, error, look, significant) in zip(places, rows, strict=True):
        low, high = error.interval
        ends = [[100.0 * (error.bias - low)], [100.0 * (high - error.bias)]]
        axis.errorbar(100.0 * error.bias, place, xerr=ends, fmt=look.marker, color=look.colour, capsize=4, lw=1.6,
                      ms=12 if place == places[-1] else 7, mfc=look.colour if significant else "white")  # fmt: skip
    axis.set_yticks(range(len(labels)), labels, fontsize=9)
    for label, row in zip(axis.get_yticklabels(), rows[:-1], strict=False):
        label.set_color(row[2].colour)
    axis.axhline(len(labels) - 1.5, color="black", lw=0.6)
    axis.axvline(0.0, color="black", lw=0.8)
    axis.set_ylim(len(labels) - 0.4, -0.6)
    axis.set_xlabel("error of the torque, 95 % interval [%]")
    axis.grid(axis="x", alpha=0.25)
    label_panel(axis, "This scene: what each setting adds (hollow: not significant)")


def _named_value(setting: str, value: float) -> str:
    unit = UNITS.get(setting, "")
    return f"{in_words(setting)} {format_time(value) if unit == 's' else f'{value:.3g} {unit}'.strip()}"


def _name_axes(axis: Axes) -> None:
    axis.set(xscale="log", yscale="log", xlabel="processor time of a run")
    axis.set_ylabel("uncertainty of the best estimate, ± [%] (95 %)")
    axis.margins(x=0.06, y=0.16)
    low, high = axis.get_xlim()
    times = [one for one in TIMES if low <= one <= high]
    axis.set_xticks(times, [_duration(one) for one in times])
    axis.set_xticks([], minor=True)
    low, high = axis.get_ylim()
    shares = [a * 10.0**k for k in range(-2, 4) for a in (1, 2, 3, 5, 7) if low <= a * 10.0**k <= high]
    axis.set_yticks(shares, [f"{one:g}" for one in shares])
    axis.set_yticks([], minor=True)
    axis.grid(alpha=0.25)


def _duration(seconds: int) -> str:
    return format_duration(seconds) if seconds < 3600 else f"{seconds // 3600} h"
