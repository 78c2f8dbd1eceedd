"""Slots in a clutch's disc or rotor: what makes its field three-dimensional.

The slots run axially through the whole body and open into the rim gap; their sides are radial planes, so
that a slot is a fraction of the pitch at every radius. They are filled flush with a non-magnetic material
(resin): grains still meet smooth walls, and only the field sees the slots.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from geometry.fault import GeometryFault, millimetres

# Finer teeth than this are an effective medium, not a geometry to mesh.
MAX_SLOTS = 500


@dataclass(frozen=True, slots=True)
class Slots:
    """Equal slots around a body, the middle of one of them at ``angle``.

    Attributes
    ----------
    count : int
        Slots (as many teeth) around.
    fraction : float
        Width of a slot over the pitch 2 pi/count, more than 0 and less than 1.
    depth : float
        Radial depth [m].
    angle : float
        Angle of the middle of the first slot [rad]; turning one body against the other is changing it.
    """

    count: int
    fraction: float
    depth: float
    angle: float = 0.0

    @property
    def pitch(self) -> float:
        """Angle from slot to slot [rad]."""
        return 2.0 * math.pi / self.count

    @property
    def mirrored(self) -> bool:
        """True if the slots are their own mirror image at the plane of angle 0."""
        turns = 2.0 * self.angle / self.pitch
        return abs(turns - round(turns)) < 1e-9

    def cuts(self, angle: float) -> bool:
        """True if the direction ``angle`` [rad] lies in a slot."""
        offset = (angle - self.angle) / self.pitch
        return abs(offset - round(offset)) < 0.5 * self.fraction

    def edges(self, start: float, end: float) -> np.ndarray:
        """Angles of the slots' sides strictly between start and end [rad], ascending."""
        first = math.floor((start - self.angle) / self.pitch) - 1
        last = math.ceil((end - self.angle) / self.pitch) + 1
        middle = self.angle + self.pitch * np.arange(first, last + 1)
        half = 0.5 * self.fraction * self.pitch
        sides = np.sort(np.concatenate((middle - half, middle + half)))
        margin = 1e-9 * self.pitch
        return sides[(sides > start + margin) & (sides < end - margin)]


def slot_faults(slots: Slots, key: str, body: str, room: float, limit: str) -> list[GeometryFault]:
    """Faults of the slots of a body.

    Parameters
    ----------
    key : str
        What they are called, such as ``"disc_slots"``.
    body : str
        The body in words.
    room : float
        Radial room for the slots [m], a length.
    limit : str
        What ends that room, in words.
    """
    faults = []
    if not 2 <= slots.count <= MAX_SLOTS or slots.count != int(slots.count):
        faults.append(
            GeometryFault(f"{key}.count", f"{slots.count:g}", "it is not a number of slots around a body",
                  f"a whole number from 2 to {MAX_SLOTS}", f"correct `{key}.count`, or leave out `{key}`")
        )  # fmt: skip
    if not 0.0 < slots.fraction < 1.0:
        faults.append(
            GeometryFault(f"{key}.fraction", f"{slots.fraction:g}",
                  "a slot is wider than the pitch" if slots.fraction >= 1.0 else "the slot has no width",
                  "more than 0 and less than 1",
                  f"lower `{key}.fraction`" if slots.fraction >= 1.0
                  else f"raise `{key}.fraction` or leave out `{key}`")
        )  # fmt: skip
    if not 0.0 < slots.depth < math.inf:
        faults.append(
            GeometryFault(f"{key}.depth", millimetres(slots.depth), "it is not a positive length", "more than 0 mm",
                  f"correct `{key}.depth`, or leave out `{key}`")
        )  # fmt: skip
    elif slots.depth >= room:
        faults.append(
            GeometryFault(f"{key}.depth", millimetres(slots.depth), f"the slots cut through {body} down to {limit}",
                  f"less than {millimetres(room)}", f"lower `{key}.depth`")
        )  # fmt: skip
    if not math.isfinite(slots.angle):
        faults.append(
            GeometryFault(f"{key}.angle", f"{slots.angle:g}", "it is not an angle", "any finite angle",
                  f"correct `{key}.angle`")
        )  # fmt: skip
    return faults
