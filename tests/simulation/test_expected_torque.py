"""The expected torque is the integral of the law of the powder over the sheared gap, and has the limits of that law."""

from math import pi
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

from emclutch.device_model.device import build_device
from emclutch.scene.case import case_from, load_case
from emclutch.simulation.check import check
from emclutch.simulation.forecast.expected_field import expected_magnetisation, field_of_sheared_powder
from emclutch.simulation.forecast.expected_torque import (
    CHAIN,
    ONSET,
    ONSET_SLOPE,
    RUNS_OVER_LAW,
    SPILL,
    Interval,
    chain_stress,
    expected_torque,
    fill_between_poles,
)
from emclutch.simulation.forecast.powder_law import shipped_laws
from emclutch.simulation.forecast.shot_clutch import shot_clutch_torque, shot_ring_radius
from field import MU_0, GrainLaw

CASES = Path(__file__).resolve().parents[2] / "cases"
INNER, OUTER, HEIGHT, FILL, MS = 10e-3, 11.2e-3, 2e-3, 0.35, 1.7e6
MIDDLE, GAP = 0.5 * (INNER + OUTER), OUTER - INNER
CELL = {
    "scene": {"title": "sheared annulus"},
    "geometry": {"kind": "shear_cell", "inner_radius": INNER, "outer_radius": OUTER, "height": HEIGHT},
    "field": {"source": "uniform", "field_strength": 60e3, "direction": "radial"},
    "particles": {"diameter": "0.15 mm", "solid_fraction": FILL, "sector": "20 deg", "saturation": MS},
    "contact": {"friction": 0.3},
    "motion": {"rotor": {"speed": "3 rpm"}, "disc": {"speed": 0.0}},
    "effects": {
        "dipoles": {"model": "near_field"}, "saturation": {}, "wall_images": {},
        "rolling_friction": {"coefficient": 0.2},
    },
    "time": {"end": "1 ms"},
}  # fmt: skip
GRAINS = GrainLaw(200.0, MS)


def expected(**values):
    scene = case_from(CELL, values).scene
    return expected_torque(scene, build_device(scene), None)


def in_field(H, **values):
    return expected(**{"field.field_strength": H, **values}).torque


def test_torque_of_a_cell_is_the_integral_over_its_cylinders():
    """T = (1/g) integral of tau(B(H0 R/r)) 2 pi r^2 L dr, every cylinder being one that the powder may yield on."""
    law = shipped_laws().of(0.3, 0.2, 200.0)

    def stress(r):
        B = law.flux_density(np.array(60e3 * MIDDLE / r), FILL, GRAINS, MS)
        return float(law.stress(B, MS, FILL, 8.0, 0.0))

    found, _ = quad(lambda r: stress(r) * 2.0 * pi * r**2 * HEIGHT, INNER, OUTER)
    assert in_field(60e3) == pytest.approx(RUNS_OVER_LAW * found / GAP, rel=2e-3)


def test_the_law_of_the_cells_is_that_of_iron_suspensions_within_a_factor_of_two():
    """Fit for carbonyl iron in oil of J. D. Carlson, Int. J. Mod. Phys. B 19 (2005) 1463; 12 grains per gap."""
    law = shipped_laws().of(0.3, 0.2, 200.0)
    for fill in (0.3, 0.38, 0.45):
        H = np.array([30e3, 60e3, 120e3, 200e3])
        found = law.stress(law.flux_density(H, fill, GRAINS, MS), MS, fill, 12.0)
        ratio = found / (271700.0 * fill**1.5239 * np.tanh(6.33e-6 * H))
        assert np.all((0.3 < ratio) & (ratio < 2.0))


@pytest.mark.parametrize("model", ["near_field", "mutual"])
def test_torque_increases_with_the_field(model):
    torques = [in_field(H, **{"effects.dipoles.model": model}) for H in (-1e3, 10e3, 50e3, 200e3, 800e3)]
    assert np.all(np.diff(torques) > 0.0)


def test_chain_stress_is_the_steepest_slope_of_its_energy():
    """Of one pair a grain, at d sqrt(1 + gamma^2): U = mu_0 m^2 (gamma^2 - 2)/(4 pi d^3 (1 + gamma^2)^2.5)."""
    strain = np.linspace(0.0, 1.0, 20001)
    volume = pi / 6.0
    energy = 4e-7 * pi * volume**2 / (4.0 * pi) * (strain**2 - 2.0) / (1.0 + strain**2) ** 2.5
    steepest = 0.4 / volume * np.gradient(energy, strain).max()
    assert chain_stress(0.4, np.ones(1))[0] == pytest.approx(steepest, rel=5e-3)
    assert CHAIN < 0.125


