"""Load of the walls: bins share out the whole force, areas are those of the walls, a bed presses with its weight."""

import math

import numpy as np
import pytest
from dem_laws import DENSITY, FLOOR, MASS, RADIUS, G, law, make_dem
from loaded_grains import RING, clamped_ring

from emclutch.simulation.wall_average import WallAverage
from geometry.triangle_wall import TriangleWall
from geometry.walls import AnnularBox, Plane, annulus, cone, cylinder
from particles import Body
from particles.diagnostics.enclosed_space import BoxSpace, enclosed_space
from particles.diagnostics.wall_pressure import wall_bins, wall_pressure, wall_sums
from particles.grains import Grains

CYLINDERS = [
    cylinder(name, body, radius, RING.z0, RING.z1)
    for name, body, radius in (("inner", "disc", RING.r0), ("outer", "rotor", RING.r1))
]


def load_of(grains, contacts, walls, space, width=0.5e-3, cuts=(), moments=1):
    bins = wall_bins(walls, space, width, cuts)
    sums = wall_sums(grains, contacts, bins)
    for _ in range(moments - 1):
        sums = sums + wall_sums(grains, contacts, bins)
    return wall_pressure(sums, bins)


def test_bins_share_out_the_whole_load_of_a_wall():
    """Radial force and torque on each cylinder are the sums over its contacts; the torques of both are opposite."""
    grains, contacts = clamped_ring()
    load = load_of(grains, contacts, CYLINDERS, RING, moments=3)
    assert load.moments == 3 and len(load.bins.wall) == 8
    for number, outward in ((0, -1.0), (1, 1.0)):
        at, own = contacts.wall == number, load.bins.wall == number
        x, f = contacts.point[at], -contacts.force[at]
        e = x * [1.0, 1.0, 0.0] / np.hypot(x[:, 0], x[:, 1])[:, None]
        assert load.normal_force[own].sum() == pytest.approx(outward * np.sum(f * e), rel=1e-9)
        assert load.torque[own].sum() == pytest.approx(np.sum(np.cross(x, f)[:, 2]), rel=1e-12)
        assert load.contacts[own].sum() == at.sum()
        radius = (RING.r0, RING.r1)[number]
        assert load.flow_force[own].sum() * radius == pytest.approx(load.torque[own].sum(), rel=1e-9)
        of_wall = load.over(own)
        assert of_wall["pressure"] * of_wall["area"] == pytest.approx(load.normal_force[own].sum())
        assert of_wall["mu"] is None or of_wall["mu"] == pytest.approx(
            abs(of_wall["shear_stress"]) / of_wall["pressure"]
        )
    assert load.torque.sum() == pytest.approx(0.0, abs=1e-9 * np.abs(load.torque).max())


def test_areas_are_those_of_the_walls_and_poles_are_edges():
    """Of cylinders, rings and cones by Pappus; a pole's limits stand among the edges; planes are sides of the space."""
    lid, slope = annulus("lid", "rotor", RING.z1, RING.r0, RING.r1), cone("cone", "disc", (3e-3, 0.0), (5e-3, 1e-3))
    walls = [*CYLINDERS, lid, slope]
    pole = AnnularBox(RING.r0, RING.r1, 0.3e-3, 1.1e-3)
    bins = wall_bins(walls, RING, 0.25e-3, (pole,))
    for number, wall in enumerate(walls):
        assert bins.area[bins.wall == number].sum() == pytest.approx(wall.area, rel=1e-12)
    assert [int(k) for k in bins.coordinate] == [1, 1, 0, 0]
    for edge in (0.3e-3, 1.1e-3):
        assert np.isclose(bins.low[bins.wall == 0], edge, rtol=1e-12).any()
    plane = Plane("floor", "housing", np.zeros(3), np.array([0.0, 0.0, 1.0]))
    slope = Plane("slope", "housing", np.zeros(3), np.array([0.0, 1.0, 1.0]))
    tile = TriangleWall("tile", "housing", np.array([[0, 0, 0], [2, 0, 0], [0, 3, 0]]) * 1e-3, np.array([[0, 1, 2]]))
    space = BoxSpace(np.zeros(3), np.array([2e-3, 3e-3, 5e-3]))
    bins = wall_bins([plane, slope, tile], space, 1e-3)
    assert bins.area[[0, 2]] == pytest.approx([6e-6, 3e-6]) and math.isnan(bins.area[1])
    ring = wall_bins([*CYLINDERS, plane], RING, 1e-3)
    assert ring.area[-1] == pytest.approx(math.pi * (RING.r1**2 - RING.r0**2))


