"""Runs of a drum clutch whose grains' moments are fed back to the field: saturation, reversal, nothing, resuming."""

from pathlib import Path

import numpy as np
import pytest
from fed_back_grains import fed_back, powder_problem
from sheared_annulus import CELL, same, state

import emclutch
from coupling.staggered import refresh_field
from emclutch.device_model.device import build_device
from emclutch.device_model.materials import grain_law
from emclutch.simulation.assembly import assemble
from emclutch.simulation.plan import make_plan
from field.spheres.lone_sphere import sphere_magnetisation
from particles import CyclicSector

pytestmark = pytest.mark.physics

QUICKSTART = Path(__file__).resolve().parents[2] / "cases" / "quickstart.toml"
FED_BACK = {f"output.{key}": value for key, value in CELL["output"].items()} | {
    "effects.dipoles.model": "near_field",
    "particles.region": "rim",
    "particles.solid_fraction": 0.03,
    "particles.sector": "6 deg",
    "field.size_factor": 2.0,
    "time.end": "10 us",
}
COURSE = {"times": [0.0, 6e-6, 12e-6, 16e-6, 22e-6], "values": [1.0, 1.0, -1.0, -1.0, 0.0]}


def run(folder, name, values=None, **options):
    case = emclutch.load_case(QUICKSTART).with_values(FED_BACK | (values or {}))
    return emclutch.run(case, out=folder / name, **options)


def moments(folder, name):
    saved = state(folder, name)
    return saved["magnetic_moment"][np.argsort(saved["particle_id"])]


def sound(history):
    """Field and moments agree to the scene's tolerance in every window, and no number is missing."""
    numbers = history.drop(columns="inertial_number")  # nothing is sheared yet
    return bool(np.isfinite(numbers.to_numpy()).all() and (history["feedback_residual"] <= 0.1).all())


@pytest.mark.hard
def test_reversed_switched_off_and_resumed_bit_for_bit(tmp_path):
    """From 1 A to -1 A the moments turn round; at exactly 0 A they are exactly 0, and so is the field's torque."""
    course = {"coil.current": COURSE}
    run(tmp_path, "whole", course | {"time.end": "16 us"})
    run(tmp_path, "part", course | {"time.end": "5 us"})
    before = moments(tmp_path, "part")
    run(tmp_path, "part", course | {"time.end": "16 us"}, resume=True)
    assert same(state(tmp_path, "whole"), state(tmp_path, "part"))
    turned = moments(tmp_path, "part")
    assert np.array_equal(turned, moments(tmp_path, "whole"))
    cosine = (turned * before).sum() / np.sqrt((turned**2).sum() * (before**2).sum())
    assert cosine < -0.97  # but for what has moved since
    history = run(tmp_path, "part", course | {"time.end": "34 us"}, resume=True).history
    assert np.all(moments(tmp_path, "part") == 0.0)
    assert history["feedback_residual"].iloc[-1] == 0.0 == history["torque_field"].iloc[-1]
    assert sound(history)


@pytest.mark.hard
@pytest.mark.parametrize("kind", ["circuit", "eddy currents"])
def test_with_a_circuit_and_eddy_currents_it_resumes_bit_for_bit(tmp_path, kind):
    """The coil at a voltage: current and moments rise together, and a checkpoint holds all of both."""
    values = {"coil.current": None, "coil.voltage": "24 V", "effects.coil_circuit": {}, "time.end": "10 us"}
    if kind == "eddy currents":
        values["effects.eddy_currents"] = {}
    whole = run(tmp_path, "whole", values).history
    run(tmp_path, "part", values | {"time.end": "5 us"})
    parts = run(tmp_path, "part", values, resume=True).history
    assert same(state(tmp_path, "whole"), state(tmp_path, "part"))
    assert np.array_equal(moments(tmp_path, "whole"), moments(tmp_path, "part"))
    physics = [name for name in whole if not name.startswith(("wall_", "processor_"))]
    assert np.array_equal(whole[physics].to_numpy(), parts[physics].to_numpy(), equal_nan=True)
    assert (np.diff(whole["current"]) > 0.0).all() and np.abs(moments(tmp_path, "whole")).max() > 0.0
    assert sound(whole)


@pytest.mark.parametrize("kind", ["circuit", "eddy currents"])
def test_a_steady_beginning_is_the_fixed_point_of_its_powder(kind):
    """The first instant is solved until field and moments agree, at the current V/R: no later window mends it."""
    values = FED_BACK | {"effects.back_reaction.tolerance": 1e-3, "coil.current": None, "coil.voltage": "24 V"}
    values["effects.coil_circuit"] = {"begin": "steady"}
    if kind == "eddy currents":
        values["effects.eddy_currents"] = {"begin": "steady"}
    case = emclutch.load_case(QUICKSTART).with_values(values)
    device, plan = make_plan(case)
    simulation = assemble(device, plan)
    refresh_field(simulation)
    source = simulation.source
    assert 0.0 < source.feedback.residual.total <= 1e-3 and source.solves > 1
    assert source.current(0.0) == pytest.approx(device.coil.largest_current, rel=1e-9)
    assert source.solution.ampere_turns == pytest.approx(source.turns * device.coil.largest_current, rel=1e-9)
    assert not source.refresh(0.0)


