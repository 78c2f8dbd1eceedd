"""Design search: the value of one quantity that gives a wanted torque, by root finding over the expected torque.

The expectation T(x) is the torque of the real powder by `emclutch.simulation.forecast.expected_torque`: its law,
integrated over the sheared gap in a field that is solved again for each x. Brent's method (R. P. Brent, Algorithms for
Minimization without Derivatives, 1973, chapter 4; `scipy.optimize.brentq`) finds T(x) = T_wanted between two values of
x that give less and more; T need not be monotone between them, and where the values that were tried show that it is
not, there may be other answers, and it is said.

T has a 95 % interval, in proportion to itself: the values of x where one of its ends is the wanted torque bracket the
answer. The torque is known by running the scene that was found. The best estimate of that run over T is a ratio, and x
of T(x) = T_wanted/ratio is the next scene to try (`like`), with the run's 95 % interval as its bracket. It is the
answer where the ratio is one of the device, and a step of a fixed-point iteration where it changes with x, as it may
where the law is a guess. With several runs the logarithm of the ratio is linear in x between the two of them that are
nearest to the wanted torque, one on each side as soon as there is one (the regula falsi, of the ratio in place of the
torque), and runs end when a torque is within a tolerance of the wanted.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field, replace
from math import inf, log
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scipy.optimize import brentq

from emclutch.device_model.coil_heat import coil_heat_in_words, winding_in_words
from emclutch.device_model.device import Device, build_device
from emclutch.results import OutputError, Result, load_result
from emclutch.results.atomic_file import replace_json, replace_text
from emclutch.results.new_path import new_folder
from emclutch.results.report.render import Reported, write_index
from emclutch.results.report.report import Mark, Report, Shown, Statement, Statements, Table, note, warning
from emclutch.results.text import format_estimate, format_percent
from emclutch.scene.case import Case, as_case, load_case
from emclutch.scene.design import Search, search_of
from emclutch.scene.errors import Fault, SceneError, bad_input_for, entry_at
from emclutch.scene.fault_report import quantity_at
from emclutch.scene.map_axes import sheared_gap_hint
from emclutch.scene.model import Scene
from emclutch.scene.units import Quantity, in_unit_of
from emclutch.scene.value_list import values_of
from emclutch.simulation.forecast.expected_field import expected_magnetisation, limits_of
from emclutch.simulation.forecast.expected_torque import ExpectedTorque, expected_torque
from field import MagneticField
from field.laws.table_end import driven_beyond_their_tables
from field.section.ampere_turns import ampere_turns_by_part

if TYPE_CHECKING:
    from emclutch.results import Progress

VALUE_TOLERANCE, BRACKET_TOLERANCE = 1e-3, 1e-2
"""Of the range of x. Another mesh for each x is a noise of 3e-4 of the torque: a closer value would be noise."""
_TOLERANCE = Quantity("a fraction", "", "5 %", 0.0, 1.0, open_minimum=True)
SAME_VALUE = 1e-4
"""Of the range of x: values this close are not run twice."""


@dataclass(frozen=True, slots=True)
class Correction:
    """Torque of a run over that which the law expects of its scene.

    Attributes
    ----------
    folder : Path
        Of the run.
    ratio : float
    interval : tuple of float or None
        Ratio at the ends of the run's 95 % interval; None where its error is unknown, or wider than the torque.
    """

    folder: Path
    ratio: float
    interval: tuple[float, float] | None


def correction_by(folder: str | Path) -> Correction:
    """Return the correction of the law by a finished run; OutputError where its torque is not known."""
    run = load_result(folder)
    if run.steady is not None and not run.steady.is_steady:
        mend = run.steady.remedy or "name another run"
        raise OutputError(f"the torque of the run {folder} is not known ({run.steady.reason}); {mend}")
    expected = expectation_of(load_case(run.folder.case)).torque
    mean, interval = run.best.mean, run.best.interval()
    if not mean or not expected:
        raise OutputError(f"{folder} has no torque that could be compared with an expectation; name another run")
    if interval[0] * interval[1] <= 0.0:  # an unknown one is infinite
        return Correction(run.folder.path, abs(mean) / expected, None)
    low, high = sorted(abs(end) / expected for end in interval)
    return Correction(run.folder.path, abs(mean) / expected, (low, high))


def expectation_of(case: Case, device: Device | None = None, unknown_powder: bool = False) -> ExpectedTorque:
    """Return the torque that is expected of a scene, or of its device; SceneError where its field cannot be solved."""
    case.need_grains()
    with bad_input_for(case.path):
        device = device or build_device(case.scene)
        solved, _ = expected_magnetisation(case, device)
        beyond = driven_beyond_their_tables([] if solved is None else [solved])
        heat = "" if device.coil is None else coil_heat_in_words(case.scene, device.coil, device.coil.shape)
        warnings = limits_of(case.scene, device, solved) + getattr(heat, "warnings", ())
        found = expected_torque(case.scene, device, solved, unknown_powder)
        return replace(found, warnings=warnings, beyond_tables=beyond)


@dataclass(frozen=True, slots=True)
class Trial:
    """A scene that was run: the value [SI] of the key, the torque that was expected [N m], and the run."""

    value: float
    expected: float
    run: Result

    @property
    def torque(self) -> float | None:
        """Magnitude of the run's best estimate [N m]; None where it has none."""
        mean = self.run.best.mean
        return abs(mean) if mean else None


