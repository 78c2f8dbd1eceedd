"""Settings of the simulated powder: size of its grains, width of the sector, speed of shear, start of the average."""

from __future__ import annotations

import math
from math import asin, degrees, floor, log10, pi, sin
from typing import Any

from emclutch.scene.scaled import DIAMETERS
from emclutch.scene.start_up import start_up_strain
from emclutch.scene.units import number
from emclutch.settings.magnetism import sector_width
from emclutch.settings.setting import HISTORIES, Setting

COUNT, SECTOR_KEY, DIAMETER_KEY = "particles.count", "particles.sector", "particles.diameter"
SAME_WIDTH = 0.02
"""Difference of two widths of the sector, relative, by which a whole number of them in the ring comes out otherwise."""


def grains_per_gap(scene) -> float:
    """Return the width of the sheared gap, in grains."""
    gap = scene.shape().sheared_gap(scene.grains.region)
    return gap.width / scene.grains.mean_diameter


def width_beside(width: float, finer: float) -> float:
    """Return the width [diameters] of a sector for grains that are finer by a factor: it is as wide as it was.

    Of coarser grains it has as many diameters. One of finer grains that has as many diameters as before is narrower
    than the gap sooner or later, and its torque is too large (docs/accuracy.md).
    """
    return width * max(1.0, finer)


def width_as_measured(width: float, finer: float, own: float) -> float:
    """Return the width [diameters] with the same error at the size of grains that others are finer than.

    `own`: of the scene with these; the angle of finer grains is the same, their smallest radius almost.
    """
    measured = width / max(1.0, finer)
    return own if math.isclose(measured, own, rel_tol=SAME_WIDTH) else measured


def _has_sizes(scene) -> bool:
    grains = scene.grains
    sized = grains.real_diameter is not None and grains.diameter is not None and grains.packing != "file"
    return sized and _has_a_gap(scene)


def _usual_sizes(scene, plan) -> tuple[float, ...]:
    real = grains_per_gap(scene) * scene.grains.mean_diameter / scene.grains.real_diameter
    return tuple(n for n in (4.0, 5.0, 6.0, 8.0, 12.0, 16.0, real) if n <= min(real, 16.0))


def _size_entries(scene, plan, value) -> dict[str, Any]:
    grains, finer = scene.grains, value / grains_per_gap(scene)
    diameter, angle = float(f"{grains.diameter / finer:.6g}"), grains.sector
    found: dict[str, Any] = {DIAMETER_KEY: diameter}
    if angle is not None:
        width = _width(scene, angle, diameter) if finer > 1.0 else sector_width(scene)
        found |= _sector_entry(scene, width, diameter)
        angle = _angle(scene, width, diameter)
    return found | _count_entry(scene, finer**3 * (1.0 if angle is None else angle / grains.sector))


def _usual_sectors(scene, plan) -> tuple[float, ...]:
    wider = [n for factor in (2.0, 4.0) if (n := sectors_of(scene, factor * scene.grains.sector)) > 1]
    sectors = wider or [sectors_of(scene, 0.5 * scene.grains.sector)]
    return tuple(_width(scene, 2.0 * pi / n, scene.grains.largest_diameter) for n in sectors)


def _sector_entries(scene, plan, value) -> dict[str, Any]:
    d = scene.grains.largest_diameter
    ratio = _angle(scene, value, d) / scene.grains.sector
    return _sector_entry(scene, value, d) | _count_entry(scene, ratio)


def _starts_up(scene) -> bool:
    from emclutch.scene.slip_checks import why_no_slip  # local: the schema imports the settings

    is_time = isinstance(scene.time.average_from, float)
    return _has_a_gap(scene) and not is_time and not why_no_slip(scene)


def _own_start(scene, plan) -> float:
    given = scene.time.average_from
    return start_up_strain(scene) if given is None else given.value


def _has_a_gap(scene) -> bool:
    return scene.geometry.has_axis and scene.shape().sheared_gap(scene.grains.region) is not None


def _pitches(scene) -> int | None:
    """Return the slots around, of whose pitches a sector has a whole number; None without slots in the field."""
    slotted = getattr(scene.geometry, "slotted", {}) if scene.coil_field is not None else {}
    return next((slots.count for slots in slotted.values()), None)


def sectors_of(scene, angle: float) -> int:
    """Return how many sectors the ring has that are as wide as an angle [rad] or wider."""
    most, pitches = floor(2.0 * pi / angle * (1.0 + 1e-5)), _pitches(scene)  # values are rounded to six digits
    return most if pitches is None else max((n for n in range(1, most + 1) if pitches % n == 0), default=1)


