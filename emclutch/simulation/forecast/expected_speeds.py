"""Expected speeds of walls and grains, from which steps and windows follow."""

from __future__ import annotations

import numpy as np

from emclutch.device_model.device import Device

HEAP = 0.6  # solid fraction of grains at rest


def largest_speed(scene, device: Device) -> float:
    """Largest speed [m/s] that a driven wall gives to grains, or that weight can; across a periodic box its flow's."""
    rate = device.kind.rate(scene)
    if rate is not None:
        return rate * float(device.extent[2])
    wall = max(scene.motion.rotor.largest_speed, scene.motion.disc.largest_speed) * device.largest_radius
    return max(wall, fall_speed(scene, device))


def slip_speed(scene, device: Device) -> float:
    """Speed [m/s] that shears or stirs the grains: of the walls past each other, of the flow, or of a fall.

    As `largest_speed`, but that shafts which turn together count by their difference, if they have one.
    """
    wall = scene.motion.largest_slip * device.largest_radius
    if device.kind.rate(scene) is not None or wall == 0.0:
        return largest_speed(scene, device)
    return max(wall, fall_speed(scene, device))


def fall_speed(scene, device: Device) -> float:
    """Speed [m/s] of a grain that falls across the sheared gap, or, where grains are poured in, through the device.

    In a box it falls through what the heap of all others leaves empty.
    """
    gravity = scene.effects.weight
    if gravity is None:
        return 0.0
    along = np.abs(gravity.direction)
    whole = float(along @ device.extent) / float(np.linalg.norm(along))
    if scene.particles.packing == "pour":
        height = whole
    elif device.sheared_gap is None:
        height = max(whole * (1.0 - device.fill.solid_fraction / HEAP), scene.particles.largest_diameter)
    else:
        height = device.shear_gap
    return float(np.sqrt(2 * gravity.acceleration * height))


def impact_speed(scene, device: Device, speed: float) -> float:
    """Largest normal speed [m/s] of two grains to be expected: a sheared gap of g/d grains has v d/g between layers.

    Twice that, for the fluctuations; never more than the speed itself, which holds for falling grains and boxes. Shot
    at rest meets the vanes of a centrifugal clutch, which go at the speed of their tips.
    """
    radius = device.kind.impact_radius(device.shape)
    if radius is not None:
        return max(fall_speed(scene, device), scene.motion.rotor.largest_speed * radius)
    return max(fall_speed(scene, device), 2.0 * layer_speed(scene, device, speed))


def layer_speed(scene, device: Device, speed: float) -> float:
    """Speed [m/s] of layers of grains past each other in a gap whose wall goes at `speed`: v d/g."""
    rate = device.kind.rate(scene)
    if rate is not None:
        return rate * scene.particles.largest_diameter
    return speed * min(0.5, scene.particles.largest_diameter / device.narrowest_gap)
