r"""Steady shear of a magnetised powder between walls that are not there: stress and permeability from first principles.

A periodic box (`particles.sheared_box`) flows along x with the gradient along z; the macroscopic field, that of an even
powder, stands along z: chains cross the flow, as in a clutch. `particles.DEM` moves equal grains with a linear contact
law, friction and rolling friction; `coupling.mutual_moments` finds moments and magnetic forces from all neighbours
within the split's width, images included. No weight, no fluid.

**Stress.** The one that a wall feels is the force along x on a plane across z. By momentum balance it is that of all
pairs whose line crosses the plane,

    tau = -(1/V) [sum over pairs r_z F_x + sum m V_x V_z],

F on the grain at r from its partner: contacts, what is held of the magnetic forces, the attraction of near pairs.
Contacts alone do not have this stress, and pairs with torques do not have F_x r_z = F_z r_x: the field's torque
mu_0 M x H stands between tau_zx and tau_xz (`Series.tau` and `Series.tau_across`). Two things do *not* come on top:

- the macroscopic Maxwell stress across z, B_z H_x, is 0: H stands along z (H_x is continuous, and 0 at the steel).
  Its partner B_x H_z = mu_0 M_x H_z is the force along z on a plane across x; no wall stands there;
- of the forces of smeared grains on grains: those above a plane are a layer of the even magnetisation M S(z), whose
  field is H_z(z) only; it has no gradient along x, hence no F_x = mu_0 (m_z dH_x/dz + m_x dH_x/dx) across the plane.

**Power.** In the steady state tau rate V is what contacts dissipate, `Series.power`; the difference is the error of the
held forces, of the lagging moments and of the step, and what chains that have not yet broken hold.

**What follows from what.** Stiffness of contacts: an overlap of 0.5 % of a diameter under the load of a chain along the
field, min(2 pi H/Ms, 0.7) mu_0 Ms^2 a^2, and ten times the negative stiffness (pi/2) mu_0 Ms^2 a of a saturated neck.
Rate: from the inertial number I = rate d sqrt(rho/tau), with an estimate of tau; the measured one is reported. Step: a
fraction of the contact's duration; the range of the neck's force, 2 a H/Ms, then is resolved a thousand times over.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from coupling.grain_law_table import FARTHEST_GAP, grain_table
from coupling.mutual_moments import MIN_GAP, Magnetisation, MutualMoments, Necks
from coupling.near_attraction import NearAttraction
from coupling.neighbour_rows import NeighbourRows, neighbour_rows
from field.laws.powder_law import GrainLaw
from field.laws.reluctivity import MU_0, Law
from field.spheres.lone_sphere import saturation
from particles import DEM, Grains, LinearContact, RollingFriction, periodic_packing

SKIN = 0.3  # of the lists, in diameters
NEAR = 1.0 + 0.5 * FARTHEST_GAP  # diameters: where two equal spheres become mutual dipoles
OVERLAP = 0.005  # of a diameter, under the load of a chain
NECK = 10.0  # contact stiffness over the neck's negative one
DIPOLES_SUFFICE = 0.15  # of Ms: the field above which a chain of mutual dipoles holds as strongly as one with necks
MIN_STRESS = 10.0  # Pa: rate of a cell without a field
FIRST_TOLERANCE, TOLERANCE, MAX_SWEEPS = 1e-3, 1e-2, 300  # of the moments, at rest and while the cell is sheared


@dataclass(frozen=True, slots=True, kw_only=True)
class ShearParameters:
    """Parameters of a run; lengths in diameters, everything else in SI.

    Attributes
    ----------
    law : GrainLaw or Law or None
        Of the grains' material; None: no magnetism.
    fill, H : float
        Solid fraction [-]; macroscopic field [A/m], along z.
    friction, rolling : float
        Coefficients of the grains [-]: Coulomb's, and of rolling friction (0: grains roll freely).
    model : str
        near_field or mutual.
    count, seed : int
        Of grains.
    strain : float
        How far to shear [-].
    inertial_number : float
        Aimed at [-].
    width : float
        Of the split [diameters].
    steps_per_contact : float
        Steps in the duration of an impact: with 12 the stress at 80 kA/m is some per cent lower than with 24.
    steps_per_look : int
        Steps between two looks at the moments.
    stiffness : float
        Over what is needed (see the module) [-].
    """

    law: GrainLaw | Law | None
    fill: float
    H: float
    model: str = "near_field"
    count: int = 600
    seed: int = 1
    strain: float = 2.5
    inertial_number: float = 5e-3
    friction: float
    rolling: float = 0.0
    restitution: float = 0.5
    smallest_gap: float = MIN_GAP
    width: float = 2.5
    steps_per_contact: float = 24.0
    steps_per_look: int = 8
    stiffness: float = 1.0
    windows: int = 100
    diameter: float = 1e-4
    density: float = 7800.0


@dataclass(slots=True)
class Series:
    """Means over windows.

    Attributes
    ----------
    strain : at the windows' ends [-].
    tau, tau_contacts, tau_held, tau_near : the stress that a wall feels and its parts: contacts, held magnetic forces,
        near pairs' attraction [Pa].
    tau_across : force along z on a plane across x, without the macroscopic field's [Pa].
    pressure : a third of the trace of the same stress, positive where grains push [Pa].
    power : dissipated by contacts, over rate and volume [Pa].
    mu_r, M_x : relative permeability [-], grains' magnetisation along the flow [A/m].
    contacts : of a grain [-].
    """

    strain: list[float] = field(default_factory=list)
    tau: list[float] = field(default_factory=list)
    tau_contacts: list[float] = field(default_factory=list)
    tau_held: list[float] = field(default_factory=list)
    tau_near: list[float] = field(default_factory=list)
    tau_across: list[float] = field(default_factory=list)
    pressure: list[float] = field(default_factory=list)
    power: list[float] = field(default_factory=list)
    mu_r: list[float] = field(default_factory=list)
    M_x: list[float] = field(default_factory=list)
    contacts: list[float] = field(default_factory=list)


def list_reach(parameters: ShearParameters) -> float:
    """Reach of the lists of pairs [diameters], without their skin."""
    magnetic = parameters.law is not None and parameters.H > 0.0
    return max(parameters.width if magnetic else 0.0, NEAR)


def least_count(parameters: ShearParameters) -> int:
    """Grains that a cell of this fill needs so that none meets a neighbour twice."""
    return math.ceil((2.0 * (list_reach(parameters) + SKIN)) ** 3 * parameters.fill * 6.0 / math.pi)


class CellMagnetism:
    """Moments and magnetic forces of the grains of a DEM in a sheared box, in the macroscopic field (3,) [A/m].

    Forces come from moments and fields that belong together, and are held until the next look at them; the attraction
    of near pairs follows the gap of each step.

    Attributes
    ----------
    stress : ndarray, shape (3, 3)
        Stress of the held forces [Pa], as `particles.BoxStress` counts it.
    found : Magnetisation
        Of the last look.
    """

    found: Magnetisation

    def __init__(self, dem: DEM, solver: MutualMoments, applied: np.ndarray) -> None:
        assert dem.box is not None
        self.dem, self.box, self.solver = dem, dem.box, solver
        self.applied = np.tile(np.asarray(applied, dtype=float), (dem.grains.count, 1))
        self.near: NearAttraction | None = None
        if solver.near:
            self.near = NearAttraction(solver, [])
            self.near.attraction.near_gap = FARTHEST_GAP  # every near pair follows its gap: nothing of theirs is held
            self.near.attraction.listed = False
        self.stress = np.zeros((3, 3))
        self._rows: NeighbourRows | None = None
        self._necks: Necks | None = None
        self._of_list, self._strain = -1, 0.0

    def look(self, tolerance: float, max_sweeps: int) -> None:
        """Find moments and forces at the present places, beginning with the last ones."""
        dem, grains, solver = self.dem, self.dem.grains, self.solver
        dem.renew_list()
        position, radius, rows = np.array(grains.position), np.array(grains.radius), self.rows()
        found = solver.solve(
            position, radius, self.applied, rows, start=grains.dipole, necks=self._necks, number=grains.particle_id,
            tolerance=tolerance, max_sweeps=max_sweeps,
        )  # fmt: skip
        self.found, grains.magnetic_moment, grains.dipole = found, found.moment, found.dipole
        self._necks = solver.necks_of(found, grains.particle_id)
        held = solver.forces(position, radius, rows, found, attraction=False, virial=True)
        assert held.virial is not None
        self.stress = held.virial.T / self.box.volume
        if self.near is None:
            dem.external_force = held.force
        else:
            self.near.hold(dem, found, solver.forces(position, radius, rows, found).force)

    def rows(self) -> NeighbourRows:
        """Rows of neighbours of the present list of the DEM, made again with it and where they may miss a pair."""
        dem, box, reach = self.dem, self.box, self.solver.reach
        skin = dem.list_skin
        known = self._rows
        if known is not None and self._of_list == dem.list_version:
            nearer = box.approach(dem.grains.position, known.position, self._strain, reach + 0.5 * skin)
            if nearer <= skin:
                return replace(known, images=box.images)
        made = neighbour_rows(np.array(dem.grains.position), reach + skin, box)
        self._rows, self._of_list, self._strain = made, dem.list_version, box.strain
        return made

    @property
    def magnetisation(self) -> np.ndarray:
        """Mean of the grains' (3,) [A/m]."""
        return self.found.moment.sum(axis=0) / float(self.dem.grains.volume.sum())


