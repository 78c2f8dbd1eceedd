"""The coil alone in time: its field after a change of the voltage, while nothing moves.

    V(t) = R(T) i + d lambda/dt,        C dT/dt = R(T) i^2

with the field's linkage lambda, and with eddy currents where the scene has them: both are one system, that of
`field.section.eddy_currents`, in steps of SDIRK2 with error control. R is that of the middle of a step. The copper
keeps its heat (`field.coil.winding.WarmingWinding`). Powder is spread evenly, as by `emclutch field`.

A rise time is that after the voltage changes, at which a quantity has gone through 63 or 90 % of its change to the
static field of V/R at the end; where the end is without voltage, that after the last change. The march is repeated with
four times the tolerance: the error is proportional to it, so that a third of the difference estimates it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import NamedTuple

import numpy as np

from emclutch.device_model.coil_heat import COPPER_HEAT
from emclutch.device_model.device import CoilDevice
from emclutch.results.rise_time import LATE, SHARE
from emclutch.scene.model import Scene
from field import MagneticField
from field.coil.winding import WarmingWinding
from field.section.diffusion_time import diffusion_time
from field.section.eddy_currents import EddyCurrentProblem, TransientState, VoltageDrive
from geometry.time_profile import TimeProfile

COARSER = 4.0
"""Factor of the tolerance of the second march."""
SETTLED = 0.01
"""Of the largest value: how near to their final values current, linkage and gap field are at the end by default."""
SPAN, MOST_SPANS = 2.5, 40
"""Of the time constants; the march ends by default after a whole number of spans."""
UNITS = {
    "time": "s",
    "voltage": "V",
    "current": "A",
    "flux_linkage": "Wb",
    "gap_flux_density": "T",
    "copper_loss": "W",
    "eddy_loss": "W",
    "winding_temperature": "degC",
    "supplied_energy": "J",
    "copper_heat": "J",
    "eddy_heat": "J",
    "field_energy": "J",
}
"""Columns of transient.csv and their units. The loss of the eddy currents is the mean over the step that ends with the
row, the copper's that of the row's instant; energies since the start, but for the field's, which is its content."""


class Rise(NamedTuple):
    """When a quantity has gone through 63 and 90 % of its change [s]; None: not by the end, or there is no change."""

    early: float | None
    late: float | None


