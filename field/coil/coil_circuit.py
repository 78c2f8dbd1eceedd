"""A coil at a voltage: V(t) = R i + d lambda/dt, with the flux linkage of the nonlinear field.

The linkage lambda is what time integrates; it cannot jump, while the current follows from it and from the
powder's fill, i = i(lambda, fill).  The field is therefore solved for a *prescribed linkage*, with the current
as a further unknown, by the same convex energy with one constraint,

    min W(psi)   with   2 pi N c . psi = lambda,           N I is the constraint's multiplier,

and between solves i(lambda) is a straight line with the slope 1/L_d of the last one: its error is of second
order in the change of the current that calls for the next solve.  In time that line is integrated exactly
(a linear R-L circuit under a piecewise linear voltage), so there is no limit to the step.

Energy: the supply gives V i, the copper takes R i^2, and i d lambda goes into the field, where it is stored or
does work on what moves.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from field.coil.bordered_solver import RankOneSolver
from field.coil.inductance import incremental_inductance
from field.newton import minimise, norm, scalar_product

if TYPE_CHECKING:
    from field.section.axisymmetric import AxisymmetricProblem
    from field.section.magnetic_field import MagneticField
    from field.section.powder_state import Powder
    from field.section.section_energy import SectionEnergy
    from field.three_d import Field3D, Problem3D

# Gauss-Legendre points for the energies of a step; steps are at most half a time constant, where this is exact
# to round-off, or the current is a straight line, of whose squares this is the integral.
_NODES, _WEIGHTS = (0.5 * (x + shift) for x, shift in zip(np.polynomial.legendre.leggauss(6), (1.0, 0.0), strict=True))
_DECAYED = 40.0
"""Time constants after which exp(-t/tau) = 4e-18 is less than the round-off of 1."""

_LARGEST_RATIO = 10.0
"""Of a flux linkage to that of a guess; beyond it the scaled current of the guess may be wrong by any factor."""


def solve_at_flux_linkage(
    problem: AxisymmetricProblem | Problem3D,
    linkage_per_turn: float,
    fill: Powder = None,
    guess: MagneticField | Field3D | None = None,
    *,
    tolerance: float = 1e-8,
    max_iterations: int = 40,
) -> MagneticField | Field3D:
    """The field whose coil links a given flux; its `ampere_turns` are solved with it.

    Parameters
    ----------
    linkage_per_turn : float
        lambda/N [Wb].
    fill, guess, tolerance, max_iterations
        See `AxisymmetricProblem.solve`. In 3D the current is determined by fields of given currents.

    Raises
    ------
    ValueError
        No coil, or a linkage that is not finite.
    ConvergenceError
    """
    from field.section.magnetic_field import MagneticField
    from field.section.section_energy import SectionEnergy
    from field.three_d import Problem3D

    if isinstance(problem, Problem3D):
        assert not isinstance(guess, MagneticField)
        return problem.solve_at_flux_linkage(linkage_per_turn, fill, guess, tolerance=tolerance)
    assert guess is None or isinstance(guess, MagneticField)
    if problem.coil_area == 0.0 or not math.isfinite(linkage_per_turn):
        raise ValueError(
            f"a flux linkage of {linkage_per_turn} Wb a turn needs a coil and a finite number; "
            f"the mesh has {', '.join(sorted(problem.mesh.regions))}"
        )
    powder = problem.check_powder(fill)
    if linkage_per_turn == 0.0 and (powder is None or powder.source is None):
        return problem.solve(0.0, powder)
    nothing = np.zeros(problem.n_dofs)
    energy = _LinkageEnergy(SectionEnergy(problem, powder, nothing, nothing), problem.coil_load[problem._free])
    c, mean_psi = energy.load, linkage_per_turn / (2.0 * math.pi)
    if guess is not None and 0.0 < abs(linkage_per_turn) <= _LARGEST_RATIO * abs(guess.flux_linkage_per_turn):
        ratio = linkage_per_turn / guess.flux_linkage_per_turn
        x, drive = ratio * guess.psi[problem._free], ratio * guess.ampere_turns
    else:
        # as in a cold start of `solve`: every material with its chord at a typical flux density
        per_ampere_turn = problem._solver.solve(energy.inner.chord_matrix(), c)
        drive = mean_psi / scalar_product(c, per_ampere_turn)
        x = drive * per_ampere_turn
    x, history = minimise(
        energy,
        x,
        max(abs(drive) * norm(c), norm(energy.inner.source[problem._free])),  # of the coil, of magnetised powder
        solver=RankOneSolver(problem._solver, c, math.inf),
        tolerance=tolerance,
        max_iterations=max_iterations,
    )
    return MagneticField(problem, energy.inner.expand(x), energy.multiplier(x), powder, history)


class _LinkageEnergy:
    """W(psi) on psi of one flux linkage: the gradient without its part along the coil's load."""

    def __init__(self, inner: SectionEnergy, load: np.ndarray) -> None:
        self.inner = inner
        self.load = load
        self._size = scalar_product(load, load)

    def value(self, x: np.ndarray) -> tuple[float, float]:
        return self.inner.value(x)

    def gradient(self, x: np.ndarray) -> np.ndarray:
        g = self.inner.gradient(x)
        return g - self.load * (scalar_product(self.load, g) / self._size)

    def hessian(self, x: np.ndarray) -> sp.csc_matrix:
        return self.inner.hessian(x)

    def chord_hessian(self, x: np.ndarray) -> sp.csc_matrix:
        return self.inner.chord_hessian(x)

    def multiplier(self, x: np.ndarray) -> float:
        """N I [A]: dW/dx = N I c at the solution."""
        return scalar_product(self.load, self.inner.gradient(x)) / self._size


