"""No pair within the cut-off is missing from the rows, however grains move and however long the grains' list lasts."""

from types import SimpleNamespace

import numpy as np
import pytest

from coupling import Simulation
from coupling.neighbour_rows import neighbour_rows
from geometry.walls import annulus, cylinder
from particles import DVI, Body, CyclicSector, Grains
from particles.dvi.dvi_contact import DviContact

CUTOFF = 3e-3


class KeptList:
    """An engine whose list is never renewed: what the rows then know of motion is their own."""

    list_version, periodicity, box = 1, None, None

    def __init__(self, position: np.ndarray, list_skin: float) -> None:
        self.grains = SimpleNamespace(position=position)
        self.skin = self.list_skin = list_skin


def in_rows(rows) -> set[tuple[int, int]]:
    """Pairs (i, j) that the rows hold, seen from both grains."""
    return {(i, int(j)) for i in range(len(rows.start) - 1) for j in rows.other[rows.start[i] : rows.start[i + 1]]}


def within(position: np.ndarray) -> set[tuple[int, int]]:
    """Pairs within the cut-off, by comparing all with all."""
    distance = np.linalg.norm(position[:, None] - position[None], axis=2)
    np.fill_diagonal(distance, np.inf)
    return {(int(i), int(j)) for i, j in np.argwhere(distance < CUTOFF)}


@pytest.mark.parametrize("list_skin", [0.3e-3, 2e-3])
def test_rows_are_complete_under_a_list_that_is_not_renewed(list_skin):
    rng = np.random.default_rng(3)
    grains = rng.uniform(-6e-3, 6e-3, (120, 3))
    velocity = rng.normal(scale=0.1e-3, size=grains.shape)  # metres a step
    simulation = Simulation(KeptList(grains.copy(), list_skin), [], None, None, 1, 1)
    made = set()
    for step in range(40):
        position = simulation.motion.grains.position
        rows = simulation.rows(CUTOFF)
        made.add(id(rows.start))
        assert within(position) <= in_rows(rows), f"step {step}"
        simulation.motion.grains.position = position + velocity
    assert 1 < len(made)


def test_rows_that_hold_are_kept():
    """Half the skin's motion costs no new rows; a hair more does."""
    position = np.random.default_rng(1).uniform(-6e-3, 6e-3, (30, 3))
    simulation = Simulation(KeptList(position, 0.4e-3), [], None, None, 1, 1)
    first = simulation.rows(CUTOFF)
    simulation.motion.grains.position = position + np.array([0.199e-3, 0.0, 0.0])
    assert simulation.rows(CUTOFF) is first
    simulation.motion.grains.position = position + np.array([0.201e-3, 0.0, 0.0])
    assert simulation.rows(CUTOFF) is not first


def test_the_wide_list_of_fast_rigid_grains_makes_wide_rows():
    """Its list reaches further than the skin, and lasts as much longer: the rows must do the same."""
    rng = np.random.default_rng(5)
    position = rng.uniform(-4e-3, 4e-3, (20, 3))
    walls = [annulus("floor", "housing", -5e-3, 0.0, 20e-3), cylinder("shell", "rotor", 20e-3, -5e-3, 5e-3)]
    grains = Grains.create(position, 0.05e-3, 7800.0)
    grains.velocity[:] = [50.0, 0.0, 0.0]
    bodies = [Body("housing"), Body("rotor")]
    engine = DVI(grains, walls, bodies, DviContact(friction=0.3, restitution=0.5), dt=1e-5)
    assert engine.list_skin == pytest.approx(4.0 * 50.0 * 1e-5) and engine.list_skin > engine.skin
    rows = Simulation(engine, [], None, None, 1, 1).rows(CUTOFF)
    assert rows.reach == pytest.approx(CUTOFF + engine.list_skin)


def test_a_checkpoint_keeps_where_the_rows_were_made():
    """Resumed, they are rebuilt at the same moment as without the interruption."""
    position = np.random.default_rng(2).uniform(-6e-3, 6e-3, (30, 3))
    simulation = Simulation(KeptList(position, 0.4e-3), [], None, None, 1, 1)
    rows = simulation.rows(CUTOFF)
    simulation.motion.grains.position = position + np.array([0.15e-3, 0.0, 0.0])
    resumed = Simulation(KeptList(position + np.array([0.15e-3, 0.0, 0.0]), 0.4e-3), [], None, None, 1, 1)
    resumed.restore_rows(simulation.rows_state())
    assert np.array_equal(resumed.rows(CUTOFF).other, rows.other)
    assert np.array_equal(resumed.rows(CUTOFF).position, position)
    without = {name: value for name, value in simulation.rows_state().items() if name != "position"}
    resumed.restore_rows(without)  # of an older version
    resumed.motion.grains.position = position + np.array([0.3e-3, 0.0, 0.0])
    assert np.array_equal(resumed.rows(CUTOFF).position, position + np.array([0.3e-3, 0.0, 0.0]))


def test_a_sector_with_room_for_two_cut_offs_but_not_for_the_skin_too():
    """The plan asks for two cut-offs; the skin takes what is left, and a wedge below two cut-offs is refused."""
    sector = CyclicSector(2.0 * np.pi / 90.0)
    position = np.array([[20e-3, 0.2e-3, 0.0], [20.5e-3, 0.7e-3, 0.0], [20e-3, 1.2e-3, 0.0]])
    engine = KeptList(position, 0.2e-3)
    engine.periodicity = sector
    room = sector.widest_cutoff(position)
    rows = Simulation(engine, [], None, None, 1, 1).rows(0.95 * room)
    assert rows.reach == pytest.approx(room) and 1.05 * room < 0.95 * room + engine.list_skin
    with pytest.raises(ValueError, match="at least two cut-offs"):
        Simulation(engine, [], None, None, 1, 1).rows(1.01 * room)


def test_each_entry_knows_where_its_pair_stands_in_the_other_grains_row():
    """Also through the faces of a sector, where the turn is the opposite."""
    sector = CyclicSector(2.0 * np.pi / 12.0)
    rng = np.random.default_rng(7)
    r, angle = rng.uniform(20e-3, 24e-3, 200), rng.uniform(0.0, sector.angle, 200)
    position = np.column_stack((r * np.cos(angle), r * np.sin(angle), rng.uniform(0.0, 4e-3, 200)))
    rows = neighbour_rows(position, CUTOFF, sector)
    row = np.repeat(np.arange(200), np.diff(rows.start))
    assert np.array_equal(row[rows.twin], rows.other) and np.array_equal(rows.other[rows.twin], row)
    none = len(rows.images) // 2
    assert np.array_equal(rows.image[rows.twin], 2 * none - rows.image) and (rows.image != none).any()
    assert rows.images[none].tolist() == [1.0, 0.0, 0.0, 0.0, 0.0, 0.0]
    assert np.array_equal(rows.twin[rows.twin], np.arange(len(row)))
