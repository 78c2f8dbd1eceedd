"""Triangle walls: what is refused, solids of known area and volume, surfaces from files."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from emclutch.results.vtk.wall_surface import triangle_surface
from emclutch.scene.surfaces import SurfaceSection, surface_walls
from geometry.file_content import CadError
from geometry.surface_import import triangle_wall_from_file
from geometry.triangle_wall import TriangleWall, box_surface, extruded, joined
from geometry.wall_openings import openings_in_words

L_SHAPE = np.array([[0, 0], [2, 0], [2, 1], [1, 1], [1, 2], [0, 2]], dtype=float)
SQUARE = np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0]], dtype=float)
HALVES = np.array([[0, 1, 2], [0, 2, 3]])


@pytest.mark.parametrize(
    ("vertices", "triangles", "message"),
    [
        (SQUARE, np.zeros((0, 3), int), "no triangles"),
        (SQUARE[:, :2], HALVES, "must be .v, 3."),
        (SQUARE, HALVES.astype(float), "integers"),
        (SQUARE, [[0, 1, 4]], "names vertex 4, but there are 4"),
        (SQUARE, [[0, 1, -1]], "names vertex -1"),
        (SQUARE, [[0, 1, 2], [0, 1, 1]], "1 of 2 triangles have no area, the first is 1"),
        (np.vstack([SQUARE, [[0.5, 0.5, 1e-12]]]), [[0, 1, 2], [0, 2, 4]], "no area"),
        (np.full((3, 3), 2.0), [[0, 1, 2]], "no area"),
        (np.vstack([SQUARE[:3], [[0, math.nan, 0]]]), HALVES, "vertex 3 is not finite"),
    ],
)
def test_what_is_no_wall_is_refused(vertices, triangles, message):
    with pytest.raises(ValueError, match=f"'vane'.*{message}"):
        TriangleWall("vane", "disc", vertices, triangles)


def test_a_soup_becomes_a_mesh():
    """Coincident vertices are merged, unused ones and triangles that stand twice are dropped; the area stays."""
    shift = 1e-11 * np.arange(18).reshape(6, 3)
    vertices = np.vstack([[[9.0, 9.0, 9.0]], SQUARE[HALVES].reshape(-1, 3) + shift])
    wall = TriangleWall("soup", "b", vertices, np.array([[1, 2, 3], [4, 5, 6], [3, 2, 1]]))
    assert wall.vertices.shape == (4, 3) and wall.triangles.shape == (2, 3)
    assert wall.area == pytest.approx(1.0, abs=1e-9) and wall.bounds[1].max() < 1.1
    assert not wall.is_closed
    with pytest.raises(ValueError, match="read-only"):
        wall.vertices[0, 0] = 1.0


@given(st.integers(0, 2**32 - 1), st.integers(3, 30), st.booleans(), st.floats(0.1, 3.0))
@settings(max_examples=40, deadline=None)
def test_a_prism_has_the_polygons_area_and_volume(seed, corners, reverse, height):
    """Star-shaped polygons, most not convex, in either direction: shoelace formula for the oracle."""
    rng = np.random.default_rng(seed)
    angle = 2.0 * np.pi * (np.arange(corners) + rng.uniform(-0.4, 0.4, corners)) / corners
    x, y = rng.uniform(0.2, 1.0, corners) * np.array([np.cos(angle), np.sin(angle)])
    area = 0.5 * abs(np.sum(x * np.roll(y, -1) - y * np.roll(x, -1)))
    girth = np.sum(np.hypot(np.roll(x, -1) - x, np.roll(y, -1) - y))
    polygon = np.column_stack([x, y])[:: -1 if reverse else 1]
    wall = extruded("prism", "b", polygon, 1.0, 1.0 + height)
    assert wall.is_closed and len(wall.triangles) == 4 * corners - 4
    assert wall.volume == pytest.approx(area * height)  # positive: normals outwards
    assert wall.area == pytest.approx(2.0 * area + girth * height)
    open_wall = extruded("prism", "b", polygon, 1.0, 1.0 + height, caps=False)
    assert not open_wall.is_closed and open_wall.area == pytest.approx(girth * height)


def test_a_polygon_with_flat_corners_is_cut_into_triangles_with_area():
    comb = [[0, 0], [1, 0], [2, 0], [3, 0], [4, 0], [4, 2], [3, 2], [3, 1], [2, 1], [1, 1], [1, 2], [0, 2], [0, 1]]
    assert extruded("U", "b", np.array(comb), 0.0, 1.0).volume == pytest.approx(6.0)


@pytest.mark.parametrize(
    ("polygon", "z", "message"),
    [
        ([[0, 0], [1, 1], [1, 0], [0, 1]], (0, 1), "sides 0 and 2 .* meet"),
        ([[0, 0], [1, 0], [1, 0], [0, 1]], (0, 1), "meet"),
        ([[0, 0], [2, 0], [1, 0], [1, 1]], (0, 1), "meet"),
        ([[0, 0], [1, 0]], (0, 1), "k >= 3"),
        (L_SHAPE, (1, 1), "z0 < z1"),
        (L_SHAPE, (0, math.inf), "finite"),
    ],
)
def test_what_is_no_prism_is_refused(polygon, z, message):
    with pytest.raises(ValueError, match=f"'rib'.*{message}"):
        extruded("rib", "b", polygon, *z)


def test_a_box_stands_where_it_is_put():
    box = box_surface("box", "b", (1.0, 2.0, 3.0), (2.0, 1.0, 0.5), math.pi / 2)
    assert box.bounds[0] == pytest.approx([0.5, 1.0, 2.75]) and box.bounds[1] == pytest.approx([1.5, 3.0, 3.25])
    assert box.volume == pytest.approx(1.0) and box.area == pytest.approx(7.0)
    with pytest.raises(ValueError, match="three positive lengths"):
        box_surface("box", "b", (0, 0, 0), (1.0, 0.0, 1.0))


def test_turned_and_joined_walls_add_up():
    """Four vanes: four times the area, and the fourfold symmetry of their vertices."""
    vane = box_surface("vane", "disc", (0.05, 0.0, 0.0), (0.03, 0.004, 0.02))
    vanes = joined("vanes", "disc", [vane.turned(k * math.pi / 2) for k in range(4)])
    assert vanes.area == pytest.approx(4 * vane.area) and vanes.volume == pytest.approx(4 * vane.volume)
    quarter = np.column_stack([-vanes.vertices[:, 1], vanes.vertices[:, 0], vanes.vertices[:, 2]])
    nearest = np.linalg.norm(quarter[:, None] - vanes.vertices[None], axis=2).min(axis=1)
    assert nearest.max() < 1e-12


def test_a_wall_is_drawn_turned_with_its_body():
    wall = box_surface("vane", "disc", (0.05, 0.01, 0.0), (0.03, 0.004, 0.02))
    points, triangles, material = triangle_surface(wall.vertices, wall.triangles, turned=0.4)
    assert points == pytest.approx(wall.turned(0.4).vertices) and np.array_equal(triangles, wall.triangles)
    centre = points[triangles].mean(axis=1)
    azimuth = np.arctan2(centre[:, 1], centre[:, 0]) - 0.4
    assert np.cos(material - azimuth) == pytest.approx(np.ones(len(material)))


# ---- files


@pytest.mark.parametrize(
    ("suffix", "options"),
    [("stl", {"binary": False}), ("stl", {"binary": True}), ("obj", {}), ("ply", {}), ("vtk", {}), ("vtu", {}),
     ("msh", {"file_format": "gmsh"})],
)  # fmt: skip
def test_meshes_come_back_from_files(tmp_path, suffix, options):
    """Area and volume of an L in millimetres, to the float32 of STL."""
    import meshio

    wall = extruded("L", "b", 1e3 * L_SHAPE, 0.0, 1e3)
    path = tmp_path / f"L.{suffix}"
    meshio.write(path, meshio.Mesh(wall.vertices, [("triangle", wall.triangles)]), **options)
    found = triangle_wall_from_file(path, "L", "rotor", scale=0.001)
    assert found.body == "rotor" and found.is_closed and len(found.vertices) == 12
    assert found.volume == pytest.approx(3.0, rel=1e-6) and found.area == pytest.approx(14.0, rel=1e-6)
    with pytest.raises(CadError, match=r"measures 2000 m.*`scale` = 0.001"):
        triangle_wall_from_file(path, "L", "rotor")
    with pytest.raises(CadError, match="remove `size`"):
        triangle_wall_from_file(path, "L", "rotor", scale=0.001, size=0.1)


def test_quadrilaterals_are_halved_and_needles_dropped(tmp_path):
    import meshio

    points = np.vstack([SQUARE, [[2, 0, 0], [3, 0, 0]]])
    cells = [("quad", [[0, 1, 2, 3]]), ("triangle", [[1, 4, 5]]), ("line", [[0, 1]])]
    meshio.write(tmp_path / "quad.vtk", meshio.Mesh(points, cells))
    wall = triangle_wall_from_file(tmp_path / "quad.vtk", "q", "b")
    assert wall.triangles.shape == (2, 3) and wall.area == pytest.approx(1.0)


def write_polygon(path, corners):
    """One face of many corners in the format of the ending."""
    import meshio

    if path.suffix == ".obj":
        rows = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in corners]
        path.write_text("\n".join([*rows, "f " + " ".join(map(str, range(1, len(corners) + 1)))]))
        return
    mesh = meshio.Mesh(corners, [("polygon", np.arange(len(corners), dtype=np.int32)[None])])
    meshio.write(path, mesh, **({"file_format": "vtk42"} if path.suffix == ".vtk" else {}))


def regular(corners, order=1):
    """Corners of a regular polygon of radius 0.1 m in a tilted plane; every `order`-th one after the other."""
    angle = 2.0 * np.pi * order * np.arange(corners) / corners
    return 0.1 * np.column_stack([np.cos(angle), 0.8 * np.sin(angle), 0.6 * np.sin(angle)])


@pytest.mark.parametrize("suffix", ["obj", "ply", "vtu", "vtk"])
@pytest.mark.parametrize("corners", [5, 24])
def test_a_convex_face_of_many_corners_keeps_its_area(tmp_path, suffix, corners):
    """The area of a regular polygon of k corners is k/2 R^2 sin(2 pi/k), in any format."""
    write_polygon(tmp_path / f"face.{suffix}", regular(corners))
    wall = triangle_wall_from_file(tmp_path / f"face.{suffix}", "face", "housing")
    assert len(wall.triangles) == corners - 2
    assert wall.area == pytest.approx(0.5 * corners * 0.01 * math.sin(2.0 * math.pi / corners), rel=1e-6)


def test_a_face_that_no_fan_covers_is_refused_with_the_number_of_such_faces(tmp_path):
    """Concave, crossing itself, warped by 1 %; a warp by the rounding of a file is none."""
    concave = np.column_stack([0.1 * L_SHAPE, np.zeros(6)])
    warped, rounded = regular(7), regular(7)
    warped[3] += 0.002 * np.array([0.0, -0.6, 0.8])
    rounded[3] += 1e-6 * np.array([0.0, -0.6, 0.8])
    for corners in (concave, np.roll(concave, 2, axis=0), regular(7, order=3), warped):
        write_polygon(tmp_path / "face.obj", corners)
        with pytest.raises(CadError, match=r"1 of its faces with \d corners are concave, warped.*export triangles"):
            triangle_wall_from_file(tmp_path / "face.obj", "face", "housing")
    write_polygon(tmp_path / "face.obj", rounded)
    assert len(triangle_wall_from_file(tmp_path / "face.obj", "face", "housing").triangles) == 5


@pytest.mark.parametrize("first", range(4))
def test_a_concave_quadrilateral_is_halved_within_itself(tmp_path, first):
    """An arrow head of 0.4 by 0.4 m with a notch to its middle has the area of two triangles, 2 (0.4 0.1)/2 m^2."""
    arrow = np.array([[0.0, 0.0, 0.0], [0.4, 0.0, 0.0], [0.1, 0.1, 0.0], [0.0, 0.4, 0.0]])
    write_polygon(tmp_path / "arrow.obj", np.roll(arrow, first, axis=0))
    assert triangle_wall_from_file(tmp_path / "arrow.obj", "a", "housing").area == pytest.approx(0.04)


def test_corners_of_an_obj_face_are_counted_as_the_format_says(tmp_path):
    """From 1, backwards from the last vertex, with textures and normals, over two lines."""
    corners = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvn 0 0 1\n"
    for faces in ("f 1/1/1 2/1/1 3/1/1 4/1/1", "f 1//1 2//1 3//1\nf -4 -2 -1", "f 1/1 2 \\\n3 4", "f 1 2 3 4 # lid"):
        (tmp_path / "square.obj").write_text(corners + faces + "\n")
        wall = triangle_wall_from_file(tmp_path / "square.obj", "square", "housing")
        assert wall.area == pytest.approx(1.0) and len(wall.triangles) == 2
    for faces, message in (
        ("f 1 2 9", "names vertex 9, and the file holds 4"),
        ("f -5 1 2", r"line 7 cannot be read \(vertex -5, after 4 vertices\)"),
        ("f 1 2 0", r"line 7 cannot be read \(vertex 0"),
        ("f 1 2 3\nsurf 0 1 0 1 1 2 3 4", r"free-form surfaces \(surf\), which is not read"),
    ):
        (tmp_path / "square.obj").write_text(corners + faces + "\n")
        with pytest.raises(CadError, match=message):
            triangle_wall_from_file(tmp_path / "square.obj", "square", "housing")


def unstructured(kinds, cells, path, **options):
    """A file of VTK cells by their numbers, over 10 points that lie in two rows."""
    import pyvista

    points = np.array([[0.1 * (k // 2), 0.1 * (k % 2), 0.0] for k in range(10)])
    rows = np.concatenate([[len(cell), *cell] for cell in cells])
    pyvista.UnstructuredGrid(rows, kinds, points).save(path, **options)
    return path


@pytest.mark.parametrize("suffix", ["vtu", "vtk"])
def test_every_flat_cell_counts_and_curved_ones_are_refused_by_name(tmp_path, suffix):
    """A strip of three triangles, a pixel and a triangle beside lines and a tetrahedron: 0.005 m2 a triangle."""
    cells = {5: [6, 7, 8], 6: [0, 1, 2, 3, 4], 8: [4, 5, 6, 7], 3: [0, 1], 4: [0, 1, 2], 10: [0, 1, 2, 4]}
    path = unstructured(list(cells), list(cells.values()), tmp_path / f"more.{suffix}")
    wall = triangle_wall_from_file(path, "cells", "housing")
    assert wall.area == pytest.approx(6 * 0.005) and np.ptp(wall.vertices[wall.triangles], axis=1).max() < 0.11
    path = unstructured([5, 22], [[6, 7, 8], [0, 1, 2, 3, 4, 5]], tmp_path / f"curved.{suffix}")
    with pytest.raises(CadError, match="quadratic triangle; export flat triangles"):
        triangle_wall_from_file(path, "cells", "housing")


def test_all_pieces_of_a_file_are_read(tmp_path):
    whole = unstructured([5, 5], [[0, 1, 2], [4, 5, 6]], tmp_path / "one.vtu", binary=False).read_text()
    begin, end = whole.index("<Piece"), whole.index("</Piece>") + len("</Piece>")
    (tmp_path / "two.vtu").write_text(whole[:end] + whole[begin:end].replace("0.1", "0.2") + whole[end:])
    wall = triangle_wall_from_file(tmp_path / "two.vtu", "wall", "housing")
    assert len(wall.triangles) == 4 and wall.area > 3.9 * 0.005


def test_a_solid_that_is_open_is_told_from_a_sheet():
    """A box without a lid, a tube, a prism without one triangle; a plate, a half tube and a closed box are as meant."""
    square = np.array([[0.0, 0.0], [0.01, 0.0], [0.01, 0.02], [0.0, 0.02]])
    box = extruded("box", "b", square, 0.0, 0.03)
    without_one = TriangleWall("box", "b", box.vertices, box.triangles[1:])
    for wall in (without_one, extruded("tube", "b", square, 0.0, 0.002, caps=False)):
        assert f"is open: {len(wall.free_edges)} edges belong to one triangle only" in openings_in_words(wall)
    angle = np.linspace(0.0, math.pi, 13)
    rows = [np.column_stack([np.cos(angle), np.sin(angle), np.full(13, z)]) for z in (0.0, 2.0)]
    strips = [[[k, k + 1, k + 13], [k + 1, k + 14, k + 13]] for k in range(12)]
    half_tube = TriangleWall("half", "b", np.vstack(rows), np.array(strips).reshape(-1, 3))
    for wall in (box, half_tube, TriangleWall("plate", "b", SQUARE, HALVES)):
        assert openings_in_words(wall) == ""


@pytest.fixture(scope="module")
def rod(tmp_path_factory):
    """A cylinder of radius 10 mm and height 30 mm as STEP and BREP."""
    from geometry.mesher import gmsh_model

    folder = tmp_path_factory.mktemp("cad")
    with gmsh_model({"General.Terminal": 0}) as gmsh:
        gmsh.model.occ.addCylinder(0, 0, 0, 0, 0, 30, 10)
        gmsh.model.occ.synchronize()
        for suffix in ("step", "brep"):
            gmsh.write(str(folder / f"rod.{suffix}"))
    return folder


@pytest.mark.parametrize(("suffix", "size"), [("step", None), ("brep", None), ("step", 0.001)])
def test_a_cad_file_is_meshed_to_its_size(rod, suffix, size):
    """Volume of the cylinder less what a polygon of 36 sides or of sides of 1 mm cuts off; sides as asked."""
    wall = triangle_wall_from_file(rod / f"rod.{suffix}", "rod", "rotor", size=size)
    sides = 36 if size is None else math.ceil(2 * math.pi * 0.01 / size)
    exact = math.pi * 0.01**2 * 0.03
    assert wall.is_closed and abs(wall.volume) < exact
    assert abs(wall.volume) == pytest.approx(exact * math.sin(2 * math.pi / sides) * sides / (2 * math.pi), rel=0.01)
    assert wall.bounds[1] == pytest.approx([0.01, 0.01, 0.03], rel=0.01)
    if size is not None:
        corner = wall.vertices[wall.triangles]
        longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max()
        assert longest < 2.0 * size


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("wall.xyz", "", r"is not a surface that is read here; give one of .stl"),
        ("wall.stl", None, "does not exist"),
        ("wall.stl", "solid\nfacet\nrubbish", "is cut off: endsolid is missing"),
        ("wall.stl", "solid a\nendsolid a\n", "holds no triangles; export it again"),
        ("wall.stl", "\0" * 84, "holds no triangles; export it again"),
        ("wall.stl", "\0" * 80 + "\x02\0\0\0" + "\0" * 60, "announces 2 triangles and holds 1; export it again"),
        ("wall.stl", "", "is neither ASCII nor binary STL; export it again"),
        ("wall.ply", "rubbish", "cannot be read as .ply"),
        ("wall.step", "rubbish", "is not a STEP file"),
        ("wall.step", "ISO-10303-21; rubbish", "cannot be read and meshed"),
        ("wall.obj", "v 0 0 0\nv 1 0 0\n", "holds no triangles"),
        ("wall.obj", "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n", "none of its triangles has an area"),
    ],
)
def test_files_that_are_no_wall_are_refused(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_text(content)
    with pytest.raises(CadError, match=message):
        triangle_wall_from_file(tmp_path / name, "wall", "rotor")


def test_a_scenes_surface_is_found_from_its_folder(tmp_path):
    import meshio
    from pydantic import ValidationError

    wall = box_surface("box", "b", (0, 0, 0), (0.1, 0.1, 0.1))
    meshio.write(tmp_path / "box.stl", meshio.Mesh(wall.vertices, [("triangle", wall.triangles)]))
    surface = SurfaceSection.model_validate({"file": "box.stl", "body": "disc"}, context={"folder": tmp_path})
    (found,) = surface_walls({"vane": surface})
    assert (found.name, found.body) == ("vane", "disc") and found.volume == pytest.approx(1e-3, rel=1e-6)
    for entries, message in (({"file": "no.stl"}, "does not exist"), ({"file": "box.stl", "body": "drum"}, "rotor")):
        with pytest.raises(ValidationError, match=message):
            SurfaceSection.model_validate(entries, context={"folder": tmp_path})
