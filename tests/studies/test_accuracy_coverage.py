"""Settings that a study finds for a wanted accuracy keep it: whole studies and runs of made-up scenes, drawn by chance.

What the settings are chosen by has noise, and the cheapest of many choices is often one that the noise favours. The
truth here is ln T = c (h^p - h_0^p) for each knob, with a coefficient that is drawn, and packings that scatter by 2 %.
"""

import math
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from emclutch.results.ladder import Basis, KnobLadder, Ladder, Rung, pooled_scatter
from emclutch.results.recommended import Choice, recommended
from emclutch.studies.accuracy.plan import (
    OWN,
    Aim,
    OfferedKnob,
    OfferedRung,
    Torques,
    first_packings,
    makespan,
    more_packings,
)

SECONDS, SCATTER, BUDGET, DRAWS = 50.0, 0.02, 600.0, 25
REAL = 1.0 / 16.7
KNOBS = {  # order, limit, own step size, others with seconds and variance, errors of the own one to be drawn from
    "grains": (2.0, REAL, 1 / 4, [(1 / 5, 87, 0.8), (1 / 8, 262, 0.25), (1 / 12, 900, 0.25)], (0.25, 0.1, 0.02)),
    "sector": (2.0, 0.0, 1 / 6, [(1 / 12, 82, 0.5), (1 / 24, 137, 0.25)], (0.0, 0.01, -0.01)),
    "overlap": (0.5, 0.0, 0.005, [(0.02, 41, 1.0), (0.01, 50, 1.0), (0.0025, 79, 1.0)], (0.0, -0.01)),
    "step": (2.0, 0.0, 1 / 20, [(1 / 10, 44, 1.0), (1 / 14, 50, 1.0), (1 / 40, 74, 1.0)], (0.0, 0.002)),
    "update": (1.0, 0.0, 2.5, [(10.0, 33, 1.0), (5.0, 48, 1.0)], (0.0, 0.003)),
}


class Device:
    """A made-up scene, whose torque without errors is 1 N m."""

    def __init__(self, random):
        self.random, self.errors = random, {}
        self.offers = []
        for name, (order, limit, own, others, errors) in KNOBS.items():
            rungs = tuple(OfferedRung(1.0 / h, h, float(seconds), variance) for h, seconds, variance in others)
            here = OfferedRung(1.0 / own, own, SECONDS, 1.0)
            self.offers.append(OfferedKnob(name, order, limit, here, rungs))
            self.errors[name] = random.choice(errors) / (own**order - limit**order)
        self.rungs = {(one.name, rung.setting): rung for one in self.offers for rung in one.rungs}

    def torques(self, settings, count):
        """Return so many packings at some settings; the scene's own for all other knobs."""
        error, variance = 0.0, 1.0
        for one in self.offers:
            rung = self.rungs.get((one.name, settings.get(one.name)), one.own)
            error += self.errors[one.name] * (rung.step_size**one.order - one.limit**one.order)
            variance *= rung.variance
        return math.exp(error) * (1.0 + SCATTER * math.sqrt(variance) * self.random.standard_normal(count))

    def study(self):
        """Return the ladder that a study finds, as `emclutch.studies.accuracy.study` but with one step less."""
        run = {OWN: list(self.torques({}, 4))}

        def do(packings):
            for name, setting in packings:
                run.setdefault((name, setting), []).extend(self.torques({name: setting}, 1))

        def scatter():
            return pooled_scatter(
                [(some, 1.0 if key == OWN else self.rungs[key].variance) for key, some in run.items()]
            )

        room = BUDGET - 2.0 * SECONDS
        do(first := first_packings(self.offers, 4, room, 2))
        room -= makespan([self.rungs[one].seconds for one in first], 2)
        found = Torques({key: float(np.mean(some)) for key, some in run.items()}, *scatter())
        count = {key: len(some) for key, some in run.items()}
        do(more_packings(self.offers, count, found, SECONDS, room, 2, [Aim()]))
        return self.ladder(run, *scatter())

    def ladder(self, run, scatter, freedom):
        def rung(one, some):
            error = scatter * math.sqrt(one.variance / len(some))
            cost = one.seconds / SECONDS
            return Rung(one.setting, one.step_size, float(np.mean(some)), error, len(some), one.seconds, cost)

        knobs = []
        for one in self.offers:
            rungs = [rung(one.own, run[OWN])]
            rungs += [rung(two, run[one.name, two.setting]) for two in one.rungs if (one.name, two.setting) in run]
            ordered = tuple(sorted(rungs, key=lambda two: -two.step_size))
            knobs.append(
                KnobLadder(one.name, "", Basis.TORQUE, one.own.setting, one.order, one.limit, ordered, freedom)
            )
        torque, packings = float(np.mean(run[OWN])), len(run[OWN])
        return Ladder("abc", "made up", {}, torque, scatter, freedom, None, packings, SECONDS, tuple(knobs))


def test_runs_with_the_settings_that_were_found_hold_the_truth():
    """In 95 % of all; half their interval is a few times their error, not many times."""
    random = np.random.default_rng(33)
    errors, halves, reached = [], [], dict.fromkeys((0.10, 0.05), 0)
    for _ in range(DRAWS):
        device = Device(random)
        ladder = device.study()
        for target in reached:
            choice = recommended(ladder, target)
            if not isinstance(choice, Choice):
                continue
            reached[target] += 1
            torques = device.torques(choice.settings, choice.packings)
            mean, n = torques.mean(), choice.packings
            statistical = stdtrit(n - 1, 0.985) * torques.std(ddof=1) / math.sqrt(n) / mean
            errors.append(abs(mean / (1.0 + choice.total.bias) - 1.0))
            halves.append(math.hypot(statistical, choice.total.half_width))
    assert reached[0.10] >= 0.9 * DRAWS and reached[0.05] >= 0.3 * DRAWS
    assert np.mean(np.array(errors) <= halves) >= 0.95
    assert np.median(halves) <= 5.0 * np.median(errors)


def test_a_knob_with_a_large_error_is_measured_before_cheaper_ones():
    offers = Device(np.random.default_rng(0)).offers
    room = 90.0
    assert "grains" not in {name for name, _ in first_packings(offers, 4, room, 1)}
    large = [replace(one, is_large=one.name == "grains") for one in offers]
    assert [name for name, _ in first_packings(large, 4, room, 1)] == ["grains"]
