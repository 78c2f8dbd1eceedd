"""Division of a run into steps, force updates and coupling windows."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from itertools import pairwise
from math import ceil, floor

import numpy as np

MAX_STEPS = 1e12
"""Of a run: at 170 ns a step one grain alone takes two days."""

MIN_WINDOWS = 200
"""Of a run with an automatic window: enough for a mean with an error bar."""

PER_CHANGE, JUMP = 10, 0.1
"""Automatic windows in each change of the coil's table, and in the time constant of its circuit; a change that is
shorter than this fraction of a usual window is a jump, for which no window is made shorter."""

RIGID_SHIFT, RIGID_PARTING = 0.025, 0.5
"""Of a diameter, and of the time in which grains part: what moments of rigid grains are held for.

quickstart, forces at the end of the interval against those of new moments, root mean square, and their pull across the
gap (2026-11-26): 0.8 % and 0.04 % after one step of 1.51 us, a tenth of that time, 2.7 % and 0.1 % after four, 5.4 %
and 0.2 % after eight, 11 % and 0.9 % after sixteen; in the mean over the interval half of it.
"""


class UpdateRule(Enum):
    """Rule for the interval between evaluations of lagged forces."""

    ASKED = auto()
    EVERY_STEP = auto()  # the step of rigid grains follows the forces themselves
    PRESSURE_EVERY_STEP = auto()  # the box follows it after each of them
    CONTACT = auto()  # half a contact, or 1 % of a diameter of travel
    PRESSURE = auto()  # the box follows it twice a contact
    NEIGHBOURS = auto()  # near pulls follow every step; 2.5 contacts, or neighbours 1 % of a diameter further
    WINDOW = auto()  # once a window that is given, where the other rules allow a longer interval
    PARTING = auto()  # the same of rigid grains; half of the time in which they part, or neighbours 2.5 % further


@dataclass(frozen=True, slots=True)
class Windows:
    """The parts of a run.

    Attributes
    ----------
    dt : float
        Step of the grains [s].
    steps_per_update : int
        Steps between evaluations of the lagged forces; the last interval of a window may be shorter.
    steps : int
        Of a window.
    count : int
        Windows of the run.
    rule : UpdateRule or None
        What decides the steps an update; None without lagged forces.
    jump : float or None
        Shortest change of the coil's table, or time constant of its circuit, that is shorter than a window [s].
    """

    dt: float
    steps_per_update: int
    steps: int
    count: int
    rule: UpdateRule | None
    jump: float | None = None

    @property
    def updates(self) -> int:
        """Evaluations in a window."""
        return ceil(self.steps / self.steps_per_update)

    @property
    def length(self) -> float:
        """Of a window [s]."""
        return self.steps * self.dt

    @property
    def end(self) -> float:
        """Time at the end of the last one [s]."""
        return self.count * self.steps * self.dt


def whole_parts(duration: float, part: float) -> int:
    """Return how many whole parts [s] a duration [s] has, at least 1; round-off of their quotient takes none away."""
    return max(1, floor(duration / part * (1.0 + 1e-12) + 1e-9))


def coupling_windows(
    scene, dt: float, speed: float, between_layers: float, held: bool, parting: float | None = None,
    time_constant: float | None = None,
) -> Windows:  # fmt: skip
    """Return the windows of a scene with a step [s]; largest speeds of the walls, and between layers of grains [m/s].

    None is longer than `time.window`, and none goes beyond `time.end`: the run ends within a window before it.

    `held`: whether effects hold forces, which are evaluated several times a window. `parting`: the time [s] in which
    magnetised rigid grains part (`particles.dvi.dvi_step.parting_time`); None where none attract each other.
    `time_constant`: of a coil whose circuit is simulated [s]; None: there is none.
    """
    end, window = scene.time.end_time, scene.time.window
    if end / dt > MAX_STEPS:
        raise ValueError(
            f"time.end = {end:.3g} s is {end / dt:.2g} steps of {dt:.2g} s; allowed: at most {MAX_STEPS:.0e}, which "
            "take days to years; lower it, raise particles.diameter or contact.max_overlap, or check the units of what "
            "the step follows from"
        )
    total, changes = whole_parts(end, dt), _changes_of_the_coil(scene, end)
    if time_constant is not None:
        changes.append(time_constant)
    if window is not None:
        steps = min(total, whole_parts(window, dt))
    else:
        # a quarter of a diameter of shear, but enough windows for a mean with an error bar and for each frame
        travel = 0.25 * scene.particles.smallest_diameter / (speed * dt) if speed > 0.0 else np.inf
        steps = max(1, floor(min(travel, total / max(MIN_WINDOWS, scene.output.snapshots), 5000)))
        slow = [time for time in changes if time >= JUMP * steps * dt]
        steps = max(1, floor(min((steps, *(time / (PER_CHANGE * dt) for time in slow)))))
    per_update, rule = steps, None
    if held or scene.geometry.barostat(scene) is not None:
        per_update, rule = _steps_per_update(scene, dt, speed, between_layers, parting)
        if window is None:
            steps = min(total, max(1, round(steps / per_update)) * per_update)
        elif per_update > steps:
            per_update, rule = _update_of_a_window(scene, dt, per_update, steps, rule)
    jump = min((time for time in changes if time < steps * dt), default=None)
    return Windows(dt, per_update, steps, whole_parts(end, steps * dt), rule, jump)


def _changes_of_the_coil(scene, end: float) -> list[float]:
    """Durations [s] of the stretches of the coil's table up to `end` [s] in which its current or voltage changes."""
    coil = scene.coil
    profiles = [] if coil is None else [one for one in (coil.current, coil.voltage) if one is not None]
    return [
        later - earlier
        for one in profiles
        for (earlier, before), (later, after) in pairwise(zip(one.times, one.values, strict=True))
        if before != after and earlier < end
    ]


