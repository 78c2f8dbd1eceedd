"""A rectangular box: closed, for tests of grains and of loose packings, or periodic. It has no mesh."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geometry.fault import GeometryFault, millimetres
from geometry.walls import AnnularBox, Plane, RevolvedWall

FLAT = 1e5
"""Distance of the axis from a flat gap over its longest edge: its faces then move evenly along x to 1e-5."""


@dataclass(frozen=True, slots=True)
class Box:
    """|x| < X/2, |y| < Y/2, 0 < z < Z for size = (X, Y, Z) [m]; its six planes belong to body ``housing``."""

    size: tuple[float, float, float]

    @property
    def lower(self) -> np.ndarray:
        """Lowest corner [m], shape (3,)."""
        return np.array([-0.5 * self.size[0], -0.5 * self.size[1], 0.0])

    @property
    def upper(self) -> np.ndarray:
        """Highest corner [m], shape (3,)."""
        return np.array([0.5 * self.size[0], 0.5 * self.size[1], self.size[2]])

    @property
    def volume(self) -> float:
        """Volume [m^3]."""
        return math.prod(self.size)

    @property
    def largest_radius(self) -> float:
        """0: a box has no axis."""
        return 0.0

    def boxes_to_fill(self, region: str = "cavity") -> list[AnnularBox]:
        """None: it is filled as a whole."""
        return []

    def space(self, region: str = "cavity") -> Box:
        """Return the box: it is filled as a whole."""
        return self

    def extent(self, region: str = "cavity") -> np.ndarray:
        """Sides [m], shape (3,)."""
        return np.asarray(self.size)

    @property
    def bed_height(self) -> float:
        """Height [m]."""
        return self.size[2]

    def volume_to_fill(self, region: str = "cavity") -> float:
        """Volume [m^3]."""
        return self.volume

    def sheared_gap(self, region: str = "cavity") -> None:
        """None: nothing turns."""
        return None

    def gap_parts(self, boxes: object) -> list:
        """None: nothing turns."""
        return []

    def faults(self, grain_diameter: float | None = None) -> list[GeometryFault]:
        """Every inconsistency; with a grain diameter [m], also a side that is shorter than one grain."""
        faults = []
        for axis, length in zip("xyz", self.size, strict=True):
            if not 0.0 < length < math.inf:
                reason, allowed = f"the {axis} side must be positive", "more than 0 mm"
                remedy = "give `size` three positive lengths"
            elif grain_diameter is not None and length < grain_diameter:
                grain = millimetres(grain_diameter)
                reason = f"the {axis} side is shorter than one grain ({grain}): no grain fits"
                allowed = f"at least {millimetres(grain_diameter)}"
                remedy = "raise `size` or lower `grain_diameter`"
            else:
                continue
            faults.append(GeometryFault("size", millimetres(length), reason, allowed, remedy))
        return faults

    def walls(self) -> list[Plane]:
        """The six planes, normals inward."""
        planes = []
        for axis, letter in enumerate("xyz"):
            inward = np.zeros(3)
            inward[axis] = 1.0
            planes.append(Plane(f"{letter}_low", "housing", self.lower, inward))
            planes.append(Plane(f"{letter}_high", "housing", self.upper, -inward))
        return planes


@dataclass(frozen=True, slots=True)
class PeriodicBox(Box):
    """0 <= x < X, 0 <= y < Y, 0 <= z < Z for size = (X, Y, Z) [m], repeated in all directions: it has no walls."""

    @property
    def lower(self) -> np.ndarray:
        """Lowest corner [m], shape (3,)."""
        return np.zeros(3)

    @property
    def upper(self) -> np.ndarray:
        """Highest corner [m], shape (3,)."""
        return np.asarray(self.size)

    def walls(self) -> list[Plane]:
        """None: beyond each face is the box again."""
        return []


@dataclass(frozen=True, slots=True)
class PeriodicGap(PeriodicBox):
    """Gap 0 < z < Z between two flat faces of steel, repeated along x and y.

    The faces are rings of the bodies ``lower`` and ``upper``. Bodies turn about z, so the box stands at y = -`axis`,
    where a ring that turns moves along x.
    """

    @property
    def axis(self) -> float:
        """Distance of the axis about which the faces turn [m]."""
        return FLAT * max(self.size)

    @property
    def lower(self) -> np.ndarray:
        """Lowest corner [m], shape (3,)."""
        return np.array([0.0, -self.axis, 0.0])

    @property
    def upper(self) -> np.ndarray:
        """Highest corner [m], shape (3,)."""
        return self.lower + self.size

    def walls(self) -> list[RevolvedWall]:  # type: ignore[override]
        """The two faces."""
        ends = 0.5 * self.axis, 2.0 * self.axis
        return [
            RevolvedWall(f"{body}_face", body, (ends[0], z), (ends[1], z), magnetic=True)
            for body, z in (("lower", 0.0), ("upper", self.size[2]))
        ]
