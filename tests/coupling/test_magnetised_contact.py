"""Grains that magnetise one another and saturate where they touch, against finite elements (p = 4, about 0.1 %).

Lengths in the grain's radius, forces in mu_0 Ms^2 a^2, magnetisations in Ms; the grains' law is Froehlich's with chi
999 and Ms 1.7 MA/m. Values: `tests/REFERENCE.md` and the axisymmetric and three-dimensional solutions that they were
made with; none of them was used to make the model.
"""

import numpy as np
import pytest
from sphere_truth import CHAIN_FORCE, CHAIN_MOMENT, PAIR_FORCE, PAIR_MOMENT

from coupling.cluster import magnetised_cluster
from coupling.grain_law_table import grain_table
from coupling.moment_sweeps import AndersonMixing
from coupling.mutual_moments import MutualMoments
from coupling.neighbour_rows import neighbour_rows
from field import MU_0, GrainLaw, LangevinLaw
from field.spheres.lone_sphere import sphere_magnetisation
from particles import CyclicSector

pytestmark = pytest.mark.physics

MS = 1.7e6
IRON = GrainLaw(999.0, MS)
A = 1e-3
UNIT = MU_0 * MS**2 * A**2
VOLUME = 4.0 / 3.0 * np.pi * A**3
FIELDS = np.array([1, 5, 18, 46, 80, 120, 200, 300, 500]) * 1e3  # A/m

FAR = 3e-4  # a surface gap below every gap here


def pair(gap, field, law=IRON, **more):
    return magnetised_cluster([[0.0, 0.0, 0.0], [0.0, 0.0, (2.0 + gap) * A]], A, law, field, **more)


def angular_momentum(x, cluster, field):
    """sum x x F, and the field's torque sum V M x B_0 [N m]."""
    return np.cross(x, cluster.force).sum(axis=0), MU_0 * np.cross(cluster.moment, field).sum(axis=0)


@pytest.mark.parametrize("gap", PAIR_FORCE)
def test_a_pair_along_the_field(gap):
    """At a gap of 1 the neck's energy begins to fade, which adds 2 % to the force there."""
    close = 5e-3 if gap < 1.0 else 0.025
    for H, force in zip(FIELDS, PAIR_FORCE[gap], strict=True):
        result = pair(gap, [0.0, 0.0, H], smallest_gap=FAR)
        assert result.force[1, 2] / UNIT == pytest.approx(-force, rel=close), H
    for H, moment in zip(FIELDS, PAIR_MOMENT.get(gap, ()), strict=False):
        result = pair(gap, [0.0, 0.0, H], smallest_gap=FAR)
        assert result.magnetisation[:, 2] / MS == pytest.approx([moment] * 2, rel=2e-3), H


@pytest.mark.parametrize("gap", CHAIN_FORCE)
def test_a_chain_along_the_field(gap):
    """Of 61 grains, against an infinite one, up to 300 kA/m: force 6 %, moment 4 %; at 500 kA/m force 9 %."""
    x = np.column_stack([np.zeros((61, 2)), (2.0 + gap) * A * np.arange(61)])
    for n, H in enumerate(FIELDS):
        result = magnetised_cluster(x, A, IRON, [0.0, 0.0, H], smallest_gap=FAR, tolerance=1e-6)
        close = 0.06 if H < 4e5 else 0.09
        assert -result.force[31:, 2].sum() / UNIT == pytest.approx(CHAIN_FORCE[gap][n], rel=close), H
        if gap in CHAIN_MOMENT:
            assert result.magnetisation[30, 2] / MS == pytest.approx(CHAIN_MOMENT[gap][n], rel=0.04), H


@pytest.mark.parametrize(
    ("angle", "h", "along", "across", "moment"),
    [
        (30.0, 0.047059, -0.07332, 0.007386, (0.06378, 0.18655)),
        (30.0, 0.117647, -0.24773, 0.03994, (0.15915, 0.43999)),
        (60.0, 0.117647, -0.11466, 0.04447, (0.2759, 0.2651)),
    ],
)
def test_an_oblique_pair(angle, h, along, across, moment):
    field = h * MS * np.array([np.sin(np.radians(angle)), 0.0, np.cos(np.radians(angle))])
    result = pair(0.03, field)
    assert result.force[1, 2] / UNIT == pytest.approx(along, rel=0.03)
    assert result.force[1, 0] / UNIT == pytest.approx(across, rel=0.03, abs=1e-9)
    assert result.magnetisation[1, [0, 2]] / MS == pytest.approx(moment, rel=0.02, abs=1e-9)


