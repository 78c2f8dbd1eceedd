"""profiles.csv and profiles.png: what is written is what was found, also where bins are empty."""

import math
from types import SimpleNamespace

import numpy as np
import pytest
import pyvista

from emclutch.results import OutputError
from emclutch.results.checkpoint import read_checkpoint, write_checkpoint
from emclutch.results.grain_profiles import profile_column, profile_table, read_profiles, write_profiles
from emclutch.results.pictures.profile import profile_picture
from emclutch.results.pictures.wall_pressure import wall_pressure_picture
from emclutch.results.vtk.wall_surface import write_wall_pressure_surfaces
from emclutch.results.wall_loads import WALL_COLUMNS, read_wall_pressure, write_wall_pressure
from emclutch.simulation.profile_average import ProfileAverage, gap_of
from emclutch.simulation.wall_average import WallAverage
from geometry.walls import AnnularBox, annulus, cylinder
from particles.diagnostics.bins import SlabBins, ring_bins
from particles.diagnostics.enclosed_space import BoxSpace
from particles.diagnostics.profiles import profile_of, profile_sums
from particles.grains import Grains
from particles.neighbours.contact_table import ContactTable

RING = AnnularBox(0.010, 0.014, 0.0, 0.002)


def moment(seed=0):
    """Grains in the inner half of a ring that turn with 1/r^2, and a spoke of two that press."""
    rng = np.random.default_rng(seed)
    r, phi = rng.uniform(0.0105, 0.012, 200), rng.uniform(0.0, 2 * math.pi, 200)
    x = np.column_stack([r * np.cos(phi), r * np.sin(phi), rng.uniform(0.0005, 0.0015, 200)])
    x[:2] = [[0.0108, 0.0, 0.001], [0.0116, 0.0, 0.001]]
    r = np.hypot(x[:, 0], x[:, 1])
    v = 1e-3 / r[:, None] ** 2 * np.column_stack([-x[:, 1], x[:, 0], 0 * r])
    contacts = ContactTable(
        np.array([0]), np.array([1]), np.array([-1]), np.array([0]), np.array([[0.0112, 0.0, 0.001]]),
        np.array([[-0.5, 0.1, 0.0]]), np.array([0.0]),
    )  # fmt: skip
    return Grains.create(x, 0.4e-3, 7800.0, velocity=v), contacts


def profiles(speeds=None):
    grains, contacts = moment()
    found = [ring_bins(RING, 0.8e-3, along=along) for along in ("r", "z")]
    return [profile_of(profile_sums(grains, contacts, bins), bins, speeds) for bins in found]


def test_profiles_are_read_back_to_the_last_bit(tmp_path):
    written = profiles({"rotor": 10.0, "disc": 0.0})
    assert np.isnan(written[0].velocity).any()  # the outer half is empty
    found = read_profiles(write_profiles(tmp_path, written))
    assert list(found) == ["r", "z"]
    for profile in written:
        table = found[profile.along]
        expected = profile_table(profile)
        assert list(table.columns) == list(expected)
        for name, values in expected.items():
            np.testing.assert_array_equal(table[name], values)
        assert table.attrs["units"]["slip_rotor"] == "m/s" and table.attrs["units"]["torque"] == "N m"
        assert table.attrs["moments"] == 1
    assert "rotor" in profile_column("slip_rotor")[1]


def test_a_box_has_no_angular_speed(tmp_path):
    grains, contacts = moment()
    bins = SlabBins(2, 0, np.array([0.0, 1e-3, 2e-3]), 1e-3)
    box = profile_of(profile_sums(grains, contacts, bins), bins, {"housing": 0.0})
    assert "angular_speed" not in profile_table(box) and not any(name.startswith("slip") for name in profile_table(box))
    assert list(read_profiles(write_profiles(tmp_path, [box]))) == ["z"]
    assert profile_picture(tmp_path / "box.png", [box]).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_nothing_to_write_says_what_to_do(tmp_path):
    with pytest.raises(OutputError, match=r"output\.profiles"):
        write_profiles(tmp_path, [])
    one = profiles()[0]
    grains, contacts = moment()
    bins = ring_bins(RING, 1e-3)
    sums = profile_sums(grains, contacts, bins)
    with pytest.raises(OutputError, match="same moments"):
        write_profiles(tmp_path, [one, profile_of(sums + sums, bins)])


