"""What accuracy costs in time, P1 to P4: error of H and grad H against wall-clock, with and without recovery.

Run from the project's root:  python tests/benchmarks/field_error_time.py [picture.png]
A coil in air with an open boundary; errors are relative RMS at 4 000 points in r 33 to 35 mm, |z| < 10 mm against the
superposition of loops. Seconds are of numbering, factorisation and solve (raw), and of those with the recovery operator
and the sampler's nodal values (recovered); compiled code warm, best of three. A minute in all.
"""

import os
import platform
import sys
import time
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
sys.path[:0] = [str(ROOT), str(ROOT / "tests" / "field")]

from air_coil import NI, Reference, coil_in_air  # noqa: E402

from field import AxisymmetricProblem, RecoveredSampler  # noqa: E402
from field.factorisation import describe_backend  # noqa: E402

SCALES = (4.0, 2.83, 2.0, 1.41, 1.0, 0.71, 0.5)


def measure(order, mesh, reference):
    """Unknowns, seconds raw and recovered, and the four errors."""
    best = [float("inf")] * 2
    for _ in range(3):
        start = time.perf_counter()
        problem = AxisymmetricProblem(mesh, {}, order=order, open_boundary=True)
        field = problem.solve(NI)
        solved = time.perf_counter()
        sampler = RecoveredSampler(field, "powder")
        best = [min(best[0], solved - start), min(best[1], time.perf_counter() - start)]
    return (problem.n_dofs, *best, *reference.of_raw(field), *reference.of(sampler))


def main():
    """Print the table, and draw it where a name for the picture is given."""
    reference = Reference(4000, (33e-3, -10e-3), (35e-3, 10e-3))
    meshes = [coil_in_air(scale, growth=0.2) for scale in SCALES]
    for order in (1, 2, 3, 4):
        measure(order, meshes[0], reference)  # compiles
    print(f"{platform.machine()}, {os.cpu_count()} cores, one thread; {describe_backend()}")
    print("order  unknowns   solve s  +recovery s   H raw    grad raw   H recovered  grad recovered")
    rows = {}
    for order in (1, 2, 3, 4):
        for mesh in meshes:
            row = measure(order, mesh, reference)
            if row[0] > 130_000:
                break
            rows.setdefault(order, []).append(row)
            n, solve, recover, *errors = row
            print(f"  P{order}  {n:9d}  {solve:8.3f}  {recover:10.3f}   " + "  ".join(f"{e:9.1e}" for e in errors))
    if len(sys.argv) > 1:
        draw(Path(sys.argv[1]), rows)


def draw(path, rows):
    """Work-precision diagram: H on the left, grad H on the right."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(1, 2, figsize=(10.5, 4.6), layout="constrained", sharey=True)
    for axis, raw, recovered, name in ((axes[0], 3, 5, "H"), (axes[1], 4, 6, "grad H")):
        for colour, (order, table) in zip(("#808080", "#0b5fa5", "#d9730d", "#2a8c3f"), rows.items(), strict=True):
            axis.loglog([r[1] for r in table], [r[raw] for r in table], "--", color=colour, marker="o", ms=3, alpha=0.6)
            axis.loglog([r[2] for r in table], [r[recovered] for r in table], "-", color=colour, marker="o", ms=4,
                        label=f"P{order}")  # fmt: skip
        axis.set_xlabel("wall-clock [s]")
        axis.set_title(f"{name}: dashed raw, solid recovered", loc="left", fontsize=10)
        axis.grid(alpha=0.25, which="both")
        axis.legend(frameon=False)
    axes[0].set_ylabel("relative RMS error at 4 000 points")
    figure.savefig(path, dpi=150)


if __name__ == "__main__":
    main()
