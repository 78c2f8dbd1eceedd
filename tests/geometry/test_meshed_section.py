"""A section from a finished mesh is the section that was drawn, in every format, and has its field.

The device: a disc of steel, the powder around it, a ring of steel, a coil. The mesh of another program is a grid of
triangles on straight lines, which no mesher of ours makes.
"""

from types import SimpleNamespace

import meshio
import numpy as np
import pytest
from graded_lines import graded_lines
from section_grid import section_grid
from step_file import rectangle, write_polygons

from field import AxisymmetricProblem, LinearLaw
from geometry.cad_meshing import cad_section, mesh_cad
from geometry.cad_shape import CadShape
from geometry.file_content import CadError
from geometry.mesher import initialize_gmsh
from geometry.section_import import MESH_SUFFIXES, _join, meshed_section, read_section_mesh

pytestmark = pytest.mark.physics

MM = 1e-3
# r0, r1, z0, z1 [mm]; the powder goes all around the disc, which is thinner than the gap at its rim
DISC, POWDER, COIL = (5, 20, -0.5, 0.5), (5, 22, -2, 2), (26, 32, -4, 4)
RING = (22, 24, -4, 4)
AROUND = [(5, 20, 0.5, 2), (5, 20, -2, -0.5), (20, 22, -2, 2)]
DRAWN = {"disc": [DISC], "rotor": [RING], "coil": [COIL], "powder": AROUND}
REGIONS = {"needed": ("coil", "disc", "rotor"), "known": ("powder", "air")}
STEEL = LinearLaw(200.0)
SCRIPT = 'SetFactory("OpenCASCADE");\n' + "".join(
    f"Rectangle({k}) = {{{r0}, {z0}, 0, {r1 - r0}, {z1 - z0}}};\n"
    for k, (r0, r1, z0, z1) in enumerate([DISC, RING, COIL, *AROUND], 1)
) + "".join(f'Physical Surface("{name}") = {{{tags}}};\n' for name, tags in
            {"disc": "1", "rotor": "2", "coil": "3", "powder": "4, 5, 6"}.items())  # fmt: skip


def polygons(drawn):
    return {name: [MM * rectangle(*box) for box in boxes] for name, boxes in drawn.items()}


@pytest.fixture(scope="module")
def grid():
    """The same section on straight lines, in metres."""
    r = np.unique(np.concatenate([np.linspace(0, 4, 3), np.linspace(5, 32, 55), graded_lines(1.0, (32, 33), (32, 90))]))
    upper = np.concatenate((np.linspace(0, 4, 17), graded_lines(0.5, (4, 5), (4, 90))))
    z = np.unique(np.concatenate((-upper, upper)))
    boxes = {"powder": POWDER, "disc": DISC, "rotor": RING, "coil": COIL}  # what is named last has its triangles
    return section_grid(MM * r, MM * z, {name: tuple(MM * x for x in box) for name, box in boxes.items()})


@pytest.fixture(scope="module")
def folder(tmp_path_factory, grid):
    """device.* in all formats, in millimetres but for .msh; of numbered regions the number is that in the alphabet."""
    folder = tmp_path_factory.mktemp("meshes")
    grid.write(folder / "device.msh")
    names = sorted(grid.regions)
    tags = np.empty(len(grid.triangles), dtype=np.int64)
    for tag, name in enumerate(names, 1):
        tags[grid.regions[name]] = tag
    points = np.column_stack((grid.points, np.zeros(len(grid.points)))) / MM

    def write(suffix, points=points, **data):
        mesh = meshio.Mesh(points, [("triangle", grid.triangles)], **data)
        if suffix == ".med":
            mesh.cell_tags = {-tag: [name] for tag, name in enumerate(names, 1)}
        mesh.write(folder / f"device{suffix}")

    sets = {name: [grid.regions[name]] for name in names} | {"EALL": [np.arange(len(tags))]}
    write(".inp", cell_sets=sets)
    write(".med", cell_data={"cell_tags": [-tags]})
    write(".mesh", cell_data={"medit:ref": [tags]})
    write(".vtk", cell_data={"zone": [tags], "quality": [tags + 0.5]})
    write(".vtu", points[:, [0, 2, 1]], cell_data={"region": [tags], "rank": [0 * tags]})  # in the plane y = 0
    return SimpleNamespace(path=folder, names={f"tag{tag}": name for tag, name in enumerate(names, 1)})


