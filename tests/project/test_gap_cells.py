"""Laws that the measured gap cells of docs/gap_cells.csv have: power of the flux, increase with the field, one flux."""

from pathlib import Path

import numpy as np
import pytest
from gap_cells import (
    SATURATION,
    SUSCEPTIBILITY,
    UNSATURATED,
    cells_of,
    demagnetising_law,
    means_over_seeds,
    over_law,
    read_table,
    stress_law,
)

from field import MU_0, GrainLaw

pytestmark = pytest.mark.physics
TABLE = read_table(Path(__file__).parents[2] / "docs" / "gap_cells.csv")
EIGHT = means_over_seeds(cells_of(TABLE, height=8, edge=8))


def test_the_stress_is_a_power_of_the_flux_density_times_a_factor_of_the_fill():
    """Within 5 % at eight grains per gap; the exponent is between 1 (of pressure B M) and 2 (of Maxwell's stress)."""
    law = stress_law(EIGHT)
    assert len(law.residuals) >= 12 and law.largest < np.log(1.05)
    assert 1.0 < law.values[1] - law.half_widths[1] < law.values[1] + law.half_widths[1] < 2.0


def test_the_law_of_the_flux_is_found_again():
    """Cells made by a law give its coefficients; a cell of twice the stress is twice the law."""
    law = stress_law(EIGHT)
    made = EIGHT | {"shear_stress": EIGHT["shear_stress"] / over_law(law, EIGHT)}
    assert stress_law(made).values == pytest.approx(law.values, rel=1e-9) and stress_law(made).largest < 1e-9
    assert over_law(law, made | {"shear_stress": 2.0 * made["shear_stress"]}) == pytest.approx(2.0, rel=1e-9)


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
    assert MU_0 * (H + TABLE["solid_fraction"] * M) == pytest.approx(TABLE["flux_density"], rel=1e-5)
    assert GrainLaw(SUSCEPTIBILITY, SATURATION).field_inside(M) == pytest.approx(H - N * M, rel=0.01)
    assert (TABLE["solid_fraction"] == pytest.approx(TABLE["fill"], rel=0.005)) and (M < SATURATION).all()


def test_the_demagnetising_factor_is_linear_in_the_field_and_below_that_of_a_sphere():
    """Within 0.01 at eight grains per gap, as far as grains are not saturated; chains have less than a sphere's 1/3."""
    law = demagnetising_law(EIGHT)
    assert law.largest < 0.01 and law.values[1] > law.half_widths[1]
    below = EIGHT["magnetisation"] < UNSATURATED * SATURATION
    assert (EIGHT["demagnetising_factor"][below] < 1.0 / 3.0).all() and (EIGHT["demagnetising_factor"] > 0.0).all()


def test_fewer_grains_per_gap_have_more_stress():
    """At equal field and fill: 4 more than 8."""
    cells = means_over_seeds(TABLE)
    four, eight = (cells_of(cells, height=n, edge=8) for n in (4, 8))
    assert len(four["fill"]) > 0
    for H, fill, stress in zip(four["field_strength"], four["fill"], four["shear_stress"], strict=True):
        assert stress > cells_of(eight, field_strength=H, fill=fill)["shear_stress"][0]


def test_every_cell_is_averaged_over_a_strain_of_eight_and_eight_grains_per_gap_are_known_to_five_per_cent():
    assert (TABLE["to_strain"] - TABLE["from_strain"] >= 7.9).all()
    assert (EIGHT["standard_error"] < 0.05 * EIGHT["shear_stress"]).all()
