"""The coil alone in time: its field after a change of the voltage, while nothing moves.

    V(t) = R(T) i + d lambda/dt,        C dT/dt = R(T) i^2

with the field's linkage lambda, and with eddy currents where the scene has them: both are one system, that of
`field.section.eddy_currents`, in steps of SDIRK2 with error control. R is that of the middle of a step. The copper
keeps its heat, so that its temperature T is an upper bound. Powder is spread evenly, as by `emclutch field`.

A rise time counts from the instant at which the voltage changes until a quantity has gone through 63 or 90 % of its
change to the static field of V/R at the end; where that is without voltage, from the last change.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np
import pandas
from scipy.interpolate import PchipInterpolator

from emclutch.device_model.coil_heat import COPPER_HEAT
from emclutch.device_model.device import CoilDevice
from emclutch.results.rise_time import LATE, SHARE
from emclutch.scene.model import Scene
from field import MagneticField
from field.coil.winding import resistance_ratio
from field.section.diffusion_time import diffusion_time
from field.section.eddy_currents import EddyCurrentProblem, TransientState, VoltageDrive
from field.section.powder_state import Powder
from geometry.time_profile import TimeProfile

SETTLED = 0.01
"""Of the largest value: how near to their final values current and linkage are at the end by default."""
SPAN, MAX_SPANS = 2.5, 40
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
        There is no voltage, nothing changes, the steel has hysteresis, or the field is one in 3D.
    """
    voltage = None if scene.coil is None else scene.coil.voltage
    steady = any(one is not None and one.begin == "steady" for one in (scene.effects.circuit, scene.effects.eddy))
    if voltage is None:
        raise ValueError(
            "coil.voltage is missing: the coil alone in time is driven by a voltage; give one, e.g. '24 V', or a table "
            "{times = [...], values = [...]}, instead of coil.current"
        )
    if voltage.largest == 0.0 or (steady and len(set(voltage.values)) == 1):
        raise ValueError("coil.voltage changes nothing: it is 0 V, or constant and begins with its steady current")
    if scene.effects.memory is not None:
        raise ValueError(
            "[effects.hysteresis] cannot be computed in time: its circuit does not follow the steel's "
            "history; remove its table, or set effects.hysteresis to 'off'"
        )
    if scene.geometry.is_solved_in_3d:
        raise ValueError(
            f"geometry.{scene.geometry.key_of_3d} asks for a field in 3D, and the coil alone in time is computed in a "
            "section; remove that key, or solve single currents without --transient"
        )
    return voltage, steady


@dataclass(frozen=True, slots=True)
class Course:
    """A march of the coil: its states, a table with a row of `UNITS` each, and the static field that it goes to.

    `final` has `current`, `flux_linkage` and, where the device has a gap, `gap_flux_density` of that field; `rises` the
    rise times [s] of the same, NAME_rise_time and NAME_rise_time_90, None where the level is not reached.
    """

    states: list[TransientState]
    table: pandas.DataFrame
    field: MagneticField
    final: dict[str, float]
    rises: dict[str, float | None]


