"""The plan of a run: everything that is decided before the first step; `emclutch check` says it in words."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from emclutch.device_model.device import Device, build_device
from emclutch.results.text import format_time
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import bad_input_for
from emclutch.scene.model import Scene
from emclutch.scene.replica_count import cores_at_hand, replica_count
from emclutch.simulation.contact_plan import ElasticContacts, dvi_springs, elastic_contacts
from emclutch.simulation.dvi_plan import RigidContacts, rigid_contacts
from emclutch.simulation.forecast.cost import Cost, format_rough_time, predict
from emclutch.simulation.forecast.expected_field import expected_magnetisation
from emclutch.simulation.forecast.expected_speeds import fall_speed, largest_speed, layer_speed, slip_speed
from emclutch.simulation.scaled_slip import ScaledSlip, with_slip
from emclutch.simulation.windows import Windows, coupling_windows, whole_parts
from field import MagneticField
from field.coil.inductance import apparent_inductance
from field.three_d import Field3D
from geometry.kernels.threads import default_threads
from particles import CyclicSector


@dataclass(frozen=True, slots=True, repr=False)
class Plan:
    """What is decided before a run: grains, step, windows, cost. `plan` makes it.

    Attributes
    ----------
    scene : Scene
        As it is run: with the speeds of the run, and times in seconds (`emclutch.simulation.scaled_slip`).
    scaled : ScaledSlip or None
        How the speeds of the user's scene were scaled; None: they are the run's.
    count : int
        Grains that are simulated (those of the sector).
    sector : CyclicSector or None
    contact : ElasticContacts or RigidContacts
        By DEM, or by DVI; with the step of the grains.
    division : Windows
        How the run is divided into windows.
    peak_field : MagneticField, Field3D or None
        Solution at the largest current with the powder spread evenly.
    M_max : float
        Largest magnetisation of a grain to be expected [A/m].
    cost : Cost
        Of the run on this machine.
    """

    scene: Scene
    scaled: ScaledSlip | None
    count: int
    sector: CyclicSector | None
    contact: ElasticContacts | RigidContacts
    division: Windows
    peak_field: MagneticField | Field3D | None
    M_max: float
    cost: Cost

    def __repr__(self) -> str:
        run = f"{self.count} grains, {self.windows} windows to {format_time(self.end)}"
        cost = format_rough_time(self.cost.seconds["total"])
        return f"<Plan: {run}, time step {format_time(self.dt)}, about {cost} on idle cores>"

    @property
    def peak_section(self) -> MagneticField | None:
        """`peak_field` where it was solved in the section."""
        return self.peak_field if isinstance(self.peak_field, MagneticField) else None

    @property
    def dt(self) -> float:
        """Step of the grains [s]."""
        return self.division.dt

    @property
    def steps_per_update(self) -> int:
        """Steps between evaluations of the lagged forces."""
        return self.division.steps_per_update

    @property
    def updates(self) -> int:
        """Evaluations in a window."""
        return self.division.updates

    @property
    def windows(self) -> int:
        """Number of coupling windows."""
        return self.division.count

    @property
    def end(self) -> float:
        """Time at the end of the last window [s]."""
        return self.division.end

    @property
    def stiffness(self) -> float | None:
        """Normal stiffness of a contact between grains, at the largest overlap to be expected [N/m]; None: rigid."""
        return self.contact.normal_stiffness

    @property
    def contact_data(self) -> dict[str, str | bool | float | None]:
        """Method, compliance and stiffness [N/m] of contacts, for readers of a run's folder.

        By DEM they always do; by DVI where the scene gives them springs.
        """
        method = self.contact.method
        return {"method": method, "compliant": self.stiffness is not None, "stiffness": self.stiffness}

    def continued(self, dt: float, steps_per_update: int, steps: int) -> Plan:
        """The plan of a run that continues with the step [s] and the windows it began with."""
        count = whole_parts(self.scene.span.end_time, steps * dt)
        return replace(
            self, division=replace(self.division, dt=dt, steps_per_update=steps_per_update, steps=steps, count=count)
        )


def make_plan(
    case: Case, device: Device | None = None, threads: int | None = None, like: Plan | None = None
) -> tuple[Device, Plan]:
    """Build the device (unless given) and decide stiffness, step, windows and numbers of the run.

    The cost is that on `threads` threads of this machine (default: as a run takes them). With the field of `like`, of
    the same device, none is solved.

    Raises ValueError with a remedy when the scene's own step is too long, its stiffness is too low or does not follow
    from it, or as of `with_slip`.
    """
    scene = case.scene
    device = device or build_device(scene)
    sector = None if scene.grains.sector is None else CyclicSector(scene.grains.sector)
    field, M_max = expected_magnetisation(case, device) if like is None else (like.peak_field, like.M_max)
    scene, scaled = with_slip(scene, device, field)
    speed = largest_speed(scene, device)
    contact: ElasticContacts | RigidContacts
    parting = None
    if scene.contact.method == "dvi":
        springs = dvi_springs(scene, device, M_max, speed)
        contact = rigid_contacts(scene, M_max, speed, slip_speed(scene, device), springs)
        parting = contact.parting_time
    else:
        contact = elastic_contacts(scene, device, M_max, speed)
    layers = max(fall_speed(scene, device), layer_speed(scene, device, speed))
    tau = circuit_time(scene, device, field)
    division = coupling_windows(scene, contact.step.dt, speed, layers, scene.effects.have_lagged_forces, parting, tau)
    rhythm = division.steps, division.updates, division.count
    threads = threads or _threads_of_a_replica(scene)
    cost = predict(scene, device, division.dt, rhythm, threads, contact.normal_stiffness)
    return device, Plan(scene, scaled, device.fill.count, sector, contact, division, field, M_max, cost)


def circuit_time(scene: Scene, device: Device, field: MagneticField | Field3D | None) -> float | None:
    """Time constant L/R [s] of a coil whose circuit is simulated, at its largest current; None: there is none."""
    coil = device.coil
    if scene.effects.circuit is None or coil is None or coil.supply is None or field is None:
        return None
    if coil.largest_current == 0.0:
        return None
    return apparent_inductance(field, coil.turns) / coil.supply.resistance


def _threads_of_a_replica(scene) -> int:
    """Threads that a run takes by itself."""
    return max(1, default_threads(cores_at_hand()) // replica_count(scene))


def plan(case: Case | str | Path, threads: int | None = None) -> Plan:
    """Plan a run: number of grains, step, windows, cost. Nothing is simulated and nothing written.

    Parameters
    ----------
    case : Case, or the path of a scene file.
    threads : for which the cost is estimated; default: as many as a run takes.

    Raises
    ------
    SceneError
        The scene has faults, or a step or a stiffness that is not possible.
    """
    case = as_case(case)
    case.need_grains()
    with bad_input_for(case.path):
        return make_plan(case, threads=threads)[1]
