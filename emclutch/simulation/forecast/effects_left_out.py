"""Effects that a scene leaves out, each with the number that says when it matters.

The numbers are orders of magnitude, from the plan alone: the field at the largest current in even powder, the expected
torque (`expected_torque`), the largest speeds of the scene. `emclutch.simulation.forecast.regime` has them with their
sources.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import TYPE_CHECKING

from emclutch.device_model.device import Device
from emclutch.effects import EFFECTS
from emclutch.effects.left_out import ABSENT, ALWAYS, LeftOut
from emclutch.simulation.forecast.expected_torque import ExpectedTorque
from emclutch.simulation.forecast.regime import Regime, regime_of
from emclutch.simulation.scaled_slip import QUASI_STATIC

if TYPE_CHECKING:
    from emclutch.simulation.plan import Plan

COERCIVE_FIELD = 1e3
"""Of soft iron powder, at most [A/m]."""


def left_out(scene, device: Device, plan: Plan, expected: ExpectedTorque) -> list[LeftOut]:
    """Every effect that the scene leaves out, and the two that decide its regime."""
    regime = regime_of(scene, device, plan, expected)
    active = set(scene.effects.active)
    possible = [one for one in EFFECTS if one.name not in active and one.role not in device.kind.excluded_roles]
    off = [line for one in possible for line in one.left_out(regime)]
    return [*off, *_of_grains(regime), *_of_grain_hysteresis(regime)]


def _of_grains(at: Regime) -> Iterator[LeftOut]:
    if at.pull > 0.0:
        yield LeftOut("centrifugal force", ALWAYS, "over the pull of touching grains", at.centrifugal / at.pull, 0.1)
    else:
        yield LeftOut("centrifugal force", ALWAYS, "over weight", at.centrifugal / at.weight, 0.1)
    yield LeftOut("inertia of grains", ALWAYS, f"inertial number of the sheared powder, {at.pressure}",
                  at.inertial_number, QUASI_STATIC, note="below, the torque does not depend on the speed")  # fmt: skip


def _of_grain_hysteresis(at: Regime) -> Iterator[LeftOut]:
    if at.M > 0.0:
        coercive = COERCIVE_FIELD / at.H if at.H > 0.0 else None
        yield LeftOut("grain_hysteresis", ABSENT, "coercive field of soft iron powder, 1 kA/m, over H", coercive, 0.05,
                      note="the grains keep a moment when the current is switched off", change=None)  # fmt: skip
