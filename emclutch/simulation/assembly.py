"""From a plan to a simulation: packs the grains and puts exactly the scene's effects into the loop."""

from __future__ import annotations

import logging
from collections.abc import Sequence
from math import pi

import numpy as np

from coupling import (
    CircuitCoilField,
    CoilField,
    CoilField3D,
    Dipoles,
    EddyCoilField,
    Effect,
    ImposedField,
    LayeredField,
    MagneticForce,
    MagnetisedGrains,
    MutuallyMagnetisedGrains,
    MutualMoments,
    NearAttraction,
    PowderFeedback,
    Simulation,
    grain_table,
)
from emclutch.device.device import CoilDevice, Device
from emclutch.device.materials import grain_law
from emclutch.scene.case import Case
from emclutch.scene.grain_smear import layers_change_the_field, moments_are_fed_back, smear_width
from emclutch.scene.model import Scene
from emclutch.scene.motion import FreeShaftSection
from emclutch.scene.time_table import points_of
from emclutch.simulation.dvi_plan import RigidContacts
from emclutch.simulation.initial_packing import grains_of, packed, settled
from emclutch.simulation.plan import Plan
from field import AxisymmetricProblem, MagneticField, RadialField
from field.section.eddy_currents import EddyCurrentProblem, VoltageDrive
from field.three_d import Field3D
from geometry import ShearCell
from geometry.time_profile import TimeProfile
from particles import DEM, DVI, Body, FreeShaft, GrainMotion, Grains, PrescribedSpeed

log = logging.getLogger(__name__)


def assemble(case: Case, device: Device, plan: Plan) -> Simulation:
    """Pack the grains (seeded), build the simulation and let them settle; raises PackingError when they do not fit."""
    scene = case.scene
    packing = packed(scene, device.boxes, device.walls(), plan.count, plan.sector)
    simulation = simulation_of(case, device, plan, grains_of(packing, scene.grains.density))
    settling = settled(scene, simulation.motion)
    if settling is not None:
        log.info(
            "settled in %.4g s of simulated time, before time 0: kinetic energy %.2g of the reference, %d contacts",
            settling.time,
            settling.kinetic,
            settling.contacts,
        )
    return simulation


def simulation_of(case: Case, device: Device, plan: Plan, grains: Grains) -> Simulation:
    """The simulation around given grains (packed, or of a checkpoint)."""
    scene, chosen = case.scene, case.scene.effects
    walls = device.walls()
    gravity = None
    if chosen.gravity is not None:
        gravity = np.asarray(chosen.gravity.vector, dtype=float)
    bodies = shafts(scene, walls)
    motion: GrainMotion
    if isinstance(plan.contact, RigidContacts):
        motion = rigid_grains(scene, plan, plan.contact, grains, walls, bodies, gravity)
    else:
        motion = DEM(
            grains,
            walls,
            bodies,
            plan.contact.laws,
            dt=plan.dt,
            gravity=gravity,
            sector=plan.sector,
            energy_budget=scene.output.energy_budget,
        )
    source = field_source(scene, device, motion.bodies, plan.peak_field)
    if moments_are_fed_back(scene) and isinstance(source, CoilField):
        source.feedback = feedback_of(scene, source.problem, walls)
    magnetised = None if source is None else magnetised_grains(scene, source.sampler, walls, motion)
    n_sectors = 1 if plan.sector is None else plan.sector.n_sectors
    effects = effects_of(scene)
    simulation = Simulation(motion, effects, magnetised, source, plan.steps_per_update, plan.updates, n_sectors)
    if simulation.holds_forces and plan.division.rule is None:
        raise AssertionError("effects hold forces, and the plan has one evaluation a window; say so in `make_plan`")
    return simulation


def rigid_grains(scene: Scene, plan: Plan, rigid: RigidContacts, grains: Grains, walls, bodies, gravity) -> DVI:
    """The grains of contact.method = 'dvi'."""
    section = scene.contact.dvi
    return DVI(
        grains,
        walls,
        bodies,
        rigid.contact,
        dt=plan.dt,
        gravity=gravity,
        theta=section.theta,
        friction_cone=section.friction_law,
        solver=section.solver,
        tolerance=rigid.tolerance,
        max_sweeps=section.max_sweeps,
        stiffness=rigid.springs,
        rolling=rigid.rolling,
        twisting=rigid.twisting,
    )


def effects_of(scene: Scene) -> list[Effect]:
    """The effects of the scene, in the order in which they act; gravity and rolling live in the grains' own step."""
    effects: list[Effect] = []
    chosen = scene.effects
    if chosen.magnetic_force is not None:
        effects.append(MagneticForce())
    if chosen.dipoles is not None:
        effects.append(Dipoles())
    return effects


