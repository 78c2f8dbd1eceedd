"""Pinned steel: return points are remembered, minor loops close, loss is a loop's area, no coercivity is the curve."""

from itertools import pairwise

import numpy as np
import pytest

from field import FroehlichLaw, LinearLaw, TableLaw, material
from field.laws.coercivity import coercivity, misfit_of_curve
from field.laws.materials import material_names
from field.laws.pinning import Pinning

STEEL = material("steel_1010")


def follow(path, pinning, law=STEEL, position=None):
    """H (n, 2) along a path of B (n, 2), the heat of each step (n,), and the positions at the end."""
    position = pinning.demagnetised() if position is None else position
    H, loss = np.empty(path.shape), np.empty(len(path))
    for i, B in enumerate(path):
        later = pinning.advanced(B, position)
        H[i], loss[i] = pinning.step(B, position)[0], pinning.loss(position, later)
        position = later
    size = np.hypot(*path.T)
    return H + (law.H_of_B(size)[0] / np.maximum(size, 1e-300))[:, None] * path, loss, position


def along(*turns, n=100, angle=0.0):
    """B between the turning points [T], along one direction."""
    B = np.concatenate([np.linspace(a, b, n + 1)[1:] for a, b in pairwise(turns)])
    return B[:, None] * np.array([np.cos(angle), np.sin(angle)])


@pytest.mark.parametrize("law", [STEEL, FroehlichLaw(2000.0, 1.5e6), material("dc01")])
def test_the_first_rise_is_the_magnetisation_curve(law):
    """To the last bit in one step from the demagnetised state, and to round-off in many."""
    pinning = Pinning.of(law, 100.0)
    B = np.array([0.3, 0.4])
    added, tangent, w = pinning.step(B, pinning.demagnetised())
    assert not added.any() and not tangent.any() and w == 0.0
    path = along(0.0, 1.8)
    H, _, _ = follow(path, pinning, law)
    assert np.allclose(H[:, 0], law.H_of_B(path[:, 0])[0], rtol=1e-12)


def test_without_coercivity_there_are_no_cells():
    pinning = Pinning.of(STEEL, 0.0)
    path = along(0.0, 1.5, -1.0, 0.7)
    H, loss, _ = follow(path, pinning)
    size = np.abs(path[:, 0])
    assert np.array_equal(H[:, 0], STEEL.H_of_B(size)[0] / np.maximum(size, 1e-300) * path[:, 0]) and not loss.any()


@pytest.mark.parametrize("value", [20.0, 80.0, 143.0, 200.0])
def test_the_major_loop_has_the_coercivity_and_its_remanence(value):
    """H = -H_c at B = 0 of a loop from saturation, and H = 0 at B_r with H_0(B_r) = H_c + P(B_r)."""
    pinning = Pinning.of(STEEL, value)
    assert pinning.coercivity == pytest.approx(value, rel=1e-12)
    path = along(0.0, 2.2, -2.2, n=550)
    H, _, _ = follow(path, pinning)
    falling = slice(550, None)
    assert np.interp(0.0, -path[falling, 0], H[falling, 0]) == pytest.approx(-value, rel=1e-9)
    Br = np.interp(0.0, -H[falling, 0], path[falling, 0])
    P = (pinning.stiffness * np.minimum(Br, pinning.reach)).sum()
    assert STEEL.H_of_B(np.array(Br))[0] == pytest.approx(value + P, rel=0.02)
    assert pinning.remanence(STEEL) == pytest.approx(Br, rel=0.03)
    assert np.all(np.diff(H[:550, 0]) > 0.0) and np.all(np.diff(H[falling, 0]) < 0.0)


def test_branches_after_a_return_follow_masings_rule():
    """Down from B_m the cells give P(B_m) - 2 P((B_m - B)/2)."""
    pinning = Pinning.of(STEEL, 143.0)

    def P(B):
        return (pinning.stiffness * np.minimum(B[:, None], pinning.reach)).sum(axis=1)

    path = along(0.0, 0.6, -0.6)
    H, _, _ = follow(path, pinning)
    B = path[100:, 0]
    curve = np.sign(B) * (STEEL.H_of_B(np.abs(B))[0] - P(np.abs(B)))
    expected = curve + P(np.array([0.6])) - 2.0 * P((0.6 - B) / 2.0)
    assert np.allclose(H[100:, 0], expected, atol=1e-9 * 143.0)


