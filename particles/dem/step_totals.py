"""What a call of `DEM.run` did: torques, work, losses, extremes.

All energies, works, torques and forces are those of the whole device: a sector's times the number of sectors.

**Bookkeeping.** `contact_work` is the work of the contact forces on the grains, taken with the mean of old
and new velocity, so that kinetic_change = contact_work + gravity_work + external_work to round-off. Shafts
put in sum(wall_work); what is neither passed on nor stored is lost: `dissipated` = sum(wall_work) -
contact_work - elastic_change, exact by definition. `dissipation` splits the loss by mechanism, each
computed on its own at the contact from the half step before the force; its sum agrees with `dissipated` to
first order in dt.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class StepTotals:
    """Sums and means over ``steps`` steps.

    Attributes
    ----------
    steps, duration : int, float
        Steps done and the time they span [s].
    torque : dict of body -> {"normal", "tangential"}
        Mean torque about z on the body [N m].
    force : dict of body -> ndarray, shape (3,)
        Mean force on the body [N]; in a sector only the axial one is left, the others cancel round the ring.
    wall_work : dict of body -> float
        Work that the body's turning did on the grains [J].
    shaft_work : dict of body -> {"drive", "load"}
        For free shafts: work put in by drive and external torque, and taken by the load [J].
    dissipation : dict
        "normal_damping", "tangential_damping", "sliding", with rolling friction also "rolling" [J].
    contact_work, gravity_work, external_work : float
        Work on the grains [J].
    kinetic_energy, kinetic_change, elastic_energy, elastic_change : float
        At the end, and against the beginning [J]; elastic energy belongs to the last evaluation of the
        forces.
    max_overlap : float
        Largest overlap, as a share of the (smaller) grain's diameter [-].
    n_contacts : int
        Contacts at the last step in what is simulated (one sector).
    max_speed : float
        Largest speed of a grain [m/s].
    rebuilds : int
        Neighbour lists made.
    """

    steps: int
    duration: float
    torque: dict[str, dict[str, float]]
    force: dict[str, np.ndarray]
    wall_work: dict[str, float]
    shaft_work: dict[str, dict[str, float]]
    dissipation: dict[str, float]
    contact_work: float
    gravity_work: float
    external_work: float
    kinetic_energy: float
    kinetic_change: float
    elastic_energy: float
    elastic_change: float
    max_overlap: float
    n_contacts: int
    max_speed: float
    rebuilds: int

    @property
    def dissipated(self) -> float:
        """Energy lost in contacts [J], from the balance (module docstring)."""
        return sum(self.wall_work.values()) - self.contact_work - self.elastic_change

    def torque_on(self, body: str) -> float:
        """Mean torque about z on ``body`` [N m], normal and tangential together."""
        return self.torque[body]["normal"] + self.torque[body]["tangential"]
