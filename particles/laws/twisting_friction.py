"""Resistance to twisting: the spin of two grains against each other about their common normal.

Perfect spheres touch in a point and twist freely; a contact of finite size resists by its slip. As for rolling
(`particles.laws.rolling_friction`), a spring and a dashpot for the twisting angle, in series with a slider
(Luding, Granular Matter 10 (2008) 235, section 2.4: torsion resistance with the lever r_eff):

    T = -(k_w theta + gamma_w dtheta/dt) n,    |T| <= mu_w r_eff F_rep,    dtheta/dt = (omega_i - omega_j).n (stuck),
    k_w = k_t r_eff^2,    gamma_w = 2 zeta sqrt(k_w I_eff),

F_rep the repulsion of the contact (|F_n| without cohesion), on i, and its opposite on j: angular momentum is conserved,
and by the return mapping of the tangential spring the torque only ever takes energy. A Hertzian contact of radius a
yields at (2/3) mu a |F_n| at most (Marshall, J. Comput. Phys. 228 (2009) 1541, full slip of a uniform traction): mu_w =
(2/3) mu a/r_eff, a few hundredths for hard grains; more stands for roughness and flats.
"""

from __future__ import annotations

from particles.laws.contact_law import ResistanceCoefficient


class TwistingFriction(ResistanceCoefficient):
    """Coefficients mu_w [-] between grains, and at walls (as between grains unless given)."""

    __slots__ = ()
    name, usual = "twisting friction", "0.01 to 0.1"
