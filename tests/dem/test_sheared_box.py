"""Laws of grains in a sheared periodic box: images, momentum, energy, stress, lists, imposed pressure, checkpoints."""

import numpy as np
import pytest

from particles import DEM, Barostat, BoxTooDense, Grains, LinearContact, RollingFriction, ShearedBox, find_pairs
from particles.attraction import Attraction
from particles.packing.periodic_packing import periodic_packing

pytestmark = pytest.mark.physics

D, RATE, RHO = 1e-4, 1500.0, 7800.0
LAW = LinearContact.from_restitution(2000.0, 0.5, 0.3)


def dem_of(box, x, v=None, *, steps=24.0, law=LAW, rolling=None, **options):
    """Grains at ``x`` that move with the flow and the peculiar velocities ``v``."""
    v = box.flow(x[:, 2]) + (0.0 if v is None else v)
    spin = np.tile([0.0, 0.5 * box.rate, 0.0], (len(x), 1))
    grains = Grains.create(x, 0.5 * D, RHO, velocity=v, angular_velocity=spin)
    dt = law.contact_time(0.5 * grains.mass[0], 0.0, 0.0) / steps
    return DEM(grains, [], [], law, dt=dt, periodicity=box, rolling=rolling, **options)


def cell(fill=0.5, count=110, stir=2.0, rate=RATE, seed=1, **options):
    """A random packing that is sheared and stirred."""
    box, x = periodic_packing(count, D, fill, seed=seed)
    box.rate = rate
    v = np.random.default_rng(3).normal(0.0, stir * rate * D, x.shape) if stir else np.zeros(x.shape)
    v -= v.mean(axis=0)  # in a flow with a gradient only a layer at rest stays where it is
    return dem_of(box, x, v, **options)


def by_number(dem, array):
    return np.asarray(array)[np.argsort(dem.grains.particle_id)]


def peculiar_velocities(dem):
    """Velocities less the flow's, in the order of the grains' numbers."""
    g = dem.grains
    return by_number(dem, g.velocity - dem.box.flow(g.position[:, 2]))


@pytest.mark.parametrize("factor", [0.97, 1.0, 1.03])
def test_no_pair_comes_nearer_than_the_box_says(factor):
    """Grains that flow with a box that is sheared and stretched, that stand still, and that move relative to it."""
    rng, reach, strain = np.random.default_rng(5), 2.5 * D, 0.02
    box = ShearedBox([8.0 * D, 7.0 * D, 9.0 * D], RATE)
    before = rng.uniform(0.0, 1.0, (120, 3)) * box.lengths

    def apart(x):
        images = [box.place(x, np.full(len(x), shift)) for shift in range(-22, 23)]
        return np.linalg.norm(np.array(images)[:, None] - x[None, :, None], axis=-1)

    first, height = apart(before), box.height
    box.lengths[2] *= factor
    box.strain, box.offset = strain, strain * 0.5 * (height + box.height)
    with_it = before * [1.0, 1.0, factor]
    with_it[:, 0] += strain * 0.5 * (1.0 + factor) * before[:, 2]
    still = np.column_stack([with_it[:, :2], before[:, 2]])
    for x in (with_it, still, with_it + rng.normal(0.0, 0.02 * D, (120, 3))):
        nearer = (first - apart(x))[(first > D) & (first < reach)].max()
        assert nearer <= box.approach(x, before, 0.0, height, reach) * (1.0 + 1e-3)
    assert box.approach(with_it, before, 0.0, height, reach) < (strain + abs(factor - 1.0)) * reach * 1.02


@pytest.mark.parametrize("axis", [0, 1, 2])
def test_a_pair_through_a_face_is_a_pair(axis):
    """Across each face, sheared by 0.37: forces, stress and what the contact loses are those inside the box."""
    direction, found = np.array([0.48, 0.6, 0.64]), []
    for middle in (0.5, 0.0):
        box = ShearedBox([8.0 * D, 7.0 * D, 9.0 * D], RATE)
        box.offset = 0.37 * box.lengths[2]
        centre = 0.5 * box.lengths
        centre[axis] = middle * box.lengths[axis]
        x = centre + np.array([[-0.5], [0.5]]) * 0.99 * D * direction
        dem = dem_of(box, x, 0.3 * RATE * D * np.array([[1.0, 2.0, -1.0], [-1.0, 0.5, 0.7]]))
        assert dem.listed_pairs.count == 1 and (dem.listed_pairs.shift[0] != 0) == (middle == 0.0)
        totals = dem.run(15)
        losses = np.array(list(totals.energy.dissipation.values()))
        found.append((peculiar_velocities(dem), totals.stress.total, losses))
    for inside, through in zip(*found, strict=True):
        assert np.abs(inside).max() > 0.0
        assert through == pytest.approx(inside, rel=1e-9, abs=1e-12 * np.abs(inside).max())


