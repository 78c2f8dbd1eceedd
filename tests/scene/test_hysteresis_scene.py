"""[effects.hysteresis]: a ramp of the field alone has two branches and heat; what does not carry history refuses it."""

from pathlib import Path

import numpy as np
import pytest

import emclutch
from emclutch.device_model.device import solved_coil
from emclutch.scene.case import case_from, load_case, read_toml
from emclutch.scene.errors import SceneError
from emclutch.simulation.check import check

CASES = Path(__file__).parents[2] / "cases"
OF_GRAINS = ("particles", "contact", "motion", "effects", "time", "accuracy", "output")


def drum(**values):
    data = {name: section for name, section in read_toml(CASES / "quickstart.toml").items() if name not in OF_GRAINS}
    return case_from(data | {"effects": {"hysteresis": {}}}, {"field.size_factor": 4.0} | values)


def test_a_ramp_up_and_down_has_two_branches(tmp_path):
    """Falling above rising, flux at 0 A, heat in every step; a first rise is the field without the effect."""
    currents = [0.0, 0.5, 1.0, 0.5, 0.0, -0.5, -1.0]
    found = emclutch.field(drum(), currents, [(0.019, 0.003, 0.023, 0.003)], tmp_path / "ramp")
    table = found.table
    linkage, heat = table["flux_linkage"].to_numpy(), table["hysteresis_loss"].to_numpy()
    assert linkage[3] > 1.005 * linkage[1] and 0.0 < linkage[4] < 0.02 * linkage[2]
    assert linkage[6] == pytest.approx(-linkage[2], rel=1e-3)
    assert heat[0] == 0.0 and np.all(heat[1:] > 0.0) and "coenergy" not in table
    assert table["gap_flux_density"][4] > 1e-4
    plain = solved_coil(drum(effects={}).scene)
    assert linkage[2] == pytest.approx(plain.turns * plain.solve_at_peak(None).flux_linkage_per_turn, rel=1e-4)
    assert "error_estimate" in found.summary["at_last_current"]
    assert (tmp_path / "ramp" / "line-1.csv").exists() and (tmp_path / "ramp" / "saturation.png").exists()


def test_coercivities_are_of_the_library_the_scene_or_the_table():
    steel = {"law": "froehlich", "susceptibility": 2000.0, "saturation": "1.6 MA/m", "coercivity": "80 A/m"}
    own = drum(materials={"ours": steel}, **{"geometry.materials": {"disc": "ours"}})
    by_region = {}
    for case in (drum(), own, drum(**{"effects.hysteresis.coercivity": {"steel_1010": "90 A/m"}})):
        coil = solved_coil(case.scene)
        names = {int(elements[0]): name for name, elements in coil.mesh.regions.items()}
        found = {names[int(one.elements[0])]: one.pinning.coercivity for one in coil.history.regions}
        by_region[len(by_region)] = found
    assert by_region[0] == pytest.approx(dict.fromkeys(by_region[0], 143.0)) and {"disc", "housing"} <= set(
        by_region[0]
    )
    assert by_region[1]["disc"] == pytest.approx(80.0) and by_region[1]["housing"] == pytest.approx(143.0)
    assert by_region[2] == pytest.approx(dict.fromkeys(by_region[0], 90.0))
    assert solved_coil(drum(**{"effects.hysteresis.coercivity": {"steel_1010": 0.0}}).scene).history is None
    assert solved_coil(drum(effects={}).scene).history is None


def test_a_coercivity_that_is_not_of_the_curves_steel_is_said():
    """check has coercivity and remanence of each steel and a warning, none of either without the effect."""
    row = check(drum()).decisions["steel"]
    assert "steel_1010: coercivity 143 A/m, remanence 0.27 T" in row and row.warnings[0].startswith("steel_1010")
    fits = check(drum(**{"effects.hysteresis.coercivity": {"steel_1010": "250 A/m"}})).decisions["steel"]
    assert "coercivity 250 A/m" in fits and not fits.warnings
    assert "steel" not in check(drum(effects={})).decisions


def test_a_material_may_be_a_measured_loop():
    """Its cells are those of the fit, its curve holds without the effect too, and a resolved scene stands alone."""
    sheet = {"loop": str(CASES.parent / "tests" / "field" / "m330_50a_loop.csv")}
    case = drum(materials={"sheet": sheet}, **{"geometry.materials": {"disc": "sheet"}})
    coil = solved_coil(case.scene)
    disc = next(one for one in coil.history.regions if one.elements[0] == coil.mesh.regions["disc"][0])
    law = case.scene.materials["sheet"].magnetic_law("sheet")
    assert np.array_equal(disc.pinning.stiffness, law.pinning.stiffness)
    assert disc.pinning.coercivity == pytest.approx(38.0, abs=0.5)
    assert case.scene.materials["sheet"].law == "loop" and len(case.scene.materials["sheet"].H) == 81
    given = {"effects.hysteresis.coercivity": {"sheet": "20 A/m"}}
    own = drum(materials={"sheet": sheet}, **{"geometry.materials": {"disc": "sheet"}}, **given)
    of_disc = [one.pinning.coercivity for one in solved_coil(own.scene).history.regions]
    assert min(of_disc) == pytest.approx(20.0)
    for more, words in (({"coercivity": "10 A/m"}, "conflicts with the loop"), ({"H": [1.0]}, "conflicts with H or B")):
        with pytest.raises(SceneError, match=words):
            drum(materials={"sheet": sheet | more}, **{"geometry.materials": {"disc": "sheet"}})


def test_what_does_not_carry_history_refuses_it():
    assert load_case(CASES / "quickstart.toml", {"effects.hysteresis": {}}).scene.effects.memory is not None
    with pytest.raises(SceneError, match=r"effects\.hysteresis.*cannot be used with \[effects\.eddy_currents\]"):
        load_case(CASES / "quickstart.toml", {"effects.hysteresis": {}, "effects.eddy_currents": {}})
    circuit = {"coil.current": None, "coil.voltage": "24 V", "effects.coil_circuit": {}}
    with pytest.raises(SceneError, match=r"effects\.hysteresis.*cannot be used with \[effects\.coil_circuit\]"):
        load_case(CASES / "quickstart.toml", {"effects.hysteresis": {}} | circuit)
    with pytest.raises(SceneError, match=r"effects\.hysteresis.*3D"):
        load_case(CASES / "slotted_disc.toml", {"effects.hysteresis": {}})
    with pytest.raises(SceneError, match=r"cannot be used with \[effects\.eddy_currents\]"):  # nor without grains
        drum(**{"effects.eddy_currents": {}})


@pytest.mark.parametrize(
    ("values", "words"),
    [
        ({"effects.hysteresis.coercivity": {"steel_1010": "5 kA/m"}}, "too much for its magnetisation curve"),
        ({"effects.hysteresis.coercivity": {"steel_1008": "80 A/m"}}, "for no material of this device"),
        ({"effects.hysteresis.coercivity": {"steel_1010": "80 T"}}, "A/m"),
        ({"effects.hysteresis.remanence": 1.0}, "remanence"),
    ],
)
def test_wrong_coercivities_are_explained(values, words):
    with pytest.raises(SceneError, match=words):
        drum(**values)
