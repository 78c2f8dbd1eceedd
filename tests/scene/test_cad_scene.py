"""A scene of kind `cad`: checked, meshed and run like the parametric one; what is wrong with the file has its key."""

from __future__ import annotations

from pathlib import Path

import meshio
import numpy as np
import pytest
import tomli_w
from step_file import rectangle, write_polygons
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.device_model.device import build_device, mesh_of
from emclutch.scene.case import case_from, load_case, read_toml
from emclutch.scene.input_files import input_files
from geometry.section_import import read_section_mesh

QUICKSTART = Path(__file__).resolve().parents[2] / "cases" / "quickstart.toml"
MATERIALS = {
    "disc": "steel_1010", "rotor": "Steel-1010", "housing": "steel_1010", "cover": "aluminum", "ring": "stainless_304",
    "seal": "aluminium", "shaft_in": "stainless_304", "shaft_out": "stainless_304",
}  # fmt: skip


@pytest.fixture(scope="module")
def drawn(tmp_path_factory):
    """A folder with the quickstart's section as device.step, and the scene as nested dictionaries."""
    folder = tmp_path_factory.mktemp("cad")
    shape = load_case(QUICKSTART).scene.shape()
    write_polygons(folder / "device.step", shape.section_polygons())
    data = read_toml(QUICKSTART)
    data["geometry"] = {"kind": "cad", "file": "device.step", "materials": MATERIALS}
    data["particles"].pop("region", None)
    return folder, data


def written(folder, data, name="scene.toml", **geometry):
    path = folder / name
    path.write_text(tomli_w.dumps({**data, "geometry": {**data["geometry"], **geometry}}), encoding="utf-8")
    return path


@pytest.fixture(scope="module")
def drawn_poles(drawn):
    """The same with powder between the poles alone; the rest of the cavity is air."""
    folder, data = drawn
    device = build_device(load_case(QUICKSTART).scene)
    boxes = [rectangle(box.r0, box.r1, box.z0, box.z1) for box in device.filled_boxes]
    write_polygons(folder / "poles.step", {**device.shape.section_polygons(), "powder": boxes})
    return folder, {**data, "geometry": {**data["geometry"], "file": "poles.step"}}


@pytest.mark.physics
def test_the_law_gives_a_drawn_device_the_torque_of_its_kind(drawn, drawn_poles):
    """Two meshes of one device; its ends are walls, so powder that nearly jams does not leave the poles."""
    loose, full = ({"particles.solid_fraction": fill} for fill in (0.3, 0.45))
    poles, whole = written(*drawn_poles, name="poles.toml"), written(*drawn)
    cad, parametric, jammed, spilt, cavity = (
        emclutch.check(load_case(path, fill)).expected
        for path, fill in ((poles, loose), (QUICKSTART, loose), (poles, full), (QUICKSTART, full), (whole, loose))
    )  # fmt: skip
    assert not cad.real.is_guess and cad.law == parametric.law
    assert cad.real.mean == pytest.approx(parametric.real.mean, rel=0.02)
    assert cad.real.high / cad.real.mean == pytest.approx(parametric.real.high / parametric.real.mean, rel=0.02)
    assert jammed.real.mean > 1.05 * spilt.real.mean
    assert cavity.real.is_guess and "of the powder lies between steel faces of two bodies" in cavity.law


def test_a_device_from_cad_is_the_parametric_one(drawn):
    cad = load_case(written(*drawn))
    parametric = load_case(QUICKSTART).with_values({"particles.region": "cavity"})
    assert case_from(cad.resolved()).scene == cad.scene and not cad.warnings
    ours, theirs = build_device(cad.scene), build_device(parametric.scene)
    assert ours.coil.turns == pytest.approx(theirs.coil.turns)
    assert ours.fill.volume == pytest.approx(theirs.fill.volume, rel=1e-9) and ours.fill.count == theirs.fill.count
    for name in ("shear_radius", "shear_gap", "largest_radius"):
        assert getattr(ours, name) == pytest.approx(getattr(theirs, name))
    fields = [device.coil.solve_at_peak(device.coil.uniform_fill(0.3)) for device in (ours, theirs)]
    flux = [field.flux_linkage_per_turn for field in fields]
    assert flux[0] == pytest.approx(flux[1], rel=3e-3)  # two meshes
    line = theirs.shape.gap_midline(50)[5:-5]
    B = [np.linalg.norm(field.B_along(line), axis=1) for field in fields]
    # where the gap's field varies over its own width, near the ring, two meshes differ most
    assert np.allclose(*B, rtol=0.03, atol=0.01)


