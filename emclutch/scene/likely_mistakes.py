"""Warnings of a valid scene: tables without effect, unusual values."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from emclutch.scene.materials import TableMaterial
from emclutch.scene.surfaces import WIDE
from emclutch.scene.usual_ranges import unusual_entries


def warnings_of(scene: Any) -> Iterator[str]:
    """Yield what is allowed and yet likely not meant."""
    effects = scene.effects
    for one in effects.present:
        yield from one.warnings(scene)
    if effects.magnetise and not effects.saturate:
        yield f"{effects.tables(saturates=True)} is missing: the grains are linear and magnetise without limit"
    if scene.coil is not None and not scene.geometry.has_coil:
        kind = scene.geometry.kind
        yield f"[coil] is not used: a device of geometry.kind = '{kind}' has none; remove the table"
    elif scene.coil is not None and scene.coil_field is None:
        yield "[coil] is not used: that needs [field] with source = 'coil'"
    if scene.particles is None:
        unused = (
            ("surfaces", "contact", "motion", "time") if effects.thermal is None else ("surfaces", "contact", "time")
        )
        idle = [name for name in unused if _is_given(scene, name)]
        if idle:
            names = ", ".join(f"[{name}]" for name in idle)
            yield f"without [particles] the scene is of the field alone, which does not use {names}"
    elif scene.field is not None and not effects.magnetise:
        yield f"[field] has no effect on the grains: that needs {effects.tables(needs_moments=True)}"
    yield from scene.geometry.warnings(scene)
    yield from _doubtful_surfaces(scene)
    for name, own in scene.materials.items():
        if isinstance(own, TableMaterial) and (text := getattr(own.magnetic_law(name), "warning", "")):
            yield f"materials.{name}: {text}"
    coil = scene.coil
    window = scene.shape() if scene.geometry.has_coil else None
    if coil is not None and coil.current is not None and coil.voltage is not None and window is not None:
        drop = coil.current.largest * coil.resistance_in(window.coil_area, window.coil_mean_radius)
        supply = coil.voltage(0.0)
        if drop > 1.01 * supply:  # rounded data of a type plate agree within a percent
            yield f"coil.current needs {drop:.4g} V, more than coil.voltage = {supply:g} V"
    yield from unusual_entries(scene)


def _doubtful_surfaces(scene: Any) -> Iterator[str]:
    """Yield the surfaces that look like solid parts with lids that are missing, or larger than the device."""
    if not scene.surfaces:
        return
    from geometry.wall_openings import openings_in_words  # local: a scene without surfaces needs no shapes

    for name, surface in scene.surfaces.items():
        if text := openings_in_words(surface.wall(name)):
            yield f"surfaces.{name}.file {text}"
        space = None if scene.particles is None else float(scene.shape().extent().max())
        if space is not None and surface.longest_side(name) > WIDE * space:
            yield f"surfaces.{name}.file {surface.too_wide_in_words(name, space, scene.particles.smallest_diameter)}"


def _is_given(scene: Any, name: str) -> bool:
    """True if a section says anything; a resolved scene has the defaults written out."""
    return getattr(scene, name) != type(scene).model_fields[name].default
