"""Design search: the value of one quantity that gives a wanted torque, by root finding over the expected torque.

The expectation T(x) is the law tau(H, phi) of `emclutch.simulation.forecast.expected_torque`, integrated over the
sheared gap in the field that is solved again for each x (`emclutch.simulation.forecast.expected_field`). Brent's method
(R. P. Brent, Algorithms for Minimization without Derivatives, 1973, chapter 4; `scipy.optimize.brentq`) finds
T(x) = T_wanted between two values of x that give less and more; T need not be monotone between them, and where the
values that were tried show that it is not, there may be other answers, and it is said.

The law holds within a stated factor f: T_wanted/f <= T(x) <= f T_wanted is the range of x in which the answer lies.
The torque is known by running the scene that was found. That run over its expectation is a ratio, and x of
T(x) = T_wanted/ratio is the next scene to try (`like`), with the run's 95 % interval as its bracket. It is the answer
where the ratio is one of the device, and a step of a fixed-point iteration where it changes with x, as it does with the
field (0.7 at 0.2 A, 1.9 at 0.94 A in docs/expected_torque.md).
"""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace
from math import inf, log
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scipy.optimize import brentq

from emclutch.device.device import build_device
from emclutch.results import OutputError, Result, RunFolder, load_result
from emclutch.results.atomic_file import replace_json, replace_text
from emclutch.scene.case import Case, as_case, load_case
from emclutch.scene.design import Search, search_of
from emclutch.scene.errors import Fault, SceneError, bad_input_for
from emclutch.scene.units import in_unit_of
from emclutch.simulation.forecast.expected_field import expected_magnetisation
from emclutch.simulation.forecast.expected_torque import BOUND, ORDER, THREEFOLD, ExpectedTorque, expected_torque

if TYPE_CHECKING:
    from emclutch.results import Progress

FACTORS = {THREEFOLD: (3.0, 3.0), ORDER: (10.0, 10.0), BOUND: (1.0, inf)}
"""How many times more and less the law may give than a run does; a bound is never less."""
SHARP, BLUNT = (
    1e-3,
    1e-2,
)  # of the range of x: of the answer (a mesh of each x: 3e-4 of the torque is noise), and of its bracket


@dataclass(frozen=True, slots=True)
class Correction:
    """Torque of a run beside that of the law.

    Attributes
    ----------
    folder : Path
        Of the run.
    ratio : float
        Its torque over that expected of its scene.
    interval : tuple of float or None
        The same of the ends of its 95 % interval; None where its error is unknown, or wider than the torque.
    """

    folder: Path
    ratio: float
    interval: tuple[float, float] | None


def correction_by(folder: str | Path) -> Correction:
    """The correction of the law by a finished run; OutputError where it has no torque."""
    run = load_result(folder)
    expected = expectation_of(load_case(run.folder.case)).torque
    mean, interval = run.torque.mean, run.torque.interval()
    if not mean or not expected:
        raise OutputError(f"{folder} has no torque that could be compared with an expectation; name another run")
    ends = None if interval is None else sorted(abs(end) / expected for end in interval)
    known = interval is not None and interval[0] * interval[1] > 0.0
    return Correction(run.folder.path, abs(mean) / expected, (ends[0], ends[1]) if ends and known else None)


def expectation_of(case: Case) -> ExpectedTorque:
    """The torque that is expected of a scene; SceneError where its field cannot be solved."""
    case.need_grains()
    with bad_input_for(case.path):
        device = build_device(case.scene)
        field, _ = expected_magnetisation(case, device)
        return expected_torque(case.scene, device, field)


