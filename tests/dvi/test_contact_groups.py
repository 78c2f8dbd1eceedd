"""Groups of contacts: each contact once, no grain twice in a group, and the same impulses as one by one."""

import numpy as np
import pytest
from dvi_scenes import DOWN, in_ring
from numba import njit

from geometry.kernels.simd import LANES
from geometry.time_profile import TimeProfile
from particles import Body, FreeShaft
from particles.dvi import gauss_seidel as gs
from particles.dvi.contact_groups import CONTACT, FIRST, SECOND, SIZE, WINDOW
from particles.dvi.dvi import DVI
from particles.dvi.dvi_contact import DviContact

STIFF = ((2e6, 1e6), (2e6, 1e6))


@njit
def _tables(grain, body, pair_index, pair, wall_index, wall):
    records = gs.grouped(grain, body, pair_index, pair, wall_index, wall)
    return records.pair_group, records.wall_group


def _groups(records):
    """Rows of both tables up to their ends."""
    for table in _tables(*records):
        ends = np.flatnonzero(table[:, CONTACT, 0] < 0)
        yield table[: ends[0]] if len(ends) else table


def _problem(pairs, walls=(), bodies=(0.0,)):
    """Records of contacts between the grains of ``pairs``, and of ``walls`` (grain, body) with 1/J of ``bodies``."""
    pairs, walls = (np.array(index, dtype=np.int32).reshape(-1, 2) for index in (pairs, walls))
    n = int(max(pairs.max(initial=0), walls[:, 0].max(initial=0))) + 1
    body = np.zeros((len(bodies), gs.N_BODY))
    body[:, gs.IJ] = bodies
    pair, wall = np.zeros((len(pairs), gs.N_PAIR)), np.zeros((len(walls), gs.N_WALL_CONTACT))
    return np.ones((n, gs.N_GRAIN)), body, pairs, pair, walls, wall


def _check(table, index, second):
    """Each contact once, its partners beside it, the rest of a group repeated, and no grain in two of its contacts."""
    size = table[:, SIZE, 0]
    assert np.all((size >= 1) & (size <= LANES))
    real = np.arange(LANES) < size[:, None]
    assert np.array_equal(np.sort(table[:, CONTACT][real]), np.arange(len(index)))
    assert np.array_equal(table[:, [FIRST, SECOND]].transpose(0, 2, 1), index[table[:, CONTACT]])
    for group, count in zip(table, size, strict=True):
        assert np.all(group[:SIZE, count:] == group[:SIZE, :1])
        grains = group[[FIRST, SECOND] if second else [FIRST], :count]
        assert len(np.unique(grains)) == grains.size


def _bed(n=400):
    """Pairs of a random graph of so many grains, about six partners each, by rows."""
    rng = np.random.default_rng(5)
    i = np.sort(rng.integers(0, n - 1, 3 * n))
    pairs = np.column_stack([i, np.minimum(i + rng.integers(1, 30, len(i)), n - 1)])
    return np.unique(pairs, axis=0)


@pytest.mark.parametrize("pairs", [_bed(), [(0, 1)], [(0, k) for k in range(1, 200)], np.zeros((0, 2))],
                         ids=["bed", "one", "star", "none"])  # fmt: skip
def test_each_contact_is_once_in_a_group_of_strangers(pairs):
    records = _problem(pairs)
    table, none = _groups(records)
    assert len(none) == 0
    _check(table, records[2], second=True)


def test_nearly_all_groups_of_a_bed_are_full():
    records = _problem(_bed())
    table, _ = _groups(records)
    assert len(table) < 1.1 * len(records[2]) / LANES


def test_a_big_grain_does_not_keep_the_others_apart():
    """The star takes a group for each of its contacts; what touches it not, fills them."""
    star = [(0, k) for k in range(1, 3 * WINDOW)]
    others = [(k, k + 1) for k in range(1000, 1000 + 2 * len(star), 2)]
    records = _problem(np.array([star, others[: len(star)]]).transpose(1, 0, 2).reshape(-1, 2))
    table, _ = _groups(records)
    _check(table, records[2], second=True)
    assert len(table) == len(star)


