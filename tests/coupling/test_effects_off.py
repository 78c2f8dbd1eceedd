"""An effect that is off evaluates nothing per pair or per grain, and allocates nothing: work is counted.

Two ways of counting. What a compiled loop must not touch is poisoned: were a number of an effect that is off read once,
the trajectory would not be the same bit for bit. What Python calls is counted, file by file.
"""

import math
import sys
from collections import Counter
from pathlib import Path

import numpy as np
import pytest
from dem_laws import DENSITY, MASS, RADIUS, law

import emclutch
from coupling import run_staggered
from emclutch.scene.errors import SceneError
from emclutch.simulation.assembly import assemble
from emclutch.simulation.plan import make_plan
from geometry.walls import cylinder
from particles import (
    DEM,
    DVI,
    Attraction,
    Body,
    Cohesion,
    DemError,
    DviContact,
    Grains,
    RollingFriction,
    TwistingFriction,
)
from particles.dem.total_columns import N_BODY_SUMS, N_SUMS
from particles.laws.columns import COHESION_0, COHESION_1, DAMPING_ROLLING, MU_ROLLING, MU_TWISTING

pytestmark = pytest.mark.physics

ROOT = Path(__file__).resolve().parents[2]
RESISTANCE = {"rolling": RollingFriction(0.1), "twisting": TwistingFriction(0.05)}
COLUMNS = {
    "cohesion": [COHESION_0, COHESION_1],
    "rolling": [MU_ROLLING],
    "twisting": [MU_TWISTING],
    "resistance": [MU_ROLLING, MU_TWISTING, DAMPING_ROLLING],
}


def crowd():
    """Grains that touch, spin and fly at one another beside a wall."""
    random = np.random.default_rng(5)
    place = 1.9 * RADIUS * np.stack(np.meshgrid(*[np.arange(3.0) - 1.0] * 3), axis=-1).reshape(-1, 3)
    return Grains.create(
        place, RADIUS, DENSITY, velocity=random.normal(0.0, 0.3, place.shape),
        angular_velocity=random.normal(0.0, 200.0, place.shape),
    )  # fmt: skip


def moved(effects, poison=None):
    """Positions, velocities and spins of the crowd after some contacts."""
    dem = DEM(crowd(), [cylinder("bore", "drum", 3.6 * RADIUS, -1.0, 1.0)], [Body("drum")], law("linear"), dt=2e-6,
              overlap_limit=0.2, **effects)  # fmt: skip
    if poison is not None:
        dem._table.rows[:, COLUMNS[poison]] = np.nan
    totals = dem.run(300)
    assert totals.n_contacts > 10
    return dem.grains.position_radius.copy(), dem.grains.velocity_force[:, :6].copy(), dem


@pytest.mark.parametrize(
    ("off", "on"),
    [("cohesion", ()), ("resistance", ()), ("twisting", ("rolling",)), ("rolling", ("twisting",))],
)
def test_no_pair_reads_what_an_effect_that_is_off_would_need(off, on):
    effects = {name: RESISTANCE[name] for name in on}
    where, motion, dem = moved(effects)
    poisoned_where, poisoned_motion, _ = moved(effects, poison=off)
    np.testing.assert_array_equal(poisoned_where, where)
    np.testing.assert_array_equal(poisoned_motion, motion)
    # a spring, and in the energy budget the last forces, of what is on; nothing of what is off, but whole fours
    columns = 3 + 3 * ("rolling" in on) + ("twisting" in on) + (8 if "twisting" in on else 7 if "rolling" in on else 4)
    assert dem._list.pair_memory.history.shape[1] == 4 * math.ceil(columns / 4)


@pytest.mark.parametrize(
    ("effects", "poison"),
    [
        ({"rolling": RESISTANCE["rolling"]}, "rolling"),
        ({"twisting": RESISTANCE["twisting"]}, "twisting"),
        ({"cohesion": Cohesion.constant(0.01 * MASS * 9.81)}, "cohesion"),
    ],
)
def test_the_poison_is_seen_where_the_effect_is_on(effects, poison):
    """Otherwise the test above could not fail."""
    where = moved(effects)[0]
    assert not np.array_equal(where, moved({})[0])
    try:
        assert not np.array_equal(moved(effects, poison)[0], where)
    except DemError as error:
        assert "not a finite number" in str(error)


@pytest.mark.parametrize("engine", ["dem", "dvi"])
def test_gravity_and_lagged_forces_that_are_off_have_no_rows(engine):
    """Per grain an empty array is asked for its length, once; rows of zeros give the same bits."""
    walls, bodies = [cylinder("bore", "drum", 3.6 * RADIUS, -1.0, 1.0)], [Body("drum")]

    def run(gravity, external):
        if engine == "dem":
            made = DEM(crowd(), walls, bodies, law("linear"), dt=2e-6, overlap_limit=0.2, gravity=gravity)
        else:
            made = DVI(crowd(), walls, bodies, DviContact(0.4), dt=2e-6, gravity=gravity, overlap_limit=0.2)
        if external:
            made.external_force = np.zeros((made.grains.count, 3))
        made.run(50)
        return made

    off, on = run(None, False), run((0.0, 0.0, 0.0), True)
    assert off.external_force is None and off.gravity_now is None and off.grains.magnetic_moment is None
    np.testing.assert_array_equal(off.grains.position_radius, on.grains.position_radius)
    np.testing.assert_array_equal(off.grains.velocity_force[:, :6], on.grains.velocity_force[:, :6])


