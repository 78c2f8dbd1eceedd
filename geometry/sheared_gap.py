"""The gap of a device in which its powder is sheared: each shape says which one that is, see its ``sheared_gap``."""

from __future__ import annotations

from dataclasses import dataclass


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
