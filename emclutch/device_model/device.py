"""From a scene to the device: its shape, the walls that grains touch, its mesh, materials and coil."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np

from coupling.smear_region import elements_within, magnetic_regions
from emclutch.device_model.excitation import Excitation, Supply, supply_of
from emclutch.device_model.materials import conductivities, grain_law, region_laws
from emclutch.device_model.pole_zone import GapZone, PoleZone
from emclutch.devices import GeometrySection
from emclutch.scene.fill import Fill, fill_of
from emclutch.scene.grain_smear import element_layers, moments_are_fed_back, smear_width
from emclutch.scene.model import Scene
from emclutch.scene.surfaces import surface_walls
from field import (
    AxisymmetricProblem,
    MagneticField,
    PowderLaw,
    RadialField,
    UniformField,
)
from field.factorisation import describe_backend
from field.section.adaptive import AdaptiveResult, adapt
from field.section.error_estimate import FluxLinkage, MeanFluxDensity
from geometry import AnnularBox, SectionMesh
from geometry.device_shape import FilledSpace, WoundShape
from geometry.sheared_gap import ShearedGap
from geometry.triangle_wall import TriangleWall
from geometry.walls import Wall

if TYPE_CHECKING:
    from emclutch.device_model.device_3d import CoilDevice3D
    from field.section.steel_history import SteelHistory


@dataclass(frozen=True, slots=True)
class CoilDevice(Excitation):
    """A device of revolution whose field a coil makes: what the solves need.

    Attributes
    ----------
    shape : WoundShape
    mesh : SectionMesh
    problem : AxisymmetricProblem
    newton_tolerance : float
    powder_boxes : list of AnnularBox
        What is filled with powder.
    adapted : AdaptiveResult or None
        How the mesh was refined to `field.tolerance`; None: as meshed.
    has_poles : bool
        Whether there are pole faces, under which the flux density is a quantity of its own.
    supply : Supply or None
        What drives the coil; None: its current is prescribed.
    conductivity : dict of str to float or None
        Of the regions [S/m], where eddy currents are simulated.
    history : SteelHistory or None
        Of the demagnetised steel; None: no hysteresis.
    """

    shape: WoundShape
    mesh: SectionMesh
    problem: AxisymmetricProblem
    newton_tolerance: float
    powder_boxes: list[AnnularBox]
    has_poles: bool
    adapted: AdaptiveResult | None = None
    supply: Supply | None = None
    conductivity: dict[str, float] | None = None
    history: SteelHistory | None = None

    def solve_at_peak(self, fill: np.ndarray | None) -> MagneticField:
        """The field at the largest current for a fill (n powder elements,) [-]."""
        return self.problem.solve(self.turns * self.largest_current, fill=fill, tolerance=self.newton_tolerance)

    def pole_line(self, *, faces: bool = False) -> np.ndarray:
        """Points (r, z) [m] on the middle of the rim gap under the two pole faces, or of the face gap, shape (k, 2).

        Of the face gap where `faces` says so, and where the disc is so thin that its rim lies within the ring.
        """
        midline = self.shape.gap_midline(201)
        under = midline[np.abs(midline[:, 1]) > 0.5 * self.shape.ring_width]
        return self.shape.face_midline(201) if faces or len(under) < 10 else under

    def mesh_in_words(self) -> str:
        """Domain on which the field is solved."""
        text = (
            f"{len(self.mesh.triangles)} triangles, {self.problem.n_dofs} unknowns of order "
            f"{self.problem.elements.order}; {describe_backend(self.problem.factorisation_backend)}"
        )
        return text if self.adapted is None else f"{text}; {self.adapted.summary()}"

    def uniform_fill(self, phi: float) -> np.ndarray:
        """Solid fraction `phi` on the powder's elements inside the filled boxes, 0 outside; (n powder elements,)."""
        fill = even_fill(self.mesh, self.powder_boxes, phi)
        return np.concatenate((fill, np.zeros(self.problem.powder_beyond.size)))


