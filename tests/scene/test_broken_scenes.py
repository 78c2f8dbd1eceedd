"""Bad input: exit code 2, a message with the key and the remedy, no traceback, and nothing is written."""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

import numba
import pytest
import tomli_w
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.scene.case import load_case, read_toml

BROKEN = Path(__file__).parent / "broken"
GOOD = BROKEN / "good.toml"
BOX = {"kind": "box", "size": ["10 mm", "10 mm", "10 mm"]}
UNIFORM = {"source": "uniform", "field_strength": "100 kA/m", "direction": "axial"}

# name: (values set in the good scene, None removes a key; key in the message; fragment of the remedy)
EDITS = {
    "unknown key": ({"geometry.gpa": "1 mm"}, "geometry.gpa", "did you mean 'gap'?"),
    "unknown section": ({"partikles": {}}, "partikles", "did you mean 'particles'?"),
    "key of another section": ({"geometry.diameter": "1 mm"}, "geometry.diameter",
        "did you mean particles.diameter?"),
    "missing key": ({"geometry.gap": None}, "geometry.gap", "a length is needed, e.g. gap = '1 mm'"),
    "a start-up known to be over, but not when": ({"time.exclude_drift": False}, "time.exclude_drift",
        "needs time.average_from"),
    "a scatter without its freedom": ({"accuracy.replica_scatter": "2 %"}, "accuracy.replica_scatter = '2 %'",
        "needs accuracy.replica_scatter_freedom as well"),
    "a scatter of no steady torque": ({"accuracy.replica_scatter": "2 %", "accuracy.replica_scatter_freedom": 16},
        "accuracy.replica_scatter", "needs a steady torque, which this scene does not have; remove it"),
    "missing section": ({"time": None}, "time", "add the section [time]"),
    "a section that is a number": ({"particles": 3}, "particles", "write [particles]"),
    "wrong dimension": ({"geometry.gap": "3 kg"}, "geometry.gap = '3 kg'",
        "is a mass; a length is needed, e.g. '1 mm'"),
    "unknown unit": ({"geometry.gap": "1 mmm"}, "geometry.gap", "did you mean 'mm'? a length is needed"),
    "a brake": ({"geometry.kind": "brake"}, "geometry.kind", "a brake is kind 'clutch' (or 'drum') with [motion.disc]"),
    "a disk": ({"geometry.kind": "disk"}, "geometry.kind", "a disc between the rotor's faces is kind 'clutch'"),
    "a strain behind its number": ({"time.end": "12 strain"}, "time.end", "is not a shear strain; write 'strain 12'"),
    "diameters before their number": ({"particles.sector": "Diameters 6"}, "particles.sector", "write '6 diameters'"),
    "unit with a wrong letter": ({"geometry.gap": "1 mn"}, "geometry.gap", "did you mean 'mm'?"),
    "no unit in a text": ({"geometry.gap": "1"}, "geometry.gap", "has no unit"),
    "frequency as speed": ({"motion.rotor.speed": "50 Hz"}, "motion.rotor.speed", "e.g. '100 rpm'"),
    "not a number": ({"particles.diameter": float("nan")}, "particles.diameter", "is not finite"),
    "negative size": ({"geometry.gap": "-1 mm"}, "geometry.gap = '-1 mm'", "allowed: > 0 m"),
    "truth value as a number": ({"coil.current": True}, "coil.current = true", "a current is needed"),
    "restitution of nothing": ({"contact.restitution": 0}, "contact.restitution", "allowed: > 0, <= 1"),
    "a solver of research": ({"contact.dvi.solver": "psor"}, "contact.dvi.solver", "accelerated"),
    "planned effect": ({"effects.grain_hysteresis": {}}, "effects.grain_hysteresis", "remove its table"),
    "unknown dipole model": ({"effects.dipoles.model": "mutaul"}, "effects.dipoles.model", "did you mean 'mutual'?"),
    "moments fed back over less than a gap": (
        {"effects.dipoles.model": "mutual", "effects.back_reaction": {}, "effects.dipoles.cutoff": 1.5},
        "effects.dipoles.cutoff", "allowed: at least 2 diameters"),
    "moments fed back in a gap of one grain": (
        {"effects.dipoles.model": "mutual", "effects.back_reaction": {}, "particles.diameter": "0.6 mm"},
        "effects.back_reaction", "remove its table (the field then ignores the grains), or lower particles.diameter"),
    "misspelt kind": ({"geometry.kind": "clucth"}, "geometry.kind", "did you mean 'clutch'?"),
    "unknown material": ({"geometry.materials.disc": "steel_10100"}, "geometry.materials.disc",
        "did you mean 'steel_1010'?"),
    "gap below a grain": ({"geometry.gap": "0.1 mm"}, "geometry.gap = '0.1 mm'", "raise geometry.gap"),
    "coil in the cavity": ({"geometry.coil_radius": "20 mm"}, "geometry.coil_radius",
        "raise geometry.coil_radius"),
    "fillet as large as the pole": ({"geometry.pole_fillet": "20 mm"}, "geometry.pole_fillet",
        "lower geometry.pole_fillet"),
    "impossible fill": ({"particles.mass": "3 kg"}, "particles.mass", "allowed: at most"),
    "less than a grain": ({"particles.mass": "1 ug"}, "particles.mass", "less than one grain; raise it"),
    "a number read as metres": ({"geometry.disc_radius": 80}, "geometry.disc_radius = 80", "write '80 mm'"),
    "cohesion as a law": ({"contact.law": "JKR"}, "contact.law = 'JKR'", "add [effects.cohesion] with model = 'jkr'"),
    "no grain by its sizes": ({"particles.mass": "1 ug", "particles.diameter": None,
        "particles.sizes": {"kind": "uniform", "min": "0.2 mm", "max": "0.3 mm"}}, "particles.mass",
        "lower particles.sizes"),
    "contacts too soft": ({"contact.stiffness": "10 N/m"}, "contact.stiffness = 10 N/m is too soft",
        "or leave it out: it then follows from contact.max_overlap"),
    "two amounts": ({"particles.count": 10}, "particles.count", "keep exactly one of"),
    "sector that does not divide": ({"particles.sector": "7 deg"}, "particles.sector", "take 360 deg / n"),
    "sector within the cut-off": ({"particles.sector": "0.5 deg"}, "particles.sector", "allowed: at least"),
    "gravity across a sector": ({"effects.gravity.direction": [1, 0, 0]}, "effects.gravity.direction",
        "take [0, 0, -1]"),
    "two ways to the turns": ({"coil.turns": 500}, "coil.turns", "keep one of them"),
    "coil missing": ({"coil": None}, "coil is missing", "add [coil]"),
    "effect without its field": ({"field": None}, "effects.dipoles", "add [field]"),
    "images without dipoles": ({"effects.dipoles": None, "effects.wall_images": {}}, "effects.wall_images",
                               "add [effects.dipoles]"),
    "back reaction on a prescribed field": ({"field": UNIFORM, "effects.back_reaction": {}},
        "effects.back_reaction",
                                            "take field.source = 'coil'"),
    "coil field in a box": ({"geometry": BOX, "motion": None}, "field.source", "field.source = 'uniform'"),
    "shaft in a box": ({"geometry": BOX, "field": UNIFORM}, "motion.rotor", "remove the table"),
    "table that goes back": ({"coil.current": {"times": [0, 0], "values": [0, 1]}}, "coil.current.times",
        "must increase"),
    "a step that no contact allows": ({"time.step": "0.1 ms"}, "time.step = 0.0001 s", "leave it out"),
    "window beyond the end": ({"time.window": "1 s"}, "time.window", "take 'auto'"),
    "text for a switch": ({"output.pictures": "no"}, "output.pictures", "write true or false"),
    "curve that is not there": ({"materials.mine": {"law": "table", "file": "none.csv"}},
        "materials.mine.file",
                                "relative to the scene's folder"),
    "slots wider than their pitch": ({"geometry.disc_slots": {"count": 120, "fraction": 1.2, "depth": "2 mm"}},
        "geometry.disc_slots.fraction", "allowed: > 0, <= 1"),
    "slots through the disc": ({"geometry.disc_slots": {"count": 120, "fraction": 0.4, "depth": "44 mm"}},
        "geometry.disc_slots.depth", "lower geometry.disc_slots.depth"),
    "slots in both bodies": ({"geometry.disc_slots": {"count": 120, "depth": "2 mm"},
        "geometry.rotor_slots": {"count": 120, "depth": "2 mm"}}, "geometry.rotor_slots", "keep one of them"),
    "slots that the sector cuts": ({"geometry.disc_slots": {"count": 50, "depth": "2 mm"}},
        "particles.sector", "take '7.2 deg' or a multiple"),
    "slots and eddy currents": ({"geometry.disc_slots": {"count": 120, "depth": "2 mm"},
        "effects.eddy_currents": {}}, "effects.eddy_currents", "need a vector potential"),
    "slots and a tolerance": ({"geometry.disc_slots": {"count": 120, "depth": "2 mm"}, "field.tolerance": 1e-3},
        "field.tolerance", "field.size_factor"),
    "tolerance of nothing": ({"field.tolerance": 0.0}, "field.tolerance", "allowed: >= 1e-06"),
    "circuit without a voltage": ({"coil.voltage": None, "effects.coil_circuit": {}}, "coil.voltage",
        "give coil.voltage, e.g. '24 V'"),
    "current and field begin apart": ({
        "coil.current": None, "coil.voltage": "24 V", "coil.resistance": "20 ohm",
        "effects.coil_circuit": {"begin": "steady"}, "effects.eddy_currents": {}}, "effects.coil_circuit.begin",
        "differs from effects.eddy_currents.begin = 'off'"),
    "circuit beside a current": ({"effects.coil_circuit": {}}, "coil.current", "remove it, or the effect's table"),
    "eddy currents in an unknown material": ({"effects.eddy_currents": {"conductivity": {"unobtainium": 1e6}}},
        "effects.eddy_currents.conductivity.unobtainium", "it has"),
}  # fmt: skip
FILES = {
    "not_toml": ("check", "not_toml.toml", "line 7"),
    "not_utf8": ("check", "not_utf8.toml", "UTF-8"),
    "missing_sections": ("check", "geometry", "add the section [geometry]"),
    "no_such_file": ("check", "no_such_file.toml", "check the path"),
    "study_of_nothing": ("sweep", "no_such_scene.toml", "check the path"),
    "study_with_faults": ("sweep", "study.values.coil.curent", "did you mean coil.current?"),
    "good": ("sweep", "study", "use: emclutch run"),
}


