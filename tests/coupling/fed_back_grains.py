"""Grains whose moments are fed back to a solved field, brought to the fixed point by hand; and all pairs of a ring."""

from dataclasses import dataclass

import numpy as np
from half_disc import half_disc

from coupling.effects import gradient_force
from coupling.grain_law_table import grain_table
from coupling.mutual_moments import Magnetisation, MutualMoments
from coupling.neighbour_rows import NeighbourRows, neighbour_rows
from coupling.powder_feedback import PowderFeedback
from coupling.powder_feedback_3d import PowderFeedback3D
from coupling.smear_region import elements_within, magnetic_regions
from coupling.wall_reflection import steel_walls
from field import MU_0, AxisymmetricProblem, GrainLaw, MagneticField, PowderLaw
from field.spheres.lone_sphere import sphere_magnetisation

IRON = GrainLaw(999.0, 1.7e6)
A = 1e-3
D = 2.0 * A


@dataclass(slots=True)
class FedBack:
    """Grains and field at their fixed point, or as far as they came."""

    feedback: PowderFeedback
    solver: MutualMoments
    solution: MagneticField
    state: Magnetisation
    rows: NeighbourRows
    position: np.ndarray
    radius: np.ndarray
    H: np.ndarray
    grad_H: np.ndarray
    residuals: list

    @property
    def moment(self):
        return self.state.moment

    @property
    def magnetisation(self):
        return self.state.moment / (4.0 / 3.0 * np.pi * self.radius[:, None] ** 3)

    @property
    def force(self):
        """Near fields, images and the solved field [N]."""
        near = self.solver.forces(self.position, self.radius, self.rows, self.state).force
        return near + gradient_force(self.state.dipole, self.grad_H)


def powder_problem(mesh, law, width, laws=None, order=2, **more):
    """Field problem whose powder reaches `width` [m] beyond its region."""
    laws = {} if laws is None else laws
    beyond = elements_within(mesh, magnetic_regions(laws), width)
    return AxisymmetricProblem(mesh, laws, powder_law=PowderLaw(law), powder_beyond=beyond, order=order, **more)


def fed_back(
    problem, law, position, radius, width, *, model="mutual", sector=None, walls=(), ampere_turns=0.0,
    boundary_field=0.0, solves=40, agree=1e-7, tolerance=1e-9, start=None, carrier=None,
):  # fmt: skip
    """Field and moments in turns until the deposited magnetisation is the solved one to `agree`.

    With a `carrier` the problem is one in 3D. `start` (n, 3): moments of lone dipoles to begin with [A m^2].
    """
    radius = np.broadcast_to(np.asarray(radius, dtype=float), (len(position),)).copy()
    volume = 4.0 / 3.0 * np.pi * radius**3
    angle = 2.0 * np.pi if sector is None else sector.angle
    kind = PowderFeedback if carrier is None else PowderFeedback3D
    feedback = kind(problem, law, width, angle, walls, carrier)
    more = {"boundary_field": boundary_field} if carrier is None else {}
    solver = MutualMoments(grain_table(law, model), near=model == "near_field", reach=width, smear=True)
    rows = neighbour_rows(position, width, sector)
    moment, dipole, necks, solution, state, residuals = start, start, None, None, None, []
    for _ in range(solves):
        feedback.deposit(position, volume, moment, solution)
        if solution is not None:
            residuals.append(feedback.residual.total)
            if residuals[-1] <= agree:
                break
        state = feedback.state(solution)
        solution = problem.solve(
            ampere_turns, state, guess=solution, tolerance=1e-10, **more
        )
        H, grad_H = feedback.sampler_after_solve(solution).sample(position)
        solver.walls = steel_walls(walls, solution)
        state = solver.solve(
            position, radius, H, rows, gradient=grad_H, start=dipole, necks=necks, tolerance=tolerance, max_sweeps=3000
        )  # fmt: skip
        moment, dipole, necks = state.moment, state.dipole, solver.necks_of(state)
    assert state is not None and solution is not None
    return FedBack(feedback, solver, solution, state, rows, position, radius, H, grad_H, residuals)


def turned(vectors, n):
    """(n, m, 3): the vectors (m, 3) in every sector of a ring of n."""
    angle = 2.0 * np.pi / n * np.arange(n)
    c, s = np.cos(angle)[:, None], np.sin(angle)[:, None]
    x, y, z = vectors.T
    return np.stack((c * x - s * y, s * x + c * y, np.broadcast_to(z, (n, len(z)))), axis=2)


