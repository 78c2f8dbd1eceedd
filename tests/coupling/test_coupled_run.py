"""Laws of whole runs: balances, effects that are off, threads, resuming."""

from pathlib import Path

import numpy as np
import pytest
from sheared_annulus import CELL, run, same, state

import emclutch
from emclutch.scene.case import case_from

pytestmark = pytest.mark.physics

CASES = Path(__file__).resolve().parents[2] / "cases"


def test_torque_balance_with_every_term_computed_on_its_own(tmp_path):
    """disc + rotor + housing (contacts) + field (m x B of the pairs) + dL/dt (state) = 0.

    Evaluated at every step it closes to round-off. Where the forces lag, the field's torque is known to the travel
    since: first order in the interval. Each of the five terms is far larger than what is left, so none is missing.
    """
    left = []
    for n in (1, 4, 16):
        values = {"effects.dipoles.update_every": n, "time.end": "0.2 ms", "time.window": 2e-5}
        history = run(tmp_path, f"lagged-{n}", values).history
        terms = history[["torque_disc", "torque_rotor", "torque_housing", "torque_field"]].assign(
            change=np.gradient(history["angular_momentum"], history["time"])
        )
        left.append(history["torque_residual"].abs().mean())
        if n == 1:
            assert (terms.abs().mean() > 10.0 * left[-1]).all(), terms.abs().mean() / left[-1]
    # sums over some hundred grains and contacts, each term with its round-off
    assert left[0] < 1000 * np.finfo(float).eps * terms.abs().mean().sum() < 1e-4 * left[1]
    assert left[2] / left[1] == pytest.approx(15 / 3, rel=0.4), left  # lagged for n - 1 steps beyond the first


def test_windows_end_where_the_scene_says_and_every_step_counts_once(tmp_path):
    """Windows of 13 steps in updates of 5, 5 and 3: the balance of torques closes in each.

    A torque of lagged forces counts with its duration, so that what is left is as in windows of whole updates:
    counted alike it would be wrong by a part of the torque itself.
    """
    values = {"effects.dipoles.update_every": 5, "time.step": 1e-7}
    whole = run(tmp_path, "whole", values | {"time.window": 1.5e-6, "time.end": 60e-6}).history
    result = run(tmp_path, "broken", values | {"time.window": 1.33e-6, "time.end": 60.2e-6})
    broken = result.history
    assert result.summary["window"] == pytest.approx(1.3e-6)
    lengths = np.diff(broken["time"], prepend=0.0)
    assert lengths == pytest.approx(1.3e-6) and (broken["steps"] == 13).all()
    assert len(broken) == 46 and broken["time"].iloc[-1] == pytest.approx(59.8e-6)  # a 47th would end at 61.1 us
    assert len(whole) == 40 and whole["time"].iloc[-1] == pytest.approx(60e-6)
    left = [each["torque_residual"].abs().mean() for each in (whole, broken)]
    assert left[1] < 1.5 * left[0], left


def test_energy_balance_of_a_run(tmp_path):
    """walls + magnetic work = dissipation by mechanism + stored; the split converges with the step."""
    left = []
    for steps in (20, 80):
        history = run(tmp_path, f"steps-{steps}", {"time.steps_per_contact": steps}).history
        throughput = (history["work_walls"].abs() + history["dissipated"]).sum()
        left.append(abs(history["energy_residual"].sum()) / throughput)
    assert left[0] < 0.02
    assert left[1] < 0.5 * left[0]


BARE = {
    "effects.magnetic_force": None, "effects.dipoles": None, "effects.saturation": None,
    "time.step": 2e-7, "time.window": 5e-5, "contact.stiffness": 2e4, "time.end": "0.2 ms",
}  # fmt: skip
PULL = {"effects.dipoles": {"model": "mutual", "cutoff": 2.5, "update_every": 10}}


@pytest.mark.parametrize(
    ("name", "beside", "idle"),
    [
        ("magnetic_force", {}, {"field.direction": "z"}),  # uniform: it has no gradient
        ("dipoles", {}, {"field.field_strength": 0.0}),
        ("saturation", PULL, {"field.field_strength": 0.0}),
        ("gravity", {}, {"effects.gravity.acceleration": 0.0}),
        ("rolling_friction", {}, {"effects.rolling_friction.coefficient": 0.0}),
        ("twisting_friction", {}, {"effects.twisting_friction.coefficient": 0.0}),
    ],
)
def test_an_effect_that_is_off_is_one_without_strength(name, beside, idle, tmp_path):
    """Off, and on where it has nothing to do, are one trajectory bit for bit; where it has, they are two."""
    effect = f"effects.{name}"

    def end(label, values):
        run(tmp_path, label, BARE | values)
        return state(tmp_path, label)

    without = {key: value for key, value in idle.items() if not key.startswith(effect)}
    on = {effect: PULL[effect] if effect in PULL else {}}
    assert same(end("off, idle", beside | without), end("on, idle", beside | on | idle))
    assert not same(end("off", beside), end("on", beside | on))


def test_what_is_off_is_not_there(tmp_path):
    """No lagged force, no moment, no field, no rolling table is allocated when no effect asks for it."""
    from emclutch.simulation.assembly import assemble
    from emclutch.simulation.plan import make_plan

    off = {"effects.magnetic_force": None, "effects.dipoles": None, "effects.saturation": None, "field": None}
    case = case_from(CELL, off)
    simulation = assemble(*make_plan(case))
    assert simulation.effects == []
    assert simulation.magnetised is None
    assert simulation.source is None
    assert simulation.motion.external_force is None
    assert simulation.motion.gravity is None
    assert simulation.motion.grains.magnetic_moment is None
    assert not simulation.motion._columns.rolls


