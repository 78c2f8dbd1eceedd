"""The gap of a device in which its powder is sheared: each shape says which one that is, see its ``sheared_gap``."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


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
    half_thickness : float
        Where it lies there: distance [m] of the disc's faces from its middle plane.
    """

    radius: float
    width: float
    narrowest: float
    at_faces: bool = False
    half_thickness: float = 0.0

    def speed(self, position: np.ndarray, disc: float, rotor: float) -> tuple[np.ndarray, np.ndarray]:
        """Rotation of a steady shear between the disc, at the inner side, and the rotor.

        Parameters
        ----------
        position : ndarray, shape (n, 3)
            Points [m].
        disc, rotor : float
            Speeds about z [rad/s].

        Returns
        -------
        omega : ndarray, shape (n,)
            Linear across the gap; outside it that of the nearer side [rad/s].
        curl : ndarray, shape (n, 3)
            Of the velocity omega r along the azimuth [1/s].
        """
        x, y, z = position.T
        r = np.hypot(x, y)
        depth = np.abs(z) - self.half_thickness if self.at_faces else r - self.radius + 0.5 * self.width
        fraction = np.clip(depth / self.width, 0.0, 1.0)
        omega = disc + fraction * (rotor - disc)
        slope = np.where((fraction > 0.0) & (fraction < 1.0), (rotor - disc) / self.width, 0.0)
        if self.at_faces:
            slope = np.copysign(slope, z * slope)
            return omega, np.column_stack([-slope * x, -slope * y, 2.0 * omega])
        return omega, np.column_stack([np.zeros_like(z), np.zeros_like(z), 2.0 * omega + r * slope])

    @classmethod
    def of_annulus(cls, inner: float, outer: float) -> ShearedGap:
        """Between two coaxial cylinders of these radii [m]."""
        return cls(0.5 * (inner + outer), outer - inner, outer - inner)
