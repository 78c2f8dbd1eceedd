"""Checks between the sections of a scene. Each is a small function that yields faults."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import TYPE_CHECKING

from emclutch.devices import kinds_in_words
from emclutch.effects import EFFECTS
from emclutch.scene.errors import Fault
from emclutch.scene.fill import fill_of
from emclutch.scene.grains import MAX_GRAINS
from emclutch.scene.motion import HELD
from emclutch.scene.partial_scene import PartialScene, size_key
from emclutch.scene.replica_count import has_steady_torque, packs_alike
from emclutch.scene.repose import repose_agrees
from emclutch.scene.section import did_you_mean
from emclutch.scene.sector_checks import sector_in_geometry, sector_in_surfaces, sector_width
from emclutch.scene.slip_checks import one_slip
from emclutch.scene.surfaces import TOO_SMALL, TOO_WIDE, extent_in_words
from emclutch.scene.timing import instant_in_words, not_before
from emclutch.scene.usual_ranges import DENSITY
from emclutch.sources import sources_in_words

if TYPE_CHECKING:
    from geometry.fault import GeometryFault

GEOMETRY_KIND = "geometry.kind"
"""Stands in `PartialScene.broken` where of the geometry not even the kind is known."""

Check = Callable[[PartialScene], Iterator[Fault]]


def materials(partial: PartialScene) -> Iterator[Fault]:
    """Materials that the geometry names are there, and those that are there are used."""
    from field.laws.materials import canonical_name, material_aliases, material_names  # local: only here

    built_in, own = material_names(), list(partial.scene.materials or {})
    for name in own:
        if canonical_name(name) is not None:
            yield partial.fault(f"materials.{name}", "has the name of a built-in material; choose another name")
    if partial.scene.geometry.has_coil:
        for region, name in dict(partial.scene.geometry.materials or {}).items():
            if canonical_name(name) is None and name not in own:
                yield partial.fault(
                    f"geometry.materials.{region}",
                    f"is not a material; {did_you_mean(name, [*own, *built_in, *material_aliases()])}"
                    f"built in: {', '.join(built_in)}; "
                    f"or define [materials.{name}]",
                )


def field_of_effects(partial: PartialScene) -> Iterator[Fault]:
    """Effects of the field have one."""
    if "field" in partial.data:
        return
    for one in partial.scene.effects.present:
        if one.needs_field:
            yield Fault(
                f"effects.{one.name}",
                "",
                f"needs a field; add [field] with source = {sources_in_words()}, or remove the effect's table",
            )


def faults_between_sections(partial: PartialScene) -> list[Fault]:
    """Run every check whose sections are right, and there."""
    void = partial.broken | {name for name in ("particles", "time") if getattr(partial.scene, name) is None}
    checks = [*CHECKS]
    if GEOMETRY_KIND not in void:
        checks += partial.scene.geometry.CHECKS
    if partial.scene.field is not None and "field" not in void:
        checks += partial.scene.field.CHECKS
    return [fault for check, sections in checks if not void & set(sections) for fault in check(partial)]


def _field_alone(partial: PartialScene) -> Iterator[Fault]:
    """A scene without grains has a coil's field to solve, and nothing that acts on grains."""
    scene = partial.scene
    if not partial.is_of_the_field_alone:
        if scene.time is None and "time" not in partial.broken:
            yield Fault("time", "", "is missing; add the section [time]")
        return
    of_grains = [one.name for one in scene.effects.present if not one.of_the_field_alone]
    if of_grains or "effects" in partial.broken:
        names = ", ".join(f"[effects.{name}]" for name in of_grains)
        yield Fault(
            "particles",
            "",
            f"is missing, but required by {names or '[effects]'}; add the section [particles], or, for the field "
            "alone, remove the tables of the effects",
        )
    elif scene.coil_field is None and "field" not in partial.broken:
        yield Fault(
            "particles",
            "",
            "is missing; add the section [particles]; without it a scene is of the field of a coil alone, which needs "
            f"[field] source = 'coil', [coil], and geometry.kind = {kinds_in_words(has_coil=True)}",
        )


