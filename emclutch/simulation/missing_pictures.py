"""Pictures of a finished run that was killed before it had drawn them all.

The summary is written before the pictures, so that such a run is done and is not run again. What it ended with lies in
its checkpoint, of which they are drawn.
"""

from __future__ import annotations

from emclutch.results import RunFolder
from emclutch.results.folder_lock import locked_folder
from emclutch.scene.case import Case, load_case
from emclutch.simulation.pictures import draw_run
from emclutch.simulation.plan import make_plan
from emclutch.simulation.resume import refuse_changed_files, run_checkpoint
from emclutch.simulation.run_observers import profile_average
from emclutch.simulation.started_run import restored


def draw_missing(folder: RunFolder, case: Case | None = None, *, trust_scripts: bool = False) -> bool:
    """Draw a finished run's pictures where they are missing, and return whether that was so.

    Parameters
    ----------
    folder : of the run.
    case : of the run; None reads it from the folder, where `trust_scripts` is as for `load_case`.

    Raises
    ------
    OutputError
        The checkpoint cannot be read, a file that the scene names has changed, or somebody else writes the folder.
    """
    if not folder.lacks_pictures():
        return False
    with locked_folder(folder.path):
        case = load_case(folder.case, trust_scripts=trust_scripts) if case is None else case
        refuse_changed_files(case, folder)
        state = run_checkpoint(folder.checkpoint)
        device, plan = make_plan(case)
        plan = plan.continued(state["steps_per_update"], state["updates"])
        simulation = restored(device, plan, state)
        profiles = profile_average(plan.scene, device)
        if profiles is not None:
            profiles.restore(state.get("profiles"), simulation.motion)
        draw_run(case, folder, device, simulation, profiles)
    return True
