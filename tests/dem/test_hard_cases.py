"""Hard cases run long with bounded energy."""

import numpy as np
import pytest
from dem_laws import DENSITY, EVERYTHING, FLOOR, LAWS, MASS, RADIUS, G, energy, in_order, law, make_dem

from geometry.box import Box
from geometry.time_profile import TimeProfile
from geometry.triangle_wall import box_surface
from geometry.walls import AnnularBox, Plane, annulus, cylinder, outline
from particles import (
    Body,
    DemError,
    FreeShaft,
    Grains,
    pack,
)

pytestmark = [pytest.mark.hard, pytest.mark.physics]


def test_sizes_of_one_to_ten_fall_apart_and_lie_still():
    """A pile of grains 10 to 1 in size, 1 000 to 1 in mass: only what gravity gave is there, less every step."""
    rng = np.random.default_rng(2)
    k = np.arange(-2, 3) * 2.1 * RADIUS
    big = np.stack([a.ravel() for a in np.meshgrid(k[1:4], k[1:4], [1.2 * RADIUS, 3.4 * RADIUS])], axis=1)
    small = rng.uniform([-4.0, -4.0, 6.0], [4.0, 4.0, 9.0], (200, 3)) * RADIUS
    keep = [0]
    for i in range(1, 200):
        if np.min(np.linalg.norm(small[keep] - small[i], axis=1)) > 0.2 * RADIUS:
            keep.append(i)
    x = np.concatenate([big, small[keep]])
    radius = np.where(np.arange(len(x)) < len(big), RADIUS, 0.1 * RADIUS)
    walls = [FLOOR, cylinder("pen", "housing", 6.0 * RADIUS, 0.0, 0.05)]
    grains = Grains.create(x, radius, DENSITY)
    dem = make_dem(
        grains, walls, [Body("housing")], law("linear", m_eff=MASS, speed=0.3), steps=12.0, everything=True,
        gravity=(0.0, 0.0, -G),
    )  # fmt: skip
    height = np.sum(grains.mass * grains.position[:, 2]) * G
    before = height
    for _ in range(8):
        totals = dem.run(int(0.01 / dem.dt))
        now = energy(totals) + np.sum(dem.grains.mass * dem.grains.position[:, 2]) * G
        assert now < before + 1e-4 * height
        before = now
    assert totals.energy_budget.kinetic_energy < 1e-2 * height and totals.max_overlap < 0.05


@pytest.mark.parametrize("name", LAWS)
def test_a_grain_on_a_shaft_a_million_times_as_heavy(name):
    """J/r^2 = 1e6 m: thrown to and fro by a box of vanes that turns freely, for a hundred impacts.

    Angular momentum to round-off although all of the grain's is a millionth of the shaft's; energy never rises.
    """
    inertia, r = 1e6 * MASS * (6.0 * RADIUS) ** 2, 6.0 * RADIUS
    vanes = [
        box_surface(f"vane {k}", "shaft", (9.0 * RADIUS, y, 0.0), (14.0 * RADIUS, RADIUS, 0.1))
        for k, y in enumerate((-2.5 * RADIUS, 2.5 * RADIUS))
    ]
    rounds = {"rim": 10.0 * RADIUS, "hub": 3.0 * RADIUS}
    walls = [*vanes, *(cylinder(wall, "shaft", radius, -0.05, 0.05) for wall, radius in rounds.items())]
    shaft = Body("shaft", FreeShaft(inertia), speed=20.0)
    grains = Grains.create([[r, 0.0, 0.0]], RADIUS, DENSITY, velocity=[[0.3, 1.0, 0.0]])
    dem = make_dem(grains, walls, [shaft], law(name, 0.95, 0.3))
    before = grains.angular_momentum_z() + inertia * shaft.speed
    total = 0.5 * inertia * shaft.speed**2
    last, changes, seen, highest = 1.0, 0, 0.5 * MASS * 1.09, 0.0
    for _ in range(400):
        totals = dem.run(int(5e-4 / dem.dt))
        assert dem.grains.angular_momentum_z() + inertia * shaft.speed == pytest.approx(before, rel=1e-12)
        spoke = dem.grains.velocity[0] @ np.array([-np.sin(shaft.angle), np.cos(shaft.angle), 0.0])
        relative = spoke - shaft.speed * r
        changes += relative * last < 0.0
        last = relative
        highest = max(highest, totals.max_speed)
    assert changes > 20 and highest < 3.0
    # what the grain has won the shaft has lost: to the round-off of the shaft's energy
    assert 0.5 * inertia * shaft.speed**2 + energy(totals) < total + seen + 1e-12 * total
    assert np.hypot(*dem.grains.position[0, :2]) < 10.0 * RADIUS


