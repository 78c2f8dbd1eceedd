"""What each effect costs on the reference machine: one core of a Xeon at 2.8 GHz, one thread, processor time.

Each number was measured on the scenes named beside it; `tests/benchmarks/cost_foretold.py` measures their sum again,
`dem_cost.py`, `moment_cost.py` and `dvi_cost.py` some of them alone. ``_NS`` are nanoseconds, ``_S`` seconds. Those of
grains and moments were brought down by how much faster the kernels became on another machine (before and after in one
sitting), when they began to take grains and contacts side by side.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from emclutch.simulation.forecast.expected_counts import Counts
from field.factorisation import available_backends

if TYPE_CHECKING:
    from emclutch.device.device import Device
    from emclutch.scene.model import Scene

# A grain and step by DEM: motion, walls near it, the list and its renewals
GRAIN_NS = 84.0  # thesis/centrifugal and electromagnetic, less the energy budget
ENERGIES_NS = 12.0  # the energy budget, output.energy_budget
NEAR_NS = 30.0  # drives of near pulls, found anew with every list: lock_up without current against centrifugal
CALL_S = 0.3e-3  # of a batch of steps between two updates, or of a window's
# A contact and step by DEM
CONTACT_NS = 30.0  # thesis/electromagnetic, 0.2 to 1.7 contacts a grain; these here: dem_cost.py
LAW_NS = {"linear": 0.0, "hertz": 3.0, "hertz_mindlin": 4.0, "thesis": 4.0, "walton_braun": 6.0}
SIZES_NS = 10.0  # where grains are of several sizes
ROLLING_NS = 11.0
TWISTING_NS = 5.0
COHESION_NS = 1.0
NEAR_CONTACT_NS = 46.0  # the pull of a neck from the gap of every step: powder_clutch, magnetised_step.py
# Of rigid grains
DVI_GRAIN_NS = 500.0  # a grain and step: search, energy budget, motion; thesis/centrifugal_methods
VISIT_NS = 46.0  # a contact in a sweep of the accelerated solver: thesis/centrifugal_methods, electromagnetic_study
# An update of the magnetic forces, a grain of it, and a row of a neighbour (a pair is seen from both grains)
UPDATE_S = 0.3e-3
SAMPLE_NS = 800.0
WEAK_NS = 23.0  # a row of moments that magnetise one another, without a field: lock_up's first millisecond
MUTUAL_NS = 52.0  # with one, of fields set up and forces: quickstart, powder_clutch
NEAR_PAIR_NS = 18.0  # besides, of near contacts
SWEEP_NS = 30.0  # a sweep of the moments
# Of the field
DEPOSIT_S = 3e-6  # an element of powder: smear of the moments (quickstart, powder_clutch)
ITERATION_S = {"cholmod": 2.4e-6, "superlu": 1.2e-5}  # an unknown and Newton iteration in the section
ITERATIONS = 2.0  # quickstart, powder_clutch: one with a new factor and three to four steps with the same, a fifth each
EDDY = 1.8  # times, where eddy currents are solved for: switch_on
SOLID_S = 2.6e-4  # an unknown of the field in 3D, the whole solve: slotted_disc, with pyamg
# Of the output, and once
WINDOW_S = 2e-3  # balances, the history's row, what is said
START_S = 3.0  # imports, reading the scene
MESH_S = 1e-4  # an unknown: mesh, the solve of the plan and the first of the run
SOLID_MESH_S = 4e-4
PACKING_S = 5e-4  # a grain
FRAME_S = 0.05  # a snapshot
FRAME_GRAIN_S = 1e-4
PICTURES_S = 3.0


def step_seconds(scene: Scene, grains: int, counts: Counts) -> float:
    """Seconds of a step of the grains."""
    if scene.contact.method == "dvi":
        return 1e-9 * grains * (DVI_GRAIN_NS + VISIT_NS * counts.contacts * counts.sweeps)
    effects, near = scene.effects, is_near(scene)
    grain = GRAIN_NS + ENERGIES_NS * scene.output.energy_budget + NEAR_NS * near
    contact = CONTACT_NS + LAW_NS[scene.contact.law] + SIZES_NS * (scene.grains.sizes is not None)
    contact += ROLLING_NS * (effects.rolling_friction is not None)
    contact += TWISTING_NS * (effects.twisting_friction is not None)
    contact += COHESION_NS * (effects.cohesion is not None) + NEAR_CONTACT_NS * near
    return 1e-9 * grains * (grain + contact * counts.contacts)


def update_seconds(scene: Scene, grains: int, counts: Counts) -> float:
    """Seconds of an evaluation of the magnetic forces: field at the grains, moments, forces."""
    effects, row = scene.effects, 0.0
    if effects.dipoles is not None:
        row = WEAK_NS
        if counts.moment_sweeps > 0.0:
            row = MUTUAL_NS + NEAR_PAIR_NS * is_near(scene) + SWEEP_NS * counts.moment_sweeps
    return UPDATE_S + 1e-9 * grains * (SAMPLE_NS + row * counts.neighbours)


def field_seconds(scene: Scene, device: Device, counts: Counts) -> float:
    """Seconds of a window's field: deposit, solves, and the moments that are found anew after each."""
    coil = device.section_coil
    if coil is None:
        return 0.0 if device.coil is None else counts.solves * SOLID_S * device.coil.problem.n_dofs
    deposit = update = 0.0
    if scene.effects.back_reaction is not None:
        update = update_seconds(scene, device.fill.count, counts)
        deposit = DEPOSIT_S * coil.problem.powder_elements.size
    eddy = EDDY if scene.effects.eddy_currents is not None else 1.0
    solve = ITERATIONS * eddy * ITERATION_S[available_backends()[0]] * coil.problem.n_dofs
    return deposit + counts.solves * (solve + deposit + update)


def start_seconds(scene: Scene, device: Device) -> float:
    """Seconds before the first step: imports, mesh, the fields of the plan and of the start, packing."""
    unknowns = 0 if device.coil is None else device.coil.problem.n_dofs
    field = (MESH_S if is_of_revolution(device) else SOLID_MESH_S + SOLID_S) * unknowns
    return START_S + field + PACKING_S * device.fill.count


def output_seconds(scene: Scene, grains: int, windows: int) -> float:
    """Seconds of the windows' rows, snapshots and pictures."""
    frames = scene.output.snapshots * (FRAME_S + FRAME_GRAIN_S * grains) if scene.output.formats else 0.0
    return WINDOW_S * windows + frames + PICTURES_S * scene.output.pictures


def is_near(scene: Scene) -> bool:
    """Whether the grains' contacts are near ones, by DEM in every step."""
    return scene.effects.dipoles is not None and scene.effects.dipoles.model == "near_field"


def is_of_revolution(device: Device) -> bool:
    """Whether the field, where there is one, is solved in the section."""
    return device.coil is None or device.section_coil is not None
