"""Laws of a scene of a sheared box: stress, work, momentum, pressure, frames, resume, verdict, and what it refuses."""

import copy
import dataclasses
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from powder_cell import PowderCell, ShearParameters

from coupling import run_staggered
from coupling.neighbour_rows import neighbour_rows
from coupling.sheared_powder import min_edge
from emclutch.device_model.decision import warnings_of
from emclutch.results.report.verdict import verdict
from emclutch.results.steady_stress import steady_stress
from emclutch.results.steady_torque import MIN_AVERAGED_STRAIN, SteadyConditions
from emclutch.scene.case import case_from
from emclutch.scene.errors import SceneError
from emclutch.scene.fill import diameters_of
from emclutch.simulation.assembly import assemble
from emclutch.simulation.check import check
from emclutch.simulation.plan import make_plan
from emclutch.simulation.run import run
from emclutch.studies.tables import row_of
from field.laws.powder_law import GrainLaw
from particles import ShearedBox

pytestmark = pytest.mark.physics

D = 1e-4
CELL = ShearParameters(
    law=GrainLaw(999.0, 1.7e6), fill=0.30, H=40e3, friction=0.3, count=110, width=2.5, inertial_number=0.05
)  # fmt: skip
EDGE = float(ShearedBox.of_fill(CELL.count, D, CELL.fill).lengths[0])
DRY = {
    "scene": {"title": "dry"},
    "geometry": {"kind": "sheared_box", "size": [EDGE] * 3, "shear_rate": 1000.0},
    "particles": {"diameter": D, "density": 7800.0, "count": CELL.count},
    "contact": {"friction": 0.3, "restitution": 0.5},
    "time": {"end": 2e-3},
    "accuracy": {"replicas": 1},
    "output": {"pictures": False, "snapshots": 2, "formats": ["hdf5"]},
}
MAGNETIC = DRY | {
    "geometry": {"kind": "sheared_box", "size": [EDGE] * 3, "inertial_number": 0.05},
    "particles": DRY["particles"] | {"susceptibility": 999.0, "saturation": 1.7e6},
    "field": {"source": "uniform", "field_strength": CELL.H, "direction": "z", "means": "macroscopic"},
    "effects": {"dipoles": {"cutoff": 2.5}, "saturation": {}},
}

PRESSED = {
    "geometry.pressure": "500 Pa", "geometry.shear_rate": None, "geometry.inertial_number": 0.1,
    "particles.count": None, "particles.solid_fraction": 0.5, "contact.max_overlap": 0.02, "time.end": "30 ms",
}  # fmt: skip

CUBE = {"geometry.size": None, "geometry.solid_fraction": CELL.fill}
DENSE = {"particles.count": None, "particles.solid_fraction": 0.5}
TEN = {"kind": "percentiles", "d10": 0.15 * D, "d50": 0.45 * D, "d90": 0.9 * D, "min": 0.1 * D, "max": D,
       "by": "number"}  # fmt: skip
SIZES = {"kind": "percentiles", "d10": 0.7 * D, "d50": D, "d90": 1.5 * D}
WIDE = {"particles.diameter": None, "particles.sizes": SIZES}


def scene(base, changes=None):
    return case_from(copy.deepcopy(base), changes or {})


def started(case):
    return assemble(*make_plan(case))


def march(simulation, windows):
    """The history of some windows, as rows of columns."""
    from emclutch.results.columns import columns_of

    rows = []
    steps = simulation.motion.step_count + windows * simulation.steps
    run_staggered(simulation, steps * simulation.motion.dt, [lambda _, row: rows.append(columns_of(row))])
    return pd.DataFrame(rows)


def test_stress_of_a_scene_is_that_of_a_cell():
    """The same packing, law, step and rate: stress and its parts, permeability and contacts of five windows."""
    cell = PowderCell(CELL)
    cell.magnetism.tolerance = 1e-3
    for _ in range(5):
        cell.window(3)
    same = {
        "geometry.shear_rate": cell.rate,
        "geometry.inertial_number": None,
        "contact.stiffness": cell.dem.contact.stiffness_at(0.0, 0.25 * D),
        "time.step": cell.dem.dt,
        "effects.dipoles.update_every": CELL.steps_per_look,
        "time.window": 3 * CELL.steps_per_look * cell.dem.dt,
    }
    simulation = started(scene(MAGNETIC, same))
    history, s = march(simulation, 5), cell.series
    assert simulation.steps == 3 * simulation.steps_per_update
    assert abs(s.tau_near[-1]) > 0.0 and abs(s.tau_lagged[-1]) > 0.0
    for column, series in (
        ("shear_strain", s.strain), ("shear_stress", s.tau), ("shear_stress_contacts", s.tau_contacts),
        ("shear_stress_near", s.tau_near), ("shear_stress_lagged", s.tau_lagged), ("shear_stress_across", s.tau_across),
        ("relative_permeability", s.mu_r), ("contacts_per_grain", s.contacts),
    ):  # fmt: skip
        assert history[column].to_numpy() == pytest.approx(np.array(series), rel=1e-6, abs=1e-6 * np.abs(series).max())


