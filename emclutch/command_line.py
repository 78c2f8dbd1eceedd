"""The command line: each command reads its input, calls one function of the package and says what came of it.

Exit codes: 0 done, 1 the run failed, 2 bad input. A user's mistake never ends in a traceback, and no command
overwrites anything. The working functions are imported by the command that needs them, so that `--help`, `check` and
`schema` start at once.
"""

from __future__ import annotations

import json
import os
import sys
import tomllib
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Annotated, Any

import typer
from rich.console import Console
from rich.table import Table

from emclutch.case import Case, load_case
from emclutch.faults import Fault, RunError, SceneError

_PACKAGES = {"emclutch", "geometry", "field", "particles", "coupling"}
BAD_INPUT, FAILED = 2, 1

app = typer.Typer(
    name="emclutch",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Torque of electromagnetic particle clutches and brakes: field, grains and their coupling.",
)

CaseFile = Annotated[Path, typer.Argument(metavar="CASE", help="scene file (.toml)")]
Out = Annotated[Path | None, typer.Option("--out", metavar="DIR", help="new folder for the results")]
Sets = Annotated[
    list[str] | None, typer.Option("--set", metavar="KEY=VALUE", help="set a key, e.g. coil.current='0.8 A'")
]
Resume = Annotated[bool, typer.Option("--resume", help="go on from the last checkpoint")]
Threads = Annotated[
    int | None, typer.Option("--threads", min=1, help="number of threads; results do not depend on it")
]
AsJson = Annotated[bool, typer.Option("--json", help="print the summary as JSON and nothing else")]


def main() -> None:
    """Entry point of the console script."""
    app()


@contextmanager
def _explained() -> Iterator[None]:
    """Turn what a user can mend into a message and an exit code; a defect of the program keeps its traceback."""
    from emclutch.results.output_error import OutputError

    try:
        yield
    except SceneError as error:
        _stop(error.report(), BAD_INPUT)
    except OutputError as error:
        _stop(f"output: {error}", BAD_INPUT)
    except RunError as error:
        _stop(f"the run failed: {error}", FAILED)
    except OSError as error:
        name = f"{error.filename}: " if error.filename else ""
        _stop(
            f"{name}{error.strerror or error}; check the path and its permissions, or write elsewhere with --out",
            BAD_INPUT,
        )
    except KeyboardInterrupt:
        _stop("interrupted; continue with --resume and --out where a checkpoint was written", FAILED)
    except Exception as error:
        # Errors that the packages define themselves say what to do (ConvergenceError, PackingError, ...).
        if type(error).__module__.partition(".")[0] not in _PACKAGES:
            raise
        _stop(f"the run failed: {error}", FAILED)


def _stop(message: str, code: int) -> None:
    typer.echo(message, err=True)
    raise typer.Exit(code)


def _assignments(sets: list[str] | None) -> dict[str, Any]:
    """Read ``key=value`` pairs; a value is read as TOML (numbers, lists, true), otherwise as text."""
    values: dict[str, Any] = {}
    for text in sets or ():
        key, equals, value = (part.strip() for part in text.partition("="))
        if not equals or not key:
            raise SceneError(
                [Fault("--set", repr(text), "is not KEY=VALUE; write it as in --set coil.current='0.8 A'")],
                "command line",
            )
        try:
            values[key] = tomllib.loads(f"value = {value}")["value"]
        except tomllib.TOMLDecodeError:
            values[key] = value
    return values


def _load(path: Path, sets: list[str] | None = None) -> Case:
    case = load_case(path, _assignments(sets))
    for warning in case.warnings:
        typer.echo(f"warning: {warning}", err=True)
    return case


def _print_result(result: Any, as_json: bool) -> None:
    """Print what a working function returned: a dictionary, or an object with `summary`."""
    summary = getattr(result, "summary", result)
    if as_json:
        typer.echo(json.dumps(summary, indent=2, default=str))


def _print_plan(case: Case) -> None:
    console = Console()
    console.print(f"[bold]{case.scene.scene.title}[/bold]: OK", highlight=False)
    effects = Table("effect", "")
    for name in case.scene.effects.names():
        effects.add_row(name, "on" if name in case.scene.effects.active else "off")
    console.print(effects)
    from emclutch.plan import plan  # local: it meshes nothing, but it needs the packages of the physics

    rows = Table("from the scene follows", "", show_lines=False)
    for label, text in plan(case).items():
        rows.add_row(label, str(text))
    console.print(rows)


