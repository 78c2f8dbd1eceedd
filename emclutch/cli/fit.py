"""Entries of `emclutch fit`: ranges of the parameters, the angle of repose."""

from __future__ import annotations

import math

from emclutch.cli.input import refuse_without
from emclutch.cli.options import USUAL_UNCERTAINTY
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.units import Quantity
from emclutch.scene.value_list import read_all

_COEFFICIENT = Quantity("a coefficient of friction", "", "0.4", 0.0, 10.0)
_FILL = Quantity("a solid fraction", "", "0.4", 0.0, 1.0, open_minimum=True)
REPOSE = Quantity("an angle", "rad", "34 deg", 0.0, 0.5 * math.pi, open_minimum=True, angular=True)


def ends_of(text: str, option: str) -> float | tuple[float, float]:
    """Return the value of ``0.4``, or the ends of ``0.2:0.7``; SceneError for a text that is neither."""
    values = read_all(text.split(":"), _FILL if option == "--fill" else _COEFFICIENT, option)
    if len(values) > 2:
        message = "is not a value or a range; write 0.4, or 0.2:0.7"
        raise SceneError([Fault(option, text, message)], "command line")
    return values[0] if len(values) == 1 else (values[0], values[1])


def angle_of(repose: str | None, uncertainty: str | None) -> tuple[float, float] | None:
    """Return the angle of repose and its standard error [rad]; None without one."""
    if repose is None:
        refuse_without("--repose", {"--uncertainty": uncertainty is not None})
        return None
    (angle,), (error,) = (
        read_all([text], REPOSE, option)
        for option, text in (("--repose", repose), ("--uncertainty", uncertainty or USUAL_UNCERTAINTY))
    )
    return angle, error
