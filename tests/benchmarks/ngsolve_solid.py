"""NGSolve in 3D: edge elements for the vector potential on our `Mesh3D`, the oracle of the scalar potential.

Vector and scalar potential err in opposite directions (the energy of B = curl A from above, the co-energy of
H = T0 - grad phi from above), so that two answers on one mesh also bracket the truth. Laws, damping and
tolerance are those of `ngsolve_oracle`.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
from ngsolve_oracle import ARMIJO, CHORD_B, MAX_HALVINGS, SOFTENING, Watch, by_law, law_spline

from field.laws.reluctivity import NU_0, Law, LinearLaw
from geometry.mesh_3d import EDGES, Mesh3D
from geometry.meshing_3d import faces_of


def mesh_3d(mesh: Mesh3D) -> Any:
    """The same tetrahedra as a mesh of NGSolve, regions and outer boundaries by the same names.

    Faces of the outline that the mesh does not name are `outline`. Second-order elements become a deformation
    of straight ones, which is the same map.
    """
    from netgen.meshing import FaceDescriptor
    from netgen.meshing import Mesh as NetgenMesh
    from ngsolve import Mesh

    ng = NetgenMesh(dim=3)
    ng.AddPoints(np.ascontiguousarray(mesh.points[: mesh.n_corners]))
    for number, (name, faces) in enumerate(_solid_outline(mesh).items(), start=1):
        ng.Add(FaceDescriptor(surfnr=number, domin=1, domout=0, bc=number))
        ng.SetBCName(number - 1, name)
        ng.AddElements(dim=2, index=number, data=faces.astype(np.int32), base=0)
    for number, (name, elements) in enumerate(mesh.regions.items(), start=1):
        ng.SetMaterial(number, name)
        ng.AddElements(dim=3, index=number, data=mesh.tetrahedra[elements].astype(np.int32), base=0)
    if mesh.periodic is not None:
        # An edge is matched if both its ends are: a node on the axis is its own partner.
        sides = np.intersect1d(mesh.boundaries["low_side"], mesh.boundaries["high_side"])
        for slave, master in [*mesh.periodic.tolist(), *np.column_stack((sides, sides)).tolist()]:
            ng.AddPointIdentification(master + 1, slave + 1, identnr=1)
    result = Mesh(ng)
    if mesh.second_order is not None:
        _bend(result, mesh)
    return result


def _solid_outline(mesh: Mesh3D) -> dict[str, np.ndarray]:
    """Outward faces of the outline by the boundary that they belong to."""
    faces, sides = faces_of(mesh.tetrahedra)
    outline = faces[sides[:, 1] < 0]
    base = mesh.n_corners

    def key(triples: np.ndarray) -> np.ndarray:
        ordered = np.sort(triples, axis=1)
        return (ordered[:, 0] * base + ordered[:, 1]) * base + ordered[:, 2]

    keys, found = key(outline), {}
    rest = np.ones(len(outline), dtype=bool)
    for name, triples in mesh.boundaries.items():
        here = rest & np.isin(keys, key(triples))
        if here.any():
            found[name] = outline[here]
            rest &= ~here
    if rest.any():
        found["outline"] = outline[rest]
    return found


def _bend(ng_mesh: Any, mesh: Mesh3D) -> None:
    """Deform straight elements by the displacement of their edges' middles."""
    import ngsolve as ngs

    assert mesh.second_order is not None
    ends = np.sort(mesh.second_order[:, EDGES].reshape(-1, 2), axis=1)
    keys, first = np.unique(ends[:, 0] * mesh.n_corners + ends[:, 1], return_index=True)
    middle = mesh.points[mesh.second_order[:, 4:].ravel()[first]]
    shift = middle - mesh.points[ends[first]].mean(axis=1)
    space = ngs.VectorH1(ng_mesh, order=2)
    deformation = ngs.GridFunction(space)
    vertices = np.array([[v.nr for v in edge.vertices] for edge in ng_mesh.edges])
    vertices.sort(axis=1)
    where = np.searchsorted(keys, vertices[:, 0] * mesh.n_corners + vertices[:, 1])
    values = np.zeros((3, ng_mesh.nv + ng_mesh.nedge))
    # NGSolve's quadratic edge function in its own scaling: the value at the middle of the first edge.
    probe = ngs.GridFunction(ngs.H1(ng_mesh, order=2))
    probe.vec[ng_mesh.nv] = 1.0
    a, b = mesh.points[vertices[0]]
    inside = 0.5 * (a + b) + 1e-9 * (_beside(ng_mesh, mesh, vertices[0]) - 0.5 * (a + b))
    peak = probe(ng_mesh(*inside))
    values[:, ng_mesh.nv :] = (shift[where] / peak).T
    deformation.vec.FV().NumPy()[:] = values.ravel()
    ng_mesh.SetDeformation(deformation)
    ng_mesh.emclutch_deformation = deformation  # SetDeformation keeps no reference of its own


