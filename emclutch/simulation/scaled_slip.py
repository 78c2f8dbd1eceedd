"""The slip of a run: that of its scene, or one of an inertial number; with it times that the scene has as shear strain.

At a small inertial number (`particles.diagnostics.inertial_number`) powder is quasi-static: its stress does not depend
on the rate. Its gap may then be sheared at another speed, and where that is set by the inertial number smaller grains
are sheared faster, so that the steps that a strain takes do not grow with 1/d.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from emclutch.device_model.decision import Decision
from emclutch.device_model.device import Device
from emclutch.results.quantity import RPM
from emclutch.scene.scaled import Scaled
from emclutch.scene.timing import instant_in_words, not_before
from geometry.time_profile import TimeProfile
from particles.diagnostics.inertial_number import inertial_number

if TYPE_CHECKING:
    from emclutch.scene.model import Scene
    from field import MagneticField
    from field.three_d import Field3D

QUASI_STATIC = 0.12
"""Inertial number up to which the torque does not depend on the slip: that of both shipped clutches is the same within
2 % from 0.02 to 0.13, and 3 % higher at 0.26 and 0.36 (docs/explanation/brake.md)."""

NEGLIGIBLE = 0.1
"""Of the magnetic pressure: what weight, or centrifugal force, may add to it."""


@dataclass(frozen=True, slots=True)
class ScaledSlip:
    """Speeds of a run that are those of its scene times a factor.

    Attributes
    ----------
    factor : float
        Speeds of the run over those of the scene [-].
    inertial_number : float
        That is asked for [-], by the expected magnetic pressure; at the scene's own speeds `own`.
    own : float
        [-]
    real : float
        That of the powder that the grains stand for, at the scene's speeds [-].
    speeds : dict of str to float
        Of the scene's shafts [rad/s], those that turn.
    centrifugal : float
        Pressure of the powder in the gap by centrifugal force at the run's speeds, over the magnetic one [-].
    """

    factor: float
    inertial_number: float
    own: float
    real: float
    speeds: dict[str, float]
    centrifugal: float

    def in_words(self) -> str:
        """Return one line for people, with warnings."""
        text = f"{self.note()}. Slip power and heat of the run are {self.factor:.3g} times those of the device"
        return Decision(text, *self.warnings())

    def note(self) -> str:
        """Return what was scaled."""
        turned = " and ".join(
            f"{name} turned at {_rpm(self.factor * speed)} instead of {_rpm(speed)}"
            for name, speed in self.speeds.items()
        )
        return f"{turned}. Inertial number: {self.inertial_number:.2g} requested, {self.own:.2g} at the scene's speeds"

    def warnings(self) -> list[str]:
        """Return why the torque may be another one than at the scene's speeds."""
        found = []
        if self.inertial_number > QUASI_STATIC:
            found.append(
                f"above an inertial number of {QUASI_STATIC:g} the torque depends on the slip: lower "
                "accuracy.inertial_number"
            )
        if self.real > QUASI_STATIC:
            found.append(
                f"at the scene's speeds the real powder has an inertial number of {self.real:.2g}, and above "
                f"{QUASI_STATIC:g} its torque is not that of a slower run: remove accuracy.inertial_number"
            )
        if self.centrifugal > NEGLIGIBLE:
            found.append(
                f"at these speeds centrifugal force adds {self.centrifugal:.2g} of the magnetic pressure: lower "
                "accuracy.inertial_number"
            )
        return found

    def as_dict(self) -> dict[str, Any]:
        """Return the entries of ``summary.json``."""
        found = {
            "factor": self.factor,
            "inertial_number": self.inertial_number,
            "own_inertial_number": self.own,
            "note": self.note(),
        }
        return found | ({"warnings": warnings} if (warnings := self.warnings()) else {})

    def had(self, inertial_number: float | None, pressure: str) -> dict[str, Any]:
        """Return entries of the summary of a finished run that had an inertial number, by a pressure in words."""
        if inertial_number is None:
            return {}
        note = f"{self.note()}, {inertial_number:.2g} in the run ({pressure} pressure)"
        found: dict[str, Any] = {"inertial_number_of_the_run": inertial_number, "note": note}
        if inertial_number > QUASI_STATIC >= self.inertial_number:
            text = f"the run had an inertial number of {inertial_number:.2g}, and above {QUASI_STATIC:g} the torque "
            found["warnings"] = [*self.warnings(), f"{text}depends on the slip: lower accuracy.inertial_number"]
        return found


