"""The hierarchy of cell grids finds what the naive search over all pairs finds, row by row, nearest first."""

import math
import tracemalloc

import numba
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from particles import CyclicSector, find_pairs
from particles.neighbours import neighbour_list
from particles.neighbours.neighbour_list import cell_order, finest_cell


def naive(position, cutoff=None, sector=None, reach=None):
    """All pairs (i, j > i, shift), sorted by row, then by distance, partner and shift: three int arrays."""
    n = len(position)
    limit = np.full((n, n), np.inf) if reach is None else reach[:, None] + reach[None]
    if cutoff is not None:
        limit = np.minimum(limit, cutoff)
    found = []
    # with two sectors a turn by +angle is one by -angle: the partner of a grain at the high face (x < 0) is beyond it
    for shift in [0] if sector is None else [0, 1, -1]:
        there = position if shift == 0 else sector.turn(position, np.full(n, shift))
        d = there[None] - position[:, None]
        square = d[..., 0] ** 2 + d[..., 1] ** 2 + d[..., 2] ** 2
        near = np.triu(square < limit**2, 1)
        if sector is not None and sector.n_sectors == 2 and shift:
            near &= (shift * position[:, 0] < 0.0)[:, None]
        i, j = np.nonzero(near)
        found.append((i, square[i, j], j, np.full(len(i), shift)))
    i, square, j, shift = (np.concatenate(part) for part in zip(*found, strict=True))
    order = np.lexsort((shift, j, square, i))
    return i[order], j[order], shift[order]


def same(pairs, expected):
    assert pairs.start[0] == 0
    for ours, theirs in zip((pairs.rows(), pairs.other, pairs.shift), expected, strict=True):
        np.testing.assert_array_equal(ours, theirs)


def cloud(name, n=240):
    rng = np.random.default_rng(7)
    x = rng.random((n, 3))
    if name == "clusters":
        return rng.random((6, 3))[rng.integers(0, 6, n)] + 0.02 * rng.normal(size=(n, 3))
    if name == "lattice":  # on the faces, edges and corners of the cells, at distances equal to cut-offs
        return np.stack(np.meshgrid(*3 * [np.arange(6)], indexing="ij"), axis=-1).reshape(-1, 3) * 0.125
    if name == "plane":
        return x * [1.0, 0.0, 1.0]
    if name == "needle":
        return x * [1e-9, 40.0, 1e-9]
    if name == "one spot":
        return np.concatenate([x[:20], np.repeat(x[:3], 5, axis=0)])
    if name == "far from the origin":
        return x + np.array([1e3, -1e3, 1e3])
    if name == "one far away":
        return np.insert(x, 100, [1e5, -1e5, 1e5], axis=0)
    if name == "falling apart":
        return x * [1.0, 1.0, 1e7]
    return x


CLOUDS = ["random", "clusters", "lattice", "plane", "needle", "one spot", "far from the origin", "one far away",
          "falling apart"]  # fmt: skip


@pytest.mark.parametrize("name", CLOUDS)
@pytest.mark.parametrize("cutoff", [0.05, 0.125, 0.25, 3.0])
def test_grid_equals_naive_search(name, cutoff):
    x = cloud(name)
    same(find_pairs(x, cutoff), naive(x, cutoff))
    ordered = x[cell_order(x, cutoff)]
    same(find_pairs(ordered, cutoff), naive(ordered, cutoff))


