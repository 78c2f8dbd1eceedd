"""A study file tells all its faults at once, and takes keys out of the scene as the command line does."""

from __future__ import annotations

import random
from collections import Counter
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.scene.case import case_from, load_case, read_toml
from emclutch.scene.design import read_design
from emclutch.scene.errors import SceneError
from emclutch.scene.reference import scene_reference
from emclutch.scene.study import StudySection, read_study

ROOT = Path(__file__).resolve().parents[2]
GOOD = ROOT / "tests" / "scene" / "broken" / "good.toml"


def study(folder, text, case=GOOD):
    path = folder / "study.toml"
    path.write_text(f'[study]\ncase = "{case}"\n{text}', encoding="utf-8")
    return path


def faults_of(path):
    with pytest.raises(SceneError) as refused:
        read_study(path)
    assert refused.value.source == str(path)
    return {fault.key: fault for fault in refused.value.faults}


def test_faults_of_file_values_and_points_come_together(tmp_path):
    found = faults_of(
        study(
            tmp_path,
            'titel = "x"\nwarm_start = "particles.mass"\n'
            '[study.values]\n"coil.curent" = [1]\n"coil.voltage" = "24 V"\n"contact.friction" = [0.1, 20, -1]\n'
            '[study.set]\n"time.ende" = "1 ms"\n"geometry.gap" = "3 kg"\n',
        )
    )
    assert set(found) == {
        "study.titel", "study.warm_start", "study.values.coil.curent", "study.values.coil.voltage",
        "study.set.time.ende", "geometry.gap", "contact.friction"}  # fmt: skip
    assert "may have: case, title, values, set, warm_start, sample" in found["study.titel"].message
    assert "did you mean time.end?" in found["study.set.time.ende"].message
    assert found["geometry.gap"].value == "'3 kg'" and "e.g. '1 mm'" in found["geometry.gap"].message
    assert found["contact.friction"].message.endswith("(at contact.friction = -1)")


