"""A design search finds the value whose expected torque is the wanted one, and says how far the law can be trusted."""

from __future__ import annotations

import io
import json
from itertools import pairwise
from pathlib import Path

import pytest
import sheared_annulus
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.results import HistoryWriter, OutputError, Progress, RunFolder, load_result
from emclutch.results.report.report import Mark
from emclutch.scene.case import case_from
from emclutch.scene.design import read_design
from emclutch.scene.errors import SceneError
from emclutch.studies.accuracy import target as run_case
from emclutch.studies.design_search import _of_the_supply, expectation_of

QUICKSTART = Path(__file__).resolve().parents[2] / "cases" / "quickstart.toml"
CELL = sheared_annulus.CELL | {"time": {"end": "0.2 ms", "window": "20 us"}, "accuracy": {"replicas": 1}}
FIELD = "field.field_strength"


def expected(case, key, value):
    return emclutch.check(case.with_values({key: value}), threads=1).expected.torque


def design(case, target, out, between=("1 kA/m", "400 kA/m"), **options):
    return emclutch.design(case, FIELD, between, target, out=out, **options)


def test_the_found_value_is_that_at_which_the_wanted_torque_is_expected(tmp_path):
    """So is that of the written scene; a torque wanted less needs less field, and a bracket holds its answer."""
    case, found = case_from(CELL), []
    for target in (0.005, 0.02):
        stream = io.StringIO()
        result = design(case, target, tmp_path / f"{target}", progress=Progress(stream=stream))
        assert stream.getvalue().splitlines()[0] == f"expected torque at {FIELD} = 1 kA/m"
        assert len(stream.getvalue().splitlines()) == len(result.tried)
        assert expected(case, FIELD, result.value) == pytest.approx(target, rel=0.02)
        written = emclutch.load_case(result.folder / "found.toml")
        assert emclutch.check(written, threads=1).expected.torque == pytest.approx(result.expected.torque, rel=1e-12)
        assert result.bracket[0] < result.value < result.bracket[1] and result.is_monotone
        assert repr(result).startswith(f"<DesignResult: {FIELD} = ") and f"target of {target:g} N m" in repr(result)
        found.append(result.value)
    assert found[0] < found[1]


def test_ends_of_the_bracket_are_where_the_law_is_off_by_its_factor(tmp_path):
    """Half at the one, twice at the other; or where the range ends."""
    case = case_from(CELL)
    result = design(case, 0.005, tmp_path / "found")
    for end, factor in zip(result.bracket, (1 / 2, 2), strict=True):
        assert expected(case, FIELD, end) == pytest.approx(factor * 0.005, rel=0.15)
    assert result.is_cut == (False, False)
    highest = 1.3 * result.value  # torque goes with less than the square of the field
    cut = design(case, 0.005, tmp_path / "cut", between=("1 kA/m", f"{highest} A/m"))
    assert cut.is_cut == (False, True) and cut.bracket[1] == pytest.approx(highest)


def test_a_torque_beyond_both_ends_is_refused_with_theirs(tmp_path):
    case = case_from(CELL)
    low, high = (expected(case, FIELD, value) for value in (1e3, 400e3))
    with pytest.raises(SceneError) as refused:
        design(case, "torque 12 N m", tmp_path / "found")
    text = str(refused.value)
    assert f"{low:.4g} N m at 1 kA/m, {high:.4g} N m at 400 kA/m" in text and "widen the range" in text
    assert not (tmp_path / "found").exists()


def test_a_torque_beyond_both_ends_names_the_part_that_takes_most_ampere_turns(tmp_path):
    case = emclutch.load_case(QUICKSTART, {"field.size_factor": 3.0, "field.gap_layers": 3})
    with pytest.raises(SceneError) as refused:
        emclutch.design(case, "coil.current", ("0.5 A", "1 A"), 10.0, out=tmp_path / "found")
    halved = expected(case, "geometry.gap", 0.5e-3)
    hint = f"geometry.gap = 0.5 mm in place of 1 mm gives {halved:.4g} N m at 1 A"
    assert f" % of the ampere-turns: {hint}; widen the range" in str(refused.value)


