"""A lone sphere of any bulk law in a uniform field: H_in = h - M/3, B = mu_0 (H_in + M)."""

import numpy as np
import pytest

from field import MU_0, BrauerLaw, FroehlichLaw, GrainLaw, LangevinLaw, LinearLaw, ThesisLaw, material
from field.spheres.lone_sphere import (
    bulk_law,
    saturation,
    sphere_flux_density,
    sphere_magnetisation,
)

FIELDS = np.concatenate(([0.0], np.logspace(-3.0, 8.0, 60)))
SATURATING = [
    FroehlichLaw(999.0, 1.7e6),
    FroehlichLaw(2.0, 4e5),
    LangevinLaw(50.0, 1e6),
    BrauerLaw(0.3774, 2.97, 388.33),
    material("steel_1010"),
    material("team_steel"),
    material("dc01"),
]


@pytest.mark.parametrize("grains", [GrainLaw(999.0, 1.7e6), GrainLaw(10.0, 1.3e6), GrainLaw(0.5, 4e5), GrainLaw(99.0)])
def test_the_sphere_of_a_grain_is_the_grain_law_without_neighbours(grains):
    M = grains.magnetisation(FIELDS, 0.0)
    # far in saturation M is a small difference of B/mu_0 and h
    assert np.allclose(sphere_magnetisation(grains, FIELDS), M, rtol=1e-9, atol=1e-15 * FIELDS.max())


@pytest.mark.parametrize("law", SATURATING, ids=lambda law: law.name)
def test_the_field_inside_is_that_of_the_law(law):
    B, M = sphere_flux_density(law, FIELDS), sphere_magnetisation(law, FIELDS)
    H = law.H_of_B(B)[0]
    assert np.allclose(H, FIELDS - M / 3.0, rtol=1e-9, atol=2e-9 * np.maximum(FIELDS, M).max())
    assert np.allclose((2.0 * H + B / MU_0) / 3.0, FIELDS, rtol=1e-12)
    assert np.all(np.diff(B) > 0.0) and B[0] == M[0] == 0.0


@pytest.mark.parametrize("law", SATURATING, ids=lambda law: law.name)
def test_limits_at_no_field_and_in_saturation(law):
    chi = 1.0 / (MU_0 * law.H_of_B(np.zeros(1))[1][0]) - 1.0
    assert sphere_magnetisation(law, 1e-6) == pytest.approx(1e-6 * chi / (1.0 + chi / 3.0), rel=1e-3)
    assert sphere_magnetisation(law, 1e9) == pytest.approx(saturation(law), rel=1e-3)


def test_saturation_of_a_table_is_that_of_its_last_point_or_its_polarisation():
    steel, transformer = material("steel_1010"), material("team_steel")
    assert saturation(transformer) == pytest.approx(transformer.B[-1] / MU_0 - transformer.H[-1], rel=1e-9)
    assert saturation(steel) == pytest.approx(steel.J_s / MU_0, rel=1e-4)
    assert saturation(GrainLaw(273.0, 1.3e6)) == 1.3e6


def test_a_linear_sphere():
    assert sphere_magnetisation(LinearLaw(10.0), 1e3) == pytest.approx(3.0 * 9.0 / 12.0 * 1e3, rel=1e-12)
    assert sphere_magnetisation(LinearLaw(1.0), np.ones((2, 3))).shape == (2, 3)
    assert isinstance(bulk_law(GrainLaw(9.0)), LinearLaw) and bulk_law(GrainLaw(9.0)).mu_r == 10.0


def test_what_cannot_be_is_refused():
    with pytest.raises(ValueError, match="no saturation magnetisation"):
        saturation(LinearLaw(1000.0, "ideal iron"))
    with pytest.raises(ValueError, match="no saturation magnetisation"):
        saturation(material("air"))
    with pytest.raises(ValueError, match="no bulk material"):
        bulk_law(ThesisLaw(0.3, 1e6))
    with pytest.raises(ValueError, match="magnitude"):
        sphere_magnetisation(FroehlichLaw(999.0, 1.7e6), np.array([1.0, -1.0]))
