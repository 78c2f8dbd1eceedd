"""The materials by name: their other names, conductivity and grains; the command that lists and draws them."""

import json

import numpy as np
import pytest
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.cli.materials import characteristics, draw_materials
from field import MU_0, LinearLaw, TableLaw, material, material_names
from field.laws.conductivity import conductivity
from field.laws.materials import canonical_name, grain_material, grain_names, material_aliases


def asked(*arguments, code=0):
    result = CliRunner().invoke(app, ["materials", *arguments], env={"COLUMNS": "160"})
    assert result.exit_code == code and "Traceback" not in result.output, result.output
    return result.output


def test_a_material_has_one_law_under_all_its_names():
    for alias, name in material_aliases().items():
        assert material(alias) is material(name) and canonical_name(alias) == name
        assert alias not in material_names()
    assert material("Steel-1010") is material("steel_1010") and material("X6Cr17") is material("stainless_430")
    assert material("pure iron") is material("vacofer_s2")
    assert canonical_name("unobtainium") is None


def test_an_unknown_name_is_answered_with_the_nearest():
    for lookup in (material, conductivity):
        with pytest.raises(ValueError, match="did you mean 'steel_1010'"):
            lookup("stel_1010")
    with pytest.raises(ValueError, match="did you mean 'stainless_430'"):
        grain_material("stainless_340")


@pytest.mark.parametrize("name", material_names())
def test_every_material_has_a_conductivity_with_its_source(name):
    found = conductivity(name)
    assert found.source and found.temperature == 20.0
    # between silver, the best conductor, and stainless steel; air conducts nothing
    assert found.sigma == 0.0 if name == "air" else 1e6 < found.sigma < 6.3e7


def test_conductivities_are_those_of_the_standards():
    assert conductivity("copper").sigma == pytest.approx(1.0 / 1.7241e-8, rel=1e-3)  # IEC 60028, 100 % IACS
    assert conductivity("aluminium").sigma / conductivity("copper").sigma == pytest.approx(0.61, abs=0.01)
    assert conductivity("stainless_304").sigma == pytest.approx(1.0 / 0.73e-6, rel=1e-2)  # EN 10088-1


def test_grains_saturate_at_their_polarisation():
    for name in grain_names():
        law, density, source = grain_material(name)
        assert source and 7500.0 < density < 7900.0 and 1.5 < MU_0 * law.Ms < 2.16  # less than iron's
        # demagnetised spheres: M -> 3 H whatever their chi
        assert law.magnetisation(np.array([1e3]), 0.0)[0] == pytest.approx(3e3, rel=0.02)


def test_characteristics_are_read_off_the_law():
    steel = characteristics(material("stainless_430"))
    assert steel.initial_mu_r == pytest.approx(274.0) and steel.law == "mu_r(B)"  # Modelica FluxTubes, X6Cr17
    b = np.linspace(0.0, 2.0, 20_001)
    assert steel.largest_mu_r == pytest.approx(np.max(1 + (273 + 970 * b) / (1 + 1.2 * b + b**8.3)), rel=1e-3)
    assert characteristics(material("copper")).J_s == 0.0
    assert characteristics(LinearLaw(1000.0, "mine")).J_s == float("inf")


@pytest.mark.parametrize("name", [name for name in material_names() if not isinstance(material(name), LinearLaw)])
def test_steels_saturate_from_above(name):
    """dB/dH >= mu_0 everywhere, and in saturation it only falls, but for 0.11 mu_0 between a table's last points.

    At its last point it falls at once to mu_0 in `team_steel`, whose table defines the TEAM problems as it is, and
    without J_s; in all others it is continuous.
    """
    law = material(name)
    B = np.linspace(0.0, 4.0, 40_001)
    H, slope = law.H_of_B(B)
    assert np.all(np.diff(H) > 0.0) and np.all(slope > 0.0) and slope.max() <= (1.0 + 1e-12) / MU_0
    mu = 1.0 / (slope * MU_0)
    saturated = mu[np.argmax(B > B[mu >= 3.0].max()) :]
    rise = (saturated - np.minimum.accumulate(saturated)).max()
    assert rise < 0.11 and saturated[-1] < 1.0 + 1e-5
    beyond = mu[B > law.curve.B[-1] if getattr(law, "J_s", None) is None else B >= law.B[-1]]
    assert np.all(np.diff(beyond) <= 1e-12)
    if isinstance(law, TableLaw):
        jump = np.diff(1.0 / law.H_of_B(law.B[-1] + np.array([1e-9, -1e-9]))[1])[0] / MU_0
        assert jump == pytest.approx(0.614 if name == "team_steel" else 0.0, abs=1e-3)
    assert 1.6 < characteristics(law).J_s < 1.02 * 2.16 or "J_s is too high" in law.source


