"""A device with slots or teeth, or solids of any shape: the mesh in 3D, its materials and its coil."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from coupling.smear_region import elements_within, magnetic_regions
from emclutch.device_model.excitation import Excitation, Supply, supply_of
from emclutch.device_model.materials import grain_law, region_laws
from emclutch.scene.grain_smear import element_layers, moments_are_fed_back, smear_width
from emclutch.scene.model import Scene
from field import MU_0, PowderLaw
from field.three_d import Field3D, FlatCoil, Problem3D
from geometry import AnnularBox, Mesh3D
from geometry.device_shape import WoundShape

ARC = 0.5
"""Longest elements along the angle where moments are fed back, over the width of the smear: half of a grain's reach."""

ALONG = 61
"""Points of the line on which the gap's field is averaged."""


@dataclass(frozen=True, slots=True)
class Solid:
    """What a kind of device makes for a field in 3D.

    Attributes
    ----------
    mesh : Mesh3D
    coil : FlatCoil
        The source of the field.
    carrier : str
        The body that is no body of revolution, in whose frame the field stands still.
    pole_line, face_line : ndarray, shape (k, 2)
        Points (r, z) [m] on the middle of the rim gap under the poles, and of a face gap.
    centre_z : float
        Of the outer boundary [m].
    pitch : float or None
        Angle [rad] after which the field repeats; None: not known.
    """

    mesh: Mesh3D
    coil: FlatCoil
    carrier: str
    pole_line: np.ndarray
    face_line: np.ndarray
    centre_z: float = 0.0
    pitch: float | None = None


@dataclass(frozen=True, slots=True)
class CoilDevice3D(Excitation):
    """A device whose field is solved in 3D.

    Attributes
    ----------
    shape : WoundShape
    mesh : Mesh3D
    problem : Problem3D
    newton_tolerance : float
    powder_boxes : list of AnnularBox
        What is filled with powder.
    carrier : str
        The body that is no body of revolution, in whose frame the field stands still.
    line : ndarray, shape (k, 2)
        Points (r, z) [m] on the middle of the rim gap under the poles, or of a face gap where it alone is filled.
    pitch : float or None
        Angle [rad] after which the field repeats; None: not known.
    supply : Supply or None
        Of a coil at a voltage.
    """

    shape: WoundShape
    mesh: Mesh3D
    problem: Problem3D
    newton_tolerance: float
    powder_boxes: list[AnnularBox]
    carrier: str
    line: np.ndarray
    pitch: float | None
    supply: Supply | None = None

    def solve_at_peak(self, fill: np.ndarray | None) -> Field3D:
        """The field at the largest current, with powder of a solid fraction (n powder elements,) or without."""
        return self.problem.solve(self.turns * self.largest_current, fill, tolerance=self.newton_tolerance)

    def uniform_fill(self, phi: float) -> np.ndarray:
        """Solid fraction `phi` on the powder's elements with their middle in the filled boxes; (n powder elements,)."""
        x = self.mesh.centroid()[self.problem.powder_elements]
        r, z = np.hypot(x[:, 0], x[:, 1]), x[:, 2]
        boxes = [(r > b.r0) & (r < b.r1) & (z > b.z0) & (z < b.z1) for b in self.powder_boxes]
        return phi * np.any(boxes, axis=0)

    def pole_line(self, *, faces: bool = False) -> np.ndarray:
        """The device's `line`, whatever `faces` is: what is filled decides; shape (k, 2)."""
        return self.line

    def mesh_in_words(self) -> str:
        """Domain on which the field is solved."""
        return (
            f"in 3D, for the slots: {len(self.mesh.tetrahedra)} tetrahedra in 1/{self.mesh.n_sectors} of the ring, "
            f"{self.problem.n_dofs} unknowns; {self.problem.linear_solver}"
        )


def build_coil_device_3d(scene: Scene, source: Any) -> CoilDevice3D:
    """Mesh, materials and coil of a device that is no body of revolution; `source` is the table [field]."""
    shape, coil, order = scene.shape(), scene.coil, min(source.order, 2)
    assert coil is not None  # by the checks between sections
    arc, powder, beyond = np.inf, None, None
    if moments_are_fed_back(scene):
        arc = ARC * smear_width(scene)
    solid = scene.geometry.solid(shape, element_layers(scene, source.gap_layers), source.size_factor, order, arc)
    laws = region_laws(scene, solid.mesh)
    if scene.effects.feedback is not None:
        powder = PowderLaw(grain_law(scene))
    if moments_are_fed_back(scene):
        beyond = elements_within(solid.mesh, magnetic_regions(laws), smear_width(scene))
    problem = Problem3D(
        solid.mesh,
        laws,
        solid.coil,
        order=order,
        outer="open" if source.open_boundary else "flux_wall",
        centre_z=solid.centre_z,
        powder_law=powder,
        powder_beyond=beyond,
    )
    region = "" if scene.particles is None else scene.particles.region
    window = shape.coil_area, shape.coil_mean_radius
    return CoilDevice3D(
        coil.winding_in(*window),
        coil.currents_in(*window),
        shape,
        solid.mesh,
        problem,
        source.newton_tolerance,
        shape.boxes_to_fill(region) if region else [],
        solid.carrier,
        solid.face_line if region == "faces" else solid.pole_line,
        solid.pitch,
        supply_of(scene, shape),
    )


def under_the_poles(shape: WoundShape) -> np.ndarray:
    """Points (r, z) [m] on the middle of the rim gap, without those over the ring between the poles; shape (k, 2)."""
    line = shape.gap_midline(ALONG)
    return line[np.abs(line[:, 1]) > 0.5 * shape.ring_width]


def gap_map(
    device: CoilDevice3D, solution: Field3D, pitches: float = 2.0, count: int = 200
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Recovered B_r (m, count) [T] on the gap's middle cylinder, free of powder; at angles [rad] and z (m,) [m].

    Over some pitches of a slotted clutch, or all around.
    """
    angle = np.linspace(0.0, 2.0 * np.pi if device.pitch is None else pitches * device.pitch, count)
    line = device.shape.gap_midline(80)
    r, z = line.T
    points = np.stack(
        [np.outer(r, np.cos(angle)), np.outer(r, np.sin(angle)), np.broadcast_to(z[:, None], (len(z), count))], axis=-1
    )
    H = solution.sampler("powder").sample(points.reshape(-1, 3))[0].reshape(len(z), count, 3)
    return angle, z, MU_0 * (H[..., 0] * np.cos(angle) + H[..., 1] * np.sin(angle))
