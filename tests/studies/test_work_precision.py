"""`accuracy`: the table holds every knob, setting and quantity, and its errors are errors."""

from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas
import pytest

import emclutch
from emclutch.results import Estimate
from emclutch.scene.errors import SceneError
from emclutch.studies.work_precision import Measurement, SmearWidth, accuracy, price_table, relative_error, run_torque

CASES = Path(__file__).resolve().parents[2] / "cases"


def test_price_tag_of_the_quickstart_at_toy_size(tmp_path):
    toy = {
        "time.end": "0.02 ms",
        "particles.sector": "4.5 deg",
        "particles.solid_fraction": 0.1,
        "field.size_factor": 2.0,
        "accuracy.mesh": [2.0, 1.4, 1.0],
        "accuracy.contact_step": [10.0, 20.0],
        "accuracy.smear": [2.5, 3.0],
        "accuracy.refresh": [80, 40],
    }
    folder = emclutch.accuracy(emclutch.load_case(CASES / "quickstart.toml").with_values(toy), out=tmp_path / "price")
    table = pandas.read_csv(folder / "accuracy.csv")
    assert (folder / "accuracy.png").stat().st_size > 10_000
    quantities = set(table[table.knob == "field mesh"].quantity)
    standing = {"H at grains", "grad H at grains", "moments", "magnetic pull"}
    assert quantities == standing | {"torque"}
    assert set(table[table.knob == "smear width"].quantity) == {"moments", "magnetic pull"}
    assert set(table[table.knob == "moment refresh"].quantity) == {"torque"}
    assert set(table[table.knob == "contact step"].quantity) == {"torque"}
    finest = table[table.setting.isin([1.0]) & (table.knob == "field mesh")]
    assert finest.error.isna().all()  # the reference has no error of its own
    error = table[table.knob == "field mesh"].pivot(index="setting", columns="quantity", values="error")
    # measured against the finest: 5, 4 and 34 % on the coarsest mesh
    for quantity, low, high in (("H at grains", 0.01, 0.2), ("moments", 0.01, 0.15), ("grad H at grains", 0.1, 1.0)):
        assert low < error[quantity][2.0] < high, error
        assert error[quantity][1.4] < 0.85 * error[quantity][2.0], error
    assert (table.seconds > 0).all()


def test_errors_are_against_the_last_setting_of_their_knob():
    measured = {
        ("mesh", 2.0): Measurement({"B": 1.1, "H": np.array([1.0, 2.0])}, {"B": 1.0, "H": 1.0}, {"B": 0.03}),
        ("mesh", 1.0): Measurement({"B": 1.0, "H": np.array([1.0, 2.2])}, {"B": 3.0, "H": 3.0}, {"B": 0.04}),
        ("step", 10.0): Measurement({"B": 2.0}, {"B": 1.0}),
        ("step", 20.0): Measurement({"B": 4.0}, {"B": 2.0}),
    }
    table = price_table(measured).set_index(["knob", "setting", "quantity"])
    assert table.error["mesh", 2.0, "B"] == pytest.approx(0.1)
    assert table.noise["mesh", 2.0, "B"] == pytest.approx(0.05)
    assert table.error["mesh", 2.0, "H"] == pytest.approx(np.sqrt(0.02) / np.sqrt((1 + 2.2**2) / 2))
    assert table.error["step", 10.0, "B"] == pytest.approx(0.5)
    assert np.isnan(table.error["step", 20.0, "B"])


def test_a_torque_of_unknown_error_has_infinite_noise(monkeypatch, tmp_path):
    """With 0 instead every difference would count as an error of the setting."""
    torque = Estimate(2.0, None, 0, None, 0.0, False, "not converged: 5 samples, 20 needed; run longer")
    ran = SimpleNamespace(torque=torque, summary={"seconds": {"total": 1.0}})
    monkeypatch.setattr("emclutch.studies.work_precision.run", lambda case, out: ran)
    known = Measurement({"torque": 1.9}, {"torque": 4.0}, {"torque": 0.01})
    table = price_table({("step", 10.0): run_torque(None, tmp_path), ("step", 20.0): known})
    assert np.isinf(table.noise[0]) and table.error[0] == pytest.approx(0.1 / 1.9)


def test_error_of_nothing_is_absolute():
    assert relative_error(0.0, 0.0) == 0.0
    assert relative_error(3.0, 0.0) == 3.0


def test_default_smear_widths_fit_the_sector_and_own_ones_are_refused_before_anything_runs(tmp_path):
    """The quickstart's sector has room for 2.5 diameters: what is wider once stopped it after two minutes."""
    case = emclutch.load_case(CASES / "quickstart.toml")
    widths = SmearWidth().settings(case)
    assert len(widths) > 1 and all(SmearWidth().turned(case, width) is not None for width in widths)
    assert set(widths) < set(case.scene.accuracy.smear)
    own = case.with_values({"accuracy.smear": [2.5, 3.5]})
    with pytest.raises(SceneError, match=r"particles.sector"):
        accuracy(own, out=tmp_path / "out")
    assert not (tmp_path / "out" / "warm-up").exists()
