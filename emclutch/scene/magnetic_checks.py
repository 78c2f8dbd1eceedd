"""What field, materials, slots and magnetic effects of a scene ask of each other."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

from emclutch.scene.draft import Draft, size_key
from emclutch.scene.errors import Fault
from emclutch.scene.fill import fill_of
from emclutch.scene.grain_smear import (
    LEAST_WIDTH,
    layers_change_the_field,
    moments_are_fed_back,
    narrowest_gap,
    smear_width,
)
from emclutch.scene.section import did_you_mean

_MISSING_IN_SPACE = {
    "back_reaction": "moments of the grains are not spread over tetrahedra",
    "coil_circuit": "a circuit is solved together with the field of a section only",
    "eddy_currents": "they need a vector potential, and the field in 3D is that of a scalar one",
}
LEAST_SIZE_IN_SPACE = 0.2  # `geometry.mesh_slotted`
_NEAR_REACH = 1.8  # diameters: two radii and the farthest gap of a near pair, 1.2 radii, where dipoles are whole


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


def needs_of_effects(draft: Draft) -> Iterator[Fault]:
    """Magnetic effects need a field, and some need each other."""
    effects, has_field = draft.scene.effects, "field" in draft.data
    if has_field and draft.is_of_the_field_alone:
        return  # such a scene has no effects, which is told
    magnetic = effects.magnetic_force is not None or effects.dipoles is not None
    for name in ("magnetic_force", "dipoles", "back_reaction"):
        if getattr(effects, name) is not None and not has_field:
            yield Fault(
                f"effects.{name}",
                "",
                "needs a field; add [field] with source = 'coil' or 'uniform', or remove the effect's table",
            )
    prescribed = draft.scene.prescribed_field is not None
    if effects.saturation is not None and not magnetic:
        yield Fault(
            "effects.saturation",
            "",
            "needs magnetised grains; add [effects.dipoles] or [effects.magnetic_force], or remove the effect's table",
        )
    if effects.back_reaction is not None and effects.dipoles is None and not prescribed:
        yield Fault(
            "effects.back_reaction",
            "",
            "needs grains that magnetise one another, whose moments it gives to the field; add [effects.dipoles], or "
            "remove its table",
        )
    if effects.wall_images is not None and effects.dipoles is None:
        yield Fault("effects.wall_images", "", "needs dipoles to mirror; add [effects.dipoles], or remove its table")
    if effects.back_reaction is not None and prescribed:
        yield Fault(
            "effects.back_reaction",
            "",
            "needs a field that is solved, and field.source = 'uniform' is "
            "prescribed; take field.source = 'coil', or remove its table",
        )


def needs_of_moments(draft: Draft) -> Iterator[Fault]:
    """What grains that magnetise one another need, and what cannot stand beside them."""
    effects, particles = draft.scene.effects, draft.scene.particles
    if effects.dipoles is None:
        return
    model, prescribed = effects.dipoles.model, draft.scene.prescribed_field
    macroscopic = prescribed is not None and prescribed.is_macroscopic
    if particles.law == "thesis":
        yield Fault(
            "effects.dipoles",
            "",
            "does not go with particles.law = 'thesis': M = chi H has no material behind it, in which grains could "
            "magnetise one another; remove [effects.dipoles] and keep [effects.magnetic_force], or take law = 'sphere'",
        )
    if moments_are_fed_back(draft.scene):
        yield from _parts_of_the_feedback(draft)
    if model == "near_field" and effects.saturation is None:
        yield draft.fault(
            "effects.dipoles.model",
            "needs grains that saturate, their necks do so first; add [effects.saturation], or take model = 'mutual'",
        )
    if macroscopic and effects.dipoles.cutoff < 2.0:
        yield draft.fault(
            "effects.dipoles.cutoff",
            "is the width over which field.means = 'macroscopic' spreads a grain; allowed: at least 2 diameters "
            "(2.5 to 3 are usual)",
        )
    elif model == "near_field" and effects.dipoles.cutoff < _NEAR_REACH:
        yield draft.fault(
            "effects.dipoles.cutoff",
            f"ends inside the range of near grains; allowed with model = 'near_field': at least {_NEAR_REACH:g} "
            "diameters",
        )


def _parts_of_the_feedback(draft: Draft) -> Iterator[Fault]:
    """Effects that hold a part of the attraction between grains whose moments are fed back to the field.

    The solved field then has every grain in it, spread out over the cut-off and mirrored in steel. Pairs within the
    cut-off add what that smear misses; what it has itself acts as `magnetic_force`, and its mirror images are taken
    out for those of the grains by `wall_images`. Without one of them a part is missing or counts twice.
    """
    effects, model = draft.scene.effects, draft.scene.effects.dipoles.model
    stands = f"is missing beside [effects.back_reaction] with effects.dipoles.model = '{model}'"
    if effects.magnetic_force is None:
        yield Fault(
            "effects.magnetic_force",
            "",
            f"{stands}: the field's gradient holds what grains beyond the cut-off, and the smear of nearer ones, do to "
            "each other; without it axial forces of pairs are 4 to 41 % too strong. Add [effects.magnetic_force], or "
            "remove [effects.back_reaction]",
        )
    if effects.wall_images is None and draft.scene.geometry.may_have_steel_faces:
        yield Fault(
            "effects.wall_images",
            "",
            f"{stands}: the solved field mirrors the grains in its steel, spread out, and only the images of single "
            "grains take that out again. Add [effects.wall_images], or remove [effects.back_reaction]",
        )


def room_for_the_layers(draft: Draft) -> Iterator[Fault]:
    """Between steel faces grains are spread over no more than the gap, and over no less than two diameters."""
    scene = draft.scene
    if scene.effects.dipoles is None or not layers_change_the_field(scene) or scene.shape().faults(None):
        return
    largest, gap = scene.particles.largest_diameter, narrowest_gap(scene)
    if gap < LEAST_WIDTH * largest:
        yield draft.fault(
            "field.means",
            f"spreads each grain over at least {LEAST_WIDTH:g} diameters between steel faces, and the gap of "
            f"{1e3 * gap:.3g} mm has {gap / largest:.3g}; take means = 'applied', or lower "
            f"particles.{size_key(scene.particles)}",
        )


def room_for_the_smear(draft: Draft) -> Iterator[Fault]:
    """What spreading the grains' moments over the section needs: a gap of two diameters, and room about the axis."""
    scene = draft.scene
    if not (moments_are_fed_back(scene) and scene.geometry.has_coil):
        return
    shape = scene.shape()
    if shape.faults(None) or scene.prescribed_field is not None:
        return
    assert scene.effects.dipoles is not None  # without it nothing is fed back
    largest, gap = scene.particles.largest_diameter, narrowest_gap(scene)
    if gap < LEAST_WIDTH * largest:
        yield draft.fault(
            "effects.back_reaction",
            f"spreads each grain over at least {LEAST_WIDTH:g} diameters, and the gap of {1e3 * gap:.3g} mm has "
            f"{gap / largest:.3g}; remove its table (the field then holds no grain), or lower "
            f"particles.{size_key(scene.particles)}",
        )
        return
    width = max(smear_width(scene), LEAST_WIDTH * largest)
    if scene.effects.dipoles.cutoff < LEAST_WIDTH:
        yield draft.fault(
            "effects.dipoles.cutoff",
            f"is the width over which back_reaction spreads a grain; allowed: at least {LEAST_WIDTH:g} diameters (2.5 "
            "to 3 are usual)",
        )
    radius = fill_of(shape, scene.particles).inner_radius
    if radius < 4.0 * width:
        yield draft.fault(
            "effects.back_reaction",
            f"cannot spread grains so near the axis: powder begins at {1e3 * radius:.3g} mm, allowed are 4 widths, "
            f"{4e3 * width:.3g} mm; remove its table, or lower effects.dipoles.cutoff",
        )


