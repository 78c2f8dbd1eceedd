"""`emclutch shear-cell` at toy size: table, files, the cache that is asked first, and what bad input is reported."""

import json

import numpy as np
import pandas
import pytest
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.cli.shear_cell import points_of
from emclutch.scene.errors import SceneError
from emclutch.scene.units import Quantity
from emclutch.scene.value_list import read_list
from emclutch.simulation.forecast import sheared_points
from emclutch.simulation.forecast.sheared_points import (
    carlson_flux_density,
    carlson_stress,
    kept_point,
    point_file,
    stress_of_field,
)

TOY = ("--fill", "0.3", "--field", "40 kA/m, 80 kA/m", "--seeds", "1", "--grains", "110", "--strain", "0.002")
FIELD = Quantity("a field strength", "A/m", "80 kA/m", 0.0, 1e7, open_minimum=True)


def invoke(*arguments):
    return CliRunner().invoke(app, ["shear-cell", *map(str, arguments)])


@pytest.fixture(scope="module")
def sheared(tmp_path_factory):
    folder = tmp_path_factory.mktemp("shear_cell")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("EMCLUTCH_CACHE", str(folder / "cache"))
        # the pair table that ships is of chi 999: no table is made here
        result = invoke("--chi", 999, "--ms", "1.7 MA/m", *TOY, "--out", folder / "first")
        assert result.exit_code == 0, result.output
        yield folder, result.output


def test_table_and_files_say_the_same(sheared):
    folder, text = sheared
    table = pandas.read_csv(folder / "first" / "tau_of_field.csv")
    data = json.loads((folder / "first" / "shear_cell.json").read_text())
    assert list(table["H"]) == [40e3, 80e3]
    assert table["tau"].to_numpy() == pytest.approx([row["tau"] for row in data["table"]], rel=1e-5)
    assert (table["mu_r_at_rest"] > 2.0).all() and (table["mu_r_at_rest"] < 4.0).all()
    assert data["run"]["count"] == 110 and len(data["points"][0]["series"]["tau"]) > 5
    assert (folder / "first" / "tau_of_field.png").stat().st_size > 10_000
    assert "Carlson" in text and "mu_r" in text


def test_what_is_done_is_taken_from_the_cache(sheared, monkeypatch):
    """The same points again, in JSON, without a step; a damaged file is none; another strain is another point."""
    folder, _ = sheared
    done = json.loads((folder / "first" / "shear_cell.json").read_text())
    monkeypatch.setattr("coupling.powder_cell.PowderCell", None)
    again = invoke("--chi", 999, "--ms", "1.7e6", *TOY, "--out", folder / "again", "--json")
    assert again.exit_code == 0, again.output
    assert json.loads(again.output)["table"] == done["table"]
    kept = sorted((folder / "cache").glob("sheared-*.json"))
    assert len(kept) == 2 and not list((folder / "cache").glob("*.new"))


def test_an_interrupted_command_keeps_what_is_done(sheared, monkeypatch):
    folder, _ = sheared
    shear = sheared_points.sheared_point

    def second_is_stopped(point, progress):
        if point.H > 60e3:
            raise KeyboardInterrupt
        return shear(point, progress)

    monkeypatch.setattr("emclutch.cli.shear_cell.sheared_point", second_is_stopped)
    result = invoke("--chi", 999, "--ms", "1.7 MA/m", *TOY, "--out", folder / "stopped")
    assert result.exit_code == 130
    assert list(pandas.read_csv(folder / "stopped" / "tau_of_field.csv")["H"]) == [40e3]


def test_points_that_are_not_of_these_parameters_are_not_taken(tmp_path, monkeypatch):
    from coupling.powder_cell import ShearParameters

    monkeypatch.setenv("EMCLUTCH_CACHE", str(tmp_path))
    point = ShearParameters(law=None, fill=0.3, H=0.0, friction=0.3)
    path = point_file(point)
    for text in ('{"digest": "of another"}', "{", "[]"):
        path.write_text(text)
        assert kept_point(point) is None


def test_means_over_seeds():
    def point(H, seed, tau, error):
        kept = {"fill": 0.32, "H": H, "seed": seed, "power": tau, "mu_r_at_rest": 3.0, "mu_r": {"mean": 4.0}}
        return kept | {
            "tau": {"mean": tau, "standard_error": error},
            "inertial_number": 5e-3,
            "deepest": 0.0,
            "seconds": 1,
        }

    low, high = stress_of_field([point(8e4, 1, 21e3, 3e2), point(2e4, 1, 5e3, 1e2), point(8e4, 2, 19e3, 4e2)])
    assert (high.tau, high.seeds, high.seconds) == (20e3, 2, 2)
    assert high.tau_error == pytest.approx(1e3)  # their difference says more than their own errors
    assert low.tau_error == 1e2 and low.exponent is None
    assert high.exponent == pytest.approx(np.log(4.0) / np.log(4.0))


def test_carlson_as_tabulated():
    """kPa and T for fills of 0.32 and 0.45, calculated from the fits elsewhere."""
    assert carlson_stress(0.32, [18e3, 80e3, 200e3, 500e3]) == pytest.approx([5.4e3, 22.4e3, 40.8e3, 47.7e3], rel=0.01)
    assert carlson_stress(0.45, 80e3) == pytest.approx(37.6e3, rel=0.01)
    assert carlson_flux_density(0.32, [18e3, 200e3]) == pytest.approx([0.138, 0.743], rel=0.01)


def test_lists_of_fields():
    assert read_list("80 kA/m, 18 kA/m,80000", FIELD, "--field") == [80e3, 18e3, 80e3]
    points = points_of(
        None, "0.3", "80 kA/m, 18 kA/m,80000", seeds=1, grains=600, strain=1.0, friction=0.3, rolling=0.1,
        model="near_field",
    )  # fmt: skip
    assert [point.H for point in points] == [18e3, 80e3]  # ascending, each once
    assert read_list("10 kA/m : 30 kA/m : 3", FIELD, "--field") == [10e3, 20e3, 30e3]
    for wrong in ("10 : 20", "a : b : 1", "3 kg", "", "0 A/m"):
        with pytest.raises(SceneError):
            read_list(wrong, FIELD, "--field")


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        ((), "needs the name of a powder"),
        (("powder_iron", "--chi", 100), "'powder_iron' has its own"),
        (("--chi", 100), "needs --ms, the saturation"),
        (("powder_iron", "--seeds", 0), "--seeds = 0 is out of range; allowed: 1 to 99"),
        (("sand",), "is not known"),
        (("--chi", -1, "--ms", "1 MA/m"), "above 0"),
        (("powder_iron", "--grains", 20), "are too few"),
        (("powder_iron", "--fill", "0.7"), "--fill"),
        (("powder_iron", "--field", "3 kg"), "field strength is needed"),
        (("powder_iron", "--model", "fixed"), "choose one of"),
    ],
)
def test_bad_input_is_explained(arguments, says):
    result = invoke(*arguments)
    assert result.exit_code == 2
    assert says in result.output
