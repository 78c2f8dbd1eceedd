"""The step of the grains, and the reason for it.

What a step must resolve, for the lightest grains in each kind of contact (with their like, and with a wall):

* **a contact**: its duration in an impact at the expected speed, and the half period pi sqrt(m_eff/S) in which it
  vibrates at the depth of that impact under the expected load, S its stiffness there; ``steps_per_contact`` steps in
  the shorter, 5 at the least;
* **sliding and rolling**: the half period of the stuck tangential spring. It moves and turns the grain,
  omega^2 = 3.5 k_t/m_eff; at a wall with rolling resistance 5.55 k_t/m (the larger eigenvalue of the pair of
  springs; between spheres rolling adds nothing to the stiffest mode, and twisting is softer than sliding);
* **damping**: gamma_n dt < m_eff, or a step turns the closing speed round and gains energy; half of that is chosen;
* **the Rayleigh time** of Hertz-Mindlin grains: 20 % of it, at most 40 % (usual for coordinations above and below 4);
* **attraction**, where the caller gives one (a scene enters it as a load): the growth sqrt(m_eff/S) of a distance on
  its negative stiffness S, taken as a half period pi sqrt(m_eff/S) is of a positive one;
* **travel**: no grain moves more than a tenth of its radius in a step, or it would tunnel into its neighbour;
* **the interval** that the caller gives, of a coupling window or of a whole run: soft contacts may allow a step that
  is longer.

The stiffness of Hertzian laws grows with the overlap: without a speed and a load, a step is chosen for an overlap of
0.5 % of the diameter, and a step asked for is refused only where it is too long at 1e-5 of it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from particles.laws.contact_law import ContactLaw
from particles.laws.elastic import rayleigh_time
from particles.laws.hertz_mindlin import HertzMindlin
from particles.laws.pair_table import PairLaws
from particles.laws.springs import law_table, spring

TRAVEL = 0.1  # largest fraction of a radius that a grain may move in one step
MIN_STEPS = 5.0  # a contact, for a step that the user asks for
RAYLEIGH, MAX_RAYLEIGH = 0.2, 0.4  # fraction of the Rayleigh time: chosen, and allowed to the user
DAMPING, MAX_DAMPING = 0.5, 1.0  # fraction of m_eff/gamma_n
# fraction of the diameter at which a Hertzian contact is judged when speed and load are unknown
REFERENCE_OVERLAP = 0.005
CHECKED_OVERLAP = 1e-5  # the same to check a step: it refuses what is too long for all but the lightest touch

AS_LONG_AS_A_WINDOW = "no longer than a coupling window, nor than the run"

SLIDING = 3.5  # omega^2 m_eff/k_t of a stuck sphere: 1 + R^2 m/I with I = 2/5 m R^2
WALL_ROLLING = 3.0 + math.sqrt(6.5)  # the same at a wall with rolling resistance k_r = k_t R^2


class StepTooLong(ValueError):
    """A wished step [s] is not within 0 and the `longest` [s] that a `rule` allows."""

    def __init__(self, dt: float, longest: float, rule: str) -> None:
        self.dt, self.longest, self.rule = dt, longest, rule
        super().__init__(self.text("dt"))

    def text(self, name: str) -> str:
        """The message with the step's name where the user gave it."""
        return (
            f"{name} = {self.dt:g} s; allowed: more than 0 and at most {self.longest:.3g} s ({self.rule}); leave it "
            "out to have it chosen"
        )


@dataclass(frozen=True, slots=True)
class TimeStep:
    """A step ``dt`` [s] and the one line that says why."""

    dt: float
    reason: str


@dataclass(frozen=True, slots=True)
class StepLimit:
    """One thing that a step must resolve: the step chosen for it [s], the longest allowed [s], and its words."""

    dt: float
    longest: float
    why: str
    rule: str