@pytest.mark.parametrize("name", CLOUDS)
@pytest.mark.parametrize("sizes", ["10:1", "spread", "a thousandfold", "one large"])
@pytest.mark.parametrize("cutoff", [None, 0.1])
def test_levels_of_size_equal_naive_search(name, sizes, cutoff):
    x, rng = cloud(name), np.random.default_rng(8)
    n = len(x)
    reach = {
        "10:1": 0.02 * rng.choice([1.0, 10.0], n, p=[0.9, 0.1]),
        "spread": 10.0 ** rng.uniform(-2.0, -1.0, n),
        "a thousandfold": 10.0 ** rng.uniform(-3.5, -0.5, n),
        "one large": np.where(np.arange(n) == 5, 0.7, 0.01),
    }[sizes]
    same(find_pairs(x, cutoff, reach=reach), naive(x, cutoff, reach=reach))
    order = cell_order(x, finest_cell(reach, cutoff))
    same(find_pairs(x[order], cutoff, reach=reach[order]), naive(x[order], cutoff, reach=reach[order]))


def test_rounding_does_not_part_neighbours():
    """Two grains nearer than the edge of a cell whose cells, without a margin, come out two apart by rounding."""
    y = [-0.05, float.fromhex("0x1.0019999999999p+7"), float.fromhex("0x1.fefffffffffffp+6")]
    x = np.array([[0.0, place, 0.0] for place in y])
    assert y[1] - y[2] < 0.3
    assert find_pairs(x, 0.3).other.tolist() == [2]


def test_large_grains_before_sorted_small_ones():
    """The small ones alone stand in the order of their cells, which must not pass for the order of all."""
    x, reach = cloud("random"), np.repeat([0.2, 0.02], [20, 220])
    x = x[cell_order(x, 0.04)]
    x = np.concatenate([x[::12], np.delete(x, np.s_[::12], axis=0)])
    same(find_pairs(x, reach=reach), naive(x, reach=reach))


def wedge(sector, inner, n, rng):
    theta, r = rng.random(n) * sector.angle, inner * (1.0 + 0.5 * rng.random(n))
    return np.stack([r * np.cos(theta), r * np.sin(theta), 0.3 * inner * rng.random(n)], axis=1)


@pytest.mark.parametrize("parts", [2, 3, 5, 12, 60])
@pytest.mark.parametrize("ratio", [1.0, 10.0])
def test_pairs_across_the_faces_of_a_sector(parts, ratio):
    """From either side: the lower number may stand at either face."""
    sector, rng = CyclicSector(2.0 * math.pi / parts), np.random.default_rng(2)
    x = wedge(sector, 1.0, 400, rng)
    largest = min(0.12, 0.49 * math.sin(0.5 * sector.angle))  # two cut-offs fit between the faces
    reach = largest * np.where(rng.random(400) < 0.3, 1.0, 1.0 / ratio)
    pairs = find_pairs(x, None, sector, reach)
    same(pairs, naive(x, None, sector, reach))
    assert (pairs.shift == 1).any() and (pairs.shift == -1).any()


def test_grains_may_have_drifted_past_a_face():
    """By a tenth of the cut-off, half the skin: the partner beyond the other face is still found."""
    sector = CyclicSector(math.radians(60.0))
    past = sector.turn(np.array([[1.0, 0.01, 0.0]]), np.array([1]))  # 0.01 beyond the high face
    x = np.concatenate([past, [[1.0, 0.105, 0.0], [1.0, -0.01, 0.02]]])
    pairs = find_pairs(x, 0.1, sector)
    assert list(zip(pairs.rows(), pairs.other, pairs.shift, strict=True)) == [(0, 2, 1), (0, 1, 1)]


@given(
    st.lists(st.tuples(*3 * [st.integers(-8, 8)]), min_size=1, max_size=40),
    st.tuples(*3 * [st.integers(-1000, 1000)]),
    st.permutations(range(3)),
    st.tuples(*3 * [st.sampled_from([1, -1])]),
    st.randoms(use_true_random=False),
)
@settings(deadline=None, max_examples=60)
def test_pairs_follow_translation_turn_mirror_and_relabelling(points, offset, axes, signs, random):
    """Small integers are exact in floating point: not a single pair may differ."""
    x = np.array(points, dtype=float)
    n = len(x)
    relabel = np.array(random.sample(range(n), n))
    reach = 0.5 + (np.arange(n) % 3)
    moved = (x[:, axes] * signs + offset)[relabel]
    pairs, again = find_pairs(x, 3.0, reach=reach), find_pairs(moved, 3.0, reach=reach[relabel])
    back = {frozenset((relabel[i], relabel[j])) for i, j in zip(again.rows(), again.other, strict=True)}
    assert back == {frozenset(pair) for pair in zip(pairs.rows(), pairs.other, strict=True)}
    assert again.count == pairs.count


