"""H and grad H at points: nanoseconds a point against scikit-fem's probes, and what the recovery costs; no asserts
on time.  `pytest -s tests/benchmarks/test_sampling.py`.
"""

import os
import platform
from time import perf_counter

import numba
import numpy as np
import pytest

from field import AxisymmetricProblem, GrainLaw, PowderLaw, RecoveredSampler, material
from field.sampling.potential_table import TableSampler
from field.sampling.recovery import RegionRecovery
from geometry import Clutch, mesh_clutch

N = 100_000


def best(function, rounds=7):
    """Shortest of several runs [s]: other work on the machine only ever adds."""
    times = []
    for _ in range(rounds):
        begin = perf_counter()
        function()
        times.append(perf_counter() - begin)
    return min(times)


@pytest.fixture(scope="module")
def mesh():
    return mesh_clutch(Clutch())


def solve(mesh, order):
    steel = ("disc", "rotor", "housing")
    laws = {name: material("steel_1010" if name in steel else "air") for name in mesh.regions}
    laws = {name: law for name, law in laws.items() if name not in ("powder", "coil")}
    return AxisymmetricProblem(mesh, laws, powder_law=PowderLaw(GrainLaw(200.0, 1.3e6)), order=order).solve(600.0)


def positions(mesh):
    """Points all over the powder's region in random order."""
    points = mesh.points[mesh.triangles[mesh.regions["powder"]]]
    random = np.random.default_rng(0)
    element = random.choice(len(points), N, p=(area := triangle_area(points)) / area.sum())
    share = random.dirichlet(np.ones(3), N)
    r, z = np.einsum("nk,nki->ni", share, points[element]).T
    angle = random.uniform(0.0, 2.0 * np.pi, N)
    return np.column_stack((r * np.cos(angle), r * np.sin(angle), z))


def triangle_area(corner):
    u, v = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    return 0.5 * np.abs(u[:, 0] * v[:, 1] - u[:, 1] * v[:, 0])


@pytest.mark.parametrize("order", [2, 3])
def test_nanoseconds_a_point(mesh, order):
    field = solve(mesh, order)
    recovered = RecoveredSampler(field, "powder")
    table = TableSampler(recovered)
    scattered = positions(mesh)
    r = np.hypot(scattered[:, 0], scattered[:, 1])
    cell = np.floor(np.column_stack((r, scattered[:, 2])) / 0.3e-3)
    ordered = scattered[np.lexsort((cell[:, 0], cell[:, 1]))].copy()
    out = np.empty((N, 3)), np.empty((N, 3, 3))
    threads = [1, 2] if numba.config.NUMBA_NUM_THREADS > 1 else [1]

    import skfem

    few = np.column_stack((r, scattered[:, 2]))[:2000].T
    element = (skfem.ElementTriP2, skfem.ElementTriP3)[order - 2]()
    basis = skfem.Basis(skfem.MeshTri(mesh.points.T.copy(), mesh.triangles.T.copy()), element)
    probes = best(lambda: basis.probes(few) @ field.psi, 3) / few.shape[1]

    print(f"\n{platform.processor() or platform.machine()}, {os.cpu_count()} cores, load {os.getloadavg()[0]:.1f}; "
          f"P{order}, {field.problem.n_dofs} dofs, {N} points; H and grad H, ns a point "
          f"(scikit-fem's probes, psi alone: {probes * 1e9:.0f})")  # fmt: skip
    results = {}

    def line(name, sampler, points, forget=False):
        for n in threads:

            def once(n=n):
                if forget:
                    sampler._hint.fill(-1)
                results[name, n] = sampler.sample(points, out=out, threads=n)

            once()
            seconds = best(once) / N
            results[name, n] = tuple(part.copy() for part in out)
            print(f"  {name:<32s} {n} thread(s) {seconds * 1e9:6.1f} ns   {probes / seconds:6.0f} x probes")

    line("elements, remembered, random", recovered, scattered)
    line("elements, remembered, sorted", recovered, ordered)
    line("elements, forgotten, random", recovered, scattered, forget=True)
    line("elements, forgotten, sorted", recovered, ordered, forget=True)
    line("table, random", table, scattered)
    line("table, sorted", table, ordered)
    for name, n in results:
        assert all(np.array_equal(a, b) for a, b in zip(results[name, n], results[name, 1], strict=True)), name
    first = results["elements, remembered, random", 1], results["elements, forgotten, random", 1]
    assert np.array_equal(first[0][1], first[1][1])


@pytest.mark.parametrize("size_factor", [1.0, 0.6])
def test_seconds_of_the_recovery(size_factor):
    """Once a mesh, and again for every new field."""
    mesh = mesh_clutch(Clutch(), size_factor=size_factor)
    print()
    for order in (1, 2, 3):
        field = solve(mesh, order)
        RecoveredSampler(field, "powder")  # compiles
        elements, region = field.problem.elements, mesh.regions["powder"]

        def build(vacuum, elements=elements, region=region):
            recovery = RegionRecovery(elements, region)
            recovery.derivatives(np.zeros(elements.n_dofs), vacuum=vacuum)
            return recovery

        once = {vacuum: best(lambda vacuum=vacuum: build(vacuum), 2) for vacuum in (True, False)}
        again = best(lambda field=field: RecoveredSampler(field, "powder"), 3)
        begin = perf_counter()
        table = TableSampler(RecoveredSampler(field, "powder"))
        grid = perf_counter() - begin - again
        table_again = best(lambda field=field: TableSampler(RecoveredSampler(field, "powder")), 3) - again
        print(f"  P{order} {elements.n_dofs:6d} dofs, {len(region):5d} elements in gap: recovery {once[True]:.3f} s "
              f"(vacuum), {once[False]:.3f} s (general) a mesh, {again * 1e3:.1f} ms a field; table of "
              f"{len(table.grid.cells)} cells {grid:.3f} s and {table_again * 1e3:.1f} ms, differs by "
              f"{table.difference[0]:.1e} in H and {table.difference[1]:.1e} in grad H")  # fmt: skip
        assert np.isfinite(table.difference).all()
