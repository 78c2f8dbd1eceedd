"""Values of a study that are not listed: ranges, and points that are sampled from them.

A range with a count is a list of so many values. Ranges without one span a cube, in which `[study.sample]` places
points: by a Latin hypercube (each of n equal layers of every value has one point: McKay, Beckman, Conover,
Technometrics 21, 1979) or by Sobol's sequence, scrambled (Owen, J. Complexity 14, 1998), both of `scipy.stats.qmc`. The
points follow from the seed alone. Values are rounded to six digits: what stands in the tables is what was run.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator
from typing import Annotated, Any

import numpy as np
from pydantic import Field, PrivateAttr

from emclutch.scene.errors import Fault, shown
from emclutch.scene.section import Choice, Integer, Section

SEED = "scene.seed"
"""Its values are replicas of every point, of whatever design."""
MOST = 10_000  # samples, and values of a range
METHODS = ("latin_hypercube", "sobol", "saltelli", "one_at_a_time")
"""All but the last place points in the ranges without a count."""
_FORMER = (("adaptive", "is no method any more; emclutch map gives a torque curve with its interval in seconds"),)
_RANGE = ("from", "to", "count", "spacing", "whole")
_EXAMPLE = '{ from = "0.25 A", to = "1 A" }'
_NUMBER_AND_UNIT = re.compile(r"\s*([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?)\s*(.*?)\s*")


class SampleSection(Section):
    """[study.sample]: the points are a sample of the values' ranges, in place of every combination.

    `latin_hypercube` and `sobol` sample the ranges without a count; listed values are combined with each point of the
    sample. `saltelli` has `count` points of Sobol's sequence and d + 1 more for each of them, of d ranges, from which
    Sobol' indices follow (docs/how_to/sensitivity.md). `one_at_a_time` begins with the first value of every key, and
    changes one key at a time to its others; it has no count and no seed. Values of `scene.seed` are replicas of every
    point.
    """

    method: Annotated[str, Choice(METHODS, elsewhere=_FORMER)] = Field(description="how the points are chosen")
    count: Annotated[int, Integer(1, MOST, "64")] | None = Field(
        default=None, description="points of the sample; of sobol and saltelli a power of two"
    )
    seed: Annotated[int, Integer(0, 2**63 - 1, "1")] | None = Field(
        default=None, description="of the random numbers; without it 0"
    )
    _over: tuple[str, ...] = PrivateAttr(default=())

    @property
    def over(self) -> tuple[str, ...]:
        """Keys of the ranges that are sampled."""
        return self._over

    def points(self, values: dict[str, list[Any]]) -> list[dict[str, Any]]:
        """Return the points: values of each key, in the order of the keys."""
        crossed = {key: options for key, options in values.items() if key not in self._over}
        if self.method != "one_at_a_time":
            rows: Iterator[dict[str, Any]] = (
                {key: values[key][place] for key in self._over} for place in range(self._sampled)
            )
        else:
            crossed = {key: options for key, options in values.items() if key == SEED}
            varied = {key: options for key, options in values.items() if key != SEED}
            base = {key: options[0] for key, options in varied.items()}
            rows = iter([base, *({**base, key: one} for key, options in varied.items() for one in options[1:])])
        return [{key: (row | point)[key] for key in values} for row in rows for point in combinations(crossed)]

    def size(self, values: dict[str, list[Any]]) -> int:
        """Return how many points there are, without making them."""
        if self.method == "one_at_a_time":
            return (1 + sum(len(options) - 1 for key, options in values.items() if key != SEED)) * len(
                values.get(SEED, [0])
            )
        return self._sampled * math.prod(len(options) for key, options in values.items() if key not in self._over)

    @property
    def _sampled(self) -> int:
        """Points of the sample itself."""
        return (self.count or 0) * (len(self._over) + 2 if self.method == "saltelli" else 1)


def combinations(values: dict[str, list[Any]]) -> list[dict[str, Any]]:
    """Return every combination of the values, the last key running fastest."""
    found: list[dict[str, Any]] = [{}]
    for key, options in values.items():
        found = [{**point, key: one} for point in found for one in options]
    return found


def is_range(entry: Any) -> bool:
    """True if a table is a range, and no part of a dotted key."""
    return isinstance(entry, dict) and any(not isinstance(entry.get(end, {}), (dict, list)) for end in ("from", "to"))


def read_ranges(
    values: dict[str, Any], sample: SampleSection | None, is_unknown: bool = False
) -> tuple[dict[str, Any], SampleSection | None, list[Fault]]:
    """Return the values with lists in place of ranges, the sample with the keys it is over, and the faults.

    Of a sample each list has the value of every point. Where there are faults everything is left as it is.
    `is_unknown` : the study's sample has faults of its own, so that a range without a count may be right.
    """
    ranges: dict[str, _Range] = {}
    faults: list[Fault] = []
    for key, entry in values.items():
        if is_range(entry):
            found, wrong = _range_of(f"study.values.{key}", entry)
            faults += wrong
            if found is not None:
                ranges[key] = found
    spans = sample is not None and sample.method != "one_at_a_time"
    over = [key for key, one in ranges.items() if one.count is None]
    if sample is not None:
        faults += _sample_faults(sample, bool(over) or bool(faults))
    if is_unknown and over:
        return values, sample, faults
    if not spans:
        remedy = "give it a count" if sample is not None else "give it a count, or sample it: [study.sample]"
        faults += [Fault(f"study.values.{key}", shown(values[key]), f"has no count; {remedy}") for key in over]
    elif SEED in over:
        words = "has no count: each point would have a single replica; give it a count, or list the seeds"
        faults.append(Fault(f"study.values.{SEED}", shown(values[SEED]), words))
    if faults:
        return values, sample, faults
    lists: dict[str, Any] = {key: one.listed() for key, one in ranges.items()}
    if spans and sample is not None:
        cube = _cube(sample, len(over))
        lists |= {key: ranges[key].values(cube[:, place]) for place, key in enumerate(over)}
        sample = sample.model_copy()
        sample._over = tuple(over)
    return {key: lists.get(key, entry) for key, entry in values.items()}, sample, []


def _cube(sample: SampleSection, dimensions: int) -> np.ndarray:
    """Points in the unit cube, shape (count, dimensions); of saltelli (count (dimensions + 2), dimensions)."""
    from scipy.stats import qmc  # local: it takes a second to import

    count, seed = sample.count or 0, sample.seed or 0
    if sample.method == "saltelli":  # the order of SALib: of each point A, A with one column of B each, B
        both = np.asarray(qmc.Sobol(2 * dimensions, seed=seed).random_base2(count.bit_length() - 1))
        rows = np.repeat(both[:, None, :dimensions], dimensions + 2, axis=1)
        rows[:, -1] = both[:, dimensions:]
        for one in range(dimensions):
            rows[:, one + 1, one] = both[:, dimensions + one]
        return rows.reshape(-1, dimensions)
    if sample.method == "sobol":
        return np.asarray(qmc.Sobol(dimensions, seed=seed).random_base2(count.bit_length() - 1))
    return np.asarray(qmc.LatinHypercube(dimensions, seed=seed).random(count))


def _sample_faults(sample: SampleSection, has_ranges: bool) -> list[Fault]:
    key, count = "study.sample", sample.count
    if sample.method == "one_at_a_time":
        words = "has no meaning with method = 'one_at_a_time'; remove it"
        given = {"count": count, "seed": sample.seed}
        return [Fault(f"{key}.{name}", str(one), words) for name, one in given.items() if one is not None]
    faults = []
    if count is None:
        faults.append(Fault(f"{key}.count", "", f"is missing; allowed: 1 to {MOST} points, e.g. count = 64"))
    elif sample.method in ("sobol", "saltelli") and count.bit_count() != 1:
        below = 2 ** (count.bit_length() - 1)
        words = f"is no power of two, and Sobol's sequence is even only then; take {below} or {2 * below}"
        faults.append(Fault(f"{key}.count", str(count), words))
    if not has_ranges:
        words = f"samples ranges without a count, and study.values has none; write one as in {_EXAMPLE}, or remove it"
        faults.append(Fault(f"{key}.method", f"'{sample.method}'", words))
    return faults


class _Range:
    """Values between two ends, in the unit in which they are given."""

    def __init__(self, low: float, high: float, unit: str | None, count: int | None, log: bool, whole: bool) -> None:
        self.low, self.high, self.unit, self.count, self.log, self.whole = low, high, unit, count, log, whole

    def listed(self) -> list[Any]:
        """Return its `count` values."""
        return self.values(np.linspace(0.0, 1.0, self.count or 1))

    def values(self, fractions: np.ndarray) -> list[Any]:
        """Return the entries at these fractions of the way from one end to the other, shape (n,)."""
        if self.whole:  # so that the ends are as likely as all others
            span = self.high - self.low + 1.0
            if self.count is None:
                return [int(min(self.low + np.floor(span * one), self.high)) for one in fractions]
            return [round(self.low + (self.high - self.low) * one) for one in fractions]
        if self.log:
            found = self.low * (self.high / self.low) ** fractions
        else:
            found = self.low + (self.high - self.low) * fractions
        if self.unit is None:
            return [float(f"{one:.6g}") for one in found]
        return [f"{one:.6g} {self.unit}" for one in found]


def _range_of(key: str, entry: dict[str, Any]) -> tuple[_Range | None, list[Fault]]:
    """Return a range, or its faults."""
    faults = [
        Fault(f"{key}.{name}", shown(entry[name]), f"is no key of a range, which may have: {', '.join(_RANGE)}")
        for name in entry
        if name not in _RANGE
    ]
    ends = {name: _number_and_unit(entry.get(name)) for name in ("from", "to")}
    for name, end in ends.items():
        if end is None:
            given = shown(entry[name]) if name in entry else ""
            what = "is no number with its unit" if name in entry else "is missing"
            faults.append(Fault(f"{key}.{name}", given, f"{what}; write the range as in {_EXAMPLE}"))
    count, spacing, whole = entry.get("count"), entry.get("spacing", "linear"), entry.get("whole", False)
    if count is not None and (type(count) is not int or not 2 <= count <= MOST):
        faults.append(Fault(f"{key}.count", shown(count), f"is out of range; allowed: 2 to {MOST} values"))
    if spacing not in ("linear", "log"):
        faults.append(Fault(f"{key}.spacing", shown(spacing), "is unknown; allowed: 'linear', 'log'"))
    if type(whole) is not bool:
        faults.append(Fault(f"{key}.whole", shown(whole), "is neither true nor false"))
    if ends["from"] is None or ends["to"] is None:
        return None, faults
    (low, unit), (high, other) = ends["from"], ends["to"]
    if unit != other:
        words = f"has another unit than from = {shown(entry['from'])}; write both in the same unit"
        faults.append(Fault(f"{key}.to", shown(entry["to"]), words))
    elif not low < high:
        words = f"is not above from = {shown(entry['from'])}; exchange them, or set the key in study.set"
        faults.append(Fault(f"{key}.to", shown(entry["to"]), words))
    if spacing == "log" and low <= 0.0:
        faults.append(
            Fault(f"{key}.from", shown(entry["from"]), "has no logarithm; allowed: above 0, or spacing = 'linear'")
        )
    if whole is True and (unit is not None or low != int(low) or high != int(high) or spacing == "log"):
        words = "needs whole numbers without a unit at both ends, and linear spacing; change them or remove it"
        faults.append(Fault(f"{key}.whole", "true", words))
    elif whole is True and type(count) is int and count > high - low + 1.0:
        words = f"is more than there are whole numbers from {low:g} to {high:g}; allowed: at most {high - low + 1.0:g}"
        faults.append(Fault(f"{key}.count", str(count), words))
    if faults:
        return None, faults
    return _Range(low, high, unit, count, spacing == "log", whole), []


def _number_and_unit(entry: Any) -> tuple[float, str | None] | None:
    """Return a number and its unit, None for one without; None for what is no finite number."""
    if type(entry) in (int, float) and math.isfinite(entry):
        return float(entry), None
    match = _NUMBER_AND_UNIT.fullmatch(entry) if isinstance(entry, str) else None
    return (float(match[1]), match[2]) if match is not None and match[2] else None
