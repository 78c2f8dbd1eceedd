"""Seconds, memory and disk that are predicted follow what they are made of; a run that needs too much is refused."""

import io
import logging
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.spatial import cKDTree
from sheared_annulus import DRY
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.effects.dipoles import SKIN
from emclutch.results import Progress, time_left
from emclutch.results.errors import RunError
from emclutch.scene.case import case_from
from emclutch.simulation.forecast import cost as cost_module
from emclutch.simulation.forecast import machine_speed, space
from emclutch.simulation.forecast.cost import CURRENT_STEP, Cost, predict, solve_seconds
from emclutch.simulation.pace import RunPace
from emclutch.simulation.plan import make_plan
from emclutch.simulation.run import run

MAGNETIC = {
    "field": {"source": "uniform", "field_strength": "50 kA/m", "direction": "radial"},
    "effects.dipoles": {"model": "near_field", "cutoff": 2.5},
    "effects.saturation": {},
}


@pytest.fixture(autouse=True)
def reference(monkeypatch):
    """A machine as fast as the reference machine, with two cores."""
    monkeypatch.setattr(cost_module, "slowness", lambda: 1.0)
    monkeypatch.setattr(cost_module, "cores_at_hand", lambda: 2)


def cost(values=None, *, threads=1):
    return make_plan(case_from(DRY, values or {}), threads=threads)[1].cost


def test_the_parts_make_the_total_and_the_loop_is_over_at_the_end():
    made = cost(MAGNETIC)
    seconds = made.seconds
    assert seconds["total"] == pytest.approx(sum(value for part, value in seconds.items() if part != "total"))
    assert made.until(made.end) == pytest.approx(sum(seconds[part] for part in ("field", "magnetic", "contact")))
    assert made.until(0.0) == 0.0


def test_a_run_twice_as_long_costs_twice_the_loop():
    once, twice = cost(MAGNETIC).seconds, cost(MAGNETIC | {"time.end": "2 ms"}).seconds
    for part in ("magnetic", "contact"):
        assert twice[part] == pytest.approx(2.0 * once[part], rel=0.05)  # whole windows
    assert twice["start"] == once["start"]


def test_twice_the_grains_cost_twice_the_steps():
    once, twice = cost({"geometry.height": 4.0}), cost({"geometry.height": 8.0})
    ratio = twice.grains / once.grains
    assert twice.seconds["contact"] / once.seconds["contact"] == pytest.approx(ratio)


@pytest.mark.parametrize(
    ("values", "part"),
    [
        ({"effects.rolling_friction": {}}, "contact"),
        ({"effects.twisting_friction": {}}, "contact"),
        (MAGNETIC, "magnetic"),
        (MAGNETIC, "contact"),
    ],
)
def test_what_is_on_costs_something(values, part):
    off, on = cost(), cost(values)
    assert on.seconds[part] / on.steps > off.seconds[part] / off.steps
    assert off.seconds["magnetic"] == 0.0


BY_DVI = MAGNETIC | {"contact.method": "dvi"}


def test_sweeps_by_dvi_grow_with_the_step():
    """In proportion to the step over the contact time, which goes with k^(-1/2); within 1 and the scene's limit."""
    scene = case_from(DRY, BY_DVI).scene
    at_all = cost_module.CHAINED_STEP_NS
    once = cost_module.step_ns(scene, 1e-6, 1e5) - at_all
    assert cost_module.step_ns(scene, 2e-6, 1e5) - at_all == pytest.approx(2.0 * once)
    assert cost_module.step_ns(scene, 1e-6, 4e5) - at_all == pytest.approx(2.0 * once)
    few = case_from(DRY, BY_DVI | {"contact.dvi.max_sweeps": 30}).scene
    assert cost_module.expected_sweeps(few, 1.0, 1e5) == 30.0
    assert cost_module.expected_sweeps(scene, 1e-9, 1e5) == 1.0
    assert cost_module.expected_sweeps(scene, 1e-6, None) == cost_module.RIGID_SWEEPS


