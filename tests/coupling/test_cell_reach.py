"""The stress of a cell that repeats does not depend on how many neighbours are summed one by one."""

import pytest

from coupling import magnetised_cell
from field import GrainLaw

R = 1e-4


@pytest.mark.parametrize("model", ["mutual", "near_field"])
@pytest.mark.parametrize(("side", "far"), [(2.6, 20.0), (4.0, 26.0)])
def test_stress_of_a_simple_cubic_lattice_converges(model, side, far):
    """Shells of a lattice enter a sphere of neighbours all at once: sparse ones were wrong by up to 24 %."""

    def stress(reach):
        law, options = GrainLaw(chi=999.0, Ms=1.7e6), {"model": model, "tolerance": 1e-7, "reach": reach}
        return magnetised_cell([[0, 0, 0]], R, [side * R] * 3, law, [0, 0, 2e4], **options).stress[2, 2]

    exact = stress(far)  # 0.6 % from that of 30 radii
    for reach in (5.0, 8.0, 11.0):
        assert stress(reach) == pytest.approx(exact, rel=0.02)
