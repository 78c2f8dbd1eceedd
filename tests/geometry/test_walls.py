"""Walls: who owns an edge, areas, the simple cells."""

import numpy as np
import pytest

from geometry import AnnularBox, Box, Plane, RevolvedWall, ShearCell, annulus, cone, cylinder, outline


def owners(walls):
    """How many walls own each end point."""
    count: dict[tuple[float, float], int] = {}
    for wall in walls:
        for vertex, neighbour in ((wall.start, wall.start_neighbour), (wall.end, wall.end_neighbour)):
            count[vertex] = count.get(vertex, 0) + (neighbour is not None)
    return count


def test_inner_vertices_of_an_open_outline_are_owned_once_and_its_ends_by_nobody():
    vertices = [(1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (3.0, 2.0)]
    assert owners(outline("w", "disc", vertices)) == dict(zip(vertices, [0, 1, 1, 0], strict=True))


def test_every_vertex_of_a_closed_outline_is_owned_once():
    vertices = [(1.0, 0.0), (2.0, 0.0), (2.0, 1.0), (1.0, 1.0)]
    walls = outline("w", "disc", vertices, closed=True)
    assert len(walls) == 4
    assert set(owners(walls).values()) == {1}


def test_the_neighbour_is_the_unit_vector_along_the_other_segment():
    first, second = outline(["a", "b"], "disc", [(1.0, 0.0), (2.0, 0.0), (5.0, -4.0)], magnetic=[True, False])
    assert first.end_neighbour == pytest.approx((0.6, -0.8))
    assert (first.name, second.name, first.magnetic, second.magnetic) == ("a", "b", True, False)
    assert second.start_neighbour is None and second.end_neighbour is None


def test_an_end_on_the_axis_continues_into_its_mirror_image():
    assert annulus("lid", "housing", 1.0, 0.0, 2.0).start_neighbour == (-1.0, 0.0)
    assert cone("tip", "housing", (3.0, 0.0), (0.0, 4.0)).end_neighbour == pytest.approx((-0.6, -0.8))
    assert cylinder("bore", "rotor", 1.0, 0.0, 1.0).start_neighbour is None


def test_areas_of_cylinder_disc_and_cone():
    assert cylinder("c", "b", 2.0, 0.0, 3.0).area == pytest.approx(12.0 * np.pi)
    assert annulus("a", "b", 0.0, 0.0, 2.0).area == pytest.approx(4.0 * np.pi)
    assert cone("k", "b", (3.0, 0.0), (0.0, 4.0)).area == pytest.approx(15.0 * np.pi)


def test_walls_without_area_and_outlines_without_segments_are_refused():
    with pytest.raises(ValueError, match="no area"):
        RevolvedWall("w", "b", (1.0, 0.0), (1.0, 0.0))
    with pytest.raises(ValueError, match="no area"):
        RevolvedWall("w", "b", (0.0, 0.0), (0.0, 1.0))
    with pytest.raises(ValueError, match="negative"):
        RevolvedWall("w", "b", (-1.0, 0.0), (1.0, 0.0))
    with pytest.raises(ValueError, match="vertices"):
        outline("w", "b", [(1.0, 0.0)])
    with pytest.raises(ValueError, match="names"):
        outline(["one"], "b", [(1.0, 0.0), (2.0, 0.0), (2.0, 1.0)])
    with pytest.raises(ValueError, match="normal"):
        Plane("p", "b", np.zeros(3), np.zeros(3))


def test_a_sector_of_an_annular_box_has_its_share_of_the_volume():
    box = AnnularBox(1.0, 2.0, 0.0, 0.5)
    assert box.volume() == pytest.approx(1.5 * np.pi)
    assert box.volume(np.pi / 6.0) == pytest.approx(box.volume() / 12.0)


def test_normals_of_the_box_point_inward():
    box = Box((2.0, 4.0, 6.0))
    centre = 0.5 * (box.lower + box.upper)
    distances = sorted(float((centre - wall.point) @ wall.normal) for wall in box.walls())
    assert distances == pytest.approx([1.0, 1.0, 2.0, 2.0, 3.0, 3.0])
    assert {wall.body for wall in box.walls()} == {"housing"}


def test_the_shear_cell_is_closed_by_three_bodies():
    cell = ShearCell(0.02, 0.03, 0.01)
    assert [wall.body for wall in cell.walls()] == ["disc", "rotor", "housing", "housing"]
    assert cell.fill_boxes()["annulus"].volume() == pytest.approx(np.pi * (0.03**2 - 0.02**2) * 0.01)


@pytest.mark.parametrize(
    "cell, diameter, keys",
    [
        (ShearCell(0.02, 0.03, 0.01), 1e-3, []),
        (ShearCell(-0.02, 0.0, float("nan")), None, ["inner_radius", "outer_radius", "height"]),
        (ShearCell(0.03, 0.02, 0.01), None, ["outer_radius"]),
        (ShearCell(0.02, 0.021, 0.001), 2e-3, ["outer_radius", "height"]),
        (Box((1.0, 0.0, 1.0)), None, ["size"]),
        (Box((1.0, 1e-3, 1e-3)), 2e-3, ["size", "size"]),
    ],
)
def test_impossible_cells_report_every_fault(cell, diameter, keys):
    faults = cell.faults(diameter)
    assert [fault.what for fault in faults] == list(keys)
    assert all("allowed:" in fault.message and fault.remedy in str(fault) for fault in faults)
