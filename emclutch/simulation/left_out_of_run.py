"""Effects that the scene of a finished run leaves out, for its report."""

from __future__ import annotations

from emclutch.effects.left_out import LeftOut
from emclutch.results import Result
from emclutch.scene.case import load_case
from emclutch.scene.errors import SceneError
from emclutch.simulation.check import check


def left_out_of(result: Result) -> list[LeftOut]:
    """Each effect with the number that says whether it matters; empty where the scene cannot be read again."""
    try:
        return list(check(load_case(result.folder.case)).left_out)
    except (SceneError, OSError, ValueError, RuntimeError):  # a file that the scene names is gone, a script in it
        return []
