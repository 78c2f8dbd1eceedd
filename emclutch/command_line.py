"""The command line: each command reads its input, calls one function of the package and says what came of it.

Exit codes: 0 done, 1 the run failed, 2 bad input, 130 stopped by Ctrl-C. A user's mistake never ends in a
traceback, and no command overwrites anything. The working functions are imported by the command that needs them, so
that `--help` and `schema` start at once.
"""

from __future__ import annotations

import json
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext
from pathlib import Path
from typing import Annotated, Any, NoReturn

import typer
from rich.console import Console
from rich.table import Table

from emclutch import __version__
from emclutch.case import Case, load_case, read_toml
from emclutch.faults import Fault, SceneError, shown

FAILED, BAD_INPUT, STOPPED = 1, 2, 130  # 130: 128 + SIGINT, as shells count it
_PACKAGES = ("emclutch", "geometry", "field", "particles", "coupling")

app = typer.Typer(
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Torque of electromagnetic particle clutches and brakes: field, grains and their coupling.",
)

RunSource = Annotated[
    Path, typer.Argument(metavar="CASE", help="scene file (.toml); with --resume the folder of a run")
]
CaseFile = Annotated[Path, typer.Argument(metavar="CASE", help="scene file (.toml)")]
StudyFile = Annotated[Path, typer.Argument(metavar="STUDY", help="study file (.toml)")]
RunPath = Annotated[Path, typer.Argument(metavar="RUN", help="folder of a run")]
RunPaths = Annotated[list[Path], typer.Argument(metavar="RUN...", help="folders of runs")]
SpeedsAsked = Annotated[bool, typer.Option("--speeds", help="speeds of motor and output against time")]
TorqueSpeedAsked = Annotated[bool, typer.Option("--torque-speed", help="torque on the output over the motor's speed")]
Measured = Annotated[
    Path | None,
    typer.Option("--measured", metavar="FILE", help="CSV to lay over --speeds: time [s], then speeds [rpm], named"),
]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="new folder for the results")]
Currents = Annotated[
    str | None,
    typer.Option(
        "--current", metavar="I", help="'0.5 A', a list '0 A, 1 A', or first : last : how many; default: the largest"
    ),
]
Lines = Annotated[
    list[str] | None,
    typer.Option("--line", metavar="R0,Z0,R1,Z1", help="write B and H along a line: '44 mm, 0 mm, 46 mm, 0 mm'"),
]
NewFile = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="new file; default: the terminal")]
NewPicture = Annotated[Path | None, typer.Option("--out", metavar="FILE", help="new picture (.png)")]
Sets = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="KEY=VALUE",
        help="set a key: coil.current='0.8 A'; KEY=none removes it; effects.NAME=off or on removes or adds an effect",
    ),
]
Resume = Annotated[bool, typer.Option("--resume", help="go on from the last checkpoint")]
Threads = Annotated[int | None, typer.Option("--threads", help="threads; results do not depend on them")]
Insist = Annotated[bool, typer.Option("--insist", help="run also where more memory is needed than is free")]
Jobs = Annotated[int, typer.Option("--jobs", min=1, help="points that run at a time, each in a process of its own")]
DryRun = Annotated[bool, typer.Option("--dry-run", help="stop after the plan; nothing is written")]
TrustScripts = Annotated[
    bool,
    typer.Option(
        "--trust-scripts", help="run a script (.geo) that the scene names as its geometry; it may run any command"
    ),
]
AsMarkdown = Annotated[bool, typer.Option("--markdown", help="a page of all keys for people to read")]
MaterialNames = Annotated[
    list[str] | None, typer.Argument(metavar="[NAME]...", help="materials, or files of a curve (.csv); default: all")
]
CurvePicture = Annotated[Path | None, typer.Option("--plot", metavar="FILE", help="new picture of B(H) and mu_r(B)")]
PairForceAsked = Annotated[
    bool, typer.Option("--pair-force", help="force between two grains of a powder against their gap (powder_iron)")
]
AsJson = Annotated[bool, typer.Option("--json", help="print JSON and nothing else")]
PowderName = Annotated[str | None, typer.Argument(metavar="[MATERIAL]", help="a powder by its name, as powder_iron")]
Chi = Annotated[float | None, typer.Option("--chi", help="susceptibility of the grains' material, in place of a name")]
Saturation = Annotated[str | None, typer.Option("--ms", metavar="M", help="its saturation: '1.7 MA/m'")]
FillList = Annotated[str, typer.Option("--fill", metavar="PHI", help="solid fractions: '0.32, 0.45'")]
FieldList = Annotated[
    str,
    typer.Option("--field", metavar="H", help="macroscopic fields: '18 kA/m, 80 kA/m', or first : last : how many"),
]
Seeds = Annotated[int, typer.Option("--seeds", min=1, max=99, help="cells that are averaged at each point")]
GrainCount = Annotated[int, typer.Option("--grains", min=1, max=1_000_000, help="grains in a cell")]
Strain = Annotated[float, typer.Option("--strain", min=1e-3, max=1e3, help="how far each cell is sheared")]
FrictionAsked = Annotated[float, typer.Option("--friction", min=0.0, max=10.0, help="Coulomb friction of the grains")]
DipoleModel = Annotated[str, typer.Option("--model", help="moments of the grains: near_field or mutual")]


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
    with _explained():
        _check_threads(threads)
        if resume and case.is_dir():
            case, out = _run_to_resume(case, out)
        read = _load(case, sets, trust_scripts)
        if resume and out is None and read.scene.output.folder is None:
            message = f"needs a run; name the run's folder: emclutch run FOLDER --resume, not the scene {case}"
            raise SceneError([Fault("--resume", "", message)], "command line")
        if dry_run:
            _tell_plan(read, as_json, threads)
            return
        from emclutch.results import Progress
        from emclutch.run_case import run as run_scene

        with nullcontext() if as_json else Progress() as progress:
            result = run_scene(read, out=out, threads=threads, resume=resume, progress=progress, insist=insist)
        if as_json:
            _print_json(result.summary)
        else:
            from emclutch.run_report import closing_lines

            typer.echo(torque_line(result.summary.get("torque")))
            for line in closing_lines(result):
                typer.echo(line)
            typer.echo(f"results and pictures: {result.folder.path}")