LEFT_OUT = {
    "steel_1010": (2.0, [(79577.5, 2.095), (159155.0, 2.2), (318310.0, 2.4), (1909860.0, 4.4)]),
    "steel_1018": (2.03, [(79577.5, 2.11), (159155.0, 2.225), (318310.0, 2.43)]),
    "steel_1020": (2.1815, [(79577.5, 2.280053), (126121.8, 2.339975), (199889.6, 2.432708), (316803.6, 2.579627)]),
    "stainless_416": (1.67, [(55704.0, 1.74)]),
}


@pytest.mark.parametrize("name", LEFT_OUT)
def test_the_approach_to_saturation_is_that_of_the_published_points(name):
    """J = J_s - (J_s - J_1) exp(-(H - H_1)/h) is within 4 mT of FEMM's points that it replaces, J_s theirs."""
    law, (J_s, points) = material(name), LEFT_OUT[name]
    B = np.linspace(0.0, 4.5, 450_001)
    for H, published in points:
        assert np.interp(H, law.H_of_B(B)[0], B) == pytest.approx(published, abs=4e-3)
    assert characteristics(law).J_s == pytest.approx(J_s, abs=1e-5)
    H_1, B_1 = law.H[-1], law.B[-1]
    _, slope = law.H_of_B(np.array([B_1 - 1e-9, B_1 + 1e-9]))
    h = (J_s - B_1 + MU_0 * H_1) / (1.0 / slope[0] - MU_0)
    H = H_1 + h * np.array([0.3, 1.0, 4.0])
    exact = J_s - (J_s - B_1 + MU_0 * H_1) * np.exp(-(H - H_1) / h) + MU_0 * H
    assert np.allclose(law.H_of_B(exact)[0], H, rtol=1e-5) and slope[1] == pytest.approx(slope[0], rel=1e-4)
    assert 400.0 < characteristics(law).largest_mu_r < 4000.0
    with pytest.raises(ValueError, match="give a larger J_s"):
        TableLaw(law.H, law.B, J_s=J_s - 0.1)


def test_the_list_has_every_material_and_its_other_names_and_one_by_name_its_sources():
    output = asked()
    for words in (*material_names(), *material_aliases(), *grain_names(), "≈ 7", "emclutch materials NAME"):
        assert words in output
    assert "Bozorth" in asked("carbonyl_iron") and "FEMM" in asked("steel_1010")
    assert "does not match the magnetisation curve" in asked("steel_1010")


def test_the_list_for_machines_is_json():
    data = json.loads(asked("--json"))
    assert [entry["name"] for entry in data["materials"]] == material_names()
    assert json.loads(asked("pure_iron", "--json"))["materials"][0]["initial_mu_r"] == pytest.approx(2666.0)


def test_a_curve_is_read_at_field_strengths_and_flux_densities(tmp_path):
    """Points of the table of steel 1010 (2228.2 A/m, 1.4028 T), in all units; beyond its last one; B = mu_r mu_0 H."""
    H, B = 2228.2, 1.4028
    places = f"{H} A/m, {H * 4e-3 * np.pi:.10g} oe, {B} T, {1e4 * B} G, 0 A/m, 70 kA/m"
    *points, zero, last = json.loads(asked("steel_1010", "--at", places, "--json"))["points"]
    assert all((one["H"], one["B"]) == pytest.approx((H, B), rel=1e-9) and not one["beyond_table"] for one in points)
    assert zero["mu_r"] == pytest.approx(1.0 / (MU_0 * material("steel_1010").H_of_B(np.zeros(1))[1][0]))
    assert last["beyond_table"] and last["B"] > 2.07 and last["mu_r"] == pytest.approx(last["B"] / (MU_0 * last["H"]))
    (tmp_path / "mine.csv").write_text("H [Oe], B [kG]\n10, 10\n20, 12\n30, 12.5\n")
    text = " ".join(asked(str(tmp_path / "mine.csv"), "--at", "40 Oe").split())
    assert "beyond the table" in text and "4 points up to H = 2387 A/m, B = 1.25 T; beyond, B grows with mu_0" in text
    assert "has no unit; write a field strength (A/m, kA/m" in " ".join(asked("--at", "3", code=2).split())
    assert "field strength is needed" in " ".join(asked("--at", "3 mm", code=2).split())


