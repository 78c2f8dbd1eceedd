"""A section or solids from a STEP file are what was drawn: names, sizes, neighbours; every wrong file is explained."""

import math

import gmsh
import numpy as np
import pytest
from step_file import rectangle, write_polygons, write_step

from geometry import Clutch
from geometry.cad_import import read_cad
from geometry.cad_meshing import cad_section, mesh_cad
from geometry.cad_parts import CadError, plain_name
from geometry.cad_shape import CadShape
from geometry.cad_solid import mesh_cad_solids, read_cad_solids
from geometry.section_import import read_section_mesh

CLUTCH = Clutch()


@pytest.fixture(scope="module")
def clutch_step(tmp_path_factory):
    return write_polygons(tmp_path_factory.mktemp("cad") / "clutch.step", CLUTCH.section_polygons())


# --- names and sizes ---------------------------------------------------------------------------------------


def area_of(polygon):
    r, z = polygon.T
    return 0.5 * abs(np.dot(r, np.roll(z, -1)) - np.dot(z, np.roll(r, -1)))


def test_names_and_areas_survive_the_file(clutch_step):
    parts = read_cad(clutch_step)
    drawn = [(name, polygon) for name, polygons in CLUTCH.section_polygons().items() for polygon in polygons]
    assert [part.region for part in parts] == [name for name, _ in drawn]
    for part, (_, polygon) in zip(parts, drawn, strict=True):
        assert part.area == pytest.approx(area_of(polygon), rel=1e-9)
        assert (part.r0, part.z0) == pytest.approx(polygon.min(axis=0), abs=1e-9)
        assert (part.r1, part.z1) == pytest.approx(polygon.max(axis=0), abs=1e-9)


@pytest.mark.parametrize(
    ("written", "region"),
    [("Cover:2", "cover"), ("cover-1", "cover"), ("cover<3>", "cover"), ("Shaft in", "shaft_in"), ("COIL", "coil"),
     ("cover_2", "cover"), ("steel 1", "steel"), ("rotor.1", "rotor")],
)  # fmt: skip
def test_counters_and_case_of_cad_programs_are_no_part_of_a_name(written, region):
    assert plain_name(written) == region


def test_names_are_translated(tmp_path):
    path = write_polygons(tmp_path / "a.step", {"Spule:1": [rectangle(0.02, 0.03, 0, 0.01)]})
    assert read_cad(path, names={"Spule": "coil"}, needed=["coil"])[0].region == "coil"
    assert read_cad(path, names={"Spule:1": "coil"}, needed=["coil"])[0].region == "coil"


def test_a_number_that_the_scene_expects_is_part_of_the_name(tmp_path):
    path = write_polygons(tmp_path / "a.step", {"Shaft-1": [rectangle(0.02, 0.03, 0, 0.01)]})
    assert read_cad(path, needed=["shaft_1"])[0].region == "shaft_1"
    assert read_cad(path, needed=["shaft"])[0].region == "shaft"


def test_either_plane_is_the_section(tmp_path):
    shapes = {"coil": [rectangle(0.02, 0.03, -0.01, 0.02)], "disc": [rectangle(0.0, 0.01, 0.0, 0.02)]}
    by_plane = [read_cad(write_polygons(tmp_path / f"{plane}.step", shapes, plane)) for plane in "zy"]
    assert [str(part) for part in by_plane[0]] == [str(part) for part in by_plane[1]]


@pytest.mark.parametrize("unit", ["m", "inch"])
def test_the_files_own_unit_is_kept(unit, tmp_path):
    """The same numbers under another unit: the STEP header alone tells."""
    path = write_polygons(tmp_path / "a.step", {"coil": [rectangle(0.002, 0.003, 0, 0.001)]})  # 2 to 3, written as mm
    text = path.read_text()
    assert "SI_UNIT(.MILLI.,.METRE.)" in text
    if unit == "m":
        path.write_text(text.replace("SI_UNIT(.MILLI.,.METRE.)", "SI_UNIT($,.METRE.)"))
        part = read_cad(path)[0]
        assert (part.r0, part.r1, part.z1) == pytest.approx((2.0, 3.0, 1.0))
    else:
        part = read_cad(path, scale=25.4)[0]
        assert (part.r0, part.r1, part.z1) == pytest.approx((2 * 25.4e-3, 3 * 25.4e-3, 25.4e-3))


