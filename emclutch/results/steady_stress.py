"""The steady stress of a sheared periodic box: one verdict for summary, result and picture.

Shear stress, normal stress along the gradient and their ratio are means over the same stretch of all replicas. They
count as known where the statistics do (`replicated_mean`), and the box was sheared by `MIN_AVERAGED_STRAIN` while
averaging. The ratio is that of the means; its error is that of the mean of mu + (tau - mu P)/P_mean, to first order.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.columns import (
    CONTACTS_PER_GRAIN,
    NORMAL_STRESS_Z,
    RELATIVE_PERMEABILITY,
    SHEAR_STRAIN,
    SHEAR_STRESS,
    SHEAR_STRESS_LOWER,
    SHEAR_STRESS_UPPER,
    SOLID_FRACTION,
    TIME,
)
from emclutch.results.statistics import NOT_CONVERGED, Estimate
from emclutch.results.steady_torque import (
    MIN_AVERAGED_STRAIN,
    SteadyConditions,
    durations,
    steady_mean_of,
    steady_torque,
)

if TYPE_CHECKING:
    import pandas

_RATIO, _LENGTH = "effective_friction", "window_length"


@dataclass(frozen=True, slots=True)
class SteadyStress:
    """Means of the steady part.

    Attributes
    ----------
    shear, normal : Estimate
        tau and the normal stress P along the gradient [Pa].
    friction : Estimate or None
        tau/P [-]; None where the grains do not push on the mean.
    """

    shear: Estimate
    normal: Estimate
    friction: Estimate | None


def steady_stress(histories: Sequence[pandas.DataFrame], conditions: SteadyConditions) -> SteadyStress:
    """Means of the stresses with their errors over all replicas.

    Parameters
    ----------
    histories : sequence of DataFrame
        Columns `time` [s], `shear_strain` [-], `shear_stress` and `normal_stress_z` [Pa]; windows begin at time 0.
    conditions : SteadyConditions
    """
    shear = _sheared_enough(steady_mean_of(histories, SHEAR_STRESS, conditions), histories)
    start = conditions.average_from if shear.start is None else shear.start
    normal = steady_mean_of(histories, NORMAL_STRESS_Z, conditions, start)
    if shear.mean is None or normal.mean is None or normal.mean <= 0.0:
        return SteadyStress(shear, normal, None)
    mu = shear.mean / normal.mean
    linear = [
        each.assign(**{_RATIO: mu + (each[SHEAR_STRESS] - mu * each[NORMAL_STRESS_Z]) / normal.mean})
        for each in histories
    ]
    of_ratio = replace(conditions, negligible=0.0)  # what is asked for in Pa says nothing of a number without a unit
    friction = steady_mean_of(linear, _RATIO, of_ratio, start)
    if friction.is_steady and not shear.is_steady:
        friction = replace(friction, converged=False, steady_alone=False, reason=shear.reason, status=shear.status,
                           remedy=shear.remedy)  # fmt: skip
    return SteadyStress(shear, normal, friction)


def steady_measure(histories: Sequence[pandas.DataFrame], conditions: SteadyConditions) -> Estimate:
    """The steady mean that a run is judged by: the shear stress [Pa] of a sheared box, else the disc's torque [N m]."""
    if SHEAR_STRESS in histories[0]:
        return steady_stress(histories, conditions).shear
    return steady_torque(histories[0], conditions, histories[1:])


def _sheared_enough(found: Estimate, histories: Sequence[pandas.DataFrame]) -> Estimate:
    """Return the estimate, not converged where some box was sheared too little while averaging."""
    if not found.is_steady or found.start is None:
        return found
    for history in histories:
        strain = history[SHEAR_STRAIN].to_numpy()
        begin = float(np.interp(found.start, [0.0, *history[TIME]], [0.0, *strain]))
        averaged = float(strain[-1]) - begin
        if averaged < MIN_AVERAGED_STRAIN:
            end = float(history[TIME].iloc[-1])
            needed = end * (begin + MIN_AVERAGED_STRAIN) / float(strain[-1])
            reason = f"the averaged part has a shear strain of {averaged:.2g}; {MIN_AVERAGED_STRAIN:g} is needed"
            remedy, missing = f"raise time.end to {1.05 * needed:.2g} s", 1.05 * needed - end
            found = replace(found, converged=False, steady_alone=False, status=NOT_CONVERGED, missing=missing)
            return replace(found, reason=reason, remedy=remedy)
    return found


def stress_summary(
    found: SteadyStress, histories: Sequence[pandas.DataFrame], rate: float, diameter: float, density: float
) -> dict[str, Any]:
    """Entries of ``summary.json``: estimates, inertial numbers, and means of the averaged part.

    The inertial number, rate d sqrt(density/stress), is that of the normal stress; where chains hold the powder that
    may be none, and the one of the shear stress stands next to it. Rate [1/s], mean diameter [m], density [kg/m^3].
    """
    from particles.diagnostics.inertial_number import inertial_number  # local: results are read without the grains

    tau, normal = found.shear.mean, found.normal.mean
    start = (found.shear.start or 0.0) * (1.0 + 1e-9)
    late = [each.assign(**{_LENGTH: durations(each)})[each[TIME] > start] for each in histories]

    def inertial(stress: float | None) -> float | None:
        return None if stress is None or stress <= 0.0 else float(inertial_number(rate, diameter, density, stress))

    summary: dict[str, Any] = {
        "stress": found.shear.as_dict(),
        "shear_stress": tau,
        "shear_stress_error": found.shear.standard_error,
        "normal_stress": found.normal.as_dict(),
        "effective_friction": None if found.friction is None else found.friction.as_dict(),
        "shear_rate": rate,
        "shear_strain": float(min(each[SHEAR_STRAIN].iloc[-1] for each in histories)),
        "inertial_number": inertial(normal),
        "inertial_number_of_shear_stress": inertial(tau),
    }
    for name in (SHEAR_STRESS_LOWER, SHEAR_STRESS_UPPER, SOLID_FRACTION, CONTACTS_PER_GRAIN, RELATIVE_PERMEABILITY):
        if name in late[0] and all(len(each) for each in late):
            summary[name] = float(np.mean([np.average(each[name], weights=each[_LENGTH]) for each in late]))
    return summary