def _shape(partial: PartialScene) -> Iterator[Fault]:
    """The shape itself, and that a grain fits into it; a drawing without grains may be any."""
    if partial.is_of_the_field_alone and partial.scene.geometry.is_from_file:
        return
    particles = partial.scene.particles

    def key_of(name: str) -> str:
        return f"particles.{size_key(particles)}" if name == "grain_diameter" else f"geometry.{name}"

    for fault in _faults_of_shape(partial, None if particles is None else particles.largest_diameter):
        found = partial.fault(key_of(fault.what), f"is not possible: {fault.message_with(key_of)}")
        yield (found if found.value else Fault(found.key, fault.value, found.message))  # a default has no entry to show


def _faults_of_shape(partial: PartialScene, diameter: float | None) -> list[GeometryFault]:
    """Check the valid dimensions of a partly invalid geometry."""
    if "geometry" not in partial.broken:
        return partial.scene.shape().faults(diameter)
    unknown = {key.split(".")[1] for key in partial.of_geometry}
    return partial.scene.geometry.check_valid_dimensions(unknown, partial.scene.materials or {}, diameter)


def _region(partial: PartialScene) -> Iterator[Fault]:
    particles, geometry = partial.scene.particles, partial.scene.geometry
    if particles.region != "cavity" and not geometry.has_regions:
        yield partial.fault(
            "particles.region",
            f"exists with geometry.kind = {kinds_in_words(has_regions=True)} only; remove it: a {geometry.kind} is "
            "filled as a whole",
        )


def _surfaces(partial: PartialScene) -> Iterator[Fault]:
    """A surface that no grain can reach, wherever its body turns to."""
    geometry, shape = partial.scene.geometry, partial.scene.shape()
    if geometry.is_from_file or shape.faults(None):
        return  # only the boxes that a CAD device is filled in are known, not all of its cavity; the latter is reported
    inner = 0.0
    if not geometry.has_axis:
        lower, upper = shape.lower, shape.upper
    else:
        boxes = shape.fill_boxes().values()
        inner, outer = min(box.r0 for box in boxes), max(box.r1 for box in boxes)
        lower = (-outer, -outer, min(box.z0 for box in boxes))
        upper = (outer, outer, max(box.z1 for box in boxes))
    for name, surface in partial.scene.surfaces.items():
        wall = surface.wall(name)
        low, high = wall.bounds
        beyond = any(a > up or b < down for a, b, up, down in zip(low, high, upper, lower, strict=True))
        within = max(math.hypot(x, y) for x, y, _ in wall.vertices) < inner
        if beyond or within:
            hole = f", r above {1e3 * inner:.4g}" if inner > 0.0 else ""
            yield partial.fault(
                f"surfaces.{name}.file",
                f"lies entirely outside the grains' space ({extent_in_words(lower, upper)}{hole} mm): it is at "
                f"{extent_in_words(low, high)} mm; move it, or check surfaces.{name}.scale",
            )


def _size_of_surfaces(partial: PartialScene) -> Iterator[Fault]:
    """A surface whose size says that its file's unit of length was misread: a mesh carries none."""
    particles, shape = partial.scene.particles, partial.scene.shape()
    if not partial.scene.surfaces or shape.faults(None):
        return
    space, grain = float(shape.extent().max()), particles.smallest_diameter
    for name, surface in partial.scene.surfaces.items():
        side = surface.longest_side(name)
        if side > TOO_WIDE * space:
            yield partial.fault(f"surfaces.{name}.file", surface.too_wide_in_words(name, space, grain))
        elif side < TOO_SMALL * grain:
            yield partial.fault(
                f"surfaces.{name}.file",
                f"measures {1e3 * side:.3g} mm, {side / grain:.2g} of a grain's diameter ({1e3 * grain:.4g} mm): its "
                f"unit of length is likely wrong; surfaces.{name}.scale = {1e3 * surface.scale:g} makes it "
                f"{1e6 * side:.4g} mm",
            )


