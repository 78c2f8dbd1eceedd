"""Benchmarks report, they do not gate: seconds, ratios and the machine they belong to, in one run (`make bench -s`).

Each test asserts only that what was timed is right.
"""

import os
import platform
from time import perf_counter

import numba
import numpy as np
import pytest

from field import AxisymmetricProblem, GrainLaw, PowderLaw, material
from geometry import Box, Clutch, mesh_clutch
from particles import DEM, Body, Grains, LinearContact, choose_time_step, pack


@pytest.fixture(scope="module", autouse=True)
def machine():
    print(f"\n{platform.processor() or platform.machine()}, {os.cpu_count()} cores, numba {numba.__version__}")


def best(function, rounds=5):
    times = []
    for _ in range(rounds):
        begin = perf_counter()
        function()
        times.append(perf_counter() - begin)
    return min(times)


def settled_bed(n, d=1e-3):
    side = (n * np.pi / 6 * d**3 / 0.45) ** (1 / 3)
    box = Box((side, side, side))
    grains = Grains.create(pack(box, box.walls(), n, d / 2, seed=1), d / 2, 7850.0)
    contact = LinearContact.from_restitution(1000.0, 0.5, 0.3)
    dt = choose_time_step(contact, grains.mass, grains.radius).dt
    dem = DEM(grains, box.walls(), [Body("housing")], contact, dt=dt, gravity=(0, 0, -9.81))
    dem.run(2000)
    return dem


@pytest.mark.parametrize("n", [1000, 10_000])
def test_particle_steps(n):
    """Nanoseconds a grain and step in a dense bed, 1 and 2 threads."""
    dem, steps = settled_bed(n), 400_000 // n
    available = numba.config.NUMBA_NUM_THREADS
    for threads in range(1, min(2, available) + 1):
        numba.set_num_threads(threads)
        seconds = best(lambda: dem.run(steps))
        print(f"{n} grains, {threads} thread(s): {seconds / steps / n * 1e9:.0f} ns a grain and step, "
              f"{2 * dem.run(1).n_contacts / n:.1f} contacts a grain")  # fmt: skip
    numba.set_num_threads(available)
    assert np.isfinite(dem.grains.position).all()


def test_field_solve_and_sampling():
    """Cold and warm solve of the 12 N m class section, and sampling against scikit-fem's own point evaluation."""
    clutch = Clutch()
    mesh = mesh_clutch(clutch)
    names = {"disc": "steel_1010", "rotor": "steel_1010", "housing": "steel_1010"}
    laws = {region: material(names.get(region, "air")) for region in mesh.regions if region not in ("powder", "coil")}
    problem = AxisymmetricProblem(mesh, laws, powder_law=PowderLaw(GrainLaw(200.0, 1.3e6)))
    fill = np.full(problem.powder_elements.size, 0.3)
    problem.solve(600.0, fill)
    begin = perf_counter()
    solution = problem.solve(640.0, fill)
    cold = perf_counter() - begin
    begin = perf_counter()
    problem.solve(640.0, fill * 1.02, guess=solution)
    warm = perf_counter() - begin
    sampler = solution.sampler()
    rng = np.random.default_rng(0)
    points = np.column_stack([rng.uniform(44.6e-3, 45.4e-3, 100_000), np.zeros(100_000),
                              rng.uniform(-14e-3, 14e-3, 100_000)])  # fmt: skip
    sampler.sample(points)
    ours = best(lambda: sampler.sample(points)) / len(points)
    import skfem

    few = points[:500, [0, 2]].T
    skfem_mesh = skfem.MeshTri(mesh.points.T, mesh.triangles.T)
    basis = skfem.Basis(skfem_mesh, skfem.ElementTriP2())
    theirs = best(lambda: basis.probes(few) @ np.zeros(basis.N), 2) / 500
    print(f"{problem.n_dofs} dofs: cold {cold:.2f} s ({len(solution.newton) - 1} Newton steps), warm {warm:.3f} s; "
          f"H and grad H {ours * 1e9:.0f} ns a point, scikit-fem's probes {theirs * 1e9:.0f} ns for psi alone "
          f"(ratio {theirs / ours:.0f})")  # fmt: skip
    assert solution.newton[-1][0] < 1e-8