@app.command()
def check(case: CaseFile, sets: Sets = None, as_json: AsJson = False, trust_scripts: TrustScripts = False) -> None:
    """Validate a scene, and say what follows from it."""
    with _explained():
        _tell_plan(_load(case, sets, trust_scripts), as_json)


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
    with _explained():
        from emclutch.scene.study import load_study

        _check_threads(threads)
        if resume and out is None:
            message = "needs a study that was begun; name the study's folder with --out"
            raise SceneError([Fault("--resume", "", message)], "command line")
        read = load_study(study, trust_scripts=trust_scripts)
        from emclutch.results.study_table import StudyTable
        from emclutch.run_study import sweep as sweep_study

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
    with _explained():
        _check_threads(threads)
        read = _load(case, sets, trust_scripts)
        from emclutch.price_tag import accuracy as measure_accuracy
        from emclutch.results import Progress

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
    with _explained():
        read = _load(case, sets, trust_scripts)
        from emclutch import field_study

        with _bad_input_for(case):
            currents = None if current is None else field_study.read_currents(current)
            lines = [field_study.read_line(text) for text in line or ()]
            folder = field_study.field_study(read, currents, lines, out)
        summary = json.loads((folder / "field.json").read_text())
        if as_json:
            _print_json(summary)
        else:
            Console().print(*field_study.tables_of(summary), sep="\n")
            typer.echo(f"results and pictures: {folder}")


@app.command()
def mesh(case: CaseFile, out: Out = None, sets: Sets = None, trust_scripts: TrustScripts = False) -> None:
    """Write the mesh of the cross-section (.msh) and its picture with the regions named."""
    with _explained():
        read = _load(case, sets, trust_scripts)
        from emclutch.mesh_command import mesh_case

        with _bad_input_for(case):
            mesh_file, picture, triangles = mesh_case(read, out=out)
        typer.echo(f"{mesh_file}\n{picture}\n{triangles} triangles")


@app.command()
def plot(
    folders: RunPaths,
    speeds: SpeedsAsked = False,
    torque_speed: TorqueSpeedAsked = False,
    measured: Measured = None,
    out: NewPicture = None,
) -> None:
    """Draw finished runs in a new file: the torque of one against time, or the speeds of one or several."""
    with _explained():
        from emclutch import plot_command as drawn

        if speeds and torque_speed:
            message = "makes another picture than --speeds; ask for one at a time"
            raise SceneError([Fault("--torque-speed", "", message)], "command line")
        kind = drawn.SPEEDS if speeds else drawn.TORQUE_SPEED if torque_speed else drawn.TORQUE
        typer.echo(str(drawn.plot_runs(folders, kind, measured=measured, out=out)))


@app.command()
def report(folder: RunPath, out: NewFile = None) -> None:
    """Write a run as a page of Markdown."""
    with _explained():
        from emclutch.results import load_result
        from emclutch.run_report import report as page_of

        text = page_of(load_result(folder), Path.cwd() if out is None else out.parent)
        if out is None:
            typer.echo(text)
            return
        with open(out, "x", encoding="utf-8") as stream:
            stream.write(text)
        typer.echo(str(out))


