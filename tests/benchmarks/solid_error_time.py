"""What accuracy costs in three dimensions: error against time on a coil in air, raw and recovered.

Run from the project's root:  python tests/benchmarks/solid_error_time.py [number of meshes, 1 to 4 [picture.png]]
The coil is r 20 to 30 mm, z +-8 mm, 800 ampere-turns; the errors are relative RMS at 4 000 points in r 33 to
35 mm, |z| < 10 mm, against the superposition of loops.  Times are of the second run, compiled code warm.
Expected: ten seconds for three meshes; quadratic elements win at every accuracy, recovery costs little.
"""

import os
import platform
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "field"), str(ROOT / "tests" / "field_3d")]

import numpy as np  # noqa: E402
import sector_grid_3d as grid  # noqa: E402
from closed_forms import rectangular_coil_field  # noqa: E402
from graded_lines import graded_lines  # noqa: E402

from field.three_d import FlatCoil, Problem3D  # noqa: E402

R_COIL, Z_COIL, NI = (20e-3, 30e-3), (-8e-3, 8e-3), 800.0
ANGLE, BOX = np.pi / 6, 0.06


def mesh(step):
    """Half a sector of 60 degrees between mirror planes, open boundary twice as far out as the coil."""
    r = graded_lines(1.25 * step, (20e-3, 40e-3), (0.0, BOX))
    z = graded_lines(step, (0.0, 12e-3), (0.0, BOX))
    regions = {"coil": (*R_COIL, *Z_COIL), "powder": (30e-3, 40e-3, -12e-3, 12e-3)}
    n = max(2, round(30e-3 * ANGLE / step))
    return grid.sector_grid(r, n, np.concatenate((-z[:0:-1], z)), regions, angle=ANGLE, mirrored=True)


def exact(x):
    """H of the closed form."""
    r = np.hypot(x[:, 0], x[:, 1])
    H_r, H_z = rectangular_coil_field(R_COIL, Z_COIL, NI, r, x[:, 2])
    return np.column_stack((H_r * x[:, 0] / r, H_r * x[:, 1] / r, H_z))


def relative(found, expected):
    """Relative RMS error."""
    return np.linalg.norm(found - expected) / np.linalg.norm(expected)


def main():
    """Print the table, and draw it where a name for the picture is given."""
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 3
    r, z, angle = np.random.default_rng(1).uniform((33e-3, -10e-3, 0.0), (35e-3, 10e-3, 6.2), (4000, 3)).T
    points = np.column_stack((r * np.cos(angle), r * np.sin(angle), z))
    H, d = exact(points), 2e-6
    gradient = np.stack([(exact(points + d * e) - exact(points - d * e)) / (2 * d) for e in np.eye(3)], axis=2)
    steps = (4e-3, 2e-3, 1e-3, 0.67e-3)[:count]
    for order in (1, 2):  # compiles
        coarse = Problem3D(mesh(4e-3), {}, FlatCoil.ring(R_COIL, Z_COIL), order=order, linear_solver="multigrid")
        warm = coarse.solve(NI)
        warm.sampler().sample(points[:1])
        warm.field_strength(points[:1])
    print(f"{platform.processor() or platform.machine()}, {os.cpu_count()} cores, python {platform.python_version()}")
    print(" order  step mm   unknowns  solve s  CG  recover s   H raw     H rec.    grad H rec.  sample ns/point")
    rows = []
    for order in (1, 2):
        for step in steps:
            device = mesh(step)
            start = time.perf_counter()
            problem = Problem3D(device, {}, FlatCoil.ring(R_COIL, Z_COIL), order=order)
            field = problem.solve(NI)
            solved = time.perf_counter()
            sampler = field.sampler()
            recovered = time.perf_counter()
            found, found_gradient = sampler.sample(points)
            sampled = time.perf_counter()
            raw, better = relative(field.field_strength(points), H), relative(found, H)
            gradient_error = relative(found_gradient, gradient)
            rows.append((order, solved - start, recovered - start, raw, better, gradient_error))
            iterations = problem.linear_iterations[-1] if problem.linear_iterations else 0
            print(
                f"   P{order}   {1e3 * step:5.2f}   {problem.n_dofs:9d}  {solved - start:7.2f} {iterations:4d}  "
                f"{recovered - solved:7.2f}   {raw:.2e}  "
                f"{better:.2e}  {gradient_error:.2e}     "
                f"{1e9 * (sampled - recovered) / len(points):7.0f}",
                flush=True,
            )
    if len(sys.argv) > 2:
        draw(Path(sys.argv[2]), rows)


def draw(path, rows):
    """Errors against seconds, raw dashed, recovered solid, grad H dotted."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axis = plt.subplots(figsize=(6.5, 4.4), layout="constrained")
    for order, colour in ((1, "#808080"), (2, "#0b5fa5")):
        _, solve, recover, raw, better, gradient = np.array([row for row in rows if row[0] == order]).T
        axis.loglog(solve, raw, "--o", color=colour, ms=4, alpha=0.6, label=f"P{order}, H raw")
        axis.loglog(recover, better, "-o", color=colour, ms=4, label=f"P{order}, H recovered")
        axis.loglog(recover, gradient, ":o", color=colour, ms=4, label=f"P{order}, grad H recovered")
    axis.set_xlabel("wall-clock [s]")
    axis.set_ylabel("relative RMS error at 4 000 points")
    axis.set_title("A coil in air, in 3D", loc="left", fontsize=10)
    axis.grid(alpha=0.25, which="both")
    axis.legend(frameon=False, fontsize=8)
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main()
