"""Entries of `emclutch fit`: what is varied, the simulated drives, the angle of repose, the common error."""

from __future__ import annotations

import math

from emclutch.cli.input import read_shares, refuse_without
from emclutch.cli.options import USUAL_UNCERTAINTY
from emclutch.scene.case import Case
from emclutch.scene.errors import Fault, SceneError
from emclutch.scene.units import Quantity
from emclutch.scene.value_list import number_or_text, read_list
from emclutch.studies.fit import Varied, drive_quantity

_FRICTION = Quantity("a coefficient of friction", "", "0.4", 0.0, 10.0)
_FILL = Quantity("a solid fraction", "", "0.4", 0.0, 1.0, open_minimum=True)
_REPOSE = Quantity("an angle", "rad", "34 deg", 0.0, 0.5 * math.pi, open_minimum=True, angular=True)


def varied_of(friction: str, rolling: str, fill: str | None) -> Varied:
    """Return the values of each parameter; SceneError for a list that cannot be read, or where nothing is fitted."""
    lists = (
        tuple(read_list(friction, _FRICTION, "--friction")), tuple(read_list(rolling, _FRICTION, "--rolling-friction")),
        () if fill is None else tuple(read_list(fill, _FILL, "--fill")),
    )  # fmt: skip
    if max(len(set(one)) for one in lists) < 2:
        message = "have one value each: nothing is fitted; give one of them two or more"
        raise SceneError([Fault("--friction, --rolling-friction, --fill", "", message)], "command line")
    return Varied(friction=lists[0], rolling=lists[1], fill=lists[2])


def drives_of(case: Case, key: str, at: str | None) -> tuple[float, ...]:
    """Return the simulated drives [SI]; none where they follow from the measured curve."""
    return () if at is None else tuple(sorted(set(read_list(at, drive_quantity(case, key), "--at"))))


def common_error_of(text: str | None) -> float:
    """Return the relative error that all measured torques share, 0.03 of ``3 %``; 0 without one."""
    found = [0.0] if text is None else read_shares(text, "--common-error")
    if len(found) > 1:
        message = f"has {len(found)} entries; give one, e.g. '3 %'"
        raise SceneError([Fault("--common-error", str(text), message)], "command line")
    return found[0]


def angle_of(repose: str | None, uncertainty: str | None) -> tuple[float, float] | None:
    """Return the angle of repose and its standard error [rad]; None without one."""
    if repose is None:
        refuse_without("--repose", {"--uncertainty": uncertainty is not None})
        return None
    found = []
    for option, text in (("--repose", repose), ("--uncertainty", uncertainty or USUAL_UNCERTAINTY)):
        try:
            found.append(_REPOSE.read(number_or_text(text)))
        except ValueError as error:
            raise SceneError([Fault(option, text, str(error))], "command line") from None
    return found[0], found[1]
