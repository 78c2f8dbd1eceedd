"""What the sections of a scene demand of each other. Each check is a small function that yields faults."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from emclutch.faults import Fault, shown
from emclutch.scene.fault_report import entry_at
from emclutch.scene.field_source import CoilField, UniformField
from emclutch.scene.fill import fill_of
from emclutch.scene.geometry import BoxGeometry, CadGeometry, CentrifugalGeometry, ClutchGeometry, ShearCellGeometry
from emclutch.scene.grain_smear import LEAST_WIDTH, moments_are_fed_back, narrowest_gap, smear_width
from emclutch.scene.motion import HELD
from emclutch.scene.replica_count import packs_alike
from emclutch.scene.section import did_you_mean
from emclutch.scene.surfaces import extent_in_words

if TYPE_CHECKING:
    from geometry.fault import Fault as ShapeFault

# Reach of a contact in grain diameters: the Verlet list holds pairs that may touch before it is built anew.
_NEAR_REACH = 1.8  # diameters: two radii and the farthest gap of a near pair, 1.2 radii, where dipoles are whole
_CONTACT_REACH = 1.3


@dataclass(frozen=True, slots=True)
class Draft:
    """A scene whose sections are right one by one; those that are not are left out and listed as broken.

    Of a geometry with faults at the keys `of_geometry` the scene has a sketch, if its kind is known
    (`emclutch.scene.geometry_sketch`).
    """

    scene: Any
    data: dict[str, Any]
    broken: frozenset[str]
    of_geometry: frozenset[str] = frozenset()

    def fault(self, key: str, message: str) -> Fault:
        """Return a fault that shows the user's entry at the key."""
        entry = entry_at(self.data, key.split("."))
        return Fault(key, "" if entry is None or isinstance(entry, dict) else shown(entry), message)


GEOMETRY_KIND = "geometry.kind"
"""Stands in `Draft.broken` where of the geometry not even the kind is known."""

Check = Callable[[Draft], Iterator[Fault]]


def faults_between_sections(draft: Draft) -> list[Fault]:
    """Run every check whose sections are right."""
    return [fault for check, sections in CHECKS if not draft.broken & set(sections) for fault in check(draft)]


def _size_key(particles: Any) -> str:
    """The key of [particles] that says how large the grains are."""
    return "sizes" if particles.sizes is not None else "packing_file" if particles.diameter is None else "diameter"


def _shape(draft: Draft) -> Iterator[Fault]:
    """The shape itself, and that a grain fits into it."""
    particles = draft.scene.particles
    for fault in _faults_of_shape(draft, None if particles is None else particles.largest_diameter):
        message = f"cannot be: {fault.message}".replace("`", "")
        if particles is not None:
            message = message.replace("particles.diameter", f"particles.{_size_key(particles)}")
        told = draft.fault(fault.key, message)
        yield (told if told.value else Fault(fault.key, fault.value, told.message))  # a default has no entry to show


def _faults_of_shape(draft: Draft, diameter: float | None) -> list[ShapeFault]:
    """Of a clutch with faulty sizes, what the others say of each other."""
    if "geometry" not in draft.broken:
        return draft.scene.shape().faults(diameter)
    if not isinstance(draft.scene.geometry, ClutchGeometry):
        return []
    unknown = {key.split(".")[1] for key in draft.of_geometry}
    lengths = unknown & set(type(draft.scene.geometry).model_fields) - {"materials", "disc_slots", "rotor_slots"}
    # not a number: whatever is compared with it is judged neither right nor wrong, but for itself, told already
    shape = draft.scene.geometry.model_copy(update=dict.fromkeys(lengths, math.nan)).shape(draft.scene.materials or {})
    return [fault for fault in shape.faults(diameter) if fault.key.split(".")[1] not in unknown]


def _materials(draft: Draft) -> Iterator[Fault]:
    from field.laws.materials import canonical_name, material_aliases, material_names  # local: only here

    built_in, own = material_names(), list(draft.scene.materials or {})
    for name in own:
        if canonical_name(name) is not None:
            yield draft.fault(f"materials.{name}", "has the name of a built-in material; choose another name")
    if isinstance(draft.scene.geometry, (ClutchGeometry, CadGeometry)):
        for region, name in dict(draft.scene.geometry.materials or {}).items():
            if canonical_name(name) is None and name not in own:
                yield draft.fault(
                    f"geometry.materials.{region}",
                    f"is no material; {did_you_mean(name, [*own, *built_in, *material_aliases()])}"
                    f"built in: {', '.join(built_in)}; "
                    f"or define [materials.{name}]",
                )


