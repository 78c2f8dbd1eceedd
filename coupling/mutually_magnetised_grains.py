"""The grains' moments where they magnetise one another: models `mutual` and `near_field` of the effect `dipoles`.

Dipoles and mmfs of the last evaluation are the start of the next one: a few sweeps follow the powder while it is
sheared. The dipoles are sorted and turned with the grains, the mmfs known by the numbers of the grains.
A field of layers (`coupling.layered_field`) is that of the last moments; where these have left it by more than the
moments' tolerance, both are solved again.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from coupling.finite_grains import refuse_not_finite
from coupling.layered_field import LayeredField
from coupling.magnetised_grains import MagnetisedGrains, MomentRow
from coupling.mutual_moments import LaggedForces, Magnetisation, MutualMoments, Necks
from coupling.near_attraction import NearAttraction
from coupling.wall_reflection import steel_walls
from field import ConvergenceError, MagneticField
from field.three_d import Field3D
from particles import DVI, GrainMotion

MAX_SWEEPS, MAX_ROUNDS = 200, 30
LOST = 0.1
"""Residual beyond which moments, or the field of their layers, are not those of the law: the run stops."""


@dataclass(slots=True, kw_only=True)
class MutuallyMagnetisedGrains(MagnetisedGrains):
    """See `MagnetisedGrains`.

    Attributes
    ----------
    solver : MutualMoments
    tolerance : float
        Largest residual of the moments.
    max_sweeps : int
        Sweeps of an evaluation at most.
    mirrors : sequence of walls, or None
        Walls whose steel mirrors the grains, as strongly as the field's solution says; None: none does.
    near : NearAttraction or None
        Transfers the near pull to the grains' own step; None: it lags like the rest.
    necks : Necks or None
        Mmfs of the last evaluation; None before the first one, and in model `mutual`.
    field_strength : float or None
        Root mean square of the field without the grains' own [A/m] at the last evaluation; None before the first one.
    """

    solver: MutualMoments
    tolerance: float = 1e-3
    max_sweeps: int = MAX_SWEEPS
    mirrors: Sequence | None = None
    near: NearAttraction | None = None
    magnetisation: Magnetisation | None = None
    necks: Necks | None = None
    field_strength: float | None = None
    _walls_of: object = None
    _stood: tuple[np.ndarray, np.ndarray] | None = None
    _worst: float = 0.0
    _sweeps: int = 0

    def update(self, simulation) -> None:
        """Sample the field and find the moments; raises `MomentError` where they do not converge."""
        assert self.sampler is not None  # the loop refreshes the source first
        grains = simulation.motion.grains
        self._refresh_walls(simulation.source)
        rows = simulation.rows(self.solver.reach)
        layers = self.sampler if isinstance(self.sampler, LayeredField) else None
        for _ in range(MAX_ROUNDS):
            self.H, self.grad_H = self.sampler.sample(grains.position)
            refuse_not_finite(grains.position, self.H, grains.particle_id)
            magnetisation = self.solver.solve(
                grains.position, grains.radius, self.H, rows, gradient=self.grad_H if self.solver.smear else None,
                start=grains.magnetic_moment if grains.dipole is None else grains.dipole, necks=self.necks,
                number=grains.particle_id, tolerance=self.tolerance, max_sweeps=self.max_sweeps,
            )  # fmt: skip
            if magnetisation.residual > LOST:
                raise MomentError(magnetisation.residual, magnetisation.sweeps)
            self.magnetisation, grains.magnetic_moment = magnetisation, magnetisation.moment
            if self.solver.near:
                # a copy: the grains turn theirs where they cross a face
                grains.dipole = magnetisation.dipole.copy()
                self.necks = self.solver.necks_of(magnetisation, grains.particle_id)
            self._sweeps += magnetisation.sweeps
            left = 0.0 if layers is None else layers.follow(grains.position, magnetisation.moment)
            if left <= self.tolerance:
                break
        if left > LOST:
            raise MomentError(left, self._sweeps)
        self._worst = max(self._worst, magnetisation.residual, left)
        self.field_strength = float(np.sqrt((self.H**2).sum(axis=1).mean())) if len(self.H) else 0.0
        budget = simulation.motion.energy_budget
        self._stood = (np.array(grains.position), np.array(grains.radius)) if budget else None

    def pulls_follow_gaps(self, simulation) -> bool:
        """True if the grains' step has the near pulls at its own gaps; DVI does where they are not updated every step.

        Else a step of DVI has their mean over its way, from the moments of its beginning.
        """
        each_step = isinstance(simulation.motion, DVI) and simulation.steps_per_update == 1
        return self.near is not None and not each_step

    def all_is_lagged(self, simulation) -> bool:
        """True if the stress of a sheared box is that of the lagged forces alone: no pull follows the gaps."""
        return simulation.motion.box is not None and not self.pulls_follow_gaps(simulation)

    def set_lagged_stress(self, lagged: LaggedForces, motion: GrainMotion) -> None:
        """Keep the stress of the lagged forces where their virial was computed; others change nothing."""
        if lagged.virial is not None and motion.box is not None:
            self.lagged_stress = lagged.virial.T / motion.box.volume

    def freeze(self, simulation, force: np.ndarray) -> None:
        """Freeze all lagged forces (n, 3) [N] of this update, and let the grains' step follow the near gaps."""
        motion, grains, magnetisation = simulation.motion, simulation.motion.grains, self.magnetisation
        follow = self.pulls_follow_gaps(simulation)
        if magnetisation is not None and motion.box is not None and follow:
            # the pulls of near pairs have their stress from each step
            rows = simulation.rows(self.solver.reach)
            place = grains.position, grains.radius, rows
            without_pulls = self.solver.forces(*place, magnetisation, attraction=False, virial=True)
            self.set_lagged_stress(without_pulls, motion)
        if follow and self.near is not None and magnetisation is not None:
            self.near.freeze(motion, magnetisation, force)

    def resume(self, motion: GrainMotion) -> None:
        """Give the motion the attraction that its saved drives belong to."""
        if self.near is not None:
            motion.attraction = self.near.attraction

    def state(self) -> dict[str, Any] | None:
        """Return the mmfs of the necks and the field's strength for a checkpoint."""
        if self.field_strength is None:
            return None
        saved_necks = {} if self.necks is None else asdict(self.necks)
        return {"field_strength": self.field_strength} | saved_necks

    def restore(self, saved: dict[str, Any] | None) -> None:
        """Restore the mmfs of the necks and the field's strength of a checkpoint."""
        saved_necks = dict(saved or {})
        self.field_strength = saved_necks.pop("field_strength", None)
        self.necks = Necks(**saved_necks) if saved_necks else None

    def energy(self) -> float | None:
        """Return W of `coupling.mutual_moments` at the last evaluation [J]; None without a budget of energy."""
        stood, state = self._stood, self.magnetisation
        return None if stood is None or state is None else self.solver.energy(*stood, state)

    def window_part(self) -> MomentRow:
        """Return the worst residual and the sweeps since the last call."""
        row = MomentRow(self._worst, float(self._sweeps))
        self._worst, self._sweeps = 0.0, 0
        return row

    def _refresh_walls(self, source) -> None:
        if self.mirrors is None:
            return
        solution = None if source is None else source.solution
        if self._walls_of is None or solution is not self._walls_of:
            solved = solution if isinstance(solution, MagneticField | Field3D) else None
            self.solver.walls = steel_walls(self.mirrors, solved)
            self._walls_of = solution if solution is not None else self


class MomentError(ConvergenceError):
    """The moments of grains that magnetise one another did not converge."""

    def __init__(self, residual: float, sweeps: int) -> None:
        remedy = (
            "look at the grains where they overlap most, shorten effects.dipoles.update_every, or take "
            "effects.dipoles.model = 'mutual'"
        )
        super().__init__(
            [(residual, 1.0)],
            remedy,
            f"the moments of the grains did not converge: residual {residual:.2g} after {sweeps} sweeps (at most "
            f"{LOST:g} is accepted); {remedy}",
        )
