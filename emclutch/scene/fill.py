"""Number of grains of a scene: from the mass, the solid fraction or the count to the other two.

Of grains of different sizes, as many are drawn as come nearest to the wanted volume: mass and solid fraction are met to
half a grain. Without a seed the number is the one to be expected, by their mean volume: good enough for checks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from emclutch.scene.grains import MAX_GRAINS, ParticlesSection

if TYPE_CHECKING:
    from geometry.device_shape import DeviceShape


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


def fill_of(shape: DeviceShape, particles: ParticlesSection, seed: int | None = None) -> Fill:
    """Work out the amount of powder; the count is whole, mass and fraction follow from it."""
    volume = shape.volume_to_fill(particles.region)
    count, simulated = _simulated(particles, volume, seed)
    grains_volume = simulated * particles.n_sectors
    inner_radius = min((box.r0 for box in shape.boxes_to_fill(particles.region)), default=0.0)
    return Fill(volume, count, grains_volume * particles.density, grains_volume / volume, inner_radius)


def diameters_of(particles: ParticlesSection, count: int, seed: int) -> np.ndarray:
    """Diameters [m] of the `count` grains that `fill_of` found with the same seed, shape (count,)."""
    if particles.packing == "file":
        return 2.0 * particles.packing_in_file().radius
    return particles.distribution().draw(count, seed)


def grains_volume(particles: ParticlesSection, seed: int | None) -> float:
    """Volume [m^3] of the ``count`` grains of a scene; without a seed the one to be expected."""
    return _volume(particles, particles.count or 0, seed)


def _volume(particles: ParticlesSection, count: int, seed: int | None) -> float:
    if particles.sizes is None or seed is None or count > MAX_GRAINS:  # too many are refused and need not be drawn
        return count * particles.grain_volume
    return float(math.pi / 6.0 * (diameters_of(particles, count, seed) ** 3).sum())


def _simulated(particles: ParticlesSection, volume: float, seed: int | None) -> tuple[int, float]:
    """Number and volume [m^3] of the grains of one sector in a region of ``volume`` [m^3]."""
    if particles.packing == "file":
        radius = particles.packing_in_file().radius
        return len(radius), float(4.0 / 3.0 * math.pi * (radius**3).sum())
    grain = particles.grain_volume
    if particles.count is not None:
        count = particles.count
    else:
        wanted = (particles.solid_fraction or 0.0) * volume
        if particles.mass is not None:
            wanted = particles.mass / particles.density
        count = round(wanted / grain / particles.n_sectors)
        # what is far too much is refused by its mean: it need not be drawn
        if particles.sizes is not None and seed is not None and wanted <= volume and count <= MAX_GRAINS:
            count = len(particles.distribution().draw_volume(wanted / particles.n_sectors, seed))
    return count, _volume(particles, count, seed)
