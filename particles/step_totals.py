"""Totals of a call of `DEM.run`: torques, work, losses, extremes.

All energies, works, torques and forces are those of the whole device: a sector's times the number of sectors.

**Bookkeeping.** Everything belongs to the time of the positions that the last forces were taken at. Velocities stand
half a step before and half a step behind it, v- and v+; the kinetic energy there is 1/2 m v-.v+, which with a linear
spring's energy a leapfrog conserves. A step's work is that of the drift before it, by the mean of the last and the
present force. With this, kinetic_change = contact_work + gravity_work + external_work to round-off. Shafts put in
sum(wall_work); what is neither passed on nor stored is lost: `EnergyTotals.dissipated` = sum(wall_work) - contact_work
- elastic_change, exact by definition. `EnergyTotals.dissipation` splits the loss by mechanism, each computed on its own
at the contact by the same rule; its sum converges to `dissipated` with the step, and the difference is what the
integration has lost or won.

In a sheared box velocities and energies are peculiar: less its flow. The shear works on the grains through contacts,
lagged attraction and their own motion, -rate V sigma_xz each; then kinetic_change also has the work through motion,
and `EnergyTotals.dissipated` the work through contacts.
"""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np


@dataclass(frozen=True, slots=True)
class EnergyTotals:
    """The energy budget over some steps [J].

    Attributes
    ----------
    wall_work : dict of body -> float
        Work that the body's turning did on the grains.
    dissipation : dict
        "normal_damping", "tangential_damping", "sliding", where they are simulated also "rolling", "twisting".
    contact_work, gravity_work, external_work : float
        Work on the grains.
    kinetic_energy, kinetic_change, elastic_energy, elastic_change : float
        At the end, and against the beginning.
    shear_work : dict
        Work of the shear through "contacts", "attraction" and "motion"; empty outside of a sheared box.
    """

    wall_work: dict[str, float]
    dissipation: dict[str, float]
    contact_work: float
    gravity_work: float
    external_work: float
    kinetic_energy: float
    kinetic_change: float
    elastic_energy: float
    elastic_change: float
    shear_work: dict[str, float] = field(default_factory=dict)

    @property
    def dissipated(self) -> float:
        """Energy lost in contacts, from the balance (module docstring)."""
        put_in = sum(self.wall_work.values()) + self.shear_work.get("contacts", 0.0)
        return put_in - self.contact_work - self.elastic_change

    @property
    def integration_error(self) -> float:
        """Difference of the balance and the mechanisms: the step's error, of either sign, second order in dt."""
        return self.dissipated - sum(self.dissipation.values())


@dataclass(frozen=True, slots=True)
class BoxStress:
    """Mean stress in a sheared box over some steps, compression positive.

    The parts of sigma_ab = (1/V) [sum over pairs F_a r_b + sum over grains m p_a p_b], with F on the grain at r from
    its partner and p the velocity less the flow's: a is the direction of the force, b that of the face.

    Attributes
    ----------
    contacts, attraction, motion : ndarray, shape (3, 3)
        [Pa]; `attraction` is the lagged one (`particles.attraction`), other lagged forces are not known here.
    """

    contacts: np.ndarray
    attraction: np.ndarray
    motion: np.ndarray

    @property
    def total(self) -> np.ndarray:
        """[Pa]"""
        return self.contacts + self.attraction + self.motion

    @property
    def shear(self) -> float:
        """Force along the flow that holds it back, per area across the gradient, -sigma_xz [Pa]."""
        return -float(self.total[0, 2])

    @property
    def pressure(self) -> float:
        """A third of the trace [Pa]."""
        return float(np.trace(self.total)) / 3.0


@dataclass(frozen=True, slots=True)
class StepTotals:
    """Sums and means over ``steps`` steps.

    Attributes
    ----------
    steps, duration : int, float
        Steps done and the time they span [s].
    torque : dict of body -> {"normal", "damping", "tangential"}
        Mean torque about z on the body [N m]: of the springs along the normals, of the dashpots parallel to them, and
        of friction with rolling and twisting torques.
    force : dict of body -> ndarray, shape (3,)
        Mean force on the body [N]; in a sector only the axial one is left, the others cancel round the ring.
    shaft_work : dict of body -> {"drive", "load", "contact"}
        For free shafts: work put in by drive and external torque, taken by the load, and put in by the grains [J].
    energy : EnergyTotals or None
        None where the energy budget is not kept (``DEM(energy_budget=False)``).
    max_overlap : float
        Largest overlap, as a fraction of the (smaller) grain's diameter [-].
    n_contacts : int
        Contacts at the last step in what is simulated (one sector).
    max_speed : float
        Largest speed of a grain [m/s].
    rebuilds : int
        Neighbour lists made.
    stress : BoxStress or None
        In a sheared box; None outside of one.
    """

    steps: int
    duration: float
    torque: dict[str, dict[str, float]]
    force: dict[str, np.ndarray]
    shaft_work: dict[str, dict[str, float]]
    energy: EnergyTotals | None
    max_overlap: float
    n_contacts: int
    max_speed: float
    rebuilds: int
    stress: BoxStress | None

    @property
    def energy_budget(self) -> EnergyTotals:
        """The energy budget.

        Raises
        ------
        ValueError
            Where it was not kept.
        """
        if self.energy is None:
            raise ValueError("the energy budget was not kept; make the DEM with energy_budget=True")
        return self.energy

    def torque_on(self, body: str) -> float:
        """Mean torque about z on ``body`` [N m], all its parts together."""
        return sum(self.torque[body].values())


def force_on_ring(force: np.ndarray, ring: int) -> np.ndarray:
    """Return a force on the whole ring (3,) [N], changed in place: of several sectors only its axial part is left."""
    if ring > 1:
        force[:2] = 0.0
    return force
