r"""Means of a window in a sheared box (`particles.sheared_box`): strain, stress, contacts, magnetisation.

**Stress.** The one that a wall across z feels is the force on a plane across z. By momentum balance it is that of all
pairs whose line crosses the plane, and of the momentum that grains carry through it,

    sigma_ab = (1/V) [sum over pairs F_a r_b + sum over grains m p_a p_b],      tau = -sigma_xz,

F on the grain at r from its partner, p the peculiar velocity (less the flow's), compression positive: contacts, the
attraction of near pairs that follows the gap of each step, and the magnetic forces that lag between two evaluations.
Contacts alone do not have this stress, and pairs with torques do not have F_x r_z = F_z r_x: the field's torque
mu_0 M x H stands between tau_zx and tau_xz (`BoxRow.shear_stress` and `BoxRow.shear_stress_across`). With the
macroscopic field H along z two things do *not* come on top:

- the macroscopic Maxwell stress across z, B_z H_x, is 0 (H_x is continuous, and 0 at the steel). Its partner
  B_x H_z = mu_0 M_x H_z is the force along z on a plane across x; no wall stands there;
- of the forces of smeared grains on grains: those above a plane are a layer of the even magnetisation M S(z), whose
  field is H_z(z) only; it has no gradient along x, hence no F_x = mu_0 (m_z dH_x/dz + m_x dH_x/dx) across the plane.

The normal stress across z has the pull of B_z^2 - (mu_0 H_z)^2 on the steel besides, which is not in it.

**Work.** The shear works V tau on the grains for each unit of strain. Of the part through the magnetic forces,
dW/dgamma = V tau_magnetic, what does not stay in the grains' energy W is their work on the peculiar motion.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coupling.magnetised_grains import MagnetisedGrains
from particles import GrainMotion, ShearedBox, StepTotals


@dataclass(frozen=True, slots=True)
class BoxRow:
    """A sheared box in a window; stresses and contacts are means over it [Pa].

    Attributes
    ----------
    shear_strain, solid_fraction : float
        At the window's end [-].
    shear_stress, shear_stress_contacts : float
        Force along the flow on a plane across the gradient, and what contacts have of it.
    shear_stress_across : float
        Force along the gradient on a plane across the flow, without the macroscopic field's.
    normal_stress_x, normal_stress_y, normal_stress_z : float
        Positive where grains push; x is along the flow, z along the gradient.
    contacts_per_grain : float
        [-]
    """

    shear_strain: float
    solid_fraction: float
    shear_stress: float
    shear_stress_contacts: float
    shear_stress_across: float
    normal_stress_x: float
    normal_stress_y: float
    normal_stress_z: float
    contacts_per_grain: float

    @property
    def pressure(self) -> float:
        """A third of the trace [Pa]."""
        return (self.normal_stress_x + self.normal_stress_y + self.normal_stress_z) / 3.0


@dataclass(frozen=True, slots=True)
class GapRow:
    """Powder between two faces in a window; stresses and contacts are means over it [Pa].

    Attributes
    ----------
    shear_strain, solid_fraction : float
        At the window's end [-].
    shear_stress, shear_stress_lower, shear_stress_upper : float
        Friction on the faces against their motion over their area: of both on average, and of each.
    normal_stress_z : float
        Pressure of the contacts on the faces, both on average. The field pulls on them besides.
    contacts_per_grain : float
        Twice the contacts over the grains, those with faces included [-].
    relative_permeability : float
        1 + phi M_z/H_z [-].
    """

    shear_strain: float
    solid_fraction: float
    shear_stress: float
    shear_stress_lower: float
    shear_stress_upper: float
    normal_stress_z: float
    contacts_per_grain: float
    relative_permeability: float


@dataclass(frozen=True, slots=True)
class MagnetisedBoxRow:
    """Magnetised grains of a sheared box in a window, means over it.

    Attributes
    ----------
    shear_stress_near, shear_stress_lagged : float
        Parts of `BoxRow.shear_stress` [Pa]: the attraction of near pairs, and the lagged magnetic forces.
    relative_permeability : float
        1 + phi M.H/H^2 [-].
    magnetisation_along_flow : float
        Of the grains [A/m].
    """

    shear_stress_near: float
    shear_stress_lagged: float
    relative_permeability: float
    magnetisation_along_flow: float


class ShearedMeans:
    """Integrals over one window; `rows` are its means.

    Parameters
    ----------
    motion : GrainMotion
        In a sheared box.
    magnetised : MagnetisedGrains or None
    """

    def __init__(self, motion: GrainMotion, magnetised: MagnetisedGrains | None) -> None:
        assert motion.box is not None
        self._motion, self._magnetised, self._box = motion, magnetised, motion.box
        self._contacts, self._near, self._lagged, self._carried = (np.zeros((3, 3)) for _ in range(4))
        self._permeability = self._along_flow = self._touching = 0.0
        self._duration = 0.0
        self.shear_work_magnetic = self.stretch_work = self.stretch_work_magnetic = 0.0
        """Work [J] so far of the shear through magnetic forces, of the stretch, and its part through magnetic forces.
        """

    def add_steps(self, totals: StepTotals) -> None:
        """Add the totals of a sub-cycle, during which the present lagged forces acted."""
        assert totals.stress is not None
        lasted = totals.duration
        self._duration += lasted
        self._contacts += lasted * totals.stress.contacts
        self._near += lasted * totals.stress.attraction
        self._carried += lasted * totals.stress.motion
        self._touching += lasted * 2.0 * totals.n_contacts / self._motion.grains.count
        if self._magnetised is not None:
            self._add_moments(self._magnetised, totals)

    def add_stretch(self, totals: StepTotals, change: float) -> None:
        """Add the work of a change of the volume [m^3] that follows steps: -sigma_zz of all forces for each unit of it.

        Peculiar velocities stay, so the momentum that grains carry by their motion has no part in it.
        """
        assert totals.stress is not None
        magnetic = float(totals.stress.attraction[2, 2])
        if self._magnetised is not None:
            magnetic += float(self._magnetised.lagged_stress[2, 2])
        self.stretch_work_magnetic -= magnetic * change
        self.stretch_work -= (float(totals.stress.contacts[2, 2]) + magnetic) * change

    def _add_moments(self, magnetised: MagnetisedGrains, totals: StepTotals) -> None:
        assert totals.stress is not None
        grains, box, lagged = self._motion.grains, self._box, magnetised.lagged_stress
        self._lagged += totals.duration * lagged
        tau = -float(lagged[0, 2] + totals.stress.attraction[0, 2])
        self.shear_work_magnetic += box.rate * box.volume * totals.duration * tau
        assert grains.magnetic_moment is not None  # of the evaluation before the steps
        moment, H = grains.magnetic_moment.sum(axis=0), magnetised.H.mean(axis=0)
        permeability = 1.0 + (float(moment @ H) / (box.volume * float(H @ H)) if H.any() else 0.0)
        self._permeability += totals.duration * permeability
        self._along_flow += totals.duration * float(moment[0]) / float(grains.volume.sum())

    def rows(self) -> tuple[BoxRow, MagnetisedBoxRow | None]:
        """Return the means over the window."""
        per_time, box = 1.0 / self._duration, self._box
        stress = per_time * (self._contacts + self._near + self._lagged + self._carried)
        row = BoxRow(
            shear_strain=box.strain,
            solid_fraction=solid_fraction(self._motion, box),
            shear_stress=-float(stress[0, 2]),
            shear_stress_contacts=-per_time * float(self._contacts[0, 2]),
            shear_stress_across=-float(stress[2, 0]),
            normal_stress_x=float(stress[0, 0]),
            normal_stress_y=float(stress[1, 1]),
            normal_stress_z=float(stress[2, 2]),
            contacts_per_grain=per_time * self._touching,
        )
        if self._magnetised is None:
            return row, None
        return row, MagnetisedBoxRow(
            shear_stress_near=-per_time * float(self._near[0, 2]),
            shear_stress_lagged=-per_time * float(self._lagged[0, 2]),
            relative_permeability=per_time * self._permeability,
            magnetisation_along_flow=per_time * self._along_flow,
        )


class GapMeans:
    """Integrals over one window of powder between two faces; `rows` are its means.

    Parameters
    ----------
    motion : GrainMotion
        In a `particles.GapBox`.
    H : float
        The macroscopic field along z [A/m]; 0: the grains are not magnetised.
    """

    def __init__(self, motion: GrainMotion, H: float) -> None:
        assert motion.gap_box is not None
        self._motion, self._box, self._H = motion, motion.gap_box, H
        self._force = {body.name: np.zeros(3) for body in motion.bodies}
        self._duration = self._touching = self._moment = 0.0

    def add_steps(self, totals: StepTotals) -> None:
        """Add the totals of a sub-cycle."""
        lasted, moment = totals.duration, self._motion.grains.magnetic_moment
        self._duration += lasted
        self._touching += lasted * 2.0 * totals.n_contacts / self._motion.grains.count
        for name, force in self._force.items():
            force += lasted * totals.force[name]
        if moment is not None:
            self._moment += lasted * float(moment[:, 2].sum())

    def rows(self) -> tuple[GapRow]:
        """Return the means over the window."""
        box, per_time = self._box, 1.0 / self._duration
        lower, upper = (per_time * self._force[name] / np.prod(box.lengths[:2]) for name in ("lower", "upper"))
        magnetisation = per_time * self._moment / box.volume
        row = GapRow(
            shear_strain=box.rate * self._motion.time,
            solid_fraction=solid_fraction(self._motion, box),
            shear_stress=0.5 * float(lower[0] - upper[0]),
            shear_stress_lower=float(lower[0]),
            shear_stress_upper=-float(upper[0]),
            normal_stress_z=0.5 * float(upper[2] - lower[2]),
            contacts_per_grain=per_time * self._touching,
            relative_permeability=1.0 + (magnetisation / self._H if self._H else 0.0),
        )
        return (row,)


def solid_fraction(motion: GrainMotion, box: ShearedBox) -> float:
    """Volume of the grains over that of the box [-]."""
    return float(motion.grains.volume.sum()) / box.volume