def read(folder, suffix):
    in_metres = suffix == ".msh"
    names = folder.names if suffix in (".mesh", ".vtk", ".vtu") else {}
    return meshed_section(folder.path / f"device{suffix}", names=names, scale=1.0 if in_metres else MM, **REGIONS)


@pytest.mark.parametrize("suffix", MESH_SUFFIXES)
def test_every_format_holds_the_same_section(suffix, folder, grid):
    mesh, section = read(folder, suffix)
    assert set(mesh.regions) == set(grid.regions) and {part.region for part in section.parts} == set(DRAWN)
    for name in grid.regions:
        assert mesh.volume(name) == pytest.approx(grid.volume(name), rel=1e-9)
    for name in ("axis", "outer"):
        assert mesh.boundary_length(name) == pytest.approx(grid.boundary_length(name), rel=1e-9)


def test_grains_see_what_was_drawn_and_not_the_mesh(folder, tmp_path):
    """Walls, boxes and gap from the mesh's edges are those from STEP; a disc thinner than the gap is no gap."""
    meshed = CadShape(read(folder, ".vtu")[1])
    drawn = CadShape(cad_section(write_polygons(tmp_path / "a.step", polygons(DRAWN)), **REGIONS))

    def corners(wall):
        ends = ((round(1e9 * r), round(1e9 * z)) for r, z in (wall.start, wall.end))
        return wall.body, *sorted(ends)

    assert {corners(wall) for wall in meshed.walls()} >= {
        corners(wall) for wall in drawn.walls() if wall.body == "disc"
    }
    for body in ("disc", "rotor", "housing"):
        areas = [sum(wall.area for wall in shape.walls() if wall.body == body) for shape in (meshed, drawn)]
        assert areas[0] == pytest.approx(areas[1])
    assert meshed.gap == pytest.approx(1.5e-3)
    volumes = [sum(box.volume() for box in shape.fill_boxes().values()) for shape in (meshed, drawn)]
    assert volumes[0] == pytest.approx(volumes[1])
    assert (meshed.coil_area, meshed.coil_mean_radius) == pytest.approx((48e-6, 29e-3))


def test_script_step_and_meshes_have_one_field(folder, tmp_path):
    """Flux linkage of one device on three meshes, to their discretisation errors; a finished mesh is not touched."""
    (tmp_path / "a.geo").write_text(SCRIPT)
    step = mesh_cad(write_polygons(tmp_path / "a.step", polygons(DRAWN)), **REGIONS)
    script = mesh_cad(tmp_path / "a.geo", trust_scripts=True, **REGIONS)
    step.write(tmp_path / "a.msh")
    again = meshed_section(tmp_path / "a.msh", **REGIONS)[0]

    def linkage(mesh):
        problem = AxisymmetricProblem(mesh, {"disc": STEEL, "rotor": STEEL})
        return problem.solve(1000.0).flux_linkage_per_turn

    exact = linkage(step)
    assert linkage(again) == pytest.approx(exact, rel=1e-12)
    assert linkage(script) == pytest.approx(exact, rel=1e-3)
    assert linkage(read(folder, ".inp")[0]) == pytest.approx(exact, rel=5e-3)


def test_a_curved_outline_becomes_chords_and_its_gap_is_the_one_across(tmp_path):
    """A ring channel of round section, 4 mm wide: no chord is longer than the mesher's edges, the gap is the width."""
    import gmsh

    initialize_gmsh()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        occ.fragment([(2, occ.addRectangle(0, -40, 0, 60, 80))], [(2, occ.addDisk(20, 0, 0, 2, 2))])
        occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [2], name="powder")
        gmsh.model.addPhysicalGroup(2, [3], name="air")
        gmsh.option.setNumber("Mesh.MeshSizeFromCurvature", 40)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(tmp_path / "round.msh"))
    finally:
        gmsh.finalize()
    section = meshed_section(tmp_path / "round.msh", scale=MM)[1]
    ends = np.array([(edge.start, edge.end) for edge in section.powder_outline])
    assert np.allclose(np.hypot(ends[..., 0] - 0.02, ends[..., 1]), 2e-3, atol=1e-7) and len(ends) >= 40
    assert section.gap == pytest.approx(4e-3, rel=0.05)


