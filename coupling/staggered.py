"""The staggered loop: coil -> field -> moments -> forces -> grains -> field, window by window.

The field is constant during a coupling window; inside it the effects' forces are evaluated every `steps_per_update`
steps of the grains and constant in between. What couples back are the grains' moments, spread into the field solve
(`coupling.powder_feedback`); they respond inside the same Newton iteration, so that the loop is stable for any
susceptibility of the powder (an explicit magnetisation source alone would diverge above chi of about 1.3).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field

import numpy as np

from coupling.coil_field import SolvedCoilField
from coupling.effects.effect import Effect
from coupling.field_source import FieldSource
from coupling.magnetised_grains import MagnetisedGrains
from coupling.neighbour_rows import NeighbourRows, neighbour_rows
from coupling.powder_feedback import FeedbackError
from coupling.window_budget import WindowBudget
from coupling.window_row import WindowRow
from particles import Barostat, Body, GrainMotion, StepTotals

MAX_SOLVES = 30
"""Of one window: beyond it field and moments do not agree, and the run stops."""


@dataclass(slots=True)
class Simulation:
    """Everything that the loop moves.

    Attributes
    ----------
    motion : GrainMotion
        What moves the grains.
    effects : list of Effect
        Exactly those of the scene, in the order in which they act.
    magnetised : MagnetisedGrains or None
        None when no effect needs the field.
    source : FieldSource or None
    steps_per_update, steps : int
        Grain steps between evaluations of the lagged forces, and of a window, whose last interval may be shorter.
    barostat : Barostat or None
        What makes the height of a sheared box follow its pressure, after every sub-cycle; None: it stays.
    """

    motion: GrainMotion
    effects: list[Effect]
    magnetised: MagnetisedGrains | None
    source: FieldSource | None
    steps_per_update: int
    steps: int
    n_sectors: int = 1
    barostat: Barostat | None = None
    window: int = 0
    lagged_steps: int = field(init=False)
    """Grain steps for which the next evaluated forces stay constant."""
    _rows: NeighbourRows | None = None
    _rows_key: tuple = ()

    def __post_init__(self) -> None:
        self.lagged_steps = self.steps_per_update

    @property
    def field_carrier(self) -> Body | None:
        """The body that carries the field round because it has slots; None: the field is one of revolution."""
        return None if self.source is None else self.source.carrier

    @property
    def has_lagged_forces(self) -> bool:
        """True if anything acts on the grains between contacts and gravity: a field, or another effect."""
        return self.magnetised is not None or any(effect.has_lagged_forces for effect in self.effects)

    def rows(self, cutoff: float) -> NeighbourRows:
        """Return neighbour rows out to `cutoff` [m], one list's skin wider where repeated space leaves room for it.

        They are rebuilt with the grains' list, which sorts the grains, and when grains have moved too far for them.
        """
        motion, periodicity = self.motion, self.motion.periodicity
        if motion.box is not None:
            motion.renew_list()
        position = motion.grains.position
        fits = self._rows is not None and (cutoff, motion.list_version) == self._rows_key
        if fits and self._rows is not None and self._rows.is_complete(position, cutoff, periodicity):
            self._rows = self._rows.at_present(periodicity)
            return self._rows
        if fits and motion.box is not None:  # the flow has carried grains far out of the box
            motion.invalidate()
            motion.renew_list()
            position = motion.grains.position
        reach = cutoff + motion.list_skin
        if periodicity is not None:  # in narrow space with less to spare: the rows are rebuilt more often
            reach = max(cutoff, min(reach, periodicity.widest_cutoff(position)))
        self._rows = neighbour_rows(position, reach, periodicity)
        self._rows_key = (cutoff, motion.list_version)
        return self._rows

    def rows_state(self) -> dict | None:
        """Return the present rows for a checkpoint: their order fixes the order of sums, bit for bit."""
        if self._rows is None or self._rows_key[1] != self.motion.list_version:
            return None  # stale: they would be rebuilt in any case
        return {
            "cutoff": self._rows_key[0],
            "start": self._rows.start,
            "other": self._rows.other,
            "image": self._rows.image,
            "images": self._rows.images,
            "position": self._rows.position,
            "reach": self._rows.reach,
            "twin": self._rows.twin,
            "strain": self._rows.strain,
            "height": self._rows.height,
        }

    def restore_rows(self, state: dict | None) -> None:
        """Restore the rows of a checkpoint; rows without the positions of the grains are rebuilt."""
        if state is not None and "position" in state:
            state = dict(state)
            self._rows_key = (state.pop("cutoff"), self.motion.list_version)
            self._rows = NeighbourRows(**state)


Measure = Callable[[Simulation, WindowRow], None]
Callback = Callable[[Simulation, WindowRow], bool | None]


def run_staggered(
    simulation: Simulation,
    end: float,
    callbacks: Iterable[Callback] = (),
    measures: Iterable[Measure] = (),
    begin: Callable[[Simulation], None] | None = None,
) -> None:
    """March to the time `end` [s]; after every window each callback gets the simulation and the window's row.

    The field is solved at the start and at the end of each window: a row, and what callbacks see, has the field of the
    window's end, which the next window keeps. `begin` is called once with the field of the start, unless the simulation
    is one of a checkpoint, which has its field. `measures` add their parts to the row before any callback sees it. A
    callback that returns True stops the run after this window (steady torque, interrupt).
    """
    motion = simulation.motion
    last_step = round(end / motion.dt)
    while motion.step_count < last_step:
        budget = WindowBudget(simulation)

        # 1. coil and powder -> field, which the window keeps: of the start, or of the end of the window before
        budget.clock("field")
        for effect in simulation.effects:
            effect.begin_window(simulation)
        if simulation.window == 0:
            refresh_field(simulation)
            budget.clock(None)
            if begin is not None:
                begin(simulation)
        elif simulation.magnetised is not None and simulation.source is not None:
            simulation.magnetised.sampler = simulation.source.sampler  # of a checkpoint

        window_end = min(motion.step_count + simulation.steps, last_step)
        while motion.step_count < window_end:
            simulation.lagged_steps = min(simulation.steps_per_update, window_end - motion.step_count)

            # 2. field -> moments -> lagged forces
            budget.clock("magnetic")
            if simulation.has_lagged_forces:
                motion.external_force = force = lagged_forces(simulation, budget)
                if simulation.magnetised is not None:
                    simulation.magnetised.freeze(simulation, force)

            # 3. grains and shafts, many steps
            budget.clock("contact")
            budget.add_steps(totals := motion.run(simulation.lagged_steps))
            if simulation.barostat is not None:
                budget.add_stretch(totals, follow_pressure(simulation, totals))

        # 4. coil and powder -> field at the window's end
        budget.end_steps()
        budget.clock("field")
        refresh_field(simulation)

        # 5. conservation, output, checkpoint, an early stop
        simulation.window += 1
        row = budget.close()
        for measure in measures:
            measure(simulation, row)
        # every callback is called, also after one has asked to stop
        if any([callback(simulation, row) for callback in callbacks]):
            return


def follow_pressure(simulation: Simulation, totals: StepTotals) -> float:
    """Stretch the box of grains towards its imposed pressure by the mean stress of the last steps.

    Returns the change of its volume [m^3].
    """
    motion = simulation.motion
    assert simulation.barostat is not None and motion.box is not None
    lagged_stress = 0.0 if simulation.magnetised is None else float(simulation.magnetised.lagged_stress[2, 2])
    before = motion.box.volume
    simulation.barostat.follow(motion, totals, lagged_stress)
    return motion.box.volume - before


def refresh_field(simulation: Simulation) -> None:
    """Solve the field of the present current and powder; with the moments of the grains in it, until both agree.

    Raises
    ------
    FeedbackError
        They do not agree after `MAX_SOLVES`.
    ConvergenceError
        A solve does not converge.
    """
    source, magnetised = simulation.source, simulation.magnetised
    if source is None or magnetised is None:
        return
    if not isinstance(source, SolvedCoilField) or source.feedback is None:
        source.refresh(simulation.motion.time)
        magnetised.sampler = source.sampler
        return
    feedback = source.feedback
    magnetised.sampler = source.sampler  # of a checkpoint, where nothing has changed since
    grains = simulation.motion.grains
    for solves in range(MAX_SOLVES + 1):
        feedback.deposit(grains.position, grains.volume, grains.magnetic_moment, source.solution)
        if solves == MAX_SOLVES and source.is_stale(source.solved_current):
            raise FeedbackError(feedback.residual.total, solves, source.powder_tolerance)
        if not source.refresh(simulation.motion.time):
            return
        magnetised.sampler = source.sampler
        magnetised.update(simulation)


def lagged_forces(simulation: Simulation, budget: WindowBudget) -> np.ndarray:
    """Return the sum of all effects' forces (n, 3) [N] at the present positions, with the present moments.

    A body that carries the field round takes the reaction of the torques under its name.
    """
    carrier, on_carrier = simulation.field_carrier, 0.0
    if simulation.magnetised is not None:
        simulation.magnetised.update(simulation)
    force = np.zeros_like(simulation.motion.grains.position)
    for effect in simulation.effects:
        torques = effect.add_forces(simulation, force)
        budget.add_torques(torques, effect.of_the_field)
        if carrier is not None:
            on_carrier += torques.get(carrier.name, 0.0)
    if carrier is not None:
        carrier.external_torque = -simulation.n_sectors * on_carrier
    return force


def forces_of_the_field(simulation: Simulation) -> np.ndarray | None:
    """Return the field's forces (n, 3) [N] on the grains at the last update; None before the first one.

    Near pulls are in them, which follow the gap in each step, and forces of other effects are not: the drag that is
    subtracted is that of the present velocities.
    """
    motion = simulation.motion
    force = motion.external_force if motion.attraction is None else motion.attraction.per_grain["total_force"]
    others = [effect for effect in simulation.effects if effect.has_lagged_forces and not effect.of_the_field]
    if force is None or not others:
        return force
    of_others = np.zeros_like(force)
    for effect in others:
        effect.add_forces(simulation, of_others)
    return force - of_others
