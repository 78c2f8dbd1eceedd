"""What a scene of rigid grains (contact.method = 'dvi') starts from: contact, step and solver, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import TYPE_CHECKING

import numpy as np

from coupling import pair_attraction
from emclutch.scene.model import Scene
from particles import RigidContact, choose_rigid_step

if TYPE_CHECKING:
    from emclutch.device import Device

TOLERANCE = 1e-4  # of the largest speed to be expected
LEAST_TOLERANCE = 1e-7  # [m/s]
LEAST_THRESHOLD = 1e-3  # [m/s], of restitution


@dataclass(frozen=True, slots=True)
class RigidPlan:
    """Contact and solver of rigid grains.

    Attributes
    ----------
    contact : RigidContact
    tolerance : float
        On the natural map [m/s].
    """

    contact: RigidContact
    tolerance: float


def plan_rigid(
    scene: Scene, device: Device, M_max: float, speed: float, reasons: dict[str, str]
) -> tuple[RigidPlan, float]:
    """Decide contact and solver of the scene, and the step [s].

    Parameters
    ----------
    M_max : float
        Largest magnetisation of a grain to be expected [A/m].
    speed : float
        Largest speed to be expected [m/s].
    reasons : dict
        Gets a line for each decision.

    Raises
    ------
    ValueError
        If the step asked for is longer than the rules allow and is not insisted upon, or none follows.
    """
    section, contact, particles = scene.contact.dvi, scene.contact, scene.particles
    lightest = particles.density * pi / 6.0 * particles.smallest_diameter**3
    step = choose_rigid_step(
        lightest,
        0.5 * particles.smallest_diameter,
        speed=speed,
        attraction=pair_attraction(M_max, particles.smallest_diameter),
        dt=scene.time.step if section.step is None else section.step,
        insist=section.insist,
    )
    gravity = scene.effects.gravity
    threshold = section.threshold
    if threshold is None:
        pull = 0.0 if gravity is None else float(np.linalg.norm(gravity.vector))
        threshold = max(2.0 * step.dt * pull, LEAST_THRESHOLD)
    tolerance = max(TOLERANCE * speed, LEAST_TOLERANCE) if section.tolerance is None else section.tolerance
    law = {"coulomb": "exact Coulomb friction", "convex": "the convex cone"}[section.friction_law]
    reasons["contact"] = f"rigid grains, {law}; stiffness and contact law are not used"
    reasons["time step"] = step.reason
    reasons["solver"] = (
        f"{section.solver}: to {tolerance:.3g} m/s on the natural map"
        + ("" if section.tolerance is not None else f", {TOLERANCE:g} of the speed expected")
        + f", at most {section.max_sweeps} sweeps a step; nothing rebounds below {threshold:.3g} m/s"
    )
    rigid = RigidContact(
        contact.friction,
        contact.restitution,
        contact.friction_at_walls,
        contact.wall_restitution,
        threshold=threshold,
    )
    return RigidPlan(rigid, tolerance), step.dt