def _field(draft: Draft) -> Iterator[Fault]:
    field, geometry = draft.scene.field, draft.scene.geometry
    if isinstance(field, CoilField) and not isinstance(geometry, (ClutchGeometry, CadGeometry)):
        yield draft.fault(
            "field.source",
            f"needs a device with a coil, but geometry.kind = '{geometry.kind}'; "
            "take geometry.kind = 'clutch', 'drum' or 'cad', or field.source = 'uniform'",
        )
    elif isinstance(field, CoilField) and draft.scene.coil is None and "coil" not in draft.broken:
        yield Fault("coil", "", "is missing, but field.source = 'coil'; add [coil] with its current and turns")
    if isinstance(field, UniformField) and field.direction == "radial" and not isinstance(geometry, ShearCellGeometry):
        yield draft.fault(
            "field.direction",
            "needs geometry.kind = 'shear_cell', whose mid radius is that of "
            "field_strength; take another direction, e.g. 'axial'",
        )


def _region(draft: Draft) -> Iterator[Fault]:
    particles, geometry = draft.scene.particles, draft.scene.geometry
    if particles.region != "cavity" and not isinstance(geometry, ClutchGeometry):
        yield draft.fault(
            "particles.region",
            f"exists in a clutch or drum only; remove it: a {geometry.kind} is filled as a whole",
        )


def _sector_in_geometry(draft: Draft) -> Iterator[Fault]:
    if draft.scene.particles.sector is None:
        return
    if isinstance(draft.scene.geometry, BoxGeometry):
        yield draft.fault(
            "particles.sector",
            "needs a shape with an axis; remove it, or take another geometry.kind than 'box'",
        )
    if isinstance(draft.scene.geometry, CentrifugalGeometry):
        yield draft.fault(
            "particles.sector",
            "cannot stand in a centrifugal clutch: its vanes and ribs do not repeat from sector to sector as one turns "
            "past the other; remove it (the full ring is simulated)",
        )


def _surfaces(draft: Draft) -> Iterator[Fault]:
    """A surface that no grain can reach, wherever its body turns to."""
    geometry, shape = draft.scene.geometry, draft.scene.shape()
    if isinstance(geometry, CadGeometry) or shape.faults(None):
        return  # only the boxes that a CAD device is filled in are known, not all of its cavity; the latter is told
    inner = 0.0
    if isinstance(geometry, BoxGeometry):
        lower, upper = shape.lower, shape.upper
    else:
        boxes = shape.fill_boxes().values()
        inner, outer = min(box.r0 for box in boxes), max(box.r1 for box in boxes)
        lower = (-outer, -outer, min(box.z0 for box in boxes))
        upper = (outer, outer, max(box.z1 for box in boxes))
    for name, surface in draft.scene.surfaces.items():
        wall = surface.wall(name)
        low, high = wall.bounds
        beyond = any(a > up or b < down for a, b, up, down in zip(low, high, upper, lower, strict=True))
        within = max(math.hypot(x, y) for x, y, _ in wall.vertices) < inner
        if beyond or within:
            hole = f", r above {1e3 * inner:.4g}" if inner > 0.0 else ""
            yield draft.fault(
                f"surfaces.{name}.file",
                f"lies wholly outside the grains' space ({extent_in_words(lower, upper)}{hole} mm): it is at "
                f"{extent_in_words(low, high)} mm; move it, or check surfaces.{name}.scale",
            )


def _sector_in_surfaces(draft: Draft) -> Iterator[Fault]:
    if draft.scene.particles.sector is not None and draft.scene.surfaces:
        yield draft.fault(
            "particles.sector",
            "cannot stand beside [surfaces]: a mesh does not repeat from sector to sector; remove one of them",
        )


def _sector_in_gravity(draft: Draft) -> Iterator[Fault]:
    gravity = draft.scene.effects.gravity
    if draft.scene.particles.sector is not None and gravity is not None and any(gravity.direction[:2]):
        yield Fault(
            "effects.gravity.direction",
            shown(list(gravity.direction)),
            "turns from sector to sector; with particles.sector it must lie along the axis: take [0, 0, -1], "
            "or remove particles.sector or [effects.gravity]",
        )


def _sector_in_field(draft: Draft) -> Iterator[Fault]:
    field = draft.scene.field
    if draft.scene.particles.sector is not None and isinstance(field, UniformField) and field.direction in ("x", "y"):
        yield draft.fault(
            "field.direction",
            "turns from sector to sector; with particles.sector take 'axial' or 'radial', or remove particles.sector",
        )


