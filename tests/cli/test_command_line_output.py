"""The command line: settings, exit codes, options without a meaning, and what is to be done next after a run."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
import typer
from typer.testing import CliRunner
from written_run import written_run

from emclutch import __version__
from emclutch.cli.errors import explained
from emclutch.cli.fit import angle_of
from emclutch.cli.input import assignments, load
from emclutch.cli.main import app
from emclutch.results import OutputError, load_result
from emclutch.results.errors import Interrupted
from emclutch.results.report.verdict import verdict
from emclutch.results.text import format_mean
from emclutch.scene.case import load_case
from emclutch.scene.errors import SceneError
from emclutch.scene.reference import scene_reference
from emclutch.simulation.open_folder import remedy_in_scene
from emclutch.simulation.resume import refuse_other_scene
from emclutch.studies.accuracy import study
from emclutch.studies.field_result import FieldResult
from particles import DemError, DemErrorKind

ROOT = Path(__file__).parents[2]
CASES = ROOT / "cases"
GOOD = ROOT / "tests" / "scene" / "broken" / "good.toml"


def called(*words):
    return CliRunner().invoke(app, [str(word) for word in words], env={"COLUMNS": "500"})


def test_settings_are_toml_or_text_and_none_and_off_remove(tmp_path):
    given = ["coil.current=0.8 A", "particles.count = 12", "output.formats=['vtk']", "output.pictures=false", "a.b=c=d",
             "effects.gravity=off", "effects.dipoles=on", "coil.voltage=none", "scene.title='none'"]  # fmt: skip
    assert assignments(given) == {
        "coil.current": "0.8 A", "particles.count": 12, "output.formats": ["vtk"], "output.pictures": False,
        "a.b": "c=d", "effects.gravity": None, "effects.dipoles": "on", "coil.voltage": None, "scene.title": "none",
    }  # fmt: skip
    path = tmp_path / "scene.toml"
    path.write_text(GOOD.read_text().replace("[effects.dipoles]", "[effects.dipoles]\ncutoff = 3.5", 1))
    kept = load(path, ["effects.dipoles=on", "effects.wall_images=on"]).scene.effects
    assert kept.dipoles.cutoff == 3.5 and kept.wall_images is not None


def test_every_command_has_help_and_what_is_printed_is_so(tmp_path):
    names = [command.name or command.callback.__name__.replace("_", "-") for command in app.registered_commands]
    assert {"run", "check", "sweep", "accuracy", "mesh", "plot", "materials", "schema", "doctor"} <= set(names)
    assert [name for name in names if called(name, "--help").exit_code] == []
    assert called("--version").output == f"emclutch {__version__}\n" and "steel_1010" in called("materials").output
    assert called("schema", "--out", tmp_path / "schema.json").exit_code == 0
    assert json.loads(called("schema").output) == json.loads((tmp_path / "schema.json").read_text())
    page = (ROOT / "docs" / "scene.md").read_text(encoding="utf-8")
    assert page == scene_reference(), "emclutch schema --markdown > docs/scene.md"


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (("check", CASES / "current_to_torque.toml", "--details"), "--details"),
        (("run", CASES / "quickstart.toml", "--dry-run", "--out", "x"), "--out cannot be combined with --dry-run"),
        (("run", "--resume", GOOD), "name the run's folder"),
        (("sweep", CASES / "current_to_torque.toml", "--dry-run", "--jobs", 2), "--jobs cannot be combined with"),
        (("design", CASES / "which_current.toml", "--within", "3 %"), "--within needs --runs"),
        (("design", CASES / "which_current.toml", "--threads", 1), "--threads needs --runs"),
        (("accuracy", CASES / "quickstart.toml", "--dry-run", "--resume", "--out", "x"), "--resume"),
        (("accuracy", CASES / "quickstart.toml", "--dry-run", "--budget", "1 s"), "--budget"),
        (("materials", "--plot", "x.png", "--json"), "--json cannot be combined with --plot"),
    ],
)
def test_an_option_without_a_meaning_is_refused(words, says):
    found = called(*words)
    assert found.exit_code == 2 and says in " ".join(found.output.split()), found.output


def test_resume_names_the_folder_where_it_is_given_a_file_of_it(tmp_path):
    checkpoint = tmp_path / "checkpoint.h5"
    checkpoint.write_bytes(b"\x89HDF\r\n")
    found = called("run", "--resume", checkpoint)
    assert found.exit_code == 2 and f"emclutch run {tmp_path} --resume" in found.output


def test_a_dry_run_of_accuracy_writes_nothing(tmp_path, monkeypatch):
    """With two of the settings only: to plan each takes a second."""
    monkeypatch.chdir(tmp_path)
    values = study.values_to_plan
    monkeypatch.setattr(study, "values_to_plan", lambda base: values(base)[:2])
    words = "accuracy", CASES / "quickstart.toml", "--dry-run", "--set", "field.size_factor=2", "--for", "20 %"
    found = called(*words)
    assert found.exit_code == 0 and "A study begins" not in found.output and not list(tmp_path.iterdir())
    assert f"emclutch check {CASES / 'quickstart.toml'}" in found.output  # reaches 20 % without a run
    (cheapest,) = json.loads(called(*words, "--json").output)["cheapest"]
    assert cheapest["fidelity"] == "law" and 0.0 < cheapest["half_width"] < cheapest["target"] == 0.2
    monkeypatch.setattr(study, "BUDGET", 1.0)  # which is too small for the replicas that run in any case
    finer = called(*words[:-1], "0.1 %")
    assert finer.exit_code == 0 and "grains per gap" in finer.output
    text = " ".join(finer.output.split())
    assert "± 0.1 %: not reached. Runs of grains reach ± " in text and "at best, limited by the " in text
    assert "No ± contains an error of friction" in text and "Fill: 45 % by volume in the rim between the poles" in text
    assert json.loads(called(*words[:-1], "0.1 %", "--json").output)["budget"] > 1.0


def test_a_dry_run_lists_the_effects_that_can_be_left_out(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    words = "accuracy", CASES / "quickstart.toml", "--effects", "--dry-run", "--set", "field.size_factor=3"
    found = called(*words, "--json")
    assert found.exit_code == 0 and not list(tmp_path.iterdir())
    told = json.loads(found.output)
    whole, *without = told["effects"]
    assert whole["effect"] == "" and {one["effect"] for one in without} >= {"dipoles", "saturation"}
    assert all((one["seconds"] > 0.0) != bool(one["reason"]) for one in told["effects"])
    refused = called(*words, "--budget", "1 s")
    assert refused.exit_code == 2 and "is less than 3 replicas without each effect" in refused.output


def test_the_error_of_an_angle_needs_the_angle():
    assert angle_of(None, None) is None
    with pytest.raises(SceneError, match="--uncertainty needs --repose"):
        angle_of(None, "2 deg")


@pytest.mark.parametrize(
    ("values", "key"), [({"contact.stiffness": "20 kN/m"}, "raise contact.stiffness = 20000"),
                        ({"contact.law": "hertz"}, "lower contact.max_overlap = 0.005")]
)  # fmt: skip
def test_grains_pressed_in_too_far_name_the_key(values, key):
    case = load_case(GOOD, values)
    for kind, says in ((DemErrorKind.OVERLAP, key), (DemErrorKind.ESCAPED, "")):
        text = remedy_in_scene(case, DemError(kind, "it is 11 % inside a wall", "raise it", 3, np.zeros(3), 0.1))
        assert says in text and bool(says) == bool(text)
    with pytest.raises(OutputError, match="a changed contact needs a new run"):
        refuse_other_scene("[contact]\nfriction = 0.1", "[contact]\nfriction = 0.2", "runs/a")


def test_ctrl_c_ends_with_130_also_while_the_program_is_loaded(capsys):
    with pytest.raises(typer.Exit) as stopped, explained():
        raise Interrupted("stopped at t = 1 s")
    assert stopped.value.exit_code == 130 and capsys.readouterr().err == "stopped at t = 1 s\n"
    stop = """