def test_return_points_are_remembered_and_minor_loops_close():
    """After excursions within it the outer branch goes on as if they had not been: the positions are the same."""
    pinning = Pinning.of(STEEL, 143.0)
    plain, _, at_plain = follow(along(0.0, 1.2, 0.1, 0.9), pinning)
    with_loops, _, at_loops = follow(along(0.0, 1.2, 0.1, 0.4, 0.3, 0.35, 0.32, 0.4, 0.2, 0.9), pinning)
    assert np.allclose(at_plain, at_loops, atol=1e-12)
    assert plain[-1, 0] == pytest.approx(with_loops[-1, 0], rel=1e-12)
    first, _, before = follow(along(0.0, 1.2, 0.1, 0.5), pinning)
    around, _, after = follow(along(0.5, 0.2, 0.5), pinning, position=before)
    assert around[-1, 0] == pytest.approx(first[-1, 0], rel=1e-12) and np.allclose(before, after, atol=1e-12)


@pytest.mark.parametrize("amplitude", [0.1, 0.5, 1.5])
def test_the_loss_of_a_closed_loop_is_its_area(amplitude):
    pinning = Pinning.of(STEEL, 143.0)
    _, _, position = follow(along(0.0, amplitude, -amplitude, amplitude), pinning)
    path = along(amplitude, -amplitude, amplitude, n=1500)
    H, loss, _ = follow(path, pinning, position=position)
    B = np.append(amplitude, path[:, 0])
    area = (0.5 * (H[:, 0] + np.append(H[-1, 0], H[:-1, 0])) * np.diff(B)).sum()
    assert np.all(loss >= 0.0) and loss.sum() == pytest.approx(area, rel=1e-3) and area > 0.0


def test_losses_of_small_loops_grow_with_the_cube_of_the_amplitude():
    """Rayleigh's law, which holds where the cells' reach is far above the amplitude and their distribution even."""
    fine = Pinning(np.full(2000, 1.0), np.linspace(0.0, 1.0, 2001)[1:])
    losses = []
    for amplitude in (0.05, 0.1):
        _, _, position = follow(along(0.0, amplitude, -amplitude, n=100), fine)
        losses.append(follow(along(-amplitude, amplitude, -amplitude, n=100), fine, position=position)[1].sum())
    assert np.log2(losses[1] / losses[0]) == pytest.approx(3.0, abs=0.05)


def test_work_goes_into_store_and_loss():
    """In small steps: integral of H dB = change of the reversible energy and the heat, on a path that turns."""
    pinning, t = Pinning.of(STEEL, 143.0), np.linspace(0.0, 2.5 * np.pi, 4001)
    path = (t / 8.0)[:, None] * np.column_stack((np.cos(t), np.sin(2.0 * t)))
    H, loss, position = follow(path, pinning)
    work = (0.5 * (H[1:] + H[:-1]) * np.diff(path, axis=0)).sum()
    size = np.hypot(*path[-1])
    stored = STEEL.energy_density(np.array([size]))[0] + pinning.stored(path[-1], position)
    assert stored + loss.sum() == pytest.approx(work, rel=1e-3) and stored > 0.0


def test_the_tangent_and_h_are_derivatives():
    """Central differences of w give H, those of H the tangent; random positions, turned fields."""
    pinning, random = Pinning.of(STEEL, 143.0), np.random.default_rng(1)
    B = random.normal(size=(200, 2))
    position = pinning.advanced(random.normal(size=(200, 2)), pinning.demagnetised(200))
    H, tangent, _ = pinning.step(B, position)
    e = 1e-6
    ahead = [pinning.step(B + e * np.eye(2)[i], position) for i in (0, 1)]
    behind = [pinning.step(B - e * np.eye(2)[i], position) for i in (0, 1)]
    for i in (0, 1):
        slope = (ahead[i][2] - behind[i][2]) / (2.0 * e)
        assert np.allclose(slope, H[:, i], atol=1e-5 * 143.0)
        columns = (ahead[i][0] - behind[i][0]) / (2.0 * e)
        right = np.isclose(columns, tangent[:, [i, i + 1]], rtol=1e-4, atol=1e-4 * pinning.stiffness.sum())
        assert right.mean() > 0.999  # a cell may slip between the two points


def test_the_step_is_that_of_its_definition():
    """The compiled step against s(B - p) - s(B) in numpy."""
    pinning, random = Pinning.of(STEEL, 143.0), np.random.default_rng(2)
    B, position = random.normal(size=(50, 3, 2)), random.normal(size=(50, 3, 2, pinning.reach.size))
    s = [B[..., None] - q - (pinning.advanced(B, q) - q) for q in (position, 0.0 * position)]
    H, _, _ = pinning.step(B, position)
    assert np.allclose(H, ((s[0] - s[1]) * pinning.stiffness).sum(axis=-1), atol=1e-10)


