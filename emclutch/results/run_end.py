"""The end of a run in seconds, also where its scene has a shear strain."""

from __future__ import annotations

from emclutch.results.run_folder import RunFolder
from emclutch.scene.scaled import Scaled
from emclutch.scene.timing import TimeSection


def seconds_of(end: float | str | Scaled, folder: RunFolder) -> float | None:
    """Return an end of the run in a folder [s], of a shear strain by the run's shear rate; None where it has none yet.

    A run that continues has the shear rate that it began with.
    """
    if isinstance(end, (int, float)):
        return float(end)
    rate = folder.read_plan().get("shear_rate")
    strain = TimeSection.model_validate({"end": end}).end
    assert isinstance(strain, Scaled)  # a text of a resolved scene
    return strain.value / rate if rate else None
