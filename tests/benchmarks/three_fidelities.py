"""What accuracy costs: the torque of two devices by a formula, by the law of the powder and by grains.

    python tests/benchmarks/three_fidelities.py docs/two_scales.csv       # the table of docs/accuracy.md
    python tests/benchmarks/three_fidelities.py docs/two_scales.csv docs/three_fidelities.png

Each fidelity is judged by the next: the formula by the law, the law by runs of grains, the grains by the accuracy study
of their device. Nothing is run: runs are those of docs/two_scales.csv and of the shipped accuracy study of the brake;
formula and law are computed, and timed on one core, in half a minute.

The formula is that of a data sheet: a magnetic circuit of the device (Roters, Electromagnetic Devices, 1941, ch. 4
and 5; `field.coil.magnetic_circuit`) has the flux density B of the gap, with powder of the law's permeability, and
T = tau(B) A r with the area A of the poles and their mean radius r. Without iron and leakage the circuit is two gaps in
series, H = N I/(2 g). It has no mesh, and no powder beyond the edges of the poles.
"""

from __future__ import annotations

import argparse
import time
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from two_scales import CASES, Row, case_of, read_rows

from emclutch.device_model.materials import grain_law, magnetic_law, saturation_of
from emclutch.results.accuracy_studies import SHIPPED
from emclutch.results.accuracy_study import AccuracyStudy
from emclutch.results.recommended import Combinations, own_choice
from emclutch.results.text import format_duration
from emclutch.scene.case import Case, load_case
from emclutch.scene.fill import fill_of
from emclutch.simulation.forecast.expected_torque import Interval
from emclutch.simulation.forecast.powder_law import powder_of, shipped_laws
from emclutch.simulation.recommended_case import cheapest_case
from emclutch.studies.design_search import expectation_of
from field import PowderLaw

DISC = "held out 2"  # the first disc clutch that no law was fitted to
USES = ("fit", "held out")  # the devices that were drawn by a seed
ROUNDS = 4  # of the permeability, which depends on H
GAPS_SECONDS, LEAST = 1e-3, 0.3  # in the picture: cost of two gaps in series [s], and the smallest deviation [%]