def refused(arguments: list[str], *fragments: str) -> str:
    """Run the command line; it must refuse with exit code 2 and every fragment in its message."""
    result = CliRunner().invoke(app, arguments)
    assert result.exit_code == 2, result.output
    assert "Traceback" not in result.output
    for fragment in fragments:
        assert fragment in result.output
    return result.output


def test_the_scene_without_edits_is_right():
    assert load_case(GOOD).warnings == ()


@pytest.mark.parametrize("name", EDITS)
def test_edited_scene_is_refused(name, tmp_path):
    values, key, remedy = EDITS[name]
    scene = tmp_path / "scene.toml"
    data = edited(values)
    scene.write_text(tomli_w.dumps(data), encoding="utf-8")
    refused(["check", str(scene)], key, remedy)
    assert [path.name for path in tmp_path.iterdir()] == ["scene.toml"]


def edited(values: dict) -> dict:
    """The good scene with dotted keys set or removed, without the package's own checks."""
    data = read_toml(GOOD)
    for key, value in values.items():
        *tables, name = key.split(".")
        table = data
        for step in tables:
            table = table.setdefault(step, {})
        if value is None:
            table.pop(name)
        else:
            table[name] = value
    return data


@pytest.mark.parametrize("name", FILES)
def test_file_is_refused(name):
    command, key, remedy = FILES[name]
    refused([command, str(BROKEN / f"{name}.toml")], key, remedy)


