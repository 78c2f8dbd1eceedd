"""Measured torques over the expected ones of a map, and whether each lies in the interval that is expected there.

A measured torque lies in the interval if its distance from the expected torque is at most that of the interval's end
and 1.96 of its own standard errors, added in quadrature.

Between the points of a map ln T is a cubic spline of ln |I|, as in a fit (`emclutch.studies.torque_fit`), and both half
widths of the interval of ln T are linear in ln |I|. Between a guess and another point the expected torque is a guess,
with the wider interval of both. Currents beyond the map are not extrapolated to, nor is 0 A.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from math import log
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.stats import kendalltau

from emclutch.results.fits import NORMAL
from emclutch.simulation.forecast.expected_torque import Interval

SAME = 1e-9
"""Relative difference of two currents up to which they are one, written in different units."""
MAX_P_VALUE, MIN_TREND = 0.1, 0.06
"""A ratio has a trend if the p-value of its rank correlation is below the first, and the ln of its change at least the
second, which is twice the scatter about the form of the law."""


def trend_in_words(name: str, points: Any, shown: Callable[[float], str]) -> str:
    """Say that a ratio of torques changes with the size of the drive, and what to suspect; empty where it does not.

    `points` has drives [A or V] and ratios (n, 2). The rank correlation is Kendall's tau with |drive|.
    """
    x, ratio = np.reshape(points, (-1, 2)).T
    if len(x) < 2 or ratio.min() <= 0.0:
        return ""
    x, (tau, p_value) = abs(x), kendalltau(abs(x), ratio)
    low, high = (float(ratio[x == end].mean()) for end in (x.min(), x.max()))
    if not p_value < MAX_P_VALUE or np.sign(tau) * log(high / low) < MIN_TREND:  # nan where all drives are one
        return ""
    how, why = ("falls", "drag or remanence") if tau < 0.0 else ("rises", "powder that still gathers")
    ends = f"{low:.3g} at {shown(float(x.min()))} to {high:.3g} at {shown(float(x.max()))}"
    return f"{name} {how} from {ends}: suspect the magnetic circuit, {why} rather than friction"


def interpolated_torques(
    currents: Sequence[float], torques: Sequence[Interval | None], at: Sequence[float]
) -> list[Interval | None]:
    """Return the torques [N m] at some currents [A], None where not both neighbours on that side of 0 A have one."""
    found: list[Interval | None] = []
    for current in at:
        side = [(abs(I), T) for I, T in zip(currents, torques, strict=True) if I * current > 0.0]
        side.sort(key=lambda one: one[0])
        below = [one for one in side if one[0] <= abs(current) * (1.0 + SAME)][-1:]
        above = [one for one in side if one[0] >= abs(current) * (1.0 - SAME)][:1]
        near = [(I, T) for I, T in (*below, *above) if T and T.mean > 0.0]
        known = np.log([(I, T.mean) for I, T in side if T and T.mean > 0.0])
        if len(near) < 2 or len(known) < 2:
            found.append(None)
            continue
        with np.errstate(divide="ignore"):  # a bound alone has no lower end
            widths = np.log([np.divide((T.mean, T.high), (T.low, T.mean)) for _, T in near])
        is_guess, here = any(T.is_guess or T.low == 0.0 for _, T in near), np.log(abs(current))
        down, up = (one.max() if is_guess else np.interp(here, np.log([I for I, _ in near]), one) for one in widths.T)
        mean = float(np.exp(CubicSpline(*known.T)(here)))
        found.append(Interval(mean, float(mean * np.exp(-down)), float(mean * np.exp(up)), is_guess))
    return found


def compared_rows(
    measured: Mapping[str, np.ndarray], currents: Sequence[float], torques: Sequence[Interval | None]
) -> list[dict[str, Any]]:
    """Return a row for each measured torque: itself, the expected one, their ratio; None beyond the map.

    `measured` is as of `emclutch.results.measured_table.read_measured`; currents and torques are those of the map.
    """
    rows, unknown = [], dict.fromkeys(("torque", "low", "high", "ratio", "is_inside", "is_guess"))
    for name, points in measured.items():
        expected = interpolated_torques(currents, torques, points[:, 0].tolist())
        for (current, torque, *error), T in zip(points.tolist(), expected, strict=True):
            sigma = error[0] if error and np.isfinite(error[0]) else None
            own = {"curve": name, "current": current, "torque_measured": torque, "standard_error": sigma}
            rows.append(own | unknown)
            if T is not None:
                half = np.hypot(T.high - T.mean if torque > T.mean else T.mean - T.low, NORMAL * (sigma or 0.0))
                inside = bool(abs(torque - T.mean) <= half)
                rows[-1] |= {"torque": T.mean, "low": T.low, "high": T.high, "ratio": torque / T.mean,
                             "is_inside": inside, "is_guess": T.is_guess}  # fmt: skip
    return rows
