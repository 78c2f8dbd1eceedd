"""Work of the magnetic forces on grains against their energy W: nothing in closed loops, -dW on open paths.

Moments and mmfs are at their fixed point at every place, as if the grains were moved quasi-statically.
"""

from types import SimpleNamespace

import numpy as np
import pytest

from coupling import MutuallyMagnetisedGrains
from coupling.grain_law_table import grain_table
from coupling.mutual_moments import MutualMoments
from coupling.neighbour_rows import neighbour_rows
from field import MU_0, GrainLaw
from particles import Grains

pytestmark = pytest.mark.physics

A = 1e-4
IRON = GrainLaw(999.0, 1.7e6)
SLOPE = np.array([[0.4, 0.0, 0.3], [0.0, 0.5, 0.0], [0.3, 0.0, -0.9]])  # of a field without curl and divergence
FLOOR = np.array([[0.0, 0.0, 1.0, 0.0, 1.0, 0.9]])  # from the axis outwards, steel below
# places [radii] of the grains that stay, and the middle of the way of the one that moves
PAIR = [[0.0, 0.0, 0.0]], [0.0, 0.0, 2.14]
CHAIN = [[0.0, 0.0, 2.03 * k] for k in range(-3, 1)], [0.0, 0.0, 2.14]
SIDES = [[0.0, 0.0, 0.0], [1.9, 0.0, 0.7], [-1.9, 0.3, 0.9], [0.2, 2.0, 0.4], [0.0, 0.0, -2.02]], [0.0, 0.0, 2.3]
WALL = [[5.0, 0.0, 2.4]], [7.4, 0.0, 1.7]


class Moved:
    """Grains of which the last one moves, in a field H + gradient x [A/m] of the given strength."""

    def __init__(self, others, strength, direction=(0.0, 0.0, 1.0), gradient=0.0, walls=None, model="near_field"):
        self.others, self.start, self.necks = np.array(others), None, None
        self.H, self.gradient = strength * np.array(direction), gradient * strength / (10.0 * A) * SLOPE
        self.solver = MutualMoments(grain_table(IRON, model), near=model == "near_field", reach=1.0, walls=walls)

    def at(self, place):
        """Energy [J] and the force [N] on the last grain at a place (3,) [radii]."""
        x = A * np.vstack((self.others, place))
        radius, rows = np.full(len(x), A), neighbour_rows(x, 1.0)
        applied = self.H + x @ self.gradient.T
        result = self.solver.solve(
            x, radius, applied, rows, start=self.start, necks=self.necks, tolerance=1e-10, max_sweeps=4000
        )
        assert result.residual <= 1e-10
        self.start, self.necks = result.dipole, self.solver.necks_of(result)
        force = self.solver.forces(x, radius, rows, result).force + MU_0 * result.dipole @ self.gradient.T
        return self.solver.energy(x, radius, result), force[-1]


def loop_work(grains, middle, size, points=64, plane=(0, 2)):
    """Work of the forces once round an ellipse [J], and the sum of the works of its positive legs."""
    t = 2.0 * np.pi * np.arange(points) / points
    places, ways = np.tile(middle, (points, 1)), np.zeros((points, 3))
    for axis, half, wave, slope in zip(plane, size, (np.sin(t), np.cos(t)), (np.cos(t), -np.sin(t)), strict=True):
        places[:, axis] += half * wave
        ways[:, axis] = half * slope * 2.0 * np.pi / points
    work = np.array([grains.at(x)[1] @ way * A for x, way in zip(places, ways, strict=True)])
    return work.sum(), work[work > 0.0].sum()


@pytest.mark.parametrize("strength", [18e3, 200e3])
@pytest.mark.parametrize(
    ("what", "size", "walls"),
    [(PAIR, (0.3, 0.1), None), (CHAIN, (0.25, 0.09), None), (SIDES, (0.25, 0.15), None), (WALL, (0.35, 0.6), FLOOR)],
    ids=["pair", "chain", "side grains", "past a wall"],
)
def test_closed_loops_do_no_work(what, size, walls, strength):
    """Axial and oblique, through gaps from 0.03 radii on, alone, before a chain, between others and past a wall."""
    others, middle = what
    work, positive = loop_work(Moved(others, strength, walls=walls), middle, size)
    assert positive > 0.0 and abs(work) < 2e-4 * positive


@pytest.mark.parametrize("model", ["mutual", "near_field"])
def test_work_on_an_open_path_is_what_the_energy_falls_by(model):
    """Beside side grains in a field with a gradient, whose force is on dipoles and on charges."""
    others, middle = SIDES
    grains = Moved(others, 80e3, (0.3, 0.1, 1.0), gradient=0.5, model=model)
    begin, end = np.add(middle, [-0.5, 0.1, 0.6]), np.add(middle, [0.1, 0.0, -0.22])
    nodes, weights = np.polynomial.legendre.leggauss(24)
    work = 0.0
    for node, weight in zip(0.5 + 0.5 * nodes, 0.5 * weights, strict=True):
        work += weight * grains.at(begin + node * (end - begin))[1] @ (end - begin) * A
    fall = grains.at(begin)[0] - grains.at(end)[0]
    assert work == pytest.approx(fall, rel=2e-4)
    assert abs(fall) > 0.02 * abs(grains.at(end)[0])


def test_energy_of_an_evaluation_stays_where_grains_are_turned_afterwards():
    """Grains that cross a face of a sector are turned with their dipoles; the energy is that of the evaluation."""
    grains = Grains.create(A * np.array([*SIDES[0], SIDES[1]]), A, 7800.0)
    rows = neighbour_rows(grains.position, 1.0)
    field = SimpleNamespace(sample=lambda x: (np.tile([8e4, 0.0, 3e4], (len(x), 1)), np.zeros((len(x), 3, 3))))
    solver = MutualMoments(grain_table(IRON, "near_field"), near=True, reach=1.0)
    magnetised = MutuallyMagnetisedGrains(field, IRON, solver=solver)
    motion = SimpleNamespace(grains=grains, energy_budget=True)
    magnetised.update(SimpleNamespace(motion=motion, source=None, rows=lambda reach: rows))
    before = magnetised.energy()
    for vectors in (grains.dipole, grains.magnetic_moment):
        vectors[:2] = vectors[:2] @ np.array([[0.0, 1.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert magnetised.energy() == before