@pytest.mark.parametrize("name", LAWS)
def test_a_deep_initial_overlap_gives_what_its_spring_held(name):
    """0.3 d deep, a limit of 0.5 d: the grains fly apart with the stored energy, less the losses; no more.

    F delta/2 is stored in a linear spring, 2/5 F delta in a Hertzian one, and e^2 F delta/2 in the hysteretic one,
    whose unloading line is 1/e^2 times as steep; it has no dashpot and gives all of that back.
    """
    for e in (1.0, 0.5):
        grains = Grains.create([[0.0, 0.0, 0.0], [1.4 * RADIUS, 0.0, 0.0]], RADIUS, DENSITY)
        contact = law(name, e, 0.3, m_eff=0.5 * MASS)
        dem = make_dem(grains, [], [], contact, dt=2e-7, overlap_limit=0.5)
        first = dem.run(1)
        held = energy(first)
        k = {"linear": 0.5, "walton_braun": 0.5 * e**2}.get(name, 0.4)
        force = np.linalg.norm(dem.contact_force[0])
        assert held == pytest.approx(k * force * 0.6 * RADIUS, rel=1e-6)
        totals = dem.run(20_000)
        assert totals.n_contacts == 0
        assert totals.energy_budget.kinetic_energy <= held * (1.0 + 1e-4)
        if e == 1.0 or name == "walton_braun":
            assert totals.energy_budget.kinetic_energy == pytest.approx(held, rel=1e-4)
        else:
            assert totals.energy_budget.kinetic_energy < 0.9 * held
    with pytest.raises(DemError, match=r"overlaps a neighbour or a wall by 30 % of the diameter \(the limit is 10 %\)"):
        grains = Grains.create([[0.0, 0.0, 0.0], [1.4 * RADIUS, 0.0, 0.0]], RADIUS, DENSITY)
        make_dem(grains, [], [], law(name, 0.5, 0.3), dt=2e-7).run(2)


@pytest.mark.slow
def test_a_column_of_a_thousand_grains_stands_under_its_weight():
    """In a square shaft three grains wide: settled, still after 10 000 more steps, walls and floor bear all of it."""
    side, n = 6.3 * RADIUS, 1000
    k = np.array([-2.08, 0.0, 2.08]) * RADIUS
    z = (1.01 + 2.06 * np.arange(112)) * RADIUS
    x = np.stack([a.ravel() for a in np.meshgrid(k, k, z)], axis=1)
    x = x[np.argsort(x[:, 2], kind="stable")][:n]
    x = x + np.random.default_rng(0).uniform(-0.01, 0.01, x.shape) * RADIUS
    walls = [FLOOR] + [
        Plane(f"side {k}", "shaft", 0.5 * side * -np.array(normal), np.array(normal))
        for k, normal in enumerate([(1.0, 0, 0), (-1.0, 0, 0), (0, 1.0, 0), (0, -1.0, 0)])
    ]
    bodies = [Body("housing"), Body("shaft")]
    dem = make_dem(Grains.create(x, RADIUS, DENSITY), walls, bodies, law("linear", 0.3, 0.5, speed=0.3), speed=0.3,
                   steps=15.0, gravity=(0.0, 0.0, -G))  # fmt: skip
    start = dem.grains.position[:, 2].copy()
    for _ in range(60):
        dem.run(400)
        dem.grains.velocity[:] *= 0.7
        dem.grains.angular_velocity[:] *= 0.7
    still = in_order(dem.grains)[0]
    totals = dem.run(5_000)
    later = dem.run(5_000)
    weight = n * MASS * G
    assert later.force["housing"][2] + later.force["shaft"][2] == pytest.approx(-weight, rel=1e-3)
    assert later.force["shaft"][2] < -0.3 * weight  # Janssen: friction of the walls bears a good part
    moved = np.linalg.norm(in_order(dem.grains)[0] - still, axis=1)
    assert np.median(moved) < 1e-3 * RADIUS and moved.max() < RADIUS  # a few grains that bear nothing still roll
    assert later.energy_budget.kinetic_energy <= totals.energy_budget.kinetic_energy + 1e-9 * weight * start.max()
    assert later.max_overlap < 0.05


