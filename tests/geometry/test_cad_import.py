"""A section or solids from a STEP file are what was drawn: names and sizes; every wrong file is explained."""

import math

import gmsh
import pytest
from step_file import area_of, rectangle, solids_of_revolution, write_polygons, write_step

from geometry import Clutch
from geometry.cad_meshing import cad_section, mesh_cad
from geometry.cad_parts import plain_name
from geometry.file_content import CadError

CLUTCH = Clutch()


def read_cad(path, **options):
    return cad_section(path, **options).parts


def test_names_and_areas_survive_the_file(tmp_path):
    parts = read_cad(write_polygons(tmp_path / "clutch.step", CLUTCH.section_polygons()))
    drawn = [(name, polygon) for name, polygons in CLUTCH.section_polygons().items() for polygon in polygons]
    assert [part.region for part in parts] == [name for name, _ in drawn]
    for part, (_, polygon) in zip(parts, drawn, strict=True):
        assert part.size == pytest.approx(area_of(polygon), rel=1e-9)
        assert part.lower == pytest.approx(polygon.min(axis=0), abs=1e-9)
        assert part.upper == pytest.approx(polygon.max(axis=0), abs=1e-9)


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
        assert (part.lower[0], *part.upper) == pytest.approx((2.0, 3.0, 1.0))
    else:
        part = read_cad(path, scale=25.4)[0]
        assert (part.lower[0], *part.upper) == pytest.approx((2 * 25.4e-3, 3 * 25.4e-3, 25.4e-3))


@pytest.mark.parametrize("axis", ["x", "y", "z"])
def test_solids_are_cut_by_the_half_plane(axis, tmp_path):
    def build(occ):
        names = solids_of_revolution(occ)
        if axis != "z":
            turn = {"x": (0, 1, 0), "y": (-1, 0, 0)}[axis]
            occ.rotate(occ.getEntities(3), 0, 0, 0, *turn, math.pi / 2)
        return names

    parts = {part.region: part for part in read_cad(write_step(tmp_path / "a.step", build), axis=axis)}
    assert parts["core"].size == pytest.approx(20e-3 * 20e-3) and parts["coil"].size == pytest.approx(10e-3 * 20e-3)
    assert parts["coil"].lower == pytest.approx((20e-3, -10e-3), abs=1e-9)
    assert parts["coil"].upper == pytest.approx((30e-3, 10e-3), abs=1e-9)


def test_a_slot_is_not_lost_without_a_word(tmp_path):
    def slotted(occ):
        disc, slot = occ.addCylinder(0, 0, 0, 0, 0, 10, 20), occ.addBox(-2, 10, 0, 4, 20, 10)
        occ.cut([(3, disc)], [(3, slot)])
        return ["disc"]

    with pytest.raises(CadError, match=r"no solids of revolution about z: 'disc' \(9\d"):
        read_cad(write_step(tmp_path / "a.step", slotted))


def test_a_part_that_is_not_closed_is_not_lost_without_a_word(tmp_path):
    """A face that belongs to no solid is no part of a device of solids."""

    def build(occ):
        occ.addCylinder(0, 0, 0, 0, 0, 10, 20)
        occ.addRectangle(0, -5, 20, 5, 5)
        return ["disc", "rotor"]

    path = write_step(tmp_path / "open.step", build)
    with pytest.raises(CadError, match="holds 1 faces that belong to no solid, besides 1 solids"):
        read_cad(path)


def test_a_wrong_axis_is_reported(tmp_path):
    path = write_step(tmp_path / "a.step", solids_of_revolution)
    with pytest.raises(CadError, match="give the right `axis`"):
        read_cad(path, axis="x")

    def aside(occ):
        occ.addCylinder(-50, 0, 0, 0, 0, 10, 20)
        return ["disc"]

    with pytest.raises(CadError, match="does not meet the half-plane"):
        read_cad(write_step(tmp_path / "b.step", aside))


# --- faults ------------------------------------------------------------------------------------------------