@app.command()
def materials(
    names: MaterialNames = None,
    picture: CurvePicture = None,
    pair_force: PairForceAsked = False,
    out: NewPicture = None,
    as_json: AsJson = False,
) -> None:
    """List the built-in magnetic materials, draw the curves of some, or the force between two grains of one."""
    with _explained():
        if pair_force:
            _tell_pair_force(names or [], picture, out, as_json)
            return
        if out is not None:
            message = "names the picture of --pair-force; that of the curves is named with --plot"
            raise SceneError([Fault("--out", str(out), message)], "command line")
        from emclutch import materials_command

        if picture is not None:
            with _bad_input_for(picture):
                laws = materials_command.laws_of(names or materials_command.material_names())
                typer.echo(str(materials_command.draw_materials(laws, picture)))
        elif as_json:
            _print_json(materials_command.materials_as_data(names))
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
    with _explained():
        from emclutch import calibrate_command as command

        name, law = command.grains_of(material, chi, ms)
        points = command.points_of(
            law, fill, field_strength, seeds=seeds, grains=grains, strain=strain, friction=friction, model=model
        )
        folder, rows = command.calibrate(name, points, out, quiet=as_json)
        if as_json:
            _print_json(command.as_data(name, folder, rows))
        else:
            Console().print(command.table_of(name, rows))
            typer.echo(f"results and pictures: {folder}")


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
    with _explained():
        with open(out, "x", encoding="utf-8") as stream:
            stream.write(text + "\n")
        typer.echo(str(out))


@app.command()
def doctor() -> None:
    """Tell whether this machine has what the program needs."""
    from emclutch.doctor import examine

    table, good = examine()
    Console().print(table)
    if not good:
        _stop(
            "something is missing; run `make setup`, which installs it; gmsh's shared libraries are in the README",
            FAILED,
        )


def torque_line(torque: dict[str, Any] | None) -> str:
    """Say a run's torque with its error, and where it is not converged, why."""
    from emclutch.results.statistics import Estimate  # local: it imports numpy

    if not torque or torque.get("mean") is None:
        return "torque on the disc: none" + (f" ({torque['reason']})" if torque else "")
    error = torque.get("standard_error")
    text = f"torque on the disc: {torque['mean']:.4g}"
    text += f" +- {error:.2g} N m" if error is not None else " N m, error unknown"
    interval = Estimate.from_dict(torque).interval()
    if interval is not None:
        behind = packings(torque.get("replicas") or 1, torque.get("packing_share"))
        text += f" (95 %: {interval[0]:.4g} to {interval[1]:.4g}, {behind})"
    return text if torque.get("converged") else f"{text}; {torque.get('reason')}"


def packings(count: int, share: float | None) -> str:
    """Say out of how many packings a mean is, and of one, what its error lacks; `share` [N m] where it is known."""
    if count > 1:
        return f"{count} packings"
    known = "" if share is None else f", some {share:.2g} N m,"
    return f"one packing: what packings differ by{known} is not in it"


def _tell_pair_force(names: list[str], picture: Path | None, out: Path | None, as_json: bool) -> None:
    if len(names) != 1 or picture is not None or as_json:
        message = "takes the name of one powder and --out FILE, and neither --plot nor --json"
        raise SceneError([Fault("--pair-force", "", message)], "command line")
    from emclutch.pair_force_command import pair_force

    path, table = pair_force(names[0], out)
    Console().print(table)
    typer.echo(str(path))


def _load(path: Path, sets: list[str] | None = None, trust_scripts: bool = False) -> Case:
    values = _assignments(sets)
    if any(value == {} for value in values.values()):
        # an effect that is switched on keeps the entries that it has, in the file or by other settings
        effects = read_toml(path).get("effects", {})
        adding: dict[str, Any] = {key: {} for key, value in values.items() if value == {}}
        kept = {key for key in adding if isinstance(effects, dict) and key.removeprefix("effects.") in effects}
        others = {key: value for key, value in values.items() if key not in adding}
        values = {key: {} for key in adding if key not in kept} | others
    case = load_case(path, values, trust_scripts=trust_scripts)
    for warning in case.warnings:
        typer.echo(f"warning: {warning}", err=True)
    return case