# --- the mesh ----------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def clutch_mesh(clutch_step):
    return mesh_cad(clutch_step, needed=["coil", "powder"])


def test_regions_fill_their_polygons_and_the_air_the_rest(clutch_mesh):
    for name, polygons in CLUTCH.section_polygons().items():
        assert clutch_mesh.area(name) == pytest.approx(sum(map(area_of, polygons)), rel=1e-9)
    radius = 3.0 * math.hypot(CLUTCH.outer_radius, 0.5 * CLUTCH.length)
    whole = sum(clutch_mesh.area(name) for name in clutch_mesh.regions)
    assert whole == pytest.approx(0.5 * math.pi * radius**2, rel=5e-3)  # a polygon of chords
    on_axis = clutch_mesh.points[clutch_mesh.boundaries["axis"]]
    assert np.all(on_axis[..., 0] == 0.0) and clutch_mesh.boundary_length("axis") == pytest.approx(2 * radius, rel=1e-9)


def test_neighbours_share_their_edges(clutch_mesh):
    """Conforming: every edge of a triangle is one of two triangles, or of the outline."""
    edges = np.sort(clutch_mesh.triangles[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    _, uses = np.unique(edges, axis=0, return_counts=True)
    outline = sum(len(clutch_mesh.boundaries[name]) for name in ("axis", "outer"))
    assert np.count_nonzero(uses == 1) == outline and uses.max() == 2


@pytest.mark.parametrize("layers", [3, 6])
def test_the_gap_has_its_layers(layers, clutch_step):
    mesh = mesh_cad(clutch_step, gap_layers=layers)
    points = mesh.points[np.unique(mesh.triangles[mesh.regions["powder"]])]
    # rows of nodes across the rim gap, counted along its middle third
    middle = points[(np.abs(points[:, 1]) < 0.3 * CLUTCH.disc_thickness) & (points[:, 0] > CLUTCH.disc_radius - 1e-9)]
    h = np.sqrt(CLUTCH.gap * 0.6 * CLUTCH.disc_thickness / max(1, len(middle)))  # mean spacing of the nodes
    assert CLUTCH.gap / h > 0.9 * layers


def test_faces_of_the_powder_are_named_by_what_is_behind(clutch_mesh):
    half = 0.5 * CLUTCH.disc_thickness
    lengths = {
        "powder_disc": 2 * half + 2 * (CLUTCH.disc_radius - CLUTCH.seal_radius),
        "powder_rotor": CLUTCH.cavity_length - CLUTCH.ring_width,
        "powder_ring": CLUTCH.ring_width,
        "powder_cover": 2 * (CLUTCH.bore_radius - CLUTCH.seal_radius),
        "powder_seal": 2 * CLUTCH.face_gap,
    }
    for name, length in lengths.items():
        assert clutch_mesh.boundary_length(name) == pytest.approx(length, rel=1e-9)


def test_the_same_section_has_the_same_flux(clutch_step):
    """Via STEP and parametric: two meshes of one device, saturated, differ by their discretisation alone."""
    from field import AIR, AxisymmetricProblem, material
    from geometry import mesh_clutch

    laws = dict.fromkeys(("disc", "rotor", "housing"), material("steel_1010"))
    laws |= dict.fromkeys(("cover", "ring", "seal", "shaft_in", "shaft_out"), AIR)

    def flux(mesh):
        return AxisymmetricProblem(mesh, laws).solve(3000.0).flux_linkage_per_turn

    coarse = flux(mesh_cad(clutch_step, size_factor=1.5)) / flux(mesh_clutch(CLUTCH, size_factor=1.5)) - 1.0
    fine = flux(mesh_cad(clutch_step, size_factor=0.8)) / flux(mesh_clutch(CLUTCH, size_factor=0.8)) - 1.0
    assert abs(coarse) < 2e-3 and abs(fine) < 5e-4


def test_curved_edges_and_a_coil_in_free_air(tmp_path):
    """A round coil (circle of 5 mm at r = 20 mm): its area and Pappus volume, to the mesh's chords."""

    def ring(occ):
        occ.addDisk(20.0, 3.0, 0.0, 5.0, 5.0)
        return ["coil"]

    mesh = mesh_cad(write_step(tmp_path / "ring.step", ring))
    area = math.pi * 5e-3**2
    assert mesh.area("coil") == pytest.approx(area, rel=0.03) and mesh.area("coil") < area
    assert mesh.volume("coil") / mesh.area("coil") == pytest.approx(2 * math.pi * 20e-3, rel=1e-3)
    assert mesh.points[:, 1].max() + mesh.points[:, 1].min() == pytest.approx(6e-3, abs=1e-9)  # about its middle


def test_a_mesh_is_written_as_it_is(tmp_path, clutch_step):
    mesh = mesh_cad(clutch_step, out=tmp_path / "mesh.msh")
    gmsh.initialize([], readConfigFiles=False, interruptible=False)
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "mesh.msh"))
        names = {gmsh.model.getPhysicalName(2, tag) for _, tag in gmsh.model.getPhysicalGroups(2)}
        highest = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)[:, 0].max()
    finally:
        gmsh.finalize()
    assert names == set(mesh.regions) and highest == pytest.approx(mesh.points[:, 0].max())


