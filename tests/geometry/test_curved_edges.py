"""Edges on curves: nodes on the curve, bulges of the same area, no tangled elements, through refinement."""

import math

import numpy as np
import pytest
from scipy.interpolate import CubicHermiteSpline

from field.sampling.locate import TriangleLocator
from field.section.section_elements import SectionElements
from geometry.cad_meshing import mesh_cad
from geometry.curved_edges import CurvedEdges
from geometry.refinement import refine
from geometry.section import SectionMesh

# mm; a ball on the axis, a bar whose section has a fillet and an ellipse's quarter for corners, a round hole in it
SCRIPT = """
SetFactory("OpenCASCADE");
Disk(1) = {0, -12, 0, 5, 5};
Rectangle(2) = {0, -20, 0, 6, 20};
BooleanIntersection(3) = { Surface{1}; Delete; }{ Surface{2}; Delete; };
Rectangle(4) = {8, -6, 0, 10, 12, 0.6};
Disk(5) = {13, 0, 0, 3, 2};
BooleanFragments{ Surface{4}; Delete; }{ Surface{5}; Delete; }
Physical Surface("disc") = {3};
Physical Surface("coil") = {5};
Physical Surface("rotor") = {6};
"""
ELLIPSE = math.pi * 3e-3 * 2e-3
AREAS = {
    "disc": 0.5 * math.pi * 5e-3**2,
    "coil": ELLIPSE,
    "rotor": 10e-3 * 12e-3 - (4.0 - math.pi) * 0.6e-3**2 - ELLIPSE,
}


@pytest.fixture
def mesh(tmp_path):
    def meshed(**options):
        path = tmp_path / "round.geo"
        path.write_text(SCRIPT)
        return mesh_cad(path, trust_scripts=True, **options)

    return meshed


def area(mesh, region, order=2):
    return float(SectionElements(mesh, order).weight[mesh.regions[region]].sum())


@pytest.mark.parametrize("size_factor", [4.0, 1.0])
def test_curved_elements_have_the_areas_of_the_drawing(mesh, size_factor):
    """To far less than chords have them, also of fillets and of an ellipse; the air fills the rest."""
    found = mesh(size_factor=size_factor)
    for region, exact in AREAS.items():
        chords = abs(found.area(region) / exact - 1.0)
        assert chords > 1e-3 and area(found, region) == pytest.approx(exact, rel=2e-7), (region, chords)
    whole = sum(area(found, region) for region in found.regions)
    assert whole == pytest.approx(found.element_area().sum(), rel=1e-12)


def test_new_nodes_lie_on_the_curves(mesh):
    coarse = mesh(size_factor=2.0)
    fine = refine(refine(coarse, np.ones(len(coarse.triangles), dtype=bool)).mesh, coarse.regions["disc"]).mesh
    assert len(fine.curved.nodes) > 2 * len(coarse.curved.nodes)
    r, z = fine.points[np.unique(fine.curved.nodes)].T
    ball = np.hypot(r, z + 12e-3) / 5e-3
    ellipse = np.hypot((r - 13e-3) / 3e-3, z / 2e-3)
    fillet = np.hypot(np.abs(r - 13e-3) - 4.4e-3, np.abs(z) - 5.4e-3) / 0.6e-3
    off = np.abs(np.array((ball, ellipse, fillet)) - 1.0).min(axis=0)
    assert off.max() < 1e-8
    for region, exact in AREAS.items():
        assert area(fine, region) == pytest.approx(exact, rel=1e-8)


def sector(angle):
    """A disc's sector of radius 1 and a triangle beyond its chord, which the arc bends into."""
    x = np.linspace(0.0, angle, 257)
    cosine, sine = np.cos(x), np.sin(x)
    arc = CubicHermiteSpline(x, np.column_stack((cosine, sine)), np.column_stack((-sine, cosine)))
    points = np.array([(0.0, 0.0), arc(0.0), arc(angle), 1.25 * arc(0.5 * angle)])
    curved = CurvedEdges(np.array([[1, 2]]), np.zeros(1, dtype=np.int64), np.array([[0.0, angle]]), (arc,))
    return SectionMesh(points, np.array([[0, 1, 2], [2, 1, 3]]), {"air": np.arange(2)}, {}, curved)


def test_elements_that_a_curve_would_tangle_are_divided():
    mesh = sector(1.2)
    assert mesh.tangled().tolist() == [1]
    assert sector(0.1).tangled().size == 0
    fine = refine(mesh, mesh.tangled())
    assert fine.mesh.tangled().size == 0 and set(fine.parent.tolist()) == {0, 1}
    for _ in range(3):
        marked = np.random.default_rng(1).random(len(fine.mesh.triangles)) < 0.3
        fine = refine(fine.mesh, marked)
        assert fine.mesh.tangled().size == 0


def test_a_ball_on_a_plate_leaves_a_cusp_that_is_meshed(tmp_path):
    """Between ball and plate every element is tangled: the tip's edge becomes straight, and the areas stay."""
    path = tmp_path / "cusp.geo"
    plate = SCRIPT.replace("Rectangle(4) = {8, -6, 0, 10, 12, 0.6};", "Rectangle(4) = {0, -7, 0, 23, 12};")
    path.write_text(plate)
    found = mesh_cad(path, trust_scripts=True)
    for _ in range(3):
        near = np.linalg.norm(found.centroid() - (0.0, -7e-3), axis=1) < 1e-3
        found = refine(found, near).mesh
        assert found.tangled().size == 0 and SectionElements(found).weight.min() > 0.0
        assert area(found, "disc") == pytest.approx(AREAS["disc"], rel=1e-6)
    assert len(found.triangles) < 20_000


def test_a_mesh_of_straight_edges_has_no_curves(tmp_path):
    path = tmp_path / "straight.geo"
    lines = ('SetFactory("OpenCASCADE");', "Rectangle(1) = {5, 0, 0, 5, 5};", 'Physical Surface("coil") = {1};')
    path.write_text("\n".join(lines) + "\n")
    found = mesh_cad(path, trust_scripts=True)
    assert found.curved is None and SectionElements(found).inverse.shape[1] == 1


@pytest.mark.parametrize("order", [1, 2, 3])
def test_points_are_found_in_the_element_that_holds_them(mesh, order):
    """Random points of every element, also between chord and curve: element, coordinates, gradient, value."""
    found = mesh(size_factor=3.0)
    elements = SectionElements(found, order)
    random = np.random.default_rng(2)
    number = np.repeat(np.arange(elements._curved.size), 8)
    share = random.dirichlet((0.3, 0.3, 0.3), number.size)[:, 1:]
    points, slope = elements._map(number, share)
    element = elements._curved[number]
    assert np.allclose(elements.local(element, points)[0], share, atol=1e-9)
    straight, _ = TriangleLocator(found.points, found.triangles).find(points)
    assert np.any(straight != element) and np.array_equal(elements.beyond_curves(straight, points), element)
    psi = random.normal(size=elements.n_dofs)
    step = 1e-7 * slope[:, :, 0]
    change = elements.value_at(psi, element, points + step) - elements.value_at(psi, element, points - step)
    along = np.einsum("ki,ki->k", elements.gradient_at(psi, element, points), 2.0 * step)
    assert np.allclose(change, along, rtol=1e-4, atol=1e-11)
