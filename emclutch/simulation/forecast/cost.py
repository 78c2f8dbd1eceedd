"""Predicted cost of a run: seconds by part and through its time, memory, disk.

Seconds are counts (`expected_counts`) times what each effect costs on the reference machine (`effect_costs`), times how
fast the machine at hand is (`machine_speed`). Parts have the names under which a run measures them: `field` (deposit
and solves), `magnetic` (moments and forces), `contact` (the grains' steps); beside them `output` (history, snapshots,
pictures) and `start` (imports, mesh, plan, packing). Compiling kernels, once for each kind of scene, and settling are
not predicted.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from emclutch.device.decision import with_warnings
from emclutch.scene.replica_count import replica_count, replicas_side_by_side
from emclutch.simulation.forecast import effect_costs as costs
from emclutch.simulation.forecast.expected_counts import counts_at, neighbours
from emclutch.simulation.forecast.free_memory import shortage
from emclutch.simulation.forecast.machine_speed import MachineSpeed, machine_speed
from particles.threads import WORTH_SHARING

if TYPE_CHECKING:
    from emclutch.device.device import Device
    from emclutch.scene.model import Scene

INSTANTS = 64  # at which the course of a run is predicted
# MiB of the program, of what a field and what pictures load; bytes a grain, a neighbour's row, an unknown of the field.
# Largest resident sizes: centrifugal 224 MiB, quickstart 368, with pictures 431, ten times its sector 481, slotted_disc
# 590; compiling takes some 200 more, once
BASE_MIB, FIELD_MIB, PICTURES_MIB = 220.0, 110.0, 60.0
GRAIN_BYTES, ROW_BYTES, UNKNOWN_BYTES, SOLID_UNKNOWN_BYTES = 4000.0, 50.0, 4000.0, 5000.0
WINDOW_BYTES = 2000.0  # a row of the history: some sixty columns as numbers and, while it is read, as text
# Bytes on disk: a grain's frame in each format, an unknown's; a row of the history, and in the record; a grain and an
# unknown of the checkpoint; the rest
FRAME_BYTES = {"vtk": 260.0, "hdf5": 120.0}
HISTORY_BYTES, OBSERVABLES_BYTES = 800.0, 1200.0
FIELD_BYTES, CHECKPOINT_BYTES, UNKNOWN_CHECKPOINT_BYTES, REST_MIB = 39.0, 1200.0, 30.0, 3.0


@dataclass(frozen=True, slots=True)
class Cost:
    """Cost of a run on a machine with a number of threads.

    Attributes
    ----------
    time : ndarray, shape (k,)
        Instants of the run [s], from 0 to its end.
    spent : dict of str to ndarray, shape (k,)
        Wall-clock seconds that `field`, `magnetic` and `contact` will have taken by then.
    once : dict of str to float
        Wall-clock seconds of `start` and `output`.
    memory, disk : float
        [MiB], at most and in the end; of one replica.
    steps, grains, threads : int
        Of one replica.
    replicas : int
        Runs side by side.
    machine : MachineSpeed
    rounds : int
        How often so many run, one after another.
    """

    time: np.ndarray
    spent: dict[str, np.ndarray]
    once: dict[str, float]
    memory: float
    disk: float
    steps: int
    grains: int
    threads: int
    replicas: int
    machine: MachineSpeed
    rounds: int = 1

    @property
    def seconds(self) -> dict[str, float]:
        """Wall-clock seconds of each part over all rounds, and their `total`."""
        parts = {part: self.rounds * float(course[-1]) for part, course in self.spent.items()}
        parts |= {part: self.rounds * seconds for part, seconds in self.once.items()}
        return parts | {"total": sum(parts.values())}

    @property
    def gain(self) -> float:
        """Number of times as fast the threads make the loops over grains."""
        return gain(self.machine, self.grains, self.threads)

    def until(self, time: float) -> dict[str, float]:
        """Wall-clock seconds of the loop's parts until `time` [s], of one round."""
        return {part: float(np.interp(time, self.time, course)) for part, course in self.spent.items()}

    def in_words(self) -> str:
        """One line: time by part, memory, disk, and what stands against them."""
        seconds = self.seconds
        parts = ", ".join(f"{part} {spoken(value)}" for part, value in seconds.items() if part != "total")
        threads = "one thread" if self.threads == 1 else f"{self.threads} threads"
        if self.replicas > 1:
            threads += f" for each of {self.replicas} replicas side by side"
        if self.rounds > 1:
            threads += f", in {self.rounds} rounds"
        each = " each" if self.replicas > 1 else ""
        text = (
            f"{self.steps} steps of {self.grains} grains: about {spoken(seconds['total'])} on {threads} ({parts}; "
            f"without compiling), {self.memory:.0f} MiB of memory{each}, {self.disk:.0f} MiB on disk; "
            f"{self.machine.in_words()}"
        )
        long = "more than a day; are all lengths and times in the units that were meant?"
        return with_warnings(text, shortage(self.replicas * self.memory), long if seconds["total"] > 86400.0 else "")


