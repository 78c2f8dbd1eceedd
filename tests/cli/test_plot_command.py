"""plot: runs and studies over one another, each with its band; pictures that a killed run owes are drawn."""

import re
from pathlib import Path

import numpy as np
import pandas
import pytest
from typer.testing import CliRunner
from written_run import written_run, written_study

from emclutch.cli.main import app
from emclutch.cli.plot import GRAIN_SIZE, TORQUE_CURRENT, curves_of, plot_runs, runs_of
from emclutch.results import OutputError, load_result, pictures
from emclutch.results.measured_table import OVER_RATED, read_measured
from emclutch.results.pictures.figure import save_picture
from emclutch.results.text import format_time, time_unit
from emclutch.scene.errors import SceneError
from emclutch.simulation.pictures import draw_missing, moment_in_words, steady_current

CASES = Path(__file__).resolve().parents[2] / "cases"


@pytest.fixture
def figures(monkeypatch):
    """The figures that are saved, in place of files."""
    from emclutch.results.pictures import torque as torque_overlay_picture

    kept = []
    monkeypatch.setattr(torque_overlay_picture, "save_picture", lambda figure, path: kept.append(figure) or Path(path))
    return kept


def test_every_run_has_its_band_around_its_mean(tmp_path, figures):
    study = written_study(tmp_path / "study", [1.0, 3.0])
    other = written_run(tmp_path / "other", mean=5.0).path
    plot_runs([study, other], out=tmp_path / "o.png")
    (axis,) = figures[0].axes
    results = [load_result(study / name) for name in ("point-000", "point-001")] + [load_result(other)]
    bands = [band.get_paths()[0].vertices[:, 1] for band in axis.collections]
    assert len(bands) == 3
    for band, result in zip(bands, results, strict=True):
        assert (band.min(), band.max()) == pytest.approx(result.torque.interval())
    labels = [text.get_text() for text in axis.get_legend().get_texts()]
    assert [label.split(":")[0] for label in labels] == ["study", "study", "other"]
    assert labels[0].startswith("study: current 1 A: ")


def test_the_legend_lies_beside_the_curves(tmp_path, figures):
    plot_runs([written_study(tmp_path / "study", [1.0, 3.0])], out=tmp_path / "o.png")
    (axis,) = figures[0].axes
    figures[0].canvas.draw()
    assert axis.get_legend().get_window_extent().x0 >= axis.get_window_extent().x1


def test_a_run_of_unknown_error_has_no_band(tmp_path, figures):
    runs = [written_run(tmp_path / name, windows=count).path for name, count in (("long", 200), ("short", 5))]
    plot_runs(runs, out=tmp_path / "o.png")
    (axis,) = figures[0].axes
    assert len(axis.collections) == 1
    assert "error unknown" in axis.get_legend().get_texts()[1].get_text()


def test_one_folder_is_drawn_as_ever_and_an_existing_file_is_kept(tmp_path):
    folder = written_run(tmp_path / "run").path
    assert plot_runs([folder]) == folder / "torque-1.png"
    with pytest.raises(OutputError, match="exists"):
        plot_runs([folder], out=folder / "torque-1.png")
    assert list(runs_of([folder])) == ["run"]


