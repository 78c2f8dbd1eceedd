"""Callbacks of the loop that write history, record and ParaView series."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np

from coupling import Simulation, WindowRow
from coupling.staggered import forces_of_the_field
from emclutch.results import HistoryWriter, RunFolder
from emclutch.results.columns import columns_of
from emclutch.results.record import Record
from emclutch.results.view.paraview_script import write_script
from emclutch.results.view.run_files import read_run_files
from emclutch.results.vtk.field_arrays import field_arrays, field_arrays_3d
from emclutch.results.vtk.flux_lines import flux_lines
from emclutch.results.vtk.series import PvdSeries
from field import MagneticField
from field.three_d import Field3D
from particles import GrainMotion
from particles.diagnostics.stress import grain_stress, largest_shear_stress


class Snapshots:
    """Writer of `count` frames evenly over the run (and the start): grains, walls, contacts and field.

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
                for name in ("particles", "field", "flux_lines", "walls", "contacts")
            }
        self._folder = folder.path
        self._script_is_due = bool(self._series)
        self.record = None
        if "hdf5" in formats:
            self.record = Record.open(
                folder.record,
                "w" if resume_time is None else "a",
                case_text=case_text,
                provenance_text=folder.provenance.read_text(),
                resume_time=resume_time,
            )

    def begin(self, simulation: Simulation) -> None:
        """Write the frame of t = 0: the grains as they were packed; no force has acted yet.

        Forces of the contacts are not asked for: without a field the step would be compiled once more.
        """
        if self._at:
            count = simulation.motion.grains.count
            self._write_grains(simulation, np.zeros(count, dtype=np.int64), (np.zeros((0, 3)),) * 3)

    def begin_field(self, simulation: Simulation) -> None:
        """Write the field of t = 0."""
        self._write_field(simulation, simulation.motion.time)

    def __call__(self, simulation: Simulation, row: WindowRow) -> None:
        if self.record is not None:
            self.record.append_observables(columns_of(row), step=simulation.motion.step_count)
        if self._script_is_due:  # every series has begun
            write_script(read_run_files(self._folder))
            self._script_is_due = False
        if simulation.window in self._at or (self._at and self._ends_early()):
            self.write(simulation)

    def write(self, simulation: Simulation) -> None:
        """Write a frame of everything."""
        motion = simulation.motion
        self._write_grains(simulation, contacts_per_grain(motion), contact_lines(motion))
        self._write_field(simulation, motion.time)

    def _write_grains(self, simulation: Simulation, n_contacts: np.ndarray, lines: tuple[np.ndarray, ...]) -> None:
        motion, grains = simulation.motion, simulation.motion.grains
        position, velocity = wrapped(motion)
        arrays = {
            "radius": grains.radius,
            "velocity": velocity,
            "angular_velocity": grains.angular_velocity,
            "particle_id": grains.particle_id,
            "force_contact": motion.contact_force,
            "n_contacts": n_contacts,
        }
        held = {}
        if simulation.magnetised is not None:
            held = {"magnetic_moment": grains.magnetic_moment, "force_magnetic": forces_of_the_field(simulation)}
        elif simulation.has_lagged_forces:
            held = {"force_lagged": motion.external_force}
        for name, values in held.items():  # before the first window there are none
            arrays[name] = np.zeros_like(grains.position) if values is None else values
        if self.record is not None:
            self.record.append_grains(motion.step_count, motion.time, {"position": position, **arrays})
        if not self._series:
            return
        arrays["largest_shear_stress"] = np.zeros(grains.count)
        if len(lines[0]):
            stress = grain_stress(grains, motion.contacts(), motion.periodicity)
            arrays["largest_shear_stress"] = largest_shear_stress(stress)
        self._series["particles"].write_particles(motion.time, position, arrays)
        self._series["walls"].write_walls(
            motion.time,
            [] if motion.gap_box is not None else self._walls,  # faces whose axis is far away
            angles={b.name: b.angle for b in motion.bodies},
            speeds={b.name: b.speed for b in motion.bodies},
            sector_angle=None if motion.sector is None else motion.sector.angle,
        )
        self._series["contacts"].write_contacts(motion.time, *lines)

    def _write_field(self, simulation: Simulation, time: float) -> None:
        solution = None if simulation.source is None else simulation.source.solution
        if not self._series:
            return
        series = self._series["field"]
        if isinstance(solution, MagneticField):
            series.write_field(time, field_arrays(solution))
            self._series["flux_lines"].write_flux_lines(time, *flux_lines(solution))
        elif isinstance(solution, Field3D):
            carrier = simulation.field_carrier
            series.write_field_3d(
                time,
                *field_arrays_3d(solution),
                turned=carrier.angle if carrier is not None and time > 0.0 else 0.0,
                region_names=sorted(solution.problem.mesh.regions),
            )

    def flush(self) -> None:
        """Write the rows that are kept back."""
        if self.record is not None:
            self.record.flush()

    def close(self) -> None:
        """Write what is still kept back, and close."""
        if self.record is not None:
            self.record.close()


def contacts_per_grain(motion: GrainMotion) -> np.ndarray:
    """Return the number of grains and walls that each grain touches, (n,) int64."""
    table = motion.contacts()
    return np.bincount(table.i, minlength=motion.grains.count) + np.bincount(
        table.j[table.j >= 0], minlength=motion.grains.count
    )


def contact_lines(motion: GrainMotion) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return force chains: centre of grain i (m, 3), its partner's or the point on the wall, and the force [N] on i."""
    table, x = motion.contacts(), motion.grains.position
    partner = x[np.maximum(table.j, 0)]
    if motion.periodicity is not None:
        partner = motion.periodicity.place(partner, table.shift)
    begin, end = x[table.i], np.where((table.j >= 0)[:, None], partner, table.point)
    if motion.box is not None or motion.gap_box is not None:  # from where the grain is drawn
        moved = wrapped(motion)[0][table.i] - begin
        begin, end = begin + moved, end + moved
    return begin, end, table.force


def wrapped(motion: GrainMotion) -> tuple[np.ndarray, np.ndarray]:
    """Return positions (n, 3) [m] and velocities (n, 3) [m/s] of the grains, in a sheared box those inside of it.

    Between two lists of neighbours grains go on freely beyond its faces. Positions in a gap count from its corner.
    """
    position, velocity, gap = motion.grains.position, motion.grains.velocity, motion.gap_box
    box = motion.box if gap is None else gap
    if box is None:
        return position, velocity
    shift = box.wraps(position)
    place = box.place(position, shift)
    return place if gap is None else place - gap.corner, box.sweep(velocity, shift)


class History:
    """Callback that writes history.csv."""

    def __init__(self, path: Path, resume_time: float | None):
        self._writer = HistoryWriter(path, resume_time=resume_time)

    def __call__(self, simulation: Simulation, row: WindowRow) -> None:
        self._writer.append(columns_of(row))

    def close(self) -> None:
        """Close the file."""
        self._writer.close()
