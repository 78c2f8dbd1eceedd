"""Every kind of picture is drawn, without a display and from the emptiest data that a run can give, and shows them."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from made_up_study import contact_step, study
from matplotlib.tri import Triangulation
from PIL import Image

from emclutch.results import OutputError, pictures, steady_mean
from emclutch.results.pictures.accuracy import accuracy_picture
from emclutch.results.pictures.axial import axial_picture
from emclutch.results.pictures.figure import new_figure
from emclutch.results.pictures.speeds import speed_picture, torque_speed_picture
from emclutch.results.pictures.torque_curves import _torque_axes
from emclutch.results.recommended import recommended
from emclutch.results.torque_curves import torque_curves
from field.section.section_elements import SectionElements
from field.section.smooth_field import SmoothField
from geometry.centrifugal import CentrifugalClutch

NO_FORMULA = "$\\nonsense{ for 3 $"


def test_a_title_is_one_line_that_is_no_wider_than_its_figure():
    """In the letters of the panels; only a title that is too long for the figure has two lines."""
    for width, lines in ((9.0, 1), (3.0, 2)):
        figure, _ = new_figure(width, 4.0, "A small drum clutch,\nswitched on at 1 A")
        title = figure.get_suptitle()
        assert title.count("\n") == lines - 1 and title.replace("\n", " ") == "A small drum clutch, switched on at 1 A"
        assert figure._suptitle.get_window_extent().width < 0.98 * figure.bbox.width


@pytest.fixture
def to(tmp_path):
    """A folder that is to hold pictures in the end, none of them blank."""
    yield tmp_path
    drawn = sorted(tmp_path.glob("*.png"))
    assert drawn
    for path in drawn:
        with Image.open(path) as picture:
            low, high = picture.convert("L").getextrema()
        assert low < 128 < high, path.name


@pytest.mark.parametrize("strength", [0.0, 1.0])
def test_section(to, strength):
    """A square of triangles with a disc, powder and air, in a uniform field along the axis."""
    r, z = (a.ravel() for a in np.meshgrid(np.linspace(0.01, 0.05, 21), np.linspace(-0.02, 0.02, 21)))
    triangles = Triangulation(r, z).triangles.astype(np.int64)
    centre = r[triangles].mean(axis=1)
    parts = {"disc": centre < 0.03, "powder": (centre >= 0.03) & (centre < 0.034), "air": centre >= 0.034}
    regions = {name: np.flatnonzero(part) for name, part in parts.items()}
    points = np.column_stack([r, z])
    mesh = SimpleNamespace(points=points, triangles=triangles, regions=regions, boundaries={}, curved=None)
    elements = SectionElements(mesh)
    field = SmoothField(elements, strength * 0.5 * elements.dof_points[:, 0] ** 2)
    grains = np.column_stack([np.full(9, 0.032), np.linspace(-0.01, 0.01, 9), np.full(9, 5e-4)])
    pictures.section_picture(to / "a.png", field, grains=grains if strength else None, title=NO_FORMULA)


@pytest.mark.parametrize("count", [1, 300])
def test_torque(to, count):
    time = 1e-3 * np.arange(1, count + 1)
    torque = 1e-2 + 1e-3 * np.random.default_rng(0).standard_normal(count)
    history = {"time": time, "torque_disc": torque, "torque_rotor": -torque, "current": time, "rotor_speed": time}
    pictures.torque_picture(to / "a.png", history, steady_mean(time, torque), title=NO_FORMULA)
    pictures.torque_picture(to / "b.png", {"time": time, "torque_disc": 0.0 * time}, steady_mean(time, 0.0 * time))


@pytest.mark.parametrize("count", [0, 200])
def test_grains(to, count):
    rng = np.random.default_rng(0)
    theta, r = rng.uniform(0.0, math.pi / 18, count), rng.uniform(0.044, 0.045, count)
    position = np.column_stack([r * np.cos(theta), r * np.sin(theta), rng.uniform(-1e-3, 1e-3, count)])
    walls = [SimpleNamespace(name="bore", body="rotor", start=(0.0451, -0.01), end=(0.0451, 0.01))]
    chains = (position[:-1], position[1:], np.ones(max(0, count - 1))) if count else None
    grains = position, np.full(count, 1e-4), r
    axial_picture(to / "a.png", *grains, walls=CentrifugalClutch().walls(), chains=chains)
    pictures.grains_picture(to / "b.png", *grains, walls=walls, chains=chains, sector_angle=math.pi / 18)


def curve(x, torque, error, converged, **values):
    """A curve of a study's rows."""
    points = zip(x, torque, error, converged, strict=True)
    rows = [{"x": x, "torque": t, "standard_error": e, "converged": c, **values} for x, t, e, c in points]
    return torque_curves(rows, "x", list(values))[0]


