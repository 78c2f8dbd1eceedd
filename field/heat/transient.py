"""Temperatures in time: implicit Euler with extrapolation, its step chosen by the difference of two.

A step of h from T_0 is made once (T_a) and as two of h/2 (T_b). The error of T_b is T_b - T_a to first order; the
result 2 T_b - T_a is of second order (extrapolation of L. F. Richardson; E. Hairer and G. Wanner, Solving Ordinary
Differential Equations II, 1996, IV.9). The largest |T_b - T_a| is kept below a tolerance [K], which bounds the error of
a step. Both steps are solved to round-off, so that in each the heat that is stored is what the sources make less what
leaves; the sums of both are extrapolated as the temperatures are, and the balance of energy closes whatever the step.
A source of a step is its mean over the step by two points of Gauss, exact for powers that are cubic in time: an error
of the heat that a period makes would add up over all periods, and the tolerance of the temperature does not bound it.

Time is cut into *stretches* between the instants at which a source is switched. A step is a stretch over a power of
two, so that the steps of a repeated duty are the same in each period and few matrices are factorised. Each step's
equations are nonlinear in the surface's radiation and the sources' powers; they are solved by Newton's method with the
matrix of one reference temperature, which changes them by per cents only.

**Ripple.** In a duty that repeats every P, T is the temperature under the mean power plus a periodic ripple of mean 0
(exactly so where the equations are linear). One period from T_0 with the mean <T> is followed by one from

    T_0' = T(P) + T_m - <T>

about the given mean T_m. A mode of time constant tau that is off by d is then off by d (e^-x - (1 - e^-x)/x), x =
P/tau: by less than 0.30 d at any x, so that a few periods find the ripple, however much longer than them the device
takes to warm.
"""

from __future__ import annotations

from collections import OrderedDict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from field.heat.conduction import MOLTEN, Factorised, HeatNotConverged, HeatProblem, ThermalRunaway

PowersInTime = Callable[[float, np.ndarray], tuple[np.ndarray, np.ndarray]]
"""Time [s] and means of the sources (m,) [degrees C] to powers (m,) [W] and their derivatives (m,) [W/K]."""

_KEPT = 32
"""Factorised matrices that are kept, each for a step's length."""
_ITERATIONS = 40
_CLOSE = 1e-9
"""Change of the temperatures [K] at which a step's iteration ends."""
_PERIODS = 30
"""Periods within which a ripple converges: 0.30^n."""
RIPPLE_ERROR = 0.01
"""Of a step and of the iteration, over the largest ripple; and its floor [K]."""
_MIN_RIPPLE = 1e-4
FINEST = 24
"""Halvings of a stretch beyond which a step counts as failed."""
_GAUSS = 0.5 * (1.0 + np.array([-1.0, 1.0]) / np.sqrt(3.0))
"""Two points of Gauss, of equal weights, over the length of a step."""


@dataclass(frozen=True, slots=True)
class HeatState:
    """Temperatures at a time, and the sums of heat until then.

    Attributes
    ----------
    time : float
        [s]
    temperature : ndarray (n_dofs,)
        [degrees C]
    made : ndarray (m,)
        Heat of each source [J].
    left : float
        Heat that left through the surfaces [J].
    """

    time: float
    temperature: np.ndarray
    made: np.ndarray
    left: float


@dataclass(frozen=True, slots=True)
class Ripple:
    """Temperatures through a period less their mean over it.

    Attributes
    ----------
    times : ndarray (k,)
        From 0 to the period [s].
    weights : ndarray (k,)
        Of the mean over the period by the trapezoidal rule.
    departures : ndarray (k, n_dofs)
        [K]
    """

    times: np.ndarray
    weights: np.ndarray
    departures: np.ndarray


