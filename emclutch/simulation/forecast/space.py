"""Estimated memory and disk of a run, in MiB; measured as resident sizes and folders of shipped cases."""

from __future__ import annotations

from typing import TYPE_CHECKING

from emclutch.simulation.forecast.free_memory import MIB

if TYPE_CHECKING:
    from emclutch.device.device import Device
    from emclutch.scene.model import Scene

# MiB of the program, of what a field and what pictures load (compiling takes some 200 more, once)
BASE_MIB, FIELD_MIB, PICTURES_MIB = 220.0, 110.0, 60.0
# Bytes in memory: a grain, one of its neighbours, an unknown of the field in the section and in 3D, a window's row
GRAIN, NEIGHBOUR, UNKNOWN, SOLID_UNKNOWN, WINDOW = 4000.0, 50.0, 4000.0, 5000.0, 2000.0
# Bytes on disk: a grain's frame in each format, an unknown's; a row of the history, and in the record; a grain and an
# unknown of the checkpoint; the rest
FRAME = {"vtk": 260.0, "hdf5": 120.0}
FIELD_FRAME, HISTORY, RECORD, CHECKPOINT, UNKNOWN_CHECKPOINT, REST_MIB = 39.0, 800.0, 1200.0, 1200.0, 30.0, 3.0


def memory(scene: Scene, device: Device, windows: int) -> float:
    """Memory [MiB] that a run holds at most, but for compiling; the history is read as a whole in the end."""
    neighbours = sum(one.neighbours(scene, device) for one in scene.effects.present)
    kept = BASE_MIB + PICTURES_MIB * scene.output.pictures
    used = device.fill.count * (GRAIN + NEIGHBOUR * neighbours) + windows * WINDOW
    if device.coil is not None:
        kept += FIELD_MIB
        used += (SOLID_UNKNOWN if device.section_coil is None else UNKNOWN) * device.coil.problem.n_dofs
    return kept + used / MIB


def disk(scene: Scene, device: Device, windows: int) -> float:
    """Disk [MiB] that a run's folder takes in the end."""
    output, count = scene.output, device.fill.count
    unknowns = 0 if device.coil is None else device.coil.problem.n_dofs
    frames = output.snapshots + 1
    used = frames * count * sum(FRAME[kind] for kind in output.formats)
    used += windows * (HISTORY + RECORD * ("hdf5" in output.formats))
    used += frames * unknowns * FIELD_FRAME * ("vtk" in output.formats)
    used += (CHECKPOINT * count + UNKNOWN_CHECKPOINT * unknowns) * output.checkpoint
    return REST_MIB + used / MIB
