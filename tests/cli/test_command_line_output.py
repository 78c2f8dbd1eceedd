"""The command line's own words: help, settings, the torque's line, progress."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import pandas
import pytest
import typer
from typer.testing import CliRunner
from written_run import written_run

from emclutch import __version__
from emclutch.cli.errors import explained
from emclutch.cli.input import assignments, load
from emclutch.cli.main import app
from emclutch.results import OutputError, load_result
from emclutch.results.errors import Interrupted
from emclutch.results.report.verdict import closing_lines
from emclutch.results.text import format_mean
from emclutch.scene.case import load_case
from emclutch.scene.reference import scene_reference
from emclutch.simulation.open_folder import remedy_in_scene
from emclutch.simulation.resume import refuse_other_scene
from particles import DemError, DemErrorKind

GOOD = Path(__file__).parents[1] / "scene" / "broken" / "good.toml"


def test_settings_are_toml_or_text():
    given = [
        "coil.current=0.8 A",
        "particles.count = 12",
        "output.formats=['vtk']",
        "output.pictures=false",
        "a.b=c=d",
    ]
    assert assignments(given) == {
        "coil.current": "0.8 A",
        "particles.count": 12,
        "output.formats": ["vtk"],
        "output.pictures": False,
        "a.b": "c=d",
    }


def test_every_command_has_help():
    names = [command.name or command.callback.__name__.replace("_", "-") for command in app.registered_commands]
    assert {"run", "check", "sweep", "accuracy", "mesh", "plot", "materials", "schema", "doctor"} <= set(names)
    for name in names:
        result = CliRunner().invoke(app, [name, "--help"])
        assert result.exit_code == 0
        if name == "plot":
            assert "speeds [rpm]" in " ".join(result.output.replace("│", " ").split())  # no style of the terminal's


def test_schema_goes_to_the_terminal_or_a_file(tmp_path):
    printed = CliRunner().invoke(app, ["schema"])
    assert CliRunner().invoke(app, ["schema", "--out", str(tmp_path / "schema.json")]).exit_code == 0
    assert json.loads(printed.output) == json.loads((tmp_path / "schema.json").read_text())


def test_materials_are_listed_with_their_source():
    result = CliRunner().invoke(app, ["materials"])
    assert result.exit_code == 0 and "steel_1010" in result.output


def test_torque_comes_with_its_error():
    """To two digits of the half of its interval."""
    assert format_mean(1.2345, (1.2345 - 0.0257, 1.2345 + 0.0257)) == "1.234 N m (95 %: 1.209 to 1.260)"
    assert format_mean(1.2345, (-2.0, 4.5)) == "1.2 N m (95 %: -2.0 to 4.5)"
    assert format_mean(1.2345, None) == "1.234 N m, error unknown"
    assert format_mean(1234567.0, (1.2e6, 1.3e6), "Pa") == "1.23e+06 Pa (95 %: 1.2e+06 to 1.3e+06)"
    assert format_mean(2.0, (2.0, 2.0)) == "2.000 N m (95 %: 2.000 to 2.000)"


def test_a_lock_and_soft_grains_are_reported(tmp_path):
    def lines(**changed):
        folder = written_run(tmp_path / f"run-{len(list(tmp_path.iterdir()))}")
        history = pandas.read_csv(folder.history).assign(rotor_speed=10.0 * math.pi, disc_speed=9.0 * math.pi)
        history.to_csv(folder.history, index=False)
        folder.write_summary(folder.read_summary() | changed)
        return closing_lines(load_result(folder.path))

    soft = lines(contact={"compliant": True}, max_overlap=0.05, lock_up_time=1.25)
    assert "– Output locked at 1.25 s, at 270 rpm at the end." in soft
    words = "The largest overlap is 5 % of the diameter: grains too soft; torque peaks are not to be trusted."
    assert f"✗ {words}" in soft
    slips = lines(lock_up_time=None)
    assert "– Output not locked: 270 rpm at the end, the motor 300 rpm." in slips and "too soft" not in str(slips)
    assert "too soft" not in str(lines(contact={"compliant": False}, max_overlap=0.05))


def test_the_verdict_names_the_error_budget_and_what_to_do_next(tmp_path):
    folder = written_run(tmp_path / "run")
    summary = folder.read_summary()

    def lines(**changed):
        folder.write_summary(summary | changed)
        return closing_lines(load_result(folder.path))

    torque = {"mean": 0.9, "standard_error": 0.02, "batches": 4, "replicas": 4, "converged": True, "reason": "steady"}
    unknown = lines(torque=torque, discretisation_error_note="no ladder; find with: X")
    assert "– The interval is statistical only, the error of the settings unknown: no ladder; find with: X." in unknown
    # 5 %, 0.045, less a margin of a tenth: 2.83 * 0.04 / sqrt(7) = 0.0428, 2.71 * 0.04 / sqrt(8) = 0.0384; 5 s for 4
    assert "– Next: 5 % takes about 8 packings (accuracy.replicas = 8), 10 s of processor time in all." in unknown
    narrow = lines(torque={**torque, "standard_error": 0.005})  # better than the usual 5 %: half of it
    assert "0.88 % takes about 13 packings (accuracy.replicas = 13), 16 s of processor time in all" in str(narrow)
    resumed = summary["seconds"] | {"processor": 50.0}  # of all parts, where `whole_run` is of the last one
    assert "(accuracy.replicas = 8), 2 min of processor time" in str(lines(torque=torque, seconds=resumed))
    found = {
        "bias": 0.2, "half_width": 0.06, "unknown": {"sector": "no time"}, "extrapolated": {}, "total_error": 0.1,
        "corrected_torque": {"mean": 0.75, "half_width": 0.057}, "ladder": {"note": "measured at coil.current = 2.0",
        "file": "x", "date": "y"}, "largest_part": {"name": "grains_across", "half_width": 0.051},
        "next": "5 % takes about 9 packings",
    }  # fmt: skip
    asked = {"asked": 0.05, "reached": False}
    budget = lines(torque=torque, discretisation_error=found, accuracy_target=asked)
    assert budget[1] == (
        "✗ Without the error of its settings (+20 %) the torque is 0.750 N m (95 %: 0.693 to 0.807); error budget: "
        "packings 8 %, settings 6 %, together 10 %; largest part: grains across, 5.1 %; not included, since not "
        "measured: sector; measured at coil.current = 2.0."
    )
    assert budget[2] == "✗ The total error of accuracy.target = 5 % is not reached."
    assert budget[3] == "– Next: grains across is the largest part of the error; 5 % takes about 9 packings."
    mostly_packings = found | {"largest_part": {"name": "statistics", "half_width": 0.071}, "half_width": 0.03}
    both = lines(torque=torque, discretisation_error=mostly_packings, accuracy_target=asked)
    assert budget[0] == both[0] and "5 % takes about 11 packings" in str(both)  # of which 4 % are left, 5^2 - 3^2
    assert "Next" not in str(lines(torque=torque, accuracy_target={"asked": 0.1, "reached": True}))
    drifting = lines(torque={**torque, "converged": False, "reason": "not settled"})
    assert "✗ The torque on the disc is not known" in drifting[0]
    lacks = lines(torque={**torque, "replicas": 1, "converged": False, "missing": 0.12})  # of 0.2 s, which took 5 s
    how = f"emclutch run {folder.path} --resume --set time.end='320 ms'"
    assert f"({how}), about 3 s of processor time more." in str(lacks)


def test_what_to_do_next_does_not_contradict_why_the_torque_is_not_known(tmp_path):
    """Run longer where more packings do not help; else as many as Student's t needs, and what is cheaper of the two."""
    folder = written_run(tmp_path / "run")
    summary, scene = folder.read_summary(), folder.case.read_text()

    def following(until=None, **torque):
        known = {"mean": 1.0, "standard_error": 0.02, "batches": 4, "replicas": 4, "converged": True, "reason": ""}
        changed = {} if until is None else {"until": {"asked": "torque 5 %", "reached": False, "reason": "", **until}}
        folder.write_summary(summary | {"torque": known | torque} | changed)
        return " ".join(line for line in closing_lines(load_result(folder.path)) if "Next" in line)

    stretch = {"start": 0.1, "end": 0.2, "settled": 0.1, "converged": False}
    stretch |= {"drift_freedom": 11.0, "exclude_drift": True}
    longer = "--set time.end='400 ms'"
    assert longer in following({"packings": 8, "end": None}, **stretch, drift=1.0, drift_error=0.01)  # by 10 %
    drifts = {**stretch, "drift": 0.7, "drift_error": 0.25}  # by 7 % +- 5.5 %: not 0, and 10 % is not excluded
    assert longer in following(**drifts)
    assert "time.end='360 ms'" in following({"packings": 6, "end": 0.36}, **drifts)
    for until in (None, {"packings": 6, "end": 0.3}):  # not balanced yet
        assert "time.end='400 ms'" in following(until, **stretch, drift=0.0, drift_error=0.01, missing=0.2)
    assert "takes about 5 packings (accuracy.replicas = 5)" in following(replicas=2, batches=2)  # 144 by Gauss's law
    assert "takes about 6 packings" in following(replicas=3, batches=3)
    assert "takes about 7 packings" in following()  # 4.9 % of 6 leave no margin
    assert following(standard_error=0.2).endswith("5 % is out of reach with 64 packings; run longer, or ask for less.")
    assert not following(standard_error=0.5)  # it may be 0, of which there is no fraction
    both = {"packings": 8, "end": 0.3}
    assert "time.end='300 ms'" in following(both) and "8 packings" in following(both | {"end": 0.5})
    assert "(accuracy.max_replicas = 8)" in following({"packings": 8, "end": None})
    folder.case.write_text(scene + "\n[accuracy]\nreplicas = 4\n")
    assert "(accuracy.replicas = 8)" in following({"packings": 8, "end": None})


