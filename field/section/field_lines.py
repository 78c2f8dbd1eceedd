"""B and H along a line through the section, of the finite element solution itself.

H follows from B by the law of the element that a point lies in, so it jumps across faces of iron as it must;
a point on a face takes the side of the element that is found first.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from field.sampling.locate import PointOutside

if TYPE_CHECKING:
    from field.section.magnetic_field import MagneticField


@dataclass(frozen=True, slots=True)
class FieldAlongLine:
    """The field at points of a polyline.

    Attributes
    ----------
    points : ndarray (k, 2)
        (r, z) [m].
    distance : ndarray (k,)
        Arc length from the first point [m].
    B : ndarray (k, 2)
        B_r, B_z [T].
    H : ndarray (k, 2)
        H_r, H_z [A/m].
    psi : ndarray (k,)
        r A_phi [Wb/rad].
    region : ndarray (k,) of str
    """

    points: np.ndarray
    distance: np.ndarray
    B: np.ndarray
    H: np.ndarray
    psi: np.ndarray
    region: np.ndarray

    @property
    def flux(self) -> float:
        """Flux [Wb] through the surface that the line sweeps in a full turn: 2 pi times the change of psi.

        Positive where B points to the left of the line's direction with r to the right and z upwards
        (a line outwards along r: where B points to +z).
        """
        return float(2.0 * math.pi * (self.psi[-1] - self.psi[0]))

    @property
    def magnetic_voltage(self) -> float:
        """Integral of H along the line [A], by the trapezoidal rule; around a coil it is N I."""
        step = np.diff(self.points, axis=0)
        return float((0.5 * (self.H[1:] + self.H[:-1]) * step).sum())


def field_along(solution: MagneticField, points: np.ndarray) -> FieldAlongLine:
    """The field at the points (r, z) [m] of a polyline, shape (k, 2), k >= 2.

    Raises
    ------
    ValueError
        Fewer than two points, or not (k, 2).
    PointOutside
        A point outside the mesh.
    """
    points = np.ascontiguousarray(np.asarray(points, dtype=float))
    if points.ndim != 2 or points.shape[1] != 2 or len(points) < 2:
        raise ValueError(f"a line needs at least two points (r, z), shape (k, 2); got an array of shape {points.shape}")
    problem = solution.problem
    element = problem.find(points)
    if np.any(element < 0):
        raise PointOutside(points[element < 0], "the mesh")
    B = solution.flux_density(points)
    size = np.hypot(B[:, 0], B[:, 1])
    region = problem.mesh.region_of_element()[element]
    nu = np.empty(len(points))
    fill_of_element = np.zeros(len(problem.mesh.triangles))
    if solution.fill is not None:
        fill_of_element[problem.powder_elements] = solution.fill
    for name in np.unique(region):
        here = region == name
        nu[here] = _reluctivity(problem.law_of(str(name)), size[here], fill_of_element[element[here]])
    distance = np.concatenate(([0.0], np.cumsum(np.linalg.norm(np.diff(points, axis=0), axis=1))))
    H = nu[:, None] * B
    if (added := solution.history_field_strength()) is not None:
        H += added[element]
    return FieldAlongLine(points, distance, B, H, problem.elements.value_at(solution.psi, element, points), region)


def straight_line(start: Sequence[float], end: Sequence[float], count: int = 201) -> np.ndarray:
    """Points (count, 2) evenly between two points (r, z) [m]."""
    return np.linspace(np.asarray(start, dtype=float), np.asarray(end, dtype=float), count)


def _reluctivity(law, B: np.ndarray, fill: np.ndarray) -> np.ndarray:
    from field.laws.powder_law import PowderLaw

    H, slope = law.H_of_B(B, fill) if isinstance(law, PowderLaw) else law.H_of_B(B)
    here = B > 0.0
    return np.where(here, H / np.where(here, B, 1.0), slope)