COIL = {"coil": [rectangle(0.02, 0.03, 0.0, 0.01)]}


def test_a_missing_name_is_reported_with_what_was_found(tmp_path):
    path = write_polygons(tmp_path / "a.step", {"coill": COIL["coil"], "disc": [rectangle(0, 0.01, 0, 0.01)]})
    with pytest.raises(CadError) as error:
        read_cad(path, needed=["coil"])
    text = str(error.value)
    assert "no part named 'coil'" in text and "is 'coill' the coil?" in text
    assert "coill: 100 mm2, r 20 to 30 mm, z 0 to 10 mm, turned 15.71 cm3, taken for 'coill'" in text
    assert "disc: 100 mm2" in text


def test_an_unknown_name_is_reported(tmp_path):
    path = write_polygons(tmp_path / "a.step", {**COIL, "bolt": [rectangle(0, 0.01, 0, 0.01)]})
    with pytest.raises(CadError, match="name means nothing here: 'bolt'"):
        read_cad(path, needed=["coil"], known=["powder", "air"])


def test_parts_that_overlap_are_reported(tmp_path):
    path = write_polygons(tmp_path / "a.step", {**COIL, "disc": [rectangle(0.01, 0.022, 0.0, 0.01)]})
    with pytest.raises(CadError, match=r"'coil' and 'disc' overlap by 20 mm2 around r = 21 mm, z = 5 mm; cut one"):
        cad_section(path)


def test_parts_that_nearly_touch_are_reported(tmp_path):
    path = write_polygons(tmp_path / "a.step", {**COIL, "disc": [rectangle(0.01, 0.02 - 1e-8, 0.0, 0.01)]})
    with pytest.raises(CadError, match=r"leave a slit of 0.01 um near r = .* let the parts touch exactly"):
        cad_section(path)


def test_lengths_of_no_device_are_reported(tmp_path):
    big = write_polygons(tmp_path / "big.step", {"coil": [1e3 * rectangle(0.02, 0.15, 0.0, 0.01)]})
    with pytest.raises(CadError, match=r"measures 130 m.*`scale` = 0.001"):
        read_cad(big)
    assert read_cad(big, scale=1e-3)[0].upper[0] == pytest.approx(0.15)
    small = write_polygons(tmp_path / "small.step", {"coil": [1e-3 * rectangle(0.02, 0.15, 0.0, 0.01)]})
    with pytest.raises(CadError, match=r"measures 0.00013 m.*`scale` = 1000"):
        read_cad(small)


def test_a_part_beyond_the_axis_is_reported(tmp_path):
    path = write_polygons(
        tmp_path / "a.step", {"coil": [rectangle(0.02, 0.03, 0.0, 0.01), rectangle(-0.03, -0.02, 0.0, 0.01)]}
    )
    with pytest.raises(CadError, match="reach to r = -30 mm, beyond the axis; keep the half"):
        read_cad(path)


def test_faces_out_of_plane_are_reported(tmp_path):
    def lifted(occ):
        occ.addRectangle(20, 0, 5, 10, 10)
        return ["coil"]

    with pytest.raises(CadError, match="neither in the plane y = 0 nor in z = 0"):
        read_cad(write_step(tmp_path / "a.step", lifted))


def test_parts_without_names_are_reported(tmp_path):
    path = write_polygons(tmp_path / "a.step", {"Open CASCADE STEP translator 7.8 9": COIL["coil"]})
    with pytest.raises(CadError, match=r"1 of 1 parts have no name(.|\n)*`names`, as in { part1 = \"disc\" }"):
        read_cad(path)