def test_a_plan_by_dvi_has_the_sweeps_of_its_springs():
    soft, stiff = (cost(BY_DVI | {"contact.stiffness": k}) for k in ("50 kN/m", "200 kN/m"))
    rest = 1e-9 * soft.grains * soft.steps * cost_module.CHAINED_STEP_NS
    assert stiff.steps == soft.steps
    assert stiff.seconds["contact"] - rest == pytest.approx(2.0 * (soft.seconds["contact"] - rest))


def test_a_machine_twice_as_slow_takes_twice_as_long(monkeypatch):
    once = cost(MAGNETIC).seconds["total"]
    monkeypatch.setattr(cost_module, "slowness", lambda: 2.0)
    assert cost(MAGNETIC).seconds["total"] == pytest.approx(2.0 * once)


def test_a_machine_is_as_slow_as_the_least_of_its_probes(monkeypatch, tmp_path):
    """Kept in the cache: a busy moment does not raise it, and the same speed does not change what is printed."""

    def slowness(probe, folder=tmp_path / "cache"):
        clock = iter(np.cumsum([0.0, 3.0 * probe, 0.0, probe] + 16 * [0.0, 5.0 * probe]))
        monkeypatch.setenv("EMCLUTCH_CACHE", str(folder))
        monkeypatch.setattr(machine_speed.time, "process_time", lambda: float(next(clock)))
        machine_speed.slowness.cache_clear()
        return machine_speed.slowness() * machine_speed.REFERENCE_S

    assert [slowness(probe) for probe in (0.02, 0.036, 0.0199, 0.01, 0.02)] == pytest.approx(
        [0.02, 0.02, 0.02, 0.01, 0.01], rel=1e-9
    )
    kept = tmp_path / "cache" / "machine_speed.json"
    for damaged in ("", "[3]", '{"a": 1', "null"):
        kept.write_text(damaged)
        assert slowness(0.03) == pytest.approx(0.03)
    assert slowness(0.04) == pytest.approx(0.03)  # a damaged file is replaced
    assert [slowness(probe, kept / "no folder") for probe in (0.02, 0.03)] == pytest.approx([0.02, 0.03])
    monkeypatch.undo()
    machine_speed.slowness.cache_clear()


def test_threads_gain_less_than_their_number_and_only_on_cores_that_are_there():
    tall = {"geometry.height": 8.0}  # enough grains to share
    one, two, four = (cost(tall, threads=n).seconds["contact"] for n in (1, 2, 4))
    assert 1.0 < one / two < 2.0 and four == two
    few = {"particles.solid_fraction": 0.01}
    assert cost(few, threads=2).seconds["contact"] == cost(few).seconds["contact"]


def test_neighbours_in_a_gap_are_those_of_random_points_in_it():
    """Counted among points that are spread evenly in a gap of some diameters, as many a volume as grains."""
    rng = np.random.default_rng(0)
    case = case_from(DRY, MAGNETIC)
    device, _ = make_plan(case)
    d, gap = case.scene.particles.largest_diameter, device.narrowest_gap
    reach, wide = (case.scene.effects.dipoles.cutoff + SKIN) * d, 20.0 * gap
    assert reach < gap
    count = round(device.fill.solid_fraction / (np.pi / 6.0 * d**3) * gap * wide**2)
    points = rng.uniform(0.0, 1.0, (count, 3)) * [gap, wide, wide]
    tree = cKDTree(points, boxsize=[10.0 * gap, wide, wide])
    counted = 2.0 * len(tree.query_pairs(reach)) / count
    assert case.scene.effects.dipoles.neighbours(case.scene, device) == pytest.approx(counted, rel=0.03)


def test_magnetic_forces_and_solves_cost_while_there_is_a_current():
    """A current that rises through the second half: three quarters off and on, and a solve for each of its steps."""
    case = case_from(DRY, MAGNETIC)
    device, plan = make_plan(case)
    rhythm = plan.division.steps, plan.updates, 10_000
    always = predict(case.scene, device, plan.dt, rhythm, 1)
    half = 0.5 * always.end
    coil = SimpleNamespace(largest_current=1.0, problem=SimpleNamespace(n_dofs=10_000))
    coil.currents = lambda t: float(np.interp(t, [half, 2.0 * half], [0.0, 1.0]))
    late = predict(case.scene, replace(device, imposed=None, coil=coil), plan.dt, rhythm, 1)
    assert late.loop["magnetic"] == pytest.approx(0.5 * always.loop["magnetic"], rel=0.05)
    assert late.loop["contact"] == always.loop["contact"]
    solve = solve_seconds(replace(device, imposed=None, coil=coil))
    assert late.loop["field"] == pytest.approx(solve / CURRENT_STEP, rel=0.1) and always.loop["field"] == 0.0


