"""Which points of a curve are run: those that narrow the intervals that are too wide most for what they cost.

The study's values are candidates: places along a curve, and replicas of each (`scene.seed`). Four places with two
replicas each begin. Then batches of `BATCH` are chosen one after the other: of the candidates the one that makes
sum over the places of (half width^2 - aim^2), where that is above zero, least per cost; each choice counts on the ones
before, for the interval of `emclutch.results.curve_interval` narrows by what is measured where, whatever the result.
A batch follows from the results of those before it alone, so that neither the number of processes nor an interruption
changes what is run. The cost of a place is counted in steps times grains, and not in seconds, for the same reason.
"""

from __future__ import annotations

import logging
from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from emclutch.results import load_result
from emclutch.results.atomic_file import replace_text
from emclutch.results.curve_interval import CurveInterval, curve_interval
from emclutch.scene.sampling import places_along
from emclutch.scene.study import StudySection

log = logging.getLogger(__name__)
BEGIN, REPLICAS, BATCH = 4, 2, 4
"""Places and replicas that begin, and points of each later batch."""


@dataclass(frozen=True, slots=True)
class MeasuredPlace:
    """Result of a point.

    Attributes
    ----------
    torque : [N m].
    cost : in any unit, the same for all.
    """

    torque: float
    cost: float


class AdaptiveCurve:
    """Chooses the points of a curve in batches.

    Parameters
    ----------
    places : of each candidate its place along the curve, above 0.
    error : half of the 95 % interval that is wanted everywhere, relative.
    most : points at most.
    """

    def __init__(self, places: Sequence[float], error: float, most: int) -> None:
        self.places, self.error, self.most = np.asarray(places, dtype=float), error, most
        self.at, count = np.unique(self.places, return_counts=True)
        self.replica = np.empty(len(self.places), dtype=int)  # of each candidate its number at its place: its seed's
        self.replica[np.argsort(self.places, kind="stable")] = np.concatenate([np.arange(one) for one in count])
        self.chosen: list[int] = []
        self.curve: CurveInterval | None = None  # of what was measured before the last batch

    @property
    def is_reached(self) -> bool:
        """True if the interval is as narrow as wanted everywhere."""
        return self.curve is not None and bool((self.curve.half_width <= np.log1p(self.error)).all())

    def next_batch(self, measured: Mapping[int, MeasuredPlace], failed: Collection[int] = ()) -> list[int]:
        """Return the next candidates to run, by number; none where the aim, or the end of the candidates, is reached.

        All that were chosen before must have been `measured` or have `failed`.

        Raises
        ------
        ValueError
            A torque is not above 0.
        """
        known = [number for number in self.chosen if number in measured]
        if not self.chosen:
            begin = self.at[np.unique(np.linspace(0, len(self.at) - 1, BEGIN).round().astype(int))]
            batch = self._of_each(begin, REPLICAS)
        else:
            batch = self._best(known, measured)
        batch = batch[: self.most - len(self.chosen)]
        self.chosen += batch
        return batch

    def _best(self, known: list[int], measured: Mapping[int, MeasuredPlace]) -> list[int]:
        x, torque, cost = (
            np.array(one)
            for one in (
                self.places[known],
                [measured[number].torque for number in known],
                [measured[number].cost for number in known],
            )
        )
        if len(known) < 4 or np.unique(x).size < 2:  # the others have failed
            return self._of_each(self.at, 1)[:BATCH]
        self.curve = curve = curve_interval(x, torque, self.at)
        if self.is_reached:
            return []
        costs = np.interp(self.at, np.unique(x), [cost[x == place].mean() for place in np.unique(x)])
        batch: list[int] = []
        aim = float(np.log1p(self.error))
        while len(batch) < BATCH:
            free = {place: numbers for place, where in enumerate(self.at) if (numbers := self._free(where, batch))}
            if not free:
                break
            wide = _excess(curve, aim)
            narrowed = {place: curve.narrowed(place) for place in free}
            gain = {place: (wide - _excess(one, aim)) / costs[place] for place, one in narrowed.items()}
            best = max(gain, key=lambda place: (gain[place], -place))
            batch.append(free[best][0])
            curve = narrowed[best]
            if wide <= 0.0:
                break
        return batch

    def _of_each(self, places: np.ndarray, count: int) -> list[int]:
        """So many free candidates of each place."""
        batch: list[int] = []
        for place in places:
            batch += self._free(place, batch)[:count]
        return batch

    def _free(self, place: float, batch: Sequence[int]) -> list[int]:
        """Candidates of a place that are neither chosen nor in the batch, those first whose seed was used least so far.

        Runs with the same seed begin with the same packing: what they have in common is no scatter of the curve.
        """
        chosen = np.array([*self.chosen, *batch], dtype=int)
        numbers = np.setdiff1d(np.flatnonzero(self.places == place), chosen)
        used = np.bincount(self.replica[chosen], minlength=self.replica.max() + 1)[self.replica[numbers]]
        return numbers[np.argsort(used, kind="stable")].tolist()


