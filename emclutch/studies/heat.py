"""`emclutch heat`: temperatures of a device through hours of duty, and the slip power that it may have.

The torque at each current and temperature of the powder is that of the law of the powder, of a measurement or of both
(`emclutch.studies.heat_torque`). From there on the thermal model stands alone (`emclutch.device_model.heat_model`,
`field.heat`).

A duty of up to `MAX_RESOLVED_PERIODS` periods is resolved. One of more is *averaged*: the mean power over a period
heats the device in steps over many of them, the ripple about that mean is found from a few periods resolved, and what
it does to the mean through R(T), the torque's fade and radiation, which averaging leaves out, is `error_of_the_mean`.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise
from math import inf, isclose
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pandas
from scipy.optimize import brentq

from emclutch.device_model.coil_heat import HOTTEST
from emclutch.device_model.heat_model import (
    COIL,
    POWDER,
    SHAFT_ENDS,
    Drive,
    HeatModel,
    film_of,
    heat_problem,
    resistance_at_20,
)
from emclutch.results.errors import RunError
from emclutch.results.new_path import new_folder
from emclutch.results.pictures.temperature import duty_picture, temperature_picture
from emclutch.results.quantity import RPM
from emclutch.results.report.render import Reported, write_index
from emclutch.results.report.report import Report
from emclutch.results.text import format_duration
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import Fault, SceneError, bad_input_for
from emclutch.scene.model import Scene
from emclutch.scene.units import Speed
from emclutch.scene.value_list import values_of
from emclutch.studies.heat_report import heat_report
from emclutch.studies.heat_torque import torque_of
from field.heat.conduction import MOLTEN, HeatNotConverged, HeatProblem, Powers, ThermalRunaway
from field.heat.transient import HeatInTime, HeatState, Ripple

if TYPE_CHECKING:
    from emclutch.results import Progress

SPEEDS = tuple(n / RPM for n in (50.0, 100.0, 200.0, 500.0, 1000.0, 1500.0))
"""At which the permitted slip power is given where none are asked for [rad/s]."""

MAX_RESOLVED_PERIODS = 300
"""Of a duty; beyond, it is averaged."""

_MOST = 1e9
"""Power [W] or current [A] beyond which no limit is sought."""

_ROWS = 100
"""Of an averaged duty at least: limits are met between rows on a line."""

_PIECES = 8
"""Between two instants, with two points of Gauss each, in an integral of the duty's power."""

UNITS = {
    "time": "s", "current": "A", "slip_speed": "rad/s", "torque": "N m", "copper_loss": "W", "slip_power": "W",
    "heat_out": "W", "coil_mean": "degC", "coil_hottest": "degC", "powder_mean": "degC", "powder_hottest": "degC",
    "surface": "degC",
}  # fmt: skip
"""Columns of heat.csv and their units; the surface's is its hottest place, the shaft's ends excepted. Of an
averaged duty those of the hottest places are the largest within a period, all others means over it."""

HOTTEST_PLACES = ("coil_hottest", "powder_hottest", "surface")
_KEYS = {"surface": "surface_limit", "coil_hottest": "coil_limit", "powder_hottest": "powder_limit"}

Tell = Callable[[float, str], None]
"""Takes the fraction of the study that is done, and what is being done."""

PERMITTED_UNITS = {
    "speed": "rad/s", "rotor_speed": "rad/s", "disc_speed": "rad/s", "film": "W/(m^2 K)", "by_surface": "W",
    "by_coil": "W", "by_powder": "W", "slip_power": "W", "torque": "N m", "powder_hottest": "degC", "current": "A",
}  # fmt: skip
"""Of permitted.csv: the slip speed, the speeds of both bodies and the rotor's film at it; the slip power up to which
surface, coil and powder stay below those limits that are given, the smallest, its torque and powder. Where the torque
of all currents is known, the current is that of the power, at most the duty's with the coil warm; else the full one."""


