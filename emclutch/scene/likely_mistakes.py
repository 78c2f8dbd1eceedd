"""What a scene may say and yet hardly means: effects that do nothing where they stand, entries of unusual size."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from emclutch.scene.grain_smear import TRUE_WIDTH, layers_change_the_field, moments_are_fed_back, smear_width
from emclutch.scene.materials import TableMaterial
from emclutch.scene.time_table import largest
from emclutch.scene.usual_ranges import unusual_entries


def warnings_of(scene: Any) -> Iterator[str]:
    """Yield what is allowed and yet likely not meant."""
    effects = scene.effects
    magnetic = effects.magnetic_force is not None or effects.dipoles is not None
    if effects.magnetic_force is not None and effects.dipoles is None:
        yield (
            "[effects.dipoles] is missing: without the forces between magnetised grains the powder forms no "
            "chains, and the torque will be near nothing"
        )
    if magnetic and effects.saturation is None:
        yield "[effects.saturation] is missing: the grains are linear and magnetise without limit"
    if scene.coil is not None and not scene.geometry.has_coil:
        kind = scene.geometry.kind
        yield f"[coil] is not used: a device of geometry.kind = '{kind}' has none; remove the table"
    elif scene.coil is not None and scene.coil_field is None:
        yield "[coil] is not used: that needs [field] with source = 'coil'"
    if scene.particles is None:
        idle = [name for name in ("surfaces", "contact", "motion", "time") if _is_told(scene, name)]
        if idle:
            names = ", ".join(f"[{name}]" for name in idle)
            yield f"without [particles] the scene is of the field alone, which does not use {names}"
    elif scene.field is not None and not magnetic:
        yield "[field] moves no grain: that needs [effects.dipoles] or [effects.magnetic_force]"
    slotted = next(iter(scene.geometry.slotted), "")
    if effects.wall_images is not None and slotted:
        yield f"[effects.wall_images] mirrors dipoles in the slots of geometry.{slotted} too, as if they were steel"
    if effects.wall_images is not None and scene.geometry.is_from_file and scene.shape().carriers:
        yield (
            "[effects.wall_images] mirrors dipoles all around in what is steel in the half-plane y = 0, x > 0: in the "
            "slots of the other parts too"
        )
    if slotted and scene.coil_field is None:
        yield f"geometry.{slotted} has no effect: only the field of a coil sees slots, grains meet smooth walls"
    if effects.wall_images is not None and not scene.geometry.may_have_steel_faces:
        kind = scene.geometry.kind
        yield f"[effects.wall_images] has no effect: geometry.kind = '{kind}' has no steel faces"
    elif effects.wall_images is not None and not any(wall.magnetic for wall in scene.shape().walls()):
        yield "[effects.wall_images] has no effect: no wall is of a magnetic material"
    prescribed = scene.prescribed_field
    macroscopic = prescribed is not None and prescribed.is_macroscopic
    if effects.wall_images is not None and macroscopic and not layers_change_the_field(scene):
        yield (
            "[effects.wall_images] beside field.means = 'macroscopic': the mean field is taken as even up to the "
            "steel; what layers of grains there change in it is followed with geometry.kind = 'shear_cell' and "
            "field.direction = 'radial' only"
        )
    yield from _narrow_smear(scene)
    for name, own in scene.materials.items():
        if isinstance(own, TableMaterial) and own.caution:
            yield f"materials.{name}: {own.caution}"
    coil = scene.coil
    window = scene.shape() if scene.geometry.has_coil else None
    if coil is not None and coil.current is not None and coil.voltage is not None and window is not None:
        drop = largest(coil.current) * coil.resistance_in(window.coil_area, window.coil_mean_radius)
        if drop > 1.01 * coil.voltage:  # rounded data of a type plate agree within a percent
            yield f"coil.current needs {drop:.4g} V, more than coil.voltage = {coil.voltage:g} V"
    yield from unusual_entries(scene)


def _narrow_smear(scene: Any) -> Iterator[str]:
    """A width at which the field still knows single grains around the axis as if they were an even ring."""
    fed_back = scene.particles is not None and moments_are_fed_back(scene)
    if not (fed_back and scene.coil_field is not None):
        return
    largest = scene.particles.largest_diameter
    width, cutoff = smear_width(scene) / largest, scene.effects.dipoles.cutoff
    if width < TRUE_WIDTH - 1e-9:
        remedy = (
            f"raise effects.dipoles.cutoff = {cutoff:g} to {TRUE_WIDTH:g}"
            if width > cutoff - 1e-9
            else "the gap allows no more; smaller grains have it"
        )
        yield (
            f"[effects.back_reaction] spreads a grain over {width:.3g} diameters: below {TRUE_WIDTH:g} forces "
            f"on grains beside steel are wrong by up to 3 %, on single ones in loose powder by 12 %; {remedy}"
        )


def _is_told(scene: Any, name: str) -> bool:
    """Whether a section says anything; a resolved scene has the defaults written out."""
    return getattr(scene, name) != type(scene).model_fields[name].default