def test_work_against_the_stress_balances_the_energies():
    """V tau for each unit of strain is dissipated or stored; W is taken at the ends, and not at the last evaluation.

    The grains' step alone closes to 2e-3; moments and mmfs, lagged between their evaluations, lose 0.3 to 1 %.
    """
    simulation = started(scene(MAGNETIC, {"geometry.inertial_number": 0.1, "effects.dipoles.update_every": 20}))

    def magnetic_energy():
        simulation.magnetised.update(simulation)
        return simulation.magnetised.energy()

    begin = march(simulation, 25).iloc[-1]  # grains snap together from afar
    before = magnetic_energy()
    history = march(simulation, 12)
    change, end, work = magnetic_energy() - before, history.iloc[-1], history["work_shear"].sum()
    strain = np.diff(np.concatenate([[begin["shear_strain"]], history["shear_strain"]]))
    lost, volume = history["dissipated"].sum(), simulation.motion.box.volume
    assert work > 0.3 * lost > 0.0
    assert work == pytest.approx(volume * (history["shear_stress"] * strain).sum(), rel=2e-3)
    assert abs(history["energy_residual"].sum()) < 2e-3 * lost
    through_field = history["work_box_magnetic"].sum() - history["work_magnetic"].sum()
    assert through_field == pytest.approx(change, abs=0.02 * lost)
    stored = change + sum(end[name] - begin[name] for name in ("kinetic_energy", "elastic_energy"))
    assert work == pytest.approx(lost + stored, abs=0.02 * lost)


@pytest.mark.parametrize("method", ["dem", "dvi"])
def test_momentum_stays(method):
    """Beside the flow, which a wrap takes along, also where a barostat stretches the box."""
    simulation = started(scene(MAGNETIC, {"geometry.pressure": "2 kPa", "contact.method": method}))
    grains, box = simulation.motion.grains, simulation.motion.box

    def momentum():
        return (grains.velocity - box.flow(grains.position[:, 2])).sum(axis=0)

    height, before = box.lengths[2], momentum()
    march(simulation, {"dem": 6, "dvi": 20}[method])
    assert simulation.motion.list_version > 3 and box.lengths[2] != height
    assert np.abs(momentum() - before).max() < 1e-11 * np.abs(grains.velocity).sum()


BALANCED = {
    "dry": (DRY, {}),
    "in a field": (MAGNETIC, {}),
    "all resistances": (MAGNETIC, {"effects.rolling_friction": {}, "effects.twisting_friction": {},
                                   "effects.cohesion": {"model": "constant", "force": "1 uN"}}),
}  # fmt: skip


@pytest.mark.parametrize("kind", BALANCED)
def test_by_dvi_the_work_of_shear_is_lost_or_stored_to_round_off(kind):
    """Same scene, other method: what the lagged forces and the contacts let the shear put in is all accounted for."""
    base, more = BALANCED[kind]
    simulation = started(scene(base, more | {"contact.method": "dvi"}))
    history = march(simulation, 12)
    strain = np.diff(np.concatenate([[0.0], history["shear_strain"]]))
    lost, work = history["dissipated"].sum(), history["work_shear"].sum()
    assert lost > 0.0 and history["missed_steps"].sum() == 0
    assert abs(history["energy_residual"]).max() < 1e-9 * lost
    assert work == pytest.approx(simulation.motion.box.volume * (history["shear_stress"] * strain).sum(), rel=1e-9)
    if base is MAGNETIC:
        assert (history["shear_stress_near"] != 0.0).all() and (history["shear_stress_lagged"] != 0.0).all()


