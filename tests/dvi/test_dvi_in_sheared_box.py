"""Momentum, energy and stress balance of rigid and compliant grains in a sheared periodic box; images are the grains.

The same laws for DEM are in `tests/dem/test_sheared_box.py`, from where the box, the rate and the packings are.
"""

import numpy as np
import pytest

from particles import (
    DEM,
    DVI,
    Barostat,
    Cohesion,
    DviContact,
    Grains,
    LinearContact,
    RollingFriction,
    ShearedBox,
    TwistingFriction,
    find_pairs,
)
from particles.packing.periodic_packing import periodic_packing

pytestmark = pytest.mark.physics

D, RATE, RHO = 1e-4, 1500.0, 7800.0
STIFF = np.array([[2000.0, 600.0], [2000.0, 600.0]])
MASS = RHO * np.pi / 6.0 * D**3
ALL = {"rolling": RollingFriction(0.2), "twisting": TwistingFriction(0.1), "cohesion": Cohesion.constant(2e-6)}


def dvi_of(box, x, v=None, dt=1e-6, **options):
    """Grains at ``x`` that move with the flow and the peculiar velocities ``v``."""
    v = box.flow(x[:, 2]) + (0.0 if v is None else v)
    spin = np.tile([0.0, 0.5 * box.rate, 0.0], (len(x), 1))
    grains = Grains.create(x, 0.5 * D, RHO, velocity=v, angular_velocity=spin)
    way = {"stiffness": STIFF, "tolerance": 1e-7, "max_sweeps": 500} | options
    return DVI(grains, [], [], DviContact(0.3, 0.5), dt=dt, periodicity=box, **way)


def packed(fill=0.5, count=110, stir=2.0, rate=RATE, seed=1):
    """A random packing that is sheared and stirred: box, places, peculiar velocities."""
    box, x = periodic_packing(count, D, fill, seed=seed)
    box.rate = rate
    v = np.random.default_rng(3).normal(0.0, stir * rate * D, x.shape) if stir else np.zeros(x.shape)
    return box, x, v - v.mean(axis=0)


def cell(fill=0.5, count=110, stir=2.0, rate=RATE, seed=1, **options):
    return dvi_of(*packed(fill, count, stir, rate, seed), **options)


def peculiar_velocities(dvi):
    """Velocities less the flow's, in the order of the grains' numbers."""
    g = dvi.grains
    return (g.velocity - dvi.box.flow(g.position[:, 2]))[np.argsort(g.particle_id)]


@pytest.mark.parametrize("axis", [0, 1, 2])
@pytest.mark.parametrize("way", [{}, {"theta": 0.5}, ALL, {"stiffness": None}],
                         ids=["springs", "theta", "all", "rigid"])  # fmt: skip
def test_a_pair_through_a_face_is_a_pair(axis, way):
    """Across each face, sheared by 0.37: velocities, stress and what the contact loses are those inside the box."""
    direction, found = np.array([0.48, 0.6, 0.64]), []
    v = 0.3 * RATE * D * np.array([[1.0, 2.0, 1.0], [-1.0, 0.5, 1.3]])
    for middle in (0.5, 0.0):
        box = ShearedBox([8.0 * D, 7.0 * D, 9.0 * D], RATE)
        box.offset = 0.37 * box.lengths[2]
        centre = 0.5 * box.lengths
        centre[axis] = middle * box.lengths[axis]
        apart = 0.998 if way.get("stiffness", 1) is not None else 1.002
        dvi = dvi_of(box, centre + np.array([[-0.5], [0.5]]) * apart * D * direction, v, tolerance=1e-12, **way)
        assert dvi._list.pairs.count == 1 and (dvi._list.pairs.shift[0] != 0) == (middle == 0.0)
        totals = dvi.run(6)
        table = dvi.contacts()
        found.append((peculiar_velocities(dvi), dvi.grains.angular_velocity[np.argsort(dvi.grains.particle_id)],
                      totals.stress.total, np.array(list(totals.energy.dissipation.values())),
                      np.sort(table.overlap)))  # fmt: skip
    for inside, through in zip(*found, strict=True):
        assert through == pytest.approx(inside, rel=1e-9, abs=1e-11 * np.abs(inside).max(initial=1e-3 * D))
    assert np.abs(found[0][2]).max() > 0.0


@pytest.mark.parametrize("way", [{}, {"theta": 0.5}, ALL, {"stiffness": None, "tolerance": 1e-3, "dt": 5e-6}],
                         ids=["springs", "theta", "all", "rigid"])  # fmt: skip