def test_torque_against_current_and_speed(to):
    two = [curve([1.0, 0.0], [3.0, 0.1], [0.1, None], [True, False], speed="1 rpm"),
           curve([1], [2], [None], [False], speed="2 rpm")]  # fmt: skip
    pictures.torque_against_current_picture(to / "a.png", two)
    pictures.torque_against_speed_picture(to / "b.png", two[:1])


def test_an_unknown_error_is_no_bar():
    """A bar of length 0 would claim to be exact."""
    of = curve([0.0, 1.0, 2.0], [0.1, 3.0, 5.0], [None, 0.1, 0.2], [False, True, False])
    _, (axis,) = _torque_axes([of], None, joined=False)
    assert [list(bars.lines[0].get_xdata()) for bars in axis.containers] == [[1.0], [2.0]]


def test_cost_against_error(to):
    """With targets that are reached and not, and a setting that was not measured."""
    step = contact_step(0.05, 0.01)
    values = tuple(dataclasses.replace(one, cost=cost) for one, cost in zip(step.values, (0.5, 1.0, 2.0), strict=True))
    of = study("abc", dataclasses.replace(step, values=values), scatter=0.02, unknown={"sector": "about 3 min more"})
    targets = [(target, recommended(of, target)) for target in (0.05, 0.001)]
    accuracy_picture(to / "a.png", of, targets)


@pytest.mark.parametrize("count", [1, 50])
def test_speeds(to, count):
    time = np.linspace(0.0, 5.0, count)
    run = {"time": time, "rotor_speed": 20.0 * time, "disc_speed": 0.0 * time, "torque_disc": time**2}
    speed_picture(to / "a.png", {"200": run, "1000": run}, measured={"tacho": np.ones((count - 1, 2))})
    torque_speed_picture(to / "b.png", {"run": run})
    with pytest.raises(OutputError, match="no disc_speed"):
        speed_picture(to / "c.png", {"box": {"time": [0.0], "rotor_speed": [0.0]}})


def test_each_curve_of_a_saturation_picture_is_in_a_legend(tmp_path, monkeypatch):
    from emclutch.results.pictures import field

    drawn = []
    monkeypatch.setattr(field, "save_picture", lambda figure, path: drawn.append(figure))
    names = ("current", "flux_linkage", "gap_flux_density", "apparent_inductance", "incremental_inductance")
    field.saturation_picture(tmp_path / "s.png", {name: np.array([1.0, 2.0]) for name in names})
    left, right = (axis.get_legend().get_texts() for axis in drawn[0].axes[:2])
    assert len(left) == len(right) == 2 and left[1].get_text() == "|B| under the poles, right axis"


def test_names_of_neighbours_in_a_section_do_not_lie_on_each_other(tmp_path):
    """Of two narrow parts side by side one name stands beside the device, at the height of its part."""
    from types import SimpleNamespace

    from matplotlib.figure import Figure
    from matplotlib.text import Text

    from emclutch.results.pictures.section import _names_beside, _region_names

    z, r = np.meshgrid(np.linspace(0.0, 0.004, 5), (0.01, 0.02))
    points = np.column_stack((r.ravel(), z.ravel()))
    triangles = np.array([corners for k in range(4) for corners in ((k, k + 1, k + 5), (k + 1, k + 6, k + 5))])
    regions = {"first_part": np.arange(4), "other": np.arange(4, 8)}
    mesh = SimpleNamespace(points=points, triangles=triangles, regions=regions)
    axis = Figure(figsize=(4.0, 4.0)).subplots()
    axis.set(xlim=(-40.0, 40.0), ylim=(0.0, 30.0))
    beside = _region_names(axis, mesh, (0.01, 0.02, 0.0, 0.004))
    _names_beside(axis, beside)
    axis.figure.draw_without_rendering()
    assert [name for *_, name in beside] == ["other"]
    assert [one.get_text() for one in axis.texts] == ["first part", "other"]
    first, other = (Text.get_window_extent(one) for one in axis.texts)  # without the line to the part
    assert not first.overlaps(other) and abs(axis.texts[1].xyann[1] - 15.0) < 4.0
