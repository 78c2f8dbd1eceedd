"""Error messages of commands, and their exit codes."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import NoReturn

import typer

from emclutch.results.errors import Interrupted, OutputError
from emclutch.scene.errors import SceneError

FAILED, BAD_INPUT, INCOMPLETE, STOPPED = 1, 2, 3, 130  # 130: 128 + SIGINT, as shells count it
_PACKAGES = ("emclutch", "geometry", "field", "particles", "coupling")


@contextmanager
def explained() -> Iterator[None]:
    """Turn what a user can mend into a message and an exit code; a defect keeps its traceback."""
    try:
        yield
    except SceneError as error:
        stop(error.report(), BAD_INPUT)
    except OutputError as error:
        stop(f"output: {error}", BAD_INPUT)
    except OSError as error:
        name = f"{error.filename}: " if error.filename else ""
        reason = error.strerror or error
        stop(f"{name}{reason}; check the path and its permissions, or write elsewhere with --out", BAD_INPUT)
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