def test_faults_of_its_scene_are_reported_once_beside_its_own(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(GOOD.read_text().replace('gap = "1 mm"', 'gap = "3 kg"', 1))
    with pytest.raises(SceneError) as refused:
        read_study(study(tmp_path, '[study.values]\n"contact.friction" = [0.1, 20]\n', "scene.toml"))
    reported = [str(fault) for fault in refused.value.faults]
    assert len(reported) == 2 and "geometry.gap" in reported[0] and reported[0].endswith("(in scene.toml)")
    assert "contact.friction = 20" in reported[1]


@pytest.mark.parametrize("text", ["study = 3", "[study]", '[study]\ncase = 3\nvalues = "x"', "[study]\nvalues = {}"])
def test_what_is_hardly_a_study_is_reported_in_words(text, tmp_path):
    path = tmp_path / "study.toml"
    path.write_text(text)
    assert faults_of(path)
    answer = CliRunner().invoke(app, ["sweep", str(path)])
    assert answer.exit_code == 2 and "Traceback" not in answer.stderr


def test_none_is_a_key_left_away(tmp_path):
    """The point is the scene without the key, bit for bit; a key that has to be there is reported as missing."""
    text = '[study.values]\n"effects.gravity" = ["off", {}]\n"particles.sector" = ["none"]\n[study.set]\n'
    found = read_study(study(tmp_path, text + '"coil.voltage" = "none"\n"time.until" = "none"\n'))
    first, second = (case for _, case in found.cases())
    away = {"particles.sector": None, "coil.voltage": None}
    assert first.scene == load_case(GOOD, {**away, "effects.gravity": None}).scene
    assert second.scene == load_case(GOOD, away).scene
    assert found.points()[0] == {"effects.gravity": "off", "particles.sector": "none"}  # as they stand in its tables
    missing = faults_of(study(tmp_path, '[study.values]\n"geometry.gap" = ["1 mm", "none"]\n'))["geometry.gap"]
    assert missing.message.startswith("is missing; a length is needed") and "= 'none')" in missing.message


def test_the_page_of_keys_has_those_of_studies():
    page = scene_reference()
    assert "## `[study]`" in page and "## `[design]`" in page
    keys = [key for key in StudySection.model_fields if key != "sample"]
    assert all(f"| `{key}` |" in page.split("## `[study]`")[1] for key in keys) and "## `[study.sample]`" in page


FIELD = {"source": "uniform", "field_strength": "1 kA/m", "direction": "axial"}
ENTRIES = {
    "field": [FIELD, {**FIELD, "direction": "radial"}, {**FIELD, "direction": "q"}, {"source": "uniform"},
              {**FIELD, "means": "macroscopic"}, {**FIELD, "order": 2}, {**FIELD, "field_strength": "3 kg"}],
    "effects.dipoles": [None, {"model": "near_field", "cutoff": 1.5}, {"model": "mutual"}],
    "effects.magnetic_force": [None, {}],
    "effects.saturation": [None, {}],
    "effects.back_reaction": [None, {}],
    "effects.wall_images": [None, {}],
    "effects.coil_circuit": [None, {}],
    "particles.sector": ["6 deg", None],
}  # fmt: skip


def test_a_broken_prescribed_field_tells_no_key_twice():
    data, chosen = read_toml(ROOT / "cases" / "quickstart.toml"), random.Random(1)
    broken = 0
    for _ in range(150):
        try:
            case_from(data, {key: chosen.choice(entries) for key, entries in ENTRIES.items()})
        except SceneError as error:
            broken += 1
            reported = Counter(fault.key for fault in error.faults)
            assert max(reported.values()) == 1, error.report()
    assert broken > 50


@pytest.mark.parametrize(("text", "key", "value", "words"), [
    ('[study.values]\n"coil.voltage" = ["1 V", "2 V", "1 V"]\n', "study.values.coil.voltage", "'1 V'", "listed twice"),
    ('[study.values]\n"coil.voltage" = ["1 V", "1000 mV"]\n', "study.values.coil.voltage", "'1000 mV'",
     "listed twice, as '1 V' is the same"),
    ('[study.values]\n"scene.seed" = [1, 2, 1]\n', "study.values.scene.seed", "1", "list each value once"),
    ('[study.values]\n"contact.friction" = [0.1, 0.2]\n[study.set]\n"contact.friction" = 0.3\n',
     "study.set.contact.friction", "0.3", "is in [study.values] too"),
    ('[study.values]\n"contact.friction" = [0.1]\n[study.values.contact]\nfriction = [0.2]\n', "study.values", None,
     "names contact.friction twice"),
])  # fmt: skip
def test_what_is_given_twice_is_refused_with_its_remedy(text, key, value, words, tmp_path):
    fault = faults_of(study(tmp_path, text))[key]
    assert words in fault.message and value in (None, fault.value)


def test_values_that_differ_are_no_repetition(tmp_path):
    read = read_study(study(tmp_path, '[study.values]\n"coil.voltage" = ["1 V", "1.1 V"]\n"scene.seed" = [1, 2]\n'))
    assert len(read.points()) == 4


@pytest.mark.parametrize("command", [
    ["check", str(GOOD), "--set", "contact.friction=0.2", "--set", "contact.friction=0.3"],
    ["run", str(GOOD), "--set", "contact.friction=0.2", "--set", "contact.friction=none"],
    ["design", str(GOOD), "--vary", "geometry.gap=0.5 mm:2 mm", "--target", "torque 1 N m", "--set",
     "geometry.gap=1 mm"],
])  # fmt: skip
def test_a_key_that_is_set_a_second_time_is_refused(command):
    answer = CliRunner().invoke(app, command)
    assert answer.exit_code == 2 and "--set" in answer.stderr
    assert "a second time; give it once" in answer.stderr or "is the key of --vary" in answer.stderr


def test_a_design_does_not_set_what_it_varies(tmp_path):
    file = tmp_path / "design.toml"
    file.write_text(f'[design]\ncase = "{GOOD}"\nvary = "geometry.gap"\nbetween = ["0.5 mm", "2 mm"]\n'
                    'target = "torque 1 N m"\n[design.set]\n"geometry.gap" = "1 mm"\n')  # fmt: skip
    with pytest.raises(SceneError, match=r"design\.set\.geometry\.gap = '1 mm' is the key of design\.vary"):
        read_design(file)


def test_warnings_of_its_points_are_those_of_a_study(tmp_path):
    """One that all points have is told once; one of some with the values of the first of them."""
    read = read_study(study(tmp_path, '[study.values]\n"contact.friction" = [0.3, 4.0, 5.0]\n[study.set]\n'
                                      '"contact.restitution" = 0.99\n'))  # fmt: skip
    restitution, four, five = read.warnings()
    assert restitution.startswith("contact.restitution = 0.99 is outside") and "(at " not in restitution
    assert four.endswith("(at contact.friction = 4.0)") and five.endswith("(at contact.friction = 5.0)")
