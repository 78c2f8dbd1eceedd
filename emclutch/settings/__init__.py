"""Numerical settings that trade time for accuracy, each with its key, its theory and its values (`Setting`).

To add one: a `Setting` in a module here and its place in `emclutch.settings.values_section.SETTINGS`. Then `emclutch
accuracy` measures it, runs report its error, and `accuracy.values` takes its values.
"""

from __future__ import annotations

from emclutch.settings.setting import FROZEN, HISTORIES, TORQUE, Setting
from emclutch.settings.values_section import SETTINGS

UNITS = {one.name: one.unit for one in SETTINGS}


def settings_of(scene) -> tuple[Setting, ...]:
    """Return the settings that a scene of grains has."""
    return tuple(one for one in SETTINGS if one.applies(scene))


__all__ = ["FROZEN", "HISTORIES", "SETTINGS", "TORQUE", "UNITS", "Setting", "settings_of"]
