"""Effect `wall_images`: steel walls attract the grains through the images of their dipoles."""

from __future__ import annotations

from coupling.effects.effect import Effect
from coupling.wall_images import add_image_forces, magnetic_wall_table


class WallImages(Effect):
    """First images in every steel wall inside `cutoff` [m]; `reflection` is (mu_r - 1)/(mu_r + 1) [-]."""

    name = "wall_images"
    of_the_field = True

    def __init__(self, cutoff: float, walls, reflection: float = 1.0):
        self.cutoff = cutoff
        self.reflection = reflection
        self.walls = magnetic_wall_table(walls)

    def add_forces(self, simulation, force):
        grains = simulation.motion.grains
        torque = add_image_forces(
            grains.position,
            grains.magnetic_moment,
            grains.radius,
            simulation.rows(self.cutoff),
            self.walls,
            self.reflection,
            self.cutoff,
            force,
        )
        return {"images": torque}
