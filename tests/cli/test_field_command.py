"""`emclutch field`: the field's quantities along a sweep agree with one another, and bad input is reported."""

import json
from pathlib import Path

import numpy as np
import pandas
import pytest
import tomli_w
from step_file import rectangle, write_polygons
from typer.testing import CliRunner

from emclutch.cli.input import read_line, read_share
from emclutch.cli.main import app
from emclutch.device_model.body_forces import forces_on, regions_of_body
from emclutch.device_model.device import build_device
from emclutch.scene.case import load_case, read_toml
from emclutch.scene.errors import SceneError
from emclutch.scene.units import Quantity
from emclutch.scene.value_list import read_list
from field import MU_0, ConvergenceError, pole_pressure

QUICKSTART = Path(__file__).parents[2] / "cases" / "quickstart.toml"
BROKEN = Path(__file__).parents[1] / "scene" / "broken"


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


def test_points_for_paraview_belong_to_one_region_each_and_agree_with_its_cells(studied):
    """H = B/mu_0 at the points of air, far less in most of the steel; corners have on average their cell's B."""
    import pyvista

    data = pyvista.read(sorted((studied / "field").iterdir())[1])
    names, region = bytes(data.field_data["region_names"]).decode().split(), data.cell_data["region"]
    triangles = data.cells_dict[pyvista.CellType.TRIANGLE]
    owner = np.full(data.n_points, -1)
    for number in range(len(names)):
        points = np.unique(triangles[region == number])
        assert np.all(owner[points] == -1)
        owner[points] = number
    B, H = data.point_data["flux_density"], data.point_data["field_strength"]
    air = owner == names.index("air")
    assert np.allclose(MU_0 * H[air], B[air], rtol=1e-9, atol=1e-12)
    steel = owner == names.index("disc")
    size = np.linalg.norm(B[steel], axis=1)
    assert np.median(MU_0 * np.linalg.norm(H[steel], axis=1) / size) < 0.1
    off = np.linalg.norm(B[triangles].mean(axis=1) - data.cell_data["flux_density"], axis=1)
    assert np.median(off) < 0.01 * size.max()
    assert np.unique(data.points, axis=0).shape[0] < data.n_points, "points on faces stand once for each region"


def test_powder_that_is_fed_back_is_reported_beside_sheared_powder(studied):
    """The rows have grains without order; sheared powder carries more flux, at most in proportion to their mu_r."""
    last = json.loads((studied / "field.json").read_text())["at_last_current"]
    row = pandas.read_csv(studied / "field.csv").iloc[-1]
    assert "Maxwell Garnett" in last["powder"] and "In a run the field becomes stronger" in last["powder"]
    for name in ("gap_flux_density", "flux_linkage"):
        assert row[name] < last[f"{name}_sheared"] < 1.37 * row[name]  # mu_r of both in weak fields: 3.54 and 2.58


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
    data["particles"] |= {"diameter": "0.1 mm", "sector": "6 deg"}
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
        (("--current", "0 A : 1 A : x"), "first : last : count"),
        (("--current", "3 mm"), "a current is needed"),
        (("--line", "1 mm, 2 mm"), "r0, z0, r1, z1"),
        (("--line", "1 mm, 0 mm, 9 m, 0 mm"), "does not lie in the mesh"),
        (("--set", "effects.back_reaction=off", "--set", "effects.dipoles=off", "--set", "effects.magnetic_force=off",
          "--set", "effects.wall_images=off", "--set", "effects.saturation=off"), "no coil's field"),
    ],
)  # fmt: skip
def test_bad_input_is_reported(arguments, words, tmp_path):
    result = invoke(*arguments, "--out", tmp_path / "new")
    assert result.exit_code == 2 and words in result.output.replace("\n", " ")
    assert not (tmp_path / "new").exists()


# The brake of the broken scenes: a thin disc, covers of steel, coarse and without grains' interaction.
THIN_DISC = {
    "geometry.coil_radius": "54 mm",
    "particles.region": "faces",
    "field.size_factor": 3.0,
    "field.order": 1,
}


@pytest.fixture(scope="module")
def thin_disc():
    case = load_case(BROKEN / "good.toml", THIN_DISC)
    device = build_device(case.scene)
    return case, device, device.coil.solve_at_peak(None)


