"""The command line: each command reads its input, calls one function of the package and says what came of it.

Exit codes: 0 done, 1 the run failed, 2 bad input, 130 stopped by Ctrl-C. A user's mistake never ends in a
traceback, and no command overwrites anything. The working functions are imported by the command that needs them, so
that `--help` and `schema` start at once.
"""

from __future__ import annotations

import json
from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console

from emclutch import __version__
from emclutch.cli.errors import FAILED, explained, stop
from emclutch.cli.input import check_threads, load, run_to_resume, search, study_to_check
from emclutch.cli.options import (
    AsHtml,
    AsJson,
    AsMarkdown,
    CaseFile,
    CheckedFile,
    Chi,
    ColourBy,
    Confirm,
    Currents,
    CurvePicture,
    DesignSource,
    DipoleModel,
    DryRun,
    ExportFormat,
    FieldList,
    FillList,
    FrictionAsked,
    GrainCount,
    Insist,
    Jobs,
    Like,
    Lines,
    Look,
    MaterialNames,
    Measured,
    Moment,
    Movie,
    NewFile,
    NewPicture,
    NewScene,
    Out,
    PairForceAsked,
    ParaViewAsked,
    PowderName,
    ResultPath,
    Resume,
    RunPath,
    RunPaths,
    RunSource,
    Saturation,
    SceneKind,
    Screenshot,
    Seeds,
    Sets,
    SpeedsAsked,
    Strain,
    StudyFile,
    Target,
    Threads,
    TorqueSpeedAsked,
    TrustScripts,
    Vary,
)
from emclutch.cli.output import print_json, tell_design, tell_plan, tell_study, torque_line
from emclutch.scene.errors import Fault, SceneError, bad_input_for

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Torque of electromagnetic particle clutches and brakes: field, grains and their coupling.",
)


def main() -> None:
    """Entry point of the console script."""
    app(prog_name="emclutch")


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"emclutch {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, typer.Option("--version", callback=_print_version, is_eager=True, help="print the version and stop")
    ] = False,
) -> None:
    """Options of the program itself."""


@app.command()
def run(
    case: RunSource,
    out: Out = None,
    sets: Sets = None,
    resume: Resume = False,
    threads: Threads = None,
    dry_run: DryRun = False,
    as_json: AsJson = False,
    trust_scripts: TrustScripts = False,
    insist: Insist = False,
) -> None:
    """Simulate one scene."""
    with explained():
        check_threads(threads)
        if resume and case.is_dir():
            case, out = run_to_resume(case, out)
        read = load(case, sets, trust_scripts)
        if resume and out is None and read.scene.output.folder is None:
            message = f"needs a run; name the run's folder: emclutch run FOLDER --resume, not the scene {case}"
            raise SceneError([Fault("--resume", "", message)], "command line")
        if dry_run:
            tell_plan(read, as_json, threads)
            return
        from emclutch.results import Progress
        from emclutch.simulation.run import run as run_scene

        with nullcontext() if as_json else Progress() as progress:
            result = run_scene(read, out=out, threads=threads, resume=resume, progress=progress, insist=insist)
        if as_json:
            print_json(result.summary)
        else:
            from emclutch.results.report.markdown import closing_lines

            typer.echo(torque_line(result.summary.get("torque")))
            for line in closing_lines(result):
                typer.echo(line)
            typer.echo(f"results and pictures: {result.folder.path}")


@app.command()
def check(
    case: CheckedFile,
    sets: Sets = None,
    jobs: Jobs = 1,
    as_json: AsJson = False,
    trust_scripts: TrustScripts = False,
) -> None:
    """Validate a scene, and say what follows from it; of a study each point's plan, and the time of all."""
    with explained():
        if (study := study_to_check(case, sets, jobs, trust_scripts)) is not None:
            tell_study(study, jobs, as_json)
            return
        tell_plan(load(case, sets, trust_scripts), as_json)


@app.command()
def sweep(
    study: StudyFile,
    out: Out = None,
    resume: Resume = False,
    jobs: Jobs = 1,
    threads: Threads = None,
    trust_scripts: TrustScripts = False,
    insist: Insist = False,
) -> None:
    """Simulate every point of a parameter study, several at a time with --jobs."""
    with explained():
        from emclutch.scene.study import read_study

        check_threads(threads)
        if resume and out is None:
            message = "needs a study that was begun; name the study's folder with --out"
            raise SceneError([Fault("--resume", "", message)], "command line")
        read = read_study(study, trust_scripts=trust_scripts)
        from emclutch.results.study_table import StudyTable
        from emclutch.studies.forecast import foretell_study
        from emclutch.studies.points import done_points
        from emclutch.studies.sweep import sweep as sweep_study

        done = done_points(read, out) if resume and out is not None else []
        if (foretold := foretell_study(read, jobs, done)).points:
            typer.echo(foretold.in_words(), err=True)
        with StudyTable() as table:
            folder = sweep_study(
                read, out=out, threads=threads, resume=resume, jobs=jobs, progress=table, insist=insist
            )
        compared = folder / "methods.txt"
        if compared.is_file():
            typer.echo(compared.read_text(encoding="utf-8"), nl=False)
        typer.echo(f"results and pictures: {folder}")


