"""`emclutch fit`: torques by the law give their powder back, what it writes, the curve it reads, what it refuses."""

import json
import re
from pathlib import Path

import numpy as np
import pandas
import pytest
import sheared_annulus
import tomli_w
from typer.testing import CliRunner

import emclutch
from emclutch.cli.fit import ends_of
from emclutch.cli.main import app
from emclutch.device_model.device import build_device
from emclutch.results import OutputError
from emclutch.scene.case import case_from
from emclutch.scene.errors import SceneError
from emclutch.simulation.forecast.expected_field import expected_magnetisation
from emclutch.simulation.forecast.expected_torque import torques_of_powders
from emclutch.simulation.forecast.powder_law import shipped_laws
from emclutch.studies.design_search import expectation_of
from emclutch.studies.fit import fit
from emclutch.studies.torque_fit import read_torques

CASES = Path(__file__).resolve().parents[2] / "cases"
COARSE = {"field.size_factor": 4.0, "field.gap_layers": 3}
FIELD, CURRENT, FRICTION, ROLLING, FILL = (
    "field.field_strength", "coil.current", "contact.friction", "effects.rolling_friction.coefficient",
    "particles.solid_fraction",
)  # fmt: skip
CELL = sheared_annulus.CELL


def write(folder, name, text):
    path = folder / name
    path.write_text(text)
    return path


def bench(folder, case, currents, factor=1.0):
    """The curve of a scene by the law, with errors of 2 % of each point."""
    torques = [factor * expectation_of(case.with_values({CURRENT: one})).torque for one in currents]
    rows = "".join(f"{one},{T:.6g},{0.02 * T:.6g}\n" for one, T in zip(currents, torques, strict=True))
    return write(folder, f"bench-{factor:g}.csv", "current [A], torque [N m], error [N m]\n" + rows)


@pytest.fixture(scope="module")
def quickstart():
    return emclutch.load_case(CASES / "quickstart.toml", COARSE)


def test_torques_of_many_powders_are_those_of_their_scenes(quickstart):
    """One device with three laws and four fills, B interpolated between solves: within 0.2 % of each scene alone."""
    pairs, fills = ((0.3, 0.2), (0.6, 0.228), (0.6, 0.054)), np.array([0.25, 0.29, 0.36, 0.42])
    base = quickstart.with_values({"particles.mass": None, "particles.count": None, FILL: 0.3})
    scene, laws = base.scene, shipped_laws()
    device = build_device(scene)
    field, _ = expected_magnetisation(base, device)
    chi = scene.grains.susceptibility
    torque, error, guess = torques_of_powders(scene, device, field, [laws.of(*pair, chi) for pair in pairs], fills)
    for i, (friction, rolling) in enumerate(pairs):
        for j, fill in enumerate(fills.tolist()):
            case = base.with_values({FRICTION: friction, ROLLING: rolling, FILL: fill})
            alone = expectation_of(case, device.driven_as(case.scene))
            assert torque[i, j] == pytest.approx(alone.torque, rel=2e-3)
            parts = [half / 1.96 for name, half in alone.parts.items() if name != "form"]
            assert alone.real.is_guess == (guess[i, j] > 0.0)
            assert alone.real.is_guess or error[i, j] == pytest.approx(np.linalg.norm(parts), rel=2e-2)


def test_half_of_the_scatter_about_the_form_of_the_law_is_common_to_all_fields():
    """Mean product of the deviations of gap cells that differ in the field alone, of near fields and of far ones."""
    cells = pandas.read_csv(CASES.parent / "docs" / "gap_cells.csv", comment="#").query("spread == 1")
    laws, Ms = shipped_laws(), 1.3e6
    same, rows = ["friction", "rolling_friction", "susceptibility", "fill", "height", "edge", "set_inertial_number"], []
    for powder, own in cells.groupby(same[:3]):
        law = laws.of(*powder)
        for _, one in own.iterrows():
            tau = float(law.stress(one.flux_density, Ms, one.fill, one.height, one.inertial_number))
            rows.append({**one[[*same, "field_strength"]], "miss": np.log(one.shear_stress / tau)})
    table = pandas.DataFrame(rows)
    pairs = table.merge(table, on=same).query("field_strength_x < field_strength_y")
    apart = np.log(pairs.field_strength_y / pairs.field_strength_x)
    product, half = pairs.miss_x * pairs.miss_y, 0.5 * (table.miss**2).mean()
    for some in (apart < 0.7, apart >= 0.7):
        error = product[some].std() / np.sqrt(some.sum())
        assert 0.0 < error < 0.5 * half and abs(product[some].mean() - half) < 3.0 * error


