"""Spaces of an annular device that grains fill: all, unless it has regions to choose from."""

from __future__ import annotations

from abc import ABC, abstractmethod

from geometry.walls import AnnularBox


class AnnularSpaces(ABC):
    """Mix-in of a shape whose spaces for grains, `fill_boxes`, are rings."""

    __slots__ = ()

    @abstractmethod
    def fill_boxes(self) -> dict[str, AnnularBox]:
        """Its disjoint spaces by name."""

    def boxes_to_fill(self, region: str = "cavity") -> list[AnnularBox]:
        """All of its spaces, whatever the region (ignored: it has none to choose from)."""
        return list(self.fill_boxes().values())

    def volume_to_fill(self, region: str = "cavity") -> float:
        """Volume of a region [m^3]."""
        return sum(box.volume() for box in self.boxes_to_fill(region))
