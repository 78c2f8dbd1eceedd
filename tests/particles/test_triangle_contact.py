"""Grains on triangle meshes: closest point, one contact for one surface, near triangles, push-off."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numba import njit
from scipy.optimize import nnls
from scipy.spatial import ConvexHull, Delaunay
from scipy.spatial.transform import Rotation

from geometry.time_profile import TimeProfile
from geometry.triangle_wall import TriangleWall, box_surface, extruded, joined
from geometry.walls import Plane, annulus, cylinder
from particles.bodies import Body
from particles.walls.triangle_kernels import (
    FEATURE_ANGLE,
    N_CONTACT,
    closest_on_triangle,
    push_off_triangles,
    triangle_contacts,
    triangle_overlaps,
    winding_number,
)
from particles.walls.triangle_search import TriangleSearch
from particles.walls.wall_table import outside, triangle_rows, triangle_table, wall_rows, wall_table


@njit
def met(rows, other, first, last, x, y, z, radius, found):
    """What the steps call, for calls from Python."""
    return triangle_contacts(rows, other, first, last, x, y, z, radius, found)


number = st.floats(-1.0, 1.0)
point = st.tuples(number, number, number).map(np.array)
seed = st.integers(0, 2**32 - 1)
few = settings(max_examples=60, deadline=None)


def contacts(rows, centre, radius=1.0):
    """Contacts of one grain with all triangles: triangles (c,), distances (c,), directions (c, 3)."""
    found = np.full((len(rows), N_CONTACT), np.nan)
    other = np.arange(len(rows), dtype=np.int32)
    count, _ = met(rows, other, 0, len(rows), *centre, radius, found)
    return found[:count, 0].astype(int), found[:count, 1], found[:count, 2:5]


def strips(profile, width=10.0, pieces=3):
    """The surface over a polyline (k, 2) of x and z, y from -width to width, as rows."""
    profile = np.asarray(profile, dtype=float)
    y = np.linspace(-width, width, pieces + 1)
    vertices = np.array([[x, b, z] for x, z in profile for b in y])
    triangles = []
    for i in range(len(profile) - 1):
        for j in range(pieces):
            a = i * (pieces + 1) + j
            b = a + pieces + 1
            triangles += [[a, b, b + 1], [a, b + 1, a + 1]]
    return triangle_rows(vertices, np.array(triangles))


# ---- closest point


@given(point, point, point, point, st.integers(-10, 0))
@few
def test_closest_point_is_the_projection(a, b, c, centre, thin):
    """p is the projection on a convex set if and only if p is in it and (x - p)·(v - p) <= 0 for all its corners v."""
    c = a + 0.6 * (b - a) + 10.0**thin * (c - a)  # down to slivers of 1e-10
    doubled = np.linalg.norm(np.cross(b - a, c - a))
    longest = max(np.linalg.norm(b - a), np.linalg.norm(c - a), np.linalg.norm(c - b))
    if not doubled > 1e-11 * longest**2 or longest < 0.1:
        return
    rows = triangle_rows(np.array([a, b, c]), np.array([[0, 1, 2]]))
    p = np.array(closest_on_triangle(rows, 0, *centre))
    for corner in (a, b, c):
        assert (centre - p) @ (corner - p) <= 1e-14
    # p = sum of w_k v_k with w >= 0 and sum w = 1, by least squares: well-posed for slivers too
    _, residual = nnls(np.vstack([np.array([a, b, c]).T, np.ones(3)]), np.append(p, 1.0))
    assert residual < 1e-13


@pytest.mark.parametrize(
    ("centre", "expected"),
    [
        ((0.2, 0.2, 3.0), (0.2, 0.2, 0.0)),  # face
        ((0.5, -2.0, 1.0), (0.5, 0.0, 0.0)),  # the three edges
        ((-1.0, 0.3, 1.0), (0.0, 0.3, 0.0)),
        ((2.0, 2.0, 0.0), (0.5, 0.5, 0.0)),
        ((-1.0, -1.0, 1.0), (0.0, 0.0, 0.0)),  # the three corners
        ((4.0, 1.0, 0.0), (1.0, 0.0, 0.0)),
        ((0.5, 4.0, 0.0), (0.0, 1.0, 0.0)),
    ],
)
def test_closest_point_in_each_region(centre, expected):
    rows = triangle_rows(np.array([[0, 0, 0], [1, 0, 0], [0, 1.0, 0]]), np.array([[0, 1, 2]]))
    assert closest_on_triangle(rows, 0, *centre) == pytest.approx(expected, abs=1e-13)  # products of 4: 4 eps each


# ---- flat meshes


@given(seed, st.floats(0.01, 0.999))
@few
def test_a_flat_mesh_is_a_plane_over_face_edge_and_vertex(number, height):
    """A random triangulation, turned at random: one contact, the plane's distance and normal, everywhere."""
    rng = np.random.default_rng(number)
    flat = rng.uniform(-2.0, 2.0, (40, 2))
    flat[:4] = [[-4, -4], [4, -4], [4, 4], [-4, 4]]
    triangles = Delaunay(flat).simplices
    turn = Rotation.random(random_state=number).as_matrix()
    vertices = np.column_stack([flat, np.zeros(len(flat))]) @ turn.T
    rows = triangle_rows(vertices, triangles)
    over = [flat[triangles[k]].mean(axis=0) for k in (0, 1)]  # faces
    over += [flat[triangles[k, :2]].mean(axis=0) for k in (2, 3)]  # edges
    over += [flat[k] for k in (10, 20)]  # vertices
    over = [place for place in over if np.all(np.abs(place) < 3.0)]
    normal = turn[:, 2]
    for place, side in zip(over, rng.choice([-1.0, 1.0], len(over)), strict=True):
        centre = turn @ np.array([*place, side * height])
        _, distance, direction = contacts(rows, centre)
        assert len(distance) == 1
        assert distance[0] == pytest.approx(height, abs=1e-9)
        assert direction[0] == pytest.approx(-side * normal, abs=1e-9)


