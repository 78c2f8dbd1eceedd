"""A sphere that goes round an edge: touched once, and the force turns without a jump.

The oracle is the contact rule of `geometry.walls` in a few lines of numpy, in the half-plane of the centre.
"""

from itertools import pairwise

import numpy as np
import pytest

from geometry import Clutch, annulus, outline

pytestmark = pytest.mark.physics


def contacts(walls, centre, radius):
    """Vectors from wall to centre, one for each contact of a sphere with centre (r, z)."""
    found = []
    for wall in walls:
        start, along = np.array(wall.start), np.subtract(wall.end, wall.start)
        t = (centre - start) @ along / (along @ along)
        if 0.0 < t < 1.0:
            nearest = start + t * along
        else:
            nearest, neighbour = (start, wall.start_neighbour) if t <= 0.0 else (start + along, wall.end_neighbour)
            if neighbour is None or (centre - nearest) @ neighbour > 0.0:
                continue
        if np.linalg.norm(centre - nearest) < radius:
            found.append(centre - nearest)
    return found


def around_corner(corner, distance, count=2001):
    """Centres at a distance from the convex corner: along the face, round the edge, along the rim."""
    r, z = corner
    along = np.linspace(2.0, 0.0, count)[:, None] * distance
    face = np.array([r, z + distance]) - along * [1.0, 0.0]
    angle = np.linspace(0.5 * np.pi, 0.0, count)[:, None]
    edge = np.array([r, z]) + distance * np.hstack((np.cos(angle), np.sin(angle)))
    rim = np.array([r + distance, z]) - along[::-1] * [0.0, 1.0]
    return np.concatenate((face, edge, rim))


@pytest.mark.parametrize("reverse", [False, True])
def test_a_sphere_rolling_round_a_convex_edge_has_one_contact_whose_force_turns_continuously(reverse):
    vertices = [(5.0, 1.0), (10.0, 1.0), (10.0, -1.0), (5.0, -1.0)]
    walls = outline("disc", "disc", vertices[::-1] if reverse else vertices)
    forces = []
    for centre in around_corner((10.0, 1.0), 0.099):
        touched = contacts(walls, centre, 0.1)
        assert len(touched) == 1
        forces.append(touched[0] / np.linalg.norm(touched[0]))
    assert np.linalg.norm(np.diff(forces, axis=0), axis=1).max() < 1e-3  # a step of the arc turns by 8e-4
    assert forces[0] == pytest.approx((0.0, 1.0)) and forces[-1] == pytest.approx((1.0, 0.0))


@pytest.mark.parametrize("reverse", [False, True])
def test_in_a_concave_corner_both_faces_are_touched_and_the_edge_is_not(reverse):
    vertices = [(5.0, 0.0), (10.0, 0.0), (10.0, 5.0)]
    walls = outline("bowl", "rotor", vertices[::-1] if reverse else vertices)
    for r, z in np.random.default_rng(1).uniform(0.001, 0.099, (200, 2)):
        touched = contacts(walls, np.array([10.0 - r, z]), 0.1)
        assert sorted(map(tuple, np.round(touched, 12))) == sorted([(round(-r, 12), 0.0), (0.0, round(z, 12))])


def test_a_straight_join_is_one_contact_everywhere():
    walls = outline("bore", "rotor", [(10.0, -5.0), (10.0, 0.0), (10.0, 5.0)])
    for z in (-1e-9, 0.0, 1e-9):
        assert len(contacts(walls, np.array([9.95, z]), 0.1)) == 1


def test_the_middle_of_a_disc_is_touched_on_the_axis_too():
    assert len(contacts([annulus("lid", "housing", 0.0, 0.0, 1.0)], np.array([0.0, 0.05]), 0.1)) == 1


def test_the_walls_of_a_clutch_hold_a_grain_everywhere_on_the_chamber():
    """A grain pressed a little against any face or edge of the chamber is touched there, never doubly."""
    clutch = Clutch()
    radius = 0.1e-3
    inset = 0.99 * radius
    bore, half = clutch.bore_radius - inset, 0.5 * clutch.cavity_length - inset
    path = np.array(
        [(clutch.seal_radius + inset, -half), (bore, -half), (bore, half), (clutch.seal_radius + inset, half)]
    )
    # Right in a corner two walls are touched; elsewhere one.
    for a, b in pairwise(path):
        for s in np.linspace(0.01, 0.99, 501):
            assert len(contacts(clutch.walls(), a + s * (b - a), radius)) == 1
    for corner in path:
        assert len(contacts(clutch.walls(), corner, radius)) == 2
    for centre in around_corner((clutch.disc_radius, 0.5 * clutch.disc_thickness), inset, 301):
        assert len(contacts(clutch.walls(), centre, radius)) == 1
