"""What a scene of rigid grains (contact.method = 'dvi') starts from: contact, step and solver, each with its reason."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi

import numpy as np

from coupling import pair_attraction
from emclutch.scene.model import Scene
from particles import DviContact, RollingFriction, TwistingFriction, choose_dvi_step

TOLERANCE = 1e-4  # of the largest speed to be expected
LEAST_TOLERANCE = 1e-7  # [m/s]
LEAST_THRESHOLD = 1e-3  # [m/s], of restitution


@dataclass(frozen=True, slots=True)
class DviPlan:
    """Contact and solver of rigid grains.

    Attributes
    ----------
    contact : DviContact
    rolling : RollingFriction or None
    twisting : TwistingFriction or None
    tolerance : float
        On the natural map [m/s].
    stiffness : ndarray, shape (2, 2), or None
        [[k_n, k_t] between grains, [k_n, k_t] at walls] [N/m] of contacts that give way.
    """

    contact: DviContact
    rolling: RollingFriction | None
    twisting: TwistingFriction | None
    tolerance: float
    stiffness: np.ndarray | None


def plan_dvi(
    scene: Scene, M_max: float, speed: float, stiffness: np.ndarray | None, reasons: dict[str, str]
) -> tuple[DviPlan, float]:
    """Decide contact and solver of the scene, and the step [s].

    Parameters
    ----------
    M_max : float
        Largest magnetisation of a grain to be expected [A/m].
    speed : float
        Largest speed to be expected [m/s].
    stiffness : ndarray, shape (2, 2), or None
        Of contacts that give way [N/m].
    reasons : dict
        Gets a line for each decision.

    Raises
    ------
    ValueError
        If the step asked for is longer than the rules allow and is not insisted upon, or none follows.
    """
    section, contact, particles = scene.contact.dvi, scene.contact, scene.grains
    lightest = particles.density * pi / 6.0 * particles.smallest_diameter**3
    step = choose_dvi_step(
        lightest,
        0.5 * particles.smallest_diameter,
        speed=speed,
        attraction=pair_attraction(M_max, particles.smallest_diameter),
        dt=scene.span.step if section.step is None else section.step,
        allow_long_step=section.allow_long_step,
    )
    gravity = scene.effects.gravity
    threshold = section.threshold
    if threshold is None:
        pull = 0.0 if gravity is None else float(np.linalg.norm(gravity.vector))
        threshold = max(2.0 * step.dt * pull, LEAST_THRESHOLD)
    tolerance = max(TOLERANCE * speed, LEAST_TOLERANCE) if section.tolerance is None else section.tolerance
    law = {"coulomb": "exact Coulomb friction", "convex": "the convex cone"}[section.friction_law]
    reasons["contact"] = f"rigid grains, {law}; " + (
        "stiffness and contact law are not used"
        if stiffness is None
        else f"contacts give way by springs of {stiffness[0, 0]:.3g} N/m"
        + ("" if stiffness[0, 0] == stiffness[1, 0] else f", {stiffness[1, 0]:.3g} N/m at walls")
        + ", taken implicitly"
    )
    reasons["time step"] = step.reason
    reasons["solver"] = (
        f"{section.solver}: to {tolerance:.3g} m/s on the natural map"
        + ("" if section.tolerance is not None else f", {TOLERANCE:g} of the speed expected")
        + f", at most {section.max_sweeps} sweeps a step; nothing rebounds below {threshold:.3g} m/s"
    )
    rigid = DviContact(
        contact.friction,
        contact.restitution,
        contact.friction_at_walls,
        contact.wall_restitution,
        threshold=threshold,
    )
    rolls, twists = scene.effects.rolling_friction, scene.effects.twisting_friction
    rolling = None if rolls is None else RollingFriction(rolls.coefficient, rolls.wall_coefficient)
    twisting = None if twists is None else TwistingFriction(twists.coefficient, twists.wall_coefficient)
    return DviPlan(rigid, rolling, twisting, tolerance, stiffness), step.dt
