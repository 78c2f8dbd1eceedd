"""Checks of field, materials and slots of a scene against each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from emclutch.scene.draft import Draft
from emclutch.scene.errors import Fault
from emclutch.scene.section import did_you_mean

MIN_SIZE_IN_3D = 0.2  # `geometry.mesh_slotted`


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
                    f"is no material; {did_you_mean(name, [*own, *built_in, *material_aliases()])}"
                    f"built in: {', '.join(built_in)}; "
                    f"or define [materials.{name}]",
                )


def source_fits(draft: Draft) -> Iterator[Fault]:
    """A field has the source that its geometry can have."""
    coil_field, prescribed, geometry = draft.scene.coil_field, draft.scene.prescribed_field, draft.scene.geometry
    if coil_field is not None and not geometry.has_coil:
        yield draft.fault(
            "field.source",
            f"needs a device with a coil, but geometry.kind = '{geometry.kind}'; "
            "take geometry.kind = 'clutch', 'drum' or 'cad', or field.source = 'uniform'",
        )
    elif coil_field is not None and draft.scene.coil is None and "coil" not in draft.broken:
        yield Fault("coil", "", "is missing, but field.source = 'coil'; add [coil] with its current and turns")
    if prescribed is not None and prescribed.direction == "radial" and not geometry.is_annulus:
        yield draft.fault(
            "field.direction",
            "needs geometry.kind = 'shear_cell', whose mid radius is that of "
            "field_strength; take another direction, e.g. 'axial'",
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
                "needs a field; add [field] with source = 'coil' or 'uniform', or remove the effect's table",
            )


def field_is_3d(draft: Draft) -> Iterator[Fault]:
    """Return what a field in 3D, of slots or of solids from CAD, cannot do, or not yet."""
    source, effects, slotted = draft.scene.coil_field, draft.scene.effects, draft.scene.geometry.slotted
    if source is None or not draft.scene.geometry.is_solved_in_3d:
        return
    key = f"geometry.{next(iter(slotted), 'three_dimensional')}"
    yield from _one_carrier(draft, slotted)
    for one in effects.present:
        if one.not_in_3d:
            yield Fault(
                f"effects.{one.name}",
                "",
                f"is not available in a 3D field, which {key} asks for: {one.not_in_3d}; remove one of them",
            )
    if source.tolerance is not None:
        yield draft.fault(
            "field.tolerance", f"refines the mesh of a section, but {key} asks for a field in 3D; remove it, and "
            "set the mesh by field.size_factor"
        )  # fmt: skip
    if source.size_factor < MIN_SIZE_IN_3D:
        yield draft.fault(
            "field.size_factor", f"is too fine for a field in 3D, which {key} asks for; allowed: at least "
            f"{MIN_SIZE_IN_3D:g}"
        )  # fmt: skip


def _one_carrier(draft: Draft, slotted: Mapping[str, object]) -> Iterator[Fault]:
    """The field stands still in the frame of one body: no other may have slots."""
    both = "the field would change with the angle between both, and is solved once a current only"
    if len(slotted) == 2:
        yield Fault("geometry.rotor_slots", "", f"stands beside geometry.disc_slots: {both}; keep one of them")
    if slotted or "geometry" in draft.broken:
        return
    shape = draft.scene.shape()
    if len(shape.carriers) > 1:
        parts = ", ".join(f"{region} ({shape.body(region)})" for region in sorted(shape.section.odd))
        yield Fault(
            "geometry.bodies",
            "",
            f"of parts that are no bodies of revolution are several: {parts}; {both}; let one of them have all",
        )
