"""The law of the powder has the coefficients of its cells, similarity, and limits; files of other kinds are refused."""

import json
from dataclasses import fields, replace

import numpy as np
import pytest

from emclutch.simulation.forecast.powder_law import COEFFICIENTS, FILE, PowderLaw, PowderLaws, shipped_laws
from field import MU_0, GrainLaw

pytestmark = pytest.mark.physics
BRAKE = (0.3, 0.2, 273.0)
MADE = {"ln_A": -4.0, "ln_fill": -0.8, "flux": 1.5, "power": 8.0, "size": 3.0, "size_fill": 2.0, "inertia": 0.1}
CHANGE = -0.1  # of the exponent of the flux with ln chi


POWDERS_MADE = [
    (0.3, 0.2, 300.0),
    (0.5, 0.4, 300.0),
    (0.6, 0.1, 900.0),
    (0.4, 0.0, 300.0),
    (0.2, 0.5, 150.0),
    (0.35, 0.3, 300.0),
]


def made_cells(noise=0.0, seed=0):
    """Cells of three powders that follow a made-up law; powders differ by 0.1 of ln A and -0.02 of ln phi_1."""
    random = np.random.default_rng(seed)
    cells = {name: [] for name in ("friction", "rolling_friction", "susceptibility", "saturation", "field_strength",
                                   "solid_fraction", "grains_per_gap", "inertial_number", "flux_density",
                                   "demagnetising_factor", "shear_stress")}  # fmt: skip
    for powder, (friction, rolling, chi) in enumerate(POWDERS_MADE):
        for _ in range(24):
            Ms, H, fill = random.uniform(1.0e6, 2.0e6), random.uniform(20e3, 150e3), random.uniform(0.3, 0.46)
            n, inertia = random.choice([4.0, 8.0, 16.0]), random.uniform(0.02, 0.8)
            b, x = random.uniform(0.1, 0.6), np.log(fill / 0.38)
            w = n**-2.0 - 1.0 / 64.0
            excess = MADE["inertia"] * (inertia**2 - 0.01)
            jamming = fill / np.exp(MADE["ln_fill"] - 0.02 * powder - MADE["size_fill"] * w - excess)
            flux = MADE["flux"] + CHANGE * np.log(chi / 273.0)
            y = (MADE["ln_A"] + 0.1 * powder + flux * np.log(b / 0.4) + np.log(1.0 + jamming ** MADE["power"])
                 + MADE["size"] * w)  # fmt: skip
            values = (friction, rolling, chi, Ms, H, fill, n, inertia, b * MU_0 * Ms,
                      0.08 + 0.01 * powder + 0.3 * H / Ms - 0.02 * x,
                      MU_0 * Ms**2 * np.exp(y + noise * random.standard_normal()))  # fmt: skip
            for name, value in zip(cells, values, strict=True):
                cells[name].append(value)
    return {name: np.array(values) for name, values in cells.items()}


def test_the_law_that_made_the_cells_is_found_again():
    laws = PowderLaws.fit(made_cells(), np.array([[0.4, 0.2]]), {})
    for powder, (friction, rolling, chi) in enumerate(POWDERS_MADE):
        law = laws.of(friction, rolling, chi)
        wanted = (
            MADE
            | {"flux": MADE["flux"] + CHANGE * np.log(chi / 273.0)}
            | {"ln_A": -4.0 + 0.1 * powder, "ln_fill": -0.8 - 0.02 * powder}
        )
        assert dict(zip(COEFFICIENTS, law.coefficients, strict=True)) == pytest.approx(wanted, abs=1e-6)
        assert law.permeability == pytest.approx((0.08 + 0.01 * powder, 0.3, -0.02), abs=1e-9)
        assert law.deviation < 1e-7 and law.cells == 24


def test_errors_of_the_coefficients_are_those_of_repeated_cells():
    """Over 200 sets of cells with 3 % of noise: 90 to 99 % of ln A within 1.96 standard errors, no bias."""
    laws = [
        PowderLaws.fit(made_cells(0.03, seed), np.array([[0.4, 0.2]]), {}).of(*BRAKE[:2], 300.0) for seed in range(200)
    ]
    missed = np.array([(law.coefficients[0] + 4.0) / law.errors[0] for law in laws])
    assert 0.90 < (np.abs(missed) < 1.96).mean() < 0.99 and abs(missed.mean()) < 3.0 / np.sqrt(200)
    assert np.mean([law.deviation for law in laws]) == pytest.approx(0.03, rel=0.02)


