"""Walls of triangles are what they tessellate, and shafts that walls turn with obey their closed forms."""

import numpy as np
import pytest
from dem_laws import DENSITY, EVERYTHING, FLOOR, MASS, RADIUS, SPEED, G, in_order, law, make_dem
from scipy.spatial import Delaunay

from geometry.time_profile import TimeProfile
from geometry.triangle_wall import TriangleWall, box_surface, extruded
from geometry.walls import Plane, annulus, cone, cylinder, outline
from particles import Body, FreeShaft, Grains, HertzContact, LinearContact, PairLaws

pytestmark = pytest.mark.physics


def sheet(count=300, side=0.04, seed=4, body="housing"):
    """A random triangulation of the floor, its vertices (v, 2) and triangles first: wall, vertices, triangles."""
    rng = np.random.default_rng(seed)
    flat = rng.uniform(-0.5 * side, 0.5 * side, (count, 2))
    flat[:4] = 0.6 * side * np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    triangles = Delaunay(flat).simplices
    return TriangleWall("sheet", body, np.column_stack([flat, np.zeros(count)]), triangles), flat, triangles


def both(make):
    """Runs on the plane and on its triangulation, each fresh: positions, velocities, spins, force on the floor."""
    results = []
    for wall in (FLOOR, sheet()[0]):
        dem, duration = make(wall)
        totals = dem.run(int(duration / dem.dt))
        results.append((*in_order(dem.grains), totals.force["housing"], totals))
    return results


def places(n):
    """n points (n, 2) over faces, edges and vertices of the sheet."""
    _, flat, triangles = sheet()
    inner = triangles[np.all(np.abs(flat[triangles]) < 0.015, axis=(1, 2))]
    k = np.arange(n)
    corners = flat[inner[7 * k]]
    return np.where((k % 3 == 0)[:, None], corners.mean(axis=1), np.where(
        (k % 3 == 1)[:, None], corners[:, :2].mean(axis=1), corners[:, 0]))  # fmt: skip


@pytest.mark.parametrize("name, everything", EVERYTHING)
def test_grains_dropped_on_faces_edges_and_vertices_bounce_as_on_a_plane(name, everything):
    """Where, how fast, how spinning: to 1e-9, each in a scene of its own, so that nothing averages out."""

    def make(wall):
        x = np.column_stack([places(6), np.full(6, RADIUS + 1e-6)])
        if make.only is not None:
            x = x[[make.only]]
        n = len(x)
        v, w = np.tile([0.3, -0.2, -SPEED], (n, 1)), np.tile([200.0, -100.0, 300.0], (n, 1))
        grains = Grains.create(x, RADIUS, DENSITY, velocity=v, angular_velocity=w)
        dem = make_dem(grains, [wall], [Body("housing")], law(name), everything=everything, gravity=(0.0, 0.0, -G))
        return dem, 1e-3

    for make.only in range(6):
        plane, triangles = both(make)
        for a, b in zip(plane[:4], triangles[:4], strict=True):
            assert np.max(np.abs(b - a)) <= 1e-9 * np.max(np.abs(a))
        assert plane[1][0, 2] > 0.0  # it has bounced
        assert triangles[4].max_overlap == pytest.approx(plane[4].max_overlap, rel=1e-9)


@pytest.mark.parametrize("name, everything", EVERYTHING)
def test_a_grain_rolls_and_slides_across_edges_as_on_a_plane(name, everything):
    """Over twenty triangles, from slip to roll: the contact with its springs is handed on, nothing bumps."""

    def make(wall):
        contact = law(name)
        depth = contact.overlap_under(MASS * G, MASS, 0.0, RADIUS)
        x = [[-0.015, -0.004, RADIUS - depth]]
        grains = Grains.create(x, RADIUS, DENSITY, velocity=[[0.4, 0.1, 0.0]], angular_velocity=[[0.0, 0.0, 100.0]])
        return make_dem(grains, [wall], [Body("housing")], contact, everything=everything, gravity=(0.0, 0.0, -G)), 0.06

    plane, triangles = both(make)
    assert plane[0][0, 0] > -0.015 + 2.5 * RADIUS  # cohesion and rolling resistance stop it there
    for a, b, scale in zip(plane[:3], triangles[:3], (0.01, 0.4, 400.0), strict=True):
        assert np.max(np.abs(b - a)) <= 1e-9 * scale
    assert triangles[4].n_contacts == 1
    for mechanism, lost in plane[4].energy_budget.dissipation.items():
        assert triangles[4].energy_budget.dissipation[mechanism] == pytest.approx(
            lost, abs=1e-9 * plane[4].energy_budget.dissipated
        )


