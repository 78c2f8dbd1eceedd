"""Grains' moments in the solved field, in free space: rings of them against all their pairs, one by one."""

import numpy as np
import pytest
from fed_back_grains import IRON, A, D, all_pairs, fed_back, in_air, powder_problem, random_grains, ring_of
from half_disc import half_disc

from coupling.cluster import magnetised_cluster
from field import MU_0, PowderState
from particles import CyclicSector

pytestmark = pytest.mark.physics

R = 20.0 * D
H0 = 46e3
REACH = 1.015 * A  # half the distance of grains with a gap of 0.03 radii
CLUSTERS = {
    "along": [[0.0, 0.0, -REACH], [0.0, 0.0, REACH]],
    "across": [[-REACH, 0.0, 0.0], [REACH, 0.0, 0.0]],
    "oblique": [[-0.5 * REACH, 0.0, -0.866 * REACH], [0.5 * REACH, 0.0, 0.866 * REACH]],
    "chain": [[0.0, 0.0, 2.0 * REACH * (k - 2)] for k in range(5)],
    "triangle": [[-0.586 * A, 0.0, -1.015 * A], [-0.586 * A, 0.0, 1.015 * A], [1.172 * A, 0.0, 0.0]],
}


def worst(result, true):
    return np.abs(result - true).max() / np.abs(true).max()


@pytest.mark.parametrize("name", CLUSTERS)
def test_rings_of_clusters_are_all_their_pairs_whatever_the_width(name):
    """Equal clusters 1.05 d apart: moments within 1 % and forces within 2 % of the largest, for a of 2 and 2.5 d.

    Rings of grains cannot be nearer than that, 0.53 a at the smallest width, where they are no even ring any more:
    that is what is left, 0.4 % and 1.6 %; at 2.5 d it is 0.4 and 0.3 %, at 3.5 d 0.02 and 0.1 %.
    """
    x = np.add(CLUSTERS[name], [R, 0.0, 0.0])
    ring, n = ring_of(x, 1.05 * D)
    moment, force = all_pairs(x, A, IRON, np.array([0.0, 0.0, H0]), n)
    for a in (2.0, 2.5):
        result = fed_back(in_air(x, a * D), IRON, ring, A, a * D, boundary_field=MU_0 * H0, agree=1e-5)
        assert result.residuals[-1] <= 1e-5
        assert worst(result.moment[::n], moment) < 0.01, a
        assert worst(result.force[::n], force) < (0.02 if a < 2.5 else 0.005), a


@pytest.mark.parametrize("name", ["across", "triangle"])
def test_necks_of_rings_of_clusters_do_not_depend_on_the_width(name):
    """The mmfs of the necks come out of the solved field, which holds both partners and all others spread out.

    At 18 kA/m, where the necks are most of the force. The solved field has the charges of a neck as a dipole at either
    grain, the pair sums take them out as charges, spread out: what is left falls with the fourth power of the width.
    Measured at 2.5, 3 and 3.5 d: 2.1, 0.8 and 0.5 % of the largest force (2 d: 5 %).
    """
    x = np.add(CLUSTERS[name], [R, 0.0, 0.0])
    ring, n = ring_of(x, 1.05 * D)
    true = magnetised_cluster(ring, A, IRON, [0.0, 0.0, 18e3], tolerance=1e-6)
    for a, share in ((2.5, 0.025), (3.5, 0.006)):
        result = fed_back(
            in_air(x, a * D), IRON, ring, A, a * D, model="near_field", boundary_field=MU_0 * 18e3, agree=1e-5
        )
        assert worst(result.moment[::n], true.moment[::n]) < 0.01, a
        assert worst(result.force[::n], true.force[::n]) < share, a