class CoilTransient:
    """A coil at its scene's voltage (`drive_of`), with a state of the powder or without powder.

    `faces` as of `Excitation.gap_flux_density`. `notify` takes the fraction of a march that is done.
    """

    notify: Callable[[float], None] | None = None

    def __init__(self, scene: Scene, coil: CoilDevice, fill: Powder, *, faces: bool) -> None:
        self.voltage, self.begins_steady = drive_of(scene)
        self.coil, self.fill, self.faces = coil, fill, faces
        assert scene.coil is not None  # it has a voltage
        self.cold_resistance = scene.coil.resistance_in(coil.shape.coil_area, coil.shape.coil_mean_radius)
        self.cold, self.heat_capacity = scene.coil.temperature, COPPER_HEAT * coil.winding.copper_mass
        self.eddy = EddyCurrentProblem(coil.problem, coil.conductivity or {}, turns=coil.turns)

    def resistance(self, loss: float) -> float:
        """R [ohm] after a copper loss [J]; ValueError where the winding passes 250 degrees C."""
        temperature = self.cold + loss / self.heat_capacity
        try:
            return self.cold_resistance * resistance_ratio(temperature) / resistance_ratio(self.cold)
        except ValueError as error:
            raise ValueError(
                f"the winding passes 250 degrees C, as its copper keeps all the heat here: {temperature:.0f} degrees C "
                f"after {loss:.3g} J; lower coil.voltage, raise coil.resistance, or end earlier (end)"
            ) from error

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
        current = self.voltage.values[-1] / self.resistance(state.copper_loss)
        return self.static(current, self.field(state) if current and state.current else None)

    def field(self, state: TransientState) -> MagneticField:
        """The field of a state, with the powder."""
        return self.eddy.field(state, self.fill)

    def quantities(self, solution: MagneticField) -> dict[str, float]:
        """Current [A], linkage [Wb] and mean |B| in the gap [T], under the poles or else over the region `powder`.

        That of the gap is negative where the field is against that of a positive current.
        """
        found = {
            "current": solution.ampere_turns / self.coil.turns,
            "flux_linkage": self.coil.turns * solution.flux_linkage_per_turn,
        }
        if (gap := self._gap_field(solution)) is not None:
            B, weight = gap
            along = weight @ (B * self._positive_gap_field).sum(axis=1)
            strength = float(np.average(np.linalg.norm(B, axis=1), weights=weight))
            found["gap_flux_density"] = -strength if along < 0.0 else strength
        return found

    def _gap_field(self, solution: MagneticField) -> tuple[np.ndarray, np.ndarray] | None:
        """B [T] at points in the gap, shape (k, 2), in any axes, and their weights (k,); None without a gap."""
        if self.coil.has_poles:
            B = solution.B_along(self.coil.pole_line(faces=self.faces))
            return B, np.ones(len(B))
        gap, elements = self.coil.mesh.regions.get("powder"), solution.problem.elements
        if gap is None:
            return None
        radius = elements.radius[gap].ravel()
        B = np.moveaxis(elements.gradient(solution.psi)[gap], 1, -1).reshape(-1, 2) / radius[:, None]
        return B, radius * elements.weight[gap].ravel()

    @cached_property
    def _positive_gap_field(self) -> np.ndarray:
        """`_gap_field` of the static field of the largest current, B alone."""
        found = self._gap_field(self.static(self.voltage.largest / self.cold_resistance))
        assert found is not None  # there is a gap
        return found[0]

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
            states = [self.eddy.steady(self.static(self.voltage(0.0) / self.cold_resistance))]
        if end is not None:
            return self._run(states, end, tolerance)
        peak = self.static(self.voltage.largest / self.cold_resistance)
        span = self.coil.turns**2 * peak.flux_linkage_per_turn / (peak.ampere_turns * self.cold_resistance)
        span = SPAN * (span + (diffusion_time(peak, self.coil.conductivity) if self.coil.conductivity else 0.0))
        states = self._run(states, self.voltage.times[-1] + span, tolerance)
        for _ in range(MAX_SPANS):
            now, final = self.field(states[-1]), self.final(states[-1])
            turns = abs(now.ampere_turns - final.ampere_turns) / peak.ampere_turns
            flux = abs(now.flux_linkage_per_turn - final.flux_linkage_per_turn) / peak.flux_linkage_per_turn
            if max(turns, flux) < SETTLED:
                break
            states = self._run(states, states[-1].time + span, tolerance)
        return states

    def _run(self, states: list[TransientState], end: float, tolerance: float) -> list[TransientState]:
        def drive(state: TransientState, step: float) -> VoltageDrive:
            if self.notify is not None:
                self.notify(state.time / end)
            return self._drive(state, step)

        later = self.eddy.run(
            states[-1], end, drive, self.fill, tolerance=tolerance, breaks=self.voltage.times,
            first_step=states[-1].time - states[-2].time if len(states) > 1 else None,
            largest=max(self.eddy.size(one.psi, self._drive(one, 0.0)) for one in states),
            newton_tolerance=self.coil.newton_tolerance,
        )  # fmt: skip
        return [*states, *later[1:]]

    def _drive(self, state: TransientState, step: float) -> VoltageDrive:
        """The voltage, behind the resistance in the middle of a step [s]."""
        loss = 0.5 * step * self.resistance(state.copper_loss) * state.current**2
        return VoltageDrive(self.voltage, self.resistance(state.copper_loss + loss))

    def course(self, end: float | None, tolerance: float) -> Course:
        """`march`, its table, and what it goes to."""
        states = self.march(end, tolerance)
        fields, static = [self.field(one) for one in states], self.final(states[-1])
        energies = np.array([(one.supplied, one.copper_loss, one.eddy_loss) for one in states]).T
        table = pandas.DataFrame([self.quantities(one) for one in fields])
        time = np.array([one.time for one in states])
        table["time"], table["voltage"] = time, self.voltage.at(time)
        table["copper_loss"] = [self.resistance(one.copper_loss) * one.current**2 for one in states]
        table["eddy_loss"] = np.append(0.0, np.diff(energies[2]) / np.diff(time))
        table["winding_temperature"] = self.cold + energies[1] / self.heat_capacity
        table["supplied_energy"], table["copper_heat"], table["eddy_heat"] = energies
        table["field_energy"] = [one.energy for one in fields]
        table, final, rises = table[[name for name in UNITS if name in table]], self.quantities(static), {}
        for name, value in final.items():
            times = rise_times(time, table[name].to_numpy(), self.changes_at, value)
            rises[f"{name}_rise_time"], rises[f"{name}_rise_time_90"] = times
        return Course(states, table, static, final, rises)


def rise_times(time: np.ndarray, value: np.ndarray, since: float, final: float) -> tuple[float | None, float | None]:
    """Return when a quantity (n,) over time (n,) [s] has gone from its value at `since` [s] by 63 and 90 % to `final`.

    Times are from `since` on, None where there is no change or it is not so far by the end; a monotone cubic lies
    between the instants.
    """
    curve = PchipInterpolator(time, value)
    first = float(curve(since))
    if math.isclose(first, final, rel_tol=SETTLED):
        return None, None

    def reached(share: float) -> float | None:
        roots = curve.solve(first + share * (final - first), extrapolate=False)
        later = roots[np.isfinite(roots) & (roots > since)]
        return float(later[0]) - since if len(later) else None

    return reached(SHARE), reached(LATE)
