"""summary.json: the torque with its error, the device, the numerics, the cost."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from emclutch.device_model.grain_size import grain_size
from emclutch.device_model.pole_zone import PoleZone
from emclutch.results import Estimate, RunFolder
from emclutch.results.atomic_file import replace_text
from emclutch.results.columns import (
    CURRENT,
    DISC_SPEED,
    DISSIPATED,
    ENERGY_RESIDUAL,
    FIELD_STRENGTH_POWDER,
    FILL_POWDER,
    FLUX_LINKAGE,
    GAP_FLUX_DENSITY,
    INERTIAL_NUMBER,
    MAX_OVERLAP,
    MISSED_STEPS,
    PROCESSOR_TIME,
    ROTOR_SPEED,
    SHEAR_STRESS,
    SOLVER_RESIDUAL,
    STABILISATION_WORK,
    STEPS,
    SWEEPS,
    TIME,
    TORQUE_DISC,
    TORQUE_RESIDUAL,
    WALL_CONTACT,
    WALL_FIELD,
    WALL_MAGNETIC,
    WALL_TOTAL,
    WORK_BOX_MAGNETIC,
    WORK_MAGNETIC,
    WORK_SHEAR,
    WORK_WALLS,
    torque_on,
)
from emclutch.results.current_ramp import TABLE, current_ramp
from emclutch.results.energy_balance import energy_made, energy_through, energy_warnings
from emclutch.results.rise_time import rise_times
from emclutch.results.steady_torque import steady_mean_of, steady_torque
from emclutch.results.text import format_percent
from emclutch.scene.replica_count import replica_seed
from emclutch.simulation.discretisation_error import discretisation_error, is_reached
from emclutch.simulation.observables import Observables
from emclutch.simulation.planned_run import PlannedRun
from emclutch.simulation.torque_trigger import how_it_ended
from field.laws.table_end import driven_beyond_their_tables
from particles.diagnostics.coordination import coordination
from particles.diagnostics.fabric import fabric
from particles.diagnostics.force_chains import force_chains
from particles.diagnostics.inertial_number import FRICTION, MAGNETIC, MEASURED

MANY_MISSES = 0.01  # of the steps: reported as a warning
JAM = 1e3  # tolerances of the solver of contacts by DVI, beyond which a step counts as jammed


def summarise(
    case,
    folder: RunFolder,
    planned: PlannedRun,
    simulation,
    seconds: dict[str, float],
    others=(),
    stopped: bool = False,
    wall_load: dict[str, Any] | None = None,
) -> None:
    """Write ``summary.json``: the torque with its error, the device, the numerics, the cost.

    `seconds` are of the process: the whole run, and what of it went into compiling kernels, which the windows' total
    contains as well, and their parts do not. `others` are the histories of the other replicas: their torques count,
    all else is of this run. `stopped`: the user's callback has ended it. `wall_load`: of `WallAverage`.
    """
    device, plan, conditions = planned.device, planned.plan, planned.conditions
    history = folder.read_history()
    summary: dict = {"title": case.scene.scene.title, "effects": list(case.scene.effects.active)}
    if case.warnings:
        summary["scene"] = {"warnings": list(case.warnings)}
    for body in ("rotor", "field"):
        column = torque_on(body)
        if column in history:
            summary[column] = steady_mean_of((history, *others), column, conditions).as_dict()
    if stopped:
        summary["stopped"] = f"by the callback at t = {history[TIME].iloc[-1]:.4g} s of {plan.end:.4g} s"
    torque = steady_torque(history, conditions, others) if TORQUE_DISC in history else None
    if torque is not None:
        summary["torque"] = torque.as_dict()
        summary |= drag_summary(case.scene.motion.drag_torque, history, torque.mean)
        if others:
            summary["replicas"] = replicas_summary(case, (history, *others), torque, TORQUE_DISC)
        if case.scene.span.until is not None:
            summary["until"] = how_it_ended(torque, history, case.scene.span.until)
    measured = case.scene.geometry.summarise((history, *others), conditions, case.scene)
    if "stress" in measured:
        summary |= measured
        stress = Estimate.from_dict(measured["stress"])
        if others:
            summary["replicas"] = replicas_summary(case, (history, *others), stress, SHEAR_STRESS)
        if case.scene.span.until is not None:
            summary["until"] = how_it_ended(stress, history, case.scene.span.until)
    shafts = {body.name for body in simulation.motion.bodies}  # walls of a box may be on one alone
    if {"rotor", "disc"} <= shafts and any(body.is_free for body in simulation.motion.bodies):
        summary["lock_up_time"] = lock_up_time(history)
    if device.coil is not None and simulation.source.solution is not None:
        summary |= coil_summary(case.scene, device.coil, simulation.source, history, others)
        solved = [one for one in (plan.peak_field, simulation.source.solution) if one is not None]
        if beyond := driven_beyond_their_tables(solved):
            summary["steel"] = {"warnings": beyond}
    if torque is not None and case.scene.coil is not None and case.scene.coil.current is not None:
        ramp = current_ramp((history, *others), case.scene.coil.current, conditions)
        if ramp is not None:
            replace_text(folder.path / TABLE, ramp.table().to_csv(index=False))
            summary["torque_against_current"] = ramp.summary()
    if torque is not None:
        summary |= slip_summary(history, torque, 1.0 if plan.scaled is None else plan.scaled.factor)
        summary |= planned.expected.as_dict()
    error = discretisation_error(case, plan, torque, device)
    size = grain_size(case.scene, device) if torque is not None else None
    if size is not None:
        summary["grain_size"] = size.as_dict(measured=error["discretisation_error"] is not None)
    if plan.scaled is not None:
        summary["scaled_speed"] = plan.scaled.as_dict()
    zone = None if simulation.magnetised is None else device.pole_zone
    if zone is not None and torque is not None:
        summary |= zone_summary(zone, (history, *others), torque, wall_load or {})
    for effect in case.scene.effects.present:
        summary |= effect.summarise(history, simulation)
    if wall_load:
        summary["wall_pressure"] = wall_load
    if MISSED_STEPS in history:
        summary["solver"] = solver_summary(history, plan.contact)
    if INERTIAL_NUMBER in history:
        summary |= inertial_number_summary(Observables(case.scene, device), simulation, history, wall_load or {})
        if plan.scaled is not None:
            summary["scaled_speed"] |= plan.scaled.had(summary["inertial_number"], summary["inertial_number_pressure"])
        if size is not None and size.is_coarser and summary["inertial_number"] is not None:
            summary["grain_size"]["real_inertial_number"] = (
                summary["inertial_number"] / size.coarse_graining / (1.0 if plan.scaled is None else plan.scaled.factor)
            )
    summary["structure"] = structure_summary(simulation.motion, case.scene.geometry.has_axis)
    if DISSIPATED in history and (warnings := energy_warnings(history, MISSED_STEPS in history)):
        summary["energy_made"] = energy_made(history) | {"warnings": warnings}
    if WORK_MAGNETIC in history:
        start = torque.start if torque is not None else measured.get("stress", {}).get("start")
        summary["work_magnetic_over_slip"] = work_over_slip(history, start)
    summary |= {"grains": plan.count, "sectors": simulation.n_sectors, "dt": plan.dt, "window": plan.division.length}
    summary |= numerics_summary(history) | error
    if (asked := folder.read_provenance().get("accuracy_target")) is not None:
        reached = is_reached(asked, torque, summary["discretisation_error"])
        summary["accuracy_target"] = {"asked": asked, "reached": reached}
    measured = {"field": WALL_FIELD, "magnetic": WALL_MAGNETIC, "contact": WALL_CONTACT, "total": WALL_TOTAL}
    summary["seconds"] = {part: float(history[name].sum()) for part, name in measured.items() if name in history}
    processor = processor_seconds((history, *others))
    summary["seconds"] |= {**seconds, "processor": processor, "predicted": plan.cost.seconds}
    known = Estimate.from_dict(summary["stress"]) if "stress" in summary else torque
    summary["figure_of_merit"] = None if known is None else known.figure_of_merit(processor)
    summary |= {"contact": plan.contact_data, "plan": planned.decisions}
    folder.write_summary(summary)


def drag_summary(given: float, history, torque: float | None) -> dict[str, float | None]:
    """Return the torque [N m] about +z by which seals and bearings drag the disc along, and its sum with the powder's.

    0 without slip at the end; empty where none is `given` [N m]. On the rotor it is the opposite: on each shaft it
    opposes the slip against the other one.
    """
    if not given:
        return {}
    drag = 0.0
    if ROTOR_SPEED in history and DISC_SPEED in history:
        drag = float(np.sign(history[ROTOR_SPEED].iloc[-1] - history[DISC_SPEED].iloc[-1])) * given
    return {"drag_torque": drag, "torque_with_drag": None if torque is None else torque + drag}


def processor_seconds(histories) -> float:
    """Return the processor time of all windows of some replicas [s].

    Mesh, packing and pictures are not in it; kernels that the first window had to compile are.
    """
    return sum(float(each[PROCESSOR_TIME].sum()) for each in histories if PROCESSOR_TIME in each)


def inertial_number_summary(observables, simulation, history, wall_load: dict[str, Any]) -> dict[str, Any]:
    """Return the inertial number of the second half of the windows, its median, and what its pressure is of.

    Where the walls' load was measured it is that of the pressure on the disc's pole faces.
    """
    late = history.iloc[len(history) // 2 :]
    measured = wall_load.get("poles", {}).get("disc", {}).get("pressure") or 0.0
    if measured > 0.0:
        slip = float((late[ROTOR_SPEED] - late[DISC_SPEED]).abs().median())
        return {"inertial_number": observables.inertial_number(slip, measured), "inertial_number_pressure": MEASURED}
    found = late[INERTIAL_NUMBER].dropna()
    return {
        "inertial_number": float(found.median()) if len(found) else None,
        "inertial_number_pressure": MAGNETIC if observables.magnetic_pressure(simulation) else FRICTION,
    }


def coil_summary(scene, coil, source, history, others=()) -> dict[str, Any]:
    """Return the coil's current at the run's end, voltage R I [V], copper loss R I^2 [W], its field, and its rise."""
    current = float(history[CURRENT].iloc[-1])
    begins_off = not getattr(source, "begin_steady", coil.currents(0.0) != 0.0)
    resistance = scene.coil.resistance_in(coil.shape.coil_area, coil.shape.coil_mean_radius)
    return {
        "current": current,
        "voltage": resistance * current,
        "copper_loss": resistance * current**2,
        "turns": coil.turns,
        "gap_flux_density": float(history[GAP_FLUX_DENSITY].iloc[-1]),
        "flux_linkage": float(history[FLUX_LINKAGE].iloc[-1]),
        "field_solves": source.solves,
        "final_current": coil.currents.values[-1],
        **rise_times(history, coil.currents.values[-1], begins_off=begins_off, replicas=others),
        "field_error_estimate": source.solution.estimated_errors(),
    }


def slip_summary(history, torque: Estimate, factor: float) -> dict[str, float]:
    """Return slip [rad/s] and its heat [W] at the steady torque; of a scaled speed (`factor`) those of the real one."""
    if torque.mean is None or not {ROTOR_SPEED, DISC_SPEED} <= set(history.columns):
        return {}
    late = history[history[TIME] > torque.start] if torque.start is not None else history.iloc[len(history) // 2 :]
    slip = float((late[ROTOR_SPEED] - late[DISC_SPEED]).abs().mean()) / factor
    return {"slip": slip, "slip_heat": abs(torque.mean) * slip}


def work_over_slip(history, begin: float | None) -> float | None:
    """Work of the magnetic forces over that of the walls, the slip's, from the steady part's beginning on [s].

    In a periodic box over that of the shear; what this works through magnetic forces is theirs to give back.

    Nothing in the mean of a steady run, but for what moments and the field lag; without a steady part of the second
    half of the windows. None where nothing slips.
    """
    late = history[history[TIME] > begin] if begin is not None else history.iloc[len(history) // 2 :]
    work = float(late[WORK_MAGNETIC].sum())
    if WORK_SHEAR in history:
        slip, work = float(late[WORK_SHEAR].sum()), work - float(late[WORK_BOX_MAGNETIC].sum())
    else:
        slip = float(late[WORK_WALLS].sum())
    return work / slip if slip else None


def numerics_summary(history) -> dict[str, float | str | None]:
    """Return steps, overlaps and residuals of a run."""
    through = energy_through(history) if DISSIPATED in history else 0.0
    return {
        "time": float(history[TIME].iloc[-1]),
        "steps": int(history[STEPS].sum()),
        "max_overlap": float(history[MAX_OVERLAP].max()),
        "typical_overlap": float(history[MAX_OVERLAP].iloc[len(history) // 2 :].median()),
        **(
            {"torque_residual_rms": float(np.sqrt((history[TORQUE_RESIDUAL] ** 2).mean()))}
            if TORQUE_RESIDUAL in history
            else {}
        ),
        "energy_residual_relative": float(history[ENERGY_RESIDUAL].sum() / through) if through else None,
    }


def zone_summary(
    zone: PoleZone, histories, torque: Estimate, wall_load: dict[str, Any]
) -> dict[str, float | str | None]:
    """Return shear stress [Pa] with its error, mean H [A/m] and fill of the powder between the poles, when steady.

    Where the walls' load was measured: the fraction of the disc's torque that acts outside of the pole faces, too.
    """
    late = [each[each[TIME] > (torque.start or 0.0)] for each in histories]
    found: dict[str, float | str | None] = {
        "shear_stress": None if torque.mean is None else zone.shear_stress(torque.mean),
        "shear_stress_note": "upper bound: the whole torque over the pole faces",
        "shear_stress_error": None if torque.standard_error is None else zone.shear_stress(torque.standard_error),
    }
    at_poles = wall_load.get("poles", {}).get("disc", {}).get("torque")
    whole = sum(wall.get("torque", 0.0) for wall in wall_load.get("walls", {}).values() if wall["body"] == "disc")
    if at_poles is not None and whole:
        found["torque_outside_of_the_poles"] = 1.0 - at_poles / whole
        found["shear_stress_note"] = (
            f"{found['shear_stress_note']}; {format_percent(1.0 - at_poles / whole)} of it outside"
        )
    for name in (FIELD_STRENGTH_POWDER, FILL_POWDER):
        if name in late[0]:
            found[name] = float(np.mean([each[name].mean() for each in late]))
    return found


def replicas_summary(case, histories, found: Estimate, column: str) -> dict[str, Any]:
    """Return the replicas' seeds, and the mean of a column of each over the averaged part."""
    start, end = found.start or 0.0, found.end or np.inf
    late = [each[(each[TIME] > start * (1.0 + 1e-9)) & (each[TIME] <= end * (1.0 + 1e-9))] for each in histories]
    widths = [np.diff(each[TIME].to_numpy(), prepend=start) for each in late]
    return {
        "count": len(histories),
        "seeds": [replica_seed(case.scene.scene.seed, number) for number in range(len(histories))],
        "means": [
            float(np.average(each[column], weights=width)) if len(each) else None
            for each, width in zip(late, widths, strict=True)
        ],
    }