def test_rows_hold_every_neighbour_of_a_high_box():
    """At the top of the box the flow is far ahead of its bottom when the rows are made again."""
    size = [min_edge(2.5) * D, min_edge(2.5) * D, 18.0 * D]
    case = scene(MAGNETIC, {"geometry.size": size, "particles.count": 200, "geometry.inertial_number": 0.5})
    simulation, made = started(case), set()
    reach = 2.5 * D
    for _ in range(20):
        march(simulation, 1)
        rows, x = simulation.rows(reach), np.array(simulation.motion.grains.position)
        made.add(rows.strain)
        fresh = neighbour_rows(x, reach, simulation.motion.box)
        assert np.array_equal(rows.images, fresh.images)
        listed = set(zip(np.repeat(np.arange(200), np.diff(rows.start)).tolist(), rows.other.tolist(), strict=True))
        wanted = zip(np.repeat(np.arange(200), np.diff(fresh.start)).tolist(), fresh.other.tolist(), strict=True)
        assert set(wanted) <= listed
    assert len(made) > 3


def test_the_height_follows_the_pressure():
    """The mean normal stress is the imposed one, a loose packing is compacted, and the budget closes.

    The box grows where its grains push harder than the pressure: it takes energy from them. Paths of grains differ with
    the last bit, hence by processor; bounds hold for the means of any of them.
    """
    simulation = started(scene(DRY, PRESSED))
    march(simulation, 60)
    late = march(simulation, 100)
    assert late["normal_stress_z"].mean() == pytest.approx(500.0, rel=0.1)
    assert late["solid_fraction"].mean() > 0.53
    assert 0.2 < late["shear_stress"].mean() / 500.0 < 0.7
    pressed = late["work_pressure"].sum()
    assert pressed < -0.001 * late["work_shear"].sum() < 0.0
    assert abs(late["energy_residual"].sum()) < 0.3 * abs(pressed)


def test_by_dvi_the_height_follows_the_pressure():
    """As by DEM, with less friction than 0.45: steps that are long against d sqrt(rho/P) would have more."""
    simulation = started(scene(DRY, PRESSED | {"contact.method": "dvi"}))
    march(simulation, 180)
    late = march(simulation, 120)
    assert late["normal_stress_z"].mean() == pytest.approx(500.0, rel=0.1)
    assert 0.53 < late["solid_fraction"].mean() < 0.64  # random close packing
    assert 0.25 < late["shear_stress"].mean() / late["normal_stress_z"].mean() < 0.45  # 0.38 +- 0.01
    pressed = late["work_pressure"].sum()
    assert pressed < -0.001 * late["work_shear"].sum() < 0.0
    assert abs(late["energy_residual"].sum()) < 0.3 * abs(pressed)


def test_a_pressure_far_below_the_stress_of_chains_does_not_shake_the_box():
    """10 Pa on chains of some kPa: the height drifts with the stress, and does not jump with each fluctuation of it."""
    pressed = {"geometry.pressure": "10 Pa", "geometry.inertial_number": None, "geometry.shear_rate": 2000.0}
    history = march(started(scene(MAGNETIC, pressed)), 8)
    assert abs(history["energy_residual"].sum()) < 0.1 * history["dissipated"].sum()
    assert abs(history["work_pressure"].sum()) < 0.3 * history["work_shear"].sum()


@pytest.mark.parametrize(("base", "method"), [(DRY, "dem"), (MAGNETIC, "dem"), (MAGNETIC, "dvi")],
                         ids=["under pressure", "in a field", "both by dvi"])  # fmt: skip
def test_a_resumed_run_is_the_same_bit_for_bit(base, method, tmp_path):
    changes = {"time.end": 2e-4, "time.window": 2e-5, "contact.method": method}
    if base is DRY or method == "dvi":
        changes |= {"geometry.pressure": "300 Pa"}
    case = scene(base, changes)
    whole = run(case, out=tmp_path / "whole", threads=1)
    half = run(case, out=tmp_path / "half", threads=1, callback=lambda state: state.row["time"] > 0.9e-4)
    assert half.stopped and len(half.history) < len(whole.history)
    shares = []
    seen = SimpleNamespace(update=lambda share, text: shares.append(share))
    resumed = run(case, out=tmp_path / "half", threads=1, resume=True, progress=seen)
    begun = len(half.history) / len(whole.history)
    assert shares[0] == pytest.approx(begun) and shares[-1] == 1.0  # what was done before is not of this pace
    same = [name for name in whole.history.columns if not name.startswith(("wall_", "processor_"))]
    assert whole.history[same].equals(resumed.history[same])
    with whole.open_record() as one, resumed.open_record() as other:
        x = one.grains(-1)["position"]
        assert x.tobytes() == other.grains(-1)["position"].tobytes()
    assert x.min() >= 0.0 and (x <= EDGE).all()
    stress = whole.summary["stress"]
    assert stress["mean"] == whole.stress.mean and not stress["converged"]
    assert "torque" not in whole.summary and whole.summary["shear_strain"] > 0.0
    assert verdict(whole)[0].text.startswith("Shear stress not known")
    row = row_of(whole, "")
    assert row["torque"] is None and row["shear_stress"] == whole.stress.mean and not row["converged"]