def test_random_powder_is_all_its_pairs():
    """A fifth of a ring 5 d wide filled: bias and scatter of the magnetisation fall with the width, and so do forces'.

    Measured: bias 0.58, 0.16, 0.13, 0.08 % and scatter 3.3, 2.0, 1.4, 1.1 % of the magnetisation at 2, 2.5, 3, 3.5 d,
    an arc of 8.5 d; forces 12.5, 5.5, 3.5, 2.3 %. What is lost is what the mean about the axis does not know.
    """
    r, n, gap, height = 40.0 * D, 30, 5.0 * D, 6.0 * D
    sector = CyclicSector(2.0 * np.pi / n)
    x = random_grains(n, (r, r + gap), height, 0.2, seed=1)
    moment, force = all_pairs(x, A, IRON, np.array([0.0, 0.0, H0]), n)
    mean, load = moment[:, 2].mean(), np.sqrt((force**2).sum(axis=1).mean())
    mesh = half_disc({"powder": (r - 0.5 * D, r + gap + 0.5 * D, -3.5 * D, 3.5 * D)}, 60.0 * D, 0.5 * D)
    for a, bias, scatter, forces in (
        (2.0, 0.008, 0.04, 0.15),
        (2.5, 0.004, 0.025, 0.07),
        (3.5, 0.002, 0.014, 0.03),
    ):
        problem = powder_problem(mesh, IRON, a * D, open_boundary=True)
        result = fed_back(problem, IRON, x, A, a * D, sector=sector, boundary_field=MU_0 * H0, tolerance=1e-12)
        missed = result.moment - moment
        assert abs(missed[:, 2].mean()) < bias * mean, a
        assert np.sqrt((missed**2).sum(axis=1).mean()) < scatter * mean, a
        assert np.sqrt(((result.force - force) ** 2).sum(axis=1).mean()) < forces * load, a
        # a field of revolution turns nothing: pairs and hoop forces cancel at the moments' fixed point
        turn = np.cross(x, result.force)[:, 2]
        assert abs(turn.sum()) < 1e-10 * np.abs(turn).sum(), a


@pytest.fixture(scope="module")
def powder():
    """A loose random powder at its fixed point."""
    r, n = 20.0 * D, 12
    x = random_grains(n, (r, r + 5.0 * D), 5.0 * D, 0.25, seed=2)
    mesh = half_disc({"powder": (r, r + 5.0 * D, -2.5 * D, 2.5 * D)}, 35.0 * D, 0.6 * D)
    problem = powder_problem(mesh, IRON, 2.5 * D, open_boundary=True)
    more = {"sector": CyclicSector(2.0 * np.pi / n), "boundary_field": MU_0 * H0, "tolerance": 1e-12}
    return problem, x, more, fed_back(problem, IRON, x, A, 2.5 * D, agree=1e-9, **more)


def test_the_field_is_that_of_the_deposited_moments(powder):
    """Solved again with the deposited magnetisation as a given one, without any law of the powder: the same field.

    To the residual, 1e-9: neither the powder's demagnetising factor nor the way there is left in it.
    """
    problem, _, _, result = powder
    nothing = np.zeros(len(problem.powder_elements))
    given = PowderState(nothing, None, result.feedback._M)
    again = problem.solve(0.0, given, boundary_field=MU_0 * H0, tolerance=1e-11)
    bare = problem.solve(0.0, None, boundary_field=MU_0 * H0, tolerance=1e-11)
    of_grains = np.linalg.norm(result.solution.psi - bare.psi)
    assert np.linalg.norm(again.psi - result.solution.psi) < 1e-7 * of_grains
    # and it holds all of them: integral of M_z r dr dz angle = sum of m_z
    shape = result.feedback._volume
    spread = 2.0 * np.pi / 12 * (result.feedback._M[:, 1] * shape).sum()
    assert spread == pytest.approx(result.moment[:, 2].sum(), rel=2e-3)


def test_the_residual_falls_geometrically(powder):
    """To 0.54 at each solve (the factor N goes half of its way), from any start, and the end does not depend on it."""
    problem, x, more, result = powder
    left = np.array(result.residuals)
    assert len(left) < 32 and left[-1] <= 1e-9
    assert np.all(left[1:] < 0.65 * left[:-1]), left
    backwards = fed_back(problem, IRON, x, A, 2.5 * D, agree=1e-9, start=-result.moment, **more)
    assert backwards.moment == pytest.approx(result.moment, abs=1e-7 * np.abs(result.moment).max())