# --- solids of revolution ----------------------------------------------------------------------------------


def solids_of_revolution(occ):
    """A stepped core and a tube about z."""
    core = occ.addCylinder(0, 0, -10, 0, 0, 20, 20)
    tube = occ.cut([(3, occ.addCylinder(0, 0, -10, 0, 0, 20, 30))], [(3, core)], removeTool=False)[0][0][1]
    assert tube == 2
    return ["core", "coil"]


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_solids_are_cut_by_the_half_plane(axis, tmp_path):
    def build(occ):
        names = solids_of_revolution(occ)
        if axis != "z":
            turn = {"x": (0, 1, 0), "y": (-1, 0, 0)}[axis]
            occ.rotate(occ.getEntities(3), 0, 0, 0, *turn, math.pi / 2)
        return names

    parts = {part.region: part for part in read_cad(write_step(tmp_path / "a.step", build), axis=axis)}
    assert parts["core"].area == pytest.approx(20e-3 * 20e-3) and parts["coil"].area == pytest.approx(10e-3 * 20e-3)
    assert (parts["coil"].r0, parts["coil"].r1) == pytest.approx((20e-3, 30e-3), abs=1e-9)
    assert (parts["coil"].z0, parts["coil"].z1) == pytest.approx((-10e-3, 10e-3), abs=1e-9)


def test_solids_and_their_section_give_one_mesh(tmp_path):
    solid = mesh_cad(write_step(tmp_path / "solid.step", solids_of_revolution))
    drawn = {"core": [rectangle(0.0, 0.02, -0.01, 0.01)], "coil": [rectangle(0.02, 0.03, -0.01, 0.01)]}
    section = mesh_cad(write_polygons(tmp_path / "section.step", drawn))
    for name in ("core", "coil", "air"):
        assert solid.area(name) == pytest.approx(section.area(name), rel=1e-9)


def test_a_slot_is_not_lost_without_a_word(tmp_path):
    def slotted(occ):
        disc, slot = occ.addCylinder(0, 0, 0, 0, 0, 10, 20), occ.addBox(-2, 10, 0, 4, 20, 10)
        occ.cut([(3, disc)], [(3, slot)])
        return ["disc"]

    with pytest.raises(CadError, match=r"no solids of revolution about z: 'disc' \(9\d"):
        read_cad(write_step(tmp_path / "a.step", slotted))


def test_a_wrong_axis_is_told(tmp_path):
    path = write_step(tmp_path / "a.step", solids_of_revolution)
    with pytest.raises(CadError, match="give the right `axis`"):
        read_cad(path, axis="x")

    def aside(occ):
        occ.addCylinder(-50, 0, 0, 0, 0, 10, 20)
        return ["disc"]

    with pytest.raises(CadError, match="does not meet the half-plane"):
        read_cad(write_step(tmp_path / "b.step", aside))


# --- solids in 3D ---------------------------------------------------------------------------------------