def test_momentum_energy_and_work_balance_to_round_off(way):
    """Beside the flow, which a wrap takes along; the work of the shear is -rate V sigma_xz, all of it accounted for."""
    dvi = cell(0.55, **way)
    before = dvi.grains.mass @ peculiar_velocities(dvi)
    dvi.run(100)
    totals = dvi.run(1500)
    energy, lost = totals.energy, totals.energy.dissipated
    assert totals.rebuilds > 2 and totals.n_contacts > 5 and np.count_nonzero(dvi.contacts().shift) > 3
    drift = dvi.grains.mass @ peculiar_velocities(dvi) - before
    assert np.abs(drift).max() < 1e-11 * MASS * RATE * D * dvi.grains.count
    assert energy.kinetic_change == pytest.approx(energy.contact_work + energy.shear_work["motion"], abs=1e-9 * lost)
    assert lost == pytest.approx(sum(energy.dissipation.values()), rel=1e-9)
    put_in = sum(energy.shear_work.values())
    assert put_in == pytest.approx(lost + energy.kinetic_change + energy.elastic_change, rel=1e-9)
    work = RATE * totals.duration * dvi.box.volume * totals.stress.shear
    assert put_in == pytest.approx(work, rel=1e-9) and work > 0.0
    assert dvi.box.strain == pytest.approx(RATE * dvi.time, rel=1e-12)
    assert (totals.projections > 0) == (way.get("stiffness", 1) is None)


def test_impulses_of_every_grain_add_up_to_its_motion():
    """The forces of contacts are what the last step did to each grain, images included; their stress is the list's."""
    dvi = cell(0.55)
    dvi.run(60)
    velocity, x, box = np.array(dvi.grains.velocity), np.array(dvi.grains.position), dvi.box
    offset, order = box.offset, dvi.order_version
    totals = dvi.run(1)
    assert dvi.order_version == order and totals.rebuilds == 0
    change = (dvi.grains.velocity - velocity) * dvi.grains.mass[:, None] / dvi.dt
    assert change == pytest.approx(dvi.contact_force, abs=1e-9 * np.abs(change).max())
    pairs, box.offset = dvi._list.pairs, offset
    force = dvi._list.pair_impulse / dvi.dt
    away = x[pairs.rows()] - box.place(x[pairs.other], pairs.shift)
    assert totals.stress.contacts == pytest.approx(force.T @ away / box.volume, rel=1e-9, abs=1e-9)


def test_grains_that_do_not_meet_follow_the_flow():
    """The affine state: no stress, not of their motion either, and every grain where the flow takes it."""
    x = (np.indices((2, 2, 2)).reshape(3, 8).T + 0.5) * 3.7 * D
    dvi = dvi_of(ShearedBox(np.full(3, 7.4 * D), RATE), x)
    totals = dvi.run(300)
    box = dvi.box
    moved = x + box.strain * np.column_stack([x[:, 2], np.zeros((8, 2))])
    off = dvi.grains.position[np.argsort(dvi.grains.particle_id)] - moved
    off[:, 0] -= box.lengths[0] * np.round(off[:, 0] / box.lengths[0])
    assert box.strain > 0.4 and totals.rebuilds > 0 and totals.max_speed < 1e-12
    assert np.abs(off).max() < 1e-9 * D
    assert np.abs(totals.stress.total).max() < 1e-12 * RHO * (RATE * D) ** 2


def test_a_dense_flow_is_linear_on_average():
    """Velocities follow the height in proportion: no layer slips, none stands out; the mean over heights is 0."""
    dvi, slopes = cell(0.56, count=200, stir=0.0), []
    dvi.run(600)
    for _ in range(60):
        dvi.run(20)
        z = dvi.grains.position[:, 2]
        slopes.append(np.polyfit(z - z.mean(), (dvi.grains.velocity - dvi.box.flow(z))[:, 0], 1)[0])
    assert np.mean(slopes) == pytest.approx(0.0, abs=0.3 * RATE)  # a layer that slips: RATE; 0.02 to 0.05 seen