# -- memory


def little_memory(monkeypatch, mib):
    monkeypatch.setattr(space, "free_memory", lambda: mib)


def test_check_warns_where_too_little_memory_is_free(monkeypatch):
    little_memory(monkeypatch, 100.0)
    (words,) = cost().in_words().warnings
    assert "100 MiB are free" in words and "particles.sector" in words
    little_memory(monkeypatch, None)  # unknown: nothing to warn of
    assert cost().in_words().warnings == ()


def test_a_run_that_needs_too_much_is_refused(monkeypatch, tmp_path):
    little_memory(monkeypatch, 100.0)
    needed = f"{cost().memory:.0f} MiB"
    with pytest.raises(RunError, match=rf"needs about {needed}.* 100 MiB are free.*fewer.*--force"):
        run(case_from(DRY, {}), out=tmp_path / "run")


def test_force_is_not_refused(monkeypatch):
    little_memory(monkeypatch, 100.0)
    with pytest.raises(space.NotEnoughSpace):
        space.refuse_too_much(101.0)
    space.refuse_too_much(101.0, force=True)
    space.refuse_too_much(99.0)


@pytest.mark.parametrize("command", ["run", "sweep"])
def test_the_command_line_hands_on_force(command, monkeypatch, tmp_path):
    import emclutch.studies.accuracy.target
    import emclutch.studies.point

    asked = {}

    def stand_in(*_, **given):
        asked.update(given)
        raise RunError("seen")

    monkeypatch.setattr(emclutch.studies.accuracy.target, "run_scene", stand_in)
    monkeypatch.setattr(emclutch.studies.point, "run", stand_in)
    case, study = tmp_path / "case.toml", tmp_path / "study.toml"
    case.write_text(case_from(DRY, {}).toml())
    study.write_text('[study]\ncase = "case.toml"\n[study.values]\n"scene.seed" = [1]\n')
    target = ["--out", str(tmp_path / "out")]
    for extra, wanted in (["--force"], True), ([], False):
        CliRunner().invoke(app, [command, str(case if command == "run" else study), *target, *extra])
        assert asked.pop("force") is wanted
        target = ["--out", str(tmp_path / "again")]


def test_a_container_allows_less_than_the_machine_has(monkeypatch, tmp_path):
    monkeypatch.setattr(space, "_NAMES", ((tmp_path, "memory.max", "memory.current"),))
    monkeypatch.setattr(space, "_own", lambda: 0.0)
    machine = space.free_memory()
    (tmp_path / "memory.current").write_text("41943040\n")
    (tmp_path / "memory.max").write_text("max\n")
    assert space.free_memory() == pytest.approx(machine, rel=0.2)
    (tmp_path / "memory.max").write_text("104857600\n")
    assert space.free_memory() == pytest.approx(60.0)
    (tmp_path / "memory.stat").write_text("anon 1\ninactive_file 10485760\n")  # given back at once
    assert space.free_memory() == pytest.approx(70.0)


# -- pace


def estimated(seconds):
    """A cost of so many seconds for a run of 1000 s."""
    loop = {"field": 0.0, "magnetic": 0.0, "contact": seconds}
    return Cost(loop, {"start": 1.0, "output": 1.0}, 1000.0, 100.0, 10.0, 1000, 2000, 1, 1)


@pytest.fixture
def clock(monkeypatch):
    """Wall-clock and processor time that a test sets, and what compiling takes of the first."""
    made = SimpleNamespace(wall=0.0, share=1.0, compiling=0.0)
    for clock in ("perf_counter", "monotonic"):
        monkeypatch.setattr(time_left.time, clock, lambda: made.wall)
    monkeypatch.setattr(time_left.time, "process_time", lambda: made.share * made.wall)
    monkeypatch.setattr(time_left, "compile_seconds", lambda: made.compiling)
    return made