@given(st.integers(0, 2**32 - 1))
@settings(deadline=None, max_examples=20)
def test_pairs_follow_any_rotation(seed):
    """Up to pairs whose distance equals the cut-off to round-off."""
    rng = np.random.default_rng(seed)
    x = rng.random((150, 3))
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    pairs, turned = find_pairs(x, 0.2), find_pairs(x @ q.T, 0.2)
    ours, theirs = (set(zip(p.rows(), p.other, strict=True)) for p in (pairs, turned))
    for i, j in ours ^ theirs:
        assert abs(np.linalg.norm(x[i] - x[j]) - 0.2) < 1e-14


def test_memory_layout_does_not_matter():
    x = np.random.default_rng(4).random((500, 3))
    padded = np.zeros((500, 4))
    padded[:, :3] = x
    frozen = x.copy()
    frozen.setflags(write=False)
    expected = naive(x, 0.15)
    for view in (padded[:, :3], np.asfortranarray(x), frozen, np.repeat(x, 2, axis=0)[::2]):
        same(find_pairs(view, 0.15), expected)
        np.testing.assert_array_equal(cell_order(view, 0.15), cell_order(x, 0.15))


@pytest.mark.parametrize("block", [1, 7, 100])
def test_blocks_and_threads_do_not_change_a_bit(monkeypatch, block):
    """Rows depend on positions alone, however many are filled at once, and where the scratch has to grow."""
    rng = np.random.default_rng(5)
    x, reach = rng.random((700, 3)), 0.02 * rng.choice([1.0, 10.0], 700)
    x[-300:] = x[-300:] * 0.05 + 0.4  # long rows
    whole = find_pairs(x, reach=reach)
    assert np.diff(whole.start).max() > 256  # what is first made room for
    monkeypatch.setattr(neighbour_list, "BLOCK", block)
    monkeypatch.setattr(neighbour_list, "WORTH_SHARING", 0)
    numba.set_num_threads(min(2, numba.config.NUMBA_NUM_THREADS))
    cut = find_pairs(x, reach=reach)
    for name in ("start", "other", "shift"):
        np.testing.assert_array_equal(getattr(whole, name), getattr(cut, name))


@pytest.mark.parametrize("sizes", ["equal", "10:1", "spread"])
@pytest.mark.parametrize("name", ["random", "plane", "needle", "one far away", "lattice"])
def test_sorted_grains_are_recognised(name, sizes):
    """What makes the search fast: after `cell_order` no line of cells before a grain's own is looked at."""
    x, rng = cloud(name), np.random.default_rng(6)
    reach = {"equal": np.full(len(x), 0.06), "10:1": rng.choice([0.02, 0.2], len(x)),
             "spread": rng.uniform(0.02, 0.2, len(x))}[sizes]  # fmt: skip
    order = cell_order(x, finest_cell(reach))
    limit = 2.0 * float(reach.max())
    points = np.column_stack([x, reach])[order]
    ordered, _, _ = neighbour_list._rows(points, limit, None, np.zeros(len(x) + 1, dtype=np.int64))
    assert ordered >= 0
    np.testing.assert_array_equal(cell_order(x[order], finest_cell(reach)), np.arange(len(x)))


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_sorted_grains_are_slabs_across_the_longest_axis(axis):
    x = np.random.default_rng(9).random((3000, 3))
    x[:, axis] *= 5.0
    along = x[cell_order(x, 0.1), axis]
    assert (along >= np.maximum.accumulate(along) - 0.1 * (1.0 + 1e-7)).all()