@pytest.mark.parametrize("moved", ["shifted", "whole boxes of strain", "whole boxes away"])
def test_where_the_box_is_cut_makes_no_difference(moved):
    """Frame invariance: all grains shifted and wrapped again, an offset of whole boxes, grains far outside."""
    box, x, v = packed()
    other, there = ShearedBox(box.lengths, RATE), x.copy()
    by = np.zeros(3)
    if moved == "shifted":
        by = np.array([1.3, -2.1, 3.7]) * D
    elif moved == "whole boxes away":
        by = np.array([2.0, -1.0, 0.0]) * box.lengths
    else:
        other.offset += 3.0 * box.lengths[0]
    pair = [dvi_of(one, at, v, tolerance=1e-12) for one, at in ((box, x), (other, there + by))]
    ends = [dvi.run(150) for dvi in pair]
    assert ends[0].n_contacts > 5 and ends[0].missed_steps == ends[1].missed_steps == 0
    assert peculiar_velocities(pair[1]) == pytest.approx(peculiar_velocities(pair[0]), abs=1e-6 * RATE * D)
    assert ends[1].stress.total == pytest.approx(ends[0].stress.total, rel=1e-6, abs=1e-6 * ends[0].stress.pressure)
    assert ends[1].energy.dissipated == pytest.approx(ends[0].energy.dissipated, rel=1e-6)


@pytest.mark.parametrize("stretched", [False, True])
def test_lists_hold_every_contact(stretched):
    """At every other step all pairs that may close within it, found anew, are in the list; sheared fast."""
    dvi = cell(0.4, stir=1.0, rate=4.0 * RATE, tolerance=1e-4)
    seen = 0
    for _ in range(250):
        dvi.run(2)
        if stretched:
            dvi.stretch(1.0005 if dvi.box.lengths[2] < 5.5 * D else 0.9995)
        dvi.renew_list()
        x, v = dvi.grains.position, dvi.grains.velocity
        every, box = find_pairs(x, 1.3 * D, dvi.box), dvi.box
        i, j = every.rows(), every.other
        r, u = x[i] - box.place(x[j], every.shift), v[i] - box.sweep(v[j], every.shift)
        distance = np.linalg.norm(r, axis=1)
        closes = distance + dvi.dt * np.einsum("ka,ka->k", r, u) / distance < D
        listed = set(zip(dvi._list.pairs.rows().tolist(), dvi._list.pairs.other.tolist(), strict=True))
        assert set(zip(i[closes].tolist(), j[closes].tolist(), strict=True)) <= listed
        seen += np.count_nonzero(closes)
    assert seen > 100 and dvi.list_version > 10


@pytest.mark.parametrize("way", [{}, ALL], ids=["springs", "all"])
def test_small_steps_of_both_methods_move_a_box_alike(way):
    """The same springs by DEM: stress and losses of a stirred packing, and places that differ by what goes with h."""
    law = LinearContact.from_restitution(STIFF[0, 0], 0.5, 0.3, stiffness_t=STIFF[0, 1], damping_t=0.0)
    box, x, v = packed(0.5)
    first = dvi_of(ShearedBox(box.lengths, RATE), x, v, dt=1e-8, **way)
    dem = DEM(Grains.of_records(first.state()), [], [], law, dt=1e-8, periodicity=ShearedBox(box.lengths, RATE), **way)
    wanted, away = dem.run(4000), []
    for dt in (4e-8, 2e-8):
        dvi = dvi_of(ShearedBox(box.lengths, RATE), x, v, dt=dt, **way)
        found = dvi.run(round(4e-5 / dt))
        assert found.missed_steps == 0
        shape = {"rel": 0.05, "abs": 0.03 * wanted.stress.pressure}
        assert found.stress.total == pytest.approx(wanted.stress.total, **shape)
        assert found.energy.dissipated == pytest.approx(wanted.energy.dissipated, rel=0.05)
        off = [m.grains.position[np.argsort(m.grains.particle_id)] for m in (dvi, dem)]
        away.append(np.median(np.linalg.norm(off[0] - off[1], axis=1)))
    assert away[0] < 0.003 * D
    if not way:  # the jump of a pull where a contact opens has no order
        assert away[1] < 0.7 * away[0]