@app.command()
def accuracy(
    case: CaseFile, out: Out = None, sets: Sets = None, threads: Threads = None, trust_scripts: TrustScripts = False
) -> None:
    """Measure what accuracy costs in time."""
    with explained():
        check_threads(threads)
        read = load(case, sets, trust_scripts)
        from emclutch.results import Progress
        from emclutch.studies.work_precision import accuracy as measure_accuracy

        with Progress() as progress:
            folder = measure_accuracy(read, out=out, threads=threads, progress=progress)
        typer.echo(f"results and pictures: {folder}")


@app.command()
def field(
    case: CaseFile,
    current: Currents = None,
    line: Lines = None,
    out: Out = None,
    sets: Sets = None,
    as_json: AsJson = False,
    trust_scripts: TrustScripts = False,
) -> None:
    """Solve the field alone: gap field, inductance, energy, force, error, at one current or along a sweep."""
    with explained():
        read = load(case, sets, trust_scripts)
        from emclutch.studies import field as field_study
        from emclutch.studies.field_result import field as solve_field

        with bad_input_for(case):
            currents = None if current is None else field_study.read_currents(current)
            lines = [field_study.read_line(text) for text in line or ()]
        found = solve_field(read, currents, lines, out)
        if as_json:
            print_json(found.summary)
        else:
            Console().print(*field_study.tables_of(found.summary), sep="\n")
            typer.echo(f"results and pictures: {found.folder}")


@app.command()
def mesh(case: CaseFile, out: Out = None, sets: Sets = None, trust_scripts: TrustScripts = False) -> None:
    """Write the mesh of the cross-section (.msh) and its picture with the regions named."""
    with explained():
        read = load(case, sets, trust_scripts)
        from emclutch.studies.mesh import mesh as mesh_scene

        made = mesh_scene(read, out=out)
        typer.echo(f"{made.file}\n{made.picture}\n{len(made.mesh.triangles)} triangles")


@app.command()
def plot(
    folders: RunPaths,
    speeds: SpeedsAsked = False,
    torque_speed: TorqueSpeedAsked = False,
    measured: Measured = None,
    out: NewPicture = None,
    trust_scripts: TrustScripts = False,
) -> None:
    """Draw runs, or a study's points, over one another in a new file: torques with their 95 % bands, or speeds.

    A finished run that was killed before its own pictures gets them.
    """
    with explained():
        from emclutch.cli import plot as drawn

        if speeds and torque_speed:
            message = "makes another picture than --speeds; ask for one at a time"
            raise SceneError([Fault("--torque-speed", "", message)], "command line")
        kind = drawn.SPEEDS if speeds else drawn.TORQUE_SPEED if torque_speed else drawn.TORQUE
        picture = drawn.plot_runs(
            folders, kind, measured=measured, out=out, trust_scripts=trust_scripts, tell=typer.echo
        )
        typer.echo(str(picture))


@app.command()
def view(
    folder: RunPath,
    look: Look = None,
    colour: ColourBy = None,
    time: Moment = None,
    screenshot: Screenshot = None,
    movie: Movie = None,
    paraview: ParaViewAsked = False,
) -> None:
    """Show a run in 3D: in a window, as a picture or a movie, or in ParaView."""
    with explained():
        from emclutch.cli import view as viewed

        if paraview:
            if (look, colour, time, screenshot, movie) != (None,) * 5:
                message = "has its choices at the head of the script and as options of pvbatch; name the run alone"
                raise SceneError([Fault("--paraview", "", message)], "command line")
            typer.echo(viewed.open_in_paraview(folder))
            return
        for path in viewed.view_run(folder, look=look, colour=colour, time=time, screenshot=screenshot, movie=movie):
            typer.echo(str(path))


@app.command()
def report(folder: ResultPath, out: NewFile = None, html: AsHtml = False) -> None:
    """Write a run as a page of Markdown; with --html a run or a study as one page for a browser, pictures inside."""
    with explained():
        if html:
            from emclutch.results.report.html import write_page
            from emclutch.simulation.left_out_of_run import left_out_of

            typer.echo(str(write_page(folder, left_out_of, out)))
            return
        from emclutch.results import load_result
        from emclutch.results.report.markdown import report as page_of
        from emclutch.results.study_folder import is_study

        if is_study(folder):
            message = f"is missing: the report of a study is a page for a browser: emclutch report {folder} --html"
            raise SceneError([Fault("--html", "", message)], "command line")
        text = page_of(load_result(folder), Path.cwd() if out is None else out.parent)
        if out is None:
            typer.echo(text)
            return
        with open(out, "x", encoding="utf-8") as stream:
            stream.write(text)
        typer.echo(str(out))


