"""Knobs of the simulated powder: size of its grains, width of the sector, speed of the shear, start of the average."""

from __future__ import annotations

from typing import Any

from emclutch.knobs.knob import HISTORIES, Knob
from emclutch.knobs.magnetism import sector_width
from emclutch.scene.multiple import DIAMETERS
from emclutch.scene.start_up import start_up_strain
from emclutch.scene.units import number


def grains_across(scene) -> float:
    """Return the width of the sheared gap, in grains."""
    gap = scene.shape().sheared_gap(scene.grains.region)
    return gap.width / scene.grains.mean_diameter


class GrainsAcross(Knob):
    """Grains across the sheared gap, where they stand for finer ones."""

    name = "grains_across"
    key = "particles.diameter"
    entry = number("8", 1.0, 1000.0)
    theory = (
        "torque of a sheared layer of n grains: 1 + a/n^2 (Kamrin and Henann 2015), too large; cost n^3 with a sector "
        "of as many diameters"
    )
    order = 2.0
    finer_is_larger = True

    @classmethod
    def applies(cls, scene):
        grains = scene.grains
        return grains.real_diameter is not None and grains.diameter is not None and _is_sheared(scene)

    @classmethod
    def own(cls, scene, plan):
        return grains_across(scene)

    @classmethod
    def usual(cls, scene, plan):
        real = grains_across(scene) * scene.grains.mean_diameter / scene.grains.real_diameter
        return tuple(n for n in (4.0, 5.0, 6.0, 8.0, 12.0, 16.0) if n <= real)

    @classmethod
    def values(cls, scene, plan, setting):
        found: dict[str, Any] = {cls.key: float(f"{scene.grains.diameter * grains_across(scene) / setting:.6g}")}
        if scene.grains.sector is not None:
            found["particles.sector"] = DIAMETERS.format(f"{sector_width(scene):.4g}")
        return found

    @classmethod
    def limit(cls, scene, plan):
        return scene.grains.real_diameter / (grains_across(scene) * scene.grains.mean_diameter)


class SectorWidth(Knob):
    """Width of the cyclic sector in diameters."""

    name = "sector"
    key = "particles.sector"
    entry = number("6", 1.0, 1e6)
    theory = (
        "images of a grain repeat it: the error falls faster than any power beyond the correlation of the flow, and as "
        "1/L^2 at the least; twice the sector costs twice as much and scatters less by the root of 2"
    )
    order = 2.0
    finer_is_larger = True
    unit = "diameters"

    @classmethod
    def applies(cls, scene):
        return scene.grains.sector is not None

    @classmethod
    def own(cls, scene, plan):
        return sector_width(scene)

    @classmethod
    def usual(cls, scene, plan):
        return tuple(factor * sector_width(scene) for factor in (2.0, 4.0) if factor * scene.grains.sector < 3.0)

    @classmethod
    def values(cls, scene, plan, setting):
        return {cls.key: DIAMETERS.format(f"{setting:.4g}")}


class InertialNumber(Knob):
    """Inertial number at which the gap is sheared, where the scene leaves the speed to it."""

    name = "inertial_number"
    key = "accuracy.inertial_number"
    entry = number("0.1", 0.0, 1.0, above=True)
    theory = "friction rises with the inertial number, first order in it; steps for a strain are inverse to it"
    order = 1.0

    @classmethod
    def applies(cls, scene):
        return scene.accuracy.inertial_number is not None

    @classmethod
    def own(cls, scene, plan):
        return scene.accuracy.inertial_number

    @classmethod
    def usual(cls, scene, plan):
        own = scene.accuracy.inertial_number
        return tuple(own * factor for factor in (4.0, 2.0, 0.5) if own * factor <= 1.0)

    @classmethod
    def limit(cls, scene, plan):
        return min(plan.scaled.real, scene.accuracy.inertial_number)


class StartUp(Knob):
    """Shear strain from which on the torque is averaged."""

    name = "start_up"
    key = "time.average_from"
    entry = number("9", 0.0, 1e6, above=True)
    theory = "a torque that still starts up is too large in magnetised powder; later averages cost longer runs"
    order = None
    measured_on = HISTORIES
    finer_is_larger = True
    unit = "strain"

    @classmethod
    def applies(cls, scene):
        return _is_sheared(scene)

    @classmethod
    def own(cls, scene, plan):
        return start_up_strain(scene)

    @classmethod
    def usual(cls, scene, plan):
        return (0.5 * start_up_strain(scene), 1.5 * start_up_strain(scene))

    @classmethod
    def values(cls, scene, plan, setting):
        return {cls.key: f"strain {setting:g}"}


def _is_sheared(scene) -> bool:
    return scene.geometry.has_axis and scene.shape().sheared_gap(scene.grains.region) is not None
