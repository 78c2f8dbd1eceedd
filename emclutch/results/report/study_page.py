"""A study as one page while it runs: points, verdicts, the curve so far, failures with their last lines, time left.

The page needs nothing else and is opened from the disk; a browser loads it again by itself until the study has ended.
It has no scripts: the curve is drawn as SVG inside it.
"""

from __future__ import annotations

import datetime
import math
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from emclutch import __version__
from emclutch.results.atomic_file import replace_text
from emclutch.results.report.content import FILES, STUDY_PICTURES
from emclutch.results.report.render import embed_small, page_template
from emclutch.results.run_folder import INDEX
from emclutch.results.seed_average import averaged_over_seeds
from emclutch.results.study_dataset import number_and_unit
from emclutch.results.study_result import best_estimate_lines
from emclutch.results.study_table import DONE, FAILED, KEPT, RUNNING, STOPPED, WAITING, PointRow
from emclutch.results.text import format_duration, format_mean
from emclutch.results.torque_curves import NORMAL, TorqueCurve, torque_curves

SEED = "scene.seed"
FIRST = ("coil.current", "coil.voltage", "motion.rotor.speed")
"""Keys over which torque is drawn, if they are varied; of other studies the first key that has numbers."""
MAX_ROWS, MAX_FAILURES, MAX_LINES, MAX_CURVES, MAX_DOTS = 300, 20, 6, 8, 3000
RELOAD = 10
"""Seconds after which a browser loads the page of a running study again."""
ORDER = {FAILED: 0, STOPPED: 1, RUNNING: 2, DONE: 3, KEPT: 3, WAITING: 4}
COLOURS = ("#1f5fa8", "#c2571a", "#1d7a3a", "#8a3fa0", "#a8871f", "#207f86", "#b3261e", "#5b6675")
WIDTH, HEIGHT, LEFT, BOTTOM, TOP, RIGHT = 720.0, 380.0, 64.0, 48.0, 14.0, 16.0


@dataclass(frozen=True, slots=True)
class FailedPoint:
    """A point that failed: its folder, and what it failed of."""

    folder: Path
    label: str
    reason: str

    @property
    def last_lines(self) -> str:
        """The last lines of its log; empty where it has none."""
        try:
            with (self.folder / "run.log").open("rb") as file:
                file.seek(max(0, file.seek(0, 2) - 4000))
                text = file.read().decode(errors="replace")
        except OSError:
            return ""
        return "\n".join(text.splitlines()[-MAX_LINES:])


@dataclass(frozen=True, slots=True)
class StudyState:
    """How far a study has come.

    Attributes
    ----------
    folder : Path
    title : str
    values : dict of str to list
        Entries of each of its keys.
    names : of the folders of all its points.
    points : PointRow of each of them.
    rows : of `study.csv`, of those that are done.
    failures : of those that have failed.
    seconds_left : wall-clock time to its end [s], None where it is not known.
    is_running : whether somebody is at work on it.
    """

    folder: Path
    title: str
    values: dict[str, list[Any]]
    names: Sequence[str]
    points: Sequence[PointRow]
    rows: Sequence[dict[str, Any]]
    failures: Sequence[FailedPoint] = ()
    seconds_left: float | None = None
    is_running: bool = False


def write_study_page(state: StudyState) -> Path:
    """Write ``index.html`` into the study's folder in one step, and return it."""
    path = state.folder / INDEX
    replace_text(path, study_page(state))
    return path


def study_page(state: StudyState) -> str:
    """Return the page of a study as HTML."""
    counts = Counter(point.state for point in state.points)
    total = max(len(state.points), 1)
    done = counts[DONE] + counts[KEPT]
    parts = [("done", done), ("running", counts[RUNNING]), ("failed", counts[FAILED]), ("stopped", counts[STOPPED])]
    parts.append(("waiting", len(state.points) - sum(number for _, number in parts)))
    places = sorted(range(len(state.points)), key=lambda k: (ORDER[state.points[k].state], k))
    unconverged = sum(point.state in (DONE, KEPT) and not point.converged for point in state.points)
    pictures = {} if state.is_running else _pictures(state.folder)
    is_drawn = any(name.startswith("torque_vs_") for name in pictures)  # with what the curve here has, and more
    return page_template("study.html.j2").render(
        title=state.title or state.folder.resolve().name,
        name=state.folder.resolve().name,
        written=datetime.datetime.now().astimezone().strftime("%Y-%m-%d %H:%M:%S"),
        reload=RELOAD if state.is_running else None,
        left=None if state.seconds_left is None else format_duration(state.seconds_left),
        total=len(state.points),
        parts=[(name, number, 100.0 * number / total) for name, number in parts if number],
        unconverged=unconverged,
        corrected=best_estimate_lines(state.folder) if (state.folder / "study.csv").is_file() else [],
        points=[_cells(state.names[k], state.points[k]) for k in places[:MAX_ROWS]],
        more=max(0, len(places) - MAX_ROWS),
        failures=state.failures[:MAX_FAILURES],
        more_failures=max(0, len(state.failures) - MAX_FAILURES),
        curve=None if is_drawn else _curve(state),
        pictures=[*pictures.values()],
        files=[(name, what) for name, what in FILES.items() if (state.folder / name).is_file()],
        version=__version__,
    )


