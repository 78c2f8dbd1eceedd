"""One scene by DEM and by DVI: contact.method is the only line that differs."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas
import pytest

import emclutch
from coupling.window_row import SolverRow
from emclutch.results.checkpoint import read_checkpoint
from emclutch.results.errors import Interrupted, RunError
from emclutch.scene.case import case_from
from emclutch.simulation.missed_steps import MissedSteps
from emclutch.simulation.plan import make_plan
from particles import ParticleError

SCENE = {
    "scene": {"title": "Shot between a turning core and a free drum", "seed": 3},
    "geometry": {"kind": "shear_cell", "inner_radius": "20 mm", "outer_radius": "40 mm", "height": "30 mm"},
    "particles": {"diameter": "6 mm", "count": 200, "density": "7800 kg/m^3"},
    "contact": {"friction": 0.3, "restitution": 0.5, "stiffness": "50 kN/m"},
    "motion": {"rotor": {"speed": "120 rpm"}, "disc": {"free": {"inertia": "2e-4 kg m^2"}}},
    "effects": {"gravity": {"direction": [0, 0, -1]}},
    "time": {"end": "0.3 s", "window": "10 ms"},
    "output": {"snapshots": 1, "pictures": False},
}


def scene(method, **values):
    return case_from(SCENE, {"contact.method": method} | values)


@pytest.fixture(scope="module")
def runs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("methods")
    return {method: emclutch.run(scene(method), out=folder / method) for method in ("dem", "dvi")}


def test_both_methods_agree_on_momentum_and_load(runs):
    """Torques balance, the drum's speed is what it got, and both beds lie alike; they are chaotic, so not exactly."""
    dem, dvi = (runs[m].history for m in ("dem", "dvi"))
    for history, fraction in ((dem, 1e-9), (dvi, 1e-3)):  # what removes overlap of rigid grains conserves no momentum
        late = history[history["time"] > 0.15]
        assert abs(late["torque_residual"]).max() < fraction * abs(late["torque_rotor"]).max()
        steps = np.diff(history["disc_speed"], prepend=0.0) * 2e-4 / np.diff(history["time"], prepend=0.0)
        np.testing.assert_allclose(history["torque_disc"], steps, atol=1e-9)
    assert runs["dvi"].summary["dt"] > 10.0 * runs["dem"].summary["dt"]
    height = [
        read_checkpoint(runs[m].folder.path / "checkpoint.h5")["dem"]["position_radius"][:, 2].mean() for m in runs
    ]
    assert height[1] == pytest.approx(height[0], abs=0.1 * 6e-3)


def test_the_books_of_rigid_grains_close(runs):
    """Impacts and sliding lose in every window; what they lose is what shafts and weight put in and nothing stores.

    The shafts' work is taken from their torques and speeds here, the energy budget' is of each contact's velocity.
    """
    history = runs["dvi"].history
    given = history["work_walls"].abs().sum() + history["work_gravity"].abs().sum()
    assert (history["dissipated_impact"] >= 0.0).all() and history["dissipated_impact"].sum() > 0.05 * given
    assert (history["dissipated_sliding"] >= 0.0).all() and history["dissipated_sliding"].sum() > 0.05 * given
    duration = np.diff(history["time"], prepend=0.0)
    disc = 0.5 * (history["disc_speed"] + np.concatenate(([0.0], history["disc_speed"][:-1])))
    work = -(history["torque_rotor"] * history["rotor_speed"] + history["torque_disc"] * disc) * duration
    assert history["work_walls"].sum() == pytest.approx(work.sum(), rel=0.01)
    stored = history["kinetic_energy"].iloc[-1] + history["elastic_energy"].iloc[-1]  # the grains begin at rest
    lost = work.sum() + history["work_gravity"].sum() - stored
    assert history["dissipated"].sum() == pytest.approx(lost, rel=0.02)
    assert {"sweeps", "solver_residual", "missed_steps", "warm_hits", "stabilisation_work"} <= set(history)
    assert "grains on springs of 5e+04 N/m" in runs["dvi"].summary["plan"]["contact"]