@dataclass(frozen=True, slots=True, repr=False)
class DesignResult(Reported):
    """The answer of a design search.

    Attributes
    ----------
    folder : Path
        With found.toml, design.csv, design.json, and the runs in run, run-2, ...
    search : Search
    value : float
        Of the key that was searched, by the law and its correction [SI].
    expected : ExpectedTorque
        Of the scene with that value.
    bracket : tuple of float
        Range of `value` [SI] that the law's uncertainty leaves, within the range that was searched.
    is_cut : tuple of bool
        Whether an end of the bracket is one of that range, so that the answer may lie beyond.
    tried : list of (float, float)
        Values [SI] and expected torques [N m], ascending.
    case : Case
        The scene that was found: that of the nearest run, without runs that of `value`.
    correction : Correction or None
        Of the law, by the run that the search was given.
    trials : list of Trial
        The scenes that were run, in their order.
    next_value : float or None
        The value at which the law, corrected by the runs, gives the wanted torque [SI]; None where none searched does.
    tolerance : float
        Deviation from the wanted torque that is accepted, relative to it [-].
    """

    folder: Path
    search: Search
    value: float
    expected: ExpectedTorque
    bracket: tuple[float, float]
    is_cut: tuple[bool, bool]
    tried: list[tuple[float, float]]
    case: Case
    correction: Correction | None = None
    trials: list[Trial] = field(default_factory=list)
    next_value: float | None = None
    tolerance: float = 0.05

    @property
    def nearest(self) -> Trial | None:
        """The run whose torque is nearest to the wanted; None without one that has a torque."""
        known = [trial for trial in self.trials if trial.torque]
        return min(known, key=lambda one: abs(log((one.torque or 0.0) / self.search.torque)), default=None)

    @property
    def run(self) -> Result | None:
        """The nearest run; None where none was asked for."""
        return None if self.nearest is None else self.nearest.run

    @property
    def is_met(self) -> bool:
        """True if the mean torque of the nearest run is within the tolerance of the wanted; see `is_certain`."""
        return self.nearest is not None and self._is_within(self.nearest.torque or 0.0)

    @property
    def is_certain(self) -> bool:
        """True if the whole 95 % interval of that torque is within the tolerance; False where it is not known."""
        return self.nearest is not None and all(self._is_within(abs(end)) for end in self.nearest.run.best.interval())

    def report(self) -> Report:
        """Return the value found, its estimate and its runs."""
        report = Report(f"Design search: {self.search.case.name}", data=as_data(self), folder=self.folder)
        report.add("Result", Statements([*_answer(self), *_of_the_runs(self)]), Shown.TERMINAL)
        tried = [(self.search.shown(value), f"{torque:.4g}") for value, torque in self.tried]
        return report.add("Tried", Table(tried, (self.search.key, "expected torque [N m]"), numbers=[1]), Shown.PAGE)

    def _is_within(self, torque: float) -> bool:
        return abs(torque / self.search.torque - 1.0) <= self.tolerance

    @property
    def is_monotone(self) -> bool:
        """True if the torque rises or falls all along the values that were tried."""
        steps = [b[1] - a[1] for a, b in zip(self.tried, self.tried[1:], strict=False)]
        return all(step >= 0.0 for step in steps) or all(step <= 0.0 for step in steps)

    @property
    def ratio(self) -> float | None:
        """Torque of the nearest run over that expected of it; None without a run, or one without a torque."""
        return None if self.nearest is None else (self.nearest.torque or 0.0) / self.nearest.expected


