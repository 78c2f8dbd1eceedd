"""Effect `fluid_drag`: Stokes drag of grains in a carrier fluid whose flow is given.

F = -k (v - u) with k = 3 pi eta d: a sphere of diameter d at v in a fluid of viscosity eta that flows at u there
(Stokes 1851; Re = rho_f |v - u| d/eta well below 1, a grain alone in the fluid). Neighbours, walls, added mass, lift
and the drag on spins are left out, and the grains do not change the flow.

The force is lagged: constant over a sub-cycle of duration h. It is the mean force of the exact decay of a free grain,

    F = -m (v - u) (1 - exp(-h k/m))/h,

which is -k (v - u) for h << m/k and stops a grain without overshoot for any h.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from coupling.effects.effect import Effect
from particles import Body

Flow = Callable[[np.ndarray], np.ndarray]
"""Velocity of the fluid (n, 3) [m/s] at positions (n, 3) [m]."""


def at_rest(position: np.ndarray) -> np.ndarray:
    """Velocity (n, 3) [m/s] of a fluid at rest."""
    return np.zeros_like(position)


@dataclass(frozen=True, slots=True)
class CouetteFlow:
    """Steady laminar flow between two coaxial cylinders at their present speeds, u_phi = A r + B/r.

    A = (w_o r_o^2 - w_i r_i^2)/(r_o^2 - r_i^2), B = (w_i - w_o) r_i^2 r_o^2/(r_o^2 - r_i^2) (Landau & Lifshitz, Fluid
    Mechanics, §18). Positions beyond a cylinder have the velocity at its surface.

    Attributes
    ----------
    inner_radius, outer_radius : float
        r_i, r_o [m]
    inner, outer : Body
        Whose speeds w_i, w_o [rad/s] are taken at every call.
    """

    inner_radius: float
    outer_radius: float
    inner: Body
    outer: Body

    def __call__(self, position: np.ndarray) -> np.ndarray:
        """Return the velocity (n, 3) [m/s] at positions (n, 3) [m]."""
        a, b = self.inner_radius**2, self.outer_radius**2
        A = (self.outer.speed * b - self.inner.speed * a) / (b - a)
        B = (self.inner.speed - self.outer.speed) * a * b / (b - a)
        r = np.hypot(position[:, 0], position[:, 1])
        at = np.clip(r, self.inner_radius, self.outer_radius)
        over_r = (A * at + B / at) / np.where(r > 0.0, r, np.inf)
        return np.column_stack((-over_r * position[:, 1], over_r * position[:, 0], np.zeros(len(r))))


class FluidDrag(Effect):
    """Drag in a fluid of a viscosity [Pa s] with a given flow."""

    name = "fluid_drag"

    def __init__(self, viscosity: float, flow: Flow = at_rest) -> None:
        self.viscosity, self.flow = viscosity, flow

    def add_forces(self, simulation, force):
        motion = simulation.motion
        grains, duration = motion.grains, motion.dt * simulation.lagged_steps
        rate = 6.0 * np.pi * self.viscosity * grains.radius / grains.mass
        slip = grains.velocity - self.flow(grains.position)
        drag = (grains.mass * np.expm1(-duration * rate) / duration)[:, None] * slip
        force += drag
        x = grains.position
        return {self.name: float((x[:, 0] * drag[:, 1] - x[:, 1] * drag[:, 0]).sum())}