@pytest.mark.parametrize(
    "values",
    [
        {"field.direction": "axial"},
        {"field.field_strength": 0.0},
        {"effects.dipoles": None, "effects.wall_images": None, "effects.magnetic_force": {}},
    ],
)
def test_without_a_pull_across_the_gap_there_is_friction_of_the_centrifugal_force_alone(values):
    found = expected(**values)
    mass = 0.35 * 7700.0 * pi * (OUTER**2 - INNER**2) * HEIGHT
    speed = 3.0 * pi / 30.0
    assert found.torque == pytest.approx(0.3 * mass * speed**2 * MIDDLE**2, rel=0.02)  # a whole number of grains
    assert "friction from weight and centrifugal force" in found.law and found.real.low == 0.0
    weight = expected(**values, **{"effects.gravity": {}}).torque - found.torque
    assert weight == pytest.approx(0.3 * mass * 9.81 * MIDDLE, rel=0.02)


def test_a_shot_clutch_has_its_closed_form():
    scene = load_case(CASES / "thesis" / "centrifugal.toml", {"effects.gravity": None}).scene
    device, shape = build_device(scene), scene.shape()
    bulk = 0.6 * 7800.0
    torque = shot_clutch_torque(
        1000.0 * pi / 30.0, friction=0.3, bulk_density=bulk, width=shape.width, drum_radius=shape.drum_radius,
        ring_radius=shot_ring_radius(device.fill.mass / bulk, shape.width, shape.drum_radius),
    )  # fmt: skip
    assert expected_torque(scene, device, None).torque == pytest.approx(torque, rel=1e-12)


def test_intervals_say_what_they_are():
    assert Interval.within(2.0, 0.05).in_words() == "2 N m ± 10 % (95 %)"
    assert Interval(2.0, 1.0, 4.0).in_words() == "2 N m (95 %: 1 to 4)"
    assert Interval(2.0, 1.0, 4.0, is_guess=True).in_words() == "2 N m within a factor of 2"
    assert Interval(2.0, 0.2, 20.0, is_guess=True).in_words() == "of the order of 2 N m"
    assert Interval(2.0, 0.0, 2.0).in_words() == "at most of the order of 2 N m"
    one = Interval.within(3.0, 0.1)
    assert one.low * one.high == pytest.approx(9.0) and one.as_dict() == {"mean": 3.0, "low": one.low, "high": one.high}


@pytest.mark.parametrize(
    ("values", "reason"),
    [
        ({}, "no pole faces"),
        ({"effects.dipoles.model": "mutual"}, "no necks"),
        ({"effects.wall_images": None}, "no images in steel walls"),
        ({"particles.solid_fraction": 0.15}, "its fill is 0.15"),
        ({"particles.susceptibility": 2.0}, "susceptibility is 2"),
        ({"contact.friction": 0.9}, "friction is 0.9"),
        ({"effects.cohesion": {"force": "1 uN"}}, "[effects.cohesion]"),
        ({"contact.wall_friction": 0.1}, "walls have a friction of 0.1"),
        ({"effects.rolling_friction.wall_coefficient": 0.0}, "walls have a rolling friction of 0"),
    ],
)
def test_what_no_cell_has_makes_the_torque_a_guess_and_is_said(values, reason):
    found = expected(**values)
    assert "within a factor of 2" in found.in_words() and reason in found.in_words()
    assert "its coil" not in found.law  # the field is given
    assert found.unknown_powder is None and not found.parts
    assert found.real.high == pytest.approx(2.0 * found.real.mean, rel=0.01)  # and friction of the centrifugal force


def test_few_grains_are_no_continuum():
    coarse = expected(**{"particles.diameter": "0.5 mm", "particles.sector": None}).in_words()
    assert coarse.startswith("of the order of") and "fewer than 3 grains per gap" in coarse
    box = case_from(CELL, {"geometry": {"kind": "box", "size": ["2 mm", "2 mm", "2 mm"]}, "motion": None,
                           "field.direction": "z", "particles.sector": None}).scene  # fmt: skip
    assert expected_torque(box, build_device(box), None).torque is None


def quickstart(**values):
    return load_case(CASES / "quickstart.toml", {"field.size_factor": 2.0, "particles.sector": None, **values})