def choose_time_step(
    contact: ContactLaw | PairLaws,
    mass: float | np.ndarray,
    radius: float | np.ndarray,
    *,
    speed: float = 0.0,
    load: float = 0.0,
    steps_per_contact: float = 20.0,
    rolling: bool = False,
    attraction: float = 0.0,
    longest: float = math.inf,
    dt: float | None = None,
) -> TimeStep:
    """Choose the step, or check the user's.

    Parameters
    ----------
    contact
        The law, or the laws by pair of materials.
    mass, radius
        Of the grains, [kg] and [m]; the smallest count.
    speed : float
        The largest relative speed to be expected [m/s], walls included.
    load : float
        The largest force on a contact to be expected [N]; it counts where the stiffness follows the overlap.
    rolling : bool
        Whether grains resist rolling.
    attraction : float
        Largest negative stiffness of an attraction of near grains [N/m], `Attraction.stiffest`.
    longest : float
        Length [s] of the interval that no step exceeds.
    dt : float, optional
        A step wished for [s]; it is refused when it is longer than a limit (5 steps a contact at the least).

    Raises
    ------
    StepTooLong
        The wished step is not positive or too long.
    ValueError
        Another number is out of range.
    """
    lightest, smallest = smallest_grain(
        mass, radius, speed=(speed, "m/s"), load=(load, "N"), attraction=(attraction, "N/m")
    )
    if not MIN_STEPS <= steps_per_contact < math.inf:
        raise ValueError(f"steps_per_contact = {steps_per_contact:g}; allowed: 5 or more (20 is usual)")
    meeting = _Meeting(
        lightest, smallest, speed, load, REFERENCE_OVERLAP if dt is None else CHECKED_OVERLAP, steps_per_contact
    )
    limits = list(_limits(contact, meeting, rolling))
    if attraction > 0.0:
        half = _half_period(0.5 * lightest, attraction)
        limits.append(
            StepLimit(
                half / steps_per_contact,
                half / MIN_STEPS,
                f"{steps_per_contact:g} steps a time {half:.3g} s of near grains' attraction ({attraction:.3g} N/m)",
                "5 steps a time pi sqrt(m_eff/S) of the attraction",
            )
        )
    limits.append(StepLimit(longest, longest * (1.0 + 1e-9), AS_LONG_AS_A_WINDOW, AS_LONG_AS_A_WINDOW))
    if dt is not None:
        tightest = min(limits, key=lambda limit: limit.longest)
        if not 0.0 < dt <= tightest.longest:
            raise StepTooLong(dt, tightest.longest, tightest.rule)
        duration = steps_per_contact * limits[0].dt
        return TimeStep(dt, f"dt = {dt:.3g} s as asked: {duration / dt:.3g} steps per contact of {duration:.3g} s")
    # of limits that agree to round-off the first is named (k_t = 2/7 k_n: sliding and contact have the same period)
    shortest = min(limit.dt for limit in limits)
    chosen = next(limit for limit in limits if limit.dt <= shortest * (1.0 + 1e-9))
    also = "" if chosen is limits[0] else f" (the contact alone would allow {limits[0].dt:.3g} s)"
    return TimeStep(chosen.dt, f"dt = {chosen.dt:.3g} s: {chosen.why}{also}")


def smallest_grain(
    mass: float | np.ndarray, radius: float | np.ndarray, **expected: tuple[float, str]
) -> tuple[float, float]:
    """Return the smallest mass [kg] and radius [m]; check them and what is ``expected``, each a number and its unit.

    Raises
    ------
    ValueError
        If mass or radius are not positive, or an expected number is negative.
    """
    lightest, smallest = float(np.min(mass)), float(np.min(radius))
    for name, value, unit in (("mass", lightest, "kg"), ("radius", smallest, "m")):
        if not 0.0 < value < math.inf:
            raise ValueError(f"{name} of a grain = {value:g} {unit}; allowed: more than 0")
    for name, (value, unit) in expected.items():
        if not 0.0 <= value < math.inf:
            raise ValueError(f"expected {name} = {value:g} {unit}; allowed: 0 or more")
    return lightest, smallest