@dataclass(frozen=True, repr=False)
class HeatResult(Reported):
    """A thermal study as it stands in its folder.

    Attributes
    ----------
    folder : Path
        With heat.csv, permitted.csv, heat.json, temperature.png, heat.png.
    summary : dict
        heat.json.
    table : pandas.DataFrame
        A row a step of the duty; units in `UNITS`.
    permitted : pandas.DataFrame
        A row a speed; units in `PERMITTED_UNITS`.
    """

    folder: Path
    summary: dict[str, Any]
    table: pandas.DataFrame
    permitted: pandas.DataFrame

    @property
    def units(self) -> dict[str, str]:
        """Units of the columns of both tables."""
        return self.summary["units"]

    def report(self) -> Report:
        """Return temperatures, limits and permitted slip power."""
        return heat_report(self.folder, self.summary, self.permitted)


def heat(
    case: Case | str | Path,
    run: str | Path | None = None,
    speeds: Sequence[float | str] = SPEEDS,
    out: str | Path | None = None,
    progress: Progress | None = None,
) -> HeatResult:
    """Compute the temperatures of a scene and write them into a new folder.

    Parameters
    ----------
    case : Case, or the path of a scene file; without [effects.heat] its defaults are taken.
    run : folder of a run; the torque is scaled to its own at its current. Default: effects.heat.torque, else that of
        the law of the powder as it is.
    speeds : slip speeds > 0, numbers [rad/s] or texts with a unit, "100 rpm", at which the permitted slip power is
        computed, besides the largest slip of the duty.
    out : new folder; default: the next runs/<case>-heat-<nnn>.
    progress : takes the stages: torque, steady temperatures, duty, permitted powers and currents.

    Raises
    ------
    SceneError
        The scene has faults, or no torque; its equations are not solved.
    ConvergenceError
        The field of a current of the law of the powder is not found.
    OutputError
        The folder is there already.
    RunError
        No slip power is found at which a limit of the temperature is reached.
    """

    def tell(share: float, text: str) -> None:
        if progress is not None:
            progress.update(share, text)

    case = as_case(case)
    folder = new_folder(out, f"{case.name}-heat")
    with bad_input_for(case.path):
        if case.scene.effects.thermal is None:
            case = case.with_values({"effects.heat": {}})
        slips = values_of(speeds, Speed, "speeds")
        if not all(0.0 < speed < inf for speed in slips):
            raise ValueError("speeds of the permitted slip power must be above 0")
        if progress is not None:
            progress.status("mesh and torque")
            progress.update(0.0)
        study = _Study.of(case, run, tell)
    own = study.peak.slip
    if own > 0.0 and not any(isclose(own, speed, rel_tol=1e-6) for speed in slips):
        slips = sorted([*slips, own])
    units = UNITS | PERMITTED_UNITS
    effect = case.scene.effects.thermal
    summary: dict[str, Any] = {
        "title": case.scene.scene.title, "units": units, "torque": study.torque_summary, "limits": study.limits,
        "default_limits": [key for key in study.limits if _KEYS[key] not in effect.model_fields_set],
        "voltage": study.peak.voltage if study.peak.current is None and study.peak.torque is None else None,
        "on_all_the_time": effect.duty.on is None, "slip": own, "supply_voltage": _supply(case.scene.coil),
        "cooling": {key: getattr(effect, key) for key in ("convection", "emissivity", "shaft_conductance")},
    }  # fmt: skip

    try:
        tell(0.2, "steady temperatures")
        summary["steady"], temperature = study.steady()
        summary["steady_at_the_ends"] = {end: study.with_torque_times(by).steady()[0] for end, by in study.ends.items()}
        table, summary["duty"], hottest = study.through_the_duty(temperature)
        permitted = study.permitted(slips)
        tell(0.8, "permitted currents and error of the mesh")
        summary["largest_current"] = study.largest_currents()
        summary["error_of_the_mesh"] = study.mesh_error(temperature)
    except HeatNotConverged as error:
        remedy = "let the torque change less steeply in effects.heat.fade and torque_curve, or leave them out"
        fault = Fault("effects.heat", "", f"has temperatures that do not converge: {error}; {remedy}")
        raise SceneError([fault], "scene" if case.path is None else str(case.path)) from error
    tell(1.0, "files and pictures")
    folder.mkdir(parents=True)
    table.to_csv(folder / "heat.csv", index=False)
    permitted.to_csv(folder / "permitted.csv", index=False)
    (folder / "heat.json").write_text(json.dumps(summary, indent=2) + "\n", encoding="utf-8")
    shown, when = hottest.temperature, f"hottest state of the duty, after {format_duration(hottest.time)}"
    if temperature is not None and not effect.duty.model_fields_set:  # no duty was asked for
        shown, when = temperature, "steady, on all the time"
    temperature_picture(folder / "temperature.png", study.problem, shown, title=f"{summary['title']}: {when}")
    duty_picture(folder / "heat.png", table, permitted, study.limits, title=summary["title"])
    found = HeatResult(folder, summary, table, permitted)
    write_index(found.report())
    return found


