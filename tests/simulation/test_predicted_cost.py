"""Seconds, memory and disk that are predicted follow what they are made of; a run that needs too much is refused."""

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from typer.testing import CliRunner

from coupling.window_row import WallClock
from emclutch.cli.main import app
from emclutch.scene.case import case_from
from emclutch.simulation import pace as run_pace
from emclutch.simulation.forecast import expected_counts, free_memory
from emclutch.simulation.forecast.cost import Cost, predict
from emclutch.simulation.forecast.expected_counts import SKIN, counts_at, neighbours
from emclutch.simulation.forecast.machine_speed import MachineSpeed
from emclutch.simulation.pace import RunPace
from emclutch.simulation.plan import make_plan
from emclutch.simulation.run import run
from emclutch.simulation.run_error import RunError

CELL = {
    "scene": {"title": "sheared annulus", "seed": 3},
    "geometry": {"kind": "shear_cell", "inner_radius": 10e-3, "outer_radius": 11.2e-3, "height": 2e-3},
    "particles": {"diameter": "0.3 mm", "solid_fraction": 0.1, "sector": "20 deg"},
    "motion": {"rotor": {"speed": "300 rpm"}, "disc": {"speed": 0.0}},
    "effects": {},
    "time": {"end": "1 ms"},
}
MAGNETIC = {
    "field": {"source": "uniform", "field_strength": "50 kA/m", "direction": "radial"},
    "effects.dipoles": {"model": "near_field", "cutoff": 2.0},
    "effects.saturation": {},
}
REFERENCE = MachineSpeed(loops=1.0, solves=1.0, cores=2, taken=0.0)


def cost(values=None, *, threads=1, machine=REFERENCE):
    case = case_from(CELL, values or {})
    device, plan = make_plan(case)
    return predict(case.scene, device, plan.dt, (plan.steps_per_update, plan.updates, plan.windows), threads, machine)


def test_the_parts_make_the_total_and_the_course_ends_at_it():
    made = cost(MAGNETIC)
    seconds = made.seconds
    assert seconds["total"] == pytest.approx(sum(value for part, value in seconds.items() if part != "total"))
    end = made.until(made.time[-1])
    assert end == {part: pytest.approx(seconds[part]) for part in ("field", "magnetic", "contact")}
    assert made.until(0.0) == dict.fromkeys(end, 0.0)


def test_a_run_twice_as_long_costs_twice_the_loop():
    once, twice = cost(MAGNETIC).seconds, cost(MAGNETIC | {"time.end": "2 ms"}).seconds
    for part in ("magnetic", "contact"):
        assert twice[part] == pytest.approx(2.0 * once[part], rel=0.05)  # whole windows
    assert twice["start"] == once["start"]


def test_twice_the_grains_cost_twice_the_steps():
    once, twice = cost({"geometry.height": 4.0}), cost({"geometry.height": 8.0})
    ratio = twice.grains / once.grains
    assert twice.seconds["contact"] / once.seconds["contact"] == pytest.approx(ratio, rel=0.01)  # but for calls


@pytest.mark.parametrize(
    ("values", "part"),
    [
        ({"effects.rolling_friction": {}}, "contact"),
        ({"effects.twisting_friction": {}}, "contact"),
        ({"effects.cohesion": {"model": "constant", "force": "1 uN"}}, "contact"),
        ({"effects.gravity": {"direction": [0.0, 0.0, -1.0]}}, "contact"),
        (MAGNETIC, "magnetic"),
        (MAGNETIC, "contact"),
    ],
)
def test_what_is_on_costs_something(values, part):
    tall = {"geometry.height": 4.0}  # so many grains that calls do not count
    off, on = cost(tall), cost(tall | values)
    assert on.seconds[part] / on.steps > off.seconds[part] / off.steps
    assert off.seconds["magnetic"] == 0.0


def test_a_machine_twice_as_slow_takes_twice_as_long():
    slow = replace(REFERENCE, loops=2.0, solves=2.0)
    assert cost(MAGNETIC, machine=slow).seconds["total"] == pytest.approx(2.0 * cost(MAGNETIC).seconds["total"])


def test_a_busy_core_delays_two_threads_and_not_one():
    busy = replace(REFERENCE, taken=1.0)
    one, two = (cost(threads=n).seconds["contact"] for n in (1, 2))
    assert cost(threads=1, machine=busy).seconds["contact"] == pytest.approx(one)
    assert cost(threads=2, machine=busy).seconds["contact"] == pytest.approx(1.5 * two)
    assert "1 of 2 cores is busy" in cost(machine=busy).in_words()
    assert "busy" not in cost().in_words()