def test_a_curve_in_two_groups_is_part_of_both_boundaries(tmp_path):
    """A half disc of 10 mm whose arc is two quarters: both are one group, and the lower is another as well."""
    import gmsh

    initialize_gmsh()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        occ = gmsh.model.occ
        south, east, north, centre = (occ.addPoint(*at, 0) for at in ((0, -10), (10, 0), (0, 10), (0, 0)))
        lower, upper = occ.addCircleArc(south, centre, east), occ.addCircleArc(east, centre, north)
        axis = occ.addLine(north, south)
        surface = occ.addPlaneSurface([occ.addCurveLoop([lower, upper, axis])])
        occ.synchronize()
        for dim, name, tags in ((2, "air", [surface]), (1, "outer", [lower, upper]), (1, "lower_arc", [lower])):
            gmsh.model.addPhysicalGroup(dim, tags, name=name)
        for tag in (lower, upper):
            gmsh.model.mesh.setTransfiniteCurve(tag, 13)
        gmsh.model.mesh.setTransfiniteCurve(axis, 16)
        gmsh.model.mesh.generate(2)
        gmsh.write(str(tmp_path / "arc.msh"))
    finally:
        gmsh.finalize()
    mesh = read_section_mesh(tmp_path / "arc.msh", scale=MM)[0]
    assert {name: len(edges) for name, edges in mesh.boundaries.items()} == {"lower_arc": 12, "outer": 24, "axis": 15}
    assert np.all(mesh.points[mesh.boundaries["lower_arc"], 1] < 1e-9)


def outline_of(points, order):
    """Ends of the joined pieces, in order along the line, of edges between successive points read in an order."""
    edges = np.column_stack((np.arange(len(points) - 1), np.arange(1, len(points))))[order]
    pieces = _join(points, edges, ["disc"] * len(edges), 50e-9)
    return sorted((piece.start, piece.end) for piece in pieces)


@pytest.mark.parametrize("curve, count", [("arc", 134), ("line", 2)])
def test_the_outline_does_not_depend_on_the_order_of_the_edges(curve, count):
    """An arc of R = 25 mm with edges of 30 um, and a straight line with one edge of 5 um, rounded by 3 nm.

    The device has a radius of 50 mm, whose tolerance of 50 nm joins two edges of the arc (36 nm off their line) but not
    three (54 nm). The short edge points away from the line by 0.6 mrad, 300 nm at the end of the next edge.
    """
    if curve == "arc":
        angle = 30e-6 / 25e-3 * np.arange(269)
        points = 25e-3 * np.column_stack((np.cos(angle), np.sin(angle)))
    else:
        z = np.insert(np.linspace(0.0, 20e-3, 41), 21, 10e-3 + 5e-6)
        points = np.column_stack((np.full(len(z), 25e-3), z))
        points[21, 0] += 3e-9
    n = len(points) - 1
    ordered = outline_of(points, np.arange(n))
    assert len(ordered) == count
    random = np.random.default_rng(1)
    for order in (np.arange(n)[::-1], random.permutation(n), random.permutation(n)):
        assert outline_of(points, order) == ordered


def spoiled(grid, tmp_path, *, points=None, keep=None, regions=None):
    """The grid with moved or doubled nodes, or without some triangles, as a .vtu in metres with region names."""
    kept = np.ones(len(grid.triangles), dtype=bool) if keep is None else keep
    region = grid.region_of_element() if regions is None else regions
    triangles = grid.triangles[kept] if points is None else points[1]
    nodes = grid.points if points is None else points[0]
    names = sorted(set(region[kept]))
    mesh = meshio.Mesh(
        np.column_stack((nodes, np.zeros(len(nodes)))),
        [("triangle", triangles)],
        cell_sets={name: [np.flatnonzero(region[kept] == name)] for name in names},
    )
    mesh.write(tmp_path / "spoiled.inp")
    return tmp_path / "spoiled.inp"


