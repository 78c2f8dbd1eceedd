"""Magnets that others measured or computed, over their stroke: Roters' plunger, and Modelica's solenoid with its coil.

python tests/benchmarks/validation_devices.py roters PICTURE.png
python tests/benchmarks/validation_devices.py solenoid PICTURE.png
python tests/benchmarks/validation_devices.py switch_on
python tests/benchmarks/validation_devices.py convergence
python tests/benchmarks/validation_devices.py air_coil

print tables, our values next to theirs (docs/explanation/validation.md sums them up); scenes, drawings and data:
cases/validation.
"""

from __future__ import annotations

import argparse
import csv
import math
import re
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure

from emclutch.device_model.device import CoilDevice, solved_coil
from emclutch.scene.case import load_case
from field import AxisymmetricProblem, MagneticField, RecoveredSampler
from field.coil.coil_circuit import CircuitState, LinearisedCoil, solve_at_flux_linkage
from field.coil.inductance import apparent_inductance
from field.section.maxwell_force import axial_force

sys.path.append(str(Path(__file__).resolve().parents[1] / "field"))  # the coil in air
CASES = Path(__file__).resolve().parents[2] / "cases" / "validation"


def columns(name: str) -> dict[str, np.ndarray]:
    """Columns of a table of cases/validation by their headings."""
    with open(CASES / name, encoding="utf-8") as stream:
        heading, *rows = csv.reader(line for line in stream if not line.startswith("#"))
    return {
        label: np.array(column, dtype=float) for label, column in zip(heading, zip(*rows, strict=True), strict=True)
    }


def drawn_at(name: str, place: float, **values: Any) -> CoilDevice:
    """The device of cases/validation/NAME.toml with its moving part at a place, in the unit of its drawing."""
    script = (CASES / f"{name}.geo").read_text(encoding="utf-8")
    moved, count = re.subn(r"^([sx]) = [0-9.]+;$", rf"\1 = {float(place)!r};", script, flags=re.MULTILINE)
    assert count == 1, "a drawing has one line that says where its moving part is"
    with tempfile.TemporaryDirectory() as folder:
        drawing = Path(folder) / f"{name}.geo"
        drawing.write_text(moved, encoding="utf-8")
        given = {"geometry.file": str(drawing), **values}
        coil = solved_coil(load_case(CASES / f"{name}.toml", given, trust_scripts=True).scene)
    assert isinstance(coil, CoilDevice)
    return coil


def pull(solution: MagneticField) -> float:
    """Force [N] that draws the moving part into the coil: both drawings have the pole on one side of it."""
    return abs(axial_force(solution, "disc").maxwell_stress)


def largest_flux(solution: MagneticField, radius: float) -> float:
    """The largest flux [Wb] through a plane of the moving part, a cylinder of a radius [m], along its mantle."""
    mesh = solution.problem.mesh
    part = np.unique(mesh.triangles[mesh.regions["disc"]])
    mantle = part[np.abs(mesh.points[part, 0] - radius) < 1e-9]
    return float(2.0 * math.pi * np.abs(solution.point_psi[mantle]).max())


def switched_on(coil: CoilDevice, times: np.ndarray, resistance: float, volts: float) -> np.ndarray:
    """Currents [A] at times [s] after a voltage is switched on, the moving part at rest, without eddy currents."""
    solution = coil.problem.solve(0.0)
    state, currents = CircuitState(0.0, 0.0, 0.0), []
    for instant in times:
        for time in np.linspace(state.time, instant, 1 + math.ceil((instant - state.time) / 2e-4))[1:]:
            line = LinearisedCoil.about(solution, coil.turns, resistance)
            state = line.advance(state, float(time), lambda _: volts)
            guess = solution if solution.ampere_turns != 0.0 else None
            solution = solve_at_flux_linkage(coil.problem, state.linkage / coil.turns, None, guess)
        currents.append(solution.ampere_turns / coil.turns)
    return np.array(currents)


def roters(picture: str, size: float) -> None:
    """Force against displacement, beside FEMM and the measurement."""
    data = columns("roters.csv")
    place, measured, femm = data["s [in]"], data["measured [N]"], data["FEMM [N]"]
    force = np.array([pull(_solved("roters", s, size)) for s in place])
    print("| s [in] | ours [N] | FEMM | measured | ours/FEMM | ours/measured |\n|---|---|---|---|---|---|")
    for row in zip(place, force, femm, measured, force / femm, force / measured, strict=True):
        print("| {:.1f} | {:.1f} | {:.1f} | {:.1f} | {:.3f} | {:.3f} |".format(*row))
    axes, figure = _axes(1)
    axes[0].plot(place, measured, "ko", mfc="none", label="measured (Roters)")
    axes[0].plot(place, femm, "C1--", label="FEMM")
    axes[0].plot(place, force, "C0-", label="emclutch")
    axes[0].set(xlabel="displacement s [in]", ylabel="force on the plunger [N]", ylim=(0.0, None))
    axes[0].set_title("Roters' taper plunger magnet, 2550 turns, 1.5 A", loc="left", fontsize=10)
    axes[0].legend(frameon=False)
    figure.savefig(picture, dpi=130)


