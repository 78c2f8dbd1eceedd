"""The walls of grains from a CAD file are those of the parametric clutch, and close around any cavity."""

import math

import numpy as np
import pytest
from step_file import rectangle, write_polygons

from geometry import Clutch
from geometry.cad_meshing import cad_section
from geometry.cad_shape import CadShape

CLUTCH = Clutch()


@pytest.fixture(scope="module")
def clutch_step(tmp_path_factory):
    return write_polygons(tmp_path_factory.mktemp("cad") / "clutch.step", CLUTCH.section_polygons())


def test_walls_and_boxes_are_those_of_the_parametric_clutch(clutch_step):
    shape = CadShape(cad_section(clutch_step), magnetic=frozenset({"disc", "rotor"}))
    assert shape.gap == pytest.approx(CLUTCH.gap) and shape.bore_radius == pytest.approx(CLUTCH.bore_radius)
    assert shape.mean_gap_radius == pytest.approx(CLUTCH.mean_gap_radius)

    def corner(point):
        return round(point[0], 9), round(point[1], 9)

    def segments(walls):
        return sorted((wall.body, wall.magnetic, *sorted((corner(wall.start), corner(wall.end)))) for wall in walls)

    def rectangles(boxes):
        return sorted((corner((box.r0, box.z0)), corner((box.r1, box.z1))) for box in boxes.values())

    def owned(walls):  # every inner corner of a body has one owner
        return sum((wall.start_neighbour is not None) + (wall.end_neighbour is not None) for wall in walls)

    assert segments(shape.walls()) == segments(CLUTCH.walls()) and owned(shape.walls()) == owned(CLUTCH.walls())
    assert rectangles(shape.fill_boxes()) == rectangles(CLUTCH.fill_boxes())
    assert (shape.coil_area, shape.coil_mean_radius) == pytest.approx((CLUTCH.coil_area, CLUTCH.coil_mean_radius))
    assert shape.faults(0.2e-3) == [] and "no grain fits" in shape.faults(2e-3)[0].message
    assert np.allclose(shape.gap_midline()[:, 0], CLUTCH.mean_gap_radius)


def test_bodies_follow_the_scene(clutch_step):
    shape = CadShape(cad_section(clutch_step), bodies={"cover": "housing"})
    bodies = {wall.name.rsplit("_", 1)[0]: wall.body for wall in shape.walls()}
    assert bodies["cover"] == "housing" and bodies["rotor"] == "rotor" and bodies["disc"] == "disc"


def test_a_cavity_around_a_disc_on_no_shaft_is_two_closed_outlines(tmp_path):
    """The powder all around a ring-shaped disc: an outer and an inner loop, each closed, every corner owned."""
    ring = rectangle(0.02, 0.03, -0.005, 0.005)
    around = [rectangle(0.018, 0.02, -0.007, 0.007), rectangle(0.03, 0.032, -0.007, 0.007),
              rectangle(0.02, 0.03, 0.005, 0.007), rectangle(0.02, 0.03, -0.007, -0.005)]  # fmt: skip
    coil = [rectangle(0.04, 0.05, -0.005, 0.005)]
    path = write_polygons(tmp_path / "a.step", {"disc": [ring], "powder": around, "coil": coil})
    shape = CadShape(cad_section(path), bodies={"air": "rotor"})
    walls = shape.walls()
    # four faces of the disc; four outside, of which the two end faces come in three pieces, as they were drawn
    assert len(walls) == 12 and all(wall.end_neighbour is not None for wall in walls)
    assert sum(wall.area for wall in walls if wall.body == "disc") == pytest.approx(
        2 * math.pi * ((0.02 + 0.03) * 0.01 + 0.03**2 - 0.02**2)
    )
    assert sum(box.volume() for box in shape.fill_boxes().values()) == pytest.approx(
        math.pi * ((0.032**2 - 0.018**2) * 0.014 - (0.03**2 - 0.02**2) * 0.01)
    )


def test_a_cavity_on_the_axis_has_no_wall_there(tmp_path):
    shapes = {"powder": [rectangle(0.0, 0.02, 0.0, 0.005)], "rotor": [rectangle(0.0, 0.02, 0.005, 0.01)],
              "coil": [rectangle(0.03, 0.04, 0.0, 0.01)]}  # fmt: skip
    shape = CadShape(cad_section(write_polygons(tmp_path / "a.step", shapes)))
    assert sorted((wall.body, round(wall.area * 1e6)) for wall in shape.walls()) == [
        ("housing", round(2 * math.pi * 20 * 5)), ("housing", round(math.pi * 400)), ("rotor", round(math.pi * 400)),
    ]  # fmt: skip