def test_a_contact_counted_twice_would_show():
    """Two sheets at one place are one contact; two walls of two bodies are two: the depth falls to 0.758 then."""
    depths = {}
    wall, flat, triangles = sheet()
    twin = TriangleWall("twin", "housing", wall.vertices, wall.triangles)
    other = TriangleWall("other", "other", wall.vertices, wall.triangles)
    for name, walls in (("one", [wall]), ("twin", [wall, twin]), ("two bodies", [wall, other])):
        grains = Grains.create(
            [[*flat[triangles[9, 0]], RADIUS + 1e-6]], RADIUS, DENSITY, velocity=[[0.0, 0.0, -SPEED]]
        )
        spring = law("hertz", 1.0, 0.0)
        contact = HertzContact(spring.stiffness_n, spring.stiffness_t, 0.0, 0.0, 0.0)
        dem = make_dem(grains, walls, [Body("housing"), Body("other")], contact, steps=400.0)
        depths[name] = dem.run(int(4e-4 / dem.dt)).max_overlap
    assert depths["twin"] == pytest.approx(depths["one"], rel=1e-9)
    assert depths["two bodies"] / depths["one"] == pytest.approx(0.758, abs=3e-4)


# ---- turning


@pytest.mark.parametrize("drum", ["revolved", "tessellated"])
def test_torque_of_a_drum_that_slips_under_a_held_grain(drum):
    """A grain at the bottom of a lying drum is dragged against a rough stop beside it, which keeps it from rolling.

    Couples on the grain: the friction at the stop is that at the drum, mu N, and presses the grain down besides,
    N = m g + mu N. So the drum, of radius r, is braked by T = mu m g r/(1 - mu), and the stop bears as much.
    720 facets stand back by 0.09 um from the circle, 0.5 % of the overlap: they shake, but drag as the circle does.
    """
    rc, mu, load, stiffness = 9.0 * RADIUS, 0.3, 0.1, law("linear").stiffness_n
    frictions = {("grain", "grain"): 0.0, ("grain", "drum"): mu, ("grain", "stop"): 3.0}
    laws = PairLaws.of_pairs(
        ["grain"],
        ["drum", "stop"],
        {pair: LinearContact.from_restitution(stiffness, 0.3, friction) for pair, friction in frictions.items()},
    )
    angle = 2.0 * np.pi * (np.arange(720) + 0.5) / 720
    polygon = rc / np.cos(np.pi / 720) * np.column_stack([np.cos(angle), np.sin(angle)])
    wall = {
        "revolved": cylinder("drum", "drum", rc, -0.01, 0.01),
        "tessellated": extruded("drum", "drum", polygon, -0.01, 0.01, caps=False),
    }[drum]
    stop = Plane("stop", "stop", np.array([RADIUS, 0.0, 0.0]), np.array([-1.0, 0.0, 0.0]))
    bodies = [Body("drum", TimeProfile.constant(5.0)), Body("stop")]
    grains = Grains.create([[0.0, RADIUS - rc + load / stiffness, 0.0]], RADIUS, DENSITY)
    gravity = (0.0, -load / MASS, 0.0)
    dem = make_dem(grains, [wall, stop], bodies, laws, gravity=gravity, wall_material=[0, 1])
    dem.run(int(0.01 / dem.dt))
    totals = dem.run(int(0.05 / dem.dt))
    # the same with the overlaps: arms of the two frictions, and the angle by which the grain stands beside the bottom
    x, y, _ = dem.grains.position[0]
    beside, arms = np.arctan2(x, -y), (rc - np.hypot(x, y)) / (RADIUS - x)
    normal = load / (np.cos(beside) + mu * np.sin(beside) - mu * arms)
    assert normal == pytest.approx(load / (1.0 - mu), rel=0.01)
    torque, tolerance = mu * normal * rc, 1e-6 if drum == "revolved" else 1e-3
    assert totals.torque_on("drum") == pytest.approx(-torque, rel=tolerance)
    assert totals.torque_on("stop") == pytest.approx(torque - load * x, rel=tolerance)
    across = normal * (mu * np.cos(beside) - np.sin(beside))
    assert totals.force["stop"][0] == pytest.approx(across, rel=tolerance)
    assert totals.force["drum"] == pytest.approx([-across, -load - mu * normal * arms, 0.0], abs=tolerance * normal)
    assert totals.energy_budget.wall_work["drum"] == pytest.approx(5.0 * torque * totals.duration, rel=tolerance)
    assert abs(dem.grains.angular_velocity[0, 2]) < 1.0