@pytest.mark.parametrize(
    ("values", "reported"),
    [
        ({"contact.stiffness": "20 kN/m"}, "raise contact.stiffness = 20000 fourfold"),
        ({"contact.law": "hertz"}, "lower contact.max_overlap = 0.005 to a quarter, or give contact.hertz_stiffness"),
    ],
)
def test_grains_pressed_in_too_far_name_the_key(values, reported):
    case = load_case(GOOD, values)
    pressed_in = DemError(DemErrorKind.OVERLAP, "it is 11 % inside a wall", "raise it", 3, np.zeros(3), 0.1)
    text = remedy_in_scene(case, pressed_in)
    assert reported in text and "take another --out, not --resume" in text
    escaped = DemError(DemErrorKind.ESCAPED, "it overlaps nothing any more", "", 3, np.zeros(3), 0.1)
    assert remedy_in_scene(case, escaped) == ""
    with pytest.raises(OutputError, match="a changed contact needs a new run"):
        refuse_other_scene("[contact]\nfriction = 0.1", "[contact]\nfriction = 0.2", "runs/a")


def test_resume_names_the_folder_where_it_is_given_a_file_of_it(tmp_path):
    checkpoint = tmp_path / "run" / "checkpoint.h5"
    checkpoint.parent.mkdir()
    checkpoint.write_bytes(b"\x89HDF\r\n")
    asked = CliRunner().invoke(app, ["run", "--resume", str(checkpoint)], env={"COLUMNS": "500"})
    assert asked.exit_code == 2 and f"takes the run's folder: emclutch run {checkpoint.parent} --resume" in asked.output


