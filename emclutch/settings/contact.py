"""Settings of the contacts: stiffness and step by DEM; step, tolerance and sweeps by DVI."""

from __future__ import annotations

import math

from emclutch.scene.units import LinearSpeed, Time, number, quantity_of
from emclutch.settings.setting import Setting

ALLOWED, UPDATE_EVERY = "contact.dvi.allow_long_step", "effects.dipoles.update_every"


class Overlap(Setting):
    """Largest expected overlap, over the diameter, which sets the stiffness of contacts.

    Friction of dense shear falls as grains soften (A. Singh et al., New J. Phys. 17 (2015) 043028). 200 grains in a
    periodic box under imposed pressure, 10 replicas each: shear stress -1.7, 0, +2.6, +6.0 % (each +- 2.3 %, 95 %) at
    overlaps of 0.04, 0.02, 0.01, 0.005. ln T over the overlap is no line (p = 0.02); over its root it is, and leaves
    -4.1 +- 1.3 % at 0.005. In magnetised powder, whose contacts are loaded far below the largest load, a step from 0.02
    to 0.005 is not resolved: +2.4 +- 4.0 %.
    """

    name = "overlap"
    key = "contact.max_overlap"
    entry = number("0.005", 1e-5, 0.05)
    theory = (
        "softer grains have less friction under imposed pressure, the torque is too small, by the root of the overlap; "
        "in magnetised powder not resolved, below 7 % at 0.02; the time step grows with the root"
    )
    order = 0.5

    @classmethod
    def applies(cls, scene):
        return scene.contact.method == "dem" or scene.contact.dvi.springs

    @classmethod
    def own(cls, scene, plan):
        return plan.contact.stiffness.overlap

    @classmethod
    def usual(cls, scene, plan):
        own = cls.own(scene, plan)
        return tuple(own * factor for factor in (4.0, 2.0, 0.5, 0.25) if cls._may_be(scene, plan, factor))

    @classmethod
    def _may_be(cls, scene, plan, factor: float) -> bool:
        """Return whether contacts so much softer hold saturated necks, and are not too soft for a run."""
        from coupling.expected_load import NECK_MARGIN
        from particles.dem.overlap_limits import SOFT

        softer = plan.contact.stiffness.value / factor
        deep = plan.contact.stiffness.overlap * factor
        return factor < 1.0 or (softer >= NECK_MARGIN * plan.contact.stiffness.neck and deep <= SOFT)

    @classmethod
    def keys(cls, scene):
        return (cls.key, *(f"contact.{name}" for name in _stiffnesses(scene.contact)))

    @classmethod
    def entries(cls, scene, plan, value):
        if scene.contact.needs_a_load:
            return {cls.key: value}
        return {
            f"contact.{key}": stiffness for key, stiffness in _stiffer(scene, plan.contact.stiffness, value).items()
        }


def _stiffnesses(contact) -> list[str]:
    """Return the entries that give the stiffness, between grains and at walls."""
    return [key for key in type(contact).model_fields if key.endswith(contact.stiffness_entry.name)]


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


class ContactStep(Setting):
    """Time steps in the duration of a contact."""

    name = "contact_step"
    key = "time.steps_per_contact"
    entry = number("20", 10.0, 200.0)
    theory = (
        "velocity Verlet: second order in the step; not resolved in sheared powder, below 4 % at 10 steps; cost in "
        "proportion to the steps"
    )
    order = 2.0
    finer_is_larger = True
    tried = (10.0, 14.0, 20.0, 40.0)
    in_contacts = True

    @classmethod
    def applies(cls, scene):
        return scene.contact.method == "dem" and scene.span.step is None

    @classmethod
    def own(cls, scene, plan):
        return scene.span.steps_per_contact

    @classmethod
    def keys(cls, scene):
        return (cls.key, UPDATE_EVERY)

    @classmethod
    def entries(cls, scene, plan, value):
        return {cls.key: value} | _same_interval(scene, value / scene.span.steps_per_contact)


def _same_interval(scene, factor: float) -> dict[str, int]:
    """Return the entry that keeps the time between evaluations of the moments, given in steps, with more of them."""
    attraction = scene.effects.attraction
    if attraction is None or attraction.update_every is None:
        return {}
    return {UPDATE_EVERY: max(1, round(factor * attraction.update_every))}


class RigidStep(Setting):
    """Time step by DVI.

    Longer steps than the rule allows are tried too: they cost less, and give an estimate of the error of the scene's
    own step.
    What is compared is the mean torque, the impulse on the shaft over the averaged part: grains that start alike are
    elsewhere after a strain of a few per cent, whatever the step is, so that their places say nothing of it.
    """

    name = "rigid_step"
    key = "contact.dvi.step"
    entry = quantity_of(Time)
    theory = (
        "Moreau-Jean's scheme: first order in the step; in magnetised powder not resolved, below 15 % up to 16 times "
        "the default; sweeps grow with the step, so that four times the default halves the cost"
    )
    order = 1.0
    unit = "s"
    factors = (4.0, 2.0, 0.5)

    @classmethod
    def applies(cls, scene):
        return scene.contact.method == "dvi"

    @classmethod
    def own(cls, scene, plan):
        return plan.dt

    @classmethod
    def keys(cls, scene):
        return (cls.key, ALLOWED, UPDATE_EVERY)

    @classmethod
    def entries(cls, scene, plan, value):
        longer = {ALLOWED: True} if value > plan.dt else {}
        return {cls.key: value} | longer | _same_interval(scene, plan.dt / value)


class RigidTolerance(Setting):
    """Residual at which the contact solver of rigid grains ends a step."""

    name = "rigid_tolerance"
    key = "contact.dvi.tolerance"
    entry = quantity_of(LinearSpeed)
    theory = "the error of impulses is in proportion to the residual; sweeps grow as it falls"
    order = 1.0
    unit = "m/s"
    factors = (10.0, 0.1)

    @classmethod
    def applies(cls, scene):
        return scene.contact.method == "dvi"

    @classmethod
    def own(cls, scene, plan):
        return plan.contact.tolerance


class RigidSweeps(Setting):
    """Most sweeps over all contacts that the solver of rigid grains may take in a step."""

    name = "rigid_sweeps"
    key = "contact.dvi.max_sweeps"
    entry = number("500", 1.0, 1e6)
    theory = "steps that end at the limit miss the tolerance; no error where none does"
    order = None
    finer_is_larger = True
    is_whole = True

    @classmethod
    def applies(cls, scene):
        return scene.contact.method == "dvi"

    @classmethod
    def own(cls, scene, plan):
        return scene.contact.dvi.max_sweeps

    @classmethod
    def usual(cls, scene, plan):
        own = scene.contact.dvi.max_sweeps
        return (max(1, own // 4), 4 * own)
