"""The five contact laws with one restitution and friction, and DEMs whose compiled steps many tests share.

Every combination of law, species, resistance, energy budget and sector is compiled once (10 s). A DEM made here is one
of two of each law: the law alone, and with ``everything`` two species of one material, rolling and twisting resistance
and cohesion.
"""

import numpy as np

from geometry.triangle_wall import TriangleWall
from geometry.walls import Plane, cylinder
from particles import (
    DEM,
    Cohesion,
    Elastic,
    Grains,
    HertzContact,
    HertzMindlin,
    LinearContact,
    PairLaws,
    RollingFriction,
    ThesisContact,
    TwistingFriction,
    WaltonBraun,
    choose_time_step,
)

G = 9.81
RADIUS, DENSITY, SPEED = 1e-3, 2500.0, 1.0
MASS = DENSITY * 4.0 / 3.0 * np.pi * RADIUS**3
LAWS = ("linear", "hertz_mindlin", "hertz", "thesis", "walton_braun")
FLOOR = Plane("floor", "housing", np.zeros(3), np.array([0.0, 0.0, 1.0]))
# laws that tests try with all that stands beside one: without a memory, with one, and the usual one
BESIDE = ("linear", "hertz_mindlin", "walton_braun")
EVERYTHING = [(name, False) for name in LAWS] + [(name, True) for name in BESIDE]


def law(name, e=0.7, mu=0.4, *, m_eff=MASS, speed=SPEED, radius=RADIUS):
    """The law ``name`` with restitution e for ``m_eff`` at ``speed``, about 2 % of d deep in that impact."""
    depth = 0.02 * 2.0 * radius
    k, hertz = m_eff * (speed / depth) ** 2, 1.25 * m_eff * speed**2 / depth**2.5
    match name:
        case "linear":
            return LinearContact.from_restitution(k, e, mu)
        case "hertz_mindlin":
            young = 0.75 * hertz / np.sqrt(radius)  # E*; two bodies of modulus E have E* = E/(2 (1 - nu^2))
            return HertzMindlin.from_restitution(Elastic(2.0 * 0.91 * young, 0.3), e, mu)
        case "hertz":
            return HertzContact.from_restitution(hertz, e, mu, m_eff=m_eff, speed=speed)
        case "thesis":
            stiffness, at = hertz * np.sqrt(2.0 * radius), {"m_eff": m_eff, "speed": speed}
            return ThesisContact.from_restitution(stiffness, e, mu, diameter=2.0 * radius, exponent=0.5, **at)
        case "walton_braun":
            return WaltonBraun.from_restitution(k, e, mu)
    raise ValueError(name)


def make_dem(grains, walls, bodies, contact, *, dt=None, steps=40.0, speed=SPEED, everything=False, **more):
    """A DEM in one of the two combinations; ``steps`` a contact at ``speed`` where no ``dt`` is given."""
    if everything:
        contact = PairLaws.of_one(
            contact,
            n_species=2,
            rolling=RollingFriction(0.1),
            twisting=TwistingFriction(0.05),
            cohesion=Cohesion.constant(COHESION),
        )
        more = {"species": np.arange(grains.count) % 2} | more
    if dt is None:
        chosen = choose_time_step(
            contact, grains.mass, grains.radius, speed=speed, steps_per_contact=steps, rolling=everything
        )
        dt = chosen.dt
    return DEM(grains, walls, bodies, contact, dt=dt, **more)


COHESION = 2e-3  # [N], with ``everything``
PARTNERS = ("plane", "triangles", "cylinder", "grain")


def impacts(normal, tangential, spin, *, delay=5e-6):
    """Grains that hit, ``delay`` later, a plane, a sheet of triangles, a cylinder from inside, and a grain at rest.

    normal, tangential : speeds (n,) [m/s] towards the partner and along it; spin : (n, 3) [rad/s] about the normal, the
    direction of ``tangential``, and across both.

    Returns grains in the order of `PARTNERS`, n each, then the n that are hit; walls of the body "wall".
    """
    n = len(normal)
    place, height = 4.0 * RADIUS * np.arange(n), 0.05
    flat = np.stack([place, np.zeros(n), np.zeros(n)], axis=1)
    up = np.stack([np.zeros(n), np.zeros(n), place], axis=1)
    gap = RADIUS + delay * normal[:, None]
    down, right, along = [0.0, 0.0, -1.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]
    starts = [  # a point of the wall, the direction towards it, the direction along it
        (flat + np.array([0.0, -height, 0.0]), down, along),
        (flat + np.array([0.0, 0.3 * RADIUS, height]), down, along),
        (up + np.array([10.0 * RADIUS, 0.0, 2.0 * height]), right, along),
        (up + np.array([0.2, 0.0, 2.0 * height]), right, along),
    ]
    x, v, w = [], [], []
    for point, towards, across in starts:
        frame = np.array([towards, across, np.cross(towards, across)])
        x.append(point - gap * frame[0])
        v.append(np.stack([normal, tangential, np.zeros(n)], axis=1) @ frame)
        w.append(spin @ frame)
    x.append(up + np.array([0.2 + RADIUS, 0.0, 2.0 * height]))
    v.append(np.zeros((n, 3)))
    w.append(np.zeros((n, 3)))
    # strips of three triangles under each grain, so that what slides crosses edges
    columns = np.linspace(-2.0 * RADIUS, place[-1] + 2.0 * RADIUS, n + 1)
    rows = np.array([-5.0, -1.0, 1.5, 6.0]) * RADIUS
    vertices = np.array([[a, b, height] for a in columns for b in rows])
    corner = np.array([4 * k + j for k in range(n) for j in range(3)])
    triangles = np.concatenate([
        np.stack([corner, corner + 4, corner + 5], axis=1), np.stack([corner, corner + 5, corner + 1], axis=1)
    ])  # fmt: skip
    walls = [
        Plane("plane", "wall", np.zeros(3), np.array([0.0, 0.0, 1.0])),
        TriangleWall("triangles", "wall", vertices, triangles),
        cylinder("cylinder", "wall", 10.0 * RADIUS, 2.0 * height - 4.0 * RADIUS, 2.0 * height + place[-1] + 1.0),
    ]
    grains = Grains.create(
        np.concatenate(x), RADIUS, DENSITY, velocity=np.concatenate(v), angular_velocity=np.concatenate(w)
    )
    return grains, walls


def in_order(grains):
    """The grains as they were given, whatever their order now: position, velocity, spin, each (n, 3)."""
    order = np.argsort(grains.particle_id)
    return grains.position[order], grains.velocity[order], grains.angular_velocity[order]


def energy(totals):
    """Kinetic energy and that of the springs [J] at the end of a run."""
    return totals.energy_budget.kinetic_energy + totals.energy_budget.elastic_energy