def _pictures(folder: Path) -> dict[str, tuple[str, str]]:
    """Return the pictures in a study's folder by their names: what they show, and an address that holds it."""
    found = {name: (what, folder / name) for name, what in STUDY_PICTURES.items() if (folder / name).is_file()}
    return {name: (what, embed_small(path.read_bytes())) for name, (what, path) in found.items()}


def _cells(name: str, point: PointRow) -> dict[str, str]:
    is_done = point.state in (DONE, KEPT)
    state = f"running, {100.0 * point.fraction:.0f} %" if point.state == RUNNING else point.state
    return {
        "name": name, "label": point.label, "state": state, "kind": "done" if is_done else point.state,
        "torque": format_mean(point.torque, point.interval) if is_done else "",
        "verdict": ("converged" if point.converged else "not converged") if is_done else "",
        "time": "" if point.seconds is None else format_duration(point.seconds),
    }  # fmt: skip


def _curve(state: StudyState) -> dict[str, Any] | None:
    """Return what the template draws of the torques that are known; None where there is nothing to draw over."""
    varied = [key for key, entries in state.values.items() if len(entries) > 1 and key != SEED]
    axes = {key: found for key in varied if (found := _numbers(state.values[key])) is not None}
    axis = next((key for key in (*FIRST, *axes) if key in axes), None)
    if axis is None:
        return None
    x, unit = axes[axis]
    rows = [{**row, "": x[str(row[axis])]} for row in state.rows if row.get("torque") is not None]
    if not rows:
        return None
    if len(state.values.get(SEED, ())) > 1:
        rows = averaged_over_seeds(rows, SEED, [key for key in state.values if key != SEED])
    rows = [{"standard_error": None, "low": None, "high": None, "converged": True, **row} for row in rows]
    shown = [row for row in rows if row["torque"] is not None][:: -(-len(rows) // MAX_DOTS)]
    curves = torque_curves(shown, "", [key for key in varied if key != axis]) if shown else []
    if not curves:
        return None
    if len(curves) > MAX_CURVES:  # of a sample: dots of one colour
        x_of, torque, error, converged = (
            np.concatenate([getattr(one, name) for one in curves]) for name in ("x", "torque", "error", "converged")
        )
        return _drawn([TorqueCurve({}, x_of, torque, error, converged)], axis, unit, joins=False)
    return _drawn(curves, axis, unit, joins=True)


def _numbers(entries: Sequence[Any]) -> tuple[dict[str, float], str] | None:
    """Return a key's entries as numbers and their unit; None where they are none."""
    found = number_and_unit([str(entry) for entry in entries])
    return None if found is None else (dict(zip(map(str, entries), found[0], strict=True)), found[1])


def _drawn(curves: Sequence[TorqueCurve], axis: str, unit: str, joins: bool) -> dict[str, Any]:
    """Return places in the picture: lines, dots with their bars, ticks, labels."""
    x = np.concatenate([curve.x for curve in curves])
    half = np.concatenate([NORMAL * np.nan_to_num(curve.error) for curve in curves])
    torque = np.concatenate([curve.torque for curve in curves])
    x_ticks = _ticks(float(x.min()), float(x.max()))
    y_ticks = _ticks(min(0.0, float((torque - half).min())), float((torque + half).max()))
    across = _scale(x_ticks, LEFT, WIDTH - RIGHT)
    up = _scale(y_ticks, HEIGHT - BOTTOM, TOP)
    drawn = []
    for number, curve in enumerate(curves):
        bars = NORMAL * np.nan_to_num(curve.error)
        dots = [
            {"x": f"{across(a):.1f}", "y": f"{up(t):.1f}", "low": f"{up(t - b):.1f}", "high": f"{up(t + b):.1f}",
             "known": bool(known), "text": f"{a:.6g} {unit}: {t:.4g} N m"}
            for a, t, b, known in zip(curve.x, curve.torque, bars, curve.converged, strict=True)
        ]  # fmt: skip
        line = " ".join(f"{dot['x']},{dot['y']}" for dot in dots) if joins else ""
        drawn.append({"colour": COLOURS[number % len(COLOURS)], "dots": dots, "line": line, "label": curve.label})
    return {
        "curves": drawn, "width": WIDTH, "height": HEIGHT, "left": LEFT, "right": WIDTH - RIGHT, "top": TOP,
        "bottom": HEIGHT - BOTTOM, "name": f"{axis} [{unit}]" if unit else axis,
        "x_ticks": [(f"{across(one):.1f}", f"{one:.6g}") for one in x_ticks],
        "y_ticks": [(f"{up(one):.1f}", f"{one:.6g}") for one in y_ticks],
    }  # fmt: skip


def _ticks(low: float, high: float) -> list[float]:
    """Return four to nine round numbers that enclose a range."""
    span = high - low or abs(high) or 1.0
    step = 10.0 ** math.floor(math.log10(span / 4.0))
    step *= next(factor for factor in (1.0, 2.0, 5.0, 10.0) if span / (factor * step) <= 6.0)
    first, last = math.floor(low / step + 1e-9), math.ceil(high / step - 1e-9)
    return [step * number for number in range(first, max(last, first + 1) + 1)]


def _scale(ticks: Sequence[float], begin: float, end: float) -> Any:
    low, high = ticks[0], ticks[-1]
    return lambda value: begin + (value - low) / (high - low) * (end - begin)