@dataclass(frozen=True, slots=True)
class _Study:
    scene: Scene
    problem: HeatProblem
    model: HeatModel
    torque_summary: dict[str, Any]
    peak: Drive
    tell: Tell

    @classmethod
    def of(cls, case: Case, run: str | Path | None, tell: Tell = lambda *_: None) -> _Study:
        scene = case.scene
        effect, coil, shape = scene.effects.thermal, scene.coil, scene.shape()
        assert coil is not None  # by the effect's checks
        window = shape.coil_area, shape.coil_mean_radius
        current, R_20 = coil.currents_in(*window).largest, resistance_at_20(scene)
        slip = scene.motion.largest_slip if effect.duty.slip is None else effect.duty.slip.largest
        problem = heat_problem(scene, *scene.motion.speeds_at_slip(slip))
        peak = Drive(current if effect.duty.current is None else effect.duty.current.largest, 0.0, slip)
        if coil.is_at_voltage:
            assert coil.voltage is not None  # what drives it
            peak = Drive(None, coil.voltage.largest, slip)
        largest = HeatModel(R_20, lambda *_: 0.0).current(peak, effect.ambient, effect.ambient)
        torque, torque_summary = torque_of(case, current, largest, run, slip, tell)
        peak = replace(peak, torque=torque_summary.get("needed_torque"))
        return cls(scene, problem, HeatModel(R_20, torque, peak.torque is not None), torque_summary, peak, tell)

    @property
    def limits(self) -> dict[str, float]:
        """The limits [degrees C] that are given, by hottest place."""
        limits = {place: getattr(self.scene.effects.thermal, key) for place, key in _KEYS.items()}
        return {place: limit for place, limit in limits.items() if limit is not None}

    @property
    def ends(self) -> dict[str, float]:
        """Ends of the torque's 95 % interval over the torque; empty of a measured torque, whose interval is unknown."""
        known, value = self.torque_summary, self.torque_summary["value"]
        return {end: known[end] / value for end in ("low", "high") if end in known and value > 0.0}

    def with_torque_times(self, factor: float) -> _Study:
        """The study with all torques times a factor."""
        torque = self.model.torque
        return replace(self, model=replace(self.model, torque=lambda *at: factor * torque(*at)))

    def _solve(
        self, powers: Powers | Drive, problem: HeatProblem | None = None, near: np.ndarray | None = None
    ) -> np.ndarray:
        """Steady temperatures at powers or a drive, found sooner from others that are `near`.

        Raises
        ------
        ThermalRunaway
            There are none, or the winding's mean is above `HOTTEST`.
        """
        problem = problem or self.problem
        if isinstance(powers, Drive):
            powers = partial(self.model.powers, powers)
        try:
            found = problem.steady(powers, HOTTEST if near is None else near)
        except ThermalRunaway:
            if near is None:  # else what is colder may run away there already
                raise
            found = problem.steady(powers, HOTTEST)
        if problem.means(found)[COIL] > HOTTEST:
            raise ThermalRunaway(f"the winding would be above {HOTTEST:g} degrees C")
        return found

    def _row(
        self, drives: Mapping[Drive, float], temperature: np.ndarray, ripple: Ripple | None = None
    ) -> dict[str, Any]:
        """Of drives by their share of the time, at temperatures or, with a ripple, at their means over a period."""
        problem, model, means = self.problem, self.model, self.problem.means(temperature)
        powers, _ = self._mean_powers(drives, means)
        row = {
            "current": sum(share * model.current(drive, *means) for drive, share in drives.items()),
            "slip_speed": sum(share * drive.slip for drive, share in drives.items()),
            "torque": sum(share * model.torque_of(drive, *means) for drive, share in drives.items()),
            "copper_loss": powers[COIL],
            "slip_power": powers[POWDER],
            "heat_out": sum(problem.losses(temperature).values()),
            "coil_mean": means[COIL],
            "powder_mean": means[POWDER],
            **dict(zip(HOTTEST_PLACES, self._hottest(temperature, ripple).max(axis=0), strict=True)),
        }
        part, _ = _hottest_surface(problem, temperature)
        return {key: float(row[key]) for key in UNITS if key in row} | {"surface_part": part}

    def _hottest(self, temperature: np.ndarray, ripple: Ripple | None) -> np.ndarray:
        """Temperatures (k, 3) [degrees C] of the `HOTTEST_PLACES` at the times of a ripple."""
        problem = self.problem
        through = [temperature] if ripple is None else temperature + ripple.departures
        return np.array([[_hottest_places(problem, one)[key] for key in HOTTEST_PLACES] for one in through])

    def _mean_powers(self, drives: Mapping[Drive, float], means: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        each = [(share, self.model.powers(drive, means)) for drive, share in drives.items()]
        none = np.zeros(2)
        return sum((share * one for share, (one, _) in each), none), sum((share * s for share, (_, s) in each), none)

    def steady(self) -> tuple[dict[str, Any], np.ndarray | None]:
        """With the coil on and slip all the time: the row, with the heat through each surface; or why there is none."""
        try:
            found = self._solve(self.peak)
        except ThermalRunaway:
            return {"state": f"No steady state: winding above {HOTTEST:g} °C"}, None
        out = {f"heat_out_{name}": heat for name, heat in self.problem.losses(found).items()}
        return {"state": "steady", **self._row({self.peak: 1.0}, found), **out}, found

    def through_the_duty(self, reference: np.ndarray | None) -> tuple[pandas.DataFrame, dict[str, Any], HeatState]:
        """A row a step, what came of it, and the hottest of its states; means over a period of an averaged duty."""
        effect, duty = self.scene.effects.thermal, self.scene.effects.thermal.duty
        if duty.slip is not None and not duty.slip.is_constant:
            values = duty.slip.values
            slips = {*map(abs, values)} | ({0.0} if min(values) < 0.0 < max(values) else set())
            self = replace(self, problem=self._cooled_at(slips))
        if duty.period is not None and duty.end > MAX_RESOLVED_PERIODS * duty.period:
            return self._averaged(reference)
        march = HeatInTime(self.problem, self._powers_in_time, effect.tolerance, reference)
        table, summary, hottest = self._marched(march, effect.ambient, self._switchings(duty.end), self._row_in_time)
        made, own = summary["heat_of_coil"] + summary["heat_of_slip"], self._heat_of_the_duty(table)
        summary["heat_error"] = (made - own) / own if own > 0.0 else 0.0
        if duty.period is not None:
            drives, mean = self._mean_of_the_periods()
            summary["steady"] = None if mean is None else {}
            with suppress(HeatNotConverged, ThermalRunaway):  # in which a period does not repeat
                summary |= {} if mean is None else self._repeated_for_ever(drives, mean, self._ripple(mean))
        return table, summary, hottest

    def _cooled_at(self, slips: Iterable[float]) -> HeatProblem:
        """The problem with the films of the bodies' speeds at slips [rad/s]; of several, with each body's smallest."""
        speeds = [self.scene.motion.speeds_at_slip(slip) for slip in slips]
        films = [min(film_of(self.scene, speed) for speed in of_body) for of_body in zip(*speeds, strict=True)]
        return self.problem.with_films(dict(zip(("rotor", "disc"), films, strict=True)))

    def _powers_in_time(self, time: float, means: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        return self.model.powers(self._drive(time), means)

    def _heat_of_the_duty(self, table: pandas.DataFrame) -> float:
        """Integral [J] of the duty's power in time, at the temperatures of a table on lines between its rows."""
        means = table[["coil_mean", "powder_mean"]].to_numpy()
        rows = table["time"].to_numpy()
        times, weights = _gauss(rows)
        at = np.column_stack([np.interp(times, rows, of_source) for of_source in means.T])
        powers = [self._powers_in_time(time, one)[0].sum() for time, one in zip(times.tolist(), at, strict=True)]
        return float(weights @ np.array(powers))

    def _row_in_time(self, temperature: np.ndarray, time: float) -> dict[str, Any]:
        before = time - 1e-9 * max(time, 1.0) if time > 0.0 else 0.0  # a source that jumps there has not yet
        return self._row({self._drive(before): 1.0}, temperature)

    def _marched(
        self,
        march: HeatInTime,
        start: np.ndarray | float,
        ends: Sequence[float],
        row: Callable[[np.ndarray, float], dict[str, Any]],
    ) -> tuple[pandas.DataFrame, dict[str, Any], HeatState]:
        effect = self.scene.effects.thermal
        state = first = hottest = march.start(start)
        rows = [{"time": 0.0} | row(state.temperature, 0.0)]
        summary: dict[str, Any] = {"state": f"computed to {effect.duty.end:g} s", "end": effect.duty.end}
        try:
            for state in march.run(first, ends):
                self.tell(0.4 + 0.2 * state.time / effect.duty.end, "temperatures through the duty")
                rows.append({"time": state.time} | row(state.temperature, state.time))
                hottest = max(hottest, state, key=lambda one: one.temperature.max())
                if rows[-1]["coil_mean"] > HOTTEST:
                    raise ThermalRunaway
        except ThermalRunaway:
            summary["state"] = f"stopped: winding above {HOTTEST:g} °C after {state.time:.4g} s"
            summary["end"] = state.time
        table = pandas.DataFrame(rows)[list(UNITS)]
        for key, limit in self.limits.items():
            summary[f"{key}_limit_passed_after"] = _passes(table["time"].to_numpy(), table[key].to_numpy(), limit)
        for key in HOTTEST_PLACES:
            summary |= {f"largest_{key}": float(table[key].max()), f"last_{key}": float(table[key].iloc[-1])}
        summary["last_surface_part"] = rows[-1]["surface_part"]
        summary["largest_surface_part"] = max(rows, key=lambda one: one["surface"])["surface_part"]
        stored, made = float(self.problem.heat_content @ (state.temperature - first.temperature)), state.made.sum()
        summary |= {
            "heat_of_coil": float(state.made[COIL]), "heat_of_slip": float(state.made[POWDER]), "heat_out": state.left,
            "heat_stored": stored, "steps": march.steps,
            "energy_error": float((made - state.left - stored) / made) if made > 0.0 else 0.0,
        }  # fmt: skip
        return table, summary, hottest

    def _averaged(self, reference: np.ndarray | None) -> tuple[pandas.DataFrame, dict[str, Any], HeatState]:
        """Through the duty with its mean power, and the ripple about it."""
        effect, problem, duty = self.scene.effects.thermal, self.problem, self.scene.effects.thermal.duty
        drives, steady = self._mean_of_the_periods()
        powers = partial(self._mean_powers, drives)
        ends = np.linspace(0.0, duty.end, _ROWS + 1)[1:].tolist()

        def through(start: np.ndarray | float, ripple: Ripple | None) -> tuple[Any, dict[str, Any], HeatState]:
            march = HeatInTime(problem, lambda _, means: powers(means), effect.tolerance, reference)
            return self._marched(march, start, ends, lambda mean, _: self._row(drives, mean, ripple))

        mean = through(effect.ambient, None)[2].temperature if steady is None else steady  # or the last that exist
        ripple = self._ripple(mean)
        # mean and ripple together start at the temperature of the surroundings
        table, summary, hottest = through(effect.ambient - ripple.departures[0], ripple)
        table.loc[0, list(HOTTEST_PLACES)] = effect.ambient
        summary["averaged_periods"] = duty.end / duty.period
        ranges = np.ptp(self._hottest(mean, ripple), axis=0)
        summary["ripple"] = dict(zip(HOTTEST_PLACES, map(float, ranges), strict=True))
        summary["steady"] = summary["error_of_the_mean"] = None
        if steady is not None:
            summary |= self._repeated_for_ever(drives, steady, ripple)
        return table, summary, hottest

    def _mean_of_the_periods(self) -> tuple[dict[Drive, float], np.ndarray | None]:
        """Drives by their share of a period, and the steady temperatures of their mean power; None: it runs away."""
        drives: dict[Drive, float] = {}
        for time, weight in zip(*self._through_a_period(), strict=True):
            drives[self._drive(time)] = drives.get(self._drive(time), 0.0) + weight
        with suppress(ThermalRunaway):
            return drives, self._solve(partial(self._mean_powers, drives))
        return drives, None

    def _ripple(self, mean: np.ndarray) -> Ripple:
        effect = self.scene.effects.thermal
        cycle = HeatInTime(self.problem, self._powers_in_time, effect.tolerance, mean)
        return cycle.ripple(mean, self._switchings(effect.duty.period))

    def _repeated_for_ever(self, drives: Mapping[Drive, float], steady: np.ndarray, ripple: Ripple) -> dict[str, Any]:
        """The row of the duty repeated for ever; and the largest shift [K] of its mean if the equations are those
        averaged through the ripple, not at its mean; linearised.
        """
        problem, means = self.problem, self.problem.means(steady)
        times, weights = self._through_a_period()
        departures = ripple.departures @ problem.spread
        through = np.column_stack([np.interp(times, ripple.times, of_source) for of_source in departures.T])
        each = [self._powers_in_time(time, means + one)[0] for time, one in zip(times, through, strict=True)]
        losses = [problem.loss(steady + one) for one in ripple.departures]
        power, slope = self._mean_powers(drives, means)
        missed = problem.spread @ (weights @ np.array(each) - power) + problem.loss(steady) - ripple.weights @ losses
        error = float(np.abs(problem.factorised(problem.tangent(steady)).solve(missed, slope)).max())
        return {"steady": self._row(drives, steady, ripple), "error_of_the_mean": error}

    def _through_a_period(self) -> tuple[np.ndarray, np.ndarray]:
        """Times [s] and weights, of sum 1, of a mean over a period."""
        period = self.scene.effects.thermal.duty.period
        times, weights = _gauss([0.0, *self._switchings(period)])
        return times, weights / period

    def _drive(self, time: float) -> Drive:
        """What heats at a time of the duty [s]."""
        duty = self.scene.effects.thermal.duty
        within = time if duty.period is None else time % duty.period
        slip = self.peak.slip if duty.slip is None else abs(duty.slip(within))
        if duty.on is not None and within >= duty.on:
            return Drive(0.0, 0.0, slip)
        if duty.current is None:
            return replace(self.peak, slip=slip)
        return Drive(abs(duty.current(within)), 0.0, slip)

    def _switchings(self, end: float) -> list[float]:
        """Instants [s] at which a stretch of the duty ends, until `end`: its power is a polynomial of time between."""
        effect, duty = self.scene.effects.thermal, self.scene.effects.thermal.duty
        period = duty.period or duty.end
        cuts = {period} | ({duty.on} if duty.on else set())
        knots = () if effect.torque_curve is None else effect.torque_curve.currents
        for profile, kinks in ((duty.current, (0.0, *knots, *(-knot for knot in knots))), (duty.slip, (0.0,))):
            if profile is not None:
                instants = {*profile.times}.union(*map(profile.crossings, kinks))
                cuts |= {time for time in instants if 0.0 < time < period}
        count = int(np.ceil(end / period * (1.0 - 1e-12)))
        times = {k * period + cut for k in range(count) for cut in cuts}
        return sorted(time for time in {*times, end} if 0.0 < time <= end)

    def permitted(self, speeds: Sequence[float]) -> pandas.DataFrame:
        """A row a slip speed, at the current of the slip power; else with the coil at its full current or voltage."""
        return pandas.DataFrame([self._permitted_at(speed, n / len(speeds)) for n, speed in enumerate(speeds)])

    def _permitted_at(self, speed: float, share: float = 1.0) -> dict[str, float]:
        self.tell(0.6 + 0.2 * share, "permitted slip power")
        peak, by_law = self.peak, self.torque_summary["of_all_currents"]
        own, last = replace(self, problem=self._cooled_at([speed])), None

        def at(x: float) -> dict[str, float]:
            """The steady row at a share of the full current or voltage; without a law, at a slip power [W]."""
            nonlocal last
            drive = replace(peak, slip=speed, torque=x / speed)
            if by_law:
                drive = Drive(None if peak.current is None else x * peak.current, x * peak.voltage, speed)
            last = own._solve(drive, near=last)  # sooner from the last
            return own._row({drive: 1.0}, last)

        reached, rows, most = {}, {}, 1.0 if by_law else inf
        for place, limit in self.limits.items():
            x = _where_reached(partial(lambda place, x: at(x)[place], place), limit, _KEYS[place], most)
            reached[f"by_{place.removesuffix('_hottest')}"] = x
            rows[x] = {"slip_power": 0.0, "torque": 0.0, "powder_hottest": float("nan")}
            with suppress(ThermalRunaway):  # the coil alone is too hot
                rows[x] = at(x)
        rotor, disc = self.scene.motion.speeds_at_slip(speed)
        row = {"speed": speed, "rotor_speed": rotor, "disc_speed": disc, "film": film_of(self.scene, rotor)}
        keys = ["slip_power", "torque", "powder_hottest"] + ["current"] * by_law
        powers = {by: rows[x]["slip_power"] for by, x in reached.items()}
        return row | powers | {key: rows[min(rows)][key] for key in keys}

    def largest_currents(self) -> dict[str, float]:
        """Steady currents [A] without slip at which the coil reaches its limit, and at which its mean is `HOTTEST`.

        Beyond, steady temperatures may exist, of a winding that has burnt. Where the torque of all currents is known,
        also those permitted at the duty's largest slip by the ends of the torque's 95 % interval.
        """

        def with_copper_loss(power: float) -> np.ndarray:
            return self.problem.steady(lambda means: (np.array([power, 0.0]), np.zeros(2)))

        def current_at(limit: float, value: Callable[[np.ndarray], float]) -> float:
            power = _where_reached(lambda power: value(with_copper_loss(power)), limit, "coil_limit")
            mean = float(self.problem.means(with_copper_loss(power))[COIL])
            return float(np.sqrt(power / self.model.resistance(mean)))

        limit = self.scene.effects.thermal.coil_limit
        out = {
            "at_the_coil_limit": current_at(limit, lambda found: float(self.problem.largest(found)[COIL])),
            "at_a_mean_of_250_degrees": current_at(HOTTEST, lambda found: float(self.problem.means(found)[COIL])),
        }
        if self.torque_summary["of_all_currents"] and self.peak.slip > 0.0:
            for end, by in self.ends.items():
                out[f"with_slip_{end}"] = self.with_torque_times(by)._permitted_at(self.peak.slip)["current"]
        return out

    def mesh_error(self, temperature: np.ndarray | None) -> dict[str, float] | str:
        """Steady temperatures less those of elements of the next order [K]."""
        if temperature is None:
            return "not known: there are no steady temperatures"
        speeds = self.scene.motion.speeds_at_slip(self.peak.slip)
        finer = heat_problem(self.scene, *speeds, self.problem.mesh, order=2)
        try:
            found = self._solve(self.peak, finer)
        except ThermalRunaway as error:
            return f"not known: with elements of the next order {error}"
        coarse, fine = _hottest_places(self.problem, temperature), _hottest_places(finer, found)
        return {place: coarse[place] - fine[place] for place in HOTTEST_PLACES}


def _supply(coil: Any) -> float | None:
    """Return the voltage of the supply [V] beside a given current; None without."""
    return None if coil is None or coil.current is None or coil.voltage is None else coil.voltage.largest


def _hottest_places(problem: HeatProblem, temperature: np.ndarray) -> dict[str, float]:
    """Temperatures [degrees C] of the `HOTTEST_PLACES`; the surface without the shaft's ends."""
    coil, powder = map(float, problem.largest(temperature)[[COIL, POWDER]])
    _, surface = _hottest_surface(problem, temperature)
    return {"coil_hottest": coil, "powder_hottest": powder, "surface": surface}


def _hottest_surface(problem: HeatProblem, temperature: np.ndarray) -> tuple[str, float]:
    """The body with the hottest place of the outside, without the shaft's ends, and its temperature [degrees C]."""
    surfaces = problem.surface_temperatures(temperature).items()
    return max((one for one in surfaces if one[0] != SHAFT_ENDS), key=lambda one: one[1])


def _where_reached(value: Callable[[float], float], limit: float, key: str, most: float = inf) -> float:
    """Power [W] or current [A], up to `most`, at which a temperature that rises with it reaches a limit; 0: above it.

    By Brent's method; a value that makes the winding run away counts as above the limit. RunError with the `key` of the
    limit where none is found.
    """

    def excess(power: float) -> float:
        try:
            return value(power) - limit
        except ThermalRunaway:
            return MOLTEN

    if excess(0.0) >= 0.0:
        return 0.0
    high = min(1.0, most)
    while excess(high) < 0.0:
        if high == most:
            return most
        high = min(2.0 * high, most)
        if high > _MOST:
            raise RunError(
                f"effects.heat.{key} = {limit:g} degrees C is reached by no power or current: {_MOST:g} W make "
                f"{value(_MOST):.4g} degrees C; lower {key}, or convection and shaft_conductance"
            )
    found = brentq(excess, 0.0, high, rtol=1e-6)
    return found if excess(found) < MOLTEN else (1.0 - 4e-6) * found  # just below where it runs away


def _gauss(edges: Sequence[float] | np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Times and weights [s] of an integral in time: two points of Gauss in each of `_PIECES` between two edges [s]."""
    cuts = np.concatenate([np.linspace(a, b, _PIECES, endpoint=False) for a, b in pairwise(edges)] + [edges[-1:]])
    middle, half = 0.5 * (cuts[:-1] + cuts[1:]), 0.5 * np.diff(cuts)
    times = (middle[:, None] + half[:, None] * np.array([-1.0, 1.0]) / np.sqrt(3.0)).ravel()
    return times, np.repeat(half, 2)


def _passes(time: np.ndarray, value: np.ndarray, limit: float) -> float | None:
    """When a temperature first passes a limit [s], between two rows on a line; None where it does not."""
    if not np.any(value > limit):
        return None
    k = int(np.argmax(value > limit))
    return float(np.interp(limit, value[k - 1 : k + 1], time[k - 1 : k + 1])) if k else 0.0