def of_device(case):
    device = build_device(case.scene)
    return expected_torque(case.scene, device, expected_magnetisation(case, device)[0])


def test_the_torque_of_a_device_has_an_interval_by_parts_and_a_range_of_unknown_powder():
    found = of_device(quickstart())
    half = np.log(found.real.high / found.real.mean)
    assert np.linalg.norm(list(found.parts.values())) == pytest.approx(half, rel=1e-6)
    assert set(found.parts) == {"cells", "form", "size", "edges", "jams", "sizes", "devices", "centrifugal"}
    assert found.unknown_powder[0] < found.real.mean < found.unknown_powder[1]
    written = found.as_dict()
    for name, one in (("expected_torque", found.real), ("expected_torque_scene", found.scene)):
        assert {key: written[name][key] for key in ("mean", "low", "high")} == one.as_dict()


def test_centrifugal_force_widens_the_interval_by_its_friction_and_makes_a_guess_of_fast_devices():
    """Half width mu m omega^2 r^2/T, with the square of the speed; both shafts at one speed carry the powder around."""
    case = quickstart()
    device = build_device(case.scene)
    solved = expected_magnetisation(case, device)[0]
    for rpm in (1000.0, 2000.0):
        scene = case.with_values({"motion.rotor.speed": f"{rpm} rpm", "motion.disc.speed": f"{rpm - 100.0} rpm"}).scene
        found = expected_torque(scene, device, solved, unknown_powder=False)
        friction = scene.contact.friction * device.fill.mass * (rpm * pi / 30.0 * device.shear_radius) ** 2
        assert found.parts["centrifugal"] == pytest.approx(friction / found.torque, rel=1e-6)
    fast = case.with_values({"motion.rotor.speed": "5000 rpm", "motion.disc.speed": "4900 rpm"}).scene
    found = expected_torque(fast, device, solved)
    assert found.real.is_guess and "weight and centrifugal force may change it by" in found.law
    assert found.real.mean / found.real.low == pytest.approx(found.real.high / found.real.mean, rel=1e-9)
    assert found.real.high > 2.0 * found.real.mean + 0.99 * friction  # either way
    disc = case.with_values({"motion.rotor.speed": 0.0, "motion.disc.speed": "50000 rpm"}).scene
    assert "lower the slip (motion.disc.speed) for a smaller" in expected_torque(disc, device, solved).law


def test_the_range_of_unknown_powder_does_not_depend_on_that_of_the_scene():
    """Within what the start of the solve leaves."""
    weak, strong = (
        of_device(quickstart(**{"contact.friction": 0.6, "effects.rolling_friction.coefficient": rolling}))
        for rolling in (0.053, 0.54)
    )
    assert weak.torque < 0.7 * strong.torque
    assert weak.unknown_powder == pytest.approx(strong.unknown_powder, rel=0.01)


def test_real_grains_have_less_torque_than_coarse_ones_and_are_alike_where_the_scene_has_them():
    coarse, real = of_device(quickstart()), of_device(quickstart(**{"particles.stands_for": None}))
    assert coarse.real.mean < coarse.scene.mean == pytest.approx(real.scene.mean, rel=1e-9)
    assert real.real.mean == pytest.approx(real.scene.mean, rel=0.05)  # without accuracy.inertial_number the same


def test_what_coarse_grains_add_is_the_ratio_of_both_torques_and_vanishes_with_its_error_at_the_real_size():
    ends = []
    for diameter in ("0.2 mm", "0.125 mm", "63 um"):
        found = of_device(quickstart(**{"particles.diameter": diameter}))
        value, low, high = found.size_excess
        assert low < value < high and 1.0 + value == pytest.approx(found.scene.mean / found.real.mean, rel=1e-9)
        ends.append((abs(value), high - low))
    assert sorted(ends, reverse=True) == ends and ends[-1][0] < 0.01 and ends[-1][1] < 0.02
    assert of_device(quickstart(**{"particles.stands_for": None})).size_excess is None
    guess = of_device(quickstart(**{"effects.wall_images": None, "effects.back_reaction": None}))
    assert guess.real.is_guess and guess.size_excess is None