@dataclass(frozen=True, slots=True)
class CircuitState:
    """State of the circuit, and the energies since its start.

    Attributes
    ----------
    time : float
        [s]
    linkage : float
        lambda [Wb].
    current : float
        i [A].
    supplied, copper_loss : float
        Integrals of V i and R i^2 [J]; their difference has gone into the field.
    """

    time: float
    linkage: float
    current: float
    supplied: float = 0.0
    copper_loss: float = 0.0

    @property
    def into_field(self) -> float:
        """Integral of i d lambda [J]."""
        return self.supplied - self.copper_loss


@dataclass(frozen=True, slots=True)
class LinearisedCoil:
    """i = i_0 + (lambda - lambda_0)/L_d about a solved field.

    Parameters
    ----------
    linkage, current : float
        lambda_0 [Wb], i_0 [A].
    inductance : float
        L_d [H], > 0.
    resistance : float
        R [ohm], > 0.
    """

    linkage: float
    current: float
    inductance: float
    resistance: float

    @classmethod
    def about(cls, solution: MagneticField | Field3D, turns: float, resistance: float) -> LinearisedCoil:
        """About a solved field."""
        return cls(
            turns * solution.flux_linkage_per_turn,
            solution.ampere_turns / turns,
            incremental_inductance(solution, turns),
            resistance,
        )

    def current_at(self, linkage: float) -> float:
        """i [A] at lambda [Wb]."""
        return self.current + (linkage - self.linkage) / self.inductance

    def advance(
        self, state: CircuitState, time: float, voltage: Callable[[float], float], breaks: Iterable[float] = ()
    ) -> CircuitState:
        """The circuit at a later time [s].

        Parameters
        ----------
        voltage : callable t [s] -> V [V]
            Linear between `breaks`, where it may jump too (it is evaluated just before and just after).
        breaks : iterable of float
            Instants [s] at which the voltage is not smooth.
        """
        stops = [state.time, *sorted(b for b in breaks if state.time < b < time), time]
        for begin, end in pairwise(stops):
            time_constants = (end - begin) * self.resistance / self.inductance
            parts = max(1, math.ceil(2.0 * min(time_constants, _DECAYED)))
            divided = _DECAYED / max(time_constants, _DECAYED)  # of the stretch; the rest of a long one is one part
            shares = [divided * k / parts for k in range(parts + 1)] + [1.0] * (divided < 1.0)
            eps = 1e-9 * (end - begin)
            first, last = voltage(begin + eps), voltage(end - eps)
            for a, b in pairwise(shares):
                state = self._smooth_step(
                    state, begin + b * (end - begin), first + a * (last - first), first + b * (last - first)
                )
        return state

    def _smooth_step(self, state: CircuitState, time: float, first: float, last: float) -> CircuitState:
        """Exact for V linear from `first` to `last`: i = p + q t + s exp(-t/tau)."""
        R, L, dt = self.resistance, self.inductance, time - state.time
        if dt <= 0.0:
            return state
        tau, slope, start = L / R, (last - first) / dt, self.current_at(state.linkage)
        q = slope / R
        p = (first - L * q) / R
        s = start - p

        def i_at(t):
            # p + s exp(-t/tau) as start + s (exp - 1): nothing cancels for a short step
            return start + q * t + s * np.expm1(-t / tau)

        t = dt * _NODES
        i, V = i_at(t), first + slope * t
        supplied = float((V * i * _WEIGHTS).sum()) * dt
        copper = float((R * i * i * _WEIGHTS).sum()) * dt
        current = float(i_at(dt))
        linkage = state.linkage + L * (current - start)
        return CircuitState(time, linkage, current, state.supplied + supplied, state.copper_loss + copper)
