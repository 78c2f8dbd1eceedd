"""Work of the kernels at an instant: contacts, neighbours, sweeps, field solves.

None of these is known before a run. They follow from the density of the powder and from a few numbers that were counted
in runs: grains in a field stand in chains of two contacts a grain, shot under its weight lies in a bed, sheared powder
calls for a solve of the field whenever it has moved by a grain.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import inf, pi, sqrt
from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from emclutch.device.device import Device
    from emclutch.scene.model import Scene

# Contacts a grain, walls included
CHAINED = 2.0  # in a field, by DEM: 1.9 to 2.2 in the shipped drum clutches, from 5 % of shear on
BEDDED = 2.3  # under their weight
STIRRED = 0.5  # where walls or vanes throw them faster than they fall: 0.1 to 1.3 in the clutches with shot
LOOSE = 0.1  # without either: grains that hit each other now and then
SKIN = 0.25  # diameters beyond the cut-off: how far rows of neighbours reach
SWEEPS = 4.0  # of the moments, an update that starts from the last one's: 3 to 5.5 at a tolerance of 1e-3
SOLVES = 0.25  # of the field in a window of a quarter of a diameter, where moments are fed back: 0.20 to 0.29
CURRENT_STEP = 0.01  # of the largest current: a change that calls for a solve
EDDY_SOLVES = 0.35  # a window, with eddy currents: 1 while the field rises, 0.2 later
OFF = 0.01  # of the largest current: less makes no chains
# A step of rigid grains that a field holds together: 40 with 500 grains of thesis/electromagnetic_study, 130 with 1000,
# where twice as many chains cross the gap and each has twice as many neighbours
FIELD_SWEEPS, DENSE = 130.0, 0.34  # sweeps, solid fraction
STIRRED_SWEEPS = 15.0  # where they are stirred: thesis/centrifugal_methods
FREE_SWEEPS = 4.0  # elsewhere


@dataclass(frozen=True, slots=True)
class Counts:
    """At an instant.

    Attributes
    ----------
    contacts : float
        A grain, walls included.
    neighbours : float
        A grain, of the rows over which moments and forces go; each pair is seen from both of its grains.
    moment_sweeps : float
        An update of the moments.
    solves : float
        Of the field, a window.
    sweeps : float
        A step, of the solver of rigid contacts.
    """

    contacts: float
    neighbours: float
    moment_sweeps: float
    solves: float
    sweeps: float


def counts_at(scene: Scene, device: Device, time: float, window: float) -> Counts:
    """Return what is to be done at `time` [s] in a run whose coupling window is `window` [s] long."""
    attracted = scene.effects.attraction is not None and field_share(device, time) > OFF
    contacts = CHAINED if attracted else _contacts_without_field(scene, device, time)
    return Counts(
        contacts,
        neighbours(scene, device),
        SWEEPS if attracted else 0.0,
        _solves(scene, device, time, window),
        _sweeps(contacts, device.fill.solid_fraction) if scene.contact.method == "dvi" else 0.0,
    )


def field_share(device: Device, time: float) -> float:
    """The field's drive at a time [s] over its largest, 0 to 1."""
    if device.imposed is not None:
        return 1.0
    if device.coil is None or device.coil.largest_current == 0.0:
        return 0.0
    return abs(device.coil.currents(time)) / device.coil.largest_current


def _contacts_without_field(scene: Scene, device: Device, time: float) -> float:
    """Contacts a grain in a bed, in one that is stirred faster than it falls, and where nothing presses grains."""
    if scene.effects.weight is None:
        return LOOSE
    rotor = scene.motion.rotor
    if rotor.free is not None:
        motor = rotor.free.motor
        speed = rotor.free.largest_speed if motor is None or time > motor.switched_on else 0.0
    else:
        assert rotor.speed is not None  # by the schema: one of the two
        speed = abs(rotor.speed(time))
    if speed**2 * device.largest_radius > scene.effects.weight.acceleration:
        return STIRRED
    return BEDDED if time > settling_time(scene, device) else LOOSE


def settling_time(scene: Scene, device: Device) -> float:
    """Time [s] from which grains lie in a bed: twice a fall through the device; infinite without one."""
    assert scene.effects.weight is not None
    weight = scene.effects.weight.acceleration
    if scene.grains.settles:
        return 0.0
    return 2.0 * sqrt(2.0 * max(2.0 * device.largest_radius, device.narrowest_gap) / weight) if weight > 0.0 else inf


def neighbours(scene: Scene, device: Device) -> float:
    """Neighbours of a grain within the cut-off of the attraction and a skin, at the density of the filled space.

    In a gap of width w a sphere of radius R around a grain lies outside of it by 3 R/(8 w) of its volume on average
    (the mean of both caps over the width, for R < w); narrower gaps hold a disc of it.
    """
    attraction = scene.effects.attraction
    if attraction is None:
        return 0.0
    d, reach = scene.grains.largest_diameter, attraction.cutoff + SKIN
    whole = device.fill.solid_fraction * 8.0 * reach**3 * (pi / 6.0 * d**3 / scene.grains.grain_volume)
    share = reach * d / device.narrowest_gap
    return whole * (1.0 - 0.375 * share if share < 1.0 else 0.625 / share)


def _sweeps(contacts: float, fill: float) -> float:
    """Sweeps a step of the solver of rigid contacts."""
    if contacts == CHAINED:
        return max(FREE_SWEEPS, FIELD_SWEEPS * min(1.0, (fill / DENSE) ** 2))
    return STIRRED_SWEEPS if contacts == STIRRED else FREE_SWEEPS


def _solves(scene: Scene, device: Device, time: float, window: float) -> float:
    """Solves a window: one for each change of the current by its tolerance, and those that moving powder calls for."""
    coil = device.coil
    if coil is None or coil.largest_current == 0.0:
        return 0.0
    change = abs(coil.currents(time + 0.5 * window) - coil.currents(time - 0.5 * window)) / coil.largest_current
    called = min(1.0, change / CURRENT_STEP)
    if field_share(device, time) > OFF:
        if scene.effects.feedback is not None:
            called = max(called, SOLVES)
        if scene.effects.eddy is not None:
            called = max(called, EDDY_SOLVES)
    return float(np.clip(called, 0.0, 1.0))
