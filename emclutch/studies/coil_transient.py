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
from dataclasses import dataclass
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pandas

from emclutch.device_model.coil_heat import COPPER_HEAT
from emclutch.device_model.device import CoilDevice
from emclutch.results.rise_time import LATE, SHARE
from emclutch.scene.model import Scene
from field import MagneticField
from field.coil.winding import WarmingWinding
from field.section.diffusion_time import diffusion_time
from field.section.eddy_currents import EddyCurrentProblem, TransientState, VoltageDrive
from field.section.powder_state import Powder
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


def drive_of(scene: Scene) -> tuple[TimeProfile, bool]:
    """Return the voltage that drives a scene's coil, and whether its field begins steady instead of with none.

    Raises
    ------
    ValueError
        There is no voltage, nothing changes, the field is one in 3D, or the steel has hysteresis.
    """
    voltage = None if scene.coil is None else scene.coil.voltage
    effects = (scene.effects.circuit, scene.effects.eddy)
    steady = any(one is not None and one.begin == "steady" for one in effects)
    if voltage is None:
        raise ValueError(
            "coil.voltage is missing: the coil alone in time is driven by a voltage; give one, e.g. '24 V', or a table "
            "{times = [...], values = [...]}, instead of coil.current"
        )
    if voltage.largest == 0.0 or (steady and len(set(voltage.values)) == 1):
        raise ValueError("coil.voltage changes nothing: it is 0 V, or constant and begins with its steady current")
    if scene.effects.memory is not None:
        raise ValueError(
            "[effects.hysteresis] cannot be computed in time: the steps of the circuit do not carry the steel's "
            "history; remove its table, or --set effects.hysteresis=off"
        )
    if scene.geometry.is_solved_in_3d:
        raise ValueError(
            f"geometry.{scene.geometry.key_of_3d} asks for a field in 3D, and the coil alone in time is computed in a "
            "section; remove that key, or solve single currents without --transient"
        )
    return voltage, steady


class Rise(NamedTuple):
    """When a quantity has gone through 63 and 90 % of its change [s]; None: not by the end, or there is no change."""

    early: float | None
    late: float | None


@dataclass(frozen=True, slots=True)
class Course:
    """A march of the coil.

    Attributes
    ----------
    states : list of TransientState
    table : pandas.DataFrame
        A row of `UNITS` a state; without `gap_flux_density` where the device has no gap.
    field : MagneticField
        The static one that the last state goes to.
    final : dict of str to float
        `current`, `gap_flux_density`, `flux_linkage` of that.
    rises : dict of str to Rise
        Of the same.
    """

    states: list[TransientState]
    table: pandas.DataFrame
    field: MagneticField
    final: dict[str, float]
    rises: dict[str, Rise]

    def rise_times(self) -> dict[str, float | None]:
        """Return rise times [s] by their names in a summary."""
        return {
            f"{name}_rise_time{suffix}": time
            for name, times in self.rises.items()
            for suffix, time in zip(("", "_90"), times, strict=True)
        }

    def distance(self) -> float:
        """How far the last state is from the final one, relative to the largest values [-]."""
        ends = ((self.table[name].to_numpy(), final) for name, final in self.final.items())
        return max(abs(float(values[-1]) - final) / max(float(np.abs(values).max()), 1e-300) for values, final in ends)


class CoilTransient:
    """A coil at its scene's voltage (`drive_of`), with a state of the powder or without powder.

    `faces` as of `Excitation.gap_flux_density`.
    """

    def __init__(self, scene: Scene, coil: CoilDevice, fill: Powder, *, faces: bool) -> None:
        self.voltage, self.begins_steady = drive_of(scene)
        self.coil, self.fill, self.faces = coil, fill, faces
        given = scene.coil
        assert given is not None  # it has a voltage
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

    def gap_flux_density(self, solution: MagneticField) -> float | None:
        """Mean |B| [T] under the poles; of a device without them over the region `powder`, None without that."""
        if self.coil.has_poles:
            return self.coil.gap_flux_density(solution, faces=self.faces)
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
                f"the winding passes 250 degrees C soon after {state.time:.3g} s ({hottest:.0f} degrees C then), as it "
                "keeps all its heat here; lower coil.voltage, raise coil.resistance, or end before (--end)"
            ) from error

    def course(self, end: float | None, tolerance: float) -> Course:
        """`march`, its table, and what it goes to."""
        states = self.march(end, tolerance)
        table, field = pandas.DataFrame(self._rows(states)), self.final(states[-1])
        final = {
            "current": field.ampere_turns / self.coil.turns,
            "gap_flux_density": self.gap_flux_density(field),
            "flux_linkage": self.coil.turns * field.flux_linkage_per_turn,
        }
        known = {name: value for name, value in final.items() if value is not None}
        time = table["time"].to_numpy()
        rises = {name: rise(time, table[name].to_numpy(), self.changes_at, value) for name, value in known.items()}
        return Course(states, table, field, known, rises)

    def _rows(self, states: Sequence[TransientState]) -> list[dict[str, float]]:
        found, before = [], states[0]
        for one in states:
            solution = self.eddy.field(one, self.fill)
            step = one.time - before.time
            row = {
                "time": one.time,
                "voltage": self.voltage(one.time),
                "current": one.current,
                "flux_linkage": one.linkage,
                "gap_flux_density": self.gap_flux_density(solution),
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
