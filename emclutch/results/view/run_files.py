"""Viewable content of the files of a run: times, arrays, regions, bodies."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from matplotlib.colors import to_rgb

from emclutch.results.errors import OutputError
from emclutch.results.run_folder import RunFolder
from emclutch.results.vtk.data_set import array_names, read_data_set, read_texts
from emclutch.results.vtk.series import read_pvd
from geometry.drawing import part_colours

COLOURS = {
    "speed": ("velocity", "speed [m/s]"),
    "spin": ("angular_velocity", "angular speed [rad/s]"),
    "force": ("force_contact", "force of the contacts [N]"),
    "magnetic-force": ("force_magnetic", "magnetic force [N]"),
    "moment": ("magnetic_moment", "magnetic moment [A m²]"),
    "shear-stress": ("largest_shear_stress", "largest shear stress in a grain [Pa]"),
    "contacts": ("n_contacts", "contacts of a grain [1]"),
    "diameter": ("diameter", "diameter [m]"),
}
"""Quantities that grains can be coloured by: array (vectors count by their magnitude) and label with its unit."""


@dataclass(frozen=True, slots=True)
class RunFiles:
    """The series of a run.

    Attributes
    ----------
    folder : of the run.
    title : of its scene.
    sector : angle of the cyclic sector that the grains fill [rad]; None: the whole circle.
    times : moments of the run that were written [s].
    series : by name (particles, walls, contacts, field) the moments [s] and files that are there.
    colours : those of `COLOURS` whose array the grains have.
    bodies : names that the numbers of the walls' array `body` stand for.
    regions : names that the numbers of the field's array `region` stand for.
    field : "section", "space" or None.
    field_at_points : whether B and H stand at the field's points; else at its cells.
    """

    folder: Path
    title: str
    sector: float | None
    times: list[float]
    series: dict[str, list[tuple[float, Path]]]
    colours: dict[str, tuple[str, str]]
    bodies: list[str]
    regions: list[str]
    field: str | None
    field_at_points: bool

    @property
    def air(self) -> int | None:
        """Number of the air among the field's regions."""
        return self.regions.index("air") if "air" in self.regions else None

    @property
    def has_time(self) -> bool:
        """Whether its moments are times: a field that was solved alone, for constant currents, has one without."""
        return "particles" in self.series or len(self.times) > 1

    @property
    def shades(self) -> list[tuple[float, float, float]]:
        """Red, green and blue of each region, as in pictures of the section."""
        return [to_rgb(colour) for colour in part_colours(self.regions).values()]

    def file(self, name: str, time: float) -> Path | None:
        """The file of a series that shows a moment [s]: the latest one not after it, or the first."""
        written = self.series.get(name)
        if not written:
            return None
        before = [path for at, path in written if at <= time * (1.0 + 1e-9)]
        return before[-1] if before else written[0][1]

    def nearest_time(self, time: float | None) -> float:
        """The moment that was written nearest to a time [s]; None: the last."""
        return self.times[-1] if time is None else min(self.times, key=lambda t: abs(t - time))


def read_run_files(folder: str | Path) -> RunFiles:
    """Look into a run's folder, also of a run that continues, or of a field that was solved alone.

    Raises
    ------
    OutputError : there is nothing to look at, or a file is damaged.
    """
    run = RunFolder(folder)
    if not run.path.is_dir():
        raise OutputError(f"{run.path} is not a folder; name that of a run")
    series = {path.stem: found for path in run.series() if path.is_file() and (found := read_pvd(path))}
    if not series:
        raise OutputError(
            f"{run.path} holds no series for looking at; a run writes them with output.formats = ['vtk'] and "
            "output.snapshots > 0, at the end of its first window"
        )
    scene = run.read_scene() if run.case.is_file() else {}
    first = {name: read_data_set(written[0][1]) for name, written in series.items()}
    at_points = {name: array_names(data.GetPointData()) for name, data in first.items()}
    colours = {name: known for name, known in COLOURS.items() if known[0] in at_points.get("particles", ())}
    field = None
    if "field" in first:
        field = "section" if "vector_potential" in at_points["field"] else "space"
    return RunFiles(
        folder=run.path.resolve(),
        title=scene.get("scene", {}).get("title") or run.path.resolve().name,
        sector=scene.get("particles", {}).get("sector"),
        times=[time for time, _ in series.get("particles", next(iter(series.values())))],
        series=series,
        colours=colours,
        bodies=read_texts(first["walls"], "body_names") if "walls" in first else [],
        regions=read_texts(first["field"], "region_names") if "field" in first else [],
        field=field,
        field_at_points="flux_density" in at_points.get("field", ()),
    )
