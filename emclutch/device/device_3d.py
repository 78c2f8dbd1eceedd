"""A clutch with slots or teeth, or solids from CAD: the mesh in 3D, its materials and its coil."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from emclutch.device.excitation import Excitation
from emclutch.device.materials import region_laws
from emclutch.scene.field_source import CoilFieldSection
from emclutch.scene.fill import boxes_to_fill
from emclutch.scene.geometry import CadGeometry
from emclutch.scene.model import Scene
from field.three_d import Field3D, FlatCoil, Problem3D
from geometry import AnnularBox, Clutch, Mesh3D, mesh_slotted
from geometry.cad_shape import CadShape
from geometry.time_profile import TimeProfile


@dataclass(frozen=True, slots=True)
class CoilDevice3D(Excitation):
    """A device whose field is solved in 3D.

    Attributes
    ----------
    shape : Clutch or CadShape
    mesh : Mesh3D
    problem : Problem3D
    newton_tolerance : float
    powder_boxes : list of AnnularBox
        What is filled with powder.
    carrier : str
        The body that is no body of revolution, in whose frame the field stands still.
    """

    shape: Clutch | CadShape
    mesh: Mesh3D
    problem: Problem3D
    newton_tolerance: float
    powder_boxes: list[AnnularBox]
    carrier: str

    def solve_at_peak(self, fill: np.ndarray | None) -> Field3D:
        """The field at the largest current; the powder does not change it."""
        assert fill is None  # by the checks between sections
        return self.problem.solve(self.turns * self.largest_current, tolerance=self.newton_tolerance)


def build_coil_device_3d(scene: Scene) -> CoilDevice3D:
    """Mesh, materials and coil of a clutch of which one body has slots, or of solids from CAD."""
    shape, source, coil = scene.shape(), scene.coil_field, scene.coil
    assert isinstance(shape, (Clutch, CadShape)) and source is not None and coil is not None
    mesh, winding, carrier = _parts_of(scene, shape, source)
    outer = mesh.points[mesh.boundaries["outer"]][..., 2]
    problem = Problem3D(
        mesh,
        region_laws(scene, mesh),
        winding,
        order=min(source.order, 2),
        outer="open" if source.open_boundary else "flux_wall",
        centre_z=0.0 if isinstance(shape, Clutch) else 0.5 * float(outer.min() + outer.max()),
    )
    window = shape.coil_area, shape.coil_mean_radius
    return CoilDevice3D(
        coil.winding_in(*window),
        TimeProfile(*coil.currents_in(*window)),
        shape,
        mesh,
        problem,
        source.newton_tolerance,
        [] if scene.particles is None else boxes_to_fill(shape, scene.particles.region),
        carrier,
    )


def _parts_of(scene: Scene, shape: Clutch | CadShape, source: CoilFieldSection) -> tuple[Mesh3D, FlatCoil, str]:
    """Mesh, source of the field, and the body that it turns with."""
    sizes: dict = {
        "gap_layers": source.gap_layers, "size_factor": source.size_factor, "order": min(source.order, 2)
    }  # fmt: skip
    if isinstance(shape, Clutch):
        half = 0.5 * shape.coil_width
        winding = FlatCoil.ring((shape.coil_inner_radius, shape.coil_outer_radius), (-half, half))
        return mesh_slotted(shape, **sizes), winding, "disc" if shape.disc_slots is not None else "rotor"
    assert isinstance(scene.geometry, CadGeometry)  # nothing else has this shape
    (part,) = (part for part in shape.section.parts if part.region == "coil")  # by `check_device_3d`
    winding = FlatCoil.ring((part.r0, part.r1), (part.z0, part.z1))
    return scene.geometry.mesh_3d(**sizes), winding, next(iter(shape.carriers), "housing")


def gap_flux_density(device: CoilDevice3D, solution: Field3D, count: int = 61) -> float:
    """Mean |B| [T] on the middle of the rim gap under the pole faces, over a sector's angle.

    Where only the face gaps are filled, on the middle of one of them.
    """
    shape = device.shape
    boxes = device.powder_boxes
    if isinstance(shape, Clutch) and boxes and all(box.r1 <= shape.disc_radius for box in boxes):
        line = shape.face_midline(count)
    else:
        line = shape.gap_midline(count)
        line = line[np.abs(line[:, 1]) > 0.5 * shape.ring_width]
    fold = solution.problem.fold
    angle = fold.first + fold.angle * (np.arange(count) + 0.5) / count
    r, z = line.T
    points = np.stack(
        [np.outer(np.cos(angle), r), np.outer(np.sin(angle), r), np.broadcast_to(z, (count, len(r)))], axis=-1
    ).reshape(-1, 3)
    return float(np.linalg.norm(solution.flux_density(points), axis=1).mean())
