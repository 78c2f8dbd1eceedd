"""A saturable core with a powder-filled ring gap: circuit estimate, Newton's order, saturation, symmetry.

The core is a pot: disc (r < 20 mm) and housing (to 45 mm) with two end plates, the coil between them; the
flux runs along the disc, out through the ring gap to one plate, along the housing and back through the other.
"""

from itertools import pairwise

import numpy as np
import pytest
from graded_lines import graded_lines
from section_grid import section_grid

from field import (
    MU_0,
    AxisymmetricProblem,
    ConvergenceError,
    GrainLaw,
    LinearLaw,
    PowderLaw,
    PowderState,
    material,
    material_names,
)
from field.section.ampere_turns import ampere_turns_by_part
from field.section.field_lines import field_along
from geometry import AnnularBox

pytestmark = pytest.mark.physics

STEELS = [name for name in material_names() if not isinstance(material(name), LinearLaw)]
GAP = 0.5e-3
R_DISC, R_BORE = 20e-3, 20e-3 + GAP
HALF = 10e-3  # half width of the coil window; the plates are 8 mm thick


@pytest.fixture(scope="module")
def pot():
    """Two face-to-face pole rings around the disc, powder in the ring gaps."""
    r = np.concatenate((graded_lines(GAP / 4, (R_DISC, R_BORE), (0.0, 0.15)), [38e-3, 45e-3]))
    z = np.unique(np.concatenate((graded_lines(1e-3, (0.0, 18e-3), (0.0, 0.15)), [HALF])))
    regions = {
        "disc": (0.0, R_DISC, -18e-3, 18e-3),
        "housing": (R_BORE, 45e-3, -18e-3, 18e-3),
        "coil": (R_BORE, 38e-3, -HALF, HALF),
        "powder": (R_DISC, R_BORE, -18e-3, 18e-3),
    }
    return section_grid(r, np.concatenate((-z, z)), regions)


def problem(pot, steel, grains=None):
    return AxisymmetricProblem(
        pot, {"disc": steel, "housing": steel}, powder_law=PowderLaw(grains) if grains is not None else None
    )


@pytest.mark.parametrize("phi", [0.0, 0.45])
def test_powder_gap_follows_the_magnetic_circuit(pot, phi):
    """B = mu_0 mu_powder N I/(2 g) at the middle of a pole face, ideal iron."""
    case = problem(pot, LinearLaw(1e5, "ideal iron"), GrainLaw(99.0))
    field = case.solve(200.0, fill=np.full(case.powder_elements.size, phi))
    mu_powder = 1.0 + float(GrainLaw(99.0).chi_eff(phi, np.array(1.0)))
    B = field.B_along(np.array([[R_DISC + GAP / 2, 14e-3], [R_DISC + GAP / 2, -14e-3]]))
    assert np.allclose(np.abs(B[:, 0]), MU_0 * mu_powder * 200.0 / (2 * GAP), rtol=0.02)
    assert B[0, 0] * B[1, 0] < 0.0, "out through one gap, back through the other"
    H, _ = field.sampler().sample(np.array([[R_DISC + GAP / 2, 0.0, 14e-3]]))
    assert abs(H[0, 0]) == pytest.approx(200.0 / (2 * GAP), rel=0.02)


def test_newton_is_quadratic_on_saturated_steel(pot):
    """The last steps square the residual: order log(r2/r1)/log(r1/r0) near 2."""
    case = problem(pot, material("steel_1010"), GrainLaw(273.0, 1.5e6))
    field = case.solve(3000.0, fill=np.full(case.powder_elements.size, 0.4), tolerance=1e-10)
    residual = np.array([r for r, _ in field.newton])
    fast = [
        np.log(c / b) / np.log(b / a)
        for a, b, c in zip(residual, residual[1:], residual[2:], strict=False)
        if 1e-12 < c and b < 1e-2
    ]
    assert len(residual) < 15 and max(fast) > 1.7, residual
    assert all(step == 1.0 for _, step in field.newton[-3:])


@pytest.mark.hard
@pytest.mark.parametrize("steel", STEELS)
def test_cold_start_converges_up_to_full_saturation(pot, steel):
    case = problem(pot, material(steel), GrainLaw(999.0, 1.7e6))
    fill = np.full(case.powder_elements.size, 0.5)
    for ampere_turns in (10.0, 1e3, 1e5, 1e7):
        assert case.solve(ampere_turns, fill).newton[-1][0] <= 1e-8


