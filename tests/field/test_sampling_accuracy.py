"""H and grad H at points: accuracy targets, rates, walls, steel, nonlinear regions; work around closed loops.

The reference of most tests is a rectangular coil in air, by superposition of loops.
"""

from types import SimpleNamespace

import numpy as np
import pytest
from air_coil import GAP, NI, Reference, coil_in_air, exact, half_disc
from section_grid import section_grid

from field import (
    AIR,
    MU_0,
    AxisymmetricProblem,
    FroehlichLaw,
    GrainLaw,
    LinearLaw,
    PowderLaw,
    RecoveredSampler,
)
from field.sampling.potential_table import TableSampler
from field.sampling.recovery import RegionRecovery
from field.sampling.sampler import field_sampler
from field.section.section_elements import SectionElements

pytestmark = pytest.mark.physics


class LikeAir:
    """Air that the recovery takes for a nonlinear material."""

    name, source = "like air", "test"
    H_of_B, energy_density = staticmethod(AIR.H_of_B), staticmethod(AIR.energy_density)


@pytest.fixture(scope="module")
def middle():
    """The issue's points: r 33 to 35 mm, |z| < 10 mm."""
    return Reference(1500, (33e-3, -10e-3), (35e-3, 10e-3))


@pytest.fixture(scope="module")
def whole_gap():
    return Reference(4000, (GAP[0], GAP[2]), (GAP[1], GAP[3]))


@pytest.fixture(scope="module")
def meshes():
    return {scale: coil_in_air(scale) for scale in (2.0, 1.0, 0.5)}


def solved(mesh, order, gap=AIR):
    return AxisymmetricProblem(mesh, {"powder": gap}, order=order, open_boundary=True).solve(NI, tolerance=1e-11)


@pytest.mark.parametrize("gap", [AIR, LikeAir()], ids=["air", "general"])
@pytest.mark.parametrize(("order", "dofs", "H", "grad"), [(2, 7000, 2e-5, 5e-4), (3, 15000, 1e-6, 6e-5)])
def test_accuracy_of_the_issue_on_the_air_coil(meshes, middle, order, dofs, H, grad, gap):
    """Relative RMS errors of H and grad H of issue 3; in a nonlinear region H of P2 may be half as bad again."""
    field = solved(coil_in_air(growth=0.2) if order == 2 else meshes[1.0], order, gap)
    error = middle.of(field_sampler(field, "powder", table_tolerance=0.0))
    assert field.problem.n_dofs <= dofs
    assert error[0] < H * (1.5 if gap is not AIR and order == 2 else 1.0) and error[1] < grad, error
    # the table adds nothing that matters
    error = middle.of(TableSampler(RecoveredSampler(field, "powder")))
    assert error[0] < 1.5 * H and error[1] < grad, error


@pytest.mark.parametrize("order", [1, 2, 3])
def test_rates_of_the_recovery(meshes, middle, order):
    """Raw H converges with order k and raw grad H with k - 1; recovered ones with k + 1 and k at least.

    P3 stops at half the mesh size of P1 and P2, not to spend a minute.
    """
    found = []
    for scale in (2.0, 1.0, 0.5) if order < 3 else (2.0, 1.0):
        air, general = (solved(meshes[scale], order, gap) for gap in (AIR, LikeAir()))
        found.append((middle.of_raw(air), middle.of(RecoveredSampler(general, "powder")), middle.of(air.sampler())))
    found = np.array(found)  # (mesh, kind, H or grad)
    rate = np.log2(found[0] / found[-1]) / (len(found) - 1)
    assert abs(rate[0, 0] - order) < 0.35 and rate[0, 1] < order - 0.5, (rate, found)
    assert np.all(rate[1:, 0] > order + 0.7) and np.all(rate[1:, 1] > order - 0.1), (rate, found)
    assert np.all(found[-1, 2] < found[-1, 0]), found


@pytest.mark.parametrize("gap", [AIR, LikeAir()], ids=["air", "general"])
@pytest.mark.parametrize("order", [2, 3, 4])
def test_walls_are_no_worse_off_than_without_recovery(meshes, whole_gap, order, gap):
    """One-sided patches: grad H over the whole gap is still several times better than the raw one."""
    field = solved(meshes[1.0], order, gap)
    raw, recovered = whole_gap.of_raw(field), whole_gap.of(field.sampler())
    assert recovered[1] < raw[1] / 5.0, (raw, recovered)
    assert recovered[0] < raw[0] / (2.0 if order < 4 else 0.1), (raw, recovered)


