"""A clutch with slots or teeth, or solids from CAD: the mesh in 3D, its materials and its coil."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from emclutch.device.excitation import Excitation
from emclutch.device.materials import region_laws
from emclutch.scene.field_source import CoilFieldSection
from emclutch.scene.geometry import CadGeometry
from emclutch.scene.model import Scene
from field.three_d import Field3D, FlatCoil, Problem3D
from geometry import AnnularBox, Clutch, Mesh3D, mesh_slotted
from geometry.cad_shape import CadShape

ALONG = 61
"""Points of the line on which the gap's field is averaged."""


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

    def pole_line(self, *, faces: bool = False) -> np.ndarray:
        """Points (r, z) [m] on the middle of the rim gap under the poles, or of a face gap where it alone is filled.

        What is filled says so, whatever `faces` is; shape (k, 2).
        """
        shape, boxes = self.shape, self.powder_boxes
        if isinstance(shape, Clutch) and boxes and all(box.r1 <= shape.disc_radius for box in boxes):
            return shape.face_midline(ALONG)
        line = shape.gap_midline(ALONG)
        return line[np.abs(line[:, 1]) > 0.5 * shape.ring_width]

    def mesh_in_words(self) -> str:
        """Return what the field is solved on."""
        return (
            f"in 3D, for the slots: {len(self.mesh.tetrahedra)} tetrahedra in 1/{self.mesh.n_sectors} of the ring, "
            f"{self.problem.n_dofs} unknowns; coil of {self.turns:.0f} turns; {self.problem.linear_solver}"
        )


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
        coil.currents_in(*window),
        shape,
        mesh,
        problem,
        source.newton_tolerance,
        [] if scene.particles is None else shape.boxes_to_fill(scene.particles.region),
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
