"""The command line's own words: help, settings, the torque's line, progress."""

from __future__ import annotations

import json

from typer.testing import CliRunner

from emclutch.command_line import _assignments, app, torque_line


def test_settings_are_toml_or_text():
    given = [
        "coil.current=0.8 A",
        "particles.count = 12",
        "output.formats=['vtk']",
        "output.pictures=false",
        "a.b=c=d",
    ]
    assert _assignments(given) == {
        "coil.current": "0.8 A",
        "particles.count": 12,
        "output.formats": ["vtk"],
        "output.pictures": False,
        "a.b": "c=d",
    }


def test_every_command_has_help():
    names = [command.name or command.callback.__name__ for command in app.registered_commands]
    assert {"run", "check", "sweep", "accuracy", "mesh", "plot", "materials", "schema", "doctor"} <= set(names)
    for name in names:
        result = CliRunner().invoke(app, [name, "--help"])
        assert result.exit_code == 0


def test_schema_goes_to_the_terminal_or_a_file(tmp_path):
    printed = CliRunner().invoke(app, ["schema"])
    assert CliRunner().invoke(app, ["schema", "--out", str(tmp_path / "schema.json")]).exit_code == 0
    assert json.loads(printed.output) == json.loads((tmp_path / "schema.json").read_text())


def test_materials_are_listed_with_their_source():
    result = CliRunner().invoke(app, ["materials"])
    assert result.exit_code == 0 and "steel_1010" in result.output


def test_torque_comes_with_its_error():
    good = {"mean": 1.2345, "standard_error": 0.0123, "converged": True, "reason": ""}
    assert torque_line(good) == "torque on the disc: 1.234 +- 0.012 N m"
    assert torque_line({**good, "converged": False, "reason": "not converged: too short"}).endswith(
        "not converged: too short"
    )
    assert torque_line(None) == "torque on the disc: none"
