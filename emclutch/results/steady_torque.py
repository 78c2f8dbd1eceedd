"""The steady torque on the disc: one verdict for summary, result and comparison of methods.

Statistics of replicas (`replicated_mean`) know nothing of mechanics. Three more things are asked. Averaging does not
begin before the gap was sheared by the strain that start-up is known to need in scenes of this kind
(`SteadyConditions.start_up_strain`). What goes into the powder must come out: rotor + disc + housing + field vanish
once the powder's angular momentum no longer changes. And between slipping shafts the gap must be sheared by
`MIN_AVERAGED_STRAIN` while averaging.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, fields, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.changing_drive import changing_drive
from emclutch.results.columns import (
    ANGULAR_MOMENTUM,
    DISC_SPEED,
    ROTOR_SPEED,
    SHEAR_STRAIN,
    SHEAR_STRESS,
    TIME,
    TORQUE_DISC,
    TORQUE_FIELD,
    TORQUE_HOUSING,
    TORQUE_ROTOR,
)
from emclutch.results.replicated_mean import USUAL, replicated_mean
from emclutch.results.statistics import MIN_BATCHES, NOT_CONVERGED, RUN_LONGER, Estimate, more_time

if TYPE_CHECKING:
    import pandas

MIN_AVERAGED_STRAIN = 5.0  # shear of the gap, slip times radius over width, while averaging: several correlation times
MAX_IMBALANCE = 0.05  # of the torque
NO_PROBLEM = "", "", 0.0
HOLDS = 0.01  # of the rotor's fastest speed: shafts whose slip falls below it do not shear the gap


@dataclass(frozen=True, slots=True)
class SteadyConditions:
    """Data that the verdict needs in addition to the history, in the run's folder from its first window on.

    Attributes
    ----------
    average_from : float or None
        Beginning of the steady part [s], None: to be found in the history.
    shear_gap : float or None
        Width of the sheared gap [m], 0 where nothing is sheared; None: unknown, as of a run of an earlier version.
    shear_radius : float
        Mean radius of that gap [m].
    negligible : float
        Torque [N m] below which it need not be known any better, as `time.until` may say; 0: there is none.
    share : float
        Half the 95 % interval over the torque that is asked for by `time.until`; 0: it asks for none.
    start_up_strain : float
        Shear strain of the gap before which no torque is averaged; 0: unknown.
    exclude_drift : bool
        A torque that may drift is not steady; False: its start-up is known to be over by `average_from`.
    several_looks : bool
        The rule that ends the run may look at the torque several times.
    replica_scatter : float
        Standard deviation between replicas of the torque, over it, that an accuracy study has measured; 0: none.
    replica_scatter_freedom : float
        Its degrees of freedom.
    replica_scatter_from : float
        Time [s] from which on it is that of a run: means over a shorter part scatter more.
    """

    average_from: float | None = None
    shear_gap: float | None = None
    shear_radius: float = 0.0
    negligible: float = 0.0
    share: float = 0.0
    start_up_strain: float = 0.0
    exclude_drift: bool = True
    several_looks: bool = False
    replica_scatter: float = 0.0
    replica_scatter_freedom: float = 0.0
    replica_scatter_from: float = 0.0

    def wanted(self, mean: float) -> float:
        """Half the interval's width [N m] that is asked for of a torque [N m]; where nothing is, that of `USUAL`."""
        share = self.share or (0.0 if self.negligible else USUAL)
        return max(share * abs(mean), self.negligible)

    def settled(self, histories: Sequence[pandas.DataFrame]) -> float:
        """Time [s] up to which the start-up lasts at the least: the gap was sheared by `start_up_strain` in all.

        0 where nothing is sheared, or shafts hold; beyond the end, at the mean rate, where the gap was sheared by less.
        """
        latest = 0.0
        for history in histories:
            strain = shear_strain(history, durations(history), self)
            if strain is None or not len(strain):
                continue
            if strain[-1] < self.start_up_strain:
                missing = min(self.start_up_strain / strain[-1], 10.0) if strain[-1] > 0.0 else 1.0
                return missing * float(history[TIME].iloc[-1])
            latest = max(latest, float(np.interp(self.start_up_strain, strain, history[TIME].to_numpy())))
        return latest

    def as_dict(self) -> dict[str, float | None]:
        """Plain values for JSON."""
        return asdict(self)

    @classmethod
    def from_dict(cls, values: Mapping[str, Any]) -> SteadyConditions:
        """Inverse of `as_dict`; what is missing is unknown."""
        known = {one.name: values[one.name] for one in fields(cls) if values.get(one.name) is not None}
        known.setdefault("several_looks", bool(known.get("share") or known.get("negligible")))  # of an earlier version
        return cls(**known)