def test_the_tolerance_follows_the_slip():
    """1e-4 of the speed of the walls past each other, in m/s; shafts that turn together shear by their difference."""

    def tolerance(disc):
        planned = scene("dvi", **{"motion.disc": {"speed": f"{disc} rpm"}, "effects": {}, "particles.density": 7800.0})
        return make_plan(planned)[1].contact.tolerance

    speed = 120.0 * np.pi / 30.0 * 40e-3
    assert tolerance(0.0) == pytest.approx(1e-4 * speed)
    assert tolerance(108.0) == pytest.approx(1e-5 * speed)
    assert tolerance(-120.0) == pytest.approx(2e-4 * speed)
    assert tolerance(120.0) == pytest.approx(1e-4 * speed)


def test_a_run_says_how_its_contacts_are_solved(runs):
    for method, result in runs.items():
        reported = result.summary["contact"]
        assert reported == result.folder.read_plan()["contact"] and reported["method"] == method
        assert reported["compliant"] == (reported["stiffness"] is not None)
    assert runs["dem"].summary["contact"]["stiffness"] == pytest.approx(50e3)


def test_rolling_and_twisting_friction_by_both_methods(tmp_path):
    """The same tables: losses in the history, and budgets that close."""
    effects = {"effects.rolling_friction": {"coefficient": 0.3}, "effects.twisting_friction": {"coefficient": 0.1}}
    for method in ("dem", "dvi"):
        history = emclutch.run(scene(method, **effects, **{"time.end": "0.1 s"}), out=tmp_path / method).history
        for name in ("rolling", "twisting"):
            assert history[f"dissipated_{name}"].sum() > 0.0
        fraction = {"dem": 1e-2, "dvi": 1e-12}[method]  # DEM's budget is of second order in the step
        assert abs(history["energy_residual"]).max() < fraction * history["dissipated"].max() + 1e-15


def test_it_resumes_bit_for_bit(tmp_path, runs):
    class InterruptAtHalf:
        def update(self, fraction, text):
            if 0.5 <= fraction < 1.0:
                import signal

                signal.raise_signal(signal.SIGINT)

    with pytest.raises(Interrupted):
        emclutch.run(scene("dvi"), out=tmp_path / "parts", progress=InterruptAtHalf())
    emclutch.run(scene("dvi"), out=tmp_path / "parts", resume=True)
    whole, parts = (
        read_checkpoint(folder / "checkpoint.h5")["dem"] for folder in (runs["dvi"].folder.path, tmp_path / "parts")
    )
    for key in ("position_radius", "velocity_force", "particle_id", "bodies"):
        assert np.array_equal(whole[key], parts[key])


def test_a_step_beyond_the_rule_is_refused_unless_allowed(tmp_path):
    with pytest.raises(RunError, match="allow_long_step = true"):
        emclutch.run(scene("dvi", **{"contact.dvi.step": "5 ms"}), out=tmp_path / "refused")
    forced = {"contact.dvi.step": "5 ms", "contact.dvi.allow_long_step": True, "time.end": "20 ms"}
    assert emclutch.run(scene("dvi", **forced), out=tmp_path / "taken").summary["dt"] == 5e-3


def test_too_many_misses_stop_the_run(tmp_path):
    hopeless = {"contact.dvi.max_sweeps": 1, "contact.dvi.tolerance": "1e-9 m/s", "contact.dvi.allowed_misses": 0.1}
    with pytest.raises(RunError, match=r"missed the tolerance of 1e-09 m/s.*raise contact\.dvi\.max_sweeps"):
        emclutch.run(scene("dvi", **hopeless), out=tmp_path / "run")


def window(missed_steps, steps):
    """What the callback looks at of a window's row."""
    solver = SolverRow(10.0, 20, 1e-5, missed_steps, 0.5, 0.0)
    return SimpleNamespace(time=0.0, steps=steps, solver=solver)


def test_a_few_misses_are_recorded_only():
    callback = MissedSteps(0.5)

    class Simulation:
        motion = type("Dem", (), {"tolerance": 1e-6})

    for _ in range(10):
        callback(Simulation, window(5, 10))
    with pytest.raises(ParticleError, match="61 of 110"):
        callback(Simulation, window(11, 10))


def test_misses_before_a_resumption_count():
    """Half of 40 steps and none of 60 more: 20 of 100, as if the run had not been stopped."""
    before = pandas.DataFrame({"missed_steps": [10, 10], "steps": [20, 20]})
    row = window(0, 60)
    simulation = SimpleNamespace(motion=SimpleNamespace(tolerance=1e-6))
    MissedSteps(0.21, before)(simulation, row)
    with pytest.raises(ParticleError, match="20 of 100"):
        MissedSteps(0.19, before)(simulation, row)