def test_momentum_stays():
    """Beside the flow, which a wrap takes along: contacts, lists rebuilt."""
    dem = cell()
    before = dem.grains.mass @ peculiar_velocities(dem)
    totals = dem.run(6000)
    assert totals.rebuilds > 2 and totals.n_contacts > 5
    drift = dem.grains.mass @ peculiar_velocities(dem) - before
    assert np.abs(drift).max() < 1e-11 * dem.grains.mass[0] * RATE * D * dem.grains.count


def test_grains_that_do_not_meet_follow_the_flow():
    """The affine state: no stress, not of their motion either, and every grain where the flow takes it."""
    x = (np.indices((2, 2, 2)).reshape(3, 8).T + 0.5) * 3.7 * D
    dem = dem_of(ShearedBox(np.full(3, 7.4 * D), RATE), x)
    totals = dem.run(4000)
    box = dem.box
    moved = x + box.strain * np.column_stack([x[:, 2], np.zeros((8, 2))])
    moved[:, 0] %= box.lengths[0]
    assert box.strain > 0.2 and totals.rebuilds > 0
    off = by_number(dem, dem.grains.position) - moved
    off[:, 0] -= box.lengths[0] * np.round(off[:, 0] / box.lengths[0])
    assert np.abs(off).max() < 1e-9 * D
    assert np.abs(totals.stress.total).max() < 1e-12 * RHO * (RATE * D) ** 2


def test_the_work_of_shear_is_dissipated_or_held():
    """Kinetic energy to round-off; what contacts lose by the balance and by each mechanism, to second order in dt."""
    errors = []
    for steps in (20.0, 40.0):
        dem = cell(0.55, steps=steps)
        dem.run(int(20 * steps))
        energy = dem.run(int(300 * steps)).energy
        lost = sum(energy.dissipation.values())
        kinetic = energy.contact_work + energy.shear_work["motion"]
        assert energy.kinetic_change == pytest.approx(kinetic, abs=1e-9 * lost)
        assert lost > 0.0 and energy.shear_work["contacts"] > 0.3 * lost
        put_in = sum(energy.shear_work.values())
        assert put_in == pytest.approx(energy.dissipated + energy.kinetic_change + energy.elastic_change, rel=1e-9)
        errors.append(abs(energy.integration_error) / lost)
    assert errors[0] < 0.01
    assert errors[1] < 0.4 * errors[0]


def test_balances_close_with_grains_of_several_sizes():
    """Peculiar momentum, kinetic energy and the work of the shear to round-off, losses to the step's error."""
    box, x = periodic_packing(150, D, 0.55, seed=1)
    box.rate, rng = RATE, np.random.default_rng(1)
    radius, v = 0.5 * D * rng.choice([0.6, 0.8, 1.0], len(x)), rng.normal(0.0, RATE * D, x.shape)
    v -= (radius**3) @ v / (radius**3).sum()
    grains = Grains.create(x, radius, RHO, velocity=v + box.flow(x[:, 2]))
    dt = LAW.contact_time(0.5 * grains.mass.min(), 0.0, 0.0) / 24.0
    dem = DEM(grains, [], [], LAW, dt=dt, periodicity=box)
    dem.run(500)
    before = by_number(dem, grains.mass) @ peculiar_velocities(dem)
    totals = dem.run(6000)
    energy, lost = totals.energy, totals.energy.dissipated
    drift = by_number(dem, grains.mass) @ peculiar_velocities(dem) - before
    assert totals.rebuilds > 5 and lost > 0.0
    assert np.abs(drift).max() < 1e-12 * grains.mass.sum() * RATE * D
    assert energy.kinetic_change == pytest.approx(energy.contact_work + energy.shear_work["motion"], abs=1e-10 * lost)
    assert abs(energy.integration_error) < 0.01 * lost
    work = RATE * totals.duration * box.volume * totals.stress.shear
    assert sum(energy.shear_work.values()) == pytest.approx(work, rel=2e-3)


def test_work_over_strain_is_the_stress():
    """-rate V sigma_xz: of the mean stress of all steps, and the trapezoidal works, which differ at the ends."""
    dem = cell(0.55)
    dem.run(200)
    totals = dem.run(5000)
    work = RATE * totals.duration * dem.box.volume * totals.stress.shear
    assert totals.stress.shear > 0.0
    assert sum(totals.energy.shear_work.values()) == pytest.approx(work, rel=2e-3)


