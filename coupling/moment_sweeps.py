"""Sweeps that find dipoles and mmfs of grains which magnetise one another, a fixed point of `coupling.moment_kernels`.

The map is neither linear nor symmetric. Damped sweeps are mixed with those before (`AndersonMixing`); where they stall,
plain ones of less damping follow, and at last Newton's method. Every sweep updates all from the same state, so no bit
depends on the threads.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from scipy.optimize import NoConvergence, newton_krylov
from scipy.sparse.linalg import LinearOperator

from coupling.finite_grains import NotFiniteGrains
from coupling.grain_law_table import GrainLawTable
from coupling.kernel_state import MagneticGrains, PairModel, Rows
from coupling.moment_kernels import N_RESPONSE, dipole_residual, find_fluxes, gather_fields, mmf_residual
from geometry.kernels.simd import LANES

if TYPE_CHECKING:
    from coupling.mutual_moments import Magnetisation

FIRST_DAMPING, MIN_DAMPING = 0.7, 0.04  # of an undamped step; near saturation the map may repel those of 0.1
WARM_DIPOLES, WARM_MMF = 0.8, 1.0  # of the first step from an earlier solve: the residual of mmfs is near Newton's
PATIENCE = 20  # sweeps in which the residual has not fallen by a tenth: less damping, at last Newton's method
NEWTON_ROUNDS, NEWTON_STEPS = 3, 20
KRYLOV = 30  # vectors of a step of Newton's
DEPTH = 5  # sweeps that are remembered


class MomentSweeps:
    """Sweeps of one solve; the state of `magnetisation` is advanced, and always belongs together when a call returns.

    Parameters
    ----------
    table, model, walls : GrainLawTable, PairModel, (w, 6) float64
        Of `coupling.mutual_moments.MutualMoments`.
    grains : MagneticGrains
        Whose arrays, but for `dipole`, are those of `magnetisation`.
    rows : Rows
    magnetisation : Magnetisation
        With `known`, the mmfs to begin with, and room for the rest.
    near_field : (k, 8) float64
        Scratch, with room for all near entries.
    """

    def __init__(
        self,
        table: GrainLawTable,
        model: PairModel,
        walls: np.ndarray,
        grains: MagneticGrains,
        rows: Rows,
        magnetisation: Magnetisation,
        near_field: np.ndarray,
    ) -> None:
        self.table, self.model, self.walls = table, model, walls
        self.grains, self.rows, self.magnetisation, self.near_field = grains, rows, magnetisation, near_field
        assert magnetisation.known is not None
        self.known = magnetisation.known
        n, w, blocks = len(magnetisation.dipole), magnetisation.wall_mmf.shape[1], len(magnetisation.neck_mmf)
        self.step, self.mmf_step, self.wall_step = np.empty((n, 3)), np.zeros((blocks, LANES)), np.zeros((n, w))
        self.response, self.squares = np.zeros((n, N_RESPONSE)), np.zeros((n, 2))
        self.mmf_squares, self.wall_squares = np.zeros((blocks, 2)), np.zeros((n, 2))
        self.sums = np.ones(4)

    def evaluate(self) -> float:
        """Find fluxes, fields and residual steps at the present dipoles and mmfs; returns the relative residual."""
        f = self.magnetisation
        grains = self.grains = self.grains._replace(dipole=f.dipole)
        if self.model.near:
            find_fluxes(
                self.table, self.model, grains, self.rows, self.walls, self.known, f.neck_mmf, f.wall_mmf, f.contrast,
                f.neck, f.wall_neck, f.charge, self.response, self.near_field,
            )  # fmt: skip
        gather_fields(self.model, grains, self.rows, self.known, f.field, f.potential)
        dipole_residual(self.table, grains, self.response, self.step, self.squares)
        sums = self.squares.sum(axis=0)
        residual = 0.0 if sums[1] == 0.0 else np.sqrt(sums[0] / sums[1])  # a NaN stays one
        if self.model.near:
            mmf_residual(
                self.model, grains, self.walls, self.known, self.response, f.neck_mmf, f.wall_mmf, self.mmf_step,
                self.wall_step, self.mmf_squares, self.wall_squares,
            )  # fmt: skip
            mmf_sums = self.mmf_squares.sum(axis=0) + self.wall_squares.sum(axis=0)
            more = 0.0 if mmf_sums[0] == 0.0 else np.sqrt(mmf_sums[0] / max(mmf_sums[1], 1e-30 * mmf_sums[0]))
            residual = max(residual, more) if np.isfinite(more) else more
            self.sums = np.array([sums[0], sums[1], mmf_sums[0], mmf_sums[1]])
        else:
            self.sums = np.array([sums[0], sums[1], 0.0, 1.0])
        if not np.isfinite(residual):
            raise NotFiniteGrains(f"the moments of the grains are not finite after {f.sweeps + 1} sweeps")
        f.residual = float(residual)
        f.sweeps += 1
        return f.residual

    def run(self, tolerance: float, max_sweeps: int, cold: bool) -> None:
        """Sweep until the residual is at most the tolerance, `max_sweeps` times at most.

        Where it is not reached the state is that of the smallest residual, evaluated once more.
        """
        damping, before, mixing = (1.0 if cold else FIRST_DAMPING), np.inf, AndersonMixing()
        self.scale = np.ones(2)
        best, best_at = np.inf, 0
        lowest, lowest_state = np.inf, self.magnetisation.dipole
        for sweep in range(1, max_sweeps + 1):
            residual = self.evaluate()
            if residual <= tolerance:
                return
            if sweep == max_sweeps:
                break
            if residual < 0.9 * best:
                best, best_at = residual, sweep
            elif sweep - best_at > PATIENCE:
                if damping <= MIN_DAMPING:
                    break
                damping, best, best_at = 0.6 * damping, residual, sweep
                mixing = AndersonMixing(depth=0)  # in saturation the map bends within a step: plain sweeps
            if sweep == 1:
                self.scale = self._scales()
            state = self._state()
            if residual < lowest:
                lowest, lowest_state = residual, state
            residual_steps = self._residual_steps()
            step = np.full(residual_steps.shape, damping)
            if sweep == 1 and not cold:
                step[:] = WARM_MMF
                step[: self.magnetisation.dipole.size] = WARM_DIPOLES
            self._set_state(mixing.next(state, residual_steps, step))
            if sweep > 1 and residual > 1.5 * before:
                mixing.forget()
            elif sweep == 1 and cold:
                damping = FIRST_DAMPING
            before = residual
        if self.magnetisation.residual > lowest:
            self._set_state(lowest_state)
            self.evaluate()

    def newton(self, tolerance: float, max_sweeps: int) -> None:
        """Newton's method with Krylov's subspaces (scipy) where the sweeps have stalled, from the best state of theirs.

        Where it fails the state is that of the smallest residual.
        """
        best = self.magnetisation.residual, self._state()

        def residual_steps(state: np.ndarray) -> np.ndarray:
            if self.magnetisation.sweeps >= max_sweeps:
                raise NoConvergence(best[1])
            self._set_state(state)
            self.evaluate()
            return self._residual_steps()

        for _ in range(NEWTON_ROUNDS):
            try:
                root = newton_krylov(
                    residual_steps, self._state(), f_tol=0.1 * tolerance, maxiter=NEWTON_STEPS, method=_gmres,
                    inner_maxiter=KRYLOV, tol_norm=lambda x: float(np.sqrt((x**2).sum())),
                )  # fmt: skip
                self._set_state(np.asarray(root))
                self.evaluate()
            except NoConvergence as failed:
                self._set_state(np.asarray(failed.args[0]))
                self.evaluate()
            except (NotFiniteGrains, ValueError, np.linalg.LinAlgError):
                break
            slow = self.magnetisation.residual > 0.1 * best[0]
            if self.magnetisation.residual < best[0]:
                best = self.magnetisation.residual, self._state()
            if self.magnetisation.residual <= tolerance:
                return
            if slow:  # a minimum of the residual that is no solution: another round ends there too
                break
        self._set_state(best[1])
        self.evaluate()

    def _scales(self) -> np.ndarray:
        """Factors of dipoles and mmfs with which both parts of the state count alike in the mixing.

        Across the field mmfs may begin at 0, of which no scale is had: not less than a hundredth of M a.
        """
        size, volume = float((self.grains.radius**2).mean()), float(np.sqrt((self.grains.volume**2).mean()))
        squares = np.maximum(self.sums[[1, 3]], [1e-300, 1e-4 * size * self.sums[1] + 1e-300])
        return 1.0 / np.sqrt(squares) * [1.0 / volume, 1.0]

    def _join(self, dipole: np.ndarray, neck_mmf: np.ndarray, wall_mmf: np.ndarray) -> np.ndarray:
        per_m, per_D = self.scale
        if not self.model.near:
            return per_m * dipole.reshape(-1)
        return np.concatenate((per_m * dipole.reshape(-1), per_D * neck_mmf.reshape(-1), per_D * wall_mmf.reshape(-1)))

    def _state(self) -> np.ndarray:
        return self._join(self.magnetisation.dipole, self.magnetisation.neck_mmf, self.magnetisation.wall_mmf)

    def _residual_steps(self) -> np.ndarray:
        return self._join(self.step, self.mmf_step, self.wall_step)

    def _set_state(self, state: np.ndarray) -> None:
        """Set dipoles and mmfs."""
        f = self.magnetisation
        a = f.dipole.size
        b = a + f.neck_mmf.size
        f.dipole = (state[:a] / self.scale[0]).reshape(f.dipole.shape)
        if self.model.near:
            f.neck_mmf = (state[a:b] / self.scale[1]).reshape(f.neck_mmf.shape)
            f.wall_mmf = (state[b:] / self.scale[1]).reshape(f.wall_mmf.shape)


class AndersonMixing:
    """The next state (k,) of a damped fixed-point iteration that remembers the last sweeps.

    Of all states in the plane through the sweeps that it remembers that one is taken whose residual step is
    smallest, and the damped step is made from there (D. G. Anderson, J. ACM 12 (1965) 547; H. F. Walker, P. Ni, SIAM J.
    Numer. Anal. 49 (2011) 1715). It follows an iteration that alternates as well as one that creeps.

    Parameters
    ----------
    depth : int
        Differences of sweeps that are remembered; 0: none, the damped step alone.
    """

    def __init__(self, depth: int = DEPTH) -> None:
        self.depth = depth
        self.forget()

    def forget(self) -> None:
        """Begin again."""
        self._last: tuple[np.ndarray, np.ndarray] | None = None
        self._moved: list[np.ndarray] = []
        self._changed: list[np.ndarray] = []
        self._products = np.zeros((0, 0))

    def next(self, state: np.ndarray, residual_steps: np.ndarray, damping: float | np.ndarray) -> np.ndarray:
        """The next state, of a `state` (k,) and the change of an undamped step, `residual_steps` (k,)."""
        if self._last is not None and self.depth:
            self._remember(state - self._last[0], residual_steps - self._last[1])
        self._last = state, residual_steps
        after = state + damping * residual_steps
        if not self._changed:
            return after
        right = np.array([_product(part, residual_steps) for part in self._changed])
        size = np.sqrt(np.maximum(np.diag(self._products), 1e-300))
        back = np.linalg.lstsq(self._products / np.outer(size, size), right / size, rcond=1e-10)[0] / size
        for part, moved, changed in zip(back, self._moved, self._changed, strict=True):
            after -= part * (moved + damping * changed)
        return after

    def _remember(self, moved: np.ndarray, changed: np.ndarray) -> None:
        if len(self._changed) == self.depth:
            del self._moved[0], self._changed[0]
            self._products = self._products[1:, 1:]
        self._moved.append(moved)
        self._changed.append(changed)
        n = len(self._changed)
        products = np.empty((n, n))
        products[:-1, :-1] = self._products
        products[-1] = products[:, -1] = [_product(part, changed) for part in self._changed]
        self._products = products


def _gmres(
    operator: LinearOperator, right: np.ndarray, rtol: float = 1e-5, maxiter: int = 30, M: None = None
) -> tuple[np.ndarray, int]:
    """GMRES without restarts, without a preconditioner ``M``; scipy's has inner products whose bits go with threads."""
    size = np.sqrt(_product(right, right))
    if size == 0.0:
        return np.zeros_like(right), 0
    basis, matrix = [right / size], np.zeros((maxiter + 1, maxiter))
    for k in range(maxiter):
        new = operator.matvec(basis[k])
        for i, vector in enumerate(basis):
            matrix[i, k] = _product(vector, new)
            new = new - matrix[i, k] * vector
        matrix[k + 1, k] = np.sqrt(_product(new, new))
        target = np.zeros(k + 2)
        target[0] = size
        part = np.linalg.lstsq(matrix[: k + 2, : k + 1], target, rcond=None)[0]
        left = matrix[: k + 2, : k + 1] @ part - target
        if np.sqrt(_product(left, left)) <= rtol * size or matrix[k + 1, k] <= 1e-14 * np.abs(matrix).max():
            break
        basis.append(new / matrix[k + 1, k])
    solution = np.zeros_like(right)
    for factor, vector in zip(part, basis, strict=False):
        solution += factor * vector
    return solution, 0


def _product(a: np.ndarray, b: np.ndarray) -> float:
    """Inner product, in an order that does not depend on threads."""
    return float(np.einsum("i,i->", a, b))
