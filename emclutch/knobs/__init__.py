"""Numerical settings that trade time for accuracy, each with its key, its theory and its ladder (`Knob`).

To add one: a class in a module here and its place in `emclutch.knobs.ladders_section.KNOBS`. `emclutch accuracy` then
measures it, runs tell its error, and `accuracy.ladders` takes its settings.
"""

from __future__ import annotations

from emclutch.knobs.knob import FROZEN, HISTORIES, TORQUE, Knob
from emclutch.knobs.ladders_section import KNOBS


def knobs_of(scene) -> tuple[type[Knob], ...]:
    """Return the knobs that a scene of grains has."""
    return tuple(one for one in KNOBS if one.applies(scene))


__all__ = ["FROZEN", "HISTORIES", "KNOBS", "TORQUE", "Knob", "knobs_of"]
