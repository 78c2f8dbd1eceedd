"""From a scene to the device: its shape, the walls that grains touch, its mesh, materials and coil."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from emclutch.scene.fill import Fill, boxes_to_fill, fill_of
from emclutch.scene.materials import FroehlichMaterial, LinearMaterial
from emclutch.scene.model import Scene
from emclutch.scene.time_table import points_of
from field import (
    AxisymmetricProblem,
    FroehlichLaw,
    GrainLaw,
    LinearLaw,
    PowderLaw,
    RadialField,
    TableLaw,
    ThesisLaw,
    UniformField,
    material,
)
from geometry import AnnularBox, Box, Clutch, SectionMesh, ShearCell, mesh_clutch


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
    mesh : SectionMesh or None
        None where no field has to be solved.
    problem : AxisymmetricProblem or None
    turns : float or None
    sampler : object or None
        Imposed field of a scene without a coil.
    """

    shape: Clutch | ShearCell | Box
    boxes: list[AnnularBox] | Box
    fill: Fill
    mesh: SectionMesh | None
    problem: AxisymmetricProblem | None
    turns: float | None
    sampler: UniformField | RadialField | None

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


def build_device(scene: Scene, *, field_needed: bool, mesh_path=None) -> Device:
    """Shape, mesh and materials of a scene; no mesh is made when no effect needs the field."""
    source = scene.field
    shape = scene.shape()
    boxes = boxes_to_fill(shape, scene.particles.region) or shape
    fill = fill_of(shape, scene.particles)
    if not field_needed:
        return Device(shape, boxes, fill, None, None, None, None)
    if source.source == "uniform":
        return Device(shape, boxes, fill, None, None, None, _imposed(source, shape))
    mesh = mesh_clutch(shape, gap_layers=source.gap_layers, size_factor=source.size_factor, path=mesh_path)
    laws = region_laws(scene, mesh)
    powder = PowderLaw(grain_law(scene)) if scene.effects.back_reaction is not None else None
    problem = AxisymmetricProblem(mesh, laws, powder_law=powder, order=source.order)
    turns = scene.coil.turns_in(shape.coil_area, shape.coil_mean_radius)
    return Device(shape, boxes, fill, mesh, problem, turns, None)


def grain_law(scene: Scene) -> GrainLaw:
    """Law of the grains; linear when the effect `saturation` is off."""
    particles = scene.particles
    saturation = particles.saturation if scene.effects.saturation is not None else None
    return (ThesisLaw if particles.law == "thesis" else GrainLaw)(particles.susceptibility, saturation)


def region_laws(scene: Scene, mesh: SectionMesh) -> dict:
    """Magnetic law of each region of the mesh, by the scene's names of materials."""
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


def current_course(scene: Scene):
    """I(t) [A] of the coil as a function of time [s]."""
    times, values = points_of(scene.coil.current)
    return lambda time: float(np.interp(time, times, values))


def _imposed(source, shape):
    H0 = source.field_strength
    if source.direction == "radial":
        middle = 0.5 * (shape.inner_radius + shape.outer_radius)
        return RadialField(H0, middle)
    axis = {"x": 0, "y": 1, "z": 2, "axial": 2}[source.direction]
    return UniformField(H0 * np.eye(3)[axis])