def test_walls_of_free_shafts_come_last_and_alone():
    walls = [(k // 2, k % 2) for k in range(60)]
    records = _problem([], walls, bodies=(0.0, 1.0))
    none, table = _groups(records)
    assert len(none) == 0
    _check(table, records[4], second=False)
    free = table[:, SECOND, 0] == 1
    assert np.array_equal(free, np.arange(len(table)) >= np.count_nonzero(~free))
    assert np.all(table[free, SIZE, 0] == 1) and np.count_nonzero(free) == 30
    assert np.array_equal(table[free, CONTACT, 0], np.arange(1, 60, 2))


def _loaded(**more):
    grains, walls = in_ring(120, 3, 0.06, sizes=(0.5, 1.0), low="drum")
    drum = Body("drum", FreeShaft(1e-3, load_torque=TimeProfile.constant(0.1)))
    bodies = [Body("rotor", TimeProfile.constant(20.0)), drum]
    dvi = DVI(grains, walls, bodies, DviContact(0.4), dt=5e-4, gravity=DOWN, stiffness=STIFF, max_sweeps=200, **more)
    dvi.run(150)
    return dvi


def test_a_group_is_as_its_contacts_one_after_another():
    """A sweep over groups, and the same visits with one contact a call: equal to round-off."""
    dvi = _loaded()
    records = dvi._records()
    pairs, walls = _groups(records)
    assert len(pairs) > 10 and pairs[:, SIZE, 0].max() == LANES and len(np.unique(walls[:, SECOND, 0])) == 2
    for array in (records[3], records[5]):
        array[:, gs.RX : gs.RZ + 1] *= 0.9
    alone = [array.copy() for array in records]
    gs.sweep_records(None, 1.0, dvi._compliance, *records)
    nothing = np.zeros(0, dtype=int)
    for table, kind in ((pairs, 0), (walls, 1)):
        for k in (k for group in table for k in group[CONTACT, : group[SIZE, 0]]):
            chosen = [nothing, nothing]
            chosen[kind] = np.array([k])
            part = [alone[2 + 2 * a + b][chosen[a]] for a in (0, 1) for b in (0, 1)]
            brake = alone[1][:, gs.BRAKE].copy()
            load, alone[1][:, gs.LOAD] = alone[1][:, gs.LOAD].copy(), 0.0  # shafts are braked once, at the end
            gs.sweep_records(None, 1.0, dvi._compliance, alone[0], alone[1], *part)
            alone[1][:, gs.LOAD], alone[1][:, gs.BRAKE] = load, brake
            alone[3 + 2 * kind][k] = part[1 + 2 * kind][0]
    gs.sweep_records(None, 1.0, dvi._compliance, alone[0], alone[1], *(a[:0] for a in alone[2:]))
    for mine, theirs in zip(records, alone, strict=True):
        assert mine == pytest.approx(theirs, rel=1e-12, abs=1e-15)


def test_frictionless_convex_contacts_do_not_pull():
    """Without friction and without sliding, a contact that opens lets go: no impulse below zero."""
    grain, body, index, pair, wall_index, wall = _problem([(1, 0)])
    grain[:], grain[:, gs.IM] = 0.0, 1.0
    grain[1, gs.VZ] = 3.0
    pair[0, [gs.EZ, gs.ARM, gs.RZ, gs.IWN, gs.IWT]] = 1.0, 1.0, 1.0, 0.5, 1.0 / 7.0
    gs.sweep_records(True, 1.0, None, grain, body, index, pair, wall_index, wall)
    assert np.all(pair[0, gs.RX : gs.RZ + 1] == 0.0)
    assert grain[:, gs.VZ] == pytest.approx([1.0, 2.0])
