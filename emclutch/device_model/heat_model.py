"""The thermal model of a scene: its section with materials, powder and clearances, what cools it and what heats it.

- **Solid parts** conduct with the library's properties or the scene's; the winding as one material across its wires.
- **Powder** conducts as a packing at rest (`field.laws.heat_properties.powder_conductivity`), with the resistance R_c
  of both walls spread over the gap's width g: 1/k + 2 R_c/g. Parts of the chamber without powder hold air.
- **Clearances** hold still air: a gap of 0.3 mm passes 90 W/(m^2 K) without its flow, which is laminar there.
- **Outside**: film and radiation; faces of what turns besides as a disc in still air, both films added by their cubes
  (S. W. Churchill, AIChE J. 23 (1977) 10, assisting convection). The ends of the shaft stubs lead to the surroundings
  by a conductance, in the middle of which the shaft's heat capacity lies, shared by both; with 0 they are insulated.
- **Sources**: R(T) I^2 evenly in the winding, R(T) = R_20 (1 + 0.00393 (T - 20)) of its mean temperature, at a given
  current or, at a voltage, V^2/R(T); torque times slip speed evenly in the powder between the poles, where it is made,
  the torque of the current and of the powder's mean temperature.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import brentq

from emclutch.device_model.device import mesh_of
from emclutch.device_model.materials import region_materials
from emclutch.scene.fill import fill_of
from emclutch.scene.model import Scene
from field.coil.winding import COPPER_TEMPERATURE_COEFFICIENT, ROOM, resistance_ratio
from field.heat.conduction import CooledSurface, HeatProblem, outer_edges
from field.laws.heat_properties import (
    IRON_HEAT,
    HeatProperties,
    heat_properties,
    powder_conductivity,
    turning_disc_film,
    winding_properties,
)
from geometry.section import SectionMesh

COIL, POWDER = 0, 1
"""Of the sources, in `HeatProblem.names`."""

SHAFT_ENDS = "shaft_ends"

_RISE = 1e-3
"""Of a temperature [K], for the derivatives of the powers: their round-off is 1e-12 of a power."""


@dataclass(frozen=True, slots=True)
class Drive:
    """What heats the device at a moment.

    Attributes
    ----------
    current : float or None
        Of the coil [A]; None: `voltage` gives it.
    voltage : float
        [V]
    slip : float
        Slip speed [rad/s].
    torque : float or None
        Given torque [N m], instead of that of the current.
    """

    current: float | None
    voltage: float = 0.0
    slip: float = 0.0
    torque: float | None = None


@dataclass(frozen=True, slots=True)
class HeatModel:
    """The sources of a device.

    Attributes
    ----------
    R_20 : float
        Resistance of the coil at 20 degrees C [ohm].
    torque : Callable
        Current [A], >= 0, and mean temperature of the powder [degrees C] to torque [N m].
    regulates : bool
        Whether the current is lowered until the torque is that of the drive; else the coil has its full current.
    """

    R_20: float
    torque: Callable[[float, float], float]
    regulates: bool = False

    def resistance(self, temperature: float) -> float:
        """R of the coil [ohm] at a mean temperature [degrees C]; the linear law, also outside of -100 to 250."""
        return self.R_20 * (1.0 + COPPER_TEMPERATURE_COEFFICIENT * (temperature - ROOM))

    def current(self, drive: Drive, coil: float, powder: float) -> float:
        """The current [A] with coil and powder at temperatures [degrees C]."""
        full = drive.voltage / self.resistance(coil) if drive.current is None else drive.current
        wanted = drive.torque if self.regulates else None
        if wanted is None or self.torque(abs(full), powder) <= wanted:
            return full
        if self.torque(0.0, powder) >= wanted:
            return 0.0
        return brentq(lambda current: self.torque(current, powder) - wanted, 0.0, abs(full))

    def torque_of(self, drive: Drive, coil: float, powder: float) -> float:
        """The torque [N m] with coil and powder at temperatures [degrees C]."""
        if drive.torque is not None and not self.regulates:
            return drive.torque
        return self.torque(abs(self.current(drive, coil, powder)), powder)

    def powers(self, drive: Drive, means: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Powers of coil and powder (2,) [W] at their mean temperatures (2,), and the derivatives (2,) [W/K].

        How one power changes with the other's temperature is left out; iterations converge even so.
        """

        def at(coil: float, powder: float) -> np.ndarray:
            copper = self.resistance(coil) * self.current(drive, coil, powder) ** 2
            return np.array([copper, self.torque_of(drive, coil, powder) * abs(drive.slip)])

        coil, powder = float(means[COIL]), float(means[POWDER])
        here, warmer = at(coil, powder), (at(coil + _RISE, powder)[COIL], at(coil, powder + _RISE)[POWDER])
        return here, (np.array(warmer) - here) / _RISE


def resistance_at_20(scene: Scene) -> float:
    """Resistance of the coil at 20 degrees C [ohm]."""
    shape, coil = scene.shape(), scene.coil
    assert coil is not None  # by the effect's checks
    return coil.resistance_in(shape.coil_area, shape.coil_mean_radius) / resistance_ratio(coil.temperature)


