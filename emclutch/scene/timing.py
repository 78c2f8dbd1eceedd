"""[time], [accuracy] and [output]: how long, how fine and what is kept."""

from __future__ import annotations

from math import inf
from typing import Annotated, Self

from pydantic import Field, StrictBool, model_validator

from emclutch.scene.fraction import Fraction, FractionEntry
from emclutch.scene.scaled import InstantOrStrain, Scaled, TimeOrStrain
from emclutch.scene.section import Automatic, Choice, Integer, Section, refuse
from emclutch.scene.torque_target import TorqueTarget, TorqueTargetEntry
from emclutch.scene.units import Time, number
from emclutch.settings.values_section import ValuesSection

MAX_SCATTER_FREEDOM = 1000  # of accuracy.replica_scatter


class TimeSection(Section):
    """End of the simulation, coupling window and step of the grains; a key that is not given is chosen by the program.

    Required with `[particles]`.
    """

    end: TimeOrStrain = Field(
        description="end of the simulation, a time or the shear strain of the gap; with `until` the latest"
    )
    until: Annotated[TorqueTarget, TorqueTargetEntry()] | None = Field(
        default=None,
        description="end as soon as half the 95 % interval of the steady torque is below this value: 'torque 2 %', "
        "'torque 0.01 N m' or 'torque 2 % or 0.01 N m'; in a sheared_box of the shear stress: 'stress 2 %'",
    )
    window: Annotated[Time | None, Automatic()] = Field(
        default=None, description="longest coupling window, rounded down to whole steps, or auto", examples=["0.03 ms"]
    )
    step: Annotated[Time | None, Automatic()] = Field(
        default=None, description="step of the grains, or auto", examples=["0.08 us"]
    )
    steps_per_contact: Annotated[float, number("20", 10.0, 200.0)] = Field(
        default=20.0, description="steps in the duration of a contact, if the step is automatic"
    )
    average_from: InstantOrStrain | None = Field(
        default=None, description="start of the steady part; default: found in the run", examples=["8 ms"]
    )
    exclude_drift: bool = Field(
        default=True,
        description="true: a torque is steady, and a run with `until` reaches its target, only if a drift of twice the "
        "target is excluded; false: averaging begins at `average_from`, and a drift leaves the torque unknown only if "
        "it is significantly (95 %) above 0.75 of the target",
    )

    @model_validator(mode="after")
    def _nests(self) -> Self:
        if not_before(self.average_from, self.end):
            raise refuse(
                f"is not before time.end = {instant_in_words(self.end)}; lower it, or raise the end", key="average_from"
            )
        if not self.exclude_drift and self.average_from is None:
            raise refuse(
                "= false needs time.average_from, the end of the start-up that is known; give it, or leave "
                "exclude_drift out",
                key="exclude_drift",
            )
        end = inf if isinstance(self.end, Scaled) else self.end
        if self.window is not None and self.window > end:
            raise refuse(f"is longer than time.end = {end:g} s; lower it, or take 'auto'", key="window")
        limit = end if self.window is None else self.window
        if self.step is not None and self.step > limit:
            raise refuse(f"is longer than the window or the end ({limit:g} s); lower it, or take 'auto'", key="step")
        return self

    @property
    def end_time(self) -> float:
        """`end` [s], in the scene of a plan (`emclutch.simulation.plan.Plan.scene`), in which strains are times."""
        assert not isinstance(self.end, Scaled)
        return self.end

    @property
    def longest_step(self) -> float:
        """Length [s] that no step of the grains exceeds: of a window that is given, or of the run."""
        return self.end_time if self.window is None else min(self.window, self.end_time)

    @property
    def average_time(self) -> float | None:
        """`average_from` [s] or None, as `end_time`."""
        assert not isinstance(self.average_from, Scaled)
        return self.average_from


def not_before(start: float | Scaled | None, end: float | Scaled | None) -> bool:
    """Return whether a start is not before an end; False where one is a time [s] and the other a strain, or missing."""
    if isinstance(start, Scaled) and isinstance(end, Scaled):
        return start.value >= end.value
    return isinstance(start, float) and isinstance(end, float) and start >= end


def instant_in_words(instant: float | Scaled) -> str:
    """Return a time [s] with its unit, or a strain."""
    return str(instant) if isinstance(instant, Scaled) else f"{instant:g} s"


class AccuracySection(Section):
    """Wanted uncertainty of the torque, number of replicas, and values at which the settings are measured."""

    target: Annotated[Fraction, FractionEntry()] | None = Field(
        default=None,
        description="half the 95 % interval of the torque that is asked for, statistics and discretisation together: "
        "the run takes the cheapest settings that reach it from the device's accuracy study, and ends when it is "
        "reached",
    )
    budget: Time = Field(
        default=1200.0, description="wall-clock time of the accuracy study of `target` where there is none yet"
    )
    values: ValuesSection = ValuesSection()
    time_end: TimeOrStrain | None = Field(
        default=None,
        description="end of the runs of an accuracy study; default: twice the start-up, else time.end",
        examples=["strain 20"],
    )
    inertial_number: Annotated[float, number("0.03", 0.0, 1.0, above=True)] | None = Field(
        default=None,
        description="shear the gap at this expected inertial number instead of at the scene's speeds, which are all "
        "multiplied by one factor; for quasi-static powder, whose torque does not depend on the slip",
    )
    replicas: Annotated[Annotated[int, Integer(1, 64, "4")] | None, Automatic()] = Field(
        default=None,
        description="runs of the scene with different seeds, from which the torque and its error come; as many "
        "at a time as there are cores for. auto: 4 for a steady torque of grains that are packed at random, and with "
        "time.until more where they are needed; else 1",
    )
    max_replicas: Annotated[int, Integer(4, 64, "24")] = Field(
        default=24, description="largest number of replicas of a run with time.until and replicas = 'auto'"
    )
    replica_scatter: Annotated[Fraction, FractionEntry()] | None = Field(
        default=None,
        description="relative standard deviation between replicas of the mean torque, as an accuracy study has "
        "measured it for runs to time.end; it is pooled with the run's own scatter (needs replica_scatter_freedom)",
        examples=["0.9 %"],
    )
    replica_scatter_freedom: Annotated[int, Integer(1, MAX_SCATTER_FREEDOM, "16")] | None = Field(
        default=None,
        description="degrees of freedom of replica_scatter: replicas of the study less its settings. With more than 3 "
        "a run with time.until begins with 2 replicas; up to 3 stand for a study of another current",
    )


class OutputSection(Section):
    """Output of a run."""

    folder: str | None = Field(default=None, min_length=1, description="folder of the run; --out wins over it")
    snapshots: Annotated[int, Integer(0, 100_000, "20")] = Field(default=20, description="number of VTK snapshots")
    formats: tuple[Annotated[str, Choice(("vtk", "hdf5"), planned=("vtkhdf",))], ...] = ("vtk", "hdf5")
    energy_budget: StrictBool = Field(
        default=True, description="keep the energy budget; without it a step of the grains is a fifth cheaper"
    )
    pictures: StrictBool = Field(default=True, description="PNG plots")
    profiles: StrictBool = Field(
        default=False,
        description="profiles.csv: fill, flow, stress and torque across the gap; wall_pressure.csv: pressure and shear "
        "stress along the walls; means of the run's second half (or from time.average_from)",
    )
    checkpoint: StrictBool = Field(default=True, description="checkpoints, so that a run can be resumed")
