"""Cost of grains that magnetise one another, beside fixed dipoles, in one run: ns a listed pair and sweep.

    python tests/benchmarks/moment_cost.py [grains] [solid fraction] [--run FOLDER]

Processor time; one thread unless OMP_NUM_THREADS says otherwise. The peer is the force of fixed dipoles on the same
rows (`coupling.dipoles`). A listed pair is a row's entry: each pair is seen from both of its grains. What does not
depend on the moments (`coupling.influence`) is set up once an update, then come the sweeps, then the forces: the price
of a sweep is the difference between 30 of them and 10. With a finished run (`emclutch run cases/quickstart.toml`), the
share of it that each part took follows, from its summary: wall-clock time, so of an idle machine.
"""

import argparse
import json
import os
from pathlib import Path
from time import process_time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

from coupling.dipoles import add_dipole_forces
from coupling.mutual_moments import MutualMoments, grain_table
from coupling.neighbour_rows import neighbour_rows
from field import GrainLaw
from particles.lists.neighbours import cell_order

A, REACH = 1e-4, 5e-4  # radius [m]; 2.5 diameters
FEW, MANY = 10, 30  # sweeps


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
        begin = process_time()
        call()
        seconds.append(process_time() - begin)
    return float(np.median(seconds))


def shares(folder: Path) -> str:
    """What each part of a finished run took of it, from its summary.json."""
    summary = json.loads((folder / "summary.json").read_text(encoding="utf-8"))
    seconds = summary["seconds"]
    whole = seconds["whole_run"]
    parts = {name: seconds[name] for name in ("field", "magnetic", "contact") if name in seconds}
    parts["rest"] = whole - sum(parts.values())
    foretold = seconds.get("foretold", {})
    lines = [
        f"{summary['title']}: {summary['steps']} steps of {summary['grains']} grains in {whole:.4g} s, of which "
        f"{seconds.get('compiling', 0.0):.3g} s compiled kernels, within the parts that called them first"
    ]
    for name, spent in parts.items():
        beside = f", foretold {foretold[name]:.3g} s" if name in foretold else ""
        lines.append(f"  {name:9}{100.0 * spent / whole:5.1f} %  {spent:8.4g} s{beside}")
    if "moments" in summary:
        lines.append(f"  {summary['moments']['sweeps_per_update']:.2g} sweeps of the moments an update")
    return "\n".join(lines)


def pairs_cost(n: int, fill: float) -> None:
    """Print the prices of fixed, mutual and near dipoles for each listed pair."""
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
    print(f"fixed dipoles: forces {1e9 * peer / pairs:.1f} ns a listed pair")
    for model in ("mutual", "near_field"):
        solver = MutualMoments(grain_table(law, model), near=model == "near_field", reach=REACH)
        found = solver.solve(x, radius, H, rows, tolerance=1e-3)

        def swept(sweeps: int, solver=solver, start=found.moment) -> float:
            more = {"start": start, "tolerance": 0.0, "most_sweeps": sweeps}
            return timed(lambda: solver.solve(x, radius, H, rows, **more), 7)

        few, many = swept(FEW), swept(MANY)
        sweep = (many - few) / (MANY - FEW)
        forces = timed(lambda s=solver, f=found: s.forces(x, radius, rows, f), 15)
        set_up = few - FEW * sweep
        print(
            f"{model}: {1e9 * sweep / pairs:.1f} ns a listed pair and sweep, set up {1e9 * set_up / pairs:.1f} ns, "
            f"forces {1e9 * forces / pairs:.1f} ns ({forces / peer:.1f} of fixed); from nothing {found.sweeps} sweeps "
            f"to {found.residual:.1e}"
        )


def main() -> None:
    """Prices of pairs, and the shares of a run where one is given."""
    parser = argparse.ArgumentParser(description="cost of grains that magnetise one another")
    parser.add_argument("grains", type=int, nargs="?", default=8000)
    parser.add_argument("fill", type=float, nargs="?", default=0.45, help="solid fraction")
    parser.add_argument("--run", type=Path, help="folder of a finished run")
    given = parser.parse_args()
    pairs_cost(given.grains, given.fill)
    if given.run is not None:
        print(shares(given.run))


if __name__ == "__main__":
    main()