def test_a_doubled_unmerged_and_split_mesh_counts_once():
    """Soups as CAD programs export them: no shared vertices, triangles twice, an edge that ends within another."""
    soup = np.array([
        [[-2, -2, 0], [2, -2, 0], [0, 0, 0]], [[2, -2, 0], [2, 2, 0], [0, 0, 0]],
        [[2, 2, 0], [-2, 2, 0], [0, 0, 0]], [[-2, 2, 0], [-2, -2, 0], [0, 0, 0]],
        [[-2, -2, 0], [0, 0, 0], [2, -2, 0]], [[-1, -1, 0], [1, -1, 0], [0, 2, 0]],
    ], dtype=float)  # fmt: skip
    rows = triangle_rows(soup.reshape(-1, 3), np.arange(18).reshape(-1, 3))
    for place in ((0.0, 0.0), (1.0, 1.0), (0.1, -0.7), (-0.3, 0.3)):
        _, distance, _ = contacts(rows, (*place, 0.9))
        assert distance == pytest.approx([0.9])


# ---- bodies


@given(seed, st.floats(0.5, 0.99))
@few
def test_a_convex_body_is_touched_once(number, depth):
    """Random convex hulls: a ball outside has one nearest point (projection on a convex set is unique)."""
    rng = np.random.default_rng(number)
    hull = ConvexHull(rng.normal(size=(20, 3)))
    rows = triangle_rows(hull.points, hull.simplices)
    # from a vertex, an edge or a face outwards: the sum of some outward normals is in the normal cone there
    facets = rng.choice(len(hull.simplices))
    corners = hull.simplices[facets, : rng.integers(1, 4)]
    at = hull.points[corners].mean(axis=0)
    normals = hull.equations[[set(corners) <= set(s) for s in hull.simplices], :3]
    out = normals.sum(axis=0) / np.linalg.norm(normals.sum(axis=0))
    _, distance, direction = contacts(rows, at + depth * out)
    assert distance == pytest.approx([depth])
    assert direction[0] == pytest.approx(-out)


BOX = box_surface("box", "housing", (0.0, 0.0, 0.0), (4.0, 4.0, 4.0))


@pytest.mark.parametrize(
    ("centre", "count"),
    [
        ((0.1, 0.3, 2.9), 1),  # outside: over a face, an edge, a corner
        ((2.6, 0.1, 2.6), 1),
        ((2.5, 2.5, 2.5), 1),
        ((0.1, 0.3, 1.1), 1),  # inside: face, edge, corner
        ((1.1, 0.3, 1.2), 2),
        ((1.1, 1.2, 1.3), 3),
        ((1.1, 1.1, 1.1), 3),
    ],
)
def test_a_box_from_outside_and_inside(centre, count):
    rows = triangle_rows(BOX.vertices, BOX.triangles)
    _, distance, direction = contacts(rows, centre)
    assert len(distance) == count
    if max(np.abs(centre)) < 2.0:  # inside, each wall is at its own distance along its own axis
        assert np.allclose(np.sort(distance), np.sort([2.0 - c for c in centre if c > 1.0]))
        assert np.allclose(direction @ direction.T, np.eye(count), atol=1e-12)