@dataclass(frozen=True, slots=True)
class Device:
    """The device of a scene, without grains.

    Attributes
    ----------
    kind : GeometrySection
        The table [geometry]: what is otherwise with this kind of device.
    shape : DeviceShape
        The kind's own.
    boxes : FilledSpace
        Where the powder is filled in.
    fill : Fill
        Amount of powder.
    coil : CoilDevice, CoilDevice3D or None
        None where no field has to be solved.
    imposed : UniformField, RadialField or None
        Field of a scene without a coil.
    surfaces : tuple of TriangleWall
        Surfaces from files.
    region : str
        Of a clutch's chamber, what the powder is filled into: rim, its poles, faces, or the whole cavity.
    """

    kind: GeometrySection
    shape: Any
    boxes: FilledSpace
    fill: Fill
    coil: CoilDevice | CoilDevice3D | None = None
    imposed: UniformField | RadialField | None = None
    surfaces: tuple[TriangleWall, ...] = ()
    region: str = "cavity"

    @property
    def section_coil(self) -> CoilDevice | None:
        """The coil whose field is solved in the section; None where it is solved in 3D, or no field is."""
        return self.coil if isinstance(self.coil, CoilDevice) else None

    @property
    def pole_zone(self) -> PoleZone | None:
        """The powder's zone between pole faces; None without pole faces."""
        return self.kind.pole_zone(self.shape, self.region)

    @property
    def gap_zone(self) -> GapZone | None:
        """The gap that is sheared as a whole; None without."""
        return self.kind.gap_zone(self.shape, self.region)

    def walls(self) -> list[Wall]:
        """Everything that grains touch: the shape's own walls and the surfaces from files."""
        return [*self.shape.walls(), *self.surfaces]

    @property
    def filled_boxes(self) -> list[AnnularBox]:
        """The rings where the powder is filled in; none in a plain box."""
        return self.shape.boxes_to_fill(self.region)

    @property
    def sheared_gap(self) -> ShearedGap | None:
        """The gap in which the powder is sheared; None for a box."""
        return self.shape.sheared_gap(self.region)

    @property
    def shears_faces(self) -> bool:
        """True if the powder is sheared in a clutch's face gaps, and not in its rim gap.

        Powder in the whole cavity is in both; the gap with the greater area counts then.
        """
        gap = self.sheared_gap
        return gap is not None and gap.at_faces

    @property
    def shear_radius(self) -> float:
        """Mean radius [m] of the gap in which the powder is sheared; 0 for a box."""
        gap = self.sheared_gap
        return 0.0 if gap is None else gap.radius

    @property
    def shear_gap(self) -> float:
        """Width [m] of that gap; 0 for a box."""
        gap = self.sheared_gap
        return 0.0 if gap is None else gap.width

    @property
    def narrowest_gap(self) -> float:
        """Width [m] of the narrowest space that is filled, in which layers of grains go past each other fastest."""
        gap = self.sheared_gap
        return float(min(self.extent)) if gap is None else gap.narrowest

    @property
    def extent(self) -> np.ndarray:
        """Extent [m] of what is filled with grains along x, y, z, shape (3,)."""
        return self.shape.extent(self.region)

    @property
    def largest_radius(self) -> float:
        """Largest radius [m] at which a wall touches grains; 0 for a box."""
        return self.shape.largest_radius

    def driven_as(self, scene: Scene) -> Device:
        """Return the device of a scene that differs in drive, speeds, friction or amount of powder alone."""
        fill, coil = fill_of(self.shape, scene.grains, scene.scene.seed), self.coil
        if coil is not None and scene.coil is not None:
            window = self.shape.coil_area, self.shape.coil_mean_radius
            winding, currents = scene.coil.winding_in(*window), scene.coil.currents_in(*window)
            coil = replace(coil, winding=winding, currents=currents, supply=supply_of(scene, self.shape))
        return replace(self, fill=fill, coil=coil)


def field_is_needed(scene: Scene) -> bool:
    """True if any effect of the scene samples the field."""
    return scene.effects.magnetise