def test_a_pair_across_the_field():
    """An isolated pair repels by 21 to 24 % too much: in a packing the even multipoles of a grain's neighbours cancel.

    Two dipoles would repel by 40 % too much.
    """
    result = pair(0.03, [0.3 * MS, 0.0, 0.0])
    assert 1.15 * 0.1123 < result.force[1, 2] / UNIT < 1.25 * 0.1123
    assert result.magnetisation[1] / MS == pytest.approx([0.8042, 0.0, 0.0], rel=0.02, abs=1e-9)


def test_a_triangle():
    x = np.array([[-0.586, 0.0, -1.015], [-0.586, 0.0, 1.015], [1.172, 0.0, 0.0]]) * A
    result = magnetised_cluster(x, A, IRON, [0.0, 0.0, 0.0470588 * MS])
    force = np.array([[0.01534, 0.0, 0.06493], [0.01534, 0.0, -0.06493], [-0.03067, 0.0, 0.0]])
    moment = np.array([[0.0366, 0.0, 0.2052], [-0.0366, 0.0, 0.2052], [0.0, 0.0, 0.1431]])
    assert np.abs(result.force / UNIT - force).max() < 0.04 * 0.06493
    assert np.abs(result.magnetisation / MS - moment).max() < 0.02 * 0.2052


@pytest.mark.parametrize("model", ["mutual", "near_field"])
def test_third_law_and_angular_momentum_at_the_fixed_point(model):
    """sum F = 0 and sum x x F = sum V M x B_0, for a loose heap of unequal grains and any direction of the field."""
    random = np.random.default_rng(5)
    x = np.array([[0.0, 0, 0], [2.03, 0, 0.1], [1.0, 1.8, 0.2], [0.9, 0.5, 1.9], [3.0, 1.9, 0.3], [1.5, 1.0, 4.5]]) * A
    radius = A * random.uniform(0.9, 1.0, len(x))
    field = np.array([30e3, -20e3, 50e3])
    result = magnetised_cluster(x, radius, IRON, field, model=model, tolerance=1e-14)
    scale = np.abs(result.force).max()
    assert np.abs(result.force.sum(axis=0)).max() < 1e-13 * scale
    on_grains, by_field = angular_momentum(x, result, field)
    assert np.abs(on_grains - by_field).max() < 1e-10 * np.abs(by_field).max()


def test_far_pairs_are_mutual_dipoles():
    x = np.array([[0.0, 0.0, 0.0], [3.3, 0.0, 0.0], [0.0, 3.5, 1.0]]) * A
    near, mutual = (magnetised_cluster(x, A, IRON, [0.0, 3e4, 4e4], model=m) for m in ("near_field", "mutual"))
    assert near.moment == pytest.approx(mutual.moment, rel=1e-12)
    assert near.force == pytest.approx(mutual.force, rel=1e-12, abs=1e-15 * np.abs(mutual.force).max())


def test_linear_dipoles_solve_the_dense_system():
    random = np.random.default_rng(1)
    x = random.uniform(0.0, 12.0, (40, 3)) * A
    keep = [i for i in range(40) if np.all(np.linalg.norm(x[:i] - x[i], axis=1) > 2.0 * A)]
    x, law, H = x[keep], GrainLaw(50.0), np.array([1e4, 2e4, -5e3])
    n = len(x)
    matrix = np.zeros((n, 3, n, 3))
    for i in range(n):
        matrix[i, :, i] = np.eye(3)
        for j in range(n):
            if i != j:
                d = x[i] - x[j]
                r = np.linalg.norm(d)
                T = (3.0 * np.outer(d, d) / r**2 - np.eye(3)) / (4.0 * np.pi * r**3)
                matrix[i, :, j] = -50.0 / (1.0 + 50.0 / 3.0) * VOLUME * T
    right = np.tile(50.0 / (1.0 + 50.0 / 3.0) * VOLUME * H, n)
    exact = np.linalg.solve(matrix.reshape(3 * n, 3 * n), right).reshape(n, 3)
    result = magnetised_cluster(x, A, law, H, model="mutual", tolerance=1e-13)
    assert result.moment == pytest.approx(exact, rel=1e-9, abs=1e-12 * np.abs(exact).max())


