"""Observables of a window besides the balances: coil, gap and dimensionless numbers.

Fill and inertial number belong to a gap that is sheared as a whole (`Device.gap_zone`); the history of a device without
one has no such columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from coupling import Simulation, WindowRow
from coupling.powder_pressure import magnetic_pressure
from emclutch.device_model.device import Device, field_is_needed
from emclutch.device_model.pole_zone import AROUND
from field.solved_field import SolvedField
from field.three_d import Field3D
from particles.diagnostics.inertial_number import inertial_number


@dataclass(frozen=True, slots=True)
class FieldRow:
    """The coil's field at its last solve.

    Attributes
    ----------
    gap_flux_density : float
        Mean |B| in the gap [T].
    field_iterations, field_residual : int, float
        Newton's, of the last solve.
    """

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
    """The sheared gap: its solid fraction, and the inertial number, None where nothing gives a pressure."""

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
        self._attracts = scene.effects.attraction is not None

    def __call__(self, simulation: Simulation, row: WindowRow) -> None:
        source = simulation.source
        if source is not None:
            if source.solution is not None and source.solution is not self._seen_solution:
                self._seen_solution = source.solution
                self._of_the_field = [self._field_quantities(source.solution)]
                if self._zone is not None and source.sampler is not None:
                    field, angles = source.solution, np.zeros(1)
                    if isinstance(field, Field3D):
                        angles = field.problem.fold.angles(AROUND)
                    self._of_the_field.append(PoleField(self._zone.field_strength(source.sampler, angles)))
            row.parts += self._of_the_field
        if self._zone is not None:
            grains = simulation.motion.grains
            row.add(PoleFill(self._zone.fill(grains.position, simulation.n_sectors * grains.volume)))
        gap = self._gap
        if gap is not None:
            grains = simulation.motion.grains
            volume = simulation.n_sectors * gap.grain_volume(grains.position, grains.volume)
            rotor, disc = row.bodies["rotor"], row.bodies["disc"]
            pressure = self.magnetic_pressure(simulation) or self.friction_pressure(disc.torque)
            inertial = self.inertial_number(rotor.speed - disc.speed, pressure)
            row.add(GapRow(float(volume / gap.volume), inertial))

    def inertial_number(self, slip: float, pressure: float) -> float | None:
        """Return I of a slip [rad/s] and a pressure [Pa] of the sheared gap; None without a pressure."""
        rate = slip * self._device.shear_radius / self._device.shear_gap
        particles = self._scene.particles
        I = float(inertial_number(rate, particles.mean_diameter, particles.density, pressure))
        return I if pressure > 0.0 else None

    def magnetic_pressure(self, simulation: Simulation) -> float:
        """Pressure [Pa] of grains that attract one another, between the poles or in the whole gap; 0 of others."""
        zone = self._zone or self._gap
        if not self._attracts or zone is None:
            return 0.0
        grains = simulation.motion.grains
        assert grains.magnetic_moment is not None  # the loop updates them before a row is complete
        inside = zone.holds(grains.position)
        volume = grains.volume[inside]
        fill = simulation.n_sectors * float(volume.sum()) / zone.volume
        return magnetic_pressure(fill, np.linalg.norm(grains.magnetic_moment[inside], axis=1) / volume, volume)

    def friction_pressure(self, torque: float) -> float:
        """Pressure tau/mu_wall [Pa] that friction at the walls needs for a torque [N m] at least; 0 without friction.

        tau is the torque over the area of the gap's mean cylinder, or of both face gaps, and its mean radius.
        """
        friction = self._scene.contact.friction_at_walls
        return abs(torque) / self._gap.torque_per_stress / friction if self._gap is not None and friction else 0.0

    def _field_quantities(self, solution: SolvedField) -> FieldRow:
        coil = self._device.coil
        assert coil is not None  # nothing else solves
        return FieldRow(
            gap_flux_density=coil.gap_flux_density(solution, faces=self._device.shears_faces),
            field_iterations=len(solution.newton) - 1,
            field_residual=solution.newton[-1][0],
        )
