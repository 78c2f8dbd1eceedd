"""Inconsistent sizes of a clutch, with remedies.

The layout stacks its parts radially, so most parts cannot overlap whatever their sizes. What can go wrong
is listed here: sizes that are not lengths, seal and shaft against the disc, ring and coil against the axial
lengths, a coil radius that reaches into the rotor, slots deeper than their body, and gaps too thin for a
grain or for a mesh.
"""

from __future__ import annotations

import math
from typing import TYPE_CHECKING

from geometry.fault import GeometryFault, millimetres
from geometry.slots import slot_faults

if TYPE_CHECKING:
    from geometry.clutch import Clutch

# A gap is meshed with elements as wide as a quarter of it: about 40 x slenderness triangles, here 80 000.
SLENDEREST = 2000.0
AIR_FACTORS = (1.5, 20.0)

_SIZES = (
    "disc_radius", "disc_thickness", "gap", "face_gap", "seal_radius", "rotor_wall", "ring_width",
    "cover_thickness",
    "clearance", "coil_width", "coil_height", "yoke", "shaft_radius", "housing_width", "coil_radius",
)  # fmt: skip


def find_faults(clutch: Clutch, grain_diameter: float | None = None) -> list[GeometryFault]:
    """Every fault of a clutch; relations are judged only between sizes that are lengths by themselves."""
    found = _sizes(clutch)
    broken = {fault.what for fault in found}
    for check in (_chamber, _magnetic_path, _coil_radius, _slenderness, _slots):
        found += check(clutch, broken)
    if grain_diameter is not None:
        found += _grain(clutch, broken, grain_diameter)
    return found


def _fault(clutch: Clutch, name: str, reason: str, allowed: str, remedy: str) -> GeometryFault:
    value = getattr(clutch, name)
    if value is None:  # a default that follows from other sizes
        value = {"housing_width": clutch.housing_length, "coil_radius": clutch.coil_inner_radius}[name]
    return GeometryFault(name, millimetres(value), reason, allowed, remedy)


def _sizes(clutch: Clutch) -> list[GeometryFault]:
    found = []
    for name in _SIZES:
        value = getattr(clutch, name)
        if value is None or 0.0 < value < math.inf or (name == "ring_width" and value == 0.0):
            continue
        allowed = "0 mm (no ring) or more" if name == "ring_width" else "more than 0 mm"
        found.append(_fault(clutch, name, "it is not a positive length", allowed, f"correct `{name}`"))
    for name in ("gap", "face_gap", "clearance"):
        value = getattr(clutch, name)
        if 0.0 < clutch.disc_radius <= value < math.inf:
            reason = "a gap is wider than the disc's radius; a bare number is in metres"
            remedy = f"write it with its unit, as in `{name}` = '1 mm'"
            found.append(_fault(clutch, name, reason, f"less than {millimetres(clutch.disc_radius)}", remedy))
    low, high = AIR_FACTORS
    if not low <= clutch.air_factor <= high:
        reason = "the air must enclose the device with some room, and not dwarf it"
        remedy = "3 is a good choice for `air_factor`"
        found.append(GeometryFault("air_factor", f"{clutch.air_factor:g}", reason, f"{low:g} to {high:g}", remedy))
    return found


def _chamber(clutch: Clutch, broken: set[str]) -> list[GeometryFault]:
    found = []
    if not broken & {"seal_radius", "disc_radius"} and clutch.seal_radius >= clutch.disc_radius:
        found.append(_fault(
            clutch, "seal_radius", "the seal covers the whole face of the disc, no powder reaches it",
            f"less than `disc_radius` ({millimetres(clutch.disc_radius)})",
            "lower `seal_radius` or raise `disc_radius`",
        ))  # fmt: skip
    if not broken & {"seal_radius", "shaft_radius"} and clutch.seal_radius <= clutch.shaft_radius:
        found.append(_fault(
            clutch, "seal_radius", "the seal lies inside the shaft",
            f"more than `shaft_radius` ({millimetres(clutch.shaft_radius)})",
            "raise `seal_radius` or lower `shaft_radius`",
        ))  # fmt: skip
    if not broken & {"disc_radius", "shaft_radius"} and clutch.shaft_radius >= clutch.disc_radius:
        found.append(_fault(
            clutch, "shaft_radius", "the shaft is as thick as the disc",
            f"less than `disc_radius` ({millimetres(clutch.disc_radius)})",
            "lower `shaft_radius` or raise `disc_radius`",
        ))  # fmt: skip
    return found