def solver_summary(history, contacts) -> dict[str, float | list[str]]:
    """Convergence of the solver of contacts by DVI, and warnings where steps violate the law."""
    tolerance = contacts.tolerance
    missed, worst = int(history[MISSED_STEPS].sum()), float(history[SOLVER_RESIDUAL].max())
    share = missed / float(history[STEPS].sum())
    summary: dict[str, float | list[str]] = {
        "tolerance": tolerance,
        "sweeps_per_step": float(np.average(history[SWEEPS], weights=history[STEPS])),
        "missed_share": share,
        "worst_residual": worst,
        "stabilisation_work": float(history[STABILISATION_WORK].sum()),
    }
    warnings = []
    if share > MANY_MISSES:
        warnings.append(
            f"{100.0 * share:.2g} % of the steps missed the tolerance of the contacts; raise contact.dvi.max_sweeps"
        )
    if worst > JAM * tolerance:
        why = "the solver came to contact.dvi.max_sweeps far from the solution"
        if contacts.springs is None:
            why = "rigid grains were jammed between walls that push, where no finite force may exist"
        warnings.append(
            f"contacts ended a step {worst:.2g} m/s off the law of contact: {why}; torques near that time are not to "
            "be trusted"
        )
    return summary | ({"warnings": warnings} if warnings else {})


