"""Shear stress and permeability of a magnetised powder from sheared cells, point by point, kept in the user's cache.

A point is one cell (`coupling.powder_cell`): material, fill, field, seed and how it is run. Its digest names its file
in the cache folder (`field.spheres.table_files.cache_folder`), which is written in one step when the point is done: who
is interrupted loses the point at work and no other, and who asks again gets the same numbers at once.
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from dataclasses import asdict, dataclass
from pathlib import Path
from time import perf_counter
from typing import TYPE_CHECKING, Any

import numpy as np

from emclutch.results.atomic_file import replace_json
from emclutch.results.fits import Measured
from emclutch.results.statistics import Estimate, steady_mean
from field.laws.reluctivity import MU_0
from field.spheres.table_files import cache_folder

if TYPE_CHECKING:
    from coupling.powder_cell import ShearParameters

VERSION = 3
"""Of the cell's physics: raised with each change that moves the stress."""

LEFT_OUT = 0.2
"""Fraction of the strain that is not averaged: the powder forgets how it was made."""


def point_digest(parameters: ShearParameters) -> str:
    """SHA-256 (hex) of all that a point depends on."""
    described = {"version": VERSION, "law": repr(parameters.law)} | {
        name: value for name, value in asdict(parameters).items() if name != "law"
    }
    return hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest()


def point_file(parameters: ShearParameters) -> Path:
    """Path where a point is kept."""
    return cache_folder() / f"sheared-{point_digest(parameters)[:32]}.json"


def kept_point(parameters: ShearParameters) -> dict[str, Any] | None:
    """A point that was done before; None where there is none, or a damaged one."""
    try:
        point = json.loads(point_file(parameters).read_text(encoding="utf-8"))
        return point if point["digest"] == point_digest(parameters) else None
    except (OSError, ValueError, KeyError, TypeError):
        return None


def sheared_point(parameters: ShearParameters, progress: Callable[[float], None] | None = None) -> dict[str, Any]:
    """Shear a cell, or take it from the cache; ``progress`` hears how far it is.

    Returns
    -------
    dict
        `tau`, `mu_r` (estimates), `mu_r_at_rest`, `power` (the mean stress by what contacts dissipate [Pa]),
        `inertial_number` with the measured stress, `deepest` overlap over the diameter, `steps`, `dt`, `seconds`,
        `series`.
    """
    from coupling.powder_cell import PowderCell
    from particles.diagnostics.inertial_number import inertial_number

    kept = kept_point(parameters)
    if kept is not None:
        return kept
    began = perf_counter()
    cell = PowderCell(parameters)
    series = asdict(cell.run(progress))
    tau, mu_r = (estimate(series, name) for name in ("tau", "mu_r"))
    late = np.array(series["strain"]) > LEFT_OUT * parameters.strain
    stress = max(tau.mean or 0.0, 1e-3)
    point = {
        "digest": point_digest(parameters),
        "fill": parameters.fill,
        "H": parameters.H,
        "seed": parameters.seed,
        "tau": tau.as_dict(),
        "mu_r": mu_r.as_dict(),
        "mu_r_at_rest": cell.mu_r_at_rest,
        "power": float(np.mean(np.array(series["power"])[late])),
        "inertial_number": float(inertial_number(cell.rate, parameters.diameter, parameters.density, stress)),
        "rate": cell.rate,
        "dt": cell.dem.dt,
        "steps": cell.dem.step_count,
        "deepest": cell.deepest,
        "residual": cell.worst_residual,
        "seconds": perf_counter() - began,
        "series": series,
    }
    path = point_file(parameters)
    path.parent.mkdir(parents=True, exist_ok=True)
    replace_json(path, point)
    return point


def estimate(series: dict[str, list[float]], name: str) -> Estimate:
    """Mean of the sheared part, with its error; strain stands for time."""
    return steady_mean(np.array(series["strain"]), np.array(series[name]), average_from=LEFT_OUT * series["strain"][-1])


@dataclass(frozen=True, slots=True)
class StressOfField:
    """One line of tau(H, fill): means over the seeds.

    Attributes
    ----------
    fill, H : float
        [-], [A/m]
    tau, tau_error : float
        [Pa]; the larger of what the seeds' own errors and what their differences give. None: unknown.
    power : float
        The same stress by what contacts dissipate [Pa].
    mu_r_at_rest, mu_r : float
        Relative permeability of the random packing and of the sheared one.
    exponent : float or None
        d ln tau/d ln H from the next smaller field on.
    inertial_number, deepest : float
        The largest of the seeds.
    seeds : int
    seconds : float
    carlson_tau, carlson_mu_r : float
        Carlson's fits for iron in oil [Pa], [-].
    """

    fill: float
    H: float
    tau: float
    tau_error: float | None
    power: float
    mu_r_at_rest: float
    mu_r: float
    exponent: float | None
    inertial_number: float
    deepest: float
    seeds: int
    seconds: float
    carlson_tau: float
    carlson_mu_r: float


UNITS = {"H": "A/m", "tau": "Pa", "tau_error": "Pa", "power": "Pa", "seconds": "s", "carlson_tau": "Pa"}
"""Of the columns that are no pure numbers."""


def stress_of_field(points: list[dict[str, Any]]) -> list[StressOfField]:
    """Means over the seeds of points, by fill and field, ascending."""
    rows: list[StressOfField] = []
    for fill, H in sorted({(point["fill"], point["H"]) for point in points}):
        alike = [point for point in points if (point["fill"], point["H"]) == (fill, H)]
        tau = np.array([point["tau"]["mean"] for point in alike])
        own = [point["tau"]["standard_error"] for point in alike]
        error = None if None in own else float(np.sqrt(np.sum(np.square(own)))) / len(alike)
        if len(alike) > 1:
            error = max(error or 0.0, Measured.of(tau).error)
        exponent = None
        if rows and rows[-1].fill == fill and rows[-1].tau > 0.0 and tau.mean() > 0.0:
            exponent = float(np.log(tau.mean() / rows[-1].tau) / np.log(H / rows[-1].H))
        rows.append(
            StressOfField(
                fill=fill,
                H=H,
                tau=float(tau.mean()),
                tau_error=error,
                power=float(np.mean([point["power"] for point in alike])),
                mu_r_at_rest=float(np.mean([point["mu_r_at_rest"] for point in alike])),
                mu_r=float(np.mean([point["mu_r"]["mean"] for point in alike])),
                exponent=exponent,
                inertial_number=max(point["inertial_number"] for point in alike),
                deepest=max(point["deepest"] for point in alike),
                seeds=len(alike),
                seconds=float(sum(point["seconds"] for point in alike)),
                carlson_tau=float(carlson_stress(fill, H)),
                carlson_mu_r=float(carlson_flux_density(fill, H) / (MU_0 * H)),
            )
        )
    return rows


def carlson_stress(fill: np.ndarray | float, H: np.ndarray | float) -> np.ndarray | float:
    """Yield stress [Pa] of carbonyl iron in oil at a macroscopic field [A/m]: Carlson's fit with C = 1.

    J. D. Carlson, «MR fluids and devices in the real world», Int. J. Mod. Phys. B 19 (2005) 1463.
    """
    return 271700.0 * np.power(fill, 1.5239) * np.tanh(6.33e-6 * np.asarray(H))


def carlson_flux_density(fill: np.ndarray | float, H: np.ndarray | float) -> np.ndarray | float:
    """Flux density [T] of the same, from the same source."""
    mu_0_H = MU_0 * np.asarray(H)
    return 1.91 * np.power(fill, 1.133) * (1.0 - np.exp(-10.97 * mu_0_H)) + mu_0_H