def magnetised_grains(scene: Scene, sampler, walls, motion: GrainMotion) -> MagnetisedGrains:
    """What gives the grains their moments: the field alone, or also the other grains and their images."""
    law, dipoles = grain_law(scene), scene.effects.dipoles
    if dipoles is None:
        return MagnetisedGrains(sampler, law)
    fed_back = moments_are_fed_back(scene)
    spread = fed_back or layers_change_the_field(scene)
    solver = MutualMoments(
        grain_table(law, dipoles.model),
        near=dipoles.model == "near_field",
        reach=smear_width(scene) if spread else dipoles.cutoff * scene.grains.largest_diameter,
        smear=fed_back or (scene.prescribed_field is not None and scene.prescribed_field.is_macroscopic),
        smallest_gap=dipoles.surface_gap,
    )
    mirrors = walls if scene.effects.wall_images is not None else None
    near = NearAttraction(solver, walls) if solver.near and isinstance(motion, DEM) else None
    return MutuallyMagnetisedGrains(
        sampler, law, solver=solver, tolerance=dipoles.tolerance, mirrors=mirrors, near=near
    )


def feedback_of(scene: Scene, problem: AxisymmetricProblem, walls) -> PowderFeedback:
    """What gives the grains' moments to the field of `problem` and back."""
    return PowderFeedback(problem, grain_law(scene), smear_width(scene), scene.grains.sector or 2 * pi, walls)


def field_source(
    scene: Scene, device: Device, bodies: Sequence[Body], peak: MagneticField | Field3D | None
) -> CoilField | CoilField3D | ImposedField | LayeredField | None:
    """Where the scene's field comes from; None when no effect needs one. `peak` is solved at the largest current."""
    if device.imposed is not None:
        if not layers_change_the_field(scene):
            return ImposedField(device.imposed)
        assert isinstance(device.imposed, RadialField) and isinstance(device.shape, ShearCell)  # by its conditions
        return LayeredField(device.imposed, device.shape, scene.grains.sector or 2 * pi, smear_width(scene))
    if device.coil is None:
        return None
    if not isinstance(device.coil, CoilDevice):
        coil = device.coil
        carrier = next(body for body in bodies if body.name == coil.carrier)
        known = peak if isinstance(peak, Field3D) else None
        return CoilField3D(coil.problem, coil.turns, coil.current, carrier, coil.newton_tolerance, known=known)
    source = coil_source(scene, device.coil)
    if scene.effects.back_reaction is not None:
        source.powder_tolerance = scene.effects.back_reaction.tolerance
    return source


def coil_source(scene: Scene, coil: CoilDevice) -> CoilField:
    """The coil's field by what its current follows from: a course, the circuit, eddy currents."""
    circuit, eddy = scene.effects.coil_circuit, scene.effects.eddy_currents
    if circuit is None and eddy is None:
        return CoilField(coil.problem, coil.turns, coil.current, coil.newton_tolerance)
    if eddy is None:
        assert circuit is not None and coil.resistance is not None  # by the checks between sections
        return CircuitCoilField(
            coil.problem,
            coil.turns,
            newton_tolerance=coil.newton_tolerance,
            current_tolerance=circuit.tolerance,
            voltage=coil.voltage,
            resistance=coil.resistance,
            breaks=coil.currents.times,
            begin_steady=circuit.begin == "steady",
            largest_current=coil.largest_current,
        )
    voltage = None
    if circuit is not None:
        assert coil.resistance is not None  # by the checks between sections
        voltage = VoltageDrive(coil.voltage, coil.resistance)
    return EddyCoilField(
        coil.problem,
        coil.turns,
        coil.current,
        coil.newton_tolerance,
        eddy=EddyCurrentProblem(coil.problem, coil.conductivity or {}, turns=coil.turns),
        voltage=voltage,
        breaks=coil.currents.times,
        begin_steady=eddy.begin == "steady",
        change_tolerance=eddy.tolerance,
        largest_current=coil.largest_current,
    )


def shafts(scene, walls) -> list[Body]:
    """One body for every name that a wall belongs to; housing stands still."""
    bodies = []
    for name in dict.fromkeys(wall.body for wall in walls):
        motion = getattr(scene.motion, name, None)
        if motion is None:
            bodies.append(Body(name))
        elif motion.free is not None:
            bodies.append(Body(name, free_shaft(motion.free), speed=motion.free.initial_speed))
        else:
            bodies.append(Body(name, PrescribedSpeed(*points_of(motion.speed))))
    return bodies


def free_shaft(section: FreeShaftSection) -> FreeShaft:
    """The shaft of [motion.NAME.free]."""
    load, motor = TimeProfile(*points_of(section.load_torque)), section.motor
    if motor is None:
        return FreeShaft(section.inertia, section.drive_torque, load)
    return FreeShaft(section.inertia, motor.signed_stall_torque, load, motor.slope, motor.switched_on)
