"""The field of even powder, before a grain has moved, and how strongly it will magnetise the grains.

Even powder has the permeability of grains without order (Maxwell Garnett's, `field.laws.powder_law`). Where a run feeds
back the moments of its grains, each element's demagnetising factor N follows from them instead: a random packing has
nearly the N = (1 - phi)/3 of that rule, a sheared one that of its chains. A grain in a straight chain of touching
dipoles along the field has the field zeta(3) M/6 of the others,

    H_in = H + zeta(3) M/6 - M/3,        N = 1/3 - zeta(3)/6 = 0.133        (2 m/(4 pi r^3) of each, on both sides),

whatever the fill, as long as chains are many diameters apart: their mean field is H. What the run
finds lies between both, or beyond chains where necks are strong (weak fields, high susceptibility).
"""

from __future__ import annotations

import numpy as np

from emclutch.device_model.device import CoilDevice, Device
from emclutch.device_model.materials import grain_law
from emclutch.device_model.pole_zone import AROUND, Zone
from emclutch.scene.case import Case
from emclutch.scene.grain_smear import moments_are_fed_back
from field import MagneticField, PowderState
from field.three_d import Field3D
from geometry import AnnularBox

CHAIN_FACTOR = 1.0 / 3.0 - 1.2020569 / 6.0
"""N of grains in straight chains."""


def expected_magnetisation(case: Case, device: Device) -> tuple[MagneticField | Field3D | None, float]:
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
    coupled = scene.effects.feedback is not None
    fill = device.coil.uniform_fill(phi) if coupled else None
    field = device.coil.solve_at_peak(fill)
    angles = field.problem.fold.angles(AROUND) if isinstance(field, Field3D) else np.zeros(1)
    points = _sample_points(device.coil.powder_boxes, scene.grains.largest_diameter, angles)
    strength = np.linalg.norm(field.sampler("powder").sample(points)[0], axis=1)
    return field, float(law.magnetisation(strength, np.full(len(strength), phi if coupled else 0.0)).max())


def mean_field_strength(device: Device, field: MagneticField | Field3D | None) -> float:
    """Mean |H| [A/m] between the poles, else in the filled space, as a run has it; 0 without a field.

    `field` is the solution at the largest current with the powder spread evenly, None of an imposed field.
    """
    sampler = device.imposed if field is None else field.sampler("powder")
    if sampler is None:
        return 0.0
    if device.pole_zone is None and not device.filled_boxes:
        return float(np.linalg.norm(sampler.sample(_corners(device))[0]))
    zone = device.pole_zone or Zone(tuple(device.filled_boxes))
    angles = field.problem.fold.angles(AROUND) if isinstance(field, Field3D) else np.zeros(1)
    return zone.field_strength(sampler, angles)


def field_in_chains(coil: CoilDevice, phi: float, current: float, guess: MagneticField | None = None) -> MagneticField:
    """The field at a current [A] of powder spread evenly to the fill `phi`, its grains in straight chains along it."""
    fill = coil.uniform_fill(phi)
    powder = PowderState(fill, np.full(len(fill), CHAIN_FACTOR))
    return coil.problem.solve(coil.turns * current, powder, guess, tolerance=coil.newton_tolerance)


def powder_in_words(scene, phi: float | None) -> str:
    """With which powder of the fill `phi` the field before a run is solved, and what the run has instead."""
    if phi is None:
        return "none: a scene without [particles]"
    if scene.effects.feedback is None:
        return "without powder (its effect on the field is off)"
    even = f"powder spread evenly to {phi:.3g} with Maxwell Garnett's permeability, as of grains without order"
    if not moments_are_fed_back(scene):
        return f"{even} (so has the run, with the fill of its grains)"
    return (
        f"{even} (the run feeds back their own moments, which chains make larger); estimates for an even fill, no "
        "bounds: runs gather powder under the poles, where the field is stronger then"
    )


def chains_in_words(coil: CoilDevice, even: MagneticField, chains: MagneticField, B_max: float, faces: bool) -> str:
    """Return the largest |B| [T] in the gap with grains in chains, and both means under the poles."""
    text = f" ({B_max:.3g} T with grains in straight chains)"
    if coil.has_poles:
        means = [coil.gap_flux_density(field, faces=faces) for field in (even, chains)]
        text += f", mean under the poles {means[0]:.3g} T ({means[1]:.3g} T)"
    return text


def _corners(device: Device) -> np.ndarray:
    """Point (1, 3) [m] where an imposed field is strongest: at the smallest radius that grains reach."""
    radius = min((box.r0 for box in device.filled_boxes), default=0.0)
    return np.array([[radius, 0.0, 0.0]])


def _sample_points(boxes: list[AnnularBox], diameter: float, angles: np.ndarray) -> np.ndarray:
    points = []
    for box in boxes:
        r = np.linspace(box.r0 + 0.5 * diameter, box.r1 - 0.5 * diameter, 9)
        z = np.linspace(box.z0 + 0.5 * diameter, box.z1 - 0.5 * diameter, 121)
        r, z = np.meshgrid(r, z)
        r, z = r.ravel(), z.ravel()
        points += [np.column_stack([np.cos(angle) * r, np.sin(angle) * r, z]) for angle in angles]
    return np.concatenate(points)
