"""Made-up devices: whole accuracy studies and runs by their answers, of scenes whose errors are drawn by chance.

ln T = sum of b_k + d + k sum of b_i b_j over pairs, b_k = c_k (h^p_k - L^p_k), with a coefficient and an order that are
drawn for each setting, deviations d of the grain size from its law (layers), and replicas that scatter by 2 %. As a
script it prints coverage and widths for several kinds of devices, each with its own study:

    python tests/studies/made_up_devices.py 250
"""

from __future__ import annotations

import math
import sys
from dataclasses import dataclass

import numpy as np
from scipy.special import stdtrit

from emclutch.results.accuracy_study import AccuracyStudy, Basis, MeasuredSetting, MeasuredValue, pooled_scatter
from emclutch.results.recommended import Choice, own_choice, recommended
from emclutch.studies.accuracy.plan import (
    OWN,
    Aim,
    OfferedSetting,
    OfferedValue,
    Torques,
    first_replicas,
    makespan,
    more_replicas,
)

SECONDS, SCATTER, BUDGET = 50.0, 0.02, 600.0
REAL = 1.0 / 16.7
GRAINS = "grains"
GRAIN_ERRORS = (0.25, 0.1, 0.02)
SETTINGS = {  # order in theory, limit, own step size, others with seconds and variance
    GRAINS: (2.0, REAL, 1 / 4, [(1 / 5, 87, 0.8), (1 / 8, 262, 0.25), (1 / 12, 900, 0.25)]),
    "sector": (2.0, 0.0, 1 / 6, [(1 / 12, 82, 0.5), (1 / 24, 137, 0.25)]),
    "overlap": (0.5, 0.0, 0.005, [(0.02, 41, 1.0), (0.01, 50, 1.0), (0.0025, 79, 1.0)]),
    "step": (2.0, 0.0, 1 / 20, [(1 / 10, 44, 1.0), (1 / 14, 50, 1.0), (1 / 40, 74, 1.0)]),
    "update": (1.0, 0.0, 2.5, [(10.0, 33, 1.0), (5.0, 48, 1.0)]),
}


@dataclass(frozen=True)
class Kind:
    """A kind of devices: standard deviation of small errors, factor by which orders are off, deviation of the grain
    size at 4 per gap (falling as 1/n^2), k of the interaction, and an error that one small setting really has."""

    small: float = 0.005
    orders: float = 1.0
    layers: float = 0.0
    interaction: float = 0.0
    one: float = 0.0


KINDS = {
    "small errors 0.5 %": Kind(),
    "small errors 1 %, orders off by 1.4": Kind(0.01, 1.4),
    "layers 3 %, orders off by 1.4, k = -3": Kind(0.005, 1.4, 0.03, -3.0),
    "orders off by 2": Kind(0.005, 2.0),
    "one small setting off by 5 %": Kind(one=0.05),
}


