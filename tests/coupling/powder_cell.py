"""A sheared periodic box of magnetised powder by the parts of the coupled loop, without a scene: for tests of its laws.

The box flows along x with the gradient along z, the macroscopic field stands along z. Stiffness of contacts: an overlap
of 0.5 % of a diameter under the load of a chain along the field, and ten times the negative stiffness of a saturated
neck. Rate: from the inertial number I = rate d sqrt(rho/tau), with an estimate of tau.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import cast

import numpy as np

from coupling.coil_field import ImposedField
from coupling.effects.dipoles import Dipoles
from coupling.grain_law_table import FARTHEST_GAP, grain_table
from coupling.mutual_moments import MIN_GAP, MutualMoments
from coupling.mutually_magnetised_grains import MutuallyMagnetisedGrains
from coupling.near_attraction import NearAttraction
from coupling.sheared_means import BoxRow, MagnetisedBoxRow
from coupling.sheared_powder import chain_load, dem_in_box, expected_stress, grains_in_flow, min_edge
from coupling.staggered import Simulation, run_staggered
from coupling.window_row import WindowRow
from field import ParticleLaw, UniformField
from field.laws.powder_law import GrainLaw
from field.laws.reluctivity import MU_0, Law
from field.spheres.lone_sphere import saturation
from particles import DEM, LinearContact, PairLaws, RollingFriction, ShearedBox, periodic_packing
from particles.diagnostics.inertial_number import shear_rate_of

OVERLAP = 0.005  # of a diameter, under the load of a chain
NECK = 10.0  # contact stiffness over the neck's negative one
MIN_STRESS = 10.0  # Pa: rate of a cell without a field
FIRST_TOLERANCE, TOLERANCE = 1e-3, 1e-2  # of the moments, at rest and while the cell is sheared


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
    inertial_number: float = 5e-3
    friction: float
    rolling: float = 0.0
    restitution: float = 0.5
    smallest_gap: float = MIN_GAP
    width: float = 2.5
    steps_per_contact: float = 24.0
    steps_per_look: int = 8
    stiffness: float = 1.0
    diameter: float = 1e-4
    density: float = 7800.0


@dataclass(slots=True)
class Series:
    """Means over windows.

    Attributes
    ----------
    strain : at the windows' ends [-].
    tau, tau_contacts, tau_lagged, tau_near : the stress that a wall feels and its parts: contacts, lagged magnetic
        forces, near pairs' attraction [Pa].
    tau_across : force along z on a plane across x, without the macroscopic field's [Pa].
    pressure : a third of the trace of the same stress, positive where grains push [Pa].
    power : dissipated by contacts, over rate and volume [Pa].
    mu_r, M_x : relative permeability [-], grains' magnetisation along the flow [A/m].
    contacts : of a grain [-].
    """

    strain: list[float] = field(default_factory=list)
    tau: list[float] = field(default_factory=list)
    tau_contacts: list[float] = field(default_factory=list)
    tau_lagged: list[float] = field(default_factory=list)
    tau_near: list[float] = field(default_factory=list)
    tau_across: list[float] = field(default_factory=list)
    pressure: list[float] = field(default_factory=list)
    power: list[float] = field(default_factory=list)
    mu_r: list[float] = field(default_factory=list)
    M_x: list[float] = field(default_factory=list)
    contacts: list[float] = field(default_factory=list)


def min_count(parameters: ShearParameters) -> int:
    """Grains that a cell of this fill needs so that none meets a neighbour twice."""
    magnetic = parameters.law is not None and parameters.H > 0.0
    return math.ceil(min_edge(parameters.width if magnetic else None) ** 3 * parameters.fill * 6.0 / math.pi)


class PowderCell:
    """One cell and its state; `window` shears it.

    Attributes
    ----------
    box : ShearedBox
    dem : DEM
    simulation : Simulation
        What the loop moves.
    magnetism : MutuallyMagnetisedGrains or None
    series : Series
    mu_r_at_rest : float
        Of the random packing before it is sheared.
    rate : float
        Shear rate [1/s].
    stress_estimate : float
        That the rate follows from [Pa].
    """

    def __init__(self, parameters: ShearParameters) -> None:
        p = self.parameters = parameters
        if p.count < min_count(p):
            raise ValueError(
                f"{p.count} grains at a fill of {p.fill:g} are too few: a grain would meet a neighbour twice; take at "
                f"least {min_count(p)}"
            )
        Ms = saturation(p.law) if p.law is not None and p.H > 0.0 else 0.0
        near = p.model == "near_field"
        load = chain_load(Ms, p.H, p.diameter, necks=near)
        self.stress_estimate = max(expected_stress(load, p.fill, p.diameter), MIN_STRESS)
        soft = p.diameter * self.stress_estimate / OVERLAP
        neck = NECK * 0.5 * np.pi * MU_0 * Ms**2 * 0.5 * p.diameter if near else 0.0
        contact = LinearContact.from_restitution(
            p.stiffness * max(load / (OVERLAP * p.diameter), neck, soft), p.restitution, p.friction
        )  # fmt: skip
        self.rate = shear_rate_of(p.inertial_number, p.diameter, p.density, self.stress_estimate)
        box, position = periodic_packing(p.count, p.diameter, p.fill, seed=p.seed)
        box.rate = self.rate
        grains = grains_in_flow(box, position, 0.5 * p.diameter, p.density)
        mass = float(grains.mass[0])
        laws = PairLaws.of_one(contact, rolling=RollingFriction(p.rolling) if p.rolling > 0.0 else None)
        dt = contact.contact_time(0.5 * mass, 0.0, 0.0) / p.steps_per_contact
        self.box: ShearedBox = box
        self.dem: DEM = dem_in_box(box, grains, laws, dt)
        self.simulation = Simulation(self.dem, [], None, None, p.steps_per_look, 1)
        self.series = Series()
        self.magnetism: MutuallyMagnetisedGrains | None = None
        self.mu_r_at_rest = 1.0
        if Ms and p.law is not None:
            solver = MutualMoments(
                grain_table(p.law, p.model), near=near, reach=p.width * p.diameter, smear=True,
                smallest_gap=p.smallest_gap,
            )  # fmt: skip
            self.magnetism = magnetise(self.simulation, solver, (0.0, 0.0, p.H), p.law)
            self.magnetism.tolerance = TOLERANCE
            self.mu_r_at_rest = self.mu_r

    @property
    def mu_r(self) -> float:
        """Relative permeability 1 + phi M_z/H."""
        moment = self.dem.grains.magnetic_moment
        if self.magnetism is None or moment is None:
            return 1.0
        return 1.0 + float(moment[:, 2].sum()) / (self.box.volume * self.parameters.H)

    def window(self, looks: int) -> None:
        """Shear for some looks at the moments; adds a line to the series."""
        self.simulation.steps = looks * self.simulation.steps_per_update
        steps = self.dem.step_count + self.simulation.steps
        run_staggered(self.simulation, steps * self.dem.dt, [self._add])

    def _add(self, simulation: Simulation, row: WindowRow) -> None:
        """Add a window to the series."""
        means, magnetised, s = row.part(BoxRow), row.part(MagnetisedBoxRow), self.series
        assert means is not None and row.energy is not None
        s.strain.append(means.shear_strain)
        s.tau.append(means.shear_stress)
        s.tau_contacts.append(means.shear_stress_contacts)
        s.tau_near.append(0.0 if magnetised is None else magnetised.shear_stress_near)
        s.tau_lagged.append(0.0 if magnetised is None else magnetised.shear_stress_lagged)
        s.tau_across.append(means.shear_stress_across)
        s.pressure.append(means.pressure)
        s.power.append(row.energy.dissipated / (row.steps * self.dem.dt * self.rate * self.box.volume))
        s.contacts.append(means.contacts_per_grain)
        s.mu_r.append(1.0 if magnetised is None else magnetised.relative_permeability)
        s.M_x.append(0.0 if magnetised is None else magnetised.magnetisation_along_flow)


def magnetise(
    simulation: Simulation, solver: MutualMoments, H: tuple[float, float, float], law: GrainLaw | Law
) -> MutuallyMagnetisedGrains:
    """Put the grains of a DEM in a sheared box into the macroscopic field H (3,) [A/m], and find their moments."""
    near = NearAttraction(solver, [], FARTHEST_GAP) if solver.near else None
    source = ImposedField(UniformField(H))
    magnetised = MutuallyMagnetisedGrains(
        source.sampler, cast(ParticleLaw, law), solver=solver, tolerance=FIRST_TOLERANCE, near=near
    )
    simulation.effects, simulation.magnetised, simulation.source = [Dipoles()], magnetised, source
    magnetised.update(simulation)
    return magnetised