def test_a_turning_vane_throws_as_a_bat_of_its_speed():
    """A vane meets a grain at rest at radius r: head-on at omega r in the vane's frame, v' = (1 + e) omega r.

    Plane to the radius at the moment of the impact; it turns by 0.01 rad during it, and the arm grows by the overlap.
    """
    omega, r = 50.0, 0.02
    vane = box_surface("vane", "disc", (0.03, -1e-3, 0.0), (0.06, 2e-3, 0.02))  # its face is y = 0 at first
    grains = Grains.create([[r, RADIUS + 1e-5, 0.0]], RADIUS, DENSITY)
    disc = Body("disc", TimeProfile.constant(omega))
    dem = make_dem(grains, [vane], [disc], law("linear", 0.7, 0.0), steps=400.0)
    totals = dem.run(int(3e-4 / dem.dt))
    assert dem.grains.velocity[0, 1] == pytest.approx(1.7 * omega * r, rel=2e-3)
    assert totals.n_contacts == 0
    # what the vane has lost in angular momentum the grain has got, and the work besides
    gained = dem.grains.angular_momentum_z()
    assert totals.torque_on("disc") * totals.duration == pytest.approx(-gained, rel=1e-9)
    assert totals.energy_budget.wall_work["disc"] == pytest.approx(omega * gained, rel=1e-9)


@pytest.mark.parametrize("axial", [False, True], ids=["across the shaft", "along the shaft"])
@pytest.mark.parametrize("name, everything", EVERYTHING)
def test_a_loaded_contact_turned_with_its_body_keeps_its_friction(name, everything, axial):
    """A grain clamped on the axis between two plates, loaded along them; plates and load turn.

    Each plate bears half of the load, for ever and to any angle: the springs turn with their normal (plates across) and
    about it (plates along), nothing creeps.
    """
    omega, load = 100.0, 3.0
    contact = law(name, 0.5, 0.5)
    depth = contact.overlap_under(20.0 * MASS * load, MASS, 0.0, RADIUS)
    at, size = 2.0 * RADIUS - depth, [8.0 * RADIUS] * 3
    size[2 if axial else 0] = 2.0 * RADIUS
    plates = [box_surface(f"plate {x}", "disc", (0.0, 0.0, x) if axial else (x, 0.0, 0.0), size) for x in (-at, at)]

    def frame(times):
        """Normal of the plates, and the load [m/s^2], both (k, 3)."""
        phase = omega * np.asarray(times)
        zero, one = np.zeros(phase.shape), np.ones(phase.shape)
        outward = np.stack([np.cos(phase), np.sin(phase), zero], axis=1)
        round_, up = np.cross([0.0, 0.0, 1.0], outward), np.stack([zero, zero, one], axis=1)
        normal, other = (up, outward) if axial else (outward, up)
        return normal, load / np.sqrt(2.0) * (round_ + other)

    grains = Grains.create([[0.0, 0.0, 0.0]], RADIUS, DENSITY, angular_velocity=[[0.0, 0.0, omega]])
    bodies = [Body("disc", TimeProfile.constant(omega))]
    dem = make_dem(grains, plates, bodies, contact, everything=everything, gravity=lambda times: frame(times)[1])
    quarter = int(0.5 * np.pi / omega / dem.dt)
    dem.run(4 * quarter)  # the start's swing dies away
    offset = []
    for _ in range(5):
        dem.run(quarter)
        table = dem.contacts()
        normal, push = (vectors[0] for vectors in frame([dem.time]))
        tangential = table.force - np.outer(table.force @ normal, normal)
        assert len(tangential) == 2
        assert np.linalg.norm(tangential, axis=1) == pytest.approx(0.5 * MASS * load, rel=2e-3)
        assert tangential == pytest.approx(np.tile(-0.5 * MASS * push, (2, 1)), abs=5e-3 * MASS * load)
        offset.append(dem.grains.position[0] @ push)
    assert np.ptp(offset) < 1e-3 * np.mean(offset)


# ---- free shafts, closed forms


def idle(shaft, dt):
    """A free shaft with a disc that nothing touches, and a grain elsewhere."""
    grains = Grains.create([[0.0, 0.0, 0.0]], 0.1, DENSITY)
    contact = law("linear", m_eff=float(grains.mass[0]), speed=0.01, radius=0.1)
    return make_dem(grains, [annulus("face", "rotor", -1.0, 0.0, 1.0)], [shaft], contact, dt=dt)