class Device:
    """A made-up scene, whose torque without errors is 1 N m."""

    def __init__(self, random, kind=Kind()):
        self.random, self.kind, self.errors, self.orders = random, kind, {}, {}
        self.offers = []
        one_small = random.choice([name for name in SETTINGS if name != GRAINS])
        for name, (order, limit, own, others) in SETTINGS.items():
            offered = tuple(OfferedValue(1.0 / h, h, float(seconds), variance) for h, seconds, variance in others)
            here = OfferedValue(1.0 / own, own, SECONDS, 1.0)
            self.offers.append(OfferedSetting(name, order, limit, here, offered, name == GRAINS))
            error = random.choice(GRAIN_ERRORS) if name == GRAINS else kind.small * random.standard_normal()
            if kind.one and name == one_small:
                error = kind.one * random.choice([-1.0, 1.0])
            p = order * kind.orders ** random.choice([-1.0, 1.0])
            self.orders[name], self.errors[name] = p, error / (own**p - limit**p)
        self.values = {(one.name, offered.value): offered for one in self.offers for offered in one.values}
        self.layers = {one.value: kind.layers * (4.0 * one.step_size) ** 2 * random.standard_normal()
                       for one in (self.offers[0].own, *self.offers[0].values)}  # fmt: skip

    def at(self, values):
        """Return ln T and the variance of a replica over that at the scene's own settings."""
        parts, variance = [], 1.0
        for one in self.offers:
            offered = self.values.get((one.name, values.get(one.name)), one.own)
            p = self.orders[one.name]
            parts.append(self.errors[one.name] * (offered.step_size**p - one.limit**p))
            parts[-1] += self.layers[offered.value] if one.name == GRAINS else 0.0
            variance *= offered.variance
        pairs = 0.5 * (sum(parts) ** 2 - sum(part**2 for part in parts))
        return sum(parts) + self.kind.interaction * pairs, variance

    def torques(self, values, count):
        """Return so many replicas at some settings; the scene's own for all others."""
        mean, variance = self.at(values)
        return math.exp(mean) * (1.0 + SCATTER * math.sqrt(variance) * self.random.standard_normal(count))

    def study(self):
        """Return the accuracy study, as `emclutch.studies.accuracy.study` but with one step less."""
        run = {OWN: list(self.torques({}, 4))}

        def do(replicas):
            for key in replicas:
                run.setdefault(key, []).extend(self.torques({} if key == OWN else {key[0]: key[1]}, 1))

        def scatter():
            return pooled_scatter(
                [(some, 1.0 if key == OWN else self.values[key].variance) for key, some in run.items()]
            )

        room = BUDGET - 2.0 * SECONDS
        do(first := first_replicas(self.offers, 4, room, 2))
        room -= makespan([self.values[one].seconds for one in first], 2)
        found = Torques({key: float(np.mean(some)) for key, some in run.items()}, *scatter())
        count = {key: len(some) for key, some in run.items()}
        do(more_replicas(self.offers, count, found, SECONDS, room, 2, [Aim()]))
        return self.accuracy_study(run, *scatter())

    def accuracy_study(self, run, scatter, freedom):
        torques = {key: float(np.mean(some)) for key, some in run.items()}
        count = {key: len(some) for key, some in run.items()}
        settings = self.start_up(), *(one.measured(torques, count, scatter, freedom) for one in self.offers)
        n, mean = count[OWN], torques[OWN]
        return AccuracyStudy("abc", "made up", {}, mean, scatter, freedom, None, n, SECONDS, settings)

    @staticmethod
    def start_up():
        """Return a start-up that is over, without noise: a run need not exclude a drift."""
        offered = tuple(MeasuredValue(one, 1.0 / one, 1.0, 0.0, 4, SECONDS, one / 9.0) for one in (9.0, 13.5))
        return MeasuredSetting("start_up", "time.average_from", Basis.START_UP, 9.0, None, 0.0, offered)

    def run(self, accuracy_study, choice):
        """Return the error of a run's best estimate, and half its 95 % interval, relative."""
        values = {name: one for name, one in choice.values.items() if name != "start_up"}
        torques, n = self.torques(values, choice.replicas), choice.replicas
        mean, freedom = float(torques.mean()), accuracy_study.freedom + n - 1
        scatter = math.sqrt(
            (accuracy_study.freedom * choice.scatter**2 + (n - 1) * np.var(torques, ddof=1) / mean**2) / freedom
        )
        statistical = float(stdtrit(freedom, 0.975)) * scatter / math.sqrt(n)
        return abs(mean / (1.0 + choice.total.bias) - 1.0), math.hypot(statistical, choice.total.half_width)


def covered(kind, draws, seed=33):
    """Return rows of errors and half widths (n, 2) of runs at the own settings, and at those for 10 and 5 %."""
    random, found = np.random.default_rng(seed), {"own": [], 0.10: [], 0.05: []}
    for _ in range(draws):
        device = Device(random, kind)
        accuracy_study = device.study()
        for name, rows in found.items():
            choice = own_choice(accuracy_study) if name == "own" else recommended(accuracy_study, float(name))
            if isinstance(choice, Choice):
                rows.append(device.run(accuracy_study, choice))
    return {name: np.array(rows).reshape(-1, 2) for name, rows in found.items()}


if __name__ == "__main__":
    for name, kind in KINDS.items():
        for target, rows in covered(kind, int(sys.argv[1])).items():
            if len(rows):
                error, half = rows.T
                wide, ratio = 100.0 * np.median(half), np.median(half) / np.median(error)
                print(f"{name:40} {target!s:5} n {len(rows):4} covered {np.mean(error <= half):.3f} "
                      f"half width {wide:.1f} %, over the median error {ratio:.1f}", flush=True)  # fmt: skip
