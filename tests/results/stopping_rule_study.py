"""How often runs that end themselves are right: Monte Carlo of the rule with synthetic and recorded torques.

    python tests/results/stopping_rule_study.py [runs a cell]

prints, for each kind of signal and target: fraction of runs called known; how many of these hold the mean of the
averaged part, and the level at its end, in their interval; share of all runs that are called known and wrong;
packings, length over the longest run, and half width over the mean. Before that, for levels of several distributions
and with the scatter of a study or without it: right runs, known ones, packings, half width over the mean.

`quickstart_packings.csv.gz` has the torque on the disc of packings of cases/quickstart.toml in windows of 0.1 ms, of
60 seeds with four packings each up to 8 ms (six where the rule asks for them), and of 32 packings up to 27 ms, whose
mean over the second half is the reference.
"""

from __future__ import annotations

import csv
import gzip
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from types import SimpleNamespace

import numpy as np
from scipy.signal import lfilter

from emclutch.results.replicated_mean import replicated_mean
from emclutch.results.statistics import Estimate
from emclutch.scene.replica_count import AUTOMATIC, DOUBTFUL_FREEDOM, WITH_KNOWN_SCATTER
from emclutch.scene.torque_target import TorqueTarget
from emclutch.simulation.stopping_rule import Stop, StoppingRule, lengths

WINDOWS = 300
OF_STUDY = 16  # degrees of freedom of an accuracy study
FLUCTUATION = 0.05  # standard deviation of a window over the mean
START_UP = 4.22e-3  # s, a shear strain of 9 in the quickstart


@dataclass(frozen=True)
class Signal:
    """AR(1) round 1 with a level of its own for each packing, a drift, and a start-up; times over the longest run.

    Attributes
    ----------
    correlation : (1 + a)/(1 - a) of the AR(1) coefficient a: windows that hold one independent sample.
    packings : standard deviation of the packings' levels.
    drift : rise over the longest run.
    start_up, decay : amplitude and time constant of an exponential.
    levels : their distribution: normal, two modes, lognormal (of a sigma of 0.75), or rare, a tenth of them.
    """

    correlation: float = 6.0
    packings: float = 0.0
    drift: float = 0.0
    start_up: float = 0.0
    decay: float = 0.05
    levels: str = "normal"

    def level(self, rng: np.random.Generator) -> float:
        """A packing's level over `packings`: mean 0, standard deviation 1."""
        if self.levels == "normal":
            return rng.standard_normal()
        if self.levels == "two modes":
            return float(rng.choice([-1.0, 1.0]))
        if self.levels == "rare":
            return (float(rng.random() < 0.1) - 0.1) / 0.3
        square = 0.75**2
        spread = np.sqrt(np.expm1(square) * np.exp(square))
        return float((np.exp(0.75 * rng.standard_normal()) - np.exp(0.5 * square)) / spread)

    def packing(self, seed: int, number: int) -> np.ndarray:
        """One packing's torque (WINDOWS,)."""
        rng = np.random.default_rng([seed, number])
        a, before = (self.correlation - 1.0) / (self.correlation + 1.0), int(10 * self.correlation)
        noise = rng.standard_normal(WINDOWS + before) * FLUCTUATION * np.sqrt(1.0 - a * a)
        t = (np.arange(WINDOWS) + 0.5) / WINDOWS
        own = lfilter([1.0], [1.0, -a], noise)[before:] + self.packings * self.level(rng)
        return 1.0 + own + self.drift * t + self.start_up * np.exp(-t / self.decay)

    def __str__(self) -> str:
        return (
            f"correlation {self.correlation:g}, packings {self.packings:g}, drift {self.drift:g}, "
            f"start-up {self.start_up:g} exp(-t/{self.decay:g}), {self.levels}"
        )


@dataclass(frozen=True)
class Run:
    """How one run ended: whether its torque is called known, and lies in its interval; over the mean where relative."""

    known: bool
    right: bool
    right_at_end: bool
    drifting: bool
    half_width: float
    replicas: int
    length: float


def ended(
    torque_of: Callable[[int, float], tuple], rule: StoppingRule, settled: float, exclude_drift: bool = True,
    first: int = AUTOMATIC, **scatter: float,
) -> tuple[Estimate, bool, int, float]:  # fmt: skip
    """Estimate, whether known, packings and length [s] of a run by the rule; `torque_of` a number up to a time."""
    start = None if exclude_drift else settled
    now = rule.first(first)
    while True:
        signals = [torque_of(number, now.length) for number in range(now.count)]
        found = replicated_mean(
            signals, settled=settled, average_from=start, exclude_drift=exclude_drift, wanted=rule.target.half_width,
            several_looks=True, **scatter,
        )  # fmt: skip
        following = rule.after(found, now)
        if isinstance(following, Stop):
            return found, following.reached, now.count, now.length
        now = following