def test_uneven_fill_and_warm_start(pot):
    case = problem(pot, material("steel_1010"), GrainLaw(273.0, 1.5e6))
    random = np.random.default_rng(0)
    fill = random.uniform(0.0, 0.6, case.powder_elements.size)
    cold = case.solve(1500.0, fill)
    near, before = case.solve(1450.0, fill), case._solver.factorisations
    warm = case.solve(1500.0, fill, guess=near)
    assert len(warm.newton) < len(cold.newton) and case._solver.factorisations - before <= 2
    assert np.allclose(warm.psi, cold.psi, rtol=0, atol=1e-6 * np.abs(cold.psi).max())
    assert len(case.solve(1500.0, fill, guess=cold).newton) == 1, "a solution is recognised at once"
    # a factor of another field altogether costs steps, not the solution
    case.factorise_tangent(case.solve(5.0, fill))
    misled = case.solve(1500.0, fill, guess=near, factorised=True)
    assert np.linalg.norm(misled.psi - cold.psi) < 1e-7 * np.linalg.norm(cold.psi)


def test_coenergy_grows_by_linkage_times_current(pot):
    """dW'/d(NI) = flux linkage per turn, at a current where the steel saturates."""
    case = problem(pot, material("steel_1010"))
    up, middle, down = (case.solve(NI) for NI in (2005.0, 2000.0, 1995.0))
    assert (up.coenergy - down.coenergy) / 10.0 == pytest.approx(middle.flux_linkage_per_turn, rel=1e-5)
    assert middle.energy + middle.coenergy == pytest.approx(2000.0 * middle.flux_linkage_per_turn, rel=1e-7)
    assert middle.coenergy > middle.energy


def test_no_current_no_field(pot):
    field = problem(pot, material("steel_1010")).solve(0.0)
    assert not field.psi.any() and field.energy == 0.0 and field.newton == [(0.0, 0.0)]
    H, grad = field.sampler().sample(np.array([[R_DISC + GAP / 2, 0.0, 0.0]]))
    assert not H.any() and not grad.any()


def test_mirror_symmetry(pot):
    """B_z even and B_r odd in z, for a device and a fill that are symmetric; sign follows the current."""
    case = problem(pot, material("steel_1010"), GrainLaw(273.0, 1.5e6))
    fill = 0.4 + 0.1 * np.cos(200 * pot.centroid()[case.powder_elements, 1])
    field, reversed_ = case.solve(1500.0, fill), case.solve(-1500.0, fill)
    where = np.column_stack((np.linspace(1e-3, 60e-3, 40), np.linspace(1e-3, 30e-3, 40)))
    B, mirrored = field.B_along(where), field.B_along(where * (1, -1))
    size = np.abs(B).max()
    # the diagonals of the grid are not mirrored: equal to the discretisation's error only
    assert np.abs(B[:, 1] - mirrored[:, 1]).max() < 0.02 * size
    assert np.abs(B[:, 0] + mirrored[:, 0]).max() < 0.02 * size
    assert np.allclose(reversed_.psi, -field.psi, atol=1e-7 * np.abs(field.psi).max())


def flux_through(field, start, end, lines):
    """2 pi times the integral of r B . n along a straight line (r, z) [m], n to the left of it, by Gauss's rule.

    ``lines``: places along the line [m from its start] where B may jump; between them r B is linear (order 2).
    """
    start, end = np.array(start), np.array(end)
    length = np.linalg.norm(end - start)
    along = (end - start) / length
    breaks = np.unique(np.concatenate(([0.0, length], lines[(lines > 0.0) & (lines < length)])))
    node, weight = np.polynomial.legendre.leggauss(3)
    middle, half = 0.5 * (breaks[1:] + breaks[:-1]), 0.5 * np.diff(breaks)
    points = start + np.outer((middle[:, None] + half[:, None] * node).ravel(), along)
    B = field.B_along(points)
    left = B @ np.array([-along[1], along[0]])
    return 2.0 * np.pi * np.sum((half[:, None] * weight).ravel() * points[:, 0] * left)


def test_no_flux_leaves_a_closed_ring(pot):
    """B, integrated over the four faces of a ring through disc, powder gap and coil, adds up to nothing.

    Each face alone carries what psi says; the ring lies between the lines of the grid, so that only the diagonals'
    and the cells' edges cut it.
    """
    field = problem(pot, material("steel_1010")).solve(1500.0)
    r, z = (np.unique(np.round(pot.points[:, k], 9)) for k in (0, 1))

    def between(lines, value):
        k = int(np.searchsorted(lines, value))
        return 0.5 * (lines[k - 1] + lines[k])

    (r0, r1), (z0, z1) = (between(r, 10e-3), between(r, 30e-3)), (between(z, -15e-3), between(z, 5.5e-3))
    cuts = [np.sort(np.concatenate((lines, 0.5 * (lines[1:] + lines[:-1])))) for lines in (r, z)]
    corners = [(r0, z0), (r1, z0), (r1, z1), (r0, z1), (r0, z0)]
    faces = []
    for a, b in pairwise(corners):
        axis = 0 if a[1] == b[1] else 1
        faces.append(flux_through(field, a, b, np.abs(cuts[axis] - a[axis])))
        assert faces[-1] == pytest.approx(field_along(field, np.array([a, b])).flux, rel=1e-9)
    assert min(map(abs, faces)) > 1e-2 * max(map(abs, faces)), faces
    assert abs(sum(faces)) < 1e-10 * sum(map(abs, faces)), faces


