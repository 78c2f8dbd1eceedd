"""The numbers of a run: each group computes them from a finished run, and says their keys, units and labels.

Effects and kinds of geometry add their own (`emclutch.effects.Effect.summarise`, `GeometrySection.summarise`).
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

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
from emclutch.results.energy_balance import energy_made, energy_through, energy_warnings
from emclutch.results.quantity import NUMBERS, OPERATING_POINT, RPM, Group, Quantity, group
from emclutch.results.rise_time import rise_times
from emclutch.results.steady_torque import steady_mean_of

MANY_MISSES = 0.01  # of the steps: reported as a warning
JAM = 1e3  # tolerances of the solver of contacts by DVI, beyond which a step counts as jammed


@group(Quantity("title"), Quantity("effects"), Quantity("scene"))
def scene(run: Any) -> dict[str, Any]:
    """Title, effects and warnings of the scene."""
    case = run.case
    warnings = {"scene": {"warnings": list(case.warnings)}} if case.warnings else {}
    return {"title": case.scene.scene.title, "effects": list(case.scene.effects.active), **warnings}


@group(
    Quantity("torque.mean", "raw torque on the disc", "N m"),
    Quantity("torque_rotor.mean", "torque on the rotor", "N m", column="torque_rotor"),
    Quantity("torque_field.mean", "torque taken by the field", "N m"),
    Quantity("stopped"),
)
def torques(run: Any) -> dict[str, Any]:
    """Steady torques on rotor, field and disc, and who ended the run early."""
    history, conditions = run.history, run.conditions
    found: dict[str, Any] = {}
    for body in ("rotor", "field"):
        if (column := torque_on(body)) in history:
            found[column] = steady_mean_of(run.histories, column, conditions).as_dict()
    if run.stopped:
        found["stopped"] = f"by the callback at t = {history[TIME].iloc[-1]:.4g} s of {run.plan.end:.4g} s"
    return found if run.torque is None else found | {"torque": run.torque.as_dict()}


@group(
    Quantity("drag_torque", "drag of seals and bearings", "N m", NUMBERS, "drag_torque"),
    Quantity("torque_with_drag", "torque on the disc's shaft", "N m", NUMBERS, "torque_with_drag"),
)
def drag(run: Any) -> dict[str, float | None]:
    """Torque about +z by which seals and bearings drag the disc along, and its sum with the powder's.

    0 without slip at the end; none where the scene has no drag. On the rotor it is the opposite: on each shaft it
    opposes the slip against the other one.
    """
    given, history, torque = run.case.scene.motion.drag_torque, run.history, run.torque
    if not given or torque is None:
        return {}
    found = 0.0
    if ROTOR_SPEED in history and DISC_SPEED in history:
        found = float(np.sign(history[ROTOR_SPEED].iloc[-1] - history[DISC_SPEED].iloc[-1])) * given
    return {"drag_torque": found, "torque_with_drag": None if torque.mean is None else torque.mean + found}


@group(Quantity("stress"), Quantity("replicas"), Quantity("until"))
def judged(run: Any) -> dict[str, Any]:
    """Stress of a sheared box; seeds and means of the replicas; whether the target is reached."""
    found, estimate = dict(run.of_the_geometry), run.estimate
    if estimate is not None and len(run.histories) > 1:
        column = TORQUE_DISC if run.torque is not None else SHEAR_STRESS
        found["replicas"] = replica_means(run.histories, run.seeds, estimate, column)
    if estimate is not None and run.ending is not None:
        found["until"] = run.ending
    return found


@group(Quantity("lock_up_time", "lock-up time", "s", NUMBERS, "lock_up_time"))
def lock_up(run: Any) -> dict[str, float | None]:
    """Time at which the output locks, where a shaft is free."""
    bodies = run.simulation.motion.bodies  # walls of a box may be on one shaft alone
    is_free = {"rotor", "disc"} <= {body.name for body in bodies} and any(body.is_free for body in bodies)
    return {"lock_up_time": lock_up_time(run.history)} if is_free else {}


@group(
    Quantity("current", "coil current", "A", OPERATING_POINT, "current", of_last_window=True),
    Quantity("voltage", "voltage at the coil's resistance", "V", OPERATING_POINT, of_last_window=True),
    Quantity("copper_loss", "copper loss", "W", OPERATING_POINT, of_last_window=True),
    Quantity("turns", "turns of the coil", "", NUMBERS),
    Quantity("gap_flux_density", "mean flux density under the poles", "T", OPERATING_POINT, "gap_flux_density",
             of_last_window=True),
    Quantity("flux_linkage", "flux linkage", "Wb", NUMBERS),
    Quantity("field_solves"),
    Quantity("final_current", "", "A"),
    Quantity("current_rise_time", "rise of the current to 63 %", "s", NUMBERS),
    Quantity("current_rise_time_90", "rise of the current to 90 %", "s", NUMBERS),
    Quantity("gap_flux_density_rise_time", "rise of the gap field to 63 %", "s", NUMBERS),
    Quantity("gap_flux_density_rise_time_90", "rise of the gap field to 90 %", "s", NUMBERS),
    Quantity("torque_rise_time", "rise of the torque to 63 %", "s", NUMBERS),
    Quantity("torque_rise_time_90", "rise of the torque to 90 %", "s", NUMBERS),
    Quantity("torque_after_rise", "", "N m"),
    Quantity("torque_rise_time_interval", "", "s"),
    Quantity("torque_rise_time_90_interval", "", "s"),
    Quantity("torque_rise_required_end", "", "s"),
    Quantity("torque_rise_replicas"),
    Quantity("torque_lag", "rise time of the torque over that of the current, 63 % (usual: 1.7 to 4)", "", NUMBERS),
)  # fmt: skip
def coil(run: Any) -> dict[str, Any]:
    """Coil at the end of the run, voltage R I, copper loss R I^2, its field, and its rise."""
    coil, source, history = run.coil, run.source, run.history
    if coil is None or source.solution is None:
        return {}
    current, shape = float(history[CURRENT].iloc[-1]), coil.shape
    resistance = run.case.scene.coil.resistance_in(shape.coil_area, shape.coil_mean_radius)
    begins_off = not getattr(source, "begin_steady", coil.currents(0.0) != 0.0)
    return {
        "current": current,
        "voltage": resistance * current,
        "copper_loss": resistance * current**2,
        "turns": coil.turns,
        "gap_flux_density": float(history[GAP_FLUX_DENSITY].iloc[-1]),
        "flux_linkage": float(history[FLUX_LINKAGE].iloc[-1]),
        "field_solves": source.solves,
        "final_current": coil.currents.values[-1],
        **rise_times(history, coil.currents.values[-1], begins_off=begins_off, replicas=run.histories[1:]),
        "field_error_estimate": source.solution.estimated_errors(),
        **({"steel": {"warnings": run.beyond_tables}} if run.beyond_tables else {}),
        **({"coil_heat": {"warnings": heat}} if (heat := run.coil_warnings) else {}),
    }


@group(
    Quantity("slip", "slip", "rad/s", OPERATING_POINT, shown_in=("rpm", RPM)),
    Quantity("slip_heat", "slip heat", "W", OPERATING_POINT),
)
def slip(run: Any) -> dict[str, float]:
    """Slip and its heat at the best estimate of the torque; of a scaled speed those of the real one."""
    torque, history = run.best, run.history
    if torque is None or torque.mean is None or not {ROTOR_SPEED, DISC_SPEED} <= set(history.columns):
        return {}
    late = history[history[TIME] > torque.start] if torque.start is not None else history.iloc[len(history) // 2 :]
    speed = float((late[ROTOR_SPEED] - late[DISC_SPEED]).abs().mean()) / run.speed_factor
    return {"slip": speed, "slip_heat": abs(torque.mean) * speed}


@group(
    Quantity("expected_torque.mean", "", "N m"),
    Quantity("expected_torque_unknown_powder.low", "", "N m"),
    Quantity("expected_torque_unknown_powder.high", "", "N m"),
    Quantity("expected_torque_scene.low", "", "N m", column="expected_low"),
    Quantity("expected_torque_scene.mean", "", "N m", column="expected_torque"),
    Quantity("expected_torque_scene.high", "", "N m", column="expected_high"),
    Quantity("grain_size.across", "", "", column="grains_per_gap"),
    Quantity("grain_size.real_across", "", "", column="real_grains_per_gap"),
    Quantity("grain_size.real_inertial_number", "inertial number of the real powder", "", NUMBERS),
    Quantity("scaled_speed.factor", "speed divided by that of the scene", "", NUMBERS),
    Quantity("torque_against_current.largest_current", "", "A"),
)
def device(run: Any) -> dict[str, Any]:
    """Torque against a ramp of current, expected torque, coarseness of the grains, scaled speed."""
    found = {} if run.ramp is None else {"torque_against_current": run.ramp}
    if run.torque is not None:
        found |= run.expected.as_dict()
    number, pressure = run.inertial_number
    if (size := run.size) is not None:
        found["grain_size"] = size.as_dict(measured=run.error["discretisation_error"] is not None)
        if size.is_coarser and number is not None:
            found["grain_size"]["real_inertial_number"] = number / size.coarse_graining / run.speed_factor
    if (scaled := run.plan.scaled) is not None:
        found["scaled_speed"] = scaled.as_dict() | scaled.had(number, pressure)
    return found


@group(
    Quantity("shear_stress", "raw shear stress between the poles, at most", "Pa", OPERATING_POINT, "shear_stress",
             ("kPa", 1e-3)),
    Quantity("shear_stress_error", "", "Pa", column="shear_stress_error"),
    Quantity("torque_outside_of_the_poles", "fraction of the torque outside of the poles", "", NUMBERS),
    Quantity("field_strength_powder", "field strength between the poles", "A/m", NUMBERS, "field_strength_powder",
             ("kA/m", 1e-3)),
    Quantity("fill_powder", "solid fraction between the poles", "", NUMBERS, "fill_powder"),
)  # fmt: skip
def poles(run: Any) -> dict[str, Any]:
    """Shear stress with its error, mean H and fill of the powder between the poles, when steady.

    Where the walls' load was measured: the fraction of the disc's torque that acts outside of the pole faces, too.
    """
    zone, torque = run.planned.device.pole_zone, run.torque
    if run.simulation.magnetised is None or zone is None or torque is None:
        return {}
    late = [each[each[TIME] > (torque.start or 0.0)] for each in run.histories]
    found: dict[str, float | None] = {
        "shear_stress": None if torque.mean is None else zone.shear_stress(torque.mean),
        "shear_stress_error": None if torque.standard_error is None else zone.shear_stress(torque.standard_error),
    }
    at_poles = run.wall_load.get("poles", {}).get("disc", {}).get("torque")
    walls = run.wall_load.get("walls", {}).values()
    whole = sum(wall.get("torque", 0.0) for wall in walls if wall["body"] == "disc")
    if at_poles is not None and whole:
        found["torque_outside_of_the_poles"] = 1.0 - at_poles / whole
    for name in (FIELD_STRENGTH_POWDER, FILL_POWDER):
        if name in late[0]:
            found[name] = float(np.mean([each[name].mean() for each in late]))
    return found


@group(Quantity("wall_pressure"))
def effects(run: Any) -> dict[str, Any]:
    """Return what each effect says of its run, and the load of the walls."""
    found: dict[str, Any] = {}
    for effect in run.case.scene.effects.present:
        found |= effect.summarise(run.history, run.simulation)
    return found | ({"wall_pressure": run.wall_load} if run.wall_load else {})


@group(Quantity("solver"))
def contact_solver(run: Any) -> dict[str, Any]:
    """Convergence of the solver of contacts by DVI, and warnings where steps violate the law."""
    history, contacts = run.history, run.plan.contact
    if MISSED_STEPS not in history:
        return {}
    tolerance = contacts.tolerance
    missed, worst = int(history[MISSED_STEPS].sum()), float(history[SOLVER_RESIDUAL].max())
    fraction = missed / float(history[STEPS].sum())
    found: dict[str, float | list[str]] = {
        "tolerance": tolerance,
        "sweeps_per_step": float(np.average(history[SWEEPS], weights=history[STEPS])),
        "missed_share": fraction,
        "worst_residual": worst,
        "stabilisation_work": float(history[STABILISATION_WORK].sum()),
    }
    warnings = []
    if fraction > MANY_MISSES:
        warnings.append(
            f"{100.0 * fraction:.2g} % of the steps missed the tolerance of the contacts; raise contact.dvi.max_sweeps"
        )
    if worst > JAM * tolerance:
        why = "the solver reached contact.dvi.max_sweeps before the tolerance"
        if contacts.springs is None:
            why = "rigid grains were jammed between moving walls, where no finite force may exist"
        warnings.append(
            f"the largest violation of Coulomb's law at the end of a step was {worst:.2g} m/s: {why}; torques near "
            "that time are unreliable"
        )
    return {"solver": found | ({"warnings": warnings} if warnings else {})}


@group(
    Quantity("inertial_number", "inertial number", "", NUMBERS, "inertial_number"), Quantity("inertial_number_pressure")
)
def inertia(run: Any) -> dict[str, Any]:
    """Inertial number of the second half of the windows, its median, and what its pressure is of."""
    if INERTIAL_NUMBER not in run.history:
        return {}
    return dict(zip(("inertial_number", "inertial_number_pressure"), run.inertial_number, strict=True))


@group(
    Quantity("structure.coordination", "contacts a grain at the end, walls included", "", NUMBERS),
    Quantity("structure.rattlers", "fraction of grains with fewer than two contacts", "", NUMBERS),
    Quantity("structure.fabric_anisotropy", "anisotropy of contact directions (0 none, 1 all parallel)", "", NUMBERS),
    Quantity("structure.force_anisotropy", "the same, weighted by normal force", "", NUMBERS),
    Quantity("structure.in_chains", "fraction of grains in force chains", "", NUMBERS),
    Quantity("structure.longest_chain", "grains in the longest force chain", "", NUMBERS),
)
def structure(run: Any) -> dict[str, Any]:
    """Measures of the packing as the grains stand at the end (`emclutch.simulation.summary.structure`)."""
    return {"structure": run.structure}


@group(
    Quantity("time", "simulated time", "s", NUMBERS),
    Quantity("steps", "steps", "", NUMBERS),
    Quantity("max_overlap", "largest overlap over diameter", "", NUMBERS),
    Quantity("typical_overlap", "largest overlap over diameter, median of the second half", "", NUMBERS,
             "typical_overlap"),
    Quantity("torque_residual_rms", "residual of the torque balance, RMS", "N m", NUMBERS),
    Quantity("energy_residual_relative", "residual of the energy balance over the energy converted", "", NUMBERS),
)  # fmt: skip
def numerics(run: Any) -> dict[str, Any]:
    """Steps, overlaps and residuals of the balances."""
    history = run.history
    through = energy_through(history) if DISSIPATED in history else 0.0
    found: dict[str, Any] = {
        "time": float(history[TIME].iloc[-1]),
        "steps": int(history[STEPS].sum()),
        "max_overlap": float(history[MAX_OVERLAP].max()),
        "typical_overlap": float(history[MAX_OVERLAP].iloc[len(history) // 2 :].median()),
        "energy_residual_relative": float(history[ENERGY_RESIDUAL].sum() / through) if through else None,
    }
    if TORQUE_RESIDUAL in history:
        found["torque_residual_rms"] = float(np.sqrt((history[TORQUE_RESIDUAL] ** 2).mean()))
    if DISSIPATED in history and (warnings := energy_warnings(history, MISSED_STEPS in history)):
        found["energy_made"] = energy_made(history) | {"warnings": warnings}
    return found


@group(
    Quantity("work_magnetic_over_slip", "work of the magnetic forces over that of the walls, when steady", "", NUMBERS)
)
def magnetic_work(run: Any) -> dict[str, float | None]:
    """Work of the magnetic forces over that of the walls, the slip's, from the steady part's beginning on.

    In a periodic box over that of the shear; what this works through magnetic forces is theirs to give back.

    Nothing in the mean of a steady run, but for what moments and the field lag; without a steady part of the second
    half of the windows. None where nothing slips.
    """
    history, begin = run.history, None if run.estimate is None else run.estimate.start
    if WORK_MAGNETIC not in history:
        return {}
    late = history[history[TIME] > begin] if begin is not None else history.iloc[len(history) // 2 :]
    work = float(late[WORK_MAGNETIC].sum())
    if WORK_SHEAR in history:
        against, work = float(late[WORK_SHEAR].sum()), work - float(late[WORK_BOX_MAGNETIC].sum())
    else:
        against = float(late[WORK_WALLS].sum())
    return {"work_magnetic_over_slip": work / against if against else None}


@group(
    Quantity("grains", "grains simulated", "", NUMBERS, "grains"),
    Quantity("sectors", "sectors in the ring", "", NUMBERS),
    Quantity("dt", "step of the grains", "s", NUMBERS),
    Quantity("window", "coupling window", "s", NUMBERS),
    Quantity("seconds.whole_run", "", "s", column="seconds"),
    Quantity("figure_of_merit", "figure of merit, 1/(relative standard error² processor time)", "1/s", NUMBERS,
             "figure_of_merit"),
    Quantity("contact"),
    Quantity("plan"),
)  # fmt: skip
def cost(run: Any) -> dict[str, Any]:
    """Size of the run, its error by the settings, its time by parts, and the plan."""
    plan, history = run.plan, run.history
    measured = {"field": WALL_FIELD, "magnetic": WALL_MAGNETIC, "contact": WALL_CONTACT, "total": WALL_TOTAL}
    seconds = {part: float(history[name].sum()) for part, name in measured.items() if name in history}
    processor = sum(float(each[PROCESSOR_TIME].sum()) for each in run.histories if PROCESSOR_TIME in each)
    found = {"grains": plan.count, "sectors": run.simulation.n_sectors, "dt": plan.dt, "window": plan.division.length}
    found |= run.error
    if run.target is not None:
        found["accuracy_target"] = run.target
    return found | {
        "seconds": seconds | {**run.seconds, "processor": processor, "predicted": plan.cost.seconds},
        "figure_of_merit": None if run.estimate is None else run.estimate.figure_of_merit(processor),
        "contact": plan.contact_data,
        "plan": run.decisions,
    }


GROUPS: tuple[Group, ...] = (
    scene, torques, drag, judged, lock_up, coil, slip, device, poles, effects, contact_solver, inertia, structure,
    numerics, magnetic_work, cost,
)  # fmt: skip
SHEARED_BOX = (
    Quantity("shear_rate", "shear rate", "1/s", NUMBERS),
    Quantity("shear_stress_lower", "", "Pa"),
    Quantity("shear_stress_upper", "", "Pa"),
    Quantity("shear_strain", "shear strain at the end", "", NUMBERS),
    Quantity("inertial_number_of_shear_stress", "inertial number of the shear stress", "", NUMBERS),
    Quantity("solid_fraction", "solid fraction of the box", "", NUMBERS, "solid_fraction"),
    Quantity("contacts_per_grain", "contacts a grain, mean of the steady part", "", NUMBERS),
    Quantity("relative_permeability", "relative permeability of the powder", "", NUMBERS, "relative_permeability"),
    Quantity("normal_stress.mean", "normal stress", "Pa", NUMBERS, "normal_stress", ("kPa", 1e-3)),
    Quantity("effective_friction.mean", "effective friction", "", NUMBERS, "effective_friction"),
    Quantity("demagnetising_factor"),
    Quantity("flux_density", "flux density of the box", "T", NUMBERS),
    Quantity("magnetisation", "magnetisation of the grains", "A/m", NUMBERS, shown_in=("kA/m", 1e-3)),
)
"""Those that `steady_stress.stress_summary` and the sheared box compute."""
QUANTITIES = tuple(one for each in GROUPS for one in each.quantities) + SHEARED_BOX
UNITS = {one.key: one.unit for one in QUANTITIES if one.unit}


def lock_up_time(history: Any) -> float | None:
    """Return the time [s] from which on the shafts' speeds stay within 1 % of the faster one; None if they do not."""
    slipping = (history[ROTOR_SPEED] - history[DISC_SPEED]).abs()
    fast = np.maximum(history[ROTOR_SPEED].abs(), history[DISC_SPEED].abs())
    places = np.flatnonzero((slipping > 0.01 * fast).to_numpy() | (fast == 0.0).to_numpy())
    if len(places) == 0:
        return 0.0
    if places[-1] == len(history) - 1:
        return None
    return float(history[TIME].iloc[places[-1] + 1])


def replica_means(histories: Any, seeds: list[int], estimate: Any, column: str) -> dict[str, Any]:
    """Return the replicas' seeds, and the mean of a column of each over the averaged part."""
    start, end = estimate.start or 0.0, estimate.end or math.inf
    late = [each[(each[TIME] > start * (1.0 + 1e-9)) & (each[TIME] <= end * (1.0 + 1e-9))] for each in histories]
    widths = [np.diff(each[TIME].to_numpy(), prepend=start) for each in late]
    return {
        "count": len(histories),
        "seeds": seeds,
        "means": [
            float(np.average(each[column], weights=width)) if len(each) else None
            for each, width in zip(late, widths, strict=True)
        ],
    }