def test_magnetic_forces_move_rigid_grains_as_elastic_ones(tmp_path):
    """The thesis' electromagnetic clutch, current on at once: before grains meet, both methods follow one motion."""
    case = Path(__file__).parents[2] / "cases" / "thesis" / "electromagnetic.toml"
    short = {"time.end": "0.1 ms", "time.window": "0.05 ms", "particles.count": 60, "coil.current": "8 A"}
    short |= {"output.snapshots": 1, "output.pictures": False}
    where = {}
    for method in ("dem", "dvi"):
        result = emclutch.run(emclutch.load_case(case, short | {"contact.method": method}), out=tmp_path / method)
        state = read_checkpoint(result.folder.path / "checkpoint.h5")["dem"]
        order = np.argsort(state["particle_id"])
        where[method] = state["position_radius"][order, :3], state["velocity_force"][order, :3], result.summary["time"]
        fraction = {"dem": 1e-2, "dvi": 1e-12}[method]  # DEM's budget holds the integrator's error
        assert abs(result.history["energy_residual"]).max() < fraction * abs(result.history["work_magnetic"]).max()
    begun = np.linalg.norm(where["dem"][1], axis=1) > 1e-2  # moved by the field
    assert begun.sum() > 20
    # velocities grow linearly at first: compare them at one time
    scaled = [velocity / time for _, velocity, time in where.values()]
    apart = np.linalg.norm(scaled[0] - scaled[1], axis=1) / np.linalg.norm(scaled[0], axis=1)
    assert np.median(apart[begun]) < 0.1


def test_grains_that_stick_by_both_methods(tmp_path):
    """Six weights of pull: torques and the energy budget close, and as many grains hold on to one another."""
    more = {"effects.cohesion.force": "50 mN", "time.end": "60 ms"}
    contacts = {}
    for method in ("dem", "dvi"):
        history = emclutch.run(scene(method, **more), out=tmp_path / method).history
        assert abs(history["torque_residual"]).max() < 1e-9 * abs(history["torque_rotor"]).max()
        fraction = {"dem": 1e-2, "dvi": 1e-12}[method]
        assert abs(history["energy_residual"]).max() < fraction * history["kinetic_energy"].max()
        contacts[method] = history["n_contacts"].iloc[-3:].mean()
    # some 165 contacts each: 11 % of scatter of their difference
    assert contacts["dvi"] == pytest.approx(contacts["dem"], rel=0.5)


MAGNETISED = {
    "scene": {"title": "Magnetised powder in a sector of a sheared gap", "seed": 2},
    "geometry": {
        "kind": "shear_cell", "inner_radius": "10 mm", "outer_radius": "11.2 mm", "height": "1.2 mm",
    },
    "particles": {"diameter": "0.3 mm", "solid_fraction": 0.4, "sector": "12 deg", "initial_velocity": "sheared"},
    "contact": {"friction": 0.3, "restitution": 0.5},
    "motion": {"rotor": {"speed": "1000 rpm"}, "disc": {"speed": 0.0}},
    "field": {"source": "uniform", "field_strength": "80 kA/m", "direction": "radial"},
    "effects": {
        "magnetic_force": {}, "dipoles": {"model": "near_field", "cutoff": 2.5}, "saturation": {},
        "rolling_friction": {"coefficient": 0.2},
    },
    "time": {"end": "0.4 ms"},
    "output": {"snapshots": 1, "pictures": False},
}  # fmt: skip


def test_magnetised_powder_in_a_sector_runs_by_both_methods(tmp_path):
    """Necks and rolling friction: torques of the ring balance, and the mean ones are alike."""
    torque, columns = {}, {}
    share = 1e-3  # of the largest torque: forces are held between updates of the moments, while the grains move on
    for method in ("dem", "dvi"):
        run = emclutch.run(case_from(MAGNETISED, {"contact.method": method}), out=tmp_path / method)
        history, columns[method] = run.history, set(run.history)
        assert abs(history["torque_residual"]).max() < share * abs(history["torque_disc"]).max()
        torque[method] = history["torque_disc"].mean()
    by_dem_only = {"dissipated_normal_damping", "dissipated_tangential_damping"}
    assert columns["dem"] - columns["dvi"] == by_dem_only and "missed_steps" in columns["dvi"]
    assert torque["dvi"] == pytest.approx(torque["dem"], rel=0.2)