def test_a_run_of_one_replica_ends_by_itself_once_its_own_error_is_small(tmp_path):
    """Long before time.end, not before the shear that is needed; a run that was stopped and resumed ends there too.

    Its stress does not count as known, since the scatter between replicas is unknown.
    """
    case = scene(DRY, DENSE | {"contact.stiffness": "50 N/m", "geometry.shear_rate": 2000.0, "time.window": 5e-5,
                               "time.until": "stress 20 %", "time.end": "40 ms", "output.snapshots": 0})  # fmt: skip
    whole = run(case, out=tmp_path / "whole", threads=1)
    stress, until = whole.summary["stress"], whole.summary["until"]
    assert stress["steady_alone"] and until["half_width"] <= 0.2 * stress["mean"] and not until["reached"]
    assert not stress["converged"] and until["replicas"] == 4 and "accuracy.replicas = 4" in until["reason"]
    assert 5.0 + MIN_AVERAGED_STRAIN <= whole.summary["shear_strain"] < 40.0  # of 80; 15 to 22 seen
    run(case, out=tmp_path / "half", threads=1, callback=lambda state: state.row["time"] > 3e-3)
    resumed = run(case, out=tmp_path / "half", threads=1, resume=True)
    assert (resumed.summary["stress"], resumed.summary["until"]) == (stress, until)
    assert len(resumed.history) == len(whole.history)


@pytest.mark.parametrize("changes", [
    pytest.param({"geometry.pressure": 1e-9}, id="no pressure to speak of"),
    pytest.param(DENSE | {"particles.solid_fraction": 0.58, "contact.friction": 1.0}, id="jammed at its volume"),
])  # fmt: skip
def test_extremes_have_a_state_and_balances(changes):
    """All is finite, grains push, the box does not shrink beyond what is asked for, and the budget closes."""
    simulation = started(scene(DRY, changes))
    height = simulation.motion.box.lengths[2]
    history = march(simulation, 20)
    assert np.isfinite(history.select_dtypes(float)).all().all()
    assert history["normal_stress_z"].iloc[-1] > 0.0 < history["shear_stress"].iloc[-1]
    assert abs(history["energy_residual"].sum()) < 0.1 * history["dissipated"].sum()
    assert simulation.motion.box.lengths[2] >= height


def test_sizes_of_one_to_ten_are_packed_without_overlaps():
    """By their percentiles, which a tenth and nine tenths of the grains are finer than."""
    wide = DENSE | {"geometry.size": [3.9 * D] * 3, "particles.diameter": None, "particles.sizes": TEN}
    motion = started(scene(DRY, wide)).motion
    x, radius, box = np.array(motion.grains.position), np.array(motion.grains.radius), motion.box
    half_a_grain = np.pi / 12.0 * D**3
    assert abs(4.0 / 3.0 * np.pi * np.sum(radius**3) - 0.5 * box.volume) <= half_a_grain
    assert radius.max() / radius.min() > 8.0
    wanted = [TEN[name] for name in ("d10", "d50", "d90")]
    assert np.quantile(2.0 * radius, [0.1, 0.5, 0.9]) == pytest.approx(wanted, rel=0.2)
    apart = x[:, None] - x[None]
    apart -= box.lengths * np.round(apart / box.lengths)  # at rest
    gap = np.linalg.norm(apart, axis=-1) - radius[:, None] - radius[None]
    assert gap[~np.eye(len(x), dtype=bool)].min() > -5e-3 * 2.0 * radius.min()


def warned(values):
    return warnings_of(check(scene(DRY, values)).decisions)


def test_check_says_where_grains_fly_apart():
    """Below density (rate d)^2 an imposed pressure does not hold them."""
    flight = 7800.0 * (1000.0 * D) ** 2
    low, high = (warned({"geometry.pressure": share * flight})["shear"] for share in (0.9, 1.1))
    assert any("grains fly apart" in one for one in low) and not any("fly" in one for one in high)