def _update_of_a_window(scene, dt: float, per_update: int, steps: int, rule: UpdateRule) -> tuple[int, UpdateRule]:
    """Return the steps between evaluations, and their rule, where so many do not fit into the steps of `time.window`.

    ValueError where the scene gives both.
    """
    if rule is UpdateRule.ASKED:
        key = f"effects.{scene.effects.attraction.name}.update_every"
        raise ValueError(
            f"{key} = {per_update} steps of {dt:.3g} s is longer than time.window = {scene.time.window:.3g} s; "
            f"allowed: at most {steps} steps; lower it, or raise time.window"
        )
    return steps, UpdateRule.WINDOW


def _steps_per_update(
    scene, dt: float, speed: float, between_layers: float, parting: float | None
) -> tuple[int, UpdateRule]:
    """Return the steps between evaluations of the lagged forces, and what decides them."""
    attraction, rigid = scene.effects.attraction, scene.contact.method == "dvi"
    if attraction is not None and attraction.update_every:
        return attraction.update_every, UpdateRule.ASKED
    # near pulls follow every step (`coupling.near_attraction`): what is held then changes with the places of layers
    followed = attraction is not None and attraction.has_necks
    if rigid and not (followed and parting is not None):
        return 1, UpdateRule.EVERY_STEP if scene.effects.have_lagged_forces else UpdateRule.PRESSURE_EVERY_STEP
    if not scene.effects.have_lagged_forces:
        return max(1, floor(0.5 * scene.time.steps_per_contact)), UpdateRule.PRESSURE
    if rigid and parting is not None:
        moved, share, longest, rule = between_layers, RIGID_SHIFT, RIGID_PARTING * parting / dt, UpdateRule.PARTING
    elif followed:
        moved, share, longest, rule = between_layers, 0.01, 2.5 * scene.time.steps_per_contact, UpdateRule.NEIGHBOURS
    else:
        moved, share, longest, rule = speed, 0.01, 0.5 * scene.time.steps_per_contact, UpdateRule.CONTACT
    travel = share * scene.particles.smallest_diameter / (moved * dt) if moved > 0.0 else np.inf
    return max(1, floor(min(travel, longest) + 1e-9)), rule