def test_a_motor_approaches_its_no_load_speed_exponentially():
    """J domega/dt = T_0 - c omega: omega = (T_0/c)(1 - exp(-c t/J)); second order in the step."""
    inertia, stall, slope = 2e-6, 1e-3, 4e-6
    error = []
    for dt in (1e-2, 5e-3):
        shaft = Body("rotor", FreeShaft(inertia, drive_torque=stall, drive_slope=slope))
        dem = idle(shaft, dt)
        totals = dem.run(round(0.5 / dt))
        error.append(shaft.speed / (stall / slope * (1.0 - np.exp(-slope * 0.5 / inertia))) - 1.0)
        work = totals.shaft_work["rotor"]
        assert work["drive"] == pytest.approx(0.5 * inertia * shaft.speed**2, rel=1e-12)
        assert work["load"] == 0.0 and work["contact"] == 0.0
    assert abs(error[0]) < 1e-4
    assert error[0] / error[1] == pytest.approx(4.0, rel=0.02)


def test_a_load_table_brakes_a_shaft_and_holds_it():
    """Load from 0 to 2 T over 1 s against a drive of T: it starts to slow at 0.5 s and stands from 1 + ... on.

    omega(t) = (T/J)(t - t^2) until 1 s, where it is 0; then the load holds it.
    """
    inertia, drive, dt = 1e-3, 2e-3, 1e-3
    shaft = Body(
        "rotor", FreeShaft(inertia, drive_torque=drive, load_torque=TimeProfile((0.0, 1.0), (0.0, 2.0 * drive)))
    )
    dem = idle(shaft, dt)
    for t in (0.25, 0.5, 0.75):
        dem.run(round(t / dt) - dem.step_count)
        # the load of a step is that of its beginning: half a step ahead on average
        assert shaft.speed == pytest.approx(drive / inertia * (t - t**2), abs=2.0 * drive / inertia * dt)
    dem.run(round(1.05 / dt) - dem.step_count)
    assert shaft.speed == 0.0
    angle = shaft.angle
    dem.run(500)
    assert shaft.speed == 0.0 and shaft.angle == angle
    assert angle == pytest.approx(drive / inertia / 6.0, rel=5e-3)  # the integral of t - t^2


def test_a_free_shaft_and_a_grain_share_angular_momentum():
    """A grain thrown against the vane of a light free shaft: inelastic exchange with the inertia J/r^2 as its mass."""
    r, inertia, v = 0.02, 3e-9, 1.0
    vane = box_surface("vane", "disc", (0.03, -1e-3, 0.0), (0.06, 2e-3, 0.02))
    grains = Grains.create([[r, RADIUS + 1e-5, 0.0]], RADIUS, DENSITY, velocity=[[0.0, -v, 0.0]])
    disc = Body("disc", FreeShaft(inertia))
    contact = law("hertz_mindlin", 1.0, 0.0)
    dem = make_dem(grains, [vane], [disc], contact, steps=400.0)
    before = dem.grains.angular_momentum_z()
    dem.run(int(4e-4 / dem.dt))
    assert dem.grains.angular_momentum_z() + inertia * disc.speed == pytest.approx(before, rel=1e-12)
    ratio = MASS * r * r / inertia
    assert dem.grains.velocity[0, 1] == pytest.approx(-v * (ratio - 1.0) / (ratio + 1.0), rel=5e-3, abs=5e-3)
    assert disc.speed == pytest.approx(-2.0 * MASS * v * r / (inertia + MASS * r * r), rel=5e-3)


@pytest.mark.parametrize("shape", ["hole", "funnel"])
@pytest.mark.parametrize("aside", [0.0, 1e-6, 1e-3, 0.05])
def test_a_ball_on_a_ring_about_the_axis_comes_to_rest(shape, aside):
    """Touched all round, it is held in the middle; by its nearest point alone it would tremble from side to side."""
    hole = 0.5 * RADIUS
    plate = outline(["pipe", "plate"], "housing", [(hole, -3.0 * RADIUS), (hole, 0.0), (4.0 * RADIUS, 0.0)])
    funnel = [cone("funnel", "housing", (0.0, 0.0), (4.0 * RADIUS, 4.0 * RADIUS))]
    walls, height = (
        (plate, np.sqrt(RADIUS**2 - (hole - aside * RADIUS) ** 2))
        if shape == "hole"
        else (funnel, (np.sqrt(2.0) + aside) * RADIUS)
    )
    grains = Grains.create(np.array([[aside * RADIUS, 0.0, height]]), RADIUS, DENSITY)
    dem = make_dem(grains, walls, [Body("housing")], law("linear", e=0.5), gravity=(0.0, 0.0, -G))
    dem.run(int(0.1 / dem.dt))
    assert np.linalg.norm(dem.grains.velocity) < 1e-10 and np.hypot(*dem.grains.position[0, :2]) < 1e-9 * RADIUS