@pytest.mark.parametrize(("voltage", "says"), [("24 V", "✓ 14 ohm in series gives 1 A"), ("5 V", "! 1 A needs 10 V")])
def test_the_current_that_is_found_is_set_beside_the_supply(voltage, says):
    coil = {"coil.resistance": "10 ohm", "coil.turns": None, "coil.voltage": voltage}
    (said,) = _of_the_supply(emclutch.load_case(QUICKSTART, coil).scene)
    mark, text = says.split(" ", 1)
    assert text in said.text and (said.mark is Mark.WARNING) == (mark == "!")


def runs_with(torque_of):
    """A stand-in for runs: the torque of a scene by a function, to 5 %."""

    def run(case, *, out, **options):
        folder = RunFolder.create(out, case.toml())
        with HistoryWriter(folder.history) as history:
            history.append({"time": 1.0, "torque_disc": 1.0})
        mean = -torque_of(case)
        torque = {"mean": mean, "standard_error": 0.05 * abs(mean), "batches": 30, "converged": True, "reason": ""}
        folder.write_summary({"torque": torque})
        return load_result(folder.path)

    return run


def test_runs_of_twice_the_expected_torque_halve_the_expectation_that_is_sought(tmp_path, monkeypatch):
    """With one ratio everywhere the second run has the wanted torque, and a search by a run begins there."""
    monkeypatch.setattr(run_case, "run", runs_with(lambda case: 2.0 * emclutch.check(case, threads=1).expected.torque))
    case = case_from(CELL)
    once = design(case, 0.01, tmp_path / "once", runs=1)
    assert once.ratio == pytest.approx(2.0) and once.run.folder.path == tmp_path / "once" / "run" and not once.is_met
    assert expected(case, FIELD, once.next_value) == pytest.approx(0.005, rel=0.02)
    found = design(case, 0.01, tmp_path / "found", runs=4)
    assert found.is_met and len(found.trials) == 2 and found.nearest.value == pytest.approx(once.next_value, rel=1e-6)
    assert not found.is_certain and found.value == once.value and found.bracket == once.bracket
    assert emclutch.load_case(tmp_path / "found" / "found.toml").resolved() == found.case.resolved()
    written = json.loads((tmp_path / "found" / "design.json").read_text())
    assert written["is_met"] and [one["value"] for one in written["runs"]] == [one.value for one in found.trials]
    again = design(case, 0.01, tmp_path / "again", like=tmp_path / "once" / "run")
    assert again.value == pytest.approx(once.next_value, abs=1e-3 * 399e3)
    page = found._repr_html_()  # in a notebook
    assert "Not within 5 % of 0.01 N m" in once._repr_html_() and "The last run is within 5 % of 0.01 N m" in page
    assert page.count("<tr>") == 1 + len(found.tried) and FIELD in page
    drifting = once.run.summary["torque"] | {"converged": False, "reason": "the signal drifts", "remedy": "run longer"}
    once.run.folder.write_summary({"torque": drifting})
    with pytest.raises(OutputError, match=r"once/run is not known \(the signal drifts\); run longer"):
        design(case, 0.01, tmp_path / "third", like=tmp_path / "once" / "run")
    low, high = again.correction.interval
    assert low < 2.0 < high and high - low < 0.5
    for end, ratio in zip(again.bracket, (high, low), strict=True):
        assert expected(case, FIELD, end) == pytest.approx(0.01 / ratio, rel=0.1)


def test_a_ratio_that_changes_along_the_way_takes_few_runs(tmp_path, monkeypatch):
    """T = expected (H/H0)^1.5, as where powder gathers in strong fields: the tolerance of 0.5 % is met in five runs."""

    def torque_of(case):
        strength = case.scene.field.field_strength / 40e3
        return emclutch.check(case, threads=1).expected.torque * strength**1.5

    monkeypatch.setattr(run_case, "run", runs_with(torque_of))
    found = design(case_from(CELL), 0.01, tmp_path / "found", runs=8, tolerance=0.005)
    misses = [abs(trial.torque / 0.01 - 1.0) for trial in found.trials]
    assert found.is_met and len(misses) <= 5, misses
    assert torque_of(found.case) == pytest.approx(0.01, rel=0.005)


