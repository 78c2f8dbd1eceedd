"""Error messages of commands, and their exit codes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import NoReturn

import typer

from emclutch.results.errors import Interrupted, OutputError
from emclutch.scene.errors import SceneError

FAILED, BAD_INPUT, INCOMPLETE = 1, 2, 3
STOPPED, CLOSED_PIPE = 130, 141  # 128 + SIGINT, 128 + SIGPIPE, as shells count them
_PACKAGES = ("emclutch", "geometry", "field", "particles", "coupling")


@contextmanager
def explained() -> Iterator[None]:
    """Turn what a user can mend into a message and an exit code; a defect keeps its traceback."""
    try:
        yield
    except SceneError as error:
        stop(error.report(), BAD_INPUT)
    except OutputError as error:
        stop(str(error), BAD_INPUT)
    except BrokenPipeError:  # of the output, as those to child processes are met where they are written to
        raise  # `emclutch.cli.main.main` answers it
    except OSError as error:
        name = f"{error.filename}: " if error.filename else ""
        reason = f"{error.strerror or error}; check the path and its permissions"
        if error.filename and not (parent := Path(error.filename).absolute().parent).is_dir():
            reason = f"the folder {parent} does not exist; make it, or give another path"
        stop(f"{name}{reason}", BAD_INPUT)
    except KeyboardInterrupt:
        stop("interrupted", STOPPED)
    except Exception as error:
        # Errors that the packages define say what to do: RunError, ConvergenceError, PackingError, ...
        if type(error).__module__.partition(".")[0] not in _PACKAGES:
            raise
        if isinstance(error, Interrupted):
            stop(str(error), STOPPED)
        stop(f"failed: {error}", FAILED)


def stop(message: str, code: int) -> NoReturn:
    typer.echo(message, err=True)
    raise typer.Exit(code)
