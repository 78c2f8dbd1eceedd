"""Cost of the parts of a run on the reference machine: one core of a Xeon at 2.8 GHz, one thread, processor time.

What an effect adds stands in its module (`emclutch.effects`). Each number was measured on the scenes named beside it;
`tests/benchmarks/predicted_cost.py` measures their sum again, `dem_cost.py`, `moment_cost.py` and `dvi_cost.py` some of
them alone. ``_NS`` are nanoseconds, ``_S`` seconds. Those of grains and moments were scaled by how much faster the
kernels became on another machine (before and after in one sitting), when they were vectorised.
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
CALL_S = 0.3e-3  # of a batch of steps between two updates, or of a window's
# A contact and step by DEM
CONTACT_NS = 30.0  # thesis/electromagnetic, 0.2 to 1.7 contacts a grain; these here: dem_cost.py
SIZES_NS = 10.0  # where grains are of several sizes
# Of rigid grains
DVI_GRAIN_NS = 500.0  # a grain and step: search, energy budget, motion; thesis/centrifugal_methods
VISIT_NS = 46.0  # a contact in a sweep of the accelerated solver: thesis/centrifugal_methods, electromagnetic_study
# An update of the magnetic forces, a grain of it, and a row of a neighbour (a pair is seen from both grains)
UPDATE_S = 0.3e-3
SAMPLE_NS = 800.0
# Of the field
ITERATION_S = {"cholmod": 2.4e-6, "superlu": 1.2e-5}  # an unknown and Newton iteration in the section
ITERATIONS = 2.0  # quickstart, powder_clutch: one with a new factor and three to four steps with the same, a fifth each
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
    effects = scene.effects
    near_grain, near_contact = (0.0, 0.0) if effects.attraction is None else effects.attraction.step_ns
    grain = GRAIN_NS + ENERGIES_NS * scene.output.energy_budget + near_grain
    contact = CONTACT_NS + scene.contact.kind.contact_ns + SIZES_NS * (scene.grains.sizes is not None)
    contact += sum(one.contact_ns for one in effects.present) + near_contact
    return 1e-9 * grains * (grain + contact * counts.contacts)


def update_seconds(scene: Scene, grains: int, counts: Counts) -> float:
    """Seconds of an evaluation of the magnetic forces: field at the grains, moments, forces."""
    attraction = scene.effects.attraction
    row = 0.0 if attraction is None else attraction.row_ns(counts.moment_sweeps)
    return UPDATE_S + 1e-9 * grains * (SAMPLE_NS + row * counts.neighbours)


def field_seconds(scene: Scene, device: Device, counts: Counts) -> float:
    """Seconds of a window's field: deposit, solves, and the moments that are found again after each."""
    coil = device.section_coil
    if coil is None:
        return 0.0 if device.coil is None else counts.solves * SOLID_S * device.coil.problem.n_dofs
    deposit = update = 0.0
    effects = scene.effects
    if effects.feedback is not None:
        update = update_seconds(scene, device.fill.count, counts)
        deposit = effects.feedback.deposit_seconds * coil.problem.powder_elements.size
    eddy = 1.0 if effects.eddy is None else effects.eddy.solve_factor
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


def is_of_revolution(device: Device) -> bool:
    """Return whether the field, where there is one, is solved in the section."""
    return device.coil is None or device.section_coil is not None