def test_solids_fill_their_volumes_and_curved_elements_converge(tmp_path):
    def build(occ):
        occ.addBox(-20, -20, -30, 40, 40, 20)
        occ.addSphere(0, 0, 0, 10)  # touches the box in a point
        return ["Block", "ball:1"]

    def apart(occ):
        names = build(occ)
        occ.translate([(3, 2)], 0, 0, 15)
        return names

    path = write_step(tmp_path / "a.step", apart)
    exact = {"block": 0.04 * 0.04 * 0.02, "ball": 4.0 / 3.0 * math.pi * 0.01**3}
    for solid in read_cad_solids(path):
        assert solid.volume == pytest.approx(exact[solid.region], rel=1e-6)
    errors, counts = [], []
    for size in (1.0, 0.5):
        mesh = mesh_cad_solids(path, size_factor=size)
        assert mesh.volume("block") == pytest.approx(exact["block"], rel=1e-9)  # plane faces
        assert set(mesh.regions) == {"block", "ball", "air"} and set(mesh.boundaries) == {"outer"}
        errors.append(abs(mesh.volume("ball") / exact["ball"] - 1.0))
        counts.append(len(mesh.regions["ball"]))
    # second-order faces: at least h^3 with h ~ n^(-1/3)
    assert errors[0] < 0.02 and errors[1] < errors[0] * (counts[0] / counts[1]) ** 0.9
    radius = np.linalg.norm(mesh.points[mesh.boundaries["outer"]], axis=2)
    assert np.ptp(radius) > 0.0  # about the middle of the device, not about the origin
    middle = np.array([0.0, 0.0, -2.5e-3])
    assert np.allclose(np.linalg.norm(mesh.points[mesh.boundaries["outer"]] - middle, axis=2).std(), 0.0, atol=1e-9)


def test_solids_that_overlap_or_have_no_name_are_refused(tmp_path):
    def overlapping(occ):
        occ.addBox(0, 0, 0, 20, 20, 20)
        occ.addBox(10, 0, 0, 20, 20, 20)
        return ["coil", "disc"]

    path = write_step(tmp_path / "a.step", overlapping)
    with pytest.raises(CadError, match=r"'coil' and 'disc' overlap by 4e\+03 mm3 around \(15, 10, 10\)"):
        mesh_cad_solids(path)
    with pytest.raises(CadError, match="no part named 'powder'"):
        read_cad_solids(path, needed=["powder"])
    flat = write_polygons(tmp_path / "flat.step", {"coil": [rectangle(0.02, 0.03, 0, 0.01)]})
    with pytest.raises(CadError, match="faces but no solids"):
        read_cad_solids(flat)


# --- walls of grains ---------------------------------------------------------------------------------------


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


def test_a_powder_that_is_no_set_of_rectangles_is_told(tmp_path):
    cone = np.array([(0.02, 0.0), (0.03, 0.0), (0.03, 0.01), (0.02, 0.005)])
    shape = CadShape(cad_section(write_polygons(tmp_path / "a.step", {"powder": [cone]})))
    assert "runs obliquely" in shape.faults()[0].message
    path = write_polygons(tmp_path / "b.step", {"coil": [rectangle(0.02, 0.03, 0, 0.01)]})
    assert "no part of the file is the powder" in CadShape(cad_section(path)).faults()[0].message


# --- faults ------------------------------------------------------------------------------------------------

COIL = {"coil": [rectangle(0.02, 0.03, 0.0, 0.01)]}


def test_a_missing_name_is_told_with_what_was_found(tmp_path):
    path = write_polygons(tmp_path / "a.step", {"coill": COIL["coil"], "disc": [rectangle(0, 0.01, 0, 0.01)]})
    with pytest.raises(CadError) as error:
        read_cad(path, needed=["coil"])
    text = str(error.value)
    assert "no part named 'coil'" in text and "is 'coill' the coil?" in text
    assert "coill: 100 mm2, r 20 to 30 mm, z 0 to 10 mm, taken for 'coill'" in text and "disc: 100 mm2" in text


def test_an_unknown_name_is_told(tmp_path):
    path = write_polygons(tmp_path / "a.step", {**COIL, "bolt": [rectangle(0, 0.01, 0, 0.01)]})
    with pytest.raises(CadError, match="name means nothing here: 'bolt'"):
        read_cad(path, needed=["coil"], known=["powder", "air"])