@app.command()
def check(case: CaseFile, sets: Sets = None, as_json: AsJson = False) -> None:
    """Validate a scene, and say what follows from it."""
    with _explained():
        read = _load(case, sets)
        if as_json:
            from emclutch.plan import plan

            typer.echo(
                json.dumps(
                    {
                        "title": read.scene.scene.title,
                        "effects": read.scene.effects.active,
                        "warnings": read.warnings,
                        "plan": plan(read),
                    },
                    indent=2,
                    default=str,
                )
            )
        else:
            _print_plan(read)


@app.command()
def run(
    case: CaseFile,
    out: Out = None,
    sets: Sets = None,
    resume: Resume = False,
    threads: Threads = None,
    dry_run: Annotated[bool, typer.Option("--dry-run", help="stop after the plan")] = False,
    as_json: AsJson = False,
) -> None:
    """Simulate one scene."""
    with _explained():
        read = _load(case, sets)
        if dry_run:
            _print_plan(read)
            return
        from emclutch.run import run_case

        _print_result(run_case(read, out=out, threads=threads, resume=resume, progress=not as_json), as_json)


@app.command()
def sweep(
    study: Annotated[Path, typer.Argument(metavar="STUDY", help="study file (.toml)")],
    out: Out = None,
    resume: Resume = False,
    threads: Threads = None,
    as_json: AsJson = False,
) -> None:
    """Simulate every point of a parameter study."""
    with _explained():
        from emclutch.scene.study import load_study

        read = load_study(study)
        from emclutch.sweep import run_study

        _print_result(run_study(read, out=out, threads=threads, resume=resume, progress=not as_json), as_json)


@app.command()
def accuracy(
    case: CaseFile, out: Out = None, sets: Sets = None, threads: Threads = None, as_json: AsJson = False
) -> None:
    """Measure what accuracy costs in time."""
    with _explained():
        read = _load(case, sets)
        from emclutch.accuracy import run_accuracy

        _print_result(run_accuracy(read, out=out, threads=threads, progress=not as_json), as_json)


@app.command()
def mesh(case: CaseFile, out: Out = None, sets: Sets = None) -> None:
    """Write the mesh of the cross-section (.msh) and its picture with the regions named."""
    with _explained():
        read = _load(case, sets)
        from emclutch.mesh_command import write_mesh

        for path in write_mesh(read, out=out):
            typer.echo(str(path))


@app.command()
def plot(
    folder: Annotated[Path, typer.Argument(metavar="RUN", help="folder of a run")], out: Out = None
) -> None:
    """Draw the pictures of a run that is there."""
    with _explained():
        from emclutch.plot_command import plot_run

        for path in plot_run(folder, out=out):
            typer.echo(str(path))


@app.command()
def materials() -> None:
    """List the built-in magnetic materials."""
    from field.materials import material, material_names

    table = Table("name", "law", "source")
    for name in material_names():
        law = material(name)
        table.add_row(name, type(law).__name__, str(getattr(law, "source", "")))
    Console().print(table)


@app.command()
def schema(
    out: Annotated[
        Path | None, typer.Option("--out", metavar="FILE", help="new file; default: the terminal")
    ] = None,
) -> None:
    """Write the JSON schema of a scene, with which editors complete and check."""
    from emclutch.scene.model import Scene

    text = json.dumps(Scene.model_json_schema(), indent=2)
    with _explained():
        if out is None:
            typer.echo(text)
            return
        with open(out, "x", encoding="utf-8") as stream:
            stream.write(text + "\n")
        typer.echo(str(out))


@app.command()
def doctor() -> None:
    """Tell whether this machine has what the program needs."""
    from importlib import import_module, metadata

    good = sys.version_info >= (3, 11)
    table = Table("", "found", "")
    table.add_row("python", sys.version.split()[0], "ok" if good else "3.11 or newer is needed")
    modules = {
        "numpy": "numpy",
        "scipy": "scipy",
        "numba": "numba",
        "scikit-fem": "skfem",
        "gmsh": "gmsh",
        "h5py": "h5py",
        "pydantic": "pydantic",
        "pint": "pint",
        "pandas": "pandas",
        "matplotlib": "matplotlib",
        "pyvista": "pyvista",
    }
    for name, module in modules.items():
        try:
            import_module(module)
            table.add_row(name, metadata.version(name), "ok")
        except (ImportError, OSError) as error:  # OSError: a shared library that gmsh loads is missing
            good = False
            table.add_row(name, "-", str(error))
    table.add_row("cores", str(os.cpu_count()), "ok")
    here_writable = os.access(".", os.W_OK)
    table.add_row("this folder", str(Path.cwd()), "ok" if here_writable else "not writable: use --out")
    Console().print(table)
    if not good:
        _stop("something is missing: pip install emclutch; for shared libraries see the README", FAILED)


if __name__ == "__main__":
    main()
