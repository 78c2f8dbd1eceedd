"""[surfaces.NAME]: a file in the wrong unit of length is refused or reported; so is a solid part that is open."""

import meshio
import pytest

from emclutch.scene.case import case_from
from emclutch.scene.errors import SceneError
from geometry.triangle_wall import box_surface, extruded

INCH = 25.4e-3
SCENE = {
    "scene": {"title": "Grains and a part"},
    "geometry": {"kind": "box", "size": ["40 mm", "40 mm", "20 mm"]},
    "particles": {"diameter": "2 mm", "count": 10},
    "contact": {"stiffness": "20 kN/m"},
    "effects": {"gravity": {}},
    "time": {"end": "1 ms"},
}


def case_with(tmp_path, wall, unit=1.0, **entries):
    """The scene with a part [m] whose file is written in a `unit` [m]."""
    meshio.write(tmp_path / "part.stl", meshio.Mesh(wall.vertices / unit, [("triangle", wall.triangles)]))
    part = {"file": str(tmp_path / "part.stl"), **entries}
    return case_from(SCENE | {"surfaces": {"part": part}}, {})


def vane(size):
    """A closed box through the floor, of a length `size` [m]."""
    return box_surface("vane", "housing", (0.0, 0.0, 1e-3), (size, 1e-3, 4e-3))


@pytest.mark.parametrize(
    ("size", "unit", "times", "scale"),
    [(6e-3, 1e-3, 150, "0.001 makes it 6 mm"), (0.03, INCH, 29.5, "0.0254 makes it 30 mm"),
     (6e-3, 1e-2, 15, "0.01 makes it 6 mm")],
)  # fmt: skip
def test_a_part_in_another_unit_is_refused_and_the_scale_is_named(tmp_path, size, unit, times, scale):
    """A part of 6 mm in a file in millimetres is 6 m wide, 150 times the 40 mm of the space."""
    with pytest.raises(SceneError) as refused:
        case_with(tmp_path, vane(size), unit)
    assert f"{times} times the grains' space (40 mm)" in str(refused.value)
    assert "surfaces.part.scale = " in str(refused.value) and scale in str(refused.value)
    assert case_with(tmp_path, vane(size), unit, scale=unit).warnings == ()


def test_a_small_part_in_inches_is_reported(tmp_path):
    """6 mm are 0.236 inches: 0.236 m wide, which some parts may be."""
    (warning,) = case_with(tmp_path, vane(6e-3), INCH).warnings
    assert "5.91 times the grains' space" in warning and "0.0254 makes it 6 mm (a file in inches)" in warning


def test_a_part_smaller_than_a_tenth_of_a_grain_is_refused(tmp_path):
    """A part of 6 mm whose file is in metres, with the scale of one in millimetres."""
    with pytest.raises(SceneError, match=r"measures 0.006 mm, 0.003 of a grain.*surfaces.part.scale = 1 makes it 6 mm"):
        case_with(tmp_path, vane(6e-3), scale=0.001)


def test_a_solid_part_that_is_open_is_reported(tmp_path):
    """A prism of four sides without its lids has eight free edges; with them it is as meant."""
    corners = [[-5e-3, -5e-3], [5e-3, -5e-3], [5e-3, 5e-3], [-5e-3, 5e-3]]
    (warning,) = case_with(tmp_path, extruded("tube", "housing", corners, 0.0, 8e-3, caps=False)).warnings
    assert warning.startswith("surfaces.part.file is open: 8 edges belong to one triangle only")
    assert case_with(tmp_path, extruded("prism", "housing", corners, 0.0, 8e-3)).warnings == ()
