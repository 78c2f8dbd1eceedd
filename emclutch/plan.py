"""Everything that is decided before the first step, with its reason: `emclutch check` prints it, `run` follows it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil, floor, inf, pi
from typing import TYPE_CHECKING

import numpy as np

from coupling import chain_magnetisation, magnetic_load, neck_load, neck_stiffness, snap_in_overlap, weight_load
from emclutch.case import Case
from emclutch.cost import Cost, foretell
from emclutch.device import CoilDevice, Device, build_device, grain_law
from emclutch.machine_speed import threads_at_hand
from emclutch.overlaps import SOFT, STOPS
from emclutch.results.steady_torque import LEAST_STRAIN
from emclutch.rigid_plan import RigidPlan, plan_rigid
from emclutch.scene.contact import Contact
from emclutch.scene.field_source import CoilField
from emclutch.scene.grain_smear import moments_are_fed_back, smear_width
from emclutch.scene.replica_count import replica_count
from emclutch.scene.surfaces import extent_in_words
from emclutch.scene.usual_ranges import FLUX_DENSITY
from field import MagneticField
from field.factorisation import describe_backend
from field.solid import SolidField
from geometry import AnnularBox, Box, Clutch, ShearCell
from geometry.centrifugal import CentrifugalClutch
from particles import CyclicSector, PairLaws, RollingFriction, TwistingFriction, choose_time_step

if TYPE_CHECKING:
    from emclutch.effects_left_out import LeftOut

HEAP = 0.6  # solid fraction of grains at rest
NECK_MARGIN = 10.0  # of a contact's stiffness over the negative one of its neck


@dataclass(frozen=True, slots=True)
class Plan:
    """The numbers that a run starts from.

    Attributes
    ----------
    count : int
        Grains that are simulated (those of the sector).
    sector : CyclicSector or None
    contact : PairLaws or RigidPlan
        By DEM, or by DVI.
    dt : float
        Step of the grains [s].
    steps_per_update, updates, windows : int
        Steps between evaluations of the magnetic forces; evaluations a window; windows of the run.
    peak_field : MagneticField, SolidField or None
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
    contact: PairLaws | RigidPlan
    dt: float
    steps_per_update: int
    updates: int
    windows: int
    peak_field: MagneticField | SolidField | None
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
        windows = max(1, ceil(end / (steps_per_update * updates * self.dt) - 1e-9))
        return replace(self, steps_per_update=steps_per_update, updates=updates, windows=windows)

    @property
    def end(self) -> float:
        """Time at the end of the last window [s]."""
        return self.windows * self.updates * self.steps_per_update * self.dt


def make_plan(case: Case, device: Device | None = None, threads: int | None = None) -> tuple[Device, Plan]:
    """Build the device (unless given) and decide stiffness, step, windows and numbers of the run.

    The cost is that on `threads` threads (default: as a run takes them).

    Raises ValueError with a remedy when the scene's own step is too long, or its stiffness is too low or does
    not follow from it.
    """
    scene = case.scene
    device = device or build_device(scene)
    particles = scene.particles
    sector = None if particles.sector is None else CyclicSector(particles.sector)
    fill = device.fill
    where = particles.region if isinstance(device.shape, Clutch) else "space"
    reasons = {
        "grains": f"{fill.count} simulated of {fill.count * particles.n_sectors} in the device "
        f"({fill.mass * 1e3:.3g} g), solid fraction {fill.solid_fraction:.3f} of the {where} filled",
        "packing": _packing_in_words(scene, device),
    }
    for surface in device.surfaces:
        reasons[f"surface {surface.name}"] = (
            f"{len(surface.triangles)} triangles, {extent_in_words(*surface.bounds)} mm, on body {surface.body}"
        )
    if isinstance(device.shape, Clutch):
        reasons["sheared gap"] = (
            f"{'at the faces' if device.shears_faces else 'at the rim'}, {1e3 * device.shear_gap:.3g} mm wide at a "
            f"mean radius of {1e3 * device.shear_radius:.3g} mm"
        )
    field, M_max = expected_magnetisation(case, device)
    if isinstance(field, MagneticField) and isinstance(device.coil, CoilDevice) and device.coil.resistance is not None:
        reasons["coil"] = _coil_in_words(scene, device.coil, field)
    speed = _largest_speed(scene, device)
    contact: PairLaws | RigidPlan
    if scene.contact.method == "dvi":
        springs = _springs(scene, device, M_max, speed, reasons)
        contact, dt = plan_rigid(scene, M_max, speed, springs, reasons)
        stiffness = None if springs is None else float(springs[0, 0])
    else:
        contact, dt, stiffness = _elastic(scene, device, M_max, speed, reasons)
    layers = max(_fall_speed(scene, device), _layer_speed(scene, device, speed))
    per_update, updates, windows = _windows(scene, dt, speed, layers, M_max > 0.0 or field is not None, reasons)
    if moments_are_fed_back(scene) and isinstance(device.coil, CoilDevice):
        reasons["feedback"] = _feedback_in_words(scene, device.coil)
    _mesh_in_words(scene, device, reasons)
    cost = foretell(scene, device, dt, (per_update, updates, windows), threads or _threads_of_a_replica(scene))
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