def _width(scene, angle: float, diameter: float) -> float:
    """Return the width of a sector [diameters], see `sector_width`; of grains of any diameter [m]."""
    from emclutch.scene.sector_checks import innermost_radius  # local: the schema imports the settings

    radius = innermost_radius(scene) + 0.5 * (diameter - scene.grains.largest_diameter)
    return 2.0 * radius * sin(0.5 * angle) / diameter


def _angle(scene, width: float, diameter: float) -> float:
    """Return the angle [rad] of the sector that is as wide or wider, in grains of a diameter [m]."""
    half = width / _width(scene, pi, diameter)
    return 2.0 * pi / sectors_of(scene, 2.0 * asin(min(half, 1.0)))


def _sector_entry(scene, width: float, diameter: float) -> dict[str, Any]:
    """Return the entry of a width; with slots as an angle, which smaller grains leave as it is."""
    if _pitches(scene) is None:
        places = 3 - floor(log10(width))  # rounded down: rounded up the ring might have a sector less
        return {SECTOR_KEY: DIAMETERS.format(f"{floor(width * 10.0**places) / 10.0**places:.12g}")}
    return {SECTOR_KEY: f"{degrees(_angle(scene, width, diameter)):.12g} deg"}


def _count_entry(scene, factor: float) -> dict[str, Any]:
    """Return the entry of so many times the grains; none where the scene does not count them."""
    count = scene.grains.count
    return {} if count is None else {COUNT: max(1, round(factor * count))}


GRAINS_PER_GAP = Setting(
    name="grains_per_gap",
    key=DIAMETER_KEY,
    summary="Simulated grains per gap, where they stand for finer ones.",
    theory="torque of a sheared layer of n grains: 1 + a/n^2 (Kamrin and Henann 2015), too large; cost n^3 of coarser "
    "grains on a sector of as many diameters, n^4 of finer ones on one as wide as it was",
    entry=number("8", 1.0, 1000.0),
    order=2.0,
    applies=_has_sizes,
    own=lambda scene, plan: grains_per_gap(scene),
    usual_of=_usual_sizes,
    keys_of=lambda scene: (DIAMETER_KEY, SECTOR_KEY, COUNT),
    entries_of=_size_entries,
    limit_of=lambda scene, plan: scene.grains.real_diameter / (grains_per_gap(scene) * scene.grains.mean_diameter),
    finer_is_larger=True,
    is_large=True,
)
SECTOR = Setting(
    name="sector",
    key=SECTOR_KEY,
    summary="Width of the cyclic sector in diameters.",
    theory="a periodic sector repeats itself around the ring: the error falls faster than any power beyond the "
    "correlation of the flow, and as 1/L^2 at the least; twice the sector costs twice as much and scatters less by the "
    "root of 2",
    entry=number("6", 1.0, 1e6),
    order=2.0,
    applies=lambda scene: scene.grains.sector is not None and scene.grains.packing != "file",
    own=lambda scene, plan: sector_width(scene),
    usual_of=_usual_sectors,
    keys_of=lambda scene: (SECTOR_KEY, COUNT),
    entries_of=_sector_entries,
    finer_is_larger=True,
    unit="diameters",
)
INERTIAL_NUMBER = Setting(
    name="inertial_number",
    key="accuracy.inertial_number",
    summary="Inertial number at which the gap is sheared, where the scene leaves the speed to it.",
    theory="friction rises with the inertial number, first order in it; the steps of a strain are inversely "
    "proportional to it",
    entry=number("0.1", 0.0, 1.0, above=True),
    order=1.0,
    applies=lambda scene: scene.accuracy.inertial_number is not None,
    own=lambda scene, plan: scene.accuracy.inertial_number,
    usual_of=lambda scene, plan: tuple(
        own for factor in (4.0, 2.0, 0.5) if (own := factor * scene.accuracy.inertial_number) <= 1.0
    ),
    limit_of=lambda scene, plan: plan.scaled.real,
)
START_UP = Setting(
    name="start_up",
    key="time.average_from",
    summary="Shear strain from which on the torque is averaged.",
    theory="the torque of the start-up is too large in magnetised powder; averages from later on need longer runs",
    entry=number("9", 0.0, 1e6, above=True),
    order=None,
    applies=_starts_up,
    own=_own_start,
    factors=(0.5, 1.5),
    entries_of=lambda scene, plan, value: {"time.average_from": f"strain {value:g}"},
    measured_on=HISTORIES,
    finer_is_larger=True,
    unit="strain",
)
