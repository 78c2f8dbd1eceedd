"""Measured points lie over the torque of a run and of a study; a table that cannot be read stops both before they run.

One scene at toy size, the quickstart on part of its sector.
"""

from pathlib import Path

import pandas
import pytest
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.results import pictures
from emclutch.results.current_ramp import PICTURE, TABLE
from emclutch.results.pictures import current_ramp, torque_curves

QUICKSTART = Path(__file__).resolve().parents[2] / "cases" / "quickstart.toml"
TOY = {
    "time.end": "0.05 ms", "time.window": "10 us", "particles.sector": "3.75 deg", "field.size_factor": 2.0,
    "accuracy.replicas": 1, "output.snapshots": 0, "output.formats": [],
}  # fmt: skip
SETS = [word for key, value in TOY.items() for word in ("--set", f"{key}={value}")]


def invoke(*arguments):
    return CliRunner().invoke(app, [str(one) for one in arguments], env={"COLUMNS": "300"})


@pytest.fixture
def drawn(monkeypatch):
    """The measured torques of every picture over the current, in its unit, in the order in which they are drawn."""
    found = []

    def draw(axis, measured, *, per_y=1.0, **options):
        found.append({name: (per_y * points[:, 1]).tolist() for name, points in (measured or {}).items()})
        return original(axis, measured, per_y=per_y, **options)

    original = pictures.figure.draw_measured
    for module in (current_ramp, torque_curves):
        monkeypatch.setattr(module, "draw_measured", draw)
    return found


@pytest.fixture
def bench(tmp_path):
    """A table as a test bench writes it, in mA and N cm."""
    path = tmp_path / "bench.csv"
    path.write_text("current [mA];torque [N cm]\n500;40\n1000;75,5\n")
    return path


POINTS = {"torque": pytest.approx([0.4, 0.755])}


def test_a_run_and_its_report_have_the_measured_points(tmp_path, bench, drawn):
    """Kept in the run's folder, in its picture and its page; over the branches of a ramp where there are any."""
    folder = tmp_path / "run"
    done = invoke("run", QUICKSTART, "--out", folder, "--with", bench, *SETS)
    assert done.exit_code == 0, done.output
    assert drawn == [POINTS] and (folder / PICTURE).stat().st_size > 10_000
    assert (folder / "measured.csv").read_text() == bench.read_text()
    page = (folder / "index.html").read_text()
    assert page.count("<img ") == 4 and 'href="measured.csv"' in page
    reported = invoke("report", folder, "--html", "--with", bench)
    assert reported.exit_code == 0 and drawn == [POINTS] * 2
    assert "with bench.csv laid over" in (folder / "report.html").read_text()
    rise = {"branch": 1, "course": "rising", "current": [0.1, 0.9], "torque": [1e-4, 9e-4], "low": 0.0, "high": 1e-3}
    pandas.DataFrame(rise).to_csv(folder / TABLE)
    over = invoke("plot", folder, "--torque-current", "--with", bench)  # drawn in mN m
    assert over.exit_code == 0 and drawn == [POINTS, POINTS, {"torque": pytest.approx([400.0, 755.0])}]


def test_a_study_and_its_report_have_the_measured_points(tmp_path, bench, drawn):
    study, folder = tmp_path / "study.toml", tmp_path / "study"
    values = "".join(f"{key!r} = {value!r}\n" for key, value in (TOY | {"output.pictures": "x"}).items())
    values = values.replace("'x'", "false")
    currents = "[study.values]\n'coil.current' = ['0.5 A', '1 A']\n"
    study.write_text(f"[study]\ncase = {str(QUICKSTART)!r}\n{currents}[study.set]\n{values}")
    done = invoke("sweep", study, "--out", folder, "--with", bench)
    assert done.exit_code == 0, done.output
    assert drawn[-1] == POINTS and (folder / PICTURE).stat().st_size > 10_000
    page = (folder / "index.html").read_text()
    assert page.count("<img ") == 1 and 'href="measured.csv"' in page
    del drawn[:]
    reported = invoke("report", folder, "--html", "--with", bench)
    assert reported.exit_code == 0 and drawn == [POINTS]
    assert "with bench.csv laid over" in (folder / "report.html").read_text()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("current [A],torque [kg]\n1,2\n", "'torque' is in 'kg', which is unknown or of another quantity; known: Nm"),
        ("current [A],torque [N m]\n1,two\n", "line 2: torque = 'two' is not a number"),
        ("1,2\n3,4\n", "line 1 has numbers but no header"),
    ],
)
def test_a_table_that_cannot_be_read_stops_the_run_before_it_begins(tmp_path, text, says):
    table, folder = tmp_path / "bench.csv", tmp_path / "run"
    table.write_text(text)
    asked = invoke("run", QUICKSTART, "--out", folder, "--with", table)
    assert asked.exit_code == 2 and says in asked.output and not folder.exists()


def test_points_that_no_picture_would_show_are_refused(tmp_path, bench):
    magnetic = ("magnetic_force", "dipoles", "saturation", "wall_images", "back_reaction")
    without_field = [word for name in magnetic for word in ("--set", f"effects.{name}=off")]
    for sets, says in ((["--set", "output.pictures=false"], "output.pictures = false"), (without_field, "has none")):
        asked = invoke("run", QUICKSTART, "--out", tmp_path / "run", "--with", bench, *sets)
        assert asked.exit_code == 2 and says in asked.output and not (tmp_path / "run").exists()
    beside = invoke("run", QUICKSTART, "--with", bench, "--dry-run")
    assert beside.exit_code == 2 and "--with cannot be combined with --dry-run" in beside.output