def build_device(scene: Scene) -> Device:
    """Shape, mesh and materials of a scene with grains; no mesh is made when no effect needs the field."""
    shape, particles = scene.shape(), scene.grains
    fill = fill_of(shape, particles, scene.scene.seed)
    surfaces = tuple(surface_walls(scene.surfaces))
    region = particles.region
    device = Device(scene.geometry, shape, shape.space(region), fill, surfaces=surfaces, region=region)
    if not field_is_needed(scene):
        return device
    assert scene.field is not None  # by the checks between sections
    return scene.field.equip(device, scene)


def solved_coil(scene: Scene) -> CoilDevice | CoilDevice3D:
    """Mesh, materials and coil of a device whose field is solved, with grains in it or without, in its section or in
    space.
    """
    if scene.geometry.is_solved_in_3d:
        from emclutch.device_model.device_3d import build_coil_device_3d  # local: most scenes need no field in 3D

        return build_coil_device_3d(scene, scene.coil_field)
    return build_coil_device(scene)


def build_coil_device(scene: Scene) -> CoilDevice:
    """Mesh, materials and coil of a clutch, or of a device from CAD."""
    shape, source, coil = scene.shape(), scene.coil_field, scene.coil
    assert coil is not None  # by the checks between sections
    powder = PowderLaw(grain_law(scene)) if scene.effects.feedback is not None else None
    boxes = [] if scene.particles is None else shape.boxes_to_fill(scene.particles.region)
    window = shape.coil_area, shape.coil_mean_radius
    winding = coil.winding_in(*window)
    currents = coil.currents_in(*window)

    def problem_on(mesh: SectionMesh) -> AxisymmetricProblem:
        laws, beyond = region_laws(scene, mesh), None
        if moments_are_fed_back(scene):
            beyond = elements_within(mesh, magnetic_regions(laws), smear_width(scene))
        return AxisymmetricProblem(
            mesh,
            laws,
            powder_law=powder,
            powder_beyond=beyond,
            order=source.order,
            open_boundary=source.open_boundary,
        )

    def fill_on(mesh: SectionMesh) -> np.ndarray:
        fill = even_fill(mesh, boxes, fill_of(shape, scene.grains).solid_fraction)
        return np.concatenate((fill, np.zeros(problem_on(mesh).powder_beyond.size)))

    mesh = mesh_of(scene)
    adapted = None
    peak = winding.turns * currents.largest
    if source.tolerance is not None and peak > 0.0:
        adapted = adapt(
            problem_on,
            mesh,
            peak,
            goals=field_goals(mesh),
            tolerance=source.tolerance,
            fill=None if powder is None else fill_on,
            newton_tolerance=source.newton_tolerance,
        )
        mesh = adapted.mesh
    problem = problem_on(mesh) if adapted is None else adapted.problem
    return CoilDevice(
        winding,
        currents,
        shape,
        mesh,
        problem,
        source.newton_tolerance,
        boxes,
        scene.geometry.has_poles,
        adapted,
        supply=supply_of(scene, shape),
        conductivity=conductivities(scene, mesh),
        history=None if scene.effects.memory is None else scene.effects.memory.history(scene, problem),
    )


def field_goals(mesh: SectionMesh) -> tuple[FluxLinkage | MeanFluxDensity, ...]:
    """Goals of mesh refinement: flux linkage, and the field where the powder is, or would be."""
    return (FluxLinkage(), MeanFluxDensity("powder")) if "powder" in mesh.regions else (FluxLinkage(),)


def even_fill(mesh: SectionMesh, boxes: list[AnnularBox], phi: float) -> np.ndarray:
    """Solid fraction (n powder elements,) of powder that fills the boxes to `phi`, whatever the mesh's lines are."""
    return phi * mesh.fraction_in_boxes("powder", boxes)


def mesh_of(scene: Scene) -> SectionMesh:
    """Mesh the section of a device with a coil."""
    source = scene.coil_field
    layers, size = (4, 1.0) if source is None else (source.gap_layers, source.size_factor)
    return scene.geometry.mesh(scene.shape(), element_layers(scene, layers), size)