def test_stresses_go_with_the_square_of_the_saturation():
    law = shipped_laws().of(*BRAKE)
    B = np.array([0.2, 0.5])
    assert law.stress(2.0 * B, 2.6e6, 0.4, 8.0) == pytest.approx(4.0 * law.stress(B, 1.3e6, 0.4, 8.0), rel=1e-12)
    assert law.stress(np.zeros(1), 1.3e6, 0.4, 8.0)[0] == 0.0


def test_flux_and_field_fit_the_material_of_the_grains():
    """B = mu_0 (H + phi M), M that of the material in the field H - N M."""
    law, grains, H, fill = shipped_laws().of(*BRAKE), GrainLaw(273.0, 1.3e6), np.geomspace(1e3, 160e3, 7), 0.41
    M = (law.flux_density(H, fill, grains, 1.3e6) / MU_0 - H) / fill
    assert grains.field_inside(M) == pytest.approx(H - law.factor(H, fill, 1.3e6) * M, rel=1e-6)


def test_more_grains_per_gap_have_less_stress_down_to_a_limit():
    law = shipped_laws().of(*BRAKE)
    stress = [float(law.stress(np.array(0.5), 1.3e6, 0.4, n)) for n in (4.0, 6.0, 8.0, 16.0, 64.0, 1e6)]
    assert np.all(np.diff(stress) < 0.0) and stress[-1] == pytest.approx(stress[-2], rel=2e-3)


def test_a_powder_between_the_measured_ones_has_a_larger_error():
    laws = shipped_laws()
    known, between = laws.of(*BRAKE), laws.of(0.35, 0.2, 273.0)
    assert known.cells > 20 and between.cells == 0
    errors = [law.errors_at(0.4, 0.38, 8.0, 0.1)["cells"] for law in (known, between)]
    assert errors[0] < errors[1]
    stress = [float(law.stress(np.array(0.6), 1.3e6, 0.38, 8.0)) for law in (known, between)]
    assert abs(np.log(stress[1] / stress[0])) < 3.0 * errors[1]


def test_the_law_is_continuous_at_a_measured_powder_and_the_brake_is_stronger_with_more_friction():
    """The stress of the brake rises from 0.25 to 0.35; each 0.001 changes it by less than 0.2 %."""
    laws = shipped_laws()
    stress = [float(laws.of(friction, *BRAKE[1:]).stress(np.array(0.6), 1.3e6, 0.41, 8.0))
              for friction in np.linspace(0.25, 0.35, 101)]  # fmt: skip
    assert (np.diff(stress) > 0.0).all() and (np.diff(np.log(stress)) < 2e-3).all()
    near, own = laws.interpolated(laws.powders * (1.0 + 1e-9)), laws.own
    assert np.array([law.coefficients[:2] for law in near]) == pytest.approx(own[:, :2], abs=1e-6)
    assert np.array([law.errors[:2] for law in near]) == pytest.approx(laws.own_errors[:, :2], rel=1e-3)
    assert [law.correlation for law in near] == pytest.approx(laws.correlation, rel=1e-3)


def test_measured_powders_are_found_again_by_the_others_within_the_error_of_the_interpolation():
    """Leave one out: 95 % of ln A and ln phi_1 within 1.96 standard errors, to one powder of 23."""
    laws = shipped_laws()
    missed, errors = [], []
    for k in range(len(laws.powders)):
        rest = np.arange(len(laws.powders)) != k
        parts = {name: getattr(laws, name)[rest] for name in ("powders", "cells", "own", "own_errors", "correlation")}
        (law,) = replace(laws, **parts).interpolated(laws.powders[k : k + 1])
        missed.append(laws.own[k, :2] - law.coefficients[:2])
        errors.append(np.hypot(law.errors[:2], laws.own_errors[k, :2]))
    assert laws.left_out[:, :2] == pytest.approx(np.array(missed), abs=1e-8)
    inside = (np.abs(missed) < 1.96 * np.array(errors)).sum(axis=0)
    assert (inside >= 21).all(), inside