def _magnetic_path(clutch: Clutch, broken: set[str]) -> list[GeometryFault]:
    found = []
    rotor_sizes = {"disc_thickness", "face_gap", "cover_thickness"}
    if not broken & {"ring_width", *rotor_sizes}:
        # With steel covers the flux enters the disc through its faces and needs no pole at the rim.
        limit = clutch.cavity_length if clutch.cover_magnetic else clutch.disc_thickness
        if clutch.ring_width >= limit:
            what = "powder chamber" if clutch.cover_magnetic else "disc"
            found.append(_fault(
                clutch, "ring_width", f"the non-magnetic ring is as wide as the {what} and leaves no pole",
                f"0 mm to less than {millimetres(limit)}",
                "lower `ring_width` or raise `disc_thickness`",
            ))  # fmt: skip
    if broken & {"coil_width", "housing_width", *rotor_sizes}:
        return found
    if clutch.coil_width >= clutch.housing_length:
        found.append(_fault(
            clutch, "coil_width", f"the coil cuts through the side walls of the housing, "
            f"which is {millimetres(clutch.housing_length)} wide",
            f"less than {millimetres(clutch.housing_length)}",
            "lower `coil_width` or raise `housing_width`",
        ))  # fmt: skip
    elif clutch.coil_width >= clutch.rotor_length:
        found.append(_fault(
            clutch, "coil_width", "the coil is as wide as the rotor: the housing's poles face no rotor",
            f"less than {millimetres(clutch.rotor_length)}",
            "lower `coil_width` or raise `disc_thickness`",
        ))  # fmt: skip
    if "ring_width" not in broken and clutch.housing_length <= clutch.ring_width:
        found.append(_fault(
            clutch, "housing_width", "the housing is no wider than the ring: its poles face no steel",
            f"more than `ring_width` ({millimetres(clutch.ring_width)})",
            "raise `housing_width` or lower `ring_width`",
        ))  # fmt: skip
    return found


def _coil_radius(clutch: Clutch, broken: set[str]) -> list[GeometryFault]:
    sizes = {"coil_radius", "disc_radius", "gap", "rotor_wall", "clearance"}
    if clutch.coil_radius is None or broken & sizes:
        return []
    if clutch.coil_inner_radius >= clutch.housing_bore:
        return []
    parts = (
        (clutch.disc_radius, "the disc"),
        (clutch.bore_radius, "the powder cavity"),
        (clutch.rotor_radius, "the rotor's shell"),
        (clutch.housing_bore, "the running clearance"),
    )
    limit, part = next(entry for entry in parts if clutch.coil_radius < entry[0])
    return [_fault(
        clutch, "coil_radius", f"the coil cuts {part}, which reaches to r = {millimetres(limit)}",
        f"at least {millimetres(clutch.housing_bore)}",
        "raise `coil_radius`, or leave it out and the coil lies right outside the rotor",
    )]  # fmt: skip


def _slenderness(clutch: Clutch, broken: set[str]) -> list[GeometryFault]:
    found = []
    for name, length, sizes in (
        ("gap", clutch.cavity_length, {"disc_thickness", "face_gap"}),
        ("face_gap", clutch.disc_radius - clutch.seal_radius, {"disc_radius", "seal_radius"}),
        ("clearance", clutch.rotor_length, {"disc_thickness", "face_gap", "cover_thickness"}),
    ):
        if not broken & {name, *sizes} and getattr(clutch, name) * SLENDEREST < length:
            found.append(_fault(
                clutch, name, f"it is {millimetres(length)} long: too slender for a mesh",
                f"at least {millimetres(length / SLENDEREST)}",
                f"raise `{name}`, and check the units of the sizes",
            ))  # fmt: skip
    return found


def _slots(clutch: Clutch, broken: set[str]) -> list[GeometryFault]:
    found = []
    if clutch.disc_slots is not None and not broken & {"disc_radius", "shaft_radius"}:
        room = clutch.disc_radius - clutch.shaft_radius
        found += slot_faults(clutch.disc_slots, "disc_slots", "the disc", room, "the shaft")
    if clutch.rotor_slots is not None and "rotor_wall" not in broken:
        room = clutch.rotor_wall
        found += slot_faults(clutch.rotor_slots, "rotor_slots", "the rotor's shell", room, "the clearance")
    return found


def _grain(clutch: Clutch, broken: set[str], diameter: float) -> list[GeometryFault]:
    found = []
    for name in ("gap", "face_gap"):
        if name not in broken and getattr(clutch, name) < diameter:
            found.append(_fault(
                clutch, name, f"it is thinner than one grain ({millimetres(diameter)}): no grain fits",
                f"at least {millimetres(diameter)}",
                f"raise `{name}` or lower `grain_diameter`",
            ))  # fmt: skip
    if not broken & {"seal_radius", "disc_radius"} and 0.0 < clutch.disc_radius - clutch.seal_radius < diameter:
        found.append(_fault(
            clutch, "seal_radius", f"the chamber is lower than one grain ({millimetres(diameter)})",
            f"at most {millimetres(clutch.disc_radius - diameter)}",
            "lower `seal_radius` or `grain_diameter`",
        ))  # fmt: skip
    return found