def _rigid(draft: Draft) -> Iterator[Fault]:
    """What rigid grains cannot do yet, and what their solvers exclude."""
    scene = draft.scene
    contact = scene.contact
    if contact.dvi.solver in ("psor", "apgd") and contact.dvi.friction_law != "convex":
        yield draft.fault("contact.dvi.solver", "solves the convex law; add friction_law = 'convex', or take another")
    if contact.dvi.springs and contact.dvi.solver in ("interior_point", "apgd"):
        yield draft.fault(
            "contact.dvi.springs", f"cannot stand beside solver = '{contact.dvi.solver}'; remove one of them"
        )
    if contact.method != "dvi":
        return
    if scene.particles is not None and scene.particles.sector is not None:
        yield draft.fault(
            "particles.sector",
            "cannot stand beside contact.method = 'dvi'; remove it (the full ring is simulated), or take 'dem'",
        )
    if scene.effects is None:
        return
    if scene.effects.cohesion is not None:
        yield Fault(
            "effects.cohesion", "", "exists with contact.method = 'dem' only; remove the table, or take method = 'dem'"
        )
    for name in ("rolling_friction", "twisting_friction"):
        if getattr(scene.effects, name) is not None and contact.dvi.solver in ("interior_point", "apgd"):
            yield Fault(
                f"effects.{name}",
                "",
                f"cannot stand beside contact.dvi.solver = '{contact.dvi.solver}'; remove the table, or "
                "take 'accelerated'",
            )


def _fill(draft: Draft) -> Iterator[Fault]:
    particles, shape = draft.scene.particles, draft.scene.shape()
    if shape.faults(None):
        return  # already told; volumes of a broken shape mean nothing
    fill = fill_of(shape, particles)
    amounts = ("mass", "solid_fraction", "count")
    key = next((name for name in amounts if getattr(particles, name) is not None), "packing_file")
    densest = particles.largest_solid_fraction
    most = densest * fill.volume
    limits = {
        "mass": f"{1e3 * most * particles.density:.4g} g",
        "solid_fraction": f"{densest:.2f}",
        "count": f"{int(most / particles.grain_volume / particles.n_sectors)}",
        "packing_file": "what the region holds",
    }
    if fill.solid_fraction > densest * (1.0 + 1e-9):
        yield draft.fault(
            f"particles.{key}",
            f"fills {fill.solid_fraction:.2f} of the region ({1e6 * fill.volume:.4g} "
            f"cm^3), more than can be packed; allowed: at most {limits[key]}; lower it, or enlarge the "
            "region",
        )
    if fill.count < 1:
        yield draft.fault(
            f"particles.{key}",
            f"is less than one grain; raise it, widen particles.sector, or lower particles.{_size_key(particles)}",
        )


def _pour(draft: Draft) -> Iterator[Fault]:
    if draft.scene.particles.packing == "pour" and draft.scene.effects.gravity is None:
        yield draft.fault("particles.packing", "needs weight; add [effects.gravity], or take another packing")


def _sector_width(draft: Draft) -> Iterator[Fault]:
    """Neither its own image nor one partner through both faces may be in a grain's reach."""
    particles, shape = draft.scene.particles, draft.scene.shape()
    if particles.sector is None or isinstance(draft.scene.geometry, (BoxGeometry, CentrifugalGeometry)):
        return
    largest = particles.largest_diameter
    if shape.faults(None):
        return
    dipoles = draft.scene.effects.dipoles
    reach = largest * (_CONTACT_REACH if dipoles is None else max(dipoles.cutoff, _CONTACT_REACH))
    if moments_are_fed_back(draft.scene) and isinstance(draft.scene.geometry, (ClutchGeometry, CadGeometry)):
        reach = max(smear_width(draft.scene), largest * _CONTACT_REACH)  # in a narrow gap the shorter of the two
    radius = fill_of(shape, particles).inner_radius + 0.5 * largest
    chord = 2.0 * radius * math.sin(0.5 * particles.sector)
    if chord < 2.0 * reach:
        narrowest = 2.0 * math.asin(min(1.0, reach / radius))
        wider = 360.0 / max(1, math.floor(2.0 * math.pi / narrowest))
        shorter = "" if dipoles is None else ", or lower effects.dipoles.cutoff"
        yield draft.fault(
            "particles.sector",
            f"is {1e3 * chord:.4g} mm wide at r = {1e3 * radius:.4g} mm, less than two "
            f"reaches of a grain ({2e3 * reach:.4g} mm); allowed: at least '{wider:.10g} deg'; widen it, "
            f"lower particles.{_size_key(particles)}{shorter}",
        )


