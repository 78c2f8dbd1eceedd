"""The weak forms of the section's field in scikit-fem's notation: what `section_elements` computes, as on the board.

With psi = r A_phi, B = |grad psi|/r and a law H(B), find psi such that for all v that vanish where psi is fixed

    integral (H(B)/B) (1/r) grad psi . grad v dr dz  =  integral J v dr dz,

and the derivative with respect to psi, for Newton's method, with the unit vector d along grad psi,

    integral (1/r) [ (H/B) grad u . grad v + (dH/dB - H/B) (d . grad u)(d . grad v) ] dr dz.

A run assembles them with compiled kernels, into one fixed pattern; these definitions are what the kernels are tested
against, to round-off. Each returns a form for ``form.assemble(basis, psi=...)`` with psi as
nodal values, on a basis that integrates with the rule of `section_elements.QUADRATURE_ORDER`.
"""

from __future__ import annotations

import numpy as np
from skfem import BilinearForm, LinearForm
from skfem.helpers import dot, grad

from field.laws.reluctivity import Law


def field_force(law: Law) -> LinearForm:
    """The left-hand side at the state ``psi`` [Wb/rad]: `SectionElements.field_force`."""

    @LinearForm
    def form(v, w):
        r = w.x[0]
        B = np.sqrt(dot(grad(w.psi), grad(w.psi))) / r
        H, _ = law.H_of_B(B)
        return H / B / r * dot(grad(w.psi), grad(v))

    return form


def field_tangent(law: Law) -> BilinearForm:
    """Its derivative at a state ``psi`` [Wb/rad] whose gradient vanishes nowhere: `SectionElements.field_tangent`."""

    @BilinearForm
    def form(u, v, w):
        r = w.x[0]
        size = np.sqrt(dot(grad(w.psi), grad(w.psi)))
        d, B = grad(w.psi) / size, size / r
        H, slope = law.H_of_B(B)
        return (H / B * dot(grad(u), grad(v)) + (slope - H / B) * dot(d, grad(u)) * dot(d, grad(v))) / r

    return form


@LinearForm
def load(v, w):
    """The right-hand side of a current density ``J`` [A/m^2] at the quadrature points: `SectionElements.load`."""
    return w.J * v
