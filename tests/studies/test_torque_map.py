"""A torque map has the expected torque of every scene of it with its interval, and tells what it could not have."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pandas
import pytest
import sheared_annulus
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.device_model.device import build_device
from emclutch.results import OutputError
from emclutch.results.pictures.torque_map import torque_contour_picture
from emclutch.results.report.render import terminal
from emclutch.scene.case import case_from
from emclutch.scene.errors import SceneError
from emclutch.scene.map_axes import axes_of, sheared_gap_hint
from emclutch.simulation.discretisation_error import device_of
from emclutch.simulation.forecast.expected_torque import Interval
from emclutch.studies.design_search import expectation_of
from emclutch.studies.measured_torques import compared_rows, interpolated_torques, trend_in_words
from field.laws.temperature import saturation_ratio

CASES = Path(__file__).resolve().parents[2] / "cases"
COARSE = {"field.size_factor": 4.0, "field.gap_layers": 3}
CELL = case_from(sheared_annulus.CELL)
FIELD = "field.field_strength"


def quickstart(**values):
    return emclutch.load_case(CASES / "quickstart.toml", COARSE | values)


def torque_map(out, case, **axes):
    return emclutch.map(case, out=out, **axes)


def command(*words):
    return CliRunner().invoke(app, ["map", *map(str, words)], env={"COLUMNS": "500"})


def test_each_point_is_the_expected_torque_of_its_scene_and_rises_with_the_current(tmp_path):
    """Also where it takes the mesh of another point; the interval holds the mean, that of unknown powder is wider."""
    found = torque_map(tmp_path / "map", quickstart(), current="-1 A, 0.3 A, 0.6 A, 1 A")
    for point in found.points:
        alone = expectation_of(found.case.with_values({"coil.current": point.values[0]}), unknown_powder=True)
        assert (point.torque, point.expected.unknown_powder) == (alone.real, alone.unknown_powder)
        low, high = alone.unknown_powder
        assert low < point.torque.low < point.torque.mean < point.torque.high and point.torque.high < high * 1.5
    torques = [point.torque.mean for point in found.points]
    assert torques[0] == pytest.approx(torques[3], rel=1e-9) and torques[1:] == sorted(torques[1:])
    assert list(pandas.read_csv(found.folder / "map.csv").torque) == torques
    assert (found.folder / "map.png").stat().st_size > 10_000
    assert repr(found).startswith("<MapResult: Largest torque: 0.") and " N m ± " in repr(found)
    text, page = terminal(found.report()), (found.folder / "index.html").read_text()
    assert text.startswith("✓ Largest torque: 0.") and "at coil current" in text.splitlines()[0]
    assert (
        f" {torques[1]:.4g} " in text and "Left out: " in text and "emclutch run " in text and page.count("<img") == 1
    )


@pytest.mark.parametrize(
    ("name", "entry", "changes"),
    [
        ("fill", "0.3, 0.35", {"particles.solid_fraction": 0.35, "particles.mass": None}),
        ("speed", "100 rpm, 300 rpm", {"motion.rotor.speed": "300 rpm"}),
        ("repose", "28 deg, 30 deg", {"particles.repose": "30 deg", "contact.friction": None,
                                      "effects.rolling_friction.coefficient": None}),
        ("voltage", "2 V, 3 V", {"coil.voltage": "3 V", "coil.current": None}),
        ("gap", "1 mm, 1.2 mm", {"geometry.gap": "1.2 mm"}),
    ],
)  # fmt: skip
def test_every_axis_changes_its_key_and_removes_those_that_it_replaces(tmp_path, name, entry, changes):
    """The second point is that of the scene alone, whether it has the mesh of the first or not."""
    case = quickstart(**{"particles.solid_fraction": None, "particles.mass": "2.4 g"})
    point = torque_map(tmp_path / "map", case, **{name: entry}).points[1]
    assert point.torque.mean == pytest.approx(expectation_of(case.with_values(changes)).torque, rel=1e-9)


def test_the_strongest_point_has_the_warnings_of_check(tmp_path):
    """Of copper and of the mean field in the powder, once, with the current; the scene at its own 1 A has fewer."""
    found = torque_map(tmp_path / "map", quickstart(), current="0.5 A, 3 A, 4 A")
    checked = emclutch.check(found.case.with_values({"coil.current": "4 A"}))
    expected = [text for text in (*checked.warnings, *checked.decisions["coil heat"].warnings)]
    assert len(expected) == 3 and found.warnings == [f"at coil current 4 A: {text}" for text in expected]


def test_two_axes_are_rows_of_the_first_for_each_value_of_the_second(tmp_path):
    found = torque_map(tmp_path / "map", CELL, **{FIELD: "50 kA/m:200 kA/m", "fill": "0.3, 0.35"})
    x, y = (axis.values for axis in found.axes)
    assert len(x) == 12 and [point.values for point in found.points] == [(a, b) for b in y for a in x]
    assert {row["unknown_low"] for row in found.rows} == {None}
    swapped = torque_map(tmp_path / "other", CELL, fill=[0.35, "0.3"], **{FIELD: "0.05 MA/m:0.2 MA/m:2"})
    assert [point.torque for point in swapped.points] == [found.points[n].torque for n in (0, 12, 11, 23)]


def test_the_gap_is_that_of_the_rim_or_of_the_faces_and_long_ranges_are_divided_in_equal_factors():
    for values, key in (({}, "geometry.gap"), ({"particles.region": "faces"}, "geometry.face_gap")):
        (axis,) = axes_of(quickstart(**values), {"gap": "0.8 mm:1.2 mm"})
        assert (axis.key, len(axis.values), axis.shown(axis.values[0])) == (key, 16, "0.8 mm")
    assert "is geometry.gap, not geometry.face_gap" in sheared_gap_hint(quickstart(), "geometry.face_gap")
    assert not any(sheared_gap_hint(quickstart(), key) for key in ("geometry.gap", "geometry.clearance"))
    with pytest.raises(SceneError, match=r"is no single key of geometry.kind = 'shear_cell'"):
        axes_of(CELL, {"gap": "0.8 mm:1.2 mm"})
    (axis,) = axes_of(quickstart(), {"current": "0.01 A:1 A"})
    assert axis.is_logarithmic and axis.values[1] / axis.values[0] == pytest.approx(100 ** (1 / 15))


@pytest.mark.parametrize(
    ("words", "says"),
    [
        ((), "map needs one or two axes, e.g. --current '0.1 A:1.5 A'; possible are --current, --voltage"),
        (("--current", "1 A:2 A", "--gap", "1 mm:2 mm", "--fill", "0.3:0.4"), "map needs one or two axes"),
        (("--current", "1 mm:2 mm"), "--current = '1 mm' is a length; a current is needed"),
        (("--current", "1 A:2 A:1"), "--current = '1 A:2 A:1' is not a list or a range; write"),
        (("--current", "0,5 A"), "--current = '0,5 A' has a decimal comma; decimals follow a point: 0.5; in a list a"),
        (("--current", "0.1 A:0,9 A:3"), "has a decimal comma; decimals follow a point: 0.9"),
        (("--gap", "1,2 mm"), "--gap = '1,2 mm' has a decimal comma"),
        (("--current", "1 A"), "--current = '1 A' is one value; an axis has 2 or more"),
        (("--current", "1 A:2 A:2000"), "has 2000 points; allowed: 2 to 1000"),
        (("--fill", "0.3:1.3"), "--fill = '1.3' is out of range; allowed: > 0, <= 1"),
        (("--vary", "coil.curent=1 A:2 A"), "--vary = 'coil.curent' is not a key of a scene; did you mean"),
        (("--vary", "particles.count=1:2"), "is not a continuous quantity"),
        (("--vary", "coil.current"), "is not one KEY=RANGE"),
        (("--current", "1 A:2 A", "--voltage", "1 V:2 V"), "coil.current cannot be varied together with coil.voltage"),
        (("--current", "1 A:2 A", "--vary", "coil.current=1 A:2 A"), "cannot be varied together with coil.current"),
        (("--current", "1 A:2 A", "--set", "coil.current='1 A'"), "--set = coil.current is a key of an axis"),
        (("--gap", "1 mm, 2 mm", "--set", "geometry.gap='1 mm'"), "--set = geometry.gap is a key of an axis"),
        (("--current", "1 A:2 A", "--current", "2 A:3 A"), "--current is given twice, and only the last would count"),
        (("--gap", "0.8 mm:1 mm", "--with", "none.csv"), "the first axis is geometry.gap: give the current first"),
        (("--gap", "0.1 mm:0.2 mm:2"), "has no torque at any point; at gap 0.1 mm: geometry.gap"),
    ],
)  # fmt: skip
def test_what_cannot_be_mapped_is_refused(words, says):
    refused = command(CASES / "quickstart.toml", *words)
    assert refused.exit_code == 2 and says in refused.output, refused.output


def test_a_point_whose_scene_is_invalid_is_told_and_the_others_go_on(tmp_path):
    words = ("--gap", "0.1 mm, 1 mm, 1.2 mm", "--out", tmp_path / "map", "--set", "field.size_factor=4")
    done = command(CASES / "quickstart.toml", *words, "--json")
    first, *others = json.loads(done.output)["points"]
    assert first["torque"] is None and first["remark"].startswith("geometry.gap = 0.0001 is not possible")
    assert all(row["torque"] > 0.0 and not row["remark"] for row in others)
    assert json.loads((tmp_path / "map" / "map.json").read_text())["points"] == [first, *others]


def test_the_option_given_first_is_x_and_measured_points_lie_over_the_current(tmp_path):
    table, case = tmp_path / "bench.csv", CASES / "quickstart.toml"
    table.write_text("current_mA,torque [N m]\n400,0.15\n900,0.5\n")
    words = ("--fill", "0.4, 0.45", "--current", "0.4 A, 1 A", "--set", "field.size_factor=4", "--json")
    swapped = json.loads(command(case, *words, "--out", tmp_path / "a").output)
    assert [axis["key"] for axis in swapped["axes"]] == ["particles.solid_fraction", "coil.current"]
    words = (*words[2:4], *words[:2], *words[4:], "--with", table)
    assert command(case, *words, "--out", tmp_path / "b").exit_code == 0
    assert (tmp_path / "b" / "measured.csv").is_file()
    over = CliRunner().invoke(app, ["plot", str(tmp_path / "b"), "--torque-current", "--with", str(table)])
    assert over.exit_code == 2 and "is a torque map" in over.output and "emclutch map CASE --current" in over.output
    with pytest.raises(OutputError, match="exists"):
        torque_map(tmp_path / "b", quickstart(), current="0.4 A, 1 A")


BENCH = "torque [N m];I [mA];Unsicherheit [%];T [degC]\n{};500;2;20\n{};800;;20\n1;1200;2;20\n0;0;;20\n"


def test_measured_torques_stand_beside_the_expected_ones(tmp_path):
    """Ratios of 1.02 and 1.5 to the law at currents between those of the map; what is beyond it is named alone."""
    case, table = quickstart(), tmp_path / "bench.csv"
    known = [expectation_of(case.with_values({"coil.current": current})).real for current in (0.5, 0.8)]
    table.write_text(BENCH.format(1.02 * known[0].mean, 1.5 * known[1].mean))
    with pytest.warns(UserWarning, match="not used: T"):
        found = emclutch.map(case, measured=table, current="0.4 A, 0.6 A, 0.9 A, 1.1 A", out=tmp_path / "map")
    zero, *near, beyond = found.measured
    assert zero["ratio"] is None and beyond["torque"] is None and beyond["coil.current"] == 1.2
    for row, own, ratio in zip(near, known, (1.02, 1.5), strict=True):
        assert row["ratio"] == pytest.approx(ratio, rel=1e-4) and not row["is_guess"]  # computed at these currents
        assert [row["low"], row["high"]] == pytest.approx([own.low, own.high], rel=1e-3)
    assert [row["is_inside"] for row in near] == [True, False]
    assert near[0]["standard_error"] == pytest.approx(0.02 * near[0]["torque_measured"])
    first, second, third, fourth = [line.text for line in found.report().statements()][:4]
    ends = f"{near[0]['ratio']:.2f} to {near[1]['ratio']:.2f}; 1 of 2 points lies outside of the 95 % interval"
    assert first == f"Measured divided by expected torque: {ends}: 0.8 A (+50 %)."
    assert second.endswith("at 0 A or beyond the points of the map: 0 A, 1.2 A.") and "common to all points" in third
    assert "emclutch fit " in fourth and f"--to {found.folder / 'measured.csv'}" in fourth
    assert json.loads((found.folder / "map.json").read_text())["measured"] == found.measured
    table = pandas.read_csv(found.folder / "measured_over_expected.csv")
    assert list(table.ratio[1:3]) == [row["ratio"] for row in near]
    assert "in the 95 % interval" in (found.folder / "index.html").read_text()


def test_expected_torques_between_the_points_of_a_map():
    """A power of the current is met exactly, with the wider interval beside a guess, and nothing at a gap or 0 A."""
    currents, factor = [-2.0, -1.0, 0.0, 0.5, 1.0, 2.0, 3.0, 4.0], [1.2, 1.1, 1.0, 2.0, 1.1, 1.2, 1.2, 1.2]
    means = [abs(I) ** 1.7 for I in currents]
    torques = [Interval(T, T / f, T * f, f == 2.0) for T, f in zip(means, factor, strict=True)]
    torques[6] = None
    at = [-1.5, -0.5, 0.0, 0.3, 0.7, 1.0 + 1e-12, 2.0**0.5, 3.0, 3.5, 4.0, 5.0]
    found = interpolated_torques(currents, torques, at)
    assert [one is None for one in found] == [False, True, True, True, False, False, False, True, True, False, True]
    for current, one in zip(at, found, strict=True):
        assert one is None or one.mean == pytest.approx(abs(current) ** 1.7, rel=1e-9)
    ratios = [one and (one.high / one.mean, one.mean / one.low, one.is_guess) for one in found]
    assert ratios[4] == (pytest.approx(2.0), pytest.approx(2.0), True)
    assert ratios[5] == (pytest.approx(1.1), pytest.approx(1.1), False)
    assert ratios[6][0] == pytest.approx(np.sqrt(1.1 * 1.2))
    assert interpolated_torques([1.0, 2.0], [None, torques[0]], [1.0]) == [None]


def test_of_a_second_axis_the_nearest_value_is_named(tmp_path):
    case, table = quickstart(), tmp_path / "bench.csv"
    values = {"coil.current": 0.5, "particles.solid_fraction": 0.35, "particles.mass": None}
    wide = expectation_of(case.with_values(values))
    table.write_text(f"I [A],cold [N m],warm [N m]\n0.5,{1.01 * wide.torque},\n1,,0\n")
    found = emclutch.map(case, measured=table, current="0.5 A, 1 A", fill="0.3, 0.35", out=tmp_path / "map")
    assert [(row["curve"], row["particles.solid_fraction"]) for row in found.measured] == [
        (name, fill) for fill in (0.3, 0.35) for name in ("cold", "warm")]  # fmt: skip
    first, second, *_ = [line.text for line in found.report().statements()]
    said = "Measured divided by expected torque ({}), nearest at solid fraction {}; {} of 1 points "
    assert first.startswith(said.format("cold", "0.35: 1.01", 0))
    assert second.startswith(said.format("warm", "0.3: 0.00", 1)) and second.endswith("interval: 1 A (-100 %).")


def test_the_first_line_names_judged_points_and_a_trend_its_causes(tmp_path):
    """0.05 A is a guess, twice off; T + 0.03 N m of drag at all other currents: their ratio falls to 1."""
    case, table = quickstart(**{"motion.drag_torque": "0.03 N m"}), tmp_path / "bench.csv"
    currents = (0.05, 0.4, 0.5, 0.7, 1.0)
    known = [expectation_of(case.with_values({"coil.current": one})).torque for one in currents]
    torques = [3.0 * known[0], *(T + 0.03 for T in known[1:])]
    rows = "".join(f"{I},{T}\n" for I, T in zip(currents, torques, strict=True))
    table.write_text("I [A],torque [N m]\n" + rows)
    found = emclutch.map(case, measured=table, current="0.05 A, 1 A", out=tmp_path / "map")
    lines = [line.text for line in found.report().statements()]
    first = 1.0 + 0.03 / known[1]
    assert f"95 % interval: 0.4 A ({100 * (first - 1):+.0f} %)" in lines[0] and lines[0].index(", 0.05 A (+200 %)") > 0
    assert "; the expected torque of 1 is a guess" in lines[0] and f"{first:#.3g};" in lines[0]
    falls = f"falls from {first:.3g} at 0.4 A to {1.0 + 0.03 / known[-1]:.3g} at 1 A: suspect the magnetic circuit"
    assert falls in lines[1] and not any("common to all" in line or "emclutch fit" in line for line in lines)
    assert "motion.drag_torque = 0.03 N m is not in the expected torque. Subtract it" in " ".join(lines)


@pytest.mark.parametrize(
    ("ratios", "says"),
    [
        ([1.13, 1.08, 1.03, 1.0], "falls from 1.13 at 1 to 1 at 4"), ([0.8, 0.9, 0.95, 1.0], "rises from 0.8 at 1 to"),
        ([1.03, 1.02, 1.01, 1.0], ""), ([1.13, 1.0, 1.05, 1.0], ""), ([1.2, 1.0], ""), ([1.3, 1.2, -1.0, 0.9], ""),
        ([], ""),
    ],
)  # fmt: skip
def test_a_trend_is_one_that_chance_and_the_form_of_the_law_do_not_make(ratios, says):
    for sign in (1.0, -1.0):
        points = [(sign * x, ratio) for x, ratio in enumerate(ratios, start=1)]
        found = trend_in_words("ratio", points, lambda x: f"{x:g}")
        assert says in found and bool(found) == bool(says)


def test_a_warm_device_is_that_at_20_degrees_with_all_fields_scaled(tmp_path):
    """m = Ms(T)/Ms: at m times the current and the speed the torque is m^2 times that at 20 degC, by similarity."""
    m, cold = saturation_ratio(200.0), quickstart(**{"field.temperature": "20 degC"})
    warm = quickstart(**{"coil.current": m, "motion.rotor.speed": f"{1000 * m} rpm"})
    found = torque_map(tmp_path / "map", warm, temperature=["20 degC", "473.15 K"]).points[1]
    assert found.torque.mean == pytest.approx(m**2 * expectation_of(quickstart()).torque, rel=1e-4)
    assert (cold.scene, device_of(cold)) == (quickstart().scene, device_of(quickstart()))


def test_a_warm_coil_at_a_voltage_has_less_current(tmp_path):
    """I = I(20 degC)/(1 + 0.00393 (T - 20))."""
    case = quickstart(**{"coil.voltage": "3 V", "coil.current": None})
    mapped = torque_map(tmp_path / "map", case, temperature="2 degC:200 °C:2")
    current = build_device(case.scene).coil.largest_current / (1.0 + 0.00393 * 180.0)
    given = {"coil.voltage": None, "coil.current": current, "field.temperature": 200.0}
    assert mapped.points[1].torque.mean == pytest.approx(expectation_of(case.with_values(given)).torque, rel=1e-9)
    assert "--set 'field.temperature=2 degC' --set 'coil.temperature=2 degC'" in terminal(mapped.report())
    assert mapped.axes[0].label == "temperature [degC]" and not mapped.axes[0].is_logarithmic


def test_many_values_of_a_second_axis_are_contours(tmp_path, monkeypatch):
    """Also where points are missing or a guess, and on logarithmic axes; each with the torques by rows of y."""
    drawn = []

    def contours(path, values, torque, is_guess, *rest, **options):
        drawn.append((values, torque, is_guess, options["logarithmic"]))
        return torque_contour_picture(path, values, torque, is_guess, *rest, **options)

    monkeypatch.setattr("emclutch.studies.torque_map.torque_contour_picture", contours)
    found = torque_map(tmp_path / "map", CELL, **{FIELD: "5 kA/m, 200 kA/m", "fill": "0.2:0.5:7"})
    (((x, y), torque, is_guess, scales),) = drawn
    assert torque.shape == (7, 2) and scales == [True, False]
    assert [found.points[3].torque.mean, x[1], y[1]] == [torque[1, 1], 200.0, 0.25]
    assert (torque[:, 1] > torque[:, 0]).all() and is_guess.all()  # a cell without poles
    assert (found.folder / "map.png").stat().st_size > 10_000
    torque[2:5, 0], is_guess[:3] = np.nan, False
    contours(tmp_path / "gaps.png", (x, y), torque, is_guess, ("a", "b"), logarithmic=(False, False))
    contours(tmp_path / "flat.png", (x, y), np.full((7, 2), 2.0), is_guess, ("a", "b"), logarithmic=(False, False))


def test_steel_with_hysteresis_has_more_torque_at_a_falling_current(tmp_path):
    """It begins at the torque of first magnetisation, and the branch does not depend on the currents between."""
    case = emclutch.load_case(CASES / "hysteresis.toml", COARSE)
    found = torque_map(tmp_path / "a", case, current="0 A, 0.03 A, 0.05 A, 0.1 A")
    zero, *points, last = found.points
    assert zero.falling is None and last.falling == pytest.approx(last.torque.mean, rel=1e-6)
    assert all(1.0 < point.falling / point.torque.mean < 1.3 for point in points)
    shares = [point.falling / point.torque.mean for point in points]
    assert shares == sorted(shares, reverse=True)
    text = terminal(found.report())
    assert "At a current that falls from 0.1 A the torque is up to" in text and "hysteresis of the powder" in text
    assert list(pandas.read_csv(found.folder / "map.csv").falling[1:3]) == [point.falling for point in points]
    fewer = torque_map(tmp_path / "b", case, current="0.03 A, 0.1 A")
    assert fewer.points[0].falling == pytest.approx(points[0].falling, rel=5e-3)
    loose = {f"effects.{name}": None for name in ("dipoles", "wall_images", "back_reaction")}
    friction = torque_map(tmp_path / "d", case.with_values(loose), current="0.03 A, 0.1 A")
    assert "falling" not in friction.rows[0] and friction.points[0].torque.low == 0.0
    without = case.with_values({"effects.hysteresis": None})
    plain = torque_map(tmp_path / "c", without, current="0.03 A, 0.1 A")
    assert "falling" not in plain.rows[0]
    assert [one.torque.mean for one in plain.points] == pytest.approx([one.torque.mean for one in fewer.points], 1e-3)


def test_a_measured_torque_may_be_off_by_its_own_error_and_that_of_the_interval():
    """In quadrature: 1.96 of 0.05 and the half width 0.1 are 0.14."""
    torques = [Interval(1.0, 0.9, 1.1, False)] * 2
    points = {"bench": np.array([[1.0, 1.13, 0.05], [1.0, 1.15, 0.05], [1.0, 0.87, 0.05], [1.0, 1.11, np.nan]])}
    rows = compared_rows(points, [1.0, 2.0], torques)
    assert [row["is_inside"] for row in rows] == [True, False, True, False]
