"""`emclutch materials NAME --pair-force`: the force between two grains of a powder against their gap, and why."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from emclutch.results.new_path import new_picture, numbered_file
from emclutch.results.report.report import Report, Shown, Statements, Table, note
from emclutch.results.text import in_words
from emclutch.scene.errors import Fault, SceneError
from field.laws.materials import grain_material
from field.laws.reluctivity import MU_0

if TYPE_CHECKING:
    from field.spheres.pair_table import PairTable

# Applied fields of the picture and the table [A/m], gaps of the table [radii]; of grains of this radius [m].
_FIELDS = (5e3, 18e3, 46e3, 80e3, 200e3, 500e3)
_GAPS = (0.001, 0.003, 0.01, 0.03, 0.1, 0.3, 1.0)
_RADIUS = 50e-6
# Beyond this gap [radii] the neck is negligible.
_NECK = 0.1


def pair_force(name: str, out: Path | None = None) -> Report:
    """Draw and tabulate the force between two grains of a powder by its name.

    Parameters
    ----------
    name : str
        Of a grain material, e.g. `carbonyl_iron`.
    out : Path or None
        New picture (.png); None: the next free <name>-pair-force-<n>.png here.

    Raises
    ------
    SceneError
        An unknown powder, or a file that is no .png.
    OutputError
        There is a file already; nothing is overwritten.
    """
    from emclutch.results.progress import Progress
    from field.spheres.pair_table import pair_table

    try:
        law = grain_material(name).law
    except ValueError as error:
        raise SceneError([Fault("", "", str(error))], "command line") from None
    out = numbered_file(Path(), f"{name}-pair-force", ".png") if out is None else new_picture(out)
    with Progress(f"two grains of {name}") as progress:
        table = pair_table(law, progress=lambda done, of: progress.update(done / of))
    return _report(name, table, _draw(name, table, out))


def _report(name: str, table: PairTable, picture: Path) -> Report:
    """Forces at a few gaps and fields, with the two-zone estimate in brackets."""
    from field.spheres.neck_estimate import two_zone_force

    unit = MU_0 * table.Ms**2 * _RADIUS**2
    h, rows = np.array(_FIELDS) / table.Ms, []
    for gap in _GAPS:
        F, estimate = 1e6 * unit * table.force_of(gap, h), 1e6 * unit * two_zone_force(gap, h)
        shown = [
            _figures(a) if gap > _NECK else f"{_figures(a)} ({_figures(b)})" for a, b in zip(F, estimate, strict=True)
        ]
        rows.append((f"{gap:g}", *shown))
    grains = f"two grains of {1e6 * _RADIUS:g} µm radius on a line along the field"
    lines = [
        note(f"{name}: attraction of {grains} [µN]. It is proportional to the square of the radius."),
        note("In brackets: estimate by the formula of two zones (unsaturated and saturated) of the neck."),
    ]
    head = ("gap/radius", *(f"{H / 1e3:g} kA/m" for H in _FIELDS))
    report = Report(f"{name}: attraction of {grains}", closing=str(picture))
    report.add("Force", [Statements(lines), Table(rows, head, range(len(head)))], Shown.TERMINAL)
    return report


def _figures(value: float) -> str:
    """Three figures without an exponent."""
    return f"{value:.0f}" if value >= 100.0 else f"{value:.3g}"


def _draw(name: str, table: PairTable, path: Path) -> Path:
    """Force against gap at a few fields: of the table, of the neck's two zones, of dipoles with the same moments."""
    from emclutch.results.pictures.figure import new_figure, save_picture
    from field.spheres.neck_estimate import two_zone_force

    title = f"Force between two grains of {in_words(name)} along the field, Ms = {1e-6 * table.Ms:.3g} MA/m"
    figure, (axes,) = new_figure(9.0, 5.6, title)
    g = np.geomspace(table.gap[0], 1.0, 200)
    near = g[g <= _NECK]
    for number, H in enumerate(_FIELDS):
        h = H / table.Ms
        dipoles = np.pi / 6.0 * table.moment_of(g, h) ** 2 * (2.0 / (2.0 + g)) ** 4
        axes.loglog(g, table.force_of(g, h), color=f"C{number}", lw=1.6, label=f"{H / 1e3:g} kA/m")
        axes.loglog(near, two_zone_force(near, h), color=f"C{number}", lw=1.0, ls="--")
        axes.loglog(g, dipoles, color=f"C{number}", lw=0.8, ls=":")
    axes.set(xlabel="gap / radius [1]", ylabel="attraction / (µ₀ Ms² radius²) [1]")
    axes.grid(True, which="both", lw=0.3, alpha=0.5)
    models = {"finite elements": "-", "two zones of the neck": "--", "dipoles with the same moments": ":"}
    drawn_as = [axes.plot([], [], color="k", lw=1.0, ls=line)[0] for line in models.values()]
    axes.add_artist(axes.legend(drawn_as, models, loc="lower left", fontsize=8, frameon=False))
    figure.legend(title="applied field", loc="outside right upper", fontsize=8, frameon=False)
    return save_picture(figure, path)