def test_steel_covers_are_pulled_as_one_body_with_their_rotor(thin_disc):
    """They touch it: no force between them is defined, and the force on the disc is opposite to theirs and the rest's.

    The device is symmetric about z = 0 but for its shafts, which carry no flux: what is left is the mesh.
    """
    _, device, solution = thin_disc
    regions = regions_of_body(device.coil, solution, "rotor")
    assert sorted(regions) == ["cover", "rotor"] and regions_of_body(device.coil, solution, "disc") == ["disc"]
    rotor, disc = forces_on(solution, [("rotor", regions), ("disc", ["disc"])]).values()
    pull = float(pole_pressure(0.5)) * device.shape.face_area  # of one side, in a field of 0.5 T
    for force in (rotor, disc):
        assert abs(force["maxwell_stress"]) < 0.02 * pull
        assert force["virtual_work"] == pytest.approx(force["maxwell_stress"], abs=1e-3 * pull)
    assert rotor["maxwell_stress"] == pytest.approx(-disc["maxwell_stress"], abs=0.02 * pull)


def test_the_command_gives_the_forces_of_a_thin_disc(thin_disc, tmp_path):
    case, _, _ = thin_disc
    case.write_toml(tmp_path / "thin.toml")
    result = CliRunner().invoke(app, ["field", str(tmp_path / "thin.toml"), "--out", str(tmp_path / "field")])
    assert result.exit_code == 0, result.output
    forces = json.loads((tmp_path / "field" / "field.json").read_text())["at_last_current"]["axial_force"]
    assert sorted(forces["rotor"]["regions"]) == ["cover", "rotor"] and forces["disc"]["error_estimate"] > 0.0


def test_a_force_that_is_not_defined_is_reported_with_its_reason(thin_disc):
    """The rotor without the covers that it touches: a reason for the user, and no key of a call."""
    _, _, solution = thin_disc
    reported = forces_on(solution, [("rotor", ["rotor"])])["rotor"]
    assert reported["regions"] == ["rotor"] and "maxwell_stress" not in reported
    reason = reported["not_defined"]
    assert "touches cover, and a force is defined across air" in reason and "yielding" not in reason


def test_a_displaced_solve_that_fails_is_reported(thin_disc, monkeypatch):
    """It costs the virtual work alone: stress and error estimate are there, and the reason beside them."""

    def fails(*_, **__):
        raise ConvergenceError([(0.5, 1.0)], "take a finer mesh")

    monkeypatch.setattr("emclutch.device_model.body_forces.force_by_virtual_work", fails)
    reported = forces_on(thin_disc[2], [("disc", ["disc"])])["disc"]
    assert reported["virtual_work"] is None and "did not converge" in reported["no_virtual_work"]
    assert reported["error_estimate"] > 0.0 and "error_estimate_of_two_shells" not in reported


def test_nothing_is_overwritten(studied):
    before = (studied / "field.csv").read_bytes()
    result = invoke("--out", studied)
    assert result.exit_code == 2 and "exists" in result.output
    assert (studied / "field.csv").read_bytes() == before


def test_currents_and_lines_are_read():
    current = Quantity("a current", "A", "0.5 A")
    assert read_list("0.5 A", current, "--current") == [0.5]
    assert read_list("500 mA, 1 A", current, "--current") == [0.5, 1.0]
    assert np.allclose(read_list("-1 A : 1 A : 5", current, "--current"), [-1.0, -0.5, 0.0, 0.5, 1.0])
    assert np.allclose(read_list("0 A : 1 A", current, "--current", 3), [0.0, 0.5, 1.0])
    assert np.allclose(read_list("0 A : 1 A : 3, 0.5 A, 0 A", current, "--current"), [0.0, 0.5, 1.0, 0.5, 0.0])
    for text in ("1,2 A", "1,2,3 A", "0,1 A:0,9 A:3", "-0,5", "1 A, 2,5 A"):
        with pytest.raises(SceneError, match="has a decimal comma; decimals follow a point"):
            read_list(text, current, "--current")
    for text in ("1 A,2 A", "1, 2", "1.0,2.0", "1 A:2 A:2", "1e0,2e0", "1e+0,2e+0"):
        assert read_list(text, current, "--current") == [1.0, 2.0]
    with pytest.raises(SceneError, match="--within = '3 %, 5 %' has 2 entries; give one"):
        read_share("3 %, 5 %", "--within")
    with pytest.raises(SceneError, match=r"decimals follow a point: 44\.5"):
        read_line("44,5 mm, 0 mm, 46,5 mm, 0 mm")  # as six lengths it was a line in 3D
    assert read_line("44 mm, 0 mm, 0.046, -1 mm") == (0.044, 0.0, 0.046, -0.001)