def run_of(signal: Signal, target: float, seed: int, known_start_up: float = 0.0, max_count: int = 64, *,
           exclude_drift: bool = True, freedom: int = 0, wrong: float = 1.0) -> Run:  # fmt: skip
    """One run of a synthetic signal; `freedom` of the scatter that a study of other packings finds, times `wrong`.

    A study of `OF_STUDY` degrees of freedom is made in any case.
    """
    time, width = (np.arange(WINDOWS) + 1.0) / WINDOWS, np.full(WINDOWS, 1.0 / WINDOWS)
    packing = cache(lambda number: signal.packing(seed, number))

    def torque_of(number: int, length: float) -> tuple:
        n = round(length * WINDOWS)
        return time[:n], packing(number)[:n], width[:n]

    rule = StoppingRule(TorqueTarget(target), lengths(1.0, known_start_up), max_count)
    scatter, first = {}, AUTOMATIC
    if freedom:
        study = [signal.packing(seed, 1000 + number)[WINDOWS // 2 :].mean() for number in range(OF_STUDY + 1)]
        scatter = {"scatter": wrong * np.std(study, ddof=1) / np.mean(study), "scatter_freedom": float(freedom)}
        first = WITH_KNOWN_SCATTER if freedom > DOUBTFUL_FREEDOM else AUTOMATIC
    found, known, count, length = ended(torque_of, rule, known_start_up, exclude_drift, first, **scatter)
    half = found.half_width() or 0.0
    mean, middle = found.mean or 0.0, 0.5 * ((found.start or 0.0) + (found.end or 0.0))
    right = abs(mean - 1.0 - signal.drift * middle) <= half
    at_end = abs(mean - 1.0 - signal.drift * (found.end or 0.0)) <= half
    return Run(known, right, at_end, found.status == "drifting", half / mean, count, length)


def summary_of(runs: Sequence[Run]) -> SimpleNamespace:
    """Shares and means over runs."""
    known = [run for run in runs if run.known]
    return SimpleNamespace(
        known=len(known) / len(runs),
        coverage=float(np.mean([run.right for run in known])) if known else np.nan,
        coverage_at_end=float(np.mean([run.right_at_end for run in known])) if known else np.nan,
        known_and_wrong=sum(not run.right for run in known) / len(runs),
        drifting=float(np.mean([run.drifting for run in runs])),
        half_width=float(np.median([run.half_width for run in runs])),
        replicas=float(np.mean([run.replicas for run in runs])),
        length=float(np.mean([run.length for run in runs])),
    )


@dataclass(frozen=True)
class Packings:
    """Recorded torques [N m] by seed and number of the packing, in windows of equal `width` [s]."""

    width: float
    torques: dict[tuple[int, int], np.ndarray]


def read_packings(kind: str) -> Packings:
    """The rows of one kind, ``run`` or ``reference``."""
    path = Path(__file__).with_name("quickstart_packings.csv.gz")
    with gzip.open(path, "rt", encoding="ascii", newline="") as file:
        rows = [row for row in csv.reader(file) if row[0] == kind]
    return Packings(1e-4, {(int(row[1]), int(row[2])): np.array(row[3:], dtype=float) for row in rows})


def recorded(packings: Packings, seed: int, target: float, reference: float) -> Run:
    """One run of the quickstart out of recorded packings; it ends without a result where it asks for one more."""
    longest = min(len(torque) for torque in packings.torques.values())

    def torque_of(number: int, length: float) -> tuple:
        n = min(longest, round(length / packings.width))
        torque = packings.torques[seed, number][:n]
        return packings.width * np.arange(1, n + 1), torque, np.full(n, packings.width)

    most = sum(one == seed for one, _ in packings.torques)
    rule = StoppingRule(TorqueTarget(target), lengths(longest * packings.width, START_UP), most)
    found, known, count, length = ended(torque_of, rule, START_UP)
    half, mean = found.half_width() or 0.0, found.mean or 0.0
    right = abs(mean - reference) <= half
    return Run(known, right, right, found.status == "drifting", half / mean, count, length)


FRESH = read_packings("run")
_LONG = [torque[len(torque) // 2 :].mean() for torque in read_packings("reference").torques.values()]
REFERENCE = float(np.mean(_LONG))
"""Torque [N m] of 32 packings of three times the length, over their second half."""

if __name__ == "__main__":
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 300
    kinds = [Signal(2.0, 0.1, levels="two modes"), Signal(2.0, 0.09, levels="rare"),
             Signal(2.0, 0.06, levels="lognormal"), Signal(2.0, 0.06)]  # fmt: skip
    for target in (0.10, 0.05, 0.02):
        for kind in kinds:
            for freedom, wrong in ((0, 1.0), (16, 1.0), (6, 1.0), (3, 1.0), (3, 0.7), (3, 0.5)):
                runs = [run_of(kind, target, seed, freedom=freedom, wrong=wrong) for seed in range(count)]
                s, right = summary_of(runs), np.mean([run.right for run in runs])
                print(
                    f"{right:5.3f} right  {s.known:5.2f} known  {s.replicas:5.1f} packings  "
                    f"{100 * s.half_width:5.2f} %  "
                    f"target {100 * target:g} %, {kind}, study {freedom}, its scatter times {wrong:g}",
                    flush=True,
                )
    print("known  holds mean  holds end  known and wrong  drifting  packings  length  half width")
    for target in (0.02, 0.10):
        for correlation in (2.0, 6.0, 20.0):
            kinds = [Signal(correlation, packings) for packings in (0.0, 0.01, 0.03, 0.06)]
            kinds += [Signal(correlation, 0.01, drift) for drift in (0.02, 0.04, 0.06, 0.08, 0.1)]
            kinds += [Signal(correlation, 0.01, 0.0, a, tau) for a in (0.1, 0.2) for tau in (0.05, 0.1, 0.2, 0.3)]
            for kind in kinds:
                s = summary_of([run_of(kind, target, seed) for seed in range(1000, 1000 + count)])
                print(
                    f"{s.known:5.2f}  {s.coverage:10.3f}  {s.coverage_at_end:9.3f}  {s.known_and_wrong:15.3f}  "
                    f"{s.drifting:8.2f}  {s.replicas:8.1f}  {s.length:6.2f}  {100 * s.half_width:9.2f} %  "
                    f"target {100 * target:g} %, {kind}",
                    flush=True,
                )
