"""Measured torques over the expected ones of a map, and whether each lies in the interval that is expected there.

A measured torque with a standard error lies in the interval if its distance from the expected torque is at most that of
the interval's end and 1.96 standard errors, added in quadrature.

Between the points of a map ln T is a cubic spline of ln |I|, as in a fit (`emclutch.studies.torque_fit`), and both half
widths of the interval of ln T are linear in ln |I|. Between a guess and another point the expected torque is a guess,
with the wider interval of both. Currents beyond the map are not extrapolated to, nor is 0 A.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.interpolate import CubicSpline

from emclutch.results.fits import NORMAL
from emclutch.simulation.forecast.expected_torque import Interval

SAME = 1e-9
"""Relative difference of two currents up to which they are one, written in different units."""


def interpolated_torques(
    currents: Sequence[float], torques: Sequence[Interval | None], at: Sequence[float]
) -> list[Interval | None]:
    """Return the torques [N m] at some currents [A], None where not both neighbours on that side of 0 A have one.

    Parameters
    ----------
    currents : ascending [A].
    torques : at these; None where none is known.
    at : currents [A] at which they are wanted.
    """
    found: list[Interval | None] = [None] * len(at)
    for sign in (-1.0, 1.0):
        side = [(sign * I, T if T and T.mean > 0.0 else None) for I, T in zip(currents, torques, strict=True)]
        side = sorted((one for one in side if one[0] > 0.0), key=lambda one: one[0])
        known = [(np.log(I), T) for I, T in side if T is not None]
        if len(known) < 2:
            continue
        x = np.array([one for one, _ in known])
        mean, low, high = (np.array([getattr(T, end) for _, T in known]) for end in ("mean", "low", "high"))
        with np.errstate(divide="ignore"):  # a bound alone has no lower end
            below, above = np.log(mean / low), np.log(high / mean)
        is_guess, spline = np.array([T.is_guess or T.low == 0.0 for _, T in known]), CubicSpline(x, np.log(mean))
        gaps = [(a, b) for (a, T), (b, U) in pairwise(side) if T is None or U is None]
        for place, current in enumerate(at):
            if sign * current <= 0.0:
                continue
            here = np.log(sign * current)
            near = np.flatnonzero(abs(x - here) <= SAME)
            if not near.size:
                if not x[0] < here < x[-1] or any(a <= sign * current <= b for a, b in gaps):
                    continue
                near = np.searchsorted(x, here) - np.array([1, 0])
            guess = bool(is_guess[near].any())
            down, up = (one[near].max() if guess else np.interp(here, x, one) for one in (below, above))
            T = float(np.exp(spline(here)))
            found[place] = Interval(T, float(T * np.exp(-down)), float(T * np.exp(up)), guess)
    return found


def compared_rows(
    measured: Mapping[str, np.ndarray], currents: Sequence[float], torques: Sequence[Interval | None]
) -> list[dict[str, Any]]:
    """Return a row for each measured torque: itself, the expected one, their ratio; None beyond the map.

    Parameters
    ----------
    measured : name -> (n, 2) current [A] and torque [N m], or (n, 3) with standard errors.
    currents, torques : of the map, as `interpolated_torques` takes them.
    """
    rows, unknown = [], dict.fromkeys(("torque", "low", "high", "ratio", "is_inside", "is_guess"))
    for name, points in measured.items():
        expected = interpolated_torques(currents, torques, points[:, 0].tolist())
        for (current, torque, *error), T in zip(points.tolist(), expected, strict=True):
            sigma = error[0] if error and np.isfinite(error[0]) else None
            known = {}
            if T is not None:
                half = np.hypot(T.high - T.mean if torque > T.mean else T.mean - T.low, NORMAL * (sigma or 0.0))
                known = {"torque": T.mean, "low": T.low, "high": T.high, "ratio": torque / T.mean,
                         "is_inside": bool(abs(torque - T.mean) <= half), "is_guess": T.is_guess}  # fmt: skip
            own = {"curve": name, "current": current, "torque_measured": torque, "standard_error": sigma}
            rows.append(own | unknown | known)
    return rows