def test_ampere_s_law_holds_around_the_coil(pot):
    """The integral of H around the winding is N I, whatever path: through air, steel and the gaps.

    The finite elements know of it only in the mean, so it holds to the discretisation's error; a path through the
    yoke of the ideal circuit crosses both gaps.
    """
    field = problem(pot, material("steel_1010")).solve(1500.0)
    for r, z in ((19e-3, 11e-3), (10e-3, 14e-3)):
        corners = np.array([(r, -z), (41e-3, -z), (41e-3, z), (r, z), (r, -z)])
        path = np.concatenate([np.linspace(a, b, 10_000) for a, b in pairwise(corners)])
        assert abs(field_along(field, path).magnetic_voltage) == pytest.approx(1500.0, rel=0.02)


def test_failed_solve_says_so(pot):
    with pytest.raises(ConvergenceError, match="max_iterations") as caught:
        problem(pot, material("steel_1010")).solve(5000.0, max_iterations=2)
    assert len(caught.value.history) == 3 and caught.value.remedy


@pytest.mark.parametrize(
    ("keywords", "words"),
    [
        ({"ampere_turns": np.nan}, "ampere_turns"),
        ({"ampere_turns": 1.0, "fill": np.full(3, 0.1)}, "elements"),
        ({"ampere_turns": 1.0, "fill": 1.2}, "solid fraction"),
        ({"ampere_turns": 1.0, "guess": np.zeros(3)}, "guess"),
    ],
)
def test_bad_input_is_explained(pot, keywords, words):
    case = problem(pot, material("steel_1010"), GrainLaw(99.0))
    if isinstance(keywords.get("fill"), float):
        keywords = {**keywords, "fill": np.full(case.powder_elements.size, keywords["fill"])}
    with pytest.raises(ValueError, match=words):
        case.solve(**keywords)


def test_wrong_regions_are_explained(pot):
    with pytest.raises(ValueError, match="no magnetic law for region"):
        AxisymmetricProblem(pot, {"disc": material("steel_1010")})
    with pytest.raises(ValueError, match="no such region"):
        AxisymmetricProblem(pot, dict.fromkeys(("disc", "housing", "hub"), material("air")))
    with pytest.raises(ValueError, match="order"):
        AxisymmetricProblem(pot, {"disc": material("air"), "housing": material("air")}, order=5)
    with pytest.raises(ValueError, match="axis"):
        problem(pot, material("steel_1010")).solve(10.0).sampler("disc")


@pytest.mark.parametrize("open_boundary", [False, True])
def test_ampere_turns_of_the_parts_add_up(pot, open_boundary):
    """sum over the parts of integral H . B dV / Phi = N I, with saturated steel and a source in the powder."""
    case = AxisymmetricProblem(
        pot,
        {"disc": material("steel_1010"), "housing": material("steel_1010")},
        powder_law=PowderLaw(GrainLaw(99.0)),
        open_boundary=open_boundary,
    )
    own = case.powder_elements.size
    source = 2e4 * np.random.default_rng(7).standard_normal((own, 2, case.elements.n_quadrature))
    for fill in (np.full(own, 0.4), PowderState(np.full(own, 0.4), source=source)):
        field = case.solve(3000.0, fill=fill, tolerance=1e-11)
        assert sum(ampere_turns_by_part(field).values()) == pytest.approx(3000.0, rel=1e-8)


def test_ampere_turns_of_an_ideal_circuit_are_in_its_gaps(pot):
    """Ideal iron: the flux that crosses the gaps has its whole drop N I there, (N I)_powder = N I Phi_gap/Phi."""
    case = problem(pot, LinearLaw(1e5, "ideal iron"), GrainLaw(99.0))
    field = case.solve(200.0, fill=np.full(case.powder_elements.size, 0.45))
    parts = ampere_turns_by_part(field, {"outside": [AnnularBox(45e-3, 1.0, -1.0, 1.0)]})
    r = R_DISC + 0.5 * GAP

    def crossing(z0):
        z = np.linspace(z0, 18e-3, 2001)[1:-1]
        B = field.B_along(np.column_stack((np.full(z.size, r), z)))[:, 0]
        return 2.0 * np.pi * r * abs(np.trapezoid(B, z))

    drop = parts["powder"] * field.flux_linkage_per_turn / 200.0
    # what crosses under a pole has the whole drop, what goes on through the window a part of it
    assert crossing(HALF) < drop < crossing(0.0) < 1.07 * crossing(HALF)
    assert parts["disc"] + parts["housing"] < 0.01 * 200.0
    whole = ampere_turns_by_part(field)
    assert parts["outside"] + parts["air"] == pytest.approx(whole["air"], rel=1e-12) and parts["outside"] > 0.0
    with pytest.raises(ValueError, match="current"):
        ampere_turns_by_part(case.solve(0.0))
