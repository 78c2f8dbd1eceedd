"""All columns of ``history.csv``: those of every run and those of the effects, in the order of the file."""

from __future__ import annotations

from collections.abc import Iterable

from emclutch.effects import EFFECTS
from emclutch.results.columns import COMPUTING_TIMES, OF_EVERY_RUN, Column

COLUMNS: dict[str, Column] = {
    column: column
    for column in (*OF_EVERY_RUN, *(column for effect in EFFECTS for column in effect.columns), *COMPUTING_TIMES)
}
"""All columns by name, in the order of the file."""


def units_of(names: Iterable[str]) -> dict[str, str]:
    """Return the units of those of the names that are columns."""
    return {name: COLUMNS[name].unit for name in names if name in COLUMNS}


def reference() -> str:
    """Return the reference of all columns in Markdown, docs/reference/columns.md."""
    rows = [(f"`{one}`", one.unit, one.when.value, one.meaning.replace("|", "\\|")) for one in COLUMNS.values()]
    lines = [f"| {' | '.join(row)} |" for row in rows]
    return "\n".join([_BEFORE_THE_COLUMNS, "| column | unit | of | meaning |", "|---|---|---|---|", *lines, ""])


_BEFORE_THE_COLUMNS = """# Columns of history.csv

A row belongs to a coupling window; a quantity that the scene does not have has no column. The same rows are in
`run.h5`, and `time` is the end of the window. The column *of* says for each quantity to which instant or interval it
belongs:

- **end of the window**: the state at `time`.
- **last solve of the field**: the field is solved at the end of a window where the current has changed by more than 1
  % of its largest value so far since the last solve, or the grains' moments by more than
  `effects.back_reaction.tolerance`; else the quantity is that of the last solve. `current` is the current of that
  field, so that `current`, `flux_linkage` and `field_energy` belong together in each row. A current that stays
  constant is solved for exactly. With `effects.hysteresis` each turn of the current is a solve too, wherever it lies in
  the window, and another one follows at the end of the window. With `effects.coil_circuit`, whose `tolerance` takes the
  place of the 1 %, these three follow the circuit to the end of the window; with `effects.eddy_currents` they are of
  the last step of the field.
- **last evaluation of the moments**: moments are found at the start of each update interval and constant in it.
- **mean, sum, largest**: over the window, whose steps are made in the field of its start. With eddy currents or
  hysteresis a sum is over the steps of the field that end in the window.

Frames for ParaView and the frames of `run.h5` have the grains, the walls and the field of their time; moments and
magnetic forces are of their last evaluation, velocities are half a step earlier.
"""
