"""Shear strain that powders need before their torque is steady, by the kind of scene.

The mean over many replicas is what shows a start-up: in one run it drowns in fluctuations. Strain is slip times mean
radius over the width of the gap, integrated over time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from emclutch.scene.model import Scene

MAGNETISED_POWDER = 9.0
"""Quickstart with an earlier contact model, 48 replicas, torque over the final one: 1.11 at a strain of 1 to 2, 1.06 at
3 to 4, 1.03 at 4 to 6, 1.02 at 7 to 8, then 1.00 +- 0.01."""

OTHER = 5.0
"""Grains that do not attract each other: not measured; hard grains forget their initial packing in a few units."""


def start_up_strain(scene: Scene) -> float:
    """Shear strain of the gap [-] before which no torque of a scene is averaged."""
    return MAGNETISED_POWDER if scene.effects.magnetise else OTHER
