"""The contact's stiffness and the grains' step, from what will load the contacts."""

from __future__ import annotations

from collections.abc import Callable
from math import pi

import numpy as np

from coupling import chain_magnetisation, magnetic_load, neck_load, neck_stiffness, snap_in_overlap, weight_load
from emclutch.device.device import Device
from emclutch.device.materials import grain_law
from emclutch.scene.contact import ContactSection
from emclutch.simulation.forecast.expected_speeds import impact_speed
from geometry import Box
from particles import PairLaws, RollingFriction, TwistingFriction, choose_time_step
from particles.dem.overlap_limits import SOFT, STOPS

NECK_MARGIN = 10.0  # of a contact's stiffness over the negative one of its neck


def elastic_contacts(
    scene, device: Device, M_max: float, speed: float, reasons: dict[str, str]
) -> tuple[PairLaws, float, float]:
    """The laws of all contacts, the step [s] by DEM, and the stiffness between grains [N/m]."""
    particles = scene.particles
    contact, load, stiffness = _contact(scene, device, M_max, impact_speed(scene, device, speed), reasons)
    lightest = particles.density * pi / 6.0 * particles.smallest_diameter**3
    try:
        step = choose_time_step(
            contact,
            lightest,
            0.5 * particles.smallest_diameter,
            speed=speed,
            load=load,
            rolling=scene.effects.rolling_friction is not None,
            steps_per_contact=scene.span.steps_per_contact,
            dt=scene.span.step,
        )
    except ValueError as error:
        raise ValueError(str(error).replace("dt =", "time.step =", 1)) from None
    reasons["time step"] = step.reason
    return contact, step.dt, stiffness


def dvi_springs(scene, device: Device, M_max: float, speed: float, reasons: dict[str, str]) -> np.ndarray | None:
    """[[k_n, k_t] between grains, [k_n, k_t] at walls] [N/m] of rigid grains that give way, None for rigid ones.

    Of a law that is not linear, the stiffness at the largest overlap to be expected.
    """
    if not scene.contact.dvi.springs:
        return None
    if scene.contact.tangential_ratio == 0.0:
        raise ValueError("contact.tangential_ratio = 0; with contact.dvi.springs it must be more than 0")
    hit = impact_speed(scene, device, speed)
    pairs, force, _ = _contact(scene, device, M_max, hit, reasons)
    d = scene.particles.largest_diameter
    mass = scene.particles.density * pi / 6.0 * d**3
    ratio = 2.0 / 7.0 if scene.contact.tangential_ratio is None else scene.contact.tangential_ratio
    stiffness = np.empty((2, 2))
    for row, law, m_eff, r_eff in zip(stiffness, pairs.laws, (0.5 * mass, mass), (0.25 * d, 0.5 * d), strict=True):
        k = law.stiffness_at(law.overlap_under(force, m_eff, hit, r_eff), r_eff)
        row[:] = k, ratio * k
    return stiffness