@pytest.mark.parametrize(
    ("name", "torques", "finest"),
    [("powder_clutch", {4: 16.46, 5: 14.99, 8: 13.36}, (12, 12.86)),
     ("quickstart", {4: 0.760, 5: 0.712, 6: 0.642, 8: 0.628}, (16, 0.606))],
)  # fmt: skip
def test_runs_of_coarse_grains_have_the_torque_of_the_finest_where_both_are_corrected(name, torques, finest):
    """Runs of docs/explanation/brake.md, of which the law was given none."""

    def excess(n):
        values = {"particles.diameter": f"{1e3 / n:.6g} um", "field.size_factor": 2.0, "time.until": None}
        return of_device(load_case(CASES / f"{name}.toml", values)).size_excess

    real = finest[1] / (1.0 + excess(finest[0])[0])
    for n, torque in torques.items():
        value, low, high = excess(n)
        assert torque / (1.0 + value) == pytest.approx(real, rel=0.06)
        assert torque / (1.0 + high) < real < torque / (1.0 + low)


def test_a_device_twice_as_large_with_twice_the_current_has_eight_times_the_torque():
    """Similarity: stresses depend on B alone, so T goes with the cube of the size at equal B and grains per gap."""
    small = quickstart()
    sizes = small.scene.geometry.model_dump()
    twice = {f"geometry.{key}": 2.0 * value for key, value in sizes.items()
             if isinstance(value, float) and key != "air_factor" and value}  # fmt: skip
    large = small.with_values({**twice, "coil.current": "2 A", "particles.diameter": "0.5 mm",
                               "particles.stands_for": "120 um", "field.size_factor": 2.0})  # fmt: skip
    assert of_device(large).torque == pytest.approx(8.0 * of_device(small).torque, rel=0.01)


def test_powder_that_nearly_jams_stands_out_beyond_the_edges():
    """Volume is conserved: phi (1 + s g E) = phi_0 with the length s g on both edges, and E = 2 over the length."""
    law = shipped_laws().of(0.3, 0.2, 200.0)
    for fill in (0.2, 0.3, 0.42, 0.5):
        device = build_device(quickstart(**{"particles.solid_fraction": fill}).scene)
        phi, full = fill_between_poles(device, law, 0.25e-3), ONSET + ONSET_SLOPE * (law.jamming_fill(4.0) - 0.5)
        out = SPILL * max(0.0, phi - full) * device.shear_gap
        box = device.pole_zone.boxes[0]
        length = box.z1 - box.z0
        assert phi * (length + 2.0 * out) == pytest.approx(device.fill.solid_fraction * length, rel=1e-9)
        assert (phi < device.fill.solid_fraction) == (device.fill.solid_fraction > full)


def test_permeability_of_the_solve_is_that_of_the_law_at_its_own_field():
    """In an element between the poles B = mu_0 (H + phi M), M that of the material in H - N(H) M."""
    case = quickstart()
    device, scene = build_device(case.scene), case.scene
    coil, law = device.coil, shipped_laws().of(0.3, 0.2, 200.0)
    phi = fill_between_poles(device, law, scene.grains.mean_diameter)
    fill = coil.uniform_fill(device.fill.solid_fraction) * (phi / device.fill.solid_fraction)
    field = field_of_sheared_powder(coil, fill, scene, coil.largest_current, None)
    Ms = scene.grains.saturation
    middle = fill > 0.99 * phi
    centroid = coil.mesh.centroid()[coil.problem.powder_elements][middle]
    B = np.linalg.norm(field.flux_density(centroid), axis=1)
    grains, H = GrainLaw(200.0, Ms), np.zeros(len(B))
    for _ in range(50):
        H = B / MU_0 - phi * grains.from_flux(B, phi, law.factor(H, phi, Ms))[0]
    assert law.flux_density(H, phi, grains, Ms) == pytest.approx(B, rel=1e-6)
    solved = field.powder.factor[middle]
    assert solved == pytest.approx(law.factor(H, phi, Ms), abs=5e-3)


def test_check_tells_the_torque_in_a_line():
    told = check(quickstart(), threads=1).decisions
    assert "N m ± " in told["expected torque"]
    assert "If friction and fill of the powder were unknown" in told["expected torque"]
    assert "N m ± " in told["expected raw torque of the run (coarse grains)"]


def test_a_field_that_does_not_settle_makes_the_torque_a_guess_and_no_run_fails(monkeypatch):
    settled = of_device(quickstart()).torque
    monkeypatch.setattr("emclutch.simulation.forecast.expected_field.ROUNDS", 1)
    found = check(quickstart(), threads=1)
    assert "did not settle within 1 solves" in found.expected.law and not found.expected.parts
    assert found.expected.torque == pytest.approx(settled, rel=0.3)
    assert "sheared powder" not in found.decisions["field"]