def test_powder_packed_to_sixty_agrees_with_its_field():
    """Where the iteration swings and grows, it goes half of its way: without that 30 solves do not end, with it 8."""
    case = emclutch.load_case(QUICKSTART.with_name("hard") / "fill_of_sixty.toml")
    device, plan = make_plan(case)
    simulation = assemble(device, plan)
    refresh_field(simulation)
    assert simulation.source.feedback.residual.total <= 0.02 and simulation.source.solves <= 12


def test_a_run_goes_on_where_nothing_asks_for_a_new_field(tmp_path):
    """The field of the checkpoint stands, and its sampler with it."""
    still = {"effects.back_reaction.tolerance": 0.9}
    whole = run(tmp_path, "whole", still).history
    run(tmp_path, "part", still | {"time.end": "5 us"})
    run(tmp_path, "part", still, resume=True)
    assert whole["field_solves"].iloc[1:].sum() == 0
    assert same(state(tmp_path, "whole"), state(tmp_path, "part"))


@pytest.mark.hard
def test_saturated_poles(tmp_path):
    """50 A: dipoles at saturation and not above it; a field of revolution takes no more torque than their residual.

    What leaves through the contacts is in addition: the largest moments are 7 % above saturation.
    """
    values = {"coil.current": "50 A", "effects.dipoles.tolerance": 2e-9, "effects.dipoles.update_every": 1}
    history = run(tmp_path, "run", values | {"time.end": "2 us"}).history
    assert sound(history)
    law = grain_law(emclutch.load_case(QUICKSTART).scene)
    whole, dipole = (
        np.linalg.norm(state(tmp_path, "run")[name], axis=1) / (np.pi / 6.0 * 0.25e-3**3)
        for name in ("magnetic_moment", "dipole")
    )
    assert dipole.max() <= law.Ms * (1.0 + 1e-9) and dipole.mean() > 0.8 * law.Ms
    assert law.Ms < whole.max() < 1.1 * law.Ms and np.mean(whole >= dipole) > 0.9
    assert history["torque_field"].abs().max() < 1e-6 * history["torque_field_gradient"].abs().max()
    assert history["torque_residual"].abs().max() < 1e-9 * history["torque_field_gradient"].abs().max()


@pytest.mark.hard
def test_one_grain_in_an_empty_gap(tmp_path):
    """It has the moment of a lone sphere in the gap's field, to the part of its ring that a sector of 8 d lacks."""
    history = run(tmp_path, "run", {"particles.solid_fraction": 0.0005}).history
    assert len(moments(tmp_path, "run")) == 1
    assert sound(history)
    case = emclutch.load_case(QUICKSTART)
    device, where = build_device(case.scene), state(tmp_path, "run")["position_radius"][:, :3]
    bare = device.coil.problem.solve(500.0)
    H = np.linalg.norm(bare.sampler("powder").sample(where)[0])
    M = np.linalg.norm(moments(tmp_path, "run")) / (np.pi / 6.0 * 0.25e-3**3)
    assert pytest.approx(float(sphere_magnetisation(grain_law(case.scene), H)), rel=0.25) == M


@pytest.mark.hard
def test_all_powder_on_one_side():
    """Grains in a tenth of the gap, dense, at 0.1, 1 and 50 A: it converges, and empty elements stay empty."""
    random = np.random.default_rng(4)
    case = emclutch.load_case(QUICKSTART)
    device, law, d, sector = build_device(case.scene), grain_law(case.scene), 0.25e-3, CyclicSector(np.pi / 30.0)
    pitch = 1.04 * d
    k = np.stack(np.meshgrid(np.arange(3), np.arange(7), np.arange(3), indexing="ij"), axis=-1).reshape(-1, 3)
    r, z = 20e-3 + 0.6 * d + pitch * k[:, 0], 3e-3 - pitch * k[:, 2]
    t = (pitch * (k[:, 1] + 0.6)) / 20e-3
    x = np.column_stack((r * np.cos(t), r * np.sin(t), z)) + random.uniform(-0.01, 0.01, (len(k), 3)) * d
    laws = {name: own for name, own in device.coil.problem.laws.items() if name != "powder"}
    problem = powder_problem(device.coil.mesh, law, 2.5 * d, laws, open_boundary=True)
    for current in (0.1, 1.0, 50.0):
        result = fed_back(
            problem, law, x, 0.5 * d, 2.5 * d, model="near_field", sector=sector, walls=device.walls(),
            ampere_turns=500.0 * current, agree=1e-4, tolerance=1e-8,
        )  # fmt: skip
        assert result.residuals[-1] <= 1e-4, current
        turn = np.cross(x, result.force)[:, 2]
        assert abs(turn.sum()) < 1e-6 * np.abs(turn).sum()
    assert result.feedback._fill.min() == 0.0 and 0.3 < result.feedback._fill.max() < 0.7
