"""Grains of a finished run as the beginning of another one, in place of a packing.

What is taken over is what the grains and their contacts remember: positions, velocities, spins, the springs of the
contacts that touch, and how far the walls have turned. All else is the new run's: its law of contact with its
stiffness, step, field, moments, shafts, and its time, which begins at 0.

A contact's stiffness follows from the load that is expected, so that its overlap does not: the overlaps of one current
carry the load of another one from the first step on. Rigid contacts (DVI) remember nothing that outlasts a step.
"""

from __future__ import annotations

import hashlib
import logging
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from coupling import Simulation
from emclutch.results import OutputError, RunFolder
from emclutch.scene.case import Case
from emclutch.scene.flat import differing_keys, flat_scene
from emclutch.simulation.assembly import simulation_of
from emclutch.simulation.resume import checkpoint_time, may_change, refuse_changed_files, run_checkpoint
from particles import Grains

log = logging.getLogger(__name__)
OF_THE_DRIVE = ("coil.", "motion.", "time.", "accuracy.inertial_number")
"""Keys that leave grains, device and contacts what they are; those that a continued run may change do so too."""


@dataclass(frozen=True, slots=True)
class StartingGrains:
    """Grains that a run begins with.

    Attributes
    ----------
    folder : of the run that they come from.
    time : of that run [s].
    sha256 : of its checkpoint.
    state : of its DEM or DVI.
    """

    folder: Path
    time: float
    sha256: str
    state: dict[str, np.ndarray]

    def as_dict(self) -> dict[str, Any]:
        """Origin of the grains, for ``provenance.json``."""
        return {"folder": str(self.folder), "time": self.time, "checkpoint_sha256": self.sha256}


def starting_grains(case: Case, folder: str | Path) -> StartingGrains:
    """The grains at the end of the run in `folder`, for `case`.

    Raises
    ------
    OutputError
        It has no checkpoint; or its scene or its input files make other grains, another device or other contacts.
    """
    run = RunFolder(folder)
    if not run.checkpoint.is_file():
        raise OutputError(
            f"no grains to start from in {folder}: it has no {run.checkpoint.name}; run it to its end with "
            "output.checkpoint = true, or start without its grains"
        )
    state = run_checkpoint(run.checkpoint)
    old, new = flat_scene(state["case"]), flat_scene(case.toml())
    others = [key for key in differing_keys(old, new) if not (may_change(key) or key.startswith(OF_THE_DRIVE))]
    if others:
        shown = "; ".join(f"{key}: {old.get(key, 'absent')} -> {new.get(key, 'absent')}" for key in others)
        raise OutputError(
            f"the grains of {folder} are of another scene ({shown}); a run may start from grains of other [coil], "
            "[motion] and [time] only: start it without them"
        )
    refuse_changed_files(case, run)
    with run.checkpoint.open("rb") as stream:
        digest = hashlib.file_digest(stream, "sha256").hexdigest()
    dem = state["dem"]
    return StartingGrains(run.path, checkpoint_time(run.checkpoint, dem, case.scene.contact.method), digest, dem)


def warm_started(device, plan, start: StartingGrains) -> Simulation:
    """The simulation at time 0 around the grains of another run; they are neither packed nor settled."""
    simulation = simulation_of(device, plan, Grains.of_records(start.state))
    simulation.motion.begin_with(start.state)
    log.info("%d grains of %s at its t = %g s", simulation.motion.grains.count, start.folder, start.time)
    return simulation
