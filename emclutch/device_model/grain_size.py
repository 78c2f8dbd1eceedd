"""Grains across the sheared gap, and what is known to follow for the torque where they stand for a finer powder."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from emclutch.device_model.device import Device
    from emclutch.scene.model import Scene

FINER = 0.80
"""Torque with eight grains across the gap over that with four, cases/quickstart.toml; `quickstart.finer_grains` in
docs/measured.csv."""

FINE = 16.0
"""Grains across the gap of real powders at the least: 1 mm over some 60 um."""


@dataclass(frozen=True, slots=True)
class GrainSize:
    """Coarseness of the grains of a sheared, magnetised powder.

    Attributes
    ----------
    across : float
        Mean diameters in the width of the gap [-].
    """

    across: float

    def in_words(self) -> str:
        """One line for people."""
        text = f"statistical error only; {self.across:.2g} grains across the gap"
        if self.across >= FINE:
            return f"{text}, as in real powder"
        less = 100.0 * (1.0 - FINER)
        return f"{text}: finer grains give less torque, {less:.0f} to {less + 5.0:.0f} % with twice as many"


def grain_size(scene: Scene, device: Device) -> GrainSize | None:
    """Of a scene whose gap is sheared and whose grains attract one another; None of others, such as shot."""
    if scene.effects.attraction is None or not device.shear_gap:
        return None
    return GrainSize(device.shear_gap / scene.grains.mean_diameter)
