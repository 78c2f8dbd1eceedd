"""The mesh of a CAD file fills what was drawn, neighbours share their edges; a mesh file is read as it was written."""

import math

import gmsh
import numpy as np
import pytest
from step_file import area_of, rectangle, solids_of_revolution, write_polygons, write_step

from geometry import Clutch
from geometry.cad_import import open_solids
from geometry.cad_meshing import mesh_cad
from geometry.cad_parts import CadFile
from geometry.cad_solid import mesh_cad_solids
from geometry.file_content import CadError
from geometry.mesher import initialize_gmsh
from geometry.meshing_3d import SOLID_OPTIONS
from geometry.section_import import read_section_mesh

CLUTCH = Clutch()


@pytest.fixture(scope="module")
def clutch_step(tmp_path_factory):
    return write_polygons(tmp_path_factory.mktemp("cad") / "clutch.step", CLUTCH.section_polygons())


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
    mesh = mesh_cad(clutch_step)
    mesh.write(tmp_path / "mesh.msh")
    initialize_gmsh()
    try:
        gmsh.option.setNumber("General.Terminal", 0)
        gmsh.open(str(tmp_path / "mesh.msh"))
        names = {gmsh.model.getPhysicalName(2, tag) for _, tag in gmsh.model.getPhysicalGroups(2)}
        highest = gmsh.model.mesh.getNodes()[1].reshape(-1, 3)[:, 0].max()
    finally:
        gmsh.finalize()
    assert names == set(mesh.regions) and highest == pytest.approx(mesh.points[:, 0].max())


def test_solids_and_their_section_give_one_mesh(tmp_path):
    solid = mesh_cad(write_step(tmp_path / "solid.step", solids_of_revolution))
    drawn = {"core": [rectangle(0.0, 0.02, -0.01, 0.01)], "coil": [rectangle(0.02, 0.03, -0.01, 0.01)]}
    section = mesh_cad(write_polygons(tmp_path / "section.step", drawn))
    for name in ("core", "coil", "air"):
        assert solid.area(name) == pytest.approx(section.area(name), rel=1e-9)


# --- solids in 3D ---------------------------------------------------------------------------------------


def read_cad_solids(path, **options):
    with open_solids(CadFile(path, **options), SOLID_OPTIONS) as (_, solids, _):
        return solids


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
        assert solid.size == pytest.approx(exact[solid.region], rel=1e-6)
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


def test_a_mesh_file_is_read_back_as_it_was_written(tmp_path, clutch_step):
    mesh = mesh_cad(clutch_step)
    mesh.write(tmp_path / "mesh.msh")
    read, _ = read_section_mesh(tmp_path / "mesh.msh")
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
    mesh, _ = read_section_mesh(path, scale=1e-3)
    assert mesh.area("coil") == pytest.approx(100e-6) and mesh.area("air") == pytest.approx(300e-6)
    assert mesh.boundary_length("axis") == pytest.approx(0.02) and mesh.boundary_length("outer") == pytest.approx(0.06)
    path.write_text(MESH_OF_ANOTHER_PROGRAM.replace('2 1 "coil"', '2 3 "coil"'))  # group 1 has no name
    assert read_section_mesh(path, scale=1e-3, names={"tag1": "coil"})[0].area("coil") == pytest.approx(100e-6)


@pytest.mark.parametrize(
    ("text", "words"),
    [("nonsense", "is not a mesh of gmsh"), ("$MeshFormat\nnonsense", r"cannot be read|no triangles"),
     (MESH_OF_ANOTHER_PROGRAM.replace("2 20 0 0", "2 -20 0 0"), "beyond the axis")],
)  # fmt: skip
def test_a_wrong_mesh_file_is_reported(text, words, tmp_path):
    (tmp_path / "a.msh").write_text(text)
    with pytest.raises(CadError, match=words):
        read_section_mesh(tmp_path / "a.msh", scale=1e-3)
    with pytest.raises(CadError, match="does not exist"):
        read_section_mesh(tmp_path / "none.msh")


@pytest.mark.parametrize(
    ("options", "words"),
    [({"gap_layers": 2}, "gap_layers"), ({"size_factor": 9.0}, "size_factor"), ({"air_factor": 1.0}, "air_factor"),
     ({"axis": "w"}, "axis"), ({"scale": 0.0}, "scale")],
)  # fmt: skip
def test_options_out_of_range_are_reported(options, words, tmp_path):
    with pytest.raises(ValueError, match=words):
        mesh_cad(write_polygons(tmp_path / "a.step", {"coil": [rectangle(0.02, 0.03, 0.0, 0.01)]}), **options)