def _fill(partial: PartialScene) -> Iterator[Fault]:
    particles, shape = partial.scene.particles, partial.scene.shape()
    if shape.faults(None):
        return  # already reported; volumes of a broken shape mean nothing
    start = partial.scene.scene  # without its seed the sizes are those to be expected
    fill = fill_of(shape, particles, None if start is None else start.seed)
    amounts = ("mass", "solid_fraction", "count")
    key = next((name for name in amounts if getattr(particles, name) is not None), "packing_file")
    densest = min(particles.largest_solid_fraction, partial.scene.geometry.largest_fill)
    most = densest * fill.volume
    limits = {
        "mass": f"{1e3 * most * particles.density:.4g} g",
        "solid_fraction": f"{densest:.2f}",
        "count": f"{int(most / particles.grain_volume / particles.n_sectors)}",
        "packing_file": "what the region holds",
    }
    half_a_grain = math.pi / 12.0 * particles.largest_diameter**3 * particles.n_sectors  # numbers are whole
    unusual = DENSITY.remark("particles.density", particles.density) if key == "mass" else None
    if fill.solid_fraction > densest * (1.0 + 1e-9) + half_a_grain / fill.volume:
        yield partial.fault(
            f"particles.{key}",
            f"fills {fill.solid_fraction:.3f} of the region ({1e6 * fill.volume:.4g} "
            f"cm^3), more than can be packed; allowed: at most {limits[key]}; lower it, or enlarge the "
            "region" + ("" if unusual is None else f"; {unusual}"),
        )
    elif fill.count > MAX_GRAINS:
        yield partial.fault(
            f"particles.{key}",
            f"makes {fill.count:.3g} grains; allowed: at most {MAX_GRAINS:.3g}; lower it, take a narrower "
            f"particles.sector, or raise particles.{size_key(particles)}",
        )
    if fill.count < 1:
        yield partial.fault(
            f"particles.{key}",
            f"is less than one grain; raise it, widen particles.sector, or lower particles.{size_key(particles)}",
        )


def _pour(partial: PartialScene) -> Iterator[Fault]:
    effects = partial.scene.effects
    if partial.scene.particles.packing == "pour" and effects.weight is None:
        needed = effects.tables(role="weight")
        yield partial.fault("particles.packing", f"needs weight; add {needed}, or take another packing")


def _motion(partial: PartialScene) -> Iterator[Fault]:
    if not partial.scene.geometry.has_axis:
        with_surfaces = {surface.body for surface in partial.scene.surfaces.values()}
        for shaft in ("rotor", "disc"):
            # a resolved scene has its defaults written out: a held shaft is no motion
            if shaft not in with_surfaces and getattr(partial.scene.motion, shaft) != HELD:
                yield Fault(
                    f"motion.{shaft}",
                    "",
                    "has nothing to turn in a box; remove the table, or take another geometry.kind",
                )


def _accuracy(partial: PartialScene) -> Iterator[Fault]:
    end, start = partial.scene.accuracy.time_end, partial.scene.time.average_from
    if start is not None and not_before(start, end):
        yield partial.fault(
            "accuracy.time_end", f"is not after time.average_from = {instant_in_words(start)}; raise it, or lower that"
        )


def _target(partial: PartialScene) -> Iterator[Fault]:
    """A target of accuracy decides itself when a run ends, by the torque on a disc."""
    scene = partial.scene
    if scene.accuracy.target is None:
        return
    if scene.time.until is not None:
        yield partial.fault(
            "accuracy.target",
            f"ends a run itself, by statistics and discretisation together, and time.until = '{scene.time.until}' does "
            "by statistics alone; remove one of them",
        )
    if scene.geometry.measured != "torque":
        yield partial.fault("accuracy.target", "needs a disc whose torque is measured; remove it")


