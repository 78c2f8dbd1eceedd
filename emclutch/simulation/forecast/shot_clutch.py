"""The centrifugal shot clutch on the back of an envelope: what a simulation of it is judged by.

The vanes turn the shot at the input's speed omega. Settled on the drum (radius r_o, width L) at bulk density rho_b, it
forms a ring down to r_i. Each wedge of it presses on the drum with its centrifugal force, no stress along the hoop
helping to carry it:

    N = integral of rho_b omega^2 r dV = rho_b omega^2 2 pi L (r_o^3 - r_i^3)/3,

and Coulomb friction mu at r_o makes of it the torque

    T = mu N r_o = K omega^2,    K = mu rho_b 2 pi L r_o (r_o^3 - r_i^3)/3.

Were the shot a fluid (hoop stress = radial stress), r_o (r_o^2 - r_i^2)/2 would stand for (r_o^3 - r_i^3)/3: for a thin
ring the same, for a full drum half as much again. Ribs replace mu by the shot's inner friction, slots in the vanes let
part of it stay behind: the estimate is one of class. It depends on the input's speed alone, so that an output of
inertia J under a load T_l obeys J domega_2/dt = K omega_1^2 - T_l until both speeds are equal; below
omega = sqrt(T_l/K) a dry-friction load is not moved at all.
"""

from __future__ import annotations

import math


def shot_ring_radius(volume: float, width: float, drum_radius: float) -> float:
    """Inner radius r_i [m] of a ring of shot of bulk ``volume`` [m^3] in a drum; 0 where it fills the drum."""
    return math.sqrt(max(0.0, drum_radius**2 - volume / (math.pi * width)))


def shot_clutch_torque(
    speed: float, *, friction: float, bulk_density: float, width: float, drum_radius: float, ring_radius: float
) -> float:
    """Torque K omega^2 [N m] that the shot transmits at the input's ``speed`` [rad/s], of the speed's sign.

    Parameters
    ----------
    friction : float
        Between shot and drum.
    bulk_density : float
        Of the settled shot [kg/m^3]: solid fraction (0.55 to 0.62) times the density of the grains.
    width, drum_radius, ring_radius : float
        L, r_o and r_i [m].
    """
    normal = bulk_density * speed * abs(speed) * 2.0 * math.pi * width * (drum_radius**3 - ring_radius**3) / 3.0
    return friction * normal * drum_radius
