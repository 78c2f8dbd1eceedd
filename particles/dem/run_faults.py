"""Errors that stop a run by DEM, with the grain and the remedy."""

from __future__ import annotations

import numpy as np

from particles.dem import total_columns
from particles.errors import DemError, DemErrorKind
from particles.grains import Grains


def escaped(grains: Grains, gone: np.ndarray, time: float) -> DemError:
    """Grains ``gone`` (their rows) have left the device; ``time`` [s] is now."""
    k = int(gone[0])
    return DemError(
        DemErrorKind.ESCAPED,
        f"it has left the device ({len(gone)} grains have)",
        "the walls may have a slot, or it was pressed through one: raise the stiffness or shorten dt",
        grains.particle_id[k], grains.position[k], time,
    )  # fmt: skip


def stopped(
    answer: int, totals: np.ndarray, grains: Grains, dt: float, overlap_limit: float, fastest: float, time: float
) -> DemError:
    """Return why the step gave an ``answer`` other than that it is done or needs a list.

    ``totals`` are its sums; ``overlap_limit`` is a share of the diameter, ``fastest`` radii of the smallest grain a
    step, ``time`` [s] now.
    """
    g = grains
    if answer == total_columns.OVERLAP:
        k = int(totals[total_columns.GRAIN])
        return DemError(
            DemErrorKind.OVERLAP,
            f"it overlaps a neighbour or a wall by {100.0 * totals[total_columns.MAX_OVERLAP]:.3g} % of the "
            f"diameter (the limit is {100.0 * overlap_limit:.3g} %)",
            f"raise the stiffness, too soft for the load, or shorten dt = {dt:.3g} s if grains are fast",
            g.particle_id[k], g.position[k], time,
        )  # fmt: skip
    if answer == total_columns.TOO_FAST:
        k = int(np.argmax(np.einsum("ij,ij->i", g.velocity, g.velocity)))
        speed = float(np.linalg.norm(g.velocity[k]))
        return DemError(
            DemErrorKind.TOO_FAST,
            f"at {speed:.3g} m/s it moves {speed * dt / g.radius.min():.2g} radii of the smallest grain in a "
            f"step (the limit is {fastest:g})",
            f"shorten dt = {dt:.3g} s, or find out what drives it",
            g.particle_id[k], g.position[k], time,
        )  # fmt: skip
    state = np.concatenate([g.position, g.velocity, g.angular_velocity], axis=1)
    bad = np.flatnonzero(~np.isfinite(state).all(axis=1))
    k = int(bad[0]) if len(bad) else 0
    return DemError(
        DemErrorKind.NOT_FINITE,
        "its position or velocity is not a finite number",
        f"check the external forces, and whether dt = {dt:.3g} s is too long for the stiffness",
        g.particle_id[k], g.position[k], time,
    )  # fmt: skip