def test_beside_a_steel_wall():
    """A coil before a thick plate of linear steel: the air sees the coil and its image of (mu_r - 1)/(mu_r + 1).

    The plate ends at the outer boundary, where the field is that of a dipole (its error (size/R)^5): psi = B r^2/2
    on a flux wall of radius R is exact there for B = mu_0 m/(2 pi R^3), m = (1 + k) N I pi mean(r^2).
    """
    mu_r, R = 50.0, 0.5
    k = (mu_r - 1.0) / (mu_r + 1.0)
    coil = ((10e-3, 14e-3), (6e-3, 9e-3))
    gap = (11e-3, 15e-3, 0.0, 4e-3)
    m = (1.0 + k) * NI * np.pi * (coil[0][0] ** 2 + coil[0][0] * coil[0][1] + coil[0][1] ** 2) / 3.0

    def with_image(r, z):
        (H, dH), (image, d_image) = (exact(r, z, (coil[0], side, NI)) for side in (coil[1], (-9e-3, -6e-3)))
        return H + k * image, dH + k * d_image

    reference = Reference(1000, (gap[0], gap[2]), (gap[1], gap[3]), with_image)
    found = []
    for scale in (2.0, 0.7):
        plate = {"coil": (*coil[0], *coil[1]), "powder": gap, "steel": (0.0, R, -R, 0.0)}
        mesh = half_disc(plate, {"coil": 0.8e-3 * scale, "powder": 0.5e-3 * scale, "steel": 1.0}, 0.25 * scale, R)
        problem = AxisymmetricProblem(mesh, {"steel": LinearLaw(mu_r, "steel")})
        field = problem.solve(NI, boundary_field=MU_0 * m / (2.0 * np.pi * R**3))
        found.append((*reference.of(field.sampler()), reference.of_raw(field)[0]))
    found = np.array(found)  # (mesh, H or grad H or raw H)
    rate = np.log(found[0] / found[-1]) / np.log(2.0 / 0.7)
    assert rate[0] > 3.0 and rate[1] > 2.0 and abs(rate[2] - 2.0) < 0.35, (rate, found)
    assert found[-1, 0] < found[-1, 2] / 20.0, found


def test_gradient_through_a_nonlinear_law():
    """psi given, H = h(|B|) b and its differences: the chain rule with dh/dB, to the recovery's fourth order."""
    law = FroehlichLaw(200.0, 1.6e6)
    a, b = 300.0, 40.0

    def H_at(r, z):
        # psi = sin(a z) exp(b r) r^2 c, B_r = -psi_z/r, B_z = psi_r/r
        c = 0.5e-2
        B = c * np.exp(b * r) * np.array([-a * r * np.cos(a * z), (2.0 + b * r) * np.sin(a * z)])
        size = np.hypot(*B)
        return law.H_of_B(size)[0] * B / size

    def field_at(r, z):
        d = 1e-6
        along = [(H_at(r + d * i, z + d * j) - H_at(r - d * i, z - d * j)) / (2 * d) for i, j in ((1, 0), (0, 1))]
        return H_at(r, z), np.stack(along, axis=1)

    reference = Reference(3000, (30e-3, 1e-3), (34e-3, 4e-3), field_at)
    assert np.ptp(np.linalg.norm(reference.H, axis=0)) > 0.3 * np.linalg.norm(reference.H, axis=0).max()
    found = []
    for n in (6, 12, 24):
        mesh = section_grid(
            np.linspace(30e-3, 34e-3, n + 1),
            np.linspace(1e-3, 4e-3, n + 1),
            {"powder": (30e-3, 34e-3, 1e-3, 4e-3)},
            jiggle=0.15,
        )
        elements = SectionElements(mesh, 2)
        r, z = elements.dof_points.T
        recovery = RegionRecovery(elements, mesh.regions["powder"])
        problem = SimpleNamespace(recovery=lambda _, it=recovery: it, law_of=lambda _: law, coil_region="coil")
        psi = 0.5e-2 * np.sin(a * z) * np.exp(b * r) * r**2
        found.append(reference.of(RecoveredSampler(SimpleNamespace(problem=problem, psi=psi, fill=None), "powder")))
    rate = np.log2(np.array(found[:-1]) / found[1:])
    assert np.all(rate[-1] > (3.5, 2.6)), (rate, found)