def design(
    case: Case | str | Path | Search,
    vary: str = "",
    between: Sequence[Any] = (),
    target: str | float = "",
    *,
    like: str | Path | None = None,
    out: str | Path | None = None,
    runs: int = 0,
    tolerance: float | str = 0.05,
    threads: int | None = None,
    progress: Progress | None = None,
) -> DesignResult:
    """Find the value of one key at which a scene's expected torque is the wanted one, and write that scene.

    With `runs` the scene is run, and the search goes on by the torques of the runs until one is within the tolerance.

    Parameters
    ----------
    case : Case, the path of a scene file, or a whole `Search` (`emclutch.scene.design.read_design` of a design file)
    vary : dotted key of a quantity, e.g. ``"geometry.gap"``.
    between : least and largest value, as in a scene: ``("0.5 mm", "2 mm")`` or numbers in SI.
    target : ``"torque 12 N m"`` or ``"12 N m"``, or a number in N m.
    like : folder of a finished run whose torque over that expected of it corrects the law.
    out : new folder; default: the next designs/<case>-<nnn>.
    runs : at most so many scenes are run; 0: none.
    tolerance : deviation of a run from the wanted torque that is accepted, relative to it [-], or "5 %". The interval
        of the run adds to it.
    threads : of the runs, as of `emclutch.run`.
    progress : shows which value is computed, and of the runs as of `emclutch.run`.

    Raises
    ------
    SceneError
        Faults of the scene or of what is searched; the torque is not reached between both values (the message names
        them with their torques, and the key that would raise it); it cannot be estimated for this scene.
    OutputError, RunError
        The folder is there already; of the run.
    """
    search = case if isinstance(case, Search) else search_of(as_case(case), vary, between, target)
    (tolerance,) = values_of([tolerance], _TOLERANCE, "tolerance")
    search = search if like is None else replace(search, like=Path(like))
    folder = new_folder(out, search.case.name, "designs")
    law = _Expectation(search, progress)
    correction = None if search.like is None else correction_by(search.like)
    ratio = 1.0 if correction is None else correction.ratio
    value = law.value_at(search.torque / ratio, VALUE_TOLERANCE)
    if value is None:
        reached = ", ".join(f"{ratio * law.torque(end):.4g} N m at {search.shown(end)}" for end in search.between)
        message = f"does not reach {search.torque:g} N m between both values: {reached} are expected; "
        message += f"{_remedy(search, law, ratio)}widen the range, or change the target"
        raise SceneError([Fault(search.key, "", message)], search.source)
    expected = law.at(value)
    ends = [law.value_at(torque, BRACKET_TOLERANCE) for torque in _torques_at_the_ends(search, expected, correction)]
    if law.torque(search.between[1]) < law.torque(search.between[0]):
        ends.reverse()
    low, high = (end if one is None else one for end, one in zip(search.between, ends, strict=True))
    folder.mkdir(parents=True)
    is_cut = ends[0] is None, ends[1] is None
    found = search.case.with_values({search.key: value})
    result = DesignResult(
        folder, search, value, expected, (low, high), is_cut, law.tried(), found, correction, tolerance=tolerance
    )
    _write(result)
    while len(result.trials) < runs and not result.is_met:
        if result.trials:
            if result.next_value is None or law.is_known(result.next_value, [trial.value for trial in result.trials]):
                break  # no other value is left
            value = result.next_value
        result = _with_a_run(result, value, law, threads, progress)
        _write(result)
    return result