def test_the_powder_of_a_curve_is_found_again(quickstart, tmp_path):
    """Friction 0.5, rolling friction 0.15, not one of the simulated powders; the angle of repose narrows both down."""
    truth = quickstart.with_values({FRICTION: 0.5, ROLLING: 0.15, "particles.repose": None})
    curve = bench(tmp_path, truth, (0.3, 0.5, 0.8))
    words = ["fit", CASES / "quickstart.toml", "--to", curve, "--common-error", "3 %", "--out", tmp_path / "fit"]
    words += [word for key, value in COARSE.items() for word in ("--set", f"{key}={value}")]
    done = CliRunner().invoke(app, [*map(str, words)], env={"COLUMNS": "500"})
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "fit" / "fit.json").read_text())
    for one, (name, value) in zip(found["parameters"], ((FRICTION, 0.5), (ROLLING, 0.15)), strict=True):
        assert one["name"] == name and one["low"] <= value <= one["high"]
    assert not found["is_poor"] and not found["is_guess"] and found["guess_points"] == 0
    low, high = found["repose"]
    assert low < np.radians(28.0) < high and high - low < np.radians(12.0)  # emclutch powder gives 27.6 degrees
    assert f"{FRICTION} is not determined: all values from 0.2 to 0.7" in done.output
    assert "All of them change the strength of the powder" in done.output
    table = pandas.read_csv(tmp_path / "fit" / "fit.csv")
    assert (abs(table.torque / table.torque_measured - 1.0) < 0.02).all()
    assert ((table.low < table.torque_measured) & (table.torque_measured < table.high)).all()
    fitted = emclutch.load_case(tmp_path / "fit" / "fitted.toml").scene
    assert fitted.contact.friction == pytest.approx(found["parameters"][0]["value"], rel=1e-3)
    assert (tmp_path / "fit" / "fit.png").stat().st_size > 10_000
    assert "Next: map the torque of these values: emclutch map" in done.output and "emclutch powder-law" in done.output
    assert CliRunner().invoke(app, [*map(str, words)]).exit_code == 2  # the folder is there
    closer = fit(quickstart, curve, repose=(np.radians(28.0), np.radians(1.0)), out=tmp_path / "closer")
    assert closer.fit.parameters[1].low <= 0.15 <= closer.fit.parameters[1].high
    assert low < closer.repose[0] < np.radians(28.0) < closer.repose[1] < high


def test_where_nothing_fits_points_and_suspects_are_named_and_no_value_is_offered(quickstart, tmp_path):
    """The last torque is halved, as by a coil that became warm at a voltage; the clearance takes 29 % of N I."""
    curve = bench(tmp_path, quickstart, (0.5, 0.8))
    *rows, last = curve.read_text().splitlines()
    current, torque, _ = last.split(",")
    curve.write_text("\n".join([*rows, f"{current},{float(torque) / 4.0},{float(torque) / 80.0}\n"]))
    found = fit(quickstart, curve, rolling_friction=0.2, out=tmp_path / "fit")
    lines = [line.text for line in found.report().statements()]
    assert found.fit.is_poor and lines[0].startswith("No parameters in the range fit")
    assert re.match(r"Largest misfits, measured against the nearest curve: -7\d % at 0.8 A, ", lines[1])
    assert re.search(r"geometry\.clearance \(it takes (2|3)\d % of the ampere-turns\), B-H curve", lines[2])
    assert lines[3].startswith("Nearest values in the range, not to be used: contact.friction = ")
    assert f"to {float(torque) / 4.0:.3g} N m at 0.8 A, by more than its errors; by the law it cannot fall" in lines[4]
    assert not any("emclutch map" in line or "95 %:" in line for line in lines)
    assert json.loads((tmp_path / "fit" / "fit.json").read_text())["fall"][1][0] == 0.8