def test_neighbours_in_a_gap_are_those_of_random_points_in_it():
    """Counted among points that are spread evenly in a gap of some diameters, as many a volume as grains."""
    rng = np.random.default_rng(0)
    case = case_from(CELL, MAGNETIC)
    device, _ = make_plan(case)
    d, gap = case.scene.particles.largest_diameter, device.narrowest_gap
    reach, wide = (case.scene.effects.dipoles.cutoff + SKIN) * d, 20.0 * gap
    assert reach < gap
    count = round(device.fill.solid_fraction / (np.pi / 6.0 * d**3) * gap * wide**2)
    points = rng.uniform(0.0, 1.0, (count, 3)) * [gap, wide, wide]
    tree = cKDTree(points, boxsize=[10.0 * gap, wide, wide])
    counted = 2.0 * len(tree.query_pairs(reach)) / count
    assert neighbours(case.scene, device) == pytest.approx(counted, rel=0.03)


def test_grains_stand_in_chains_only_where_there_is_a_field():
    case = case_from(CELL, MAGNETIC)
    device, _ = make_plan(case)
    coil = SimpleNamespace(largest_current=1.0, current=lambda t: float(np.interp(t, [1e-3, 2e-3], [0.0, 1.0])))
    device = replace(device, imposed=None, coil=coil)
    before, ramp, after = (counts_at(case.scene, device, t, 1e-5) for t in (0.5e-3, 1.5e-3, 3e-3))
    assert before.contacts < ramp.contacts == after.contacts
    assert before.moment_sweeps == 0.0 < after.moment_sweeps
    assert (before.solves, ramp.solves, after.solves) == (0.0, pytest.approx(1.0), 0.0)  # 1 % of the current a window
    assert expected_counts.CURRENT_STEP == 0.01


def test_grains_lie_in_a_bed_once_they_have_fallen_and_without_weight_never():
    still = {"motion.rotor.speed": 0.0, "contact.stiffness": "1 kN/m"}

    def contacts(weight, time):
        case = case_from(CELL, still | {"effects.gravity": {"direction": [0.0, 0.0, -1.0], "acceleration": weight}})
        return counts_at(case.scene, make_plan(case)[0], time, 1e-5).contacts

    assert contacts(9.81, 1.0) > contacts(9.81, 1e-4) == contacts(0.0, 1e-4) == contacts(0.0, 1e9)


# -- memory


def little_memory(monkeypatch, mib):
    monkeypatch.setattr(free_memory, "free_memory", lambda: mib)


def test_check_warns_where_too_little_memory_is_free(monkeypatch):
    little_memory(monkeypatch, 100.0)
    words = cost().in_words()
    assert "WARNING" in words and "100 MiB are free" in words and "particles.sector" in words
    little_memory(monkeypatch, None)  # not told: nothing to warn of
    assert "WARNING" not in cost().in_words()


def test_a_run_that_needs_too_much_is_refused(monkeypatch, tmp_path):
    little_memory(monkeypatch, 100.0)
    needed = f"{cost().memory:.0f} MiB"
    with pytest.raises(RunError, match=rf"needs about {needed}.* 100 MiB are free.*fewer.*--force"):
        run(case_from(CELL, {}), out=tmp_path / "run")


def test_force_is_not_refused(monkeypatch):
    little_memory(monkeypatch, 100.0)
    with pytest.raises(free_memory.NotEnoughMemory):
        free_memory.refuse_too_much(101.0)
    free_memory.refuse_too_much(101.0, force=True)
    free_memory.refuse_too_much(99.0)


@pytest.mark.parametrize("command", ["run", "sweep"])
def test_the_command_line_hands_on_force(command, monkeypatch, tmp_path):
    import emclutch.simulation.run
    import emclutch.studies.tasks

    asked = {}

    def stand_in(*_, **given):
        asked.update(given)
        raise RunError("seen")

    monkeypatch.setattr(emclutch.simulation.run, "run", stand_in)
    monkeypatch.setattr(emclutch.studies.tasks, "run", stand_in)
    case, study = tmp_path / "case.toml", tmp_path / "study.toml"
    case.write_text(case_from(CELL, {}).toml())
    study.write_text('[study]\ncase = "case.toml"\n[study.values]\n"scene.seed" = [1]\n')
    target = ["--out", str(tmp_path / "out")]
    for extra, wanted in (["--force"], True), ([], False):
        CliRunner().invoke(app, [command, str(case if command == "run" else study), *target, *extra])
        assert asked.pop("force") is wanted
        target = ["--out", str(tmp_path / "again")]