def test_torque_against_current_lies_on_what_was_measured(tmp_path, monkeypatch):
    """In A and N m, and over the point at a rated current, where measured shares are drawn as they are."""
    from emclutch.results.pictures import torque_curves

    kept = []
    monkeypatch.setattr(torque_curves, "save_picture", lambda figure, path: kept.append(figure) or Path(path))
    study = written_study(tmp_path / "study", [1.0, 2.0, 4.0])
    (tmp_path / "bench.csv").write_text("# my brake\nI [A],rising [N m],falling [N m]\n0,0,\n1,0.5,0.6\n2,1,1\n")
    asked = {"measured": tmp_path / "bench.csv", "out": tmp_path / "o.png"}
    plot_runs([study], TORQUE_CURRENT, **asked)
    (tmp_path / "shares.csv").write_text("I,rising,falling\n0,0,\n1,0.5,0.6\n2,1,1\n")
    plot_runs([study], TORQUE_CURRENT, rated="2 A", **asked | {"measured": tmp_path / "shares.csv"})
    assert [len(figure.axes) for figure in kept] == [1, 2] and kept[1].axes[1].get_xscale() == "log"
    torques = [load_result(study / f"point-00{number}").torque for number in range(3)]
    means, errors = (np.array([getattr(one, name) for one in torques]) for name in ("mean", "standard_error"))
    (absolute,), (shares, logarithmic) = (figure.axes for figure in kept)
    for axis, x, y in (
        (absolute, [1.0, 2.0, 3.0], means),
        (shares, [0.5, 1.0, 1.5], means / means[1]),
        (logarithmic, [0.5, 1.0, 1.5], means / means[1]),
    ):
        curves = {line.get_label(): line.get_xydata().tolist() for line in axis.get_lines()}
        assert curves["measured: rising"] == [[0.0, 0.0], [1.0, 0.5], [2.0, 1.0]]
        assert curves["measured: falling"] == [[1.0, 0.6], [2.0, 1.0]]
        drawn = next(line for line in axis.get_lines() if len(line.get_xdata()) == 3 and line.get_marker() == "None")
        assert drawn.get_xdata() == pytest.approx(x) and drawn.get_ydata() == pytest.approx(y)
    (curve,) = (one.over_rated(2.0) for one in curves_of([study], TORQUE_CURRENT))
    of_ratio = means / means[1] * np.hypot(errors / means, errors[1] / means[1])  # of independent torques
    assert curve.error == pytest.approx([of_ratio[0], 0.0, of_ratio[2]], rel=0.05) and curve.torque[1] == 1.0


def test_runs_alone_are_one_curve_and_a_study_is_averaged_over_its_seeds(tmp_path):
    runs = []
    for current, mean in ((2.0, 3.0), (1.0, 1.0)):
        folder = written_run(tmp_path / f"run-{current:g}", mean=mean)
        folder.write_summary({**folder.read_summary(), "current": current})
        runs.append(folder.path)
    study = written_study(tmp_path / "study", [1.0, 2.0, 3.0, 5.0])
    table = pandas.read_csv(study / "study.csv")
    table.insert(0, "scene.seed", [1, 2, 1, 2])
    table["coil.current"], table["current"] = ["1 A", "1 A", "2 A", "2 A"], [1.0, 1.0, 2.0, 2.0]
    table.to_csv(study / "study.csv", index=False)
    seeds, alone = curves_of([*runs, study], TORQUE_CURRENT)
    assert seeds.x.tolist() == [1.0, 2.0] and seeds.torque == pytest.approx([1.5, 4.0], rel=0.02)
    assert alone.x.tolist() == [1.0, 2.0] and alone.torque == pytest.approx([1.0, 3.0], rel=0.02)


def test_runs_of_several_grain_sizes_are_extrapolated(tmp_path):
    """T = 2 N m (1 + 6/n^2) and what is printed of it; runs without grains per gap are refused."""
    runs = []
    for across in (4.0, 8.0, 16.0):
        folder = written_run(tmp_path / f"run-{across:g}", mean=2.0 + 12.0 / across**2)
        folder.write_summary({**folder.read_summary(), "grain_size": {"across": across, "real_across": 20.0}})
        runs.append(folder.path)
    done = CliRunner().invoke(app, ["plot", *map(str, runs), "--grain-size", "--out", str(tmp_path / "o.png")])
    assert done.exit_code == 0, done.output
    assert "3 grain sizes, 4 to 16 grains per gap: T = " in done.output
    found = re.search(r"at the 20 grains per gap of the real powder: ([0-9.]+) N m", done.output)
    assert float(found[1]) == pytest.approx(2.03, rel=0.01)
    assert (tmp_path / "o.png").stat().st_size > 10_000
    with pytest.raises(OutputError, match="study has no grains per gap"):
        plot_runs([written_study(tmp_path / "study", [1.0, 2.0])], GRAIN_SIZE)


