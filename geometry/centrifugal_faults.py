"""Inconsistent sizes of a centrifugal clutch, with remedies."""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from geometry.fault import GeometryFault, millimetres

if TYPE_CHECKING:
    from geometry.centrifugal import CentrifugalClutch

_COUNTS = (("vanes", 1, 60), ("slots", 0, 20), ("ribs", 0, 360))


def find_faults(clutch: CentrifugalClutch, grain_diameter: float | None = None) -> list[GeometryFault]:
    """Every fault of a clutch; relations are judged only between numbers that are right by themselves."""
    found = _numbers(clutch) or _vanes(clutch) + _slots(clutch) + _ribs(clutch)
    if not found and grain_diameter is not None:
        found = _grain(clutch, grain_diameter)
    return found


def _fault(clutch: CentrifugalClutch, name: str, reason: str, allowed: str, remedy: str) -> GeometryFault:
    value = getattr(clutch, name)
    shown = f"{value:g}" if name in [count for count, _, _ in _COUNTS] else millimetres(value)
    return GeometryFault(name, shown, reason, allowed, remedy)


def _numbers(clutch: CentrifugalClutch) -> list[GeometryFault]:
    """Counts that are none, and sizes that are not lengths; those of what there is none of do not matter."""
    found = []
    for name, least, most in _COUNTS:
        count = getattr(clutch, name)
        if not least <= count <= most or count != int(count):
            allowed = f"a whole number from {least} to {most}"
            found.append(_fault(clutch, name, f"it is not a number of {name}", allowed, f"correct `{name}`"))
    sizes = ["drum_radius", "width", "hub_radius", "vane_thickness", "tip_clearance", "side_clearance"]
    sizes += ["slot_width", "slot_depth"] if clutch.slots else []
    sizes += ["rib_height", "rib_width"] if clutch.ribs else []
    for name in sizes:
        if not 0.0 < getattr(clutch, name) < math.inf:
            reason = "it is not a positive length"
            found.append(_fault(clutch, name, reason, "more than 0 mm", f"correct `{name}`"))
    return found


def _vanes(clutch: CentrifugalClutch) -> list[GeometryFault]:
    found = []
    least = clutch.hub_radius + clutch.tip_clearance + (clutch.rib_height if clutch.ribs else 0.0)
    if clutch.drum_radius <= least + clutch.vane_thickness:  # a vane shorter than thick is none
        found.append(
            _fault(clutch, "drum_radius", "hub, ribs and tip clearance leave no room for the vanes",
                   f"more than {millimetres(least + clutch.vane_thickness)}",
                   "raise `drum_radius` or lower `hub_radius`")
        )  # fmt: skip
    thickest = 2.0 * clutch.hub_radius * math.sin(math.pi / max(clutch.vanes, 2))
    if clutch.vane_thickness >= thickest:
        found.append(
            _fault(clutch, "vane_thickness", f"{clutch.vanes} vanes of this thickness meet on the hub",
                   f"less than {millimetres(thickest)}", "lower `vane_thickness` or `vanes`")
        )  # fmt: skip
    if clutch.side_clearance >= 0.5 * clutch.width:
        found.append(
            _fault(clutch, "side_clearance", "the clearances at both covers leave no width for the vanes",
                   f"less than {millimetres(0.5 * clutch.width)}",
                   "lower `side_clearance` or raise `width`")
        )  # fmt: skip
    return found


def _slots(clutch: CentrifugalClutch) -> list[GeometryFault]:
    if not clutch.slots:
        return []
    found = []
    room = clutch.width - 2.0 * clutch.side_clearance
    if 0.0 < room <= clutch.slots * clutch.slot_width:
        found.append(
            _fault(clutch, "slot_width", f"{clutch.slots} slots leave no tooth of a vane {millimetres(room)} wide",
                   f"less than {millimetres(room / clutch.slots)}", "lower `slot_width` or `slots`")
        )  # fmt: skip
    length = clutch.tip_radius - clutch.hub_radius
    if 0.0 < length <= clutch.slot_depth:
        found.append(
            _fault(clutch, "slot_depth", "the slots reach the hub and cut the teeth off",
                   f"less than {millimetres(length)}", "lower `slot_depth`")
        )  # fmt: skip
    return found


def _ribs(clutch: CentrifugalClutch) -> list[GeometryFault]:
    if not clutch.ribs or clutch.rib_radius <= 0.0:
        return []
    # Flat tops: as wide as the chord of the drum at their height, or as the polygon of all tops has sides.
    chord = 2.0 * math.sqrt(clutch.drum_radius**2 - clutch.rib_radius**2)
    side = 2.0 * clutch.rib_radius * math.tan(math.pi / max(clutch.ribs, 3))
    if clutch.rib_width < min(chord, side):
        return []
    reason = "their edges vanish in the drum" if chord < side else f"{clutch.ribs} of them leave no groove between them"
    return [
        _fault(clutch, "rib_width", f"the ribs are so wide that {reason}", f"less than {millimetres(min(chord, side))}",
               "lower `rib_width`" + (" or raise `rib_height`" if chord < side else " or "
               "`ribs`"))
    ]  # fmt: skip


def _grain(clutch: CentrifugalClutch, d: float) -> list[GeometryFault]:
    """Check that grains fit everywhere, and that not all of them escape the vanes."""
    found, grain = [], millimetres(d)
    ring = clutch.rib_radius - clutch.hub_radius
    if ring < d:
        found.append(
            _fault(clutch, "drum_radius",
                   f"the ring of {millimetres(ring)} between hub and ribs is thinner than one grain ({grain}): no "
                   "grain fits", f"at least {millimetres(clutch.drum_radius + d - ring)}",
                   "raise `drum_radius` or lower `grain_diameter`")
        )  # fmt: skip
    if clutch.width < d:
        found.append(
            _fault(clutch, "width", f"the drum is narrower than one grain ({grain}): no grain fits",
                   f"at least {grain}", "raise `width` or lower `grain_diameter`")
        )  # fmt: skip
    chamber = 2.0 * clutch.tip_radius * math.sin(math.pi / max(clutch.vanes, 2)) - clutch.vane_thickness
    if chamber < d:
        found.append(
            _fault(clutch, "vanes", f"two vanes are {millimetres(chamber)} apart at their tips, less than one grain "
                   f"({grain}): none fits between them",
                   f"at most {_most_vanes(clutch, d)}", "lower `vanes` or `grain_diameter`")
        )  # fmt: skip
    over = clutch.drum_radius - clutch.tip_height
    if over >= d:
        found.append(
            _fault(clutch, "tip_clearance", f"the vanes end {millimetres(over)} short of the drum, a grain's diameter "
                   f"({grain}) or more: the shot passes over their tips and nothing drags it round",
                   f"less than {millimetres(max(0.0, clutch.tip_clearance + d - over))}",
                   "lower `tip_clearance` or raise `grain_diameter`")
        )  # fmt: skip
    if clutch.side_clearance >= d:
        found.append(
            _fault(clutch, "side_clearance", f"a grain ({grain}) passes beside the vanes",
                   f"less than {grain}", "lower `side_clearance` or raise `grain_diameter`")
        )  # fmt: skip
    return found


def _most_vanes(clutch: CentrifugalClutch, d: float) -> int:
    ratio = 0.5 * (d + clutch.vane_thickness) / clutch.tip_radius
    return max(1, math.floor(math.pi / math.asin(ratio))) if ratio < 1.0 else 1