def all_pairs(position, radius, law, H, n=1, *, images=lambda x: [(x, np.eye(3))], tolerance=1e-10):
    """Moments (m, 3) and forces (m, 3) of dipoles that magnetise one another, every pair of the ring of n whole.

    `images` gives the mirrored places (m, 3) of grains at x and the matrix of their moments, the grains themselves
    first. Dense matrices and a damped iteration: none of the code that is tested, but for the law of a lone sphere.
    """
    m = len(position)
    volume = 4.0 / 3.0 * np.pi * np.broadcast_to(radius, (m,)) ** 3
    matrix = np.zeros((m, 3, m, 3))
    slope = np.zeros((m, 3, 3, m, 3))  # dH_a/dx_b at i of the moment of j
    eye = np.eye(3)
    for k, (place, mirror) in enumerate(images(position)):
        for c, copy in enumerate(turned(place, n)):
            t = 2.0 * np.pi * c / n
            turn = np.array([[np.cos(t), -np.sin(t), 0.0], [np.sin(t), np.cos(t), 0.0], [0.0, 0.0, 1.0]]) @ mirror
            d = position[:, None, :] - copy[None, :, :]
            r = np.linalg.norm(d, axis=2)
            if k == 0 and c == 0:
                np.fill_diagonal(r, np.inf)
            e = d / r[:, :, None]
            w = 1.0 / (4.0 * np.pi * r**3)
            T = w[..., None, None] * (3.0 * e[..., :, None] * e[..., None, :] - eye)
            matrix += np.einsum("ijab,bc->iajc", T, turn)
            f = 3.0 * (w / r)[..., None, None, None]
            e_a, e_b, e_c = e[..., :, None, None], e[..., None, :, None], e[..., None, None, :]
            d_ab, d_ac, d_bc = eye[:, :, None], eye[:, None, :], eye[None, :, :]
            G = f * (d_ab * e_c + d_bc * e_a + d_ac * e_b - 5.0 * e_a * e_b * e_c)
            slope += np.einsum("ijabc,cd->iabjd", G, turn)
    moment, before, damping = np.zeros((m, 3)), np.inf, 0.5
    for _ in range(20000):
        S = H + np.einsum("iajc,jc->ia", matrix, moment)
        size = np.linalg.norm(S, axis=1)
        new = (volume * sphere_magnetisation(law, size) / np.where(size > 0.0, size, 1.0))[:, None] * S
        step = np.abs(new - moment).max() / np.abs(new).max()
        if step <= tolerance:
            break
        if step > 0.98 * before:
            damping = max(0.8 * damping, 0.02)
        before = step
        moment = moment + damping * (new - moment)
    assert step <= tolerance, step
    grad = np.einsum("iabjd,jd->iab", slope, moment)
    return moment, MU_0 * np.einsum("iab,ia->ib", grad, moment)


def ring_of(x, apart):
    """The clusters (m, 3) all around the axis, about `apart` [m] from each other: (m n, 3), cluster by grain; and n."""
    n = int(np.ceil(2.0 * np.pi * np.hypot(*x[0, :2]) / apart))
    return np.ascontiguousarray(turned(x, n).transpose(1, 0, 2).reshape(-1, 3)), n


def in_air(x, width, size=0.5 * D):
    """A problem of air around grains at x in a half plane, elements of `size` [m] where their smear is."""
    low, high = x.min(axis=0) - width - 0.5 * D, x.max(axis=0) + width + 0.5 * D
    box = (float(low[0]), float(high[0]), float(low[2]), float(high[2]))
    mesh = half_disc({"powder": box}, 1.3 * float(np.hypot(high[0], high[2])), size)
    return powder_problem(mesh, IRON, width, open_boundary=True)


def random_grains(n, radii, height, fill, seed):
    """Places (m, 3) of equal grains in a sector of a ring of n, |z| < height/2, none nearer than a diameter."""
    random = np.random.default_rng(seed)
    angle, (inner, outer) = 2.0 * np.pi / n, radii
    count = round(fill * 0.5 * angle * (outer**2 - inner**2) * height / (np.pi / 6.0 * D**3))
    x, seen = np.zeros((0, 3)), np.zeros((0, 3))
    while len(x) < count:
        r = np.sqrt(random.uniform((inner + A) ** 2, (outer - A) ** 2))
        t, z = random.uniform(0.0, angle), random.uniform(A - 0.5 * height, 0.5 * height - A)
        new = np.array([[r * np.cos(t), r * np.sin(t), z]])
        if len(x) == 0 or ((seen - new) ** 2).sum(axis=1).min() > D**2:
            x, seen = np.vstack((x, new)), np.vstack((seen, turned(new, n)[[0, 1, -1], 0]))
    return x
