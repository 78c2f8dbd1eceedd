"""The plan of a run in words: one line for each decision, for people."""

from __future__ import annotations

from collections.abc import Iterator
from math import asin, degrees, inf, sin
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from emclutch.device_model.coil_heat import winding_in_words
from emclutch.device_model.decision import Decision
from emclutch.device_model.device import CoilDevice, Device
from emclutch.device_model.excitation import Excitation
from emclutch.results.steady_torque import MIN_AVERAGED_STRAIN
from emclutch.scene.case import Case
from emclutch.scene.grain_smear import moments_are_fed_back, smear_width
from emclutch.scene.input_files import paths_elsewhere
from emclutch.scene.replica_count import max_replica_count, replica_count
from emclutch.scene.repose import friction_in_words
from emclutch.scene.sector_checks import innermost_radius
from emclutch.scene.start_up import start_up_strain
from emclutch.scene.surfaces import extent_in_words
from emclutch.settings.powder import sectors_of
from emclutch.simulation.contacts_in_words import contacts_in_words
from emclutch.simulation.scaled_slip import strain_rate
from emclutch.simulation.windows import UpdateRule, Windows
from field import MagneticField
from field.coil.inductance import apparent_inductance, incremental_inductance

if TYPE_CHECKING:
    from emclutch.device_model.device_3d import CoilDevice3D
    from emclutch.simulation.plan import Plan
    from field.three_d import Field3D

MIN_RISE = 7.0
"""Time constants of a coil that rise times need: three times the 2.3 after which an exponential is at 90 %."""

UPDATE_RULES = {
    UpdateRule.ASKED: " as asked",
    UpdateRule.EVERY_STEP: "",
    UpdateRule.PRESSURE_EVERY_STEP: "",
    UpdateRule.CONTACT: ", twice a contact and before a grain has moved by 1 % of a diameter",
    UpdateRule.PRESSURE: ", twice a contact",
    UpdateRule.WINDOW: ", once a window",
    UpdateRule.NEIGHBOURS: ". Pairs of grains that jump together gain 6 % too much energy (between 1 and 16 %); "
    "effects.dipoles.update_every = 1 prevents it",
    UpdateRule.PARTING: ". Pairs of grains that jump together gain 9 % too much energy, with a scatter of 20 %; "
    "effects.dipoles.update_every = 1 reduces it to 2 %",
}
NEAR_EVERY_STEP = (UpdateRule.NEIGHBOURS, UpdateRule.PARTING)


def plan_in_words(device: Device, plan: Plan) -> dict[str, str]:
    """Decisions for a run and their reasons: label -> text, in the order in which `emclutch check` prints them."""
    scene = plan.scene
    words = dict(device_in_words(scene, device))
    if plan.scaled is not None:
        words["speed"] = plan.scaled.in_words()
    coil, field = device.coil, plan.peak_field
    if coil is not None and coil.supply is not None and field is not None:
        words["coil"] = coil_in_words(scene, coil, coil.supply.resistance, field)
    if scene.grains.repose is not None:
        words["friction"] = friction_in_words(scene.grains.repose)
    words |= dict(contacts_in_words(scene, plan.contact))
    words |= dict(scene.geometry.words(scene, plan.end))
    sheared = 0.0 if scene.geometry.is_periodic else strain_rate(scene, device) * plan.end  # a box says so of itself
    words |= dict(windows_in_words(plan.division, sheared, scene))
    if moments_are_fed_back(scene) and coil is not None:
        words["feedback"] = feedback_in_words(scene, coil)
    if coil is not None:
        words |= {"winding": winding_in_words(scene), "mesh": coil.mesh_in_words()}
    words |= dict(end_in_words(scene, device, plan))
    words |= {"cost": plan.cost.in_words(), "cost by part": plan.cost.parts_in_words()}
    return words


def fill_in_words(scene, device: Device) -> str:
    """Return how much of the space of the grains they fill, and their mass in the whole device."""
    where = scene.grains.region if scene.geometry.has_regions else "space"
    where = "rim between the poles" if where == "poles" else where
    fill = device.fill
    return f"{100.0 * fill.solid_fraction:.3g} % by volume in the {where} ({1e3 * fill.mass:.3g} g of powder)"


