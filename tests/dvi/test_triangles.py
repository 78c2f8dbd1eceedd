"""Rigid grains on triangles: a flat mesh is a plane, lists that reach far enough, impulses over edges, restarts."""

from contextlib import suppress

import numpy as np
import pytest
from dvi_scenes import DOWN, NONE, STEEL, R, floor

from geometry.time_profile import TimeProfile
from geometry.triangle_wall import TriangleWall, box_surface
from geometry.walls import annulus, cylinder
from particles import DVI, Body, DemError, DviContact, FreeShaft, Grains


def sheet(slope, body="housing"):
    """A plane through the origin, tilted about y, as a mesh of 20 mm squares, cut along alternate diagonals."""
    line = 0.02 * np.arange(-10, 11)
    x, y = np.meshgrid(line, line, indexing="ij")
    vertices = np.column_stack([x.ravel() * np.cos(slope), y.ravel(), x.ravel() * np.sin(slope)])
    triangles = []
    for i in range(20):
        for j in range(20):
            a, b, c, d = 21 * i + j, 21 * i + j + 21, 21 * i + j + 22, 21 * i + j + 1
            triangles += [[a, b, c], [a, c, d]] if (i + j) % 2 else [[a, b, d], [b, c, d]]
    return TriangleWall("floor", body, vertices, np.array(triangles))


def grains_on(slope, height):
    """One over a face, two over edges, one over a vertex; along an edge, along a diagonal, and across."""
    flat = np.array([[0.007, 0.004], [0.05, 0.02], [-0.05, -0.03], [-0.04, 0.04]])
    along, up = np.array([np.cos(slope), 0.0, np.sin(slope)]), np.array([-np.sin(slope), 0.0, np.cos(slope)])
    where = flat[:, :1] * along + flat[:, 1:] * np.array([0.0, 1.0, 0.0]) + (R + height) * up
    pace = np.array([[0.3, 0.1], [0.4, 0.0], [0.2, 0.2], [-0.1, 0.3]])
    velocity = pace[:, :1] * along + pace[:, 1:] * np.array([0.0, 1.0, 0.0])
    return Grains.create(where, R, STEEL, velocity=velocity)


@pytest.mark.parametrize(("slope", "height", "restitution", "theta"), [(0.0, 0.0, 0.0, 1.0), (0.3, 2e-3, 0.6, 0.5)])
def test_a_flat_mesh_is_a_plane(slope, height, restitution, theta):
    """Positions, velocities, spins, forces and the table of contacts, to 1e-9, while grains cross edges and corners."""
    made = []
    for wall in (floor(slope), sheet(slope)):
        dvi = DVI(grains_on(slope, height), [wall], [Body("housing")], DviContact(0.2, restitution), dt=1e-3,
                  gravity=DOWN, theta=theta)  # fmt: skip
        totals = dvi.run(250)
        made.append((dvi, totals))
    (smooth, a), (mesh, b) = made
    order = [np.argsort(dvi.grains.particle_id) for dvi in (smooth, mesh)]
    assert mesh.grains.position_radius[order[1]] == pytest.approx(smooth.grains.position_radius[order[0]], abs=1e-9)
    assert mesh.grains.velocity_force[order[1]] == pytest.approx(smooth.grains.velocity_force[order[0]], abs=1e-9)
    assert mesh.contact_force[order[1]] == pytest.approx(smooth.contact_force[order[0]], abs=1e-9)
    assert b.force["housing"] == pytest.approx(a.force["housing"], abs=1e-9)
    assert b.warm_hits == pytest.approx(a.warm_hits, abs=1e-12)  # no impulse is lost where the triangle changes
    if theta == 1.0:  # else positions are half a step beyond the contacts
        for name in ("overlap", "point", "force", "wall"):
            one, other = (getattr(dvi.contacts(), name)[np.argsort(dvi.contacts().i)] for dvi in (smooth, mesh))
            assert len(one) == 4
            assert other == pytest.approx(one, abs=1e-9)


def _vane(speed, grain, h, restitution=0.0, reach=0.12, skin=None, **more):
    """A radial vane 4 mm thick, its face at y = 2 mm, that turns with ``speed``; no gravity."""
    wall = box_surface("vane", "rotor", (0.5 * reach, 0.0, 0.0), (reach, 4e-3, 0.1))
    rotor = Body("rotor", TimeProfile.constant(speed))
    contact = DviContact(more.pop("friction", 0.0), restitution)
    return DVI(grain, [wall], [rotor], contact, dt=h, gravity=NONE, skin=skin, **more)