def test_saturated_grains_are_dipoles_of_their_saturation():
    """At 20 Ms: moments Ms within 1 %, force pi/6 (2/R)^4 within 6 %; that of the necks ends slowly."""
    for gap in (0.003, 0.1, 0.5):
        result = pair(gap, [0.0, 0.0, 20.0 * MS])
        assert result.magnetisation[:, 2] / MS == pytest.approx([1.0, 1.0], rel=0.01)
        assert -result.force[1, 2] / UNIT == pytest.approx(np.pi / 6.0 * (2.0 / (2.0 + gap)) ** 4, rel=0.06)


def test_langevin_grains_and_lone_grains():
    law = LangevinLaw(300.0, 1.5e6)
    for H in (0.0, 1.0, 3e4, 4e5, 1e7):
        one = magnetised_cluster([[0.0, 0.0, 0.0]], A, law, [0.0, H, 0.0], model="mutual")
        assert one.magnetisation[0, 1] == pytest.approx(float(sphere_magnetisation(law, H)), rel=1e-6)
        assert np.all(one.force == 0.0)


@pytest.mark.hard
@pytest.mark.parametrize("model", ["mutual", "near_field"])
def test_bad_corners(model):
    """No grain, zero field, overlap, soft iron, reversal: answers without a NaN, odd in the field."""
    assert magnetised_cluster(np.zeros((0, 3)), A, IRON, np.zeros(3), model=model).force.shape == (0, 3)
    x = np.array([[0.0, 0.0, 0.0], [0.0, 0.2, 1.9], [0.0, 1.9, 0.9], [1.7, 0.9, 0.9]]) * A  # overlapping by 5 %
    still = magnetised_cluster(x, A, IRON, np.zeros(3), model=model)
    assert np.all(still.force == 0.0) and np.all(still.moment == 0.0)
    # far beyond the saturation the fluxes of the necks add up to more than the grain carries (see the limits)
    most = 1.0 + 1e-9 if model == "mutual" else 1.6
    for H in (1e-9, 1.0, 1e3, 1e5, 1e8):
        one = magnetised_cluster(x, A, IRON, [H, 0.3 * H, H], model=model, tolerance=1e-10)
        back = magnetised_cluster(x, A, IRON, [-H, -0.3 * H, -H], model=model, tolerance=1e-10)
        assert np.all(np.isfinite(one.force)) and np.linalg.norm(one.magnetisation, axis=1).max() <= most * MS
        assert back.moment == pytest.approx(-one.moment, rel=1e-12)
        assert back.force == pytest.approx(one.force, rel=1e-9, abs=1e-12 * np.abs(one.force).max())


def dense_bed(n=400, fill=0.55, seed=0):
    """Grains in a wedge of an annulus at the given solid fraction: a sheared lattice, shaken."""
    pitch = 2.0 * A * (np.pi / (6.0 * fill)) ** (1.0 / 3.0)
    random = np.random.default_rng(seed)
    k = np.arange(n)
    inside = np.column_stack([k % 8, (k // 8) % 8, k // 64]) * pitch
    x = inside + np.array([60.0 * A, -4.0 * pitch, 0.0])
    return x + random.uniform(-0.5, 0.5, x.shape) * (pitch - 2.0 * A)


@pytest.mark.hard
def test_a_dense_bed_converges_in_forty_sweeps():
    """phi = .55 at 18 kA/m, from nothing: residual below 1e-3."""
    x = dense_bed()
    solver = MutualMoments(grain_table(IRON, "near_field"), near=True, reach=6.0 * A)
    rows, radius = neighbour_rows(x, 6.0 * A), np.full(len(x), A)
    for direction in np.eye(3)[[0, 2]]:
        H = np.tile(18e3 * direction, (len(x), 1))
        result = solver.solve(x, radius, H, rows, tolerance=1e-3, max_sweeps=40)
        assert result.residual <= 1e-3, result.residual
        start = {"start": result.dipole, "necks": solver.necks_of(result)}
        warm = solver.solve(x, radius, 1.01 * H, rows, tolerance=1e-3, **start)
        assert warm.sweeps < 0.5 * result.sweeps, (warm.sweeps, result.sweeps)


@pytest.mark.hard
@pytest.mark.parametrize("model", ["mutual", "near_field"])
def test_a_field_that_falls_or_is_switched_off_takes_the_moments_along(model):
    """From the moments of 60 kA/m: to nothing, to a ten-thousandth, to the opposite; lone grains too."""
    x = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 2.002], [1.9, 0.0, 1.0], [30.0, 0.0, 0.0]]) * A
    radius, H = np.full(4, A), np.tile([1e4, 0.0, 6e4], (4, 1))
    solver = MutualMoments(grain_table(IRON, model), near=model == "near_field", reach=8.0 * A)
    rows = neighbour_rows(x, 8.0 * A)
    high = solver.solve(x, radius, H, rows, tolerance=1e-10, max_sweeps=1000)
    off = solver.solve(x, radius, 0.0 * H, rows, start=high.dipole, necks=solver.necks_of(high))
    assert np.all(off.moment == 0.0) and off.residual == 0.0
    assert np.all(solver.forces(x, radius, rows, off).force == 0.0)
    for factor in (1e-2, 1e-4, 1e-6, -1.0):
        warm = solver.solve(x, radius, factor * H, rows, start=high.dipole, necks=solver.necks_of(high), tolerance=1e-6)
        cold = solver.solve(x, radius, factor * H, rows, tolerance=1e-10, max_sweeps=1000)
        assert warm.residual <= 1e-6, (factor, warm.residual)
        assert warm.moment == pytest.approx(cold.moment, rel=1e-4, abs=1e-5 * np.abs(cold.moment).max())