def test_runs_end_where_no_other_value_is_left(tmp_path, monkeypatch):
    """A torque that jumps over the wanted one is never met: no scene is run twice, and the nearest one is written."""

    def torque_of(case):
        return 0.02 if case.scene.field.field_strength > 60e3 else 0.009

    monkeypatch.setattr(run_case, "run", runs_with(torque_of))
    found = design(case_from(CELL), 0.01, tmp_path / "found", runs=30)
    values = sorted(trial.value for trial in found.trials)
    assert not found.is_met and len(values) < 30
    assert all(b - a > 1e-4 * 399e3 for a, b in pairwise(values))
    assert found.nearest.torque == pytest.approx(0.009)
    assert emclutch.load_case(tmp_path / "found" / "found.toml").resolved() == found.case.resolved()


def test_a_gap_is_found_again_by_the_torque_of_its_own_field(tmp_path):
    """From the command line, the field solved again for each gap; a wider one has less field and less torque."""
    coarse = {"field.size_factor": 2.5, "field.gap_layers": 3}
    target = expectation_of(emclutch.load_case(QUICKSTART, coarse | {"geometry.gap": "1.1 mm"})).torque
    values = [word for key, value in coarse.items() for word in ("--set", f"{key}={value}")]
    aim = ["--vary", "geometry.gap=0.8 mm:1.6 mm", "--target", f"torque {target!r} N m"]
    answer = CliRunner().invoke(
        app, ["design", str(QUICKSTART), *aim, *values, "--json", "--out", str(tmp_path / "at")]
    )
    assert answer.exit_code == 0, answer.output
    reported = json.loads(answer.stdout)
    assert reported["expected_torque"] == pytest.approx(target, rel=5e-3)
    assert reported["value"] == pytest.approx(1.1e-3, rel=0.03)
    rows = [line.split(",") for line in (tmp_path / "at" / "design.csv").read_text().splitlines()]
    assert rows[0] == ["geometry.gap", "expected_torque"]
    assert float(rows[1][1]) > target > float(rows[-1][1])


def test_faults_of_a_design_file_come_together(tmp_path):
    file = tmp_path / "design.toml"
    text = '[design]\ncase = "{}"\nvary = "{}"\nbetween = {}\ntarget = "{}"\n[design.set]\n"{}" = 3\n'
    file.write_text(text.format(QUICKSTART, "geometry.gpa", "[1, 2]", "12 N", "time.ende"))
    with pytest.raises(SceneError) as refused:
        read_design(file)
    assert {fault.key for fault in refused.value.faults} == {"design.vary", "design.target", "design.set.time.ende"}
    file.write_text(text.format(QUICKSTART, "geometry.gap", '["3 mm", "1 kg"]', "torque 12 kg", "scene.seed"))
    with pytest.raises(SceneError) as refused:
        read_design(file)
    reported = [str(fault) for fault in refused.value.faults]
    assert len(reported) == 2 and "'1 kg' is a mass" in reported[0] and "torque 12 kg" in reported[1]
    file.write_text(text.format(QUICKSTART, "particles.count", "[1, 2]", "torque 12 N m", "scene.seed"))
    with pytest.raises(SceneError, match=r"design\.vary = 'particles\.count' is not a continuous quantity"):
        read_design(file)
    answer = CliRunner().invoke(app, ["design", str(file), "--target", "torque 1 N m"])
    assert answer.exit_code == 2 and "--target is given in" in answer.stderr
    answer = CliRunner().invoke(app, ["design", str(QUICKSTART)])
    assert answer.exit_code == 2 and "--vary is needed" in answer.stderr and "--target is missing" in answer.stderr
