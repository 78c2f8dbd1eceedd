"""Source fields T0 with curl T0 = J for the reduced potential H = T0 - grad phi.

A flat coil (a prism z1 < z < z2 over a ring of constant width in the plane) has the plateau

    T0 = e_z T(x, y)  for z1 < z < z2, else 0;      T = J clip(d, 0, width),

d the distance inwards from its outer outline [m], J = N I/((z2 - z1) width) [A/m^2].  curl(e_z T) = J (d_y,
-d_x, 0) runs anticlockwise with |J| exact because |grad d| = 1.  T0 jumps at z1 and z2, where its tangential
part is zero on both sides: curl T0 holds no surface current, and T0 is curl-conforming.  The mesh must have
the planes z1 and z2 as element faces inside the outer outline, or the jump falls within elements.
In an iron core T0 is the gradient of a piecewise polynomial on such a mesh: phi takes it up to round-off.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np


class Source(Protocol):
    """A source of the field, for one ampere-turn (or one unit of whatever drives it)."""

    def T0(self, points: np.ndarray) -> np.ndarray:
        """Source field [A/m per ampere-turn] at points (n, 3) [m]; shape (n, 3)."""

    def current_density(self, points: np.ndarray) -> np.ndarray:
        """J = curl T0 [A/m^2 per ampere-turn] at points (n, 3) [m]; shape (n, 3)."""

    def potential_difference(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """Integral of T0 . dl [A per ampere-turn] between close points (n, 3) outside all current; shape (n,)."""


@dataclass(frozen=True, slots=True)
class FlatCoil:
    """A prismatic coil whose outer outline is a circle, a racetrack or a rounded rectangle.

    Parameters
    ----------
    half_length_x, half_length_y : float
        Half lengths of the outer outline [m].
    corner_radius : float
        Of the outer outline [m]; both half lengths for a circle, the smaller one for a racetrack.
    width : float
        Of the winding in the plane [m], at most the smaller half length.
    z_range : tuple of float
        [m]
    """

    half_length_x: float
    half_length_y: float
    corner_radius: float
    width: float
    z_range: tuple[float, float]

    def __post_init__(self) -> None:
        shorter = min(self.half_length_x, self.half_length_y)
        if not 0.0 <= self.corner_radius <= shorter * (1.0 + 1e-12):
            raise ValueError(
                f"`corner_radius` = {self.corner_radius} m of the coil must lie between 0 and the shorter half "
                f"length, {shorter} m"
            )
        if not 0.0 < self.width <= shorter * (1.0 + 1e-12):
            raise ValueError(
                f"`width` = {self.width} m of the coil must be above 0 and at most the shorter half length, {shorter} m"
            )
        if not self.z_range[0] < self.z_range[1]:
            raise ValueError(f"`z_range` = {self.z_range} m of the coil must grow")

    @classmethod
    def ring(cls, r_range: tuple[float, float], z_range: tuple[float, float]) -> FlatCoil:
        """A coil of rectangular section around the axis, r_range and z_range in m."""
        return cls(r_range[1], r_range[1], r_range[1], r_range[1] - r_range[0], z_range)

    @property
    def _height(self) -> float:
        return self.z_range[1] - self.z_range[0]

    def _distance(self, points: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Distance inwards from the outer outline [m], and its gradient in the plane (2, n)."""
        x, y = points[:, 0], points[:, 1]
        # signed distance of a rounded rectangle, with the centres of the corners' arcs as origin of (u, v)
        u = np.abs(x) - (self.half_length_x - self.corner_radius)
        v = np.abs(y) - (self.half_length_y - self.corner_radius)
        in_corner = (u > 0.0) & (v > 0.0)
        radius = np.hypot(u, v)
        outside = np.where(in_corner, radius, np.maximum(u, v))
        safe = np.where(radius > 0.0, radius, 1.0)
        slope_u = np.where(in_corner, u / safe, (u >= v).astype(float))
        slope_v = np.where(in_corner, v / safe, (u < v).astype(float))
        return self.corner_radius - outside, np.array([-slope_u * np.sign(x), -slope_v * np.sign(y)])

    def _plateau(self, points: np.ndarray) -> np.ndarray:
        """T [A/m] for one ampere-turn, whatever z; the full plateau is 1/height."""
        distance, _ = self._distance(points)
        return np.clip(distance / self.width, 0.0, 1.0) / self._height

    def T0(self, points: np.ndarray) -> np.ndarray:
        """See `Source.T0`."""
        T0 = np.zeros((len(points), 3))
        inside = (points[:, 2] > self.z_range[0]) & (points[:, 2] < self.z_range[1])
        T0[:, 2] = np.where(inside, self._plateau(points), 0.0)
        return T0

    def current_density(self, points: np.ndarray) -> np.ndarray:
        """See `Source.current_density`."""
        distance, slope = self._distance(points)
        inside = (points[:, 2] > self.z_range[0]) & (points[:, 2] < self.z_range[1])
        winding = inside & (distance > 0.0) & (distance < self.width)
        J = np.where(winding, 1.0 / (self._height * self.width), 0.0)
        return np.column_stack((J * slope[1], -J * slope[0], np.zeros(len(points))))

    def potential_difference(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """See `Source.potential_difference`.

        A path outside the winding collects only while its height is within the coil's, and there T is the same
        all along it (the full plateau in the bore, nothing outside); which, the end that lies there tells.
        """
        low, high = self.z_range
        first, last = np.clip(start[:, 2], low, high), np.clip(end[:, 2], low, high)
        beside = (start[:, 2] > low) & (start[:, 2] < high)
        return np.where(beside, self._plateau(start), self._plateau(end)) * (last - first)


@dataclass(frozen=True, slots=True)
class UniformSource:
    """A uniform applied field, T0 the same everywhere: what the device adds is then -grad phi.

    Parameters
    ----------
    direction : tuple of float
        T0 for one unit of drive; with a unit vector the drive is H0 [A/m].
    """

    direction: tuple[float, float, float] = (0.0, 0.0, 1.0)

    def T0(self, points: np.ndarray) -> np.ndarray:
        """See `Source.T0`."""
        return np.tile(np.asarray(self.direction, dtype=float), (len(points), 1))

    def current_density(self, points: np.ndarray) -> np.ndarray:
        """See `Source.current_density`."""
        return np.zeros((len(points), 3))

    def potential_difference(self, start: np.ndarray, end: np.ndarray) -> np.ndarray:
        """See `Source.potential_difference`."""
        return (end - start) @ np.asarray(self.direction, dtype=float)