def _remedy(search: Search, law: _Expectation, ratio: float) -> str:
    """Return the part with a key that takes most ampere-turns, and the torque of half its width.

    It is empty for a target below the torque at both ends, and without the coil of a section.
    """
    best = max(search.between, key=law.torque)
    if search.torque < ratio * law.torque(best):
        return ""
    case = search.case.with_values({search.key: best})
    geometry, device = case.scene.geometry, build_device(case.scene)
    coil = device.section_coil
    if coil is None or not coil.largest_current or case.scene.effects.memory is not None:
        return ""
    field, _ = expected_magnetisation(case, device)
    assert isinstance(field, MagneticField)  # of a section
    parts = ampere_turns_by_part(field, device.shape.air_gaps())
    keys = {"clearance": "geometry.clearance", "powder": geometry.gap_key(device.shape, case.scene.grains.region)}
    for part, taken in parts.items():
        key = keys.get(part)
        if key is None or key == search.key:
            continue
        quantity, given = quantity_at(key, Scene, case.data), entry_at(case.data, key.split("."))
        assert quantity is not None  # of a width
        width = getattr(geometry, key.removeprefix("geometry."))
        with suppress(SceneError):  # too narrow for the grains, as an example
            torque = ratio * (expectation_of(case.with_values({key: 0.5 * width})).torque or 0.0)
            half, whole = (in_unit_of(given, value, quantity) for value in (0.5 * width, width))
            share = format_percent(taken / sum(parts.values()))
            return (
                f"the {part} takes {share} of the ampere-turns: {key} = {half} in place of {whole} gives "
                f"{torque:.4g} N m at {search.shown(best)}; "
            )
    return ""


def _with_a_run(
    result: DesignResult, value: float, law: _Expectation, threads: int | None, progress: Progress | None
) -> DesignResult:
    """Return the result with a run at a value [SI], and with the value to try next."""
    from emclutch.studies.accuracy.target import run  # local: a search alone compiles no kernel

    search, number = result.search, len(result.trials) + 1
    name = "run" if number == 1 else f"run-{number}"
    case = search.case.with_values({search.key: value})
    done = run(case, out=result.folder / name, threads=threads, progress=progress)
    trials = [*result.trials, Trial(value, law.torque(value), done)]
    following = law.corrected_value_at(search.torque, [one for one in trials if one.torque])
    result = replace(result, trials=trials, next_value=following, tried=law.tried())
    if result.nearest is not None:
        result = replace(result, case=search.case.with_values({search.key: result.nearest.value}))
    return result