def test_curves_are_drawn_into_a_new_file(tmp_path):
    picture = tmp_path / "curves.png"
    (tmp_path / "mine.csv").write_text("H [A/m], B [T]\n100, 1\n1000, 1.5\n9000, 1.7\n")
    text = asked("steel_1010", "copper", str(tmp_path / "mine.csv"), "--plot", str(picture), "--at", "1 T")
    assert "curves.png" in text.replace("\n", "") and "B/(mu_0 H)" in text
    assert picture.read_bytes()[:4] == b"\x89PNG" and picture.stat().st_size > 20_000
    before = picture.read_bytes()
    assert "--plot" in asked("steel_1010", "--plot", str(picture), code=2)
    assert picture.read_bytes() == before
    assert ".png" in asked("steel_1010", "--plot", str(tmp_path / "curves.txt"), code=2)
    assert "does not exist; make it" in asked("steel_1010", "--plot", str(tmp_path / "none" / "curves.png"), code=2)


def test_a_table_weaker_than_any_steel_is_doubted():
    """B in kG that is said to be T has J_s ten times too large; in T that is said to be kG ten times too small."""
    H, B = np.array([100.0, 1e3, 9e3]), np.array([1.0, 1.5, 1.7])
    assert TableLaw(H, 0.1 * B).warning.startswith("J_s = 0.16 T; steels have 1 to 2.4 T: check the unit of B")
    assert not TableLaw(H, B).warning and not any(getattr(material(name), "warning", "") for name in material_names())


def test_every_wrong_name_is_reported(tmp_path):
    (tmp_path / "bad.csv").write_text("H [A/m], B [T]\n100, 1\n1000, 0.5\n9000, 1.7\n")
    output = asked("stel_1010", str(tmp_path / "none.csv"), str(tmp_path / "bad.csv"), code=2)
    assert "did you mean 'steel_1010'" in output and "check the path" in output and "line 3: not monotone" in output


def test_the_picture_holds_the_curves(tmp_path, monkeypatch):
    """What is drawn is the law: read back from the lines of the figure."""
    from matplotlib.figure import Figure

    drawn = []
    monkeypatch.setattr(Figure, "savefig", lambda figure, *_, **__: drawn.append(figure))
    draw_materials([material("steel_1010"), material("copper")], tmp_path / "curves.png")
    plain, logarithmic, permeability = drawn[0].axes
    H, B = plain.lines[0].get_data()
    assert np.allclose(material("steel_1010").H_of_B(B)[0], 1e3 * H)
    H, B = logarithmic.lines[0].get_data()
    assert np.allclose(material("steel_1010").H_of_B(B)[0], H)
    solid, dashed = (line.get_data()[1] for line in plain.lines[:2])
    assert plain.lines[1].get_linestyle() == "--" and solid.max() <= material("steel_1010").B.max() <= dashed.min()
    B, mu_r = permeability.lines[-1].get_data()
    assert np.allclose(mu_r, 1.0)
    assert [text.get_text() for text in plain.get_legend().get_texts()] == ["steel_1010", "copper"]


def test_the_force_between_two_grains_is_drawn_and_tabulated(tmp_path):
    out = tmp_path / "pair.png"
    text = asked("stainless_430", "--pair-force", "--out", str(out))
    assert str(out.name) in text.replace("\n", "") and "500 kA/m" in text and "gap/radius" in text
    assert out.read_bytes()[:4] == b"\x89PNG" and [path.name for path in tmp_path.iterdir()] == ["pair.png"]
    assert "exists; name another file" in asked("stainless_430", "--pair-force", "--out", str(out), code=2)
    assert "did you mean 'carbonyl_iron'" in asked("carbonil_iron", "--pair-force", code=2)
    assert ".png" in asked("stainless_430", "--pair-force", "--out", str(tmp_path / "pair.gif"), code=2)
    for arguments in ((), ("stainless_430", "carbonyl_iron"), ("stainless_430", "--json")):
        assert "takes the name of one powder" in asked(*arguments, "--pair-force", code=2)
    assert "that of the curves" in asked("steel_1010", "--out", str(out), code=2)
