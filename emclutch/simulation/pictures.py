"""The pictures of a finished run, at its end or later where they are missing.

Section with |B| and flux lines, torque and speeds against time, profiles, grains.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from emclutch.device_model.device_3d import gap_map
from emclutch.results import RunFolder, load_result
from emclutch.results.columns import CURRENT, SHEAR_STRESS, TORQUE_DISC
from emclutch.results.current_ramp import PICTURE, TABLE
from emclutch.results.folder_lock import locked_folder
from emclutch.results.measured_table import measured_in
from emclutch.results.pictures import (
    axial_picture,
    grains_picture,
    profile_picture,
    section_picture,
    sheared_box_picture,
    speed_picture,
    stress_picture,
    torque_picture,
    wall_pressure_picture,
)
from emclutch.results.pictures.current_ramp import run_against_current_picture
from emclutch.results.pictures.field import gap_map_picture
from emclutch.results.pictures.speeds import speeds_vary
from emclutch.results.pictures.torque import varies
from emclutch.results.text import format_time
from emclutch.scene.case import Case, load_case
from emclutch.simulation.plan import make_plan
from emclutch.simulation.resume import begun_windows, refuse_changed_files, run_checkpoint
from emclutch.simulation.run_observers import profile_average
from emclutch.simulation.snapshots import contact_lines, wrapped
from emclutch.simulation.started_run import restored
from field import MagneticField
from field.section.smooth_field import SmoothField

if TYPE_CHECKING:
    from emclutch.simulation.profile_average import ProfileAverage


def draw_run(case, folder: RunFolder, device, simulation, profiles: ProfileAverage | None = None) -> None:
    """Write the pictures that the run has something to show in.

    section.png or gap.png with a solved field, torque.png, torque_vs_current.png of a slow ramp of the current or where
    the folder has a measured curve, stress.png of a sheared box, speeds.png where a shaft's speed changes, profiles.png
    and wall_pressure.png where profiles were asked for, and at last grains.png: where it lies all others do.
    """
    title = case.scene.scene.title
    result = load_result(folder.path)
    grains, motion = simulation.motion.grains, simulation.motion
    solution = None if simulation.source is None else simulation.source.solution
    at = moment_in_words(result.history, motion.time)
    if isinstance(solution, MagneticField):
        x = grains.position
        r, theta = np.hypot(x[:, 0], x[:, 1]), np.arctan2(x[:, 1], x[:, 0])
        middle = 0.0 if motion.sector is None else 0.5 * motion.sector.angle
        slice_ = np.abs(r * (theta - middle)) < grains.radius  # one layer of grains around a half-plane
        section_picture(
            folder.section_picture,
            SmoothField(solution.problem.elements, solution.psi),
            title=f"{title}, {at}",
            grains=np.column_stack([r, x[:, 2], grains.radius])[slice_],
            filled=device.coil.powder_boxes,
        )
    elif solution is not None:
        gap_map_picture(folder.path / "gap.png", *gap_map(device.coil, solution), title=f"{title}, {at}")
    if TORQUE_DISC in result.history:  # a box has no disc
        current = steady_current(result.history)
        torque_picture(
            folder.torque_picture,
            result.history,
            result.torque,
            result.other_histories,
            best=result.best,
            title=title if current is None else f"{title}, {current:.4g} A",
            times=rise_times_in_words(case.scene.effects, result.summary),
            locked=result.summary.get("lock_up_time"),
        )
    measured = measured_in(folder.path)
    if (folder.path / TABLE).is_file() or (measured is not None and CURRENT in result.history):
        run_against_current_picture(folder.path / PICTURE, result, measured=measured, title=title)
    if SHEAR_STRESS in result.history:
        stress_picture(folder.stress_picture, result.history, result.stress, result.other_histories, title=title)
    if speeds_vary(result.history):
        locked = result.summary.get("lock_up_time")
        speed_picture(folder.path / "speeds.png", {title: result.history}, title=title, locked=locked)
    if profiles is not None and (across := profiles.profiles()):
        profile_picture(folder.path / "profiles.png", across, title=f"{title}, {at}")
    load = None if profiles is None else profiles.walls.pressure()
    if load is not None and load.contacts.any():
        wall_pressure_picture(folder.path / "wall_pressure.png", load, motion.walls, title=f"{title}, {at}")
    start, ends, force = contact_lines(motion)
    chains = start, ends, np.linalg.norm(force, axis=1)
    speed = np.linalg.norm(grains.velocity, axis=1)
    box = motion.box or motion.gap_box
    if box is not None:
        position, velocity = wrapped(motion)
        sheared_box_picture(
            folder.grains_picture,
            position,
            grains.radius,
            velocity,
            lengths=box.lengths,
            faces=motion.gap_box is not None,
            chains=chains,
            title=f"{title}, {at}",
        )
        return
    if device.kind.is_seen_along_axis:
        axial_picture(
            folder.grains_picture,
            grains.position,
            grains.radius,
            speed,
            walls=motion.walls,
            angles={body.name: body.angle for body in motion.bodies},
            chains=chains,
            title=f"{title}, {at}",
        )
        return
    grains_picture(
        folder.grains_picture,
        grains.position,
        grains.radius,
        speed,
        walls=motion.walls,
        chains=chains,
        title=f"{title}, {at}",
        sector_angle=None if motion.sector is None else motion.sector.angle,
    )


def moment_in_words(history, time: float) -> str:
    """The moment [s] that a picture shows, with the current at the end of a history where there is a coil."""
    at = f"t = {format_time(time)}"
    return f"{history[CURRENT].iloc[-1]:.4g} A, {at}" if CURRENT in history else at


def rise_times_in_words(effects, summary) -> str:
    """The times to 63 and 90 % of the final values, where a run has them.

    A current that the scene gives is no result, nor is a field that follows it without delay.
    """
    parts = []
    delayed = {
        "torque": summary.get("lock_up_time") is None,
        "current": effects.circuit is not None,
        "gap_flux_density": effects.circuit is not None or effects.eddy is not None,
    }
    for name, key in (("torque", "torque"), ("current", "current"), ("field", "gap_flux_density")):
        first, late = (summary.get(f"{key}_rise_time{share}") for share in ("", "_90"))
        if first is not None and delayed[key]:
            then = f", 90 % after {format_time(late)}" if late else ""
            parts.append(f"{name} 63 % after {format_time(first)}{then}")
    return "\n".join(parts)


def steady_current(history) -> float | None:
    """The coil's current [A] of a run in which it does not change; None of another, or without a coil."""
    if CURRENT not in history or varies(history[CURRENT]):
        return None
    return float(history[CURRENT].iloc[-1])


def draw_missing(folder: RunFolder, case: Case | None = None, *, trust_scripts: bool = False) -> bool:
    """Draw a finished run's pictures where they are missing, and return whether that was so.

    The summary is written before the pictures, so that a run that was killed between the two is done and is not run
    again. What it ended with lies in its checkpoint, of which they are drawn.

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
        plan = plan.continued(*begun_windows(state, case.scene.contact.method))
        simulation = restored(device, plan, state)
        profiles = profile_average(plan.scene, device)
        if profiles is not None:
            profiles.restore(state.get("profiles"), simulation.motion)
        draw_run(case, folder, device, simulation, profiles)
    return True
