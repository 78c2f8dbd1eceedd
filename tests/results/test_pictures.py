"""Every picture is drawn without a display, also from the emptiest data that a run can give."""

import math
import subprocess
import sys
from types import SimpleNamespace

import numpy as np
import pytest

from emclutch.results import pictures, steady_mean
from emclutch.results.linear_range import linear_range
from emclutch.results.pictures.grains import _across, _gaps
from emclutch.results.pictures.torque_curves import _draw_range, _torque_axes
from emclutch.results.text import format_torque
from emclutch.results.torque_curves import torque_curves
from emclutch.simulation.pictures import transient_in_words
from field.section.section_elements import SectionElements
from field.section.smooth_field import SmoothField
from geometry import AnnularBox


def is_picture(path):
    return path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


@pytest.fixture
def mesh():
    """A square of 2 x 20 x 20 triangles with a powder strip, a disc below and air above."""
    from matplotlib.tri import Triangulation

    r, z = (a.ravel() for a in np.meshgrid(np.linspace(0.01, 0.05, 21), np.linspace(-0.02, 0.02, 21)))
    triangles = Triangulation(r, z).triangles.astype(np.int64)
    centre = r[triangles].mean(axis=1)
    parts = {"disc": centre < 0.03, "powder": (centre >= 0.03) & (centre < 0.034), "air": centre >= 0.034}
    return SimpleNamespace(
        points=np.column_stack([r, z]),
        triangles=triangles,
        regions={name: np.flatnonzero(part) for name, part in parts.items()},
        boundaries={},
    )


def field_on(mesh, psi):
    """The field of psi(r, z) on quadratic elements."""
    elements = SectionElements(mesh)
    return SmoothField(elements, psi(*elements.dof_points.T))


@pytest.mark.parametrize("strength", [0.0, 1.0])
@pytest.mark.parametrize("with_grains", [False, True])
def test_section(tmp_path, mesh, strength, with_grains):
    grains = np.column_stack([np.full(9, 0.032), np.linspace(-0.01, 0.01, 9), np.full(9, 5e-4)])
    field = field_on(mesh, lambda r, z: strength * 0.5 * r**2)  # uniform along the axis
    path = pictures.section_picture(tmp_path / "s.png", field, grains=grains if with_grains else None)
    assert is_picture(path)


def test_a_title_is_no_formula(tmp_path, mesh):
    """A dollar sign in a title is one, however many there are."""
    history = {"time": np.linspace(0.0, 1.0, 9), "torque_disc": np.ones(9), "rotor_speed": np.ones(9)}
    title = "$\\nonsense{ for 3 $"
    assert is_picture(pictures.torque_picture(tmp_path / "t.png", history, title=title))
    field = field_on(mesh, lambda r, z: r)
    assert is_picture(pictures.section_picture(tmp_path / "s.png", field, title=title))


def test_the_enlarged_part_lies_in_what_is_filled(tmp_path, mesh, monkeypatch):
    """The field is strongest in a part of the powder's region without powder: it is not what is enlarged."""
    shown = []
    monkeypatch.setattr("emclutch.results.pictures.section._draw_zoom", lambda *given: shown.append(given[4]))
    field = field_on(mesh, lambda r, z: r**2 * (0.02 - z) ** 2)  # weakest at z = 20 mm, strongest at -20 mm
    filled = [AnnularBox(0.03, 0.034, 0.005, 0.02)]
    for boxes in ((), filled):
        pictures.section_picture(tmp_path / "s.png", field, filled=boxes)
    (_, _, _, whole), (low_r, high_r, low_z, high_z) = shown
    assert whole < 0.0 and 0.005 < 0.5 * (low_z + high_z) < 0.02 and 0.03 < 0.5 * (low_r + high_r) < 0.034


@pytest.mark.parametrize("count", [1, 5, 300])
def test_torque(tmp_path, count):
    time = 1e-3 * np.arange(1, count + 1)
    torque = 1e-2 + 1e-3 * np.random.default_rng(0).standard_normal(count)
    history = {
        "time": time,
        "torque_disc": torque,
        "torque_rotor": -torque,
        "current": time,
        "rotor_speed": time,
    }
    assert is_picture(pictures.torque_picture(tmp_path / "t.png", history, steady_mean(time, torque)))
    without = {"time": time, "torque_disc": np.zeros(count)}
    assert is_picture(pictures.torque_picture(tmp_path / "t0.png", without, steady_mean(time, np.zeros(count))))