def steady_mean_of(
    histories: Sequence[pandas.DataFrame], column: str, conditions: SteadyConditions, average_from: float | None = None
) -> Estimate:
    """Mean and standard error of the steady part of a torque [N m] or stress [Pa] over all replicas.

    By statistics alone. The scatter that a study has measured is that of the disc's torque, or of the shear stress.

    `average_from` [s] is that of the conditions where it is None.
    """
    start = conditions.average_from if average_from is None else average_from
    signals = [(each[TIME].to_numpy(), each[column].to_numpy(), durations(each)) for each in histories]
    is_pooled = column in (TORQUE_DISC, SHEAR_STRESS) and all(
        time[-1] >= conditions.replica_scatter_from for time, _, _ in signals
    )
    return replicated_mean(
        signals,
        average_from=start,
        settled=conditions.settled(histories),
        exclude_drift=conditions.exclude_drift or start is None,
        wanted=conditions.wanted,
        several_looks=conditions.several_looks,
        scatter=conditions.replica_scatter if is_pooled else 0.0,
        scatter_freedom=conditions.replica_scatter_freedom,
    )


def steady_torque(
    history: pandas.DataFrame, conditions: SteadyConditions, replicas: Sequence[pandas.DataFrame] = ()
) -> Estimate:
    """The disc's steady torque [N m]; converged only where statistics, balance and shear agree.

    Parameters
    ----------
    history : DataFrame
        Columns `time` [s], `torque_disc` [N m], and where the scene has them `torque_rotor`, `torque_housing`,
        `torque_field` [N m], `rotor_speed` and `disc_speed` [rad/s]; windows begin at time 0.
    conditions : SteadyConditions
    replicas : sequence of DataFrame
        Histories of the other replicas.
    """
    found = _judged(history, conditions, replicas)
    if not found.is_steady and (changing := changing_drive(history, found.start)):
        return replace(found, reason=changing, status=NOT_CONVERGED, remedy="", missing=None)
    return found


def _judged(history: pandas.DataFrame, conditions: SteadyConditions, replicas: Sequence[pandas.DataFrame]) -> Estimate:
    """Return the torque judged as if its drive were steady, see `steady_torque`."""
    found = steady_mean_of((history, *replicas), TORQUE_DISC, conditions)
    if _is_negligible((history, *replicas), conditions):
        return _negligible(found, conditions.negligible)
    if not found.is_steady or found.mean is None or found.start is None:
        text, missing = _how_much_longer(found, history, conditions)
        return replace(found, remedy=found.remedy + text, missing=missing)
    for each in (history, *replicas):
        duration = durations(each)
        late = each[TIME].to_numpy() - 0.5 * duration > found.start
        error = (found.standard_error or 0.0) * found.replicas**0.5  # of one of them
        problem, remedy, least = _imbalance(each[late], duration[late], found.mean, error)
        if not problem:
            problem, remedy, least = _little_shear(each, duration, late, conditions)
        if problem:
            text, missing = _how_much_longer(found, history, conditions, least)
            found = replace(found, converged=False, steady_alone=False, status=NOT_CONVERGED, missing=missing)
            return replace(found, reason=problem, remedy=remedy + text)
    return found


def _is_negligible(histories: Sequence[pandas.DataFrame], conditions: SteadyConditions) -> bool:
    """True if the disc's torque is negligible in every window of the later half, while the gap is sheared."""
    if not conditions.negligible:
        return False
    for history in histories:
        duration = durations(history)
        late = history[TIME].to_numpy() > 0.5 * history[TIME].iloc[-1]
        if history[TORQUE_DISC].abs()[late].max() >= conditions.negligible:
            return False
        if _little_shear(history, duration, late, conditions) != NO_PROBLEM:
            return False
    return True


def _negligible(found: Estimate, bound: float) -> Estimate:
    """The estimate of a torque that was below `bound` [N m] in every window: its interval is no wider than that."""
    found = replace(found, drift=None, drift_error=None)  # of a torque that does not count
    half = found.half_width()
    error = found.standard_error
    if error is None or half is None or half > bound:
        freedom = found.degrees_of_freedom or max(found.batches - 1.0, 1.0)
        unit = replace(found, standard_error=1.0, degrees_of_freedom=freedom).half_width()
        found = replace(found, standard_error=bound / (unit or 1.0), degrees_of_freedom=freedom)
    below = f"below {bound:g} N m in every window of the later half"
    found = replace(found, converged=True, reason=below, status="converged", remedy="")
    return found.of_one_replica() if found.replicas == 1 else found