def test_the_missing_scene_of_a_study_is_named_once_with_its_folder(tmp_path):
    (tmp_path / "study.toml").write_text('[study]\ncase = "nowhere.toml"\n[study.values]\n"coil.current" = [1]\n')
    output = refused(["sweep", str(tmp_path / "study.toml")], "study.case = 'nowhere.toml' does not exist; check")
    assert f"({tmp_path / 'nowhere.toml'}; relative paths start in the study's folder)" in output


def test_all_faults_are_reported_at_once():
    output = refused(["run", str(BROKEN / "many_faults.toml")])
    for key in (
        "scene.titel",
        "geometry.height",
        "particle",
        "contact.friction",
        "effects.back_reactoin",
        "time.end",
    ):
        assert f"- {key} " in output
    assert "- scene.title is missing" in output and "- particles is missing" in output


def test_faults_between_sections_come_with_those_within():
    output = refused(["check", str(GOOD), "--set", "contact.friction=-1", "--set", "geometry.gap=0.1 mm"])
    assert "contact.friction" in output and "geometry.gap" in output


def test_grains_are_compared_with_the_sizes_that_are_right():
    output = refused(["check", str(GOOD), "--set", "particles.diameter=20 mm", "--set", "geometry.yoke=3 kg"])
    assert "geometry.yoke" in output and "geometry.gap" in output