def _replicas(partial: PartialScene) -> Iterator[Fault]:
    scene = partial.scene
    if (scene.accuracy.replicas or 1) > 1 and packs_alike(scene):
        yield partial.fault(
            "accuracy.replicas",
            f"asks for several replicas, but particles.packing = '{scene.particles.packing}' packs all of them "
            "identically; take a random packing, or one replica",
        )
    until, measured = scene.time.until, scene.geometry.measured
    if until is not None and not measured:
        yield partial.fault("time.until", "needs a disc whose torque is measured; remove it, a box ends at time.end")
    elif until is not None and until.quantity != measured:
        yield partial.fault(
            "time.until",
            f"is of a {until.quantity}, and with geometry.kind = '{scene.geometry.kind}' a {measured} is measured; "
            f"write until = '{measured} 2 %'",
        )


def _scatter(partial: PartialScene) -> Iterator[Fault]:
    """The scatter between replicas has its degrees of freedom, and replicas that it is of."""
    scene, accuracy = partial.scene, partial.scene.accuracy
    both = ("accuracy.replica_scatter", "accuracy.replica_scatter_freedom")
    if (accuracy.replica_scatter is None) != (accuracy.replica_scatter_freedom is None):
        given, lacking = both if accuracy.replica_scatter_freedom is None else both[::-1]
        yield partial.fault(given, f"needs {lacking} as well; give both, or none")
    elif accuracy.replica_scatter is None:
        return
    elif not has_steady_torque(scene):
        yield partial.fault(both[0], "needs a steady torque, which this scene does not have; remove it")
    elif accuracy.replicas == 1 or packs_alike(scene):
        yield partial.fault(
            both[0],
            "is pooled with the scatter of several replicas, and this scene has one; remove it, or take a random "
            "packing and accuracy.replicas = 2 to 64",
        )


def _initial_flow(partial: PartialScene) -> Iterator[Fault]:
    """Grains that begin in shear need a gap that is sheared as a whole."""
    scene = partial.scene
    if scene.particles.initial_velocity == "rest":
        return
    if scene.geometry.gap_zone(scene.shape(), scene.particles.region) is None:
        yield partial.fault(
            "particles.initial_velocity",
            f"cannot be 'sheared' in a device of kind '{scene.geometry.kind}', which has no gap between two shafts; "
            "remove it",
        )


# What a check needs is right: a section as a whole, or of the geometry no more than the kind and the materials.
CHECKS: tuple[tuple[Check, tuple[str, ...]], ...] = (
    (_field_alone, ()),
    (_shape, (GEOMETRY_KIND,)),
    (materials, (GEOMETRY_KIND, "materials")),
    (_region, (GEOMETRY_KIND, "particles")),
    (sector_in_geometry, (GEOMETRY_KIND, "particles")),
    (_surfaces, ("geometry", "surfaces")),
    (_size_of_surfaces, ("geometry", "surfaces", "particles")),
    (sector_in_surfaces, ("particles", "surfaces")),
    (_initial_flow, (GEOMETRY_KIND, "particles")),
    (_fill, ("geometry", "particles")),
    (_pour, ("particles", "effects")),
    (repose_agrees, ("particles", "contact", "effects")),
    (sector_width, ("geometry", "particles", "effects")),
    (field_of_effects, ("effects",)),
    *(check for effect in EFFECTS for check in effect.CHECKS),
    (_motion, (GEOMETRY_KIND, "motion", "surfaces")),
    (_accuracy, ("accuracy", "time")),
    (_target, (GEOMETRY_KIND, "accuracy", "time", "particles")),
    (one_slip, ("geometry", "accuracy", "time", "motion", "effects", "particles", "coil")),
    (_replicas, (GEOMETRY_KIND, "accuracy", "time", "particles")),
    (_scatter, ("geometry", "accuracy", "time", "motion", "effects", "particles", "coil")),
)
