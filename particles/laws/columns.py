"""Columns of a row of contact parameters: a row a pair of materials, shape (rows, N_LAW), for the kernels.

Columns 0 to 5 belong to the law, and a column serves a law only where it is named below; the others are the same for
every law. What a spring may be missing (a dashpot, a second stiffness) is 0.
"""

from __future__ import annotations

N_LAW = 16  # a multiple of 4, as SIMD gathers need (`geometry.kernels.simd_tables`); the last ones are empty

# linear: k_n, k_t [N/m], zeta_n, zeta_t [-]
# hertz_mindlin: E*, G* [Pa], gamma_n and gamma_t over sqrt(m_eff a), a = sqrt(r_eff delta) [sqrt(Pa)]
# hertz: k, k_t [N/m^1.5], gamma_n, gamma_t [kg/s]
# thesis: k, k_t [N/m], gamma_n, gamma_t [1/s], then D [m] and the exponent of delta/D
# walton_braun: k_1, k_t [N/m], then k_2 [N/m] in place of a normal dashpot, zeta_t [-]
STIFFNESS_N, STIFFNESS_T, DAMPING_N, DAMPING_T, DIAMETER, EXPONENT = range(6)
YOUNG, SHEAR = STIFFNESS_N, STIFFNESS_T
UNLOADING = DAMPING_N

MU = 6  # Coulomb friction [-]
MU_ROLLING = 7  # torque / (r_eff |F_n|) [-]
MU_TWISTING = 8  # torque / (r_eff |F_n|) [-]
COHESION_0 = 9  # pull [N]
COHESION_1 = 10  # pull / r_eff [N/m]
DAMPING_ROLLING = 11  # fraction of critical damping of rolling and twisting [-]
COHESIVE = 12  # 1 where there is cohesion; else the kernel does not read its columns
