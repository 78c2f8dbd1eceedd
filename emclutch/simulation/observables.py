"""Observables of a window besides the balances: coil, gap and dimensionless numbers.

Fill and inertial number belong to a gap that is sheared as a whole. A box has none, and neither has a centrifugal
clutch: its shot is a heap in front of each vane, a thin ring, or at rest between the vanes, and what says how it
transmits are the speeds and torques of the balances. Their histories have no such columns.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi, sqrt

import numpy as np

from coupling import Simulation, WindowRow
from emclutch.device.device import Device, field_is_needed
from emclutch.device.pole_zone import pole_zone
from field.solved_field import SolvedField
from geometry import AnnularBox, Clutch, ShearCell


@dataclass(frozen=True, slots=True)
class FieldRow:
    """The coil's field in a window.

    Attributes
    ----------
    flux_linkage : float
        Of all turns [Wb].
    field_energy : float
        [J]
    gap_flux_density : float
        Mean |B| in the gap [T].
    field_iterations, field_residual : int, float
        Newton's, of the last solve.
    """

    flux_linkage: float
    field_energy: float
    gap_flux_density: float
    field_iterations: int
    field_residual: float


@dataclass(frozen=True, slots=True)
class PoleField:
    """Mean |H| [A/m] of the macroscopic field between the pole faces."""

    field_strength_powder: float


@dataclass(frozen=True, slots=True)
class PoleFill:
    """Solid fraction between the pole faces."""

    fill_powder: float


@dataclass(frozen=True, slots=True)
class GapRow:
    """The sheared gap: its solid fraction, and the inertial number, None where no torque gives a pressure."""

    solid_fraction_gap: float
    inertial_number: float | None


class Observables:
    """Measure of the loop: it adds field quantities, fill and inertial number to each row."""

    def __init__(self, scene, device: Device):
        self._scene = scene
        self._device = device
        self._seen_solution: object = None
        self._of_the_field: list[FieldRow | PoleField] = []
        self._zone = pole_zone(device) if field_is_needed(scene) else None

    def __call__(self, simulation: Simulation, row: WindowRow) -> None:
        source = simulation.source
        if source is not None:
            if source.solution is not None and source.solution is not self._seen_solution:
                self._seen_solution = source.solution
                self._of_the_field = [self._field_quantities(source.solution)]
                if self._zone is not None and source.sampler is not None:
                    self._of_the_field.append(PoleField(self._zone.field_strength(source.sampler)))
            row.parts += self._of_the_field
        if self._zone is not None:
            grains = simulation.motion.grains
            row.add(PoleFill(self._zone.fill(grains.position, simulation.n_sectors * grains.volume)))
        boxes = self._sheared_boxes()
        if boxes:
            x = simulation.motion.grains.position
            r = np.hypot(x[:, 0], x[:, 1])
            inside = np.zeros(len(r), dtype=bool)
            for box in boxes:
                inside |= (r > box.r0) & (r < box.r1) & (x[:, 2] > box.z0) & (x[:, 2] < box.z1)
            volume = simulation.n_sectors * simulation.motion.grains.volume[inside].sum()
            rotor, disc = row.bodies["rotor"], row.bodies["disc"]
            row.add(
                GapRow(
                    float(volume / sum(box.volume() for box in boxes)),
                    self.inertial_number(disc.torque, rotor.speed - disc.speed),
                )
            )

    def inertial_number(self, torque: float, slip: float) -> float | None:
        """Upper bound of I = shear rate d sqrt(rho/P) in the sheared gap; None where no torque gives a pressure.

        P = tau/mu_wall with tau the torque over the area of the gap's mean cylinder, or of both face gaps, and its
        mean radius: at most that pressure is missed when the walls do not slip, so the true number is smaller.
        """
        scene, radius = self._scene, self._device.shear_radius
        tau = abs(torque) / self._torque_per_stress()
        friction = scene.contact.friction_at_walls
        if tau == 0.0 or friction == 0.0:
            return None
        rate = abs(slip) * radius / self._device.shear_gap
        return rate * scene.particles.mean_diameter * sqrt(scene.particles.density * friction / tau)

    def _sheared_boxes(self) -> list[AnnularBox]:
        """The gap that is sheared as a whole, both of the face gaps; none where there is no such gap."""
        shape = self._device.shape
        if not isinstance(shape, (Clutch, ShearCell)):
            return []  # see the module's docstring
        boxes = shape.fill_boxes()
        if self._device.shears_faces:
            return [boxes["face_left"], boxes["face_right"]]
        return [boxes.get("rim", next(iter(boxes.values())))]

    def _torque_per_stress(self) -> float:
        """Area in the middle of the gap times its mean radius [m^3]."""
        radius = self._device.shear_radius
        if self._device.shears_faces:
            assert isinstance(self._device.shape, Clutch)
            return self._device.shape.face_area * radius
        (box,) = self._sheared_boxes()
        return 2 * pi * radius**2 * (box.z1 - box.z0)

    def _field_quantities(self, solution: SolvedField) -> FieldRow:
        coil = self._device.coil
        assert coil is not None  # nothing else solves
        return FieldRow(
            flux_linkage=coil.turns * solution.flux_linkage_per_turn,
            field_energy=solution.energy,
            gap_flux_density=coil.gap_flux_density(solution, faces=self._device.shears_faces),
            field_iterations=len(solution.newton) - 1,
            field_residual=solution.newton[-1][0],
        )