def _elastic(
    scene, device: Device, M_max: float, speed: float, reasons: dict[str, str]
) -> tuple[PairLaws, float, float]:
    """The laws of all contacts, the step [s] by DEM, and the stiffness between grains [N/m]."""
    particles = scene.particles
    contact, load, stiffness = _contact(scene, device, M_max, _impact_speed(scene, device, speed), reasons)
    lightest = particles.density * pi / 6.0 * particles.smallest_diameter**3
    step = choose_time_step(
        contact,
        lightest,
        0.5 * particles.smallest_diameter,
        speed=speed,
        load=load,
        rolling=scene.effects.rolling_friction is not None,
        steps_per_contact=scene.time.steps_per_contact,
        dt=scene.time.step,
    )
    reasons["time step"] = step.reason
    return contact, step.dt, stiffness


def _springs(scene, device: Device, M_max: float, speed: float, reasons: dict[str, str]) -> np.ndarray | None:
    """[[k_n, k_t] between grains, [k_n, k_t] at walls] [N/m] of rigid grains that give way, None for rigid ones.

    Of a law that is not linear, the stiffness at the largest overlap to be expected.
    """
    if not scene.contact.dvi.gives_way:
        return None
    if scene.contact.tangential_ratio == 0.0:
        raise ValueError("contact.tangential_ratio = 0; with contact.dvi.springs it must be more than 0")
    hit = _impact_speed(scene, device, speed)
    pairs, force, _ = _contact(scene, device, M_max, hit, reasons)
    d = scene.particles.largest_diameter
    mass = scene.particles.density * pi / 6.0 * d**3
    ratio = 2.0 / 7.0 if scene.contact.tangential_ratio is None else scene.contact.tangential_ratio
    stiffness = np.empty((2, 2))
    for row, law, m_eff, r_eff in zip(stiffness, pairs.laws, (0.5 * mass, mass), (0.25 * d, 0.5 * d), strict=True):
        k = law.stiffness_at(law.overlap_under(force, m_eff, hit, r_eff), r_eff)
        row[:] = k, ratio * k
    return stiffness


def expected_magnetisation(case: Case, device: Device) -> tuple[MagneticField | SolidField | None, float]:
    """Field at the largest current with the powder spread evenly over its boxes, and the grains' largest M there."""
    scene = case.scene
    law = grain_law(scene)
    if device.imposed is not None:
        H = device.imposed.sample(_corners(device))[0]
        strength = np.linalg.norm(H, axis=1).max(keepdims=True)
        return None, float(law.magnetisation(strength, np.zeros(1))[0])
    if device.coil is None:
        return None, 0.0
    phi = device.fill.solid_fraction
    coupled = scene.effects.back_reaction is not None
    fill = device.coil.uniform_fill(phi) if coupled and isinstance(device.coil, CoilDevice) else None
    field = device.coil.solve_at_peak(fill)
    points = _sample_points(device.coil.powder_boxes, scene.particles.largest_diameter)
    strength = np.linalg.norm(field.sampler("powder").sample(points)[0], axis=1)
    return field, float(law.magnetisation(strength, np.full(len(strength), phi if coupled else 0.0)).max())


