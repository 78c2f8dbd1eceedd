"""A clutch with slots in one body: the field turns with it, and what it does to the grains comes back to that body."""

from pathlib import Path

import numpy as np
import pytest

import emclutch
from coupling import CircuitCoilField, CoilField, run_staggered
from coupling.turning_sampler import TurningSampler
from emclutch.results.checkpoint import read_checkpoint
from emclutch.results.errors import Interrupted
from emclutch.scene.case import load_case
from emclutch.simulation.assembly import assemble
from emclutch.simulation.plan import make_plan
from field import MU_0, UniformField
from particles import Body

pytestmark = pytest.mark.physics

QUICKSTART = Path(__file__).resolve().parents[2] / "cases" / "quickstart.toml"
SLOTTED = {
    "geometry.disc_slots": {"count": 60, "fraction": 0.4, "depth": "2 mm"},
    "field.size_factor": 1.5,
    "field.gap_layers": 3,
    "field.order": 1,
    "effects.back_reaction": None,
    "effects.wall_images": None,
    "particles.region": "rim",
    "particles.solid_fraction": 0.15,
    "particles.sector": "6 deg",
    "time.end": "0.15 ms",
    "output.pictures": False,
}


def slotted(values=None):
    return load_case(QUICKSTART).with_values(SLOTTED | (values or {}))


def test_a_field_turns_with_its_body():
    """Uniform along x at angle 0: at angle a it points along (cos a, sin a); a gradient turns as a tensor."""

    class Shear:
        def sample(self, position):
            grad = np.tile(np.array([[0.0, 2.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.0, 0.0]]), (len(position), 1, 1))
            return np.einsum("nij,nj->ni", grad, position), grad

    body, points = Body("disc"), np.random.default_rng(0).normal(size=(20, 3))
    body.angle = 0.7
    H, grad = TurningSampler(UniformField((1.0, 0.0, 0.0)), body).sample(points)
    assert np.allclose(H, [np.cos(0.7), np.sin(0.7), 0.0]) and not grad.any()
    H, grad = TurningSampler(Shear(), body).sample(points)
    step = 1e-6 * np.eye(3)
    for j in range(3):
        change = TurningSampler(Shear(), body).sample(points + step[j])[0] - H
        assert np.allclose(grad[:, :, j], change / 1e-6, atol=1e-8)
    body.angle = 0.0
    still = Shear().sample(points)[0]
    body.angle = 0.5 * np.pi
    assert np.allclose(TurningSampler(Shear(), body).sample(points)[0], -still), "H = grad(2xy) changes sign"


def test_torque_of_the_slots_field_comes_back_to_the_slotted_body(tmp_path):
    """Balance of disc + rotor + dL/dt: all that the field turns grains with, forces and moments, is the disc's."""
    result = emclutch.run(slotted(), out=tmp_path / "run")
    history = result.history
    terms = history[["torque_disc", "torque_rotor"]]
    assert "torque_field" not in history
    assert history["torque_disc_field"].abs().max() > 100 * history["torque_residual"].abs().max()
    assert history["torque_residual"].abs().max() < 1e-3 * terms.abs().sum(axis=1).max()
    parts = history["torque_disc_normal"] + history["torque_disc_tangential"] + history["torque_disc_field"]
    assert np.allclose(parts, history["torque_disc"], rtol=1e-12, atol=1e-18)
    assert (history["field_solves"].sum(), result.summary["field_solves"]) == (1, 1), "one solve a current"
    assert history["gap_flux_density"].between(0.1, 0.4).all()
    assert (tmp_path / "run" / "field.pvd").is_file()


def test_a_free_slotted_disc_feels_the_grains_through_its_field():
    """J d omega = integral of (contact torque + reaction of the field) dt, grain by grain from m and grad H."""
    case = slotted({"motion.disc": {"free": {"inertia": "1e-7 kg m^2"}}, "effects.dipoles": None})
    device, plan = make_plan(case)
    simulation = assemble(device, plan)
    disc = next(body for body in simulation.motion.bodies if body.name == "disc")
    assert isinstance(simulation.source, CoilField) and simulation.field_carrier is disc
    again = device.coil.problem.solve(device.coil.turns * 1.0, tolerance=device.coil.newton_tolerance)
    assert np.array_equal(again.phi, plan.peak_field.phi)  # so the run need not solve for it
    angular_momentum, impulse = 0.0, 0.0

    def follow(simulation, row):
        nonlocal angular_momentum, impulse
        angular_momentum = 1e-7 * disc.speed
        impulse += row.bodies["disc"].torque * plan.division.length

    run_staggered(simulation, 30 * plan.division.length, (follow,))
    assert simulation.source.solution is plan.peak_field and simulation.source.solves == 1
    assert abs(impulse) > 0.0 and angular_momentum == pytest.approx(impulse, rel=1e-6)
    grains = simulation.motion.grains
    _, grad = simulation.source.sampler.sample(grains.position)
    assert grains.dipole is None  # no necks: the whole moment is the dipole's
    pull = MU_0 * np.einsum("nij,nj->ni", grad, grains.magnetic_moment)
    x = grains.position
    torque = simulation.n_sectors * (x[:, 0] * pull[:, 1] - x[:, 1] * pull[:, 0]).sum()
    # the grains have moved since by half an evaluation's worth
    assert disc.external_torque == pytest.approx(-torque, rel=0.2, abs=1e-7)


