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
    """Instant or interval to which a column belongs, with its text in the reference."""

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
CURRENT = Column("current", "A", "coil current that makes the field of this row", FIELD)
ROTOR_SPEED = Column("rotor_speed", "rad/s", "speed of the rotor (input shaft)", END)
DISC_SPEED = Column("disc_speed", "rad/s", "speed of the disc (output shaft)", END)
TORQUE_DISC = Column("torque_disc", "N m", "torque of the grains on the disc about z, whole device", MEAN)
TORQUE_ROTOR = Column("torque_rotor", "N m", "torque of the grains on the rotor about z, whole device", MEAN)
TORQUE_HOUSING = Column("torque_housing", "N m", "torque of the grains on the housing about z, whole device", MEAN)
TORQUE_FIELD = Column(
    "torque_field",
    "N m",
    "minus the torque of the field on the grains; zero by symmetry for coil and steel of revolution, where its size is "
    "the error of the iteration for the moments",
    MEAN,
)
TORQUE_DISC_NORMAL = Column(
    "torque_disc_normal", "N m", "part of torque_disc from the normal springs of contacts", MEAN
)
TORQUE_DISC_DAMPING = Column(
    "torque_disc_damping", "N m", "part of torque_disc from the normal dashpots of contacts", MEAN
)
TORQUE_DISC_TANGENTIAL = Column(
    "torque_disc_tangential", "N m", "part of torque_disc from tangential contact forces", MEAN
)
ANGULAR_MOMENTUM = Column("angular_momentum", "N m s", "angular momentum of the grains about z, spin included", END)
TORQUE_RESIDUAL = Column(
    "torque_residual", "N m", "residual of the balance of all torques and dL/dt, each computed independently", MEAN
)
KINETIC_ENERGY = Column("kinetic_energy", "J", "kinetic energy of the grains, spin included", END)
ELASTIC_ENERGY = Column("elastic_energy", "J", "elastic energy of the contacts", END)
MAGNETIC_ENERGY = Column(
    "magnetic_energy", "J", "energy of the moments of the grains in the field at the start of the window", MOMENTS
)
FIELD_ENERGY = Column("field_energy", "J", "magnetic field energy", FIELD)
FLUX_LINKAGE = Column("flux_linkage", "Wb", "flux linkage of all turns of the coil", FIELD)
GAP_FLUX_DENSITY = Column("gap_flux_density", "T", "mean |B| in the gap", FIELD)
FIELD_STRENGTH_POWDER = Column(
    "field_strength_powder", "A/m", "mean |H| of the macroscopic field between the pole faces", FIELD
)
FILL_POWDER = Column("fill_powder", "1", "solid fraction between the pole faces", END)
WORK_WALLS = Column("work_walls", "J", "work of the walls on the grains", SUM)
WORK_SHEAR = Column("work_shear", "J", "work of the shear of a periodic box on the grains", SUM)
WORK_PRESSURE = Column(
    "work_pressure", "J", "work on the grains as a periodic box under pressure changes its height", SUM
)
WORK_BOX_MAGNETIC = Column(
    "work_box_magnetic",
    "J",
    "part of work_shear and work_pressure that changes the magnetic energy",
    SUM,
)
WORK_MAGNETIC = Column("work_magnetic", "J", "work of the magnetic forces on the grains", SUM)
WORK_LAGGED = Column(
    "work_lagged", "J", "work of all forces that are updated every few steps, if some of them are not magnetic", SUM
)
DISSIPATED_NORMAL_DAMPING = Column("dissipated_normal_damping", "J", "part of dissipated in the normal dashpots", SUM)
DISSIPATED_TANGENTIAL_DAMPING = Column(
    "dissipated_tangential_damping", "J", "part of dissipated in the tangential dashpots", SUM
)
DISSIPATED_SLIDING = Column("dissipated_sliding", "J", "part of dissipated by sliding friction", SUM)
DISSIPATED_IMPACT = Column("dissipated_impact", "J", "part of dissipated in impacts of rigid grains", SUM)
DISSIPATED = Column("dissipated", "J", "energy that contacts turn into heat", SUM)
ENERGY_RESIDUAL = Column(
    "energy_residual", "J", "residual of the balance of the energies, each term computed independently", SUM
)
SHEAR_STRAIN = Column("shear_strain", "1", "shear strain of the periodic box", END)
SOLID_FRACTION = Column("solid_fraction", "1", "solid fraction of the periodic box", END)
SHEAR_STRESS = Column(
    "shear_stress", "Pa", "shear stress of the powder; between steel faces the mean of both faces", MEAN
)
SHEAR_STRESS_LOWER = Column("shear_stress_lower", "Pa", "friction on the lower face over its area", MEAN)
SHEAR_STRESS_UPPER = Column("shear_stress_upper", "Pa", "friction on the upper face over its area", MEAN)
SHEAR_STRESS_CONTACTS = Column("shear_stress_contacts", "Pa", "part of shear_stress from contacts", MEAN)
SHEAR_STRESS_NEAR = Column(
    "shear_stress_near",
    "Pa",
    "part of shear_stress from the attraction of near grains, updated every step",
    MEAN,
)
SHEAR_STRESS_LAGGED = Column(
    "shear_stress_lagged", "Pa", "part of shear_stress from the other magnetic forces, updated every few steps", MEAN
)
SHEAR_STRESS_ACROSS = Column(
    "shear_stress_across",
    "Pa",
    "stress along the gradient on a plane across the flow, without the part of the mean field",
    MEAN,
)
NORMAL_STRESS_X = Column("normal_stress_x", "Pa", "normal stress along the flow, positive for pressure", MEAN)
NORMAL_STRESS_Y = Column("normal_stress_y", "Pa", "normal stress along the vorticity, positive for pressure", MEAN)
NORMAL_STRESS_Z = Column(
    "normal_stress_z",
    "Pa",
    "normal stress along the gradient, positive for pressure; between steel faces the pressure on them",
    MEAN,
)
CONTACTS_PER_GRAIN = Column("contacts_per_grain", "1", "contacts per grain in the periodic box", MEAN)
RELATIVE_PERMEABILITY = Column(
    "relative_permeability", "1", "relative permeability of the powder in the periodic box", MEAN
)
MAGNETISATION_ALONG_FLOW = Column(
    "magnetisation_along_flow", "A/m", "mean magnetisation of the grains along the flow", MEAN
)
N_CONTACTS = Column("n_contacts", "1", "contacts that carry force", END)
MAX_OVERLAP = Column("max_overlap", "1", "largest overlap over the diameter of the grain", LARGEST)
MAX_SPEED = Column("max_speed", "m/s", "largest speed of a grain", LARGEST)
INERTIAL_NUMBER = Column(
    "inertial_number",
    "1",
    "inertial number in the gap: shear rate d sqrt(density/p), p the magnetic pressure, or without magnetism shear "
    "stress over friction",
    END,
)
SOLID_FRACTION_GAP = Column("solid_fraction_gap", "1", "solid fraction of the gap between the pole faces", END)
FIELD_ITERATIONS = Column("field_iterations", "1", "Newton iterations of the solve", FIELD)
FIELD_RESIDUAL = Column("field_residual", "1", "relative residual of the solve", FIELD)
FIELD_SOLVES = Column("field_solves", "1", "solves of the field, including that of the start", SUM)
SWEEPS = Column("sweeps", "1", "sweeps of the contact solver (DVI) per step", MEAN)
LARGEST_SWEEPS = Column("largest_sweeps", "1", "largest number of sweeps of a step (DVI)", LARGEST)
SOLVER_RESIDUAL = Column(
    "solver_residual", "m/s", "largest violation of Coulomb's law at the end of a step (DVI)", LARGEST
)
MISSED_STEPS = Column("missed_steps", "1", "steps that did not reach the tolerance of the solver (DVI)", SUM)
WARM_HITS = Column(
    "warm_hits", "1", "fraction of loaded contacts that start from the impulse of the step before (DVI)", MEAN
)
STABILISATION_WORK = Column(
    "stabilisation_work", "J", "work of the lagged forces on displacements that remove overlap (DVI)", SUM
)
REBUILDS = Column("rebuilds", "1", "rebuilds of the neighbour list", SUM)
STEPS = Column("steps", "1", "time steps of the grains", SUM)

OF_EVERY_RUN = tuple(value for value in list(globals().values()) if isinstance(value, Column))

WALL_FIELD = Column("wall_field", "s", "wall-clock time for the field", SUM)
WALL_MAGNETIC = Column("wall_magnetic", "s", "wall-clock time for moments and lagged forces", SUM)
WALL_CONTACT = Column("wall_contact", "s", "wall-clock time for contacts and motion", SUM)
WALL_TOTAL = Column("wall_total", "s", "wall-clock time of the window", SUM)
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
