"""What a command says first: check what counts, accuracy what it would cost, a failed run why, a stopped one one line.
"""

import subprocess
import sys
from pathlib import Path

import pandas
import pytest
from typer.testing import CliRunner

from emclutch.cli.fit import angle_of
from emclutch.cli.main import app
from emclutch.results import RunFolder
from emclutch.results.report.render import write_failed_index
from emclutch.scene.errors import SceneError
from emclutch.studies.accuracy import study
from emclutch.studies.field_result import FieldResult
from emclutch.studies.heat import HeatResult

setting_tasks = study.setting_tasks
CASES = Path(__file__).parents[2] / "cases"
COARSE = ("--set", "field.size_factor=2")


def test_check_says_what_counts_on_a_page_and_the_rest_on_request():
    short = CliRunner().invoke(app, ["check", str(CASES / "quickstart.toml")]).output
    assert len(short.splitlines()) <= 40
    for word in ("OK", "expected torque", "cost", "--details", "effects: "):
        assert word in short
    whole = CliRunner().invoke(app, ["check", str(CASES / "quickstart.toml"), "--details"]).output
    assert "ampere-turns" in whole and "not in this scene" in whole and "ampere-turns" not in short


def test_accuracy_says_what_it_would_measure_and_writes_nothing(tmp_path, monkeypatch):
    """With two of the settings only: to plan each takes a second."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(study, "setting_tasks", lambda base: setting_tasks(base)[:2])
    result = CliRunner().invoke(app, ["accuracy", str(CASES / "quickstart.toml"), "--dry-run", *COARSE])
    assert result.exit_code == 0, result.output
    assert "4 packings at the scene's own settings" in result.output and "grains across, 4" in result.output
    assert "packings at the scene's own settings; the four above run in any case" in " ".join(result.output.split())
    for option, value in (("--for", "5 %"), ("--budget", "1 s")):
        given = [str(CASES / "quickstart.toml"), "--dry-run", option, value, *COARSE]
        refused = CliRunner().invoke(app, ["accuracy", *given])
        assert refused.exit_code == 2 and option in refused.output, refused.output
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("check", CASES / "current_to_torque.toml", "--details"), "--details is for scenes"),
        (("run", CASES / "quickstart.toml", "--dry-run", "--out", "x"), "--out has no meaning beside --dry-run"),
        (("sweep", CASES / "current_to_torque.toml", "--dry-run", "--jobs", 2), "--jobs has no meaning beside"),
        (("design", CASES / "which_current.toml", "--within", "3 %"), "--within has no meaning without --runs"),
        (("design", CASES / "which_current.toml", "--threads", 1), "--threads has no meaning without --runs"),
        (("materials", "--plot", "x.png", "--json"), "--json has no meaning beside --plot"),
    ],
)
def test_an_option_without_a_meaning_is_refused(arguments, says):
    found = CliRunner().invoke(app, [str(one) for one in arguments])
    assert found.exit_code == 2 and says in " ".join(found.output.split()), found.output


def test_the_error_of_an_angle_needs_the_angle():
    assert angle_of(None, None) is None
    with pytest.raises(SceneError, match="--uncertainty has no meaning without --repose"):
        angle_of(None, "2 deg")


def test_a_run_that_fails_leaves_a_page_that_says_why(tmp_path):
    folder = RunFolder.create(tmp_path / "run", '[scene]\ntitle = "a <b>brake</b>"\n')
    write_failed_index(folder, "grain 3 overlaps by 11 %. In the scene: raise contact.stiffness")
    page = folder.index.read_text()
    for words in ("failed before its first window", "raise contact.stiffness", "a &lt;b&gt;brake"):
        assert words in page
    failed = folder.read_failure()
    assert failed is not None and failed.reason in page


def test_a_stop_while_the_program_is_loaded_is_one_line():
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
    assert (done.returncode, done.stderr) == (130, "interrupted\n")


def test_a_notebook_shows_the_tables_of_field_and_heat(tmp_path):
    summary = {"units": {"current": "A"}, "currents": [{"current": 0.5, "material": "<steel>"}]}
    shown = FieldResult(tmp_path / "field", summary)._repr_html_()
    assert "current [A]" in shown and "0.5" in shown and "&lt;steel&gt;" in shown
    table = pandas.DataFrame([{"coil": 351.2345}])
    assert "351.2<" in HeatResult(tmp_path / "heat", {}, table, table)._repr_html_().replace(" ", "")