def _contact(
    scene, device: Device, M_max: float, speed: float, reasons: dict[str, str]
) -> tuple[PairLaws, float, float]:
    """The laws of all contacts, the largest force on one that is to be expected [N], and the stiffness then [N/m]."""
    particles, contact = scene.particles, scene.contact
    d = particles.largest_diameter  # overlap / diameter grows with the size under every load
    mass = particles.density * pi / 6.0 * d**3
    model = None if scene.effects.dipoles is None else scene.effects.dipoles.model
    chained = chain_magnetisation(grain_law(scene), M_max) if model == "mutual" and M_max > 0.0 else M_max
    loads = {f"grains magnetised to {chained / 1e3:.3g} kA/m": magnetic_load(chained, d)}
    neck = 0.0
    if model == "near_field":
        grains = grain_law(scene)
        neck = neck_stiffness(grains, d, at_walls=scene.effects.wall_images is not None)
        loads[f"necks between grains magnetised to {M_max / 1e3:.3g} kA/m"] = neck_load(
            grains, M_max, d, scene.effects.dipoles.surface_gap
        )
        if contact.needs_a_load:  # so stiff that no neck pulls a contact in by itself
            least = NECK_MARGIN * neck * contact.max_overlap * d
            loads[f"{NECK_MARGIN:g} times the stiffness of saturated necks, {neck:.3g} N/m,"] = least
    if scene.effects.gravity is not None:
        height = device.shape.size[2] if isinstance(device.shape, Box) else 2.0 * device.largest_radius
        loads["the weight of the bed"] = weight_load(particles.density, scene.effects.gravity.acceleration, height, d)
    if scene.effects.cohesion is not None:
        pull = scene.effects.cohesion.law().table()
        loads["cohesion"] = float(max(pull[0] @ (1.0, 0.25 * d), pull[1] @ (1.0, 0.5 * d)))
    cause, force = max(loads.items(), key=lambda item: item[1])
    loaded = f"{force:.3g} N from {cause}" if force > 0.0 else ""
    hit = f"impacts at {speed:.3g} m/s" if speed > 0.0 else ""
    why = " and ".join(filter(None, (loaded, hit)))
    effects = scene.effects
    if not why and contact.needs_a_load:
        raise ValueError(
            "nothing loads the contacts (no weight, no magnetism, no motion), so no stiffness follows; "
            f"give {contact.stiffness_key}"
        )
    between, at_walls = contact.laws(mass=mass, diameter=d, force=force, speed=speed)

    def deepest_of(chosen: ContactSection) -> float:
        inner, outer = chosen.laws(mass=mass, diameter=d, force=force, speed=speed)
        return max(
            inner.overlap_under(force, 0.5 * mass, speed, 0.25 * d), outer.overlap_under(force, mass, speed, 0.5 * d)
        )

    deepest = deepest_of(contact)
    if deepest > STOPS * d:
        raise ValueError(_too_soft(contact, lambda chosen: deepest_of(chosen) / d, why))
    stiffness = between.stiffness_at(deepest, 0.25 * d)
    overlap = f"overlap {100 * deepest / d:.2g} % of the diameter" + (f" under {why}" if why else "")
    asked = "" if contact.needs_a_load else " as asked"
    kind = "" if contact.law == "linear" else f"law {contact.law}, at that overlap "
    reasons["stiffness"] = f"{kind}k_n = {stiffness:.3g} N/m{asked}: {overlap}"
    if M_max > 0.0:
        snap = snap_in_overlap(chained, d, stiffness)
        reasons["stiffness"] += f"; grains that snap together from afar press in by {100 * snap:.2g} % for an instant"
    if stiffness < 0.999 * NECK_MARGIN * neck:
        reasons["stiffness"] += (
            f"; WARNING: less than {NECK_MARGIN:g} times the negative stiffness of saturated necks, {neck:.3g} N/m: "
            "contacts close by more than their overlap says"
        )
    if deepest > SOFT * d:
        reasons["stiffness"] += f"; WARNING: above {100 * SOFT:g} % grains are too soft for peaks of the torque"
    rolls, twists = effects.rolling_friction, effects.twisting_friction
    rolling = None if rolls is None else RollingFriction(rolls.coefficient, rolls.wall_coefficient)
    twisting = None if twists is None else TwistingFriction(twists.coefficient, twists.wall_coefficient)
    cohesion = None if effects.cohesion is None else effects.cohesion.law()
    laws = PairLaws.of_one(between, at_walls=at_walls, rolling=rolling, twisting=twisting, cohesion=cohesion)
    return laws, force, stiffness


def _too_soft(contact: ContactSection, overlap: Callable[[ContactSection], float], why: str) -> str:
    """What is said of a stiffness with which the run would stop; `overlap` over the diameter."""
    key = contact.stiffness_key.partition(",")[0].removeprefix("contact.")
    unit = {"hertz_stiffness": "N/m^1.5", "youngs_modulus": "Pa"}.get(key, "N/m")
    given = {name: value for name in (key, f"wall_{key}") if (value := getattr(contact, name)) is not None}
    factor = 1.0
    while overlap(contact.model_copy(update={name: factor * v for name, v in given.items()})) > SOFT and factor < 1e12:
        factor *= 1.25
    told = " and ".join(f"contact.{name} = {value:.4g} {unit}" for name, value in given.items())
    higher = " and ".join(f"'{factor * value:.2g} {unit}'" for value in given.values())
    return (
        f"{told} is too soft: grains would overlap by {100 * overlap(contact):.2g} % of the diameter under {why}, and "
        f"a run stops at {100 * STOPS:g} %; raise it to about {higher}, or leave it out: it then follows from "
        f"contact.max_overlap = {contact.max_overlap:g}"
    )
