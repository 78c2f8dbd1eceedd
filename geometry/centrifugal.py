"""A centrifugal shot clutch: vanes on the input throw steel shot against the ribbed drum of the output.

The shaft axis z lies horizontally. Body ``rotor`` (input): a hub with straight radial vanes, each a rake whose slots
are open towards the drum. Body ``disc`` (output): the drum around it with its two covers, and ribs along its inner
face. Between them lies the shot. The vanes drag it round; its weight in the centrifugal field presses it on the drum,
and friction there turns the output (`emclutch.simulation.forecast.shot_clutch` has the estimate). Overloaded, the drum
lags and the shot slips back through the slots.

Hub, drum and covers are smooth walls of revolution; vanes and ribs are closed surfaces of triangles, whose roots lie
behind the smooth wall that carries them, out of the grains' reach, so that the joint is a plain concave corner.

A rib should be lower than R (1 - sin(2 atan mu)) for shot of radius R and friction mu: a grain caught between a
vane and the edge of a higher rib jams, its wedge angle being below twice the angle of friction, and the clutch locks
like a sprag.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from geometry.annular_spaces import AnnularSpaces
from geometry.fault import FaultFinder, GeometryFault, millimetres
from geometry.sheared_gap import ShearedGap
from geometry.triangle_wall import TriangleWall, extruded
from geometry.walls import AnnularBox, RevolvedWall, annulus, cylinder

_COUNTS = (("vanes", 1, 60), ("slots", 0, 20), ("ribs", 0, 360))
_SIZES = ("drum_radius", "width", "hub_radius", "vane_thickness", "tip_clearance", "side_clearance")


@dataclass(frozen=True, slots=True)
class Chamber(AnnularBox):
    """The part theta0 < theta < theta1 [rad] of an annular box: the space between two vanes at rest."""

    theta0: float = 0.0
    theta1: float = 2.0 * math.pi

    def volume(self, angle: float = 2.0 * math.pi) -> float:
        """Volume [m^3] of the part of the chamber in 0 < theta < ``angle`` [rad]."""
        opening = max(0.0, min(self.theta1, angle) - max(self.theta0, 0.0))
        return 0.5 * opening * (self.r1**2 - self.r0**2) * (self.z1 - self.z0)


@dataclass(frozen=True, slots=True)
class CentrifugalClutch(AnnularSpaces):
    """Sizes [m] and counts of a shot clutch, symmetric about z = 0; the defaults are those of `cases/thesis`.

    Attributes
    ----------
    drum_radius, width
        Inner radius of the drum and the distance of its covers.
    hub_radius
        Radius of the hub that carries the vanes.
    vanes : int
    vane_thickness
    tip_clearance
        Between the circle of the vanes' tips and the ribs (the drum, where there are none).
    side_clearance
        Between a vane's side and the cover, on both sides.
    slots : int
        Slots in each vane, evenly spread over its width, 0 for plain vanes.
    slot_width, slot_depth
        Axial width of a slot; its radial depth, from the tip inwards.
    ribs : int
        Ribs on the drum, 0 for a smooth one.
    rib_height, rib_width
        Radial height above the drum; tangential width. Their tops are flat.
    """

    drum_radius: float = 120e-3
    width: float = 90e-3
    hub_radius: float = 40e-3
    vanes: int = 6
    vane_thickness: float = 5e-3
    tip_clearance: float = 2e-3
    side_clearance: float = 1e-3
    slots: int = 3
    slot_width: float = 18e-3
    slot_depth: float = 45e-3
    ribs: int = 16
    rib_height: float = 2e-3
    rib_width: float = 6e-3

    @property
    def rib_radius(self) -> float:
        """Smallest radius that the output reaches [m]: the middle of the ribs' tops, or the drum."""
        return self.drum_radius - (self.rib_height if self.ribs else 0.0)

    @property
    def tip_radius(self) -> float:
        """Largest radius that the input reaches [m]: the edges of the vanes' tips."""
        return self.rib_radius - self.tip_clearance

    @property
    def tip_height(self) -> float:
        """Distance of the flat tip of a vane from the axis [m], a little less than the radius of its edges."""
        return math.sqrt(self.tip_radius**2 - 0.25 * self.vane_thickness**2)

    @property
    def tooth_width(self) -> float:
        """Axial width [m] of each of the ``slots + 1`` teeth of a vane."""
        solid = self.width - 2.0 * self.side_clearance - (self.slots * self.slot_width if self.slots else 0.0)
        return solid / (self.slots + 1)

    @property
    def outer_radius(self) -> float:
        """Largest radius that grains reach [m]."""
        return self.drum_radius

    @property
    def inner_radius(self) -> float:
        """Smallest radius that grains reach [m]."""
        return self.hub_radius

    @property
    def vane_volume(self) -> float:
        """Volume [m^3] of one vane outside the hub."""
        t, r = self.vane_thickness, self.hub_radius
        section = t * self.tip_height - _under_arc(r, t)
        volume = section * (self.width - 2.0 * self.side_clearance)
        return volume - (self.slots * self.slot_width * self.slot_depth * t if self.slots else 0.0)

    @property
    def rib_volume(self) -> float:
        """Volume [m^3] of one rib inside the drum."""
        return (_under_arc(self.drum_radius, self.rib_width) - self.rib_width * self.rib_radius) * self.width

    @property
    def volume(self) -> float:
        """Volume [m^3] of the space between hub and drum that vanes and ribs leave to the shot."""
        ring = math.pi * (self.drum_radius**2 - self.hub_radius**2) * self.width
        return ring - self.vanes * self.vane_volume - self.ribs * (self.rib_volume if self.ribs else 0.0)

    @property
    def largest_radius(self) -> float:
        """Largest radius [m] at which a wall touches grains."""
        return self.outer_radius

    def sheared_gap(self, region: str = "cavity") -> ShearedGap:
        """All of the space between hub and drum."""
        return ShearedGap.of_annulus(self.inner_radius, self.outer_radius)

    def gap_parts(self, boxes: Sequence[AnnularBox]) -> list[tuple[AnnularBox, bool]]:
        """None: shot is thrown, and is sheared in no gap."""
        return []

    def faults(self, grain_diameter: float | None = None) -> list[GeometryFault]:
        """Every inconsistency; with a grain diameter [m], also a place that no grain fits into, or all escape by.

        Relations are judged only where all numbers are right by themselves, grains only where the clutch is.
        """
        it = FaultFinder(self)
        for name, least, most in _COUNTS:
            count = getattr(self, name)
            it.refuse(not least <= count <= most or count != int(count), name, f"it is not a number of {name}",
                      f"a whole number from {least} to {most}", f"correct `{name}`", value=f"{count:g}")  # fmt: skip
        slot_sizes = ("slot_width", "slot_depth") if self.slots else ()
        rib_sizes = ("rib_height", "rib_width") if self.ribs else ()
        it.check_lengths(*_SIZES, *slot_sizes, *rib_sizes)
        if not it.faults:
            self._judge_relations(it)
        if not it.faults and grain_diameter is not None:
            self._judge_grains(it, grain_diameter)
        return it.faults

    def _judge_relations(self, it: FaultFinder) -> None:
        mm, vanes = millimetres, max(self.vanes, 2)
        # a vane shorter than thick is none
        least = self.hub_radius + self.drum_radius - self.tip_radius + self.vane_thickness
        it.refuse(self.drum_radius <= least, "drum_radius", "hub, ribs and tip clearance leave no room for the vanes",
                  f"more than {mm(least)}", "raise `drum_radius` or lower `hub_radius`")  # fmt: skip
        thickest = 2.0 * self.hub_radius * math.sin(math.pi / vanes)
        it.refuse(self.vane_thickness >= thickest, "vane_thickness",
                  f"{self.vanes} vanes of this thickness meet on the hub", f"less than {mm(thickest)}",
                  "lower `vane_thickness` or `vanes`")  # fmt: skip
        it.refuse(self.side_clearance >= 0.5 * self.width, "side_clearance",
                  "the clearances at both covers leave no width for the vanes", f"less than {mm(0.5 * self.width)}",
                  "lower `side_clearance` or raise `width`")  # fmt: skip
        if self.slots:
            room, length = self.width - 2.0 * self.side_clearance, self.tip_radius - self.hub_radius
            it.refuse(0.0 < room <= self.slots * self.slot_width, "slot_width",
                      f"{self.slots} slots leave no tooth of a vane {mm(room)} wide",
                      f"less than {mm(room / self.slots)}", "lower `slot_width` or `slots`")  # fmt: skip
            it.refuse(0.0 < length <= self.slot_depth, "slot_depth", "the slots reach the hub and cut the teeth off",
                      f"less than {mm(length)}", "lower `slot_depth`")  # fmt: skip
        if self.ribs and self.rib_radius > 0.0:
            # Flat tops: as wide as the chord of the drum at their height, or as the polygon of all tops has sides.
            chord = 2.0 * math.sqrt(self.drum_radius**2 - self.rib_radius**2)
            side = 2.0 * self.rib_radius * math.tan(math.pi / max(self.ribs, 3))
            crowded = f"{self.ribs} of them leave no groove between them"
            reason = "their edges vanish in the drum" if chord < side else crowded
            it.refuse(self.rib_width >= min(chord, side), "rib_width", f"the ribs are so wide that {reason}",
                      f"less than {mm(min(chord, side))}",
                      "lower `rib_width` or " + ("raise `rib_height`" if chord < side else "`ribs`"))  # fmt: skip

    def _judge_grains(self, it: FaultFinder, d: float) -> None:
        """Note where no grain of diameter d [m] fits, and where all of them would escape the vanes."""
        mm, grain, ring = millimetres, millimetres(d), self.rib_radius - self.hub_radius
        it.refuse(ring < d, "drum_radius",
                  f"the ring of {mm(ring)} between hub and ribs is thinner than one grain ({grain}): no grain fits",
                  f"at least {mm(self.drum_radius + d - ring)}",
                  "raise `drum_radius` or lower `grain_diameter`")  # fmt: skip
        it.refuse(self.width < d, "width", f"the drum is narrower than one grain ({grain}): no grain fits",
                  f"at least {grain}", "raise `width` or lower `grain_diameter`")  # fmt: skip
        chamber = 2.0 * self.tip_radius * math.sin(math.pi / max(self.vanes, 2)) - self.vane_thickness
        ratio = 0.5 * (d + self.vane_thickness) / self.tip_radius
        most = max(1, math.floor(math.pi / math.asin(ratio))) if ratio < 1.0 else 1
        it.refuse(chamber < d, "vanes", f"two vanes are {mm(chamber)} apart at their tips, less than one grain "
                  f"({grain}): none fits between them", f"at most {most}", "lower `vanes` or `grain_diameter`",
                  value=f"{self.vanes:g}")  # fmt: skip
        over = self.drum_radius - self.tip_height
        it.refuse(over >= d, "tip_clearance",
                  f"the vanes end {mm(over)} short of the drum, a grain's diameter ({grain}) or more: the shot "
                  "passes over their tips and nothing drags it round",
                  f"less than {mm(max(0.0, self.tip_clearance + d - over))}",
                  "lower `tip_clearance` or raise `grain_diameter`")  # fmt: skip
        it.refuse(self.side_clearance >= d, "side_clearance", f"a grain ({grain}) passes beside the vanes",
                  f"less than {grain}", "lower `side_clearance` or raise `grain_diameter`")  # fmt: skip

    def walls(self) -> list[RevolvedWall | TriangleWall]:
        """Walls of the grains: hub and vanes on body ``rotor``; drum, covers and ribs on body ``disc``."""
        half = 0.5 * self.width
        smooth = [
            cylinder("hub", "rotor", self.hub_radius, -half, half),
            cylinder("drum", "disc", self.drum_radius, -half, half),
            annulus("cover_left", "disc", -half, self.hub_radius, self.drum_radius),
            annulus("cover_right", "disc", half, self.hub_radius, self.drum_radius),
        ]
        vane = _rake(self)
        vanes = [vane.turned(2.0 * math.pi * k / self.vanes, f"vane_{k + 1}") for k in range(self.vanes)]
        return [*smooth, *vanes, *self._ribs()]

    def fill_boxes(self) -> dict[str, AnnularBox]:
        """The chambers between the vanes at rest, named ``chamber_1`` ...; each clear of the vanes' roots."""
        half, root = 0.5 * self.width, math.asin(0.5 * self.vane_thickness / self.hub_radius)
        pitch = 2.0 * math.pi / self.vanes
        return {
            f"chamber_{k + 1}": Chamber(
                self.hub_radius, self.rib_radius, -half, half, k * pitch + root, (k + 1) * pitch - root
            )
            for k in range(self.vanes)
        }

    def _ribs(self) -> list[TriangleWall]:
        """Bars along z, from rib_radius out to behind the drum, and through the covers."""
        if not self.ribs:
            return []
        low, high, half = self.rib_radius, self.drum_radius + self.rib_height, 0.5 * self.rib_width
        section = np.array([(low, -half), (high, -half), (high, half), (low, half)])
        end = 0.5 * self.width + self.rib_height
        rib = extruded("rib_1", "disc", section, -end, end)
        # Half a pitch aside, so that at rest no rib faces the first vane.
        return [rib.turned(2.0 * math.pi * (k + 0.5) / self.ribs, f"rib_{k + 1}") for k in range(self.ribs)]


