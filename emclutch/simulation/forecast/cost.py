"""Estimated cost of a run before its first step: seconds by part, memory, disk.

Seconds are counts (grains, steps, updates, neighbours, solves) times a few costs on the reference machine, what each
effect of the scene adds (`emclutch.effects`), and how slow the machine at hand is (`machine_speed.slowness`). Parts
have the names under which a run measures them: `field` (deposit and solves), `magnetic` (moments and forces), `contact`
(the grains' steps); besides `output` (history, snapshots, pictures) and `start` (imports, mesh, plan, packing). Not in
it: compiling kernels, once for each kind of scene, settling, and other programs. It holds within a factor of about two
(docs/explanation/expected_torque.md has what was measured); the windows of the run itself say it better
(`emclutch.simulation.pace`).
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import TYPE_CHECKING

import numpy as np

from emclutch.device_model.decision import Decision
from emclutch.scene.replica_count import cores_at_hand, replica_count, replicas_side_by_side
from emclutch.simulation.forecast.machine_speed import slowness
from emclutch.simulation.forecast.space import disk, memory, shortage
from field.factorisation import available_backends
from particles.threads import WORTH_SHARING

if TYPE_CHECKING:
    from emclutch.device_model.device import Device
    from emclutch.scene.model import Scene

# Processor time on the reference machine, one core of an AMD EPYC (tests/benchmarks/predicted_cost.py)
STEP_NS = 80.0  # a grain and step by DEM, with its contacts
RIGID_STEP_NS = 700.0  # the same by DVI
# by DVI where grains attract one another, and of it a sweep. Sweeps pass a push on as sound does: on springs their
# number is about in proportion to the step (10, 23 and 52 at 0.5, 1 and 2 contact times, quickstart)
CHAINED_STEP_NS, CHAINED_SWEEP_NS = 2200.0, 72.0
SWEEPS_PER_CONTACT, RIGID_SWEEPS = 22.0, 50.0  # in a contact time pi sqrt(m_eff/k); in a step without springs
UPDATE_S, SAMPLE_NS = 5e-4, 600.0  # an update of the magnetic forces, and the field at a grain in it
SOLVE_S = {"cholmod": 4.5e-6, "superlu": 2.2e-5}  # an unknown of the field in the section, and solve
SOLID_SOLVE_S = 1e-4  # an unknown of the field in 3D, and solve
WINDOW_S, FRAME_S, FRAME_GRAIN_S, PICTURES_S = 1e-3, 0.03, 4e-5, 2.0  # a row of the history, a snapshot, all pictures
START_S, PACKING_S = 2.0, 2e-4  # imports and reading the scene; a grain
CURRENT_STEP = 0.01  # of the largest current: a change that calls for a solve
OFF = 0.01  # of the largest current: less magnetises no grains


@dataclass(frozen=True, slots=True)
class Cost:
    """Estimated cost of a run on this machine, with a number of threads.

    Attributes
    ----------
    loop : dict of str to float
        Wall-clock seconds of `field`, `magnetic` and `contact` to the end, of one round of replicas.
    once : dict of str to float
        Those of `start` and `output`.
    end : float
        Simulated time [s].
    memory, disk : float
        [MiB], at most and in the end; of one replica.
    steps, grains, threads : int
        Of one replica.
    replicas : int
        Runs at a time.
    rounds : int
        How often so many run, one after another.
    """

    loop: dict[str, float]
    once: dict[str, float]
    end: float
    memory: float
    disk: float
    steps: int
    grains: int
    threads: int
    replicas: int
    rounds: int = 1

    @property
    def seconds(self) -> dict[str, float]:
        """Wall-clock seconds of each part over all rounds, and their `total`."""
        parts = {part: self.rounds * seconds for part, seconds in (self.loop | self.once).items()}
        return parts | {"total": sum(parts.values())}

    def until(self, time: float) -> float:
        """Wall-clock seconds of the loop until `time` [s], of one round."""
        return sum(self.loop.values()) * time / self.end

    def in_words(self) -> str:
        """One line: time, memory and disk, with warnings where they are large."""
        seconds = self.seconds
        threads, times = "one thread" if self.threads == 1 else f"{self.threads} threads", ""
        if self.replicas > 1:
            threads, times = f"{self.replicas} replicas at a time, {threads} each", f"{self.replicas} x "
        if self.rounds > 1:
            threads += f", {self.rounds} rounds"
        text = (
            f"about {format_rough_time(seconds['total'])} on idle cores, within a factor of two ({threads}). "
            f"Memory {times}{self.memory:.0f} MiB, disk {self.disk:.0f} MiB"
        )
        long = "the run takes more than a day; are all lengths and times in the units that were meant?"
        return Decision(text, shortage(self.replicas * self.memory), long if seconds["total"] > 86400.0 else "")

    def parts_in_words(self) -> str:
        """One line: steps and grains, and the time by part, without that of compiling."""
        parts = ((part, value) for part, value in self.seconds.items() if part != "total")
        times = ", ".join(f"{part} {format_rough_time(value)}" for part, value in parts)
        return f"{self.steps} steps of {self.grains} grains: {times}"


def predict(
    scene: Scene, device: Device, dt: float, rhythm: tuple[int, int, int], threads: int, stiffness: float | None = None
) -> Cost:
    """Estimate the cost of a planned run on `threads` threads of this machine.

    `dt` is the grains' step [s]; `rhythm` are steps a window, updates a window and windows; `stiffness` that of
    contacts between grains [N/m], None of rigid ones.
    """
    window, updates, windows = rhythm
    grains, steps = device.fill.count, window * windows
    times = steps * dt * np.linspace(0.0, 1.0, 65)
    drive = relative_drive(device, times)
    on = float((drive > OFF).mean())  # fraction of the run in which grains are magnetised
    update = UPDATE_S + 1e-9 * grains * update_ns(scene, device)
    solves = float(np.minimum(np.abs(np.diff(drive)) / CURRENT_STEP, windows / (len(times) - 1)).sum())
    solves = max(solves, on * windows * max((one.window_solves for one in scene.effects.present), default=0.0))
    slow, count = slowness(), replica_count(scene)
    gain = sqrt(min(threads, cores_at_hand())) if grains >= WORTH_SHARING else 1.0
    loop = {
        "field": slow * solves * (solve_seconds(device) + update),
        "magnetic": slow * on * updates * windows * update / gain,
        "contact": slow * steps * 1e-9 * grains * step_ns(scene, dt, stiffness) / gain,
    }
    output, replicas = scene.output, replicas_side_by_side(count, threads)
    frames = output.snapshots * (FRAME_S + FRAME_GRAIN_S * grains) if output.formats else 0.0
    once = {
        "start": slow * (START_S + 2.0 * solve_seconds(device) + PACKING_S * grains),
        "output": slow * (WINDOW_S * windows + frames + PICTURES_S * output.pictures),
    }
    room = memory(scene, device, windows), disk(scene, device, windows)
    return Cost(loop, once, steps * dt, *room, steps, grains, threads, replicas, -(-count // replicas))


def step_ns(scene: Scene, dt: float, stiffness: float | None) -> float:
    """Processor time of a grain and step `dt` [s] [ns]; see `predict`."""
    effects = scene.effects
    if scene.contact.method == "dvi":
        if effects.attraction is None:
            return RIGID_STEP_NS
        return CHAINED_STEP_NS + CHAINED_SWEEP_NS * expected_sweeps(scene, dt, stiffness)
    return STEP_NS + sum(one.step_ns() for one in effects.present)


def expected_sweeps(scene: Scene, dt: float, stiffness: float | None) -> float:
    """Sweeps that a step by DVI takes in a packing of grains that attract one another."""
    sweeps = RIGID_SWEEPS
    if stiffness is not None:
        mass = scene.grains.density * pi / 6.0 * scene.grains.smallest_diameter**3
        sweeps = SWEEPS_PER_CONTACT * dt / (pi * sqrt(0.5 * mass / stiffness))
    return float(min(max(sweeps, 1.0), scene.contact.dvi.max_sweeps))


def update_ns(scene: Scene, device: Device) -> float:
    """Processor time of a grain in an evaluation of the magnetic forces [ns]."""
    return SAMPLE_NS + sum(one.neighbour_ns * one.neighbours(scene, device) for one in scene.effects.present)


def solve_seconds(device: Device) -> float:
    """Processor time of a solve of the coil's field [s]; 0 without a coil."""
    if device.coil is None:
        return 0.0
    each = SOLID_SOLVE_S if device.section_coil is None else SOLVE_S[available_backends()[0]]
    return each * device.coil.problem.n_dofs


def relative_drive(device: Device, times: np.ndarray) -> np.ndarray:
    """The field's drive at some instants [s] over its largest, 0 to 1."""
    if device.coil is None or device.coil.largest_current == 0.0:
        return np.full(len(times), 1.0 if device.imposed is not None else 0.0)
    return np.abs([device.coil.currents(float(time)) for time in times]) / device.coil.largest_current


def format_rough_time(seconds: float) -> str:
    """A duration in the unit that one would say it in."""
    for limit, unit, size in ((90.0, "s", 1.0), (5400.0, "min", 60.0), (172800.0, "h", 3600.0)):
        if seconds < limit:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds / 86400.0:.0f} days"
