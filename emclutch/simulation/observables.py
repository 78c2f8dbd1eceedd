"""Observables of a window besides the balances: coil, gap and dimensionless numbers.

Fill and inertial number belong to a gap that is sheared as a whole (`Device.gap_zone`); the history of a device without
one has no such columns.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import sqrt

from coupling import Simulation, WindowRow
from emclutch.device_model.device import Device, field_is_needed
from field.solved_field import SolvedField


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
        self._gap = device.gap_zone
        self._zone = device.pole_zone if field_is_needed(scene) else None

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
        gap = self._gap
        if gap is not None:
            grains = simulation.motion.grains
            volume = simulation.n_sectors * gap.grain_volume(grains.position, grains.volume)
            rotor, disc = row.bodies["rotor"], row.bodies["disc"]
            inertial = self.inertial_number(disc.torque, rotor.speed - disc.speed)
            row.add(GapRow(float(volume / gap.volume), inertial))

    def inertial_number(self, torque: float, slip: float) -> float | None:
        """Upper bound of I = shear rate d sqrt(rho/P) in the sheared gap; None where no torque gives a pressure.

        P = tau/mu_wall with tau the torque over the area of the gap's mean cylinder, or of both face gaps, and its
        mean radius: at most that pressure is missed when the walls do not slip, so the true number is smaller.
        """
        scene, radius = self._scene, self._device.shear_radius
        if self._gap is None:
            return None
        tau = abs(torque) / self._gap.torque_per_stress
        friction = scene.contact.friction_at_walls
        if tau == 0.0 or friction == 0.0:
            return None
        rate = abs(slip) * radius / self._device.shear_gap
        return rate * scene.particles.mean_diameter * sqrt(scene.particles.density * friction / tau)

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