@pytest.mark.parametrize("model", ["mutual", "near_field"])
def test_the_slotted_body_takes_what_the_field_turns_dipoles_and_charges_with(model):
    """sum x x [(m.grad) B + Q B] + m x B of all grains, whatever pairs they form, at the moments' fixed point."""
    case = slotted({"effects.dipoles.model": model, "effects.dipoles.tolerance": 1e-9})
    device, plan = make_plan(case)
    simulation = assemble(device, plan)
    from coupling.staggered import lagged_forces, refresh_field
    from coupling.window_budget import WindowBudget

    refresh_field(simulation)
    lagged_forces(simulation, WindowBudget(simulation))
    disc, solved = simulation.field_carrier, simulation.magnetised.magnetisation
    x = simulation.motion.grains.position
    H, grad = simulation.source.sampler.sample(x)
    pull = np.einsum("nij,nj->ni", grad, solved.dipole) + solved.charge[:, None] * H
    torque = MU_0 * (np.cross(x, pull) + np.cross(solved.dipole, H))[:, 2].sum()
    size = MU_0 * np.abs(np.cross(x, pull)[:, 2]).sum()
    assert abs(torque) > 1e-3 * size
    assert disc.external_torque == pytest.approx(-simulation.n_sectors * torque, abs=1e-6 * simulation.n_sectors * size)
    assert (model == "near_field") == bool(solved.charge.any())


def test_a_slotted_clutch_is_switched_on(tmp_path):
    """V i = R i^2 + i d lambda/dt at every window; the current rises as V/R (1 - exp(-t R/L)) of its own inductance."""
    values = {"coil.current": None, "coil.voltage": "2 V", "coil.resistance": "2 ohm", "effects.coil_circuit": {}}
    case = slotted(values | {"field.size_factor": 3.0, "effects.dipoles": None, "time.end": "0.05 ms"})
    history = emclutch.run(case, out=tmp_path / "run").history
    assert np.allclose(history["coil_supplied"], history["copper_loss"] + history["into_field"], rtol=1e-9, atol=1e-15)
    device, plan = make_plan(case)
    L = device.coil.turns * plan.peak_field.flux_linkage_per_turn / 1.0
    assert np.all(np.diff(history["current"]) > 0.0)
    # at 1 A the steel is nearly linear
    assert history["current"].iloc[-1] == pytest.approx(-np.expm1(-5e-5 * 2.0 / L), rel=0.05)


def test_powder_strengthens_the_field_of_a_slotted_clutch_and_the_torques_balance(tmp_path):
    """The moments agree with the field to the tolerance; disc + rotor + dL/dt close, the field's reaction included."""
    values = {"particles.diameter": "0.4 mm", "field.size_factor": 3.0, "time.end": "5 us"}
    history = emclutch.run(slotted(values | FED), out=tmp_path / "fed").history
    assert (history["feedback_residual"] <= 0.02).all() and history["field_solves"].iloc[0] > 1
    torque = history[["torque_disc", "torque_rotor"]].abs().sum(axis=1).max()
    assert history["torque_residual"].abs().max() < 1e-3 * torque
    device, plan = make_plan(slotted(values))
    assert history["gap_flux_density"].iloc[0] > 1.05 * device.coil.gap_flux_density(plan.peak_field)


FED = {"effects.back_reaction": {}, "effects.wall_images": {}, "particles.diameter": "0.4 mm"}


@pytest.mark.parametrize("more", [{}, FED | {"time.end": "0.02 ms"}], ids=["alone", "with powder"])
def test_it_resumes_bit_for_bit(tmp_path, more):
    short = {"field.size_factor": 3.0, "time.end": "0.05 ms"} | more
    whole = emclutch.run(slotted(short), out=tmp_path / "whole")

    class InterruptAtHalf:
        def update(self, fraction, text):
            if 0.5 <= fraction < 1.0:
                import signal

                signal.raise_signal(signal.SIGINT)

    with pytest.raises(Interrupted):
        emclutch.run(slotted(short), out=tmp_path / "parts", progress=InterruptAtHalf())
    parts = emclutch.run(slotted(short), out=tmp_path / "parts", resume=True)
    states = [read_checkpoint(tmp_path / name / "checkpoint.h5")["dem"] for name in ("whole", "parts")]
    for key in ("position_radius", "velocity_force", "particle_id"):
        assert np.array_equal(states[0][key], states[1][key])
    assert whole.summary["torque_rotor"] == parts.summary["torque_rotor"]


def test_an_effect_that_is_off_is_one_with_nothing_to_do():
    """Without a current, runs with feedback or circuit are bit for bit the one without their tables."""

    def end(*tables):
        values = {"coil.current": None, "coil.voltage": "0 V", "coil.resistance": "2 ohm", "effects.wall_images": {}}
        values |= {"particles.diameter": "0.4 mm", "field.size_factor": 3.0}
        simulation = assemble(*make_plan(slotted(values | {f"effects.{name}": {} for name in tables})))
        run_staggered(simulation, 3e-6)
        grains, source = simulation.motion.grains, simulation.source
        assert type(source) is (CircuitCoilField if "coil_circuit" in tables else CoilField)
        assert (source.feedback is not None) == ("back_reaction" in tables)
        assert source.solves > 0 and grains.velocity.any()
        return np.hstack((grains.position, grains.velocity, grains.angular_velocity))

    off = end()
    assert np.array_equal(off, end("back_reaction")) and np.array_equal(off, end("coil_circuit"))


def test_without_the_field_slots_cost_nothing():
    """No effect samples the field: no mesh is made, and the trajectory is that of the smooth device."""
    off = {"effects.magnetic_force": None, "effects.dipoles": None, "effects.saturation": None, "time.end": "20 us"}
    positions = []
    for values in (off, off | {"geometry.disc_slots": None}):
        case = slotted(values)
        device, plan = make_plan(case)
        assert device.coil is None
        simulation = assemble(device, plan)
        simulation.motion.run(50)
        positions.append(simulation.motion.grains.position.copy())
    assert np.array_equal(*positions)
