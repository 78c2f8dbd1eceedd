"""The grains' moments in the field of the device: deposited on its mesh, solved with it, fed back until both agree.

The field is that of the moments themselves. They stand in it, spread out (`coupling.smeared_grains`), in two parts:

    M = phi M_grain(|B|; N) B/|B| + source,        N = (H - h(M))/M of each element,

with h(M) the field inside a grain by its own law. The first part responds to B inside the Newton iteration as the
powder there does, whatever its structure; the source is what it misses of the deposited moments at the field of the
last solve. So at the fixed point the magnetisation is the deposited one, whatever N is; N only makes the iteration
converge faster. N is limited to 0.03 to 0.4, relaxed by half at each solve, and kept where it is undefined: H, phi or M
almost zero, grains at saturation, M against H.

In dense powder, whose necks respond more strongly than the law with such an N says, the iteration may swing and grow.
Where a solve has not brought field and moments nearer by a tenth, moments are deposited that go half of the way from
the last deposited ones, until the grains have moved.

A grain takes H = B/mu_0 - M from the solve, with the same M at its place, and of the grains nearer than the width a
what their smear misses (`coupling.pair_fields`), its own included: nothing counts twice, nothing is lost.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from coupling.smear_region import mirror_points_in_steel
from coupling.smeared_grains import SectionSmear, ring_smear
from coupling.wall_reflection import steel_walls
from field import (
    ConvergenceError,
    FieldSampler,
    MagneticField,
    ParticleLaw,
    PowderState,
    RecoveredSampler,
)
from field.laws.reluctivity import MU_0, NU_0
from particles import Body

MIN_FACTOR, MAX_FACTOR = 0.03, 0.4
MIN_FILL = 0.01
WEAK, SATURATED = 1e-4, 0.98  # of the saturation: H and M beyond which N says nothing
WEAKEST = 1.0  # [A/m] of grains that do not saturate
STUCK, HALF_WAY = 0.9, 0.5


@dataclass(frozen=True, slots=True)
class FeedbackResidual:
    """Difference of the solved magnetisation from the deposited one, relative to it (root mean square, [-]).

    Attributes
    ----------
    total : float
        Of the present moments against those in the present field.
    across, factor, lag : float
        Parts of the last solve's source, which it took from the moments before it: across H, where no N can stand for
        it; along H where N is at a limit; and the rest, the relaxation of N and what changes within an element.
    """

    total: float = np.inf
    across: float = 0.0
    factor: float = 0.0
    lag: float = 0.0


@dataclass(frozen=True, slots=True)
class FeedbackRow:
    """The residual at the end of a window, see `FeedbackResidual`."""

    feedback_residual: float
    feedback_across: float
    feedback_clipped: float
    feedback_lagged: float


class PowderFeedback:
    """Deposits grains on the powder's elements, and keeps the data that the field's solve needs of them.

    Parameters
    ----------
    problem : AxisymmetricProblem, in 3D Problem3D
        With a powder law, and `elements_within` as its `powder_beyond`.
    law : ParticleLaw
        Of a grain.
    width : float
        a of the smear [m].
    angle : float
        Of the simulated sector [rad].
    walls : sequence of walls
        Those that grains touch; the magnetic ones among them fold the smear back.
    carrier : Body or None
        In whose frame a field in 3D stands still.
    """

    DIMENSIONS: ClassVar[int] = 2

    def __init__(
        self, problem: Any, law: ParticleLaw, width: float, angle: float, walls, carrier: Body | None = None
    ) -> None:
        self.problem, self.law, self.width, self.angle = problem, law, float(width), float(angle)
        self.walls, self.carrier = walls, carrier
        self._steel = steel_walls(walls)
        self._volume = self._place()
        self._weight = self._volume / self._volume.sum(axis=1, keepdims=True)
        scale = getattr(law, "Ms", None)
        self._scale = np.inf if scale is None else float(scale)
        self._factor: np.ndarray | None = None
        self._fill = np.zeros(len(self._volume))
        self._M = np.zeros((len(self._volume), self.DIMENSIONS, self._volume.shape[1]))
        self._field: Any = None
        self._field_M = np.zeros_like(self._M)
        self._damping = 1.0
        self._judged: Any = None
        self._given = np.zeros((0, 3))
        self.residual = FeedbackResidual()

    def _place(self) -> np.ndarray:
        """Note where the smear is evaluated; returns the volumes (m, q) of the quadrature points."""
        problem, rows = self.problem, self._steel
        elements, own = problem.elements, problem.powder_elements
        points = np.stack((elements.radius[own], elements.height[own]), axis=2)
        self._shape = points.shape[:2]
        self._points = np.ascontiguousarray(points.reshape(-1, 2))
        self._nodes = problem.recovery(problem.powder_region).nodes
        self._folds = mirror_points_in_steel(self._points, rows, problem, self.width)
        self._node_folds = mirror_points_in_steel(self._nodes, rows, problem, self.width)
        self._node_M = np.zeros((6, len(self._nodes)))
        self._smear: SectionSmear | None = None
        return elements.radius[own] * elements.weight[own]

    def _spread(self, position: np.ndarray, volume: np.ndarray, moment: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Solid fraction (m, q) and magnetisation (m, 2, q) of the smeared grains at the quadrature points."""
        self._set_smear(position, volume, moment)
        assert self._smear is not None
        smeared = self._smear.at(self._points, self._folds, slopes=False)
        M = np.ascontiguousarray(smeared[1:3].reshape(2, *self._shape).transpose(1, 0, 2))
        return smeared[0].reshape(self._shape), M

    def _set_smear(self, position: np.ndarray, volume: np.ndarray, moment: np.ndarray) -> None:
        """Keep the smear, which gives `sampler_after_solve` M at the nodes."""
        self._smear = ring_smear(position, volume, moment, self.width, self.angle, self._steel)

    def deposit(
        self, position: np.ndarray, volume: np.ndarray, moment: np.ndarray | None, field: Any
    ) -> None:
        """Take grains at (n, 3) [m] of volumes (n,) [m^3], moments (n, 3) [A m^2]; note by how much `field` misses."""
        self._update_field(field)
        moment = np.zeros_like(position) if moment is None else moment
        before = self._M
        fill, self._M = self._spread(position, volume, moment)
        self._fill = np.minimum((fill * self._weight).sum(axis=1), 0.95)
        total = np.inf
        if field is not None:
            size = self._square(self._M)
            missed = self._square(self._M - self._field_M)
            total = float(np.sqrt(missed / size)) if size > 0.0 else (0.0 if missed == 0.0 else np.inf)
        if field is self._judged or len(self._given) == 0:  # no solve since: the grains have moved, or it is resumed
            self._damping = 1.0
        elif total > STUCK * self.residual.total:
            self._damping = HALF_WAY
        if self._damping < 1.0:
            moment = self._given + self._damping * (moment - self._given)
            self._set_smear(position, volume, moment)
            self._M = before + self._damping * (self._M - before)
        self._judged, self._given = field, moment.copy()
        self.residual = FeedbackResidual(total, self.residual.across, self.residual.factor, self.residual.lag)

    def _update_field(self, field: Any) -> None:
        """Compute once per field the mirrors of its steel and its magnetisation, which `deposit` needs."""
        if field is None or field is not self._field:
            self._steel = steel_walls(self.walls, field, steel_only=True)
            self._field_M = np.zeros_like(self._M) if field is None else self.magnetisation(field)
            self._field = field

    def magnetisation(self, field: Any) -> np.ndarray:
        """Magnetisation (m, 2, q) [A/m] of the powder in a solved field."""
        powder = field.powder
        B, size = self._flux(field)
        if powder is None:
            return np.zeros_like(B)
        by_law = self._of_flux(powder, B, size)
        return by_law if powder.source is None else by_law + powder.source

    def _of_flux(self, powder: PowderState, B: np.ndarray, size: np.ndarray) -> np.ndarray:
        M, _ = self.law.from_flux(size, *powder.arguments)
        M = powder.fill[:, None] * M
        return np.divide(M, size, out=np.zeros_like(size), where=size > 0.0)[:, None, :] * B

    def _strength(self, field: Any) -> np.ndarray:
        """H (m, 2, q) [A/m] of a solved field at the quadrature points."""
        return NU_0 * self._flux(field)[0] - self.magnetisation(field)

    def _law_part(self, powder: PowderState, H: np.ndarray) -> np.ndarray:
        """What the law says of M in the next solve, where H and the moments now deposited hold."""
        # at the B that the deposited moments make with the present H: grains follow H, and so does what is lagged
        B = MU_0 * (H + self._M)
        return self._of_flux(powder, B, np.hypot(B[:, 0], B[:, 1]))

    def _is_on(self, field: Any) -> bool:
        return bool(field.psi.any())

    def state(self, field: Any) -> PowderState:
        """The powder of the grains deposited last for the next solve, after the present field (None: the first one)."""
        if field is None or not self._M.any() or not self._is_on(field):
            self._factor = None
            return PowderState(self._fill)
        H = self._strength(field)
        mean_H = (H * self._weight[:, None, :]).sum(axis=2)
        strength = np.hypot.reduce(mean_H, axis=1)
        along = np.divide(mean_H, strength[:, None], out=np.zeros_like(mean_H), where=strength[:, None] > 0.0)
        mean_M = (self._M * self._weight[:, None, :]).sum(axis=2)
        M = np.divide((mean_M * along).sum(axis=1), self._fill, out=np.zeros_like(strength), where=self._fill > 0.0)
        weak = WEAK * self._scale if np.isfinite(self._scale) else WEAKEST
        says = (strength > weak) & (self._fill > MIN_FILL) & (M > 0.0)
        says &= M < SATURATED * self._scale
        before = self.law.demagnetising_factors(self._fill)[0] if self._factor is None else self._factor
        M = np.where(says, M, 1.0)
        unbounded = np.where(says, (strength - self.law.field_inside(M)) / M, before)
        target = np.clip(unbounded, MIN_FACTOR, MAX_FACTOR)
        factor = target if self._factor is None else before + 0.5 * (target - before)
        state = PowderState(self._fill, factor)
        source = self._M - self._law_part(state, H)
        self._note(source, H, (target != unbounded) | ~says)
        self._factor = factor
        return PowderState(self._fill, factor, np.ascontiguousarray(source))

    def sampler_after_solve(self, field: Any) -> FieldSampler:
        """Sampler of H = B/mu_0 - M at grains in a field that was solved with the last `state`."""
        assert self._smear is not None  # grains are deposited before a solve
        recovery = self.problem.recovery(self.problem.powder_region)
        if not field.psi.any():  # switched off: soft grains have no moment
            self._node_M = np.zeros_like(self._node_M)
            return self.sampler(field)
        self._node_M = self._smear.at(self._nodes, self._node_folds)[1:]
        difference = (self.magnetisation(field) - self._M) * self._weight[:, None, :]
        change = difference.sum(axis=2)[: len(recovery.centroids)]
        for k in range(2):
            value, slope = recovery.smooth_fill(np.ascontiguousarray(change[:, k]))
            self._node_M[k] += value
            self._node_M[2 + 2 * k : 4 + 2 * k] += slope
        return self.sampler(field)

    def sampler(self, field: Any) -> FieldSampler:
        """The sampler of the last `sampler_after_solve`."""
        return RecoveredSampler(field, self.problem.powder_region, self._node_M)

    def window_part(self) -> FeedbackRow:
        """Return the residual and its causes."""
        residual = self.residual
        total = residual.total if np.isfinite(residual.total) else 0.0  # no field and no moment yet
        return FeedbackRow(total, residual.across, residual.factor, residual.lag)

    def checkpoint(self) -> dict[str, Any]:
        """State for a bit-exact continuation, in addition to the field's own psi, fill, factor and source."""
        residual = self.residual
        return {
            "factor": self._factor,
            **self._of_the_sampler(),
            "residual": [residual.total, residual.across, residual.factor, residual.lag],
        }

    def _of_the_sampler(self) -> dict[str, Any]:
        return {"magnetisation": self._node_M}

    def restore(self, saved: dict[str, Any]) -> None:
        """Take up the state of a checkpoint."""
        self._factor = saved["factor"]
        if "magnetisation" in saved:
            self._node_M = np.array(saved["magnetisation"], dtype=float)
        self.residual = FeedbackResidual(*map(float, saved["residual"]))

    def _flux(self, field: MagneticField) -> tuple[np.ndarray, np.ndarray]:
        """B (m, 2, q) [T] and |B| (m, q) at the powder's quadrature points."""
        own = self.problem.powder_elements
        gradient = self.problem.elements.gradient(field.psi)[own]
        B = np.stack((-gradient[:, 1], gradient[:, 0]), axis=1) / self.problem.elements.radius[own][:, None, :]
        return B, np.hypot(B[:, 0], B[:, 1])

    def _square(self, M: np.ndarray) -> float:
        return float(((M**2).sum(axis=1) * self._volume).sum())

    def _note(self, source: np.ndarray, H: np.ndarray, limited: np.ndarray) -> None:
        """The parts of a source, by cause."""
        size = self._square(self._M)
        strength = np.hypot.reduce(H, axis=1)[:, None, :]
        e = np.divide(H, strength, out=np.zeros_like(H), where=strength > 0.0)
        part = (source * e).sum(axis=1)
        across = source - part[:, None, :] * e
        mean = (part * self._weight).sum(axis=1)[:, None] * limited[:, None]
        volume = self._volume
        squares = self._square(across), float((mean**2 * volume).sum()), float(((part - mean) ** 2 * volume).sum())
        self.residual = FeedbackResidual(self.residual.total, *(float(np.sqrt(s / size)) for s in squares))


class FeedbackError(ConvergenceError):
    """The field and the moments of the grains in it do not come to agree."""

    def __init__(self, residual: float, solves: int, tolerance: float) -> None:
        remedy = (
            "look at the grains where they are densest, raise that tolerance, or remove [effects.back_reaction]: the "
            "field is then that without grains"
        )
        super().__init__(
            [(residual, 1.0)],
            remedy,
            f"the field and the moments of the grains do not agree: they differ by {residual:.2g} of the magnetisation "
            f"after {solves} solves of one window (effects.back_reaction.tolerance: {tolerance:g}); {remedy}",
        )
