"""Columns of ``history.csv``: the names by which code reads them, with unit and meaning, and their order in the file.

Columns of an effect are declared by the effect (`EffectSection.columns`); those of every run stand here. Column names
carry no unit. A quantity that a scene does not have (its effect is off) has no column.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from typing import TYPE_CHECKING

from emclutch.effects import EFFECTS
from emclutch.effects.column import Column

if TYPE_CHECKING:
    from coupling import WindowRow

TIME = Column("time", "s", "end of the window")
CURRENT = Column("current", "A", "coil current")
ROTOR_SPEED = Column("rotor_speed", "rad/s", "speed of the rotor (input shaft)")
DISC_SPEED = Column("disc_speed", "rad/s", "speed of the disc (output shaft)")
TORQUE_DISC = Column("torque_disc", "N m", "torque of the grains on the disc about z, window mean, whole device")
TORQUE_ROTOR = Column("torque_rotor", "N m", "torque of the grains on the rotor about z, window mean, whole device")
TORQUE_HOUSING = Column(
    "torque_housing", "N m", "torque of the grains on the housing about z, window mean, whole device"
)
TORQUE_FIELD = Column(
    "torque_field",
    "N m",
    "minus the field's torque on the grains: nothing by the laws for coil and steel of revolution, so what the "
    "moments are off their fixed point",
)
TORQUE_DISC_NORMAL = Column(
    "torque_disc_normal", "N m", "part of torque_disc from the springs along the contacts' normals"
)
TORQUE_DISC_DAMPING = Column(
    "torque_disc_damping", "N m", "part of torque_disc from the dashpots along the contacts' normals"
)
TORQUE_DISC_TANGENTIAL = Column("torque_disc_tangential", "N m", "part of torque_disc from tangential contact forces")
ANGULAR_MOMENTUM = Column("angular_momentum", "N m s", "of the grains about z, spin included, at the window's end")
TORQUE_RESIDUAL = Column(
    "torque_residual", "N m", "balance of all torques and dL/dt: what is left, each computed independently"
)
KINETIC_ENERGY = Column("kinetic_energy", "J", "of the grains, spin included")
ELASTIC_ENERGY = Column("elastic_energy", "J", "stored in the contacts")
MAGNETIC_ENERGY = Column(
    "magnetic_energy", "J", "of the grains' moments in the present field, at the last evaluation of the window"
)
FIELD_ENERGY = Column("field_energy", "J", "magnetic field energy")
FLUX_LINKAGE = Column("flux_linkage", "Wb", "of the coil, all turns")
GAP_FLUX_DENSITY = Column("gap_flux_density", "T", "mean |B| in the gap")
FIELD_STRENGTH_POWDER = Column(
    "field_strength_powder", "A/m", "mean |H| of the macroscopic field between the pole faces"
)
FILL_POWDER = Column("fill_powder", "1", "solid fraction between the pole faces")
WORK_WALLS = Column("work_walls", "J", "work of the walls on the grains in the window")
WORK_SHEAR = Column("work_shear", "J", "work of the shear of a periodic box on the grains in the window")
WORK_PRESSURE = Column(
    "work_pressure", "J", "work on the grains by the stretch of a periodic box under an imposed pressure in the window"
)
WORK_BOX_MAGNETIC = Column(
    "work_box_magnetic", "J", "part of work_shear and work_pressure through magnetic forces, whose energy it changes"
)
WORK_MAGNETIC = Column("work_magnetic", "J", "work of the magnetic forces on the grains in the window")
WORK_HELD = Column("work_held", "J", "work of all held forces on the grains in the window, where some are not magnetic")
DISSIPATED_NORMAL_DAMPING = Column(
    "dissipated_normal_damping", "J", "part of dissipated in the dashpots along the normals"
)
DISSIPATED_TANGENTIAL_DAMPING = Column(
    "dissipated_tangential_damping", "J", "part of dissipated in the tangential dashpots"
)
DISSIPATED_SLIDING = Column("dissipated_sliding", "J", "part of dissipated by sliding friction")
DISSIPATED_IMPACT = Column("dissipated_impact", "J", "part of dissipated along the normals, where rigid grains meet")
DISSIPATED = Column("dissipated", "J", "energy turned into heat in the contacts in the window")
ENERGY_RESIDUAL = Column(
    "energy_residual", "J", "balance of the energies: what is left, each term computed independently"
)
SHEAR_STRAIN = Column("shear_strain", "1", "of the periodic box, at the window's end")
SOLID_FRACTION = Column("solid_fraction", "1", "of the periodic box, at the window's end")
SHEAR_STRESS = Column("shear_stress", "Pa", "force along the flow on a plane across the gradient, window mean")
SHEAR_STRESS_CONTACTS = Column("shear_stress_contacts", "Pa", "part of shear_stress from contacts")
SHEAR_STRESS_NEAR = Column(
    "shear_stress_near", "Pa", "part of shear_stress from the pull of near magnetised grains, which follows every step"
)
SHEAR_STRESS_HELD = Column(
    "shear_stress_held", "Pa", "part of shear_stress from the magnetic forces held between two evaluations"
)
SHEAR_STRESS_ACROSS = Column(
    "shear_stress_across", "Pa", "force along the gradient on a plane across the flow, the macroscopic field's aside"
)
NORMAL_STRESS_X = Column("normal_stress_x", "Pa", "along the flow, positive where grains push, window mean")
NORMAL_STRESS_Y = Column("normal_stress_y", "Pa", "along the vorticity, positive where grains push, window mean")
NORMAL_STRESS_Z = Column("normal_stress_z", "Pa", "along the gradient, positive where grains push, window mean")
CONTACTS_PER_GRAIN = Column("contacts_per_grain", "1", "of the periodic box, window mean")
RELATIVE_PERMEABILITY = Column("relative_permeability", "1", "of the powder in the periodic box, window mean")
MAGNETISATION_ALONG_FLOW = Column(
    "magnetisation_along_flow", "A/m", "mean magnetisation of the grains along the flow, window mean"
)
N_CONTACTS = Column("n_contacts", "1", "contacts that carry force, at the window's end")
MAX_OVERLAP = Column("max_overlap", "1", "largest overlap of the window over the grain's diameter")
MAX_SPEED = Column("max_speed", "m/s", "largest speed of a grain in the window")
INERTIAL_NUMBER = Column(
    "inertial_number", "1", "shear rate times d sqrt(density/pressure) in the gap; pressure magnetic or of friction"
)
SOLID_FRACTION_GAP = Column("solid_fraction_gap", "1", "solid fraction of the gap between the pole faces")
FIELD_ITERATIONS = Column("field_iterations", "1", "Newton iterations of the field in the window")
FIELD_RESIDUAL = Column("field_residual", "1", "relative residual of the last field solve")
FIELD_SOLVES = Column("field_solves", "1", "field solves in the window")
SWEEPS = Column("sweeps", "1", "sweeps of the solver of rigid contacts a step, mean of the window")
LARGEST_SWEEPS = Column("largest_sweeps", "1", "sweeps of the window's hardest step")
SOLVER_RESIDUAL = Column(
    "solver_residual", "m/s", "largest natural map of the contacts at the end of a step, worst of the window"
)
MISSED_STEPS = Column("missed_steps", "1", "steps of the window that did not reach the solver's tolerance")
WARM_HITS = Column("warm_hits", "1", "fraction of the loaded contacts that began from the impulse of the step before")
STABILISATION_WORK = Column("stabilisation_work", "J", "work of the held forces on displacements that removed overlap")
REBUILDS = Column("rebuilds", "1", "rebuilds of the neighbour list in the window")
STEPS = Column("steps", "1", "time steps of the grains in the window")

_OF_EVERY_RUN = tuple(value for value in list(globals().values()) if isinstance(value, Column))

WALL_FIELD = Column("wall_field", "s", "wall-clock time for the field")
WALL_MAGNETIC = Column("wall_magnetic", "s", "wall-clock time for moments and held forces")
WALL_CONTACT = Column("wall_contact", "s", "wall-clock time for contacts and motion")
WALL_TOTAL = Column("wall_total", "s", "wall-clock time of the window")
PROCESSOR_TIME = Column("processor_time", "s", "processor time of the window, of all threads")

COLUMNS: dict[str, Column] = {
    column: column
    for column in (
        *_OF_EVERY_RUN,
        *(column for effect in EFFECTS for column in effect.columns),
        *(WALL_FIELD, WALL_MAGNETIC, WALL_CONTACT, WALL_TOTAL, PROCESSOR_TIME),
    )
}
"""All columns by name, in the order of the file."""


def speed_of(body: str) -> str:
    """Return the column of a body's speed."""
    return f"{body}_speed"


