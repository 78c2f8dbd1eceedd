"""The weak forms of the field in 3D, which scikit-fem assembles.

With H = T0 - grad phi and a law B(H), find phi such that for all v that vanish where phi is fixed

    integral B . grad v dV = 0,     B = B(|H|) H/|H|,

and the derivative with respect to phi, for Newton's method, but for its sign, with the unit vector d along H,

    integral (B/H) grad u . grad v + (dB/dH - B/H) (d . grad u)(d . grad v) dV.

Fields are given at the quadrature points of the basis.
"""

from __future__ import annotations

from skfem import BilinearForm, LinearForm
from skfem.helpers import dot, grad


@LinearForm
def divergence(v, w):
    """Of a ``flow`` (3, n_elements, n_quadrature)."""
    return dot(w.flow, grad(v))


@BilinearForm
def stiffness(u, v, w):
    """Of a permeability ``mu`` (n_elements, n_quadrature)."""
    return w.mu * dot(grad(u), grad(v))


@BilinearForm
def tangent(u, v, w):
    """Of ``mu`` = B/H, ``excess`` = dB/dH - B/H and ``direction`` d (3, n_elements, n_quadrature)."""
    return w.mu * dot(grad(u), grad(v)) + w.excess * dot(w.direction, grad(u)) * dot(w.direction, grad(v))
