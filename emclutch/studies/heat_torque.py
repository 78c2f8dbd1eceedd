"""The torque of a device against current and temperature of the powder, of which `emclutch heat` makes slip power.

**Law.** The law of the powder (`emclutch.simulation.forecast.expected_torque`) gives the torque at `POINTS` currents on
one mesh; between them lies a monotone cubic interpolation (PCHIP: F. N. Fritsch and R. E. Carlson, SIAM J. Numer. Anal.
17 (1980) 238). A temperature theta scales the saturation of grains and steel by m = Ms(theta)/Ms(theta_0) and keeps
their initial permeability (`field.laws.temperature`). At m times the current all fields are then m times and all
stresses m^2 times those at theta_0, so that

    T(I, theta) = m^2 T(I/m, theta_0).

Neglected: the inertial number changes with the stress, by 1e-5 of the torque from 20 to 200 degrees C. Temperatures
outside of the range that a scene may have count as its ends.

**Slip power.** `effects.heat.slip_power` over the largest slip is a torque. The current that gives it follows from the
law or the curve at each temperature of the powder, up to the largest current. Without either, and at a current of
`effects.heat.duty.current`, that one torque is taken at all currents and temperatures.

**Measured.** A torque that is given (`effects.heat.torque`, a run) scales the law. `effects.heat.torque_curve` replaces
it, and `effects.heat.fade` replaces its change with the temperature at a given current.
"""

from __future__ import annotations

from collections.abc import Callable
from math import isclose
from pathlib import Path
from typing import Any

import numpy as np
from scipy.interpolate import PchipInterpolator

from emclutch.device_model.coil_heat import HOTTEST
from emclutch.device_model.device import build_device
from emclutch.device_model.heat_model import Drive, HeatModel
from emclutch.device_model.materials import saturation_ratio_of
from emclutch.effects.heat import HeatSection
from emclutch.results import load_result
from emclutch.results.quantity import RPM
from emclutch.scene.case import Case
from emclutch.scene.map_axes import axes_of
from emclutch.studies.design_search import expectation_of
from field.laws.temperature import AS_GIVEN, saturation_ratio

POINTS = 12
"""Currents of the law, denser towards 0: the interpolation is off by 0.1 % of the largest torque."""

COLDEST = -100.0
"""Temperature [degrees C] from which on, up to `HOTTEST`, the saturation changes."""

_SAME = "the same torque"

Torque = Callable[[float, float], float]
"""Current [A], >= 0, and temperature of the powder [degrees C] to the torque [N m]."""


def torque_of(
    case: Case, current: float, largest: float, run: str | Path | None, slip: float,
    tell: Callable[[float, str], None] = lambda *_: None,
) -> tuple[Torque, dict[str, Any]]:  # fmt: skip
    """Return the torque of a scene with [effects.heat], or of a run's folder, and how it was found.

    `current` [A] is the largest one of [coil], at which `effects.heat.torque` is, `largest` that of the duty, `slip`
    [rad/s] the largest slip of the duty, at which `effects.heat.slip_power` is. Found are
    `value` [N m] at `current` and `temperature` [degrees C], its `source`, and what holds at others; of the law besides
    `low` and `high` [N m], the ends of its 95 % interval, `is_guess` and `words`; with a slip power its `needed_torque`
    [N m] and `needed_current` [A] at `temperature`, or `full_current`, why the coil keeps its current.

    Raises
    ------
    SceneError, ConvergenceError
        The field at one of the law's currents cannot be solved.
    ValueError
        There is no torque, or one of another current than the duty's alone, or it is too small for the slip power.
    """
    scene, effect = case.scene, case.scene.effects.thermal
    power, fixed = effect.slip_power, effect.slip_power is not None and effect.duty.current is not None
    if power is not None and slip == 0.0:
        raise ValueError(
            f"effects.heat.slip_power = {power:g} W needs a slip: give effects.heat.duty.slip, or a speed in [motion]"
        )
    measured, at = (effect.torque, current) if run is None else _of_run(effect.torque, run)
    given = "effects.heat.torque" if run is None else f"the best estimate of the run {run} at {at:.4g} A"
    fade, curve = effect.fade, effect.torque_curve
    found: dict[str, Any] = {}
    needs_law = curve is None and scene.particles is not None and not fixed
    law = _by_the_law(case, current, max(current, largest, at), tell) if needs_law else None
    if power is not None and (fixed or (curve is None and law is None)):
        return _of_slip_power(effect, power, abs(slip), largest, run)
    first = fade.temperatures[0] if fade is not None else AS_GIVEN if scene.field is None else scene.field.temperature
    if curve is not None:
        name, shape = "effects.heat.torque_curve", lambda I, _: float(np.interp(I, curve.currents, curve.torques))
    elif law is not None:
        name, (shape, found) = "the law of the powder", law
    elif measured is None:
        message = "the scene has no [particles], or no sheared gap; give effects.heat.torque, slip_power, or a run"
        raise ValueError(f"effects.heat has no torque: {message}")
    elif not isclose(at, largest, rel_tol=1e-3):
        raise ValueError(
            f"{given} is of a coil current of {at:.4g} A, the duty one of {largest:.4g} A; give [particles] or "
            "effects.heat.torque_curve, which is then scaled to it, or a torque at the duty's current"
        )
    else:
        name, shape = _SAME, lambda I, _: float(I > 0.0)
    factor, elsewhere, found = 1.0, name, {"source": name} | found
    if measured is not None:
        if shape(at, first) == 0.0:
            raise ValueError(f"{name} cannot be scaled to {given}: no torque at its {at:.4g} A; leave one of them out")
        factor, found = measured / shape(at, first), {"source": given}
        elsewhere += f" times {factor:.4g} (to meet {given})" if name != _SAME else ""

    def torque(current: float, temperature: float) -> float:
        if fade is None:
            return factor * shape(current, temperature)
        return factor * shape(current, first) * float(np.interp(temperature, fade.temperatures, fade.factors))

    if power is not None:
        needed, most = power / abs(slip), torque(largest, first)
        if needed > most:
            raise ValueError(
                f"effects.heat.slip_power = {power:g} W needs {needed:.3g} N m at {RPM * abs(slip):.4g} rpm, but "
                f"{elsewhere} gives {most:.3g} N m at the largest current, {largest:.3g} A; the largest slip power is "
                f"{most * abs(slip):.3g} W: lower it, raise coil.current or coil.voltage, or give the current as "
                "effects.heat.duty.current"
            )
        model = HeatModel(0.0, torque, regulates=True)
        found["needed_torque"] = needed
        found["needed_current"] = model.current(Drive(largest, torque=needed), first, first)

    return torque, found | {
        "value": torque(current, first),
        "current": current,
        "temperature": first,
        "of_all_currents": name != _SAME,
        "at_other_currents": elsewhere,
        "at_other_temperatures": "effects.heat.fade" if fade else _SAME if curve else elsewhere,
    }


