"""Energy that went through a run, by which the residual of its balance is judged, and energy that its contacts made."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from emclutch.results.columns import (
    DISSIPATED,
    ELASTIC_ENERGY,
    KINETIC_ENERGY,
    MAGNETIC_ENERGY,
    WORK_LAGGED,
    WORK_MAGNETIC,
    WORK_PRESSURE,
    WORK_SHEAR,
    WORK_WALLS,
)

if TYPE_CHECKING:
    import pandas

ROUND_OFF = 1e-9
"""Of the energy that went through a run: a smaller negative loss is rounding."""


def energy_through(history: pandas.DataFrame) -> float:
    """Return the energy that went through a run [J]: supplied, dissipated and exchanged.

    Exchanged are the largest kinetic and elastic energy, and the ranges of the magnetic energy and of the works of
    lagged forces and weight up to a window, which are ranges of potential energies. 0 where nothing moves.
    """

    def sizes(name: str) -> float:
        return float(history[name].abs().sum()) if name in history else 0.0

    def work_range(name: str) -> float:
        return float(np.ptp(np.append(0.0, np.cumsum(history[name])))) if name in history else 0.0

    stored = sum(history[name] for name in (KINETIC_ENERGY, ELASTIC_ENERGY) if name in history)
    magnetic = float(np.ptp(history[MAGNETIC_ENERGY])) if MAGNETIC_ENERGY in history else 0.0
    through = sum(map(sizes, (WORK_WALLS, WORK_SHEAR, WORK_PRESSURE, *losses(history))))
    through += sum(map(work_range, (WORK_MAGNETIC, WORK_LAGGED, "work_gravity")))
    return through + magnetic + float(np.max(stored))


def losses(history: pandas.DataFrame) -> list[str]:
    """Return the columns of what each mechanism dissipates [J]; their sum where it is not split."""
    return [name for name in history if name.startswith(f"{DISSIPATED}_")] or [DISSIPATED]


def energy_made(history: pandas.DataFrame) -> dict[str, float]:
    """Return the energy [J] that mechanisms made which can only lose it: sums over the run below 0 beyond round-off.

    A window alone may have a negative loss: the elastic energy of its begin, say.
    """
    least = ROUND_OFF * energy_through(history)
    sums = {name: float(history[name].sum()) for name in losses(history)}
    return {name: -total for name, total in sums.items() if total < -least}


def energy_warnings(history: pandas.DataFrame, by_dvi: bool) -> list[str]:
    """Return a warning with its remedy where contacts made energy."""
    if not (made := energy_made(history)):
        return []
    total, through = sum(made.values()), energy_through(history)
    names = ", ".join(name.removeprefix(f"{DISSIPATED}_").replace("_", " ") for name in made)
    remedy = "set contact.restitution and contact.wall_restitution to 0.9 or less, and take shorter steps "
    remedy += "(contact.dvi.step)" if by_dvi else "(time.steps_per_contact)"
    return [
        f"contacts made {total:.2g} J of energy, {100.0 * total / through:.2g} % of the energy supplied, exchanged and "
        f"dissipated, by {names}: {remedy}"
    ]
