"""Spaces of an annular device that grains fill: all, unless it has regions to choose from."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from geometry.walls import AnnularBox


class AnnularSpaces(ABC):
    """Mix-in of a shape whose spaces for grains, `fill_boxes`, are rings."""

    __slots__ = ()

    @property
    @abstractmethod
    def largest_radius(self) -> float:
        """Largest radius [m] at which a wall touches grains."""

    @abstractmethod
    def fill_boxes(self) -> dict[str, AnnularBox]:
        """Its disjoint spaces by name."""

    def boxes_to_fill(self, region: str = "cavity") -> list[AnnularBox]:
        """All of its spaces, whatever the region (ignored: it has none to choose from)."""
        return list(self.fill_boxes().values())

    def space(self, region: str = "cavity") -> list[AnnularBox]:
        """What is filled of a region, as `particles.pack` takes it."""
        return self.boxes_to_fill(region)

    def extent(self, region: str = "cavity") -> np.ndarray:
        """Extent [m] of the rings of a region, out to the walls, along x, y, z; shape (3,)."""
        boxes = self.boxes_to_fill(region)
        low, high = min(box.z0 for box in boxes), max(box.z1 for box in boxes)
        return np.array([2.0 * self.largest_radius, 2.0 * self.largest_radius, high - low])

    @property
    def bed_height(self) -> float:
        """Largest height [m] of a bed: with the axis lying."""
        return 2.0 * self.largest_radius

    def volume_to_fill(self, region: str = "cavity") -> float:
        """Volume of a region [m^3]."""
        return sum(box.volume() for box in self.boxes_to_fill(region))
