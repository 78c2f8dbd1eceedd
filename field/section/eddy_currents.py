"""Eddy currents in solid conductors about the axis, with a coil at a current or at a voltage.

    curl (nu curl A) + sigma dA/dt = J,      in psi = r A_phi for all v:

    integral (nu/r) grad psi . grad v + integral (sigma/r) dpsi/dt v = N i integral c v,
    V = R i + d lambda/dt,        lambda = 2 pi N integral c psi          (a coil at a voltage).

The conductors are rings: their current closes on itself, no net electric field drives it, and the shafts'
turning does not change an axisymmetric field.  Neglected: hysteresis, displacement current, eddy currents in
the winding and in the powder, insulation between parts of one conductor (each filament of a region closes on
its own in any case).

Without the current, i = (V - d lambda/dt)/R, both equations are one,

    K(psi) + M dpsi/dt = f(t),       M = integral (sigma/r) u v + (2 pi N^2/R) c c^T,       f = N (V/R or i) c,

with a symmetric mass M >= 0 that vanishes in air: a differential-algebraic system of index 1, stiff.  In time:

- `backward_euler`, order 1;
- `sdirk2` (Alexander 1977), order 2, gamma = 1 - 1/sqrt(2), L-stable and stiffly accurate, so that the
  algebraic part holds exactly at the end of each step and a step in the voltage does not ring.

Each stage is the minimum of the convex energy W(psi) + (psi - psi*) . M (psi - psi*)/(2 gamma dt) - f . psi, by
the same Newton iteration with line search as the static field.

Energy: what the source gives is copper loss + eddy loss + stored; the sums here use the method's own weights,
so that the balance closes to its order. A given current that jumps at the beginning of a step takes the field around
the conductors with it at once, while that in them stays: the source gives the mean of both currents times the change
of the linkage.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field, replace
from typing import TYPE_CHECKING, Literal

import numpy as np
import scipy.sparse as sp

from field.coil.bordered_solver import RankOneSolver
from field.newton import minimise, norm, scalar_product
from field.section.magnetic_field import MagneticField
from field.section.powder_state import Powder, PowderState

if TYPE_CHECKING:
    from field.section.axisymmetric import AxisymmetricProblem
    from field.section.section_energy import SectionEnergy

_GAMMA = 1.0 - math.sqrt(0.5)
# Of the forces of a step's memory: what round-off leaves of the residual.
_ROUND_OFF = 1e-14
# Of a given current: more than its change within a sliver.
_JUMP = 1e-3
SLIVER = 1e-6
"""Of an interval: instants of the drive that are nearer to each other or to its ends are one."""
Method = Literal["sdirk2", "backward_euler"]
# stage: (position of the stage in the step, its weight in integrals over the step)
_STAGES: dict[str, tuple[tuple[float, float], ...]] = {
    "backward_euler": ((1.0, 1.0),),
    "sdirk2": ((_GAMMA, 1.0 - _GAMMA), (1.0, _GAMMA)),
}


@dataclass(frozen=True, slots=True)
class CurrentDrive:
    """A coil whose current is prescribed, t [s] -> i [A]."""

    current: Callable[[float], float]


@dataclass(frozen=True, slots=True)
class VoltageDrive:
    """A coil at a voltage, t [s] -> V [V], behind its resistance [ohm]."""

    voltage: Callable[[float], float]
    resistance: float

    def __post_init__(self) -> None:
        if not (math.isfinite(self.resistance) and self.resistance > 0.0):
            raise ValueError(f"`resistance` = {self.resistance} ohm of the coil must be a finite number above 0")


Drive = CurrentDrive | VoltageDrive
DriveOfStep = Callable[["TransientState", float], Drive]
"""The drive of a step from its first state and its length [s]: of a winding that warms, whose resistance grows."""


@dataclass(frozen=True, slots=True)
class TransientState:
    """The field at one instant, and the energies since the start.

    Attributes
    ----------
    time : float
        [s]
    psi : ndarray (n_dofs,)
        [Wb/rad]
    current : float
        Of the coil [A].
    linkage : float
        Of the coil [Wb].
    eddy_loss, copper_loss, supplied : float
        Integrals since the start [J].  `supplied` is that of V i; of a coil at a prescribed current, whose
        resistance plays no part, that of i d lambda/dt, with no copper loss.
    error : float
        Local error of the last step relative to the state [-], in the energy norm of the mass.
    newton : list of (relative residual, step length)
        Of the step's last stage.
    """

    time: float
    psi: np.ndarray
    current: float
    linkage: float
    eddy_loss: float = 0.0
    copper_loss: float = 0.0
    supplied: float = 0.0
    error: float = 0.0
    newton: list[tuple[float, float]] = field(default_factory=lambda: [(0.0, 0.0)])


class EddyCurrentProblem:
    """A section whose solid parts conduct.

    Parameters
    ----------
    problem : AxisymmetricProblem
        Mesh, laws and coil.
    conductivity : dict of str to float
        sigma of regions [S/m], >= 0; regions that are not named do not conduct.
    turns : float
        N of the coil.

    Raises
    ------
    ValueError
        An unknown region, the coil's region (its wire carries the driven current), or a sigma that is
        negative or not finite.
    """

    def __init__(self, problem: AxisymmetricProblem, conductivity: Mapping[str, float], *, turns: float = 1.0) -> None:
        regions = problem.mesh.regions
        for name, sigma in conductivity.items():
            if name not in regions:
                raise ValueError(f"a conductivity for {name!r}, but the mesh has only {', '.join(sorted(regions))}")
            if name == problem.coil_region and sigma != 0.0:
                raise ValueError(
                    f"region {name!r} is the winding: its wire carries the driven current; leave its conductivity out"
                )
            if not (math.isfinite(sigma) and sigma >= 0.0):
                raise ValueError(f"conductivity of {name!r} = {sigma} S/m must be a finite number of at least 0")
        if not turns > 0.0:
            raise ValueError(f"`turns` = {turns} of the coil must be above 0")
        self.problem = problem
        self.turns = float(turns)
        self.conductivity = dict(conductivity)
        elements = problem.elements
        elements.curl_free -= {name for name, sigma in conductivity.items() if sigma}
        elements.__dict__.pop("axis_recovery", None)
        self.sigma = np.zeros(len(problem.mesh.triangles))
        for name, sigma in conductivity.items():
            self.sigma[regions[name]] = sigma
        density = self.sigma[:, None] * elements.weight / elements.radius
        blocks = np.einsum("eq,qi,qj->eij", density, elements.shape, elements.shape, optimize=True)
        n, dofs = elements.element_dofs.shape[1], elements.element_dofs
        rows, columns = np.repeat(dofs, n, axis=1).ravel(), np.tile(dofs, (1, n)).ravel()
        self.mass = sp.csr_matrix((blocks.ravel(), (rows, columns)), shape=(problem.n_dofs,) * 2)
        self._mass_on_pattern = problem._pattern.matrix(blocks).data

    def at_rest(self, time: float = 0.0) -> TransientState:
        """No current and no field."""
        return TransientState(time, np.zeros(self.problem.n_dofs), 0.0, 0.0)

    def steady(self, solution: MagneticField, time: float = 0.0) -> TransientState:
        """The static field of a current that has flowed for long."""
        return TransientState(
            time, solution.psi.copy(), solution.ampere_turns / self.turns, self.turns * solution.flux_linkage_per_turn
        )

    def field(self, state: TransientState, fill: Powder = None) -> MagneticField:
        """The state as a field, to sample and to integrate."""
        ampere_turns = self.turns * state.current
        return MagneticField(self.problem, state.psi, ampere_turns, fill, state.newton, is_static=False)

    def step(
        self,
        state: TransientState,
        dt: float,
        drive: Drive,
        fill: Powder = None,
        *,
        method: Method = "sdirk2",
        boundary_field: Callable[[float], float] | None = None,
        tolerance: float = 1e-9,
        max_iterations: int = 40,
    ) -> TransientState:
        """One step of dt [s].

        Parameters
        ----------
        fill : ndarray (n powder elements,), PowderState or None
            At the end of the step.
        boundary_field : callable t [s] -> B [T] or None
            Uniform axial flux density imposed on `outer`.
        tolerance : float
            Residual of Newton relative to the drive and to the field's own forces at the beginning of the step, so
            that the rate of change, and the current at a voltage, are as accurate in a short step as in a long one.

        Raises
        ------
        ValueError
            dt not above 0, or an unknown method.
        ConvergenceError
        """
        if not (math.isfinite(dt) and dt > 0.0) or method not in _STAGES:
            raise ValueError(f"a step of {dt} s by {method!r}: dt must be above 0, the method one of {list(_STAGES)}")
        powder = self.problem.check_powder(fill)
        if isinstance(drive, CurrentDrive):
            state = self._jumped(state, dt, drive, powder, boundary_field, tolerance, max_iterations)
        stages = _STAGES[method]
        diagonal = stages[0][0]
        base, guess = state.psi, state.psi
        rates: list[np.ndarray] = []
        eddy = copper = supplied = 0.0
        current, newton = state.current, state.newton
        for position, weight in stages:
            if rates:
                base = state.psi + (1.0 - diagonal) * dt * rates[0]
                guess = state.psi + dt * rates[0]  # where the first stage points to
            time = state.time + position * dt
            psi, newton = self._stage(
                base, guess, diagonal * dt, time, drive, powder, boundary_field, tolerance, max_iterations
            )
            rate = (psi - base) / (diagonal * dt)
            rates.append(rate)
            linkage_rate = self._linkage(rate)
            eddy += weight * dt * 2.0 * math.pi * scalar_product(rate, self.mass @ rate)
            if isinstance(drive, VoltageDrive):
                current = (drive.voltage(time) - linkage_rate) / drive.resistance
                copper += weight * dt * drive.resistance * current**2
                supplied += weight * dt * drive.voltage(time) * current
            else:
                current = drive.current(time)
                supplied += weight * dt * current * linkage_rate
        # between order 2 and the order 1 of the first stage's slope alone: O(dt^2), the larger of the two errors
        difference = diagonal * dt * (rates[1] - rates[0]) if len(rates) > 1 else psi - guess
        return TransientState(
            state.time + dt,
            psi,
            current,
            self._linkage(psi),
            state.eddy_loss + eddy,
            state.copper_loss + copper,
            state.supplied + supplied,
            self._relative_size(difference, psi, drive),
            newton,
        )

    def run(
        self,
        state: TransientState,
        end: float,
        drive: Drive | DriveOfStep,
        fill: Powder = None,
        *,
        tolerance: float = 1e-3,
        first_step: float | None = None,
        largest_step: float = math.inf,
        breaks: Iterable[float] = (),
        boundary_field: Callable[[float], float] | None = None,
        newton_tolerance: float = 1e-9,
        largest: float = 0.0,
    ) -> list[TransientState]:
        """March to `end` [s] by SDIRK2 with steps that keep the local error below `tolerance`; all states.

        No step is shorter than 1e-6 of the interval.

        Parameters
        ----------
        tolerance : float
            Local error of a step, of the first-order solution as well (so pessimistic), relative to the
            largest state so far.
        first_step : float or None
            [s]; None: a thousandth of the interval.
        breaks : iterable of float
            Instants [s] where the drive is not smooth: steps end there and begin small again. One that lies within
            1e-6 of the interval before `end` is taken for the end: what the drive does after it belongs to later steps.
        newton_tolerance : float
            `tolerance` of `step`.
        largest : float
            `size` of the largest state before the first one here.
        """
        if not (end > state.time and 0.0 < tolerance < 1.0):
            raise ValueError(
                f"from {state.time} s to {end} s with `tolerance` = {tolerance}: the end must lie after the "
                "beginning, the tolerance between 0 and 1"
            )
        smallest = SLIVER * (end - state.time)
        start = 1e-3 * (end - state.time) if first_step is None else first_step
        states, dt = [state], start
        for stop in [*sorted(b for b in breaks if state.time < b < end), end]:
            dt = min(start, dt)
            while stop - state.time > smallest:
                step = min(dt, largest_step, stop - state.time)
                # no sliver of a last step
                if stop - state.time - step < 0.1 * step:
                    step = stop - state.time
                of_step = drive if isinstance(drive, CurrentDrive | VoltageDrive) else drive(state, step)
                trial = self.step(state, step, of_step, fill, boundary_field=boundary_field, tolerance=newton_tolerance)
                size, among = self.size(trial.psi, of_step), self._largest([*states, trial], of_step)
                error = trial.error * size / max(among, largest)
                factor = min(4.0, max(0.2, 0.9 * math.sqrt(tolerance / max(error, 1e-300))))
                if error > tolerance and step > smallest:
                    dt = step * factor
                    continue
                state, dt = trial, max(step * factor, smallest)
                states.append(state)
            state = replace(state, time=stop)  # where it stopped a sliver before: a jump in it is one at `stop`
        states[-1] = replace(state, time=end)
        return states

    def _linkage(self, psi: np.ndarray) -> float:
        return 2.0 * math.pi * self.turns * scalar_product(self.problem.coil_load, psi)

    def _rank_one(self, drive: Drive) -> float:
        return 2.0 * math.pi * self.turns**2 / drive.resistance if isinstance(drive, VoltageDrive) else 0.0

    def size(self, psi: np.ndarray, drive: Drive) -> float:
        """Norm of psi by the whole mass, sqrt(psi . M psi)."""
        along = scalar_product(self.problem.coil_load, psi)
        return math.sqrt(max(scalar_product(psi, self.mass @ psi) + self._rank_one(drive) * along**2, 0.0))

    def _relative_size(self, difference: np.ndarray, psi: np.ndarray, drive: Drive) -> float:
        size = self.size(psi, drive)
        return self.size(difference, drive) / size if size > 0.0 else 0.0

    def _largest(self, states: list[TransientState], drive: Drive) -> float:
        # the first, the last and one in the middle bound a rise and a decay alike without a pass over all
        chosen = (states[0], states[len(states) // 2], states[-1])
        return max(max(self.size(s.psi, drive) for s in chosen), 1e-300)

    def _jumped(
        self,
        state: TransientState,
        dt: float,
        drive: CurrentDrive,
        powder: PowderState | None,
        boundary_field: Callable[[float], float] | None,
        tolerance: float,
        max_iterations: int,
    ) -> TransientState:
        """Return the state after the jump of a given current at its instant, or the state where there is none."""
        before, after = state.current, drive.current(state.time)
        if abs(after - before) <= _JUMP * max(abs(after), abs(before)):
            return state
        psi, newton = self._stage(
            state.psi, state.psi, SLIVER * dt, state.time, drive, powder, boundary_field, tolerance, max_iterations
        )
        linkage = self._linkage(psi)
        supplied = state.supplied + 0.5 * (before + after) * (linkage - state.linkage)
        return replace(state, psi=psi, current=after, linkage=linkage, supplied=supplied, newton=newton)

    def _stage(
        self,
        base: np.ndarray,
        guess: np.ndarray,
        dt: float,
        time: float,
        drive: Drive,
        powder: PowderState | None,
        boundary_field: Callable[[float], float] | None,
        tolerance: float,
        max_iterations: int,
    ) -> tuple[np.ndarray, list[tuple[float, float]]]:
        """psi of K(psi) + M (psi - base)/dt = f(time)."""
        from field.section.section_energy import SectionEnergy

        problem = self.problem
        per_turn = drive.voltage(time) / drive.resistance if isinstance(drive, VoltageDrive) else drive.current(time)
        boundary = np.zeros(problem.n_dofs)
        if boundary_field is not None:
            fixed = problem._fixed
            boundary[fixed] = 0.5 * boundary_field(time) * problem.elements.dof_points[fixed, 0] ** 2
        source = self.turns * per_turn * problem.coil_load
        if boundary_field is not None and problem.exterior is not None:
            source[problem.exterior.dofs] += boundary_field(time) * problem.exterior.uniform_load
        inner = SectionEnergy(problem, powder, source, boundary)
        energy = _StepEnergy(self, inner, base, dt, self._rank_one(drive))
        free = problem._free
        largest = norm(inner.source[free]) + norm(energy.memory(base)[free])
        if boundary_field is not None:
            largest += norm(energy.gradient(np.zeros(free.size)))
        if largest == 0.0:
            return boundary, [(0.0, 0.0)]
        # not by the memory M base/dt, of which the rate (psi - base)/dt is the smaller a part, the shorter the step
        scale = norm(inner.source[free]) + norm(inner.gradient(base[free])) + _ROUND_OFF / tolerance * largest
        solver = RankOneSolver(problem._solver, problem.coil_load[problem._free], energy.rank_one)
        x, history = minimise(
            energy, guess[problem._free], scale, solver=solver, tolerance=tolerance, max_iterations=max_iterations
        )
        return inner.expand(x), history


class _StepEnergy:
    """W(psi) - f . psi + (psi - base) . M (psi - base)/(2 dt) of the free unknowns."""

    def __init__(
        self, eddy: EddyCurrentProblem, inner: SectionEnergy, base: np.ndarray, dt: float, rank_one: float
    ) -> None:
        self._eddy = eddy
        self._inner = inner
        self._base = base
        self._dt = dt
        self._load = eddy.problem.coil_load
        self.rank_one = rank_one / dt

    def memory(self, change: np.ndarray) -> np.ndarray:
        """M change/dt."""
        along = self.rank_one * scalar_product(self._load, change)
        return self._eddy.mass @ change / self._dt + along * self._load

    def value(self, x: np.ndarray) -> tuple[float, float]:
        value, magnitude = self._inner.value(x)
        change = self._inner.expand(x) - self._base
        kept = 0.5 * scalar_product(change, self.memory(change))
        return value + kept, magnitude + kept

    def gradient(self, x: np.ndarray) -> np.ndarray:
        change = self._inner.expand(x) - self._base
        return self._inner.gradient(x) + self.memory(change)[self._eddy.problem._free]

    def hessian(self, x: np.ndarray) -> sp.csc_matrix:
        return self._with_mass(self._inner.hessian(x))

    def chord_hessian(self, x: np.ndarray) -> sp.csc_matrix:
        return self._with_mass(self._inner.chord_hessian(x))

    def _with_mass(self, tangent: sp.csc_matrix) -> sp.csc_matrix:
        # the rank-one part is the solver's
        data = tangent.data + self._eddy._mass_on_pattern / self._dt
        return sp.csc_matrix((data, tangent.indices, tangent.indptr), shape=tangent.shape)
