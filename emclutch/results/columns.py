"""Columns of ``history.csv``: the names by which code reads them, with unit and meaning.

Columns of an effect are declared by the effect (`EffectSection.columns`); those of every run stand here, and
`emclutch.results.column_table` has both. Column names carry no unit. A quantity that a scene does not have (its effect
is off) has no column. A row is of a coupling window; each column says of which instant, or of what over the window, it
is (`When`).
"""

from __future__ import annotations

from dataclasses import fields
from enum import Enum
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from coupling import WindowRow


class When(Enum):
    """What a column of a window's row is of; the value is how the reference says it."""

    END = "instant: end of the window"
    FIELD = "instant: last solve of the field"
    MOMENTS = "instant: last evaluation of the moments"
    MEAN = "mean over the window"
    SUM = "sum over the window"
    LARGEST = "largest of the window"


class Column(str):
    """Name of a column of ``history.csv``, so that ``history[column]`` is the column.

    Attributes
    ----------
    unit : str
        SI; "1" where it has none.
    meaning : str
    when : When
    """

    __slots__ = ("meaning", "unit", "when")
    unit: str
    meaning: str
    when: When

    def __new__(cls, name: str, unit: str = "1", meaning: str = "", when: When = When.END) -> Column:
        """Make the column of a name."""
        column = super().__new__(cls, name)
        column.unit, column.meaning, column.when = unit, meaning, when
        return column


END, FIELD, MOMENTS, MEAN, SUM, LARGEST = When.END, When.FIELD, When.MOMENTS, When.MEAN, When.SUM, When.LARGEST

