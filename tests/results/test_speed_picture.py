"""Speeds against time: measured tables are read as people write them; parabolas are the nearest ones."""

import numpy as np
import pytest

from emclutch.results import OutputError
from emclutch.results.measured_table import read_measured
from emclutch.results.pictures.figure import draw_measured, new_figure
from emclutch.results.pictures.speeds import explained_share, quadratic_factor, speeds_vary

AXES = "time [s]", "speed [rpm]"


def test_speeds_are_drawn_where_a_shaft_changes_its_speed():
    still = {"rotor_speed": np.full(5, 30.0), "disc_speed": np.zeros(5)}
    assert not speeds_vary(still)
    assert not speeds_vary({**still, "disc_speed": 1e-3 * np.arange(5.0)})  # dry friction holds it: it chatters
    assert speeds_vary({**still, "disc_speed": np.arange(5.0)})
    assert speeds_vary({"rotor_speed": np.arange(5.0), "disc_speed": np.zeros(5)})
    assert not speeds_vary({"rotor_speed": np.arange(5.0)})  # a box has no disc


def test_the_parabola_is_the_nearest_one_and_has_its_r_squared():
    rng = np.random.default_rng(0)
    speed = rng.uniform(0.0, 120.0, 200)
    torque = 0.07 * speed**2 + rng.normal(0.0, 20.0, 200)
    factor = quadratic_factor(speed, torque)
    assert factor == pytest.approx(np.linalg.lstsq(speed[:, None] ** 2, torque)[0][0])
    left = np.sum((torque - factor * speed**2) ** 2)
    assert explained_share(factor, speed, torque) == pytest.approx(1.0 - left / (200.0 * np.var(torque)))
    assert quadratic_factor(np.zeros(3), np.ones(3)) is None and explained_share(1.0, speed, np.ones(200)) is None


@pytest.mark.parametrize(
    "text",
    [
        "# of a test bench\ntime [s],motor [rpm],output [rpm]\n0,0,0\n1.5,500.25,\n1,250,10\n",
        "vrijeme (s);motor (1/min);izlaz (1/min)\n0;0;0\n1,5;500,25;\n1;250;10\n\n",
        "\ufefft [s]\tmotor_rpm\toutput in rpm\r\n0\t0\t0\r\n1.5\t500.25\t\r\n1\t250\t10\r\n",
    ],
    ids=["commas", "semicolons and decimal commas", "tabs, byte order mark"],
)
def test_tables_as_people_write_them(tmp_path, text):
    (tmp_path / "m.csv").write_bytes(text.encode())
    motor, output = read_measured(tmp_path / "m.csv", *AXES).values()
    assert motor.tolist() == [[0.0, 0.0], [1.0, 250.0], [1.5, 500.25]]  # by time
    assert output.tolist() == [[0.0, 0.0], [1.0, 10.0]]  # an empty cell was not measured


def test_a_column_of_errors_belongs_to_the_one_before_it(tmp_path):
    """It is no curve of its own; bars are of 95 %, and a value without an error has none."""
    (tmp_path / "m.csv").write_text("t [s],motor [rpm],error [rpm],output [rpm]\n0,1,0.5,7\n1,2,,8\n")
    table = read_measured(tmp_path / "m.csv", *AXES)
    np.testing.assert_array_equal(table["motor"], [[0.0, 1.0, 0.5], [1.0, 2.0, np.nan]])
    assert list(table) == ["motor", "output"] and table["output"].shape == (2, 2)
    _, (axis,) = new_figure(4.0, 3.0, None)
    draw_measured(axis, table, joined=True)
    (bars,) = axis.containers
    low, high = (cap.get_ydata() for cap in bars.lines[1])
    np.testing.assert_allclose([low, high], [[1.0 - 1.96 * 0.5, np.nan], [1.0 + 1.96 * 0.5, np.nan]])


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        (None, "cannot be read"),
        ("", "has no table"),
        ("0,0,0\n1,2,3\n", "line 1 has numbers but no header"),
        ("time [s]\n0\n", "has one column"),
        ("t_s,motor_rpm\n0,1\n1\n", "line 3 has 1 entries"),
        ("  # a comment\nt_s,motor_rpm\n0,fast\n", "line 3: motor = 'fast' is not a number"),
        ("t_s,motor_rpm\nnan,1\n", "line 2: t = 'nan' is not a number"),
        ("t_s,motor_rpm\n,1\n", "line 2: t = '' is not a number"),
        ('t_s,"motor\n[rpm]"\n0,1\n0,fast\n', "line 4: motor = 'fast'"),
        ('t_s,"motor [rpm]\n0,1\n', "line 1: unexpected end of data; look for a quote"),
        ("t_s,motor [rpm],motor [rad/s]\n0,1,2\n", "line 1 names 'motor' twice"),
        ("t_s,error [rpm]\n1,2\n", "follows no measured column"),
        ("t_s,motor_rpm,error\n1,2,-1\n", "line 2: an error is below 0"),
        ("time,motor [rpm]\n1,2\n", r"line 1: the column 'time' has no unit; .*wanted: time \[s\]; speed \[rpm\]"),
        ("time [s],motor\n1,2\n", "the column 'motor' has no unit"),
        ("time [s],motor [Hz]\n1,2\n", "'motor' is in 'Hz', which is unknown or of another quantity"),
    ],
)
def test_tables_that_are_none_are_refused_with_the_line(tmp_path, text, reason):
    if text is not None:
        (tmp_path / "m.csv").write_text(text)
    with pytest.raises(OutputError, match=reason):
        read_measured(tmp_path / "m.csv", *AXES)