class CoilTransient:
    """A coil at its scene's voltage, with the powder's fill (n powder elements,) or without powder.

    Raises
    ------
    ValueError
        A scene without a voltage, with hysteresis, or in which nothing changes.
    """

    def __init__(self, scene: Scene, coil: CoilDevice, fill: np.ndarray | None) -> None:
        given = scene.coil
        if given is None or given.voltage is None:
            raise ValueError(
                "coil.voltage is missing: the coil alone in time is driven by a voltage; give one, e.g. '24 V', or a "
                "table {times = [...], values = [...]}, instead of coil.current"
            )
        if scene.effects.memory is not None:
            raise ValueError(
                "[effects.hysteresis] cannot be computed in time: the steps of the circuit do not carry the steel's "
                "history; remove its table, or --set effects.hysteresis=off"
            )
        effects = (scene.effects.circuit, scene.effects.eddy)
        self.begins_steady = any(one is not None and one.begin == "steady" for one in effects)
        self.voltage, self.coil, self.fill = given.voltage, coil, fill
        if self.voltage.largest == 0.0 or (self.begins_steady and len(set(self.voltage.values)) == 1):
            raise ValueError("coil.voltage changes nothing: it is 0 V, or constant and begun with its steady current")
        resistance = given.resistance_in(coil.shape.coil_area, coil.shape.coil_mean_radius)
        self.winding = WarmingWinding(resistance, given.temperature, COPPER_HEAT * coil.winding.copper_mass)
        self.eddy = EddyCurrentProblem(coil.problem, coil.conductivity or {}, turns=coil.turns)

    @property
    def changes_at(self) -> float:
        """When the voltage begins to change what there is [s]; to no voltage: when it does so last."""
        times, values = self.voltage.times, self.voltage.values
        changes = [time for time, (a, b) in zip(times, pairwise(values), strict=False) if a != b]
        if values[-1] == 0.0:
            return changes[-1]
        return 0.0 if not changes or (values[0] != 0.0 and not self.begins_steady) else changes[0]

    def static(self, current: float, guess: MagneticField | None = None) -> MagneticField:
        """The static field of a current [A]."""
        tolerance = self.coil.newton_tolerance
        return self.coil.problem.solve(self.coil.turns * current, fill=self.fill, guess=guess, tolerance=tolerance)

    def final(self, state: TransientState) -> MagneticField:
        """The static field that a state goes to, with the winding as warm as it is then."""
        current = self.voltage.values[-1] / self.winding.resistance_after(state.copper_loss)
        return self.static(current, self.eddy.field(state, self.fill) if current and state.current else None)

    def gap_flux_density(self, solution: MagneticField, *, faces: bool) -> float | None:
        """Mean |B| [T] under the poles; of a device without them over the region `powder`, None without that."""
        if self.coil.has_poles:
            return self.coil.gap_flux_density(solution, faces=faces)
        gap = self.coil.mesh.regions.get("powder")
        if gap is None:
            return None
        elements = solution.problem.elements
        gradient = np.hypot(*np.moveaxis(elements.gradient(solution.psi)[gap], 1, 0))  # r B
        return float((gradient * elements.weight[gap]).sum() / (elements.radius * elements.weight)[gap].sum())

    def march(self, end: float | None, tolerance: float) -> list[TransientState]:
        """States from 0 to `end` [s], None: until current and linkage are within `SETTLED` of their final values.

        Raises
        ------
        ValueError
            The winding passes 250 degrees C.
        ConvergenceError
        """
        states = [self.eddy.at_rest()]
        if self.begins_steady:
            states = [self.eddy.steady(self.static(self.voltage(0.0) / self.winding.resistance))]
        if end is not None:
            return self._run(states, end, tolerance, None)
        peak = self.static(self.voltage.largest / self.winding.resistance)
        span = self.coil.turns**2 * peak.flux_linkage_per_turn / (peak.ampere_turns * self.winding.resistance)
        span = SPAN * (span + (diffusion_time(peak, self.coil.conductivity) if self.coil.conductivity else 0.0))
        states = self._run(states, self.voltage.times[-1] + span, tolerance, None)
        for _ in range(MOST_SPANS):
            last = states[-1]
            off = self.eddy.field(last, self.fill), self.final(last)
            turns = [one.ampere_turns / peak.ampere_turns for one in off]
            flux = [one.flux_linkage_per_turn / peak.flux_linkage_per_turn for one in off]
            if max(abs(turns[0] - turns[1]), abs(flux[0] - flux[1])) < SETTLED:
                break
            states = self._run(states, last.time + span, tolerance, last.time - states[-2].time)
        return states

    def _run(
        self, states: list[TransientState], end: float, tolerance: float, first_step: float | None
    ) -> list[TransientState]:
        drive, largest = self._drive, max(self.eddy.size(one.psi, self._drive(one, 0.0)) for one in states)
        later = self.eddy.run(
            states[-1], end, drive, self.fill, tolerance=tolerance, first_step=first_step, largest=largest,
            breaks=self.voltage.times, newton_tolerance=self.coil.newton_tolerance,
        )  # fmt: skip
        return [*states, *later[1:]]

    def _drive(self, state: TransientState, step: float) -> VoltageDrive:
        """The voltage, behind the resistance in the middle of a step [s]."""
        loss, hottest = state.copper_loss, self.winding.temperature_after(state.copper_loss)
        try:
            loss += 0.5 * step * self.winding.resistance_after(loss) * state.current**2
            return VoltageDrive(self.voltage, self.winding.resistance_after(loss))
        except ValueError as error:
            raise ValueError(
                f"the winding passes 250 degrees C soon after {state.time:.3g} s ({hottest:.0f} degrees C then); it keeps "
                "all its heat here: lower coil.voltage, raise coil.resistance, or end before (--end)"
            ) from error

    def rows(self, states: Sequence[TransientState], *, faces: bool) -> list[dict[str, float]]:
        """A row of `UNITS` a state; without `gap_flux_density` where the device has no gap."""
        found, before = [], states[0]
        for one in states:
            solution = self.eddy.field(one, self.fill)
            step = one.time - before.time
            row = {
                "time": one.time,
                "voltage": self.voltage(one.time),
                "current": one.current,
                "flux_linkage": one.linkage,
                "gap_flux_density": self.gap_flux_density(solution, faces=faces),
                "copper_loss": self.winding.resistance_after(one.copper_loss) * one.current**2,
                "eddy_loss": (one.eddy_loss - before.eddy_loss) / step if step else 0.0,
                "winding_temperature": self.winding.temperature_after(one.copper_loss),
                "supplied_energy": one.supplied,
                "copper_heat": one.copper_loss,
                "eddy_heat": one.eddy_loss,
                "field_energy": solution.energy,
            }
            found.append({name: value for name, value in row.items() if value is not None})
            before = one
        return found


def rise(time: np.ndarray, value: np.ndarray, since: float, final: float) -> Rise:
    """Return when a quantity (n,) over time (n,) [s] has gone from its value at `since` [s] by 63 and 90 % to `final`.

    Times are from `since` on; a monotone cubic lies between the instants.
    """
    from scipy.interpolate import PchipInterpolator

    curve = PchipInterpolator(time, value)
    first = float(curve(since))
    if math.isclose(first, final, rel_tol=SETTLED):
        return Rise(None, None)
    found = []
    for share in (SHARE, LATE):
        roots = curve.solve(first + share * (final - first), extrapolate=False)
        later = roots[np.isfinite(roots) & (roots > since)]
        found.append(float(later[0]) - since if len(later) else None)
    return Rise(*found)
