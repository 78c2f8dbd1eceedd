"""[effects.saturation]: the grains' magnetisation saturates; without it M is linear in H."""

from __future__ import annotations

from collections.abc import Iterator
from typing import ClassVar

from emclutch.effects.effect import EffectSection
from emclutch.effects.left_out import OFF, LeftOut
from emclutch.scene.draft import Draft
from emclutch.scene.errors import Fault


def _acts_on_moments(draft: Draft) -> Iterator[Fault]:
    """Saturation needs magnetised grains."""
    effects = draft.scene.effects
    if effects.saturate and not effects.magnetise and not draft.is_of_the_field_alone:
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
    def left_out(cls, at):
        """Yield the largest magnetisation over that of saturation."""
        if at.M > 0.0:
            yield LeftOut(cls.name, OFF, "largest magnetisation over saturation", at.saturation, 0.1)
