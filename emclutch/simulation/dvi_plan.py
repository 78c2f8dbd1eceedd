"""Plan of a scene by DVI (contact.method = 'dvi'), rigid or on springs: contact, step and solver."""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt
from typing import ClassVar, NamedTuple

import numpy as np

from coupling import neck_pull, pair_attraction, pair_work
from emclutch.device_model.materials import grain_law
from emclutch.scene.model import Scene
from emclutch.simulation.stiffness import Stiffness
from particles import Cohesion, DviContact, RollingFriction, TwistingFriction, choose_dvi_step
from particles.dem.time_step import TimeStep
from particles.dvi.dvi_step import parting_time

TOLERANCE = 1e-4
"""Of the slip speed: a chain of a hundred grains between the walls closes by at most 1 % of it, see the tests of
`tests/dvi/test_apparent_elasticity.py`: each of its contacts by the tolerance."""
MIN_TOLERANCE = 1e-7  # [m/s]
MIN_THRESHOLD = 1e-3  # [m/s], of restitution


class Pull(NamedTuple):
    """Attraction of two grains that touch [N], the work [J] of parting them, and what attracts."""

    force: float
    work: float
    source: str


@dataclass(frozen=True, slots=True)
class RigidContacts:
    """Contacts of rigid grains, by DVI, and their solver.

    Attributes
    ----------
    contact : DviContact
    rolling : RollingFriction or None
    twisting : TwistingFriction or None
    cohesion : Cohesion or None
    tolerance : float
        On the natural map [m/s].
    step : TimeStep
    parting_time : float or None
        In which two magnetised grains that touch part [s] (`particles.dvi.dvi_step.parting_time`).
    springs : ndarray, shape (2, 2), or None
        [[k_n, k_t] between grains, [k_n, k_t] at walls] [N/m] of compliant contacts.
    stiffness : Stiffness or None
        What the springs follow from.
    """

    contact: DviContact
    rolling: RollingFriction | None
    twisting: TwistingFriction | None
    cohesion: Cohesion | None
    tolerance: float
    step: TimeStep
    parting_time: float | None = None
    springs: np.ndarray | None = None
    stiffness: Stiffness | None = None
    method: ClassVar[str] = "dvi"

    @property
    def normal_stiffness(self) -> float | None:
        """Between grains [N/m]; None of rigid ones."""
        return None if self.springs is None else float(self.springs[0, 0])


def rigid_contacts(
    scene: Scene, M_max: float, speed: float, slip: float, springs: tuple[np.ndarray, Stiffness] | None
) -> RigidContacts:
    """Decide contact, step and solver of the scene.

    Parameters
    ----------
    M_max : float
        Largest magnetisation of a grain to be expected [A/m].
    speed : float
        Largest speed to be expected [m/s].
    slip : float
        Of the walls past each other [m/s], `emclutch.simulation.forecast.expected_speeds.slip_speed`.
    springs : tuple, or None
        Of compliant contacts, see `emclutch.simulation.contact_plan.dvi_springs`.

    Raises
    ------
    ValueError
        If the step asked for is longer than the rules allow and is not allowed by `allow_long_step`, or none follows.
    """
    section, contact, particles = scene.contact.dvi, scene.contact, scene.grains
    terms, radius = scene.effects.contact_terms(), 0.5 * particles.smallest_diameter
    cohesion = terms.get("cohesion")
    adhesion = 0.0 if cohesion is None else float((cohesion.table() @ (1.0, radius)).max())
    magnetic, mass = _magnetic_pull(scene, M_max), particles.density * pi / 6.0 * particles.smallest_diameter**3
    pulls = [one for one in (magnetic, Pull(adhesion, adhesion * radius, "cohesion")) if one.force]
    strongest = max(pulls, key=lambda one: one.force / sqrt(one.work), default=Pull(0.0, 1.0, "nothing"))
    barostat = scene.geometry.barostat(scene)
    given, longest = scene.span.step if section.step is None else section.step, scene.span.longest_step
    if given is not None and given > longest * (1.0 + 1e-9):
        key = "time.step" if section.step is None else "contact.dvi.step"
        raise ValueError(
            f"{key} = {given:g} s is longer than the coupling window or the run; allowed: at most {longest:.3g} s; "
            "lower it, or leave it out"
        )
    step = choose_dvi_step(
        mass,
        radius,
        speed=speed,
        attraction=strongest.force,
        work=strongest.work,
        source=strongest.source,
        pressure=0.0 if barostat is None else barostat.pressure,
        longest=longest,
        dt=given,
        allow_long_step=section.allow_long_step,
    )
    weight = scene.effects.weight
    threshold = section.threshold
    if threshold is None:
        pull = 0.0 if weight is None else float(np.linalg.norm(weight.vector))
        threshold = max(2.0 * step.dt * pull, MIN_THRESHOLD)
    tolerance = max(TOLERANCE * slip, MIN_TOLERANCE) if section.tolerance is None else section.tolerance
    rigid = DviContact(
        contact.friction,
        contact.restitution,
        contact.friction_at_walls,
        contact.wall_restitution,
        threshold=threshold,
    )
    spring_table, stiffness = (None, None) if springs is None else springs
    resist = terms.get("rolling"), terms.get("twisting")
    parting = parting_time(mass, magnetic.force, magnetic.work) if magnetic.force else None
    return RigidContacts(rigid, *resist, cohesion, tolerance, step, parting, spring_table, stiffness)


def _magnetic_pull(scene: Scene, M: float) -> Pull:
    """Attraction of two of the smallest grains, magnetised to M [A/m]."""
    d, attraction, at = scene.grains.smallest_diameter, scene.effects.attraction, f"magnetised to {M / 1e3:.3g} kA/m"
    if M > 0.0 and attraction is not None and attraction.has_necks:
        return Pull(*neck_pull(grain_law(scene), M, d, attraction.surface_gap), f"necks between grains {at}")
    return Pull(pair_attraction(M, d), pair_work(M, d), f"grains {at}")