TIME = Column("time", "s", "end of the window", END)
CURRENT = Column("current", "A", "coil current, of the field in this row", FIELD)
ROTOR_SPEED = Column("rotor_speed", "rad/s", "speed of the rotor (input shaft)", END)
DISC_SPEED = Column("disc_speed", "rad/s", "speed of the disc (output shaft)", END)
TORQUE_DISC = Column("torque_disc", "N m", "torque of the grains on the disc about z, whole device", MEAN)
TORQUE_ROTOR = Column("torque_rotor", "N m", "torque of the grains on the rotor about z, whole device", MEAN)
TORQUE_HOUSING = Column("torque_housing", "N m", "torque of the grains on the housing about z, whole device", MEAN)
TORQUE_FIELD = Column(
    "torque_field",
    "N m",
    "minus the field's torque on the grains: zero by symmetry for coil and steel of revolution; its size is the error "
    "of the moments' iteration",
    MEAN,
)
TORQUE_DISC_NORMAL = Column(
    "torque_disc_normal", "N m", "part of torque_disc from the springs along the contacts' normals", MEAN
)
TORQUE_DISC_DAMPING = Column(
    "torque_disc_damping", "N m", "part of torque_disc from the dashpots along the contacts' normals", MEAN
)
TORQUE_DISC_TANGENTIAL = Column(
    "torque_disc_tangential", "N m", "part of torque_disc from tangential contact forces", MEAN
)
ANGULAR_MOMENTUM = Column("angular_momentum", "N m s", "of the grains about z, spin included", END)
TORQUE_RESIDUAL = Column(
    "torque_residual", "N m", "residual of the balance of all torques and dL/dt, each computed independently", MEAN
)
KINETIC_ENERGY = Column("kinetic_energy", "J", "of the grains, spin included", END)
ELASTIC_ENERGY = Column("elastic_energy", "J", "stored in the contacts", END)
MAGNETIC_ENERGY = Column(
    "magnetic_energy", "J", "of the grains' moments in the field in which the window's steps were made", MOMENTS
)
FIELD_ENERGY = Column("field_energy", "J", "magnetic field energy", FIELD)
FLUX_LINKAGE = Column("flux_linkage", "Wb", "of the coil, all turns", FIELD)
GAP_FLUX_DENSITY = Column("gap_flux_density", "T", "mean |B| in the gap", FIELD)
FIELD_STRENGTH_POWDER = Column(
    "field_strength_powder", "A/m", "mean |H| of the macroscopic field between the pole faces", FIELD
)
FILL_POWDER = Column("fill_powder", "1", "solid fraction between the pole faces", END)
WORK_WALLS = Column("work_walls", "J", "work of the walls on the grains", SUM)
WORK_SHEAR = Column("work_shear", "J", "work of the shear of a periodic box on the grains", SUM)
WORK_PRESSURE = Column(
    "work_pressure", "J", "work on the grains by the stretch of a periodic box under an imposed pressure", SUM
)
WORK_BOX_MAGNETIC = Column(
    "work_box_magnetic",
    "J",
    "part of work_shear and work_pressure through magnetic forces, whose energy it changes",
    SUM,
)
WORK_MAGNETIC = Column("work_magnetic", "J", "work of the magnetic forces on the grains", SUM)
WORK_LAGGED = Column("work_lagged", "J", "work of all lagged forces on the grains, where some are not magnetic", SUM)
DISSIPATED_NORMAL_DAMPING = Column(
    "dissipated_normal_damping", "J", "part of dissipated in the dashpots along the normals", SUM
)
DISSIPATED_TANGENTIAL_DAMPING = Column(
    "dissipated_tangential_damping", "J", "part of dissipated in the tangential dashpots", SUM
)
DISSIPATED_SLIDING = Column("dissipated_sliding", "J", "part of dissipated by sliding friction", SUM)
DISSIPATED_IMPACT = Column(
    "dissipated_impact", "J", "part of dissipated along the normals, where rigid grains meet", SUM
)
DISSIPATED = Column("dissipated", "J", "energy turned into heat in the contacts", SUM)
ENERGY_RESIDUAL = Column(
    "energy_residual", "J", "residual of the balance of the energies, each term computed independently", SUM
)
SHEAR_STRAIN = Column("shear_strain", "1", "of the periodic box", END)
SOLID_FRACTION = Column("solid_fraction", "1", "of the periodic box", END)
SHEAR_STRESS = Column(
    "shear_stress", "Pa", "force along the flow on a plane across the gradient; between faces the mean of both", MEAN
)
SHEAR_STRESS_LOWER = Column("shear_stress_lower", "Pa", "friction on the lower face over its area", MEAN)
SHEAR_STRESS_UPPER = Column("shear_stress_upper", "Pa", "friction on the upper face over its area", MEAN)
SHEAR_STRESS_CONTACTS = Column("shear_stress_contacts", "Pa", "part of shear_stress from contacts", MEAN)
SHEAR_STRESS_NEAR = Column(
    "shear_stress_near",
    "Pa",
    "part of shear_stress from the pull of near magnetised grains, which follows every step",
    MEAN,
)
SHEAR_STRESS_LAGGED = Column(
    "shear_stress_lagged", "Pa", "part of shear_stress from the lagged magnetic forces", MEAN
)
SHEAR_STRESS_ACROSS = Column(
    "shear_stress_across",
    "Pa",
    "force along the gradient on a plane across the flow, without that of the macroscopic field",
    MEAN,
)
NORMAL_STRESS_X = Column("normal_stress_x", "Pa", "along the flow, positive where grains push", MEAN)
NORMAL_STRESS_Y = Column("normal_stress_y", "Pa", "along the vorticity, positive where grains push", MEAN)
NORMAL_STRESS_Z = Column(
    "normal_stress_z",
    "Pa",
    "along the gradient, positive where grains push; between faces the pressure on them",
    MEAN,
)
CONTACTS_PER_GRAIN = Column("contacts_per_grain", "1", "of the periodic box", MEAN)
RELATIVE_PERMEABILITY = Column("relative_permeability", "1", "of the powder in the periodic box", MEAN)
MAGNETISATION_ALONG_FLOW = Column(
    "magnetisation_along_flow", "A/m", "mean magnetisation of the grains along the flow", MEAN
)
N_CONTACTS = Column("n_contacts", "1", "contacts that carry force", END)
MAX_OVERLAP = Column("max_overlap", "1", "overlap over the grain's diameter", LARGEST)
MAX_SPEED = Column("max_speed", "m/s", "speed of a grain", LARGEST)
INERTIAL_NUMBER = Column(
    "inertial_number",
    "1",
    "shear rate times d sqrt(density/pressure) in the gap; pressure magnetic, or that of friction at the mean torque",
    END,
)
SOLID_FRACTION_GAP = Column("solid_fraction_gap", "1", "solid fraction of the gap between the pole faces", END)
FIELD_ITERATIONS = Column("field_iterations", "1", "Newton iterations of the solve", FIELD)
FIELD_RESIDUAL = Column("field_residual", "1", "relative residual of the solve", FIELD)
FIELD_SOLVES = Column("field_solves", "1", "field solves; in the first window that of the start too", SUM)
SWEEPS = Column("sweeps", "1", "sweeps of the solver of rigid contacts a step", MEAN)
LARGEST_SWEEPS = Column("largest_sweeps", "1", "sweeps of a step", LARGEST)
SOLVER_RESIDUAL = Column("solver_residual", "m/s", "natural map of the contacts at the end of a step", LARGEST)
MISSED_STEPS = Column("missed_steps", "1", "steps that did not reach the solver's tolerance", SUM)
WARM_HITS = Column(
    "warm_hits", "1", "fraction of the loaded contacts that began from the impulse of the step before", MEAN
)
STABILISATION_WORK = Column(
    "stabilisation_work", "J", "work of the lagged forces on displacements that removed overlap", SUM
)
REBUILDS = Column("rebuilds", "1", "rebuilds of the neighbour list", SUM)
STEPS = Column("steps", "1", "time steps of the grains", SUM)

OF_EVERY_RUN = tuple(value for value in list(globals().values()) if isinstance(value, Column))

WALL_FIELD = Column("wall_field", "s", "wall-clock time for the field", SUM)
WALL_MAGNETIC = Column("wall_magnetic", "s", "wall-clock time for moments and lagged forces", SUM)
WALL_CONTACT = Column("wall_contact", "s", "wall-clock time for contacts and motion", SUM)
WALL_TOTAL = Column("wall_total", "s", "wall-clock time", SUM)
PROCESSOR_TIME = Column("processor_time", "s", "processor time of all threads", SUM)

COMPUTING_TIMES = WALL_FIELD, WALL_MAGNETIC, WALL_CONTACT, WALL_TOTAL, PROCESSOR_TIME


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
        lagged = WORK_MAGNETIC if row.lagged_is_magnetic else WORK_LAGGED
        values |= _present({lagged: energy.work_lagged, "work_gravity": energy.work_gravity})
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