def device_in_words(scene, device: Device) -> Iterator[tuple[str, str]]:
    """Grains, packing, surfaces and the sheared gap: label and text."""
    particles, fill = scene.grains, device.fill
    yield "grains", f"{fill.count} simulated of {fill.count * particles.n_sectors} in the device"
    yield "fill", fill_in_words(scene, device)
    yield "packing", packing_in_words(scene, device)
    if particles.sector is not None:
        yield "sector", sector_in_words(scene)
    for surface in device.surfaces:
        text = f"{len(surface.triangles)} triangles, {extent_in_words(*surface.bounds)} mm, on body {surface.body}"
        if scene.effects.images is not None:
            text += f"; not magnetic: it has no images (effects.{scene.effects.images.name}) and is not in the field"
        yield f"surface {surface.name}", text
    if scene.geometry.has_regions:
        yield (
            "sheared gap",
            f"{'at the faces' if device.shears_faces else 'at the rim'}, {1e3 * device.shear_gap:.3g} mm wide at a "
            f"mean radius of {1e3 * device.shear_radius:.3g} mm",
        )


def sector_in_words(scene) -> str:
    """Return the angle of the cyclic sector, and its width where it is narrowest; with a warning of a narrow one."""
    particles, radius = scene.grains, innermost_radius(scene)
    chord = 2.0 * radius * sin(0.5 * particles.sector)
    text = (
        f"{degrees(particles.sector):.5g} deg, 1/{particles.n_sectors} of the ring; {1e3 * chord:.3g} mm "
        f"({chord / particles.largest_diameter:.3g} diameters) wide at r = {1e3 * radius:.3g} mm"
    )
    return Decision(text, narrow_sector(scene))


def narrow_sector(scene) -> str:
    """Return a warning of a sector that is narrower than the gap in which magnetised powder is sheared; else empty."""
    particles, gap = scene.grains, scene.shape().sheared_gap(scene.grains.region)
    if particles.sector is None or scene.effects.attraction is None or gap is None:
        return ""
    width = 2.0 * gap.radius * sin(0.5 * particles.sector)
    if width >= gap.width:
        return ""
    wanted = 2.0 * asin(min(1.0, 0.5 * gap.width / gap.radius))
    return (
        f"the sector is {1e3 * width:.3g} mm wide in the sheared gap of {1e3 * gap.width:.3g} mm: the torque of "
        "magnetised powder can come out too large, and rise with the strain (docs/accuracy.md); widen particles.sector "
        f"to '{360.0 / sectors_of(scene, wanted):.10g} deg' or more"
    )


def packing_in_words(scene, device: Device) -> str:
    """Text on the packing of the grains, and to what they settle."""
    particles, gravity = scene.particles, scene.effects.weight
    lattice = f" ({particles.lattice})" if particles.packing == "lattice" else ""
    if not particles.settles:
        return f"{particles.packing}{lattice}; the run starts from this packing"
    longest = particles.settle_longest
    weight = 0.0 if gravity is None else gravity.acceleration
    if longest is not None:
        limit = f"{longest:.3g} s as asked"
    elif weight > 0.0:
        limit = f"100 falls through the device ({100.0 * np.sqrt(2.0 * device.extent.max() / weight):.3g} s)"
    else:
        limit = "1e5 steps"
    energy = "m g d" if weight > 0.0 else "the energy stored in contacts"
    return (
        f"{particles.packing}{lattice}; before time 0 the grains settle, shafts held and no magnetic forces, to a "
        f"kinetic energy of {particles.settle_kinetic:.2g} of {energy}; longest: {limit}, not counted in the cost"
    )


def coil_in_words(scene, coil: Excitation, resistance: float, field: MagneticField | Field3D) -> str:
    """Resistance, current and, where its circuit is simulated, inductance and time constant of a coil at a voltage."""
    loss = resistance * coil.largest_current**2
    text = f"{resistance:.3g} ohm: up to {coil.largest_current:.3g} A, {loss:.3g} W of copper loss"
    if scene.effects.circuit is not None and coil.largest_current > 0.0:
        inductance = apparent_inductance(field, coil.turns)
        tau = inductance / resistance
        text += f"; {inductance:.3g} H at that current (incremental {incremental_inductance(field, coil.turns):.3g} H)"
        text += f": time constant about {tau:.3g} s"
        if scene.time.end_time < MIN_RISE * tau:
            short = f"time.end = {scene.time.end_time:.3g} s is below {MIN_RISE:g} time constants of the coil"
            return Decision(text, f"{short}; for rise times take {10.0 * tau:.2g} s, ten of them, or more")
    return text