def solenoid(picture: str, size: float) -> None:
    """Force, flux and inductance against the air gap, beside the library's table."""
    data = columns("solenoid.csv")
    gap = data["x [mm]"]
    solved = [_solved("solenoid", x, size) for x in gap]
    turns = 957.0
    ours = {
        "force [N]": np.array([pull(field) for field in solved]),
        "flux [uWb]": np.array([1e6 * largest_flux(field, 5e-3) for field in solved]),
        "inductance [mH]": np.array([1e3 * apparent_inductance(field, turns) for field in solved]),
    }
    print("| x [mm] | F [N] | library | ratio | flux [uWb] | library | ratio | L [mH] | library | ratio |")
    print("|---" * 10 + "|")
    for k, x in enumerate(gap):
        cells = [f"{mine[k]:.4g} | {data[name][k]:.4g} | {mine[k] / data[name][k]:.3f}" for name, mine in ours.items()]
        print(f"| {x:g} | {' | '.join(cells)} |")
    axes, figure = _axes(3)
    for axis, (name, mine) in zip(axes, ours.items(), strict=True):
        axis.plot(gap, data[name], "ko", ms=4, mfc="none", label="Modelica's table (finite elements)")
        axis.plot(gap, mine, "C0-", label="emclutch")
        axis.set(xlabel="air gap x [mm]", ylabel=name.replace("uWb", "µWb"), ylim=(0.0, None))
    axes[0].legend(frameon=False, fontsize=8)
    figure.suptitle("Solenoid of the Modelica library, 957 turns, 1.2 A", fontsize=10)
    figure.savefig(picture, dpi=130)


def switch_on(size: float) -> None:
    """Current after 12 V are switched on at x = 5 mm, beside the library's."""
    data = columns("solenoid_switch_on.csv")
    currents = switched_on(drawn_at("solenoid", 5.0, **{"field.size_factor": size}), 1e-3 * data["t [ms]"], 10.0, 12.0)
    print("| t [ms] | ours [A] | library | ratio |\n|---|---|---|---|")
    for t, mine, theirs in zip(data["t [ms]"], currents, data["current [A]"], strict=True):
        print(f"| {t:g} | {mine:.5f} | {theirs:.5f} | {mine / theirs:.4f} |")


def convergence() -> None:
    """Force of both at one place on ever finer meshes, by Maxwell stress and virtual work; flux wall and open air."""
    print("| magnet | size_factor | unknowns | F [N] | virtual work | with a flux wall |\n|---|---|---|---|---|---|")
    for name, place in (("roters", 1.0), ("solenoid", 2.5)):
        for size in (4.0, 2.0, 1.0, 0.5):
            field, walled = _solved(name, place, size), _solved(name, place, size, open_boundary=False)
            work = abs(axial_force(field, "disc", virtual_work=True).virtual_work or math.nan)
            print(
                f"| {name} | {size:g} | {field.problem.n_dofs} | {pull(field):.4f} | {work:.4f} | {pull(walled):.4f} |"
            )


def air_coil() -> None:
    """H and grad H beside an air coil, recovered from elements of order 2, against loops; these against magpylib."""
    import magpylib
    from air_coil import NI, R_COIL, Z_COIL, Reference, coil_in_air

    low, high, count = (33e-3, -10e-3), (35e-3, 10e-3), 24
    beside = Reference(500, low, high)
    node, weight = np.polynomial.legendre.leggauss(count)
    loops = magpylib.Collection()
    for x, w_r in zip(node, weight, strict=True):
        for y, w_z in zip(node, weight, strict=True):
            radius = 0.5 * (sum(R_COIL) + x * (R_COIL[1] - R_COIL[0]))
            height = 0.5 * (sum(Z_COIL) + y * (Z_COIL[1] - Z_COIL[0]))
            loops.add(
                magpylib.current.Circle(
                    current=0.25 * NI * w_r * w_z, diameter=2.0 * radius, position=(0.0, 0.0, height)
                )
            )
    H = loops.getH(beside.position)[:, ::2].T
    print(f"closed form against magpylib: {np.linalg.norm(H - beside.H) / np.linalg.norm(beside.H):.1e} of H")
    print("| size | unknowns | H | grad H |\n|---|---|---|---|")
    for scale in (2.0, 1.0, 0.5):
        problem = AxisymmetricProblem(coil_in_air(scale), {}, order=2, open_boundary=True)
        of_H, of_grad = beside.of(RecoveredSampler(problem.solve(NI), "powder"))
        print(f"| {scale:g} | {problem.n_dofs} | {of_H:.1e} | {of_grad:.1e} |")


def _solved(name: str, place: float, size: float, **of_field: Any) -> MagneticField:
    of_field |= {"size_factor": size}
    return drawn_at(name, place, **{f"field.{key}": value for key, value in of_field.items()}).solve_at_peak(None)


def _axes(count: int) -> tuple[list[Any], Figure]:
    figure = Figure(figsize=(5.6 if count == 1 else 3.7 * count, 3.9), layout="constrained")
    FigureCanvasAgg(figure)
    axes = [figure.add_subplot(1, count, k + 1) for k in range(count)]
    for axis in axes:
        axis.grid(alpha=0.3, lw=0.4)
    return axes, figure


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=("roters", "solenoid", "switch_on", "convergence", "air_coil"))
    parser.add_argument("picture", nargs="?", default="validation.png")
    parser.add_argument("--size", type=float, default=1.0, help="field.size_factor")
    asked = parser.parse_args()
    if asked.what in ("convergence", "air_coil"):
        {"convergence": convergence, "air_coil": air_coil}[asked.what]()
    elif asked.what == "switch_on":
        switch_on(asked.size)
    else:
        {"roters": roters, "solenoid": solenoid}[asked.what](asked.picture, asked.size)