def coil_transients(draft: Draft) -> Iterator[Fault]:
    """What a coil's circuit and eddy currents need."""
    effects = draft.scene.effects
    magnetic = effects.magnetic_force is not None or effects.dipoles is not None
    coil, solved = draft.scene.coil, draft.scene.coil_field is not None
    for name in ("coil_circuit", "eddy_currents"):
        if getattr(effects, name) is not None and not (solved and magnetic) and not draft.is_of_the_field_alone:
            yield Fault(
                f"effects.{name}",
                "",
                "needs the field of a coil and an effect that feels it; take [field] source = 'coil' with "
                "[effects.dipoles] or [effects.magnetic_force], or remove the effect's table",
            )
    if effects.coil_circuit is not None and coil is not None:
        if coil.current is not None and coil.voltage is not None:
            yield draft.fault(
                "coil.current",
                "stands beside coil.voltage, but [effects.coil_circuit] computes it; remove it, or the effect's table",
            )
        elif coil.voltage is None:
            yield Fault(
                "coil.voltage",
                "",
                "is missing: [effects.coil_circuit] computes the current from it; give coil.voltage, e.g. '24 V', "
                "instead of coil.current, or remove the effect's table",
            )
    if effects.eddy_currents is not None and "geometry.materials" not in draft.of_geometry:
        known = {*(draft.scene.materials or {}), *_materials_in_use(draft)}
        for name in effects.eddy_currents.conductivity:
            if name not in known:
                yield draft.fault(
                    f"effects.eddy_currents.conductivity.{name}",
                    f"is for no material of this device; it has {', '.join(sorted(known))}",
                )


def _materials_in_use(draft: Draft) -> set[str]:
    materials = getattr(draft.scene.geometry, "materials", None)
    if materials is None:
        return set()
    return set(dict(materials).values())


def field_is_3d(draft: Draft) -> Iterator[Fault]:
    """What a field in 3D, of slots or of solids from CAD, cannot do, or not yet."""
    source, effects, slotted = draft.scene.coil_field, draft.scene.effects, draft.scene.geometry.slotted
    if source is None or not draft.scene.geometry.is_solved_in_3d:
        return
    key = f"geometry.{next(iter(slotted), 'three_dimensional')}"
    yield from _one_carrier(draft, slotted)
    for name, missing in _MISSING_IN_SPACE.items():
        if getattr(effects, name) is not None:
            yield Fault(
                f"effects.{name}",
                "",
                f"is not there for a field in 3D, which {key} asks for: {missing}; remove one of them",
            )
    if source.tolerance is not None:
        yield draft.fault(
            "field.tolerance", f"refines the mesh of a section, but {key} asks for a field in 3D; remove it, and "
            "set the mesh by field.size_factor"
        )  # fmt: skip
    if source.size_factor < LEAST_SIZE_IN_SPACE:
        yield draft.fault(
            "field.size_factor", f"is too fine for a field in 3D, which {key} asks for; allowed: at least "
            f"{LEAST_SIZE_IN_SPACE:g}"
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
