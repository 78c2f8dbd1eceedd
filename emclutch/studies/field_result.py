"""Results of the field alone: `emclutch.field(case)`."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

from emclutch.results.report.render import Reported, write_index
from emclutch.results.report.report import Report
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import bad_input_for
from emclutch.scene.units import Current
from emclutch.scene.value_list import values_of

if TYPE_CHECKING:
    import pandas


@dataclass(frozen=True, repr=False)
class FieldResult(Reported):
    """A field study as it stands in its folder.

    Attributes
    ----------
    folder : Path
        With field.csv, field.json, field.pvd, pictures and line-<n>.csv.
    summary : dict
        field.json: `units`, `currents` (a row a current), `at_last_current` (error estimate, forces [N], winding,
        solver, sheared powder) and `warnings` (of the scene, and regions driven beyond the end of their steel's table).
    """

    folder: Path
    summary: dict[str, Any]

    @cached_property
    def table(self) -> pandas.DataFrame:
        """A row a current; units of the columns in `units`."""
        import pandas

        return pandas.DataFrame(self.summary["currents"])

    @property
    def units(self) -> dict[str, str]:
        """Units of the columns and of what is known at the last current; what has none is a pure number."""
        return self.summary["units"]

    @cached_property
    def lines(self) -> tuple[pandas.DataFrame, ...]:
        """Along each line at the last current: distance, r, z [m], B_r, B_z [T], H_r, H_z [A/m], region."""
        import pandas

        count = len(list(self.folder.glob("line-*.csv")))
        return tuple(pandas.read_csv(self.folder / f"line-{number}.csv") for number in range(1, count + 1))

    def report(self) -> Report:
        """Return a table of the currents, and what is known at the last one."""
        from emclutch.studies.field_report import field_report  # local: it imports the packages of the physics

        return field_report(self.folder, self.summary)


def field(
    case: Case | str | Path,
    currents: float | str | Sequence[float | str] | None = None,
    lines: Sequence[tuple[float, ...]] = (),
    out: str | Path | None = None,
) -> FieldResult:
    """Solve the field alone, the powder spread evenly, and write it into a new folder.

    Parameters
    ----------
    case : Case, or the path of a scene file, with a coil
    currents : one or several, numbers [A] or texts with a unit, "0.4 A"; default: the largest of the scene.
    lines : straight lines (r0, z0, r1, z1) [m] along which B and H are wanted at the last current; of a device that is
        solved in 3D (x0, y0, z0, x1, y1, z1).
    out : new folder; default: the next runs/<case>-field-<nnn>.

    Raises
    ------
    SceneError
        The scene has faults or no coil's field, a current cannot be read, or a line leaves the mesh.
    ConvergenceError
        A current that does not converge; what was solved before is written.
    OutputError
        The folder is there already.
    """
    from emclutch.studies.field import field_study  # local: it imports the packages of the physics

    case = as_case(case)
    asked = None if currents is None else values_of(currents, Current, "currents")
    with bad_input_for(case.path):
        folder = field_study(case, asked, lines, out)
    found = FieldResult(folder, json.loads((folder / "field.json").read_text(encoding="utf-8")))
    write_index(found.report())
    return found
