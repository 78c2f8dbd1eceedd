"""How many steps, force updates and coupling windows a run is divided into."""

from __future__ import annotations

from math import ceil, floor

import numpy as np

MOST_STEPS = 1e12
"""Of a run: one grain alone takes a week for them."""


def parts_of(duration: float, part: float) -> int:
    """How many parts [s] reach the end of a duration [s]; round-off of their quotient adds none."""
    return max(1, ceil(duration / part - 1e-9))


def coupling_windows(
    scene, dt: float, speed: float, between_layers: float, magnetic: bool, reasons: dict[str, str]
) -> tuple[int, int, int]:
    """Steps a force update, updates a window and windows of the run; speeds of the walls and of layers [m/s]."""
    d = scene.particles.smallest_diameter
    if scene.time.end / dt > MOST_STEPS:
        raise ValueError(
            f"time.end = {scene.time.end:.3g} s is {scene.time.end / dt:.2g} steps of {dt:.2g} s; allowed: at most "
            f"{MOST_STEPS:.0e}, which take months; lower it, raise particles.diameter or contact.max_overlap, or check "
            "the units of what the step follows from"
        )
    end_steps = parts_of(scene.time.end, dt)
    per_update = 1
    if magnetic:
        asked = scene.effects.dipoles.update_every if scene.effects.dipoles is not None else None
        rigid = scene.contact.method == "dvi"  # its step follows the forces themselves
        # near pulls follow every step (`coupling.near_attraction`): what is held then changes with the places of layers
        followed = scene.effects.dipoles is not None and scene.effects.dipoles.model == "near_field" and not rigid
        moved, contacts = (between_layers, 2.0) if followed else (speed, 0.5)
        travel = 0.01 * d / (moved * dt) if moved > 0.0 else np.inf
        per_update = asked or (1 if rigid else max(1, floor(min(travel, contacts * scene.time.steps_per_contact))))
        every = f"evaluated every {per_update} steps" if per_update > 1 else "evaluated every step"
        why = ": half a contact, 1 % of a diameter of travel"
        if followed:
            why = ", near pulls every step: at most two contacts, neighbours 1 % of a diameter further"
        why = "" if rigid else why
        reasons["magnetic forces"] = every + (" as asked" if asked else why)
    if scene.time.window is not None:
        steps = max(1, round(scene.time.window / dt))
    else:
        # a quarter of a diameter of shear, but enough windows for a mean with an error bar
        travel = 0.25 * d / (speed * dt) if speed > 0.0 else np.inf
        steps = max(1, floor(min(travel, end_steps / 200, 5000)))
    if not magnetic:
        per_update, updates = steps, 1
    else:
        updates = max(1, round(steps / per_update))
    windows = parts_of(scene.time.end, per_update * updates * dt)
    reasons["coupling window"] = (
        f"{per_update * updates} steps = {per_update * updates * dt:.3g} s, "
        f"{windows} windows to t = {windows * per_update * updates * dt:.4g} s"
    )
    return per_update, updates, windows