def test_a_common_factor_and_a_parameter_at_the_limit_of_its_range_are_said(quickstart, tmp_path):
    """Three times the torque is that of no powder; 1.08 times that of the largest fill ends at this fill."""
    rolling, truth = quickstart.scene.effects.rolling.coefficient, {"particles.mass": None, FILL: 0.34}
    case = quickstart.with_values(truth | {"particles.count": None})
    options = {"friction": quickstart.scene.contact.friction, "rolling_friction": rolling, "fill": (0.25, 0.34)}
    wrong = fit(quickstart, bench(tmp_path, case, (0.4, 0.8), 3.0), **options, out=tmp_path / "a")
    assert wrong.fit.is_poor and wrong.fit.has_shape and wrong.fit.factor == pytest.approx(3.0, rel=0.02)
    assert "The curve has the shape of the law: 3 times the nearest curve fits" in str(wrong.report().statements())
    ended = fit(quickstart, bench(tmp_path, case, (0.4, 0.8), 1.08), **options, out=tmp_path / "b")
    first = ended.report().statements()[0].text
    assert first.startswith(f"{FILL} ends at the limit of its range, 0.34 (95 %: ") and "are 1.08 times" in first


def test_the_fill_of_a_curve_is_found_again_and_more_torque_is_more_powder(quickstart, tmp_path):
    truth = quickstart.with_values({"particles.mass": None, "particles.count": None, FILL: 0.34})
    rolling = quickstart.scene.effects.rolling.coefficient
    options = {"friction": quickstart.scene.contact.friction, "rolling_friction": rolling, "fill": (0.25, 0.45)}
    (one,) = fit(quickstart, bench(tmp_path, truth, (0.4, 0.8)), **options, out=tmp_path / "a").fit.parameters
    assert one.name == FILL and one.value == pytest.approx(0.34, abs=0.003) and one.bounded == (True, True)
    more = fit(quickstart, bench(tmp_path, truth, (0.4, 0.8), 1.1), **options, out=tmp_path / "b")
    assert more.fit.parameters[0].low > one.low and more.fit.parameters[0].value > one.value + 0.01
    assert more.case.scene.particles.mass is None and more.repose is None


def test_a_device_outside_of_the_law_is_a_guess_and_is_said(tmp_path):
    """An annulus has no pole faces: strengths within a factor of 2."""
    near = {"model": "near_field", "cutoff": 2.5}
    cell = case_from(CELL, {"effects.dipoles": near, "effects.wall_images": {}, "particles.diameter": "0.15 mm"})
    torques = [expectation_of(cell.with_values({FIELD: H, ROLLING: 0.2})).torque for H in (100e3, 150e3)]
    curve = write(tmp_path, "m.csv", f"H [kA/m], torque [mN m], error [mN m]\n0,0,1\n100,{1e3 * torques[0]},1\n"
                  f"150,{1e3 * torques[1]},1\n")  # fmt: skip
    found = fit(cell, curve, friction=0.3, over=FIELD, out=tmp_path / "fit")
    assert found.fit.is_guess and found.left_out == 1
    assert "The fit is a guess, as is the torque: guess by the law of the powder" in str(found.report().statements())
    assert not any(found.fit.parameters[0].bounded)