def _how_much_longer(
    found: Estimate, history: pandas.DataFrame, conditions: SteadyConditions, least: float = 0.0
) -> tuple[str, float | None]:
    """Estimated time to the requested precision, in words and [s]; `least` [s]: what the mechanics needs.

    Of several replicas `emclutch.simulation.stopping_rule` estimates it.
    """
    if found.mean is None or not (least or (found.replicas == 1 and found.batches < MIN_BATCHES)):
        return "", None
    half, wanted = found.half_width(), conditions.wanted(found.mean)
    more = more_time(found, float(history[TIME].iloc[-1]), wanted) if found.replicas == 1 else None
    if more is None or (half is not None and abs(found.mean) <= half and not conditions.negligible):
        return (f" (estimate: about {least:.2g} s more)", least) if least else ("", None)
    aim = f"{100.0 * wanted / abs(found.mean):.2g} %" if found.mean else f"{wanted:.2g} N m"
    return f" (estimate: about {max(more, least):.2g} s more for {aim})", max(more, least)


def _imbalance(late: pandas.DataFrame, duration: np.ndarray, mean: float, error: float) -> tuple[str, str, float]:
    """Return the error in the balance of mean torques on the powder, the remedy, and how much longer [s] helps.

    Empty where it holds.
    """
    columns = [name for name in (TORQUE_DISC, TORQUE_ROTOR, TORQUE_HOUSING, TORQUE_FIELD) if name in late]
    if ANGULAR_MOMENTUM in late and len(late) > 1:  # weight may turn the powder too, about a shaft that lies
        kept = late[ANGULAR_MOMENTUM].to_numpy()
        left = float((kept[-1] - kept[0]) / duration[1:].sum())
    elif len(columns) == 1:  # a history without the torque on anything else has no balance
        return NO_PROBLEM
    else:
        left = float(np.average(late[columns].sum(axis=1), weights=duration))
    if abs(left) <= MAX_IMBALANCE * abs(mean) + 3.0 * error:
        return NO_PROBLEM
    text = f"the torques on the powder add up to {left:.2g} N m: it still accelerates"
    return text, RUN_LONGER, float(late[TIME].iloc[-1])


def _little_shear(
    history: pandas.DataFrame, duration: np.ndarray, late: np.ndarray, conditions: SteadyConditions
) -> tuple[str, str, float]:
    """Fault of the gap's shear while averaging, the remedy, and how much longer [s] helps.

    Empty where it suffices or the shafts hold.
    """
    if ROTOR_SPEED not in history or DISC_SPEED not in history or conditions.shear_gap == 0.0:
        return NO_PROBLEM
    if _holds(history):
        return NO_PROBLEM
    if conditions.shear_gap is None:
        text = "the folder does not say how wide the gap is, so its shear is unknown"
        return text, "continue with --resume, which writes it", 0.0
    strain = shear_strain(history, duration, conditions)
    if strain is None:
        return NO_PROBLEM
    averaged = float(strain[-1] - np.append(0.0, strain)[:-1][late][0])  # from the begin of the first of its windows
    if averaged >= MIN_AVERAGED_STRAIN:
        return NO_PROBLEM
    more = float(history[TIME].iloc[-1]) * (MIN_AVERAGED_STRAIN / max(averaged, 0.1) - 1.0)
    text = f"the averaged part has a shear strain of {averaged:.2g}; {MIN_AVERAGED_STRAIN:g} is needed"
    return text, RUN_LONGER, more


def shear_strain(history: pandas.DataFrame, duration: np.ndarray, conditions: SteadyConditions) -> np.ndarray | None:
    """Shear strain of the gap, or of a periodic box, at the end of each window (n,); None where shafts do not slip."""
    if SHEAR_STRAIN in history:  # of a periodic box
        return history[SHEAR_STRAIN].to_numpy()
    if ROTOR_SPEED not in history or DISC_SPEED not in history or not conditions.shear_gap:
        return None
    if _holds(history):
        return None
    slip = (history[ROTOR_SPEED] - history[DISC_SPEED]).abs().to_numpy()
    return np.cumsum(slip * duration) * conditions.shear_radius / conditions.shear_gap


def _holds(history: pandas.DataFrame) -> bool:
    """True if the shafts do not slip in some window of the later half."""
    slip = (history[ROTOR_SPEED] - history[DISC_SPEED]).abs().to_numpy()
    return float(slip[len(slip) // 2 :].min()) <= HOLDS * max(float(history[ROTOR_SPEED].abs().max()), 1e-300)


def durations(history: pandas.DataFrame) -> np.ndarray:
    """Length of each window [s], (n,); the first begins at time 0."""
    return np.diff(np.concatenate([[0.0], history[TIME].to_numpy()]))
