"""How many replicas of a scene are run, and which seed each has."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

from emclutch.scene.time_table import TimeTable

if TYPE_CHECKING:
    from emclutch.scene.model import Scene


def replica_count(scene: Scene) -> int:
    """What the scene asks for; where it asks for nothing, what suits the machine and the scene."""
    return automatic_count(scene) if scene.accuracy.replicas is None else scene.accuracy.replicas


def automatic_count(scene: Scene) -> int:
    """As many as cores, at least 2, for a steady torque of grains that are packed at random; else 1."""
    if not has_steady_torque(scene) or packs_alike(scene):
        return 1
    return max(2, len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 2)


def has_steady_torque(scene: Scene) -> bool:
    """Whether current and speeds are constant from the start on, so that a torque comes to a steady mean."""
    shafts = (scene.motion.rotor, scene.motion.disc)
    coil = scene.coil
    drive = None if coil is None else coil.voltage if coil.current is None else coil.current
    return (
        scene.geometry.has_axis
        and all(shaft.free is None and not isinstance(shaft.speed, TimeTable) for shaft in shafts)
        and scene.effects.coil_circuit is None
        and not isinstance(drive, TimeTable)
    )


def packs_alike(scene: Scene) -> bool:
    """Whether the seed has no part in where the grains begin."""
    particles = scene.grains
    if particles.packing == "file":
        return True
    return particles.packing == "lattice" and particles.noise == 0.0 and particles.sizes is None


def replica_seed(seed: int, number: int) -> int:
    """Seed of a replica; the first has the scene's own, the others are unlike those that a study may list.

    They come from NumPy's SeedSequence, whose streams are independent, and are whole numbers in any reader of JSON.
    """
    if number == 0:
        return seed
    import numpy as np

    return int(np.random.SeedSequence([seed, number]).generate_state(1, np.uint64)[0] >> 12)