def test_a_powder_that_is_no_set_of_rectangles_is_reported(tmp_path):
    cone = np.array([(0.02, 0.0), (0.03, 0.0), (0.03, 0.01), (0.02, 0.005)])
    shape = CadShape(cad_section(write_polygons(tmp_path / "a.step", {"powder": [cone]})))
    assert "runs obliquely" in shape.faults()[0].message
    path = write_polygons(tmp_path / "b.step", {"coil": [rectangle(0.02, 0.03, 0, 0.01)]})
    assert "no part of the file is the powder" in CadShape(cad_section(path)).faults()[0].message


def test_a_gap_is_sheared_where_its_faces_are_of_two_bodies(tmp_path):
    """Faces along r and along z, cut where a part of a face ends; steel at both makes them poles."""
    powder = np.array([(24, -8), (26, -8), (26, 10), (10, 10), (10, 8), (24, 8)]) * 1e-3  # at the rim and a face
    shapes = {"powder": [powder], "disc": [rectangle(0.01, 0.024, -0.008, 0.008)],
              "rotor": [rectangle(0.026, 0.03, -0.008, 0.0)], "ring": [rectangle(0.026, 0.03, 0.0, 0.01)],
              "cover": [rectangle(0.01, 0.03, 0.01, 0.014)]}  # fmt: skip
    section = cad_section(write_polygons(tmp_path / "a.step", shapes))
    steel = frozenset({"disc", "rotor", "cover"})

    def parts(found):
        return {(*np.round([1e3 * x for x in (p.box.r0, p.box.r1, p.box.z0, p.box.z1)], 6), p.regions) for p in found}

    rim = {(24, 26, -8, 0, ("disc", "rotor")), (24, 26, 0, 8, ("disc", "ring"))}
    face = {(10, 24, 8, 10, ("disc", "cover"))}
    shape = CadShape(section, magnetic=steel)
    assert parts(shape.sheared_parts()) == rim | face and sum(part.radial for part in shape.sheared_parts()) == 2
    assert parts(shape.pole_parts()) == {part for part in rim | face if "ring" not in part[-1]}
    (on_face,) = (part for part in shape.sheared_parts() if not part.radial)
    assert on_face.area == pytest.approx(math.pi * (0.024**2 - 0.01**2))
    torque = 2.0 / 3.0 * math.pi * (0.024**3 - 0.01**3)  # of a unit of stress: integral of r dA
    assert on_face.area * on_face.radius == pytest.approx(torque)
    turned = CadShape(section, bodies={"ring": "disc", "cover": "disc"}, magnetic=steel)
    assert parts(turned.sheared_parts()) == {(24, 26, -8, 0, ("disc", "rotor"))}
    assert not CadShape(section, bodies={"disc": "rotor"}).sheared_parts()
    between = CadShape(section, bodies={"disc": "housing", "ring": "disc"})  # the torque is measured on the disc
    assert parts(between.sheared_parts()) == {(24, 26, 0, 8, ("disc", "ring"))}


def test_a_channel_between_two_chambers_has_no_faces_across(tmp_path):
    """Powder on both its sides along r: the thin slab is no gap."""
    powder = np.array([(10, -5), (14, -5), (14, -2), (14.5, -2), (14.5, -5), (18, -5),
                       (18, 5), (14.5, 5), (14.5, 2), (14, 2), (14, 5), (10, 5)]) * 1e-3  # fmt: skip
    shapes = {"powder": [powder], "disc": [rectangle(0.005, 0.01, -0.005, 0.005)],
              "rotor": [rectangle(0.018, 0.022, -0.005, 0.005)]}  # fmt: skip
    shape = CadShape(cad_section(write_polygons(tmp_path / "a.step", shapes)), magnetic=frozenset({"disc", "rotor"}))
    assert (0.014, 0.0145) in {(box.r0, box.r1) for box in shape.fill_boxes().values()}
    assert shape.sheared_parts() == [] and shape.gap_parts([]) == []
