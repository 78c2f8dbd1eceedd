"""Solvers of one step of a dense bed that moves: accelerated sweeps, and the interior point as their oracle."""

import numpy as np
import pytest
from dvi_scenes import DOWN, STEEL, G, R, lattice, scaled, swept
from interior_point import cone_problem, cone_programme

from geometry import Box
from particles import Body, Grains
from particles.dvi import gauss_seidel as gs
from particles.dvi.accelerated import accelerate_records
from particles.dvi.dvi import DVI
from particles.dvi.dvi_contact import DviContact

pytestmark = pytest.mark.physics

SIDEWAYS = np.array([G, 0.0, 0.0])


def _box(**more):
    """64 spheres in a box that just holds them."""
    side = 4 * 2.05 * R
    sites = lattice(64)[0] * 2.05 * R
    where = sites - [0.5 * side, 0.5 * side, 0.0] + 2e-4 * R * np.random.default_rng(2).normal(size=sites.shape)
    box = Box((side, side, 1.1 * side))
    return DVI(Grains.create(where, R, STEEL), box.walls(), [Body("housing")], DviContact(0.3), dt=1e-3,
               **({"gravity": DOWN, "tolerance": 1e-5, "max_sweeps": 500} | more))  # fmt: skip


@pytest.fixture(scope="module")
def sheared():
    """Their bed after its gravity has turned to the side."""
    dvi = _box()
    dvi.run(150)
    dvi.gravity = SIDEWAYS
    dvi.run(40)
    return dvi


def _velocities(records):
    return records[0][:, [0, 1, 2, 4, 5, 6]].ravel()


def test_over_relaxed_sweeps_have_the_fixed_points_of_plain_ones(sheared):
    """A solution stays where it is, and its residual with it, at any over-relaxation."""
    records = scaled(sheared._records(), 0.0)
    reached = accelerate_records(None, None, 1e-12, 100_000, *records)[1]
    assert reached <= 1e-12
    solved = [a.copy() for a in records]
    for over in (0.5, 1.6):
        for _ in range(5):
            gs.sweep_records(None, over, None, *records)
    assert _velocities(records) == pytest.approx(_velocities(solved), abs=1e-9)
    assert gs.residual_records(None, None, *records) < 1e-10


def test_sweeps_find_the_velocities_of_the_convex_law(sheared):
    """They are unique: a cone programme with sparse factors must meet them."""
    sweeps = scaled(sheared._records(), 0.0)
    problem = cone_problem(*sweeps)
    velocity = cone_programme(problem, np.zeros(len(problem.friction)), 1e-10)[1]
    assert swept(1e-9, 200_000, sweeps, convex=True)[1] <= 1e-9
    assert _velocities(sweeps) == pytest.approx(velocity, abs=1e-5)


def test_linearised_shift_solves_exact_coulomb(sheared):
    """One programme, no sweeps: the natural map of the exact law is met, that of the convex law is not."""
    records = scaled(sheared._records(), 0.0)
    problem = cone_problem(*records)
    impulse, velocity = cone_programme(problem, None, 1e-9, 100)
    world = np.einsum("mi,mij->mj", impulse, problem.frame)
    p = len(records[3])
    records[3][:, gs.RX : gs.RZ + 1], records[5][:, gs.RX : gs.RZ + 1] = world[:p], world[p:]
    gs.apply_records(1.0, *records)
    # the programme bounds products of velocity and impulse; where both vanish each is the root of the bound
    assert gs.residual_records(None, None, *records) < 1e-9**0.5
    assert gs.residual_records(True, None, *records) > 1e-3
    assert _velocities(records) == pytest.approx(velocity, abs=1e-9**0.5)
