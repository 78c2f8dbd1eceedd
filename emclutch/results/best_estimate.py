"""Best estimate of a run's torque: the raw one corrected for the error of its numerical settings, with the total error.

The accuracy study of the device knows that error. Without one the law of the powder corrects grains that are coarser
than those that they stand for, or the general law of grain size where that one is a guess; the other settings' errors
are then unknown and not in the interval.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any

from emclutch.results.statistics import Estimate


def best_estimate(raw: Estimate, summary: Mapping[str, Any]) -> Estimate:
    """Return the best estimate of a torque; the raw one where the summary knows no correction.

    Parameters
    ----------
    raw : Estimate
        Mean torque of the run [N m].
    summary : mapping
        ``summary.json`` of the run: its `discretisation_error` and `grain_size` count.
    """
    if error := summary.get("discretisation_error"):
        bias, half = error["bias"], error["half_width"]
    elif (size := summary.get("grain_size") or {}).get("torque_excess") is not None:
        bias = size["torque_excess"]
        half = 0.5 * (size["torque_excess_high"] - size["torque_excess_low"]) / (1.0 + bias)
    else:
        return raw
    if not raw.mean:
        return raw
    mean = raw.mean / (1.0 + bias)
    scaled = replace(raw, mean=mean, standard_error=None, drift=None, drift_error=None, fluctuation=None)
    statistical = raw.half_width()
    if statistical is None:
        return scaled
    total = math.hypot(statistical / raw.mean, half) * abs(mean)
    unit = replace(scaled, standard_error=1.0).half_width()
    assert unit is not None  # the raw one has an error
    return replace(scaled, standard_error=total / unit)