def test_a_thin_plate_is_touched_once_and_two_plates_twice():
    plate = box_surface("p", "b", (0, 0, 0), (4, 4, 0.01))
    assert len(contacts(triangle_rows(plate.vertices, plate.triangles), (0.1, 0.2, 0.9))[1]) == 1
    pair = joined("p", "b", [box_surface("p", "b", (0, 0, z), (4, 4, 0.01)) for z in (-0.95, 0.95)])
    rows = triangle_rows(pair.vertices, pair.triangles)
    for centre in ((0.0, 0.0, 0.0), (0.3, 0.2, 0.01), (2.1, 0.0, 0.0), (2.1, 2.1, 0.0)):
        _, _, direction = contacts(rows, centre)
        assert len(direction) == 2 and direction[0, 2] * direction[1, 2] < 0.0


@pytest.mark.parametrize(("factor", "count"), [(0.5, 1), (0.98, 1), (1.5, 2), (4.0, 2)])
def test_a_crease_counts_twice_from_the_feature_angle_on(factor, count):
    """A ball 0.5 % deep in both sides of a concave crease whose normals enclose factor times the feature angle."""
    half = 0.5 * factor * FEATURE_ANGLE
    rows = strips([(-9 * math.cos(half), 9 * math.sin(half)), (0, 0), (9 * math.cos(half), 9 * math.sin(half))])
    _, distance, _ = contacts(rows, (0.0, 0.3, 0.995 / math.cos(half)))
    assert distance == pytest.approx([0.995] * count)


@given(st.sampled_from([0.1, 0.5, 0.9, 0.97]), st.integers(18, 60), st.floats(0, 2 * math.pi), st.floats(-1, 1))
@few
def test_the_inside_of_a_tessellated_tube_is_touched_once(ball, sides, azimuth, height):
    """Wherever a ball 1 % deep presses on the wall of a tube, even if it nearly fills it."""
    angle = 2.0 * np.pi * np.arange(sides + 1) / sides
    inner = math.cos(math.pi / sides) / ball  # inscribed radius, with the circle's corners at 1 / ball
    rows = strips(np.column_stack([np.cos(angle), np.sin(angle)]) / ball)
    offset = azimuth % (2.0 * math.pi / sides) - math.pi / sides  # from the middle of its facet
    out = (inner - 0.99) / math.cos(offset)
    _, distance, direction = contacts(rows, (out * math.cos(azimuth), height, out * math.sin(azimuth)))
    assert len(distance) == 1
    # the nearest facet is that in the direction of the ball, to half its angle
    assert distance[0] == pytest.approx(0.99, abs=1e-12)
    assert direction[0] @ [math.cos(azimuth), 0.0, math.sin(azimuth)] == pytest.approx(math.cos(offset), abs=1e-9)


@given(st.integers(0, 50), st.floats(0.0, 0.9))
@few
def test_the_inside_of_an_irregular_bowl_is_touched_once(number, eccentricity):
    """A ball 1 % deep, of up to 0.6 of the size of a sphere whose random faces turn by 7 degrees, 18 at most."""
    rng = np.random.default_rng(number)
    bowl = rng.normal(size=(1000, 3))
    hull = ConvexHull(bowl / np.linalg.norm(bowl, axis=1)[:, None])
    rows = triangle_rows(hull.points, hull.simplices)
    out = rng.normal(size=3)
    centre = (0.4 + 0.6 * eccentricity) * out / np.linalg.norm(out)
    _, nearest, _ = contacts(rows, centre)
    _, distance, _ = contacts(rows, centre, nearest[0] / 0.99)
    assert distance == pytest.approx([nearest[0]])


@given(seed)
@few
def test_the_order_of_triangles_does_not_matter(number):
    """The same contacts, apart from ties, in a scene of flat, convex and concave parts."""
    rng = np.random.default_rng(number)
    rows = np.vstack([
        triangle_rows(BOX.vertices, BOX.triangles),
        strips([(-9.0, -1.9), (0.0, -1.9), (3.0, -1.5), (9.0, 4.0)]),
    ])  # fmt: skip
    centre = rng.uniform(-2.5, 2.5, 3)
    _, distance, direction = contacts(rows, centre)
    _, other_distance, other_direction = contacts(rows[rng.permutation(len(rows))], centre)
    assert other_distance == pytest.approx(distance, abs=1e-14)
    assert other_direction == pytest.approx(direction, abs=1e-12)