def windows_in_words(division: Windows, strain: float, scene) -> Iterator[tuple[str, str]]:
    """Interval of magnetic forces, its reason, and the windows, with the strain at their end: label and text."""
    if division.rule is not None:
        steps = division.steps_per_update
        every = f"every {steps} steps" if steps > 1 else "every step"
        if division.rule in NEAR_EVERY_STEP:
            every = f"near attraction updated every step, far forces {every}"
        of_pressure = division.rule in (UpdateRule.PRESSURE, UpdateRule.PRESSURE_EVERY_STEP)
        what = ("pressure", "followed ") if of_pressure else ("magnetic forces", "")
        yield what[0], f"{what[1]}{every}{UPDATE_RULES[division.rule]}"
    text = (
        f"{division.steps} steps = {division.length:.3g} s, {division.count} windows to t = {division.end:.4g} s"
        f"{f', a shear strain of {strain:.3g}' if strain else ''}"
    )
    given, snapshots = scene.time.window, scene.output.snapshots
    if given is not None and division.length < 0.999 * given:
        text += f"; time.window = {given:.3g} s is rounded down to whole steps"
    if division.end < 0.99 * scene.time.end_time:
        text += f"; one more would go beyond time.end = {scene.time.end_time:.4g} s"
    if division.jump is not None:
        text += f"; the coil's drive changes within {division.jump:.3g} s, less than a window: its field jumps"
    if snapshots > division.count:
        text += f"; {division.count} of the {snapshots} frames of output.snapshots, one for each window"
    yield "coupling window", text


def feedback_in_words(scene, coil: CoilDevice | CoilDevice3D) -> str:
    """Return the width over which moments are fed back, and why."""
    width, d = smear_width(scene), scene.particles.largest_diameter
    text = f"moments spread over {1e3 * width:.3g} mm ({width / d:.3g} diameters"
    if width < scene.effects.attraction.cutoff * d:
        attraction = scene.effects.attraction
        text += f": the gap's width, less than effects.{attraction.name}.cutoff = {attraction.cutoff:g}"
    return text + f"); {len(coil.problem.powder_elements)} field elements in the powder and beside it"


def end_in_words(scene, device: Device, plan: Plan) -> Iterator[tuple[str, str]]:
    """Return number of replicas, start-up and end of a run, and whether its torque can be known by then."""
    count, until, end = replica_count(scene), scene.time.until, plan.end
    measured = scene.geometry.measured or "result"
    if count > 1:
        most, at_a_time = max_replica_count(scene), plan.cost.replicas
        more = f", up to {most} if the error is still too large" if until is not None and most > count else ""
        yield "replicas", f"{count}{more}, {at_a_time} at a time; the {measured} is their mean"
    rate, needed = strain_rate(scene, device), start_up_strain(scene)
    if rate and count > 1:
        start_up = scene.time.average_time or needed / rate
        why = f"a shear strain of {needed:g}; nor in the first half of the run"
        if scene.time.average_time is not None:
            why = "as the scene says"
        yield "start-up", f"not averaged before {start_up:.3g} s ({why})"
    if until is not None:
        strain = rate * end if rate else inf
        least = needed + MIN_AVERAGED_STRAIN
        text = f"when half the 95 % interval of the {measured} is at most {until.size}, or at {end:.4g} s"
        if strain < least and not scene.geometry.is_periodic:  # which says so of itself
            text = Decision(
                text,
                f"the shear strain at that time is {strain:.2g}, and a torque counts as known from a strain of "
                f"{least:g} on: raise time.end to {end * 1.2 * least / max(strain, 1e-9):.2g} s",
            )
        yield "end", text


def paths_in_words(case: Case) -> dict[str, str]:
    """Paths of the scene outside its folder; nothing where all lie within."""
    elsewhere = paths_elsewhere(case.scene, case.data, Path() if case.path is None else case.path.parent)
    if not elsewhere:
        return {}
    named = ", ".join(f"{key} = {path}" for key, path in elsewhere.items())
    return {"paths": f"outside the scene's folder: {named}"}
