"""What a scene leaves out, each with the number that says when it matters.

The numbers are orders of magnitude, from the plan alone: the field at the largest current in even powder, the expected
torque (`expected_torque`), the largest speeds of the scene. `emclutch.simulation.forecast.regime` has them with their
sources.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from emclutch.device.coil_heat import COOLING, cooled_surface
from emclutch.device.device import Device
from emclutch.results.left_out import ABSENT, ALWAYS, OFF, LeftOut
from emclutch.scene.units import two_digits
from emclutch.simulation.forecast.expected_torque import ExpectedTorque
from emclutch.simulation.forecast.regime import Regime, regime_of

if TYPE_CHECKING:
    from emclutch.simulation.plan import Plan

COERCIVE_FIELD = 1e3
"""Of soft iron powder, at most [A/m]."""


def left_out(scene, device: Device, plan: Plan, expected: ExpectedTorque) -> list[LeftOut]:
    """Every effect that the scene leaves out, and the two that decide its regime."""
    regime = regime_of(scene, device, plan, expected)
    lines = [*_of_grains(regime), *_of_magnetism(regime), *_of_the_coil(regime), *_of_heat(regime, device)]
    active = set(scene.effects.active)
    return [line for line in lines if line.effect not in active]


def _of_grains(at: Regime) -> Iterator[LeftOut]:
    if at.pull > 0.0:
        yield LeftOut("gravity", OFF, "pull of touching grains over weight", at.pull / at.weight, 10.0, below=True)
        yield LeftOut("centrifugal force", ALWAYS, "over the pull of touching grains", at.centrifugal / at.pull, 0.1)
    else:
        yield LeftOut("gravity", OFF, "centrifugal force over weight", at.centrifugal / at.weight, 10.0, below=True)
        yield LeftOut("centrifugal force", ALWAYS, "over weight", at.centrifugal / at.weight, 0.1)
    yield LeftOut("inertia of grains", ALWAYS, "inertial number of the sheared gap", at.inertial_number, 0.03,
                  note="below, the torque does not depend on the speed")  # fmt: skip
    yield LeftOut("fluid_drag", ABSENT, "Stokes number in air", at.stokes, 10.0, below=True)
    yield LeftOut("cohesion", OFF, "van der Waals force of rough grains over pull and weight", at.bond, 0.1)
    doubled = "0 for smooth shot; 0.2 for rough grains doubled the torque of the shipped clutches"
    yield LeftOut("rolling_friction", OFF, "the shape of the grains decides", note=doubled)
    yield LeftOut("twisting_friction", OFF, "torque of a contact's twist over that of its sliding", at.twist, 0.1)


def _of_magnetism(at: Regime) -> Iterator[LeftOut]:
    if at.M == 0.0:
        return
    yield LeftOut("dipoles", OFF, "pull of touching grains over weight", at.pull / at.weight, 0.1)
    yield LeftOut("magnetic_force", OFF, "pull of the field over that of touching grains", at.gradient, 0.1)
    yield LeftOut("saturation", OFF, "largest magnetisation over saturation", at.saturation, 0.1)
    if at.wall_share is not None:
        yield LeftOut("wall_images", OFF, "share of the grains that touch steel", at.wall_share, 0.1)
    if at.solved:
        yield LeftOut("back_reaction", OFF, "powder's magnetisation over H", at.powder_susceptibility, 0.1)
    coercive = COERCIVE_FIELD / at.H if at.H > 0.0 else None
    yield LeftOut("remanence", ABSENT, "coercive field of soft iron powder, 1 kA/m, over H", coercive, 0.05,
                  note="it remains when the current is switched off")  # fmt: skip


def _of_the_coil(at: Regime) -> Iterator[LeftOut]:
    if not at.solved or at.M == 0.0:
        return
    for effect, number, time in (
        ("coil_circuit", "time constant L/R of the coil", at.coil_time),
        ("eddy_currents", "diffusion time of the steel", at.diffusion_time),
    ):
        told = number if time is None else f"{number}, {two_digits(time)} s,"
        if at.switching_time is None:
            yield LeftOut(effect, OFF, f"{told} over that of switching", 0.0, 0.1, note="the current is constant")
        else:
            ratio = None if time is None else time / at.switching_time
            yield LeftOut(effect, OFF, f"{told} over that of switching", ratio, 0.1)


def _of_heat(at: Regime, device: Device) -> Iterator[LeftOut]:
    if at.slip_power is None:
        yield LeftOut("heat", ABSENT, "slip power, which follows from no expected torque")
        return
    assert at.heating is not None  # as the power
    note = f"at most {two_digits(at.slip_power)} W of slip, {two_digits(at.heating)} K/s in the powder alone"
    surface = cooled_surface(device.shape)
    if surface is not None:
        note += f"; kept up, {two_digits(at.slip_power / (COOLING * surface))} K of the housing"
    yield LeftOut("heat", ABSENT, "kelvins in this run", at.heating * at.end, 100.0, note=note)
