"""Hysteresis of the steel in a section: history on the quadrature points, added to the field's energy.

The vectors of `field.laws.pinning` are here (dpsi/dr, dpsi/dz)/r = (B_z, -B_r), B turned by a right angle: the law is
isotropic, and turned alike H stands in the weak form as it is, integral of H . grad v dr dz. A history is a constant;
a solve begins with one, and its field tells the next (`MagneticField.later_history`): only what converged counts.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from field.laws.pinning import Pinning

if TYPE_CHECKING:
    from field.section.axisymmetric import AxisymmetricProblem
    from field.section.section_elements import SectionElements


@dataclass(frozen=True, slots=True, eq=False)
class PinnedRegion:
    """Elements of one steel.

    Attributes
    ----------
    pinning : Pinning
    elements : ndarray (m,)
    position : ndarray (m, n_quadrature, 2, n cells)
        Of the cells [T].
    """

    pinning: Pinning
    elements: np.ndarray
    position: np.ndarray


@dataclass(frozen=True, slots=True, eq=False)
class HistoryStep:
    """What history adds to the weak form.

    Attributes
    ----------
    flow : ndarray (n_elements, 2, n_quadrature)
        To H, turned [A/m].
    tangents : list of (elements (m,), (m, n_quadrature, 3))
        To dH/dB of a steel: xx, xy, yy [m/H].
    work : float
        To the energy functional, per radian [J/rad].
    """

    flow: np.ndarray
    tangents: list[tuple[np.ndarray, np.ndarray]]
    work: float


@dataclass(frozen=True, slots=True, eq=False)
class SteelHistory:
    """What the steel of a section remembers."""

    regions: tuple[PinnedRegion, ...]

    @classmethod
    def demagnetised(cls, problem: AxisymmetricProblem, steels: Mapping[str, float | Pinning]) -> SteelHistory | None:
        """The history of steel that has none yet.

        Parameters
        ----------
        problem : AxisymmetricProblem
        steels : mapping of str to float or Pinning
            By region, the coercivity [A/m] or the cells; a region without one, or of 0 A/m, has no hysteresis.

        Returns
        -------
        SteelHistory or None
            None where no region has hysteresis.

        Raises
        ------
        ValueError
            A region that the mesh does not have, or a coercivity that its curve does not allow (`Pinning.of`).
        """
        unknown = sorted(set(steels) - set(problem.mesh.regions))
        if unknown:
            raise ValueError(
                f"hysteresis for {', '.join(unknown)}, but the mesh has no such region; "
                f"it has {', '.join(sorted(problem.mesh.regions))}"
            )
        regions = []
        for name, given in steels.items():
            pinning = given if isinstance(given, Pinning) else Pinning.of(problem.laws[name], given)
            if pinning.reach.size:
                elements = problem.mesh.regions[name]
                position = pinning.demagnetised(elements.size, problem.elements.n_quadrature)
                regions.append(PinnedRegion(pinning, elements, position))
        return cls(tuple(regions)) if regions else None

    def at(self, positions: Sequence[np.ndarray]) -> SteelHistory:
        """The same steels with the cells at other positions, `PinnedRegion.position` of each region."""
        pairs = zip(self.regions, positions, strict=True)
        return SteelHistory(tuple(PinnedRegion(one.pinning, one.elements, np.asarray(at)) for one, at in pairs))

    def later(self, elements: SectionElements, gradient: np.ndarray) -> SteelHistory:
        """The history after a step to grad psi (n_elements, 2, n_quadrature)."""
        return SteelHistory(
            tuple(
                PinnedRegion(
                    one.pinning, one.elements, one.pinning.advanced(_turned(one, elements, gradient), one.position)
                )
                for one in self.regions
            )
        )

    def step(self, elements: SectionElements, gradient: np.ndarray) -> HistoryStep:
        """What it adds to the weak form in a step to grad psi (n_elements, 2, n_quadrature)."""
        flow, tangents, work = np.zeros_like(gradient), [], 0.0
        for one in self.regions:
            H, tangent, w = one.pinning.step(_turned(one, elements, gradient), one.position)
            flow[one.elements] = np.moveaxis(H, 2, 1)
            tangents.append((one.elements, tangent))
            work += _integral(one, elements, w)
        return HistoryStep(flow, tangents, work)

    def stored(self, elements: SectionElements, gradient: np.ndarray) -> float:
        """What it adds to the energy stored beside that of the magnetisation curves, per radian [J/rad]."""
        return sum(
            _integral(one, elements, one.pinning.stored(_turned(one, elements, gradient), one.position))
            for one in self.regions
        )

    def loss(self, elements: SectionElements, later: SteelHistory) -> float:
        """Heat between this history and a later one, per radian [J/rad]."""
        return sum(
            _integral(one, elements, one.pinning.loss(one.position, then.position))
            for one, then in zip(self.regions, later.regions, strict=True)
        )


def _turned(one: PinnedRegion, elements: SectionElements, gradient: np.ndarray) -> np.ndarray:
    """(B_z, -B_r) at a steel's quadrature points, (m, n_quadrature, 2) [T]."""
    return np.moveaxis(gradient[one.elements], 1, 2) / elements.radius[one.elements][:, :, None]


def _integral(one: PinnedRegion, elements: SectionElements, density: np.ndarray) -> float:
    return float((density * elements.radius[one.elements] * elements.weight[one.elements]).sum())