def _history(strain, seed, tau=300.0, P=1000.0, windows=400):
    rng = np.random.default_rng(seed)
    common = rng.normal(0.0, 0.05, windows)
    time = np.linspace(0.0, 1.0, windows + 1)[1:]
    return pd.DataFrame(
        {
            "time": time, "shear_strain": strain * time, "shear_stress": tau * (1.0 + common),
            "normal_stress_z": P * (1.0 + common + rng.normal(0.0, 0.01, windows)),
            "contacts_per_grain": 4.0,
        }
    )  # fmt: skip


def test_friction_is_the_ratio_of_the_means():
    """Its error is that of what shear and normal stress do not have in common; without shear nothing is known."""
    found = steady_stress([_history(40.0, seed) for seed in range(4)], SteadyConditions(shear_gap=0.0))
    assert found.shear.converged and found.friction.converged
    assert found.friction.mean == pytest.approx(found.shear.mean / found.normal.mean, rel=1e-12)
    relative = [one.standard_error / one.mean for one in (found.friction, found.shear)]
    assert relative[0] < 0.5 * relative[1]
    little = steady_stress([_history(6.0, seed) for seed in range(4)], SteadyConditions(shear_gap=0.0))
    assert not little.shear.converged and "shear strain of 3;" in little.shear.reason
    pulled = steady_stress([_history(40.0, seed, P=-1000.0) for seed in range(4)], SteadyConditions(shear_gap=0.0))
    assert pulled.shear.converged and pulled.friction is None


def test_a_stress_that_is_asked_for_in_pascal_says_nothing_of_the_friction():
    """tau is steady while P, and with it tau/P, still changes by a third."""
    histories = [_history(40.0, seed) for seed in range(4)]
    for each in histories:
        each["normal_stress_z"] *= 1.0 + 0.5 * each["time"]
    for asked in ({}, {"negligible": 1000.0}):
        found = steady_stress(histories, SteadyConditions(shear_gap=0.0, **asked))
        assert found.shear.converged and not found.friction.converged


@pytest.mark.parametrize("seed", [3, 4])
def test_a_cube_has_the_fill_that_is_asked_for_with_the_sizes_that_are_drawn(seed):
    """Few grains of wide sizes have a volume that is some per cent off that of as many mean ones."""
    found = scene(DRY, CUBE | WIDE | {"particles.count": 900, "scene.seed": seed}).scene
    drawn = np.pi / 6.0 * np.sum(diameters_of(found.grains, 900, seed) ** 3)
    assert abs(drawn / (900 * found.grains.grain_volume) - 1.0) > 1e-3
    assert drawn / np.prod(found.shape().size) == pytest.approx(CELL.fill, rel=1e-12)
    dense = CUBE | WIDE | {"particles.count": 1300, "geometry.solid_fraction": 0.56, "scene.seed": seed}
    assert check(scene(DRY, dense)).decisions["grains"].startswith("1300 ")


def test_check_warns_of_a_box_that_is_pressed_too_low():
    """Grains of a fill of 0.2 in a box 4 diameters high leave a third of it, less than two neighbours need."""
    loose = {"geometry.size": [8.0 * D, 8.0 * D, 4.0 * D], "particles.count": None, "particles.solid_fraction": 0.2}
    (said,) = warned(loose | {"geometry.pressure": "1 kPa"})["box"]
    assert "the box would be 0.125 mm high" in said and "make it higher" in said
    assert "box" not in warned(loose)
    large = {"geometry.pressure": "1 kPa", "geometry.size": [2.0 * EDGE] * 3, "particles.count": 880}
    assert "box" not in warned(large)


def test_dipoles_that_do_not_saturate_shear_at_nearly_the_expected_stress_of_those_that_do():
    """Weak: H is a fiftieth of Ms."""
    mutual = {"effects.dipoles.model": "mutual", "field.field_strength": "30 kA/m"}
    both, linear = scene(MAGNETIC, mutual), scene(MAGNETIC, mutual | {"effects.saturation": None})
    stress = [one.scene.geometry.expected_stress(one.scene) for one in (both, linear)]
    assert stress[1] == pytest.approx(stress[0], rel=1e-12) and check(linear).decisions["shear"]