def test_an_attraction_that_is_off_is_no_argument_of_the_step():
    """Not even an empty array, and nothing in the state; one that was set and taken away again leaves the same bits."""
    dem = [
        DEM(crowd(), [cylinder("bore", "drum", 3.6 * RADIUS, -1.0, 1.0)], [Body("drum")], law("linear"), dt=2e-6)
        for _ in range(2)
    ]

    def never(dem):
        raise AssertionError("the drives of an attraction that is off were asked for")

    dem[1].attraction = Attraction(-7.0, 0.1, np.ones((9, 2)), np.ones(9), 3e-3, never)
    dem[1].attraction = None
    for one in dem:
        one.run(50)
        given = one._arguments(1, True, np.zeros(1), np.zeros(1), np.zeros(N_SUMS), np.zeros((1, N_BODY_SUMS)), None)
        assert given.attraction is None and not any("attraction" in name for name in one.state())
    states = [one.state() for one in dem]
    assert [name for name in states[0] if not np.array_equal(states[0][name], states[1][name])] == []


# the files that do the work of an effect, and nothing else
FILES = {
    "magnetic_force": {"coupling/effects/magnetic_force.py"},
    "eddy_currents": {"field/section/eddy_currents.py"},
    "dipoles": {"coupling/mutual_moments.py", "coupling/near_attraction.py", "coupling/effects/dipoles.py",
                "coupling/mutually_magnetised_grains.py", "coupling/neighbour_rows.py"},
    "back_reaction": {"coupling/powder_feedback.py", "coupling/smeared_grains.py"},
    "wall_images": {"coupling/wall_reflection.py"},
}  # fmt: skip
NEEDS = {  # what goes with an effect that is taken out
    "dipoles": ("wall_images", "back_reaction"), "magnetic_force": ("back_reaction",), "wall_images": ("back_reaction",)
}  # fmt: skip
CIRCUIT = "field/coil/coil_circuit.py"  # with eddy currents the circuit is an equation of theirs


def calls(without=()):
    """Calls by file in one coupling window of the clutch that has them all, and its grains."""
    case = emclutch.load_case(ROOT / "cases/switch_on.toml").with_values({
        "field.size_factor": 3.0, "particles.sector": "5 deg", "particles.solid_fraction": 0.2,
        "effects.eddy_currents": {}, "effects.coil_circuit": {}, "time.window": "5 us", "time.end": "5 us",
        **{f"effects.{name}": None for name in without},
        **({"effects.dipoles.model": "mutual"} if without == ("saturation",) else {}),  # necks saturate first
        **({"coil.voltage": None, "coil.current": "1 A"} if "coil_circuit" in without else {}),
    })  # fmt: skip
    result: Counter = Counter()

    def count(frame, event, argument):
        if event == "call" and frame.f_code.co_filename.startswith(str(ROOT)) and frame.f_code.co_name != "<module>":
            result[str(Path(frame.f_code.co_filename).relative_to(ROOT))] += 1

    device, plan = make_plan(case)
    simulation = assemble(device, plan)
    sys.setprofile(count)
    try:
        run_staggered(simulation, simulation.motion.dt)
    finally:
        sys.setprofile(None)
    return result, simulation


@pytest.fixture(scope="module")
def all_on():
    return calls()


def test_every_effect_works_when_all_are_on(all_on):
    result, simulation = all_on
    for effect, files in FILES.items():
        for file in files:
            assert result[file] > 0, f"{effect}: nothing of {file} was called"
    assert simulation.motion.grains.magnetic_moment is not None and simulation.motion.external_force is not None


@pytest.mark.parametrize("effect", FILES)
def test_an_effect_that_is_off_is_never_called(effect):
    without = (effect, *NEEDS.get(effect, ()))
    result, _ = calls(without)
    for name in without:
        for file in FILES[name]:
            assert result[file] == 0, f"{name} is off, and {file} was called {result[file]} times"


def test_a_circuit_that_is_off_is_never_called():
    assert calls(("eddy_currents",))[0][CIRCUIT] > 0
    assert calls(("eddy_currents", "coil_circuit"))[0][CIRCUIT] == 0


def test_without_saturation_grains_are_linear_at_any_field(all_on):
    """Their law is one product: twice the field is twice the moment, far beyond what iron holds."""
    H, phi = np.array([1e3, 1e6, 2e6]), np.zeros(3)
    linear = calls(("saturation",))[1].magnetised.law.magnetisation(H, phi)
    assert linear[1:] == pytest.approx([1e3 * linear[0], 2e3 * linear[0]], rel=1e-12)
    assert all_on[1].magnetised.law.magnetisation(H, phi)[2] < 0.6 * linear[2]


def test_without_magnetic_effects_nothing_magnetic_is_there():
    result, simulation = calls((*FILES, "coil_circuit", "saturation"))
    assert not [file for file in result if file.startswith("field/")]
    assert simulation.magnetised is None and simulation.source is None
    assert simulation.motion.grains.magnetic_moment is None and simulation.motion.external_force is None


@pytest.mark.parametrize("effect", ["magnetic_force", "wall_images"])
@pytest.mark.parametrize("model", ["near_field", "mutual"])
def test_effects_that_cannot_be_taken_apart_are_refused(model, effect):
    """Moments fed back: what is near and what is far of one attraction, and the images of one mirror."""
    case = emclutch.load_case(ROOT / "cases/quickstart.toml").with_values({"effects.dipoles.model": model})
    words = rf"(?s)effects.{effect} is missing with \[effects.back_reaction\].*add\s+it"
    with pytest.raises(SceneError, match=words):
        case.with_values({f"effects.{effect}": None})
    case.with_values({f"effects.{effect}": None, "effects.back_reaction": None})  # then nothing is fed back
