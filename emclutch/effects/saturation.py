"""[effects.saturation]: the grains' magnetisation saturates; without it M is linear in H."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from emclutch.effects.effect import EffectSection
from emclutch.effects.omitted_effect import OFF, OmittedEffect
from emclutch.scene.errors import Fault
from emclutch.scene.partial_scene import PartialScene


def _acts_on_moments(partial: PartialScene) -> Iterator[Fault]:
    """Saturation needs magnetised grains."""
    effects = partial.scene.effects
    if effects.saturate and not effects.magnetise and not partial.is_of_the_field_alone:
        yield Fault(
            "effects.saturation",
            "",
            f"needs magnetised grains; add {effects.tables(needs_moments=True)}, or remove the effect's table",
        )


class SaturationSection(EffectSection):
    """Grains saturate; without it their law is linear."""

    name = "saturation"
    summary = "grains saturate"
    saturates = True
    CHECKS: ClassVar = ((_acts_on_moments, ("effects",)),)

    @classmethod
    def omitted_effects(cls, at):
        """Yield the largest magnetisation over that of saturation."""
        if at.M > 0.0:
            yield OmittedEffect(cls.name, OFF, "largest magnetisation over saturation", at.saturation, 0.1)
