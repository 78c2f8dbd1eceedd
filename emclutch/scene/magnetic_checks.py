"""Checks of materials and of the field that effects need."""

from __future__ import annotations

from collections.abc import Iterator

from emclutch.scene.draft import Draft
from emclutch.scene.errors import Fault
from emclutch.scene.section import did_you_mean
from emclutch.sources import sources_in_words


def materials(draft: Draft) -> Iterator[Fault]:
    """Materials that the geometry names are there, and those that are there are used."""
    from field.laws.materials import canonical_name, material_aliases, material_names  # local: only here

    built_in, own = material_names(), list(draft.scene.materials or {})
    for name in own:
        if canonical_name(name) is not None:
            yield draft.fault(f"materials.{name}", "has the name of a built-in material; choose another name")
    if draft.scene.geometry.has_coil:
        for region, name in dict(draft.scene.geometry.materials or {}).items():
            if canonical_name(name) is None and name not in own:
                yield draft.fault(
                    f"geometry.materials.{region}",
                    f"is not a material; {did_you_mean(name, [*own, *built_in, *material_aliases()])}"
                    f"built in: {', '.join(built_in)}; "
                    f"or define [materials.{name}]",
                )


def field_of_effects(draft: Draft) -> Iterator[Fault]:
    """Effects of the field have one."""
    if "field" in draft.data:
        return
    for one in draft.scene.effects.present:
        if one.needs_field:
            yield Fault(
                f"effects.{one.name}",
                "",
                f"needs a field; add [field] with source = {sources_in_words()}, or remove the effect's table",
            )
