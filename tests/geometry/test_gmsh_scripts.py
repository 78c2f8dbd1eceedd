"""No file from elsewhere runs a command: not by its name, not by its content, not by what lies beside it."""

from pathlib import Path

import pytest
import tomli_w
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.scene.case import load_case, read_toml
from geometry.cad_import import SUFFIXES
from geometry.cad_meshing import cad_section
from geometry.file_content import CadError
from geometry.section_import import read_section_mesh
from geometry.surface_import import CAD_SUFFIXES, MESH_SUFFIXES, triangle_wall_from_file

QUICKSTART = Path(__file__).parents[2] / "cases" / "quickstart.toml"
SECTION = """SetFactory("OpenCASCADE");
Rectangle(1) = {0, -10, 0, 20, 20}; Rectangle(2) = {20, -10, 0, 1, 20}; Rectangle(3) = {21, -5, 0, 8, 10};
Physical Surface("disc") = {1}; Physical Surface("powder") = {2}; Physical Surface("coil") = {3};
"""
MESH = """$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$PhysicalNames\n1\n2 1 "coil"\n$EndPhysicalNames
$Nodes\n3\n1 0 0 0\n2 20 0 0\n3 20 20 0\n$EndNodes\n$Elements\n1\n1 2 2 1 1 1 2 3\n$EndElements\n"""
# what each kind begins with, so that a script behind it is not taken for another by its first line
BEGINNINGS = {
    ".step": "ISO-10303-21;\n", ".stp": "ISO-10303-21;\n", ".brep": "DBRep_DrawableShape\n", ".msh": "$MeshFormat\n",
    ".iges": f"{'':72}S      1\n", ".igs": f"{'':72}S      1\n", ".stl": "solid a\n",
}  # fmt: skip


@pytest.fixture
def marker(tmp_path):
    return tmp_path / "marker"


@pytest.fixture
def script(marker):
    return f'SystemCall "touch {marker}";\n'


ANY = sorted({*SUFFIXES, *CAD_SUFFIXES, *MESH_SUFFIXES, ".txt", ".pos", ".opt", ".geo_unrolled", ""})


@pytest.mark.parametrize(("suffix", "beginning"), [*((suffix, "") for suffix in ANY), *BEGINNINGS.items()])
def test_a_script_under_any_name_does_not_run(suffix, beginning, tmp_path, marker, script):
    path = tmp_path / f"a{suffix}"
    path.write_text(beginning + script)
    with pytest.raises(CadError):
        cad_section(path)
    with pytest.raises(CadError):
        triangle_wall_from_file(path, "wall", "rotor")
    with pytest.raises(CadError):
        read_section_mesh(path)
    assert not marker.exists()


def test_options_beside_a_mesh_are_not_read(tmp_path, marker, script):
    path = tmp_path / "a.msh"
    path.write_text(MESH)
    (tmp_path / "a.msh.opt").write_text(script)
    assert read_section_mesh(path, scale=1e-3)[0].area("coil") == pytest.approx(200e-6)
    assert not marker.exists()


def test_a_script_runs_for_those_who_trust_it(tmp_path, marker, script):
    path = tmp_path / "a.geo"
    path.write_text(SECTION + script)
    with pytest.raises(CadError, match=r"is a script of gmsh, which may run any command.*--trust-scripts.*STEP"):
        cad_section(path)
    assert not marker.exists()
    assert {part.region for part in cad_section(path, trust_scripts=True).parts} == {"disc", "powder", "coil"}
    assert marker.exists()


@pytest.fixture
def scene(tmp_path, script):
    """A scene whose geometry is a script."""
    (tmp_path / "a.geo").write_text(SECTION + script)
    data = read_toml(QUICKSTART)
    data["geometry"] = {"kind": "cad", "file": "a.geo", "materials": {"disc": "steel_1010"}}
    data["particles"].pop("region", None)
    data["motion"] = {"disc": {"speed": "1000 rpm"}}  # the powder lies between disc and housing
    path = tmp_path / "scene.toml"
    path.write_text(tomli_w.dumps(data))
    return path


def test_a_scene_is_trusted_by_its_reader_only(scene, marker):
    refused = CliRunner().invoke(app, ["check", str(scene)])
    assert refused.exit_code == 2 and "geometry.file" in refused.output and "--trust-scripts" in refused.output
    reported_in_the_scene = CliRunner().invoke(app, ["check", str(scene), "--set", "geometry.trust_scripts=true"])
    assert reported_in_the_scene.exit_code == 2 and not marker.exists()
    case = load_case(scene, trust_scripts=True)
    assert marker.exists()
    assert case.with_values({"coil.current": "0.1 A"}).scene.geometry.options()["trust_scripts"]
    with pytest.raises(Exception, match="trust-scripts"):  # what was read with trust is not handed out without
        load_case(scene)


@pytest.mark.parametrize("command", ["run", "check", "sweep", "accuracy", "field", "mesh"])
def test_every_command_that_builds_a_device_asks_for_trust(command, scene, marker, tmp_path):
    source = scene
    if command == "sweep":
        source = tmp_path / "study.toml"
        source.write_text(f'[study]\ncase = "{scene}"\n[study.values]\ncoil.current = ["0.1 A"]\n')
    refused = CliRunner().invoke(app, [command, str(source)])
    assert refused.exit_code == 2 and "--trust-scripts" in refused.output, refused.output
    assert not marker.exists()
    accepted = CliRunner().invoke(app, [command, str(tmp_path / "none.toml"), "--trust-scripts"])
    assert accepted.exit_code == 2 and "check the path" in accepted.output, accepted.output
