"""Errors that stop a run of rigid grains, with the grain and the remedy."""

from __future__ import annotations

import numpy as np

from particles.dvi import end_of_step
from particles.dvi.step_kernel import OVERLAP
from particles.errors import DemError, DemErrorKind, ParticleError
from particles.grains import Grains

SHOT_OFF = 20.0  # radii a step: what no wall of a device throws a grain at


def escaped(grains: Grains, gone: np.ndarray, dt: float, time: float) -> DemError:
    """Grains ``gone`` (their rows) have left the device; ``time`` [s] is now."""
    k = int(gone[0])
    return DemError(
        DemErrorKind.ESCAPED,
        f"it has left the device ({len(gone)} grains have)",
        f"the walls may have a slot; or shorten dt = {dt:.3g} s",
        grains.particle_id[k], grains.position[k], time,
    )  # fmt: skip


def refuse_shot_off(fastest: float, grains: Grains, dt: float, tolerance: float, time: float) -> None:
    """A solution that missed its tolerance by far may shoot a grain out of the device within a step: a DemError.

    ``fastest`` [m/s] is the largest speed of a grain, ``tolerance`` [m/s] that of the natural map.
    """
    if fastest * dt <= SHOT_OFF * float(grains.radius.min()):
        return
    k = int(np.argmax(np.sum(grains.velocity**2, axis=1)))
    raise DemError(
        DemErrorKind.TOO_FAST,
        f"it was shot off at {fastest:.3g} m/s, {0.5 * fastest * dt / grains.radius[k]:.3g} diameters in a step, "
        f"by contacts whose impulses did not converge to {tolerance:.3g} m/s",
        f"rigid grains jammed between walls that push have no finite forces: shorten dt = {dt:.3g} s, allow "
        "more sweeps, leave more clearance, or use DEM",
        grains.particle_id[k], grains.position[k], time,
    )  # fmt: skip


def stopped(
    answer: int, totals: np.ndarray, grains: Grains, dt: float, overlap_limit: float, tolerance: float, time: float
) -> ParticleError:
    """Return why the step gave an ``answer`` other than that it is done or needs a list.

    ``totals`` are its sums; ``overlap_limit`` is a share of the diameter, ``tolerance`` [m/s] that of the natural map,
    ``time`` [s] now.
    """
    g = grains
    if answer == OVERLAP:
        k = int(totals[end_of_step.GRAIN])
        return DemError(
            DemErrorKind.OVERLAP,
            f"it overlaps a neighbour or a wall by {100.0 * totals[end_of_step.MAX_OVERLAP]:.3g} % of the "
            f"diameter (the limit is {100.0 * overlap_limit:.3g} %)",
            f"shorten dt = {dt:.3g} s, or tighten the tolerance of {tolerance:.3g} m/s",
            g.particle_id[k], g.position[k], time,
        )  # fmt: skip
    state = np.concatenate([g.position, g.velocity, g.angular_velocity], axis=1)
    bad = np.flatnonzero(~np.isfinite(state).all(axis=1))
    if len(bad) == 0:
        return ParticleError(f"t = {time:.6g} s: the speed of a shaft is not a finite number")
    return DemError(
        DemErrorKind.NOT_FINITE,
        "its position or velocity is not a finite number", "check the external forces",
        g.particle_id[bad[0]], g.position[bad[0]], time,
    )  # fmt: skip