def test_solved_nonlinear_region_converges():
    """A saturating ring beside the coil: H and grad H against P4 on the finest mesh."""
    law = FroehlichLaw(20.0, 4e5)
    meshes = {scale: coil_in_air(scale) for scale in (2.0, 1.0)}

    def solve(scale, order):
        problem = AxisymmetricProblem(meshes[scale], {"powder": law}, order=order, open_boundary=True)
        return problem.solve(40.0 * NI, tolerance=1e-10)

    best = solve(1.0, 4).sampler()

    def field_at(r, z):
        H, grad = best.sample(np.column_stack((r, 0.0 * r, z)))
        return H[:, ::2].T, grad[:, ::2, ::2].transpose(1, 2, 0)

    reference = Reference(3000, (32.5e-3, -11e-3), (35.5e-3, 11e-3), field_at)
    strength = np.linalg.norm(reference.H, axis=0)
    assert strength.max() > 3e4, "saturation sets in at Ms/chi = 2e4 A/m"
    found = np.array([reference.of(solve(scale, 2).sampler()) for scale in (2.0, 1.0)])
    assert np.all(np.log2(found[0] / found[1]) > (2.0, 1.5)), found
    assert found[1, 0] < 2e-3 and found[1, 1] < 2e-2, found


def test_table_is_for_smooth_gaps(meshes):
    """Taken where there is no powder, refused for a fill that differs from element to element."""
    problem = AxisymmetricProblem(meshes[2.0], {}, powder_law=PowderLaw(GrainLaw(100.0)), open_boundary=True)
    n = problem.powder_elements.size
    assert isinstance(field_sampler(problem.solve(NI), "powder"), TableSampler)
    assert isinstance(field_sampler(problem.solve(NI, np.zeros(n)), "powder"), TableSampler)
    granular = np.random.default_rng(0).uniform(0.2, 0.5, n)
    sampler = field_sampler(problem.solve(NI, granular), "powder")
    assert isinstance(sampler, RecoveredSampler)
    assert TableSampler(sampler).difference[1] > 0.1


@pytest.fixture(scope="module")
def closed_paths():
    """Random polygons inside the gap: quadrature points (n_paths, n, 3) and weighted steps along them."""
    random = np.random.default_rng(5)
    node, weight = np.polynomial.legendre.leggauss(4)
    pieces = 300  # a segment; the table's grad H has kinks in its slope at the cells' borders
    fraction = ((np.arange(pieces)[:, None] + 0.5 + 0.5 * node) / pieces).ravel()
    weight = np.tile(0.5 * weight / pieces, pieces)
    where, step = [], []
    for corners in (3, 4, 5, 6, 8):
        r, z, angle = random.uniform((32.3e-3, -11.9e-3, -0.1), (35.9e-3, 11.9e-3, 0.1), (corners, 3)).T
        vertex = np.column_stack((r * np.cos(angle), r * np.sin(angle), z))
        side = np.roll(vertex, -1, axis=0) - vertex
        where.append((vertex[:, None] + fraction[:, None] * side[:, None]).reshape(-1, 3))
        step.append((weight[:, None] * side[:, None]).reshape(-1, 3))
    return where, step


def loop_work(sampler, closed_paths, magnetisation):
    """Work of F = mu_0 (m . grad) H with m = M(|H|) H/|H| around each path, relative to that of |F . dx|."""
    ratios = []
    for where, step in zip(*closed_paths, strict=True):
        H, grad = sampler.sample(where)
        strength = np.linalg.norm(H, axis=1)
        moment = (magnetisation(strength) / strength)[:, None] * H
        work = MU_0 * np.einsum("nij,nj,ni->n", grad, moment, step)
        ratios.append(abs(work.sum()) / np.abs(work).sum())
    return np.array(ratios)


@pytest.mark.parametrize(
    "magnetisation",
    [lambda H: np.full_like(H, 1e6), lambda H: 2.7 * H, lambda H: 1.6e6 * H / (3e3 + H)],
    ids=["fixed", "linear", "saturating"],
)
@pytest.mark.parametrize("order", [2, 3])
def test_work_around_a_closed_path_is_nothing(meshes, closed_paths, order, magnetisation):
    """The table's force derives from an energy, whatever the curve M(H); the element kernel's only nearly."""
    recovered = solved(meshes[2.0], order).sampler()
    assert loop_work(TableSampler(recovered), closed_paths, magnetisation).max() < 1e-8
    elements = loop_work(RecoveredSampler(solved(meshes[2.0], order), "powder"), closed_paths, magnetisation)
    assert 1e-8 < elements.max() < 1e-2, elements