SHARED = {"particles.region": "rim", "particles.solid_fraction": 0.35, "particles.sector": "6 deg"}  # 918 grains


def test_one_and_two_threads_give_the_same_bits(tmp_path):
    """The quickstart with all its effects, steel images and rolling included: 918 grains, enough to be shared."""
    import numba

    if numba.config.NUMBA_NUM_THREADS < 2:
        pytest.fail("this machine has one core; the test needs two to say anything")
    quiet = {f"output.{key}": value for key, value in CELL["output"].items()}
    case = emclutch.load_case(CASES / "quickstart.toml").with_values({**quiet, **SHARED, "time.end": "0.04 ms"})
    for threads in (1, 2):
        result = emclutch.run(case, out=tmp_path / str(threads), threads=threads)
        assert result.history["torque_field_images"].abs().max() > 0.0
    assert len(state(tmp_path, "1")["mass"]) > 600
    assert same(state(tmp_path, "1"), state(tmp_path, "2"))


def test_an_interrupted_run_resumes_bit_for_bit(tmp_path):
    """Stopped in the middle by Ctrl-C and resumed: same state, same history."""
    import signal

    from emclutch.results.errors import Interrupted

    run(tmp_path, "whole")

    class Impatient:
        pressed = False

        def update(self, fraction, text):
            if fraction > 0.4 and not self.pressed:
                self.pressed = True
                signal.raise_signal(signal.SIGINT)

    with pytest.raises(Interrupted, match="--resume"):
        run(tmp_path, "parts", progress=Impatient())
    with pytest.raises(
        emclutch.OutputError, match=r"motion\.rotor\.speed: 31\.4.* -> "
    ):  # another scene: nothing is touched
        run(tmp_path, "parts", {"motion.rotor.speed": "10 rpm"}, resume=True)
    assert not (tmp_path / "parts" / "case-1.toml").exists()
    resumed = run(tmp_path, "parts", resume=True)
    assert same(state(tmp_path, "whole"), state(tmp_path, "parts"))
    whole = (tmp_path / "whole" / "history.csv").read_text().splitlines()
    parts = (tmp_path / "parts" / "history.csv").read_text().splitlines()
    clockless = [line.rsplit(",", 5)[0] for line in whole]  # but for the five columns of a clock
    assert clockless == [line.rsplit(",", 5)[0] for line in parts]
    assert resumed.summary["time"] == pytest.approx(1e-3, rel=0.05)


def test_a_run_can_be_lengthened(tmp_path):
    """Resuming with a later end keeps the windows, bit for bit as if that end had been asked for at once."""
    run(tmp_path, "long", {"time.end": "1.5 ms", "time.window": 1e-5})
    run(tmp_path, "short", {"time.end": "0.8 ms", "time.window": 1e-5})
    summary, seen = tmp_path / "short" / "summary.json", []
    assert summary.is_file()

    class Witness:
        def update(self, fraction, text):
            seen.append((fraction, summary.is_file()))

    run(tmp_path, "short", {"time.end": "1.5 ms", "time.window": 1e-5}, resume=True, progress=Witness())
    # cut off in between, the torque to the earlier end would pass for that of the whole
    assert {there for fraction, there in seen if 0.6 < fraction < 1.0} == {False} and summary.is_file()
    assert same(state(tmp_path, "long"), state(tmp_path, "short"))


def test_pair_forces_make_the_torque(tmp_path):
    """With the field's force alone the cell transmits almost nothing; with dipoles it grips."""
    longer = {"time.end": "3 ms", "effects.rolling_friction": {}}
    alone = run(tmp_path, "alone", {**longer, "effects.dipoles": None}).history["torque_disc"]
    pairs = run(tmp_path, "pairs", longer).history["torque_disc"]
    late = len(pairs) // 2
    assert pairs[late:].mean() > 5 * abs(alone[len(alone) // 2 :].mean())


def test_a_free_disc_is_carried_along(tmp_path):
    """A light free disc comes up to the rotor's speed, but for what floor and ceiling of the cell brake."""
    values = {
        "motion.disc": {"free": {"inertia": 5e-9}},
        "effects.rolling_friction": {},
        "time.end": "6 ms",
    }
    result = run(tmp_path, "free", values)
    speed = result.history["disc_speed"]
    assert speed.iloc[0] < 0.5 * speed.iloc[-1]
    assert 0.9 * 31.416 < speed.iloc[-1] < 1.01 * 31.416
    assert "lock_up_time" in result.summary


def test_lock_up_time_is_when_the_slip_ends_for_good():
    import pandas

    from emclutch.results.quantities import lock_up_time

    time = np.arange(1, 7) * 1e-3
    table = pandas.DataFrame({"time": time, "rotor_speed": 10.0, "disc_speed": [0, 5.0, 9.95, 8.0, 9.95, 10.0]})
    assert lock_up_time(table) == pytest.approx(5e-3)
    assert lock_up_time(table.assign(disc_speed=5.0)) is None
    assert lock_up_time(table.assign(disc_speed=10.0)) == 0.0
