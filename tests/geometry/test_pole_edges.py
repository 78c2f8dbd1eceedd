"""A chamfer removes c^2/2 and a fillet (1 - pi/4) r^2 of steel a corner; sharp poles are the field's limit from above.

The volume is that area times 2 pi times the radius of its centroid.
"""

import math

import numpy as np
import pytest

from field import AxisymmetricProblem, LinearLaw, material
from geometry import Clutch, mesh_clutch

CORNERS = 4  # of the housing's section at the clearance
AREA = {"pole_chamfer": 0.5, "pole_fillet": 1.0 - 0.25 * math.pi}  # over the square of the size


def centroid_from_corner(key):
    """Distance of the removed area's centroid from either side, over the size: of a triangle 1/3; of a square less a
    quarter circle, whose centroid lies 4/(3 pi) from the centre, by moments."""
    if key == "pole_chamfer":
        return 1.0 / 3.0
    quarter = 0.25 * math.pi
    return (0.5 - quarter * (1.0 - 4.0 / (3.0 * math.pi))) / (1.0 - quarter)


@pytest.mark.parametrize("size, coil", [(0.3e-3, None), (2e-3, 54e-3)])
@pytest.mark.parametrize("key", AREA)
def test_area_and_volume_that_are_removed_have_their_closed_form(key, size, coil):
    sharp, cut = Clutch(coil_radius=coil), Clutch(coil_radius=coil, **{key: size})
    assert cut.faults() == []
    a, b = mesh_clutch(sharp), mesh_clutch(cut)
    removed = CORNERS * AREA[key] * size**2
    assert a.area("housing") - b.area("housing") == pytest.approx(removed, rel=1e-6)
    assert b.area("air") - a.area("air") == pytest.approx(removed, rel=1e-2)  # the outer arc's chords differ
    radius = sharp.housing_bore + centroid_from_corner(key) * size
    volume = a.volume("housing") - b.volume("housing")
    assert volume == pytest.approx(2.0 * math.pi * radius * removed, rel=1e-4)
    for name in set(a.regions) - {"housing", "air"}:
        assert a.area(name) == pytest.approx(b.area(name), rel=1e-9), name


@pytest.mark.parametrize("key", AREA)
def test_triangles_at_cut_edges_are_well_shaped(key):  # the winding's side is a tangent of the fillet
    for size in (0.05e-3, 3e-3):
        mesh = mesh_clutch(Clutch(**{key: size}))
        corner = mesh.points[mesh.triangles]
        edges = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2)
        quality = 4.0 * 3.0**0.5 * mesh.element_area() / (edges**2).sum(axis=1)  # 1: equilateral
        assert quality.min() > 0.15 and quality.mean() > 0.9, size


def test_a_size_of_zero_is_the_sharp_mesh_bit_by_bit():
    assert mesh_clutch(Clutch(pole_chamfer=0.0, pole_fillet=0.0)).hash() == mesh_clutch(Clutch()).hash()


def test_what_touches_grains_does_not_depend_on_the_cut_edges():
    sharp, cut = Clutch(), Clutch(pole_fillet=1e-3)
    for one, other in zip(sharp.walls(), cut.walls(), strict=True):
        assert repr(one) == repr(other)


@pytest.mark.parametrize(
    "changes, key, reason",
    [
        ({"pole_chamfer": 6.6e-3}, "pole_chamfer", "no face"),
        ({"pole_fillet": 6.6e-3}, "pole_fillet", "no face"),
        ({"pole_fillet": -1e-3}, "pole_fillet", "not a positive length"),
        ({"pole_fillet": 1e-6}, "pole_fillet", "is sharp"),
        ({"pole_fillet": 1e-3, "pole_chamfer": 1e-3}, "pole_fillet", "have a chamfer"),
    ],
)
def test_edges_that_cannot_be_cut_are_refused(changes, key, reason):
    fault = {fault.what: fault for fault in Clutch(**changes).faults()}[key]
    assert reason in fault.message and fault.allowed and fault.remedy


def gap_field(changes):
    """Mean B [T] under the steel poles at 500 ampere-turns, without powder."""
    clutch = Clutch(**changes)
    mesh = mesh_clutch(clutch)
    steel = LinearLaw(1000.0, "linear steel")
    laws = {name: steel if name in ("disc", "rotor", "housing") else material("air") for name in mesh.regions}
    problem = AxisymmetricProblem(mesh, {name: law for name, law in laws.items() if name not in ("air", "coil")})
    middle = clutch.gap_midline(201)
    middle = middle[np.abs(middle[:, 1]) > 0.5 * clutch.ring_width]
    return np.linalg.norm(problem.solve(500.0).B_along(middle), axis=1).mean()


@pytest.mark.physics
@pytest.mark.parametrize("key", AREA)
def test_the_field_in_the_gap_tends_to_that_of_sharp_poles_from_below(key):
    sharp = gap_field({})
    losses = [1.0 - gap_field({key: size}) / sharp for size in (4e-3, 2e-3, 1e-3, 0.25e-3)]
    assert losses == sorted(losses, reverse=True), losses
    assert abs(losses[-1]) < 0.1 * losses[0], losses
