"""[materials.NAME] of a scene: every law reaches the solver as it is written; faults have key, line and remedy."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
import tomli_w
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.device_model.materials import magnetic_law
from emclutch.scene.case import case_from, load_case, read_toml
from emclutch.scene.errors import SceneError
from field import FroehlichLaw, LinearLaw, PermeabilityLaw, TableLaw
from field.laws.brauer import BrauerLaw
from field.laws.langevin import LangevinLaw

GOOD = Path(__file__).parent / "broken" / "good.toml"
CURVE = "H [kA/m];B [mT]\n0;0\n0,1;1000\n1;1500\n5;1700\n"
TABLE = TableLaw(np.array([0.0, 100.0, 1000.0, 5000.0]), np.array([0.0, 1.0, 1.5, 1.7]))
LAWS = {
    "linear": ({"law": "linear", "relative_permeability": 1000}, LinearLaw(1000.0)),
    "froehlich": ({"law": "froehlich", "susceptibility": 200, "saturation": "1.3 MA/m"}, FroehlichLaw(200.0, 1.3e6)),
    "langevin": ({"law": "langevin", "susceptibility": 200, "saturation": "1.3 MA/m"}, LangevinLaw(200.0, 1.3e6)),
    "brauer": ({"law": "brauer", "k1": "0.3774 m/H", "k2": 2.97, "k3": 388.33}, BrauerLaw(0.3774, 2.97, 388.33)),
    "permeability": (
        {"law": "permeability", "initial_permeability": 200, "scale": "1170 mT", "c_a": 8100, "c_b": 2.59, "n": 10},
        PermeabilityLaw(200.0, 1.17, 8100.0, 2.59, 10.0),
    ),
    "lists": ({"law": "table", "H": [0, 100, 1000, 5000], "B": [0, 1, 1.5, 1.7]}, TABLE),
    "file": ({"law": "table", "file": "curve.csv"}, TABLE),
    "file alone": ({"table": "curve.csv", "conductivity": "7 MS/m"}, TABLE),
}


def scene(tmp_path, mine, curve=CURVE):
    (tmp_path / "curve.csv").write_text(curve)
    data = read_toml(GOOD)
    data["materials"] = {"mine": mine}
    data["geometry"]["materials"] = {**data["geometry"].get("materials", {}), "disc": "mine"}
    path = tmp_path / "scene.toml"
    path.write_text(tomli_w.dumps(data), encoding="utf-8")
    return path


@pytest.mark.parametrize("name", LAWS)
def test_a_scenes_material_is_its_law(name, tmp_path):
    mine, law = LAWS[name]
    case = load_case(scene(tmp_path, mine))
    B = np.linspace(0.0, 3.0, 61)
    found = magnetic_law(case.scene, "mine")
    assert found.name == "mine"
    for of_scene, expected in zip(found.H_of_B(B), law.H_of_B(B), strict=True):
        assert np.allclose(of_scene, expected, rtol=1e-13)
    # a resolved scene stands alone: without the file, and in SI
    assert case_from(case.resolved()).scene == case.scene
    if name == "file alone":
        assert case.scene.materials["mine"].conductivity == pytest.approx(7e6)


HEAD = "H [A/m],B [T]\n0,0\n9,1\n"
TABLED, FILED = {"table": "curve.csv"}, {"law": "table", "file": "curve.csv"}
BRAUER = {"law": "brauer", "k1": 1, "k2": 2, "k3": 1}
# name: (material, curve, key in the message, fragment of the remedy)
FAULTS = {
    "no file": ({"table": "none.csv"}, CURVE, "materials.mine.table = 'none.csv'", "relative to the scene's folder"),
    "not monotone": (TABLED, HEAD + "8,2\n99,3\n", "materials.mine.table", "line 4: not monotone"),
    "below mu_0": (FILED, HEAD + "1e6,1.1\n2e6,4\n", "materials.mine.file", "line 4"),
    "exchanged": (TABLED, "H [A/m],B [T]\n0,0\n1,100\n2,9e4\n3,1e5\n", "materials.mine.table", "H and B are exchanged"),
    "another key": ({"bh": "curve.csv"}, CURVE, "materials.mine.bh", "write table = 'curve.csv'"),
    "a key beside a table": ({**TABLED, "sigma": 6e6}, CURVE, "materials.mine.sigma", "may have: table, file,"),
    "a key of a loop": ({"law": "loop", "mu": 5}, CURVE, "materials.mine.mu", "may have: loop, density"),
    "lists are missing": ({"law": "table"}, CURVE, "materials.mine.H", "or name a file with table or file"),
    "another law": ({"law": "linear", **TABLED}, CURVE, "materials.mine.table", "conflicts with law = 'linear'"),
    "no name": ({"table": 3}, CURVE, "materials.mine.table = 3", "the name of a file in quotes"),
    "two keys": ({**TABLED, "bh": "curve.csv"}, CURVE, "materials.mine.bh", "is not a known key"),
    "no unit": (TABLED, "H,B\n0,0\n", "materials.mine.table", "e.g. H [A/m], H [kA/m], H [Oe]"),
    "too few points": (TABLED, HEAD, "materials.mine.table", "at least 3"),
    "too few in lists": ({"law": "table", "H": [0, 1, 2], "B": [0, 1, 2]}, CURVE, "materials.mine ", "at least 3"),
    "two files": ({**TABLED, "file": "curve.csv"}, CURVE, "materials.mine.file", "keep one of them"),
    "file and lists": ({**TABLED, "H": [0, 1]}, CURVE, "materials.mine.table", "either the file or the two lists"),
    "unknown law": ({"law": "langevn"}, CURVE, "materials.mine.law", "did you mean 'langevin'?"),
    "no law": ({}, CURVE, "materials.mine.law", "give one of linear, froehlich, langevin, brauer"),
    "wrong unit": ({**BRAUER, "k1": "1 T"}, CURVE, "materials.mine.k1 = '1 T'", "a reluctivity is needed"),
    "stiffer than vacuum": ({**BRAUER, "k3": 9e5}, CURVE, "materials.mine ", "check the units"),
    "missing coefficient": (
        {"law": "langevin", "susceptibility": 9}, CURVE, "materials.mine.saturation", "e.g. saturation = '1.3 MA/m'"
    ),
    "nothing to saturate": (
        {"law": "froehlich", "susceptibility": 0, "saturation": 1e6}, CURVE, "materials.mine.susceptibility",
        "allowed: > 0"
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", FAULTS)
def test_a_faulty_material_is_refused(name, tmp_path):
    mine, curve, key, remedy = FAULTS[name]
    result = CliRunner().invoke(app, ["check", str(scene(tmp_path, mine, curve))])
    assert result.exit_code == 2 and "Traceback" not in result.output
    assert key in result.output and remedy in result.output, result.output


def test_points_that_are_not_used_are_reported(tmp_path):
    """A tail that rises more slowly than mu_0 H is no fault of the scene, but the user hears of it."""
    H, B = [0, 100, 1000, 1e4, 1e5, 2e5], [0, 1, 1.5, 1.9, 2.2, 2.25]
    path = scene(tmp_path, {"law": "table", "H": H, "B": B})
    (reported,) = load_case(path).warnings
    assert reported.startswith("materials.mine: the last 1 point of the table, from H = 200000 A/m on, is not used")
    (tmp_path / "tail.csv").write_text("H [A/m],B [T]\n" + "".join(f"{h},{b}\n" for h, b in zip(H, B, strict=True)))
    page = CliRunner().invoke(app, ["materials", str(tmp_path / "tail.csv")])
    assert page.exit_code == 0 and "! tail: the last 1 point of the table" in " ".join(page.output.split())


def test_any_file_that_is_there_is_a_curve(tmp_path, monkeypatch):
    """A table by any ending or none; a built-in name stays what it is beside a file of this name."""
    from emclutch.cli.materials import laws_of

    monkeypatch.chdir(tmp_path)
    for name in ("core.tab", "core.bh", "core", "steel_1010"):
        Path(name).write_text("H (Oe)\tB (kG)\n0\t0\n1\t5\n10\t12\n100\t17\n")
    laws = laws_of(["core.tab", "core.bh", "core", "steel_1010"])
    assert [law.B[-1] for law in laws[:3]] == pytest.approx([1.7] * 3)
    assert laws[0].H[-1] == pytest.approx(1e5 / (4.0 * np.pi)) and laws[3].source.startswith("AISI 1010")
    with pytest.raises(SceneError, match=r"none.tab.*No such file"):
        laws_of(["none.tab"])
