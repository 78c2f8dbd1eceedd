"""Shear strain that powders need before their torque is steady, by the kind of scene.

The mean over many packings is what shows a start-up: in one run it drowns in fluctuations. Strain is slip times mean
radius over the width of the gap, integrated over time.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from emclutch.scene.model import Scene

MAGNETISED_POWDER = 9.0
"""Quickstart. 48 packings: 0.97 N m at a strain of 1 to 2, 0.93 at 3 to 4, 0.90 at 4 to 6, 0.89 at 7 to 8, then 0.87 to
0.88. 32 other packings: docs/explanation/torque_error.md."""

RUN_IN = 3.0
"""Of such powder between pole faces that begins in shear (`particles.initial_velocity`). The brake of
cases/powder_clutch.toml with 8 to 16 grains across the gap, over its mean from a strain of 3 to 7: 0.96 at a strain of
0.5 to 1, 0.98 from there to 3 (docs/explanation/brake.md). What still creeps after that is the verdict's matter."""

OTHER = 5.0
"""Grains that do not attract each other: not measured; packings of hard grains forget their making in a few units."""


def start_up_strain(scene: Scene) -> float:
    """Shear strain of the gap [-] before which no torque of a scene is averaged."""
    if not scene.effects.magnetise:
        return OTHER
    grains = scene.grains
    return RUN_IN if grains.region == "poles" and grains.initial_velocity == "sheared" else MAGNETISED_POWDER
