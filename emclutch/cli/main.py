"""The command line: each command reads its input, calls one function of the package and says what came of it.

Exit codes: 0 done, 1 the run failed, 2 bad input, 130 stopped by Ctrl-C, 141 the output was closed (`| head`). A user's
mistake never ends in a traceback, and no command overwrites anything. The working functions are imported by the command
that needs them, so that `--help` and `schema` start at once.
"""

from __future__ import annotations

import gc
import sys
import warnings

try:
    from typing import Annotated, Any

    import typer
    from typer.core import TyperCommand, TyperGroup, TyperOption

    from emclutch import __version__
    from emclutch.cli.errors import CLOSED_PIPE, explained
    from emclutch.cli.field_commands import field, heat, materials, mesh, powder
    from emclutch.cli.options import flag
    from emclutch.cli.result_commands import export, plot, report, view
    from emclutch.cli.run_commands import accuracy, check, design, fit, map, powder_law, run, sweep
    from emclutch.cli.scene_commands import doctor, new, schema
    from emclutch.scene.errors import Fault, SceneError
except KeyboardInterrupt:  # while the program is loaded no command is there to answer
    sys.stderr.write("interrupted\n")
    raise SystemExit(130) from None


class _HelpWithoutType:
    """Help that names no type for `--help`, as for no option without a value."""

    def get_help_option(self, ctx: Any) -> Any:
        """Return the option `--help`."""
        option = super().get_help_option(ctx)  # type: ignore[misc]
        if option is not None:
            option.metavar = ""
        return option


class Command(_HelpWithoutType, TyperCommand):
    """A command of the program; an option that takes one value is given once, else the first would be lost."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Parse the arguments; exit code 2 where one of them contradicts another."""
        _, _, given = self.make_parser(ctx).parse_args(args=[*args])
        for option in (one for one in self.params if isinstance(one, TyperOption)):
            if given.count(option) > 1 and not option.multiple and not option.is_flag:
                with explained():
                    message = "is given twice, and only the last would count; give it once"
                    raise SceneError([Fault(option.opts[-1], "", message)], "command line")
        return super().parse_args(ctx, args)


class Program(_HelpWithoutType, TyperGroup):
    """The program with all its commands."""


app = typer.Typer(
    cls=Program,
    no_args_is_help=True,
    rich_markup_mode="markdown",  # rich's own would take a unit in brackets for a style
    add_completion=False,
    pretty_exceptions_enable=False,
    help="Torque of electromagnetic particle clutches and brakes: field, grains and their coupling.",
)


def main() -> None:
    """Entry point of the console script."""
    gc.set_threshold(50_000, 10, 10)  # what a start loads stays: looking for garbage in it took a tenth of a check
    warnings.formatwarning = lambda message, *_: f"warning: {message}\n"  # without the line of the program
    try:
        app(prog_name="emclutch")
    except SystemExit as end:
        if isinstance(end.__context__, BrokenPipeError):  # typer and rich keep silent, and end with 1
            raise SystemExit(CLOSED_PIPE) from None
        raise


def _print_version(asked: bool) -> None:
    if asked:
        typer.echo(f"emclutch {__version__}")
        raise typer.Exit


@app.callback()
def _common(
    version: Annotated[
        bool, flag("--version", "print the version and stop", callback=_print_version, is_eager=True)
    ] = False,
) -> None:
    """Options of the program itself."""


# as `emclutch --help` lists them
for command in (
    run,
    check,
    sweep,
    accuracy,
    field,
    heat,
    mesh,
    plot,
    view,
    report,
    export,
    materials,
    powder,
    powder_law,
    design,
    map,
    fit,
    new,
    schema,
    doctor,
):
    app.command(cls=Command)(command)


if __name__ == "__main__":
    main()
