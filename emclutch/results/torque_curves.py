"""Torque curves of a study: torque over one of its values, a curve for each set of the others."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.errors import OutputError
from emclutch.results.fits import NORMAL

if TYPE_CHECKING:
    from emclutch.results.result import Result

PER_GAP, REAL_PER_GAP = "grains_per_gap", "real_grains_per_gap"
"""Columns: grains across the sheared gap, those of the scene and those of the powder that they stand for."""
BEST_ESTIMATE = "best_torque", "best_low", "best_high"
"""Columns [N m] of torques that are corrected for their settings (`emclutch.results.best_estimate`): with the ends of
the 95 % interval."""


def best_of(row: Mapping[str, Any]) -> tuple[float | None, tuple[float, float] | None]:
    """Return the best estimate of a row of ``study.csv`` and its 95 % interval [N m]; the raw torque without one."""
    names = BEST_ESTIMATE if row.get(BEST_ESTIMATE[0]) is not None else ("torque", "low", "high")
    torque, low, high = (row.get(name) for name in names)
    return torque, None if low is None or high is None else (low, high)


@dataclass(frozen=True, slots=True)
class TorqueCurve:
    """Points of one curve, by increasing x.

    Attributes
    ----------
    values : the study's other values, the same for all points; empty where it has none.
    x : (n,) current [A], speed [rad/s] or grains per gap.
    torque : (n,) [N m]; nan where a run has none.
    error : (n,) standard errors [N m]; nan where unknown. Of few replicas it is larger than their scatter says: a
        normal distribution of this error has the 95 % interval of Student's.
    converged : (n,) whether the run says so.
    real_across : grains of the real powder across the gap, where all points have the same and say it.
    best : (n,) best estimates of the torques, corrected for their settings [N m]; nan where they are the raw ones.
    seeds : (n,) runs of different seeds behind each torque; nan where it is that of one run.
    """

    values: dict[str, Any]
    x: np.ndarray
    torque: np.ndarray
    error: np.ndarray
    converged: np.ndarray
    real_across: float | None = None
    best: np.ndarray | None = None
    seeds: np.ndarray | None = None

    def along(self, x: np.ndarray) -> TorqueCurve:
        """Return the same torques over another x, (n,)."""
        return replace(self, x=x)

    def over_rated(self, rated: float) -> TorqueCurve:
        """Return the curve over its point at a rated current, the errors of both torques of a ratio counted.

        Raises
        ------
        OutputError
            The curve has no torque at that current, or none but zero.
        """
        at = np.flatnonzero(np.isclose(self.x, rated, rtol=1e-3) & np.isfinite(self.torque) & (self.torque != 0.0))
        if not at.size or rated == 0.0:
            known = ", ".join(f"{x:.4g}" for x in self.x[np.isfinite(self.torque) & (self.torque != 0.0)])
            raise OutputError(
                f"{self.label or 'the curve'} has no torque at {rated:.4g} A to divide by; it has: {known} A"
            )
        torque, error = self.torque[at[0]], self.error[at[0]]
        ratio = self.torque / torque
        of_ratio = np.hypot(self.error, ratio * error) / abs(torque)
        of_ratio[at[0]] = 0.0
        return replace(self, x=self.x / self.x[at[0]], torque=ratio, error=of_ratio, best=None)

    @property
    def label(self) -> str:
        """The last part of each other value's key, with the value."""
        return ", ".join(f"{key.rpartition('.')[2].replace('_', ' ')} {value}" for key, value in self.values.items())


def torque_curves(rows: Sequence[Mapping[str, Any]], x: str, others: Sequence[str]) -> list[TorqueCurve]:
    """Curves of a study's rows, in the order in which the other values are met.

    Parameters
    ----------
    rows : columns `x`, `others`, `torque`, `standard_error` [N m] or None, `converged`, and where known the ends `low`
        and `high` [N m] of the torque's 95 % interval.
    x : name of the column along the curves.
    others : names of the columns in which the curves differ.
    """
    groups: dict[str, list[Mapping[str, Any]]] = {}
    for row in rows:
        groups.setdefault(repr([row[key] for key in others]), []).append(row)
    curves = []
    for group in groups.values():
        ordered = sorted(group, key=lambda row: row[x])
        real = np.unique(_numbers([row.get(REAL_PER_GAP) for row in ordered]).round(6))
        curves.append(
            TorqueCurve(
                {key: group[0][key] for key in others},
                _numbers([row[x] for row in ordered]),
                _numbers([row["torque"] for row in ordered]),
                _numbers([_error(row) for row in ordered]),
                np.array([bool(row["converged"]) for row in ordered]),
                float(real[0]) if real.size == 1 and np.isfinite(real[0]) else None,
                _numbers([row.get(BEST_ESTIMATE[0]) for row in ordered]),
                _numbers([row.get("seeds") for row in ordered]),
            )
        )
    return curves


def row_of_run(result: Result) -> dict[str, Any]:
    """Return a run as a row of `torque_curves`, over its current at the end or its grains per gap."""
    torque, size = result.torque, result.summary.get("grain_size", {})
    low, high = torque.interval() if torque.known else (None, None)
    return {"torque": torque.mean, "standard_error": torque.standard_error, "low": low, "high": high,
            "converged": torque.converged, "current": result.summary.get("current"), PER_GAP: size.get("across"),
            REAL_PER_GAP: size.get("real_across")}  # fmt: skip


def _error(row: Mapping[str, Any]) -> float | None:
    if row.get("high") is not None:
        return 0.5 * (row["high"] - row["low"]) / NORMAL
    return row.get("standard_error")


def _numbers(values: Sequence[float | None]) -> np.ndarray:
    """None becomes nan, which is not drawn."""
    return np.array([np.nan if value is None else value for value in values], dtype=np.float64)