def _by_the_law(
    case: Case, current: float, largest: float, tell: Callable[[float, str], None]
) -> tuple[Torque, dict[str, Any]] | None:
    """Return the torque of the law up to a largest current [A], and what it is at `current` [A]; None without a gap."""

    def ratio(temperature: float) -> float:
        return saturation_ratio(min(max(temperature, COLDEST), HOTTEST)) / saturation_ratio_of(case.scene)

    currents = (largest or 1.0) / ratio(HOTTEST) * np.linspace(0.0, 1.0, POINTS) ** 2
    (axis,) = axes_of(case, {"current": [current, *currents.tolist()]})
    needless = {} if case.scene.coil is None or case.scene.coil.turns is None else {"coil.resistance": None}
    device, torques = build_device(case.scene), []
    here = expectation_of(case, device, unknown_powder=True)
    if here.real is None:
        return None
    for number, value in enumerate(axis.values):
        tell(0.2 * number / len(axis.values), "torque at each current")
        at = case.with_values(axis.changes(value) | needless)
        found = expectation_of(at, device.driven_as(at.scene))
        off = value == 0.0 and here.magnetic  # all that is known there is a bound, of friction without a field
        torques.append(0.0 if off else found.torque)
    cold = PchipInterpolator(axis.values, torques)

    def torque(current: float, temperature: float) -> float:
        m = ratio(temperature)
        return float(m**2 * cold(min(current / m, axis.values[-1])))

    real, words = here.real, here.in_words()
    return torque, {"low": real.low, "high": real.high, "is_guess": real.is_guess or real.low == 0.0, "words": words}


def _of_slip_power(
    effect: HeatSection, power: float, slip: float, current: float, run: str | Path | None
) -> tuple[Torque, dict[str, Any]]:
    """Return the one torque that has the slip power at a slip [rad/s], while there is a current [A]."""
    given = f"effects.heat.slip_power = {power:g} W"
    if run is not None:
        raise ValueError(f"{given} conflicts with the torque of the run {run}; keep one of them")
    why = f"The coil has its full current, {current:.3g} A: no law gives the current that the slip power needs. Give "
    why += "[particles] or effects.heat.torque_curve."
    if effect.duty.current is not None:
        why = f"The coil has the current of effects.heat.duty.current, at most {current:.3g} A, not that of the law."
    needless = [f"effects.heat.{key}" for key in ("torque", "torque_curve", "fade") if getattr(effect, key) is not None]
    torque = power / slip
    return lambda I, _: torque * float(I > 0.0), {
        "source": f"{given} at {RPM * slip:.4g} rpm",
        "full_current": f"{why} {' and '.join(needless)} {'is' if len(needless) == 1 else 'are'} not used."
        if needless else why,
        "value": torque, "current": current, "temperature": AS_GIVEN, "of_all_currents": False,
        "at_other_currents": _SAME, "at_other_temperatures": _SAME,
    }  # fmt: skip


def _of_run(given: float | None, run: str | Path) -> tuple[float, float]:
    """Return best estimate of the torque [N m] and current [A] of a run, beside which none must be given in the scene.

    ValueError where the run's torque is not steady.
    """
    if given is not None:
        raise ValueError(f"effects.heat.torque = {given:g} N m conflicts with the run {run}; keep one of them")
    result = load_result(run)
    current = result.summary.get("current")
    if current is None:
        raise ValueError(f"the run {run} has no coil current; take another, or give effects.heat.torque")
    best = result.best
    if best.mean is None or not result.torque.is_steady:
        mend = result.torque.remedy or "take another run"
        raise ValueError(f"the torque of the run {run} is not known ({result.torque.reason}); {mend}, or give "
                         "effects.heat.torque")  # fmt: skip
    return abs(best.mean), abs(current)
