"""NGSolve on our meshes: an independent oracle of the field, and the peer that our speed is measured against.

Written as a good user of NGSolve would: compiled forms, assembled on all threads of a `TaskManager`, linear
regions once; NGSolve's sparse Cholesky, ordered once; and the same damped Newton iteration as ours (first
step with the chord H/B at 1 T, then the tangent; Armijo's rule on the energy; the residual over the norm of
the source). What is independent is all below that: shape functions, quadrature, assembly, factorisation.

The laws enter as cubic B-splines that are exactly the cubics of `HSpline`, energy and slope by NGSolve's
own integration and differentiation of the spline. The same in 3D: `ngsolve_solid`.
"""

from __future__ import annotations

import math
import time
from collections.abc import Mapping
from typing import Any

import numpy as np

from field.laws.reluctivity import NU_0, Law, LinearLaw
from geometry.section import SectionMesh

# sqrt has no second derivative at 0: |B| is softened by 1 nT, of no consequence beside 1e-8 of a tesla.
SOFTENING = 1e-18
_B_FAR = 50.0  # the spline's last knot [T]; beyond the law's own table its slope is that of vacuum
CHORD_B = 1.0  # [T], as in field.section.axisymmetric
ARMIJO = 1e-4
MAX_HALVINGS = 30


def law_spline(law: Law) -> Any:
    """H(B) of a law as a cubic B-spline of NGSolve, exact for laws that are an `HSpline`.

    Every break point is a triple knot, so that the control points of the spline are the Bezier points of the
    single cubics: the slope may jump, as it does where a table ends.
    """
    from ngsolve import BSpline

    curve = getattr(law, "curve", None)
    B = np.linspace(0.0, 4.0, 2001) if curve is None else np.asarray(curve.B)
    H, left, right = _end_values(law, B)
    width = np.diff(B)
    control = np.column_stack((H[:-1], H[:-1] + width * left / 3.0, H[1:] - width * right / 3.0)).ravel()
    far = H[-1] + NU_0 * (_B_FAR - B[-1])
    thirds = np.linspace(H[-1], far, 4)
    control = np.concatenate((control, thirds))
    knots = np.concatenate((B[:1], np.repeat(np.append(B, _B_FAR), 3), [_B_FAR]))
    return BSpline(4, knots.tolist(), control.tolist())