# name: (values in the good scene, what must be reported of the geometry, what else)
HIDDEN = {
    "a size hides sizes": ({"geometry.gap": "3 kg", "geometry.shaft_radius": "60 mm"},
        "geometry.gap = '3 kg'", "geometry.shaft_radius = '60 mm'"),
    "a missing size hides a material": ({"geometry.gap": None, "geometry.materials.disc": "steel_10100"},
        "geometry.gap is missing", "geometry.materials.disc"),
    "a size hides the amount of powder": ({"geometry.gap": "0.1 mm", "particles.mass": "3 kg"},
        "geometry.gap = '0.1 mm'", "particles.mass = '3 kg'"),
    "a size hides the sector": ({"geometry.gap": "0.1 mm", "particles.sector": "0.5 deg"},
        "geometry.gap = '0.1 mm'", "particles.sector = '0.5 deg'"),
    "a misspelt key hides slots": ({"geometry.gpa": "1 mm", "geometry.disc_slots": {"count": 120, "depth": "2 mm"},
        "effects.eddy_currents": {}}, "geometry.gpa", "effects.eddy_currents"),
    "slots hide a missing voltage": ({"geometry.disc_slots": {"count": 120, "fraction": 1.2, "depth": "2 mm"},
        "coil.voltage": None, "effects.coil_circuit": {}}, "geometry.disc_slots.fraction", "coil.voltage"),
    "an amount hides what dipoles need": ({"particles.count": 10, "effects.dipoles.model": "mutual",
        "contact.friction": -1}, "particles.count", "contact.friction"),
    "a material that is none hides the region": ({"geometry": {**BOX, "size": "3 kg"}, "particles.region": "faces",
        "motion": None, "field": UNIFORM}, "geometry.size", "particles.region = 'faces'"),
    "a box hides its coil's field": ({"geometry": {**BOX, "size": [1, 2]}}, "geometry.size", "field.source"),
}  # fmt: skip


@pytest.mark.parametrize("name", HIDDEN)
def test_a_fault_of_the_geometry_hides_no_other(name, tmp_path):
    values, of_geometry, other = HIDDEN[name]
    scene = tmp_path / "scene.toml"
    scene.write_text(tomli_w.dumps(edited(values)), encoding="utf-8")
    refused(["check", str(scene)], f"- {of_geometry}", f"- {other}")


def test_a_size_that_is_no_length_is_reported_once():
    """What is left of the geometry is judged without it: no relation to a size that is not known."""
    output = refused(["check", str(GOOD), "--set", "geometry.housing_width=3 kg", "--set", "geometry.gap=3 kg"])
    assert "2 errors" in output and output.count("- geometry.") == 2


@pytest.mark.parametrize("setting", ["coil.current", "=3", "scene.title.x=3", "coil..current=1"])
def test_wrong_setting_is_refused(setting):
    refused(["check", str(GOOD), "--set", setting], setting.split("=")[0])


def test_threads_out_of_range_are_refused():
    refused(["run", str(GOOD), "--threads", "0"], "--threads = 0", "allowed: 1 to")


def test_one_limit_of_threads_also_before_a_plan():
    most = numba.config.NUMBA_NUM_THREADS
    refused(["run", str(GOOD), "--threads", str(most + 1), "--dry-run"], "--threads", f"allowed: 1 to {most}")


def test_resume_needs_a_folder(tmp_path):
    refused(["run", str(GOOD), "--resume"], "emclutch run FOLDER --resume")
    refused(["sweep", str(BROKEN / "good.toml"), "--resume"], "name its folder with --out")
    refused(["run", str(tmp_path), "--resume"], str(tmp_path), "no case.toml")


def test_a_removed_key_must_exist():
    refused(["check", str(GOOD), "--set", "effects.gravtiy=off"], "effects.gravtiy", "effects.gravity")


@pytest.mark.parametrize(
    ("key", "entry", "remedy"),
    [
        ("geometry.gap", "1,0 mm", "decimals follow a point: '1.0 mm'"),
        ("contact.friction", "0.3 mm", "write it without a unit, e.g. 0.3"),
        ("particles.count", "12 pcs", "write it without a unit"),
        ("effects.eddy_currents", "yes", "set effects.eddy_currents to 'on' or 'off' (--set)"),
    ],
)
def test_habits_of_writing_are_reported(key, entry, remedy):
    refused(["check", str(GOOD), "--set", f"{key}={entry}"], key, remedy)


def test_far_names_are_not_suggested():
    assert "did you mean" not in refused(["check", str(GOOD), "--set", "geometry.kind=sphere"], "geometry.kind")


