"""The one way in which people are told a torque and how well it is known: its mean, and the ends of its 95 % interval.

Tables for other programs hold standard errors too, and say so in the names of their columns.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from emclutch.results.statistics import Estimate


def torque_in_words(torque: Estimate, unit: str = "N m", factor: float = 1.0) -> str:
    """A torque with its 95 % interval by Student's t, in a unit that is `factor` from N m.

    Examples
    --------
    ``2.254 N m (95 %: 2.21 to 2.298)``
    """
    return in_words(torque.mean, torque.interval(), unit, factor)


def in_words(mean: float | None, interval: tuple[float, float] | None, unit: str = "N m", factor: float = 1.0) -> str:
    """The same of a mean and the ends of its 95 % interval [N m]; None: unknown."""
    if mean is None:
        return "no torque"
    if interval is None:
        return f"{factor * mean:.4g} {unit}, error unknown"
    low, high = interval
    return f"{factor * mean:.4g} {unit} (95 %: {factor * low:.4g} to {factor * high:.4g})"