@pytest.mark.parametrize("moved", ["shifted", "whole boxes of strain", "whole boxes away"])
def test_where_the_box_is_cut_makes_no_difference(moved):
    """Frame invariance: all grains shifted and wrapped again, an offset of whole boxes, grains far outside."""
    box, x = periodic_packing(110, D, 0.5, seed=1)
    v = np.random.default_rng(3).normal(0.0, 2.0 * RATE * D, x.shape)
    other, there = ShearedBox(box.lengths), x.copy()
    box.rate = other.rate = RATE
    by = np.zeros(3)
    if moved == "shifted":
        by = np.array([1.3, -2.1, 3.7]) * D
    elif moved == "whole boxes away":
        by = np.array([2.0, -1.0, 0.0]) * box.lengths
    else:
        other.offset += 3.0 * box.lengths[0]
    there = there + by
    pair = [dem_of(box, x, v), dem_of(other, there, v)]
    ends = [dem.run(1500) for dem in pair]
    assert ends[0].n_contacts > 5 and ends[0].rebuilds >= 1
    assert peculiar_velocities(pair[1]) == pytest.approx(peculiar_velocities(pair[0]), abs=1e-6 * RATE * D)
    assert ends[1].stress.total == pytest.approx(ends[0].stress.total, rel=1e-6, abs=1e-6 * ends[0].stress.pressure)
    assert ends[1].energy.dissipated == pytest.approx(ends[0].energy.dissipated, rel=1e-6)


@pytest.mark.parametrize("stretched", [False, True])
def test_lists_hold_every_contact(stretched):
    """At every tenth step the contacts of the list against all pairs found anew, while the box is sheared fast."""
    dem = cell(0.4, stir=1.0, rate=4.0 * RATE)
    seen = 0
    for _ in range(150):
        dem.run(10)
        if stretched:
            dem.stretch(1.0005 if dem.box.lengths[2] < 5.5 * D else 0.9995)
        x = dem.grains.position
        every = find_pairs(x, D, dem.box)
        if dem._stale:
            continue  # another list is made before the next step
        listed = {
            (i, j) for i, j in zip(dem.listed_pairs.rows().tolist(), dem.listed_pairs.other.tolist(), strict=True)
        }
        apart = set(zip(every.rows().tolist(), every.other.tolist(), strict=True))
        assert apart <= listed
        seen += len(apart)
    assert seen > 100 and dem.list_version > 10


def test_a_table_of_pulls_makes_stress_and_work():
    """Held attraction: its stress is the virial of its pulls, its shear work theirs; the balance closes."""
    dem = cell(0.4, stir=1.0)
    values, across = np.linspace(1.0, 0.0, 20)[:, None] * np.ones((1, 2)), np.zeros(20)

    def drives(dem):
        pair = np.zeros((dem.listed_pairs.count, 3))
        pair[:, 1] = 2e-6
        return pair, np.zeros((0, 2))

    dem.attraction = Attraction(np.log(1e-3), np.log(300.0) / 19.0, values, across, 1e-3, drives, near_gap=0.3)
    dem.run(200)
    totals = dem.run(3000)
    energy = totals.energy
    assert totals.stress.attraction[2, 2] < 0.0
    assert np.abs(totals.stress.attraction - totals.stress.attraction.T).max() == 0.0
    kinetic = energy.contact_work + energy.external_work + energy.shear_work["motion"]
    assert energy.kinetic_change == pytest.approx(kinetic, abs=1e-9 * energy.dissipated)
    # the virial of one instant, from the pulls themselves
    pairs, box = dem.listed_pairs, dem.box
    x = np.array(dem.grains.position)
    r = box.place(x[pairs.other], pairs.shift) - x[pairs.rows()]
    distance = np.linalg.norm(r, axis=1)
    gap = np.maximum((distance - D) / (0.5 * D), 1e-3)
    pull = np.where(
        gap < 0.3, 2e-6 * np.interp(np.log(gap), np.log(1e-3) + np.log(300.0) / 19.0 * np.arange(20), values[:, 0]), 0.0
    )
    wanted = -np.einsum("k,ka,kb->ab", pull / distance, r, r) / box.volume
    assert dem.run(1).stress.attraction == pytest.approx(wanted, rel=1e-9)


def test_rolling_friction_raises_the_stress():
    """Everything that DEM's contacts have is there: friction that resists rolling makes a dense powder stiffer."""
    tau = []
    for rolling in (None, RollingFriction(0.3)):
        dem = cell(0.56, count=200, stir=0.0, rolling=rolling)
        dem.run(6000)
        totals = dem.run(25000)
        tau.append(totals.stress.shear)
        if rolling is not None:
            assert totals.energy.dissipation["rolling"] > 0.0
            assert abs(totals.energy.integration_error) < 0.02 * totals.energy.dissipated
    assert tau[1] > 1.1 * tau[0] > 0.0


