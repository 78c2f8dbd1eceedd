"""What a run writes while it runs: history, record, ParaView series and checkpoints, as callbacks of the loop."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from coupling import CoilField, LayeredField, Simulation, SolidCoilField
from emclutch.field_arrays import field_arrays, solid_field_arrays
from emclutch.results import HistoryWriter, RunFolder
from emclutch.results.checkpoint import write_checkpoint
from emclutch.results.record import Record
from emclutch.results.vtk_series import PvdSeries
from particles import GrainMotion

if TYPE_CHECKING:
    from emclutch.profile_average import ProfileAverage


class Snapshots:
    """Writes `count` frames evenly over the run (and the start), grains, walls, contacts and field.

    Parameters
    ----------
    folder : RunFolder
    walls : list of Wall
    windows, count : int
        Windows of the whole run; frames.
    formats : tuple of str
        "vtk", "hdf5".
    resume_time : float or None
        Later frames of an interrupted run are removed [s].
    ends_early : function
        Whether the run ends with the present window, of which a frame is then written too.
    """

    def __init__(
        self,
        folder: RunFolder,
        walls,
        windows: int,
        count: int,
        formats,
        case_text: str,
        resume_time: float | None,
        ends_early: Callable[[], bool] = lambda: False,
    ):
        self._ends_early = ends_early
        self._walls = walls
        self._at = {round(k * windows / count) for k in range(1, count + 1)} if count else set()
        self._series = {}
        if "vtk" in formats and count:
            self._series = {
                name: PvdSeries(folder.path, name, resume_time=resume_time)
                for name in ("particles", "field", "walls", "contacts")
            }
        self.record = None
        if "hdf5" in formats:
            self.record = Record.open(
                folder.record,
                "w" if resume_time is None else "a",
                case_text=case_text,
                provenance_text=folder.provenance.read_text(),
                resume_time=resume_time,
            )

    def __call__(self, simulation: Simulation, row: dict) -> None:
        if self.record is not None:
            self.record.append_observables(row, step=simulation.motion.step_count)
        if simulation.window in self._at or (self._at and self._ends_early()):
            self.write(simulation)

    def write(self, simulation: Simulation) -> None:
        """Write a frame of everything now."""
        dem, grains = simulation.motion, simulation.motion.grains
        arrays = {
            "radius": grains.radius,
            "velocity": grains.velocity,
            "angular_velocity": grains.angular_velocity,
            "particle_id": grains.particle_id,
            "force_contact": dem.contact_force,
            "n_contacts": contacts_per_grain(dem),
        }
        if grains.magnetic_moment is not None:
            arrays["magnetic_moment"] = grains.magnetic_moment
        if dem.external_force is not None:
            arrays["force_magnetic"] = dem.external_force
        if self.record is not None:
            self.record.append_grains(dem.step_count, dem.time, {"position": grains.position, **arrays})
        if not self._series:
            return
        self._series["particles"].write_particles(dem.time, grains.position, arrays)
        self._series["walls"].write_walls(
            dem.time,
            self._walls,
            angles={b.name: b.angle for b in dem.bodies},
            speeds={b.name: b.speed for b in dem.bodies},
            sector_angle=None if dem.sector is None else dem.sector.angle,
        )
        self._series["contacts"].write_contacts(dem.time, *contact_lines(dem))
        if isinstance(simulation.source, CoilField):
            self._write_field(dem.time, simulation.source)
        elif isinstance(simulation.source, SolidCoilField) and simulation.source.solution is not None:
            solution = simulation.source.solution
            self._series["field"].write_solid_field(
                dem.time,
                *solid_field_arrays(solution),
                turned=simulation.source.carrier.angle,
                region_names=sorted(solution.problem.mesh.regions),
            )

    def _write_field(self, time: float, source: CoilField) -> None:
        assert source.solution is not None
        mesh = source.problem.mesh
        cells, at_points, names = field_arrays(source.solution)
        self._series["field"].write_field(
            time, mesh.points, mesh.triangles, cell_arrays=cells, point_arrays=at_points, region_names=names
        )

    def flush(self) -> None:
        """Write the rows that are kept back."""
        if self.record is not None:
            self.record.flush()

    def close(self) -> None:
        """Write what is still kept back, and close."""
        if self.record is not None:
            self.record.close()


def contacts_per_grain(dem: GrainMotion) -> np.ndarray:
    """Number of grains and walls that each grain touches, (n,) int64."""
    table = dem.contacts()
    return np.bincount(table.i, minlength=dem.grains.count) + np.bincount(
        table.j[table.j >= 0], minlength=dem.grains.count
    )


def contact_lines(dem: GrainMotion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Force chains: centre of grain i (m, 3), its partner's centre or the point on the wall, and the force [N] on i."""
    table, x = dem.contacts(), dem.grains.position
    partner = x[np.maximum(table.j, 0)]
    if dem.sector is not None:
        partner = dem.sector.turn(partner, table.shift)
    end = np.where((table.j >= 0)[:, None], partner, table.point)
    return x[table.i], end, table.force


class History:
    """Callback that writes history.csv."""

    def __init__(self, path: Path, resume_time: float | None):
        self._writer = HistoryWriter(path, resume_time=resume_time)

    def __call__(self, simulation: Simulation, row: dict) -> None:
        self._writer.append(row)

    def close(self) -> None:
        """Close the file."""
        self._writer.close()


def save_checkpoint(path: Path, simulation: Simulation, case_text: str, profiles: ProfileAverage | None = None) -> None:
    """Everything that a bit-exact continuation needs."""
    state = {
        "case": case_text,
        "window": simulation.window,
        "steps_per_update": simulation.steps_per_update,
        "updates": simulation.updates,
        "dem": simulation.motion.state(),
        "rows": simulation.rows_state(),
        "source": None,
    }
    source = simulation.source
    if isinstance(source, (CoilField, SolidCoilField, LayeredField)):
        state["source"] = source.state()
    if profiles is not None:
        state["profiles"] = profiles.state()
    write_checkpoint(path, state)