def test_parts_that_overlap_are_told(tmp_path):
    path = write_polygons(tmp_path / "a.step", {**COIL, "disc": [rectangle(0.01, 0.022, 0.0, 0.01)]})
    with pytest.raises(CadError, match=r"'coil' and 'disc' overlap by 20 mm2 around r = 21 mm, z = 5 mm; cut one"):
        cad_section(path)


def test_parts_that_nearly_touch_are_told(tmp_path):
    path = write_polygons(tmp_path / "a.step", {**COIL, "disc": [rectangle(0.01, 0.02 - 1e-8, 0.0, 0.01)]})
    with pytest.raises(CadError, match=r"leave a slit of 0.01 um near r = .* let the parts touch exactly"):
        cad_section(path)


def test_lengths_of_no_device_are_told(tmp_path):
    big = write_polygons(tmp_path / "big.step", {"coil": [1e3 * rectangle(0.02, 0.15, 0.0, 0.01)]})
    with pytest.raises(CadError, match=r"measures 130 m.*`scale` = 0.001"):
        read_cad(big)
    assert read_cad(big, scale=1e-3)[0].r1 == pytest.approx(0.15)
    small = write_polygons(tmp_path / "small.step", {"coil": [1e-3 * rectangle(0.02, 0.15, 0.0, 0.01)]})
    with pytest.raises(CadError, match=r"measures 0.00013 m.*`scale` = 1000"):
        read_cad(small)


def test_a_part_beyond_the_axis_is_told(tmp_path):
    path = write_polygons(
        tmp_path / "a.step", {"coil": [rectangle(0.02, 0.03, 0.0, 0.01), rectangle(-0.03, -0.02, 0.0, 0.01)]}
    )
    with pytest.raises(CadError, match="reach to r = -30 mm, beyond the axis; keep the half"):
        read_cad(path)


def test_faces_out_of_plane_are_told(tmp_path):
    def lifted(occ):
        occ.addRectangle(20, 0, 5, 10, 10)
        return ["coil"]

    with pytest.raises(CadError, match="neither in the plane y = 0 nor in z = 0"):
        read_cad(write_step(tmp_path / "a.step", lifted))


def test_parts_without_names_are_told(tmp_path):
    path = write_polygons(tmp_path / "a.step", {"Open CASCADE STEP translator 7.8 9": COIL["coil"]})
    with pytest.raises(CadError, match="1 of 1 parts have no name"):
        read_cad(path)


def test_parts_of_a_brep_file_are_named_by_their_number(tmp_path):
    path = write_polygons(tmp_path / "a.brep", {**COIL, "disc": [rectangle(0, 0.01, 0, 0.01)]})
    with pytest.raises(CadError, match=r"no part named 'coil'(.|\n)*part1: 100 mm2, r 20 to 30 mm"):
        read_cad(path, needed=["coil"])
    parts = read_cad(path, names={"part1": "coil", "part2": "disc"}, needed=["coil"], known=["disc"])
    assert [part.region for part in parts] == ["coil", "disc"] and parts[1].r1 == pytest.approx(0.01)


EMPTY_STEP = "ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n"
BUILT_IN = """Point(1) = {20, 0, 0}; Point(2) = {30, 0, 0}; Point(3) = {30, 10, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 1}; Curve Loop(1) = {1, 2, 3};
Plane Surface(1) = {1}; Physical Surface("coil") = {1};
"""
NOTHING = r"cannot be read|neither solids nor faces"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [("none.step", None, "does not exist"), ("a.stl", "solid", "no CAD file"), ("a.step", "solid", "not a STEP file"),
     ("a.step", EMPTY_STEP, NOTHING), ("a.brep", "nonsense", "not a BREP file"), ("a.igs", "nonsense", "not an IGES"),
     ("a.brep", "DBRep_DrawableShape nonsense", NOTHING), ("a.geo", "Point(1) = {0, 0, 0", NOTHING),
     ("a.geo", BUILT_IN, "built-in kernel")],
)  # fmt: skip
def test_files_that_are_no_cad_are_told(name, content, words, tmp_path):
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    with pytest.raises(CadError, match=words):
        read_cad(path, trust_scripts=True)
    assert not gmsh.isInitialized()