def test_check_names_grains_rate_and_inertial_number():
    for asked, of in ((scene(MAGNETIC), "expected shear stress"), (scene(DRY, PRESSED), "imposed pressure")):
        (line,) = (one for one in check(asked).omitted_effects if one.effect == "inertia of grains")
        assert line.value == pytest.approx(asked.scene.geometry.inertial_number, rel=1e-9) and line.number.endswith(of)
    said = check(scene(MAGNETIC)).decisions
    assert said["grains"].startswith("110 ") and "inertial number about 0.05" in said["shear"]
    until = scene(MAGNETIC, {"time.until": "stress 2 %", "time.end": "50 ms"})
    assert check(until).decisions["end"].startswith("when half the 95 % interval of the stress is at most 2 %")
    target = scene(MAGNETIC, {"time.until": "stress 5 % or 1 kPa"}).scene.time.until
    assert target.half_width(1e4) == 1e3 and str(target) == "stress 5 % or 1000.0 Pa"
    rate = make_plan(scene(MAGNETIC))[0].kind.rate(scene(MAGNETIC).scene)
    assert f"rate {rate:.4g} 1/s" in said["shear"] and "steps of 110 grains" in said["cost by part"]
    assert make_plan(scene(DRY, CUBE))[0].shape.size == pytest.approx([EDGE] * 3, rel=1e-12)
    assert rate == pytest.approx(PowderCell(dataclasses.replace(CELL, law=CELL.law)).rate, rel=1e-6)


@pytest.mark.parametrize(
    ("changes", "key", "told"),
    [
        ({"geometry.shear_rate": None}, "geometry.shear_rate", "is missing; give shear_rate"),
        ({"geometry.inertial_number": 0.1}, "geometry.inertial_number", "conflicts with shear_rate"),
        ({"geometry.size": [3e-4] * 3, "particles.count": 20}, "geometry.size", "allowed: at least"),
        ({"geometry.shear_rate": None, "geometry.inertial_number": 0.1}, "geometry.inertial_number", "needs a stress"),
        ({"geometry.pressure": 0.0}, "geometry.pressure", "allowed: > 0 Pa"),
        ({"geometry.pressure": 500.0, "contact": {"method": "dvi", "dvi": {"springs": False}}}, "contact.dvi.springs",
         "take springs = true"),
        ({"effects.gravity": {}}, "effects.gravity", "fall for ever"),
        ({"effects.fluid_drag": {"viscosity": "0.1 Pa s"}}, "effects.fluid_drag", "move past a fluid at rest"),
        ({"particles.packing": "lattice"}, "particles.packing", "take packing = 'random'"),
        ({"particles.count": None, "particles.solid_fraction": 0.62}, "particles.solid_fraction", "at most 0.58"),
        ({"geometry.size": None}, "geometry.size", "is missing; give three lengths"),
        ({"geometry.solid_fraction": 0.3}, "geometry.solid_fraction", "conflicts with size"),
        (CUBE | {"particles.count": 20}, "particles.count", "an edge of 0.3268 mm"),
        (CUBE | {"particles.count": None, "particles.mass": "1 g"}, "geometry.solid_fraction", "particles.count"),
        ({"particles.sector": "90 deg"}, "particles.sector", "repeats by itself"),
        ({"motion.rotor.speed": "10 rpm"}, "motion.rotor", "nothing to turn"),
        ({"output.profiles": True}, "output.profiles", "no meaning"),
        ({"time.until": "torque 2 %"}, "time.until", "write until = 'stress 2 %'"),
    ],
)
def test_what_a_periodic_box_cannot_have_is_refused(changes, key, told):
    with pytest.raises(SceneError) as refused:
        scene(DRY, changes)
    assert any(fault.key == key and told in fault.message for fault in refused.value.faults), str(refused.value)


@pytest.mark.parametrize(
    ("changes", "key"),
    [({"field.means": "applied"}, "field.means"), ({"field.direction": "x"}, "field.direction"),
     ({"effects.dipoles.cutoff": 4.0}, "geometry.size")],
)  # fmt: skip
def test_a_field_that_a_periodic_box_cannot_have_is_refused(changes, key):
    with pytest.raises(SceneError) as refused:
        scene(MAGNETIC, changes)
    assert key in [fault.key for fault in refused.value.faults], str(refused.value)


def test_a_pressure_that_would_press_soft_grains_flat_is_refused():
    with pytest.raises(ValueError, match=r"too soft: .* under the imposed 1e\+06 Pa"):
        make_plan(scene(DRY, {"geometry.pressure": 1e6, "contact.stiffness": "1000 N/m"}))