def test_a_folder_with_files_is_not_written_to(tmp_path):
    (tmp_path / "mine.txt").write_text("mine")
    refused(["run", str(GOOD), "--out", str(tmp_path)], str(tmp_path), "--out")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.txt"]


def test_unwritable_output_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    for command in ("run", "mesh"):
        refused([command, str(GOOD), "--out", str(tmp_path / "file" / "run")], "file", "--out")


def test_nothing_to_resume_is_refused(tmp_path):
    refused(["run", str(GOOD), "--out", str(tmp_path / "new"), "--resume"], "nothing to resume", "--out")
    assert not (tmp_path / "new").exists()


def test_a_folder_without_a_run_is_not_plotted(tmp_path):
    refused(["plot", str(tmp_path)], "history.csv", "name the folder of a run")


def test_a_box_has_no_mesh(tmp_path):
    scene = tmp_path / "scene.toml"
    scene.write_text(tomli_w.dumps(edited({"geometry": BOX, "field": UNIFORM, "coil": None, "motion": None,
                                           "particles.sector": None, "particles.mass": "1 g"})))  # fmt: skip
    output = refused(["mesh", str(scene), "--out", str(tmp_path / "new")], str(scene), "clutch and drum")
    assert output.count("geometry.kind") == 1
    refused(["accuracy", str(scene), "--out", str(tmp_path / "new")], "geometry.kind = 'box'", "has no disc")
    refused(["accuracy", str(scene), "--effects", "--for", "5 %"], "--for = 5 %", "remove one of the two")
    assert not (tmp_path / "new").exists()


def test_a_surface_that_no_grain_reaches_is_refused(tmp_path):
    for name, x in (("away", 50), ("near", 4)):
        corners = f"vertex {x} 0 1\nvertex {x + 1} 0 1\nvertex {x} 1 1"
        text = f"solid\nfacet normal 0 0 1\nouter loop\n{corners}\nendloop\nendfacet\nendsolid\n"
        (tmp_path / f"{name}.stl").write_text(text)
    values = {"geometry": BOX, "field": None, "effects": {"gravity": {}}, "coil": None, "motion": None,
              "particles.sector": None, "particles.mass": "1 g"}  # fmt: skip
    scene = tmp_path / "scene.toml"
    surfaces = {name: {"file": f"{name}.stl", "scale": 0.001} for name in ("away", "near")}
    scene.write_text(tomli_w.dumps(edited(values | {"surfaces": surfaces})))
    output = refused(["check", str(scene)], "surfaces.away.file", "entirely outside", "x 50 to 51")
    assert "surfaces.near" not in output
    scene.write_text(tomli_w.dumps(edited(values | {"surfaces": {"near": surfaces["near"]}})))
    reported = CliRunner().invoke(app, ["check", str(scene), "--json"])
    plan = json.loads(reported.stdout)["plan"]
    assert plan["surface near"] == "1 triangles, x 4 to 5, y 0 to 1, z 1 to 1 mm, on body housing"
    assert plan["packing"].startswith("random")


def test_what_a_clutch_of_shot_cannot_have():
    scene = str(Path(__file__).parents[2] / "cases" / "thesis" / "centrifugal.toml")
    refused(["check", scene, "--set", "particles.sector=60 deg"], "particles.sector", "vanes and ribs do not repeat")
    refused(["check", scene, "--set", "geometry.coil_radius=3 mm"], "geometry.coil_radius", "which has no coil")
    refused(["check", scene, "--set", "contact.stiffness=100 kN/m"], "impacts at 12.1 m/s", "limit 10 %")
    reported = CliRunner().invoke(app, ["check", scene, "--json", "--set", "particles.settle=true"])
    told = json.loads(reported.stdout)
    assert "impacts at 12.1 m/s" in told["plan"]["stiffness"] and told["plan_warnings"]["stiffness"]
    assert "longest: 100 falls" in told["plan"]["packing"]


def test_schema_overwrites_nothing(tmp_path):
    (tmp_path / "schema.json").write_text("mine")
    refused(["schema", "--out", str(tmp_path / "schema.json")], "schema.json")
    assert (tmp_path / "schema.json").read_text() == "mine"


def test_the_installed_program_answers_alike(tmp_path):
    """One run as a process of its own: the exit code and both streams are what a shell sees."""
    command = [sys.executable, "-m", "emclutch.cli.main", "check", str(tmp_path / "none.toml")]
    root = Path(__file__).parents[2]
    done = subprocess.run(command, capture_output=True, text=True, cwd=root, check=False)
    assert done.returncode == 2
    assert done.stdout == "" and "does not exist" in done.stderr and "Traceback" not in done.stderr