def reported(clock, seconds, windows, *, begin=0.0, compiling=0.0, cost=None, share=lambda time: 1e-3 * time):
    """What is reported in windows of 1 s of simulated time that take so many seconds."""
    said = []
    pace = RunPace(cost or estimated(1000.0), share, begin, lambda text, level: said.append((level, text)))
    clock.compiling += compiling
    clock.wall += compiling
    for k in range(windows):
        clock.wall += seconds
        pace(None, SimpleNamespace(time=begin + k + 1.0))
    return said


def test_the_time_left_is_reported_after_a_twentieth_and_a_tenth(clock):
    first, second = ((logging.INFO, f"about {minutes} min left") for minutes in (24, 22))
    assert reported(clock, 2.0, 49) == []
    assert reported(clock, 1.5, 99, compiling=300.0) == [first]
    assert reported(clock, 1.5, 900) == [first, second]


def test_the_pace_is_that_of_the_windows_whatever_was_estimated(clock):
    ((level, text),) = reported(clock, 1.5, 60, cost=estimated(10.0))
    assert level == logging.WARNING and "about 24 min left" in text and "150.0 times the estimate" in text
    ((level, text),) = reported(clock, 1.5, 60, cost=estimated(1e6))
    assert level == logging.INFO and "24 min left" in text


def test_a_run_on_a_busy_machine_says_that(clock):
    clock.share = 0.4
    ((level, text),) = reported(clock, 3.0, 60)
    assert level == logging.WARNING and "3.0 times the estimate" in text and "the machine is busy" in text
    clock.share = 0.9  # of one core, by two threads
    ((_, text),) = reported(clock, 3.0, 60, cost=replace(estimated(1000.0), threads=2))
    assert "the machine is busy" in text


def test_a_run_that_goes_on_late_is_measured_from_there(clock):
    ((_, text),) = reported(clock, 1.0, 60, begin=600.0)
    assert "about 6 min left" in text


def test_the_line_and_the_progress_bar_agree_on_what_is_left_of_all_replicas(clock):
    """Four replicas of 1000 s, two at a time, taken up at 600 s of the first two: 2800 s of 4000 at 2 s a second."""

    def share(time):
        return 2.0 * time / 4000.0

    stream = io.StringIO()
    bar = Progress(stream=stream)
    for k in range(102):
        clock.wall += k > 0
        bar.update(share(600.0 + k))
    ((level, text),) = reported(clock, 1.0, 101, begin=600.0, share=share, cost=replace(estimated(1000.0), rounds=2))
    assert level == logging.INFO and text.startswith("about 22 min left")
    assert stream.getvalue().splitlines()[-1].endswith("22 min left")


def test_a_bar_counts_down_while_nothing_advances(clock):
    """Half of what was left at the start in 100 s, and 30 s without a reading since: 70 s of 100 are left."""
    left = time_left.TimeLeft(0.5)
    for fraction, wall in ((0.75, 100.0), (0.75, 130.0)):
        clock.wall = wall
        left.read(fraction)
    assert left.estimate()[0] == pytest.approx(70.0)
    clock.wall = 300.0
    assert left.estimate()[0] == 0.0


def test_a_resumed_bar_has_the_pace_of_its_own_windows(clock):
    """Resumed at 50 % after its mesh of 40 s: 1 % a 2 s leaves 58 s at 71 %, not 34 s."""
    stream = io.StringIO()
    bar = Progress(stream=stream)
    bar.status("mesh and field")
    clock.wall = 40.0
    for k in range(22):
        bar.update(0.5 + 0.01 * k)
        clock.wall += 2.0
    first, last = stream.getvalue().splitlines()[0], stream.getvalue().splitlines()[-1]
    assert first == "mesh and field" and last == " 71 %  mesh and field  58 s left"


def test_time_left_starts_again_where_the_work_grows(clock):
    left = time_left.TimeLeft(0.0)
    for fraction, wall in ((0.5, 10.0), (0.3, 20.0), (0.4, 30.0)):  # more replicas are needed than were asked first
        clock.wall = wall
        left.read(fraction)
    assert left.estimate() == (pytest.approx(60.0), pytest.approx(1.0))


def test_what_is_soon_over_is_not_worth_a_line(clock):
    assert reported(clock, 1.0, 60, begin=930.0) == []
