"""The unit in which a picture or a page says times: one unit within a picture."""

from __future__ import annotations

UNITS = (("s", 1.0), ("ms", 1e3), ("µs", 1e6))


def time_unit(longest: float) -> tuple[str, float]:
    """Unit, and the factor from seconds, in which the longest time [s] is at least 1; s where it is 0."""
    return next((one for one in UNITS if abs(longest) * one[1] >= 1.0), UNITS[-1] if longest else UNITS[0])


def time_in_words(time: float) -> str:
    """A time [s] with its unit, three digits."""
    unit, factor = time_unit(time)
    return f"{factor * time:.3g} {unit}"
