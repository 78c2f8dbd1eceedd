r"""Steady shear of a magnetised powder between walls that are not there: stress and permeability from first principles.

The cell (`coupling.sheared_cell.cell`) flows along x with the gradient along z, the macroscopic field stands along z:
chains cross the flow, as in a clutch. Equal grains with a linear contact law and friction; no weight, no fluid.

**Stress.** The one that a wall feels is the force along x on a plane across z. By momentum balance it is that of all
pairs whose line crosses the plane,

    tau = -(1/V) [sum over pairs r_z F_x + sum m V_x V_z],

F on the grain at r from its partner: contacts, dipoles less the smear, the attraction of near pairs and their torques.
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
from dataclasses import dataclass, field

import numpy as np

from coupling.grain_law_table import grain_table
from coupling.mutual_moments import MIN_GAP
from coupling.sheared_cell import step_kernel as column
from coupling.sheared_cell.cell import CellPairs, cell_pairs
from coupling.sheared_cell.cell_moments import CellMoments
from coupling.sheared_cell.held_forces import NEAR
from coupling.sheared_cell.near_pull import N_GRIP
from coupling.sheared_cell.random_cell import random_cell
from coupling.sheared_cell.step_kernel import CellGrains, Flow, FollowedPairs, NearPull, shear_steps
from field.laws.powder_law import GrainLaw
from field.laws.reluctivity import MU_0, Law
from field.spheres.lone_sphere import saturation
from particles import LinearContact
from particles.laws.columns import DAMPING_N, DAMPING_T
from particles.laws.linear import EqualLinearTable

SKIN = 0.3  # of the lists, in diameters
OVERLAP = 0.005  # of a diameter, under the load of a chain
NECK = 10.0  # contact stiffness over the neck's negative one
DIPOLES_SUFFICE = 0.15  # of Ms: the field above which a chain of mutual dipoles holds as strongly as one with necks
MIN_STRESS = 10.0  # Pa: rate of a cell without a field
FIRST_TOLERANCE = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class ShearParameters:
    """Parameters of a run; lengths in diameters, everything else in SI.

    Attributes
    ----------
    law : GrainLaw or Law or None
        Of the grains' material; None: no magnetism.
    fill, H : float
        Solid fraction [-]; macroscopic field [A/m], along z.
    friction : float
        Coulomb coefficient of the grains [-].
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
    tau, tau_contacts, tau_held, tau_near : the stress that a wall feels and its parts: contacts, dipoles with torques,
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


