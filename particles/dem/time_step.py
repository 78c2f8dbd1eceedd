"""The step of the grains, and the reason for it.

Two limits: a binary contact, of duration pi sqrt(m_eff/k_n), is resolved by ``steps_per_contact`` steps;
and no grain moves more than a tenth of its radius in a step, or it would tunnel into its neighbour.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from particles.laws.linear import LinearContact

TRAVEL = 0.1  # largest share of a radius that a grain may move in one step


@dataclass(frozen=True, slots=True)
class TimeStep:
    """A step ``dt`` [s] and the one line that says why."""

    dt: float
    reason: str


def contact_time(contact: LinearContact, mass: float) -> float:
    """Duration pi sqrt(m/(2 k_n)) [s] of an undamped impact of two grains of ``mass`` [kg]."""
    return math.pi * math.sqrt(0.5 * mass / contact.stiffness_n)


def choose_time_step(
    contact: LinearContact,
    mass: float | np.ndarray,
    radius: float | np.ndarray,
    *,
    speed: float = 0.0,
    steps_per_contact: float = 20.0,
    dt: float | None = None,
) -> TimeStep:
    """Choose the step, or check the user's.

    Parameters
    ----------
    mass, radius
        Of the grains, [kg] and [m]; the smallest count.
    speed : float
        The largest relative speed to be expected [m/s], walls included.
    dt : float, optional
        A step wished for [s]; it is refused when it is longer than a limit (5 steps a contact at the least).

    Raises
    ------
    ValueError
        If a number is out of range or the wished step is too long.
    """
    lightest, smallest = float(np.min(mass)), float(np.min(radius))
    for name, value, unit in (("mass", lightest, "kg"), ("radius", smallest, "m")):
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} of a grain = {value:g} {unit}; allowed: more than 0")
    if not 0.0 <= speed < math.inf:
        raise ValueError(f"expected speed = {speed:g} m/s; allowed: 0 or more")
    if not 5.0 <= steps_per_contact < math.inf:
        raise ValueError(f"steps_per_contact = {steps_per_contact:g}; allowed: 5 or more (20 is usual)")
    duration = contact_time(contact, lightest)
    by_contact = duration / steps_per_contact
    by_speed = TRAVEL * smallest / speed if speed > 0.0 else math.inf
    if dt is not None:
        longest = min(duration / 5.0, by_speed)
        if not 0.0 < dt <= longest:
            raise ValueError(
                f"dt = {dt:g} s; allowed: more than 0 and at most {longest:.3g} s "
                f"({'5 steps a contact' if longest < by_speed else 'a tenth of a radius a step'}); leave it "
                "out to have it chosen"
            )
        return TimeStep(dt, f"dt = {dt:.3g} s as asked: {duration / dt:.3g} steps a contact of {duration:.3g} s")
    if by_speed < by_contact:
        return TimeStep(
            by_speed,
            f"dt = {by_speed:.3g} s: a grain at {speed:.3g} m/s moves {TRAVEL:g} of its radius "
            f"{smallest * 1e3:.3g} mm (the contact alone would allow {by_contact:.3g} s)",
        )
    return TimeStep(
        by_contact,
        f"dt = {by_contact:.3g} s: {steps_per_contact:g} steps a contact of {duration:.3g} s "
        f"(k_n = {contact.stiffness_n:.3g} N/m, lightest grain {lightest:.3g} kg)",
    )


def stiffness_for_overlap(
    force: float, diameter: float, overlap: float = 0.005, *, mass: float = 0.0, speed: float = 0.0
) -> float:
    """Normal stiffness k_n [N/m] at which a contact that is pressed and hit is no deeper than ``overlap`` of d.

    The two add up: F/k + v sqrt(m/k) = overlap d, with ``force`` F [N] and an impact of ``mass`` m [kg] at ``speed`` v
    [m/s] (depth of an undamped impact on a wall).

    Raises
    ------
    ValueError
        If neither force nor impact is positive, a number is negative, or the overlap is above 5 % of the diameter.
    """
    impact = speed * math.sqrt(mass)
    if not (0.0 <= force < math.inf and 0.0 <= impact < math.inf and 0.0 < diameter < math.inf):
        raise ValueError(
            f"force = {force:g} N, speed = {speed:g} m/s and diameter = {diameter * 1e3:g} mm must be finite and not "
            "negative"
        )
    if force == 0.0 and impact == 0.0:
        raise ValueError("neither a force nor an impact presses the contact, so no stiffness follows; give one")
    if not 0.0 < overlap <= 0.05:
        raise ValueError(f"overlap = {overlap:g} of the diameter; allowed: more than 0, at most 0.05 (0.005 is usual)")
    depth = overlap * diameter
    # F s^2 + v sqrt(m) s = depth with s = 1/sqrt(k): the positive root, in the form that does not cancel
    s = 2.0 * depth / (impact + math.sqrt(impact * impact + 4.0 * force * depth))
    return 1.0 / (s * s)
