"""How many grains a scene has: from the mass, the solid fraction or the count to the other two."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

from emclutch.scene.grains import Particles

if TYPE_CHECKING:
    from geometry import AnnularBox, Box, Clutch, ShearCell
    from geometry.cad_shape import CadShape

_REGIONS = {
    "cavity": ("rim", "face_left", "face_right"),
    "rim": ("rim",),
    "faces": ("face_left", "face_right"),
}


@dataclass(frozen=True, slots=True)
class Fill:
    """Amount of powder in a scene.

    Attributes
    ----------
    volume : volume of the filled region in the whole device [m^3]
    count : number of simulated grains, those of one sector where there is one
    mass : mass of powder in the whole device as simulated, ``count`` times the sectors [kg]
    solid_fraction : volume of the grains / volume of the region
    inner_radius : smallest radius of the region [m]; 0 in a box
    """

    volume: float
    count: int
    mass: float
    solid_fraction: float
    inner_radius: float


def boxes_to_fill(shape: Clutch | CadShape | ShearCell | Box, region: str) -> list[AnnularBox]:
    """Return the annular boxes of a region; none for a plain box, which is filled as a whole."""
    from geometry import Box, Clutch

    if isinstance(shape, Box):
        return []
    boxes = shape.fill_boxes()
    return [boxes[name] for name in _REGIONS[region]] if isinstance(shape, Clutch) else list(boxes.values())


def fill_of(shape: Clutch | CadShape | ShearCell | Box, particles: Particles) -> Fill:
    """Work out the amount of powder; the count is whole, mass and fraction follow from it."""
    from geometry import Box

    boxes = boxes_to_fill(shape, particles.region)
    volume = shape.volume if isinstance(shape, Box) else sum(box.volume() for box in boxes)
    grain, sectors = particles.grain_volume, particles.n_sectors
    if particles.count is not None:
        count = particles.count
    else:
        grains_volume = (particles.solid_fraction or 0.0) * volume
        if particles.mass is not None:
            grains_volume = particles.mass / particles.density
        count = round(grains_volume / grain / sectors)
    grains_volume = count * sectors * grain
    inner_radius = min((box.r0 for box in boxes), default=0.0)
    return Fill(volume, count, grains_volume * particles.density, grains_volume / volume, inner_radius)
