"""Errors that stop a run, with the grain and the remedy; both engines raise them."""

from __future__ import annotations

import numpy as np

from particles.errors import DemError, DemErrorKind, ParticleError
from particles.grains import Grains

SHOT_OFF = 20.0  # radii a step: no wall of a device throws a grain so far


def _error(kind: DemErrorKind, grains: Grains, row: int, time: float, fault: str, remedy: str) -> DemError:
    return DemError(kind, fault, remedy, grains.particle_id[row], grains.position[row], time)


def escaped(grains: Grains, rows: np.ndarray, time: float, remedy: str) -> DemError:
    """Return the error for grains ``rows`` that have left the device; ``time`` [s] is the present one."""
    fault = f"it has left the device ({len(rows)} grains have)"
    return _error(DemErrorKind.ESCAPED, grains, int(rows[0]), time, fault, remedy)


def too_deep(grains: Grains, row: int, overlap: float, limit: float, time: float, remedy: str) -> DemError:
    """Return the error for grain ``row`` with an ``overlap`` beyond the ``limit``, fractions of the diameter."""
    fault = (
        f"it overlaps a neighbour or a wall by {100.0 * overlap:.3g} % of the "
        f"diameter (the limit is {100.0 * limit:.3g} %)"
    )
    return _error(DemErrorKind.OVERLAP, grains, row, time, fault, remedy)


def too_fast(grains: Grains, velocity: np.ndarray, dt: float, limit: float, time: float) -> DemError:
    """Return the error for the fastest grain: in ``dt`` [s] it moves more than ``limit`` radii of the smallest one.

    ``velocity`` (n, 3) [m/s] is peculiar in a sheared box.
    """
    row = int(np.argmax(np.einsum("ij,ij->i", velocity, velocity)))
    speed = float(np.linalg.norm(velocity[row]))
    fault = (
        f"at {speed:.3g} m/s it moves {speed * dt / grains.radius.min():.2g} radii of the smallest grain in a "
        f"step (the limit is {limit:g})"
    )
    remedy = f"shorten dt = {dt:.3g} s, or find out what drives it"
    return _error(DemErrorKind.TOO_FAST, grains, row, time, fault, remedy)


def refuse_shot_off(
    fastest: float, grains: Grains, velocity: np.ndarray, dt: float, tolerance: float, time: float
) -> None:
    """Raise DemError where impulses that missed their tolerance by far have shot a grain off.

    ``fastest`` [m/s] is the largest speed of a grain, ``velocity`` (n, 3) [m/s] the peculiar one of all in a
    sheared box, ``tolerance`` [m/s] that of the natural map.
    """
    if fastest * dt <= SHOT_OFF * float(grains.radius.min()):
        return
    row = int(np.argmax(np.sum(velocity**2, axis=1)))
    fault = (
        f"it was shot off at {fastest:.3g} m/s, {0.5 * fastest * dt / grains.radius[row]:.3g} diameters in a step, "
        f"by contacts whose impulses did not converge to {tolerance:.3g} m/s"
    )
    remedy = (
        f"rigid grains jammed between walls that push have no finite forces: shorten dt = {dt:.3g} s, allow "
        "more sweeps, leave more clearance, or use DEM"
    )
    raise _error(DemErrorKind.TOO_FAST, grains, row, time, fault, remedy)


def not_finite(grains: Grains, time: float, remedy: str) -> ParticleError:
    """Return the error for the first grain whose state is not finite, or else for a shaft.

    A grain whose speed is finite and its square is not counts as not finite: the kernels compare squares.
    """
    state = np.concatenate([grains.position, grains.velocity, grains.angular_velocity], axis=1)
    rows = np.flatnonzero(~np.isfinite(state).all(axis=1))
    if len(rows) == 0:
        with np.errstate(over="ignore"):
            rows = np.flatnonzero(~np.isfinite(np.square(state).sum(axis=1)))
    if len(rows) == 0:
        return ParticleError(f"t = {time:.6g} s: the speed of a shaft is not a finite number")
    fault = "its position or velocity is not a finite number"
    return _error(DemErrorKind.NOT_FINITE, grains, int(rows[0]), time, fault, remedy)
