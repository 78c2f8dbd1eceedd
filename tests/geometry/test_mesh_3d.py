"""The mesh in 3D: volumes of flat and curved elements, quality, partition, periodic pairs, hash."""

import numpy as np
import pytest

from geometry.mesh_3d import EDGES, Mesh3D

CORNERS = np.vstack((np.zeros(3), np.eye(3)))
NODES = np.vstack((CORNERS, CORNERS[EDGES].mean(axis=1)))


def one(**changes):
    parts = {
        "points": NODES,
        "tetrahedra": np.array([[0, 1, 2, 3]]),
        "second_order": np.arange(10)[None],
        "regions": {"body": np.array([0])},
        "boundaries": {"floor": np.array([[0, 2, 1]])},
    }
    return Mesh3D(**(parts | changes))


def test_straight_edges_give_the_flat_volume():
    flat = one(points=CORNERS, second_order=None)
    assert one().volume("body") == pytest.approx(1.0 / 6.0, rel=1e-14)
    assert flat.volume("body") == pytest.approx(1.0 / 6.0, rel=1e-14)


def test_the_volume_under_a_bent_face_is_that_of_the_quadratic_map():
    """Lifting the middle of an edge of the floor by s moves the floor by s N(xi): volume -s integral of N = -s/6.

    N is the edge's function 4 l_0 l_1 on the floor; its integral over the triangle of area 1/2 is 1/6, and the
    faces beside it stay flat ones of a vertical prism, so that the change is exact.
    """
    lifted = NODES.copy()
    lifted[4, 2] += 0.1
    mesh = one(points=lifted)
    assert mesh.volume("body") == pytest.approx(1.0 / 6.0 - 0.1 / 6.0, rel=1e-12)


def test_a_sector_stands_for_the_machine():
    assert one(n_sectors=12).volume("body") == pytest.approx(2.0, rel=1e-14)


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"points": NODES * [1.0, 1.0, -1.0]}, "inverted"),
        ({"points": NODES * [1.0, 1.0, 0.0]}, "flat"),
        ({"points": np.where(np.arange(10)[:, None] == 4, [0.5, 0.0, 0.6], NODES)}, "folded"),
        ({"regions": {"body": np.array([0, 0])}}, "exactly one region"),
        ({"regions": {}}, "exactly one region"),
        ({"second_order": np.arange(10)[None, ::-1]}, "begins with the corners"),
        ({"boundaries": {"floor": np.array([[0, 1, 17]])}}, "floor"),
        ({"points": np.full((10, 3), np.nan)}, "finite"),
        ({"tetrahedra": np.array([[0, 1, 2, 5]]), "second_order": None}, "first nodes"),
        ({"periodic": np.array([[1, 2]]), "sector_angle": 0.3}, "17.1887 degrees"),
    ],
)
def test_a_broken_mesh_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        one(**changes)


def test_matching_periodic_nodes_are_accepted():
    mesh = one(periodic=np.array([[2, 1]]), sector_angle=0.5 * np.pi, n_sectors=4)
    assert mesh.periodic is not None


def test_equal_meshes_have_equal_hashes_and_others_do_not():
    assert one().hash() == one().hash()
    assert one().hash() != one(n_sectors=2).hash()
    assert one().hash() != one(points=NODES * (1.0 + 1e-15)).hash()
    assert one().hash() != one(regions={"other": np.array([0])}).hash()


def test_an_unknown_region_is_named_with_those_there_are():
    with pytest.raises(KeyError, match="body"):
        one().volume("disc")