import sys
class Stop:
    def find_spec(self, name, path=None, target=None):
        if name == "emclutch.cli.run_commands":
            raise KeyboardInterrupt
sys.meta_path.insert(0, Stop())
import emclutch.cli.main
"""
    done = subprocess.run([sys.executable, "-c", stop], capture_output=True, text=True)
    assert (done.returncode, len(done.stderr.splitlines())) == (130, 1)


@pytest.mark.parametrize("words", [["--help"], ["materials"], ["check", "nowhere.toml"]])
def test_output_that_nobody_reads_ends_in_silence_as_of_other_programs(words):
    """As `yes | head -1`: killed by SIGPIPE, which a shell counts as 128 + 13."""
    command = [sys.executable, "-m", "emclutch.cli.main", *words]
    reader, writer = os.pipe()
    os.close(reader)
    with open(writer, "w") as closed:
        stderr = closed if "check" in words else subprocess.PIPE  # an error is what is printed
        ended = subprocess.run(command, cwd=ROOT, stdout=closed, stderr=stderr, text=True)
    assert (ended.returncode, ended.stderr or "") == (141, "")


def test_a_notebook_shows_no_foreign_markup(tmp_path):
    rows = [{"current": 0.5, "flux_linkage": 0.1}]
    summary = {"units": {"current": "A", "flux_linkage": "Wb"}, "currents": rows, "at_last_current": {"<steel>": 1.0},
               "warnings": []}  # fmt: skip
    shown = FieldResult(tmp_path / "field", summary)._repr_html_()
    assert "I [A]" in shown and "0.5" in shown and "&lt;steel&gt;" in shown


def test_a_torque_has_two_digits_of_the_half_of_its_interval():
    assert format_mean(1.2345, (1.2345 - 0.0257, 1.2345 + 0.0257)) == "1.234 N m (95 %: 1.209 to 1.260)"
    assert format_mean(1.2345, (-2.0, 4.5)) == "1.2 N m (95 %: -2.0 to 4.5)"
    assert format_mean(1234567.0, (1.2e6, 1.3e6), "Pa") == "1.23e+06 Pa (95 %: 1.2e+06 to 1.3e+06)"
    assert format_mean(1.2345, None) == "1.234 N m, error unknown"


UNTIL = {"asked": "torque 5 %", "reached": False, "reason": "", "replicas": 8, "end": None}
DRIFT = {"start": 0.1, "end": 0.2, "settled": 0.1, "converged": False, "drift_freedom": 11.0, "exclude_drift": True}
BIASED = {"bias": 0.2, "half_width": 0.03, "unknown": {}, "extrapolated": {}, "total_error": 0.1,
          "best_estimate": {"mean": 0.75, "half_width": 0.057},
          "accuracy_study": {"note": "", "file": "x", "date": "y"},
          "largest_part": {"name": "statistics", "half_width": 0.071}, "next": "9 replicas"}  # fmt: skip


@pytest.mark.parametrize(
    ("torque", "until", "more", "following"),
    [
        # 5 %, 0.045, less a margin of a tenth: 2.57 * 0.04 / sqrt(6) = 0.0420, 2.45 * 0.04 / sqrt(7) = 0.0370
        ({"mean": 0.9}, {}, {}, "accuracy.replicas = 7, 9 s of processor time"),  # 5 s for 4
        ({"mean": 0.9, "several_looks": True}, {}, {}, "accuracy.replicas = 8, 10 s of processor time"),  # 97 %
        ({"mean": 0.9, "standard_error": 0.005}, {}, {}, "± 0.88 % takes accuracy.replicas = 10"),  # half of it
        ({"replicas": 2, "batches": 2}, {}, {}, "replicas = 5"),  # by Student's t; 144 by Gauss's law
        ({"replicas": 3, "batches": 3}, {}, {}, "replicas = 5"),
        ({"replicas": 1, "converged": False, "steady_alone": True}, {}, {}, "accuracy.replicas = 4 measures"),
        ({"standard_error": 0.2}, {}, {}, "needs more than 64 replicas"),
        ({"standard_error": 0.5}, {}, {}, None),  # it may be 0, of which there is no fraction
        ({"mean": 0.9}, {}, {"discretisation_error": BIASED, "accuracy_target": {"asked": 0.05, "reached": False}},
         "replicas = 9"),  # of which 4 % are left, 5^2 - 3^2
        ({}, {}, {"accuracy_target": {"asked": 0.1, "reached": True}}, None),
        ({"replicas": 1, "converged": False, "missing": 0.12}, {}, {}, "time.end='320 ms'"),  # of 0.2 s
        ({**DRIFT, "drift": 1.0, "drift_error": 0.01}, UNTIL, {}, "time.end='400 ms'"),  # by 10 %
        ({**DRIFT, "drift": 0.7, "drift_error": 0.25}, {}, {}, "time.end='400 ms'"),  # 10 % is not excluded
        ({**DRIFT, "drift": 0.7, "drift_error": 0.25}, UNTIL | {"replicas": 6, "end": 0.36}, {}, "time.end='360 ms'"),
        ({**DRIFT, "drift": 0.0, "drift_error": 0.01, "missing": 0.2}, {}, {}, "time.end='400 ms'"),
        ({}, UNTIL | {"end": 0.3}, {}, "time.end='300 ms'"),  # the cheaper of the two
        ({}, UNTIL | {"end": 0.5}, {}, "replicas = 8"),
        ({}, UNTIL, {}, "accuracy.max_replicas = 8"),
    ],
)  # fmt: skip
def test_what_to_do_next_is_what_reaches_the_target(tmp_path, torque, until, more, following):
    """Longer where more replicas do not help; else as many as Student's t needs, and what is cheaper of the two."""
    folder = written_run(tmp_path / "run")
    known = {"mean": 1.0, "standard_error": 0.02, "batches": 4, "replicas": 4, "converged": True, "reason": ""}
    changed = {"torque": known | torque} | more | ({"until": until} if until else {})
    folder.write_summary(folder.read_summary() | changed)
    said = [one.text for one in verdict(load_result(folder.path)) if one.text.startswith("Next: ")]
    assert len(said) == (following is not None) and (following or "") in "".join(said)


def test_a_column_that_is_not_used_is_named_in_one_line(tmp_path):
    path = tmp_path / "curve.csv"
    path.write_text("no, H [A/m], B [T]\n1, 100, 0.5\n2, 1000, 1.2\n3, 10000, 1.7\n")
    words = [sys.executable, "-m", "emclutch.cli.main", "materials", str(path)]
    found = subprocess.run(words, capture_output=True, text=True, check=True)
    assert found.stderr == f"warning: {path}: not used: no\n"