def test_a_mesh_file_is_read_back_as_it_was_written(tmp_path, clutch_step):
    mesh = mesh_cad(clutch_step, out=tmp_path / "mesh.msh")
    read = read_section_mesh(tmp_path / "mesh.msh")
    assert set(read.regions) == set(mesh.regions) and {"axis", "outer"} <= set(read.boundaries)
    for name in mesh.regions:
        assert read.volume(name) == pytest.approx(mesh.volume(name), rel=1e-9)
    for name in mesh.boundaries:
        assert read.boundary_length(name) == pytest.approx(mesh.boundary_length(name), rel=1e-9)


MESH_OF_ANOTHER_PROGRAM = """$MeshFormat
2.2 0 8
$EndMeshFormat
$PhysicalNames
2
2 1 "coil"
2 2 "air"
$EndPhysicalNames
$Nodes
5
1 0 0 0
2 20 0 0
3 20 20 0
4 0 20 0
5 10 10 0
$EndNodes
$Elements
4
1 2 2 1 1 1 2 5
2 2 2 2 2 2 3 5
3 2 2 2 2 3 4 5
4 2 2 2 2 4 1 5
$EndElements
"""


def test_a_mesh_of_another_program_gets_its_axis_and_outline(tmp_path):
    path = tmp_path / "a.msh"
    path.write_text(MESH_OF_ANOTHER_PROGRAM)
    mesh = read_section_mesh(path, scale=1e-3)
    assert mesh.area("coil") == pytest.approx(100e-6) and mesh.area("air") == pytest.approx(300e-6)
    assert mesh.boundary_length("axis") == pytest.approx(0.02) and mesh.boundary_length("outer") == pytest.approx(0.06)
    path.write_text(MESH_OF_ANOTHER_PROGRAM.replace('2 1 "coil"', '2 3 "coil"'))  # group 1 has no name
    assert read_section_mesh(path, scale=1e-3, names={"tag1": "coil"}).area("coil") == pytest.approx(100e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [("nonsense", "is not a mesh of gmsh"), ("$MeshFormat\nnonsense", r"cannot be read|no triangles"),
     (MESH_OF_ANOTHER_PROGRAM.replace("2 20 0 0", "2 -20 0 0"), "beyond the axis")],
)  # fmt: skip
def test_a_wrong_mesh_file_is_told(text, words, tmp_path):
    (tmp_path / "a.msh").write_text(text)
    with pytest.raises(CadError, match=words):
        read_section_mesh(tmp_path / "a.msh", scale=1e-3)
    with pytest.raises(CadError, match="does not exist"):
        read_section_mesh(tmp_path / "none.msh")


def test_a_geo_file_with_physical_names_is_a_section(tmp_path):
    path = tmp_path / "a.geo"
    path.write_text('SetFactory("OpenCASCADE");\nRectangle(1) = {20, 0, 0, 10, 5};\nPhysical Surface("coil") = {1};\n')
    part = read_cad(path, needed=["coil"], trust_scripts=True)[0]
    assert part.region == "coil" and part.area == pytest.approx(50e-6)
    path.write_text(
        'SetFactory("OpenCASCADE");\nRectangle(1) = {0, -10, 0, 20, 20};\nRectangle(2) = {20, -10, 0, 1, 20};\n'
        'Rectangle(3) = {21, -5, 0, 8, 10};\nPhysical Surface("disc") = {1};\nPhysical Surface("powder") = {2};\n'
        'Physical Surface("coil") = {3};\n'
    )
    mesh = mesh_cad(path, needed=["coil", "disc"], known=["powder"], trust_scripts=True)
    areas = {"disc": 400e-6, "powder": 20e-6, "coil": 80e-6}
    assert set(mesh.regions) == {*areas, "air"}
    for region, area in areas.items():
        assert mesh.area(region) == pytest.approx(area)


@pytest.mark.parametrize(
    ("options", "words"),
    [({"gap_layers": 2}, "gap_layers"), ({"size_factor": 9.0}, "size_factor"), ({"air_factor": 1.0}, "air_factor"),
     ({"axis": "w"}, "axis"), ({"scale": 0.0}, "scale")],
)  # fmt: skip
def test_options_out_of_range_are_told(options, words, tmp_path):
    with pytest.raises(ValueError, match=words):
        mesh_cad(write_polygons(tmp_path / "a.step", COIL), **options)