def test_what_cannot_be_drawn_over_the_current_is_refused(tmp_path):
    study, run = written_study(tmp_path / "study", [1.0, 2.0]), written_run(tmp_path / "run").path
    (bench := tmp_path / "bench.csv").write_text("current_A,torque_Nm\n0.9,12\n")
    for given, reason in (
        ({"rated": "3 A"}, r"no torque at 3 A to divide by; it has: 1, 2 A"),
        ({"rated": "3 V"}, "--rated = '3 V' is a voltage; a current is needed"),
        ({"rated": "0 A"}, "allowed"),
        ({"rated": "1 A", "measured": bench}, "'current' is in 'A', which is .*wanted: current over the rated one"),
        ({"kind": "torque", "rated": "1 A"}, "add --torque-current"),
        ({"kind": "torque", "measured": tmp_path / "m.csv"}, "add --speeds or --torque-current"),
    ):
        with pytest.raises((OutputError, SceneError), match=reason):
            plot_runs([study], **{"kind": TORQUE_CURRENT, **given})
    with pytest.raises(OutputError, match="run has no coil current"):
        plot_runs([run], TORQUE_CURRENT)


AXES = "current [A]", "torque [N m]"


@pytest.mark.parametrize(
    ("columns", "over", "named"),
    [
        (("current [mm]", "rising [N m]"), AXES, "'current' is in 'mm', which is unknown .*; known: A"),
        (("current [A]", "rising"), ("current over rated", "torque over rated"), "'current' is in 'A'"),
        (("current_A", "torque_Nm"), OVER_RATED, "'current' is in 'A', .*wanted: current over the rated one"),
        (("current (A)", "torque (N m)"), OVER_RATED, "'current' is in 'A'"),
        (("current", "torque (N m)"), OVER_RATED, "'torque' is in 'N m'"),
        (("current [A]", "torque [V]"), AXES, "'torque' is in 'V'"),
        (("current", "torque [N m]"), AXES, "'current' has no unit; .*wanted: current .A.; torque .N m. in each"),
        (("current [A]", "torque"), AXES, "'torque' has no unit; .*wanted: current .A.; torque .N m. in each"),
        (("current_A", "brake_B"), AXES, "'brake_B' has no unit"),
        (("current_A", "torque (cold)"), AXES, "'torque .cold.' has no unit"),
    ],
)
def test_a_column_without_a_unit_or_in_that_of_another_quantity_is_refused(tmp_path, columns, over, named):
    table = tmp_path / "bench.csv"
    table.write_text(f"{','.join(columns)}\n200,2\n")
    with pytest.raises(OutputError, match=named):
        read_measured(table, *over)
    table.write_text("current [A],rising [N m]\n1,2\n")
    assert read_measured(table, *AXES)["rising"].tolist() == [[1.0, 2.0]]


def test_a_column_in_another_unit_of_its_quantity_is_converted(tmp_path):
    """1 mA = 1e-3 A, 1 N cm = 1e-2 N m with its error; 2 pi rad/s are 60 rpm, and 1 Hz is refused as no angle."""
    table = tmp_path / "bench.csv"
    table.write_text("current_mA,torque [N cm],error [mN m],other (N m)\n400,200,5,3\n")
    found = read_measured(table, *AXES)
    assert list(found) == ["torque", "other"]
    assert np.concatenate([*found.values()], axis=1) == pytest.approx(np.array([[0.4, 2.0, 5e-3, 0.4, 3.0]]))
    table.write_text("time [ms],motor [rad/s],output [rpm]\n500,6.283185307,60\n")
    found = read_measured(table, "time [s]", "speed [rpm]")
    assert np.concatenate([*found.values()]) == pytest.approx(np.array([[0.5, 60.0]] * 2))
    table.write_text("time [ms],motor [Hz]\n500,1\n")
    with pytest.raises(OutputError, match="'motor' is in 'Hz', which is unknown or of another quantity; known: rad/s"):
        read_measured(table, "time [s]", "speed [rpm]")


