"""Interface of every shape of a device.

What a coil needs beside it (`coil_area`, `coil_mean_radius`, `gap_midline`, ...) has `Clutch` and `CadShape` only.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Protocol

from geometry.fault import GeometryFault
from geometry.sheared_gap import ShearedGap
from geometry.walls import AnnularBox, Wall


class DeviceShape(Protocol):
    """A shape such as `geometry.Clutch` or `geometry.Box`: its walls, and the space of its grains."""

    @property
    def largest_radius(self) -> float:
        """Largest radius [m] at which a wall touches grains; 0 without an axis."""

    def faults(self, grain_diameter: float | None = None) -> list[GeometryFault]:
        """Every inconsistency of its sizes; with a grain diameter [m], also gaps that no grain fits into."""

    def walls(self) -> Sequence[Wall]:
        """Return what grains touch."""

    def boxes_to_fill(self, region: str = "cavity") -> list[AnnularBox]:
        """The rings that a region of it is filled in; none where it is filled as a whole."""

    def volume_to_fill(self, region: str = "cavity") -> float:
        """Volume of a region [m^3]."""

    def sheared_gap(self, region: str = "cavity") -> ShearedGap | None:
        """The gap in which powder in a region is sheared; None where nothing turns."""

    def gap_parts(self, boxes: Sequence[AnnularBox]) -> list[tuple[AnnularBox, bool]]:
        """Those of the filled boxes that lie between the shafts, and whether the gap's width is along r."""
