"""The field of pictures: B without jumps where there are none, the flux of its lines, its faces of regions."""

from types import SimpleNamespace

import numpy as np
import pytest

from emclutch.results.pictures.section import flux_levels
from field.section.section_elements import SectionElements
from field.section.smooth_field import SmoothField

SIDE = 0.04


def square(cells, border=0.5 * SIDE, jiggle=0.2):
    """Triangles on r, z in 0 to SIDE, irregular inside; two regions that meet at r = `border`."""
    line = np.linspace(0.0, SIDE, cells + 1)
    r, z = (grid.ravel() for grid in np.meshgrid(line, line, indexing="ij"))
    inside = (r > 0.0) & (r < SIDE) & (z > 0.0) & (z < SIDE) & (np.abs(r - border) > 1e-9)
    move = np.random.default_rng(1).uniform(-jiggle, jiggle, (2, r.size)) * SIDE / cells * inside
    number = np.arange(r.size).reshape(cells + 1, cells + 1)
    a, b, c, d = (part.ravel() for part in (number[:-1, :-1], number[1:, :-1], number[1:, 1:], number[:-1, 1:]))
    triangles = np.vstack([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    points = np.column_stack([r + move[0], z + move[1]])
    outer = points[triangles, 0].mean(axis=1) > border
    regions = {"disc": np.flatnonzero(~outer), "air": np.flatnonzero(outer)}
    return SimpleNamespace(points=points, triangles=triangles, regions=regions, boundaries={}, curved=None)


def smooth(cells, psi, order=2):
    elements = SectionElements(square(cells), order)
    return SmoothField(elements, psi(*elements.dof_points.T))


@pytest.mark.parametrize(
    ("order", "psi", "B"),
    [
        (2, lambda r, z: 0.5 * r**2, lambda r, z: (0 * r, 1 + 0 * r)),
        (3, lambda r, z: r**2 * z, lambda r, z: (-r, 2 * z)),
    ],
)
def test_a_field_that_the_elements_hold_exactly_stays_exact(order, psi, B):
    """Off the axis: in elements that touch it B is recovered, here of a field that is not of air."""
    field = smooth(6, psi, order)
    off_axis = field.elements.mesh.points[field.elements.mesh.triangles, 0].min(axis=1) > 1e-9
    fine = field.subdivide(np.flatnonzero(off_axis), 5)
    assert fine.psi == pytest.approx(psi(*fine.points.T), abs=1e-12)
    touches = fine.points[:, 0] < 1.5 * SIDE / 6  # nodes that elements at the axis share
    assert fine.B[~touches] == pytest.approx(np.column_stack(B(*fine.points.T))[~touches], abs=1e-9)


def test_the_mean_follows_the_solution_as_it_converges():
    """Both are second order, and the mean is the nearer to the true field."""
    kx = 60.0

    def true_B(r, z):
        return np.column_stack((-r * kx * np.cos(kx * z), 2.0 * np.sin(kx * z)))

    errors = {}
    for cells in (8, 16):
        field = smooth(cells, lambda r, z: r**2 * np.sin(kx * z))
        fine = field.subdivide(np.arange(len(field.elements.mesh.triangles)), 4)
        centre = fine.points[fine.triangles].mean(axis=1)
        owner = np.repeat(np.arange(len(field.elements.mesh.triangles)), 16)
        own = field.elements.flux_density_at(field.psi, owner, centre)
        mean = fine.B[fine.triangles].mean(axis=1)
        away = centre[:, 0] > SIDE / 4
        errors[cells] = [np.sqrt(np.mean((B - true_B(*centre.T))[away] ** 2)) for B in (own, mean)]
    (own_8, mean_8), (own_16, mean_16) = errors[8], errors[16]
    assert own_8 / own_16 > 3.5 and mean_8 / mean_16 > 3.5
    assert mean_16 < own_16


def test_what_jumps_at_a_face_is_not_smeared():
    """B along a face of iron is another one on either side: neither side's mean takes from the other."""

    def psi(r, z):
        return np.where(r <= 0.5 * SIDE, 0.5 * r**2, 0.125 * SIDE**2 + 3.0 * 0.5 * (r**2 - 0.25 * SIDE**2))

    field = smooth(6, psi)
    for name, expected in (("disc", 1.0), ("air", 3.0)):
        fine = field.subdivide(field.elements.mesh.regions[name], 3)
        near = np.abs(fine.points[:, 0] - 0.5 * SIDE) < 0.1 * SIDE
        assert fine.B[near, 1] == pytest.approx(expected, abs=1e-9)


def test_between_two_neighbouring_flux_lines_there_is_the_same_flux():
    """Every line that is drawn is a level line of psi, of the solution itself, and the levels are even."""
    from matplotlib.figure import Figure
    from matplotlib.tri import Triangulation

    field = smooth(10, lambda r, z: r**2 * np.cos(40.0 * z))
    levels = flux_levels(field, 9)
    step = np.diff(levels)
    assert step == pytest.approx(step[0])
    fine = field.subdivide(np.arange(len(field.elements.mesh.triangles)), 8)
    drawn = Figure().add_subplot().tricontour(Triangulation(*fine.points.T, fine.triangles), fine.psi, levels=levels)
    elements = field.elements
    for level, lines in zip(levels, drawn.allsegs, strict=True):
        along = np.vstack(lines)
        # the solution at the line's points, by the element whose middle is the nearest of those that hold the point
        corner = elements.mesh.points[elements.mesh.triangles]
        u, v = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
        offset = along[:, None, :] - corner[None, :, 0]
        area = u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0]
        x = (offset[..., 0] * v[:, 1] - offset[..., 1] * v[:, 0]) / area
        y = (u[:, 0] * offset[..., 1] - u[:, 1] * offset[..., 0]) / area
        owner = np.argmax(np.minimum(np.minimum(x, y), 1.0 - x - y), axis=1)
        psi = np.empty(len(along))
        for point, element in enumerate(owner):
            psi[point] = psi_in(field, element, along[point])
        assert np.abs(psi - level).max() < 0.01 * step[0]


def psi_in(field, element, point):
    """psi at a point of an element, by the quadratic through its six unknowns."""
    dofs = field.elements.element_dofs[element]
    middle = field.elements.dof_points[dofs].mean(axis=0)
    r, z = ((field.elements.dof_points[dofs] - middle) / 1e-3).T
    terms = np.linalg.solve(np.column_stack([np.ones(6), r, z, r**2, r * z, z**2]), field.psi[dofs])
    r, z = (point - middle) / 1e-3
    return terms @ [1.0, r, z, r**2, r * z, z**2]
