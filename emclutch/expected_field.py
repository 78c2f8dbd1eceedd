"""The field at the largest current, and how strongly it will magnetise the grains."""

from __future__ import annotations

import numpy as np

from emclutch.case import Case
from emclutch.device import CoilDevice, Device, grain_law
from field import MagneticField
from field.solid import SolidField
from geometry import AnnularBox, ShearCell


def expected_magnetisation(case: Case, device: Device) -> tuple[MagneticField | SolidField | None, float]:
    """Field at the largest current with the powder spread evenly over its boxes, and the grains' largest M there."""
    scene = case.scene
    law = grain_law(scene)
    if device.imposed is not None:
        H = device.imposed.sample(_corners(device))[0]
        strength = np.linalg.norm(H, axis=1).max(keepdims=True)
        return None, float(law.magnetisation(strength, np.zeros(1))[0])
    if device.coil is None:
        return None, 0.0
    phi = device.fill.solid_fraction
    coupled = scene.effects.back_reaction is not None
    fill = device.coil.uniform_fill(phi) if coupled and isinstance(device.coil, CoilDevice) else None
    field = device.coil.solve_at_peak(fill)
    points = _sample_points(device.coil.powder_boxes, scene.particles.largest_diameter)
    strength = np.linalg.norm(field.sampler("powder").sample(points)[0], axis=1)
    return field, float(law.magnetisation(strength, np.full(len(strength), phi if coupled else 0.0)).max())


def _corners(device: Device) -> np.ndarray:
    """Where an imposed field is strongest: at the smallest radius that grains reach, (1, 3) [m]."""
    radius = device.shape.inner_radius if isinstance(device.shape, ShearCell) else 0.0
    return np.array([[radius, 0.0, 0.0]])


def _sample_points(boxes: list[AnnularBox], diameter: float) -> np.ndarray:
    points = []
    for box in boxes:
        r = np.linspace(box.r0 + 0.5 * diameter, box.r1 - 0.5 * diameter, 9)
        z = np.linspace(box.z0 + 0.5 * diameter, box.z1 - 0.5 * diameter, 121)
        r, z = np.meshgrid(r, z)
        points.append(np.column_stack([r.ravel(), np.zeros(r.size), z.ravel()]))
    return np.concatenate(points)
