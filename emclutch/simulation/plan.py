"""The plan of a run: everything that is decided before the first step, with its reason; `emclutch check` prints it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

from emclutch.device.device import CoilDevice, Device, build_device
from emclutch.scene.case import Case, as_case
from emclutch.scene.errors import bad_input_for
from emclutch.scene.grain_smear import moments_are_fed_back
from emclutch.scene.replica_count import replica_count
from emclutch.simulation.contact_plan import dvi_springs, elastic_contacts
from emclutch.simulation.dvi_plan import DviPlan, plan_dvi
from emclutch.simulation.forecast.cost import Cost, foretell
from emclutch.simulation.forecast.expected_field import expected_magnetisation
from emclutch.simulation.forecast.expected_speeds import fall_speed, largest_speed, layer_speed
from emclutch.simulation.forecast.machine_speed import MachineSpeed, threads_at_hand
from emclutch.simulation.plan_in_words import (
    coil_in_words,
    device_in_words,
    end_in_words,
    feedback_in_words,
    mesh_in_words,
)
from emclutch.simulation.windows import coupling_windows, parts_of
from field import MagneticField
from field.three_d import Field3D
from particles import CyclicSector, PairLaws


@dataclass(frozen=True, slots=True)
class Plan:
    """The numbers that a run starts from.

    Attributes
    ----------
    count : int
        Grains that are simulated (those of the sector).
    sector : CyclicSector or None
    contact : PairLaws or DviPlan
        By DEM, or by DVI.
    dt : float
        Step of the grains [s].
    steps_per_update, updates, windows : int
        Steps between evaluations of the magnetic forces; evaluations a window; windows of the run.
    peak_field : MagneticField, Field3D or None
        Solution at the largest current with the powder spread evenly.
    M_max : float
        Largest magnetisation of a grain to be expected [A/m].
    stiffness : float or None
        Normal stiffness of a contact between grains, at the largest overlap to be expected [N/m]; None: rigid.
    reasons : dict of str to str
        One line for each decision, for people: what decides is in the other attributes.
    cost : Cost
        Of the run on this machine.
    """

    count: int
    sector: CyclicSector | None
    contact: PairLaws | DviPlan
    dt: float
    steps_per_update: int
    updates: int
    windows: int
    peak_field: MagneticField | Field3D | None
    M_max: float
    stiffness: float | None
    reasons: dict[str, str]
    cost: Cost

    @property
    def contact_data(self) -> dict[str, str | bool | float | None]:
        """How contacts are solved, for those who read a run's folder: method, whether grains press in, stiffness [N/m].

        By DEM they always do; by DVI where the scene gives them springs.
        """
        method = "dem" if isinstance(self.contact, PairLaws) else "dvi"
        return {"method": method, "compliant": self.stiffness is not None, "stiffness": self.stiffness}

    def continued(self, steps_per_update: int, updates: int, end: float) -> Plan:
        """The plan of a run that goes on with the windows it began with, to the time `end` [s]."""
        windows = parts_of(end, steps_per_update * updates * self.dt)
        return replace(self, steps_per_update=steps_per_update, updates=updates, windows=windows)

    @property
    def end(self) -> float:
        """Time at the end of the last window [s]."""
        return self.windows * self.updates * self.steps_per_update * self.dt


def make_plan(
    case: Case, device: Device | None = None, threads: int | None = None, machine: MachineSpeed | None = None
) -> tuple[Device, Plan]:
    """Build the device (unless given) and decide stiffness, step, windows and numbers of the run.

    The cost is that on `threads` threads (default: as a run takes them) of a machine (default: the one at hand).

    Raises ValueError with a remedy when the scene's own step is too long, or its stiffness is too low or does
    not follow from it.
    """
    scene = case.scene
    device = device or build_device(scene)
    particles = scene.grains
    sector = None if particles.sector is None else CyclicSector(particles.sector)
    fill, reasons = device.fill, dict(device_in_words(scene, device))
    field, M_max = expected_magnetisation(case, device)
    if isinstance(field, MagneticField) and isinstance(device.coil, CoilDevice) and device.coil.resistance is not None:
        reasons["coil"] = coil_in_words(scene, device.coil, field)
    speed = largest_speed(scene, device)
    contact: PairLaws | DviPlan
    if scene.contact.method == "dvi":
        springs = dvi_springs(scene, device, M_max, speed, reasons)
        contact, dt = plan_dvi(scene, M_max, speed, springs, reasons)
        stiffness = None if springs is None else float(springs[0, 0])
    else:
        contact, dt, stiffness = elastic_contacts(scene, device, M_max, speed, reasons)
    layers = max(fall_speed(scene, device), layer_speed(scene, device, speed))
    per_update, updates, windows = coupling_windows(scene, dt, speed, layers, M_max > 0.0 or field is not None, reasons)
    if moments_are_fed_back(scene) and isinstance(device.coil, CoilDevice):
        reasons["feedback"] = feedback_in_words(scene, device.coil)
    if device.coil is not None:
        reasons["mesh"] = mesh_in_words(device.coil)
    threads = threads or _threads_of_a_replica(scene)
    cost = foretell(scene, device, dt, (per_update, updates, windows), threads, machine)
    reasons |= dict(end_in_words(scene, device, windows * updates * per_update * dt))
    reasons["cost"] = cost.in_words()
    return device, Plan(
        fill.count, sector, contact, dt, per_update, updates, windows, field, M_max, stiffness, reasons, cost
    )


def _threads_of_a_replica(scene) -> int:
    """Threads that a run takes by itself."""
    return max(1, threads_at_hand() // replica_count(scene))


def plan(case: Case | str | Path, threads: int | None = None) -> Plan:
    """The numbers that a run of a scene would start from; nothing is simulated and nothing written.

    `case` is a case or the path of a scene file; the cost is that on `threads` threads, by default as a run takes them.
    Raises SceneError where the scene has faults, or its own step or stiffness cannot be.
    """
    case = as_case(case)
    case.need_grains()
    with bad_input_for(case.path):
        return make_plan(case, threads=threads)[1]
