"""Division of a run into steps, force updates and coupling windows."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum, auto
from math import ceil, floor

import numpy as np

MAX_STEPS = 1e12
"""Of a run: at 170 ns a step one grain alone takes two days."""

RIGID_SHIFT, RIGID_PARTING = 0.025, 0.5
"""Of a diameter, and of the time in which grains part: what moments of rigid grains are held for.

quickstart, forces at the end of the interval against those of new moments, root mean square, and their pull across the
gap (2026-11-26): 0.8 % and 0.04 % after one step of 1.51 us, a tenth of that time, 2.7 % and 0.1 % after four, 5.4 %
and 0.2 % after eight, 11 % and 0.9 % after sixteen; in the mean over the interval half of it.
"""


class UpdateRule(Enum):
    """Rule for the interval between evaluations of held forces."""

    ASKED = auto()
    EVERY_STEP = auto()  # the step of rigid grains follows the forces themselves
    PRESSURE_EVERY_STEP = auto()  # the box follows it after each of them
    CONTACT = auto()  # half a contact, or 1 % of a diameter of travel
    PRESSURE = auto()  # the box follows it twice a contact
    NEIGHBOURS = auto()  # near pulls follow every step; 2.5 contacts, or neighbours 1 % of a diameter further
    PARTING = auto()  # the same of rigid grains; half of the time in which they part, or neighbours 2.5 % further


@dataclass(frozen=True, slots=True)
class Windows:
    """The parts of a run.

    Attributes
    ----------
    dt : float
        Step of the grains [s].
    steps_per_update : int
        Steps between evaluations of the held forces.
    updates : int
        Evaluations in a window.
    count : int
        Windows of the run.
    rule : UpdateRule or None
        What decides the steps an update; None without held forces.
    """

    dt: float
    steps_per_update: int
    updates: int
    count: int
    rule: UpdateRule | None

    @property
    def steps(self) -> int:
        """Of a window."""
        return self.steps_per_update * self.updates

    @property
    def end(self) -> float:
        """Time at the end of the last one [s]."""
        return self.count * self.updates * self.steps_per_update * self.dt


def parts_of(duration: float, part: float) -> int:
    """Return the number of parts [s] reach the end of a duration [s]; round-off of their quotient adds none."""
    return max(1, ceil(duration / part - 1e-9))


def coupling_windows(
    scene, dt: float, speed: float, between_layers: float, held: bool, parting: float | None = None
) -> Windows:
    """Return the windows of a scene with a step [s]; largest speeds of the walls, and between layers of grains [m/s].

    `held`: whether effects hold forces, which are evaluated several times a window. `parting`: the time [s] in which
    magnetised rigid grains part (`particles.dvi.dvi_step.parting_time`); None where none attract each other.
    """
    end = scene.time.end_time
    if end / dt > MAX_STEPS:
        raise ValueError(
            f"time.end = {end:.3g} s is {end / dt:.2g} steps of {dt:.2g} s; allowed: at most {MAX_STEPS:.0e}, which "
            "take days to years; lower it, raise particles.diameter or contact.max_overlap, or check the units of what "
            "the step follows from"
        )
    if scene.time.window is not None:
        steps = max(1, round(scene.time.window / dt))
    else:
        # a quarter of a diameter of shear, but enough windows for a mean with an error bar
        travel = 0.25 * scene.particles.smallest_diameter / (speed * dt) if speed > 0.0 else np.inf
        steps = max(1, floor(min(travel, parts_of(end, dt) / 200, 5000)))
    if held or scene.geometry.barostat(scene) is not None:
        per_update, rule = _steps_per_update(scene, dt, speed, between_layers, parting)
        updates = max(1, round(steps / per_update))
    else:
        per_update, updates, rule = steps, 1, None
    return Windows(dt, per_update, updates, parts_of(end, per_update * updates * dt), rule)


def _steps_per_update(
    scene, dt: float, speed: float, between_layers: float, parting: float | None
) -> tuple[int, UpdateRule]:
    """Return the steps between evaluations of the held forces, and what decides them."""
    attraction, rigid = scene.effects.attraction, scene.contact.method == "dvi"
    if attraction is not None and attraction.update_every:
        return attraction.update_every, UpdateRule.ASKED
    # near pulls follow every step (`coupling.near_attraction`): what is held then changes with the places of layers
    followed = attraction is not None and attraction.has_necks
    if rigid and not (followed and parting is not None):
        return 1, UpdateRule.EVERY_STEP if scene.effects.hold_forces else UpdateRule.PRESSURE_EVERY_STEP
    if not scene.effects.hold_forces:
        return max(1, floor(0.5 * scene.time.steps_per_contact)), UpdateRule.PRESSURE
    if rigid and parting is not None:
        moved, share, longest, rule = between_layers, RIGID_SHIFT, RIGID_PARTING * parting / dt, UpdateRule.PARTING
    elif followed:
        moved, share, longest, rule = between_layers, 0.01, 2.5 * scene.time.steps_per_contact, UpdateRule.NEIGHBOURS
    else:
        moved, share, longest, rule = speed, 0.01, 0.5 * scene.time.steps_per_contact, UpdateRule.CONTACT
    travel = share * scene.particles.smallest_diameter / (moved * dt) if moved > 0.0 else np.inf
    return max(1, floor(min(travel, longest) + 1e-9)), rule