def curve(x, torque, error, converged, **values):
    """A curve of a study's rows."""
    points = zip(x, torque, error, converged, strict=True)
    rows = [{"x": x, "torque": t, "standard_error": e, "converged": c, **values} for x, t, e, c in points]
    return torque_curves(rows, "x", list(values))[0]


def test_torque_against_current(tmp_path):
    two = [
        curve([1.0, 0.0], [3.0, 0.1], [0.1, None], [True, False], speed="1 rpm"),
        curve([1], [2], [None], [False], speed="2 rpm"),
    ]
    assert is_picture(pictures.torque_against_current_picture(tmp_path / "c.png", two))
    assert is_picture(pictures.torque_against_speed_picture(tmp_path / "d.png", two[:1]))


def test_a_linear_range_is_drawn_up_to_its_knee():
    x = np.linspace(0.0, 2.0, 11)
    of = curve(x, np.minimum(x, 1.25), np.full(11, 0.01), np.full(11, True))
    _, (axis,) = _torque_axes([of], None, joined=True)
    _draw_range(axis, of, linear_range(of.x, of.torque, of.error))
    line = axis.get_lines()[-1]
    assert line.get_label().startswith("1 ±") and "knee at 1.25" in line.get_label()
    assert line.get_xydata() == pytest.approx(np.array([[0.0, 0.0], [1.25, 1.25]]), abs=0.02)
    _draw_range(axis, of, linear_range(of.x, of.torque, np.full(11, np.nan)))  # of unknown range
    assert axis.get_lines()[-1] is line
    _draw_range(axis, of, linear_range(of.x, of.torque, of.error, np.arange(11) != 3))
    unsure = axis.get_lines()[-1]
    assert unsure.get_linestyle() == "--" and "1 of 7 points not converged" in unsure.get_label()


def test_an_unknown_error_is_no_bar():
    """It is drawn hollow, without a bar, and the legend says so; a bar of length 0 would claim to be exact."""
    _, (axis,) = _torque_axes(
        [curve([0.0, 1.0, 2.0], [0.1, 3.0, 5.0], [None, 0.1, 0.2], [False, True, False])], None, joined=False
    )
    assert [len(bars.lines[0].get_xdata()) for bars in axis.containers] == [1, 1]
    (unknown,) = [line for line in axis.get_lines() if line.get_label() == "error unknown"]
    assert list(unknown.get_xdata()) == [0.0] and unknown.get_markerfacecolor() == "white"
    _, (axis,) = _torque_axes([curve([1.0], [2.0], [None], [True])], None, joined=False)
    assert not axis.containers


def test_the_torques_picture_has_the_interval_and_no_standard_error(tmp_path, monkeypatch):
    labels = []
    monkeypatch.setattr("matplotlib.figure.Figure.legend", lambda self, handles, names, **_: labels.extend(names))
    time = np.arange(1.0, 101.0)
    history = {"time": time, "torque_disc": 0.5 + 0.1 * np.random.default_rng(1).standard_normal(100)}
    found = steady_mean(time, history["torque_disc"])
    pictures.torque_picture(tmp_path / "t.png", history, found)
    assert f"disc: {format_torque(found)}" in labels


def test_a_torque_of_unknown_error_says_so(tmp_path, monkeypatch):
    labels = []
    monkeypatch.setattr("matplotlib.figure.Figure.legend", lambda self, handles, names, **_: labels.extend(names))
    time = np.arange(1.0, 101.0)
    history = {"time": time, "torque_disc": np.full(100, 0.5)}
    pictures.torque_picture(tmp_path / "t.png", history, steady_mean(time, history["torque_disc"]))
    assert "disc: 0.5 N m, error unknown, not converged" in labels


def test_a_transient_is_not_judged_as_a_steady_torque(tmp_path, monkeypatch):
    labels = []
    monkeypatch.setattr("matplotlib.figure.Figure.legend", lambda self, handles, names, **_: labels.extend(names))
    monkeypatch.setattr("matplotlib.axes.Axes.set_title", lambda self, text, **_: labels.append(text))
    time = np.arange(1.0, 101.0)
    history = {"time": time, "torque_disc": 1e-2 * time}
    drifting = steady_mean(time, history["torque_disc"])
    pictures.torque_picture(tmp_path / "steady.png", history, drifting)
    assert not drifting.converged and drifting.reason in labels and "averaged part" in labels
    labels.clear()
    pictures.torque_picture(tmp_path / "switched.png", history | {"current": time}, drifting)
    assert "current" in labels and drifting.reason not in labels and "averaged part" not in labels