def test_a_table_without_errors_has_no_test_of_the_fit_and_a_trend_is_said(quickstart, tmp_path):
    """T + drag: the misfit alone gives the errors of single points, so its probability would say nothing."""
    case = quickstart.with_values({"motion.drag_torque": 0.03, "geometry.seal_radius": "18.7 mm"})
    rows = bench(tmp_path, case, (0.3, 0.4, 0.6, 1.0)).read_text().splitlines()[1:]
    points = [(float(I), float(T) + 0.03) for I, T, _ in (row.split(",") for row in rows)]
    curve = write(tmp_path, "m.csv", "I [A], T [N m]\n" + "".join(f"{I},{T}\n" for I, T in points))
    rolling = case.scene.effects.rolling.coefficient
    found = fit(case, curve, rolling_friction=rolling, out=tmp_path / "a")
    lines = " ".join(line.text for line in found.report().statements())
    assert "No test of the fit is possible: the table has no errors." in lines and "probability" not in lines
    assert "Measured divided by fitted torque falls from 1." in lines and "drag or remanence rather than" in lines
    assert "So large a scatter makes the values doubtful." in lines and "motion.drag_torque = 0.03 N m" in lines
    assert json.loads((tmp_path / "a" / "fit.json").read_text())["probability"] is None
    assert f"The scene's own values fit too: {FRICTION} = {case.scene.contact.friction:.3g}." in lines
    assert "seal_radius = 0.0187\n" in (tmp_path / "a" / "fitted.toml").read_text()
    assert not fit(case, curve, rolling_friction=0.5 * rolling, out=tmp_path / "b").own  # of another rolling friction


def test_a_measured_curve_is_read_in_its_units(tmp_path):
    path = write(
        tmp_path, "m.csv", "\ufeff# brake\ncurrent [mA], torque [mN m], error (mN m)\n\n400,300,5\n200, 90, 3\n0,1,1\n"
    )
    found, left_out = read_torques(path, "A")
    assert found.drive == pytest.approx([0.2, 0.4])
    assert found.torque == pytest.approx([0.09, 0.3]) and found.error == pytest.approx([0.003, 0.005])
    assert left_out == 1
    assert read_torques(write(tmp_path, "n.csv", 'I/"A",T/"N cm"\n1,200\n'), "A")[0].torque == pytest.approx([2.0])
    assert read_torques(tmp_path / "n.csv", "A")[0].error is None


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("", "has no table"),
        ("current, torque\n1,2\n", "column 'current' has no unit; write the unit of your numbers"),
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


def test_a_common_error_out_of_range_is_refused(tmp_path):
    with pytest.raises(SceneError, match=r"common_error = 3 is out of range; allowed: >= 0, < 1"):
        fit(case_from(CELL), tmp_path / "none.csv", common_error=3.0, out=tmp_path / "fit")


def test_powder_without_magnetism_has_no_law(tmp_path):
    curve = write(tmp_path, "m.csv", "H [kA/m], torque [N m]\n100,0.01\n150,0.02\n200,0.03\n")
    dry = case_from(CELL, {"effects.dipoles": None})
    with pytest.raises(SceneError, match="no magnetised powder is sheared"):
        fit(dry, curve, over=FIELD, out=tmp_path / "fit")
    assert not (tmp_path / "fit").exists()


def test_a_value_or_a_range_is_read():
    assert ends_of("0.4", "--friction") == 0.4 and ends_of("0.25:0.4", "--fill") == (0.25, 0.4)
    with pytest.raises(SceneError, match="is not a value or a range"):
        ends_of("0.2:0.3:0.4", "--friction")


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (("--friction", "0.3", "--rolling-friction", "0.1"), "nothing is fitted"),
        (("--friction", "-1:1"), "out of range"),
        (("--friction", "0.2:5"), "the law of the powder holds from 0.2 to 0.7"),
        (("--over", "particles.region"), "not a continuous quantity"),
        (("--over", "coil.nothing"), "coil.nothing"),
        (("--repose", "200 deg"), "out of range"),
        (("--uncertainty", "2 deg"), "needs --repose"),
        (("--common-error", "3,5 %"), "has a decimal comma; decimals follow a point: 3.5"),
        (("--common-error", "3"), "is not a percentage"),
        (("--common-error", "3 %, 5 %"), "has 2 entries; give one"),
        (("--over", "coil.current"), "the scene does not have; name its drive"),
        (("--fill", "0.3:0.7", "--rolling-friction", "0"), "particles.solid_fraction = 0.7 fills 0.7"),
        (("--fill", "0.3:0.4"), "has 3 points without errors, too few for 3 parameters"),
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