def _friction(motion, updates, steps):
    """tau/P, and losses over the work of the shear, of so many updates after a fifth of them."""
    rows = []
    for _ in range(updates):
        totals = motion.run(steps)
        stress, energy = totals.stress, totals.energy
        rows.append((stress.shear, stress.total[2, 2], energy.dissipated, sum(energy.shear_work.values())))
    tau, normal, lost, work = np.mean(rows[updates // 5 :], axis=0)
    return tau / normal, lost / work


def test_a_dense_powder_has_the_friction_that_it_has_by_dem():
    """tau/P at a given volume, two packings to a strain of 3; steps of 0.002 strain, 80 of DEM's. DEM: 0.37 and 0.40.

    Stresses themselves differ from packing to packing by a third, at the same volume; their ratio by 0.015.
    """
    rate, springs = 300.0, np.array([[200.0, 57.0], [200.0, 57.0]])
    law, found = LinearContact.from_restitution(200.0, 0.5, 0.3, stiffness_t=57.0), []
    for seed in (1, 2):
        options = {"dt": 0.002 / rate, "stiffness": springs, "tolerance": 1e-6}
        dvi = cell(0.58, count=150, stir=0.0, rate=rate, seed=seed, **options)
        box, x, _ = packed(0.58, 150, 0.0, rate, seed)
        grains = Grains.of_records(dvi_of(box, x, **options).state())
        dem = DEM(grains, [], [], law, dt=law.contact_time(0.5 * MASS, 0.0, 0.0) / 14.0, periodicity=box)
        found.append((_friction(dvi, 300, 5), _friction(dem, round(3.0 / (rate * dem.dt * 200)), 200)))
    by_dvi, by_dem = np.mean(found, axis=0)
    # five standard deviations of the difference of two means of two packings, and of such a mean
    assert by_dvi[0] == pytest.approx(by_dem[0], abs=5 * 0.015) and by_dem[0] == pytest.approx(0.385, abs=5 * 0.011)
    assert by_dvi[1] == pytest.approx(1.0, abs=0.08)


@pytest.mark.parametrize("way", [{}, {"stiffness": None}], ids=["springs", "rigid"])
def test_a_barostat_reaches_its_pressure(way):
    """From a looser packing the mean normal stress becomes the imposed one, and the budget of the stretch closes."""
    dvi, barostat = cell(0.5, count=150, stir=1.0, dt=4e-6, **{"tolerance": 1e-5} | way), Barostat(300.0, 5.0)
    edges, normal, times, heights = dvi.box.lengths.copy(), [], [], []
    for _ in range(1000):
        totals = dvi.run(2)
        barostat.follow(dvi, totals)
        normal.append(totals.stress.total[2, 2])
        heights.append(dvi.box.lengths[2])
        times.append(totals.duration)
    late = slice(500, None)
    stretch = 5.0 * np.log(heights[-1] / heights[499]) / np.sum(times[late])
    assert (dvi.box.lengths[:2] == edges[:2]).all()
    assert np.average(normal[late], weights=times[late]) == pytest.approx(300.0 + stretch, rel=0.02)
    assert abs(stretch) < 0.15 * 300.0


def test_a_stretch_changes_the_energy_of_springs_by_its_work():
    """-sigma_zz of the springs for each unit of volume, at a small strain, at rest; then it is elastic change."""
    dvi = cell(0.58, stir=0.0)
    dvi.run(800)
    held, elastic = dvi.run(1), dvi._springs[0]
    volume = dvi.box.volume
    dvi.stretch(1.0 + 1e-7)
    rise = dvi._springs[0] - elastic
    x, pairs, box = dvi.grains.position, dvi._list.pairs, dvi.box
    r = x[pairs.rows()] - box.place(x[pairs.other], pairs.shift)
    distance = np.linalg.norm(r, axis=1)
    push = STIFF[0, 0] * np.maximum(D - distance, 0.0)
    assert rise == pytest.approx(-np.sum(push * r[:, 2] ** 2 / distance) * 1e-7, rel=1e-3)
    assert held.stress.contacts[2, 2] > 0.0 and volume < box.volume
    assert dvi.run(0).energy.elastic_change == pytest.approx(rise, rel=1e-9)


@pytest.mark.parametrize("way", [{}, ALL], ids=["springs", "all"])
def test_a_checkpoint_continues_bit_for_bit(way):
    one, other = cell(0.5, **way), cell(0.5, seed=2, **way)
    one.run(77)
    one.stretch(1.0003)
    other.restore(one.state())
    for dvi in (one, other):
        dvi.stretch(0.9999)
    ends = [dvi.run(150) for dvi in (one, other)]
    for a, b in zip(one.state().values(), other.state().values(), strict=True):
        assert a.tobytes() == b.tobytes()
    assert ends[0].stress.total.tobytes() == ends[1].stress.total.tobytes()
    assert ends[0].energy == ends[1].energy and one.box.strain == other.box.strain > 0.0


def test_beginning_with_other_grains_keeps_the_own_shear_rate():
    """Beside the flow they move as before, images too."""
    first, faster = cell(0.5), cell(0.5, seed=2, rate=3.0 * RATE)
    first.run(80)
    moving = first._kinetic_now()
    faster.begin_with(first.state())
    box = faster.box
    assert (box.rate, box.strain, faster.time) == (3.0 * RATE, 0.0, 0.0)
    assert (box.lengths == first.box.lengths).all() and box.offset == pytest.approx(first.box.offset)
    assert faster._kinetic_now() == pytest.approx(moving, rel=1e-12)
    totals = faster.run(40)
    assert box.strain == pytest.approx(3.0 * RATE * totals.duration, rel=1e-12)
