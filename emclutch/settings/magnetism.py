"""Settings of the grains' magnetism: smearing width, moments and their updates, feedback to the field."""

from __future__ import annotations

from math import sin

from emclutch.scene.grain_smear import MIN_WIDTH, TRUE_WIDTH, moments_are_fed_back, narrowest_gap
from emclutch.scene.units import Time, number, quantity_of
from emclutch.settings.contact import UPDATE_EVERY, is_dem, is_dvi
from emclutch.settings.setting import FROZEN, Setting


def sector_width(scene) -> float:
    """Return the width of the cyclic sector [largest diameters], at the smallest radius of a grain's centre."""
    from emclutch.scene.sector_checks import innermost_radius  # local: the schema imports the settings

    return 2.0 * innermost_radius(scene) * sin(0.5 * scene.grains.sector) / scene.grains.largest_diameter


def _usual_widths(scene, plan) -> tuple[float, ...]:
    least = TRUE_WIDTH if scene.effects.attraction.has_necks else MIN_WIDTH
    widest = narrowest_gap(scene) / scene.grains.largest_diameter
    if scene.grains.sector is not None:
        widest = min(widest, 0.5 * sector_width(scene))
    return tuple(a for a in (2.0, 2.25, 2.5, 2.75, 3.0, 3.5) if least <= a <= widest * (1.0 + 1e-9))


def _longer_intervals(scene, plan) -> tuple[float, ...]:
    own = UPDATE_INTERVAL.own(scene, plan)
    most = 10_000 if scene.span.window is None else plan.division.steps
    return tuple(factor * own for factor in (4, 2) if factor * plan.steps_per_update <= most)


def _rigid_intervals(scene, plan) -> tuple[float, ...]:
    n = plan.steps_per_update
    longer = 2 * n if scene.span.window is None else min(2 * n, plan.division.steps)
    return tuple(plan.dt * steps for steps in dict.fromkeys((longer, max(1, n // 2))))


def _speed_factor(plan) -> float:
    return 1.0 if plan.scaled is None else plan.scaled.factor


SMEAR_WIDTH = Setting(
    name="smear_width",
    key="effects.dipoles.cutoff",
    summary="Width over which a grain's moment is smeared for the field; pairs that are nearer attract one by one.",
    theory="nearer pairs attract one by one, farther ones through the smooth field; pairs grow with the width cubed",
    entry=number("2.5", 2.0, 10.0),
    order=None,
    applies=moments_are_fed_back,
    own=lambda scene, plan: scene.effects.attraction.cutoff,
    usual_of=_usual_widths,
    measured_on=FROZEN,
    finer_is_larger=True,
    unit="diameters",
)
MOMENT_TOLERANCE = Setting(
    name="moment_tolerance",
    key="effects.dipoles.tolerance",
    summary="Residual at which the iteration for the grains' moments ends.",
    theory="the error of moments and forces is in proportion to the residual; sweeps grow with its logarithm",
    entry=number("1e-3", 1e-12, 0.05),
    order=1.0,
    applies=lambda scene: scene.effects.attraction is not None,
    own=lambda scene, plan: scene.effects.attraction.tolerance,
    tried=(1e-2, 3e-3, 1e-3, 3e-4, 1e-4),
    measured_on=FROZEN,
)
FEEDBACK_TOLERANCE = Setting(
    name="feedback_tolerance",
    key="effects.back_reaction.tolerance",
    summary="Difference between the grains' magnetisation and that in the field, above which the field is solved "
    "again.",
    theory="the error of the field in the powder is in proportion to it; a larger one needs fewer solutions",
    entry=number("0.02", 1e-6, 1.0),
    order=1.0,
    applies=moments_are_fed_back,
    own=lambda scene, plan: scene.effects.feedback.tolerance,
    tried=(0.08, 0.04, 0.02, 0.01, 0.005),
    measured_on=FROZEN,
)
UPDATE_INTERVAL = Setting(
    name="update_interval",
    key=UPDATE_EVERY,
    summary="Time between evaluations of moments and of the forces that lag in between, in durations of a contact.",
    theory="lagged forces are late by half the interval: first order in it; not resolved in sheared powder with necks, "
    "below 5 % at 20 contacts; the magnetic part of the cost is inversely proportional to it",
    entry=number("2.5", 0.005, 1000.0),
    order=1.0,
    applies=lambda scene: scene.effects.attraction is not None and is_dem(scene),
    own=lambda scene, plan: plan.steps_per_update / scene.span.steps_per_contact,
    usual_of=_longer_intervals,
    entries_of=lambda scene, plan, value: {UPDATE_EVERY: max(1, round(value * scene.span.steps_per_contact))},
    unit="contacts",
    in_contacts=True,
)
RIGID_UPDATE_INTERVAL = Setting(
    name="rigid_update_interval",
    key=UPDATE_EVERY,
    summary="Time between evaluations of the moments of rigid grains, whose near pulls follow their gaps at every "
    "step.",
    theory="lagged moments are late by half the interval: first order in it; forces differ by 2 % for each 1 % of a "
    "diameter that layers of grains go on in it, their sum across the gap by a tenth of that; the magnetic part of the "
    "cost is inversely proportional to it",
    entry=quantity_of(Time),
    order=1.0,
    applies=lambda scene: is_dvi(scene) and scene.effects.attraction is not None,
    own=lambda scene, plan: plan.steps_per_update * plan.dt,
    usual_of=_rigid_intervals,
    entries_of=lambda scene, plan, value: {UPDATE_EVERY: max(1, round(value / plan.dt))},
    unit="s",
)
# In seconds at the scene's own speeds: where an inertial number scales them the strain of a window counts.
COUPLING_WINDOW = Setting(
    name="coupling_window",
    key="time.window",
    summary="Interval after which the field is compared with the grains' magnetisation, and solved again where it "
    "differs.",
    theory="the field lags behind the grains by half a window: first order in it, where it changes by more than the "
    "tolerance of the feedback in a window",
    entry=quantity_of(Time),
    order=1.0,
    applies=moments_are_fed_back,
    own=lambda scene, plan: plan.division.length * _speed_factor(plan),
    factors=(4.0,),
    entries_of=lambda scene, plan, value: {"time.window": value / _speed_factor(plan)},
    unit="s",
)