def _needs_of_effects(draft: Draft) -> Iterator[Fault]:
    effects, has_field = draft.scene.effects, "field" in draft.data
    magnetic = effects.magnetic_force is not None or effects.dipoles is not None
    for name in ("magnetic_force", "dipoles", "back_reaction"):
        if getattr(effects, name) is not None and not has_field:
            yield Fault(
                f"effects.{name}",
                "",
                "needs a field; add [field] with source = 'coil' or 'uniform', or remove the effect's table",
            )
    for name in ("saturation", "back_reaction"):
        if getattr(effects, name) is not None and not magnetic:
            yield Fault(
                f"effects.{name}",
                "",
                "needs magnetised grains; add [effects.dipoles] or "
                "[effects.magnetic_force], or remove the effect's table",
            )
    yield from _needs_of_moments(draft)
    if effects.wall_images is not None and effects.dipoles is None:
        yield Fault("effects.wall_images", "", "needs dipoles to mirror; add [effects.dipoles], or remove its table")
    if effects.back_reaction is not None and isinstance(draft.scene.field, UniformField):
        yield Fault(
            "effects.back_reaction",
            "",
            "needs a field that is solved, and field.source = 'uniform' is "
            "prescribed; take field.source = 'coil', or remove its table",
        )


def _needs_of_moments(draft: Draft) -> Iterator[Fault]:
    """What grains that magnetise one another need, and what cannot stand beside them."""
    effects, particles = draft.scene.effects, draft.scene.particles
    if effects.dipoles is None:
        return
    model, source = effects.dipoles.model, draft.scene.field
    macroscopic = isinstance(source, UniformField) and source.means == "macroscopic"
    if model == "fixed":
        if macroscopic:
            yield draft.fault(
                "field.means",
                "is not used by effects.dipoles.model = 'fixed'; take model = 'near_field' or 'mutual', or remove it",
            )
        return
    if particles.law == "thesis":
        yield draft.fault(
            "effects.dipoles.model",
            "does not go with particles.law = 'thesis': M = chi H has no material behind it, in which grains could "
            "magnetise one another; take model = 'fixed', or law = 'sphere'",
        )
    if model == "near_field" and effects.saturation is None:
        yield draft.fault(
            "effects.dipoles.model",
            "needs grains that saturate, their necks do so first; add [effects.saturation], or take model = 'mutual'",
        )
    if model == "near_field" and effects.dipoles.cutoff < _NEAR_REACH:
        yield draft.fault(
            "effects.dipoles.cutoff",
            f"ends inside the range of near grains; allowed with model = 'near_field': at least {_NEAR_REACH:g} "
            "diameters",
        )
    if macroscopic and effects.dipoles.cutoff < 2.0:
        yield draft.fault(
            "effects.dipoles.cutoff",
            "is the width over which field.means = 'macroscopic' spreads a grain; allowed: at least 2 diameters "
            "(2.5 to 3 are usual)",
        )


def _room_for_the_smear(draft: Draft) -> Iterator[Fault]:
    """What spreading the grains' moments over the section needs: a gap of two diameters, and room about the axis."""
    scene = draft.scene
    if not (moments_are_fed_back(scene) and isinstance(scene.geometry, (ClutchGeometry, CadGeometry))):
        return
    shape = scene.shape()
    if shape.faults(None) or isinstance(scene.field, UniformField):
        return
    assert scene.effects.dipoles is not None  # without it nothing is fed back
    largest, gap = scene.particles.largest_diameter, narrowest_gap(scene)
    if gap < LEAST_WIDTH * largest:
        yield draft.fault(
            "effects.back_reaction",
            f"spreads each grain over at least {LEAST_WIDTH:g} diameters, and the gap of {1e3 * gap:.3g} mm has "
            f"{gap / largest:.3g}; remove its table (the field then holds no grain), take effects.dipoles.model = "
            f"'fixed', or lower particles.{_size_key(scene.particles)}",
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
            f"{4e3 * width:.3g} mm; remove its table, lower effects.dipoles.cutoff, or take model = 'fixed'",
        )


def _coil_transients(draft: Draft) -> Iterator[Fault]:
    effects = draft.scene.effects
    magnetic = effects.magnetic_force is not None or effects.dipoles is not None
    coil, solved = draft.scene.coil, isinstance(draft.scene.field, CoilField)
    for name in ("coil_circuit", "eddy_currents"):
        if getattr(effects, name) is not None and not (solved and magnetic):
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