@pytest.mark.parametrize(("powder", "name"), [((0.9, 0.2, 273.0), "friction is 0.9"), ((0.3, 2.0, 273.0), "rolling"),
                                              ((0.3, 0.2, 5000.0), "susceptibility is 5000")])  # fmt: skip
def test_a_powder_outside_of_the_measured_ones_is_refused_with_their_range(powder, name):
    with pytest.raises(ValueError, match=name):
        shipped_laws().of(*powder)
    nearest, why = shipped_laws().nearest(*powder)
    assert nearest.powder in set(map(tuple, shipped_laws().powders.tolist())) and name in why
    same, why = shipped_laws().nearest(*BRAKE)
    assert same.powder == BRAKE and same.cells > 20 and why == ""


def test_beyond_the_cells_stress_saturates_and_vanishes_with_flux_and_fill():
    law, Ms = shipped_laws().of(*BRAKE), 1.3e6
    strong = law.stress(MU_0 * Ms * np.array([0.7, 5.0]), Ms, 0.38, 8.0)
    assert strong[1] == pytest.approx(strong[0], rel=1e-12)
    weak = law.stress(MU_0 * Ms * np.array([1e-4, 2e-4]), Ms, 0.38, 8.0)
    assert weak[1] == pytest.approx(4.0 * weak[0], rel=1e-9)
    thin = [float(law.stress(np.array(0.5), Ms, fill, 8.0)) for fill in (1e-3, 2e-3)]
    assert thin[1] == pytest.approx(2.0**1.5 * thin[0], rel=1e-3)
    assert np.isfinite(list(law.errors_at(0.0, 1e-3, 8.0, 0.1).values())).all()


def test_laws_are_written_and_read_to_the_last_bit(tmp_path):
    laws = PowderLaws.fit(made_cells(0.03), np.array([[0.4, 0.2]]), {"cells": "made"})
    laws.write(tmp_path / "laws.json")
    again = PowderLaws.read(tmp_path / "laws.json")
    for name in (one.name for one in fields(PowderLaws)):
        assert np.array_equal(getattr(laws, name), getattr(again, name)), name


def test_the_law_of_one_powder_is_found_by_its_cells_with_their_errors(tmp_path):
    """Over 100 sets of six cells with 3 % of noise: ln A within its error and without bias; more cells, less error."""
    laws = PowderLaws.fit(made_cells(0.03), np.array([[0.4, 0.2]]), {})
    prior, missed = laws.of(*POWDERS_MADE[1]), []
    for seed in range(100):
        cells = {name: column[24:30] for name, column in made_cells(0.03, 1000 + seed).items()}
        law = prior.fit(cells, {"contact.friction": 0.5})
        missed.append((law.coefficients[0] + 3.9) / law.errors[0])
    assert 0.88 < (np.abs(missed) < 1.96).mean() and abs(np.mean(missed)) < 0.5 and np.std(missed) > 0.5
    whole = prior.fit({name: column[24:48] for name, column in made_cells(0.03).items()}, {})
    assert whole.errors[0] < law.errors[0] and whole.cells == 24
    law.write(tmp_path / "law.json")
    again = PowderLaw.read(tmp_path / "law.json")
    assert again.measured == law.measured and np.array_equal(again.coefficients, law.coefficients)
    assert np.array_equal(again.errors, law.errors) and again.permeability == law.permeability


