"""Strategies for the values of a random scene: numbers, quantities in units, courses in time, tables."""

from __future__ import annotations

from typing import Any

from hypothesis import strategies as st

Table = dict[str, Any]


def numbers(low: float, high: float) -> st.SearchStrategy[float]:
    """Numbers of four digits."""
    return st.floats(low, high, allow_nan=False).map(lambda value: float(f"{value:.4g}"))


def quantities(low: float, high: float, unit: str, per_si: float = 1.0) -> st.SearchStrategy[float | str]:
    """From `low` to `high` in SI, as a bare number or as a text in a unit of which `per_si` make one of SI."""
    return numbers(low, high) | numbers(low, high).map(lambda value: f"{value * per_si:.4g} {unit}")


def lengths(low: float, high: float) -> st.SearchStrategy[float | str]:
    return quantities(low, high, "mm", 1e3)


def courses(values: st.SearchStrategy) -> st.SearchStrategy:
    """One value, or a table in time of it."""
    tables = st.lists(numbers(1e-5, 1e-3), min_size=1, max_size=4, unique=True).flatmap(
        lambda times: st.fixed_dictionaries(
            {"times": st.just(sorted(times)), "values": st.lists(values, min_size=len(times), max_size=len(times))}
        )
    )
    return values | values | tables


def some(**optional: st.SearchStrategy) -> st.SearchStrategy[Table]:
    """A table of which every key may be left out."""
    return st.fixed_dictionaries({}, optional=optional)


def seldom(strategy: st.SearchStrategy) -> st.SearchStrategy:
    """Mostly None."""
    return st.sampled_from((0, 0, 0, 1)).flatmap(lambda on: strategy if on else st.none())


def millimetres(**low_and_high: tuple[float, float]) -> st.SearchStrategy[Table]:
    return st.fixed_dictionaries({name: lengths(1e-3 * a, 1e-3 * b) for name, (a, b) in low_and_high.items()})
