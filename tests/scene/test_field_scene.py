"""A scene without [particles] is of the field alone: check, field and mesh take it, what moves grains refuses it."""

import json
from pathlib import Path

import pandas
import pytest
import tomli_w
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.device_model.device import build_device, solved_coil
from emclutch.scene.case import case_from, load_case, read_toml

QUICKSTART = Path(__file__).parents[2] / "cases" / "quickstart.toml"
OF_GRAINS = ("particles", "contact", "motion", "effects", "time")
COARSE = {"field.size_factor": 2.0}


@pytest.fixture(scope="module")
def alone(tmp_path_factory):
    """The quickstart without its grains, as a file."""
    data = {name: section for name, section in read_toml(QUICKSTART).items() if name not in OF_GRAINS}
    path = tmp_path_factory.mktemp("alone") / "drum.toml"
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    return path


def invoke(*arguments):
    return CliRunner().invoke(app, [str(argument) for argument in arguments], env={"COLUMNS": "160"})


def test_it_stands_alone_and_comes_back_from_its_resolved_form(alone):
    case = load_case(alone)
    assert case.scene.particles is None and case.scene.time is None and not case.warnings
    assert case_from(case.resolved()).scene == case.scene


def test_its_field_is_that_of_the_device_with_grains_that_do_not_answer(alone):
    """Bit for bit: grains without back_reaction are no part of mesh, materials or solve."""
    with_grains = load_case(QUICKSTART, COARSE | {"effects.back_reaction": None}).scene
    coils = solved_coil(load_case(alone, COARSE).scene), build_device(with_grains).coil
    ours, theirs = (coil.solve_at_peak(None) for coil in coils)
    assert ours.flux_linkage_per_turn == theirs.flux_linkage_per_turn > 0.0


def test_check_field_and_mesh_take_it(alone, tmp_path):
    coarse = ("--set", "field.size_factor=2")
    reported = invoke("check", alone, *coarse, "--json")
    assert reported.exit_code == 0, reported.output
    plan = json.loads(reported.output)["plan"]
    assert "without [particles]" in plan["grains"] and "inductance" in plan["field"] and "force on the disc" in plan
    assert invoke("check", alone, *coarse).exit_code == 0
    assert invoke("mesh", alone, *coarse, "--out", tmp_path / "mesh").exit_code == 0
    solved = invoke("field", alone, *coarse, "--out", tmp_path / "field")
    assert solved.exit_code == 0, solved.output
    for word in ("linkage [Wb]", "L [H]", "energy [J]", "axial force on"):
        assert word in solved.output
    row = pandas.read_csv(tmp_path / "field" / "field.csv").iloc[-1]
    summary = json.loads((tmp_path / "field" / "field.json").read_text())
    force = summary["at_last_current"]["axial_force"]["disc"]["maxwell_stress"]
    for body in ("disc", "rotor"):  # check tells the error that field finds
        found = summary["at_last_current"]["axial_force"][body]
        assert plan[f"force on the {body}"].startswith(
            f"{found['maxwell_stress']:.4g} ± {found['error_estimate']:.2g} N"
        )
        smaller = abs(found["maxwell_stress"]) <= found["error_estimate"]
        assert smaller == ("smaller than its error" in plan[f"force on the {body}"])
    assert summary["at_last_current"]["axial_force"]["coil (J x B)"]["error"] == "not known"
    assert row["axial_force_disc"] == pytest.approx(force, rel=1e-9) and summary["units"]["axial_force_disc"] == "N"


@pytest.mark.parametrize("command", ["run", "accuracy"])
def test_what_moves_grains_refuses_it(command, alone, tmp_path):
    result = invoke(command, alone, "--out", tmp_path / "new")
    assert result.exit_code == 2 and not (tmp_path / "new").exists()
    assert "particles is missing" in result.output and "emclutch field" in result.output
    assert result.output.startswith(str(alone))


def test_a_study_of_it_is_refused_and_so_is_a_run_from_python(alone, tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(f'[study]\ncase = "{alone}"\nvalues = {{ "coil.current" = [0.5, 1.0] }}\n', encoding="utf-8")
    result = invoke("sweep", study, "--out", tmp_path / "new")
    assert result.exit_code == 2 and result.output.count("particles is missing") == 1
    with pytest.raises(emclutch.SceneError, match="particles is missing"):
        emclutch.run(load_case(alone), out=tmp_path / "new")


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"effects.dipoles": {}, "effects.gravity": {}}, "required by [effects.gravity], [effects.dipoles]"),
        ({"field": None}, "needs [field] source = 'coil'"),
        ({"field": {"source": "uniform", "field_strength": 1e5, "direction": "axial"}}, "field of a coil alone"),
    ],
)
def test_what_is_neither_a_run_nor_a_field_is_reported_once(values, words, alone):
    with pytest.raises(emclutch.SceneError) as refused:
        load_case(alone, values)
    assert words in str(refused.value) and len(refused.value.faults) == 1, refused.value


def test_sections_of_a_run_are_reported_to_be_idle(alone):
    case = load_case(alone, {"motion.rotor": {"speed": "100 rpm"}, "time.end": "1 ms"})
    (reported,) = case.warnings
    assert reported.startswith("without [particles]") and reported.endswith("does not use [motion], [time]")
