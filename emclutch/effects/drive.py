"""Shared by effects on the coil's drive: state at the start, need of a coil, time of switching."""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from emclutch.effects.effect import EffectSection
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.results.columns import Column, When
from emclutch.scene.errors import Fault
from emclutch.scene.partial_scene import PartialScene
from emclutch.scene.units import format_number

if TYPE_CHECKING:
    from emclutch.simulation.forecast.regime import Regime

BEGINNING = ("off", "steady")

COIL_SUPPLIED = Column("coil_supplied", "J", "energy from the supply of the coil", When.SUM)
COPPER_LOSS = Column("copper_loss", "J", "part of coil_supplied that heats the winding", When.SUM)
ENERGY_COLUMNS = (COIL_SUPPLIED, COPPER_LOSS)


def need_of_a_coil(partial: PartialScene, effect: type[EffectSection]) -> Iterator[Fault]:
    """Yield a fault where the effect has no field of a coil to act on, or nothing feels that field."""
    effects = partial.scene.effects
    if effect.name not in effects.active or partial.is_of_the_field_alone:
        return
    if partial.scene.coil_field is None or not effects.magnetise:
        yield Fault(
            f"effects.{effect.name}",
            "",
            "needs the field of a coil, and an effect that uses this field; take [field] source = 'coil' with "
            f"{effects.tables(needs_moments=True)}, or remove the effect's table",
        )


def switching_omitted(at: Regime, name: str, number: str, time: float | None) -> Iterator[OmittedEffect]:
    """Yield a time constant [s] over the shortest time in which the drive changes."""
    if not at.solved or at.M == 0.0:
        return
    text = number if time is None else f"{number}, {format_number(time)} s,"
    if at.switching_time is None:
        note = "the current is constant"
        yield OmittedEffect(name, OFF, f"{text} divided by the switching time", 0.0, 0.1, note=note, change=None)
    else:
        ratio = None if time is None else time / at.switching_time
        yield OmittedEffect(name, OFF, f"{text} divided by the switching time", ratio, 0.1, change=None)
