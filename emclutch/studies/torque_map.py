"""Torque map: the expected torque with its 95 % interval over one or two quantities of a scene.

Each point is the torque of the real powder by its law (`emclutch.simulation.forecast.expected_torque`), in a field that
is solved for that point. Points that differ in drive, speed, friction or amount of powder alone share their mesh. Steel
with hysteresis is demagnetised at each point; over the current there is a second branch, of currents that fall from the
last one.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product
from math import inf, isclose, log, nan
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas

from emclutch.device_model.device import Device, build_device
from emclutch.results.atomic_file import replace_json, replace_text
from emclutch.results.measured_table import MEASURED, TORQUE_CURVE, keep_measured, measured_in, read_measured
from emclutch.results.new_path import new_folder
from emclutch.results.pictures.torque_map import BandedCurve, torque_contour_picture, torque_map_picture
from emclutch.results.report.render import Reported, write_index
from emclutch.results.report.report import (
    Links,
    Mark,
    Picture,
    Report,
    Shown,
    Statement,
    Statements,
    Table,
    note,
    warning,
)  # fmt: skip
from emclutch.results.text import format_range
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import Fault, SceneError, bad_input_for, no_argument
from emclutch.scene.flat import settings_beside
from emclutch.scene.input_files import materials_in_words
from emclutch.scene.map_axes import CURRENT, KEYS, Axis, axes_of, sheared_gap_hint
from emclutch.scene.units import unit_of
from emclutch.simulation.forecast.expected_field import field_of_sheared_powder
from emclutch.simulation.forecast.expected_torque import ExpectedTorque, Interval
from emclutch.studies.design_search import expectation_of
from emclutch.studies.measured_torques import compared_rows, trend_in_words
from field import ConvergenceError

if TYPE_CHECKING:
    from emclutch.results import Progress

TORQUES = ("torque", "low", "high", "unknown_low", "unknown_high")
"""Columns of map.csv in N m: mean, 95 % interval, and 90 % range of unknown powder, of a map over one axis."""
HEADS = ("torque [N m]", "95 % low", "95 % high", "90 % low", "90 % high")
LEFT_OUT = (
    "The interval is that of the law of the powder. Left out: tolerances of the drawing and of materials, friction "
    "that changes with temperature, and hysteresis"
)
FALLING = "falling"
"""Column of map.csv in N m: torque of the same powder at a current that falls from the last one of the map, of steel
with hysteresis."""
COMPARED = "measured_over_expected.csv"
SHOWN = 100
"""Measured torques at most in the table of the page; the file has all."""
MAX_MEASURED = 30
"""Measured currents at most at which the expected torque is computed; with more it is interpolated."""
NAMED = 3
"""Points outside of the interval that are named."""
SHORT = 20
"""Points at most in a table on the terminal; the page has all."""
CURVES = 6
"""Values of a second axis up to which the picture has a curve for each; it has contours for more."""


@dataclass(frozen=True, slots=True)
class MapPoint:
    """A point: values of the axes [SI] and the torque that is expected there; None with the reason where none is.

    `falling` is the torque [N m] of a falling current in steel with hysteresis; None without one.
    """

    values: tuple[float, ...]
    expected: ExpectedTorque | None
    reason: str = ""
    falling: float | None = None

    @property
    def torque(self) -> Interval | None:
        """Of the real powder; None where the scene is not valid, or has no torque."""
        return None if self.expected is None else self.expected.real

    @property
    def is_guess(self) -> bool:
        """Whether it is a guess, or a bound alone."""
        return self.torque is not None and (self.torque.is_guess or self.torque.low == 0.0 < self.torque.high)

    @property
    def beyond(self) -> str:
        """Materials whose tables end too early for the torque, in words; empty without any."""
        names = ", ".join({} if self.torque is None or self.expected is None else self.expected.beyond_tables.values())
        return f"beyond the table of {names}" if names else ""

    @property
    def remark(self) -> str:
        """Why there is no torque, or why it is 0, a guess or beyond a table; else empty."""
        without = self.torque is None or self.torque.mean == 0.0
        law = self.expected.law if self.expected is not None and (self.is_guess or without) else self.reason
        return "; ".join(filter(None, (law, self.beyond)))

    def row(self) -> dict[str, Any]:
        """Return its torques [N m] by the columns of map.csv; None where unknown."""
        torque, unknown = self.torque, None if self.expected is None else self.expected.unknown_powder
        ends = (None, None, None) if torque is None else (torque.mean, torque.low, torque.high)
        found = dict(zip(TORQUES, (*ends, *(unknown or (None, None))), strict=True))
        return found | {"is_guess": self.is_guess, "remark": self.remark}


@dataclass(frozen=True, repr=False)
class MapResult(Reported):
    """Expected torques over one or two axes.

    Attributes
    ----------
    folder : Path
        With map.csv, map.json, map.png and index.html, beside a measured table with measured_over_expected.csv.
    case : Case
    axes : tuple of Axis
        The first is x.
    points : tuple of MapPoint
        A row of x for each value of the second axis.
    """

    folder: Path
    case: Case
    axes: tuple[Axis, ...]
    points: tuple[MapPoint, ...]

    @property
    def table(self) -> pandas.DataFrame:
        """`rows`, a row a point; units in `units`."""
        return pandas.DataFrame(self.rows)

    @property
    def units(self) -> dict[str, str]:
        """Units of the columns of `table`; what has none is a pure number or a text."""
        torques = [*TORQUES, *([FALLING] if FALLING in self.rows[0] else [])]
        return {axis.key: axis.quantity.unit for axis in self.axes} | dict.fromkeys(torques, "N m")

    @cached_property
    def measured(self) -> list[dict[str, Any]]:
        """Rows of measured_over_expected.csv: each torque of the folder's ``measured.csv`` and the expected one.

        A row has the column of the table, the current [A], the value of the second axis [SI], torque and standard error
        [N m], the expected torque with its 95 % interval, the ratio of both, whether the torque lies in the interval,
        and whether that is a guess; None where a current is beyond the map (`emclutch.studies.measured_torques`).
        """
        curves, (x, *others) = measured_in(self.folder) or {}, self.axes
        rows = []
        for value in others[0].values if others else (None,):
            torques = [one.torque for one in self.points if value in (None, *one.values[1:])]
            for row in compared_rows(curves, x.values, torques):
                head = {"curve": row.pop("curve"), x.key: row.pop("current")}
                rows.append(head | ({others[0].key: value} if others else {}) | row)
        return rows

    @cached_property
    def warnings(self) -> list[str]:
        """Warnings of the scene and of the point with the strongest field, and of points beyond the end of a table."""
        known = sorted(((one.expected, one) for one in self.points if one.expected), key=lambda pair: pair[0].H)
        (expected, strongest), of_all = known[-1], self.case.warnings
        texts = dict.fromkeys(_scene_at(self.case, self.axes, strongest.values).warnings + expected.warnings)
        found = [text if text in of_all else f"at {self.where(strongest)}: {text}" for text in texts]
        if beyond := [(expected, one) for expected, one in known if one.beyond]:
            expected, worst = beyond[-1]
            found.append(f"{len(beyond)} of {len(self.points)} points drive steel beyond its table; the interval does "
                         f"not contain the error of the table. At {self.where(worst)}: "
                         f"{'. '.join(expected.beyond_tables)}")  # fmt: skip
        return found

    @property
    def rows(self) -> list[dict[str, Any]]:
        """Rows of map.csv: values by their keys [SI], torques [N m], and why a torque is a guess or missing."""
        keys, points = [axis.key for axis in self.axes], self.points
        rows = [dict(zip(keys, point.values, strict=True)) | point.row() for point in points]
        if any(point.falling is not None for point in points):
            rows = [row | {FALLING: point.falling} for row, point in zip(rows, points, strict=True)]
        return rows

    def where(self, point: MapPoint) -> str:
        """Return the values of a point in words."""
        return ", ".join(f"{a.name} {a.shown(value)}" for a, value in zip(self.axes, point.values, strict=True))

    def picture(self, path: Path) -> Path:
        """Draw the torque over x, a curve for each value of the second axis, with measured points of the folder.

        More than `CURVES` values of the second axis have contours, unless measured points lie over the curves.
        """
        x, *others = self.axes
        factors = [unit_of(axis.entry, axis.quantity)[1] for axis in self.axes]
        title, measured = self.case.scene.scene.title, measured_in(self.folder)
        if others and len(others[0].values) > CURVES and measured is None:
            shape = len(others[0].values), len(x.values)
            torque = np.array([nan if one.torque is None else one.torque.mean for one in self.points]).reshape(shape)
            is_guess = np.array([one.is_guess for one in self.points]).reshape(shape)
            values = [factor * np.array(axis.values) for axis, factor in zip(self.axes, factors, strict=True)]
            labels, scales = ([axis.label for axis in self.axes], [axis.is_logarithmic for axis in self.axes])
            return torque_contour_picture(path, values, torque, is_guess, labels, logarithmic=scales, title=title)
        curves = []
        for value in others[0].values if others else (None,):
            label = "expected torque" if value is None else f"{others[0].name} {others[0].shown(value)}"
            found = [one for one in self.points if one.torque is not None and value in (None, *one.values[1:])]
            ends = [(one.torque.mean, one.torque.low, one.torque.high) for one in found if one.torque is not None]
            unknown = [(one.expected and one.expected.unknown_powder) or (nan, nan) for one in found]
            falling = [nan if one.falling is None else one.falling for one in found]
            along = [factors[0] * one.values[0] for one in found]
            columns = along, ends, [one.is_guess for one in found], unknown, falling
            if found:
                curves.append(BandedCurve(label, *(np.array(column) for column in columns)))
        return torque_map_picture(
            path, curves, x.label, logarithmic=x.is_logarithmic, measured=measured, per_x=factors[0], title=title
        )

    def report(self) -> Report:
        """Return the largest and the smallest torque, what is a guess or missing, and the table; data in SI."""
        axes = [{"key": a.key, "name": a.name, "unit": a.quantity.unit, "values": a.values} for a in self.axes]
        materials = materials_in_words(self.case.scene, self.case.data)
        data = {"case": self.case.name, "axes": axes, "points": self.rows, "folder": str(self.folder),
                "materials": materials, "warnings": self.warnings}  # fmt: skip
        data |= {"measured": self.measured} if self.measured else {}
        report = Report(f"Torque map: {self.case.name}", data=data, folder=self.folder)
        report.add("Result", Statements([*self._of_measured(), *self._statements()]), Shown.TERMINAL)
        report.add("Picture", Picture("torque map", self.folder / "map.png"), Shown.PAGE)
        names = TORQUES[: 5 if len(self.axes) == 1 else 3]
        branch = [f"{FALLING} current [N m]"] if FALLING in self.rows[0] else []
        cells = [
            [a.shown(value) for a, value in zip(self.axes, point.values, strict=True)]
            + [_shown(row[name]) for name in (*names, FALLING) if name in row]
            + [", ".join(filter(None, ("guess" if point.is_guess else "" if point.torque else "none", point.beyond)))]
            for point, row in zip(self.points, self.rows, strict=True)
        ]
        head = [*(a.name for a in self.axes), *HEADS[: len(names)], *branch, ""]
        if self.measured:
            report.add("Measured divided by expected torque", self._measured_table(), Shown.PAGE)
        where = Shown.TERMINAL if len(cells) <= SHORT else Shown.PAGE
        report.add("Points", Table(cells, head, range(len(head) - 1)), where)
        report.add("Materials", Table([*materials.items()], ("region", "material")), Shown.PAGE)
        files = [("map.csv", "all points in SI, with the reason of every guess"), ("map.json", "the same as JSON"),
                 ("case.toml", "the scene as resolved, in SI units")]  # fmt: skip
        if self.measured:
            files += [(COMPARED, "measured and expected torques"), (MEASURED, "the measured table as it was given")]
        return report.add("Files", Links(files), Shown.PAGE)

    def _measured_table(self) -> Table:
        """Return the first `SHOWN` measured torques beside the expected ones."""
        rows, keys = self.measured[:SHOWN], [axis.key for axis in self.axes]
        numbers = ("torque_measured", "standard_error", "torque", "low", "high")
        head = ["measured", *(a.name for a in self.axes), *(f"{name.replace('_', ' ')} [N m]" for name in numbers),
                "measured / expected", "in the 95 % interval"]  # fmt: skip
        cells = [
            [row["curve"], *(a.shown(row[key]) for a, key in zip(self.axes, keys, strict=True))]
            + [_shown(row[name]) for name in (*numbers, "ratio")]
            + ["beyond the map" if row["ratio"] is None else
               ("yes" if row["is_inside"] else "no") + ", of a guess" * row["is_guess"]]
            for row in rows
        ]  # fmt: skip
        return Table(cells, head, range(1, len(head) - 1))

    def _of_measured(self) -> Iterator[Statement]:
        """Say for each measured curve its ratio to the expected one, to the nearest one of a second axis."""
        rows, (x, *others) = self.measured, self.axes
        names, has_trend = list(dict.fromkeys(row["curve"] for row in rows)), False
        for name in names:
            known = [row for row in rows if row["curve"] == name and row["ratio"] is not None]
            missing = {row[x.key]: None for row in rows if row["curve"] == name and row["ratio"] is None}
            of = f" ({name})" if len(names) > 1 else ""
            if known:
                groups: dict[Any, list[dict[str, Any]]] = {}
                for row in known:
                    groups.setdefault(row[others[0].key] if others else None, []).append(row)
                value, nearest = min(groups.items(), key=lambda pair: float(np.mean([_misfit(row) for row in pair[1]])))
                of += f", nearest at {others[0].name} {others[0].shown(value)}" if others else ""
                yield _ratio_in_words(nearest, of, x)
                judged = [(row[x.key], row["ratio"]) for row in nearest if not row["is_guess"]]
                if trend := trend_in_words(f"measured divided by expected torque{of}", judged, x.shown):
                    has_trend = True
                    yield warning(trend)
            if missing:
                shown = [x.shown(current) for current in missing]
                several = ", ".join(shown if len(shown) < 5 else [*shown[:3], "...", shown[-1]])
                yield note(f"Measured{of} but not compared, at 0 A or beyond the points of the map: {several}.")
        if any(row["is_inside"] is False for row in rows) and not has_trend:
            yield note("The interval is common to all points: one cause may move them all, as powder, gap or winding.")
            if len(names) == 1:
                yield note(f"Next: fit the powder to them: {self._command('fit', '--to', str(self.folder / MEASURED))}")

    def _statements(self) -> Iterator[Statement]:
        known = [(one.torque.mean, one) for one in self.points if one.torque is not None]
        (_, largest), (_, smallest) = (of(known, key=lambda pair: pair[0]) for of in (max, min))
        names = ("Largest torque", "Smallest torque") if len(known) > 1 else ("Torque",)
        for name, point in zip(names, (largest, smallest), strict=False):
            assert point.torque is not None  # by `known`
            mark = Mark.WARNING if point.is_guess or point.beyond or point.torque.mean == 0.0 else Mark.GOOD
            yield Statement(mark, f"{name}: {point.torque.in_words()} at {self.where(point)}.")
            if point.expected is not None and point.expected.unknown_powder is not None:
                between = format_range(*point.expected.unknown_powder)
                yield note(f"If friction and fill of the powder were unknown: {between} N m (90 % range).")
        for axis in self.axes:
            if hint := sheared_gap_hint(self.case, axis.key):
                yield note(hint)
        zero = [one for one in self.points if one.torque is not None and one.torque.mean == 0.0]
        for what, found in (("a guess", [one for one in self.points if one.is_guess]), ("at 0 N m", zero),
                            ("missing", [one for one in self.points if one.torque is None])):  # fmt: skip
            if found:
                count = f"{len(found)} of {len(self.points)} points {'is' if len(found) == 1 else 'are'} {what}"
                all_of = "" if len(found) == 1 else " All reasons: map.csv."
                yield warning(f"{count}. At {self.where(found[0])}: {found[0].remark}.{all_of}")
        yield from (warning(text) for text in self.warnings)
        if drag := self.case.scene.motion.drag_in_words:
            yield note(drag)
        above = [(one.falling / one.torque.mean - 1.0, one) for one in self.points if one.falling and one.torque]
        if above:
            ratio, point = max(above, key=lambda pair: pair[0])
            last = self.axes[0].shown(self.axes[0].values[-1])
            yield note(f"At a current that falls from {last} the torque is up to {100.0 * ratio:.2g} % larger by the "
                       f"hysteresis of the steel, at {self.where(point)}.")  # fmt: skip
        if (file := self.case.scene.grains.powder_law) is not None:
            yield note(f"Law of the powder: {file}.")
        yield note(f"{LEFT_OUT}{' of the powder, which makes most of a measured loop' if above else ''}.")
        texts = {key: "none" if of is None else axis.shown(value)
                 for axis, value in zip(self.axes, largest.values, strict=True)
                 for key, of in axis.changes(value).items()}  # fmt: skip
        yield note(f"Next: run one point, for example: {self._command('run', **texts)}")

    def _command(self, name: str, *words: str, **texts: str) -> str:
        """Return a command for the case with its settings and others, by dotted keys."""
        sets = [word for pair in (settings_beside(self.case) | texts).items() for word in ("--set", "=".join(pair))]
        return shlex.join(["emclutch", name, str(self.case.path or "CASE"), *words, *sets])


def _shown(value: float | None) -> str:
    return "" if value is None else f"{value:.4g}"


def _misfit(row: Mapping[str, Any]) -> float:
    """Return |ln| of a ratio, infinite for a measured torque of another sign."""
    return abs(log(row["ratio"])) if row["ratio"] > 0.0 else inf


def _ratio_in_words(rows: Sequence[Mapping[str, Any]], of: str, x: Axis) -> Statement:
    """Say the range of the ratios, of guesses only where all are, and the points outside of the interval."""
    judged = [row for row in rows if not row["is_guess"]]
    outside = sorted((row for row in rows if not row["is_inside"]), key=lambda row: (row["is_guess"], -_misfit(row)))
    low, high = (f"{end(row['ratio'] for row in judged or rows):#.3g}".rstrip(".") for end in (min, max))
    names = [f"{x.shown(row[x.key])} ({100.0 * (row['ratio'] - 1.0):+.0f} %)" for row in outside[:NAMED]]
    which = f": {', '.join(names)}{', ...' * (len(outside) > NAMED)}" if names else ""
    lie, guesses = "lies" if len(outside) == 1 else "lie", len(rows) - len(judged)
    count = f"{len(outside)} of {len(rows)} points {lie} outside of the 95 % interval"
    guess = f"; the expected torque of {guesses} is a guess" if guesses else ""
    spread = low if low == high else f"{low} to {high}"
    return Statement(Mark.WARNING if outside else Mark.GOOD,
                     f"Measured divided by expected torque{of}: {spread}; {count}{which}{guess}.")  # fmt: skip


def map(
    case: Case | str | Path,
    *,
    measured: str | Path | None = None,
    out: str | Path | None = None,
    progress: Progress | None = None,
    **axes: str | Sequence[Any],
) -> MapResult:
    """Return the expected torque over one or two axes, and write table, picture and page.

    Parameters
    ----------
    case : Case, or the path of a scene file
    measured : table of measured torques [N m] over the current [A] (`emclutch.results.measured_table.read_measured`),
        to be compared where x is the current; `MapResult.measured` has the ratios.
    out : new folder; default: the next maps/<case>-<nnn>.
    progress : takes the fraction of the points that are done.
    **axes : one or two of ``current``, ``voltage``, ``gap``, ``speed``, ``fill``, ``repose``, ``temperature`` or a
        dotted key of a quantity, the first is x: a range ``"0.1 A:1.5 A"``, with a count ``"0.1 A:1.5 A:8"``, or a
        list ``"1 A, 2 A"``; or a sequence of numbers in SI and of texts with units. A point whose scene is not valid
        keeps its reason.

    Raises
    ------
    SceneError
        Faults of the scene or of the axes; no point has a torque.
    OutputError
        The folder is there already; the measured table cannot be read.
    """
    case = as_case(case)
    for name in axes:
        if name not in KEYS and "." not in name:
            raise no_argument(name, "map", [*KEYS, "case", "measured", "out", "progress"])
    return map_over(case, axes_of(case, axes), measured=measured, out=out, progress=progress)


def map_over(
    case: Case,
    axes: tuple[Axis, ...],
    *,
    measured: str | Path | None = None,
    out: str | Path | None = None,
    progress: Progress | None = None,
) -> MapResult:
    """Return and write the map over axes; see `map`."""
    if measured is not None:
        if axes[0].key != CURRENT:
            message = f"lies over torque against current; the first axis is {axes[0].key}: give the current first"
            raise SceneError([Fault("measured table", str(measured), message)], "torque map")
        axes = (_with_measured(axes[0], read_measured(measured, *TORQUE_CURVE)), *axes[1:])
    folder = new_folder(out, case.name, "maps")
    known: dict[tuple[float, ...], MapPoint] = {}
    grid = [tuple(reversed(values)) for values in product(*(axis.values for axis in reversed(axes)))]
    meshes = {at: tuple(v for v, axis in zip(at, axes, strict=True) if not axis.keeps_mesh) for at in grid}
    mesh, device = None, None
    for at in sorted(grid, key=lambda at: meshes[at]):  # points of one mesh follow each other
        known[at], made = _point(case, axes, at, device if mesh == meshes[at] else None)
        if made is not None:
            mesh, device = meshes[at], made
        if progress is not None:
            progress.update(len(known) / len(grid), f"{len(known)} of {len(grid)} points")
    points, n = [known[at] for at in grid], len(axes[0].values)
    effects = case.scene.effects
    has_branch = effects.memory is not None and effects.attraction is not None
    if has_branch and axes[0].key == CURRENT and axes[0].values[0] >= 0.0:
        rows = [points[start : start + n] for start in range(0, len(grid), n)]
        points = [point for row in rows for point in _with_falling(case, axes, row)]
    result = MapResult(folder, case, axes, tuple(points))
    if all(point.torque is None for point in result.points):
        first = result.points[0]
        message = f"has no torque at any point; at {result.where(first)}: {first.remark}"
        raise SceneError([Fault("map", "", message)], "torque map")
    folder.mkdir(parents=True)
    if measured is not None:
        keep_measured(measured, folder)
    result.picture(folder / "map.png")
    replace_text(folder / "map.csv", result.table.to_csv(index=False))
    if result.measured:
        replace_text(folder / COMPARED, pandas.DataFrame(result.measured).to_csv(index=False))
    report = result.report()
    replace_json(folder / "map.json", report.data)
    case.write_toml(folder / "case.toml")
    write_index(report)
    return result


def _with_measured(axis: Axis, measured: Mapping[str, np.ndarray]) -> Axis:
    """Return an axis of currents with the measured ones between its ends, at most `MAX_MEASURED`."""
    known, currents = axis.values, {float(I) for points in measured.values() for I in points[:, 0]}
    new = [one for one in currents if known[0] < one < known[-1] and one != 0.0
           and not any(isclose(one, value, rel_tol=1e-6) for value in known)]  # fmt: skip
    return replace(axis, values=tuple(sorted([*known, *new]))) if len(new) <= MAX_MEASURED else axis


def _scene_at(case: Case, axes: tuple[Axis, ...], at: tuple[float, ...]) -> Case:
    """Return the scene with some values [SI] of the axes."""
    changes = [axis.changes(value) for axis, value in zip(axes, at, strict=True)]
    return case.with_values({key: value for change in changes for key, value in change.items()})


def _point(
    case: Case, axes: tuple[Axis, ...], at: tuple[float, ...], like: Device | None
) -> tuple[MapPoint, Device | None]:
    """Return the point at some values [SI], with its device, which has the mesh of another one where that is given."""
    try:
        changed = _scene_at(case, axes, at)
        with bad_input_for(case.path):
            device = build_device(changed.scene) if like is None else like.driven_as(changed.scene)
        unknown = len(axes) == 1 and not axes[0].is_of_friction
        point, source = MapPoint(at, expectation_of(changed, device, unknown)), changed.scene.coil_field
        return point, None if source is not None and source.tolerance else device  # refined for one current and fill
    except SceneError as error:
        return MapPoint(at, None, str(error.faults[0])), None
    except ConvergenceError as error:
        return MapPoint(at, None, str(error)), None


def _with_falling(case: Case, axes: tuple[Axis, ...], rising: list[MapPoint]) -> list[MapPoint]:
    """Return points over ascending currents with the torque of the way down from the last one.

    The steel's history goes from each current to the next one below, with the permeability of sheared powder.
    """
    points, device = list(rising), None
    for number in reversed([n for n, one in enumerate(rising) if one.torque is not None and one.values[0] > 0.0]):
        changed = _scene_at(case, axes, rising[number].values)
        device = build_device(changed.scene) if device is None else device.driven_as(changed.scene)
        coil = device.section_coil
        if coil is None or coil.history is None:
            break
        try:
            points[number] = replace(rising[number], falling=expectation_of(changed, device).torque)
            in_the_field = 0.0 if changed.scene.effects.feedback is None else device.fill.solid_fraction
            fill = coil.uniform_fill(in_the_field)
            found = field_of_sheared_powder(coil, fill, changed.scene, coil.largest_current, None)
        except ConvergenceError:
            break  # the currents below have no history
        device = replace(device, coil=replace(coil, history=found.later_history))
    return points