@pytest.mark.parametrize(("unit", "factor"), [("mNm", 1e-3), ("Nmm", 1e-3), ("Ncm", 1e-2), ("N_cm", 1e-2)])
def test_errors_without_a_unit_have_that_of_their_torque(tmp_path, unit, factor):
    table = tmp_path / "bench.csv"
    for name in (f"torque_{unit}", f"torque ({unit})", f"torque [{unit}]"):
        table.write_text(f"current_A,{name},error\n1,10,1\n")
        (points,) = read_measured(table, *AXES).values()
        assert points == pytest.approx(np.array([[1.0, 10.0 * factor, factor]]))


@pytest.mark.parametrize("unit", ["1/min", "min-1", "min^-1", "min⁻¹", "rpm"])
def test_speeds_per_minute_are_turns(tmp_path, unit):
    table = tmp_path / "bench.csv"
    for name in (f"motor [{unit}]", f"motor ({unit})", f"motor_{unit}"):
        table.write_text(f"t_s,{name}\n1,10\n")
        assert read_measured(table, "time [s]", "speed [rpm]")["motor"].tolist() == [[1.0, 10.0]]


@pytest.mark.parametrize("unit", ["MA", "ma"])
@pytest.mark.parametrize("name", ["CURRENT_{}", "current [{}]", "current ({})"])
def test_capitals_that_mean_another_unit_are_refused(tmp_path, unit, name):
    """MA is a megaampere and ma a year; both are typed for mA."""
    table = tmp_path / "bench.csv"
    table.write_text(f"{name.format(unit)},torque [N m]\n900,12\n")
    with pytest.raises(OutputError, match=f"is in '{unit}', which is unknown .*did you mean mA"):
        read_measured(table, *AXES)


POUND_INCH = 0.45359237 * 9.80665 * 0.0254  # [N m]


@pytest.mark.parametrize(
    ("unit", "factor"),
    [
        *((unit, POUND_INCH) for unit in ("lbin", "in_lb", "in-lbs", "lbf in", "in·lbf", "lb-in")),
        *((unit, 12.0 * POUND_INCH) for unit in ("lb_ft", "ft-lb", "ft-lbs", "ft.lbf")),
        *((unit, POUND_INCH / 16.0) for unit in ("ozin", "oz-in", "ozf in")),
        ("kgcm", 9.80665e-2),
    ],
)
def test_torques_of_pounds_ounces_and_kilograms_are_converted(tmp_path, unit, factor):
    table = tmp_path / "bench.csv"
    for name in (f"torque_{unit}", f"torque ({unit})", f"torque [{unit}]", f"torque {unit}", f"torque / {unit}"):
        table.write_text(f"current_A,{name}\n1,2\n")
        assert read_measured(table, *AXES)["torque"] == pytest.approx(np.array([[1.0, 2.0 * factor]]), rel=1e-12)


def test_names_in_the_wanted_unit_are_read(tmp_path):
    table = tmp_path / "bench.csv"
    names = ["torque_Nm", "rising_N_m", "T [Nm]", "M (N·m)", "brake_A [N m]", "cold_in_oil [N m]", "lower_arm in N m"]
    table.write_text(f"current_A,{','.join(names)}\n1{',2' * len(names)}\n")
    assert list(read_measured(table, *AXES)) == ["torque", "rising", "T", "M", "brake_A", "cold_in_oil", "lower_arm"]


def test_currents_with_thousands_are_read_or_refused(tmp_path):
    table = tmp_path / "bench.csv"
    table.write_text("current [mA];torque [N m]\n1,000;2.5\n")
    assert read_measured(table, *AXES)["torque"].tolist() == [[1.0, 2.5]]
    table.write_text("current [mA];torque [N m]\n1,000;2\n")
    with pytest.raises(OutputError, match=r"line 2: '1,000' may be 1000 or 1\.000; write one of them"):
        read_measured(table, *AXES)


