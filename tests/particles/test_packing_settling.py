"""Grains come to rest: the bed carries its weight, shafts and clock stay, what never rests is reported."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from emclutch.simulation import initial_packing
from geometry.box import Box
from geometry.time_profile import TimeProfile
from geometry.walls import Plane
from particles import DEM, Body, Grains, LinearContact, ParticleError
from particles.packing.poured_packing import poured_packing
from particles.packing.settling import NotAtRestError, Settling, before_the_start, settle
from particles.packing.sizes import UniformSizes
from particles.packing.space import Space

pytestmark = pytest.mark.physics

G = 9.81
CONTACT = LinearContact.from_restitution(300.0, 0.5, 0.4)


def _bed():
    box = Box((8e-3, 8e-3, 20e-3))
    space = Space.of(box, box.walls())
    radius = 0.5 * UniformSizes(0.9e-3, 1.3e-3).draw(250, seed=1)
    packing = poured_packing(space, radius, up=(0.0, 0.0, 1.0), seed=1)
    grains = Grains.create(packing.position, packing.radius, 2500.0)
    return DEM(grains, box.walls(), [Body("housing")], CONTACT, dt=2e-5, gravity=(0.0, 0.0, -G))


def test_a_poured_bed_comes_to_rest_and_weighs_what_it_weighs():
    dem = _bed()
    top = dem.grains.position[:, 2].max()
    answer = settle(dem)
    assert answer.reached and answer.kinetic < 1e-6
    assert answer.time > math.sqrt(2.0 * 10e-3 / G)  # no sooner than the fall takes
    weight = float(dem.grains.mass.sum()) * G
    totals = dem.run(200)
    assert totals.force["housing"] == pytest.approx([0.0, 0.0, -weight], abs=1e-3 * weight)
    # K < 1e-6 sum(m g d): mean speed at most sqrt(2e-6 g d)
    speed = np.sqrt(np.sum(dem.grains.mass[:, None] * dem.grains.velocity**2) / dem.grains.mass.sum())
    assert speed < math.sqrt(2e-6 * G * 1.3e-3)
    assert dem.grains.position[:, 2].max() < 0.75 * top
    assert answer.contacts > 1.5 * dem.grains.count  # a frictional bed at rest needs about 2 a grain, rattlers apart


def test_grains_let_go_at_rest_are_not_at_rest():
    dem = _bed()
    assert dem.grains.kinetic_energy() == 0.0
    answer = settle(dem, longest=0.02)
    assert not answer.reached and answer.time == pytest.approx(0.02, rel=1e-3)
    with pytest.raises(NotAtRestError, match=r"after 0\.02 s the grains still move") as caught:
        settle(_bed(), longest=0.02, required=True)
    assert not caught.value.settling.reached


def test_without_gravity_a_pressed_pair_comes_to_rest_by_its_dashpot():
    """Two grains pressed between plates 2 % too near: the stored energy oscillates away through the dashpots."""
    r = 0.5e-3
    plates = [
        Plane("low", "housing", np.zeros(3), np.array([0.0, 0.0, 1.0])),
        Plane("high", "housing", np.array([0.0, 0.0, 3.92 * r]), np.array([0.0, 0.0, -1.0])),
    ]
    grains = Grains.create(np.array([[0.0, 0.0, r], [0.0, 0.0, 2.92 * r]]), r, 2500.0)
    dem = DEM(grains, plates, [Body("housing")], CONTACT, dt=1e-5)
    answer = settle(dem, kinetic=1e-9)
    assert answer.reached
    # three equal springs in a row share the 0.08 r evenly
    assert np.sort(dem.grains.position[:, 2]) == pytest.approx([r * (1 - 0.08 / 3), r * (2.92 + 0.08 / 3)], rel=1e-4)


@pytest.mark.parametrize("damping, rests", [(0.0, False), (20.0, True)])
def test_free_flight_ends_by_damping_only(damping, rests):
    grains = Grains.create(np.zeros((1, 3)), 0.5e-3, 2500.0, velocity=np.array([[1e-3, 0.0, 0.0]]))
    floor = Plane("low", "housing", np.array([0.0, 0.0, -1.0]), np.array([0.0, 0.0, 1.0]))
    dem = DEM(grains, [floor], [Body("housing")], CONTACT, dt=1e-5)
    answer = settle(dem, damping=damping, longest=1.0)
    assert answer.reached == rests
    if rests:  # exp(-2 damping t) = 1e-6, up to two looks of 200 steps
        assert answer.time == pytest.approx(math.log(1e6) / 40.0, abs=3 * 200 * 1e-5)


@pytest.mark.parametrize("damping, rests", [(0.0, False), (None, True)])
def test_a_rolling_grain_is_stopped_by_damping_only(damping, rests):
    """On a plane a rolling sphere has no slip, so that friction does no work and it rolls for ever."""
    r, u = 0.5e-3, 2e-3
    grains = Grains.create(
        np.array([[0.0, 0.0, r]]), r, 2500.0, velocity=[[u, 0.0, 0.0]], angular_velocity=[[0.0, u / r, 0.0]]
    )
    floor = Plane("low", "housing", np.zeros(3), np.array([0.0, 0.0, 1.0]))
    dem = DEM(grains, [floor], [Body("housing")], CONTACT, dt=1e-5, gravity=(0.0, 0.0, -G))
    answer = settle(dem, damping=damping, longest=0.5)
    assert answer.reached == rests
    if not rests:  # 7/10 m u^2 over m g d
        assert answer.kinetic == pytest.approx(0.7 * u**2 / (G * 2.0 * r), rel=0.01)


def test_shafts_and_clock_start_afresh():
    box = Box((8e-3, 8e-3, 20e-3))
    grains = Grains.create(np.array([[0.0, 0.0, 1e-3]]), 0.5e-3, 2500.0)
    shaft = Body("shaft", TimeProfile.constant(5.0))
    dem = DEM(grains, box.walls(), [Body("housing"), shaft], CONTACT, dt=2e-5, gravity=(0.0, 0.0, -G))
    with before_the_start(dem):
        assert settle(dem).reached
        assert shaft.angle == 0.0 and shaft.speed == 0.0
    assert dem.time == 0.0 and shaft.speed == 5.0 and shaft.angle == 0.0
    dem.run(100)
    assert shaft.angle == pytest.approx(5.0 * 100 * 2e-5)
    assert dem.grains.position[0, 2] == pytest.approx(0.5e-3, rel=1e-2)


@pytest.mark.parametrize("name, value", [("kinetic", 0.0), ("longest", -1.0), ("damping", -1.0)])
def test_numbers_out_of_range_are_refused(name, value):
    with pytest.raises(ValueError, match=name):
        settle(_bed(), **{name: value})


@pytest.mark.parametrize("missed", [0.05, 0.5])
def test_rigid_grains_whose_contacts_do_not_converge_are_not_settled(monkeypatch, missed):
    motion = SimpleNamespace(bodies=[], step_count=0)
    monkeypatch.setattr(initial_packing, "settle", lambda *_, **__: Settling(True, 1e-3, 0.0, 4, missed))
    scene = SimpleNamespace(
        grains=SimpleNamespace(settles=True, settle_kinetic=1e-6, settle_longest=None),
        contact=SimpleNamespace(dvi=SimpleNamespace(allowed_misses=0.1)),
    )
    if missed < 0.1:
        assert initial_packing.settled(scene, motion).missed == missed
    else:
        with pytest.raises(ParticleError, match=r"while the grains settled, 50 % of the steps missed the tolerance"):
            initial_packing.settled(scene, motion)
