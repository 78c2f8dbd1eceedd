"""Settings of the contacts: stiffness and step by DEM; step, tolerance and sweeps by DVI."""

from __future__ import annotations

import math

from emclutch.scene.units import LinearSpeed, Time, number, quantity_of
from emclutch.settings.setting import Setting

ALLOWED, UPDATE_EVERY = "contact.dvi.allow_long_step", "effects.dipoles.update_every"
OVERLAP_KEY = "contact.max_overlap"


def is_dvi(scene) -> bool:
    """Return whether contacts are rigid."""
    return scene.contact.method == "dvi"


def is_dem(scene) -> bool:
    """Return whether contacts are elastic, with a step that follows from the duration of a contact."""
    return scene.contact.method == "dem" and scene.span.step is None


def _usual_overlaps(scene, plan) -> tuple[float, ...]:
    """Return overlaps at which contacts hold saturated necks, and are not too soft for a run."""
    from coupling.expected_load import NECK_MARGIN
    from particles.dem.overlap_limits import SOFT

    stiffness, found = plan.contact.stiffness, []
    for factor in (4.0, 2.0, 0.5, 0.25):
        holds = stiffness.value / factor >= NECK_MARGIN * stiffness.neck and stiffness.overlap * factor <= SOFT
        found += [stiffness.overlap * factor] if factor < 1.0 or holds else []
    return tuple(found)


def _stiffnesses(contact) -> list[str]:
    """Return the entries that give the stiffness, between grains and at walls."""
    return [key for key in type(contact).model_fields if key.endswith(contact.stiffness_entry.name)]


def _overlap_entries(scene, plan, value) -> dict[str, float]:
    if scene.contact.needs_a_load:
        return {OVERLAP_KEY: value}
    return {f"contact.{key}": k for key, k in _stiffer(scene, plan.contact.stiffness, value).items()}


def _stiffer(scene, stiffness, overlap: float) -> dict[str, float]:
    """Return the stiffnesses that a scene gives, all by the factor with which grains press in so far."""
    from scipy.optimize import brentq

    from emclutch.simulation.contact_plan import largest_overlap

    contact = scene.contact
    given = {key: value for key in _stiffnesses(contact) if (value := getattr(contact, key)) is not None}

    def scaled(exponent: float) -> dict[str, float]:
        return {key: float(f"{math.exp(exponent) * value:.6g}") for key, value in given.items()}

    def excess(exponent: float) -> float:
        chosen = contact.model_copy(update=scaled(exponent))
        return math.log(largest_overlap(chosen, scene.grains, stiffness.load.force, stiffness.speed) / overlap)

    return scaled(brentq(excess, -20.0, 20.0, rtol=1e-4))


def _same_interval(scene, factor: float) -> dict[str, int]:
    """Return the entry that keeps the time between evaluations of the moments, given in steps, with more of them."""
    attraction = scene.effects.attraction
    if attraction is None or attraction.update_every is None:
        return {}
    return {UPDATE_EVERY: max(1, round(factor * attraction.update_every))}


# Friction of dense shear falls as grains soften (A. Singh et al., New J. Phys. 17 (2015) 043028). 200 grains in a
# periodic box under imposed pressure, 10 replicas each: shear stress -1.7, 0, +2.6, +6.0 % (each +- 2.3 %, 95 %) at
# overlaps of 0.04, 0.02, 0.01, 0.005. ln T over the overlap is no line (p = 0.02); over its root it is, and leaves
# -4.1 +- 1.3 % at 0.005. In magnetised powder, whose contacts are loaded far below the largest load, a step from 0.02
# to 0.005 is not resolved: +2.4 +- 4.0 %.
OVERLAP = Setting(
    name="overlap",
    key=OVERLAP_KEY,
    summary="Largest expected overlap, over the diameter, which sets the stiffness of contacts.",
    theory="softer grains have less friction under imposed pressure, the torque is too small, by the root of the "
    "overlap; in magnetised powder not resolved, below 7 % at 0.02; the time step grows with the root",
    entry=number("0.005", 1e-5, 0.05),
    order=0.5,
    applies=lambda scene: scene.contact.method == "dem" or scene.contact.dvi.springs,
    own=lambda scene, plan: plan.contact.stiffness.overlap,
    usual_of=_usual_overlaps,
    keys_of=lambda scene: (OVERLAP_KEY, *(f"contact.{name}" for name in _stiffnesses(scene.contact))),
    entries_of=_overlap_entries,
)
CONTACT_STEP = Setting(
    name="contact_step",
    key="time.steps_per_contact",
    summary="Time steps in the duration of a contact.",
    theory="velocity Verlet: second order in the step; not resolved in sheared powder, below 4 % at 10 steps; cost in "
    "proportion to the steps",
    entry=number("20", 10.0, 200.0),
    order=2.0,
    applies=is_dem,
    own=lambda scene, plan: scene.span.steps_per_contact,
    tried=(10.0, 14.0, 20.0, 40.0),
    keys_of=lambda scene: ("time.steps_per_contact", UPDATE_EVERY),
    entries_of=lambda scene, plan, value: {
        "time.steps_per_contact": value,
        **_same_interval(scene, value / scene.span.steps_per_contact),
    },
    finer_is_larger=True,
    in_contacts=True,
)
# Longer steps than the rule allows are tried too: they cost less, and give an estimate of the error of the scene's own
# step. What is compared is the mean torque, the impulse on the shaft over the averaged part: grains that start alike
# are elsewhere after a strain of a few per cent, whatever the step is, so that their places say nothing of it.
RIGID_STEP = Setting(
    name="rigid_step",
    key="contact.dvi.step",
    summary="Time step by DVI.",
    theory="Moreau-Jean's scheme: first order in the step; in magnetised powder not resolved, below 15 % up to 16 "
    "times the default; sweeps grow with the step, so that four times the default halves the cost",
    entry=quantity_of(Time),
    order=1.0,
    applies=is_dvi,
    own=lambda scene, plan: plan.dt,
    factors=(4.0, 2.0, 0.5),
    keys_of=lambda scene: ("contact.dvi.step", ALLOWED, UPDATE_EVERY),
    entries_of=lambda scene, plan, value: {
        "contact.dvi.step": value,
        **({ALLOWED: True} if value > plan.dt else {}),
        **_same_interval(scene, plan.dt / value),
    },
    unit="s",
)
RIGID_TOLERANCE = Setting(
    name="rigid_tolerance",
    key="contact.dvi.tolerance",
    summary="Residual at which the contact solver of rigid grains ends a step.",
    theory="the error of impulses is in proportion to the residual; sweeps grow as it falls",
    entry=quantity_of(LinearSpeed),
    order=1.0,
    applies=is_dvi,
    own=lambda scene, plan: plan.contact.tolerance,
    factors=(10.0, 0.1),
    unit="m/s",
)
RIGID_SWEEPS = Setting(
    name="rigid_sweeps",
    key="contact.dvi.max_sweeps",
    summary="Most sweeps over all contacts that the solver of rigid grains may take in a step.",
    theory="steps that end at the limit miss the tolerance; no error where none does",
    entry=number("500", 1.0, 1e6),
    order=None,
    applies=is_dvi,
    own=lambda scene, plan: scene.contact.dvi.max_sweeps,
    usual_of=lambda scene, plan: (max(1, scene.contact.dvi.max_sweeps // 4), 4 * scene.contact.dvi.max_sweeps),
    finer_is_larger=True,
    is_whole=True,
)
