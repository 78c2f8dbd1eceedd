"""The expected torque of a device, before a grain has moved: its powder's law on the field of its coil.

Magnetised powder that is sheared across a field yields at a stress tau(B, phi). The torque of a gap of width g is the
mean over the cylinders (or planes) that it may be sheared on,

    T = (1/g) integral of tau(B_n, phi) r dV,

B_n the flux density across the gap at the largest current, from a solve in which the powder has the permeability of its
law (`emclutch.simulation.forecast.powder_law`). Powder that was filled between pole faces to phi_0 stands out beyond
their edges and has phi there (`fill_between_poles`). The torque is that of the real powder, with its grains per gap and
its inertial number; that of the scene's own grains is found beside it, which a run has without a correction.

Runs of whole devices have `RUNS_OVER_LAW` times this torque, and differ from it by `DEVICES` (standard deviation),
measured by devices and powders that no law was fitted to (docs/explanation/two_scales.md). Where a scene is outside of
what the law was measured for, the same formula is a guess within a factor of `GUESS`, and says why. Dipoles without
necks (`model = "mutual"`) have at most the stress of straight chains of touching point dipoles m = M V along the field,
strained by gamma (Jolly, Carlson and Munoz, Smart Mater. Struct. 5 (1996) 607), tau = phi mu_0 M^2 max of
gamma (4 - gamma^2)/(8 (1 + gamma^2)^(7/2)) = 0.114 phi mu_0 M^2. Without magnetism there is Coulomb friction of weight
and centrifugal force.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from dataclasses import field as dataclass_field
from functools import cached_property
from math import exp, log, sqrt
from typing import Any

import numpy as np

from coupling.expected_load import chain_magnetisation
from coupling.powder_pressure import magnetic_pressure
from emclutch.device_model.device import CoilDevice, Device
from emclutch.device_model.materials import grain_law, saturation_of
from emclutch.device_model.pole_zone import ACROSS, ALONG
from emclutch.results.fits import NORMAL
from emclutch.results.report.report import sentence
from emclutch.results.text import format_range
from emclutch.simulation.forecast.expected_field import field_of_sheared_powder
from emclutch.simulation.forecast.powder_law import RANGES, PowderLaw, law_of, shipped_laws
from field import MU_0, ConvergenceError, MagneticField, ParticleLaw
from field.three_d import Field3D
from particles.diagnostics.inertial_number import MAGNETIC, inertial_number, shear_rate_of

CHAIN = 0.114
"""Largest stress over phi mu_0 M^2 of a chain of touching dipoles, at a strain of 0.39."""

RUNS_OVER_LAW, DEVICES = 1.0, 0.03
"""Torque of runs over that by the law, geometric mean, and the standard deviation of its logarithm over devices and
powders without the runs' own errors (tests/benchmarks/two_scales.py)."""

GUESS = 2.0
"""Factor within which the formula holds outside of what it was measured for."""

MIN_GRAINS_PER_GAP, EXTRAPOLATION_FACTOR = 3.0, 10.0
"""Below so many grains per gap the formula is good within the factor `EXTRAPOLATION_FACTOR` only."""

UNKNOWN_FILL = (0.8, 0.9, 1.0)
"""Parts of the powder that may be between the poles where it is not known."""

CENTRIFUGAL = 0.1
"""Coulomb friction of weight and centrifugal force on the outer wall, over the torque, from which on that is a guess.
They press the powder on the outer wall and relieve the inner one by as much, so the torque changes by that friction at
most, in either direction: it is a half width of the 95 % interval. Powder that leaves the faces of a disc is not in
it."""

BULK_FILL = 0.6
"""Of settled shot [-]."""


def chain_stress(phi: float, M: np.ndarray) -> np.ndarray:
    """Stress [Pa] of chains of dipoles magnetised to M [A/m]."""
    return CHAIN * phi * MU_0 * np.square(M)


