"""``summary.json``: what a finished run says of itself, by the groups of quantities (`emclutch.results.quantities`)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING, Any

from emclutch.device_model.coil_heat import coil_heat_in_words
from emclutch.device_model.grain_size import GrainSize, grain_size
from emclutch.results import Estimate, Result, RunFolder
from emclutch.results.atomic_file import replace_text
from emclutch.results.best_estimate import best_estimate
from emclutch.results.columns import DISC_SPEED, INERTIAL_NUMBER, ROTOR_SPEED, TORQUE_DISC
from emclutch.results.current_ramp import TABLE, current_ramp
from emclutch.results.quantities import GROUPS, UNITS
from emclutch.results.report.verdict import verdict
from emclutch.results.steady_torque import steady_torque
from emclutch.scene.replica_count import replica_seed
from emclutch.simulation.discretisation_error import discretisation_error, is_reached
from emclutch.simulation.observables import Observables
from emclutch.simulation.torque_trigger import how_it_ended
from field.laws.table_end import driven_beyond_their_tables
from particles.diagnostics.coordination import coordination
from particles.diagnostics.fabric import fabric
from particles.diagnostics.force_chains import force_chains
from particles.diagnostics.inertial_number import FRICTION, MAGNETIC, MEASURED

if TYPE_CHECKING:
    import pandas

    from emclutch.scene.case import Case
    from emclutch.simulation.planned_run import PlannedRun


@dataclass
class FinishedRun:
    """A run that has marched, from which `GROUPS` compute its numbers.

    Attributes
    ----------
    case : Case
    folder : RunFolder
    planned : PlannedRun
    simulation : Simulation
    histories : sequence of DataFrame
        Of all replicas, its own first.
    seconds : dict of str to float
        Wall-clock time [s] of the process: the whole run, and of it the compilation of kernels, which the windows'
        total contains as well, and their parts do not.
    stopped : bool
        Whether the user's callback has ended it.
    wall_load : dict
        Of `WallAverage`.
    """

    case: Case
    folder: RunFolder
    planned: PlannedRun
    simulation: Any
    histories: Sequence[pandas.DataFrame]
    seconds: dict[str, float]
    stopped: bool = False
    wall_load: dict[str, Any] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.history, self.source = self.histories[0], self.simulation.source
        self.plan, self.conditions = self.planned.plan, self.planned.conditions
        self.expected, self.decisions = self.planned.expected, self.planned.decisions
        self.coil = self.planned.device.coil
        self.speed_factor = 1.0 if self.plan.scaled is None else self.plan.scaled.factor
        self.seeds = [replica_seed(self.case.scene.scene.seed, number) for number in range(len(self.histories))]

    @cached_property
    def torque(self) -> Estimate | None:
        """Steady torque on the disc [N m]; None where there is no disc."""
        known = TORQUE_DISC in self.history
        return steady_torque(self.history, self.conditions, self.histories[1:]) if known else None

    @cached_property
    def of_the_geometry(self) -> dict[str, Any]:
        """Numbers that the kind of geometry computes: those of a sheared box."""
        found = self.case.scene.geometry.summarise(self.histories, self.conditions, self.case.scene)
        return found if "stress" in found else {}

    @property
    def estimate(self) -> Estimate | None:
        """What the run is judged by: the stress of a sheared box, else its torque."""
        stress = self.of_the_geometry.get("stress")
        return self.torque if stress is None else Estimate.from_dict(stress)

    @property
    def ending(self) -> dict[str, Any] | None:
        """Whether the requested precision is reached; None where none is requested."""
        until = self.case.scene.span.until
        return None if until is None or self.estimate is None else how_it_ended(self.estimate, self.history, until)

    @property
    def coil_warnings(self) -> list[str]:
        """Warnings of the copper loss, as `check` prints them."""
        coil = self.planned.device.coil
        if coil is None:
            return []
        words = coil_heat_in_words(self.case.scene, coil, coil.shape)
        return [*getattr(words, "warnings", ())]

    @property
    def beyond_tables(self) -> list[str]:
        """Warnings of steel that is driven beyond its table."""
        solved = [one for one in (self.plan.peak_field, self.source.solution) if one is not None]
        return [*driven_beyond_their_tables(solved)]

    @cached_property
    def ramp(self) -> dict[str, Any] | None:
        """Torque against a ramp of current, whose table is written beside the history; None without a ramp."""
        coil = self.case.scene.coil
        if self.torque is None or coil is None or coil.current is None or self.coil is None:
            return None
        ramp = current_ramp(self.histories, coil.current, self.conditions)
        if ramp is None:
            return None
        replace_text(self.folder.path / TABLE, ramp.table().to_csv(index=False))
        return ramp.summary()

    @cached_property
    def error(self) -> dict[str, Any]:
        """Error of the torque by the numerical settings."""
        return discretisation_error(self.case, self.plan, self.torque, self.planned.device)

    @property
    def best(self) -> Estimate | None:
        """Torque [N m] corrected for the error of the numerical settings, see `best_estimate`."""
        size = {} if self.size is None else {"grain_size": self.size.as_dict()}
        return None if self.torque is None else best_estimate(self.torque, self.error | size)

    @cached_property
    def size(self) -> GrainSize | None:
        """Coarseness of the grains; None where there is no torque."""
        if self.torque is None:
            return None
        return grain_size(self.case.scene, self.planned.device, self.expected.size_excess)

    @cached_property
    def inertial_number(self) -> tuple[float | None, str]:
        """Median inertial number of the second half of the windows, and what its pressure is of.

        Where the walls' load was measured it is that of the pressure on the disc's pole faces.
        """
        if INERTIAL_NUMBER not in self.history:
            return None, ""
        observables, late = (
            Observables(self.case.scene, self.planned.device),
            self.history.iloc[len(self.history) // 2 :],
        )
        measured = self.wall_load.get("poles", {}).get("disc", {}).get("pressure") or 0.0
        if measured > 0.0:
            slip = float((late[ROTOR_SPEED] - late[DISC_SPEED]).abs().median())
            return observables.inertial_number(slip, measured), MEASURED
        known = late[INERTIAL_NUMBER].dropna()
        kind = MAGNETIC if observables.magnetic_pressure(self.simulation) else FRICTION
        return float(known.median()) if len(known) else None, kind

    @property
    def structure(self) -> dict[str, float | None]:
        """Measures of the packing as the grains stand, see `structure_of`."""
        return structure_of(self.simulation.motion, self.case.scene.geometry.has_axis)

    @property
    def target(self) -> dict[str, Any] | None:
        """The accuracy that was requested, and whether it is reached; None where none is."""
        asked = self.folder.read_provenance().get("accuracy_target")
        if asked is None:
            return None
        return {"asked": asked, "reached": is_reached(asked, self.torque, self.error["discretisation_error"])}


def summarise(run: FinishedRun) -> dict[str, Any]:
    """Write ``summary.json``, the verdict on the run with it, and return it."""
    summary: dict[str, Any] = {}
    for group in GROUPS:
        summary |= group.of(run)
    summary["units"] = {key: unit for key, unit in UNITS.items() if key.split(".")[0] in summary}
    said = verdict(Result(run.folder, summary))
    summary["verdict"] = [{"mark": one.mark.value, "text": one.text} for one in said]
    run.folder.write_summary(summary)
    return summary


def structure_of(motion: Any, has_axis: bool = True) -> dict[str, float | None]:
    """Measures of the packing as the grains stand, see `particles.diagnostics`; None where there is no contact.

    ``coordination`` contacts a grain, walls included; ``rattlers`` fraction of grains with fewer than two;
    ``fabric_anisotropy`` and ``force_anisotropy`` of the directions of contacts between grains, each alike and weighted
    by normal force: 0 isotropic, 1 all parallel, along (r, phi, z), without an axis along (x, y, z); ``in_chains``
    fraction of grains in force chains; ``longest_chain`` grains in the longest.
    """
    grains, periodicity, contacts = motion.grains, motion.periodicity, motion.contacts()
    standing, chains = coordination(contacts, grains.count), force_chains(grains, contacts, periodicity)
    alike, weighed = (fabric(grains, contacts, periodicity, force_weighted=weighs) for weighs in (False, True))
    found = {
        "coordination": standing.mean,
        "rattlers": standing.rattlers,
        "fabric_anisotropy": alike.ring_anisotropy if has_axis else alike.anisotropy,
        "force_anisotropy": weighed.ring_anisotropy if has_axis else weighed.anisotropy,
        "in_chains": chains.fraction,
        "longest_chain": float(chains.lengths.max(initial=0)),
    }
    return {name: float(value) if math.isfinite(value) else None for name, value in found.items()}
