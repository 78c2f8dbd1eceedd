"""The section mesh: areas, Pappus volumes, partition of the elements, hash."""

import numpy as np
import pytest

from geometry import SectionMesh


def square(r0=1.0, **changes):
    points = np.array([[r0, 0.0], [r0 + 1.0, 0.0], [r0 + 1.0, 1.0], [r0, 1.0]])
    parts = {
        "points": points,
        "triangles": np.array([[0, 1, 2], [0, 2, 3]]),
        "regions": {"below": np.array([0]), "above": np.array([1])},
        "boundaries": {"inner": np.array([[3, 0]])},
    }
    return SectionMesh(**(parts | changes))


def test_area_and_volume_of_a_ring_follow_pappus():
    mesh = square(r0=2.0)
    assert mesh.area("below") + mesh.area("above") == pytest.approx(1.0, rel=1e-14)
    assert mesh.volume("below") + mesh.volume("above") == pytest.approx(np.pi * (3.0**2 - 2.0**2), rel=1e-14)
    assert mesh.boundary_length("inner") == pytest.approx(1.0)
    assert mesh.region_of_element().tolist() == ["below", "above"]


def test_equal_meshes_have_equal_hashes_and_others_do_not():
    assert square().hash() == square().hash()
    assert square().hash() != square(r0=1.0 + 1e-15).hash()
    assert square().hash() != square(regions={"below": np.array([0]), "other": np.array([1])}).hash()


@pytest.mark.parametrize(
    "changes, message",
    [
        ({"triangles": np.array([[0, 2, 1], [0, 2, 3]])}, "counter-clockwise"),
        ({"regions": {"below": np.array([0])}}, "exactly one region"),
        ({"regions": {"below": np.array([0, 1]), "above": np.array([1])}}, "exactly one region"),
        ({"points": np.array([[-1.0, 0.0], [1.0, 0.0], [1.0, 1.0], [0.0, 1.0]])}, "r >= 0"),
    ],
)
def test_a_broken_mesh_is_refused(changes, message):
    with pytest.raises(ValueError, match=message):
        square(**changes)


def test_an_unknown_region_is_named_with_those_there_are():
    with pytest.raises(KeyError, match="above, below"):
        square().area("disk")
