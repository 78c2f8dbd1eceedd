"""The commands that show what a run or a study has found: plot, view, report, export."""

from __future__ import annotations

from pathlib import Path

import typer

from emclutch.cli import options as opt
from emclutch.cli.errors import explained
from emclutch.scene.errors import Fault, SceneError


def plot(
    folders: opt.RunPaths,
    speeds: opt.SpeedsAsked = False,
    torque_speed: opt.TorqueSpeedAsked = False,
    torque_current: opt.TorqueCurrentAsked = False,
    grain_size: opt.GrainSizeAsked = False,
    rated: opt.Rated = None,
    measured: opt.Measured = None,
    out: opt.NewPicture = None,
    trust_scripts: opt.TrustScripts = False,
) -> None:
    """Draw several runs, points of studies, or switched coils (field --transient) in one picture.

    Runs are drawn as torque against time with 95 % bands, or as the curve that an option names.

    If a run was killed before it drew its own pictures, these are drawn too.
    """
    with explained():
        from emclutch.cli import plot as drawn

        pictures = {drawn.SPEEDS: speeds, drawn.TORQUE_SPEED: torque_speed, drawn.TORQUE_CURRENT: torque_current,
                    drawn.GRAIN_SIZE: grain_size}  # fmt: skip
        first, *more = [kind for kind, asked in pictures.items() if asked] or [drawn.TORQUE]
        if more:
            option, other = (f"--{kind.replace('_', '-')}" for kind in (more[0], first))
            message = f"makes another picture than {other}; ask for one at a time"
            raise SceneError([Fault(option, "", message)], "command line")
        picture = drawn.plot_runs(
            folders, first, rated=rated, measured=measured, out=out, trust_scripts=trust_scripts, log=typer.echo
        )
        typer.echo(str(picture))


def view(
    folder: opt.RunPath,
    look: opt.Look = None,
    colour: opt.ColourBy = None,
    field: opt.FieldShown = None,
    ring: opt.FullRing = False,
    time: opt.Moment = None,
    screenshot: opt.Screenshot = None,
    movie: opt.Movie = None,
    paraview: opt.ParaViewAsked = False,
) -> None:
    """Show a run in 3D: in a window, as a picture or a movie, or in ParaView."""
    with explained():
        from emclutch.cli import view as viewed

        if paraview:
            if ring or (look, colour, field, time, screenshot, movie) != (None,) * 6:
                message = "has its choices at the head of the script and as options of pvbatch; name the run alone"
                raise SceneError([Fault("--paraview", "", message)], "command line")
            typer.echo(viewed.open_in_paraview(folder))
            return
        for path in viewed.view_run(
            folder, look=look, colour=colour, field=field, ring=ring, time=time, screenshot=screenshot, movie=movie
        ):
            typer.echo(str(path))


def report(
    folder: opt.ResultPath, out: opt.NewFile = None, html: opt.AsHtml = False, measured: opt.Catalogue = None
) -> None:
    """Write the report of a run or a study, as Markdown or as one HTML page."""
    with explained():
        from emclutch.results.report.render import markdown, write_new, write_page
        from emclutch.results.report.report import Picture, Section
        from emclutch.results.study_result import report_on
        from emclutch.simulation.check import omitted_effects_of

        page = report_on(folder, omitted_effects_of)
        if measured is not None:
            from emclutch.cli import plot as drawn

            def draw(path: Path) -> Path:
                return drawn.plot_runs([folder], drawn.TORQUE_CURRENT, measured=measured, out=path)

            picture = Picture(f"torque against current, with {measured.name} laid over", draw=draw)
            if not html:
                picture.png()  # a wrong table is an error, of a page without pictures too
            page.sections.insert(1, Section("Beside measured torques", [picture]))
        if html:
            typer.echo(str(write_page(page, out)))
        elif out is None:
            typer.echo(markdown(page, Path.cwd()))
        else:
            typer.echo(str(write_new(out, markdown(page, out.parent))))


def export(folder: opt.ResultPath, to: opt.ExportFormat, out: opt.Out = None) -> None:
    """Write the history and profiles of a run, or of all points of a study, for other programs."""
    with explained():
        from emclutch.cli.export import Format
        from emclutch.cli.export import export as export_tables

        if to not in list(Format):
            allowed = ", ".join(Format)
            raise SceneError([Fault("--to", to, f"is not a format; allowed: {allowed}")], "command line")
        typer.echo(str(export_tables(folder, Format(to), out)))
