"""The grains of a scene at the start: drawn, packed, and settled where the scene asks for it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from coupling.sheared_powder import grains_in_flow
from emclutch.scene.fill import diameters_of
from emclutch.scene.model import Scene
from geometry.device_shape import FilledSpace
from geometry.sheared_gap import ShearedGap
from geometry.walls import Wall
from particles import BoxTooDense, CyclicSector, GrainMotion, Grains, PackingError, ParticleError, ShearedBox
from particles.packing.file_packing import OVERLAP_LIMIT
from particles.packing.grown_packing import grown_packing
from particles.packing.lattice_packing import lattice_packing
from particles.packing.packing import Packing, require_fit
from particles.packing.periodic_packing import random_in_box
from particles.packing.poured_packing import poured_packing
from particles.packing.random_packing import random_packing
from particles.packing.settling import Settling, before_the_start, settle
from particles.packing.space import Space


def packed(scene: Scene, boxes: FilledSpace, walls: Sequence[Wall], count: int, sector: CyclicSector | None) -> Packing:
    """The packing of a scene (seeded).

    Raises
    ------
    PackingError
        If the grains do not fit.
    """
    particles, seed = scene.grains, scene.scene.seed
    space = Space.of(boxes, walls, sector)
    if particles.packing == "file":
        packing = particles.packing_in_file()
        require_fit(packing, space, OVERLAP_LIMIT)
        return packing
    radius = 0.5 * diameters_of(particles, count, seed)
    if particles.packing == "grow":
        return grown_packing(space, radius, seed=seed)
    if particles.packing == "lattice":
        return lattice_packing(space, radius, kind=particles.lattice, noise=particles.noise, seed=seed)
    if particles.packing == "pour":
        if scene.effects.weight is None:
            raise PackingError(f"particles.packing = 'pour' needs weight; add {scene.effects.tables(role='weight')}")
        return poured_packing(space, radius, up=-np.asarray(scene.effects.weight.vector), seed=seed)
    return random_packing(space, radius, seed=seed)


def grains_of(packing: Packing, density: float) -> Grains:
    """Grains in the places of a packing."""
    return Grains.create(
        packing.position,
        packing.radius,
        density,
        velocity=packing.velocity,
        angular_velocity=packing.angular_velocity,
    )


def sheared_between(packing: Packing, gap: ShearedGap, disc: float, rotor: float) -> Packing:
    """Set grains in motion as in a steady shear between disc and rotor, speeds about z [rad/s].

    Each spins with half the curl of the flow. Powder that begins at rest takes up this motion in a shear strain of
    about phi (I n)^2 P/tau, for n grains per gap at an inertial number I: momentum crosses a gap g in a time of
    phi rho g^2 rate/tau.
    """
    omega, curl = gap.speed(packing.position, disc, rotor)
    x, y, _ = packing.position.T
    velocity = np.column_stack([-omega * y, omega * x, np.zeros_like(x)])
    return replace(packing, velocity=velocity, angular_velocity=0.5 * curl)


def packed_in_flow(scene: Scene, box: ShearedBox, count: int) -> Grains:
    """Grains at random in a periodic box (seeded), which go with its flow.

    Raises
    ------
    PackingError
        If they cannot be pushed apart.
    """
    radius = 0.5 * diameters_of(scene.grains, count, scene.scene.seed)
    try:
        position = random_in_box(box, radius, seed=scene.scene.seed)
    except BoxTooDense as error:
        raise PackingError(str(error)) from error
    return grains_in_flow(box, position, radius, scene.grains.density)


def settled(scene: Scene, motion: GrainMotion) -> Settling | None:
    """Let the grains come to rest before time 0, shafts held and without magnetic forces; None where not asked for.

    Raises
    ------
    particles.packing.settling.NotAtRestError
        If they still move after the longest time.
    ParticleError
        By DVI, if more of the steps than contact.dvi.allowed_misses have missed the tolerance on the contacts.
    """
    particles = scene.grains
    if not particles.settles:
        return None
    with before_the_start(motion):
        found = settle(motion, kinetic=particles.settle_kinetic, longest=particles.settle_longest, required=True)
    if found.missed > scene.contact.dvi.allowed_misses:
        raise ParticleError(
            f"while the grains settled, {100.0 * found.missed:.3g} % of the steps missed the tolerance on the "
            "contacts; raise contact.dvi.max_sweeps or contact.dvi.tolerance, shorten contact.dvi.step, or allow more "
            "by contact.dvi.allowed_misses"
        )
    return found
