"""`emclutch field`: the field's quantities along a sweep agree with one another, and bad input is told."""

import json
from pathlib import Path

import numpy as np
import pandas
import pytest
from typer.testing import CliRunner

from emclutch.command_line import app
from emclutch.field_study import read_currents, read_line

QUICKSTART = Path(__file__).parents[2] / "cases" / "quickstart.toml"


def invoke(*arguments):
    return CliRunner().invoke(app, ["field", str(QUICKSTART), *map(str, arguments)])


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    folder = tmp_path_factory.mktemp("field") / "study"
    result = invoke("--current", "0 A : 4 A : 9", "--line", "19 mm, 3 mm, 23 mm, 3 mm", "--out", folder)
    assert result.exit_code == 0, result.output
    return folder


def test_linkage_inductance_and_coenergy_belong_together(studied):
    """lambda = L I, d lambda/dI = L_inc, dW*/dI = lambda, W + W* = lambda I; the trapezoidal rule is off by O(dI^2)."""
    table = pandas.read_csv(studied / "field.csv")
    I, linkage = table["current"].to_numpy(), table["flux_linkage"].to_numpy()
    assert np.allclose(table["apparent_inductance"][1:] * I[1:], linkage[1:], rtol=1e-10)
    assert np.allclose(table["energy"] + table["coenergy"], linkage * I, rtol=1e-6)
    assert np.allclose(np.diff(table["coenergy"]), 0.5 * (linkage[1:] + linkage[:-1]) * np.diff(I), rtol=0.02)
    slope = table["incremental_inductance"].to_numpy()
    assert np.allclose(np.diff(linkage), 0.5 * (slope[1:] + slope[:-1]) * np.diff(I), rtol=0.02)
    assert np.all(table["residual"] <= 1e-8)
    circuit = table["circuit_flux_linkage"][1:] / linkage[1:]
    assert circuit.between(0.75, 1.1).all(), "a reluctance estimate without all leakage"


def test_summary_and_pictures_are_there(studied):
    summary = json.loads((studied / "field.json").read_text())["at_last_current"]
    assert 0.0 < summary["estimated_relative_error"]["flux linkage"] < 0.01
    force = summary["axial_force"]["disc"]
    assert force["virtual_work"] == pytest.approx(
        force["maxwell_stress"], abs=0.01 * abs(force["error_estimate"]) + 1e-3
    )
    for name in ("section.png", "saturation.png", "line-1.png", "line-1.csv", "field.pvd"):
        assert (studied / name).stat().st_size > 200
    line = pandas.read_csv(studied / "line-1.csv")
    assert list(dict.fromkeys(line["region"])) == ["disc", "powder", "rotor"]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (("--current", "0 A : 1 A"), "first : last : how many"),
        (("--current", "3 mm"), "a current is needed"),
        (("--line", "1 mm, 2 mm"), "r0, z0, r1, z1"),
        (("--line", "1 mm, 0 mm, 9 m, 0 mm"), "does not lie in the mesh"),
        (("--set", "effects.back_reaction=off", "--set", "effects.dipoles=off", "--set", "effects.magnetic_force=off",
          "--set", "effects.wall_images=off", "--set", "effects.saturation=off"), "no coil's field"),
    ],
)  # fmt: skip
def test_bad_input_is_told(arguments, words, tmp_path):
    result = invoke(*arguments, "--out", tmp_path / "new")
    assert result.exit_code == 2 and words in result.output.replace("\n", " ")
    assert not (tmp_path / "new").exists()


def test_nothing_is_overwritten(studied):
    before = (studied / "field.csv").read_bytes()
    result = invoke("--out", studied)
    assert result.exit_code == 2 and "exists" in result.output
    assert (studied / "field.csv").read_bytes() == before


def test_currents_and_lines_are_read():
    assert read_currents("0.5 A") == [0.5] and read_currents("500 mA, 1 A") == [0.5, 1.0]
    assert np.allclose(read_currents("-1 A : 1 A : 5"), [-1.0, -0.5, 0.0, 0.5, 1.0])
    assert read_line("44 mm, 0 mm, 0.046, -1 mm") == (0.044, 0.0, 0.046, -0.001)