@pytest.mark.hard
def test_what_a_solve_returns_belongs_together_when_it_has_not_converged():
    """Field and moments of the last sweep: gathering again changes nothing."""
    x, radius = dense_bed(100), np.full(100, A)
    solver = MutualMoments(grain_table(IRON, "near_field"), near=True, reach=6.0 * A)
    rows, H = neighbour_rows(x, 6.0 * A), np.tile([0.0, 0.0, 46e3], (100, 1))
    one_more = {"tolerance": 0.0, "max_sweeps": 1}
    for sweeps in (1, 2, 5):
        result = solver.solve(x, radius, H, rows, tolerance=0.0, max_sweeps=sweeps)
        again = solver.solve(x, radius, H, rows, start=result.dipole, necks=solver.necks_of(result), **one_more)
        assert result.field == pytest.approx(again.field, rel=1e-12)
        assert result.residual == pytest.approx(again.residual, rel=1e-9)


@pytest.mark.hard
def test_very_soft_grains_near_saturation_have_no_nan():
    for H in np.geomspace(4e5, 1e6, 40):
        result = pair(0.01, [0.3 * H, 0.0, H], law=GrainLaw(1e6, MS), model="mutual")
        assert np.all(np.isfinite(result.force))
    solver = MutualMoments(grain_table(GrainLaw(1e6, MS), "mutual"), near=False, reach=1.0)
    x = np.zeros((1, 3))
    for H in np.geomspace(5e5, 8e5, 100):
        result = solver.solve(x, np.array([A]), np.array([[0.0, 0.0, H]]), neighbour_rows(x, 1.0))
        assert result.residual < 1e-3 and np.isfinite(result.moment).all()
    table = grain_table(GrainLaw(1e6, MS), "mutual")
    assert np.isfinite(table.contrast).all() and table.contrast[:, 0].min() >= 0.0


def test_a_sector_is_part_of_the_ring():
    """Turned copies of a wedge and the wedge with cyclic faces: the same moments and forces."""
    sector = CyclicSector(2.0 * np.pi / 8)
    random = np.random.default_rng(2)
    angle, r = np.array([0.1, 0.4, 0.7, 0.3]), np.array([11.0, 11.1, 11.0, 13.3]) * A
    z = random.uniform(-0.3, 0.3, 4) * A
    wedge = np.column_stack([r * np.cos(angle), r * np.sin(angle), z])
    reach = sector.widest_cutoff(wedge) * 0.99
    assert reach > 3.0 * A
    turn = [np.array([[np.cos(t), -np.sin(t), 0.0], [np.sin(t), np.cos(t), 0.0], [0.0, 0.0, 1.0]])
            for t in sector.angle * np.arange(8)]  # fmt: skip
    ring = np.concatenate([wedge @ R.T for R in turn])
    answers = []
    for x, s in ((wedge, sector), (ring, None)):
        e_r = x * [1.0, 1.0, 0.0] / np.hypot(x[:, 0], x[:, 1])[:, None]
        H = 4e4 * e_r + [0.0, 0.0, 2e4]
        solver = MutualMoments(grain_table(IRON, "near_field"), near=True, reach=reach)
        rows, radius = neighbour_rows(x, reach, s), np.full(len(x), A)
        result = solver.solve(x, radius, H, rows, tolerance=1e-13, max_sweeps=1000)
        answers.append((result.moment[:4], solver.forces(x, radius, rows, result).force[:4]))
    assert answers[0][0] == pytest.approx(answers[1][0], rel=1e-9, abs=1e-15)
    assert answers[0][1] == pytest.approx(answers[1][1], rel=1e-8, abs=1e-9 * np.abs(answers[1][1]).max())