def _coil_in_words(scene, coil: CoilDevice, field: MagneticField) -> str:
    """Resistance, current and, where its circuit is simulated, inductance and time constant of a coil at a voltage."""
    assert coil.resistance is not None
    loss = coil.resistance * coil.largest_current**2
    text = f"{coil.resistance:.3g} ohm: up to {coil.largest_current:.3g} A, {loss:.3g} W of copper loss"
    if scene.effects.coil_circuit is not None and coil.largest_current > 0.0:
        inductance = field.inductance(coil.turns)
        tau = inductance / coil.resistance
        text += f"; {inductance:.3g} H at that current (incremental {field.incremental_inductance(coil.turns):.3g} H)"
        text += f": time constant about {tau:.3g} s"
        if scene.time.end < 3.0 * tau:
            text += f"; WARNING: time.end = {scene.time.end:.3g} s is over before the current has risen"
    return text


def _corners(device: Device) -> np.ndarray:
    """Where an imposed field is strongest: at the smallest radius that grains reach, (1, 3) [m]."""
    radius = device.shape.inner_radius if isinstance(device.shape, ShearCell) else 0.0
    return np.array([[radius, 0.0, 0.0]])


def _sample_points(boxes: list[AnnularBox], diameter: float) -> np.ndarray:
    points = []
    for box in boxes:
        r = np.linspace(box.r0 + 0.5 * diameter, box.r1 - 0.5 * diameter, 9)
        z = np.linspace(box.z0 + 0.5 * diameter, box.z1 - 0.5 * diameter, 121)
        r, z = np.meshgrid(r, z)
        points.append(np.column_stack([r.ravel(), np.zeros(r.size), z.ravel()]))
    return np.concatenate(points)


def _largest_speed(scene, device: Device) -> float:
    """Largest speed [m/s] that a driven wall gives to grains, or that weight can."""
    wall = max(scene.motion.rotor.largest_speed, scene.motion.disc.largest_speed) * device.largest_radius
    return max(wall, _fall_speed(scene, device))


def _fall_speed(scene, device: Device) -> float:
    """Speed [m/s] of a grain that falls across the sheared gap, or, where grains are poured in, through the device.

    In a box it falls through what the heap of all others leaves empty.
    """
    gravity = scene.effects.gravity
    if gravity is None:
        return 0.0
    along = np.abs(gravity.direction)
    whole = float(along @ _size(device)) / float(np.linalg.norm(along))
    if scene.particles.packing == "pour":
        height = whole
    elif isinstance(device.shape, Box):
        height = max(whole * (1.0 - device.fill.solid_fraction / HEAP), scene.particles.largest_diameter)
    else:
        height = device.shear_gap
    return float(np.sqrt(2 * gravity.acceleration * height))


def _size(device: Device) -> np.ndarray:
    """Extent [m] of what is filled with grains along x, y, z."""
    if isinstance(device.boxes, Box):
        return np.asarray(device.boxes.size)
    low, high = min(box.z0 for box in device.boxes), max(box.z1 for box in device.boxes)
    return np.array([2.0 * device.largest_radius, 2.0 * device.largest_radius, high - low])


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
        limit = f"100 falls through the device ({100.0 * np.sqrt(2.0 * _size(device).max() / weight):.3g} s)"
    else:
        limit = "1e5 steps"
    energy = "m g d" if weight > 0.0 else "the energy stored in contacts"
    return (
        f"{particles.packing}{lattice}; before time 0 the grains settle, shafts held and no magnetic forces, to a "
        f"kinetic energy of {particles.settle_kinetic:.2g} of {energy}; longest: {limit}, not counted in the cost"
    )


def _impact_speed(scene, device: Device, speed: float) -> float:
    """Largest normal speed [m/s] of two grains to be expected: a sheared gap of g/d grains has v d/g between layers.

    Twice that, for the fluctuations; never more than the speed itself, which holds for falling grains and boxes. Shot
    at rest meets the vanes of a centrifugal clutch, which go at the speed of their tips.
    """
    if isinstance(device.shape, CentrifugalClutch):
        return max(_fall_speed(scene, device), scene.motion.rotor.largest_speed * device.shape.tip_radius)
    return max(_fall_speed(scene, device), 2.0 * _layer_speed(scene, device, speed))


def _layer_speed(scene, device: Device, speed: float) -> float:
    """Speed [m/s] of layers of grains past each other in a gap whose wall goes at `speed`: v d/g."""
    return speed * min(0.5, scene.particles.largest_diameter / device.narrowest_gap)