@given(seed)
@few
def test_a_contact_points_down_the_gradient_of_its_distance(number):
    """grad d = -n, so that a force along n is that of a potential; central differences of 1e-6."""
    rng = np.random.default_rng(number)
    rows = triangle_rows(BOX.vertices, BOX.triangles)
    centre, along, h = rng.uniform(-2.8, 2.8, 3), rng.normal(size=3), 1e-6
    before, here, after = (contacts(rows, centre + k * h * along) for k in (-1, 0, 1))
    if not len(here[1]) or not np.array_equal(before[0], here[0]) or not np.array_equal(after[0], here[0]):
        return  # a grain in the air, or at a switch of triangles
    assert (after[1] - before[1]) / (2 * h) == pytest.approx(-here[2] @ along, abs=1e-6)


@pytest.mark.parametrize("place", [(0.3, 0.2), (0.0, 0.3), (0.0, 0.0), (2.0, 0.5)])
def test_a_centre_on_the_surface_is_pushed_along_the_normal(place):
    """On a face, an edge, a vertex and the rim of a flat mesh whose normals point to +z."""
    vertices = np.array([[-2, -2, 0], [2, -2, 0], [2, 2, 0], [-2, 2, 0], [0, 0, 0.0]])
    rows = triangle_rows(vertices, np.array([[0, 1, 4], [1, 2, 4], [2, 3, 4], [3, 0, 4]]))
    _, distance, direction = contacts(rows, (*place, 0.0))
    assert distance.tolist() == [0.0]
    assert direction[0] == pytest.approx([0.0, 0.0, -1.0])


# ---- tables


def scene():
    """A triangle drum on the rotor, vanes on the disc, a floor: walls and bodies."""
    angle = 2.0 * np.pi * np.arange(24) / 24
    drum = extruded("drum", "rotor", 0.1 * np.column_stack([np.cos(angle), np.sin(angle)]), -0.02, 0.02)
    vane = box_surface("vane", "disc", (0.06, 0.0, 0.0), (0.05, 0.005, 0.03))
    floor = annulus("floor", "housing", -0.03, 0.0, 0.1)
    walls = [vane, floor, drum, *(vane.turned(k * np.pi / 2, f"vane_{k}") for k in (1, 2, 3))]
    return walls, [Body("rotor", TimeProfile.constant(1.0)), Body("housing"), Body("disc")]


def test_tables_part_triangles_from_analytic_walls():
    walls, bodies = scene()
    table, triangles = wall_table(walls, bodies), triangle_table(walls, bodies)
    assert table.wall.tolist() == [1] and table.body.tolist() == [1] and np.array_equal(table.rows, wall_rows(walls))
    assert np.all(np.diff(triangles.body) >= 0)
    assert triangles.first.tolist() == [0, len(walls[2].triangles), len(walls[2].triangles), triangles.count]
    for t in (0, triangles.count - 1):
        assert bodies[triangles.body[t]].name == walls[triangles.wall[t]].body
    assert triangle_table(walls[1:2], bodies).count == 0
    with pytest.raises(ValueError, match=r"vane.*'disc', which does not exist"):
        triangle_table(walls, bodies[:2])


@pytest.mark.parametrize("reach", [0.0005, 0.004, 0.05])
def test_near_triangles_are_those_of_the_brute_search(reach):
    """Naive distances to all triangles, bodies turned; ascending; reach below, about and far above a triangle."""
    walls, bodies = scene()
    table = triangle_table(walls, bodies)
    search = TriangleSearch(table)
    rng = np.random.default_rng(3)
    angle = [0.3, 0.0, -1.1]
    for factor in (1.0, 0.9, 3.0):  # a second and third reach: the grid is kept, and rebuilt
        position = rng.uniform(-0.12, 0.12, (300, 3))
        reaches = factor * reach * rng.uniform(0.5, 1.0, len(position))
        start, other = search.near(position, reaches, angle)
        for i, (centre, limit) in enumerate(zip(position, reaches, strict=True)):
            near = []
            for t in range(table.count):
                a = -angle[table.body[t]]
                x = math.cos(a) * centre[0] - math.sin(a) * centre[1]
                y = math.sin(a) * centre[0] + math.cos(a) * centre[1]
                p = closest_on_triangle(table.rows, t, x, y, centre[2])
                if math.dist(p, (x, y, centre[2])) < limit:
                    near.append(t)
            assert other[start[i] : start[i + 1]].tolist() == near
    assert len(other) > 0


