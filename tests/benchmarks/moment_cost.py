"""Cost of grains that magnetise one another, beside fixed dipoles, in one run: ns a listed pair.

python tests/benchmarks/moment_cost.py [grains] [solid fraction]; one thread unless OMP_NUM_THREADS says otherwise.
The peer is the force of fixed dipoles on the same rows (`coupling.dipoles`).
"""

import os
import sys
from time import perf_counter

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from coupling.dipoles import add_dipole_forces
from coupling.mutual_moments import MutualMoments, grain_table
from coupling.neighbour_rows import neighbour_rows
from field import GrainLaw
from particles.lists.neighbours import cell_order

A, REACH = 1e-4, 5e-4  # radius [m]; 2.5 diameters


def bed(n: int, fill: float) -> np.ndarray:
    """A shaken lattice at a solid fraction, in the order of cells."""
    pitch = 2.0 * A * (np.pi / (6.0 * fill)) ** (1.0 / 3.0)
    side = int(np.ceil(n ** (1.0 / 3.0)))
    x = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:n] * pitch
    x = x + np.random.default_rng(0).uniform(-0.5, 0.5, x.shape) * (pitch - 2.0 * A)
    return np.ascontiguousarray(x[cell_order(x, REACH)])


def timed(call, repeats: int) -> float:
    """Median of the seconds of a call, after one that compiles."""
    call()
    seconds = []
    for _ in range(repeats):
        begin = perf_counter()
        call()
        seconds.append(perf_counter() - begin)
    return float(np.median(seconds))


def main(n: int = 8000, fill: float = 0.45) -> None:
    x, radius, law = bed(n, fill), np.full(n, A), GrainLaw(999.0, 1.7e6)
    rows = neighbour_rows(x, REACH)
    pairs = len(rows.other)
    H = np.tile([0.0, 0.0, 46e3], (n, 1))
    print(
        f"{n} grains at {fill}, {pairs / n:.1f} listed neighbours within 2.5 d, threads {os.environ['OMP_NUM_THREADS']}"
    )
    force = np.zeros((n, 3))
    moment = np.tile([0.0, 0.0, 1e-9], (n, 1))
    peer = timed(lambda: add_dipole_forces(x, moment, radius, rows, REACH, force), 15)
    print(f"fixed dipoles, forces: {1e9 * peer / pairs:.1f} ns a listed pair")
    for model in ("mutual", "near_field"):
        solver = MutualMoments(grain_table(law, model), near=model == "near_field", reach=REACH)
        found = solver.solve(x, radius, H, rows, tolerance=1e-3)
        start = found.moment
        more = {"start": start, "tolerance": 0.0, "most_sweeps": 10}
        sweeps = timed(lambda s=solver, more=more: s.solve(x, radius, H, rows, **more), 7)
        forces = timed(lambda s=solver, f=found: s.forces(x, radius, rows, f), 15)
        print(
            f"{model}: {1e9 * sweeps / 10 / pairs:.1f} ns a listed pair and sweep, forces {1e9 * forces / pairs:.1f} "
            f"({forces / peer:.1f} of fixed); from nothing {found.sweeps} sweeps to {found.residual:.1e}"
        )


if __name__ == "__main__":
    main(*(kind(text) for kind, text in zip((int, float), sys.argv[1:], strict=False)))