def _rpm(speed: float) -> str:
    return f"{RPM * speed:.4g} rpm"


def strain_rate(scene: Scene, device: Device) -> float:
    """Return the largest shear rate of the gap, or of the periodic box [1/s]; 0 where nothing is sheared."""
    rate = device.kind.rate(scene)
    if rate is not None:
        return rate
    return scene.motion.largest_slip * device.shear_radius / device.shear_gap if device.shear_gap else 0.0


def with_slip(scene: Scene, device: Device, field: MagneticField | Field3D | None) -> tuple[Scene, ScaledSlip | None]:
    """Return the scene with the speeds of its run, and its times in seconds; and how the speeds were scaled.

    `field` is the solution at the largest current with the powder spread evenly.

    Raises
    ------
    ValueError
        `accuracy.inertial_number` is asked for without a magnetic pressure, or with a weight that counts beside it; the
        averaging begins after the end.
    """
    scaled = _scaled_slip(scene, device, field)
    if scaled is not None:
        motion = {
            name: getattr(scene.motion, name).model_copy(update={"speed": TimeProfile.constant(scaled.factor * speed)})
            for name, speed in scaled.speeds.items()
        }
        scene = scene.model_copy(update={"motion": scene.motion.model_copy(update=motion)})
    span, rate = scene.span, strain_rate(scene, device)
    strains = {
        name: given.value / rate for name in ("end", "average_from") if isinstance(given := getattr(span, name), Scaled)
    }
    if not strains:
        return scene, scaled
    times = span.model_copy(update=strains)
    if span.average_from is not None and not_before(times.average_time, times.end_time):
        raise ValueError(
            f"time.average_from = {instant_in_words(span.average_from)} is not before time.end = "
            f"{instant_in_words(span.end)}: {times.average_time:.4g} and {times.end_time:.4g} s at a shear rate of "
            f"{rate:.4g} 1/s; lower it, or raise the end"
        )
    return scene.model_copy(update={"time": times}), scaled


def _scaled_slip(scene: Scene, device: Device, field: MagneticField | Field3D | None) -> ScaledSlip | None:
    wanted = scene.accuracy.inertial_number
    if wanted is None:
        return None
    from emclutch.simulation.forecast.expected_torque import expected_pressure  # local: most runs do not need it

    pressure = expected_pressure(scene, device, field)
    if pressure == 0.0:
        raise ValueError(
            f"accuracy.inertial_number = {wanted:g} needs a pressure, and no field magnetises the powder; give the "
            "coil a current, or remove accuracy.inertial_number"
        )
    grains, weight, density = scene.grains, scene.effects.weight, scene.grains.density * device.fill.solid_fraction
    if weight is not None and density * weight.acceleration * device.shape.bed_height > NEGLIGIBLE * pressure:
        raise ValueError(
            f"accuracy.inertial_number = {wanted:g} is of the magnetic pressure, {pressure:.2g} Pa, and weight adds "
            f"more than {NEGLIGIBLE:g} of it; remove [effects.gravity] or accuracy.inertial_number"
        )
    own = float(inertial_number(strain_rate(scene, device), grains.mean_diameter, grains.density, pressure))
    speeds = {name: getattr(scene.motion, name).speed.values[0] for name in ("rotor", "disc")}
    fastest = wanted / own * max(map(abs, speeds.values()))
    return ScaledSlip(
        wanted / own,
        wanted,
        own,
        own * (grains.real_diameter or grains.mean_diameter) / grains.mean_diameter,
        {name: speed for name, speed in speeds.items() if speed},
        density * fastest**2 * device.shear_radius * device.shear_gap / pressure,
    )
