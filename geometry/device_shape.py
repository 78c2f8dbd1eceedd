"""Interface of every shape of a device, and of those with a coil."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

import numpy as np

from geometry.box import Box
from geometry.fault import GeometryFault
from geometry.sheared_gap import ShearedGap
from geometry.walls import AnnularBox, Wall

FilledSpace = list[AnnularBox] | Box
"""What grains are put into, as `particles.pack` takes it: rings, or a box."""


class DeviceShape(Protocol):
    """A shape such as `geometry.Clutch` or `geometry.Box`: its walls, and the space of its grains."""

    @property
    def largest_radius(self) -> float:
        """Largest radius [m] at which a wall touches grains; 0 without an axis."""

    def faults(self, grain_diameter: float | None = None) -> list[GeometryFault]:
        """Every inconsistency of its sizes; with a grain diameter [m], also gaps that no grain fits into."""

    def walls(self) -> Sequence[Wall]:
        """Walls of the grains."""

    def boxes_to_fill(self, region: str = "cavity") -> list[AnnularBox]:
        """The rings that a region of it is filled in; none where it is filled as a whole."""

    def space(self, region: str = "cavity") -> FilledSpace:
        """What is filled of a region."""

    def extent(self, region: str = "cavity") -> np.ndarray:
        """Extent [m] of a region along x, y, z, shape (3,)."""

    @property
    def bed_height(self) -> float:
        """Largest height [m] that a bed of grains can have, however the device is turned."""

    def volume_to_fill(self, region: str = "cavity") -> float:
        """Volume of a region [m^3]."""

    def sheared_gap(self, region: str = "cavity") -> ShearedGap | None:
        """The gap in which powder in a region is sheared; None where nothing turns."""

    def gap_parts(self, boxes: Sequence[AnnularBox]) -> list[tuple[AnnularBox, bool]]:
        """Those of the filled boxes that lie between the shafts, and whether the gap's width is along r."""


class WoundShape(DeviceShape, Protocol):
    """A shape with a coil and a gap that its flux crosses."""

    @property
    def coil_area(self) -> float:
        """Area [m^2] of the coil's window."""

    @property
    def coil_mean_radius(self) -> float:
        """Mean radius [m] of the coil's window."""

    @property
    def ring_width(self) -> float:
        """Width [m] in the middle of the gap between the poles; 0 where they are not known."""

    def gap_midline(self, count: int = 101) -> np.ndarray:
        """Points (r, z) [m] along the middle of the gap, shape (count, 2)."""

    def face_midline(self, count: int = 101) -> np.ndarray:
        """Points (r, z) [m] along the middle of a face gap, shape (count, 2)."""

    def air_gaps(self) -> dict[str, list[AnnularBox]]:
        """Parts of the air that the coil's flux has to cross, by name; none where they are not known."""

    def body(self, region: str) -> str:
        """The body that a region turns with."""
