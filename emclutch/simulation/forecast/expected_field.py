"""The field of even powder, before a grain has moved, and how strongly it will magnetise the grains.

Even powder has the permeability of grains without order (Maxwell Garnett's, `field.laws.powder_law`), with which a run
begins. Sheared powder carries more flux: `field_of_sheared_powder` has the demagnetising factor N of the law that gap
cells gave (`emclutch.simulation.forecast.powder_law`), in each element at its own H.
"""

from __future__ import annotations

import numpy as np

from emclutch.device_model.device import CoilDevice, Device
from emclutch.device_model.materials import grain_law, saturation_of
from emclutch.device_model.pole_zone import AROUND, Zone
from emclutch.scene.case import Case
from emclutch.scene.grain_smear import moments_are_fed_back
from emclutch.scene.model import Scene
from emclutch.simulation.forecast.powder_law import PowderLaw, law_of
from field import MU_0, MagneticField, PowderState
from field.newton import ConvergenceError
from field.three_d import Field3D
from geometry import AnnularBox

SETTLED, TOLERANCE = 1e-3, 1e-5
"""Change of N between two solves at which it counts as found, and residual of a solve: both 1e-4 of the field."""

ROUNDS = 8


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


def limits_of(scene: Scene, device: Device, field: MagneticField | Field3D | None) -> tuple[str, ...]:
    """Why the field of `mean_field_strength` is outside of what the models of the effects hold for."""
    strength = mean_field_strength(device, field)
    return tuple(text for one in scene.effects.present for text in one.limits(scene, strength))


def field_of_sheared_powder(
    coil: CoilDevice,
    fill: np.ndarray,
    scene: Scene,
    current: float,
    guess: MagneticField | None,
    law: PowderLaw | None = None,
) -> MagneticField:
    """The field at a current [A] of powder with the fill (n powder elements,) and the permeability of a law.

    Without a law it is that of the scene's powder, or of the nearest one. Steel with hysteresis has `coil.history`
    before; without a later one it is demagnetised.

    Raises
    ------
    ConvergenceError
        A solve, or N after `ROUNDS` of them.
    """
    grains, Ms, law = grain_law(scene), saturation_of(scene), law or law_of(scene)[0]
    problem, own = coil.problem, coil.problem.powder_elements
    elements, filled, phi = problem.elements, fill > 0.0, fill[:, None]
    weight = elements.weight[own] * elements.radius[own]
    N = law.factor(np.zeros(len(fill)), fill, Ms)
    for _ in range(ROUNDS):
        drive, powder = coil.turns * current, PowderState(fill, N)
        found = problem.solve(drive, powder, guess, tolerance=TOLERANCE, history=coil.history)
        B = np.hypot(*np.moveaxis(elements.gradient(found.psi)[own], 1, 0)) / elements.radius[own]
        H = B / MU_0 - phi * grains.from_flux(B, phi, N[:, None])[0]
        before, N = N, law.factor((H * weight).sum(axis=1) / weight.sum(axis=1), fill, Ms)
        if np.abs(N - before)[filled].max(initial=0.0) < SETTLED:
            return found
        guess = found
    message = f"the permeability of the sheared powder did not settle within {ROUNDS} solves"
    raise ConvergenceError(found.newton, "lower coil.current", message)


def powder_in_words(scene, phi: float | None) -> str:
    """With which powder of the fill `phi` the field before a run is solved, and what the run has instead."""
    if phi is None:
        return "none: a scene without [particles]"
    if scene.effects.feedback is None:
        return "the field is solved without powder, as [effects.back_reaction] is off"
    even = f"spread evenly, solid fraction {phi:.3g}, with the permeability of a random packing (Maxwell Garnett)"
    if not moments_are_fed_back(scene):
        return f"{even}. A run uses the same permeability, with the fill of its own grains"
    return (
        f"{even}. In a run the field becomes stronger, because shear raises the permeability and powder gathers under "
        "the poles"
    )


def sheared_in_words(coil: CoilDevice, even: MagneticField, sheared: MagneticField, B_max: float, faces: bool) -> str:
    """Return the largest |B| [T] in the gap with sheared powder, and both means under the poles."""
    if not coil.has_poles:
        return f", {B_max:.3g} T with sheared powder"
    means = [coil.gap_flux_density(field, faces=faces) for field in (even, sheared)]
    return f", mean under the poles {means[0]:.3g} T. With sheared powder: {B_max:.3g} T, mean {means[1]:.3g} T"


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
