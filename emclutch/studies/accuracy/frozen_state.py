"""Field, moments and forces of a frozen packing, on which the settings of the magnetic model are measured.

A torque fluctuates more than most settings change it; moments and forces of the same grains at the same places do not.
"""

from __future__ import annotations

from dataclasses import dataclass
from time import perf_counter

import numpy as np

from coupling.staggered import lagged_forces, refresh_field
from coupling.window_budget import WindowBudget
from emclutch.scene.case import Case
from emclutch.simulation.assembly import simulation_of
from emclutch.simulation.plan import make_plan
from particles import Grains

MOMENTS_TOLERANCE, FEEDBACK_TOLERANCE = 1e-6, 1e-4
"""Far below the effect of any setting."""


@dataclass(frozen=True, slots=True)
class FrozenState:
    """Of n grains, in the order in which they were given.

    Attributes
    ----------
    field, gradient : (n, 3), (n, 3, 3) float64
        H [A/m] and its gradient [A/m^2] as sampled.
    moment, force : (n, 3) float64
        [A m^2], [N]; the force is the sum of all magnetic ones.
    stress : float
        Magnetic pull across the gap, sum of F_r (r - r_mid) [J]: what presses the powder together, times its volume.
    seconds : float
        Wall-clock time of field and moments together.
    """

    field: np.ndarray
    gradient: np.ndarray
    moment: np.ndarray
    force: np.ndarray
    stress: float
    seconds: float

    @property
    def squared_moments(self) -> float:
        """Sum of the squared moments [A^2 m^4].

        Stresses of magnetised powder are in proportion to mu0 M^2. In powder_clutch the torque followed it between 0.4
        and 1.2 A, d ln T/d ln(sum m^2) from 0.87 to 1.07, while that over the magnetic pull across the gap was 1.5 to
        2.6 (grains of one packing, at the places of 0.94 A).
        """
        return float((self.moment**2).sum())


def frozen_state(
    case: Case, position: np.ndarray, diameter: np.ndarray | float | None = None, own_key: str = ""
) -> FrozenState:
    """Solve for grains at (n, 3) [m] of diameters (n,) [m], by default the scene's, at time 0 of the coil's course.

    Moments and feedback are solved far more finely than the scene says, but for a tolerance with the dotted key
    `own_key`, which stays the scene's. Raises what field and moments raise where they do not converge.
    """
    effects = case.scene.effects
    exact = ((effects.attraction, MOMENTS_TOLERANCE), (effects.feedback, FEEDBACK_TOLERANCE))
    tolerances = {f"effects.{one.name}.tolerance": value for one, value in exact if one is not None}
    case = case.with_values({key: value for key, value in tolerances.items() if key != own_key})
    device, plan = make_plan(case)
    d = case.scene.grains.largest_diameter if diameter is None else diameter
    radius = 0.5 * np.broadcast_to(np.asarray(d, dtype=float), len(position))
    grains = Grains.create(np.array(position, dtype=float), np.array(radius), case.scene.grains.density)
    simulation = simulation_of(device, plan, grains)
    magnetised, source = simulation.magnetised, simulation.source
    if magnetised is None or source is None:
        raise ValueError("the scene has no magnetic effect: nothing changes with the settings of the field")
    for effect in simulation.effects:
        effect.begin_window(simulation)
    begin = perf_counter()
    refresh_field(simulation)
    force = lagged_forces(simulation, WindowBudget(simulation))
    seconds = perf_counter() - begin
    grains = simulation.motion.grains
    assert grains.magnetic_moment is not None  # of the update in `lagged_forces`
    given = np.argsort(grains.particle_id)
    pull = pull_across(device.shear_radius, grains.position, force)
    return FrozenState(
        magnetised.H[given], magnetised.grad_H[given], grains.magnetic_moment[given], force[given], pull, seconds
    )


def pull_across(middle: float, position: np.ndarray, force: np.ndarray) -> float:
    """See `FrozenState.stress`; `middle` of the gap at a radius [m]."""
    r = np.hypot(position[:, 0], position[:, 1])
    radial = (force[:, :2] * position[:, :2]).sum(axis=1) / r
    return -float((radial * (r - middle)).sum())
