"""A Couette shear cell: grains between two coaxial cylinders, floor and ceiling. It has no mesh."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from geometry.annular_spaces import AnnularSpaces
from geometry.fault import FaultFinder, GeometryFault, millimetres
from geometry.sheared_gap import ShearedGap
from geometry.walls import AnnularBox, RevolvedWall, annulus, cylinder


@dataclass(frozen=True, slots=True)
class ShearCell(AnnularSpaces):
    """Annulus inner_radius < r < outer_radius, |z| < height/2 [m].

    The inner cylinder belongs to body ``disc``, the outer one to ``rotor``, floor and ceiling to ``housing``.
    """

    inner_radius: float
    outer_radius: float
    height: float

    @property
    def largest_radius(self) -> float:
        """Largest radius [m] at which a wall touches grains."""
        return self.outer_radius

    def sheared_gap(self, region: str = "cavity") -> ShearedGap:
        """All of the annulus."""
        return ShearedGap.of_annulus(self.inner_radius, self.outer_radius)

    def gap_parts(self, boxes: Sequence[AnnularBox]) -> list[tuple[AnnularBox, bool]]:
        """Those filled parts, of `boxes`, that lie between the shafts, and whether the gap's width is along r."""
        return [(box, True) for box in boxes]

    def faults(self, grain_diameter: float | None = None) -> list[GeometryFault]:
        """Every inconsistency; with a grain diameter [m], also a cell that no grain fits into."""
        mm, it = millimetres, FaultFinder(self)
        it.check_lengths("inner_radius", "outer_radius", "height")
        it.judge_relations()
        width = self.outer_radius - self.inner_radius
        it.refuse(width <= 0.0, "outer_radius", "the outer cylinder lies inside the inner one",
                  f"more than {mm(self.inner_radius)}", "raise `outer_radius` or lower `inner_radius`",
                  "inner_radius")  # fmt: skip
        if grain_diameter is not None:
            grain = mm(grain_diameter)
            it.refuse(0.0 < width < grain_diameter, "outer_radius",
                      f"the annulus of {mm(width)} is thinner than one grain ({grain}): no grain fits",
                      f"at least {mm(self.inner_radius + grain_diameter)}",
                      "raise `outer_radius` or lower `grain_diameter`", "inner_radius")  # fmt: skip
            it.refuse(self.height < grain_diameter, "height",
                      f"the cell is lower than one grain ({grain}): no grain fits", f"at least {grain}",
                      "raise `height` or lower `grain_diameter`")  # fmt: skip
        return it.faults

    def walls(self) -> list[RevolvedWall]:
        """The four walls; all corners are concave, so that no edge is owned."""
        half = 0.5 * self.height
        inner, outer = self.inner_radius, self.outer_radius
        return [
            cylinder("inner_cylinder", "disc", inner, -half, half),
            cylinder("outer_cylinder", "rotor", outer, -half, half),
            annulus("floor", "housing", -half, inner, outer),
            annulus("ceiling", "housing", half, inner, outer),
        ]

    def fill_boxes(self) -> dict[str, AnnularBox]:
        """The one space to fill, ``annulus``."""
        return {"annulus": AnnularBox(self.inner_radius, self.outer_radius, -0.5 * self.height, 0.5 * self.height)}