def bed(friction):
    """64 grains in a box six radii wide, let fall from a loose lattice; its walls, the lid far above."""
    k = np.array([-1.5, 1.5, -1.5, 1.5]) * RADIUS
    layer = list(zip(k, k[[0, 1, 3, 2]], strict=True))
    x = np.array([[a, b, z * RADIUS] for z in 1.1 + 2.2 * np.arange(16) for a, b in layer])
    x += np.random.default_rng(1).uniform(-0.1, 0.1, x.shape) * RADIUS
    sides = [np.array(n) for n in ((1.0, 0, 0), (-1.0, 0, 0), (0, 1.0, 0), (0, -1.0, 0))]
    walls = [FLOOR, *(Plane(f"side {k}", "shaft", -3.0 * RADIUS * n, n) for k, n in enumerate(sides))]
    grains, contact = Grains.create(x, RADIUS, DENSITY), law("linear", 0.3, friction, speed=0.3)
    bodies = [Body("housing"), Body("shaft")]
    return make_dem(grains, walls, bodies, contact, speed=0.3, steps=15.0, gravity=(0.0, 0.0, -G))


def load_on(dem):
    space = enclosed_space(dem.grains, dem.walls)
    return load_of(dem.grains, dem.contacts(), dem.walls, space)


@pytest.mark.physics
def test_pressure_on_a_floor_times_its_area_is_the_weight_of_the_bed():
    """At rest between walls without friction, which bear nothing of it."""
    dem = bed(0.0)
    weight = 64 * MASS * G
    while True:
        dem.run(2000)
        dem.grains.velocity[:] *= 0.5
        if np.abs(dem.grains.velocity).max() < 1e-5:
            break
    load = load_on(dem)
    floor = load.over(load.bins.wall == 0)
    assert floor["area"] == pytest.approx(36.0 * RADIUS**2)
    assert floor["pressure"] * floor["area"] == pytest.approx(weight, rel=1e-3)
    assert floor["shear_stress"] == 0.0 and floor["mu"] == 0.0 and "torque" not in floor
    assert (load.pressure[1:] > 0.0).all()  # sides of equal and opposite load
    assert load.normal_force[1] == pytest.approx(load.normal_force[2], rel=1e-2)


@pytest.mark.physics
def test_loads_of_the_walls_change_the_momentum_of_a_falling_bed():
    """m dv/dt of all grains along x and z in the next step: floor, friction of sides, weight, to round-off."""
    dem = bed(0.4)
    dem.run(3000)
    for _ in range(3):
        dem.run(200)
        load, contacts = load_on(dem), dem.contacts()
        before = dem.grains.mass @ dem.grains.velocity
        dem.run(1)
        rate = (dem.grains.mass @ dem.grains.velocity - before) / dem.dt
        at_sides = contacts.force[contacts.wall > 0]
        assert rate[2] == pytest.approx(load.normal_force[0] + at_sides[:, 2].sum() - 64 * MASS * G, abs=1e-9)
        # x: normal forces of both sides across, friction of the floor; that of the other two sides along x as well
        along = load.normal_force[1] - load.normal_force[2] - load.flow_force[[0, 3, 4]].sum()
        assert rate[0] == pytest.approx(along, abs=1e-9 * max(1.0, np.abs(load.normal_force).max()))
        assert load.normal_force[0] > 10.0 * MASS * G
    average, again = WallAverage(), WallAverage()
    average.add(dem, dem.contacts())
    dem.run(500)  # the uppermost grain, up to which the sides are counted, goes on falling
    again.restore(average.state(), dem)
    assert np.array_equal(again.pressure().pressure, average.pressure().pressure)
