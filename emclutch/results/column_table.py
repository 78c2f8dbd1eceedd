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

`history.csv` has one row for each coupling window. `time` is the end of the window. `run.h5` has the same rows. A
quantity that does not exist in a scene has no column. The third column of the table, *of*, says to which instant or
interval a value belongs:

- **end of the window**: the state at `time`.
- **last solve of the field**: the state when the field was last solved. The field is solved at the end of a window if,
  since the last solve, the current has changed by more than 1 % of its largest value so far, or the moments of the
  grains by more than `effects.back_reaction.tolerance`. `current` is the current of this solve, so that `current`,
  `flux_linkage` and `field_energy` of a row belong together.
- **last evaluation of the moments**: moments are computed at the start of each update interval and are constant in it.
- **mean, sum, largest**: over the window. Its steps use the field of the start of the window.

Exceptions:

- With `effects.hysteresis` the field is also solved at each turn of the current, and again at the end of that window.
- With `effects.coil_circuit` its `tolerance` replaces the 1 %. `current`, `flux_linkage` and `field_energy` are those
  of the circuit at the end of the window.
- With `effects.eddy_currents` these three are those of the last time step of the field.
- With eddy currents or hysteresis a sum covers the time steps of the field that end in the window.

Frames for ParaView and of `run.h5` have positions, walls and field at their time. Moments and magnetic forces are those
of the last evaluation. Velocities are half a step earlier.
"""