def _slots(draft: Draft) -> Iterator[Fault]:
    """What a field in space cannot do, or not yet."""
    geometry, effects = draft.scene.geometry, draft.scene.effects
    if not isinstance(geometry, ClutchGeometry) or not isinstance(draft.scene.field, CoilField):
        return
    slotted = {key: s for key in ("disc_slots", "rotor_slots") if (s := getattr(geometry, key)) is not None}
    if not slotted:
        return
    key = f"geometry.{next(iter(slotted))}"
    if len(slotted) == 2:
        yield Fault(
            "geometry.rotor_slots",
            "",
            "stands beside geometry.disc_slots: the field would change with the angle between both, and is solved "
            "once a current only; keep one of them",
        )
    for name in ("back_reaction", "coil_circuit", "eddy_currents"):
        if getattr(effects, name) is not None:
            yield Fault(
                f"effects.{name}", "", f"is not there for a field in space, which {key} asks for; remove one of them"
            )
    if draft.scene.field.tolerance is not None:
        yield draft.fault(
            "field.tolerance", f"refines the mesh of a section, but {key} asks for a field in space; remove it, and "
            "set the mesh by field.size_factor"
        )  # fmt: skip
    sector = draft.scene.particles.sector
    if sector is not None and len(slotted) == 1:
        pitches = sector * slotted[next(iter(slotted))].count / (2.0 * math.pi)
        if abs(pitches - round(pitches)) > 1e-6 or round(pitches) < 1:
            pitch = 360.0 / slotted[next(iter(slotted))].count
            yield draft.fault(
                "particles.sector",
                f"is {pitches:.4g} pitches of {key}; the field repeats every pitch only: take '{pitch:.10g} deg' or a "
                "multiple, or another count of slots",
            )


def _motion(draft: Draft) -> Iterator[Fault]:
    if isinstance(draft.scene.geometry, BoxGeometry):
        with_surfaces = {surface.body for surface in draft.scene.surfaces.values()}
        for shaft in ("rotor", "disc"):
            # a resolved scene has its defaults written out: a held shaft is no motion
            if shaft not in with_surfaces and getattr(draft.scene.motion, shaft) != HELD:
                yield Fault(
                    f"motion.{shaft}",
                    "",
                    "has nothing to turn in a box; remove the table, or take another geometry.kind",
                )


def _accuracy(draft: Draft) -> Iterator[Fault]:
    end, start = draft.scene.accuracy.time_end, draft.scene.time.average_from
    if end is not None and start is not None and end <= start:
        yield draft.fault("accuracy.time_end", f"is not after time.average_from = {start:g} s; raise it, or lower that")


def _replicas(draft: Draft) -> Iterator[Fault]:
    scene = draft.scene
    if (scene.accuracy.replicas or 1) > 1 and packs_alike(scene):
        yield draft.fault(
            "accuracy.replicas",
            f"asks for several packings, and particles.packing = '{scene.particles.packing}' packs all of them alike; "
            "take a random packing, or one replica",
        )
    if scene.time.until is not None and scene.geometry.kind == "box":
        yield draft.fault("time.until", "has no disc whose torque could be known; remove it, a box ends at time.end")


# What a check needs is right: a section as a whole, or of the geometry no more than the kind and the materials.
CHECKS: tuple[tuple[Check, tuple[str, ...]], ...] = (
    (_shape, (GEOMETRY_KIND,)),
    (_materials, (GEOMETRY_KIND, "materials")),
    (_field, (GEOMETRY_KIND, "field")),
    (_region, (GEOMETRY_KIND, "particles")),
    (_sector_in_geometry, (GEOMETRY_KIND, "particles")),
    (_surfaces, ("geometry", "surfaces")),
    (_sector_in_surfaces, ("particles", "surfaces")),
    (_sector_in_gravity, ("particles", "effects")),
    (_sector_in_field, ("particles", "field")),
    (_fill, ("geometry", "particles")),
    (_pour, ("particles", "effects")),
    (_rigid, ("contact",)),
    (_sector_width, ("geometry", "particles", "effects")),
    (_needs_of_effects, ("effects",)),
    (_room_for_the_smear, ("geometry", "particles", "effects", "field")),
    (_coil_transients, ("effects", "coil", "field", GEOMETRY_KIND, "materials")),
    (_slots, (GEOMETRY_KIND, "effects", "field", "particles")),
    (_motion, (GEOMETRY_KIND, "motion", "surfaces")),
    (_accuracy, ("accuracy", "time")),
    (_replicas, (GEOMETRY_KIND, "accuracy", "time", "particles")),
)