class _Expectation:
    """The expected torque over the key that is searched; each value is computed once."""

    def __init__(self, search: Search, progress: Progress | None = None) -> None:
        self._search, self._progress = search, progress
        self._known: dict[float, ExpectedTorque] = {}

    def at(self, value: float) -> ExpectedTorque:
        """Return the expectation at a value [SI]; SceneError where the scene is not valid there, or has no torque."""
        search = self._search
        if value not in self._known:
            if self._progress is not None:
                self._progress.status(f"expected torque at {search.key} = {search.shown(value)}")
            try:
                found = expectation_of(search.case.with_values({search.key: value}))
            except SceneError as error:
                at = f"(at {search.key} = {search.shown(value)})"
                faults = [Fault(one.key, one.value, f"{one.message} {at}") for one in error.faults]
                raise SceneError(faults, error.source) from None
            if not found.torque:
                message = f"cannot be searched: no torque is expected, {found.law}"
                raise SceneError([Fault("target", "", message)], search.source)
            self._known[value] = found
        return self._known[value]

    def torque(self, value: float) -> float:
        """Return the expected torque at a value [SI], in N m."""
        return self.at(value).torque or 0.0

    def is_known(self, value: float, others: list[float]) -> bool:
        """Return True where a value [SI] is one of the others, as near as values are found."""
        low, high = self._search.between
        return any(abs(value - other) <= SAME_VALUE * (high - low) for other in others)

    def tried(self) -> list[tuple[float, float]]:
        """Return all values [SI] with their torques [N m], ascending."""
        return [(value, self.torque(value)) for value in sorted(self._known)]

    def value_at(self, torque: float, tolerance: float) -> float | None:
        """Return the value [SI] of a torque [N m], to `tolerance` of the range; None where the range has none."""
        low, high = self._search.between
        if torque == inf:
            return None

        def excess(value: float) -> float:  # of logarithms: torques are positive and go with powers of the quantities
            return log(self.torque(value) / torque)

        if excess(low) * excess(high) > 0.0:
            return None
        return float(brentq(excess, low, high, xtol=tolerance * (high - low)))

    def corrected_value_at(self, torque: float, trials: list[Trial]) -> float | None:
        """Return the value [SI] at which the expectation times the ratio of the runs gives a torque [N m], or None.

        ln(ratio) is linear in the value, through the runs that are nearest to the torque from below and from above;
        without both it is that of the last run.
        """
        if not trials:
            return None

        def miss(trial: Trial) -> float:
            return log((trial.torque or 0.0) / torque)

        below = [trial for trial in trials if miss(trial) < 0.0]
        above = [trial for trial in trials if miss(trial) >= 0.0]
        if not below or not above:
            last = trials[-1]
            return self.value_at(torque * last.expected / (last.torque or inf), SAME_VALUE)
        a, b = max(below, key=miss), min(above, key=miss)
        ratios = [log((trial.torque or 0.0) / trial.expected) for trial in (a, b)]

        def excess(value: float) -> float:
            share = (value - a.value) / (b.value - a.value)
            return log(self.torque(value) / torque) + ratios[0] + share * (ratios[1] - ratios[0])

        low, high = self._search.between
        return float(brentq(excess, a.value, b.value, xtol=SAME_VALUE * (high - low)))


def _torques_at_the_ends(
    search: Search, expected: ExpectedTorque, correction: Correction | None
) -> tuple[float, float]:
    """Return the least and the largest expectation [N m] that may mean the wanted torque.

    They follow from the 95 % interval of the run that corrects the law, where it is known, else from that of the law.
    """
    if correction is not None and correction.interval is not None:
        return search.torque / correction.interval[1], search.torque / correction.interval[0]
    wanted, known = search.torque / (1.0 if correction is None else correction.ratio), expected.real
    assert known is not None  # by `_Expectation.at`
    return wanted * known.mean / known.high, wanted * known.mean / known.low if known.low else inf


def _write(result: DesignResult) -> None:
    """Write found.toml, design.csv and design.json, again after each run."""
    replace_text(result.folder / "found.toml", result.case.toml())
    rows = "".join(f"{value!r},{torque!r}\n" for value, torque in result.tried)
    replace_text(result.folder / "design.csv", f"{result.search.key},expected_torque\n{rows}")
    replace_json(result.folder / "design.json", as_data(result))
    write_index(result.report())


def as_data(result: DesignResult) -> dict[str, Any]:
    """The answer for a machine; values in SI, torques in N m."""
    search = result.search
    return {
        "key": search.key,
        "unit": search.quantity.unit,
        "between": search.between,
        "target": search.torque,
        "value": result.value,
        "expected_torque": result.expected.torque,
        "law": result.expected.law,
        "estimate": result.expected.in_words(),
        "like": None if result.correction is None else asdict(result.correction) | {"folder": str(search.like)},
        "bracket": result.bracket,
        "bracket_is_cut": result.is_cut,
        "is_monotone": result.is_monotone,
        "runs": [
            {"value": one.value, "folder": str(one.run.folder.path), "torque": one.run.best.as_dict()}
            for one in result.trials
        ],
        "tolerance": result.tolerance,
        "is_met": result.is_met,
        "is_certain": result.is_certain,
        "found_value": result.value if result.nearest is None else result.nearest.value,
        "run_over_expected": result.ratio,
        "next_value": result.next_value,
        "folder": str(result.folder),
    }