class Shear:
    """One cell and its state; `run` shears it.

    Attributes
    ----------
    series : Series
    mu_r_at_rest : float
        Of the random packing before it is sheared.
    """

    def __init__(self, parameters: ShearParameters) -> None:
        p = self.parameters = parameters
        self.radius = 0.5 * p.diameter
        self.mass = p.density * np.pi / 6.0 * p.diameter**3
        Ms = saturation(p.law) if p.law is not None and p.H > 0.0 else 0.0
        unit = MU_0 * Ms**2 * self.radius  # N/m
        near = p.model == "near_field"
        load = min(2.0 * np.pi * p.H / Ms, 0.7) * unit * self.radius if Ms else 0.0
        if Ms and not near:
            load *= min(1.0, (p.H / (DIPOLES_SUFFICE * Ms)) ** 1.2)
        self.stress_estimate = max(0.86 * p.fill * load / p.diameter**2 * 0.3, MIN_STRESS)
        soft = p.diameter * self.stress_estimate / OVERLAP
        stiffness = p.stiffness * max(load / (OVERLAP * p.diameter), NECK * 0.5 * np.pi * unit if near else 0.0, soft)
        self.contact = LinearContact.from_restitution(stiffness, p.restitution, p.friction)
        self.rate = p.inertial_number / (p.diameter * math.sqrt(p.density / self.stress_estimate))
        self.dt = self.contact.contact_time(0.5 * self.mass, 0.0, 0.0) / p.steps_per_contact
        self.box, self.position = random_cell(p.count, p.diameter, p.fill, seed=p.seed)
        self.velocity = np.zeros((p.count, 3))
        self.velocity[:, 0] = self.rate * self.position[:, 2]
        self.spin = np.zeros((p.count, 3))
        self.spin[:, 1] = 0.5 * self.rate  # grains turn with the flow
        self.strain, self.steps, self.lists = 0.0, 0, 0
        self.series = Series()
        self.deepest = self.fastest = self.worst_residual = 0.0
        self.moments: CellMoments | None = None
        self.mu_r_at_rest = 1.0
        gamma = 2.0 * np.sqrt(stiffness * 0.5 * self.mass)
        row = self.contact.row()
        row[[DAMPING_N, DAMPING_T]] *= gamma
        self._law = EqualLinearTable(row[None, :])
        self._touching, self._history = np.zeros(0, dtype=np.int8), np.zeros((0, column.N_HISTORY))
        self._key = np.zeros(0, dtype=np.int64)
        model = p.model if p.law is not None else "mutual"
        self._table = grain_table(p.law if p.law is not None else GrainLaw(1.0), model)
        if Ms:
            self.moments = CellMoments(
                self.box, self._table, near=p.model == "near_field", reach=p.width * p.diameter,
                smallest_gap=p.smallest_gap, field=np.array([0.0, 0.0, p.H]), radius=self.radius, count=p.count,
            )  # fmt: skip
        self._look_reach = list_reach(p) * p.diameter
        self._make_lists()
        if self.moments is not None:
            self.moments.settle(self.position, self.offset, FIRST_TOLERANCE)
            self.mu_r_at_rest = self.mu_r
            self.moments.hold(self.position, self.offset)

    @property
    def offset(self) -> float:
        """Displacement of the cell above, wrapped when the lists were made [m]."""
        return self._offset_then + (self.strain - self._pairs.strain) * self.box.lengths[2]

    @property
    def mu_r(self) -> float:
        """Relative permeability 1 + phi M_z/H."""
        if self.moments is None:
            return 1.0
        return 1.0 + self.parameters.fill * float(self.moments.magnetisation[2]) / self.parameters.H

    def run(self, progress: Callable[[float], None] | None = None) -> Series:
        """Shear to the end of `parameters.strain`."""
        p = self.parameters
        total = max(1, round(p.strain / (self.rate * self.dt)))
        looks = max(1, round(total / p.steps_per_look / p.windows))
        while self.strain < p.strain * (1.0 - 1e-9):
            self.window(looks)
            if progress is not None:
                progress(min(1.0, self.strain / p.strain))
        return self.series

    def window(self, looks: int) -> None:
        """Shear for some looks at the moments; adds a line to the series."""
        p, sums = self.parameters, np.zeros(column.N_SUMS)
        held, steps = np.zeros((3, 3)), 0
        mu_r = M_x = 0.0
        for _ in range(looks):
            if self._lists_are_old():
                self._make_lists()
            if self.moments is not None:
                self.moments.sweep(self.position, self.offset)
                self.moments.hold(self.position, self.offset)
                self.worst_residual = max(self.worst_residual, self.moments.residual)
                held += self.moments.stress * p.steps_per_look
                mu_r += self.mu_r / looks
                M_x += float(self.moments.magnetisation[0]) / looks
            self.advance(p.steps_per_look, sums)
            steps += p.steps_per_look
        if not np.all(np.isfinite(self.position)):
            raise FloatingPointError("the grains of the sheared cell have gone astray: shorten the step")
        scale = -1.0 / (steps * self.box.volume)
        s = self.series
        lost = float(sums[column.LOST_NORMAL : column.LOST_SLIDING + 1].sum())
        tau = scale * (sums[column.CONTACT_ZX] + sums[column.NEAR_ZX] + sums[column.KINETIC_ZX] + held[2, 0])
        s.strain.append(self.strain)
        s.tau.append(tau)
        s.tau_contacts.append(scale * sums[column.CONTACT_ZX])
        s.tau_near.append(scale * sums[column.NEAR_ZX])
        s.tau_held.append(scale * held[2, 0])
        s.tau_across.append(scale * (sums[column.CONTACT_XZ] + sums[column.NEAR_ZX] + held[0, 2]))
        s.pressure.append(-scale * (sums[column.CONTACT_ALL] + sums[column.NEAR_ALL] + np.trace(held)) / 3.0)
        s.power.append(lost / (steps * self.dt * self.rate * self.box.volume))
        s.contacts.append(2.0 * sums[column.CONTACTS] / (steps * p.count))
        s.mu_r.append(mu_r if self.moments is not None else 1.0)
        s.M_x.append(M_x)
        self.deepest = max(self.deepest, float(sums[column.DEEPEST]) / p.diameter)
        self.fastest = max(self.fastest, math.sqrt(sums[column.FASTEST]))

    def advance(self, steps: int, sums: np.ndarray) -> None:
        """Steps with what is held; ``sums`` see `step_kernel`."""
        m = self.moments
        held, grip = (self._nothing, self._no_grip) if m is None else (m.held, m.grip)
        shear_steps(
            steps, self.dt, Flow(np.array(self.box.lengths), self.offset, self.rate),
            CellGrains(self.position, self.velocity, self.spin, held, self.radius, self.mass),
            FollowedPairs(self._first, self._second, self._image, self._history, self._touching, grip), self._law,
            NearPull(self._table, m is not None and m.near, self.parameters.smallest_gap), sums,
        )  # fmt: skip
        self.steps += steps
        self.strain += steps * self.dt * self.rate

    def _lists_are_old(self) -> bool:
        """True if a pair may have come into reach: by what grains moved beside the flow, and the flow itself."""
        strained = self.strain - self._pairs.strain
        moved = self.position - self._pairs.position
        moved[:, 0] -= strained * (self._pairs.position[:, 2] + 0.5 * moved[:, 2])
        farthest = math.sqrt(float(np.einsum("ij,ij->i", moved, moved).max()))
        d = self.parameters.diameter
        # a quarter is kept for the steps until this is asked again
        return 2.0 * farthest + strained * (self._look_reach + SKIN * d) > 0.75 * SKIN * d

    def _make_lists(self) -> None:
        p = self.parameters
        d, n = p.diameter, p.count
        offset = self.strain * self.box.lengths[2] % self.box.lengths[0]
        self._offset_then = offset
        self.box.wrap(self.position, self.velocity, offset, self.rate)
        self._pairs: CellPairs = cell_pairs(self.box, self.position, self._look_reach + SKIN * d, self.strain)
        if self.moments is None:
            shift = self.box.image_shift(self._pairs.image.astype(float), offset)
            r = self.position[self._pairs.first] - self.position[self._pairs.second] - shift
            chosen = np.flatnonzero(np.einsum("ij,ij->i", r, r) < ((1.0 + SKIN) * d) ** 2)
            self._nothing, self._no_grip = np.zeros((n, 3)), np.zeros((len(chosen), N_GRIP))
        else:
            self.moments.follow(self._pairs)
            chosen = self.moments.choose_near(self.position, offset, SKIN * d)
        self._first, self._second = self._pairs.first[chosen], self._pairs.second[chosen]
        self._image = self._pairs.image[chosen].astype(float)
        # springs go with their pair, whatever its image is now
        key = self._first.astype(np.int64) * n + self._second
        history, touching = np.zeros((len(key), column.N_HISTORY)), np.zeros(len(key), dtype=np.int8)
        _, new, old = np.intersect1d(key, self._key, return_indices=True)
        history[new], touching[new] = self._history[old], self._touching[old]
        self._key, self._history, self._touching = key, history, touching
        self.lists += 1
