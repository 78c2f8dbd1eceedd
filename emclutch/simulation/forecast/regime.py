"""The dimensionless numbers of a scene, before it runs: the forces and times of its grains over each other.

Sources, each with what is compared:

- pull of touching grains, (pi/24) mu_0 M^2 d^2 of two dipoles (`coupling.expected_load`), M the mean in the gap;
- inertial number (`particles.diagnostics.inertial_number`), with the expected magnetic pressure, or p = tau/mu_wall
  of friction; by the law of P. Jop, Y. Forterre and O. Pouliquen, Nature 441 (2006) 727, friction has risen
  by 0.025 at 0.03 and by 0.07 at 0.1, from 0.38;
- Stokes number, rate rho d^2/(18 eta): the time in which air of eta = 18 uPa s slows a grain over that of a unit shear;
- van der Waals force A r/(12 z^2) = 5 nN of asperities r = 0.1 um at z = 0.4 nm, A = 1e-19 J (A. Castellanos, Adv.
  Phys. 54 (2005) 263): the granular Bond number is that force over the largest of pull, weight and centrifugal force;
- twist of a contact of radius a: torque (2/3) mu F a over mu F d/2, with a^2 = d delta/4 at the allowed overlap;
- diffusion time: `field.section.diffusion_time`; time constant of the coil: apparent L over R at the largest current;
- slip heat, T omega_slip into the powder's mass at 450 J/(kg K), that of iron, with nothing carried off; in steady
  operation it and the copper loss warm the housing (`emclutch.device_model.coil_heat`).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from math import pi, sqrt
from typing import TYPE_CHECKING

from coupling.expected_load import pair_attraction
from emclutch.device_model.coil_heat import copper_loss, housing_rise
from emclutch.device_model.device import Device
from emclutch.device_model.materials import conductivity_of, region_materials, saturation_of
from emclutch.effects import EFFECTS
from emclutch.effects.omitted_effect import ABSENT, ALWAYS, OmittedEffect
from emclutch.simulation.forecast.expected_torque import ExpectedTorque
from emclutch.simulation.scaled_slip import QUASI_STATIC
from field.section.diffusion_time import diffusion_time
from particles.diagnostics.inertial_number import FRICTION, inertial_number

if TYPE_CHECKING:
    from emclutch.simulation.plan import Plan

G = 9.81
AIR_VISCOSITY = 1.8e-5
"""[Pa s] at 20 degrees C."""
ASPERITY_PULL = 1e-19 * 1e-7 / (12.0 * 0.4e-9**2)
"""[N], see above."""
IRON_HEAT = 450.0
"""[J/(kg K)]"""


@dataclass(frozen=True, slots=True)
class Regime:
    """Forces, times and numbers.

    Attributes
    ----------
    weight, centrifugal, pull : float
        Forces on a grain of the mean diameter [N]: its weight, at the largest speed and radius, of a touching one.
    H, M : float
        Means across the sheared gap [A/m].
    inertial_number, stokes : float or None
        None where nothing is sheared, or no pressure is known.
    pressure : str
        What the pressure of the inertial number is of, in words.
    bond, twist, saturation, gradient, powder_susceptibility : float
        See the module; the force of the field's gradient over `pull`, and phi M/H.
    wall_share : float or None
        Fraction of the grains that touch a magnetic wall; None without one.
    solved : bool
        Whether a coil makes the field.
    coil_time, diffusion_time, switching_time : float or None
        [s]; None where the plan does not know them, or the drive is constant.
    slip_power, heating : float or None
        [W], [K/s] of the powder alone; None without an expected torque.
    copper_loss : float
        At the largest current [W].
    housing_rise : float or None
        Of the housing in the end by both powers [K], infinite where the winding runs away; None: surface unknown.
    end : float
        Time [s] in which the powder is sheared at the scene's own speeds as far as in the run.
    """

    weight: float
    centrifugal: float
    pull: float
    H: float
    M: float
    inertial_number: float | None
    pressure: str
    stokes: float | None
    bond: float
    twist: float
    saturation: float
    gradient: float
    powder_susceptibility: float
    wall_share: float | None
    solved: bool
    coil_time: float | None
    diffusion_time: float | None
    switching_time: float | None
    slip_power: float | None
    heating: float | None
    copper_loss: float
    housing_rise: float | None
    end: float


def regime_of(scene, device: Device, plan: Plan, expected: ExpectedTorque) -> Regime:
    """The numbers of a scene, of its plan and its expected torque."""
    particles, motion = scene.particles, scene.motion
    d, rho = particles.mean_diameter, particles.density
    mass = pi / 6.0 * d**3 * rho
    gravity = scene.effects.weight
    weight = mass * (G if gravity is None or gravity.acceleration == 0.0 else gravity.acceleration)
    speed = max(motion.rotor.largest_speed, motion.disc.largest_speed)
    centrifugal = mass * speed**2 * device.largest_radius
    pull = pair_attraction(expected.M, d)
    slip = motion.largest_slip
    rate = device.kind.rate(scene) or 0.0
    if device.shear_gap > 0.0:
        rate = slip * device.shear_radius / device.shear_gap
    friction = scene.contact.friction_at_walls
    pressure = expected.pressure or (expected.stress / friction if friction > 0.0 else 0.0)
    steel = any(wall.magnetic for wall in device.walls())
    contact_radius = 0.5 * d * sqrt(scene.contact.max_overlap)
    power = None if expected.torque is None else expected.torque * slip
    coil = device.coil
    return Regime(
        weight=weight,
        centrifugal=centrifugal,
        pull=pull,
        H=expected.H,
        M=expected.M,
        inertial_number=float(inertial_number(rate, d, rho, pressure)) if pressure > 0.0 else None,
        pressure=expected.pressure_of if expected.pressure else f"{FRICTION} pressure",
        stokes=rate * rho * d**2 / (18.0 * AIR_VISCOSITY) if rate > 0.0 else None,
        bond=ASPERITY_PULL / max(pull, weight, centrifugal),
        twist=2.0 / 3.0 * contact_radius / (0.5 * d),
        saturation=plan.M_max / saturation_of(scene),
        gradient=expected.gradient_force * pi / 6.0 * d**3 / pull if pull > 0.0 else 0.0,
        powder_susceptibility=device.fill.solid_fraction * expected.M / expected.H if expected.H > 0.0 else 0.0,
        wall_share=min(1.0, 2.0 * d / device.narrowest_gap) if steel else None,
        solved=device.coil is not None,
        coil_time=_coil_time(scene, device, plan),
        diffusion_time=_diffusion_time(scene, device, plan),
        switching_time=_switching_time(scene, device, _coil_time(scene, device, plan)),
        slip_power=power,
        heating=None if power is None else power / (device.fill.mass * IRON_HEAT),
        copper_loss=0.0 if coil is None else copper_loss(scene, coil, device.shape),
        housing_rise=housing_rise(scene, coil, device.shape, power or 0.0),
        end=plan.end * (1.0 if plan.scaled is None else plan.scaled.factor),
    )


def _coil_time(scene, device: Device, plan: Plan) -> float | None:
    coil = device.coil
    if coil is None or plan.peak_field is None or coil.largest_current == 0.0:
        return None
    inductance = coil.turns * plan.peak_field.flux_linkage_per_turn / coil.largest_current
    return inductance / scene.coil.resistance_in(coil.shape.coil_area, coil.shape.coil_mean_radius)


def _diffusion_time(scene, device: Device, plan: Plan) -> float | None:
    coil, field = device.section_coil, plan.peak_section
    if coil is None or field is None or coil.largest_current == 0.0:
        return None
    materials = region_materials(scene, coil.mesh)
    sigma = {name: conductivity_of(scene, of) for name, of in materials.items() if name != "coil"}
    return diffusion_time(field, sigma)


def _switching_time(scene, device: Device, coil_time: float | None) -> float | None:
    """The shortest in which the drive goes from one current to another; that of the circuit where it is simulated."""
    if device.coil is None:
        return None
    if scene.effects.circuit is not None:
        return coil_time
    course = pairwise(zip(device.coil.currents.times, device.coil.currents.values, strict=True))
    return min((later - time for (time, i), (later, j) in course if i != j), default=None)


COERCIVE_FIELD = 1e3
"""Of soft iron powder, at most [A/m]."""


def omitted_effects(scene, device: Device, plan: Plan, expected: ExpectedTorque) -> list[OmittedEffect]:
    """Every effect that the scene leaves out, and the two that decide its regime, each with its order of magnitude."""
    regime = regime_of(scene, device, plan, expected)
    active = set(scene.effects.active)
    possible = [one for one in EFFECTS if one.name not in active and one.role not in device.kind.excluded_roles]
    off = [line for one in possible for line in one.omitted_effects(regime)]
    return [*off, *_of_grains(regime), *_of_grain_hysteresis(regime)]


def _of_grains(at: Regime) -> Iterator[OmittedEffect]:
    if at.pull > 0.0:
        over, ratio = "force on a grain divided by the attraction of touching grains", at.centrifugal / at.pull
    else:
        over, ratio = "force on a grain divided by its weight", at.centrifugal / at.weight
    yield OmittedEffect("centrifugal force", ALWAYS, over, ratio, 0.1)
    yield OmittedEffect("inertia of grains", ALWAYS, f"inertial number, computed with the {at.pressure}",
                  at.inertial_number, QUASI_STATIC, note="below, the torque does not depend on the speed")  # fmt: skip


def _of_grain_hysteresis(at: Regime) -> Iterator[OmittedEffect]:
    if at.M > 0.0:
        coercive = COERCIVE_FIELD / at.H if at.H > 0.0 else None
        number = "coercive field of soft iron powder, 1 kA/m, divided by H"
        note = "neglected: the moment that real grains keep after the current is switched off"
        yield OmittedEffect("grain_hysteresis", ABSENT, number, coercive, 0.05, note=note, change=None)