def _answer(result: DesignResult) -> Iterator[Statement]:
    """Say the value, its estimate and its range."""
    search, expected, correction = result.search, result.expected, result.correction
    torque = (expected.torque or 0.0) * (correction.ratio if correction else 1.0)
    value = search.shown(result.value)
    mark = Mark.WARNING if any(result.is_cut) or not result.is_monotone else Mark.GOOD
    yield Statement(mark, f"{search.key} = {value}: {torque:.4g} N m expected for a target of {search.torque:g} N m.")
    yield note(f"Estimate: {expected.in_words()}")
    if hint := sheared_gap_hint(search.case, search.key):
        yield note(hint)
    if correction is not None:
        ends = correction.interval
        spread = "its error unknown" if ends is None else f"95 %: {ends[0]:.2f} to {ends[1]:.2f}"
        yield note(f"Corrected by {correction.ratio:.2f} ({spread}): torque of {correction.folder} over its estimate.")
    low, high = map(search.shown, result.bracket)
    if all(result.is_cut):
        yield note(f"Uncertainty too large: any value from {low} to {high} may be right.")
    else:
        by_run = correction is not None and correction.interval is not None
        whose = "The error of that run" if by_run else "The uncertainty of the law"
        beyond = ", or values beyond the searched range" if any(result.is_cut) else ""
        yield note(f"{whose} allows {low} to {high}{beyond}.")
    if not result.is_monotone:
        yield warning("the torque rises and falls between both values: other answers may exist, see design.csv")
    if search.key.startswith("coil."):
        yield note(f"Winding: {winding_in_words(result.case.scene)}.")
        yield from _of_the_supply(result.case.scene)
    yield note(f"Scene: {result.folder / 'found.toml'}")


def _of_the_supply(scene: Scene) -> Iterator[Statement]:
    """Say which resistance in series makes the given current of the supply, or that its voltage is too low."""
    coil, shape = scene.coil, scene.shape()
    if coil is None or coil.current is None or coil.voltage is None:
        return
    voltage, current = coil.voltage.largest, coil.current.largest
    own = coil.resistance_in(shape.coil_area, shape.coil_mean_radius)
    if (missing := voltage / current - own) >= 0.0:
        series = f"a resistance of {missing:.3g} ohm in series"
        yield note(f"At coil.voltage = {voltage:.4g} V {series} gives {current:.4g} A.")
    else:
        text = f"coil.voltage = {voltage:.4g} V gives {voltage / own:.4g} A through {own:.3g} ohm"
        yield warning(f"{text}; {current:.4g} A needs {current * own:.3g} V")


def _of_the_runs(result: DesignResult) -> Iterator[Statement]:
    """Say what the runs gave, and what follows from them."""
    search = result.search
    for trial in result.trials:
        estimate = trial.run.best
        known = "no torque" if trial.torque is None else format_estimate(estimate)
        yield note(f"Run at {search.shown(trial.value)}: {known}; {trial.expected:.4g} N m expected.")
    if not result.trials:
        return
    wanted, within = f"{search.torque:g} N m", f"{100.0 * result.tolerance:g} %"
    if result.is_met and result.is_certain:
        yield Statement(Mark.GOOD, f"The last run is within {within} of {wanted}.")
    elif result.is_met:
        yield warning(f"the last run is within {within} of {wanted}; its 95 % interval is wider or unknown: run longer")
    elif result.next_value is None:
        yield warning(f"by the runs no value of {search.key} in the range gives {wanted}")
    else:
        yield warning(f"not within {within} of {wanted}; by the runs {search.shown(result.next_value)} gives it")