def _contact(
    scene, device: Device, M_max: float, speed: float, reasons: dict[str, str]
) -> tuple[PairLaws, float, float]:
    """The laws of all contacts, the largest force on one that is to be expected [N], and the stiffness then [N/m]."""
    particles, contact = scene.particles, scene.contact
    d = particles.largest_diameter  # overlap / diameter grows with the size under every load
    mass = particles.density * pi / 6.0 * d**3
    model = None if scene.effects.dipoles is None else scene.effects.dipoles.model
    chained = chain_magnetisation(grain_law(scene), M_max) if model == "mutual" and M_max > 0.0 else M_max
    loads = {f"grains magnetised to {chained / 1e3:.3g} kA/m": magnetic_load(chained, d)}
    neck = 0.0
    if model == "near_field":
        grains = grain_law(scene)
        neck = neck_stiffness(grains, d, at_walls=scene.effects.wall_images is not None)
        loads[f"necks between grains magnetised to {M_max / 1e3:.3g} kA/m"] = neck_load(
            grains, M_max, d, scene.effects.dipoles.surface_gap
        )
        if contact.needs_a_load:  # so stiff that no neck pulls a contact in by itself
            least = NECK_MARGIN * neck * contact.max_overlap * d
            loads[f"{NECK_MARGIN:g} times the stiffness of saturated necks, {neck:.3g} N/m,"] = least
    if scene.effects.gravity is not None:
        height = device.shape.size[2] if isinstance(device.shape, Box) else 2.0 * device.largest_radius
        loads["the weight of the bed"] = weight_load(particles.density, scene.effects.gravity.acceleration, height, d)
    if scene.effects.cohesion is not None:
        pull = scene.effects.cohesion.law().table()
        loads["cohesion"] = float(max(pull[0] @ (1.0, 0.25 * d), pull[1] @ (1.0, 0.5 * d)))
    cause, force = max(loads.items(), key=lambda item: item[1])
    loaded = f"{force:.3g} N from {cause}" if force > 0.0 else ""
    hit = f"impacts at {speed:.3g} m/s" if speed > 0.0 else ""
    why = " and ".join(filter(None, (loaded, hit)))
    effects = scene.effects
    if not why and contact.needs_a_load:
        raise ValueError(
            "nothing loads the contacts (no weight, no magnetism, no motion), so no stiffness follows; "
            f"give {contact.stiffness_key}"
        )
    between, at_walls = contact.laws(mass=mass, diameter=d, force=force, speed=speed)

    def deepest_of(chosen: Contact) -> float:
        inner, outer = chosen.laws(mass=mass, diameter=d, force=force, speed=speed)
        return max(
            inner.overlap_under(force, 0.5 * mass, speed, 0.25 * d), outer.overlap_under(force, mass, speed, 0.5 * d)
        )

    deepest = deepest_of(contact)
    if deepest > STOPS * d:
        raise ValueError(_too_soft(contact, lambda chosen: deepest_of(chosen) / d, why))
    stiffness = between.stiffness_at(deepest, 0.25 * d)
    overlap = f"overlap {100 * deepest / d:.2g} % of the diameter" + (f" under {why}" if why else "")
    asked = "" if contact.needs_a_load else " as asked"
    kind = "" if contact.law == "linear" else f"law {contact.law}, at that overlap "
    reasons["stiffness"] = f"{kind}k_n = {stiffness:.3g} N/m{asked}: {overlap}"
    if M_max > 0.0:
        snap = snap_in_overlap(chained, d, stiffness)
        reasons["stiffness"] += f"; grains that snap together from afar press in by {100 * snap:.2g} % for an instant"
    if stiffness < 0.999 * NECK_MARGIN * neck:
        reasons["stiffness"] += (
            f"; WARNING: less than {NECK_MARGIN:g} times the negative stiffness of saturated necks, {neck:.3g} N/m: "
            "contacts close by more than their overlap says"
        )
    if deepest > SOFT * d:
        reasons["stiffness"] += f"; WARNING: above {100 * SOFT:g} % grains are too soft for peaks of the torque"
    rolls, twists = effects.rolling_friction, effects.twisting_friction
    rolling = None if rolls is None else RollingFriction(rolls.coefficient, rolls.wall_coefficient)
    twisting = None if twists is None else TwistingFriction(twists.coefficient, twists.wall_coefficient)
    cohesion = None if effects.cohesion is None else effects.cohesion.law()
    laws = PairLaws.of_one(between, at_walls=at_walls, rolling=rolling, twisting=twisting, cohesion=cohesion)
    return laws, force, stiffness