def test_parts_without_names_are_translated_by_their_number_and_listed_with_size_and_place(tmp_path):
    boxes = {"one": (0.02, 0.03), "": (0.0, 0.01), "Ring": (0.04, 0.05)}
    shapes = {name: [rectangle(*r, 0, 0.01)] for name, r in boxes.items()}
    path = write_polygons(tmp_path / "a.step", shapes)
    volume = math.pi * 1.0**2 * 1.0  # cm3, turned
    listed = rf"1 of 3 parts(.|\n)*part2: 100 mm2, r 0 to 10 mm.*turned {volume:.4g} cm3, no name"
    with pytest.raises(CadError, match=listed):
        read_cad(path, known=["one", "ring"])
    parts = read_cad(path, names={"part2": "disc"}, known=["one", "ring", "disc"])
    assert [part.region for part in parts] == ["one", "disc", "ring"]
    clash = write_polygons(tmp_path / "b.step", {"Part2": shapes["one"], "": shapes[""]})
    with pytest.raises(CadError, match="'part2' is the name of one part and the number of another"):
        read_cad(clash)


def test_parts_of_a_brep_file_are_named_by_their_number(tmp_path):
    path = write_polygons(tmp_path / "a.brep", {**COIL, "disc": [rectangle(0, 0.01, 0, 0.01)]})
    with pytest.raises(CadError, match=r"2 of 2 parts have no name(.|\n)*part1: 100 mm2, r 20 to 30 mm"):
        read_cad(path, needed=["coil"])
    parts = read_cad(path, names={"part1": "coil", "part2": "disc"}, needed=["coil"], known=["disc"])
    assert [part.region for part in parts] == ["coil", "disc"] and parts[1].upper[0] == pytest.approx(0.01)


EMPTY_STEP = "ISO-10303-21;\nHEADER;\nENDSEC;\nDATA;\nENDSEC;\nEND-ISO-10303-21;\n"
BUILT_IN = """Point(1) = {20, 0, 0}; Point(2) = {30, 0, 0}; Point(3) = {30, 10, 0};
Line(1) = {1, 2}; Line(2) = {2, 3}; Line(3) = {3, 1}; Curve Loop(1) = {1, 2, 3};
Plane Surface(1) = {1}; Physical Surface("coil") = {1};
"""
NOTHING = r"cannot be read|neither solids nor faces"


@pytest.mark.parametrize(
    ("name", "content", "words"),
    [("none.step", None, "does not exist"), ("a.stl", "solid", "not a CAD file"),
     ("a.step", "solid", "not a STEP file"),
     ("a.step", EMPTY_STEP, NOTHING), ("a.brep", "nonsense", "not a BREP file"), ("a.igs", "nonsense", "not an IGES"),
     ("a.brep", "DBRep_DrawableShape nonsense", NOTHING), ("a.geo", "Point(1) = {0, 0, 0", NOTHING),
     ("a.geo", BUILT_IN, "built-in kernel")],
)  # fmt: skip
def test_files_that_are_no_cad_are_reported(name, content, words, tmp_path):
    path = tmp_path / name
    if content is not None:
        path.write_text(content)
    with pytest.raises(CadError, match=words):
        read_cad(path, trust_scripts=True)
    assert not gmsh.isInitialized()


def test_a_geo_file_with_physical_names_is_a_section(tmp_path):
    path = tmp_path / "a.geo"
    path.write_text('SetFactory("OpenCASCADE");\nRectangle(1) = {20, 0, 0, 10, 5};\nPhysical Surface("coil") = {1};\n')
    part = read_cad(path, needed=["coil"], trust_scripts=True)[0]
    assert part.region == "coil" and part.size == pytest.approx(50e-6)
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


# --- units -------------------------------------------------------------------------------------------------

SECTION = """SetFactory("OpenCASCADE"); k = {k};
Rectangle(7) = {{0.04*k, -0.03*k, 0, 0.02*k, 0.06*k}}; Rectangle(2) = {{0, -0.05*k, 0, 0.03*k, 0.1*k}};
Physical Surface("coil") = {{7}}; Physical Surface("disc") = {{2}};
"""
SOLIDS = """SetFactory("OpenCASCADE"); k = {k};
Cylinder(8) = {{0, 0, -0.05*k, 0, 0, 0.1*k, 0.03*k}}; Cylinder(2) = {{0, 0, -0.03*k, 0, 0, 0.06*k, 0.06*k}};
Cylinder(3) = {{0, 0, -0.03*k, 0, 0, 0.06*k, 0.04*k}};
BooleanDifference(4) = {{ Volume{{2}}; Delete; }}{{ Volume{{3}}; Delete; }};
Physical Volume("disc") = {{8}}; Physical Volume("coil") = {{4}};
"""