class PowderCell:
    """One cell and its state; `run` shears it.

    Attributes
    ----------
    dem : DEM
    magnetism : CellMagnetism or None
    series : Series
    mu_r_at_rest : float
        Of the random packing before it is sheared.
    rate : float
        Shear rate [1/s].
    stress_estimate : float
        That the rate follows from [Pa].
    deepest, worst_residual : float
        Largest overlap over the diameter; largest residual of the moments.
    """

    def __init__(self, parameters: ShearParameters) -> None:
        p = self.parameters = parameters
        radius, mass = 0.5 * p.diameter, p.density * np.pi / 6.0 * p.diameter**3
        Ms = saturation(p.law) if p.law is not None and p.H > 0.0 else 0.0
        unit = MU_0 * Ms**2 * radius  # N/m
        near = p.model == "near_field"
        load = min(2.0 * np.pi * p.H / Ms, 0.7) * unit * radius if Ms else 0.0
        if Ms and not near:
            load *= min(1.0, (p.H / (DIPOLES_SUFFICE * Ms)) ** 1.2)
        self.stress_estimate = max(0.86 * p.fill * load / p.diameter**2 * 0.3, MIN_STRESS)
        soft = p.diameter * self.stress_estimate / OVERLAP
        stiffness = p.stiffness * max(load / (OVERLAP * p.diameter), NECK * 0.5 * np.pi * unit if near else 0.0, soft)
        contact = LinearContact.from_restitution(stiffness, p.restitution, p.friction)
        self.rate = p.inertial_number / (p.diameter * math.sqrt(p.density / self.stress_estimate))
        box, position = periodic_packing(p.count, p.diameter, p.fill, seed=p.seed)
        box.rate = self.rate
        spin = np.tile([0.0, 0.5 * self.rate, 0.0], (p.count, 1))  # grains turn with the flow
        grains = Grains.create(
            position, radius, p.density, velocity=box.flow(position[:, 2]), angular_velocity=spin
        )  # fmt: skip
        self.box = box
        self.dem = DEM(
            grains, [], [], contact, dt=contact.contact_time(0.5 * mass, 0.0, 0.0) / p.steps_per_contact,
            periodicity=box, rolling=RollingFriction(p.rolling) if p.rolling > 0.0 else None, skin=SKIN * p.diameter,
        )  # fmt: skip
        self.series = Series()
        self.deepest = self.worst_residual = 0.0
        self.magnetism: CellMagnetism | None = None
        self.mu_r_at_rest = 1.0
        if p.law is not None and p.H > 0.0:
            solver = MutualMoments(
                grain_table(p.law, p.model), near=near, reach=p.width * p.diameter, smear=True,
                smallest_gap=p.smallest_gap,
            )  # fmt: skip
            self.magnetism = CellMagnetism(self.dem, solver, np.array([0.0, 0.0, p.H]))
            self.magnetism.look(FIRST_TOLERANCE, MAX_SWEEPS)
            self.mu_r_at_rest = self.mu_r

    @property
    def mu_r(self) -> float:
        """Relative permeability 1 + phi M_z/H."""
        if self.magnetism is None:
            return 1.0
        return 1.0 + self.parameters.fill * float(self.magnetism.magnetisation[2]) / self.parameters.H

    def run(self, progress: Callable[[float], None] | None = None) -> Series:
        """Shear to the end of `parameters.strain`."""
        p = self.parameters
        total = max(1, round(p.strain / (self.rate * self.dem.dt)))
        looks = max(1, round(total / p.steps_per_look / p.windows))
        while self.box.strain < p.strain * (1.0 - 1e-9):
            self.window(looks)
            if progress is not None:
                progress(min(1.0, self.box.strain / p.strain))
        return self.series

    def window(self, looks: int) -> None:
        """Shear for some looks at the moments; adds a line to the series."""
        p, magnetism, volume = self.parameters, self.magnetism, self.box.volume
        contacts, near, held, motion = (np.zeros((3, 3)) for _ in range(4))
        mu_r = M_x = lost = touching = 0.0
        for _ in range(looks):
            if magnetism is not None:
                magnetism.look(TOLERANCE, MAX_SWEEPS)
                self.worst_residual = max(self.worst_residual, magnetism.found.residual)
                held += magnetism.stress / looks
                mu_r += self.mu_r / looks
                M_x += float(magnetism.magnetisation[0]) / looks
            totals = self.dem.run(p.steps_per_look)
            assert totals.stress is not None
            contacts += totals.stress.contacts / looks
            near += totals.stress.attraction / looks
            motion += totals.stress.motion / looks
            lost += sum(totals.energy_budget.dissipation.values())
            touching += totals.n_contacts / looks
            self.deepest = max(self.deepest, totals.max_overlap)
        whole, s = contacts + near + held + motion, self.series
        s.strain.append(self.box.strain)
        s.tau.append(-float(whole[0, 2]))
        s.tau_contacts.append(-float(contacts[0, 2]))
        s.tau_near.append(-float(near[0, 2]))
        s.tau_held.append(-float(held[0, 2]))
        s.tau_across.append(-float(whole[2, 0]))
        s.pressure.append(float(np.trace(whole)) / 3.0)
        s.power.append(lost / (looks * p.steps_per_look * self.dem.dt * self.rate * volume))
        s.contacts.append(2.0 * touching / p.count)
        s.mu_r.append(mu_r if magnetism is not None else 1.0)
        s.M_x.append(M_x)