class AdaptiveStudy:
    """The points of a study, chosen by their results; ``adaptive_curve.csv`` and ``.txt`` say what is known so far.

    Parameters
    ----------
    study : that is adaptive.
    folder : of its results.
    """

    def __init__(self, study: StudySection, folder: Path) -> None:
        assert study.sample is not None and study.sample.error is not None
        self._folder, points = folder, study.points()
        self._key, numbers = places_along(study.values)
        place_of = dict(zip(map(repr, study.values[self._key]), numbers, strict=True))
        self._entry_of = dict(zip(numbers, study.values[self._key], strict=True))
        self._curve = AdaptiveCurve(
            [place_of[repr(point[self._key])] for point in points],
            study.sample.error,
            min(study.sample.count or len(points), len(points)),
        )
        self._ended = False

    def next_points(self, done: Mapping[int, Mapping[str, Any]], failed: Collection[int]) -> list[int]:
        """Return the numbers of the next points, none where there are no more; `done` are the rows of those done.

        Raises
        ------
        ValueError
            A torque is not known, or not above 0.
        """
        curve = self._curve
        if self._ended or not set(curve.chosen) <= {*done, *failed}:
            return []
        measured = {}
        for number in curve.chosen:
            if number in done:
                row = done[number]
                if (torque := row["torque"]) is None:
                    raise ValueError(f"{row['folder']} has no mean torque; run longer")
                summary = load_result(self._folder / row["folder"]).summary
                measured[number] = MeasuredPlace(torque, float(summary["steps"]) * summary["grains"])
        batch = curve.next_batch(measured, failed)
        self._ended = not batch
        if curve.curve is not None:
            self._write(curve.curve, measured)
        return batch

    def _write(self, curve: CurveInterval, measured: Mapping[int, MeasuredPlace]) -> None:
        """Write the curve with its interval, and say where it is widest."""
        replicas = [sum(self._curve.places[number] == place for number in measured) for place in curve.x]
        lines = [f"{self._key},torque,low,high,replicas"]
        for place, torque, half, count in zip(curve.x, curve.torque, curve.half_width, replicas, strict=True):
            low, high = torque * np.exp(-half), torque * np.exp(half)
            lines.append(f"{self._entry_of[place]},{float(torque)!r},{float(low)!r},{float(high)!r},{count}")
        replace_text(self._folder / "adaptive_curve.csv", "\n".join(lines) + "\n")
        widest = int(np.argmax(curve.half_width))
        state = "as narrow as wanted" if self._curve.is_reached else f"{100.0 * self._curve.error:.3g} % is wanted"
        if self._ended and not self._curve.is_reached:
            state += ", and there are no more points: list more scene.seed, or raise study.sample.count"
        most, where = np.expm1(curve.half_width[widest]), self._entry_of[curve.x[widest]]
        text = (
            f"after {len(measured)} replicas the curve's 95 % interval is at most ± {100.0 * most:.2g} %, at "
            f"{self._key} = {where}: {state}; one replica scatters by {100.0 * curve.noise:.2g} %"
        )
        if (seeds := self._curve.replica.max() + 1) < BEGIN * REPLICAS:
            text += (
                f"; the places that begin share {seeds} seeds, and the interval does not have what runs of one seed "
                f"have in common: list {BEGIN * REPLICAS} scene.seed or more"
            )
        replace_text(self._folder / "adaptive_curve.txt", text + "\n")
        log.info("%s", text)


def _excess(curve: CurveInterval, aim: float) -> float:
    return float(np.maximum(curve.half_width**2 - aim**2, 0.0).sum())