def _assignments(sets: list[str] | None) -> dict[str, Any]:
    """Read ``key=value`` pairs; a value is read as TOML (numbers, lists, true), otherwise as text.

    A bare ``none`` is None, which removes the key. For ``effects.NAME`` a bare ``off`` is None too, ``on`` an empty
    table.
    """
    values: dict[str, Any] = {}
    for text in sets or ():
        key, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not key:
            message = "is not KEY=VALUE; write it as in --set coil.current='0.8 A'"
            raise SceneError([Fault("--set", shown(text), message)], "command line")
        is_effect = key.startswith("effects.") and key.count(".") == 1
        if value == "none" or (is_effect and value == "off"):
            if reason := _unknown(key):
                raise SceneError([Fault(key, value, reason)], "command line")
            values[key] = None
            continue
        if is_effect and value == "on":
            values[key] = {}
            continue
        try:
            values[key] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            values[key] = value
    return values


def _check_threads(threads: int | None) -> None:
    if threads is None:
        return
    from emclutch.doctor import most_threads  # local: it imports numba

    most = most_threads()
    if not 1 <= threads <= most:
        message = f"is out of range; allowed: 1 to {most} (this machine's cores, or NUMBA_NUM_THREADS where it is set)"
        raise SceneError([Fault("--threads", str(threads), f"{message}; change it or leave it out")], "command line")


def _run_to_resume(folder: Path, out: Path | None) -> tuple[Path, Path]:
    """The scene and the folder of a run that is to go on."""
    if out is not None and out.resolve() != folder.resolve():
        message = f"is another folder than the run's, {folder}; leave --out away"
        raise SceneError([Fault("--out", str(out), message)], "command line")
    scene = folder / "case.toml"
    if not scene.is_file():
        message = "has no case.toml and so no run to resume; name the folder of a run"
        raise SceneError([Fault(str(folder), "", message)], "command line")
    return scene, folder


def _unknown(key: str) -> str:
    """Say why a key cannot be removed; empty where a scene may have it."""
    from emclutch.scene.fault_report import key_fault
    from emclutch.scene.model import Scene

    return key_fault(key, Scene)


def _tell_plan(case: Case, as_json: bool, threads: int | None = None) -> None:
    from emclutch.plan import plan  # local: it needs the packages of the physics

    with _bad_input_for(case.path):
        decisions, left_out = plan(case, threads)
    active = case.scene.effects.active
    if as_json:
        title = case.scene.scene.title
        _print_json({"title": title, "effects": active, "warnings": case.warnings, "plan": decisions,
                     "left_out": [line.as_dict() for line in left_out]})  # fmt: skip
        return
    console = Console()
    console.print(f"{case.scene.scene.title}: OK", highlight=False, markup=False)
    effects = Table("effect", "")
    for name in case.scene.effects.names():
        effects.add_row(name, "on" if name in active else "off")
    console.print(effects)
    rows = Table("what follows", "")
    for label, text in decisions.items():
        rows.add_row(label, text)
    console.print(rows)
    rows = Table("left out", "matters", "by this number (from there on)")
    for line in left_out:
        rows.add_row(line.effect, line.verdict, line.in_words())
    console.print(rows)


def _print_json(values: Any) -> None:
    typer.echo(json.dumps(values, indent=2, default=str))


@contextmanager
def _explained() -> Iterator[None]:
    """Turn what a user can mend into a message and an exit code; a defect keeps its traceback."""
    from emclutch.results.output_error import OutputError

    try:
        yield
    except SceneError as error:
        _stop(error.report(), BAD_INPUT)
    except OutputError as error:
        _stop(f"output: {error}", BAD_INPUT)
    except OSError as error:
        name = f"{error.filename}: " if error.filename else ""
        reason = error.strerror or error
        _stop(f"{name}{reason}; check the path and its permissions, or write elsewhere with --out", BAD_INPUT)
    except KeyboardInterrupt:
        _stop("interrupted", STOPPED)
    except Exception as error:
        # Errors that the packages define say what to do: RunError, ConvergenceError, PackingError, ...
        if type(error).__module__.partition(".")[0] not in _PACKAGES:
            raise
        from emclutch.run_case import Interrupted  # local: it needs the packages of the physics

        if isinstance(error, Interrupted):
            _stop(str(error), STOPPED)
        _stop(f"the run failed: {error}", FAILED)


@contextmanager
def _bad_input_for(file: Path | None) -> Iterator[None]:
    """Take a ValueError for a fault of the scene: the planning functions raise it with a remedy."""
    try:
        yield
    except ValueError as error:
        raise SceneError([Fault("", "", str(error))], "scene" if file is None else str(file)) from error


def _stop(message: str, code: int) -> NoReturn:
    typer.echo(message, err=True)
    raise typer.Exit(code)


if __name__ == "__main__":
    main()
