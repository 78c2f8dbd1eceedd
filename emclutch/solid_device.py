"""A clutch with slots or teeth: its mesh in space, its materials and its coil."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from emclutch.coil_course import CoilCourse
from emclutch.device import region_laws
from emclutch.scene.field_source import CoilField as CoilFieldSection
from emclutch.scene.fill import boxes_to_fill
from emclutch.scene.model import Scene
from field.solid import FlatCoil, SolidField, SolidProblem
from geometry import AnnularBox, Clutch, SolidMesh, mesh_slotted


@dataclass(frozen=True, slots=True)
class SolidCoilDevice(CoilCourse):
    """A device whose field is solved in space.

    Attributes
    ----------
    shape : Clutch
    mesh : SolidMesh
    problem : SolidProblem
    newton_tolerance : float
    powder_boxes : list of AnnularBox
        What is filled with powder.
    carrier : str
        The slotted body, in whose frame the field stands still.
    """

    shape: Clutch
    mesh: SolidMesh
    problem: SolidProblem
    newton_tolerance: float
    powder_boxes: list[AnnularBox]
    carrier: str

    def solve_at_peak(self, fill: np.ndarray | None) -> SolidField:
        """The field at the largest current; the powder does not change it."""
        assert fill is None  # by the checks between sections
        return self.problem.solve(self.turns * self.largest_current, tolerance=self.newton_tolerance)


def build_solid_coil_device(scene: Scene) -> SolidCoilDevice:
    """Mesh, materials and coil of a clutch of which one body has slots."""
    shape, source, coil = scene.shape(), scene.field, scene.coil
    assert isinstance(shape, Clutch) and isinstance(source, CoilFieldSection) and coil is not None  # by the schema
    mesh = mesh_slotted(shape, gap_layers=source.gap_layers, size_factor=source.size_factor, order=min(source.order, 2))
    inner, outer = shape.coil_inner_radius, shape.coil_outer_radius
    winding = FlatCoil.ring((inner, outer), (-0.5 * shape.coil_width, 0.5 * shape.coil_width))
    problem = SolidProblem(
        mesh,
        region_laws(scene, mesh),
        winding,
        order=min(source.order, 2),
        outer="open" if source.open_boundary else "flux_wall",
    )
    window = shape.coil_area, shape.coil_mean_radius
    times, currents = coil.currents_in(*window)
    return SolidCoilDevice(
        coil.winding_in(*window),
        times,
        currents,
        shape,
        mesh,
        problem,
        source.newton_tolerance,
        [] if scene.particles is None else boxes_to_fill(shape, scene.particles.region),
        "disc" if shape.disc_slots is not None else "rotor",
    )


def gap_flux_density(device: SolidCoilDevice, solution: SolidField, count: int = 61) -> float:
    """Mean |B| [T] on the middle of the rim gap under the pole faces, over a sector's angle.

    Where only the face gaps are filled, on the middle of one of them.
    """
    shape = device.shape
    boxes = device.powder_boxes
    if boxes and all(box.r1 <= shape.disc_radius for box in boxes):
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
