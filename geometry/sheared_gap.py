"""The gap of a device in which its powder is sheared: each shape says which one that is, see its ``sheared_gap``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from geometry.walls import AnnularBox

AT_RIM = ("rim", "poles")
"""Regions of a clutch's chamber from which the powder is sheared in the rim gap."""


@dataclass(frozen=True, slots=True)
class ShearedGap:
    """Gap in which the powder is sheared between two bodies.

    Attributes
    ----------
    radius : float
        Mean radius [m].
    width : float
        Distance [m] of the two bodies.
    narrowest : float
        Width [m] of the narrowest gap that is filled, in which layers of grains go past each other fastest.
    at_faces : bool
        It lies in the face gaps of a clutch, and not at its rim.
    """

    radius: float
    width: float
    narrowest: float
    at_faces: bool = False

    @classmethod
    def of_annulus(cls, inner: float, outer: float) -> ShearedGap:
        """Between two coaxial cylinders of these radii [m]."""
        return cls(0.5 * (inner + outer), outer - inner, outer - inner)


def thin_parts(boxes: Sequence[AnnularBox], limit: float) -> list[tuple[AnnularBox, bool]]:
    """Parts of the powder's space that are thinner than `limit` [m], and whether their thickness is along r."""
    sizes = [(box, box.r1 - box.r0, box.z1 - box.z0) for box in boxes]
    return [(box, along_r < along_z) for box, along_r, along_z in sizes if min(along_r, along_z) < limit]
