"""Laws that the measured gap cells of docs/gap_cells.csv have: power of the flux, increase with the field, one flux."""

from pathlib import Path

import numpy as np
import pytest
from gap_cells import OF_REPOSE, SATURATION, Cell, cells_of, means_over_seeds, of_brake, powder_laws, read_table

from emclutch.simulation.forecast.powder_law import UNSATURATED, PowderLaws, shipped_laws
from field import MU_0, GrainLaw

pytestmark = pytest.mark.physics
PATH = Path(__file__).parents[2] / "docs" / "gap_cells.csv"
TABLE = read_table(PATH)
EIGHT = means_over_seeds(cells_of(of_brake(TABLE), height=8, edge=8))


def test_the_laws_that_ship_are_those_of_the_table():
    """To a fiftieth of their errors: another processor rounds otherwise."""
    fitted, shipped = powder_laws(TABLE, PATH), shipped_laws()
    assert shipped.provenance["cells_sha256"] == fitted.provenance["cells_sha256"]
    assert np.array_equal(shipped.powders, fitted.powders) and np.array_equal(shipped.unknown, fitted.unknown)
    assert (np.abs(shipped.own - fitted.own) < 0.02 * fitted.own_errors).all()
    assert (np.abs(shipped.common - fitted.common) < 0.02 * fitted.common_errors).all()
    for name in ("own_errors", "common_errors", "deviation", "permeability", "cells"):
        assert getattr(shipped, name) == pytest.approx(getattr(fitted, name), rel=0.02), name


def test_cells_of_all_powders_and_sizes_have_one_law_within_its_deviation():
    """95 % within two deviations; the exponent of the flux is between 1 (of pressure B M) and 2 (Maxwell's stress)."""
    laws, cells = shipped_laws(), cells_of(TABLE, spread=1.0)
    missed = [
        np.log(tau / float(laws.of(*powder).stress(np.array(B), SATURATION, fill, n, inertia)))
        for *powder, tau, B, fill, n, inertia in zip(
            *(cells[name] for name in ("friction", "rolling_friction", "susceptibility", "shear_stress", "flux_density",
                                       "solid_fraction", "height", "inertial_number")), strict=True
        )
    ]  # fmt: skip
    assert (np.abs(missed) < 2.0 * laws.deviation).mean() > 0.9 and np.abs(missed).max() < 4.0 * laws.deviation
    assert laws.deviation < 0.05 and 1.0 < laws.common[0] - 2.0 * laws.common_errors[0] < laws.common[0] < 2.0


def test_a_law_of_a_few_cells_of_a_powder_has_the_stress_of_its_others_within_its_error():
    """Each powder with eight cells or more, known before by a fit to the cells of all others; three to six cells."""
    laws, cells, random, missed = shipped_laws(), cells_of(TABLE, spread=1.0), np.random.default_rng(1), []
    cells |= {"saturation": np.full(len(cells["fill"]), SATURATION), "grains_per_gap": cells["height"]}
    names = ("flux_density", "solid_fraction", "height", "inertial_number", "shear_stress")
    keys = ("friction", "rolling_friction", "susceptibility")
    for k in np.flatnonzero(laws.cells >= 8):
        is_own = np.all([cells[name] == value for name, value in zip(keys, laws.powders[k], strict=True)], axis=0)
        others, own = ({name: one[which] for name, one in cells.items()} for which in (~is_own, is_own))
        before, _ = PowderLaws.fit(others, laws.unknown, {}).nearest(*laws.powders[k])
        for count in (3, 4, 5, 6):
            chosen = random.permutation(len(own["fill"])) < count
            law = before.fit({name: column[chosen] for name, column in own.items()}, {})
            for B, fill, n, inertia, tau in zip(*(own[name][~chosen] for name in names), strict=True):
                found = float(law.stress(np.array(B), SATURATION, fill, n, inertia))
                errors = law.errors_at(B / (MU_0 * SATURATION), fill, n, inertia)
                missed.append(np.log(tau / found) / np.linalg.norm(list(errors.values())))
    assert len(missed) > 200 and (np.abs(missed) < 1.96).mean() > 0.94


def test_the_pressure_on_the_faces_is_that_of_the_law_whatever_the_friction():
    """Nothing of a powder but its jamming fill is in it; powders differ from it by less than 8 %."""
    laws, cells = shipped_laws(), cells_of(TABLE, spread=1.0)
    slow = cells["inertial_number"] < 0.35
    columns = (
        "friction",
        "rolling_friction",
        "susceptibility",
        "wall_pressure",
        "flux_density",
        "solid_fraction",
        "height",
    )
    missed = {}
    for *powder, P, B, fill, n in zip(*(cells[name][slow] for name in columns), strict=True):
        wanted = float(laws.of(*powder).pressure(np.array(B), SATURATION, fill, n))
        missed.setdefault(tuple(powder), []).append(np.log(P / wanted))
    assert np.concatenate(list(missed.values())).std() < 0.05
    assert all(abs(np.mean(one)) < 0.08 for one in missed.values())