def _under_arc(radius: float, width: float) -> float:
    """Area [m^2] of a bar of ``width`` from the axis to the circle of ``radius``: |y| < width/2, 0 < x < arc."""
    half = 0.5 * width
    return half * math.sqrt(radius**2 - half**2) + radius**2 * math.asin(half / radius)


def vane_outline(clutch: CentrifugalClutch) -> np.ndarray:
    """Outline (z, x) of the vane at angle 0 [m], shape (n, 2), with its slots; the root lies in the hub."""
    t, half, tip = clutch.vane_thickness, 0.5 * clutch.width - clutch.side_clearance, clutch.tip_height
    on_hub = math.sqrt(clutch.hub_radius**2 - 0.25 * t**2)
    root = max(0.5 * on_hub, on_hub - t)
    edge = [(-half, tip)]
    for k in range(clutch.slots):
        z0 = -half + (k + 1) * clutch.tooth_width + k * clutch.slot_width
        z1, floor = z0 + clutch.slot_width, tip - clutch.slot_depth
        edge += [(z0, tip), (z0, floor), (z1, floor), (z1, tip)]
    return np.array([(-half, root), *edge, (half, tip), (half, root)])


def _rake(clutch: CentrifugalClutch) -> TriangleWall:
    """The vane at angle 0: its outline, as thick as the vane in y."""
    prism = extruded("vane_1", "rotor", vane_outline(clutch), -0.5 * clutch.vane_thickness, 0.5 * clutch.vane_thickness)
    return TriangleWall("vane_1", "rotor", prism.vertices[:, [1, 2, 0]], prism.triangles)  # (z, x, y) -> (x, y, z)