def test_an_open_section_is_refused(grid, tmp_path):
    """Parts without air around, a shaft that was not meshed, parts that do not share their nodes."""
    region = grid.region_of_element()
    bare = spoiled(grid, tmp_path, keep=grid.centroid()[:, 0] < 30 * MM)
    with pytest.raises(CadError, match=r"no air at the outline of the mesh near r = 30 mm.*three times its size"):
        meshed_section(bare, **REGIONS)
    r, z = grid.centroid().T
    hole = spoiled(grid, tmp_path, keep=~((r > 2 * MM) & (r < 4 * MM) & (np.abs(z) < 4 * MM)))
    with pytest.raises(CadError, match=r"a hole or a crack near r = 3 mm"):
        meshed_section(hole, **REGIONS)
    shifted = grid.triangles.copy()
    shifted[region == "coil"] += len(grid.points)
    apart = spoiled(grid, tmp_path, points=(np.vstack((grid.points, grid.points)), shifted))
    with pytest.raises(CadError, match=r"a hole or a crack near r = 29 mm.*merge double nodes"):
        meshed_section(apart, **REGIONS)


def test_names_units_and_cells_are_refused_in_words(folder, grid, tmp_path):
    with pytest.raises(CadError, match=r"no part named 'coil', 'disc', 'rotor'.*translate(.|\n)*tag2: 48 mm2"):
        meshed_section(folder.path / "device.vtk", scale=MM, **REGIONS)
    with pytest.raises(CadError, match=r"measures 27 m.*unit of length is likely wrong; say the file's own by `unit`"):
        meshed_section(folder.path / "device.inp", **REGIONS)
    half = grid.region_of_element().astype(object)
    half[grid.regions["coil"]] = "bolt"
    path = spoiled(grid, tmp_path, regions=half)
    with pytest.raises(CadError, match=r"768 triangle\(s\) have no name.*found: air, disc"):
        meshed_section(path, needed=("disc",), known=("powder", "air", "rotor"))
    two = {"cell_data": {"a": [np.ones(1)], "b": [np.ones(1)]}}
    for cells, data, words in (
        ([("quad", [[0, 1, 2, 3]])], {}, "cells of the kind quad; mesh the section by triangles"),
        ([("triangle", [[0, 1, 2]])], {}, r"no column of whole numbers by cell \(cell data: none\)"),
        ([("triangle", [[0, 1, 2]])], two, r"several columns of whole numbers by cell \(cell data: a, b\)"),
        ([("line", [[0, 1]])], {}, "holds no triangles"),
    ):
        corners = np.array([(0.0, 0, 0), (0.01, 0, 0), (0.01, 0.01, 0), (0.0, 0.01, 0)])
        meshio.Mesh(corners, cells, **data).write(tmp_path / "a.vtu")
        with pytest.raises(CadError, match=words):
            read_section_mesh(tmp_path / "a.vtu")
    (tmp_path / "b.inp").write_text("*HEADING\n*INCLUDE, INPUT=elsewhere.inp\n")
    with pytest.raises(CadError, match=r"reads another file \(\*INCLUDE\)"):
        read_section_mesh(tmp_path / "b.inp")


@pytest.mark.parametrize(("options", "order", "kind"), [({}, 2, "Triangle 6"), ({"Mesh.RecombineAll": 1}, 1, "Quadr")])
def test_elements_of_gmsh_that_are_no_straight_triangles_are_refused(options, order, kind, tmp_path):
    from geometry.mesher import gmsh_model

    with gmsh_model({"General.Terminal": 0, **options}) as gmsh:
        surface = gmsh.model.occ.addRectangle(0.0, 0.0, 0.0, 10.0, 10.0)
        gmsh.model.occ.synchronize()
        gmsh.model.addPhysicalGroup(2, [surface], name="air")
        gmsh.model.mesh.generate(2)
        gmsh.model.mesh.setOrder(order)
        gmsh.write(str(tmp_path / "a.msh"))
    with pytest.raises(CadError, match=f"cells of the kind .*{kind}.*; mesh the section by triangles of first order"):
        read_section_mesh(tmp_path / "a.msh")