def test_a_container_allows_less_than_the_machine_has(monkeypatch, tmp_path):
    monkeypatch.setattr(free_memory, "_NAMES", ((tmp_path, "memory.max", "memory.current"),))
    monkeypatch.setattr(free_memory, "_own", lambda: 0.0)
    machine = free_memory.free_memory()
    (tmp_path / "memory.current").write_text("41943040\n")
    (tmp_path / "memory.max").write_text("max\n")
    assert free_memory.free_memory() == pytest.approx(machine, rel=0.2)
    (tmp_path / "memory.max").write_text("104857600\n")
    assert free_memory.free_memory() == pytest.approx(60.0)
    (tmp_path / "memory.stat").write_text("anon 1\ninactive_file 10485760\n")  # given back at once
    assert free_memory.free_memory() == pytest.approx(70.0)


# -- pace


def planned(threads=1, **rates):
    """A cost of so many seconds for each second of a run of 100 s."""
    time = np.linspace(0.0, 100.0, 3)
    spent = {part: rates[part] * time for part in ("field", "magnetic", "contact")}
    return Cost(time, spent, {"start": 1.0, "output": 1.0}, 100.0, 10.0, 1000, 2000, threads, 1, REFERENCE)


def drive(pace, windows, clock=None, begin=0.0, **seconds):
    """Windows of 1 s of simulated time whose parts take so many seconds."""
    for k in range(windows):
        if clock is not None:
            clock.wall += sum(seconds.values())
        spent = WallClock(seconds.get("field"), seconds.get("magnetic"), seconds["contact"], sum(seconds.values()))
        pace(None, SimpleNamespace(time=begin + k + 1.0, seconds=spent))


@pytest.fixture
def clock(monkeypatch):
    """Wall-clock and processor time that a test sets; the processor works as long as the clock goes, unless halted."""
    made = SimpleNamespace(wall=0.0, share=1.0)
    monkeypatch.setattr(run_pace.time, "perf_counter", lambda: made.wall)
    monkeypatch.setattr(run_pace.time, "process_time", lambda: made.share * made.wall)
    return made


def test_a_run_on_plan_is_silent(clock):
    said = []
    drive(RunPace(planned(field=0.1, magnetic=0.3, contact=0.6), 0.0, said.append), 90, clock,
          field=0.15, magnetic=0.5, contact=1.0)  # fmt: skip
    assert said == []


@pytest.mark.parametrize(
    ("slow", "named"), [("field", "field solves"), ("magnetic", "moments"), ("contact", "the grains' steps")]
)
def test_a_run_that_falls_behind_says_so_once_and_which_part(slow, named, clock, caplog):
    said = []
    rates = {"field": 0.3, "magnetic": 0.3, "contact": 0.4}
    pace = RunPace(planned(**rates), 0.0, said.append)
    drive(pace, 60, clock, **(rates | {slow: 3.0}))
    assert len(said) == 1 and named in said[0] and "times as slow as predicted" in said[0]
    assert [record.getMessage() for record in caplog.records if record.levelname == "WARNING"] == said


@pytest.mark.parametrize(("threads", "share"), [(1, 0.4), (2, 0.9)])  # two have 1.4 cores where both are free
def test_a_run_on_a_busy_machine_says_that(threads, share, clock):
    said = []
    clock.share = share
    drive(RunPace(planned(threads, field=0.1, magnetic=0.3, contact=0.6), 0.0, said.append), 60, clock,
          field=0.25, magnetic=0.75, contact=1.5)  # fmt: skip
    assert len(said) == 1 and "the machine is busy" in said[0]


def test_windows_that_compile_do_not_count(clock):
    said, compiled = [], [0]
    pace = RunPace(planned(field=0.1, magnetic=0.3, contact=0.6), 0.0, said.append, lambda: compiled[0])
    for k in range(30):
        compiled[0] += 1
        drive(pace, 1, clock, begin=k, contact=30.0)
    drive(pace, 60, clock, begin=30.0, field=0.1, magnetic=0.3, contact=0.6)
    assert said == []


def test_a_run_that_goes_on_late_is_measured_from_there(clock):
    said = []
    drive(RunPace(planned(field=0.1, magnetic=0.3, contact=0.6), 50.0, said.append), 40, clock, begin=50.0,
          field=0.1, magnetic=0.3, contact=0.6)  # fmt: skip
    assert said == []
