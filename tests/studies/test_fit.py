"""`emclutch fit`: the study it runs, what it writes, the curve it reads, and what it refuses."""

import json
import re

import numpy as np
import pytest
import tomli_w
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.results import OutputError
from emclutch.scene.case import case_from
from emclutch.scene.errors import SceneError
from emclutch.studies.fit import Varied, fit, study_case
from emclutch.studies.torque_fit import read_torques

FIELD = "field.field_strength"
CELL = {
    "scene": {"title": "sheared annulus", "seed": 3},
    "geometry": {"kind": "shear_cell", "inner_radius": 10e-3, "outer_radius": 11.2e-3, "height": 2e-3},
    "field": {"source": "uniform", "field_strength": "150 kA/m", "direction": "radial"},
    "particles": {"diameter": "0.3 mm", "solid_fraction": 0.35, "sector": "20 deg", "repose": "20 deg"},
    "motion": {"rotor": {"speed": "300 rpm"}, "disc": {"speed": 0.0}},
    "effects": {"magnetic_force": {}, "dipoles": {"cutoff": 2.5, "model": "mutual"}, "saturation": {}},
    "time": {"end": "0.2 ms", "window": "20 us"},
    "output": {"snapshots": 0, "pictures": False, "formats": []},
    "accuracy": {"replicas": 1},
}


def write(folder, name, text):
    path = folder / name
    path.write_text(text)
    return path


def test_the_friction_of_a_run_is_found_again(tmp_path):
    """A curve that two runs of friction 0.3 give, fitted by runs of 0.1 and 0.6; resumed, nothing is run again."""
    scene = write(tmp_path, "cell.toml", tomli_w.dumps(CELL))
    case = emclutch.load_case(scene, {"particles.repose": None, "contact.friction": 0.3})
    rows = []
    for field in (100e3, 200e3):
        run = emclutch.run(case.with_values({FIELD: field}), out=tmp_path / f"{field}", threads=1)
        rows.append(f"{field / 1e3},{1e3 * abs(run.torque.mean)}\n")
    curve = write(tmp_path, "measured.csv", "field [kA/m], torque [mN m]\n0,0\n" + "".join(rows))
    arguments = ["fit", scene, "--to", curve, "--over", FIELD, "--out", tmp_path / "fit", "--threads", 1]
    arguments += ["--friction", "0.1, 0.6", "--rolling-friction", "0", "--common-error", "3 %"]
    done = CliRunner().invoke(app, [str(one) for one in arguments])
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "fit" / "fit.json").read_text())
    (friction,) = found["parameters"]
    assert friction["name"] == "contact.friction" and 0.1 < friction["value"] < 0.6
    assert (found["measured_points"], found["left_out"], found["common_error"]) == (2, 1, 0.03)
    assert "The intervals contain a common error of 3 % of all measured torques" in done.output
    fitted = emclutch.load_case(tmp_path / "fit" / "fitted.toml").scene
    assert fitted.contact.friction == friction["value"] and fitted.particles.repose is None
    assert fitted.effects.rolling is None
    assert len(emclutch.load_study(tmp_path / "fit" / "points").table) == 4
    assert (tmp_path / "fit" / "fit.png").stat().st_size > 10_000
    times = [path.stat().st_mtime_ns for path in sorted((tmp_path / "fit").glob("points/point-*/history.csv"))]
    again = CliRunner().invoke(app, [*(str(one) for one in arguments), "--resume", "--json"])
    assert again.exit_code == 0, again.output
    assert json.loads(again.stdout)["parameters"] == [friction]
    assert times == [path.stat().st_mtime_ns for path in sorted((tmp_path / "fit").glob("points/point-*/history.csv"))]
    assert CliRunner().invoke(app, [str(one) for one in arguments]).exit_code == 2  # the folder is there
    for other, key in (("--friction=0.1, 0.5", "contact.friction"), ("--set=time.end=0.3 ms", "time.end")):
        mixed = CliRunner().invoke(app, [*(str(one) for one in arguments), "--resume", other])
        assert mixed.exit_code == 2 and f"was begun with another {key}; give what" in " ".join(mixed.output.split())