def test_ties_keep_their_order():
    x = np.repeat(np.random.default_rng(10).random((50, 3)), 4, axis=0)
    order = cell_order(x, 1e-3).reshape(50, 4)
    assert (order == order[:, :1] + np.arange(4)).all()


@pytest.mark.parametrize("spread", [1.0, 1e6, 1e12])
def test_memory_follows_the_grains_and_not_the_space(spread):
    """Less than 200 bytes a grain, pairs included, for 20 000 in a bed or blown apart."""
    n = 20_000
    x = np.random.default_rng(11).random((n, 3)) * [spread, 1.0, spread]
    cutoff = 1.25 * (0.58 / (n * np.pi / 6.0)) ** (1.0 / 3.0)
    x = x[cell_order(x, cutoff)]
    reach = np.full(n, 0.5 * cutoff)
    find_pairs(x, reach=reach)  # compiled
    tracemalloc.start()
    find_pairs(x, reach=reach)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < 200 * n


@pytest.mark.parametrize("n", [0, 1])
def test_too_few_grains_for_a_pair(n):
    pairs = find_pairs(np.zeros((n, 3)), 1.0)
    assert pairs.count == 0 and pairs.start.tolist() == [0] * (n + 1)
    assert cell_order(np.zeros((n, 3)), 1.0).tolist() == list(range(n))


def test_points_without_reach_have_no_pairs():
    assert find_pairs(np.zeros((3, 3)), reach=np.zeros(3)).count == 0


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_position_that_is_not_finite_is_refused(bad):
    x = np.zeros((4, 3))
    x[2, 1] = bad
    with pytest.raises(ValueError, match=r"grain 2 stands at \[0\.0, (nan|inf|-inf), 0\.0\] m"):
        find_pairs(x, 1.0)
    with pytest.raises(ValueError, match="grain 2 stands at"):
        cell_order(x, 1.0)


@pytest.mark.parametrize(
    ("cutoff", "reach", "says"),
    [
        (None, None, "neither a cut-off nor a reach"),
        (0.0, None, "cut-off = 0 mm"),
        (math.inf, None, "cut-off = inf mm"),
        (math.nan, None, "cut-off = nan mm"),
        (None, np.array([0.1, -0.1, 0.1]), "negative or not a finite number"),
        (None, np.array([0.1, np.nan, 0.1]), "negative or not a finite number"),
        (None, np.array([0.1, np.inf, 0.1]), "negative or not a finite number"),
        (None, np.array([0.1, 0.1]), r"reach has shape \(2,\); it must be \(3,\)"),
    ],
)
def test_lengths_out_of_range_are_refused(cutoff, reach, says):
    with pytest.raises(ValueError, match=says):
        find_pairs(np.zeros((3, 3)), cutoff, reach=reach)


def test_narrow_sector_is_refused():
    sector = CyclicSector(math.radians(10.0))
    with pytest.raises(ValueError, match=r"10 degrees is 1\.743 mm wide .* at least two cut-offs = 4 mm"):
        find_pairs(np.array([[0.01, 0.0, 0.0]]), 0.002, sector)


@pytest.mark.parametrize("degrees", [0.0, 100.0, 360.0, -30.0])
def test_angle_must_divide_the_full_turn(degrees):
    with pytest.raises(ValueError, match="sector angle"):
        CyclicSector(math.radians(degrees))


def test_wrap_brings_everything_into_the_wedge():
    sector = CyclicSector(math.radians(40.0))
    position = np.random.default_rng(5).normal(size=(500, 3))
    position[0] = [1.0, -1e-18, 0.0]  # rounds to a full turn
    inside = sector.turn(position, sector.wraps(position))
    theta = np.arctan2(inside[:, 1], inside[:, 0])
    assert (theta > -1e-12).all() and (theta < sector.angle + 1e-12).all()
    assert sector.wraps(position)[0] == 0