@dataclass(frozen=True, slots=True)
class DesignResult:
    """The answer of a design search.

    Attributes
    ----------
    folder : Path
        With found.toml, design.csv, design.json and, of a confirmed one, the run in `run`.
    search : Search
    value : float
        Of the key that was searched [SI].
    expected : ExpectedTorque
        Of the scene that was found.
    bracket : tuple of float
        Range of `value` [SI] that the law's uncertainty leaves, within the range that was searched.
    is_cut : tuple of bool
        Whether an end of the bracket is one of that range, so that the answer may lie beyond.
    tried : list of (float, float)
        Values [SI] and expected torques [N m], ascending.
    case : Case
        The scene that was found.
    correction : Correction or None
        Of the law, by the run that the search was given.
    run : Result or None
        Its run, where it was to be confirmed.
    next_value : float or None
        The value at which the law, corrected by that run, gives the wanted torque [SI]; None where none searched does.
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
    run: Result | None = None
    next_value: float | None = None

    @property
    def is_monotone(self) -> bool:
        """True if the torque rises or falls all along the values that were tried."""
        steps = [b[1] - a[1] for a, b in zip(self.tried, self.tried[1:], strict=False)]
        return all(step >= 0.0 for step in steps) or all(step <= 0.0 for step in steps)

    @property
    def ratio(self) -> float | None:
        """Torque of the run over that expected of it; None without a run, or one without a torque."""
        mean = None if self.run is None else self.run.torque.mean
        return None if mean is None else abs(mean) / (self.expected.torque or inf)

    def shown(self, value: float) -> str:
        """A value [SI] in the unit in which the range was given."""
        return in_unit_of(self.search.entries[0], value, self.search.quantity)


def design(
    case: Case | str | Path | Search,
    vary: str = "",
    between: tuple[Any, Any] = ("", ""),
    target: str | float = "",
    *,
    like: str | Path | None = None,
    out: str | Path | None = None,
    confirm: bool = False,
    threads: int | None = None,
    progress: Progress | None = None,
) -> DesignResult:
    """Find the value of one key at which a scene's expected torque is the wanted one, and write that scene.

    Parameters
    ----------
    case : Case, the path of a scene file, or a whole `Search` (`emclutch.scene.design.read_design`)
    vary : dotted key of a quantity, e.g. ``"geometry.gap"``.
    between : least and largest value, as in a scene: ``("0.5 mm", "2 mm")`` or numbers in SI.
    target : ``"torque 12 N m"``, or a number in N m.
    like : folder of a finished run whose torque over that expected of it corrects the law.
    out : new folder; default: the next designs/<case>-<nnn>.
    confirm : run the scene that was found.
    threads, progress : of that run, as of `emclutch.run`.

    Raises
    ------
    SceneError
        Faults of the scene or of what is searched; the torque is not reached between both values, which are then told
        with their torques; it cannot be told of this scene.
    OutputError, RunError
        The folder is there already; of the run.
    """
    search = case if isinstance(case, Search) else search_of(as_case(case), vary, between, target)
    search = search if like is None else replace(search, like=Path(like))
    folder = Path(out) if out is not None else RunFolder.next_path(search.case.name, "designs")
    if folder.exists():
        raise OutputError(f"{folder} exists; name another folder with --out")
    law = _Expectation(search)
    correction = None if search.like is None else correction_by(search.like)
    value = law.value_at(search.torque / (correction.ratio if correction else 1.0), SHARP)
    if value is None:
        raise SceneError([_out_of_range(search, law, correction)], search.source)
    expected = law.at(value)
    bracket, is_cut = _bracket(search, law, expected.trust, correction)
    found = search.case.with_values({search.key: value})
    folder.mkdir(parents=True)
    found.write_toml(folder / "found.toml")
    result = DesignResult(folder, search, value, expected, bracket, is_cut, law.tried(), found, correction)
    _write(result)
    if confirm:
        from emclutch.simulation.run import run  # local: a search alone compiles no kernel

        result = replace(result, run=run(found, out=folder / "run", threads=threads, progress=progress))
        if result.ratio:
            asked = law.value_at(search.torque / result.ratio, SHARP)
            result = replace(result, next_value=asked, tried=law.tried())
        _write(result)
    return result


class _Expectation:
    """The expected torque of each value of the key, worked out once."""

    def __init__(self, search: Search) -> None:
        self._search = search
        self._known: dict[float, ExpectedTorque] = {}

    def at(self, value: float) -> ExpectedTorque:
        """The expectation at a value [SI]; SceneError where the scene cannot be there, or has no torque to tell."""
        if value not in self._known:
            search = self._search
            where = in_unit_of(search.entries[0], value, search.quantity)
            try:
                case = search.case.with_values({search.key: value})
                found = expectation_of(case)
            except SceneError as error:
                at = f"(at {search.key} = {where})"
                faults = [Fault(one.key, one.value, f"{one.message} {at}") for one in error.faults]
                raise SceneError(faults, error.source) from None
            if not found.torque:
                raise SceneError([Fault("target", "", f"cannot be searched: no torque is expected, {found.law}")],
                                 search.source)  # fmt: skip
            self._known[value] = found
        return self._known[value]

    def torque(self, value: float) -> float:
        """The same as a number [N m]."""
        return self.at(value).torque or 0.0

    def tried(self) -> list[tuple[float, float]]:
        """All values [SI] with their torques [N m], ascending."""
        return [(value, self.torque(value)) for value in sorted(self._known)]

    def value_at(self, torque: float, tolerance: float) -> float | None:
        """A value [SI] that gives a torque [N m], to `tolerance` of the range; None where both ends are on one side."""
        low, high = self._search.between
        ends = [log(self.torque(end) / torque) for end in (low, high)]
        if ends[0] * ends[1] > 0.0:
            return None
        # of logarithms: torques are positive and go with powers of the quantities
        return float(brentq(lambda x: log(self.torque(x) / torque), low, high, xtol=tolerance * (high - low)))


def _bracket(
    search: Search, law: _Expectation, trust: str, correction: Correction | None
) -> tuple[tuple[float, float], tuple[bool, bool]]:
    """Range of the key that the law's uncertainty leaves, and which of its ends are those of what is searched.

    The uncertainty is that of the run that corrects the law, where its interval is known, and the law's own otherwise.
    """
    less, more = FACTORS[trust]
    if correction is not None and correction.interval is not None:
        less, more = correction.interval[1], 1.0 / correction.interval[0]
    elif correction is not None:
        less, more = less * correction.ratio, more / correction.ratio
    low, high = search.between
    rises = law.torque(high) >= law.torque(low)
    weak = law.value_at(search.torque / less, BLUNT)
    strong = None if more == inf else law.value_at(search.torque * more, BLUNT)
    first, last = (weak, strong) if rises else (strong, weak)
    return (low if first is None else first, high if last is None else last), (first is None, last is None)


def _out_of_range(search: Search, law: _Expectation, correction: Correction | None) -> Fault:
    ratio = correction.ratio if correction else 1.0
    ends = ", ".join(
        f"{ratio * law.torque(end):.4g} N m at {in_unit_of(search.entries[0], end, search.quantity)}"
        for end in search.between
    )
    return Fault(
        search.key,
        "",
        f"gives no {search.torque:g} N m between both values: {ends} are expected; widen the range, vary another key, "
        "or change the target",
    )


def _write(result: DesignResult) -> None:
    """design.csv and design.json, again after the run."""
    search = result.search
    rows = "".join(f"{value!r},{torque!r}\n" for value, torque in result.tried)
    replace_text(result.folder / "design.csv", f"{search.key},expected_torque\n{rows}")
    replace_json(result.folder / "design.json", as_data(result))


def as_data(result: DesignResult) -> dict[str, Any]:
    """The answer for a machine; values in SI, torques in N m."""
    search, run = result.search, result.run
    return {
        "key": search.key,
        "unit": search.quantity.unit,
        "between": search.between,
        "target": search.torque,
        "value": result.value,
        "expected_torque": result.expected.torque,
        "law": result.expected.law,
        "trust": result.expected.in_words(),
        "like": None if result.correction is None else asdict(result.correction) | {"folder": str(search.like)},
        "bracket": result.bracket,
        "bracket_is_cut": result.is_cut,
        "is_monotone": result.is_monotone,
        "run": None if run is None else {"folder": str(run.folder.path), "torque": run.torque.as_dict()},
        "run_over_expected": result.ratio,
        "next_value": result.next_value,
        "folder": str(result.folder),
    }


def in_words(result: DesignResult) -> list[str]:
    """The answer for a terminal, a line each."""
    search, expected = result.search, result.expected
    torque = (expected.torque or 0.0) * (result.correction.ratio if result.correction else 1.0)
    low, high = (
        f"{result.shown(end)}{' (end of the range: perhaps beyond)' if is_cut else ''}"
        for end, is_cut in zip(result.bracket, result.is_cut, strict=True)
    )
    lines = [
        f"{search.key} = {result.shown(result.value)}: {torque:.4g} N m expected, {search.torque:g} N m wanted",
        f"law: {expected.in_words()}",
        *([] if result.correction is None else [_correction_in_words(result.correction)]),
        f"its uncertainty leaves {low} to {high}"
        if result.correction is None or result.correction.interval is None
        else f"the error of that run leaves {low} to {high}, where its ratio is the same there",
    ]
    if not result.is_monotone:
        lines.append(
            "WARNING: the torque rises and falls between both values: there may be other answers, see design.csv"
        )
    lines.append(f"scene: {result.folder / 'found.toml'}")
    return lines


def _correction_in_words(correction: Correction) -> str:
    ends = correction.interval
    spread = "its error unknown" if ends is None else f"95 %: {ends[0]:.2f} to {ends[1]:.2f}"
    return f"times {correction.ratio:.2f} ({spread}), which {correction.folder} has over what is expected of it"


def run_in_words(result: DesignResult) -> list[str]:
    """Return what the run of the scene says, beside its expectation."""
    if result.ratio is None:
        return []
    text = f"run over expected: {result.ratio:.2f}; "
    if result.next_value is None:
        return [f"{text}with it no value of {result.search.key} that was searched gives {result.search.torque:g} N m"]
    return [f"{text}with it {result.search.key} = {result.shown(result.next_value)} gives {result.search.torque:g} N m"]