def test_stress_pressure_and_flux_density_increase_with_field_and_fill():
    for given, other in (("fill", "field_strength"), ("field_strength", "fill")):
        for value in np.unique(EIGHT[given]):
            cells = cells_of(EIGHT, **{given: value})
            order = np.argsort(cells[other])
            for name in ("shear_stress", "wall_pressure", "flux_density"):
                assert (np.diff(cells[name][order]) > 0.0).all(), (given, value, name)


def test_flux_magnetisation_and_demagnetising_factor_say_the_same():
    """B = mu_0 (H + fill M) with the fill of the number of grains; the grains' material has M in the field H - N M."""
    H, M, N = (TABLE[name] for name in ("field_strength", "magnetisation", "demagnetising_factor"))
    equal = TABLE["spread"] == 1.0
    assert (MU_0 * (H + TABLE["solid_fraction"] * M))[equal] == pytest.approx(TABLE["flux_density"][equal], rel=1e-5)
    for chi in np.unique(TABLE["susceptibility"]):
        of = equal & (chi == TABLE["susceptibility"]) & np.isfinite(N)
        assert GrainLaw(chi, SATURATION).field_inside(M[of]) == pytest.approx((H - N * M)[of], rel=0.02)
    assert TABLE["solid_fraction"][equal] == pytest.approx(TABLE["fill"][equal], rel=0.005)


def test_the_demagnetising_factor_is_linear_in_the_field_and_below_that_of_a_sphere():
    """Within 0.01 at eight grains per gap, as far as grains are not saturated; chains have less than a sphere's 1/3."""
    law = shipped_laws().of(0.3, 0.2, 273.0)
    below = EIGHT["field_strength"] / SATURATION < UNSATURATED
    factor = law.factor(EIGHT["field_strength"], EIGHT["solid_fraction"], SATURATION)
    assert factor[below] == pytest.approx(EIGHT["demagnetising_factor"][below], abs=0.01)
    assert (factor < 1.0 / 3.0).all() and (factor > 0.0).all() and law.permeability[1] > 0.0


def test_fewer_grains_per_gap_have_more_stress():
    """At equal field and fill: 4 more than 8, and 8 more than 16; at a fill of 0.30 nothing jams."""
    cells = means_over_seeds(of_brake({name: column[TABLE["fill"] > 0.35] for name, column in TABLE.items()}))
    eight = cells_of(cells, height=8, edge=8)
    for n, edge, sign in ((4, 8, 1.0), (16, 12, -1.0)):
        other = cells_of(cells, height=n, edge=edge)
        assert len(other["fill"]) > 0
        for H, fill, stress in zip(other["field_strength"], other["fill"], other["shear_stress"], strict=True):
            assert sign * (stress - cells_of(eight, field_strength=H, fill=fill)["shear_stress"][0]) > 0.0


def test_every_cell_is_averaged_over_a_strain_of_eight_and_eight_grains_per_gap_are_known_to_five_per_cent():
    assert (TABLE["to_strain"] - TABLE["from_strain"] >= 7.9).all()
    assert (EIGHT["standard_error"] < 0.05 * EIGHT["shear_stress"]).all()


@pytest.mark.stability
@pytest.mark.slow
@pytest.mark.parametrize("fill", [0.38, 0.45])
@pytest.mark.parametrize(
    "powder", [(0.3, 0.2, 200.0), (0.3, 0.2, 273.0), (0.3, 0.2, 999.0), *((0.6, one, 273.0) for one in OF_REPOSE)]
)
def test_cells_of_the_shipped_powders_have_their_law_again(powder, fill):
    """Another seed: within three standard deviations, those of the law and of the run."""
    friction, rolling, chi = powder
    cell = Cell(150e3, fill, seed=11, friction=friction, rolling_friction=rolling, susceptibility=chi)
    row = {name: float(value) for name, value in cell.row().items()}
    law = shipped_laws().of(*powder)
    tau = float(law.stress(np.array(row["flux_density"]), SATURATION, fill, 8.0, row["inertial_number"]))
    error = np.linalg.norm([*law.errors_at(0.4, fill, 8.0, 0.1).values(), row["standard_error"] / row["shear_stress"]])
    assert abs(np.log(row["shear_stress"] / tau)) < 3.0 * float(error)