@pytest.mark.parametrize("name", ["linear", "hertz_mindlin"])
def test_a_jammed_bed_under_a_turning_lid(name):
    """Grains swollen in a closed cup until they press on its lid, which turns then: it drags as the cup is dragged.

    Overlaps and energies stay bounded; in the steady state what the lid puts in is lost, and the budget tells where.
    """
    rc, height = 8.0 * RADIUS, 8.0 * RADIUS
    cup = outline("cup", "cup", [(0.0, 0.0), (rc, 0.0), (rc, height)])
    lid = annulus("lid", "lid", height, 0.0, rc)
    contact = law(name, 0.5, 0.5)

    def scene(x, radius, speed):
        bodies = [Body("cup"), Body("lid", TimeProfile((0.0, 2e-3), (0.0, speed)))]
        grains = Grains.create(x, radius, DENSITY)
        return make_dem(grains, [*cup, lid], bodies, contact, steps=30.0, overlap_limit=0.2)

    x = pack([AnnularBox(0.0, rc, 0.0, height)], [*cup, lid], 190, 0.93 * RADIUS, seed=1)
    for swollen in np.linspace(0.93, 1.02, 10):
        dem = scene(x, swollen * RADIUS, 0.0)
        for _ in range(8):
            dem.run(200)
            dem.grains.velocity[:] *= 0.5
        x = in_order(dem.grains)[0]
    pressed = dem.run(1000)
    assert pressed.n_contacts > 2 * 190 and abs(pressed.force["lid"][2]) > 0.1
    dem = scene(x, 1.02 * RADIUS, 30.0)
    dem.run(int(5e-3 / dem.dt))
    put_in = lost = 0.0
    for _ in range(5):
        totals = dem.run(int(0.01 / dem.dt))
        budget = totals.energy_budget
        assert totals.torque_on("lid") < 0.0 < totals.torque_on("cup")
        assert totals.max_overlap < 0.2 and 0.0 < budget.kinetic_energy < 0.2 * budget.elastic_energy  # jammed
        assert abs(budget.integration_error) < 0.01 * budget.wall_work["lid"]
        put_in, lost = put_in + budget.wall_work["lid"], lost + budget.dissipated
    assert totals.torque_on("cup") == pytest.approx(-totals.torque_on("lid"), rel=0.05)
    assert lost == pytest.approx(put_in, rel=0.5)  # the rest is stored; how much, differs by path and processor


@pytest.mark.parametrize("name, everything", EVERYTHING)
def test_a_spin_of_1e5_per_second(name, everything):
    """A surface speed of 100 m/s, 0.2 rad a step: it climbs, throws, and never has more energy than at first.

    On the floor friction acts as it says: mu N, so the thrown speed is at most mu (1 + e) v.
    """
    w = np.array([[1e5, 0.0, 0.0], [0.0, 0.0, 1e5], [-1e5, 0.0, 0.0]])
    x = np.array([[0.0, 0.0, RADIUS], [0.02, 0.0, RADIUS], [0.04, 0.0, 1.5 * RADIUS]])
    grains = Grains.create(x, RADIUS, DENSITY, velocity=[[0.0, 0.0, -0.5]] * 3, angular_velocity=w)
    dem = make_dem(grains, [FLOOR], [Body("housing")], law(name, 0.8, 0.4), everything=everything,
                   gravity=(0.0, 0.0, -G))  # fmt: skip
    energies = [grains.kinetic_energy()]
    for _ in range(60):
        totals = dem.run(int(1e-3 / dem.dt))
        energies.append(energy(totals) + np.sum(MASS * G * (dem.grains.position[:, 2] - x[:, 2])))
    assert np.all(np.diff(energies) < 1e-5 * energies[0])
    assert energies[-1] < 0.999 * energies[0]
    _, v, spin = in_order(dem.grains)
    assert np.all(np.abs(spin).max(axis=1) <= 1e5) and np.abs(v).max() < 40.0
    if not everything:  # sphere on a point: nothing brakes its spin about the normal
        assert spin[1, 2] == pytest.approx(1e5, rel=1e-12)


