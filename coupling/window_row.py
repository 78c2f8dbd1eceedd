"""Results of a coupling window: one typed object, whole device, SI units.

The loop's budgets make it, source and grains add what they know of the field and the moments, and whatever measures the
device adds its quantities (`coupling.staggered`); callbacks get it complete.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, TypeVar

Part = TypeVar("Part")


@dataclass(slots=True)
class BodyRow:
    """A body in a window; torques [N m] of the grains on it about z, window mean.

    Attributes
    ----------
    speed : float
        At the window's end [rad/s].
    normal, damping, tangential : float
        Torque by springs and dashpots along the contacts' normals, and by tangential forces.
    field : float or None
        Reaction to the pull of the field that it carries round; None: it carries none.
    """

    speed: float
    normal: float
    damping: float
    tangential: float
    field: float | None = None

    @property
    def torque(self) -> float:
        """Total torque [N m]."""
        return sum((self.normal, self.damping, self.tangential)) + (self.field or 0.0)


@dataclass(slots=True)
class EnergyRow:
    """Energies of the grains [J]: stored at the window's end, and work, losses and what is left in the window.

    Attributes
    ----------
    kinetic_energy, elastic_energy : float
    magnetic_energy : float or None
        Of the grains in the field, at the window's last evaluation of it; None where it is not known.
    work_walls : float or None
        None in a sheared box, which has no walls.
    work_lagged : float or None
        Of the lagged forces; None: there are none.
    work_gravity : float or None
    losses : dict of str to float
        By mechanism.
    dissipated : float
        All of them.
    stored : float
        Change of the kinetic and elastic energy.
    work_shear, work_pressure : float or None
        Of the shear of a box, and of its stretch under an imposed pressure, through all forces; None without.
    work_box_magnetic : float or None
        Part of both through magnetic forces; None without any.
    """

    kinetic_energy: float
    elastic_energy: float
    magnetic_energy: float | None
    work_walls: float | None
    work_lagged: float | None
    work_gravity: float | None
    losses: dict[str, float]
    dissipated: float
    stored: float
    work_shear: float | None = None
    work_pressure: float | None = None
    work_box_magnetic: float | None = None

    @property
    def residual(self) -> float:
        """Residual of the balance: the error of the grains' step.

        Magnetic forces put into the grains' motion `work_lagged`, and not what shear and stretch work through them.
        """
        work = (self.work_walls or 0.0) + (self.work_lagged or 0.0) + (self.work_gravity or 0.0)
        work += (self.work_shear or 0.0) + (self.work_pressure or 0.0) - (self.work_box_magnetic or 0.0)
        return work - self.dissipated - self.stored


@dataclass(slots=True)
class SolverRow:
    """The solver of rigid contacts in a window.

    Attributes
    ----------
    sweeps, largest_sweeps : float, int
        A step, mean and most.
    solver_residual : float
        Worst natural map of the contacts at the end of a step [m/s].
    missed_steps : int
        Steps that missed the tolerance.
    warm_hits : float
        Fraction of the loaded contacts that began from the impulse of the step before.
    stabilisation_work : float
        Of the lagged forces on displacements that removed overlap [J].
    """

    sweeps: float
    largest_sweeps: int
    solver_residual: float
    missed_steps: int
    warm_hits: float
    stabilisation_work: float


@dataclass(slots=True)
class WallClock:
    """Seconds that a window took, less compiling in its parts; None where there is no such part.

    `processor` is the processor time of all threads: less than `total` where other programs take the cores.
    """

    field: float | None
    magnetic: float | None
    contact: float
    total: float
    processor: float


@dataclass(slots=True, kw_only=True)
class WindowRow:
    """A coupling window.

    Attributes
    ----------
    time : float
        At its end [s].
    bodies : dict of str to BodyRow
        By name: rotor, disc, housing.
    field_torque, other_torque : dict of str to float
        Torque [N m] of the field's forces on the grains and of those of other effects, by name; that of a field
        which a body carries round is the body's.
    angular_momentum : float or None
        Of the grains about z at the window's end, spin included [N m s]; None in a sheared box, as the next one.
    torque_residual : float or None
        Of the balance of torques [N m].
    energy : EnergyRow or None
        None in a run without a budget of energy.
    lagged_is_magnetic : bool
        Whether all forces that do `work_lagged` are those of the field.
    field_solves : int or None
        In the window; None: no field is solved.
    n_contacts : int
        Contacts that carry force at the window's end.
    max_overlap, max_speed : float
        Largest overlap over the grain's diameter, and speed of a grain [m/s].
    solver : SolverRow or None
        None for elastic grains.
    rebuilds, steps : int
        Rebuilds of the neighbour list, and time steps of the grains.
    seconds : WallClock
    parts : list
        Dataclasses of effects, source and device; each field is a column of the history of that name, None an empty
        cell.
    """

    time: float
    bodies: dict[str, BodyRow]
    field_torque: dict[str, float]
    other_torque: dict[str, float]
    angular_momentum: float | None
    torque_residual: float | None
    energy: EnergyRow | None
    lagged_is_magnetic: bool
    field_solves: int | None
    n_contacts: int
    max_overlap: float
    max_speed: float
    solver: SolverRow | None
    rebuilds: int
    steps: int
    seconds: WallClock
    parts: list[Any] = field(default_factory=list)

    def add(self, part: Any) -> None:
        """Add a part; None adds nothing."""
        if part is not None:
            self.parts.append(part)

    def part(self, kind: type[Part]) -> Part | None:
        """Return the part of a type; None where the scene has none."""
        return next((one for one in self.parts if isinstance(one, kind)), None)
