"""Effect `dipoles`, model `fixed`: near grains attract one another as point dipoles with the moment of their law."""

from __future__ import annotations

from coupling.dipoles import add_dipole_forces
from coupling.effects.effect import Effect


class FixedDipoles(Effect):
    """Pair forces inside `cutoff` [m]; the torque m x B of the pairs is booked as the field's reaction."""

    name = "dipoles"

    def __init__(self, cutoff: float):
        self.cutoff = cutoff

    def add_forces(self, simulation, force):
        grains = simulation.dem.grains
        reaction, _energy = add_dipole_forces(
            grains.position, grains.magnetic_moment, grains.radius, simulation.rows(self.cutoff), self.cutoff, force
        )
        return {"dipoles": reaction}