def predict(
    scene: Scene,
    device: Device,
    dt: float,
    rhythm: tuple[int, int, int],
    threads: int,
    machine: MachineSpeed | None = None,
) -> Cost:
    """The cost of a planned run on `threads` threads of a machine (None: the one at hand).

    `dt` is the grains' step [s]; `rhythm` are steps an update, updates a window and windows.
    """
    machine = machine or machine_speed()
    per_update, updates, windows = rhythm
    grains, window = device.fill.count, updates * per_update * dt
    magnetic = device.coil is not None or device.imposed is not None
    rates = np.empty((INSTANTS, 3))  # seconds a window
    time = windows * window / INSTANTS * np.arange(INSTANTS + 1)
    for k, middle in enumerate(0.5 * (time[1:] + time[:-1])):
        counts = counts_at(scene, device, float(middle), window)
        rates[k] = (
            costs.field_seconds(scene, device, counts) * machine.solves,
            updates * costs.update_seconds(scene, grains, counts) * machine.loops if magnetic else 0.0,
            updates * (costs.CALL_S + per_update * costs.step_seconds(scene, grains, counts)) * machine.loops,
        )
    count = replica_count(scene)
    replicas = replicas_side_by_side(count, threads)
    delay = machine.delay(replicas * threads)
    faster = gain(machine, grains, threads)
    rates *= delay / np.array([1.0, faster, faster])
    sums = np.vstack((np.zeros(3), np.cumsum(rates, axis=0))) * windows / INSTANTS
    spent = {part: sums[:, k] for k, part in enumerate(("field", "magnetic", "contact"))}
    alone = machine.delay(replicas)
    once = {
        "start": costs.start_seconds(scene, device) * machine.solves * alone,
        "output": costs.output_seconds(scene, grains, windows) * machine.loops * alone,
    }
    steps = windows * updates * per_update
    return Cost(
        time,
        spent,
        once,
        memory(scene, device, windows),
        disk(scene, device, windows),
        steps,
        grains,
        threads,
        replicas,
        machine,
        -(-count // replicas),
    )


def gain(machine: MachineSpeed, grains: int, threads: int) -> float:
    """Return the number of times as fast `threads` threads make the loops over so many grains; a few are not shared."""
    return machine.gain(threads) if grains >= WORTH_SHARING else 1.0


def memory(scene: Scene, device: Device, windows: int) -> float:
    """Memory [MiB] that a run holds at most, but for compiling; the history is read as a whole in the end."""
    count = device.fill.count
    kept = BASE_MIB + PICTURES_MIB * scene.output.pictures
    used = count * (GRAIN_BYTES + ROW_BYTES * neighbours(scene, device)) + windows * WINDOW_BYTES
    if device.coil is not None:
        each = UNKNOWN_BYTES if costs.is_of_revolution(device) else SOLID_UNKNOWN_BYTES
        kept, used = kept + FIELD_MIB, used + each * device.coil.problem.n_dofs
    return kept + used / 2**20


def disk(scene: Scene, device: Device, windows: int) -> float:
    """Disk [MiB] that a run's folder takes in the end."""
    output, count = scene.output, device.fill.count
    unknowns = 0 if device.coil is None else device.coil.problem.n_dofs
    frames = output.snapshots + 1
    used = frames * count * sum(FRAME_BYTES[kind] for kind in output.formats)
    used += windows * (HISTORY_BYTES + OBSERVABLES_BYTES * ("hdf5" in output.formats))
    used += frames * unknowns * FIELD_BYTES * ("vtk" in output.formats)
    used += (CHECKPOINT_BYTES * count + UNKNOWN_CHECKPOINT_BYTES * unknowns) * output.checkpoint
    return REST_MIB + used / 2**20


def spoken(seconds: float) -> str:
    """A duration in the unit that one would say it in."""
    for limit, unit, size in ((90.0, "s", 1.0), (5400.0, "min", 60.0), (172800.0, "h", 3600.0)):
        if seconds < limit:
            return f"{seconds / size:.0f} {unit}"
    return f"{seconds / 86400.0:.0f} days"
