"""`emclutch powder`, and `particles.repose` in a scene: the same pairs by both, and what contradicts them."""

import json
import math

import pytest
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.scene.case import case_from
from emclutch.scene.errors import SceneError
from emclutch.simulation.check import check
from particles.bulk_friction.friction_table import measured_table

SCENE = {
    "scene": {"title": "a box of powder"},
    "geometry": {"kind": "box", "size": [2e-3, 2e-3, 2e-3]},
    "particles": {"diameter": "0.3 mm", "count": 20, "repose": "30 deg"},
    "contact": {"stiffness": "1000 N/m"},
    "time": {"end": "0.1 ms"},
}


def invoke(*arguments):
    return CliRunner().invoke(app, ["powder", *map(str, arguments)])


def changed(**tables):
    return {**SCENE, **{name: {**SCENE.get(name, {}), **table} for name, table in tables.items()}}


@pytest.mark.parametrize("angle", [12, 20, 21.7, 25, 30, 34])
def test_every_pair_of_the_line_has_the_angle(angle):
    """By the inverse command too; sin(angle) is tau/P, so the internal friction of the same name has the same line."""
    line = json.loads(invoke("--repose", f"{angle} deg", "--json").stdout)
    assert line["bulk_friction"] == pytest.approx(math.sin(math.radians(angle)))
    for pair in [*line["pairs"], line["taken"]]:
        back = invoke("--friction", pair["friction"], "--rolling-friction", pair["rolling"], "--json")
        assert math.degrees(json.loads(back.stdout)["repose"]) == pytest.approx(angle, abs=0.2)
    assert json.loads(invoke("--internal-friction", line["bulk_friction"], "--json").stdout)["pairs"] == line["pairs"]
    frictions = [pair["friction"] for pair in line["pairs"]]
    assert frictions == sorted(frictions) and [frictions[0], frictions[-1]] == line["friction_range"]


def test_a_steep_heap_has_rolling_friction_and_a_flat_one_ends_without():
    steep, flat = (json.loads(invoke("--repose", angle, "--json").stdout) for angle in ("30 deg", "18 deg"))
    assert min(pair["rolling"] for pair in steep["pairs"]) > 0.05
    assert flat["pairs"][-1]["rolling"] == pytest.approx(0.0, abs=0.02)
    assert "perfect spheres" in invoke("--repose", "18 deg").output
    assert "Spheres that roll freely reach" in " ".join(invoke("--repose", "27 deg").output.split())


def test_a_wider_reading_has_a_wider_interval():
    narrow, wide = (
        json.loads(invoke("--repose", "27 deg", "--uncertainty", by, "--json").stdout)["pairs"]
        for by in ("0 deg", "2 deg")
    )
    for a, b in zip(narrow, wide, strict=True):
        assert a["rolling"] == b["rolling"] and a["lowest"] >= b["lowest"]


def test_both_readings_of_a_heap_are_told():
    """Its tangent as --internal-friction takes it, none where no pair gives it; a measured tau/P has one reading."""
    line = json.loads(invoke("--repose", "30 deg", "--json").stdout)
    slope = json.loads(invoke("--internal-friction", math.tan(math.radians(30.0)), "--json").stdout)
    for key in ("friction", "rolling"):
        assert line["taken_by_tangent"][key] == slope["taken"][key]
    assert line["taken_by_tangent"]["rolling"] > 2.0 * line["taken"]["rolling"] and slope["taken_by_tangent"] is None
    assert json.loads(invoke("--repose", "34 deg", "--json").stdout)["taken_by_tangent"] is None
    words = " ".join(invoke("--repose", "34 deg").output.split())
    assert "The tangent, 0.675 (a flowing slope), gives a bulk friction above that of all pairs" in words
    assert "--internal-friction" in words and "tangent" not in invoke("--internal-friction", 0.5).output


def test_the_picture_is_new(tmp_path):
    path = tmp_path / "line.png"
    assert invoke("--repose", "30 deg", "--out", path).exit_code == 0 and path.stat().st_size > 20_000
    assert "exists" in invoke("--repose", "30 deg", "--out", path).output
    assert "must end in .png" in invoke("--repose", "30 deg", "--out", tmp_path / "line.txt").output


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "needs an angle of repose"),
        (("--repose", "30 deg", "--internal-friction", 0.5), "only one of the two"),
        (("--repose", "60 deg"), "give contact.friction itself, and add a cohesion"),
        (("--repose", "1 deg"), "measure it again"),
        (("--internal-friction", 1.5), "cannot be reached"),
        (("--repose", "30"), "allowed: > 0 deg, <= 90 deg; write '30 deg' if degrees are meant"),
        (("--repose", "30 mm"), "is a length"),
        (("--repose", "30 deg", "--uncertainty", "-1 deg"), "out of range"),
        (("--friction", 0.5), "--friction = 0.5 gives an angle of repose together with --rolling-friction only"),
        (("--friction", 7, "--rolling-friction", 0), "--friction = 7 is out of range; allowed: 0 to 1"),
        (("--friction", 0.5, "--rolling-friction", 0, "--repose", "30 deg"), "--repose cannot be combined with"),
        (("--friction", 0.5, "--rolling-friction", 0, "--uncertainty", "2 deg"), "--uncertainty cannot be combined"),
    ],
)
def test_bad_input_is_explained(arguments, says):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert says in " ".join(result.output.split())


def test_a_scene_takes_the_pair_that_the_command_names():
    case, taken = case_from(SCENE), json.loads(invoke("--repose", "30 deg", "--json").stdout)["taken"]
    rolling = case.scene.effects.rolling
    assert (case.scene.contact.friction, rolling.coefficient) == (taken["friction"], taken["rolling"])
    assert measured_table().bulk_friction(taken["friction"], taken["rolling"])[0] == pytest.approx(0.5, abs=2e-3)
    checked = check(case, threads=1)
    assert "The tangent, 0.577" in checked.decisions["friction"]
    assert "angle of repose of 30 deg" in checked.decisions["friction"] and rolling.name in checked.effects
    assert f"(from {taken['lowest']:.2g} to {taken['highest']:.2g} by 1 deg" in checked.decisions["friction"]
    assert "friction" not in check(case.with_values({"particles.repose": None}), threads=1).decisions
    again = case_from(case.resolved())  # has both, and they agree
    assert again.scene == case.scene


def test_a_flat_heap_calls_for_no_rolling_friction():
    assert case_from(changed(particles={"repose": "18 deg"})).scene.effects.rolling is None


def test_walls_keep_their_own_friction():
    scene = case_from(changed(contact={"wall_friction": 0.1}, effects={"rolling_friction": {"wall_coefficient": 0.02}}))
    rolling = scene.scene.effects.rolling
    assert (scene.scene.contact.wall_friction, rolling.wall_coefficient) == (0.1, 0.02)
    assert rolling.coefficient > 0.02


@pytest.mark.parametrize(
    ("tables", "says"),
    [
        ({"contact": {"friction": 0.3}}, "contact.friction = 0.3 conflicts with particles.repose"),
        ({"effects": {"rolling_friction": {"coefficient": 0.9}}}, "coefficient = 0.9 conflicts with particles.repose"),
        ({"particles": {"repose": "50 deg"}}, "cannot be reached"),
        ({"particles": {"repose": "30 mm"}}, "is a length"),
    ],
)
def test_a_scene_that_contradicts_itself_is_refused(tables, says):
    with pytest.raises(SceneError) as raised:
        case_from(changed(**tables))
    assert says in raised.value.report()
