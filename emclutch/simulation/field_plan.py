"""Plan of the field: of a scene without grains all of it, as `emclutch check` prints it."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from emclutch.device_model.body_forces import forces_in_words, movable_bodies
from emclutch.device_model.coil_heat import coil_heat_in_words, winding_in_words
from emclutch.device_model.decision import Decision
from emclutch.device_model.device import CoilDevice, solved_coil
from emclutch.device_model.device_3d import CoilDevice3D
from emclutch.device_model.materials import hysteresis_of, region_materials
from emclutch.scene.case import Case
from emclutch.scene.input_files import materials_in_words
from emclutch.simulation.plan_in_words import paths_in_words
from field import MagneticField
from field.laws.table_end import driven_beyond_their_tables
from field.section.ampere_turns import OPEN_BOUNDARY, ampere_turns_by_part, ampere_turns_in_words


def field_plan(case: Case) -> dict[str, str]:
    """Equations, mesh, and results at the largest current: label -> text."""
    scene = case.scene
    coil = solved_coil(scene)
    words = {
        "grains": "none: without [particles] the scene is of the field alone, for the commands field and mesh; run "
        "refuses it",
        "winding": winding_in_words(scene),
        "mesh": coil.mesh_in_words(),
        "coil heat": coil_heat_in_words(scene, coil, coil.shape),
    }
    words |= steel_row(case, coil)
    if coil.largest_current > 0.0 and isinstance(coil, CoilDevice):
        solution = coil.solve_at_peak(None)
        words["field"] = Decision(_field_in_words(coil, solution), *driven_beyond_their_tables([solution]))
        words |= ampere_turns_row(coil, solution)
        for body, regions, force in forces_in_words(solution, movable_bodies(coil, solution)):
            words[f"force on the {body}"] = f"{force}, on {', '.join(regions)}"
    return words | paths_in_words(case)


def steel_row(case: Case, coil: CoilDevice | CoilDevice3D) -> dict[str, str]:
    """Rows of the plan: materials of the regions, and with hysteresis coercivity and remanence of the steels."""
    steels, warnings = hysteresis_of(case.scene, region_materials(case.scene, coil.mesh).values())
    materials = ", ".join(f"{region}: {name}" for region, name in materials_in_words(case.scene, case.data).items())
    return {"materials": materials} | ({"steel": Decision(steels, *warnings)} if steels else {})


def ampere_turns_row(coil: CoilDevice, solution: MagneticField) -> dict[str, str]:
    """Row of the plan: what drives the flux through each part; none with hysteresis or without current."""
    if solution.ampere_turns == 0.0 or solution.history is not None:
        return {}
    parts = ampere_turns_by_part(solution, coil.shape.air_gaps())
    return {"ampere-turns": Decision(ampere_turns_in_words(parts), _leakage_warning(coil, parts))}


def _leakage_warning(coil: CoilDevice, parts: Mapping[str, float]) -> str:
    """Warn of a device with poles in which leakage takes more of the ampere-turns than the powder."""
    total, powder = sum(parts.values()), parts.get(coil.problem.powder_region, 0.0)
    leakage = sum(parts.get(name, 0.0) for name in ("air", coil.problem.coil_region, OPEN_BOUNDARY))
    if not coil.has_poles or leakage <= powder:
        return ""
    return (
        f"leakage through air and winding takes {100.0 * leakage / total:.2g} % of the ampere-turns, the powder "
        f"{100.0 * powder / total:.2g} %: much flux bypasses the powder. A wide winding leaves narrow poles beside it: "
        "lower geometry.coil_width or geometry.clearance"
    )


def _field_in_words(coil: CoilDevice, solution: MagneticField) -> str:
    current = solution.ampere_turns / coil.turns
    linkage = coil.turns * solution.flux_linkage_per_turn
    B_max = float(np.linalg.norm(solution.flux_density(), axis=1).max())
    return (
        f"at {current:.3g} A: flux linkage {linkage:.4g} Wb, inductance {linkage / current:.4g} H, energy "
        f"{solution.energy:.4g} J, co-energy {solution.coenergy:.4g} J, |B| up to {B_max:.3g} T"
    )