@dataclass
class HeatInTime:
    """Marches a problem through stretches of time.

    Parameters
    ----------
    problem : HeatProblem
    powers : PowersInTime
        Of the sources; smooth within a stretch.
    tolerance : float
        Of a step's error [K], > 0.
    reference : ndarray (n_dofs,) or None
        Temperatures [degrees C] of the matrices; None: those at the start of each stretch's first step.
    """

    problem: HeatProblem
    powers: PowersInTime
    tolerance: float = 0.1
    reference: np.ndarray | None = None
    steps: int = field(default=0, init=False)
    _factors: OrderedDict[float, Factorised] = field(default_factory=OrderedDict, init=False)

    def __post_init__(self) -> None:
        if not self.tolerance > 0.0:
            raise ValueError(f"`tolerance` = {self.tolerance:g} K of a step must be above 0")

    def start(self, temperature: np.ndarray | float, time: float = 0.0) -> HeatState:
        """The state at `time` [s] with temperatures (n_dofs,) or a uniform one [degrees C]."""
        problem = self.problem
        start = np.broadcast_to(np.asarray(temperature, float), (problem.n_dofs,)).copy()
        return HeatState(time, start, np.zeros(len(problem.names)), 0.0)

    def run(self, state: HeatState, ends: Sequence[float]) -> Iterator[HeatState]:
        """Yield the states at the end of each step until the last of increasing instants `ends` [s].

        Raises
        ------
        ThermalRunaway
            However short the step, the sources' power grows faster than the heat is stored.
        HeatNotConverged
            The equations of a step are not solved.
        """
        level = 4  # a first guess, in the first stretch
        for end in ends:
            begin, length = state.time, end - state.time
            if length <= 0.0:
                continue
            done, of = 0, 2**FINEST
            while done < of:
                level = max(level, 0)
                size = of >> level
                while done % size or done + size > of:
                    size >>= 1
                    level += 1
                h = length * (size / of)
                try:
                    new, error = self._step(state, h)
                except (ThermalRunaway, HeatNotConverged):
                    if level >= FINEST - 1:
                        raise
                    level += 1
                    continue
                if error > self.tolerance and level < FINEST - 1:
                    level += 1
                    continue
                done += size
                state = HeatState(begin + length * (done / of), new.temperature, new.made, new.left)
                self.steps += 1
                yield state
                if error < 0.25 * self.tolerance:
                    level -= 1

    def ripple(self, mean: np.ndarray, ends: Sequence[float]) -> Ripple:
        """The ripple about mean temperatures (n_dofs,) [degrees C] of powers that repeat after the last of `ends` [s].

        `ends` are those of the stretches of one period from 0 on. The tolerance falls to `RIPPLE_ERROR` of the ripple.

        Raises
        ------
        ThermalRunaway, HeatNotConverged
            As `run`; or the periods do not approach one that repeats.
        """
        start = mean
        for _ in range(_PERIODS):
            first = self.start(start)
            states = [first, *self.run(first, ends)]
            times, values = (np.array([getattr(one, key) for one in states]) for key in ("time", "temperature"))
            between = np.diff(times)
            weights = 0.5 * (np.append(between, 0.0) + np.append(0.0, between)) / times[-1]
            average = weights @ values
            change = values[-1] - start + mean - average
            small = RIPPLE_ERROR * max(float(np.ptp(values, axis=0).max()), _MIN_RIPPLE)
            if self.tolerance <= 1.5 * small and np.abs(change).max() <= small:
                return Ripple(times, weights, values - average)
            self.tolerance = min(self.tolerance, small)
            start = start + change
        raise HeatNotConverged(f"the ripple of a period of {ends[-1]:.6g} s did not converge within {_PERIODS} periods")

    def _step(self, state: HeatState, h: float) -> tuple[HeatState, float]:
        """The state after h [s] within a stretch, and the error's estimate [K]."""
        full = self._euler(state, h)
        halves = self._euler(self._euler(state, 0.5 * h), 0.5 * h)
        error = float(np.abs(halves.temperature - full.temperature).max())
        return (
            HeatState(
                state.time + h,
                2.0 * halves.temperature - full.temperature,
                2.0 * halves.made - full.made,
                2.0 * halves.left - full.left,
            ),
            error,
        )

    def _mean_powers(self, times: np.ndarray, means: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        (first, first_slope), (second, second_slope) = (self.powers(time, means) for time in times.tolist())
        return 0.5 * (first + second), 0.5 * (first_slope + second_slope)

    def _euler(self, state: HeatState, h: float) -> HeatState:
        problem, old = self.problem, state.temperature
        factors, times = self._factorised(h, old), state.time + h * _GAUSS
        temperature = old.copy()
        for _ in range(_ITERATIONS):
            power, slope = self._mean_powers(times, problem.means(temperature))
            residual = problem.M @ ((temperature - old) / h) + problem.K @ temperature + problem.loss(temperature)
            step = factors.solve(residual - problem.spread @ power, slope)
            temperature = temperature - step
            size = float(np.abs(step).max())
            if not np.isfinite(size) or np.abs(temperature).max() > MOLTEN:
                break
            if size <= _CLOSE:
                power, _ = self._mean_powers(times, problem.means(temperature))
                left = sum(problem.losses(temperature).values())
                return HeatState(state.time + h, temperature, state.made + h * power, state.left + h * left)
        raise HeatNotConverged(
            f"a step of {h:.3g} s at {state.time:.6g} s did not converge in {_ITERATIONS} iterations"
        )

    def _factorised(self, h: float, old: np.ndarray) -> Factorised:
        key = float(f"{h:.9g}")  # lengths that only round-off tells apart are one
        if key in self._factors:
            self._factors.move_to_end(key)
            return self._factors[key]
        if self.reference is None:
            self.reference = old.copy()
        made = self.problem.factorised(self.problem.tangent(self.reference, 1.0 / h))
        self._factors[key] = made
        if len(self._factors) > _KEPT:
            self._factors.popitem(last=False)
        return made
