"""The contact's stiffness and the grains' step, from what will load the contacts."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from math import pi
from typing import ClassVar

import numpy as np

from coupling import magnetic_load, snap_in_overlap
from emclutch.device_model.device import Device
from emclutch.effects.effect import Load
from emclutch.scene.contact import ContactSection
from emclutch.scene.grains import ParticlesSection
from emclutch.simulation.contacts_in_words import load_in_words
from emclutch.simulation.forecast.expected_speeds import impact_speed
from emclutch.simulation.stiffness import Stiffness
from particles import PairLaws, choose_time_step
from particles.dem.overlap_limits import SOFT, STOPS
from particles.dem.time_step import StepTooLong, TimeStep


@dataclass(frozen=True, slots=True)
class ElasticContacts:
    """Contacts of grains that press in, by DEM.

    Attributes
    ----------
    laws : PairLaws
    step : TimeStep
    stiffness : Stiffness
    """

    laws: PairLaws
    step: TimeStep
    stiffness: Stiffness
    method: ClassVar[str] = "dem"

    @property
    def normal_stiffness(self) -> float:
        """Between grains [N/m]."""
        return self.stiffness.value


def elastic_contacts(scene, device: Device, M_max: float, speed: float) -> ElasticContacts:
    """The laws of all contacts and the step by DEM; largest magnetisation [A/m] and speed [m/s] to be expected."""
    particles = scene.particles
    laws, stiffness = contacts_under_load(scene, device, M_max, impact_speed(scene, device, speed))
    lightest = particles.density * pi / 6.0 * particles.smallest_diameter**3
    try:
        step = choose_time_step(
            laws,
            lightest,
            0.5 * particles.smallest_diameter,
            speed=speed,
            load=stiffness.load.force,
            rolling="rolling" in scene.effects.contact_terms(),
            steps_per_contact=scene.span.steps_per_contact,
            longest=scene.span.longest_step,
            dt=scene.span.step,
        )
    except StepTooLong as error:
        raise ValueError(error.text("time.step")) from None
    return ElasticContacts(laws, step, stiffness)


def dvi_springs(scene, device: Device, M_max: float, speed: float) -> tuple[np.ndarray, Stiffness] | None:
    """Springs of compliant contacts, and what they follow from; None for grains without.

    The springs are [[k_n, k_t] between grains, [k_n, k_t] at walls] [N/m]; of a law that is not linear, the stiffness
    at the largest overlap to be expected.
    """
    if not scene.contact.dvi.springs:
        return None
    if scene.contact.tangential_ratio == 0.0:
        raise ValueError("contact.tangential_ratio = 0; with contact.dvi.springs it must be more than 0")
    hit = impact_speed(scene, device, speed)
    pairs, stiffness = contacts_under_load(scene, device, M_max, hit)
    d = scene.particles.largest_diameter
    mass = scene.particles.density * pi / 6.0 * d**3
    ratio = 2.0 / 7.0 if scene.contact.tangential_ratio is None else scene.contact.tangential_ratio
    springs = np.empty((2, 2))
    for row, law, m_eff, r_eff in zip(springs, pairs.laws, (0.5 * mass, mass), (0.25 * d, 0.5 * d), strict=True):
        k = law.stiffness_at(law.overlap_under(stiffness.load.force, m_eff, hit, r_eff), r_eff)
        row[:] = k, ratio * k
    return springs, stiffness


def contacts_under_load(scene, device: Device, M_max: float, speed: float) -> tuple[PairLaws, Stiffness]:
    """The laws of all contacts, and their stiffness; magnetisation [A/m] and speed of impacts [m/s] to be expected.

    ValueError where nothing says how stiff they are, or they are so soft that a run would stop.
    """
    particles, contact, attraction = scene.particles, scene.contact, scene.effects.attraction
    d = particles.largest_diameter  # overlap / diameter grows with the size under every load
    mass = particles.density * pi / 6.0 * d**3
    chained = M_max if attraction is None else attraction.magnetisation_in_chains(scene, M_max)
    neck = 0.0 if attraction is None else attraction.neck_stiffness(scene)
    load = max(_loads(scene, device, M_max, chained), key=lambda load: load.force)
    if contact.needs_a_load and load.force <= 0.0 and speed <= 0.0:
        raise ValueError(
            "nothing loads the contacts (no weight, no magnetism, no motion), so no stiffness follows; "
            f"give {contact.stiffness_entry}"
        )
    between, at_walls = contact.laws(mass=mass, diameter=d, force=load.force, speed=speed)

    def overlap_of(chosen: ContactSection) -> float:
        return largest_overlap(chosen, particles, load.force, speed)

    if overlap_of(contact) > STOPS:
        raise ValueError(_too_soft(contact, overlap_of, load_in_words(load, speed)))
    deepest = overlap_of(contact) * d
    value = between.stiffness_at(deepest, 0.25 * d)
    snap = snap_in_overlap(chained, d, value) if M_max > 0.0 else None
    stiffness = Stiffness(value, not contact.needs_a_load, contact.law, deepest / d, load, speed, snap, neck)
    return PairLaws.of_one(between, at_walls=at_walls, **scene.effects.contact_terms()), stiffness


def largest_overlap(contact: ContactSection, particles: ParticlesSection, force: float, speed: float) -> float:
    """Return the overlap of the largest grains over their diameter under a load [N] and an impact [m/s]."""
    d = particles.largest_diameter
    mass = particles.density * pi / 6.0 * d**3
    inner, outer = contact.laws(mass=mass, diameter=d, force=force, speed=speed)
    return (
        max(inner.overlap_under(force, 0.5 * mass, speed, 0.25 * d), outer.overlap_under(force, mass, speed, 0.5 * d))
        / d
    )


def _loads(scene, device: Device, M_max: float, chained: float) -> Iterator[Load]:
    """Everything that presses grains together, each at its largest."""
    force = magnetic_load(chained, scene.particles.largest_diameter)
    yield Load("magnetism", force, f"grains magnetised to {chained / 1e3:.3g} kA/m")
    yield from device.kind.loads(scene)
    for one in scene.effects.present:
        yield from one.loads(scene, device, M_max)


def _too_soft(contact: ContactSection, overlap: Callable[[ContactSection], float], why: str) -> str:
    """Message for a stiffness with which the run would stop; `overlap` over the diameter."""
    key, unit = contact.stiffness_entry.name, contact.stiffness_entry.unit
    given = {name: value for name in (key, f"wall_{key}") if (value := getattr(contact, name)) is not None}
    factor = 1.0
    while overlap(contact.model_copy(update={name: factor * v for name, v in given.items()})) > SOFT and factor < 1e12:
        factor *= 1.25
    given_by = " and ".join(f"contact.{name} = {value:.4g} {unit}" for name, value in given.items())
    higher = " and ".join(f"'{factor * value:.2g} {unit}'" for value in given.values())
    return (
        f"{given_by} is too soft: grains overlap by {100 * overlap(contact):.3g} % of the diameter (limit "
        f"{100 * STOPS:g} %) under {why}. Raise it to about {higher}, or leave it out: it then follows from "
        f"contact.max_overlap = {contact.max_overlap:g}"
    )
