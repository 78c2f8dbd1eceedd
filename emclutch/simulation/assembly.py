"""From a plan to a simulation: packs the grains and puts exactly the scene's effects into the loop."""

from __future__ import annotations

import logging
from collections.abc import Mapping

import numpy as np

from coupling import (
    MagnetisedGrains,
    Simulation,
)
from coupling.sheared_powder import dem_in_box
from emclutch.device_model.device import Device, field_is_needed
from emclutch.device_model.materials import grain_law
from emclutch.scene.model import Scene
from emclutch.scene.motion import FreeShaftSection
from emclutch.simulation.dvi_plan import RigidContacts
from emclutch.simulation.initial_packing import grains_of, packed, packed_in_flow, settled, sheared_between
from emclutch.simulation.plan import Plan
from geometry.time_profile import TimeProfile
from particles import DEM, DVI, Body, FreeShaft, GrainMotion, Grains

log = logging.getLogger(__name__)


def assemble(device: Device, plan: Plan) -> Simulation:
    """Pack the grains (seeded), build the simulation and let them settle; raises PackingError when they do not fit."""
    scene = plan.scene
    box = device.kind.periodic_box(scene)
    if box is not None:
        grains = packed_in_flow(scene, box, plan.count)
    else:
        packing = packed(scene, device.boxes, device.walls(), plan.count, plan.sector)
        gap = device.sheared_gap
        if scene.grains.initial_velocity == "sheared" and gap is not None:
            speeds = (shaft.initial_speed for shaft in (scene.motion.disc, scene.motion.rotor))
            packing = sheared_between(packing, gap, *speeds)
        grains = grains_of(packing, scene.grains.density)
    simulation = simulation_of(device, plan, grains)
    settling = settled(scene, simulation.motion)
    if settling is not None:
        log.info(
            "settled in %.4g s of simulated time, before time 0: kinetic energy %.2g of the reference, %d contacts",
            settling.time,
            settling.kinetic,
            settling.contacts,
        )
    return simulation


def simulation_of(device: Device, plan: Plan, grains: Grains) -> Simulation:
    """The simulation around given grains (packed, or of a checkpoint)."""
    scene, effects = plan.scene, plan.scene.effects
    walls = device.walls()
    gravity = None if effects.weight is None else np.asarray(effects.weight.vector, dtype=float)
    bodies = shafts(scene, walls, device.kind.face_speeds(scene))
    motion: GrainMotion
    box = device.kind.periodic_box(scene)
    if isinstance(plan.contact, RigidContacts):
        motion = rigid_grains(scene, plan, plan.contact, grains, walls, bodies, gravity, box or plan.sector)
    elif box is not None and not walls:
        motion = dem_in_box(box, grains, plan.contact.laws, plan.dt, energy_budget=scene.output.energy_budget)
    else:
        motion = DEM(
            grains,
            walls,
            bodies,
            plan.contact.laws,
            dt=plan.dt,
            gravity=gravity,
            periodicity=box or plan.sector,
            energy_budget=scene.output.energy_budget,
        )
    source = None
    if scene.field is not None and field_is_needed(scene):
        source = scene.field.build(scene, device, motion.bodies, walls, plan.peak_field)
    magnetised = None
    if source is not None and effects.attraction is not None:
        magnetised = effects.attraction.magnetised_grains(scene, source.sampler, walls, motion)
    elif source is not None:
        magnetised = MagnetisedGrains(source.sampler, grain_law(scene))
    n_sectors = 1 if plan.sector is None else plan.sector.n_sectors
    acting = [each for one in effects.present for each in one.acting(scene, motion.bodies)]
    rhythm = plan.steps_per_update, plan.division.steps
    return Simulation(motion, acting, magnetised, source, *rhythm, n_sectors, device.kind.barostat(scene))


def rigid_grains(
    scene: Scene, plan: Plan, rigid: RigidContacts, grains: Grains, walls, bodies, gravity, periodicity
) -> DVI:
    """The grains of contact.method = 'dvi'."""
    section = scene.contact.dvi
    return DVI(
        grains,
        walls,
        bodies,
        rigid.contact,
        dt=plan.dt,
        gravity=gravity,
        periodicity=periodicity,
        theta=section.theta,
        friction_cone=section.friction_law,
        solver=section.solver,
        tolerance=rigid.tolerance,
        max_sweeps=section.max_sweeps,
        stiffness=rigid.springs,
        rolling=rigid.rolling,
        twisting=rigid.twisting,
        cohesion=rigid.cohesion,
    )


def shafts(scene, walls, faces: Mapping[str, float]) -> list[Body]:
    """One body for every name that a wall belongs to, `faces` at their speeds [rad/s]; housing stands still."""
    bodies = []
    for name in dict.fromkeys(wall.body for wall in walls):
        motion = getattr(scene.motion, name, None)
        if name in faces:
            bodies.append(Body(name, TimeProfile.constant(faces[name])))
        elif motion is None:
            bodies.append(Body(name))
        elif motion.free is not None:
            bodies.append(Body(name, free_shaft(motion.free), speed=motion.free.initial_speed))
        else:
            bodies.append(Body(name, motion.speed))
    return bodies


def free_shaft(section: FreeShaftSection) -> FreeShaft:
    """The shaft of [motion.NAME.free]."""
    load, motor = section.load_torque, section.motor
    if motor is None:
        return FreeShaft(section.inertia, section.drive_torque, load)
    return FreeShaft(section.inertia, motor.signed_stall_torque, load, motor.slope, motor.switched_on)