def lock_up_time(history) -> float | None:
    """Return the time [s] from which on the shafts' speeds stay within 1 % of the faster one; None if they do not."""
    slip = (history[ROTOR_SPEED] - history[DISC_SPEED]).abs()
    fast = np.maximum(history[ROTOR_SPEED].abs(), history[DISC_SPEED].abs())
    slipping = np.flatnonzero((slip > 0.01 * fast).to_numpy() | (fast == 0.0).to_numpy())
    if len(slipping) == 0:
        return 0.0
    if slipping[-1] == len(history) - 1:
        return None
    return float(history[TIME].iloc[slipping[-1] + 1])


def structure_summary(motion: Any, has_axis: bool = True) -> dict[str, float | None]:
    """Measures of the packing as the grains stand, see `particles.diagnostics`; None where there is no contact.

    ``coordination`` contacts a grain, walls included; ``rattlers`` share of grains with fewer than two;
    ``fabric_anisotropy`` and ``force_anisotropy`` of the directions of contacts between grains, each alike and weighed
    by normal force: 0 isotropic, 1 all parallel, along (r, phi, z), without an axis along (x, y, z); ``in_chains``
    share of grains in force chains; ``longest_chain`` grains in the longest.
    """
    grains, periodicity, contacts = motion.grains, motion.periodicity, motion.contacts()
    standing, chains = coordination(contacts, grains.count), force_chains(grains, contacts, periodicity)
    alike, weighed = (fabric(grains, contacts, periodicity, force_weighted=weighs) for weighs in (False, True))
    found = {
        "coordination": standing.mean,
        "rattlers": standing.rattlers,
        "fabric_anisotropy": alike.ring_anisotropy if has_axis else alike.anisotropy,
        "force_anisotropy": weighed.ring_anisotropy if has_axis else weighed.anisotropy,
        "in_chains": chains.fraction,
        "longest_chain": float(chains.lengths.max(initial=0)),
    }
    return {name: float(value) if math.isfinite(value) else None for name, value in found.items()}
