"""Averages over seeds: runs that differ in nothing but their random packing are independent measurements of one torque.

Their mean has the standard error s/sqrt(n), s being the standard deviation between the runs. It holds what a run's own
error cannot: how much the packing that it began with matters. With few seeds s itself is uncertain, so the interval is
Student's, of n - 1 degrees of freedom. Runs of equal weight: their own errors, which are estimates too, do not enter.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from emclutch.results.fits import Measured

OF_A_RUN = ("standard_error", "steady_alone", "seconds", "figure_of_merit", "reason", "folder", "started_from")
"""Columns of a single run that have no average over seeds."""


def averaged_over_seeds(rows: Sequence[Mapping[str, Any]], seed: str, others: Sequence[str]) -> list[dict[str, Any]]:
    """A row for each set of the other values, in the order in which these are met.

    Parameters
    ----------
    rows : of single runs, with the columns `seed` and `others`, `torque` [N m], `converged`; `steady_alone` of runs
        of one replica, which lack nothing but the scatter between replicas.
    seed : column of the seed.
    others : columns of the other values of the study.

    Returns
    -------
    list of dict
        The other values; `seeds`, how many; `torque` with its `standard_error` [N m] from the scatter between the seeds
        and the ends `low`, `high` of its 95 % interval, None of one seed; `converged` where all runs are, or lack
        nothing but the scatter that several seeds show; the mean of
        every other column of numbers, None where a run has none; of an `..._error` the error of that mean, as of the
        torque.
    """
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault(repr([row[key] for key in others]), []).append(row)
    return [_average(group, seed, others) for group in groups.values()]


def _average(group: Sequence[Mapping[str, Any]], seed: str, others: Sequence[str]) -> dict[str, Any]:
    first = group[0]
    torques = [row["torque"] for row in group]
    found = {key: first[key] for key in others} | {"seeds": len(group)} | _spread(torques)
    is_several = len(group) > 1
    found["converged"] = all(row["converged"] or (is_several and row.get("steady_alone") is True) for row in group)
    for name in first:
        if name not in (seed, *others, *found, *OF_A_RUN):
            values: list[Any] = [row.get(name) for row in group]
            numbers = all(isinstance(value, (int, float)) and not isinstance(value, bool) for value in values)
            if numbers and name.endswith("_error") and name.removesuffix("_error") in first:  # not the runs' own
                of = [row[name.removesuffix("_error")] for row in group]
                found[name] = Measured.of(of).error if len(of) > 1 else None
            else:
                found[name] = float(np.mean(values)) if numbers else None
    return found


def _spread(torques: Sequence[float | None]) -> dict[str, float | None]:
    """Mean torque [N m] and what its scatter says of it."""
    if len(torques) == 1 or None in torques:
        return {"torque": torques[0] if len(torques) == 1 else None, "standard_error": None, "low": None, "high": None}
    mean = Measured.of(torques)
    low, high = mean.interval()
    return {"torque": mean.value, "standard_error": mean.error, "low": low, "high": high}
