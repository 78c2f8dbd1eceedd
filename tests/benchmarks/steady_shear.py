"""Steady shear of a dry powder at an imposed pressure: what its bulk friction, tau/P, is measured in.

Grains in a sheared periodic box (`particles.sheared_box`) flow along x with the gradient along z; the height of the box
follows the normal stress sigma_zz, which is the imposed pressure P (`particles.barostat`). There is neither weight
nor fluid, cohesion or magnetism. The state then depends on numbers without a unit alone (da Cruz, Emam, Prochnow, Roux
& Chevoir, Phys. Rev. E 72 (2005) 021309; GDR MiDi, Eur. Phys. J. E 14 (2004) 341):

- sliding friction mu_s and rolling friction mu_r of the contacts,
- the inertial number I = rate d sqrt(rho/P), which is small where inertia does not count,
- the stiffness kappa = k/(P d), large where grains do not deform: their overlap is of the order of d/kappa,
- restitution and the widths of the sizes, which count little where I is small.

tau/sigma_zz is the tangent of the angle of internal friction that a ring shear tester reads in steady flow (critical
state), not that of the peak which a dense bed passes first.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from time import process_time

import numpy as np

from particles.barostat import Barostat
from particles.dem.dem import DEM
from particles.diagnostics.inertial_number import shear_rate_of
from particles.grains import Grains
from particles.laws.linear import LinearContact
from particles.laws.rolling_friction import RollingFriction
from particles.packing.periodic_packing import periodic_packing

FILL = 0.58  # of grains of the largest size, before the sizes are drawn: every state dilates or compacts from there
DAMPING = 20.0  # of the barostat, in P d sqrt(rho/P): slower than a collision, faster than the shear up to I = 0.02
STEPS_AT_ONCE = 20  # between two strains of the box
BLOCKS = 20  # of the averaged strain, for the standard error; what it lacks, runs with other seeds say


@dataclass(frozen=True, slots=True, kw_only=True)
class SteadyShear:
    """Parameters of a run.

    Attributes
    ----------
    friction, rolling : float
        Of the contacts [-]: Coulomb's coefficient, coefficient of rolling friction (0: grains roll freely).
    count, seed : int
        Of grains.
    inertial_number, stiffness : float
        I and kappa (see the module) [-].
    start, strain : float
        Strain that is left out, and after it the strain that is averaged [-].
    restitution, spread : float
        Of the contacts; half the width of the uniform sizes over their mean: equal grains would crystallise [-].
    steps_per_contact : float
        Steps in the duration of an impact of two of the smallest grains.
    diameter, density, pressure : float
        [m], [kg/m^3], [Pa]; no result without a unit depends on them.
    """

    friction: float
    rolling: float = 0.0
    count: int = 400
    seed: int = 1
    inertial_number: float = 5e-3
    stiffness: float = 500.0
    start: float = 0.5
    strain: float = 2.0
    restitution: float = 0.5
    spread: float = 0.15
    steps_per_contact: float = 14.0
    diameter: float = 1e-4
    density: float = 7800.0
    pressure: float = 300.0

    def __post_init__(self) -> None:
        for name in ("friction", "rolling", "start"):
            if not 0.0 <= getattr(self, name) < math.inf:
                raise ValueError(f"{name} = {getattr(self, name)}; allowed: at least 0 and finite")
        for name in ("inertial_number", "stiffness", "strain", "diameter", "density", "pressure"):
            if not 0.0 < getattr(self, name) < math.inf:
                raise ValueError(f"{name} = {getattr(self, name)}; allowed: above 0 and finite")
        if not 0.0 <= self.spread < 1.0:
            raise ValueError(f"spread = {self.spread}; allowed: from 0 to below 1")


@dataclass(frozen=True, slots=True)
class BulkFriction:
    """Means over the averaged strain.

    Attributes
    ----------
    mean, error : float
        tau/P and its standard error from blocks of the strain [-].
    pressure : float
        sigma_zz over the imposed one: 1 where the barostat follows [-].
    fill, contacts : float
        Solid fraction [-]; contacts of a grain [-].
    overlap : float
        The largest, over the diameter [-].
    steps : int
    seconds : float
        Processor time.
    """

    mean: float
    error: float
    pressure: float
    fill: float
    contacts: float
    overlap: float
    steps: int
    seconds: float


def measure_bulk_friction(shear: SteadyShear) -> BulkFriction:
    """Shear a powder at an imposed pressure and average the shear stress over that pressure.

    Raises
    ------
    ValueError
        Too few grains for the periodic box; a strain too short for an error bar.
    DemError
        The grains overlap too far: the stiffness is too small.
    """
    began = process_time()
    dem = sheared_grains(shear)
    box = dem.box
    assert box is not None
    time = shear.diameter * math.sqrt(shear.density / shear.pressure)
    barostat = Barostat(shear.pressure, DAMPING * shear.pressure * time)
    solid = float(dem.grains.volume.sum())
    shortest = BLOCKS * STEPS_AT_ONCE * dem.dt * box.rate
    if shear.strain < shortest:
        raise ValueError(
            f"strain = {shear.strain}; allowed: at least {shortest:.2g}, {BLOCKS} blocks for its error bar"
        )
    overlap, rows = 0.0, []
    while box.strain < shear.start + shear.strain:
        totals = dem.run(STEPS_AT_ONCE)
        barostat.follow(dem, totals)
        assert totals.stress is not None
        if box.strain > shear.start:
            normal = float(totals.stress.total[2, 2])
            rows.append((totals.stress.shear, normal, solid / box.volume, totals.n_contacts))
            overlap = max(overlap, totals.max_overlap)
    blocks = np.array([block.mean(axis=0) for block in np.array_split(np.array(rows), BLOCKS)])
    tau, normal, fill, touching = np.mean(rows, axis=0)
    return BulkFriction(
        mean=float(tau / shear.pressure),
        error=float(np.std(blocks[:, 0], ddof=1) / (math.sqrt(BLOCKS) * shear.pressure)),
        pressure=float(normal / shear.pressure),
        fill=float(fill),
        contacts=2.0 * float(touching) / shear.count,
        overlap=overlap,
        steps=dem.step_count,
        seconds=process_time() - began,
    )


def sheared_grains(shear: SteadyShear) -> DEM:
    """Random grains in a box that begins to flow, their sizes uniform between 1 -+ the spread of the mean."""
    mean, widest = 0.5 * shear.diameter, 1.0 + shear.spread
    box, position = periodic_packing(shear.count, shear.diameter * widest, FILL, seed=shear.seed)
    box.rate = shear_rate_of(shear.inertial_number, shear.diameter, shear.density, shear.pressure)
    radius = mean * np.random.default_rng(shear.seed).uniform(2.0 - widest, widest, shear.count)
    contact = LinearContact.from_restitution(
        shear.stiffness * shear.pressure * shear.diameter, shear.restitution, shear.friction
    )
    spin = np.tile([0.0, 0.5 * box.rate, 0.0], (shear.count, 1))  # grains turn with the flow
    grains = Grains.create(
        position, radius, shear.density, velocity=box.flow(position[:, 2]), angular_velocity=spin
    )  # fmt: skip
    dt = contact.contact_time(0.5 * float(grains.mass.min()), 0.0, 0.0) / shear.steps_per_contact
    rolling = RollingFriction(shear.rolling) if shear.rolling > 0.0 else None
    return DEM(grains, [], [], contact, dt=dt, periodicity=box, rolling=rolling)
