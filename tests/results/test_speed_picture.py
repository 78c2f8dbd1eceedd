"""Speeds against time: measured tables are read as people write them, the parabola is the nearest one."""

import math

import numpy as np
import pytest

from emclutch.results import OutputError
from emclutch.results.measured_table import read_measured
from emclutch.results.pictures.figure import draw_measured, new_figure
from emclutch.results.pictures.speeds import (
    explained_share,
    power_law,
    quadratic_factor,
    speed_picture,
    speeds_vary,
    torque_speed_picture,
)


def is_picture(path):
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def history(lag, count=50):
    time = np.linspace(0.0, 5.0, count)
    motor = 100.0 * np.clip((time - 2.0) / 2.0, 0.0, 1.0)
    return {"time": time, "rotor_speed": motor, "disc_speed": np.interp(time - lag, time, motor),
            "torque_disc": 0.05 * motor**2}  # fmt: skip


def labels_of(monkeypatch, draw):
    """The legend that a picture gets."""
    from matplotlib.axes import Axes

    seen = []
    original = Axes.legend

    def legend(axis, *arguments, **options):
        seen.extend(axis.get_legend_handles_labels()[1])
        return original(axis, *arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(Axes, "legend", legend)
        draw()
    return seen


def test_motors_that_turn_alike_are_drawn_once(tmp_path, monkeypatch):
    runs = {"200": history(2.0), "1000": history(0.5, 70)}
    path = tmp_path / "s.png"
    found = labels_of(monkeypatch, lambda: speed_picture(path, runs, title="two counts"))
    assert found == ["motor", "output, 200", "output, 1000"]
    assert is_picture(path)
    runs["free motor"] = {**history(1.0), "rotor_speed": np.full(50, 90.0)}
    found = labels_of(monkeypatch, lambda: speed_picture(path, runs))
    assert [name for name in found if name.startswith("motor")] == ["motor, 200", "motor, free motor"]


@pytest.mark.parametrize("count", [0, 1, 300])
def test_measured_speeds_lie_over_the_curves_of_one_run(tmp_path, monkeypatch, count):
    measured = {"tacho": np.column_stack([np.linspace(0, 5, count), np.linspace(0, 900, count)])}
    path = tmp_path / "s.png"
    found = labels_of(monkeypatch, lambda: speed_picture(path, {"run": history(1.0)}, measured=measured))
    assert found == ["motor", "output", "measured: tacho"]
    assert is_picture(path)


def test_a_run_that_has_just_begun_is_drawn(tmp_path):
    assert is_picture(speed_picture(tmp_path / "s.png", {"run": history(1.0, 1)}))
    assert is_picture(torque_speed_picture(tmp_path / "t.png", {"run": history(1.0, 1)}))  # nothing turns yet
    assert is_picture(torque_speed_picture(tmp_path / "t.png", {"run": history(1.0)}))
    with pytest.raises(OutputError, match="no disc_speed"):
        speed_picture(tmp_path / "x.png", {"box": {"time": [0.0], "rotor_speed": [0.0]}})


def test_only_a_standing_output_shows_what_the_clutch_transmits_at_a_speed(tmp_path, monkeypatch):
    """The parabola is that of the law while the output stands, whatever its torque when it turns or is locked."""
    held = history(2.0)
    held["disc_speed"][:] = 0.0
    law = f"{0.05 * (1000 * math.pi / 30) ** 2:.3g} N m · (rpm/1000)², R² = 1.00"
    started = {name: values.copy() for name, values in held.items()}
    started["disc_speed"][-10:] = 0.5 * started["rotor_speed"][-10:]
    started["torque_disc"][-10:] = 3.0
    locked = {name: values.copy() for name, values in held.items()}
    locked["disc_speed"][-10:] = locked["rotor_speed"][-10:]
    locked["torque_disc"][-10:] = 1.0  # a small load
    for run, found in ((held, [law]), (started, ["the output turns", law]), (locked, [law])):
        assert found == labels_of(monkeypatch, lambda run=run: torque_speed_picture(tmp_path / "t.png", {"run": run}))
    rng = np.random.default_rng(1)
    noise = {**held, "torque_disc": rng.normal(size=50)}  # no parabola: none is drawn
    assert labels_of(monkeypatch, lambda: torque_speed_picture(tmp_path / "t.png", {"run": noise})) == []


def test_the_share_explained_is_r_squared():
    speed, torque = np.array([1.0, 2.0, 3.0]), np.array([1.0, 5.0, 8.0])
    factor = quadratic_factor(speed, torque)
    assert factor == pytest.approx((1.0 + 20.0 + 72.0) / 98.0)
    left = np.sum((torque - factor * speed**2) ** 2)
    assert explained_share(factor, speed, torque) == pytest.approx(1.0 - left / (3.0 * np.var(torque)))
    assert explained_share(1.0, speed, speed**2) == 1.0
    assert explained_share(1.0, speed, np.ones(3)) is None


def test_speeds_are_drawn_where_a_shaft_changes_its_speed():
    still = {"rotor_speed": np.full(5, 30.0), "disc_speed": np.zeros(5)}
    assert not speeds_vary(still)
    assert not speeds_vary({**still, "disc_speed": 1e-3 * np.arange(5.0)})  # dry friction holds it: it chatters
    assert speeds_vary({**still, "disc_speed": np.arange(5.0)})
    assert speeds_vary({"rotor_speed": np.arange(5.0), "disc_speed": np.zeros(5)})
    assert not speeds_vary({"rotor_speed": np.zeros(0), "disc_speed": np.zeros(0)})
    assert not speeds_vary({"rotor_speed": np.arange(5.0)})  # a box has no disc


def test_an_exact_power_law_is_found():
    speed = np.array([0.0, 10.0, 20.0, 50.0, 100.0])
    factor, exponent, error = power_law(speed, 0.3 * speed**1.7)
    assert (factor, exponent) == pytest.approx((0.3, 1.7))
    assert error == pytest.approx(0.0, abs=1e-9)
    for few in ([0.0, 10.0, 20.0], [10.0, 10.0, 10.0], []):
        assert power_law(few, np.ones(len(few))) is None
    assert power_law([10.0, 20.0, 30.0], [1.0, -1.0, 2.0]) is None  # two that transmit


def test_the_exponents_error_is_that_of_least_squares():
    """Against numpy's polyfit; errors smaller than the scatter are widened by it, larger ones are kept."""
    rng = np.random.default_rng(1)
    speed = np.linspace(20.0, 100.0, 12)
    for noise in (0.01, 0.2):
        torque = 0.05 * speed**2 * np.exp(noise * rng.normal(size=12))
        sigma = 0.05 * torque * rng.uniform(0.5, 2.0, 12)
        weight = torque / sigma
        fit, covariance = np.polyfit(np.log(speed), np.log(torque), 1, w=weight, cov="unscaled")
        left = np.log(torque) - np.polyval(fit, np.log(speed))
        scatter = float(np.sum((weight * left) ** 2)) / 10
        assert (scatter > 1.0) == (noise == 0.2)
        found = power_law(speed, torque, sigma)
        assert found == pytest.approx(
            (math.exp(fit[1]), fit[0], math.sqrt(covariance[0, 0] * max(1.0, scatter))), rel=1e-9
        )
    sigma[3] = np.nan  # one unknown error: all points count alike
    fit, covariance = np.polyfit(np.log(speed), np.log(torque), 1, cov=True)
    assert power_law(speed, torque, sigma)[1:] == pytest.approx((fit[0], math.sqrt(covariance[0, 0])), rel=1e-9)


def test_the_parabola_is_the_nearest_one():
    """Against numpy's least squares; and exactly for an exact parabola."""
    rng = np.random.default_rng(0)
    speed = rng.uniform(0.0, 120.0, 200)
    torque = 0.07 * speed**2 + rng.normal(0.0, 20.0, 200)
    assert quadratic_factor(speed, torque) == pytest.approx(np.linalg.lstsq(speed[:, None] ** 2, torque)[0][0])
    assert quadratic_factor(speed, 0.07 * speed**2) == pytest.approx(0.07)
    assert quadratic_factor(np.zeros(3), np.ones(3)) is None


@pytest.mark.parametrize(
    "text",
    [
        "time,motor,output\n0,0,0\n1.5,500.25,\n1,250,10\n",
        "vrijeme;motor;izlaz\n0;0;0\n1,5;500,25;\n1;250;10\n\n",
        "# of a test bench\n# twice\nt,motor,output\n0,0,0\n1.5,500.25,\n1,250,10\n",
        "\ufefft [s]\tmotor\toutput\r\n0\t0\t0\r\n1.5\t500.25\t\r\n1\t250\t10\r\n",
    ],
    ids=["commas", "semicolons and decimal commas", "comments", "tabs, byte order mark"],
)
def test_tables_as_people_write_them(tmp_path, text):
    (tmp_path / "m.csv").write_bytes(text.encode())
    motor, output = read_measured(tmp_path / "m.csv", "time [s]", "speed [rpm]").values()
    assert motor.tolist() == [[0.0, 0.0], [1.0, 250.0], [1.5, 500.25]]  # by time
    assert output.tolist() == [[0.0, 0.0], [1.0, 10.0]]  # an empty cell was not measured


def test_a_column_of_errors_belongs_to_the_one_before_it(tmp_path):
    """It is no curve of its own; a value without an error has a bar of none."""
    (tmp_path / "m.csv").write_text("t [s],motor [rpm],error [rpm],output [rpm]\n0,1,0.5,7\n1,2,,8\n")
    table = read_measured(tmp_path / "m.csv", "time [s]", "speed [rpm]")
    np.testing.assert_array_equal(table["motor [rpm]"], [[0.0, 1.0, 0.5], [1.0, 2.0, np.nan]])
    assert list(table) == ["motor [rpm]", "output [rpm]"] and table["output [rpm]"].shape == (2, 2)
    _, (axis,) = new_figure(4.0, 3.0, None)
    draw_measured(axis, table, joined=True)
    (bars,) = axis.containers  # of 95 %
    low, high = (cap.get_ydata() for cap in bars.lines[1])
    np.testing.assert_allclose([low, high], [[1.0 - 1.96 * 0.5, np.nan], [1.0 + 1.96 * 0.5, np.nan]])
    with pytest.raises(OutputError, match="cannot be read"):
        read_measured(tmp_path / "none.csv", "time [s]", "speed [rpm]")


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("", "must name the columns"),
        ("0,0,0\n1,2,3\n", "must name the columns"),
        ("time\n0\n", "must name the columns"),
        ("time,motor\n0,1\n1\n", "line 3"),
        ("time,motor\n0,fast\n", "line 2: 'fast' in column 'motor'"),
        ("time,motor\nnan,1\n", "line 2"),
        ("# a comment\ntime,motor\n0,fast\n", "line 3: 'fast' in column 'motor'"),
        ("# a comment alone\n", "must name the columns"),
        ("  # indented\ntime,motor\n0,fast\n", "line 3: 'fast' in column 'motor'"),
        ('time,"motor\n[rpm]"\n0,1\n0,fast\n', r"line 4: 'fast' in column 'motor \[rpm\]'"),
        ('time,"motor\n0,1\n', "line 1: unexpected end of data; look for a quote"),
        ("time,motor [rpm],motor [rad/s]\n0,1,2\n", r"several columns are 'motor \[rpm\]'"),
        ("time,error\n1,2\n", "errors follows no measured one"),
        ("time,motor,error\n1,2,-1\n", "line 2: '-1' in column 'error' is not an error of at least 0"),
    ],
)
def test_tables_that_are_none_are_refused_with_the_line(tmp_path, text, reason):
    (tmp_path / "m.csv").write_text(text)
    with pytest.raises(OutputError, match=reason):
        read_measured(tmp_path / "m.csv", "time [s]", "speed [rpm]")


def test_speeds_are_drawn_in_rpm(tmp_path, monkeypatch):
    from matplotlib.axes import Axes

    drawn = []
    original = Axes.plot

    def plot(axis, *arguments, **options):
        drawn.append(np.asarray(arguments[1], dtype=float))
        return original(axis, *arguments, **options)

    monkeypatch.setattr(Axes, "plot", plot)
    speed_picture(tmp_path / "s.png", {"run": history(0.0)})
    assert max(curve.max() for curve in drawn) == pytest.approx(100.0 * 30.0 / math.pi)  # 100 rad/s