@pytest.mark.parametrize("count", [0, 1, 200])
def test_grains(tmp_path, count):
    rng = np.random.default_rng(0)
    theta, r = rng.uniform(0.0, math.pi / 18, count), rng.uniform(0.044, 0.045, count)
    position = np.column_stack([r * np.cos(theta), r * np.sin(theta), rng.uniform(-1e-3, 1e-3, count)])
    walls = [SimpleNamespace(name="bore", body="rotor", start=(0.0451, -0.01), end=(0.0451, 0.01))]
    chains = (position[:-1], position[1:], np.ones(max(0, count - 1))) if count else None
    path = pictures.grains_picture(
        tmp_path / "g.png",
        position,
        np.full(count, 1e-4),
        r,
        walls=walls,
        chains=chains,
        sector_angle=math.pi / 18,
    )
    assert is_picture(path)


@pytest.mark.parametrize(("across", "expected"), [("cylinders", "r"), ("faces", "z")])
def test_the_gap_is_where_disc_and_rotor_enclose_the_grains(across, expected):
    # A cell as wide as high, whose grains spread less along the other coordinate.
    rng = np.random.default_rng(0)
    r, z = rng.uniform(0.0202, 0.0218, 50), rng.uniform(-8e-4, 8e-4, 50)
    if across == "cylinders":
        ends = {"disc": ((0.02, -1e-3), (0.02, 1e-3)), "rotor": ((0.022, -1e-3), (0.022, 1e-3))}
        z *= 0.5
    else:
        ends = {"disc": ((0.02, -1e-3), (0.022, -1e-3)), "rotor": ((0.02, 1e-3), (0.022, 1e-3))}
        r = 0.021 + 0.5 * (r - 0.021)
    walls = [SimpleNamespace(body=body, start=start, end=end) for body, (start, end) in ends.items()]
    assert _across(_gaps(r, z, walls), r, z) == expected


def test_grains_around_the_whole_turn_are_cut_to_a_readable_strip(tmp_path):
    theta = np.linspace(0.0, 2.0 * math.pi, 500, endpoint=False)
    position = np.column_stack([0.05 * np.cos(theta), 0.05 * np.sin(theta), np.zeros(500)])
    title = "a long title that has to be wrapped because it does not fit on one line " * 3
    path = pictures.grains_picture(tmp_path / "g.png", position, np.full(500, 1e-4), theta, title=title)
    assert is_picture(path)


@pytest.mark.parametrize(
    ("speeds", "limits", "extend"),
    [
        ([0.0] * 995 + [1.0, 2.0, 3.0, 4.0, 5.0], (0.0, 5.0), "neither"),  # nearly all rest: those that move are seen
        ([2.0] * 1000, (1.5, 2.5), "neither"),
        ([*np.linspace(0.0, 1.0, 981), *[9.0] * 19], None, "max"),
    ],
)
def test_colours_of_grains_end_with_an_arrow_only_where_values_exceed_them(
    tmp_path, monkeypatch, speeds, limits, extend
):
    from matplotlib.figure import Figure

    drawn, colorbar = [], Figure.colorbar
    monkeypatch.setattr(
        Figure, "colorbar", lambda self, shown, **given: drawn.append(given | {"limits": shown.get_clim()})
        or colorbar(self, shown, **given)
    )  # fmt: skip
    position = np.random.default_rng(4).uniform(1e-2, 2e-2, (1000, 3))
    pictures.grains_picture(tmp_path / "g.png", position, np.full(1000, 1e-4), np.array(speeds))
    (bar,) = drawn
    assert bar["extend"] == extend and bar["limits"] == (limits or (0.0, np.percentile(speeds, 98)))


def test_results_import_without_heavy_packages():
    heavy = "{'matplotlib', 'pandas', 'vtkmodules', 'pyvista', 'rich', 'h5py'}"
    code = f"import sys, emclutch.results, emclutch.results.pictures; print({heavy} & set(sys.modules))"
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True).stdout
    assert found.strip() == "set()"


def test_the_headline_of_a_transient_has_the_rise_of_what_is_delayed_only():
    summary = {"current_rise_time": 2e-3, "gap_flux_density_rise_time": 3e-3, "lock_up_time": 4e-3}
    given = SimpleNamespace(circuit=None, eddy=None)
    assert transient_in_words(given, summary) == "locked at t = 4 ms"
    driven = SimpleNamespace(circuit=object(), eddy=None)
    assert transient_in_words(driven, summary) == "locked at t = 4 ms; current 63 % after 2 ms; field 63 % after 3 ms"