def test_a_measured_curve_is_read_in_its_units(tmp_path):
    path = write(
        tmp_path, "m.csv", "\ufeff# brake\ncurrent [mA], torque [mN m], error (mN m)\n\n400,300,5\n200, 90, 3\n0,1,1\n"
    )
    found, left_out = read_torques(path, "A")
    assert found.drive == pytest.approx([0.2, 0.4])
    assert found.torque == pytest.approx([0.09, 0.3]) and found.error == pytest.approx([0.003, 0.005])
    assert left_out == 1
    assert read_torques(write(tmp_path, "n.csv", "I [A],T [N m]\n1,2\n"), "A")[0].error is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "has no table"),
        ("current, torque\n1,2\n", "column 'current' has no unit; write current [A]"),
        ("current [kg], torque [N m]\n1,2\n", "'kg', which is unknown or of another quantity; known: A"),
        ("current [A], torque [N m]\n1,two\n", "line 2: torque = 'two' is not a number"),
        ("current [A], torque [N m]\n1\n", "line 2 has 1 entries for 2 columns"),
        ("current [A], torque [N m]\n1,nan\n", "line 2: torque = 'nan' is not a number"),
        ("current [A], torque [N m], error [N m]\n1,2,0\n", "without an error above 0"),
        ("current [A], cold [N m], warm [N m]\n1,2,3\n", "leave one, and name the column of standard errors 'error"),
        ("current [A], torque [N m]\n0,1\n1,0\n", "no point"),
    ],
)
def test_a_curve_that_cannot_be_read_is_explained(text, says, tmp_path):
    with pytest.raises(OutputError, match=re.escape(says)):
        read_torques(write(tmp_path, "m.csv", text), "A")
    with pytest.raises(OutputError, match="cannot be read"):
        read_torques(tmp_path / "none.csv", "A")


def test_a_sheared_box_has_no_torque_to_fit(tmp_path):
    box = CELL | {"geometry": {"kind": "sheared_box", "size": 3 * [2e-3], "shear_rate": 500.0}}
    box |= {"field": CELL["field"] | {"direction": "z", "means": "macroscopic"}, "motion": {}}
    box |= {"particles": {"diameter": "0.3 mm", "solid_fraction": 0.35}}
    with pytest.raises(SceneError, match=r"geometry.kind = 'sheared_box' has no torque"):
        fit(case_from(box), tmp_path / "none.csv")


def test_a_common_error_out_of_range_is_refused_before_anything_runs(tmp_path):
    with pytest.raises(SceneError, match=r"common_error = 3 is out of range; allowed: >= 0, < 1"):
        fit(case_from(CELL), tmp_path / "none.csv", common_error=3.0, out=tmp_path / "fit")
    assert not (tmp_path / "fit").exists()


def test_what_is_varied_goes_by_the_keys_of_the_scene():
    case = case_from(CELL)
    keys = Varied(friction=(0.5, 0.2), rolling=(0.0, 0.3), fill=(0.3,)).keys(case.scene)
    assert keys == {
        "contact.friction": (0.2, 0.5), "effects.rolling_friction.coefficient": (0.0, 0.3),
        "particles.solid_fraction": (0.3,),
    }  # fmt: skip
    heavy = case_from(CELL | {"particles": {"diameter": "0.3 mm", "mass": "0.5 g", "sector": "20 deg"}})
    assert study_case(heavy, keys).scene.particles.mass is None


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--friction", "0.3", "--rolling-friction", "0.1"), "nothing is fitted"),
        (("--friction", "-1, 1"), "out of range"),
        (("--over", "particles.region"), "not a continuous quantity"),
        (("--over", "coil.nothing"), "coil.nothing"),
        (("--friction", "0.2, 5", "--repose", "20 deg"), "beyond the table"),
        (("--repose", "200 deg"), "out of range"),
        (("--common-error", "3"), "is not a percentage"),
        (("--common-error", "3 %, 5 %"), "has 2 entries; give one"),
        (("--resume",), "needs a fit that was begun"),
        (("--at", "10 kA/m, 20 kA/m"), "0 points at the simulated drives, 10000 to 20000 A/m, too few"),
        (("--over", "coil.current"), "the scene does not have; name its drive"),
        (("--fill", "0.3, 0.7", "--rolling-friction", "0"), "particles.solid_fraction = 0.7 fills 0.7"),
    ],
)
def test_what_cannot_be_asked_is_explained(options, says, tmp_path):
    scene = write(tmp_path, "cell.toml", tomli_w.dumps(CELL))
    curve = write(tmp_path, "m.csv", "H [kA/m], torque [N m]\n100,0.01\n150,0.02\n200,0.03\n")
    over = () if "--over" in options else ("--over", FIELD)
    done = CliRunner().invoke(app, ["fit", str(scene), "--to", str(curve), *over, *options])
    assert done.exit_code == 2
    assert says in " ".join(done.output.split())
    assert np.unique([path.name for path in tmp_path.iterdir()]).tolist() == ["cell.toml", "m.csv"]