def _beside(ng_mesh: Any, mesh: Mesh3D, edge: np.ndarray) -> np.ndarray:
    """Centre of an element at an edge."""
    at_edge = np.isin(mesh.tetrahedra, edge).sum(axis=1) == 2
    return mesh.points[mesh.tetrahedra[np.argmax(at_edge)]].mean(axis=0)


def solve_3d(
    mesh: Mesh3D,
    laws: Mapping[str, Law],
    coil: Any,
    ampere_turns: float,
    order: int = 2,
    tolerance: float = 1e-8,
    *,
    flux_walls: str = "low_side|high_side|outer",
    bodies: tuple[str, ...] = (),
    threads: int | None = None,
    regularisation: float = 1e-6,
    linear_tolerance: float = 1e-4,
    max_iterations: int = 40,
) -> dict[str, Any]:
    """The nonlinear field in 3D by NGSolve's edge elements, B = curl A.

    Conjugate gradients with the BDDC preconditioner; instead of a gauge A gets a small mass, `regularisation`
    nu_0 [1/m^2].

    Parameters
    ----------
    mesh : Mesh3D
    laws : mapping of str to Law
        Regions that are not named are air.
    coil : object
        half_length_x, half_length_y, corner_radius, width, z_range [m] of the region `coil`, as in
        `field.three_d.current_source.FlatCoil`.
    ampere_turns : float
        N I [A], anticlockwise seen from +z.
    order : int
        Of the edge elements (without gradients of higher order).
    tolerance : float
        Residual over the norm of the source.
    flux_walls : str
        Boundaries with B . n = 0 (the others: H tangential = 0); of a periodic sector the sides are left out.
    bodies : tuple of str
        Bodies in air to give force and torque of, each a region or several joined by ``|``.

    Returns
    -------
    dict
        dofs, seconds_setup, seconds_assemble, seconds_factor (preconditioner and iterations), seconds_total,
        newton_steps, residuals, linear_iterations, flux_linkage_per_turn [Wb], energy [J], forces and torques
        {body: (3,)} about the origin [N], [N m] (one layer of elements around the body), B, A (functions of
        NGSolve) and ng_mesh. Integrals are those of the whole machine, forces summed over mirrored or turned
        copies: of a sector only the axial components mean something.
    """
    import ngsolve as ngs

    watch = Watch()
    ng_mesh = mesh_3d(mesh)
    seconds_mesh = watch.lap()
    if threads is not None:
        ngs.SetNumThreads(threads)
    with ngs.TaskManager():
        watch.lap()
        present = [name for name in flux_walls.split("|") if name in set(ng_mesh.GetBoundaries())]
        if mesh.periodic is not None:
            present = [name for name in present if name not in ("low_side", "high_side")]
        space = ngs.HCurl(ng_mesh, order=order, nograds=True, dirichlet="|".join(present))
        if mesh.periodic is not None:
            space = ngs.Periodic(space)
        A = ngs.GridFunction(space)
        energy = _Energy3D(space, A, laws, regularisation)
        T0 = ampere_turns * unit_source(coil)
        load = ngs.LinearForm(T0 * ngs.curl(space.TestFunction()) * ngs.dx(bonus_intorder=2)).Assemble()
        seconds_setup = watch.lap()
        history, times, iterations = _newton_krylov(energy, A, load.vec, tolerance, linear_tolerance, max_iterations)
        seconds_solve = watch.lap()
        linkage = float(ngs.InnerProduct(load.vec, A.vec)) / ampere_turns
        stored = energy.value(mass=False)
        shells = {body: _shell_force(ng_mesh, ngs.curl(A), body) for body in bodies}
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
        "linear_iterations": iterations,
        "flux_linkage_per_turn": mesh.n_sectors * linkage,
        "energy": mesh.n_sectors * stored,
        "forces": {body: mesh.n_sectors * force for body, (force, _) in shells.items()},
        "torques": {body: mesh.n_sectors * torque for body, (_, torque) in shells.items()},
        "B": ngs.curl(A),
        "A": A,
        "ng_mesh": ng_mesh,
    }