def test_the_measured_brakes_that_ship_lie_over_a_study(tmp_path):
    study = written_study(tmp_path / "study", [1.0, 2.0])
    measured = ["--with", str(CASES / "validation" / "dry_powder_brakes.csv")]
    drawn = CliRunner().invoke(app, ["plot", str(study), "--torque-current", "--rated", "2 A", *measured])
    assert drawn.exit_code == 0 and drawn.output.strip() == str(study / "torque_current-1.png")
    assert (study / "torque_current-1.png").stat().st_size > 10_000
    both = CliRunner().invoke(app, ["plot", str(study), "--torque-current", "--speeds"])
    assert both.exit_code == 2 and "makes another picture than --speeds" in both.output


@pytest.mark.parametrize(("longest", "unit"), [(0.0, "s"), (2.0, "s"), (1.0, "s"), (0.5, "ms"), (2e-4, "µs")])
def test_times_are_said_in_the_unit_of_their_size(longest, unit):
    name, factor = time_unit(longest)
    assert name == unit and format_time(longest) == f"{factor * longest:.3g} {unit}"


def test_a_title_says_the_moment_and_a_current_that_stays():
    switched_on = pandas.DataFrame({"current": [0.0, 0.25]})
    assert moment_in_words(switched_on, 4e-3) == "0.25 A, t = 4 ms"
    assert moment_in_words(pandas.DataFrame({"time": [1.5]}), 1.5) == "t = 1.5 s"
    assert steady_current(switched_on) is None
    assert steady_current(pandas.DataFrame({"current": [0.25, 0.25]})) == 0.25


def test_a_picture_is_whole_or_not_there(tmp_path, monkeypatch):
    """What was there stays, when the file is not moved to its place."""
    from matplotlib.figure import Figure

    path = tmp_path / "p.png"
    path.write_bytes(b"old")

    def killed(*given):
        raise KeyboardInterrupt

    monkeypatch.setattr("os.replace", killed)
    with pytest.raises(KeyboardInterrupt):
        save_picture(Figure(), path)
    assert path.read_bytes() == b"old" and [one.name for one in tmp_path.iterdir()] == ["p.png"]
    with pytest.raises(OutputError, match=r"allowed: .*\.png"):
        save_picture(Figure(), tmp_path / "p.nonsense")


def test_speeds_of_a_short_run_are_in_its_unit(tmp_path, monkeypatch):
    """Measured seconds lie at the same places as the run's."""
    from emclutch.results.pictures import speeds as speed_picture

    kept = []
    monkeypatch.setattr(speed_picture, "save_picture", lambda figure, path: kept.append(figure))
    time = np.linspace(0.0, 0.1, 5)
    history = {"time": time, "rotor_speed": 10.0 + time, "disc_speed": time}
    pictures.speed_picture(tmp_path / "s.png", {"run": history}, measured={"tacho": np.column_stack([time, time])})
    (axis,) = kept[0].axes
    assert axis.get_xlabel() == "time [ms]"
    assert [line.get_xdata()[-1] for line in axis.get_lines()[:3]] == pytest.approx([100.0, 100.0, 100.0])


def test_only_a_finished_run_that_wanted_pictures_owes_them(tmp_path):
    folder = written_run(tmp_path / "run")
    assert not folder.lacks_pictures()  # it wanted none
    folder.case.write_text("[output]\npictures = true\n")
    assert not folder.lacks_pictures()  # nothing to draw them of
    folder.checkpoint.write_bytes(b"")
    assert folder.lacks_pictures()
    folder.grains_picture.write_bytes(b"")
    assert not folder.lacks_pictures() and not draw_missing(folder)
    folder.grains_picture.unlink()
    folder.summary.unlink()
    assert not folder.lacks_pictures()  # it still runs