def _end_values(law: Law, B: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """H at the break points, and dH/dB at the left and at the right end of every interval."""
    H, slope = law.H_of_B(B)
    curve = getattr(law, "curve", None)
    if curve is None:
        return H, slope[:-1], slope[1:]
    c3, c2, c1, c0 = curve.coefficients
    width = np.diff(B)
    return np.append(c0, curve.H_last), c1, (3.0 * c3 * width + 2.0 * c2) * width + c1


def section_mesh(mesh: SectionMesh) -> Any:
    """The same triangles as a mesh of NGSolve, regions and boundaries by the same names.

    The axis is the boundary `axis` whether the section names it or not.
    """
    from netgen.meshing import FaceDescriptor
    from netgen.meshing import Mesh as NetgenMesh
    from ngsolve import Mesh

    ng = NetgenMesh(dim=2)
    ng.AddPoints(np.column_stack((mesh.points, np.zeros(len(mesh.points)))))
    for number, (name, elements) in enumerate(mesh.regions.items(), start=1):
        ng.Add(FaceDescriptor(surfnr=number, domin=number, bc=number))
        ng.SetMaterial(number, name)
        ng.AddElements(dim=2, index=number, data=mesh.triangles[elements].astype(np.int32), base=0)
    for number, (name, edges) in enumerate(_section_boundaries(mesh).items(), start=1):
        ng.AddElements(dim=1, index=number, data=edges.astype(np.int32), base=0)
        ng.SetBCName(number - 1, name)
    return Mesh(ng)


def _section_boundaries(mesh: SectionMesh) -> dict[str, np.ndarray]:
    """The outline of the section as `axis` and `outer`."""
    edges = np.sort(mesh.triangles[:, [0, 1, 1, 2, 2, 0]].reshape(-1, 2), axis=1)
    edges, uses = np.unique(edges, axis=0, return_counts=True)
    outline = edges[uses == 1]
    on_axis = np.all(mesh.points[outline, 0] <= 1e-12 * mesh.points[:, 0].max(), axis=1)
    return {"axis": outline[on_axis], "outer": outline[~on_axis]}


def solve_section(
    mesh: SectionMesh,
    laws: Mapping[str, Law],
    ampere_turns: float,
    order: int = 2,
    tolerance: float = 1e-8,
    *,
    threads: int | None = None,
    inverse: str = "sparsecholesky",
    max_iterations: int = 30,
) -> dict[str, Any]:
    """The nonlinear axisymmetric field of a coil current by NGSolve, psi = r A_phi.

    Parameters
    ----------
    mesh : SectionMesh
        With regions named as in `laws`; the region `coil` carries the current.
    laws : mapping of str to Law
        Regions that are not named are air.
    ampere_turns : float
        N I of the coil [A].
    order : int
        Order of the elements for psi.
    tolerance : float
        Residual over the norm of the source.
    threads : int or None
        Threads of the TaskManager; None: all that NGSolve sees.
    inverse : str
        Direct solver: "sparsecholesky" or "umfpack".

    Returns
    -------
    dict
        dofs; seconds_mesh (the conversion, in no other sum); seconds_setup (space, forms, pattern);
        seconds_assemble (matrices, residuals, energies); seconds_factor (factorisation and back-substitution);
        seconds_solve (the Newton iteration); seconds_total = setup + solve; newton_steps; residuals (relative,
        one a step, the start first); flux_linkage_per_turn [Wb]; energy [J]; psi (GridFunction), ng_mesh.
    """
    import ngsolve as ngs

    watch = Watch()
    ng_mesh = section_mesh(mesh)
    seconds_mesh = watch.lap()
    if threads is not None:
        ngs.SetNumThreads(threads)
    with ngs.TaskManager():
        watch.lap()
        space = ngs.H1(ng_mesh, order=order, dirichlet="axis|outer")
        v = space.TestFunction()
        psi = ngs.GridFunction(space)
        energy = SectionEnergy(space, psi, laws)
        coil = ng_mesh.Materials("coil")
        area = ngs.Integrate(ngs.CF(1.0), coil, order=1)
        load = ngs.LinearForm(ampere_turns / area * v * ngs.dx(definedon=coil)).Assemble()
        seconds_setup = watch.lap()
        history, times = _newton(energy, psi, load.vec, tolerance, max_iterations, inverse)
        seconds_solve = watch.lap()
        mean_psi = ngs.InnerProduct(load.vec, psi.vec) / ampere_turns
        stored = 2.0 * math.pi * energy.value()
    return {
        "dofs": space.ndof,
        "seconds_mesh": seconds_mesh,
        "seconds_setup": seconds_setup,
        "seconds_assemble": times["assemble"],
        "seconds_factor": times["factor"],
        "seconds_solve": seconds_solve,
        "seconds_total": seconds_setup + seconds_solve,
        "newton_steps": len(history) - 1,
        "residuals": history,
        "flux_linkage_per_turn": 2.0 * math.pi * mean_psi,
        "energy": stored,
        "psi": psi,
        "ng_mesh": ng_mesh,
    }


class SectionEnergy:
    """Energy, residual and tangent of integral r w(|grad psi|/r) over the section, at the state psi.

    Faster than NGSolve's automatic second derivative of the energy, about twice: the curve is evaluated once
    a quadrature point, and the matrix of the linear regions is assembled once.
    """

    def __init__(self, space: Any, psi: Any, laws: Mapping[str, Law]) -> None:
        import ngsolve as ngs

        u, v = space.TnT()
        r, grad, flux = ngs.x, ngs.grad, ngs.grad(psi)
        B = ngs.sqrt(flux * flux / (r * r) + SOFTENING)
        self._linear = ngs.BilinearForm(space, symmetric=True)
        self._curved = ngs.BilinearForm(space, symmetric=True)
        self._chord = ngs.BilinearForm(space, symmetric=True)
        self._residual = ngs.LinearForm(space)
        self._densities: list[Any] = []
        # Our rules' order; the same for energy, residual and tangent, or Newton would not be one. NGSolve's
        # default differs between the three, and its rule of order 2 has points on the axis.
        rule = {ngs.ET.TRIG: ngs.IntegrationRule(ngs.ET.TRIG, max(2 * space.globalorder, 3))}
        one_point = {ngs.ET.TRIG: ngs.IntegrationRule(ngs.ET.TRIG, 0)}
        for law, names in by_law(laws, space.mesh.GetMaterials()):
            region = space.mesh.Materials("|".join(names))
            dx = ngs.dx(definedon=region, intrules=rule)
            # The sum of two matrices needs one pattern: an entry that adds nothing for the others' elements.
            nothing = ngs.CF(1e-300) * u * v * ngs.dx(definedon=region, intrules=one_point)
            H_chord = float(law.H_of_B(np.array([CHORD_B]))[0][0])
            self._chord += (H_chord / CHORD_B / r * grad(u) * grad(v)).Compile() * dx
            if isinstance(law, LinearLaw):
                self._linear += (NU_0 / law.mu_r / r * grad(u) * grad(v)).Compile() * dx
                self._curved += nothing
                continue
            spline = law_spline(law)
            nu = spline(B) / B
            along = (spline.Differentiate()(B) - nu) / (r * r * r * B * B)
            tangent = nu / r * grad(u) * grad(v) + along * (flux * grad(u)) * (flux * grad(v))
            self._linear += nothing
            self._curved += tangent.Compile() * dx
            self._residual += (nu / r * flux * grad(v)).Compile() * dx
            self._densities.append((spline.Integrate()(B) * r).Compile() * dx)
        self._linear.Assemble()
        self.space, self._psi = space, psi

    def value(self) -> float:
        """Stored energy over the section [J/rad]."""
        import ngsolve as ngs

        product = self._psi.vec.CreateVector()
        product.data = self._linear.mat * self._psi.vec
        curved = sum(ngs.Integrate(density, self.space.mesh) for density in self._densities)
        return 0.5 * float(ngs.InnerProduct(product, self._psi.vec)) + float(curved)

    def gradient(self, out: Any) -> None:
        """Derivative of the energy for every unknown."""
        self._residual.Assemble()
        out.data = self._residual.vec
        out.data += self._linear.mat * self._psi.vec

    def chord_matrix(self) -> Any:
        """The matrix with H/B of each law at 1 T."""
        return self._chord.Assemble().mat

    def tangent_into(self, matrix: Any) -> None:
        """Overwrite a matrix of the same pattern by the second derivative."""
        self._curved.Assemble()
        matrix.AsVector().data = self._curved.mat.AsVector() + self._linear.mat.AsVector()


def by_law(laws: Mapping[str, Law], materials: Any) -> list[tuple[Law, list[str]]]:
    """Regions that share a law, so that the compiled form is one; air where no law is given."""
    air = LinearLaw(1.0, "air")
    groups: dict[int, tuple[Law, list[str]]] = {}
    for name in dict.fromkeys(materials):
        law = laws.get(name, air)
        groups.setdefault(id(law), (law, []))[1].append(name)
    return list(groups.values())


def _newton(
    energy: Any, solution: Any, load: Any, tolerance: float, max_iterations: int, inverse: str
) -> tuple[list[float], dict[str, float]]:
    """Damped Newton from zero with a direct solver; relative residuals, the start's first, and seconds by phase.

    One matrix and one factor are kept: sparse Cholesky's `Update` skips the ordering.
    """
    import ngsolve as ngs

    free = energy.space.FreeDofs()
    project = ngs.Projector(free, True)
    x, residual, step = (solution.vec.CreateVector() for _ in range(3))
    x[:] = 0.0
    solution.vec[:] = 0.0
    times = {"assemble": 0.0, "factor": 0.0}
    watch = Watch()

    def relative_residual() -> float:
        energy.gradient(residual)
        residual.data -= load
        project.Project(residual)
        return float(residual.Norm()) / scale

    step.data = load
    project.Project(step)
    scale = float(step.Norm())
    history = [relative_residual()]
    value = 0.0
    matrix = energy.chord_matrix()
    times["assemble"] += watch.lap()
    factor = matrix.Inverse(free, inverse=inverse)
    while history[-1] > tolerance:
        if len(history) > max_iterations:
            raise RuntimeError(f"NGSolve's Newton iteration stopped at a relative residual of {history[-1]:.2e}")
        if len(history) > 1:
            energy.tangent_into(matrix)
            times["assemble"] += watch.lap()
            if inverse == "sparsecholesky":
                factor.Update()
            else:
                factor = matrix.Inverse(free, inverse=inverse)
        step.data = factor * residual
        times["factor"] += watch.lap()
        slope = -float(ngs.InnerProduct(residual, step))
        length = 1.0
        for _ in range(MAX_HALVINGS):
            solution.vec.data = x - length * step
            new = energy.value() - float(ngs.InnerProduct(load, solution.vec))
            if new <= value + ARMIJO * length * slope + 1e-13 * abs(value):
                break
            length *= 0.5
        x.data, value = solution.vec, new
        history.append(relative_residual())
        times["assemble"] += watch.lap()
    return history, times


class Watch:
    """A stopwatch that is read lap by lap."""

    def __init__(self) -> None:
        self._last = time.perf_counter()

    def lap(self) -> float:
        """Seconds since the last lap."""
        now = time.perf_counter()
        seconds, self._last = now - self._last, now
        return seconds