def test_faces_of_steel_mirror_dipoles_and_others_do_not(drawn):
    folder, data = drawn
    own = {"light": {"law": "linear", "relative_permeability": 1.02}}
    given = {**data, "materials": own}
    scene = load_case(written(folder, given, "own.toml", materials={**MATERIALS, "ring": "light"})).scene
    steel = {wall.name.rsplit("_", 1)[0]: wall.magnetic for wall in scene.shape().walls()}
    assert steel == {"disc": True, "rotor": True, "ring": False, "cover": False, "seal": False}


def test_it_runs_with_grains(drawn, tmp_path):
    folder, data = drawn
    toy = {"time.end": "0.01 ms", "output.snapshots": 2}
    case = load_case(written(folder, data)).with_values(toy)
    result = emclutch.run(case, out=tmp_path / "run")
    assert result.summary["gap_flux_density"] > 0.1 and (result.folder.path / "section.png").stat().st_size > 10_000
    assert "torque_disc" in result.history and np.isfinite(result.history["torque_disc"]).all()
    drawing = folder / "device.step"
    before = drawing.read_bytes()
    drawing.write_bytes(before + b"\n")
    try:
        with pytest.raises(emclutch.OutputError, match=r"another content of geometry\.file = .*device\.step"):
            emclutch.run(case, out=tmp_path / "run", resume=True)
    finally:
        drawing.write_bytes(before)


def test_its_mesh_is_drawn(drawn, tmp_path):
    result = CliRunner().invoke(app, ["mesh", str(written(*drawn)), "--out", str(tmp_path / "mesh")])
    assert result.exit_code == 0, result.output
    assert {path.name for path in (tmp_path / "mesh").iterdir()} == {"mesh.msh", "mesh.png"}


