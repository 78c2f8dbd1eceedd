"""From a scene to the device: its shape, the walls that grains touch, its mesh, materials and coil."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from emclutch.scene.field_source import CoilField as CoilFieldSection
from emclutch.scene.field_source import UniformField as UniformFieldSection
from emclutch.scene.fill import Fill, boxes_to_fill, fill_of
from emclutch.scene.geometry import ClutchGeometry
from emclutch.scene.materials import FroehlichMaterial, LinearMaterial
from emclutch.scene.model import Scene
from emclutch.scene.time_table import points_of
from field import (
    AxisymmetricProblem,
    FroehlichLaw,
    GrainLaw,
    LinearLaw,
    MagneticField,
    PowderLaw,
    RadialField,
    TableLaw,
    ThesisLaw,
    UniformField,
    material,
)
from geometry import AnnularBox, Box, Clutch, SectionMesh, ShearCell, mesh_clutch


@dataclass(frozen=True, slots=True)
class CoilDevice:
    """A device whose field a coil makes: what the solves need.

    Attributes
    ----------
    shape : Clutch
    mesh : SectionMesh
    problem : AxisymmetricProblem
    turns : float
    times, currents : tuple of float
        Course of the current, [s] and [A]; linear between, held beyond.
    newton_tolerance : float
    powder_boxes : list of AnnularBox
        What is filled with powder.
    """

    shape: Clutch
    mesh: SectionMesh
    problem: AxisymmetricProblem
    turns: float
    times: tuple[float, ...]
    currents: tuple[float, ...]
    newton_tolerance: float
    powder_boxes: list[AnnularBox]

    def current(self, time: float) -> float:
        """I [A] at a time [s]."""
        return float(np.interp(time, self.times, self.currents))

    @property
    def largest_current(self) -> float:
        """Largest |I| of the course [A]."""
        return max(abs(current) for current in self.currents)

    def solve_at_peak(self, fill: np.ndarray | None) -> MagneticField:
        """The field at the largest current for a fill (n powder elements,) [-]."""
        return self.problem.solve(self.turns * self.largest_current, fill=fill, tolerance=self.newton_tolerance)

    def uniform_fill(self, phi: float) -> np.ndarray:
        """Solid fraction `phi` on the powder's elements inside the filled boxes, 0 outside; (n powder elements,)."""
        r, z = self.mesh.centroid()[self.mesh.regions["powder"]].T
        inside = np.zeros(len(r), dtype=bool)
        for box in self.powder_boxes:
            inside |= (r > box.r0) & (r < box.r1) & (z > box.z0) & (z < box.z1)
        return np.where(inside, phi, 0.0)


@dataclass(frozen=True, slots=True)
class Device:
    """What the scene describes before any powder is in it.

    Attributes
    ----------
    shape : Clutch, ShearCell or Box
    boxes : list of AnnularBox, or the Box
        Where the powder is filled in, as `particles.pack` takes it.
    fill : Fill
        Amount of powder.
    coil : CoilDevice or None
        None where no field has to be solved.
    imposed : UniformField, RadialField or None
        Field of a scene without a coil.
    """

    shape: Clutch | ShearCell | Box
    boxes: list[AnnularBox] | Box
    fill: Fill
    coil: CoilDevice | None = None
    imposed: UniformField | RadialField | None = None

    @property
    def shear_radius(self) -> float:
        """Mean radius [m] of the gap in which the powder is sheared; 0 for a box."""
        if isinstance(self.shape, Box):
            return 0.0
        if isinstance(self.shape, ShearCell):
            return 0.5 * (self.shape.inner_radius + self.shape.outer_radius)
        return self.shape.mean_gap_radius

    @property
    def shear_gap(self) -> float:
        """Width [m] of that gap."""
        if isinstance(self.shape, Box):
            return min(self.shape.size)
        if isinstance(self.shape, ShearCell):
            return self.shape.outer_radius - self.shape.inner_radius
        return self.shape.gap

    @property
    def largest_radius(self) -> float:
        """Largest radius [m] at which a wall touches grains."""
        if isinstance(self.shape, Box):
            return 0.0
        return self.shape.outer_radius if isinstance(self.shape, ShearCell) else self.shape.bore_radius


def field_is_needed(scene: Scene) -> bool:
    """Whether any effect of the scene samples the field."""
    return scene.effects.magnetic_force is not None or scene.effects.dipoles is not None


def build_device(scene: Scene) -> Device:
    """Shape, mesh and materials of a scene; no mesh is made when no effect needs the field."""
    shape = scene.shape()
    boxes = shape if isinstance(shape, Box) else boxes_to_fill(shape, scene.particles.region)
    fill = fill_of(shape, scene.particles)
    if not field_is_needed(scene):
        return Device(shape, boxes, fill)
    if isinstance(scene.field, UniformFieldSection):
        return Device(shape, boxes, fill, imposed=imposed_field(scene.field, shape))
    return Device(shape, boxes, fill, coil=build_coil_device(scene))


def build_coil_device(scene: Scene) -> CoilDevice:
    """Mesh, materials and coil of a clutch."""
    shape, source, coil = scene.shape(), scene.field, scene.coil
    assert isinstance(shape, Clutch) and isinstance(source, CoilFieldSection) and coil is not None  # by the schema
    mesh = mesh_clutch(shape, gap_layers=source.gap_layers, size_factor=source.size_factor)
    powder = PowderLaw(grain_law(scene)) if scene.effects.back_reaction is not None else None
    problem = AxisymmetricProblem(mesh, region_laws(scene, mesh), powder_law=powder, order=source.order)
    turns = coil.turns_in(shape.coil_area, shape.coil_mean_radius)
    times, currents = points_of(coil.current)
    boxes = boxes_to_fill(shape, scene.particles.region)
    return CoilDevice(shape, mesh, problem, turns, times, currents, source.newton_tolerance, boxes)


def grain_law(scene: Scene) -> GrainLaw:
    """Law of the grains; linear when the effect `saturation` is off."""
    particles = scene.particles
    saturation = particles.saturation if scene.effects.saturation is not None else None
    return (ThesisLaw if particles.law == "thesis" else GrainLaw)(particles.susceptibility, saturation)


def region_laws(scene: Scene, mesh: SectionMesh) -> dict:
    """Magnetic law of each region of the mesh, by the scene's names of materials."""
    assert isinstance(scene.geometry, ClutchGeometry)  # only a clutch has a mesh
    names = scene.geometry.materials.model_dump()
    names["shaft_in"] = names["shaft_out"] = names.pop("shaft")
    return {region: magnetic_law(scene, names[region]) for region in mesh.regions if region in names}


def magnetic_law(scene: Scene, name: str):
    """A material's law: the scene's own under this name, or a built-in one."""
    own = scene.materials.get(name)
    if own is None:
        return material(name)
    if isinstance(own, LinearMaterial):
        return LinearLaw(own.relative_permeability, name, "the scene")
    if isinstance(own, FroehlichMaterial):
        return FroehlichLaw(own.susceptibility, own.saturation, name, "the scene")
    return TableLaw(np.array(own.H), np.array(own.B), name, "the scene")


def imposed_field(source: UniformFieldSection, shape) -> UniformField | RadialField:
    """The field of a scene without a coil."""
    H0 = source.field_strength
    if source.direction == "radial":
        middle = 0.5 * (shape.inner_radius + shape.outer_radius)
        return RadialField(H0, middle)
    axis = {"x": 0, "y": 1, "z": 2, "axial": 2}[source.direction]
    return UniformField(H0 * np.eye(3)[axis])
