"""Load of the walls, averaged over the moments of the steady part of a run, and its split at the pole faces."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from geometry.walls import AnnularBox, RevolvedWall
from particles.diagnostics.enclosed_space import enclosed_space
from particles.diagnostics.wall_pressure import WallBins, WallPressure, WallSums, wall_bins, wall_pressure, wall_sums
from particles.neighbours.contact_table import ContactTable

NEAR = 1e-9  # of a radius: a wall that a box was made from lies at its side


class WallAverage:
    """Sums of the walls' loads over moments.

    Between two pole faces the contact pressure on a face is what the magnetic forces on the grains of the nearer half
    of the gap press against it, and what contacts transmit across the middle. The former is summed here from the
    forces that the grains hold: pull of the steel (images), gradient of the field, and attraction of the other half.

    Parameters
    ----------
    poles : sequence of AnnularBox
        The spaces between pole faces.
    """

    def __init__(self, poles: Sequence[AnnularBox] = ()) -> None:
        self._poles = tuple(poles)
        self._bins: WallBins | None = None
        self._sums: WallSums | None = None
        self._pull = np.zeros((len(self._poles), 2))  # [N], towards the lower and the upper side of each space
        self._walls: Sequence[Any] = ()
        self._n_sectors = 1.0

    def add(self, motion: Any, contacts: ContactTable, force: np.ndarray | None = None) -> None:
        """Add the present moment, with the field's forces (n, 3) [N] (`coupling.staggered.forces_of_the_field`)."""
        if self._bins is None:
            self.begin(motion)
        assert self._bins is not None
        sums = wall_sums(motion.grains, contacts, self._bins, motion.sector)
        self._sums = sums if self._sums is None else self._sums + sums
        if force is None or not self._poles:
            return
        x = motion.grains.position
        r = np.hypot(x[:, 0], x[:, 1])
        at = np.stack([r, x[:, 2]])
        along = np.stack([(force[:, 0] * x[:, 0] + force[:, 1] * x[:, 1]) / np.where(r > 0.0, r, 1.0), force[:, 2]])
        for k, box in enumerate(self._poles):
            axis, low, high = across(box)
            inside = (r > box.r0) & (r < box.r1) & (at[1] > box.z0) & (at[1] < box.z1)
            upper = at[axis] > 0.5 * (low + high)
            self._pull[k] += -along[axis, inside & ~upper].sum(), along[axis, inside & upper].sum()

    def begin(self, motion: Any) -> None:
        """Take the walls of a run, in bins two grains wide: narrower ones hold a contact or none at a moment."""
        self._walls = motion.walls
        self._n_sectors = 1.0 if motion.sector is None else 2.0 * math.pi / motion.sector.angle
        space = enclosed_space(motion.grains, motion.walls, ring=True if motion.sector else None)
        self._bins = wall_bins(motion.walls, space, 4.0 * float(np.mean(motion.grains.radius)), self._poles)

    def state(self) -> dict[str, np.ndarray]:
        """State with which a resumed run continues; empty before the first moment."""
        if self._sums is None or self._bins is None:
            return {}
        sums = {name: getattr(self._sums, name) for name in WallSums.__slots__}
        return sums | {"pull": self._pull, "area": self._bins.area}

    def restore(self, state: dict[str, np.ndarray], motion: Any) -> None:
        """Go on from a state."""
        if not state:
            return
        self.begin(motion)
        assert self._bins is not None
        self._bins = replace(self._bins, area=state["area"])  # an open side of a box ends where grains were then
        self._pull = np.array(state["pull"])
        self._sums = WallSums(**{name: state[name] for name in WallSums.__slots__})

    def pressure(self) -> WallPressure | None:
        """The mean; None before the first moment."""
        if self._sums is None or self._bins is None:
            return None
        return wall_pressure(self._sums, self._bins, self._n_sectors)

    def summary(self) -> dict[str, Any]:
        """Return load by wall, and by body between the pole faces; empty before the first moment."""
        load = self.pressure()
        if load is None:
            return {}
        walls = {}
        for number, wall in enumerate(self._walls):
            own = load.bins.wall == number
            if load.contacts[own].any() and np.isfinite(load.bins.area[own]).all():
                walls[wall.name] = {"body": wall.body, **load.over(own)}
        found: dict[str, Any] = {"moments": load.moments, "walls": walls}
        poles: dict[str, tuple[np.ndarray, float]] = {}
        for k, box in enumerate(self._poles):
            for side, body, own in faces_of(box, load.bins, self._walls):
                chosen, pull = poles.get(body, (np.zeros(len(own), dtype=bool), 0.0))
                poles[body] = chosen | own, pull + self._n_sectors * self._pull[k, side] / load.moments
        if poles:
            found["poles"] = {
                body: load.over(own) | {"magnetic_pull": pull / float(load.bins.area[own].sum())}
                for body, (own, pull) in poles.items()
            }
        return found


def across(box: AnnularBox) -> tuple[int, float, float]:
    """Return the coordinate across the gap, 0 for r or 1 for z, and its limits [m]."""
    radial = box.r1 - box.r0 < box.z1 - box.z0
    return (0, box.r0, box.r1) if radial else (1, box.z0, box.z1)


def faces_of(box: AnnularBox, bins: WallBins, walls: Sequence[Any]) -> list[tuple[int, str, np.ndarray]]:
    """Return side, body and bins (b,) bool of the walls on the lower side (0) and on the upper one (1) of a space."""
    axis, *sides = across(box)
    low, high = (box.z0, box.z1) if axis == 0 else (box.r0, box.r1)
    middle = 0.5 * (bins.low + bins.high)
    found = []
    for number_of_side, side in enumerate(sides):
        own, body = np.zeros(len(middle), dtype=bool), ""
        for number, wall in enumerate(walls):
            on_it = isinstance(wall, RevolvedWall) and all(
                abs(end[axis] - side) <= NEAR * abs(side) + 1e-12 for end in (wall.start, wall.end)
            )
            mine = (bins.wall == number) & (middle > low) & (middle < high)
            if on_it and mine.any():
                own, body = own | mine, wall.body
        if body:
            found.append((number_of_side, body, own))
    return found