@dataclass(frozen=True)
class GapPowder:
    """Sheared powder as the law of a flux tube: solid fraction and demagnetising factor of its grains."""

    powder: PowderLaw
    fill: float
    factor: float
    name: str = "powder"
    source: str = "law of the powder"

    def H_of_B(self, B: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See `field.laws.reluctivity.Law`."""
        return self.powder.H_of_B(B, self.fill, self.factor)

    def energy_density(self, B: np.ndarray) -> np.ndarray:
        """See `field.laws.reluctivity.Law`."""
        return self.powder.energy_density(B, self.fill, self.factor)


def formula(case: Case, iron: bool = True) -> float:
    """Torque [N m] of the real powder by a magnetic circuit, with iron and leakage, or of the gaps alone."""
    scene = case.scene
    shape, grains, Ms, coil = scene.shape(), grain_law(scene), saturation_of(scene), scene.coil
    assert coil is not None
    window = shape.coil_area, shape.coil_mean_radius
    ampere_turns = coil.winding_in(*window).turns * coil.currents_in(*window).largest
    region = scene.grains.region
    zone, gap = scene.geometry.pole_zone(shape, region), shape.sheared_gap(region)
    fill = fill_of(shape, scene.grains).mass / scene.grains.density / zone.volume
    law = shipped_laws().nearest(*powder_of(scene))[0]
    H = np.array(ampere_turns / (2.0 * gap.width))
    B = law.flux_density(H, fill, grains, Ms)
    if iron:
        names = scene.geometry.region_materials(("disc", "rotor", "housing", "cover"))
        laws = {part: magnetic_law(scene, name) for part, name in names.items()}
        for _ in range(ROUNDS):
            powder = GapPowder(PowderLaw(grains), fill, float(law.factor(H, fill, Ms)))
            solution = scene.geometry.magnetic_circuit(shape, laws, powder).solve(ampere_turns)
            B = np.array(abs(solution.flux_density["face" if gap.at_faces else "gap"]))
            H = powder.H_of_B(B)[0]
    per_gap = gap.width / (scene.grains.real_diameter or scene.grains.mean_diameter)
    return float(law.stress(B, Ms, fill, per_gap)) * zone.area * zone.radius


def timed(function, *values) -> tuple:
    """What a function returns, and the processor time that its second call takes [s]."""
    function(*values)
    start = time.process_time()
    found = function(*values)
    return found, time.process_time() - start


@dataclass(frozen=True)
class Device:
    """Torques [N m] of a device by all fidelities, and what they cost [s of one core].

    `grains` is the best estimate of runs and half of its 95 % interval, with what is in it; `choices` are the settings
    of grains that a study knows, each with its half width and cost, the last those of `grains`.
    """

    name: str
    gaps: float
    circuit: float
    law: Interval
    grains: tuple[float, float]
    inside: str
    seconds: tuple[float, float]
    choices: tuple[tuple[str, float, float], ...]

    @property
    def law_half_width(self) -> float:
        """Half of the law's 95 % interval, relative."""
        return self.law.high / self.law.mean - 1.0


def device(case: Case, name: str, grains: tuple[float, float], inside: str, choices) -> Device:
    """A device with its formula and law computed."""
    (expected, law_seconds), (circuit, circuit_seconds) = timed(expectation_of, case), timed(formula, case)
    assert expected.real is not None and not expected.real.is_guess
    return Device(
        name, formula(case, False), circuit, expected.real, grains, inside, (circuit_seconds, law_seconds), choices
    )


def brake_study() -> AccuracyStudy:
    """The shipped accuracy study of the brake."""
    found = (AccuracyStudy.from_json(path.read_text()) for path in sorted(SHIPPED.glob("*.json")))
    return next(one for one in found if one.case == "powder_clutch")


def brake() -> Device:
    """cases/powder_clutch.toml, judged by its accuracy study."""
    study, case = brake_study(), load_case(CASES / "powder_clutch.toml")
    cheapest, own = cheapest_case(case, study, 0.10), own_choice(study)
    assert isinstance(cheapest, tuple)
    coarse = cheapest[0]
    choices = (("cheapest for 10 %", coarse.half_width, coarse.seconds), ("of the scene", own.half_width, own.seconds))
    torque, half = study.best_estimate()
    return device(case, "brake", (torque, half), "all settings", choices)


def disc_clutch(rows: list[Row]) -> Device:
    """The disc clutch, judged by its one run, whose settings were not measured."""
    row = next(row for row in rows if row["name"] == DISC)
    torque, error = float(row["torque"]), float(row["standard_error"])
    half = 1.96 * error / torque
    choices = (("one replica", half, float(row["processor_seconds"])),)
    return device(case_of(row), "small disc clutch", (torque, half), "statistics alone", choices)


def others(rows: list[Row], base: str = "") -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Deviations of the drawn devices, relative: gaps alone and circuit from the law, the law from the runs."""
    own = [row for row in rows if row["use"] in USES and base in row["base"]]
    law, run = (np.array([float(row[name]) for row in own]) for name in ("predicted", "torque"))
    gaps, circuit = (np.array([formula(case_of(row), iron) for row in own]) for iron in (False, True))
    return gaps / law - 1.0, circuit / law - 1.0, law / run - 1.0


def seconds_in_words(seconds: float) -> str:
    """A cost: milliseconds below a second."""
    return f"{float(f'{1e3 * seconds:.1g}'):g} ms" if seconds < 0.5 else format_duration(seconds)


def table(devices: list[Device], rows: list[Row]) -> list[str]:
    """The lines of the table in Markdown."""
    lines = [
        "| fidelity | device | torque [N m] | error | error of 16 random devices | processor time |",
        "|---|---|---|---|---|---|",
    ]
    all_ = {one.name: others(rows, {"brake": "drum", "small disc clutch": "disc"}[one.name]) for one in devices}

    def in_percent(error: float, values: np.ndarray) -> str:
        return f"{100.0 * error:+.0f} % | {100.0 * values.mean():+.0f} ± {100.0 * values.std(ddof=1):.0f} %"

    for place, what in enumerate(("formula: gaps alone", "formula: magnetic circuit")):
        for one in devices:
            torque = (one.gaps, one.circuit)[place]
            error = in_percent(torque / one.law.mean - 1.0, all_[one.name][place])
            cost = seconds_in_words(one.seconds[0]) if place else "< 1 ms"
            lines.append(f"| {what} | {one.name} | {torque:.3g} | {error} | {cost} |")
    for one in devices:
        error = in_percent(one.law.mean / one.grains[0] - 1.0, all_[one.name][2])
        torque = f"{one.law.mean:.3g} ± {100.0 * one.law_half_width:.2g} %"
        lines.append(f"| law | {one.name} | {torque} | {error} | {seconds_in_words(one.seconds[1])} |")
    for one in devices:
        for what, half, seconds in one.choices:
            torque, error = f"{one.grains[0]:.3g}", f"± {100.0 * half:.2g} % ({one.inside}) |"
            lines.append(f"| grains, {what} | {one.name} | {torque} | {error} | {format_duration(seconds)} |")
    return lines


def draw(devices: list[Device], rows: list[Row], path: Path) -> None:
    """Draw the error of each fidelity against its cost."""
    figure = Figure(figsize=(9.5, 5.4), layout="constrained")
    axes = figure.add_subplot()
    places = (GAPS_SECONDS, *np.exp(np.mean(np.log([one.seconds for one in devices]), axis=0)))
    spread = np.random.default_rng(0).uniform(0.75, 1.33, 32)  # so that dots do not cover one another
    for x, values in zip(places, others(rows), strict=True):
        axes.plot(x * spread, np.maximum(100.0 * np.abs(values), LEAST), ".", color="0.72", ms=5, zorder=1,
                  label="32 random devices: deviation" if x == GAPS_SECONDS else None)  # fmt: skip
    for one, color, marker in zip(devices, ("C0", "C3"), ("o", "s"), strict=True):
        errors = [one.gaps / one.law.mean - 1.0, one.circuit / one.law.mean - 1.0, one.law.mean / one.grains[0] - 1.0]
        axes.plot(places, 100.0 * np.abs(errors), marker, color=color, ms=8, zorder=3,
                  label=f"{one.name}: deviation from the next fidelity")  # fmt: skip
        axes.plot(places[2], 100.0 * one.law_half_width, "_", color=color, ms=22, mew=2.5, zorder=3,
                  label=f"{one.name}: half of the 95 % interval")  # fmt: skip
        for what, half, seconds in one.choices:
            axes.plot(seconds, 100.0 * half, "_", color=color, ms=22, mew=2.5, zorder=3)
            words = f"{what} ({one.inside})"
            axes.annotate(words, (seconds, 100.0 * half), xytext=(0, 6 if one.name == "brake" else -13),
                          textcoords="offset points", ha="center", fontsize=8, color=color)  # fmt: skip
    seconds, half = Combinations(brake_study()).frontier()
    axes.plot(seconds, 100.0 * half, color="C0", lw=5.0, alpha=0.16, drawstyle="steps-post",
              label="brake: best settings")  # fmt: skip
    names = "formula:\ngaps", "formula:\ncircuit", "law of\nthe powder", "grains"
    for x, words in zip((*places, 700.0), names, strict=True):
        axes.text(x, 640.0, words, ha="center", va="top", fontsize=10, fontweight="bold")
    axes.set(xscale="log", yscale="log", ylim=(0.25, 700.0), xlim=(2e-4, 3e4),
             xlabel="processor time of a torque [s of one core]", ylabel="error of the torque [%]",
             title="Error of the torque against processor time")  # fmt: skip
    axes.set_yticks([0.3, 1, 3, 10, 30, 100, 300], ["0.3", "1", "3", "10", "30", "100", "300"])
    axes.grid(alpha=0.25)
    axes.legend(frameon=False, fontsize=8, loc="lower left")
    FigureCanvasAgg(figure).print_png(path)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("table_file", metavar="table", type=Path, help="the runs of devices (docs/two_scales.csv)")
    parser.add_argument("picture", nargs="?", type=Path, help="the picture to draw (.png), in place of the table")
    asked = parser.parse_args()
    rows = read_rows(asked.table_file)
    devices = [brake(), disc_clutch(rows)]
    if asked.picture is None:
        print("\n".join(table(devices, rows)))
    else:
        draw(devices, rows, asked.picture)


if __name__ == "__main__":
    main()