def test_the_step_is_convex():
    """The curve's tangent with that of the cells is positive definite for any position: Newton's steps go downhill."""
    random = np.random.default_rng(3)
    for name in material_names():
        law = material(name)
        if isinstance(law, LinearLaw):
            continue
        pinning = Pinning.of(law, coercivity(name).H_c)
        angle = random.uniform(0.0, 2.0 * np.pi, 20_000)
        size = random.exponential(0.5, angle.size) + 1e-6
        d = np.stack((np.cos(angle), np.sin(angle)), axis=-1)
        position = pinning.advanced(random.normal(size=d.shape), pinning.demagnetised(angle.size))
        _, tangent, _ = pinning.step(size[:, None] * d, position)
        H, slope = law.H_of_B(size)
        nu = H / size
        xx, xy, yy = (tangent + np.stack((nu + (slope - nu) * d[:, 0] ** 2, (slope - nu) * d[:, 0] * d[:, 1],
                                          nu + (slope - nu) * d[:, 1] ** 2), axis=-1)).T  # fmt: skip
        assert np.all(xx > 0.0) and np.all(xx * yy > xy * xy), name


def test_a_turned_path_gives_turned_fields():
    pinning, random = Pinning.of(STEEL, 143.0), np.random.default_rng(4)
    path = 0.5 * random.normal(size=(50, 2)).cumsum(axis=0)
    R = np.array([[0.6, -0.8], [0.8, 0.6]])
    assert np.allclose(follow(path @ R.T, pinning)[0], follow(path, pinning)[0] @ R.T, rtol=0.0, atol=1e-7)


def test_a_rotating_field_loses_and_lags():
    """In a rotating B of constant size H leads by the cells' friction; the loss a turn is the integral of H dB."""
    pinning, t = Pinning.of(STEEL, 143.0), np.linspace(0.0, 4.0 * np.pi, 4001)
    path = np.column_stack((np.cos(t), np.sin(t)))
    H, loss, _ = follow(path, pinning)
    turn = slice(2001, None)
    work = (0.5 * (H[turn] + H[2000:-1]) * np.diff(path, axis=0)[2000:]).sum()
    assert loss[turn].sum() == pytest.approx(work, rel=1e-3)
    # all cells slip: sum of kappa times the way of their positions, each on a circle of radius sqrt(1 - reach^2)
    way = 2.0 * np.pi * np.sqrt(1.0 - np.minimum(pinning.reach, 1.0) ** 2)
    assert work == pytest.approx((pinning.stiffness * pinning.reach * way).sum(), rel=1e-2)


@pytest.mark.parametrize("value", [-1.0, np.nan, np.inf, 5000.0])
def test_a_coercivity_that_cannot_be_is_refused(value):
    with pytest.raises(ValueError, match=r"coercivity.*steel_1010"):
        Pinning.of(STEEL, value)


def test_a_coercivity_far_below_the_curves_largest_permeability_is_reported():
    """The permeability of the law of Froehlich is largest at 0 A/m, that of a table with a knee at the knee."""
    knee = TableLaw(np.array([0.0, 200.0, 1000.0, 5000.0, 20000.0]), np.array([0.0, 0.05, 1.2, 1.7, 2.0]), "knee")
    assert misfit_of_curve(FroehlichLaw(1000.0, 1.6e6), Pinning.of(FroehlichLaw(1000.0, 1.6e6), 100.0)) == ""
    assert misfit_of_curve(knee, Pinning.of(knee, 0.0)) == ""
    for H_c, said in ((150.0, True), (500.0, False)):
        found = misfit_of_curve(knee, Pinning.of(knee, H_c))
        assert bool(found) == said, H_c
    assert "remanence" in misfit_of_curve(knee, Pinning.of(knee, 150.0))


def test_the_library_says_which_coercivities_do_not_fit_their_curves():
    """Six of eleven; all others have a remanence of 0.5 T at least."""
    reported = set()
    for name in material_names():
        law = material(name)
        pinning = Pinning.of(law, coercivity(name).H_c)
        if misfit_of_curve(law, pinning):
            reported.add(name)
        elif pinning.reach.size:
            assert pinning.remanence(law) > 0.5, name
    assert reported == {"steel_1010", "steel_1018", "steel_11smn30", "steel_11smnpb30", "dc01", "stainless_430"}


def test_every_built_in_material_has_its_coercivity_with_a_source():
    for name in material_names():
        known = coercivity(name)
        assert known.source and (known.H_c == 0.0) == isinstance(material(name), LinearLaw)
    with pytest.raises(ValueError, match="not known"):
        coercivity("unobtainium")
