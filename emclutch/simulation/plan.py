"""Everything that is decided before the first step, with its reason: `emclutch check` prints it, `run` follows it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from math import ceil, floor, inf
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from emclutch.device.device import CoilDevice, Device, build_device
from emclutch.results.steady_torque import LEAST_STRAIN
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import bad_input_for
from emclutch.scene.grain_smear import moments_are_fed_back, smear_width
from emclutch.scene.input_files import paths_elsewhere
from emclutch.scene.replica_count import replica_count
from emclutch.scene.surfaces import extent_in_words
from emclutch.scene.usual_ranges import FLUX_DENSITY
from emclutch.simulation.contact_plan import dvi_springs, elastic_contacts
from emclutch.simulation.dvi_plan import DviPlan, plan_dvi
from emclutch.simulation.forecast.cost import Cost, foretell
from emclutch.simulation.forecast.expected_field import expected_magnetisation, field_in_chains, powder_in_words
from emclutch.simulation.forecast.expected_speeds import device_extent, fall_speed, largest_speed, layer_speed
from emclutch.simulation.forecast.machine_speed import MachineSpeed, threads_at_hand
from field import MagneticField
from field.coil.inductance import apparent_inductance, incremental_inductance
from field.factorisation import describe_backend
from field.three_d import Field3D
from geometry import Clutch
from particles import CyclicSector, PairLaws

if TYPE_CHECKING:
    from emclutch.device.device_3d import CoilDevice3D
    from emclutch.simulation.forecast.effects_left_out import LeftOut
    from emclutch.simulation.forecast.expected_torque import ExpectedTorque


MOST_STEPS = 1e12
"""Of a run: one grain alone takes a week for them."""


@dataclass(frozen=True, slots=True)
class Plan:
    """The numbers that a run starts from.

    Attributes
    ----------
    count : int
        Grains that are simulated (those of the sector).
    sector : CyclicSector or None
    contact : PairLaws or DviPlan
        By DEM, or by DVI.
    dt : float
        Step of the grains [s].
    steps_per_update, updates, windows : int
        Steps between evaluations of the magnetic forces; evaluations a window; windows of the run.
    peak_field : MagneticField, Field3D or None
        Solution at the largest current with the powder spread evenly.
    M_max : float
        Largest magnetisation of a grain to be expected [A/m].
    stiffness : float or None
        Normal stiffness of a contact between grains, at the largest overlap to be expected [N/m]; None: rigid.
    reasons : dict of str to str
        One line for each decision, for people: what decides is in the other attributes.
    cost : Cost
        Of the run on this machine.
    """

    count: int
    sector: CyclicSector | None
    contact: PairLaws | DviPlan
    dt: float
    steps_per_update: int
    updates: int
    windows: int
    peak_field: MagneticField | Field3D | None
    M_max: float
    stiffness: float | None
    reasons: dict[str, str]
    cost: Cost

    @property
    def contact_data(self) -> dict[str, str | bool | float | None]:
        """How contacts are solved, for those who read a run's folder: method, whether grains press in, stiffness [N/m].

        By DEM they always do; by DVI where the scene gives them springs.
        """
        method = "dem" if isinstance(self.contact, PairLaws) else "dvi"
        return {"method": method, "compliant": self.stiffness is not None, "stiffness": self.stiffness}

    def continued(self, steps_per_update: int, updates: int, end: float) -> Plan:
        """The plan of a run that goes on with the windows it began with, to the time `end` [s]."""
        windows = _parts(end, steps_per_update * updates * self.dt)
        return replace(self, steps_per_update=steps_per_update, updates=updates, windows=windows)

    @property
    def end(self) -> float:
        """Time at the end of the last window [s]."""
        return self.windows * self.updates * self.steps_per_update * self.dt


def make_plan(
    case: Case, device: Device | None = None, threads: int | None = None, machine: MachineSpeed | None = None
) -> tuple[Device, Plan]:
    """Build the device (unless given) and decide stiffness, step, windows and numbers of the run.

    The cost is that on `threads` threads (default: as a run takes them) of a machine (default: the one at hand).

    Raises ValueError with a remedy when the scene's own step is too long, or its stiffness is too low or does
    not follow from it.
    """
    scene = case.scene
    device = device or build_device(scene)
    particles = scene.grains
    sector = None if particles.sector is None else CyclicSector(particles.sector)
    fill = device.fill
    where = particles.region if isinstance(device.shape, Clutch) else "space"
    where = "rim between the poles" if where == "poles" else where
    reasons = {
        "grains": f"{fill.count} simulated of {fill.count * particles.n_sectors} in the device "
        f"({fill.mass * 1e3:.3g} g), solid fraction {fill.solid_fraction:.3f} of the {where} filled",
        "packing": _packing_in_words(scene, device),
    }
    for surface in device.surfaces:
        reasons[f"surface {surface.name}"] = (
            f"{len(surface.triangles)} triangles, {extent_in_words(*surface.bounds)} mm, on body {surface.body}"
        )
        if scene.effects.wall_images is not None:
            reasons[f"surface {surface.name}"] += (
                "; taken as not magnetic: it mirrors no dipoles (effects.wall_images) and is not in the field's solve"
            )
    if isinstance(device.shape, Clutch):
        reasons["sheared gap"] = (
            f"{'at the faces' if device.shears_faces else 'at the rim'}, {1e3 * device.shear_gap:.3g} mm wide at a "
            f"mean radius of {1e3 * device.shear_radius:.3g} mm"
        )
    field, M_max = expected_magnetisation(case, device)
    if isinstance(field, MagneticField) and isinstance(device.coil, CoilDevice) and device.coil.resistance is not None:
        reasons["coil"] = _coil_in_words(scene, device.coil, field)
    speed = largest_speed(scene, device)
    contact: PairLaws | DviPlan
    if scene.contact.method == "dvi":
        springs = dvi_springs(scene, device, M_max, speed, reasons)
        contact, dt = plan_dvi(scene, M_max, speed, springs, reasons)
        stiffness = None if springs is None else float(springs[0, 0])
    else:
        contact, dt, stiffness = elastic_contacts(scene, device, M_max, speed, reasons)
    layers = max(fall_speed(scene, device), layer_speed(scene, device, speed))
    per_update, updates, windows = _windows(scene, dt, speed, layers, M_max > 0.0 or field is not None, reasons)
    if moments_are_fed_back(scene) and isinstance(device.coil, CoilDevice):
        reasons["feedback"] = _feedback_in_words(scene, device.coil)
    if device.coil is not None:
        reasons["mesh"] = mesh_in_words(device.coil)
    threads = threads or _threads_of_a_replica(scene)
    cost = foretell(scene, device, dt, (per_update, updates, windows), threads, machine)
    _torque_in_words(scene, device, windows * updates * per_update * dt, reasons)
    reasons["cost"] = cost.in_words()
    return device, Plan(
        fill.count, sector, contact, dt, per_update, updates, windows, field, M_max, stiffness, reasons, cost
    )


def _threads_of_a_replica(scene) -> int:
    """Threads that a run takes by itself."""
    return max(1, threads_at_hand() // replica_count(scene))


def _torque_in_words(scene, device: Device, end: float, reasons: dict[str, str]) -> None:
    """Of how many packings the torque will be, when the run ends, and whether it can be known by then."""
    count, until = replica_count(scene), scene.time.until
    if count > 1:
        reasons["replicas"] = f"{count} packings side by side, a process each; the torque and its error are of all"
    if until is not None:
        strain = scene.motion.largest_slip * end * device.shear_radius / device.shear_gap if device.shear_gap else inf
        aim = str(until).removeprefix("torque ")
        reasons["end"] = f"as soon as half the torque's 95 % interval is {aim}, at the latest at {end:.4g} s"
        if strain < LEAST_STRAIN:
            reasons["end"] += (
                f"; WARNING: until then the gap is sheared by {strain:.2g}, and no torque counts as known below "
                f"{LEAST_STRAIN:g}: raise time.end to {end * 1.5 * LEAST_STRAIN / max(strain, 1e-9):.2g} s"
            )


def _feedback_in_words(scene, coil: CoilDevice) -> str:
    """Over which width moments are fed back, and why."""
    width, d = smear_width(scene), scene.particles.largest_diameter
    text = f"moments spread over {1e3 * width:.3g} mm ({width / d:.3g} diameters"
    if width < scene.effects.dipoles.cutoff * d:
        text += f": the gap's width, less than effects.dipoles.cutoff = {scene.effects.dipoles.cutoff:g}"
    return text + f"); {len(coil.problem.powder_elements)} elements of powder and beside it"


def _coil_in_words(scene, coil: CoilDevice, field: MagneticField) -> str:
    """Resistance, current and, where its circuit is simulated, inductance and time constant of a coil at a voltage."""
    assert coil.resistance is not None
    loss = coil.resistance * coil.largest_current**2
    text = f"{coil.resistance:.3g} ohm: up to {coil.largest_current:.3g} A, {loss:.3g} W of copper loss"
    if scene.effects.coil_circuit is not None and coil.largest_current > 0.0:
        inductance = apparent_inductance(field, coil.turns)
        tau = inductance / coil.resistance
        text += f"; {inductance:.3g} H at that current (incremental {incremental_inductance(field, coil.turns):.3g} H)"
        text += f": time constant about {tau:.3g} s"
        if scene.time.end < 3.0 * tau:
            text += f"; WARNING: time.end = {scene.time.end:.3g} s is over before the current has risen"
    return text


def _packing_in_words(scene, device: Device) -> str:
    """How the grains are packed, and to what they settle."""
    particles, gravity = scene.particles, scene.effects.gravity
    lattice = f" ({particles.lattice})" if particles.packing == "lattice" else ""
    if not particles.settles:
        return f"{particles.packing}{lattice}; time 0 begins with the grains as packed"
    longest = particles.settle_longest
    weight = 0.0 if gravity is None else gravity.acceleration
    if longest is not None:
        limit = f"{longest:.3g} s as asked"
    elif weight > 0.0:
        limit = f"100 falls through the device ({100.0 * np.sqrt(2.0 * device_extent(device).max() / weight):.3g} s)"
    else:
        limit = "1e5 steps"
    energy = "m g d" if weight > 0.0 else "the energy stored in contacts"
    return (
        f"{particles.packing}{lattice}; before time 0 the grains settle, shafts held and no magnetic forces, to a "
        f"kinetic energy of {particles.settle_kinetic:.2g} of {energy}; longest: {limit}, not counted in the cost"
    )


def _parts(duration: float, part: float) -> int:
    """How many parts [s] reach the end of a duration [s]; round-off of their quotient adds none."""
    return max(1, ceil(duration / part - 1e-9))


def _windows(
    scene, dt: float, speed: float, between_layers: float, magnetic: bool, reasons: dict[str, str]
) -> tuple[int, int, int]:
    """Steps a force update, updates a window and windows of the run; speeds of the walls and of layers [m/s]."""
    d = scene.particles.smallest_diameter
    if scene.time.end / dt > MOST_STEPS:
        raise ValueError(
            f"time.end = {scene.time.end:.3g} s is {scene.time.end / dt:.2g} steps of {dt:.2g} s; allowed: at most "
            f"{MOST_STEPS:.0e}, which take months; lower it, raise particles.diameter or contact.max_overlap, or check "
            "the units of what the step follows from"
        )
    end_steps = _parts(scene.time.end, dt)
    per_update = 1
    if magnetic:
        asked = scene.effects.dipoles.update_every if scene.effects.dipoles is not None else None
        rigid = scene.contact.method == "dvi"  # its step follows the forces themselves
        # near pulls follow every step (`coupling.near_attraction`): what is held then changes with the places of layers
        followed = scene.effects.dipoles is not None and scene.effects.dipoles.model == "near_field" and not rigid
        moved, contacts = (between_layers, 2.0) if followed else (speed, 0.5)
        travel = 0.01 * d / (moved * dt) if moved > 0.0 else np.inf
        per_update = asked or (1 if rigid else max(1, floor(min(travel, contacts * scene.time.steps_per_contact))))
        every = f"evaluated every {per_update} steps" if per_update > 1 else "evaluated every step"
        why = ": half a contact, 1 % of a diameter of travel"
        if followed:
            why = ", near pulls every step: at most two contacts, neighbours 1 % of a diameter further"
        why = "" if rigid else why
        reasons["magnetic forces"] = every + (" as asked" if asked else why)
    if scene.time.window is not None:
        steps = max(1, round(scene.time.window / dt))
    else:
        # a quarter of a diameter of shear, but enough windows for a mean with an error bar
        travel = 0.25 * d / (speed * dt) if speed > 0.0 else np.inf
        steps = max(1, floor(min(travel, end_steps / 200, 5000)))
    if not magnetic:
        per_update, updates = steps, 1
    else:
        updates = max(1, round(steps / per_update))
    windows = _parts(scene.time.end, per_update * updates * dt)
    reasons["coupling window"] = (
        f"{per_update * updates} steps = {per_update * updates * dt:.3g} s, "
        f"{windows} windows to t = {windows * per_update * updates * dt:.4g} s"
    )
    return per_update, updates, windows


def mesh_in_words(coil: CoilDevice | CoilDevice3D) -> str:
    """What the field is solved on."""
    if not isinstance(coil, CoilDevice):
        return (
            f"in space, for the slots: {len(coil.mesh.tetrahedra)} tetrahedra in 1/{coil.mesh.n_sectors} of the ring, "
            f"{coil.problem.n_dofs} unknowns; coil of {coil.turns:.0f} turns; {coil.problem.linear_solver}"
        )
    text = (
        f"{len(coil.mesh.triangles)} triangles, {coil.problem.n_dofs} unknowns of order {coil.problem.elements.order}; "
        f"coil of {coil.turns:.0f} turns; {describe_backend(coil.problem.factorisation_backend)}"
    )
    return text if coil.adapted is None else f"{text}; {coil.adapted.summary()}"


def paths_in_words(case: Case) -> dict[str, str]:
    """What of the scene lies outside its folder; nothing where all lies within."""
    elsewhere = paths_elsewhere(case.scene, case.data, Path() if case.path is None else case.path.parent)
    if not elsewhere:
        return {}
    named = ", ".join(f"{key} = {path}" for key, path in elsewhere.items())
    return {"paths": f"outside the scene's folder: {named}"}


def plan(case: Case | str | Path, threads: int | None = None) -> Plan:
    """The numbers that a run of a scene would start from; nothing is simulated and nothing written.

    `case` is a case or the path of a scene file; the cost is that on `threads` threads, by default as a run takes them.
    Raises SceneError where the scene has faults, or its own step or stiffness cannot be.
    """
    case = as_case(case)
    case.need_grains()
    with bad_input_for(case.path):
        return make_plan(case, threads=threads)[1]


@dataclass(frozen=True, slots=True)
class Checked:
    """What follows from a right scene, as `emclutch check` says it.

    Attributes
    ----------
    title : str
    effects : tuple of str
        Names of the effects that the scene has.
    warnings : tuple of str
        What is allowed and yet likely not meant.
    decisions : dict of str to str
        The plan in words: label -> text.
    left_out : tuple of LeftOut
        Of each effect left out the number that says when it matters.
    expected : ExpectedTorque
        The torque's order of magnitude.
    """

    title: str
    effects: tuple[str, ...]
    warnings: tuple[str, ...]
    decisions: dict[str, str]
    left_out: tuple[LeftOut, ...]
    expected: ExpectedTorque


def check(case: Case | str | Path, threads: int | None = None) -> Checked:
    """Validate a scene and say what follows from it; `case`, `threads` and what is raised are as of `plan`."""
    case = as_case(case)
    with bad_input_for(case.path):
        return _check(case, threads)


def _check(case: Case, threads: int | None) -> Checked:
    from emclutch.device.coil_heat import coil_heat_in_words  # local, as the next two: a run does not need them
    from emclutch.simulation.forecast.effects_left_out import left_out
    from emclutch.simulation.forecast.expected_torque import ExpectedTorque, expected_torque

    scene = case.scene
    if scene.particles is None:
        from emclutch.simulation.field_plan import field_plan  # local: as the next

        none = ExpectedTorque(None, law="the scene has no grains")
        return Checked(scene.scene.title, scene.effects.active, case.warnings, field_plan(case), (), none)
    device, made = make_plan(case, threads=threads)
    B_max = 0.0
    if isinstance(made.peak_field, MagneticField) and isinstance(device.coil, CoilDevice):
        faces, phi = device.shears_faces, device.fill.solid_fraction
        midline = device.coil.shape.face_midline() if faces else device.coil.shape.gap_midline()

        def largest(field: MagneticField) -> float:
            return float(np.linalg.norm(field.B_along(midline), axis=1).max())

        B_max = largest(made.peak_field)
        made.reasons["field"] = (
            f"at the largest current, {powder_in_words(scene, phi)}: |B| in the {'face' if faces else 'rim'} gap up to "
            f"{B_max:.3g} T, grains magnetised up to {made.M_max / 1e3:.3g} kA/m"
        )
        if moments_are_fed_back(scene) and device.coil.largest_current > 0.0:
            chains = field_in_chains(device.coil, phi, device.coil.largest_current, made.peak_field)
            made.reasons["field"] += f"; were they in straight chains, up to {largest(chains):.3g} T"
    elif isinstance(made.peak_field, Field3D):
        from emclutch.device.device_3d import CoilDevice3D, gap_flux_density  # local: most scenes need no such field

        assert isinstance(device.coil, CoilDevice3D)
        B_max = gap_flux_density(device.coil, made.peak_field)
        made.reasons["field"] = (
            f"at the largest current, without powder: |B| under the poles {B_max:.3g} T on average, "
            f"grains magnetised up to {made.M_max / 1e3:.3g} kA/m"
        )
    unusual = FLUX_DENSITY.remark("|B|", B_max)
    if unusual:
        made.reasons["field"] += f"; WARNING: {unusual}"
    if device.coil is not None:
        made.reasons["copper"] = coil_heat_in_words(scene, device.coil, device.coil.shape)
    expected = expected_torque(scene, device, made.peak_field)
    made.reasons["expected torque"] = expected.in_words()
    made.reasons.update(paths_in_words(case))
    title, effects, missing = scene.scene.title, scene.effects.active, left_out(scene, device, made, expected)
    return Checked(title, effects, case.warnings, made.reasons, tuple(missing), expected)