@pytest.mark.parametrize("mu", [0.0, 5.0])
@pytest.mark.parametrize("e", [0.05, 1.0])
@pytest.mark.parametrize("name", LAWS)
def test_extreme_friction_and_restitution(name, mu, e):
    """A closed box of grains that fly at first: energy never rises, and without a loss it stays, for 300 impacts."""
    side = 12.0 * RADIUS
    cell = Box((side, side, side))
    k = np.arange(-1.5, 2.0) * 2.6 * RADIUS
    x = np.stack([a.ravel() for a in np.meshgrid(k, k, k + 0.5 * side)], axis=1)
    v = np.random.default_rng(3).normal(size=x.shape) * 0.3
    grains = Grains.create(x, RADIUS, DENSITY, velocity=v, angular_velocity=v[::-1] * 300.0)
    steps = 60.0 if e == 1.0 else 30.0  # only what has no losses is to keep its energy to 1e-3
    dem = make_dem(grains, cell.walls(), [Body("housing")], law(name, e, mu), steps=steps)
    energies = [grains.kinetic_energy()]
    lost = 0.0
    for _ in range(40):
        totals = dem.run(int(5e-4 / dem.dt))
        energies.append(energy(totals))
        lost += totals.energy_budget.dissipated
        assert totals.max_overlap < 0.05
    assert np.all(np.diff(energies) < 1e-3 * energies[0])
    assert energies[0] - energies[-1] == pytest.approx(lost, abs=1e-9 * energies[0])
    if e == 1.0 and mu == 0.0:
        assert energies[-1] == pytest.approx(energies[0], rel=1e-3)
    elif e < 1.0:
        assert energies[-1] < (0.9 if mu == 0.0 else 0.5) * energies[0]


# ---- degenerate places


def test_a_grain_exactly_on_an_edge_on_the_axis_and_on_a_cell_boundary():
    """Balanced on the edge of a box, on the axis of a disc and of a cone's tip, in a corner, on cells of the search."""
    r = RADIUS
    contact = law("linear", 0.5, 0.3)
    depth = contact.overlap_under(MASS * G, MASS, 0.0, r)
    block = box_surface("block", "housing", (0.02, 0.0, -0.01), (0.02, 0.02, 0.02))
    disc = annulus("disc", "rotor", 0.0, 0.0, 5.0 * r)
    tip = outline("cone", "rotor", [(0.0, 0.05), (0.004, 0.046)])
    x = [
        [0.0, 0.0, r - depth],  # on the axis, on a disc
        [0.0, 0.0, 0.05 + r - depth],  # on the axis, on the tip of a cone
        [0.02, 0.0, r - depth],  # over the diagonal of the block's top
        [0.03, 0.0, r - depth],  # on its edge
        [0.03, 0.01, r - depth],  # on its corner
    ]
    bodies = [Body("housing"), Body("rotor", TimeProfile.constant(30.0))]
    dem = make_dem(Grains.create(x, r, DENSITY), [block, disc, *tip], bodies, contact, gravity=(0.0, 0.0, -G))
    for _ in range(200):
        totals = dem.run(1)
        assert totals.n_contacts == 5
    table = dem.contacts()
    assert np.sort(table.i).tolist() == [0, 1, 2, 3, 4]
    assert totals.max_overlap == pytest.approx(depth / (2.0 * r), rel=1e-6)
    at, v, _ = in_order(dem.grains)
    assert np.abs(at - x).max() < 1e-9 * r and np.abs(v).max() < 1e-9
    later = dem.run(int(0.02 / dem.dt))  # the three on the block and both on the axis: nothing pushes them aside
    assert later.n_contacts == 5 and np.abs(in_order(dem.grains)[0] - x).max() < 1e-6 * r


@pytest.mark.parametrize("spacing", [2.0, 2.0 * (1.0 - 1e-12), 1.999])
def test_grains_on_the_boundaries_of_cells_all_meet_their_neighbours(spacing):
    """A cubic lattice whose constant is the diameter (or the list's cell): 3 n^2 (n - 1) contacts or none."""
    n, skin = 6, 0.5 * RADIUS
    for scale in (1.0, 1.25):  # 2.5 R is diameter and skin: the places of the grains are those of the cells
        k = np.arange(n) * spacing * RADIUS * scale
        x = np.stack([a.ravel() for a in np.meshgrid(k, k, k)], axis=1)
        grains = Grains.create(x, RADIUS * scale, DENSITY)
        dem = make_dem(grains, [], [], law("linear"), skin=skin)
        count = dem.run(1).n_contacts
        distance = np.linalg.norm(x[:, None] - x[None], axis=2)
        assert count == np.count_nonzero(np.triu(distance < 2.0 * RADIUS * scale, 1))
        if spacing < 1.9999:
            assert count == 3 * n * n * (n - 1)
