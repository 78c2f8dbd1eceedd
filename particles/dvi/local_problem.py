"""One contact alone: the impulse r that satisfies Signorini and Coulomb for u = W r + q.

Normal direction first: r = (r_n, r_1, r_2), u and q likewise. The unilateral contact with exact Coulomb friction asks

    0 <= u_n  _|_  r_n >= 0,     |r_t| <= mu r_n,     u_t = -s r_t with s >= 0, and s = 0 unless |r_t| = mu r_n

(Acary & Brogliato, Numerical Methods for Nonsmooth Dynamical Systems, Springer 2008, sec. 3.9). The convex relaxation
(cone complementarity, Anitescu & Tasora, Comput. Optim. Appl. 47 (2010) 207) asks K* contains u _|_ r in K instead,
with K the friction cone and K* its dual; a sliding contact then opens at u_n = mu |u_t|.

**Spheres**: W is diagonal, w_n = 1/m_i + 1/m_j and w_t = 3.5 w_n (solid spheres that touch), and both laws have
a closed form (`gauss_seidel`).

**Full block** (a wall on a free shaft adds z z^T/J with z the lever about the axis). With q_n >= 0 the contact opens:
r = 0. Otherwise, if the sticking impulse -W^-1 q lies in the cone, it is the solution. Otherwise the contact slides at
u_n = 0; with the Schur complement A = W_tt - w_tn w_nt/w_nn and b = q_t - w_tn q_n/w_nn,

    r_t(s) = -(A + s)^-1 b,    r_n(s) = -(q_n + w_nt.r_t(s))/w_nn,    psi(s) = mu r_n(s)/|r_t(s)| - 1 = 0.

psi(0) < 0 because sticking was not admissible, and r_n(s) -> -q_n/w_nn > 0, r_t(s) -> 0 for s -> inf: a root lies in
a bracket that is known beforehand. psi is linear in s where A is a multiple of the identity, so Newton needs a step
or two; bisection guards it. A solution is thus always found; it is unique unless mu |w_nt| is large against w_nn
(Painleve), which bodies of revolution exclude: there w_nt = 0.
"""

from __future__ import annotations

import numpy as np
from numba import njit

from geometry.kernels.simd import llvm_sqrt, select


@njit(error_model="numpy", fastmath={"contract"})
def coulomb_block(w_nn, w_n1, w_n2, w_11, w_12, w_22, mu, q_n, q_1, q_2):
    """Exact Coulomb for a symmetric positive definite W."""
    if q_n >= 0.0:
        return 0.0, 0.0, 0.0
    r_0, g_1, g_2 = -q_n / w_nn, w_n1 / w_nn, w_n2 / w_nn
    # Schur complement on its principal axes (cos, sin): r_t(s) = c/(a + s) there
    a_11, a_12, a_22 = w_11 - w_n1 * g_1, w_12 - w_n1 * g_2, w_22 - w_n2 * g_2
    b_1, b_2 = q_1 + w_n1 * r_0, q_2 + w_n2 * r_0
    half, mean = 0.5 * (a_11 - a_22), 0.5 * (a_11 + a_22)
    spread = np.sqrt(half * half + a_12 * a_12)
    cos, sin = 1.0, 0.0
    if spread > 0.0 and half >= 0.0:  # the larger of the two first: the other would cancel
        cos = np.sqrt(0.5 * (1.0 + half / spread))
        sin = 0.5 * a_12 / (spread * cos)
    elif spread > 0.0:
        sin = np.sqrt(0.5 * (1.0 - half / spread))
        cos = 0.5 * a_12 / (spread * sin)
    big, small = mean + spread, (a_11 * a_22 - a_12 * a_12) / (mean + spread)
    c_1, c_2 = -(cos * b_1 + sin * b_2), -(cos * b_2 - sin * b_1)
    h_1, h_2 = cos * g_1 + sin * g_2, cos * g_2 - sin * g_1

    x, y = c_1 / big, c_2 / small
    r_n = r_0 - h_1 * x - h_2 * y
    if r_n < 0.0 or x * x + y * y > mu * mu * r_n * r_n:  # it does not stick
        size = np.sqrt(c_1 * c_1 + c_2 * c_2)
        if mu == 0.0 or size == 0.0:
            return r_0, 0.0, 0.0
        low, high = 0.0, size * (1.0 / mu + np.sqrt(h_1 * h_1 + h_2 * h_2)) / r_0
        s = max((size / mu + h_1 * c_1 + h_2 * c_2) / r_0 - mean, 0.0)  # the root if A were mean * identity
        if not s < 1e20 * big:  # so little load that W does not show: kinetic friction on a prescribed velocity
            x, y = c_1 * (mu * r_0 / size), c_2 * (mu * r_0 / size)
            return r_0, cos * x - sin * y, sin * x + cos * y
        for _ in range(200):
            d_1, d_2 = 1.0 / (big + s), 1.0 / (small + s)
            x, y = c_1 * d_1, c_2 * d_2
            r_n = r_0 - h_1 * x - h_2 * y
            t = np.sqrt(x * x + y * y)
            psi = mu * r_n / t - 1.0
            if abs(psi) < 4e-15:
                break
            if psi < 0.0:
                low = s
            else:
                high = s
            slope = mu / t * (h_1 * x * d_1 + h_2 * y * d_2 + r_n * (x * x * d_1 + y * y * d_2) / (t * t))
            step = s - psi / slope if slope > 0.0 else -1.0
            if not low < step < high:
                step = 0.5 * (low + high)
            if step == s or high - low <= 1e-16 * high:
                break
            s = step
        r_n = max(r_n, 0.0)
        t = np.sqrt(x * x + y * y)
        x, y = x * (mu * r_n / t), y * (mu * r_n / t)
    return r_n, cos * x - sin * y, sin * x + cos * y


