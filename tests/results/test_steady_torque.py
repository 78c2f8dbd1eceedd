"""A run has one steady torque: summary, result without a summary and comparison of methods give the same verdict."""

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

from emclutch.results import Estimate, HistoryWriter, RunFolder, load_result
from emclutch.results.steady_stress import steady_stress, stress_summary
from emclutch.results.steady_torque import MIN_AVERAGED_STRAIN, SteadyConditions, steady_torque
from emclutch.scene.case import case_from
from emclutch.simulation.forecast.expected_torque import ExpectedTorque
from emclutch.simulation.planned_run import PlannedRun
from emclutch.simulation.summary import FinishedRun, summarise
from emclutch.studies.method_comparison import compare_methods
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable

ONE = Grains.create(np.array([[1e-2, 0.0, 0.0]]), 1e-3, 1000.0)
NOTHING_TOUCHES = ContactTable(*np.zeros((4, 0), dtype=np.int64), *np.zeros((2, 0, 3)), np.zeros(0))
CASE = case_from(
    {
        "scene": {"title": "A cell"},
        "geometry": {"kind": "shear_cell", "inner_radius": "20 mm", "outer_radius": "21 mm", "height": "5 mm"},
        "particles": {"diameter": "0.2 mm", "count": 10},
        "time": {"end": "4 s"},
    }
)
CONDITIONS = SteadyConditions(None, 1e-3, 20.5e-3)
WINDOWS = 400


def history(*, driven=2.0, speed=10.0):
    """4 s of a disc dragged by 2 N m after a transient of half a second; the rotor gives `driven` N m."""
    time = 0.01 * np.arange(1, WINDOWS + 1)
    noise = 0.05 * np.random.default_rng(4).standard_normal(WINDOWS)
    level = 1.0 - np.exp(-time / 0.1)
    return pd.DataFrame(
        {
            "time": time,
            "torque_disc": 2.0 * level + noise,
            "torque_rotor": -driven * level - noise,
            "rotor_speed": np.full(WINDOWS, speed),
            "disc_speed": np.zeros(WINDOWS),
            "steps": np.full(WINDOWS, 10),
            "missed_steps": np.zeros(WINDOWS, dtype=int),
            "sweeps": np.ones(WINDOWS),
            "solver_residual": np.zeros(WINDOWS),
            "stabilisation_work": np.zeros(WINDOWS),
            "max_overlap": np.full(WINDOWS, 1e-3),
            "torque_residual": np.zeros(WINDOWS),
            "energy_residual": np.zeros(WINDOWS),
        }
    )


CONTACT = SimpleNamespace(tolerance=1e-3, springs=None)  # of the plan, as the verdict on the solver reads it
NO_TORQUE = ExpectedTorque(None, "no gap")
NO_FIELD = SimpleNamespace(  # a device without a gap: nothing is expected of it
    coil=None,
    imposed=None,
    pole_zone=None,
)


def three_ways(path, rows, conditions):
    """The torque of a run's folder before its summary is written, in the summary, and in the comparison of methods."""
    folder = RunFolder.create(path, CASE.toml())
    folder.write_plan({"steady_torque": conditions.as_dict()})
    with HistoryWriter(folder.history) as writer:
        for row in rows.to_dict("records"):
            writer.append(row)
    cut_off = load_result(path).torque
    simulation = SimpleNamespace(
        motion=SimpleNamespace(
            bodies=[], tolerance=1e-6, grains=ONE, periodicity=None, contacts=lambda: NOTHING_TOUCHES
        ),
        magnetised=None,
        source=None,
        n_sectors=1,
    )
    cost = SimpleNamespace(seconds={"total": 1.0})
    plan = SimpleNamespace(
        scaled=None, count=10, dt=1e-3, division=SimpleNamespace(length=1e-3), contact_data={}, contact=CONTACT,
        cost=cost, peak_field=None,
    )  # fmt: skip
    planned = PlannedRun(NO_FIELD, plan, conditions, {}, NO_TORQUE)
    summarise(FinishedRun(CASE, folder, planned, simulation, [folder.read_history()], {"whole_run": 1.0}))
    written = Estimate.from_dict(folder.read_summary()["torque"])
    result = load_result(path)
    (row,) = compare_methods([({"contact.method": method}, result) for method in ("dem", "dvi")])
    compared = {name: (row[f"torque_{name}"], row[f"torque_error_{name}"], row[f"torque_converged_{name}"])
                for name in ("dem", "dvi")}  # fmt: skip
    return cut_off, written, compared


@pytest.mark.parametrize(
    ("rows", "conditions", "reason"),
    [
        (history(), CONDITIONS, ""),
        (history(), SteadyConditions(3.0, 1e-3, 20.5e-3), ""),
        (history(driven=2.5), CONDITIONS, "the torques on the powder add up to -0.5 N m"),
        (history(speed=0.03), CONDITIONS, "the averaged part has a shear strain of 2."),
    ],
    ids=["steady", "from a given time", "powder speeds up", "too little shear"],
)
def test_one_torque_by_three_ways(tmp_path, rows, conditions, reason):
    cut_off, written, compared = three_ways(tmp_path / "run", rows, conditions)
    assert cut_off == written
    assert set(compared.values()) == {(written.mean, written.standard_error, written.converged)}
    assert written.is_steady == (reason == "") and reason in written.reason
    assert not written.converged and ("scatter between replicas" in written.reason) == written.is_steady
    assert written.mean == pytest.approx(2.0, abs=0.02) and 0.0 < written.standard_error < 0.02
    if conditions.average_from is not None:
        assert written.start == pytest.approx(conditions.average_from)