@pytest.mark.parametrize("first", [2.5, 2.3, 2.05])
def test_the_mean_force_of_a_long_step_does_the_work_of_short_ones(first):
    """Two grains on their way to each other: the neck's pull is its mean over the gaps that the step passes."""
    solver = MutualMoments(grain_table(IRON, "near_field"), near=True, reach=8.0 * A)
    x, radius = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, first * A]]), np.full(2, A)
    H, speed, dt = np.tile([0.0, 0.0, 4e4], (2, 1)), 0.4, 1e-3
    rows = neighbour_rows(x, 8.0 * A)
    result = solver.solve(x, radius, H, rows, tolerance=1e-12, max_sweeps=500)
    velocity = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, -speed]])
    ahead = solver.forces(x, radius, rows, result, velocity=velocity, ahead=dt).force
    rest = solver.forces(x, radius, rows, result, attraction=False).force
    gap, end = first - 2.0, max(first - 2.0 - speed * dt / A, -3e-3)
    points, weights = np.polynomial.legendre.leggauss(24)
    # even in ln g above the smallest gap, constant below
    low, high = np.log(max(end, 3e-3)), np.log(gap)
    parts = np.exp(0.5 * (low + high) + 0.5 * (high - low) * points)
    pull = [pull_of_neck(solver, g) for g in parts]
    work = 0.5 * (high - low) * weights @ (parts * pull) + pull_of_neck(solver, 3e-3) * max(3e-3 - end, 0.0)
    assert (rest - ahead)[1, 2] == pytest.approx(work / (gap - end), rel=5e-3)


def pull_of_neck(solver, gap):
    """What the neck of a pair in 40 kA/m adds to the attraction [N]."""
    x, radius = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, (2.0 + gap) * A]]), np.full(2, A)
    H = np.tile([0.0, 0.0, 4e4], (2, 1))
    rows = neighbour_rows(x, 8.0 * A)
    result = solver.solve(x, radius, H, rows, tolerance=1e-10, max_sweeps=500)
    parts = [solver.forces(x, radius, rows, result, attraction=on).force[1, 2] for on in (False, True)]
    return parts[0] - parts[1]


def test_bad_input_is_reported():
    with pytest.raises(ValueError, match="model = 'far'"):
        pair(0.1, [0.0, 0.0, 1.0], model="far")
    with pytest.raises(ValueError, match="finite"):
        pair(0.1, [0.0, np.nan, 1.0])
    with pytest.raises(ValueError, match="saturat"):
        pair(0.1, [0.0, 0.0, 1.0], law=GrainLaw(100.0))
    with pytest.raises(RuntimeError, match="did not converge: residual"):
        pair(0.001, [0.0, 0.0, 1e4], max_sweeps=3)


@pytest.mark.parametrize("eigenvalue", [-3.0, -0.9, 0.0, 0.9])
@pytest.mark.parametrize("damping", [1.0, 0.5, 0.05])
def test_a_map_that_stretches_alike_everywhere_is_solved_by_its_secant(eigenvalue, damping):
    """Its fixed point lies on the line through the first two sweeps, also where plain sweeps diverge."""
    rng = np.random.default_rng(5)
    fixed, state = rng.normal(size=(2, 21))
    mixing = AndersonMixing()
    for _ in range(2):
        state = mixing.next(state, (eigenvalue - 1.0) * (state - fixed), damping)
    assert abs(state - fixed).max() < 1e-12


def test_a_linear_map_of_few_eigenvalues_is_solved_by_as_many_sweeps():
    """With as many differences remembered as there are eigenvalues, whatever these are."""
    rng = np.random.default_rng(6)
    vectors, _ = np.linalg.qr(rng.normal(size=(30, 30)))
    eigenvalue = np.resize([-2.0, 0.5, 0.9, 1.3], 30)
    fixed, state = rng.normal(size=(2, 30))
    mixing = AndersonMixing(depth=4)
    for _ in range(5):
        asked = vectors @ ((eigenvalue - 1.0) * (vectors.T @ (state - fixed)))
        state = mixing.next(state, asked, 0.7)
    assert abs(state - fixed).max() < 1e-6
