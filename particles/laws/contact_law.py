"""Interface of a contact law: a row of the compiled table, and the scales of time step and stiffness.

``kernel`` names the compiled spring (`particles.laws.springs`), which all contacts of a scene share:

    spring(rows, kind, delta, m_eff, r_eff, memory) -> (f_elastic, k_t, gamma_n, gamma_t, energy, memory)

with the law's parameters ``rows`` (rows, N_LAW) and the row ``kind`` of this pair of materials,
the overlap delta [m] > 0, 1/m_eff = 1/m_i + 1/m_j (m_eff = m_i at a wall) [kg], r_eff = R_i R_j/(R_i + R_j) (R_i at a
wall) [m]. f_elastic [N] >= 0 repels, k_t [N/m] is the tangential stiffness at this overlap, gamma_n and gamma_t [kg/s]
are the dashpots (force = gamma times closing or sliding speed), energy [J] is what the normal spring gives back, and
memory a number that is 0 when the contact begins and comes back in its next step. The contact clips max(0, f_elastic +
gamma_n v_closing): it never pulls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol, runtime_checkable

import numpy as np

from particles.laws.columns import DAMPING_ROLLING, MU, N_LAW


@runtime_checkable
class ContactLaw(Protocol):
    """Parameters of a contact between two materials."""

    @property
    def kernel(self) -> str:
        """A key of `SPRINGS`: the compiled spring."""

    @property
    def friction(self) -> float:
        """Coulomb coefficient mu [-]."""

    def row(self) -> np.ndarray:
        """The law's columns and the friction, shape (N_LAW,)."""

    def contact_time(self, m_eff: float, r_eff: float, speed: float) -> float:
        """Duration [s] of an undamped head-on impact at ``speed`` [m/s], exact; infinite where it has no end."""

    def stiffness_at(self, delta: float, r_eff: float) -> float:
        """Largest normal stiffness dF/d(delta) [N/m] met at the overlap ``delta`` [m]."""

    def overlap_under(self, force: float, m_eff: float, speed: float, r_eff: float) -> float:
        """Depth [m] of a contact that rests under ``force`` [N] and is hit at ``speed`` [m/s], undamped."""


class LinearImpact:
    """Scales of a law whose normal spring loads with the constant ``stiffness_n`` [N/m]."""

    __slots__ = ()
    stiffness_n: float

    def contact_time(self, m_eff: float, r_eff: float, speed: float) -> float:
        """pi sqrt(m_eff/k_n) [s], whatever radius and speed."""
        return math.pi * math.sqrt(m_eff / self.stiffness_n)

    def stiffness_at(self, delta: float, r_eff: float) -> float:
        """k_n [N/m] at every overlap."""
        return self.stiffness_n

    def overlap_under(self, force: float, m_eff: float, speed: float, r_eff: float) -> float:
        """F/k + v sqrt(m/k) [m]: rest under ``force`` [N], then an undamped impact at ``speed`` [m/s]."""
        return force / self.stiffness_n + speed * math.sqrt(m_eff / self.stiffness_n)


@dataclass(frozen=True, slots=True)
class ResistanceCoefficient:
    """A coefficient [-] of rolling or twisting between grains, and at walls (as between grains unless given)."""

    name: ClassVar[str]
    usual: ClassVar[str]
    coefficient: float
    wall_coefficient: float | None = None

    def __post_init__(self) -> None:
        for key in ("coefficient", "wall_coefficient"):
            value = getattr(self, key)
            if value is not None and not 0.0 <= value < math.inf:
                raise ValueError(f"{key} of {self.name} = {value:g}; allowed: 0 or more ({self.usual} is usual)")

    def table(self) -> np.ndarray:
        """Coefficients between grains and at walls, shape (2,)."""
        wall = self.coefficient if self.wall_coefficient is None else self.wall_coefficient
        return np.array([self.coefficient, wall])


def law_row(columns: list[float], friction: float, damping_rolling: float) -> np.ndarray:
    """A row of the table, shape (N_LAW,): the law's own columns first; no rolling, twisting and cohesion."""
    row = np.zeros(N_LAW)
    row[: len(columns)] = columns
    row[MU], row[DAMPING_ROLLING] = friction, damping_rolling
    return row


def check_parameters(law: object, positive: dict[str, str], not_negative: dict[str, str]) -> None:
    """Check attributes of a law by name -> unit; a value of None is not given and is right.

    Raises
    ------
    ValueError
        For a value that is not finite, negative, or 0 among ``positive``.
    """
    for names, allowed in ((positive, "more than 0"), (not_negative, "0 or more")):
        for name, unit in names.items():
            value = getattr(law, name)
            if value is None:
                continue
            if not (0.0 <= value < math.inf) or (value == 0.0 and names is positive):
                raise ValueError(f"{name} = {value:g}{f' {unit}' if unit else ''}; allowed: {allowed}")
