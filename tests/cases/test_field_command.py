"""`emclutch field`: the field's quantities along a sweep agree with one another, and bad input is told."""

import json
from pathlib import Path

import numpy as np
import pandas
import pytest
import tomli_w
from step_file import rectangle, write_polygons
from typer.testing import CliRunner

from emclutch.case import read_toml
from emclutch.command_line import app
from emclutch.field_study import read_currents, read_line
from field import MU_0

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
    for name in ("section.png", "saturation.png", "line-1.png", "line-1.csv", "field.pvd"):
        assert (studied / name).stat().st_size > 200
    line = pandas.read_csv(studied / "line-1.csv")
    assert list(dict.fromkeys(line["region"])) == ["disc", "powder", "rotor"]


def test_a_pot_magnet_pulls_its_disc_by_the_pressure_on_the_poles(tmp_path):
    """F = flux^2/(2 mu_0) (1/A_inner + 1/A_outer) across a gap of 0.5 mm, by both ways of taking it, towards the pot.

    A clutch is symmetric and pulls its disc nowhere; so the device is drawn. The reluctance is that of the gap alone,
    the poles fringe at their edges: 15 %.
    """
    gap, turns, current = 0.5e-3, 500, 0.4
    pot = 1e-3 * np.array([(0, -24), (34, -24), (34, 0), (28, 0), (28, -16), (14, -16), (14, 0), (0, 0)])
    write_polygons(tmp_path / "pot.step", {
        "housing": [pot], "coil": [rectangle(14e-3, 28e-3, -16e-3, 0.0)], "disc": [rectangle(0.0, 34e-3, gap, 12e-3)],
        "powder": [rectangle(5e-3, 33e-3, 0.0, gap)],
    })  # fmt: skip
    data = read_toml(QUICKSTART)
    iron = {"law": "linear", "relative_permeability": 1e4}
    data["geometry"] = {"kind": "cad", "file": "pot.step", "materials": {"housing": "iron", "disc": "iron"}}
    data |= {"materials": {"iron": iron}, "motion": {"disc": {"speed": 0.0}}}
    data["particles"] |= {"diameter": "0.1 mm"}
    data["particles"].pop("region")
    data["effects"].pop("back_reaction")
    (tmp_path / "pot.toml").write_text(tomli_w.dumps(data), encoding="utf-8")
    folder = tmp_path / "study"
    result = CliRunner().invoke(
        app, ["field", str(tmp_path / "pot.toml"), "--current", f"{current} A", "--out", str(folder)]
    )
    assert result.exit_code == 0, result.output
    force = json.loads((folder / "field.json").read_text())["at_last_current"]["axial_force"]["disc"]
    inner, outer = np.pi * 14e-3**2, np.pi * (34e-3**2 - 28e-3**2)
    flux = MU_0 * turns * current / (gap / inner + gap / outer)
    assert force["maxwell_stress"] == pytest.approx(-(flux**2) / (2.0 * MU_0) * (1.0 / inner + 1.0 / outer), rel=0.15)
    assert force["virtual_work"] == pytest.approx(force["maxwell_stress"], rel=1e-3)
    assert 0.0 < force["error_estimate"] < 0.05 * abs(force["maxwell_stress"])


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
