"""Checks of a cyclic sector: geometry, surfaces, and the reach of its grains."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING, Any

from emclutch.scene.errors import Fault
from emclutch.scene.grain_smear import moments_are_fed_back, smear_width
from emclutch.scene.partial_scene import PartialScene, size_key
from emclutch.scene.scaled import Scaled

if TYPE_CHECKING:
    from emclutch.scene.model import Scene

# Reach of a contact in grain diameters: the Verlet list holds pairs that may touch before it is rebuilt.
_CONTACT_REACH = 1.3


def sector_in_geometry(partial: PartialScene) -> Iterator[Fault]:
    """A sector needs an axis, and walls that repeat from sector to sector."""
    if partial.scene.particles.sector is None:
        return
    if partial.scene.geometry.why_no_sector:
        yield partial.fault("particles.sector", partial.scene.geometry.why_no_sector)


def sector_in_surfaces(partial: PartialScene) -> Iterator[Fault]:
    """Surfaces from files repeat from no sector to the next."""
    if partial.scene.particles.sector is not None and partial.scene.surfaces:
        yield partial.fault(
            "particles.sector",
            "cannot be combined with [surfaces]: a mesh does not repeat from sector to sector; remove one of them",
        )


def innermost_radius(scene: Scene) -> float:
    """Return the smallest radius [m] of a grain's centre: from the rim grains wander into the face gaps of a clutch."""
    walls = min(box.r0 for box in scene.shape().fill_boxes().values())
    return walls + 0.5 * scene.grains.largest_diameter


def with_sector_angle(scene: Any, *, shape_is_known: bool = True) -> Any:
    """Return the scene with the angle of a sector whose width it gives in diameters; any other as it is.

    The ring has a whole number of sectors, so that they are as wide as asked or wider at the innermost radius of a
    grain's centre. Where that radius is not known (no axis, a shape with faults) the angle is half a turn, and of a
    width beyond half the ring a whole one: the checks say what is wrong.
    """
    particles = scene.particles
    if particles is None or not isinstance(width := particles.sector, Scaled):
        return scene
    angle = math.pi
    if shape_is_known and not (scene.geometry.why_no_sector or scene.shape().faults(None)):
        half = width.value * particles.largest_diameter / (2.0 * innermost_radius(scene))
        angle = 2.0 * math.pi / (1 if half > 1.0 else math.floor(math.pi / math.asin(half) + 1e-9))
    return scene.model_copy(update={"particles": particles.model_copy(update={"sector": angle})})


def sector_width(partial: PartialScene) -> Iterator[Fault]:
    """Neither its own image nor one partner through both faces may be in a grain's reach."""
    particles, shape = partial.scene.particles, partial.scene.shape()
    if particles.sector is None or partial.scene.geometry.why_no_sector:
        return
    largest = particles.largest_diameter
    if shape.faults(None):
        return
    if particles.n_sectors < 2:
        yield partial.fault("particles.sector", "is wider than half the ring; lower it, or remove it")
        return
    attraction = partial.scene.effects.attraction
    reach = largest * (_CONTACT_REACH if attraction is None else max(attraction.cutoff, _CONTACT_REACH))
    if moments_are_fed_back(partial.scene) and partial.scene.geometry.has_coil:
        reach = max(smear_width(partial.scene), largest * _CONTACT_REACH)  # in a narrow gap the shorter of the two
    radius = innermost_radius(partial.scene)
    chord = 2.0 * radius * math.sin(0.5 * particles.sector)
    if chord < 2.0 * reach:
        narrowest = 2.0 * math.asin(min(1.0, reach / radius))
        wider = 360.0 / max(1, math.floor(2.0 * math.pi / narrowest))
        shorter = "" if attraction is None else f", or lower effects.{attraction.name}.cutoff"
        yield partial.fault(
            "particles.sector",
            f"is {1e3 * chord:.4g} mm wide at r = {1e3 * radius:.4g} mm, less than "
            f"twice the dipole cut-off ({2e3 * reach:.4g} mm); allowed: at least '{wider:.10g} deg'; widen it, "
            f"lower particles.{size_key(particles)}{shorter}",
        )