@pytest.mark.parametrize("millimetres", [1e3, 25.4, 10.0, 1.0, 0.1, 1e-3])
@pytest.mark.parametrize("script", [SECTION, SOLIDS])
def test_a_drawing_is_the_same_in_every_unit(script, millimetres, tmp_path):
    """Areas and corners of bar and winding, and a mesh whose axis is found."""
    path = tmp_path / "a.geo"
    path.write_text(script.format(k=1e3 / millimetres))
    parts = {part.region: part for part in read_cad(path, scale=millimetres, trust_scripts=True)}
    for region, lower, upper in (("disc", (0.0, -0.05), (0.03, 0.05)), ("coil", (0.04, -0.03), (0.06, 0.03))):
        assert parts[region].size == pytest.approx((upper[0] - lower[0]) * (upper[1] - lower[1]), rel=1e-9)
        assert (*parts[region].lower, *parts[region].upper) == pytest.approx((*lower, *upper), abs=2e-9)
    mesh = mesh_cad(path, size_factor=2.0, scale=millimetres, trust_scripts=True)
    assert len(mesh.boundaries["axis"]) and (mesh.points[mesh.boundaries["axis"], 0] == 0.0).all()
    assert mesh.area("disc") == pytest.approx(0.003) and mesh.area("coil") == pytest.approx(0.0012)


@pytest.mark.parametrize("scale", [0.1, 2.0])
def test_a_scaled_step_file_keeps_names_and_rings(scale, tmp_path):
    parts = {part.region: part for part in read_cad(write_step(tmp_path / "a.step", solids_of_revolution), scale=scale)}
    assert parts["core"].size == pytest.approx(scale**2 * 400e-6) and parts["coil"].upper[0] == scale * 30e-3


def test_solids_whose_faces_are_nurbs_are_of_revolution(tmp_path):
    """Cylinder and torus as some programs write them; a slot of a per cent in the cylinder is still found."""

    def build(occ, slot=0.0):
        solids = [(3, occ.addCylinder(0, 0, 0, 0, 0, 20, 20)), (3, occ.addTorus(0, 0, 0, 40, 5))][: 1 if slot else 2]
        if slot:
            occ.cut(solids, [(3, occ.addBox(-slot, -30, -1, 2 * slot, 20, 30))])
        occ.dilate(solids, 0, 0, 0, 1.5, 1.5, 1.5)
        return ["core", "ring"][: len(solids)]

    core, ring = read_cad(write_step(tmp_path / "a.step", build))
    assert core.size == pytest.approx(900e-6) and ring.size == pytest.approx(math.pi * 0.0075**2, rel=5e-3)
    with pytest.raises(CadError, match=r"no solids of revolution about z: 'core' \(98.8"):
        read_cad(write_step(tmp_path / "b.step", lambda occ: build(occ, slot=0.7)))


def test_groups_of_a_script_that_have_numbers_alone_are_named_by_them(tmp_path):
    path = tmp_path / "a.geo"
    boxes = 'SetFactory("OpenCASCADE");\nRectangle(1) = {0, -5, 0, 9, 10};\nRectangle(2) = {20, -5, 0, 8, 10};\n'
    path.write_text(boxes + "Physical Surface(3) = {1};\nPhysical Surface(12) = {2};\n")
    parts = read_cad(path, names={"tag12": "coil"}, needed=["coil", "tag3"], trust_scripts=True)
    assert [(part.name, part.region) for part in parts] == [("tag3", "tag3"), ("tag12", "coil")]
    path.write_text(boxes + 'Physical Surface("disc") = {1};\nPhysical Surface(12) = {1, 2};\n')
    with pytest.raises(CadError, match="one part is in the physical groups disc and tag12"):
        read_cad(path, trust_scripts=True)