@dataclass(frozen=True, slots=True)
class ShearedZone:
    """Points of the gaps that are filled and sheared, with what a torque or a mean needs of them.

    Attributes
    ----------
    points : ndarray (n, 3)
        [m]
    across : ndarray (n, 3)
        Unit vector across the gap.
    volume : ndarray (n,)
        That a point stands for, in the whole turn [m^3].
    gap : ndarray (n,)
        Width of the gap [m].
    """

    points: np.ndarray
    across: np.ndarray
    volume: np.ndarray
    gap: np.ndarray

    @property
    def lever(self) -> np.ndarray:
        """Area times radius [m^3] of each point: times a stress a torque."""
        return np.hypot(self.points[:, 0], self.points[:, 1]) * self.volume / self.gap


def sheared_zone(device: Device, angles: np.ndarray | None = None) -> ShearedZone | None:
    """The gaps between both shafts that hold powder; None for a box, and for a heap of shot.

    `angles` [rad] are those at which points are taken, for a field that changes with them.
    """
    gaps = device.shape.gap_parts(device.filled_boxes)
    if not gaps:
        return None
    angles = np.zeros(1) if angles is None else angles
    parts = []
    for box, radial in gaps:
        n_r, n_z = (ACROSS, ALONG) if radial else (ALONG, ACROSS)
        r, z, theta = (
            v.ravel()
            for v in np.meshgrid(
                box.r0 + (np.arange(n_r) + 0.5) / n_r * (box.r1 - box.r0),
                box.z0 + (np.arange(n_z) + 0.5) / n_z * (box.z1 - box.z0),
                angles,
            )
        )
        outwards = np.column_stack((np.cos(theta), np.sin(theta), np.zeros_like(theta)))
        points = r[:, None] * outwards + z[:, None] * np.array([0.0, 0.0, 1.0])
        across = outwards if radial else np.tile([0.0, 0.0, 1.0], (len(r), 1))
        width = box.r1 - box.r0 if radial else box.z1 - box.z0
        parts.append((points, across, box.volume() * r / r.sum(), np.full(len(r), width)))
    return ShearedZone(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


@dataclass(frozen=True, slots=True)
class Interval:
    """A torque [N m] with the ends of its 95 % interval, or of what a guess may be off by."""

    mean: float
    low: float
    high: float
    is_guess: bool = False

    @classmethod
    def within(cls, mean: float, error: float) -> Interval:
        """Of a torque whose logarithm has a standard error."""
        factor = exp(NORMAL * error)
        return cls(mean, mean / factor, mean * factor)

    def as_dict(self) -> dict[str, float]:
        """Return the three for a summary."""
        return {"mean": self.mean, "low": self.low, "high": self.high}

    def in_words(self) -> str:
        """Return the torque with its half width, its factor, as a bound, or 0."""
        mean = f"{self.mean:.3g} N m"
        if self.mean == 0.0:
            return mean
        if self.low == 0.0:
            return f"at most of the order of {mean}"
        factor = self.high / self.mean
        if self.is_guess:
            return f"of the order of {mean}" if factor > 5.0 else f"{mean} within a factor of {factor:.2g}"
        if factor > 1.5:
            return f"{mean} (95 %: {self.low:.3g} to {self.high:.3g})"
        return f"{mean} ± {100.0 * (factor - 1.0):.2g} % (95 %)"


@dataclass(frozen=True, slots=True)
class ExpectedTorque:
    """Expected torque on the output, and its law.

    Attributes
    ----------
    real : Interval or None
        Of the powder that the grains stand for; None where no gap is sheared.
    scene : Interval or None
        Of the scene's own grains, as a run has it without a correction.
    unknown_powder : tuple of float or None
        Torque [N m] that 5 % and 95 % of free-flowing powders have less than, with 80 to 100 % of them in place; None
        of a powder that no shipped law is of but for its friction.
    parts : dict of str to float
        Half widths of the 95 % interval of `real` [-] by their causes; empty of a guess.
    size_excess : tuple of float or None
        Torque of the scene's own grains over that of the real ones, less 1, with its 95 % interval; None of real
        grains, and where either is a guess.
    law : str
        How it was found, and why it is a guess.
    stress : float
        Torque over area and lever [Pa]; 0 without a gap.
    H, M : float
        Mean field across the gap and mean magnetisation of the grains there [A/m].
    gradient_force : float
        Mean of mu_0 M |grad |H||, the force of the field on a volume of grains [N/m^3].
    magnetic : bool
        Whether grains attract each other, so that the law is one of magnetised powder.
    pressure, pressure_of : float, str
        The pressure of the inertial number [Pa] and what it is of; 0 where it is that of friction. Magnetised powder
        has it between the poles, or in the whole gap.
    warnings : tuple of str
        Of the current in the copper, and of a field outside of what an effect's model holds for.
    beyond_tables : dict of str to str
        Materials by the warnings of steel that the field drives beyond the unsaturated end of its table.
    """

    real: Interval | None
    law: str
    scene: Interval | None = None
    unknown_powder: tuple[float, float] | None = None
    parts: dict[str, float] = dataclass_field(default_factory=dict)
    size_excess: tuple[float, float, float] | None = None
    stress: float = 0.0
    H: float = 0.0
    M: float = 0.0
    gradient_force: float = 0.0
    magnetic: bool = False
    pressure: float = 0.0
    pressure_of: str = f"{MAGNETIC} pressure"
    warnings: tuple[str, ...] = ()
    beyond_tables: dict[str, str] = dataclass_field(default_factory=dict)

    @property
    def torque(self) -> float | None:
        """Of the real powder [N m]."""
        return None if self.real is None else self.real.mean

    def as_dict(self) -> dict[str, dict[str, float | str | None]]:
        """Return the entries of a summary."""
        if self.real is None:
            return {}
        found: dict[str, dict[str, float | str | None]] = {"expected_torque": self.real.as_dict() | {"law": self.law}}
        found["expected_torque_scene"] = dict((self.scene or self.real).as_dict())
        if self.parts:
            found["expected_torque"]["parts"] = self.parts  # type: ignore[assignment]
        if self.unknown_powder is not None:
            found["expected_torque_unknown_powder"] = dict(zip(("low", "high"), self.unknown_powder, strict=True))
        return found

    def in_words(self) -> str:
        """Return the torque and the range of unknown powder; of a guess, and of 0 N m, the reason."""
        if self.real is None:
            return f"unknown: {self.law}"
        text = self.real.in_words()
        if self.unknown_powder is not None:
            between = format_range(*self.unknown_powder)
            text += f". If friction and fill of the powder were unknown: {between} N m (90 % range)"
        if self.real.mean == 0.0:
            return f"{text}. {self.law}"
        return f"{text}. {sentence(self.law)}" if self.real.is_guess else text

    def details(self) -> dict[str, str]:
        """Return the torque with the scene's own grains, and the law, by their labels."""
        if self.real is None:
            return {}
        found = {"law of the expected torque": self.law}
        if self.scene is not None and self.scene != self.real:
            found["expected raw torque of the run (coarse grains)"] = self.scene.in_words()
        return found


def expected_torque(
    scene, device: Device, field: MagneticField | Field3D | None, unknown_powder: bool = True
) -> ExpectedTorque:
    """The torque at the largest current, `field` being the solution of the plan at that current.

    Without `unknown_powder` its range, which takes three more solves of the field, is left out.
    """
    sampled, reason = _sampled(device, field), scene.geometry.why_not_sheared(scene)
    if reason and (scene.motion.largest_slip > 0.0 or not device.shape.gap_parts(device.filled_boxes)):
        return ExpectedTorque(Interval(0.0, 0.0, 0.0), reason)
    if scene.geometry.is_from_file and sheared_zone(device) is None:
        return ExpectedTorque(None, "the drawing has no gap of powder between faces of two bodies (geometry.bodies)")
    if sampled is None:
        return _friction(scene, device)
    zone, H, grad_H = sampled
    across = np.abs((H * zone.across).sum(axis=1))
    if across.max() == 0.0:
        return _friction(scene, device)
    strength = np.linalg.norm(H, axis=1)
    in_powder = device.fill.solid_fraction if scene.effects.feedback is not None else 0.0
    grains = grain_law(scene)
    M = grains.magnetisation(strength, np.full(len(strength), in_powder))
    slope = np.linalg.norm(np.einsum("ni,nij->nj", H, grad_H), axis=1) / np.maximum(strength, np.finfo(float).tiny)
    H_mean, M_mean, force = (float(np.average(v, weights=zone.lever)) for v in (across, M, MU_0 * M * slope))
    if scene.effects.attraction is None:
        return replace(_friction(scene, device), H=H_mean, M=M_mean, gradient_force=force)
    pressure = _pressure(device, grains, zone, strength)
    found = _Sheared(scene, device, field, zone, across, pressure).torque(unknown_powder)
    return replace(
        found,
        stress=(found.torque or 0.0) / float(zone.lever.sum()),
        H=H_mean,
        M=M_mean,
        gradient_force=force,
        magnetic=True,
        pressure=pressure,
    )


SPILL, ONSET, ONSET_SLOPE, ONSET_ERROR = 6.3, 0.41, 0.59, 0.035
"""Length that powder stands out beyond an edge of a pole, over the gap, is `SPILL` (phi - phi_s), and 0 below
phi_s = `ONSET` + `ONSET_SLOPE` (phi_n - 0.5), with phi_n the fill of `PowderLaw.jamming_fill`; and the standard
deviation of ln(phi_s) over powders. Fitted to the fill between the poles of runs, all but those held out, which have it
within 1 % (standard deviation; tests/benchmarks/two_scales.py)."""

JAMS, LOOSE = 1.5, 0.82
"""Standard error of the logarithm of the torque over phi/phi_n - `LOOSE`: jams depend on size and history."""

SPREAD = 0.05
"""Standard error of the logarithm of the torque where sizes differ: cells with diameters of 1 to 3 have 5 to 9 %
more."""

OUTSIDE = 0.02
"""Part of the powder's space that may be outside of the poles where it is filled as a whole."""

BEYOND = 0.2
"""Torque of the powder beyond the edges, over that of the same volume between the poles."""


def open_edges(device: Device) -> float:
    """Length of the edges of a pole over its area [1/m]: of those over which powder leaves; 0 without poles.

    At the rim both edges of each pole; of the faces of a disc the outer one, since the seal closes the inner one. None
    where the whole space is filled.
    """
    zone = device.pole_zone
    if zone is None or device.region not in ("poles", "faces"):
        return 0.0
    box = zone.boxes[0]
    if device.shears_faces:
        return 2.0 * box.r1 / (box.r1**2 - box.r0**2)
    return 2.0 / (box.z1 - box.z0)


def fill_between_poles(
    device: Device, law: PowderLaw, diameter: float, part: float = 1.0, onset: float = ONSET
) -> float:
    """Solid fraction between the poles of a part of the powder, with grains of a diameter [m].

    Powder that nearly jams between the faces stands out beyond the edges: phi_0/phi - 1 = g E `SPILL` (phi - phi_s),
    with E the length of the edges over the area; the equation is of second order in phi. Powder that is not between the
    poles alone gathers there until it does.
    """
    phi, gap = part * device.fill.solid_fraction, device.shear_gap
    full, rate = onset + ONSET_SLOPE * (law.jamming_fill(gap / diameter) - 0.5), SPILL * gap * open_edges(device)
    if not between_poles(device):
        room = 0.0 if device.pole_zone is None else device.pole_zone.volume
        return min(phi * device.fill.volume / room, max(phi, full)) if room else phi
    if phi <= full:
        return phi
    linear = 1.0 - rate * full
    return 2.0 * phi / (linear + sqrt(linear**2 + 4.0 * rate * phi))


def between_poles(device: Device) -> bool:
    """Whether all of the powder begins between pole faces."""
    zone = device.pole_zone
    if zone is None:
        return False
    return device.region in ("poles", "faces") or zone.volume > (1.0 - OUTSIDE) * device.fill.volume


@dataclass(frozen=True, slots=True)
class _Grains:
    """Torque [N m] of grains of one size, its errors by causes [-], what makes it a guess, and within which factor.

    By a law at B/(mu_0 Ms), fill, grains per gap and inertial number.
    """

    torque: float
    parts: dict[str, float]
    doubts: list[str]
    factor: float
    law: PowderLaw
    at: tuple[float, float, float, float]

    def interval(self, doubts: list[str], most: float) -> Interval:
        """The 95 % interval, with the doubts of the device and a torque [N m] that a guess may have besides."""
        if not (doubts or self.doubts):
            return Interval.within(self.torque, float(np.linalg.norm(list(self.parts.values()))))
        found = Interval.within(self.torque, log(self.factor) / NORMAL)
        high = found.high + most
        return replace(found, low=self.torque**2 / high if high > 0.0 else 0.0, high=high, is_guess=True)

    def excess_over(self, real: _Grains) -> tuple[float, float, float] | None:
        """The torque over that of finer grains in the same device, less 1, with its 95 % interval; None of a guess.

        Errors that both have alike cancel: of a coefficient of the law their difference counts. A size deviates from
        the law as a cell does, the less the nearer both are.
        """
        if self.doubts or real.doubts:
            return None
        change = self.law.changes(*self.at) - self.law.changes(*real.at)
        square = float((change**2).sum() + 2.0 * self.law.correlation * change[0] * change[1])
        form = self.law.deviation * (1.0 - (self.at[2] / real.at[2]) ** 2)
        other = [self.parts[name] - real.parts[name] for name in ("edges", "jams")]
        found = Interval.within(self.torque / real.torque, float(np.linalg.norm([sqrt(square), form, *other])))
        return found.mean - 1.0, found.low - 1.0, found.high - 1.0


class _Sheared:
    """The magnetised powder of a device between its poles, or in its gap; `doubts` say why its torque is a guess."""

    def __init__(self, scene, device: Device, field: Any, zone: ShearedZone, H: np.ndarray, pressure: float) -> None:
        self._scene, self._device, self._zone, self._H, self._pressure = scene, device, zone, H, pressure
        self._grains, self._Ms = grain_law(scene), saturation_of(scene)
        self._solved: MagneticField | None = field if isinstance(field, MagneticField) else None
        self._known: dict[Any, np.ndarray] = {}
        self._law, doubts = law_of(scene)
        self.doubts = [*_outside_of_cells(scene, device), *doubts]

    def torque(self, unknown_powder: bool) -> ExpectedTorque:
        """The torque, with what is known of its error."""
        grains = self._scene.grains
        own, real = grains.mean_diameter, grains.real_diameter or grains.mean_diameter
        scene, found = self._of(own, scene=True), self._of(real)
        measured = "measured " if self._law.measured else ""
        law = f"the {measured}law of the powder, in the {'given' if self._device.coil is None else 'solved'} field"
        if not measured and not self._scene.effects.attraction.has_necks:
            law = "straight chains of point dipoles"
        elif self._law.cells == 0:
            law += ", interpolated between simulated powders"
        doubts = [*self.doubts, *found.doubts]
        if doubts:
            law = f"guess by {law}. Outside of its range: {'; '.join(doubts)}"
        return ExpectedTorque(
            found.interval(self.doubts, self._most),
            law,
            scene.interval(self.doubts, self._most),
            self._of_unknown_powder(real) if unknown_powder and not measured and not doubts else None,
            {} if doubts else {name: NORMAL * part for name, part in found.parts.items()},
            scene.excess_over(found) if own > real and not self.doubts else None,
        )

    @cached_property
    def _most(self) -> float:
        """Friction of weight and centrifugal force on the outer wall [N m]."""
        return _friction(self._scene, self._device).torque or 0.0

    def _of(self, diameter: float, scene: bool = False, part: float = 1.0, law: PowderLaw | None = None) -> _Grains:
        """Torque of grains of a diameter [m], of the scene or real ones, with a part of the powder in place."""
        device, law, zone, density = self._device, law or self._law, self._zone, self._scene.grains.density
        whole, across = part * device.fill.solid_fraction, device.shear_gap / diameter
        fill = fill_between_poles(device, law, diameter, part)
        B = self._flux_density(fill, law)
        rate = self._scene.motion.largest_slip * device.shear_radius / device.shear_gap
        scaled = self._scene.accuracy.inertial_number if scene else None  # of the magnetic pressure, the law's of tau
        if scaled is not None:
            rate = shear_rate_of(scaled, diameter, density, self._pressure)
        tau, inertia = law.stress(B, self._Ms, fill, across), 0.0
        for _ in range(3):
            stress = float(np.average(tau, weights=zone.lever))
            inertia = float(inertial_number(rate, diameter, density, stress))
            tau = law.stress(B, self._Ms, fill, across, min(inertia, RANGES["inertial number"][1]))
        has_necks = self._scene.effects.attraction.has_necks
        if not law.measured and (not has_necks or law.powder[2] > self._scene.particles.susceptibility):
            chains = chain_stress(fill, self._grains.from_flux(B, fill, law.factor(self._H, fill, self._Ms))[0])
            tau = np.minimum(tau, chains)  # weak magnets have weak necks
        b = float(np.average(B, weights=zone.lever)) / (MU_0 * self._Ms)
        doubts = [
            f"its {name} is {value:.3g}, and the law was fitted from {low:g} to {high:g}"
            for (name, (low, high)), value in zip(RANGES.items(), (fill, b, across, inertia), strict=True)
            if not low <= value <= high and name != "grains per gap"
        ]
        if inertia > RANGES["inertial number"][1]:
            shaft = max("rotor", "disc", key=lambda one: getattr(self._scene.motion, one).largest_speed)
            key = f"the slip (motion.{shaft}.speed)" if scaled is None else "accuracy.inertial_number"
            doubts.append(f"lower {key} for a smaller inertial number")
        if whole > RANGES["fill"][1] >= fill:
            most = RANGES["fill"][1]
            doubts.append(f"its fill is {whole:.3g} before it spills, and the law was fitted up to {most:g}")
        if across < MIN_GRAINS_PER_GAP:
            doubts.append("fewer than 3 grains per gap are not a continuum")
        elif across < RANGES["grains per gap"][0]:
            doubts.append(f"the gap holds {across:.2g} grains, and the law was fitted from 4 on")
        at = (b, fill, across, min(inertia, RANGES["inertial number"][1]))
        parts = law.errors_at(*at)
        early, late = (
            fill_between_poles(device, law, diameter, part, ONSET * (1.0 + sign * ONSET_ERROR)) for sign in (-1, 1)
        )
        parts["edges"] = 0.5 * law.rise_with_fill(fill, across) * log(late / early)
        parts["jams"] = JAMS * max(0.0, fill / law.jamming_fill(across) - LOOSE)
        parts["sizes"] = 0.0 if self._scene.particles.sizes is None or law.measured else SPREAD
        parts["devices"] = DEVICES
        beyond = max(0.0, whole / fill - 1.0)
        torque = RUNS_OVER_LAW * float(tau @ zone.lever) * (1.0 + BEYOND * beyond)
        share = self._most / torque if torque > 0.0 else 0.0
        parts["centrifugal"] = share / NORMAL
        if share > CENTRIFUGAL:
            change = f"may change it by {100.0 * share:.0f} %" if share < 1.0 else f"may be {share:.2g} times as large"
            doubts.append(f"weight and centrifugal force {change}, and the law has neither")
        return _Grains(torque, parts, doubts, EXTRAPOLATION_FACTOR if across < MIN_GRAINS_PER_GAP else GUESS, law, at)

    def _flux_density(self, fill: float, law: PowderLaw) -> np.ndarray:
        """B [T] across the gap at the points of the zone, of powder of a fill."""
        device, coil, key = self._device, self._device.coil, (fill, law.permeability)
        if not isinstance(coil, CoilDevice) or self._scene.effects.feedback is None:
            return law.flux_density(self._H, fill, self._grains, self._Ms)
        if key not in self._known:
            at = coil.uniform_fill(device.fill.solid_fraction) * (fill / device.fill.solid_fraction)
            try:
                self._solved = field_of_sheared_powder(coil, at, self._scene, coil.largest_current, self._solved, law)
            except ConvergenceError as error:
                doubt = f"its field was not found with the permeability of sheared powder ({error})"
                self.doubts += [] if doubt in self.doubts else [doubt]
                return law.flux_density(self._H, fill, self._grains, self._Ms)
            points, across = self._zone.points, self._zone.across
            B = self._solved.B_along(points[:, [0, 2]])
            self._known[key] = np.abs((B * across[:, [0, 2]]).sum(axis=1))
        return self._known[key]

    def _of_unknown_powder(self, diameter: float) -> tuple[float, float]:
        """Torques [N m] that 5 and 95 % of free-flowing powders have less than, each with its own fill.

        The flux density is that of the one of them with the middle permeability, with the same part in place.
        """
        device, torques, across = self._device, [], self._device.shear_gap / diameter
        others = shipped_laws().free_flowing(self._law.powder[2])
        middle = sorted(others, key=lambda law: law.permeability)[len(others) // 2]
        for part in UNKNOWN_FILL:
            one = [fill_between_poles(device, law, diameter, part) for law in (middle, *others)]
            whole = part * device.fill.solid_fraction
            stress = [
                float(law.stress(np.array(MU_0), 1.0, fill, across)) * (1.0 + BEYOND * (whole / fill - 1.0))
                for law, fill in zip((middle, *others), one, strict=True)
            ]
            torques.append(self._of(diameter, part=part, law=middle).torque * np.array(stress[1:]) / stress[0])
        low, high = np.quantile(np.concatenate(torques), [0.05, 0.95])
        return float(low), float(high)


class _OtherPowders(_Sheared):
    """The device with powders of other laws and fills; B is a line in N_0 and a parabola in the fill between solves."""

    def solve(self, laws: Sequence[PowderLaw], fills: np.ndarray) -> None:
        """Solve the field for the ends of N_0 and of the fills, and a fill between these."""
        factors = [law.permeability[0] for law in laws]
        self._factors = np.unique([min(factors), max(factors)])
        self._fills = np.unique(np.linspace(fills.min(), fills.max(), 3))
        at = [replace(laws[0], permeability=(N_0, *laws[0].permeability[1:])) for N_0 in self._factors]
        self._B = np.array(
            [[super(_OtherPowders, self)._flux_density(fill, law) for law in at] for fill in self._fills]
        )

    def _flux_density(self, fill: float, law: PowderLaw) -> np.ndarray:
        weights = np.outer(_lagrange(self._fills, fill), _lagrange(self._factors, law.permeability[0]))
        return np.tensordot(weights, self._B)


def _lagrange(nodes: np.ndarray, x: float) -> np.ndarray:
    """Weights (n,) of values at different nodes (n,) in the polynomial through all of them."""
    return np.array([np.prod([(x - other) / (node - other) for other in nodes if other != node]) for node in nodes])


def torques_of_powders(
    scene, device: Device, field: MagneticField | Field3D | None, laws: Sequence[PowderLaw], fills: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Torques at the largest current with other powders: as `expected_torque`, with six solves of the field for all.

    Between the solves B is within 0.1 %.

    Parameters
    ----------
    scene, device, field : as of `expected_torque`.
    laws : n of them, all of grains with the scene's susceptibility.
    fills : ndarray (m,)
        Solid fractions of the powder as it is filled in.

    Returns
    -------
    torque : ndarray (n, m)
        Of real grains [N m].
    error : ndarray (n, m)
        Standard error of its logarithm by all causes but the form of the law (`PowderLaw.deviation`).
    guess : ndarray (n, m)
        That of a guess, to be added; 0 where the law holds.

    Raises
    ------
    ValueError
        No magnetised powder is sheared.
    """
    sampled = None if scene.effects.attraction is None else _sampled(device, field)
    if sampled is None:
        raise ValueError("no magnetised powder is sheared, so no law applies; add [effects.dipoles]")
    zone, H, _ = sampled
    powders = _OtherPowders(scene, device, field, zone, np.abs((H * zone.across).sum(axis=1)), 0.0)
    diameter, parts = scene.grains.real_diameter or scene.grains.mean_diameter, fills / device.fill.solid_fraction
    powders.solve(laws, np.array([fill_between_poles(device, law, diameter, part) for law in laws for part in parts]))
    found = [powders._of(diameter, part=part, law=law) for law in laws for part in parts]
    errors = [float(np.linalg.norm([v for k, v in one.parts.items() if k != "form"])) for one in found]
    guesses = [log(one.factor) / NORMAL if one.doubts or powders.doubts else 0.0 for one in found]
    torque, error, guess = np.reshape([[one.torque for one in found], errors, guesses], (3, len(laws), len(parts)))
    return torque, error, guess


def _sampled(device: Device, field) -> tuple[ShearedZone, np.ndarray, np.ndarray] | None:
    """The sheared zone with H [A/m] and its gradient; None without one of them."""
    angles = None
    if isinstance(field, Field3D):
        fold = field.problem.fold
        angles = fold.first + (np.arange(8) + 0.5) / 8.0 * fold.angle
    sampler = device.imposed if field is None else field.sampler("powder")
    zone = sheared_zone(device, angles)
    if zone is None or sampler is None:
        return None
    H, grad_H = sampler.sample(zone.points)
    return zone, H, grad_H


def _outside_of_cells(scene, device: Device) -> Iterator[str]:
    """What a device has that no gap cell has."""
    effects = scene.effects
    if effects.images is None:
        yield "no images in steel walls ([effects.wall_images])"
    if device.coil is not None and effects.feedback is None:
        yield "field solved without powder ([effects.back_reaction])"
    if device.coil is not None and device.section_coil is None:
        yield "slots"
    drawn = scene.geometry.is_from_file
    if device.pole_zone is None:
        gaps = "gaps of one width between steel faces of two bodies" if drawn else "pole faces"
        yield f"no {gaps}"
    elif not between_poles(device):
        part = device.pole_zone.volume / device.fill.volume
        outside = f"only {100.0 * part:.0f} % of the powder lies between steel faces of two bodies"
        whole = 'powder outside of the poles at the start (particles.region = "poles" or "faces" avoids it)'
        yield outside if drawn else whole
    if device.surfaces:
        yield "surfaces from files"
    for one in effects.present:
        if one.changes_stress and one.role == "drag":
            yield f"[effects.{one.name}]"


def expected_pressure(scene, device: Device, field: MagneticField | Field3D | None) -> float:
    """The pressure [Pa] of magnetised powder alone, see `ExpectedTorque`; 0 of other powders."""
    sampled = _sampled(device, field)
    if sampled is None or scene.effects.attraction is None:
        return 0.0
    zone, H, _ = sampled
    return _pressure(device, grain_law(scene), zone, np.linalg.norm(H, axis=1))


def _pressure(device: Device, law: ParticleLaw, zone: ShearedZone, H: np.ndarray) -> float:
    """`magnetic_pressure` of grains in straight chains along the mean field of a zone's points (n,) [A/m].

    Nearest to runs: 294 kPa in the brake of cases/powder_clutch.toml where its own moments had 284, 266 in the
    quickstart for 249. Grains without order, by Maxwell Garnett's rule, have some 160.
    """
    poles, weight = device.pole_zone, zone.volume
    between = weight if poles is None else weight * poles.holds(zone.points)
    lone = law.magnetisation(H, np.zeros(len(H)))
    mean = float(np.average(lone, weights=between if between.any() else weight))
    M = chain_magnetisation(law, mean) if mean > 0.0 else 0.0
    return magnetic_pressure(device.fill.solid_fraction, np.array([M]))


def _friction(scene, device: Device) -> ExpectedTorque:
    """Coulomb friction of all the powder's weight and centrifugal force on the outer wall."""
    own = device.kind.friction_torque(scene, device)
    if own is not None:
        return own
    gravity = scene.effects.weight
    friction, mass, radius = scene.contact.friction_at_walls, device.fill.mass, device.shear_radius
    speed = max(scene.motion.rotor.largest_speed, scene.motion.disc.largest_speed)
    weight = 0.0 if gravity is None else mass * gravity.acceleration
    zone = sheared_zone(device)
    torque = friction * radius * (weight + mass * speed**2 * radius)
    stress = torque / float(zone.lever.sum()) if zone is not None else 0.0
    without = "no field across the gap" if scene.effects.attraction is not None else "no attraction"
    law = f"{without}, so only friction from weight and centrifugal force"
    return ExpectedTorque(Interval(torque, 0.0, torque), law, stress=stress)
