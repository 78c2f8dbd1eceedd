"""Running a DEM until its grains are at rest.

**At rest** means: the kinetic energy K of all grains is below ``kinetic`` times a reference E, at two looks in a row.

With gravity, E = sum(m g d), the work of lifting every grain by its diameter. A grain on others has to climb
(1 - sqrt(3)/2) d = 0.13 d at the least to roll into the next hollow, so that for kinetic << 0.13 the mean grain cannot
leave its place; at the default of 1e-6 it moves at sqrt(2e-6 g d), 1e-3 of what it would gain falling half a diameter,
and even if all the energy of 1e5 grains sat in one, it could not leave its place. Looks are sqrt(d/g) apart, the time
to fall half a diameter: a bed that has just been let go has K = E/2 at the second look, however still it
was at the first.

Without gravity nothing but contacts moves grains, and E is the largest sum of kinetic and elastic energy met since the
start: a compressed packing has come to rest when less than ``kinetic`` of what was stored in it is still in motion.
Looks are then 200 steps apart, about ten contacts.

**Damping.** Dry friction stops no grain that rolls on a floor, spins about the vertical where it stands, or, without
gravity, flies free; one loose grain under a bed that bears all the others has kept K above 1e-6 E for good. Velocities
and spins are therefore taken down a little at each look; with gravity only once falls are over (K < 1e-3 E), so that
nothing but such leftovers feels it.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from particles.bodies import ZERO
from particles.errors import ParticleError
from particles.grain_motion import GrainMotion

KINETIC = 1e-6  # of the reference energy (module docstring)
_FALLS_OVER = 1e-3  # of the reference energy: from there on damping acts
_LOOK_STEPS = 200
_MAX_FALLS = 100.0  # times the fall through the bed


@dataclass(frozen=True, slots=True)
class Settling:
    """Result of a settling.

    Attributes
    ----------
    reached : bool
        Whether the grains are at rest.
    time : float
        Simulated time that it took [s].
    kinetic : float
        Kinetic energy over the reference energy at the end.
    contacts : int
        Contacts at the last step.
    missed : float
        Share of the steps whose contacts missed the solver's tolerance; 0 by DEM.
    """

    reached: bool
    time: float
    kinetic: float
    contacts: int
    missed: float = 0.0


class NotAtRestError(ParticleError):
    """Grains still move when the longest time is over; ``settling`` tells how it went."""

    def __init__(self, message: str, settling: Settling) -> None:
        super().__init__(message)
        self.settling = settling


def settle(
    dem: GrainMotion,
    *,
    kinetic: float = KINETIC,
    longest: float | None = None,
    damping: float | None = None,
    required: bool = False,
) -> Settling:
    """Run ``dem`` until its grains are at rest (module docstring).

    Parameters
    ----------
    kinetic : float
        Kinetic energy over the reference energy below which grains are at rest.
    longest : float, optional
        Time [s] after which it is given up; by default a hundred falls through the height of the device, or 1e5 steps
        where there is no gravity.
    damping : float, optional
        Rate [1/s] at which velocities and spins are taken down between the looks, in addition to what the contacts do:
        exp(-damping t). By default sqrt(g/d), 1/e a look, with gravity, and none without. It acts against walls that
        turn as well.
    required : bool
        Raise where grains do not come to rest.

    Raises
    ------
    ValueError
        If a number is out of range.
    NotAtRestError
        If grains still move at the longest time and rest is required.
    """
    for name, value in (("kinetic", kinetic), ("longest", math.inf if longest is None else longest)):
        if not value > 0.0:
            raise ValueError(f"{name} = {value:g}; allowed: more than 0")
    if damping is not None and not 0.0 <= damping < math.inf:
        raise ValueError(f"damping = {damping:g} 1/s; allowed: 0 or more")
    grains = dem.grains
    diameter = 2.0 * grains.radius
    g = 0.0 if dem.gravity_now is None else float(np.linalg.norm(dem.gravity_now))
    weight = dem.n_sectors * g * float(grains.mass @ diameter)
    if g > 0.0:
        height = float(np.ptp(grains.position, axis=0).max() + diameter.max())
        look = math.ceil(math.sqrt(float(diameter.max()) / g) / dem.dt)
        limit = _MAX_FALLS * math.sqrt(2.0 * height / g) if longest is None else longest
    else:
        look, limit = _LOOK_STEPS, 1e5 * dem.dt if longest is None else longest
    rate = (math.sqrt(g / float(diameter.max())) if g > 0.0 else 0.0) if damping is None else damping
    kept = math.exp(-rate * look * dem.dt)
    most = max(1, math.ceil(limit / dem.dt))
    reference, still, steps, missed, ratio, contacts = weight, 0, 0, 0, math.inf, 0
    if g == 0.0:
        reference = dem.n_sectors * grains.kinetic_energy()
    while steps < most and still < 2:
        n = min(look, most - steps)
        totals = dem.run(n)
        steps, missed = steps + n, missed + getattr(totals, "missed_steps", 0)
        contacts = totals.n_contacts
        moving, stored = dem.n_sectors * grains.kinetic_energy(), 0.0
        if totals.energy is not None:
            moving, stored = totals.energy.kinetic_energy, totals.energy.elastic_energy
        if g == 0.0:
            reference = max(reference, moving + stored)
        ratio = moving / reference if reference > 0.0 else 0.0
        still = still + 1 if ratio < kinetic else 0
        if kept < 1.0 and still < 2 and (g == 0.0 or ratio < _FALLS_OVER):
            dem.grains.velocity[:] *= kept
            dem.grains.angular_velocity[:] *= kept
    result = Settling(still == 2, steps * dem.dt, ratio, contacts, missed / max(steps, 1))
    if required and not result.reached:
        raise NotAtRestError(
            f"after {result.time:.4g} s the grains still move: kinetic energy over the reference is {ratio:.2g} "
            f"(at rest: below {kinetic:g}); allow more time, more damping, or let walls stand still",
            result,
        )
    return result


@contextmanager
def before_the_start(dem: GrainMotion) -> Iterator[GrainMotion]:
    """Hold every shaft while grains settle; afterwards shafts and clock are as at the beginning.

    Contact history and the grains' velocities stay: the run continues from the settled bed without a bump.
    """
    kept = [(body.motion, body.angle, body.speed) for body in dem.bodies]
    clock = dem.step_count
    for body in dem.bodies:
        body.motion, body.speed = ZERO, 0.0
    try:
        yield dem
    finally:
        for body, (motion, angle, speed) in zip(dem.bodies, kept, strict=True):
            body.motion, body.angle, body.speed = motion, angle, speed
        dem.step_count = clock
