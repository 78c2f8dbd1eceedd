"""The powder between pole faces, where nearly all of its torque is made: shear stress, H and fill.

With these three every run is a point on the law tau(H, phi) of its powder, and can be compared with that of another
device, of a sheared cell (`emclutch shear-cell`) or of a rheometer.
"""

from __future__ import annotations

from dataclasses import dataclass
from math import pi
from typing import Self

import numpy as np

from field import FieldSampler
from geometry import AnnularBox

ACROSS, ALONG, AROUND = 5, 41, 16
"""Points at which H is averaged, across the gap, along each face, and in 3D over a period around the axis."""


@dataclass(frozen=True, slots=True)
class Zone:
    """Part of the gap.

    Attributes
    ----------
    boxes : tuple of AnnularBox
        Disjoint.
    """

    boxes: tuple[AnnularBox, ...]

    @property
    def volume(self) -> float:
        """Of a full turn [m^3]."""
        return sum(box.volume() for box in self.boxes)

    def grain_volume(self, position: np.ndarray, volume: np.ndarray) -> float:
        """Sum of the volumes (n,) [m^3] of grains whose centres, at (n, 3) [m], lie in the zone."""
        return volume[self.holds(position)].sum()

    def holds(self, position: np.ndarray) -> np.ndarray:
        """Return which of some points (n, 3) [m] lie in the zone, (n,) bool."""
        r, z = np.hypot(position[:, 0], position[:, 1]), position[:, 2]
        inside = np.zeros(len(r), dtype=bool)
        for box in self.boxes:
            inside |= (r > box.r0) & (r < box.r1) & (z > box.z0) & (z < box.z1)
        return inside

    def field_strength(self, sampler: FieldSampler, angles: np.ndarray = np.zeros(1)) -> float:
        """Mean |H| [A/m] of the macroscopic field in the zone, by volume and over angles (k,) [rad] about the axis."""
        cos, sin = np.cos(angles), np.sin(angles)
        points, weights = [], []
        for box in self.boxes:
            # half an element off the walls: the field is sampled inside the powder's region
            along_r = box.r1 - box.r0 > box.z1 - box.z0
            n_r, n_z = (ALONG, ACROSS) if along_r else (ACROSS, ALONG)
            r = box.r0 + (np.arange(n_r) + 0.5) / n_r * (box.r1 - box.r0)
            z = box.z0 + (np.arange(n_z) + 0.5) / n_z * (box.z1 - box.z0)
            r, z = (np.repeat(v.ravel(), len(cos)) for v in np.meshgrid(r, z))
            points.append(np.column_stack((r * np.resize(cos, len(r)), r * np.resize(sin, len(r)), z)))
            weights.append(r)
        H, _ = sampler.sample(np.concatenate(points))
        return float(np.average(np.sqrt((H**2).sum(axis=1)), weights=np.concatenate(weights)))


@dataclass(frozen=True, slots=True)
class GapZone(Zone):
    """The gap that is sheared as a whole.

    Attributes
    ----------
    torque_per_stress : float
        Area in the middle of the gap times its mean radius [m^3].
    """

    torque_per_stress: float

    @classmethod
    def between_cylinders(cls, box: AnnularBox, radius: float) -> Self:
        """Of a ring with its middle at a radius [m]."""
        return cls((box,), 2 * pi * radius**2 * (box.z1 - box.z0))


@dataclass(frozen=True, slots=True)
class PoleZone(Zone):
    """Part of the gap between steel pole faces.

    Attributes
    ----------
    boxes : tuple of AnnularBox
        One for each pole face.
    area : float
        Of the faces, in the middle of the gap [m^2].
    radius : float
        Mean lever of a stress there [m].
    """

    area: float
    radius: float

    def shear_stress(self, torque: float) -> float:
        """Torque [N m] over area and lever [Pa], all of it counted as that of the pole faces: an upper bound.

        Powder outside of the faces, on the rest of the rim and in the other gaps, has some of it, which a run with
        `output.profiles` measures.
        """
        return torque / (self.area * self.radius)

    def fill(self, position: np.ndarray, volume: np.ndarray) -> float:
        """Solid fraction [-] of the zone in a full turn, from all grains at (n, 3) [m] with volumes (n,) [m^3]."""
        return float(self.grain_volume(position, volume) / self.volume)