def unit_source(coil: Any) -> Any:
    """T0 = e_z T [A/m per A] with curl T0 = J, the current density of one ampere-turn.

    The load integral of T0 . curl v has no part along gradients, whatever the mesh; that of J . v has one
    where the coil's outline is curved, and the small mass would answer it with a large A.
    """
    import ngsolve as ngs

    def positive(f: Any) -> Any:
        return ngs.IfPos(f, f, 0.0)

    u = ngs.IfPos(ngs.x, ngs.x, -ngs.x) - (coil.half_length_x - coil.corner_radius)
    v = ngs.IfPos(ngs.y, ngs.y, -ngs.y) - (coil.half_length_y - coil.corner_radius)
    larger = ngs.IfPos(u - v, u, v)
    outside = ngs.sqrt(positive(u) * positive(u) + positive(v) * positive(v)) + ngs.IfPos(larger, 0.0, larger)
    depth = (coil.corner_radius - outside) / coil.width
    low, high = coil.z_range
    within = ngs.IfPos(ngs.z - low, ngs.IfPos(high - ngs.z, 1.0, 0.0), 0.0)
    plateau = ngs.IfPos(depth, ngs.IfPos(depth - 1.0, 1.0, depth), 0.0)
    return ngs.CF((0.0, 0.0, within * plateau / (high - low)))


class _Energy3D:
    """Energy, residual and tangent of integral w(|curl A|) + mass/2 |A|^2, at the state A."""

    def __init__(self, space: Any, A: Any, laws: Mapping[str, Law], regularisation: float) -> None:
        import ngsolve as ngs

        u, v = space.TnT()
        curl, flux = ngs.curl, ngs.curl(A)
        B = ngs.sqrt(flux * flux + SOFTENING)
        mass = regularisation * NU_0
        rule = {ngs.ET.TET: ngs.IntegrationRule(ngs.ET.TET, 2 * space.globalorder)}
        everywhere = ngs.dx(intrules=rule)
        self._tangent = ngs.BilinearForm(space, symmetric=True)
        self._chord = ngs.BilinearForm(space, symmetric=True)
        self._residual = ngs.LinearForm(space)
        self._densities: list[Any] = []
        for form in (self._tangent, self._chord):
            form += mass * u * v * everywhere
        self._residual += mass * A * v * everywhere
        self._mass = (0.5 * mass * A * A) * everywhere
        for law, names in by_law(laws, space.mesh.GetMaterials()):
            dx = ngs.dx(definedon=space.mesh.Materials("|".join(names)), intrules=rule)
            nu_chord = float(law.H_of_B(np.array([CHORD_B]))[0][0]) / CHORD_B
            self._chord += nu_chord * curl(u) * curl(v) * dx
            if isinstance(law, LinearLaw):
                nu = NU_0 / law.mu_r
                self._tangent += nu * curl(u) * curl(v) * dx
                self._residual += (nu * flux * curl(v)).Compile() * dx
                self._densities.append((0.5 * nu * flux * flux).Compile() * dx)
                continue
            spline = law_spline(law)
            nu = spline(B) / B
            along = (spline.Differentiate()(B) - nu) / (B * B)
            self._tangent += (nu * curl(u) * curl(v) + along * (flux * curl(u)) * (flux * curl(v))).Compile() * dx
            self._residual += (nu * flux * curl(v)).Compile() * dx
            self._densities.append(spline.Integrate()(B).Compile() * dx)
        self._preconditioners = {id(form): ngs.Preconditioner(form, "bddc") for form in (self._chord, self._tangent)}
        self.space = space

    def value(self, mass: bool = True) -> float:
        """Energy of the mesh [J], with or without that of the mass."""
        import ngsolve as ngs

        densities = [*self._densities, self._mass] if mass else self._densities
        return float(sum(ngs.Integrate(density, self.space.mesh) for density in densities))

    def gradient(self, out: Any) -> None:
        """Derivative of the energy for every unknown."""
        out.data = self._residual.Assemble().vec

    def matrix(self, chord: bool) -> tuple[Any, Any]:
        """Chord or tangent matrix, and its preconditioner."""
        form = (self._chord if chord else self._tangent).Assemble()
        return form.mat, self._preconditioners[id(form)].mat