@njit(error_model="numpy", fastmath={"contract"})
def natural_map(convex, w_n, mu, r_n, r_1, r_2, u_n, u_1, u_2):
    """|r - P_K(r - rho (u + mu |u_t| e_n))|/rho with rho = 1/w_n [m/s]; without the shift for the convex law.

    Of one contact, or of eight.
    """
    if not convex:
        u_n = u_n + mu * llvm_sqrt(u_1 * u_1 + u_2 * u_2)
    n, x, y = r_n - u_n / w_n, r_1 - u_1 / w_n, r_2 - u_2 / w_n
    t = llvm_sqrt(x * x + y * y)
    opens = w_n * llvm_sqrt(r_n * r_n + r_1 * r_1 + r_2 * r_2)
    # from the velocity, not from the difference of impulses: where these have run away it would round to nothing
    sticks = llvm_sqrt(u_n * u_n + u_1 * u_1 + u_2 * u_2)
    out = w_n * (t - mu * n) / (1.0 + mu * mu)  # from the cone's surface
    d_n, d_1, d_2 = u_n - mu * out, u_1 + out * x / t, u_2 + out * y / t
    slides = llvm_sqrt(d_n * d_n + d_1 * d_1 + d_2 * d_2)
    # opening is tested first: without friction, sticking would take a pull for a point of the cone
    return select(mu * t <= 0.0 - n, opens, select(t <= mu * n, sticks, slides))


@njit(error_model="numpy", fastmath={"contract"})
def in_disc(a, b, limit, f, g):
    """The (x, y) in the disc of radius ``limit`` that makes (a x^2 + b y^2)/2 - f x - g y smallest, a and b > 0.

    Where the free minimum lies outside, x = f/(a + s), y = g/(b + s) with s > 0: Newton for 1/limit = 1/|(x, y)|, which
    is nearly linear in s and comes to the root from one side (More & Sorensen, SIAM J. Sci. Stat. Comput. 4 (1983)
    553).
    """
    x, y = f / a, g / b
    if limit <= 0.0:
        return 0.0, 0.0
    size = np.sqrt(x * x + y * y)
    if size <= limit:
        return x, y
    s = 0.0
    for _ in range(50):
        if size - limit <= 4e-16 * size:
            break
        s += size * size * (size - limit) / (limit * (x * x / (a + s) + y * y / (b + s)))
        x, y = f / (a + s), g / (b + s)
        size = np.sqrt(x * x + y * y)
    return x * (limit / size), y * (limit / size)