def test_a_barostat_reaches_its_pressure():
    """From a looser and from a denser packing to the same mean fill, and so the mean normal stress is the imposed one.

    The mean of sigma_zz - P is g ln(Lz/Lz before) over the time, but for steps whose change is bounded; a height that
    stays brings it to 0.
    """
    means = []
    for fill in (0.45, 0.57):
        dem, barostat = cell(fill, count=150, stir=1.0), Barostat(300.0, 5.0)
        edges, solid = dem.box.lengths.copy(), 150 * np.pi / 6.0 * D**3
        normal, fills, times = [], [], []
        for _ in range(1200):
            totals = dem.run(50)
            barostat.follow(dem, totals)
            normal.append(totals.stress.total[2, 2])
            fills.append(solid / dem.box.volume)
            times.append(totals.duration)
        late = slice(600, None)
        means.append(np.mean(fills[late]))
        assert (dem.box.lengths[:2] == edges[:2]).all()
        stretch = 5.0 * np.log(fills[599] / fills[-1]) / np.sum(times[late])
        assert np.average(normal[late], weights=times[late]) == pytest.approx(300.0 + stretch, rel=1e-2)
        assert abs(stretch) < 0.15 * 300.0
    assert means[0] == pytest.approx(means[1], rel=0.06)  # 0.4 to 2 % seen, by the path of the grains
    with pytest.raises(ValueError, match="more than 0"):
        Barostat(1.0, 0.0)


def test_a_checkpoint_continues_bit_for_bit():
    one = cell(0.5)
    one.run(777)
    one.stretch(1.0003)
    state = one.state()
    other = cell(0.5, seed=2)
    other.restore(state)
    for dem in (one, other):
        dem.stretch(0.9999)
    ends = [dem.run(1500) for dem in (one, other)]
    for a, b in zip(one.state().values(), other.state().values(), strict=True):
        assert a.tobytes() == b.tobytes()
    assert ends[0].stress.total.tobytes() == ends[1].stress.total.tobytes()
    assert ends[0].energy == ends[1].energy
    assert one.box.strain == other.box.strain > 0.0


def test_beginning_with_other_grains_keeps_the_own_shear_rate():
    """Beside the flow they move as before, images too; at the rate of before they go on as those grains would."""
    first = cell(0.5)
    first.run(800)
    state, moving = first.state(), first._kinetic_now()
    faster = cell(0.5, seed=2, rate=3.0 * RATE)
    faster.begin_with(state)
    box = faster.box
    assert (box.rate, box.strain, faster.time) == (3.0 * RATE, 0.0, 0.0)
    assert (box.lengths == first.box.lengths).all() and box.offset == pytest.approx(first.box.offset)
    assert faster._kinetic_now() == pytest.approx(moving, rel=1e-12)  # less the flow's
    totals = faster.run(400)
    assert box.strain == pytest.approx(3.0 * RATE * totals.duration, rel=1e-12)
    assert abs(totals.energy.integration_error) < 0.02 * totals.energy.dissipated
    goes_on = cell(0.5, seed=2)
    goes_on.begin_with(state)
    for dem in (first, goes_on):
        dem.run(300)
    assert peculiar_velocities(goes_on) == pytest.approx(peculiar_velocities(first), abs=1e-6 * RATE * D)


def test_how_a_run_is_split_makes_no_difference():
    one, other = cell(), cell()
    one.run(900)
    for steps in (1, 299, 600):
        other.run(steps)
    for a, b in zip(one.state().values(), other.state().values(), strict=True):
        assert a.tobytes() == b.tobytes()


def test_what_a_box_cannot_have_is_refused():
    box, x = periodic_packing(100, D, 0.5, seed=2)
    pairs = find_pairs(x, D, box)
    apart = box.place(x[pairs.other], pairs.shift) - x[pairs.rows()]
    assert np.linalg.norm(apart, axis=1).min(initial=D) > 0.995 * D
    with pytest.raises(ValueError, match="at most"):
        periodic_packing(10, D, 0.7, seed=1)
    with pytest.raises(ValueError, match="a neighbour twice"):
        periodic_packing(4, D, 0.5, seed=1)
    assert issubclass(BoxTooDense, RuntimeError)
    with pytest.raises(ValueError, match="fall for ever"):
        dem_of(box, x, gravity=np.array([0.0, 0.0, -9.81]))
    with pytest.raises(ValueError, match="a neighbour twice"):
        dem_of(ShearedBox(np.full(3, 2.0 * D)), np.full((1, 3), D))
    dem = dem_of(box, x)
    with pytest.raises(ValueError, match="above 0"):
        dem.stretch(0.0)
