"""Checks of what has a meaning with one constant slip only: shear strains as times, and an imposed inertial number."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from emclutch.scene.errors import Fault
from emclutch.scene.partial_scene import PartialScene
from emclutch.scene.scaled import Scaled

if TYPE_CHECKING:
    from emclutch.scene.model import Scene

INERTIAL_NUMBER = "accuracy.inertial_number"


def one_slip(partial: PartialScene) -> Iterator[Fault]:
    """Yield what stands against times in strain and against an imposed inertial number."""
    scene = partial.scene
    if scene.shape().faults(None):
        return  # already reported
    times = scene.time.end, scene.time.average_from, scene.accuracy.time_end
    for key, given in zip(("time.end", "time.average_from", "accuracy.time_end"), times, strict=True):
        if not isinstance(given, Scaled):
            continue
        if reason := why_no_slip(scene):
            yield partial.fault(key, f"is a shear strain, and {reason}; give a time, e.g. '20 ms'")
    if scene.accuracy.inertial_number is None:
        return
    if scene.geometry.is_periodic:
        reason = "and a sheared box has a rate of its own: give geometry.inertial_number"
    elif found := why_no_slip(scene) or _why_speed_counts(scene):
        reason = f"and {found}"
    else:
        return
    remedy = f"remove {INERTIAL_NUMBER} (--set {INERTIAL_NUMBER}=none)"
    yield partial.fault(INERTIAL_NUMBER, f"changes the speeds, {reason}, or {remedy}")


def why_no_slip(scene: Scene) -> str:
    """Return why the gap has no constant slip that the scene says; empty where it has one."""
    if scene.geometry.is_periodic:
        return ""
    shape = scene.shape()
    if not shape.gap_parts(shape.boxes_to_fill(scene.grains.region)):
        kind = scene.geometry.name()
        others = "a clutch, a drum, a shear_cell, or two bodies at the powder"
        return f"with geometry.kind = '{kind}' no gap is sheared: take {others}"
    for name in ("rotor", "disc"):
        speed = getattr(scene.motion, name).speed
        if speed is None:
            return f"motion.{name} is free: prescribe its speed"
        if not speed.is_constant:
            return f"motion.{name}.speed changes in time: make it constant"
    return "" if scene.motion.largest_slip > 0.0 else "both shafts have the same speed: change one of them"


def _why_speed_counts(scene: Scene) -> str:
    """Return why the speeds or times of the scene must be real, or why no pressure is expected; empty without."""
    effects, coil = scene.effects, scene.coil
    for one in (effects.circuit, effects.eddy):
        if one is not None:
            return f"the times of effects.{one.name} would be wrong: remove that table"
    if effects.get("fluid_drag") is not None:
        return "the drag of the fluid depends on the speed: remove effects.fluid_drag"
    if effects.attraction is None:
        return f"only magnetised powder has an expected pressure: add {effects.tables(role='attraction')}"
    drive = None if coil is None else coil.current or coil.voltage
    if drive is not None and not drive.is_constant:
        return "the current of the coil changes in real time: make it constant"
    return ""
