"""Plan of the field: of a scene without grains all of it, as `emclutch check` prints it."""

from __future__ import annotations

import numpy as np

from emclutch.device_model.body_forces import forces_in_words, movable_bodies
from emclutch.device_model.coil_heat import coil_heat_in_words, winding_in_words
from emclutch.device_model.decision import Decision
from emclutch.device_model.device import CoilDevice, solved_coil
from emclutch.device_model.device_3d import CoilDevice3D
from emclutch.device_model.materials import hysteresis_of, region_materials
from emclutch.scene.case import Case
from emclutch.scene.model import Scene
from emclutch.simulation.plan_in_words import paths_in_words
from field import MagneticField
from field.laws.table_end import driven_beyond_their_tables
from field.section.ampere_turns import ampere_turns_by_part, ampere_turns_in_words


def field_plan(case: Case) -> dict[str, str]:
    """Equations, mesh, and results at the largest current: label -> text."""
    scene = case.scene
    coil = solved_coil(scene)
    words = {
        "grains": "none: without [particles] the scene is of the field alone, for the commands field and mesh; run "
        "refuses it",
        "winding": winding_in_words(scene),
        "mesh": coil.mesh_in_words(),
        "copper": coil_heat_in_words(scene, coil, coil.shape),
    }
    words |= steel_row(scene, coil)
    if coil.largest_current > 0.0 and isinstance(coil, CoilDevice):
        solution = coil.solve_at_peak(None)
        words["field"] = Decision(_field_in_words(coil, solution), *driven_beyond_their_tables([solution]))
        words |= ampere_turns_row(coil, solution)
        for body, regions, force in forces_in_words(solution, movable_bodies(coil, solution)):
            words[f"force on the {body}"] = f"{force}, on {', '.join(regions)}"
    return words | paths_in_words(case)


def steel_row(scene: Scene, coil: CoilDevice | CoilDevice3D) -> dict[str, str]:
    """Row of the plan: coercivity and remanence of the steels; none without hysteresis."""
    steels, warnings = hysteresis_of(scene, region_materials(scene, coil.mesh).values())
    return {"steel": Decision(steels, *warnings)} if steels else {}


def ampere_turns_row(coil: CoilDevice, solution: MagneticField) -> dict[str, str]:
    """Row of the plan: what drives the flux through each part; none with hysteresis or without current."""
    if solution.ampere_turns == 0.0 or solution.history is not None:
        return {}
    return {"ampere-turns": ampere_turns_in_words(ampere_turns_by_part(solution, coil.shape.air_gaps()))}


def _field_in_words(coil: CoilDevice, solution: MagneticField) -> str:
    current = solution.ampere_turns / coil.turns
    linkage = coil.turns * solution.flux_linkage_per_turn
    B_max = float(np.linalg.norm(solution.flux_density(), axis=1).max())
    return (
        f"at {current:.3g} A: flux linkage {linkage:.4g} Wb, inductance {linkage / current:.4g} H, energy "
        f"{solution.energy:.4g} J, co-energy {solution.coenergy:.4g} J, |B| up to {B_max:.3g} T"
    )
