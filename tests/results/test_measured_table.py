"""Measured tables: columns are found by their units, errors by their names; what is not used is named, not drawn."""

import warnings

import numpy as np
import pytest

from emclutch.results import OutputError
from emclutch.results.measured_table import OVER_RATED, TORQUE_CURVE, keep_measured, measured_in, read_measured


def read(folder, text, over=TORQUE_CURVE, encoding="utf-8"):
    (folder / "bench.csv").write_text(text, encoding=encoding)
    return read_measured(folder / "bench.csv", *over)


@pytest.mark.parametrize(
    "name",
    ["error", "Unsicherheit", "uncertainty", "sigma", "σ", "std", "std. dev.", "standard deviation", "±", "+/-",
     "Fehler", "torque error", "torque_err", "Standardabweichung", "M_sd"],
)  # fmt: skip
@pytest.mark.parametrize("unit", [" [N m]", " (mN m)", ""])
def test_the_usual_names_of_errors_are_no_curve(tmp_path, name, unit):
    (points,) = read(tmp_path, f"I [A];M [N m];{name}{unit}\n0,2;1,0;0,05\n0,4;2,5;\n").values()
    factor = 1e-3 if "mN" in unit else 1.0
    np.testing.assert_allclose(points, [[0.2, 1.0, 0.05 * factor], [0.4, 2.5, np.nan]])


def test_errors_in_per_cent_are_those_of_the_torque(tmp_path):
    found = read(tmp_path, "I [A],cold [N m],error [%],warm [N cm],rel. error [1]\n1,-2,5,300,0.1\n")
    assert found["cold"].tolist() == [[1.0, -2.0, 0.1]]
    assert found["warm"] == pytest.approx(np.array([[1.0, 3.0, 0.3]]))
    found = read(tmp_path, "I over rated,M over rated,error [%],other [%],error [%]\n1,0.5,4,50,2\n", OVER_RATED)
    assert found["M over rated"] == pytest.approx(np.array([[1.0, 0.5, 0.02]]))
    assert found["other"] == pytest.approx(np.array([[1.0, 0.5, 0.02]]))  # of one unit: points of per cent


def test_columns_stand_in_any_order_and_the_others_are_named(tmp_path):
    """The nearest torque before it has the error, also behind a column of something else."""
    head = "time [s],supply [mA],torque [N m],temperature [degC],error,coil current [mA],error [A],remark\n"
    with pytest.warns(UserWarning, match="not used: time, supply, temperature, error, remark$"):
        found = read(tmp_path, head + "1,0,3,20,0.1,400,0,warm\n2,0,,21,0.1,300,0,\n")
    assert list(found) == ["torque"] and found["torque"].tolist() == [[0.4, 3.0, 0.1]]
    with warnings.catch_warnings(action="error"):
        keep_measured(tmp_path / "bench.csv", tmp_path)  # said once
        assert measured_in(tmp_path)["torque"].tolist() == [[0.4, 3.0, 0.1]]


@pytest.mark.parametrize("sign", ["±", "+/-", "+-", " ± "])
@pytest.mark.parametrize("head", ["I [A];M [N m]", "I [A];M ± s [N m]", "I [A];M_Nm", "I;M\nA;N m"])
def test_a_cell_may_hold_a_value_with_its_error(tmp_path, head, sign):
    (points,) = read(tmp_path, f"{head}\n0,4;7,30{sign}0,15\n0,2;3,5\n").values()
    np.testing.assert_array_equal(points, [[0.2, 3.5, np.nan], [0.4, 7.3, 0.15]])


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("I [A],M [N m],error (95 %) [N m]\n1,2,3\n", "is no standard error .one sigma.; divide its values by 1.96"),
        ("I [A],M [N m],2 sigma [N m]\n1,2,3\n", "is no standard error"),
        ("I [A],M [N m],U (k=2)_err\n1,2,3\n", "is no standard error"),
        ("I [A],M [N m],relative error\n1,2,3\n", "'relative error' has no unit; write the unit of your"),
        ("I [A],M [N m],std,error\n1,2,3,4\n", "'error' is a second column of errors"),
        ("I [A],error [N m],M [N m]\n1,2,3\n", "follows no measured column"),
        ("I [A],M,error\n1,2,3\n", "has errors but follows no measured column; write the unit of 'M', e.g. 'M .N m"),
        ("I [A],M [N m]\n,2\n", "line 2: I = '' is not a number"),
        ("M [N m],I [A]\n2,\n", "line 2: I = '' is not a number"),
        ("I [A],temperature [degC]\n1,2\n", "'temperature' is in 'degC', which is unknown or of another quantity"),
        ("I [A];M [N m]\n0,4;7,30 ± zero\n", "line 2: error = 'zero' is not a number"),
    ],
)
def test_what_would_be_read_wrongly_is_refused(tmp_path, text, says):
    with pytest.raises(OutputError, match=says):
        read(tmp_path, text)


def test_a_table_of_a_spreadsheet_is_kept_as_it_is(tmp_path):
    found = read(tmp_path, "current [A]\ttorque [N m]\n1,5\t2\n", encoding="utf-16")
    keep_measured(tmp_path / "bench.csv", tmp_path)
    assert measured_in(tmp_path)["torque"].tolist() == found["torque"].tolist() == [[1.5, 2.0]]