def test_none_and_off_remove_and_on_adds():
    given = ["effects.gravity=off", "effects.dipoles=on", "coil.voltage=none", "scene.title='none'"]
    assert assignments(given) == {
        "effects.gravity": None, "effects.dipoles": {}, "coil.voltage": None, "scene.title": "none",
    }  # fmt: skip


def test_an_effect_that_is_on_keeps_its_entries(tmp_path):
    text = GOOD.read_text().replace("[effects.dipoles]", "[effects.dipoles]\ncutoff = 3.5", 1)
    (tmp_path / "scene.toml").write_text(text)
    kept = load(tmp_path / "scene.toml", ["effects.dipoles=on", "effects.wall_images=on"]).scene.effects
    assert kept.dipoles.cutoff == 3.5 and kept.wall_images is not None


def test_version_is_reported():
    assert CliRunner().invoke(app, ["--version"]).output == f"emclutch {__version__}\n"


def test_ctrl_c_is_no_failure(capsys):
    with pytest.raises(typer.Exit) as stopped, explained():
        raise Interrupted("stopped at t = 1 s")
    assert stopped.value.exit_code == 130 and capsys.readouterr().err == "stopped at t = 1 s\n"


def test_the_page_of_keys_is_what_the_models_say():
    page = Path(__file__).parents[2] / "docs" / "scene.md"
    assert page.read_text(encoding="utf-8") == scene_reference(), "emclutch schema --markdown > docs/scene.md"
