"""Every kind of picture is drawn, without a display and from the emptiest data that a run can give, and shows them."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from made_up_ladder import contact_step, ladder
from matplotlib.collections import PolyCollection
from matplotlib.tri import Triangulation
from PIL import Image

from emclutch.results import pictures, steady_mean
from emclutch.results.linear_range import linear_range
from emclutch.results.pictures import accuracy
from emclutch.results.pictures.axial import axial_picture
from emclutch.results.pictures.torque_curves import _draw_range, _torque_axes
from emclutch.results.recommended import own_choice, recommended
from emclutch.results.torque_curves import torque_curves
from field.section.section_elements import SectionElements
from field.section.smooth_field import SmoothField
from geometry.centrifugal import CentrifugalClutch
from geometry.triangle_wall import TriangleWall

NO_FORMULA = "$\\nonsense{ for 3 $"


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
    mesh = SimpleNamespace(points=np.column_stack([r, z]), triangles=triangles, regions=regions, boundaries={})
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


def test_a_linear_range_is_drawn_up_to_its_knee():
    x = np.linspace(0.0, 2.0, 11)
    of = curve(x, np.minimum(x, 1.25), np.full(11, 0.01), np.full(11, True))
    _, (axis,) = _torque_axes([of], None, joined=True)
    _draw_range(axis, of, linear_range(of.x, of.torque, of.error))
    assert axis.get_lines()[-1].get_xydata() == pytest.approx(np.array([[0.0, 0.0], [1.25, 1.25]]), abs=0.02)


def test_an_unknown_error_is_no_bar():
    """A bar of length 0 would claim to be exact."""
    of = curve([0.0, 1.0, 2.0], [0.1, 3.0, 5.0], [None, 0.1, 0.2], [False, True, False])
    _, (axis,) = _torque_axes([of], None, joined=False)
    assert [list(bars.lines[0].get_xdata()) for bars in axis.containers] == [[1.0], [2.0]]


def test_a_turned_body_is_drawn_where_a_wall_turned_by_hand_is(to, monkeypatch):
    drawn, original = [], PolyCollection.__init__

    def remember(self, polygons, *arguments, **options):
        drawn.append(np.array(polygons))
        original(self, polygons, *arguments, **options)

    monkeypatch.setattr(PolyCollection, "__init__", remember)
    vane = next(one for one in CentrifugalClutch().walls() if isinstance(one, TriangleWall) and one.body == "rotor")
    nothing, angle = (np.zeros((0, 3)), np.zeros(0), np.zeros(0)), math.radians(17.0)
    axial_picture(to / "a.png", *nothing, walls=[vane], angles={"rotor": angle, "disc": 1.0})
    axial_picture(to / "b.png", *nothing, walls=[vane.turned(angle)])
    assert drawn[0] == pytest.approx(drawn[1], abs=1e-9)


def test_cost_against_error_has_the_scene_where_its_settings_are(to, monkeypatch):
    drawn, save = [], accuracy.save_picture
    monkeypatch.setattr(accuracy, "save_picture", lambda figure, path: drawn.append(figure) or save(figure, path))
    step = contact_step(0.05, 0.01)
    rungs = tuple(dataclasses.replace(rung, cost=cost) for rung, cost in zip(step.rungs, (0.5, 1.0, 2.0), strict=True))
    of = ladder("abc", dataclasses.replace(step, rungs=rungs), scatter=0.02, unknown={"sector": "about 3 min more"})
    accuracy.accuracy_picture(to / "a.png", of, [(0.05, recommended(of, 0.05)), (0.001, recommended(of, 0.001))])
    own = own_choice(of, accuracy.PACKINGS)
    star = next(line for line in drawn[0].axes[0].lines if line.get_gid() == "this scene")
    assert star.get_xydata()[0] == pytest.approx([own.seconds, 100.0 * own.half_width])