def test_a_powder_unlike_those_of_the_prior_has_larger_errors():
    """Coefficients of all powders 20 times their errors off, over 100 powders of ten cells: within 95 % of them."""
    prior, random, missed = shipped_laws().of(*BRAKE), np.random.default_rng(5), []
    b = np.array([0.35, 0.35, 0.35, 0.35, 0.15, 0.35, 0.35, 0.35, 0.35, 0.07])
    fill = np.array([0.38, 0.456, 0.304, 0.38, 0.38, 0.38, 0.456, 0.304, 0.38, 0.38])
    n = np.array([8.0, 8.0, 8.0, 8.0, 8.0, 4.0, 8.0, 8.0, 12.0, 8.0])
    Ms, at = 1.3e6, ((0.55, 0.38, 16.0), (0.35, 0.46, 4.0))
    for _ in range(100):
        off = np.append([0.3, 0.15], 20.0 * prior.errors[2:]) * random.standard_normal(len(COEFFICIENTS))
        truth = replace(prior, coefficients=np.minimum(prior.coefficients + off, [9.0, np.log(0.6), *[99.0] * 5]))
        tau = [float(truth.stress(np.array(x * MU_0 * Ms), Ms, y, z)) for x, y, z in zip(b, fill, n, strict=True)]
        law = prior.fit({
            "saturation": np.full(10, Ms), "field_strength": np.full(10, 6e4), "solid_fraction": fill,
            "grains_per_gap": n, "inertial_number": np.full(10, 0.1), "flux_density": b * MU_0 * Ms,
            "shear_stress": np.array(tau) * np.exp(prior.deviation * random.standard_normal(10)),
            "demagnetising_factor": np.full(10, np.nan),
        }, {})  # fmt: skip
        for x, y, z in at:
            errors = law.errors_at(x, y, z, 0.1)
            ratio = law.stress(np.array(x * MU_0 * Ms), Ms, y, z) / truth.stress(np.array(x * MU_0 * Ms), Ms, y, z)
            missed.append(float(np.log(ratio)) / np.hypot(errors["cells"], errors["size"]))
    inside = (np.abs(missed) < 1.96).reshape(-1, len(at)).mean(axis=0)
    assert (inside > 0.9).all(), inside


def test_cells_of_one_field_do_not_tell_the_exponent_of_a_powder_without_necks():
    """It is 2.1 in place of 1.47, so that the stress at a third of the flux density is half of the law's."""
    prior, Ms = shipped_laws().of(*BRAKE), 1.3e6
    truth = replace(prior, coefficients=prior.coefficients + np.eye(len(COEFFICIENTS))[2] * (2.1 - 1.47))
    fill, n, B = np.array([0.38, 0.45, 0.3]), 8.0, 0.35 * MU_0 * Ms
    cells = {"saturation": np.full(3, Ms), "field_strength": np.full(3, 6e4), "solid_fraction": fill,
             "grains_per_gap": np.full(3, n), "inertial_number": np.full(3, 0.1), "flux_density": np.full(3, B),
             "shear_stress": np.array([float(truth.stress(np.array(B), Ms, one, n)) for one in fill]),
             "demagnetising_factor": np.full(3, np.nan)}  # fmt: skip
    for is_unlike in (False, True):
        law = prior.fit(cells, {}, is_unlike)
        ratio = law.stress(np.array(B / 3.0), Ms, 0.38, n) / truth.stress(np.array(B / 3.0), Ms, 0.38, n)
        assert (np.log(ratio) < 1.96 * law.errors_at(0.35 / 3.0, 0.38, n, 0.1)["cells"]) == is_unlike


def test_dilute_cells_leave_the_jamming_fill_open():
    """Cells at half the jamming fill say nothing of it: its error is at least that of what is known before."""
    laws = PowderLaws.fit(made_cells(0.03), np.array([[0.4, 0.2]]), {})
    cells = {name: column[24:48] for name, column in made_cells().items()}
    thin = cells["solid_fraction"] < 0.34
    law = laws.of(*POWDERS_MADE[1]).fit({name: column[thin] for name, column in cells.items()}, {})
    assert law.errors[1] > 0.05 and law.errors_at(0.4, 0.45, 8.0, 0.1)["cells"] > 0.1


@pytest.mark.parametrize(
    ("change", "text"),
    [
        ({"version": 0}, "of version 0"),
        ({"version": "1"}, "of version '1'"),
        ({"powders": None}, "no powder laws"),
        ({"powders": []}, "powder laws"),
        ({"deviation": float("nan")}, "no finite numbers"),
        ({"common": {}}, "no powder laws"),
    ],
)
def test_files_of_another_version_or_kind_are_refused(tmp_path, change, text):
    (tmp_path / "laws.json").write_text(json.dumps(json.loads(FILE.read_text()) | change))
    with pytest.raises(ValueError, match=text):
        PowderLaws.read(tmp_path / "laws.json")