def test_overlaps_turn_with_the_body():
    """A body turned by an angle is met by a grain turned with it as at rest, and pushes it in the turned direction."""
    walls, bodies = scene()
    table = triangle_table(walls, bodies)
    search, angle = TriangleSearch(table), 0.7
    cos, sin = math.cos(angle), math.sin(angle)
    turn = np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
    position = np.random.default_rng(0).uniform(-0.1, 0.1, (200, 3))
    radius = np.full(200, 0.01)
    results = []
    for a, x in ((0.0, position), (angle, position @ turn.T)):
        start, other = search.near(x, radius, [a] * 3)
        other = other.astype(np.int64)
        trig = np.tile([math.cos(a), math.sin(a)], (3, 1))
        results.append((start, other, triangle_overlaps(x, radius, table.rows, table.body, trig, start, other)))
    (start, other, rest), (start_2, other_2, turned) = results
    assert np.array_equal(start, start_2) and np.array_equal(other, other_2)
    counted = rest[:, 0] > 0.0
    grain = np.repeat(np.arange(200), np.diff(start))
    pushed = np.zeros((2, 200, 3))  # sums of overlap times direction: which of two equally near triangles is open
    for total, slots in zip(pushed, (rest, turned), strict=True):
        np.add.at(total, grain, np.maximum(slots[:, :1], 0.0) * slots[:, 1:])
    assert counted.sum() > 50 and np.allclose(pushed[1], pushed[0] @ turn.T, atol=1e-12)
    # grains that touch a vane and the drum touch both: bodies do not hide each other
    both = [len(set(table.body[other[(grain == i) & counted]])) for i in range(200)]
    assert max(both) == 2


def test_push_off_leaves_no_overlap():
    """Grains thrown into a box, many through its walls, edges and corners: a few sweeps, and none overlaps."""
    rows = triangle_rows(BOX.vertices, BOX.triangles)
    rng = np.random.default_rng(1)
    position, radius = rng.uniform(-1.95, 1.95, (500, 3)), rng.uniform(0.2, 0.6, 500)
    start, other = np.arange(0, 501) * len(rows), np.tile(np.arange(len(rows), dtype=np.int32), 500)
    worst = [push_off_triangles(position, radius, rows, start, other) for _ in range(3)]
    assert worst[0] > 0.4 and worst[-1] < 1e-12
    assert np.all(np.abs(position) + radius[:, None] < 2.0 + 1e-12)


def test_winding_number_tells_inside_from_outside():
    """Of a closed surface it is 1 inside and 0 outside, for an L too; a point's place is known from the polygon."""
    wall = extruded("L", "b", np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]]), 0.0, 1.0)
    rows = triangle_rows(wall.vertices, wall.triangles)
    x = np.random.default_rng(0).uniform(-0.5, 2.5, (300, 3))
    inside = (x > 0).all(axis=1) & (x < [2, 2, 1]).all(axis=1) & ~((x[:, 0] > 1) & (x[:, 1] > 1))
    assert inside.any() and np.allclose(winding_number(x, rows, 0, len(rows)), inside, atol=1e-12)


def test_only_walls_that_enclose_tell_that_a_grain_has_left():
    far = np.array([[5.0, 0.0, 0.0], [0.0, 0.0, 0.0], [0.0, 0.0, -5.0]])
    assert outside(far, [BOX], 0.1).tolist() == [True, False, True]
    floor = Plane("floor", "housing", np.array([0, 0, -2.0]), np.array([0, 0, 1.0]))
    vane = box_surface("vane", "disc", (0.5, 0.0, 0.0), (1.0, 0.1, 1.0))
    assert outside(far, [floor, vane], 0.1).tolist() == [False, False, True]
    belt = TriangleWall("belt", "housing", BOX.vertices, BOX.triangles[:-1])  # open
    assert not outside(far, [belt], 0.1).any()
    shell = [cylinder("shell", "rotor", 2.0, -1.0, 1.0), annulus("lid", "rotor", 1.0, 0.0, 2.0)]
    assert outside(far, [*shell, vane], 0.1).tolist() == [True, False, True]
