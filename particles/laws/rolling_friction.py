"""Rolling resistance of grains that are not the perfect spheres they are computed as.

A spring and a dashpot for the rolling angle theta, in series with a slider (Iwashita & Oda, J. Eng. Mech. 124 (1998)
285; model C of Ai, Chen, Rotter & Ooi, Powder Technology 206 (2011) 269), on i and its opposite on j:

    T = -(k_r theta + gamma_r dtheta/dt),   |T| <= mu_r R_eff F_rep,   dtheta/dt = w while it sticks,
    k_r = k_t R_eff^2,   gamma_r = 2 zeta_n sqrt(k_r I_eff),

F_rep the repulsion of the contact (|F_n| without cohesion), w the tangential part of omega_i - omega_j, 1/R_eff =
1/R_i + 1/R_j (R_i at a wall), I_eff the reduced inertia. theta turns with the pair and yields by the return mapping of
the tangential spring (`particles.laws.linear`), so that a loaded grain rests, whatever the time step, and the torque
only ever takes energy; the two cancel: angular momentum is conserved. Spheres on smooth walls roll like balls in a
bearing and let a clutch slip; ground powder is rough and angular: values of 0.1 to 0.3 are usual for irregular grains
(Wensrich & Katterfeld, Powder Technology 217 (2012) 409).
"""

from __future__ import annotations

from particles.laws.contact_law import ResistanceCoefficient


class RollingFriction(ResistanceCoefficient):
    """Coefficients mu_r [-] between grains, and at walls (as between grains unless given)."""

    __slots__ = ()
    name, usual = "rolling friction", "0.1 to 0.3"