def _too_soft(contact: Contact, overlap: Callable[[Contact], float], why: str) -> str:
    """What is said of a stiffness with which the run would stop; `overlap` over the diameter."""
    key = contact.stiffness_key.partition(",")[0].removeprefix("contact.")
    unit = {"hertz_stiffness": "N/m^1.5", "youngs_modulus": "Pa"}.get(key, "N/m")
    given = {name: value for name in (key, f"wall_{key}") if (value := getattr(contact, name)) is not None}
    factor = 1.0
    while overlap(contact.model_copy(update={name: factor * v for name, v in given.items()})) > SOFT and factor < 1e12:
        factor *= 1.25
    told = " and ".join(f"contact.{name} = {value:.4g} {unit}" for name, value in given.items())
    higher = " and ".join(f"'{factor * value:.2g} {unit}'" for value in given.values())
    return (
        f"{told} is too soft: grains would overlap by {100 * overlap(contact):.2g} % of the diameter under {why}, and "
        f"a run stops at {100 * STOPS:g} %; raise it to about {higher}, or leave it out: it then follows from "
        f"contact.max_overlap = {contact.max_overlap:g}"
    )


def _windows(
    scene, dt: float, speed: float, between_layers: float, magnetic: bool, reasons: dict[str, str]
) -> tuple[int, int, int]:
    """Steps a force update, updates a window and windows of the run; speeds of the walls and of layers [m/s]."""
    d = scene.particles.smallest_diameter
    end_steps = max(1, ceil(scene.time.end / dt))
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
    windows = max(1, ceil(end_steps / (per_update * updates)))
    reasons["coupling window"] = (
        f"{per_update * updates} steps = {per_update * updates * dt:.3g} s, "
        f"{windows} windows to t = {windows * per_update * updates * dt:.4g} s"
    )
    return per_update, updates, windows


def _mesh_in_words(scene, device: Device, reasons: dict[str, str]) -> None:
    """What the field is solved on."""
    if device.coil is not None and not isinstance(device.coil, CoilDevice):
        solid = device.coil
        reasons["mesh"] = (
            f"in space, for the slots: {len(solid.mesh.tetrahedra)} tetrahedra in 1/{solid.mesh.n_sectors} of the "
            "ring, "
            f"{solid.problem.n_dofs} unknowns; coil of {solid.turns:.0f} turns; {solid.problem.linear_solver}"
        )
    elif device.coil is not None and isinstance(scene.field, CoilField):
        reasons["mesh"] = (
            f"{len(device.coil.mesh.triangles)} triangles, {device.coil.problem.n_dofs} unknowns of order "
            f"{scene.field.order}; coil of {device.coil.turns:.0f} turns; "
            f"{describe_backend(device.coil.problem.factorisation_backend)}"
        )
        if device.coil.adapted is not None:
            reasons["mesh"] += f"; {device.coil.adapted.summary()}"


def plan(case: Case, threads: int | None = None) -> tuple[dict[str, str], list[LeftOut]]:
    """The plan in words, label -> text, and what the scene leaves out, for `check`; the cost on `threads` threads."""
    from emclutch.coil_heat import coil_heat_in_words  # local, as the next two: a run does not need them
    from emclutch.effects_left_out import left_out
    from emclutch.expected_torque import expected_torque

    scene = case.scene
    device, made = make_plan(case, threads=threads)
    B_max = 0.0
    if isinstance(made.peak_field, MagneticField) and isinstance(device.coil, CoilDevice):
        faces = device.shears_faces
        midline = device.coil.shape.face_midline() if faces else device.coil.shape.gap_midline()
        B = np.linalg.norm(made.peak_field.B_along(midline), axis=1)
        where = f"the {'face' if faces else 'rim'} gap"
        made.reasons["field"] = (
            f"at the largest current, powder spread evenly: |B| in {where} up to "
            f"{B.max():.3g} T, grains magnetised up to {made.M_max / 1e3:.3g} kA/m"
        )
        B_max = float(B.max())
    elif isinstance(made.peak_field, SolidField):
        from emclutch.solid_device import SolidCoilDevice, gap_flux_density  # local: most scenes need no such field

        assert isinstance(device.coil, SolidCoilDevice)
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
    return made.reasons, left_out(scene, device, made, expected)