def test_a_fast_vane_is_found_beyond_the_skin_and_through_neighbours():
    """12.6 mm a step: a row of grains, none within the list's skin of the vane or of one another, is swept along."""
    speed, h, x = 105.0, 1e-3, 0.1
    gaps = np.array([40e-3, 2e-3, 2e-3, 2e-3])
    y = 2e-3 + np.cumsum(gaps) + R * np.arange(1, 8, 2)
    where = np.column_stack([np.full(4, x), y, np.zeros(4)])
    dvi = _vane(speed, Grains.create(where, R, STEEL), h, skin=1e-4, tolerance=1e-9)
    totals = dvi.run(6)
    assert totals.max_overlap < 0.05 and totals.missed_steps == 0
    assert np.linalg.norm(dvi.grains.velocity, axis=1).min() > 0.5 * speed * x


def test_a_squeezed_grain_is_a_miss_and_does_not_explode():
    """Between a driven vane and a fixed rib no velocity fits: the steps are missed, and what moves is slow.

    They meet the grain from 2 mm apart at 0.1 m/s, at 0.02 s; the gap that is left at the end is less than a radius.
    """
    grains = Grains.create([[0.1, 2e-3 + 1.2 * R, 0.0]], R, STEEL)
    vane = box_surface("vane", "rotor", (0.06, 0.0, 0.0), (0.12, 4e-3, 0.1))
    rib = box_surface("rib", "housing", (0.06, 4e-3 + 2.4 * R, 0.0), (0.12, 4e-3, 0.1))
    bodies = [Body("rotor", TimeProfile.constant(1.0)), Body("housing")]
    dvi = DVI(grains, [vane, rib], bodies, DviContact(0.3), dt=1e-4, gravity=NONE, max_sweeps=200)
    assert dvi.run(190).missed_steps == 0
    missed = 0
    with suppress(DemError):
        for _ in range(60):
            missed += dvi.run(1).missed_steps
            assert np.abs(dvi.grains.velocity).max() < 1.0
            assert np.abs(dvi.grains.position[0] - [0.1, 2e-3 + 1.2 * R, 0.0]).max() < 0.02
    assert missed > 10


def clutch(**more):
    """A vane and three ribs in a drum on a free shaft, 30 grains between."""
    ribs = [
        box_surface(f"rib{k}", "drum", 0.05 * np.array([np.cos(a), np.sin(a), 0.0]), (4e-3, 6e-3, 0.05), a)
        for k, a in enumerate((0.5, 2.6, 4.7))
    ]
    walls = [
        cylinder("shell", "drum", 0.05, -0.02, 0.02), annulus("low", "drum", -0.02, 0.0, 0.05),
        annulus("high", "drum", 0.02, 0.0, 0.05), *ribs,
        box_surface("vane", "rotor", (0.0, 0.0, 0.0), (0.06, 4e-3, 0.038)),
    ]  # fmt: skip
    rotor = more.pop("rotor", TimeProfile((0.0, 0.1), (0.0, 20.0)))
    bodies = [Body("rotor", rotor), Body("drum", FreeShaft(1e-4), speed=more.pop("drum_speed", 0.0))]
    rng = np.random.default_rng(4)
    a, b = np.meshgrid(np.arange(10) * 0.2 * np.pi + 0.3, (-0.013, 0.0, 0.013), indexing="ij")
    a, b = a.ravel(), b.ravel()
    where = np.column_stack([0.039 * np.cos(a), 0.039 * np.sin(a), b])
    grains = Grains.create(where, 4e-3, STEEL, velocity=rng.normal(0.0, more.pop("agitation", 0.2), (30, 3)))
    return DVI(grains, walls, bodies, DviContact(0.3, 0.5), dt=5e-4, gravity=more.pop("gravity", NONE),
               tolerance=1e-9, **more)  # fmt: skip


def test_restart_is_bitwise_and_bodies_turn_with_the_grains():
    whole, first, second = (clutch(gravity=(0.0, -9.81, 0.0), theta=0.5) for _ in range(3))
    whole.run(300)
    first.run(137)
    second.restore(first.state())
    second.run(163)
    for name, value in whole.state().items():
        assert np.array_equal(value, second.state()[name]), name
    # theta = 1/2 turns a prescribed body by the trapezoidal rule, all but the last half step's change of speed
    assert whole.bodies[0].angle == pytest.approx(0.5 * 200.0 * 0.1**2 + 20.0 * 0.05, abs=1e-12)
    assert whole.bodies[1].angle != 0.0