def _newton_krylov(
    energy: _Energy3D, solution: Any, load: Any, tolerance: float, linear_tolerance: float, max_iterations: int
) -> tuple[list[float], dict[str, float], list[int]]:
    """Damped Newton from zero, each step by conjugate gradients; residuals, seconds by phase, iterations."""
    import ngsolve as ngs
    from ngsolve.krylovspace import CGSolver

    project = ngs.Projector(energy.space.FreeDofs(), True)
    x, residual, step = (solution.vec.CreateVector() for _ in range(3))
    x[:] = 0.0
    solution.vec[:] = 0.0
    times, iterations = {"assemble": 0.0, "factor": 0.0}, []
    watch = Watch()
    step.data = load
    project.Project(step)
    scale = float(step.Norm())
    value, history = 0.0, [1.0]
    residual.data = -1.0 * step
    while history[-1] > tolerance:
        if len(history) > max_iterations:
            raise RuntimeError(f"NGSolve's Newton iteration stopped at a relative residual of {history[-1]:.2e}")
        matrix, preconditioner = energy.matrix(chord=len(history) == 1)
        times["assemble"] += watch.lap()
        # near the end no more digits than asked for
        precision = max(linear_tolerance, 0.1 * tolerance / history[-1])
        solver = CGSolver(mat=matrix, pre=preconditioner, tol=precision, maxiter=3000)
        step.data = solver * residual
        iterations.append(solver.iterations)
        times["factor"] += watch.lap()
        slope = -float(ngs.InnerProduct(residual, step))
        length = 1.0
        for _ in range(MAX_HALVINGS):
            solution.vec.data = x - length * step
            new = energy.value() - float(ngs.InnerProduct(load, solution.vec))
            # the energy of the mass on gradients costs digits: 1e-12 where the section has 1e-13
            if new <= value + ARMIJO * length * slope + 1e-12 * abs(value):
                break
            length *= 0.5
        x.data, value = solution.vec, new
        energy.gradient(residual)
        residual.data -= load
        project.Project(residual)
        history.append(float(residual.Norm()) / scale)
        times["assemble"] += watch.lap()
    return history, times, iterations


def _shell_force(ng_mesh: Any, B: Any, body: str) -> tuple[np.ndarray, np.ndarray]:
    """Force and torque on a body by the stress in the layer of elements around it, all of it air.

    F = -integral of T grad g, g falling from 1 at the body's nodes to 0 at all others: the derivative of the
    discrete energy when the layer is strained (Coulomb 1983).
    """
    import ngsolve as ngs

    space = ngs.H1(ng_mesh, order=1)
    g = ngs.GridFunction(space)
    region = ng_mesh.Materials(body)
    dofs = space.GetDofs(region)
    g.vec.FV().NumPy()[:] = np.array(list(dofs), dtype=float)
    slope = ngs.grad(g)
    traction = NU_0 * (B * (B * slope) - 0.5 * (B * B) * slope)
    moment = ngs.Cross(ngs.CF((ngs.x, ngs.y, ngs.z)), traction)
    around = ngs.dx(definedon=~region, bonus_intorder=2)

    def over_layer(part: Any) -> np.ndarray:
        return -np.array([ngs.Integrate(part[i] * around, ng_mesh) for i in range(3)])

    return over_layer(traction), over_layer(moment)
