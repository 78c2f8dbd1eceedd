"""Profiles across the gap and load of the walls, averaged over the windows of a run's steady part: a callback.

It asks for the contacts of each window and changes nothing.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import fields
from typing import Any

import numpy as np

from coupling import WindowRow
from coupling.staggered import forces_of_the_field
from emclutch.simulation.wall_average import WallAverage
from geometry.walls import AnnularBox
from particles import DEM
from particles.diagnostics.bins import Bins, RingBins, SlabBins, ring_bins
from particles.diagnostics.enclosed_space import BoxSpace, Space, default_bins, enclosed_space
from particles.diagnostics.profiles import Profile, ProfileSums, profile_of, profile_sums


class ProfileAverage:
    """Adds up the profiles of the windows that end after `start` [s].

    Parameters
    ----------
    shape
        Of the device; the one of its spaces to fill that holds most grains is the gap, else what the walls enclose.
    start : float
        Time from which on windows count [s].
    poles : sequence of AnnularBox
        The spaces between pole faces.

    Attributes
    ----------
    walls : WallAverage
    """

    def __init__(self, shape: Any, start: float, poles: Sequence[AnnularBox] = ()) -> None:
        self._shape, self._start = shape, start
        self._poles, self.walls = poles, WallAverage(poles)
        self._bins: list[Bins] = []
        self._sums: list[ProfileSums] = []
        self._speeds: dict[str, float] = {}

    def __call__(self, simulation: Any, row: WindowRow) -> None:
        dem = simulation.motion
        if dem.time <= self._start:
            return
        if not self._bins:
            self._bins = bins_across(dem, gap_of(self._shape, dem))
        contacts = dem.contacts()
        self.walls.add(dem, contacts, forces_of_the_field(simulation) if self._poles else None)
        sums = [profile_sums(dem.grains, contacts, bins, dem.sector) for bins in self._bins]
        self._sums = [a + b for a, b in zip(self._sums, sums, strict=True)] if self._sums else sums
        for body in dem.bodies:
            self._speeds[body.name] = self._speeds.get(body.name, 0.0) + body.speed

    def state(self) -> dict[str, Any]:
        """State with which a resumed run continues."""
        bins = [{"kind": type(one).__name__, **_fields(one)} for one in self._bins]
        sums = [_fields(one) for one in self._sums]
        return {"start": self._start, "bins": bins, "sums": sums, "speeds": self._speeds, "walls": self.walls.state()}

    def restore(self, state: dict[str, Any] | None, motion: Any) -> None:
        """Go on with a `motion` from the sums of a checkpoint; restart where there are none or from another time."""
        if state is None or state["start"] != self._start:
            return
        kinds = {kind.__name__: kind for kind in (RingBins, SlabBins)}
        self._bins = [kinds[one.pop("kind")](**one) for one in state["bins"]]
        self._sums = [ProfileSums(**one) for one in state["sums"]]
        self._speeds = dict(state["speeds"])
        self.walls.restore(state["walls"], motion)

    def profiles(self) -> list[Profile]:
        """The means: against r and z in a ring, against z in a box; empty before the first window that counts."""
        if not self._sums:
            return []
        moments = float(self._sums[0].moments[0])
        speeds = {name: total / moments for name, total in self._speeds.items()}
        return [profile_of(sums, bins, speeds) for sums, bins in zip(self._sums, self._bins, strict=True)]


def _fields(one: Any) -> dict[str, Any]:
    """The fields of a dataclass by name, as they are."""
    return {each.name: getattr(one, each.name) for each in fields(one)}


def gap_of(shape: Any, dem: DEM) -> Space:
    """The space to fill that holds the centres of most grains; without such rings, what the walls enclose."""
    rings = shape.boxes_to_fill()
    if not rings:
        return enclosed_space(dem.grains, dem.walls, ring=True if dem.sector else None)
    x = dem.grains.position
    r, z = np.hypot(x[:, 0], x[:, 1]), x[:, 2]

    def held(box: AnnularBox) -> int:
        return int(np.count_nonzero((r >= box.r0) & (r <= box.r1) & (z >= box.z0) & (z <= box.z1)))

    return max(rings, key=held)


def bins_across(dem: DEM, space: Space) -> list[Bins]:
    """Bins one grain wide against r and against z of a ring, against z of a box."""
    width = 2.0 * float(np.mean(dem.grains.radius))
    angle = 2.0 * math.pi if dem.sector is None else dem.sector.angle
    if isinstance(space, BoxSpace):
        return [default_bins(space, width, angle)]
    return [ring_bins(space, width, along="r", angle=angle), ring_bins(space, width, along="z", angle=angle)]