@app.command()
def export(folder: ResultPath, to: ExportFormat, out: Out = None) -> None:
    """Write the history and profiles of a run, or of all points of a study, for other programs."""
    with explained():
        from emclutch.cli.export import Format
        from emclutch.cli.export import export as export_tables

        if to not in list(Format):
            allowed = ", ".join(Format)
            raise SceneError([Fault("--to", to, f"is no format; allowed: {allowed}")], "command line")
        typer.echo(str(export_tables(folder, Format(to), out)))


@app.command()
def materials(
    names: MaterialNames = None,
    picture: CurvePicture = None,
    pair_force: PairForceAsked = False,
    out: NewPicture = None,
    as_json: AsJson = False,
) -> None:
    """List the built-in magnetic materials, draw the curves of some, or the force between two grains of one."""
    with explained():
        if pair_force:
            _tell_pair_force(names or [], picture, out, as_json)
            return
        if out is not None:
            message = "names the picture of --pair-force; that of the curves is named with --plot"
            raise SceneError([Fault("--out", str(out), message)], "command line")
        from emclutch.cli import materials as materials_command

        if picture is not None:
            with bad_input_for(picture):
                laws = materials_command.laws_of(names or materials_command.material_names())
                typer.echo(str(materials_command.draw_materials(laws, picture)))
        elif as_json:
            print_json(materials_command.materials_as_data(names))
        else:
            materials_command.materials_page(names)


@app.command()
def calibrate(
    material: PowderName = None,
    chi: Chi = None,
    ms: Saturation = None,
    fill: FillList = "0.32",
    field_strength: FieldList = "18 kA/m, 46 kA/m, 80 kA/m, 200 kA/m, 500 kA/m",
    seeds: Seeds = 2,
    grains: GrainCount = 600,
    strain: Strain = 2.5,
    friction: FrictionAsked = 0.3,
    model: DipoleModel = "near_field",
    out: Out = None,
    as_json: AsJson = False,
) -> None:
    """Shear a powder in a periodic cell: shear stress and permeability against the field; finished points are kept."""
    with explained():
        from emclutch.cli import calibrate as command

        name, law = command.grains_of(material, chi, ms)
        points = command.points_of(
            law, fill, field_strength, seeds=seeds, grains=grains, strain=strain, friction=friction, model=model
        )
        folder, rows = command.calibrate(name, points, out, quiet=as_json)
        if as_json:
            print_json(command.as_data(name, folder, rows))
        else:
            Console().print(command.table_of(name, rows))
            typer.echo(f"results and pictures: {folder}")


@app.command()
def design(
    file: DesignSource,
    vary: Vary = None,
    target: Target = None,
    like: Like = None,
    confirm: Confirm = False,
    out: Out = None,
    sets: Sets = None,
    threads: Threads = None,
    as_json: AsJson = False,
    trust_scripts: TrustScripts = False,
) -> None:
    """Search the value of one key that gives a wanted torque, over the expected torque; a run confirms it."""
    with explained():
        check_threads(threads)
        asked = search(file, vary, target, sets, trust_scripts)
        from emclutch.results import Progress
        from emclutch.studies import design_search

        with nullcontext() if as_json or not confirm else Progress() as progress:
            found = design_search.design(asked, like=like, out=out, confirm=confirm, threads=threads, progress=progress)
        tell_design(found, as_json)


@app.command()
def new(file: NewScene, kind: SceneKind = "drum") -> None:
    """Write a scene of a kind, with every key, its unit and what it is for; nothing is overwritten."""
    with explained():
        from emclutch.cli.new import new_scene

        for written in new_scene(file, kind):
            typer.echo(str(written))


@app.command()
def schema(out: NewFile = None, markdown: AsMarkdown = False) -> None:
    """Write the JSON schema of a scene, with which editors complete and check."""
    from emclutch.scene.model import Scene
    from emclutch.scene.reference import scene_reference

    text = scene_reference() if markdown else json.dumps(Scene.model_json_schema(), indent=2)
    text = text.rstrip("\n")
    if out is None:
        typer.echo(text)
        return
    with explained():
        with open(out, "x", encoding="utf-8") as stream:
            stream.write(text + "\n")
        typer.echo(str(out))


@app.command()
def doctor() -> None:
    """Tell whether this machine has what the program needs."""
    from emclutch.cli.doctor import examine

    table, good = examine()
    Console().print(table)
    if not good:
        stop(
            "something is missing; run `make setup`, which installs it; gmsh's shared libraries are in the README",
            FAILED,
        )


def _tell_pair_force(names: list[str], picture: Path | None, out: Path | None, as_json: bool) -> None:
    if len(names) != 1 or picture is not None or as_json:
        message = "takes the name of one powder and --out FILE, and neither --plot nor --json"
        raise SceneError([Fault("--pair-force", "", message)], "command line")
    from emclutch.cli.pair_force import pair_force

    path, table = pair_force(names[0], out)
    Console().print(table)
    typer.echo(str(path))


if __name__ == "__main__":
    main()