def heat_problem(
    scene: Scene, rotor_speed: float = 0.0, disc_speed: float = 0.0, mesh: SectionMesh | None = None, order: int = 1
) -> HeatProblem:
    """The equations of conduction in a scene's device, bodies turning at speeds [rad/s]; `mesh` spares the meshing."""
    mesh = mesh_of(scene) if mesh is None else mesh
    effect, shape, geometry = scene.effects.thermal, scene.shape(), scene.geometry
    k, capacity = np.zeros(len(mesh.triangles)), np.zeros(len(mesh.triangles))
    for region, name in region_materials(scene, mesh).items():
        own = _winding(scene) if region == "coil" else _material(scene, name)
        k[mesh.regions[region]], capacity[mesh.regions[region]] = own.conductivity, own.capacity
    air = heat_properties("air")
    within = np.zeros(0, dtype=int)
    if "air" in mesh.regions:
        inside = mesh.fraction_in_boxes("air", geometry.clearances(shape) or []) > 0.5
        within = mesh.regions["air"][inside]
    k[within], capacity[within] = air.conductivity, air.capacity
    powder = mesh.elements_of("powder")
    k[powder], capacity[powder] = air.conductivity, air.capacity
    if scene.particles is not None:
        phi = fill_of(shape, scene.particles, scene.scene.seed).solid_fraction
        conducts = effect.powder_conductivity or powder_conductivity(min(phi, 0.74))
        holds = phi * scene.particles.density * IRON_HEAT + (1.0 - phi) * air.capacity
        for box in shape.boxes_to_fill(scene.particles.region):
            width = min(box.r1 - box.r0, box.z1 - box.z0)
            through = 1.0 / (1.0 / conducts + 2.0 * effect.contact_resistance / width)
            share = mesh.fraction_in_boxes("powder", [box])
            k[powder] += share * (through - air.conductivity)
            capacity[powder] += share * (holds - air.capacity)
    elif effect.powder_conductivity is not None:
        k[powder] = effect.powder_conductivity
    elements = np.flatnonzero(k > 0.0)
    region_of_powder = "poles" if scene.particles is None else scene.particles.region
    zone = geometry.pole_zone(shape, region_of_powder)
    assert zone is not None  # kinds whose clearances are known have poles
    slips = powder[mesh.fraction_in_boxes("powder", list(zone.boxes)) > 0.5]
    return HeatProblem(
        mesh,
        elements,
        k[elements],
        capacity[elements],
        _surfaces(scene, mesh, elements, {"rotor": rotor_speed, "disc": disc_speed}),
        {"coil": mesh.elements_of("coil"), "powder": slips},
        order,
    )


def _winding(scene: Scene) -> HeatProperties:
    shape, coil, effect = scene.shape(), scene.coil, scene.effects.thermal
    assert coil is not None  # by the effect's checks
    winding = coil.winding_in(shape.coil_area, shape.coil_mean_radius)
    own = winding_properties(winding.fill_factor)
    if effect.coil_conductivity is None:
        return own
    return HeatProperties(effect.coil_conductivity, own.density, own.specific_heat, "the scene")


def _material(scene: Scene, name: str) -> HeatProperties:
    effect = scene.effects.thermal
    given_k, given_c = effect.conductivity.get(name), effect.heat_capacity.get(name)
    if given_k is not None and given_c is not None:
        return HeatProperties(given_k, 1.0, given_c, "the scene")
    library = heat_properties(name)
    k = library.conductivity if given_k is None else given_k
    return HeatProperties(k, 1.0, library.capacity if given_c is None else given_c, library.source)


def film_of(scene: Scene, speed: float) -> float:
    """Heat transfer coefficient [W/(m^2 K)] of the outside of a body that turns at `speed` [rad/s]."""
    effect = scene.effects.thermal
    turning = turning_disc_film(speed) if effect.self_cooling else 0.0
    return float(np.cbrt(effect.convection**3 + turning**3))


def _surfaces(scene: Scene, mesh: SectionMesh, elements: np.ndarray, speeds: dict[str, float]) -> list[CooledSurface]:
    """The outside by the body that it belongs to, and the ends of the shaft."""
    effect, shape = scene.effects.thermal, scene.shape()
    edges, owner = outer_edges(mesh, elements)
    body = np.full(len(mesh.triangles), "", dtype=object)
    for region, members in mesh.regions.items():
        if region not in ("air", "powder"):
            body[members] = shape.body(region)
    r, z = mesh.points[edges].transpose(2, 0, 1)  # (k, 2) each
    ends = np.zeros(len(edges), dtype=bool)
    area = 0.0
    for radius, height in shape.shaft_ends():
        near = 1e-6 * radius
        ends |= np.all((np.abs(z - height) < near) & (r <= radius + near), axis=1)
        area += np.pi * radius**2
    film = effect.shaft_conductance / area
    held = effect.shaft_heat_capacity
    surfaces = [CooledSurface(SHAFT_ENDS, edges[ends], film, 0.0, effect.ambient, held)] if film > 0.0 else []
    for name in ("housing", "rotor", "disc"):
        own = (body[owner] == name) & ~ends
        film = film_of(scene, speeds.get(name, 0.0))
        surfaces.append(CooledSurface(name, edges[own], film, effect.emissivity, effect.ambient))
    return surfaces
