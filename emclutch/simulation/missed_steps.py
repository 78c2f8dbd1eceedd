"""A run of rigid grains whose solver fails too often is stopped."""

from __future__ import annotations

from typing import TYPE_CHECKING

from emclutch.results.columns import MISSED_STEPS, STEPS
from particles import ParticleError

if TYPE_CHECKING:
    import pandas

    from coupling import WindowRow


class MissedSteps:
    """Callback that stops a run of rigid grains of whose steps too many miss the tolerance.

    Parameters
    ----------
    allowed : fraction of all steps.
    before : history of a run that is resumed: its steps count.

    Raises
    ------
    ParticleError
        If more than the fraction ``allowed`` of all steps so far, and of a hundred at the least, have missed it.
    """

    def __init__(self, allowed: float, before: pandas.DataFrame | None = None):
        self._allowed = allowed
        self._missed = 0 if before is None else int(before[MISSED_STEPS].sum())
        self._steps = 0 if before is None else int(before[STEPS].sum())

    def __call__(self, simulation, row: WindowRow) -> None:
        assert row.solver is not None  # only rigid grains have such a callback
        self._missed += row.solver.missed_steps
        self._steps += row.steps
        if self._missed > self._allowed * max(self._steps, 100):
            raise ParticleError(
                f"t = {row.time:.4g} s: {self._missed} of {self._steps} steps missed the tolerance of "
                f"{simulation.motion.tolerance:.3g} m/s on the contacts (the last window's residual: "
                f"{row.solver.solver_residual:.3g} m/s); raise contact.dvi.max_sweeps or contact.dvi.tolerance, "
                "shorten contact.dvi.step, or allow more by contact.dvi.allowed_misses"
            )
