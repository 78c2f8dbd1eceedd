"""The torque's order of magnitude, before a grain has moved.

Magnetised powder that is sheared across a field yields at a stress tau(H, phi); the torque of a gap of width g is the
mean over the cylinders (or planes) that it may be sheared on,

    T = (1/g) integral of tau(H_n, phi) r dV,

H_n the component of the macroscopic field across the gap, at the largest current and in the powder spread evenly, as
the plan has solved it. Two laws:

- `neck_stress`: suspensions of carbonyl iron as measured (J. D. Carlson, Int. J. Mod. Phys. B 19 (2005) 1463; fill 0.1
  to 0.5, chi of iron, some hundreds and more), tau = 271.7 kPa phi^1.5239 tanh(H/158 kA/m), with fields over the
  saturation Ms of the grains and stresses over mu_0 Ms^2, iron having 1.7 MA/m.
- `chain_stress`: straight chains of touching point dipoles m = M V along the field, strained by gamma (Jolly, Carlson
  and Munoz, Smart Mater. Struct. 5 (1996) 607), tau = phi mu_0 M^2 max of gamma (4 - gamma^2)/(8 (1 + gamma^2)^(7/2))
  = 0.114 phi mu_0 M^2; at most `neck_stress`, since chains are not straight. In sheared cells
  (docs/explanation/expected_torque.md) mutual dipoles have this stress.

Not in it: rolling friction, which doubled the torque of the shipped clutches; powder that gathers at the poles; the
mutual magnetisation by which the powder carries more flux than an even one. Without magnetism there is Coulomb friction
of weight and centrifugal force.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from coupling.expected_load import chain_magnetisation
from coupling.powder_pressure import magnetic_pressure
from emclutch.device_model.device import Device
from emclutch.device_model.materials import grain_law
from emclutch.device_model.pole_zone import ACROSS, ALONG
from emclutch.scene.units import two_digits
from emclutch.simulation.forecast.sheared_points import carlson_stress
from field import MU_0, MagneticField, ParticleLaw
from field.three_d import Field3D
from particles.diagnostics.inertial_number import MAGNETIC

IRON = 1.7e6
"""Saturation [A/m] of the carbonyl iron of Carlson's fit."""

CHAIN = 0.114
"""Largest stress over phi mu_0 M^2 of a chain of touching dipoles, at a strain of 0.39."""


@dataclass(frozen=True, slots=True)
class Trust:
    """How far an expected torque holds: it may be `too_large` or `too_small` by these factors."""

    before: str
    after: str
    too_large: float
    too_small: float

    def in_words(self, torque: str) -> str:
        """Return a torque with this in words."""
        return f"{self.before}{torque}{self.after}"


THREEFOLD = Trust("", " within a factor of three", 3.0, 3.0)
ORDER = Trust("of the order of ", "", 10.0, 10.0)
BOUND = Trust("at most of the order of ", "", np.inf, 1.0)

FEW = 3.0
"""Grains across a gap, below which they are no continuum."""

BULK_FILL = 0.6
"""Of settled shot [-]."""


def neck_stress(phi: float, H: np.ndarray, Ms: float) -> np.ndarray:
    """Carlson's yield stress [Pa] at H [A/m] for grains of saturation Ms [A/m]."""
    scale = Ms / IRON
    return scale**2 * np.asarray(carlson_stress(phi, np.abs(H) / scale))


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
class ExpectedTorque:
    """Expected torque on the output, and its law.

    Attributes
    ----------
    torque : float or None
        [N m], of magnetised powder or of friction alone; None where no gap is sheared.
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
    trust : Trust
        How far the law holds: `THREEFOLD`, `ORDER` or `BOUND`.
    law : str
        In words.
    """

    torque: float | None
    stress: float = 0.0
    H: float = 0.0
    M: float = 0.0
    gradient_force: float = 0.0
    magnetic: bool = False
    pressure: float = 0.0
    pressure_of: str = f"{MAGNETIC} pressure"
    trust: Trust = BOUND
    law: str = ""

    def as_dict(self) -> dict[str, float | str | None]:
        """Return the torque and the ends of what a run may give [N m], for a summary."""
        torque = self.torque or 0.0
        low, high = torque / self.trust.too_large, torque * self.trust.too_small
        return {"mean": self.torque, "low": low, "high": high, "law": self.in_words()}

    def in_words(self) -> str:
        """One line for the plan."""
        if self.torque is None:
            return f"unknown: {self.law}"
        order = self.trust.in_words(f"{two_digits(self.torque)} N m")
        if not self.magnetic:
            return f"{order}: {self.law}"
        return (
            f"{order}: {self.stress / 1e3:.2g} kPa at {self.H / 1e3:.3g} kA/m across the gap in "
            f"even powder, by {self.law}"
        )


def expected_torque(scene, device: Device, field: MagneticField | Field3D | None) -> ExpectedTorque:
    """The torque's order of magnitude at the largest current, from the solution `field` of the plan at that current."""
    sampled = _sampled(device, field)
    if sampled is None:
        return _friction(scene, device)
    zone, H, grad_H = sampled
    across = np.abs((H * zone.across).sum(axis=1))
    if across.max() == 0.0:
        return _friction(scene, device)
    strength = np.linalg.norm(H, axis=1)
    phi = device.fill.solid_fraction
    in_powder = phi if scene.effects.feedback is not None else 0.0  # as `plan.expected_magnetisation`
    law = grain_law(scene)
    M = law.magnetisation(strength, np.full(len(strength), in_powder))
    slope = np.linalg.norm(np.einsum("ni,nij->nj", H, grad_H), axis=1) / np.maximum(strength, np.finfo(float).tiny)
    H_mean, M_mean, force = (float(np.average(v, weights=zone.lever)) for v in (across, M, MU_0 * M * slope))
    if scene.effects.attraction is None:
        return replace(_friction(scene, device), H=H_mean, M=M_mean, gradient_force=force)
    tau, words = neck_stress(phi, across, scene.particles.saturation), "Carlson's law of iron suspensions"
    if not scene.effects.attraction.has_necks:
        tau, words = np.minimum(tau, chain_stress(phi, M)), "straight chains of point dipoles"
    torque = float((tau * zone.lever).sum())
    layers = device.narrowest_gap / scene.particles.largest_diameter
    if layers < FEW:
        words += f"; the gap holds {layers:.2g} grains, no powder"
    words = "; ".join((words, *(one.torque_note for one in scene.effects.present if one.torque_note)))
    return ExpectedTorque(
        torque,
        torque / float(zone.lever.sum()),
        H=H_mean,
        M=M_mean,
        gradient_force=force,
        magnetic=True,
        pressure=_pressure(device, law, zone, strength),
        trust=ORDER if layers < FEW else THREEFOLD,
        law=words,
    )


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
    return ExpectedTorque(torque, stress, law=f"{without}, so no more than friction of weight and centrifugal force")