# name: (keys of [geometry] that are changed, key in the message, fragments)
FAULTS = {
    "no file": ({"file": "none.step"}, "geometry.file = 'none.step'", ("does not exist; check the path",)),
    "not CAD": ({"file": "scene.toml"}, "geometry.file", ("not a CAD file", ".step")),
    "a material too many": ({"materials": {**MATERIALS, "yoke": "steel_1010"}}, "geometry.file",
                            ("no part named 'yoke'", "found in the file:", "taken for 'rotor'")),
    "a material too few": ({"materials": {"disc": "steel_1010"}}, "geometry.file",
                           ("name means nothing here: 'cover', 'housing'", "give each a material")),
    "unit": ({"scale": 1000.0}, "geometry.file", ("unit of length is likely wrong", "geometry.scale = 0.001")),
    "unknown material": ({"materials": {**MATERIALS, "disc": "steel_10100"}}, "geometry.materials.disc",
                         ("did you mean 'steel_1010'?",)),
    "unknown body": ({"bodies": {"cover": "rotr"}}, "geometry.bodies.cover", ("did you mean 'rotor'?",)),
    "misspelt key": ({"filee": "a"}, "geometry.filee", ("did you mean 'file'?",)),
    "axis": ({"axis": "w"}, "geometry.axis", ("available: x, y, z",)),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_faulty_cad_scene_is_refused(name, drawn):
    geometry, key, fragments = FAULTS[name]
    result = CliRunner().invoke(app, ["check", str(written(*drawn, "faulty.toml", **geometry))])
    assert result.exit_code == 2 and "Traceback" not in result.output, result.output
    assert key in result.output
    for fragment in fragments:
        assert fragment in result.output, result.output


def test_a_file_without_powder_holds_no_grains(drawn):
    folder, data = drawn
    write_polygons(folder / "coil.step", {"coil": [rectangle(0.02, 0.03, 0.0, 0.01)]})
    path = written(folder, data, "empty.toml", file="coil.step", materials={})
    result = CliRunner().invoke(app, ["check", str(path)])
    assert result.exit_code == 2 and "draw the space of the grains as a part of its own" in result.output


def test_grains_larger_than_the_gap_are_refused(drawn):
    result = CliRunner().invoke(app, ["check", str(written(*drawn)), "--set", "particles.diameter=3 mm"])
    assert result.exit_code == 2 and "no grain fits" in result.output


# --- a finished mesh instead of a drawing --------------------------------------------------------------------


@pytest.fixture(scope="module")
def meshed(drawn):
    """The scene with its section's mesh, in millimetres and with tags for regions; back_reaction needs a finer one."""
    folder, data = drawn
    data = {**data, "effects": {name: table for name, table in data["effects"].items() if name != "back_reaction"}}
    mesh = mesh_of(load_case(written(folder, data)).with_values({"field.size_factor": 1.5}).scene)
    names = sorted(mesh.regions)
    tags = np.empty(len(mesh.triangles), dtype=np.int64)
    for tag, name in enumerate(names, 1):
        tags[mesh.regions[name]] = tag
    points = 1e3 * np.column_stack((mesh.points, np.zeros(len(mesh.points))))
    meshio.Mesh(points, [("triangle", mesh.triangles)], cell_data={"region": [tags]}).write(folder / "device.vtu")
    geometry = {"kind": "cad", "file": "device.vtu", "unit": "mm", "materials": MATERIALS,
                "names": {f"tag{tag}": name for tag, name in enumerate(names, 1)}}  # fmt: skip
    return folder, {**data, "geometry": geometry}, mesh


def test_a_finished_mesh_is_taken_as_it_is(meshed, tmp_path):
    folder, data, mesh = meshed
    case = load_case(written(folder, data))
    assert case_from(case.resolved()).scene == case.scene and input_files(case.scene)["geometry.file"].suffix == ".vtu"
    device = build_device(case.scene)
    drawing = {**data, "geometry": {"kind": "cad", "file": "device.step", "materials": MATERIALS}}
    theirs = build_device(
        load_case(written(folder, drawing, "drawn.toml")).with_values({"field.size_factor": 1.5}).scene
    )
    assert device.fill == theirs.fill and device.shear_gap == pytest.approx(theirs.shear_gap)
    ours, expected = (each.coil.solve_at_peak(None).flux_linkage_per_turn for each in (device, theirs))
    assert ours == pytest.approx(expected, rel=1e-9)
    written_out = CliRunner().invoke(app, ["mesh", str(written(folder, data)), "--out", str(tmp_path / "mesh")])
    assert written_out.exit_code == 0, written_out.output
    again, _ = read_section_mesh(tmp_path / "mesh" / "mesh.msh")
    assert again.volume("powder") == pytest.approx(mesh.volume("powder"))


# name: (changes of the scene, fragments)
FAULTS_OF_A_MESH = {
    "no unit": ({"geometry": {"unit": None}}, ("unit of length is likely wrong; say the file's own by geometry.unit",)),
    "no names": ({"geometry": {"names": {}}}, ("no part named 'coil'", "tag2: 36 mm2")),
    "unknown unit": ({"geometry": {"unit": "foot"}}, ("geometry.unit = 'foot'", "available: m, cm, mm, um, inch")),
    "axis": ({"geometry": {"axis": "x"}}, ("geometry.axis = 'x' is for CAD files, and device.vtu is a mesh",)),
    "air": ({"geometry": {"air_factor": 4.0}}, ("geometry.air_factor = 4.0 is for CAD files",)),
    "layers": ({"field": {"gap_layers": 6}}, ("field.gap_layers = 6 sizes a mesh that is made here",)),
    "size": ({"field": {"size_factor": 0.5}}, ("field.size_factor = 0.5 sizes a mesh that is made here",)),
    "coarse": ({"effects": {"back_reaction": {}}}, ("is too coarse for effects.back_reaction", "0.208 mm")),
    "unit of STEP": ({"geometry": {"file": "device.step", "names": {}}}, ("geometry.unit = 'mm' is not for .step",)),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS_OF_A_MESH)
def test_a_faulty_scene_with_a_mesh_is_refused(name, meshed):
    folder, data, _ = meshed
    changes, fragments = FAULTS_OF_A_MESH[name]
    data = {**data, **{section: {**data[section], **entries} for section, entries in changes.items()}}
    data["geometry"] = {key: entry for key, entry in data["geometry"].items() if entry is not None}
    result = CliRunner().invoke(app, ["check", str(written(folder, data, "faulty.toml"))])
    assert result.exit_code == 2 and "Traceback" not in result.output, result.output
    for fragment in fragments:
        assert fragment in result.output, result.output


def test_a_mesh_with_too_little_air_is_refused(meshed):
    """Air that ends a hair beyond the device: the multipoles of an open boundary do not converge there."""
    folder, data, mesh = meshed
    device = np.concatenate([elements for name, elements in mesh.regions.items() if name != "air"])
    reach = np.hypot(*mesh.points[mesh.triangles[device]].reshape(-1, 2).T).max()
    region = mesh.region_of_element()
    inside = np.hypot(*mesh.points[mesh.triangles].transpose(2, 0, 1)).max(axis=1) < 1.2 * reach
    sets = {name: [np.flatnonzero(region[inside] == name)] for name in mesh.regions}
    points = 1e3 * np.column_stack((mesh.points, np.zeros(len(mesh.points))))
    meshio.Mesh(points, [("triangle", mesh.triangles[inside])], cell_sets=sets).write(folder / "near.inp")
    path = written(folder, data, "near.toml", file="near.inp", names={})
    result = CliRunner().invoke(app, ["check", str(path)])
    assert result.exit_code == 2 and "geometry.file = 'near.inp' has too little air" in result.output, result.output