def test_shafts_that_hold_need_no_shear():
    held = history(speed=0.0)
    assert steady_torque(held, CONDITIONS).is_steady


@pytest.mark.parametrize(("share", "enough"), [(1.0 + 1e-6, True), (1.0 - 1e-6, False)])
@pytest.mark.parametrize("start", [0.0, 2.0])
def test_the_shear_while_averaging_is_that_of_all_averaged_windows(share, enough, start):
    """Of a gap and of a periodic box alike, to round-off at the strain that is needed."""
    rate, rows = share * MIN_AVERAGED_STRAIN / (4.0 - start), history()
    gap = replace(CONDITIONS, average_from=start, shear_gap=1.0, shear_radius=rate / 10.0)
    noise = 1e-3 * np.random.default_rng(1).standard_normal((2, WINDOWS))
    torque = 2.0 + noise[0]
    assert steady_torque(rows.assign(torque_disc=torque, torque_rotor=-torque), gap).is_steady is enough
    box = pd.DataFrame({"time": rows["time"], "shear_strain": rate * rows["time"],
                        "shear_stress": 1.0 + noise[0], "normal_stress_z": 2.0 + noise[1]})  # fmt: skip
    found = steady_stress([box], SteadyConditions(average_from=start))
    assert (found.shear.is_steady, found.friction.is_steady) == (enough, enough)
    # windows of unequal length: the mean is over time
    box["time"] = [*rows["time"][:-1], rows["time"].iloc[-1] + 4.0]
    box["solid_fraction"] = [*[0.5] * (WINDOWS - 1), 0.6]
    said = stress_summary(found, [box], rate, 1e-3, 1e3)["solid_fraction"]
    last = (4.0 + 0.01) / (8.0 - start)
    assert said == pytest.approx(0.5 * (1.0 - last) + 0.6 * last)


def test_weight_that_turns_powder_about_a_lying_shaft_is_no_imbalance():
    """The torques on the bodies then add up to the weight's; the powder's angular momentum does not change."""
    rows = history(driven=2.5)
    assert "the torques on the powder add up to" in steady_torque(rows, CONDITIONS).reason
    noise = 1e-6 * np.random.default_rng(2).standard_normal(WINDOWS)
    assert steady_torque(rows.assign(angular_momentum=0.3 + noise), CONDITIONS).is_steady
    rising = rows.assign(angular_momentum=0.5 * rows["time"])
    assert "the torques on the powder add up to" in steady_torque(rising, CONDITIONS).reason


def test_a_folder_that_does_not_know_its_gap_is_not_trusted(tmp_path):
    """Of an earlier version: the scene says from when to average, but not how much the gap was sheared."""
    folder = RunFolder.create(tmp_path / "run", CASE.with_values({"time.average_from": "3 s"}).toml())
    with HistoryWriter(folder.history) as writer:
        for row in history().to_dict("records"):
            writer.append(row)
    torque = load_result(folder.path).torque
    assert torque.start == pytest.approx(3.0)
    assert not torque.converged and "its shear is unknown" in torque.reason


def test_a_torque_that_does_not_count_is_known_once_the_gap_was_sheared():
    """A coil without current: what friction leaves is neither steady nor in balance, and far below what counts."""
    rows = history(driven=3.0)
    small = rows.assign(torque_disc=1e-4 * rows["torque_disc"], torque_rotor=1e-4 * rows["torque_rotor"])
    assert not steady_torque(small, CONDITIONS).is_steady
    enough = replace(CONDITIONS, negligible=1e-3)
    alone = steady_torque(small, enough)
    assert alone.is_steady and not alone.converged and "scatter between replicas" in alone.reason
    found = steady_torque(small, enough, [small.assign(torque_disc=1.1 * small["torque_disc"])])
    assert found.converged and found.half_width() <= 1e-3 and "below 0.001 N m" in found.reason
    assert not steady_torque(rows, enough).is_steady  # in a window it was more
    still = small.assign(rotor_speed=0.1)  # not sheared yet: grains that touch nothing know no torque
    assert not steady_torque(still, replace(enough, negligible=1e-3)).is_steady
    assert SteadyConditions.from_dict(enough.as_dict()) == enough


def test_how_much_longer_is_said_for_what_the_scene_asks_for():
    """Without an aim it is for 5 %; a fiftieth of that takes 2500 times as long."""
    rows, quick = history().iloc[:30], replace(CONDITIONS, average_from=0.0)
    reported = {share: steady_torque(rows, replace(quick, share=share)).remedy for share in (0.0, 0.001)}
    words = r"estimate: about (\S+) s more for"
    seconds = {share: float(re.search(words, text)[1]) for share, text in reported.items()}
    assert reported[0.0].endswith("more for 5 %)") and reported[0.001].endswith("more for 0.1 %)")
    assert seconds[0.001] == pytest.approx((0.05 / 0.001) ** 2 * seconds[0.0], rel=0.3)
