"""Settings of the grains' magnetism: smearing width, moments and their updates, feedback to the field."""

from __future__ import annotations

from emclutch.scene.grain_smear import MIN_WIDTH, TRUE_WIDTH, moments_are_fed_back, narrowest_gap
from emclutch.scene.units import Time, number, quantity_of
from emclutch.settings.contact import UPDATE_EVERY
from emclutch.settings.setting import FROZEN, Setting


class SmearWidth(Setting):
    """Width over which a grain's moment is smeared for the field; pairs that are nearer attract one by one."""

    name = "smear_width"
    key = "effects.dipoles.cutoff"
    entry = number("2.5", 2.0, 10.0)
    theory = "nearer pairs attract one by one, farther ones through the smooth field; pairs grow with the width cubed"
    order = None
    measured_on = FROZEN
    finer_is_larger = True
    unit = "diameters"

    @classmethod
    def applies(cls, scene):
        return moments_are_fed_back(scene)

    @classmethod
    def own(cls, scene, plan):
        return scene.effects.attraction.cutoff

    @classmethod
    def usual(cls, scene, plan):
        least = TRUE_WIDTH if scene.effects.attraction.has_necks else MIN_WIDTH
        widest = narrowest_gap(scene) / scene.grains.largest_diameter
        if scene.grains.sector is not None:
            widest = min(widest, 0.5 * sector_width(scene))
        return tuple(a for a in (2.0, 2.25, 2.5, 2.75, 3.0, 3.5) if least <= a <= widest * (1.0 + 1e-9))


class MomentTolerance(Setting):
    """Residual at which the iteration for the grains' moments ends."""

    name = "moment_tolerance"
    key = "effects.dipoles.tolerance"
    entry = number("1e-3", 1e-12, 0.05)
    theory = "the error of moments and forces is in proportion to the residual; sweeps grow with its logarithm"
    order = 1.0
    measured_on = FROZEN
    tried = (1e-2, 3e-3, 1e-3, 3e-4, 1e-4)

    @classmethod
    def applies(cls, scene):
        return scene.effects.attraction is not None

    @classmethod
    def own(cls, scene, plan):
        return scene.effects.attraction.tolerance


class FeedbackTolerance(Setting):
    """Difference between the grains' magnetisation and that in the field, above which the field is solved again."""

    name = "feedback_tolerance"
    key = "effects.back_reaction.tolerance"
    entry = number("0.02", 1e-6, 1.0)
    theory = "the error of the field in the powder is in proportion to it; a larger one needs fewer solutions"
    order = 1.0
    measured_on = FROZEN
    tried = (0.08, 0.04, 0.02, 0.01, 0.005)

    @classmethod
    def applies(cls, scene):
        return moments_are_fed_back(scene)

    @classmethod
    def own(cls, scene, plan):
        return scene.effects.feedback.tolerance


class UpdateInterval(Setting):
    """Time between evaluations of moments and of the forces that are held in between, in durations of a contact."""

    name = "update_interval"
    key = UPDATE_EVERY
    entry = number("2.5", 0.005, 1000.0)
    theory = (
        "held forces lag by half the interval: first order in it; not resolved in sheared powder with necks, below 5 % "
        "at 20 contacts; the magnetic part of the cost is inversely proportional to it"
    )
    order = 1.0
    unit = "contacts"
    in_contacts = True

    @classmethod
    def applies(cls, scene):
        return scene.effects.attraction is not None and scene.contact.method == "dem" and scene.span.step is None

    @classmethod
    def own(cls, scene, plan):
        return plan.steps_per_update / scene.span.steps_per_contact

    @classmethod
    def usual(cls, scene, plan):
        own = cls.own(scene, plan)
        most = 10_000 if scene.span.window is None else plan.division.steps
        return tuple(factor * own for factor in (4, 2) if factor * plan.steps_per_update <= most)

    @classmethod
    def entries(cls, scene, plan, value):
        return {cls.key: max(1, round(value * scene.span.steps_per_contact))}


class RigidUpdateInterval(Setting):
    """Time between evaluations of the moments of rigid grains, whose near pulls follow their gaps at every step."""

    name = "rigid_update_interval"
    key = UpdateInterval.key
    entry = quantity_of(Time)
    theory = (
        "held moments lag by half the interval: first order in it; forces differ by 2 % for each 1 % of a diameter "
        "that layers of grains go on in it, their sum across the gap by a tenth of that; the magnetic part of the cost "
        "is inversely proportional to it"
    )
    order = 1.0
    unit = "s"

    @classmethod
    def applies(cls, scene):
        return scene.contact.method == "dvi" and scene.effects.attraction is not None

    @classmethod
    def own(cls, scene, plan):
        return plan.steps_per_update * plan.dt

    @classmethod
    def usual(cls, scene, plan):
        n = plan.steps_per_update
        longer = 2 * n if scene.span.window is None else min(2 * n, plan.division.steps)
        return tuple(plan.dt * steps for steps in dict.fromkeys((longer, max(1, n // 2))))

    @classmethod
    def entries(cls, scene, plan, value):
        return {cls.key: max(1, round(value / plan.dt))}


class CouplingWindow(Setting):
    """Interval after which the field is compared with the grains' magnetisation, and solved again where it differs.

    In seconds at the scene's own speeds: where an inertial number scales them the strain of a window counts.
    """

    name = "coupling_window"
    key = "time.window"
    entry = quantity_of(Time)
    theory = (
        "the field lags behind the grains by half a window: first order in it, where it changes by more than the "
        "tolerance of the feedback in a window"
    )
    order = 1.0
    unit = "s"
    factors = (4.0,)

    @classmethod
    def applies(cls, scene):
        return moments_are_fed_back(scene)

    @classmethod
    def own(cls, scene, plan):
        return plan.division.length * _speed_factor(plan)

    @classmethod
    def entries(cls, scene, plan, value):
        return {cls.key: value / _speed_factor(plan)}


def _speed_factor(plan) -> float:
    return 1.0 if plan.scaled is None else plan.scaled.factor


def sector_width(scene) -> float:
    """Return the width of the cyclic sector [largest diameters], at the smallest radius of a grain's centre."""
    from math import sin

    from emclutch.scene.sector_checks import innermost_radius  # local: the schema imports the settings

    return 2.0 * innermost_radius(scene) * sin(0.5 * scene.grains.sector) / scene.grains.largest_diameter
