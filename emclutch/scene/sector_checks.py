"""Checks of a cyclic sector: geometry, surfaces, and the reach of its grains."""

from __future__ import annotations

import math
from collections.abc import Iterator

from emclutch.scene.draft import Draft, size_key
from emclutch.scene.errors import Fault
from emclutch.scene.grain_smear import moments_are_fed_back, smear_width

# Reach of a contact in grain diameters: the Verlet list holds pairs that may touch before it is rebuilt.
_CONTACT_REACH = 1.3


def sector_in_geometry(draft: Draft) -> Iterator[Fault]:
    """A sector needs an axis, and walls that repeat from sector to sector."""
    if draft.scene.particles.sector is None:
        return
    if draft.scene.geometry.why_no_sector:
        yield draft.fault("particles.sector", draft.scene.geometry.why_no_sector)


def sector_in_surfaces(draft: Draft) -> Iterator[Fault]:
    """Surfaces from files repeat from no sector to the next."""
    if draft.scene.particles.sector is not None and draft.scene.surfaces:
        yield draft.fault(
            "particles.sector",
            "cannot be combined with [surfaces]: a mesh does not repeat from sector to sector; remove one of them",
        )


def _innermost_radius(draft: Draft) -> float:
    """Smallest radius [m] of a wall that grains come to: from the rim they wander into the face gaps of a clutch."""
    return min(box.r0 for box in draft.scene.shape().fill_boxes().values())


def sector_width(draft: Draft) -> Iterator[Fault]:
    """Neither its own image nor one partner through both faces may be in a grain's reach."""
    particles, shape = draft.scene.particles, draft.scene.shape()
    if particles.sector is None or draft.scene.geometry.why_no_sector:
        return
    largest = particles.largest_diameter
    if shape.faults(None):
        return
    attraction = draft.scene.effects.attraction
    reach = largest * (_CONTACT_REACH if attraction is None else max(attraction.cutoff, _CONTACT_REACH))
    if moments_are_fed_back(draft.scene) and draft.scene.geometry.has_coil:
        reach = max(smear_width(draft.scene), largest * _CONTACT_REACH)  # in a narrow gap the shorter of the two
    radius = _innermost_radius(draft) + 0.5 * largest
    chord = 2.0 * radius * math.sin(0.5 * particles.sector)
    if chord < 2.0 * reach:
        narrowest = 2.0 * math.asin(min(1.0, reach / radius))
        wider = 360.0 / max(1, math.floor(2.0 * math.pi / narrowest))
        shorter = "" if attraction is None else f", or lower effects.{attraction.name}.cutoff"
        yield draft.fault(
            "particles.sector",
            f"is {1e3 * chord:.4g} mm wide at r = {1e3 * radius:.4g} mm, less than two "
            f"reaches of a grain ({2e3 * reach:.4g} mm); allowed: at least '{wider:.10g} deg'; widen it, "
            f"lower particles.{size_key(particles)}{shorter}",
        )
