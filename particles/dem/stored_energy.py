"""Elastic energy of a state that has no history yet, and the table of the law that it follows from."""

from __future__ import annotations

from typing import Any

import numpy as np

from particles.dem.contact_kernel import LAST_STORED
from particles.grains import Grains
from particles.laws.columns import COHESION_0, COHESION_1, DAMPING_N, DAMPING_T
from particles.laws.pair_table import PairLaws
from particles.laws.springs import EqualLinearTable, law_table, remembers, spring
from particles.neighbours.contact_list import ContactList


def scene_law_table(laws: PairLaws, grains: Grains, one_species: bool) -> Any:
    """The table of the law; with constant dashpots [kg/s] where grains of a linear law are of one size and mass."""
    rows = laws.rows
    table = law_table(laws.kernel, rows)
    if laws.kernel != "linear" or not one_species:
        return table
    if np.ptp(grains.radius) > 0.0 or np.ptp(grains.mass) > 0.0:
        return table
    equal = rows.copy()
    for row in range(len(rows)):
        m_eff = float(grains.mass[0]) * (1.0 if row in laws.wall else 0.5)
        equal[row, [DAMPING_N, DAMPING_T]] = spring(table, row, 1e-6, m_eff, 1.0, 0.0)[2:4]
    return EqualLinearTable(equal)


def elastic_energy_at_rest(
    table: Any,
    laws: PairLaws,
    wall_row: np.ndarray,
    species: np.ndarray | None,
    grains: Grains,
    contacts: ContactList,
    overlaps: tuple[np.ndarray, np.ndarray],
) -> float:
    """Elastic energy [J] of the ``overlaps`` [m] of the list's pairs (p,) and walls (s,).

    ``wall_row`` are the rows of the law for species and wall. For a law with a memory the contacts note what they
    store, because its losses follow from the change of that.
    """
    energy, c = 0.0, contacts
    kind = np.zeros(grains.count, dtype=np.int64) if species is None else species
    radius, mass = grains.radius, grains.mass
    pairs, walls = overlaps
    for k in np.flatnonzero(pairs > 0.0):
        i, j = int(np.searchsorted(c.pairs.start, k, side="right") - 1), int(c.pairs.other[k])
        m_eff = mass[i] * mass[j] / (mass[i] + mass[j])
        r_eff = radius[i] * radius[j] / (radius[i] + radius[j])
        row = int(laws.pair[kind[i], kind[j]])
        stored = spring(table, row, pairs[k], m_eff, r_eff, 0.0)[4]
        energy += stored - _pull(laws, row, r_eff) * pairs[k]
        if remembers(table):
            c.pair_memory.history[k, LAST_STORED], c.pair_memory.touching[k] = stored, 1
    for k in np.flatnonzero(walls > 0.0):
        i = int(np.searchsorted(c.wall_start, k, side="right") - 1)
        row = int(wall_row[kind[i], c.wall_other[k]])
        stored = spring(table, row, walls[k], mass[i], radius[i], 0.0)[4]
        energy += stored - _pull(laws, row, radius[i]) * walls[k]
        if remembers(table):
            c.wall_memory.history[k, LAST_STORED], c.wall_memory.touching[k] = stored, 1
    return energy


def _pull(laws: PairLaws, row: int, r_eff: float) -> float:
    """Pull of cohesion [N] in a contact of this row."""
    return float(laws.rows[row, COHESION_0] + laws.rows[row, COHESION_1] * r_eff)