def torque_on(body: str) -> str:
    """Return the column of the torque on a body, or on the field."""
    return f"torque_{body}"


def columns_of(row: WindowRow) -> dict[str, float | None]:
    """Return a window's values by column; None is an empty cell."""
    values: dict[str, float | None] = {TIME: row.time}
    for name, body in row.bodies.items():
        values[torque_on(name)] = body.torque
        if name != "housing":  # it stands
            values[speed_of(name)] = body.speed
        if body.field is not None:
            values[f"{torque_on(name)}_field"] = body.field
        if name == "disc":
            values |= {TORQUE_DISC_NORMAL: body.normal, TORQUE_DISC_DAMPING: body.damping}
            values[TORQUE_DISC_TANGENTIAL] = body.tangential
    if row.field_torque:
        values[TORQUE_FIELD] = -sum(row.field_torque.values())
        if len(row.field_torque) > 1:
            values |= {f"{TORQUE_FIELD}_{name}": -torque for name, torque in row.field_torque.items()}
    values |= {torque_on(name): -torque for name, torque in row.other_torque.items()}
    values |= _present({ANGULAR_MOMENTUM: row.angular_momentum, TORQUE_RESIDUAL: row.torque_residual})
    if (energy := row.energy) is not None:
        values |= {KINETIC_ENERGY: energy.kinetic_energy, ELASTIC_ENERGY: energy.elastic_energy}
        values |= _present({MAGNETIC_ENERGY: energy.magnetic_energy})
        values |= {f"{DISSIPATED}_{name}": loss for name, loss in energy.losses.items()}
        works: dict[str, float | None] = {WORK_WALLS: energy.work_walls, WORK_SHEAR: energy.work_shear}
        works |= {WORK_PRESSURE: energy.work_pressure, WORK_BOX_MAGNETIC: energy.work_box_magnetic}
        values |= _present(works)
        values |= {DISSIPATED: energy.dissipated, ENERGY_RESIDUAL: energy.residual}
        held = WORK_MAGNETIC if row.held_is_magnetic else WORK_HELD
        values |= _present({held: energy.work_held, "work_gravity": energy.work_gravity})
    values |= {N_CONTACTS: row.n_contacts, MAX_OVERLAP: row.max_overlap, MAX_SPEED: row.max_speed}
    values |= {REBUILDS: row.rebuilds, STEPS: row.steps}
    seconds = row.seconds
    values |= {WALL_CONTACT: seconds.contact, WALL_TOTAL: seconds.total, PROCESSOR_TIME: seconds.processor}
    values |= _present({FIELD_SOLVES: row.field_solves, WALL_FIELD: seconds.field, WALL_MAGNETIC: seconds.magnetic})
    for part in (*row.parts, *([] if row.solver is None else [row.solver])):
        values |= {each.name: getattr(part, each.name) for each in fields(part)}
    return values


def _present(values: dict[str, float | None]) -> dict[str, float | None]:
    """Return those of a scene that has them."""
    return {name: value for name, value in values.items() if value is not None}


def units_of(names: Iterable[str]) -> dict[str, str]:
    """Return the units of those of the names that are columns."""
    return {name: COLUMNS[name].unit for name in names if name in COLUMNS}
