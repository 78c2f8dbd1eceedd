"""Numbers as people read them: times, durations, and torques with their 95 % interval.

Tables for other programs hold SI numbers and standard errors, and say so in the names of their columns.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from emclutch.results.statistics import Estimate

TIME_UNITS = (("s", 1.0), ("ms", 1e3), ("µs", 1e6))


def time_unit(longest: float) -> tuple[str, float]:
    """Return the unit, and the factor from seconds, in which the longest time [s] is at least 1; s where it is 0."""
    least = TIME_UNITS[-1] if longest else TIME_UNITS[0]
    return next((one for one in TIME_UNITS if abs(longest) * one[1] >= 1.0), least)


def format_time(time: float) -> str:
    """Return a time [s] with its unit, three digits."""
    unit, factor = time_unit(time)
    return f"{factor * time:.3g} {unit}"


def format_duration(seconds: float) -> str:
    """Return a time [s] as seconds, minutes or hours."""
    if seconds < 60.0:
        return f"{seconds:.0f} s"
    minutes = round(seconds / 60.0)
    return f"{minutes} min" if minutes < 60 else f"{minutes // 60} h {minutes % 60:02d} min"


def format_cost(seconds: float, cores: int, wall: float | None = None) -> str:
    """Return a processor time [s] with the wall-clock time `wall` [s] on some cores, where these are several.

    Examples
    --------
    ``53 min of processor time (27 min on 2 cores)``
    """
    text = f"{format_duration(seconds)} of processor time"
    if cores < 2:
        return text
    return f"{text} ({format_duration(seconds / cores if wall is None else wall)} on {cores} cores)"


def format_percent(share: float) -> str:
    """Return a share in per cent with two digits."""
    return f"{float(f'{100.0 * share:.2g}'):g} %"


def format_range(low: float, high: float) -> str:
    """Return a range with the decimals that two digits of its lower end have: ``8.4 to 16.5``."""
    decimals = max(0, 1 - math.floor(math.log10(low))) if low > 0.0 else 1
    return f"{low:.{decimals}f} to {high:.{decimals}f}"


def in_words(name: str) -> str:
    """Return a name of the program as words: ``grains_per_gap`` as ``grains per gap``."""
    return name.replace("_", " ")


def format_estimate(found: Estimate, unit: str = "N m") -> str:
    """Return a torque, or a stress in Pa, with half its 95 % interval relative to it.

    Examples
    --------
    ``0.607 N m ± 7.3 % (95 %)``
    """
    half, mean = found.half_width(), found.mean
    if mean is None:
        return "unknown"
    factor = 1.0
    if unit == "Pa" and abs(mean) >= 1e3:
        unit, factor = "kPa", 1e-3
    if half is None or not math.isfinite(half):
        return f"{factor * mean:.3g} {unit}, error unknown"
    value, error = factor * mean, factor * half
    if not mean or half >= abs(mean):
        return f"{value:.2g} ± {error:.2g} {unit} (95 %)"
    digits = 2 + math.floor(math.log10(abs(mean))) - math.floor(math.log10(half)) if half else 4
    return f"{value:.{min(max(digits, 2), 5)}g} {unit} ± {format_percent(half / abs(mean))} (95 %)"


def format_torque(torque: Estimate, unit: str = "N m", factor: float = 1.0) -> str:
    """Return a torque with its 95 % interval by Student's t, in a unit that is `factor` from N m.

    Examples
    --------
    ``2.254 N m (95 %: 2.210 to 2.298)``
    """
    return format_mean(torque.mean, torque.interval(), unit, factor)


def format_stress(stress: Estimate) -> str:
    """Return a stress with its 95 % interval, in Pa or kPa."""
    unit, factor = ("kPa", 1e-3) if abs(stress.mean or 0.0) >= 1e3 else ("Pa", 1.0)
    return "no stress" if stress.mean is None else format_mean(stress.mean, stress.interval(), unit, factor)


def format_mean(
    mean: float | None, interval: tuple[float, float] | None, unit: str = "N m", factor: float = 1.0
) -> str:
    """Return the same of a mean and the ends of its 95 % interval [N m], to two digits of its half.

    Unknown: a mean of None; an interval of None, as of tables, or an infinite one.
    """
    if mean is None:
        return "no torque"
    if interval is None or not all(map(math.isfinite, interval)):
        return f"{factor * mean:.4g} {unit}, error unknown"
    ends = [factor * one for one in (mean, *interval)]
    half, largest = 0.5 * abs(ends[2] - ends[1]), max(map(abs, ends))
    digits = 3 if not 0.0 < half < math.inf else 1 - math.floor(math.log10(half))
    if not 1e-3 <= largest < 1e6:
        shown = [f"{one:.3g}" for one in ends]
    else:
        digits = max(0, min(digits, 5 - math.floor(math.log10(largest))))
        shown = [f"{one:.{digits}f}" for one in ends]
    return f"{shown[0]} {unit} (95 %: {shown[1]} to {shown[2]})"
