"""[effects.wall_images]: image dipoles of the grains in steel faces (`coupling.image_kernels`)."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from emclutch.effects.effect import EffectSection
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.results.columns import Column, When
from emclutch.scene.errors import Fault
from emclutch.scene.grain_smear import layers_change_the_field
from emclutch.scene.partial_scene import PartialScene


def _something_to_mirror(partial: PartialScene) -> Iterator[Fault]:
    """Images are those of dipoles."""
    effects = partial.scene.effects
    if effects.images is not None and effects.attraction is None and not partial.is_of_the_field_alone:
        needed = effects.tables(role="attraction")
        yield Fault("effects.wall_images", "", f"add {needed}, or remove this table: images are those of dipoles")


TORQUE_FIELD_IMAGES = Column(
    "torque_field_images", "N m", "part of torque_field from image dipoles in steel walls", When.MEAN
)


class WallImagesSection(EffectSection):
    """Images of the dipoles in the steel faces."""

    name = "wall_images"
    summary = "images of the dipoles in steel faces"
    role = "images"
    columns = (TORQUE_FIELD_IMAGES,)
    neighbour_ns = 50.0  # an image: quickstart, thesis/electromagnetic, of 4 and 1.4 spheres across the gap
    CHECKS: ClassVar = ((_something_to_mirror, ("effects",)),)

    def warnings(self, scene):
        """Yield where images have no effect, or are not those of the device."""
        geometry = scene.geometry
        where = geometry.false_mirrors(scene.shape())
        if where:
            yield f"[effects.wall_images] mirrors dipoles {where}"
        if not geometry.may_have_steel_faces:
            yield f"[effects.wall_images] has no effect: geometry.kind = '{geometry.kind}' has no steel faces"
        elif not any(wall.magnetic for wall in scene.shape().walls()):
            yield "[effects.wall_images] has no effect: no wall is of a magnetic material"
        prescribed = scene.prescribed_field
        if prescribed is not None and prescribed.is_macroscopic and not layers_change_the_field(scene):
            yield (
                "[effects.wall_images] with field.means = 'macroscopic': the mean field is taken as uniform up to "
                "the steel; only geometry.kind = 'sheared_box' computes how layers of grains at the steel change it"
            )

    def neighbours(self, scene, device):
        """Return the images within reach: as many as the walls have taken of the neighbours in the bulk."""
        attraction = scene.effects.attraction
        if attraction is None:
            return 0.0
        return attraction.neighbours_in_bulk(scene, device) - attraction.neighbours(scene, device)

    @classmethod
    def omitted_effects(cls, at):
        """Yield the fraction of the grains that touch steel."""
        if at.M > 0.0 and at.wall_share is not None:
            yield OmittedEffect(cls.name, OFF, "fraction of the grains that touch steel", at.wall_share, 0.1)