@pytest.mark.parametrize("speeds", [None, {"rotor": 10.0, "shell": 0.0}])
def test_picture(tmp_path, speeds):
    path = profile_picture(tmp_path / "profiles.png", profiles(speeds), title="a ring")
    assert path.read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_average_begins_at_its_time_and_takes_the_mean_of_the_moments():
    """Two windows after the start: twice the sums over two moments; the shafts' speeds are their mean, 10 and 20."""
    grains, contacts = moment()
    rotor = SimpleNamespace(name="rotor", speed=0.0)
    dem = SimpleNamespace(time=0.0, grains=grains, sector=None, bodies=[rotor], walls=[], contacts=lambda: contacts)
    shape = SimpleNamespace(boxes_to_fill=lambda: [AnnularBox(0.1, 0.2, 0.0, 1.0), RING])
    average = ProfileAverage(shape, 1.0)
    for dem.time, rotor.speed in ((0.5, 1e3), (1.0, 1e3), (1.5, 10.0), (2.0, 20.0)):
        assert average.profiles() == [] or dem.time > 1.5
        average(SimpleNamespace(motion=dem), {})
    radial, axial = average.profiles()
    assert (radial.along, axial.along, radial.moments) == ("r", "z", 2)
    once = profile_of(profile_sums(grains, contacts, ring_bins(RING, 0.8e-3)), ring_bins(RING, 0.8e-3), {"rotor": 15.0})
    np.testing.assert_allclose(radial.slip["rotor"], once.slip["rotor"])
    np.testing.assert_allclose(radial.torque, once.torque)
    assert radial.torque[1] == pytest.approx(0.0112 * 0.1)  # the spoke: 0.1 N at 11.2 mm


def test_an_average_goes_on_from_a_checkpoint_as_if_nothing_had_been(tmp_path):
    grains, contacts = moment()
    rotor = SimpleNamespace(name="rotor", speed=10.0)
    dem = SimpleNamespace(time=1.0, grains=grains, sector=None, bodies=[rotor], walls=[], contacts=lambda: contacts)
    for shape in (
        SimpleNamespace(boxes_to_fill=lambda: [RING]),
        SimpleNamespace(boxes_to_fill=list),
    ):  # in a ring, in a box
        whole, part, again, other = (ProfileAverage(shape, start) for start in (0.0, 0.0, 0.0, 0.5))
        for average in (whole, whole, part):
            average(SimpleNamespace(motion=dem), {})
        write_checkpoint(tmp_path / "checkpoint.h5", part.state())
        again.restore(read_checkpoint(tmp_path / "checkpoint.h5"), dem)
        again(SimpleNamespace(motion=dem), {})
        for first, second in zip(whole.profiles(), again.profiles(), strict=True):
            assert first.moments == second.moments == 2
            for name in ("volume", "torque", "temperature", "shear_rate"):
                np.testing.assert_array_equal(getattr(first, name), getattr(second, name))
        other.restore(read_checkpoint(tmp_path / "checkpoint.h5"), dem)  # of another time: averaging restarts
        assert other.profiles() == []


def test_load_of_the_walls_in_its_files(tmp_path):
    """A grain that presses a cylinder with 2 N: in one row of the table, and as pressure times area of the surfaces.

    The picture is drawn; an average goes on from its state.
    """
    grains, _ = moment()
    walls = [cylinder("bore", "rotor", 0.012, 0.0, 0.002), annulus("lid", "rotor", 0.0, 0.010, 0.012)]
    at = ContactTable(
        np.array([0]), np.array([-1]), np.array([0]), np.array([0]), np.array([[0.012, 0.0, 0.001]]),
        np.array([[-2.0, 0.5, 0.0]]), np.array([0.0]),
    )  # fmt: skip
    motion = SimpleNamespace(grains=grains, walls=walls, sector=None)
    average, again = WallAverage(), WallAverage()
    for _ in range(2):
        average.add(motion, at)
    again.restore(average.state(), motion)
    load = again.pressure()
    assert load.moments == 2 and again.summary() == average.summary()
    of_bore = again.summary()["walls"]["bore"]
    assert of_bore["normal_force"] == pytest.approx(2.0, rel=1e-3) and of_bore["torque"] == pytest.approx(-0.012 * 0.5)
    assert "lid" not in again.summary()["walls"]
    table = read_wall_pressure(write_wall_pressure(tmp_path, load, walls))
    (row,) = table[table["contacts"] > 0].to_dict("records")
    assert row["wall"] == "bore" and row["along"] == "z" and row["low"] <= 0.001 <= row["high"]
    assert row["pressure"] * row["area"] == pytest.approx(row["normal_force"]) == pytest.approx(of_bore["normal_force"])
    assert table.attrs["units"]["pressure"] == "Pa" and set(table) == set(WALL_COLUMNS)
    surfaces = pyvista.read(write_wall_pressure_surfaces(tmp_path, load, walls, None, 0.1)).compute_cell_sizes()
    total = surfaces["pressure"] @ surfaces["Area"]  # right but for the facets of the ring
    assert total == pytest.approx(of_bore["normal_force"], rel=1e-3)
    assert wall_pressure_picture(tmp_path / "load.png", load, walls).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"


def test_gap_is_the_space_that_holds_most_grains_or_what_walls_enclose():
    grains, _ = moment()
    dem = SimpleNamespace(grains=grains, sector=None, walls=[])
    assert gap_of(SimpleNamespace(boxes_to_fill=lambda: [AnnularBox(1.0, 2.0, 0.0, 1.0), RING]), dem) == RING
    assert isinstance(gap_of(SimpleNamespace(boxes_to_fill=list), dem), BoxSpace)