@dataclass(frozen=True, slots=True)
class _Meeting:
    """The lightest grain, and how hard it is hit and pressed: SI; ``unloaded`` is the overlap / d without either."""

    mass: float
    radius: float
    speed: float
    load: float
    unloaded: float
    steps: float

    def depth(self, law: ContactLaw, m_eff: float, r_eff: float) -> float:
        """Overlap [m] at which the contact is judged."""
        if self.speed > 0.0 or self.load > 0.0:
            return law.overlap_under(self.load, m_eff, self.speed, r_eff)
        return 2.0 * self.unloaded * self.radius


def _limits(contact: ContactLaw | PairLaws, meeting: _Meeting, rolling: bool) -> Iterator[StepLimit]:
    """Everything that bounds the step; the shortest contact comes first."""
    table = contact if isinstance(contact, PairLaws) else PairLaws.of_one(contact)
    mass, radius, speed = meeting.mass, meeting.radius, meeting.speed
    turning = WALL_ROLLING if rolling else SLIDING
    contacts = [
        *(_of_contact(table.laws[k], 0.5 * mass, 0.5 * radius, SLIDING, meeting) for k in np.unique(table.pair)),
        *(_of_contact(table.laws[k], mass, radius, turning, meeting) for k in np.unique(table.wall)),
    ]
    yield min((limits[0] for limits in contacts), key=lambda limit: limit.dt)
    for limits in contacts:
        yield from limits
    if speed > 0.0:
        travel = TRAVEL * radius / speed
        yield StepLimit(
            travel,
            travel,
            f"a grain at {speed:.3g} m/s moves {TRAVEL:g} of its radius {radius * 1e3:.3g} mm",
            "a tenth of a radius a step",
        )


def _of_contact(law: ContactLaw, m_eff: float, r_eff: float, turning: float, meeting: _Meeting) -> list[StepLimit]:
    """Limits of one law: contact, sliding, damping, Rayleigh wave."""
    steps = meeting.steps
    delta = meeting.depth(law, m_eff, r_eff)
    stiffness = law.stiffness_at(delta, r_eff)
    duration = min(law.contact_time(m_eff, r_eff, meeting.speed), _half_period(m_eff, stiffness))
    _, k_t, gamma_n, _, _, _ = spring(law_table(law.kernel, law.row()[None]), 0, delta, m_eff, r_eff, 0.0)
    at_depth = "" if law.kernel in ("linear", "walton_braun") else f" at an overlap of {delta * 1e6:.3g} um"
    limits = [
        StepLimit(
            duration / steps,
            duration / MIN_STEPS,
            f"{steps:g} steps per contact of {duration:.3g} s (k_n = {stiffness:.3g} N/m{at_depth}, lightest grain "
            f"{meeting.mass:.3g} kg)",
            "5 steps per contact",
        )
    ]
    if k_t > 0.0:
        half = _half_period(m_eff / turning, float(k_t))
        name = "sliding and rolling" if turning > SLIDING else "sliding"
        limits.append(
            StepLimit(
                half / steps,
                half / MIN_STEPS,
                f"{steps:g} steps a half period {half:.3g} s of {name} (k_t = {k_t:.3g} N/m{at_depth})",
                f"5 steps a half period of {name}",
            )
        )
    if gamma_n > 0.0:
        decay = float(m_eff / gamma_n)
        limits.append(
            StepLimit(
                DAMPING * decay,
                MAX_DAMPING * decay,
                f"half of the time {decay:.3g} s in which the dashpot brakes the lightest grain (m_eff/gamma_n)",
                "m_eff/gamma_n: a longer step turns the closing speed round and gains energy",
            )
        )
    if isinstance(law, HertzMindlin):
        density = meeting.mass / (4.0 / 3.0 * math.pi * meeting.radius**3)
        wave = rayleigh_time(law.grain, density, meeting.radius)
        limits.append(
            StepLimit(
                RAYLEIGH * wave,
                MAX_RAYLEIGH * wave,
                f"{100.0 * RAYLEIGH:g} % of the Rayleigh time {wave:.3g} s of the smallest grain",
                f"{100.0 * MAX_RAYLEIGH:g} % of the Rayleigh time",
            )
        )
    return limits


def _half_period(mass: float, stiffness: float) -> float:
    return math.pi * math.sqrt(mass / stiffness)


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
