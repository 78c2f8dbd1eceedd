"""Unequal spheres, free fall, and a sphere that rolls over a convex edge; closed forms: test_impact_and_sliding."""

import numpy as np
import pytest
from dem_laws import FLOOR, G

from geometry.walls import outline
from particles import DEM, Body, Grains, LinearContact, choose_time_step

pytestmark = pytest.mark.physics


def _sphere(position, radius, density, **state):
    return Grains.create([position], radius, density, **{name: [value] for name, value in state.items()})


@pytest.mark.parametrize("e", [0.9, 0.5])
def test_restitution_of_two_unequal_grains(e):
    law = LinearContact.from_restitution(1e4, e, 0.3)
    grains = Grains.create([[0, 0, 0], [3.01e-3, 0, 0]], [1e-3, 2e-3], 2500.0, velocity=[[0.3, 0, 0], [-0.2, 0, 0]])
    dem = DEM(grains, [], [], law, dt=choose_time_step(law, grains.mass, grains.radius, steps_per_contact=1000).dt)
    dem.run(5000)
    order = np.argsort(dem.grains.particle_id)
    v = dem.grains.velocity[order, 0]
    assert (v[1] - v[0]) / 0.5 == pytest.approx(e, rel=3e-3)


def test_free_fall_is_an_exact_parabola():
    """With v given half a step back the leapfrog is exact for a constant force."""
    dt, n = 1e-4, 1000
    grains = _sphere([0.0, 0.0, 1.0], 1e-3, 2500.0, velocity=[0.2, 0.0, 1.0 + 0.5 * G * dt])
    law = LinearContact.from_restitution(100.0, 0.5, 0.3)
    dem = DEM(grains, [FLOOR], [Body("housing")], law, dt=dt, gravity=(0.0, 0.0, -G))
    dem.run(n)
    t = n * dt
    assert dem.grains.position[0] == pytest.approx([0.2 * t, 0.0, 1.0 + t - 0.5 * G * t**2], rel=1e-12)


def test_rolling_over_a_convex_edge_keeps_one_contact_and_a_continuous_force():
    """A sphere rolls outward on a disc's face, over its edge, down its rim: one contact, handed on."""
    walls = outline("disc", "disc", [(0.0, 0.01), (0.03, 0.01), (0.03, -0.01), (0.0, -0.01)])
    law, r = LinearContact.from_restitution(1e5, 0.3, 5.0), 5e-3
    grains = _sphere([0.0295, 0.0, 0.01 + r], r, 2500.0, velocity=[0.05, 0.0, 0.0], angular_velocity=[0.0, 10.0, 0.0])
    weight = grains.mass[0] * G
    grains.position[0, 2] -= weight / law.stiffness_n
    dt = choose_time_step(law, grains.mass, grains.radius).dt
    dem = DEM(grains, walls, [Body("disc")], law, dt=dt, gravity=(0.0, 0.0, -G))
    dem.run(100)
    before, over = dem.contact_force[0], 0.0
    while dem.contacts().i.size and dem.time < 1.0:
        count = dem.run(1).n_contacts
        assert count <= 1
        if count:
            assert np.linalg.norm(dem.contact_force[0] - before) < 0.05 * weight
            before = dem.contact_force[0]
        over = max(over, np.arctan2(dem.grains.position[0, 0] - 0.03, dem.grains.position[0, 2] - 0.01))
    # a sphere on a sharp edge leaves it at cos(angle) = 10/17 from rest; here it starts a little faster
    assert 0.6 < over < np.arccos(10.0 / 17.0) + 0.02


def test_force_is_the_same_all_round_an_edge():
    """Pressed in by the same depth from the face, round the edge, to the rim: always one wall, one depth."""
    from particles.walls.wall_kernels import near_walls, wall_overlaps
    from particles.walls.wall_table import wall_rows

    rows = wall_rows(outline("disc", "disc", [(0.0, 0.01), (0.03, 0.01), (0.03, -0.01), (0.0, -0.01)]))
    r, depth = 5e-3, 1e-4
    turn = np.linspace(0.0, 0.5 * np.pi, 181)
    arc = np.stack([0.03 + (r - depth) * np.sin(turn), np.zeros(181), 0.01 + (r - depth) * np.cos(turn)], axis=1)
    face = arc[0] - np.linspace(5e-3, 0.0, 50)[:, None] * [1.0, 0.0, 0.0]
    rim = arc[-1] - np.linspace(0.0, 5e-3, 50)[:, None] * [0.0, 0.0, 1.0]
    centres = np.concatenate([face, arc, rim])
    radius, start, other = (
        np.full(len(centres), r),
        np.zeros(len(centres) + 1, np.int64),
        np.zeros(9999, np.int32),
    )
    found = near_walls(centres, radius, rows, start, other)
    grain = np.repeat(np.arange(len(centres)), np.diff(start))
    overlap = wall_overlaps(centres, radius, rows, grain, other[:found].astype(np.int64))[:, 0]
    touching = overlap > 0.0
    assert np.array_equal(grain[touching], np.arange(len(centres)))
    assert overlap[touching] == pytest.approx(depth, rel=1e-9)
