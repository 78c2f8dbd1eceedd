"""Number of replicas of a scene, and their seeds."""

from __future__ import annotations

import os
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from emclutch.scene.model import Scene

AUTOMATIC = 4
"""Replicas of a steady torque at the least: Student's t of three degrees of freedom is the first of a useful width."""

WITH_KNOWN_SCATTER = 2
"""The same of a run with `time.until` whose scene knows the scatter between replicas: t has more degrees of freedom."""
DOUBTFUL_FREEDOM = 3
"""Degrees of freedom up to which a known scatter may be of other conditions: a run begins with `AUTOMATIC` replicas."""


def replica_count(scene: Scene) -> int:
    """Number of replicas that the scene asks for; where it does not, with how many a run begins."""
    return automatic_count(scene) if scene.accuracy.replicas is None else scene.accuracy.replicas


def max_replica_count(scene: Scene) -> int:
    """Return the largest number of replicas of a run with `time.until`."""
    count = replica_count(scene)
    return max(count, scene.accuracy.max_replicas) if scene.accuracy.replicas is None and count > 1 else count


def automatic_count(scene: Scene) -> int:
    """Replicas of a scene that does not say how many: 1 where no torque is steady, or no packing random.

    Else `AUTOMATIC`, or `WITH_KNOWN_SCATTER`.
    """
    if not has_steady_torque(scene) or packs_alike(scene):
        return 1
    is_known = scene.span.until is not None and (scene.accuracy.replica_scatter_freedom or 0) > DOUBTFUL_FREEDOM
    return WITH_KNOWN_SCATTER if is_known else AUTOMATIC


def replicas_side_by_side(count: int, threads: int) -> int:
    """Number of replicas that run concurrently."""
    return max(1, min(count, cores_at_hand() // max(1, threads)))


def cores_at_hand() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def has_steady_torque(scene: Scene) -> bool:
    """True if current and speeds are constant from the start on, so that a torque comes to a steady mean.

    In a periodic box it is a stress that does.
    """
    if scene.geometry.is_periodic:
        return True
    shafts = (scene.motion.rotor, scene.motion.disc)
    coil = scene.coil
    drive = None if coil is None else coil.voltage if coil.current is None else coil.current
    return (
        scene.geometry.has_axis
        and all(shaft.speed is not None and shaft.speed.is_constant for shaft in shafts)
        and scene.effects.circuit is None
        and (drive is None or drive.is_constant)
    )


def packs_alike(scene: Scene) -> bool:
    """True if the seed has no part in where the grains begin."""
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
