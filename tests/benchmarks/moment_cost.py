"""Cost of grains that magnetise one another, beside forces of point dipoles, in one run: ns a listed pair and sweep.

    python tests/benchmarks/moment_cost.py [grains] [solid fraction] [--run FOLDER]

Processor time; one thread unless OMP_NUM_THREADS says otherwise. The peer is the force between point dipoles of given
moments on the same rows (`dipole_forces`). A listed pair is a row's entry: each pair is seen from both of its grains.
What does not depend on the moments (`coupling.influence`) is set up once an update, then come the sweeps, then the
forces: the price of a sweep is the difference between 30 of them and 10. With a finished run (`emclutch run
cases/quickstart.toml`), the fraction of it that each part took follows, from its summary: wall-clock time, so of an
idle machine.
"""

import argparse
import json
import os
from dataclasses import dataclass
from pathlib import Path
from time import process_time

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np
from numba import njit, set_num_threads

from coupling.grain_law_table import grain_table
from coupling.mutual_moments import MutualMoments
from coupling.neighbour_rows import neighbour_rows
from field import GrainLaw
from particles.neighbours.neighbour_list import cell_order

A, REACH = 1e-4, 5e-4  # radius [m]; 2.5 diameters
FEW, MANY = 10, 30  # sweeps


def bed(n: int, fill: float) -> np.ndarray:
    """A shaken lattice at a solid fraction, in the order of cells."""
    pitch = 2.0 * A * (np.pi / (6.0 * fill)) ** (1.0 / 3.0)
    side = int(np.ceil(n ** (1.0 / 3.0)))
    x = np.stack(np.meshgrid(*[np.arange(side)] * 3, indexing="ij"), axis=-1).reshape(-1, 3)[:n] * pitch
    x = x + np.random.default_rng(0).uniform(-0.5, 0.5, x.shape) * (pitch - 2.0 * A)
    return np.ascontiguousarray(x[cell_order(x, REACH)])


@njit
def dipole_forces(position, moment, start, other, force):
    """F_i = 3 mu_0/(4 pi r^4) sum ((m_j.e) m_i + (m_i.e) m_j + (m_i.m_j) e - 5 (m_i.e)(m_j.e) e) [N], in place."""
    for i in range(len(position)):
        mi = moment[i]
        for k in range(start[i], start[i + 1]):
            j = other[k]
            mj = moment[j]
            x, y, z = position[i] - position[j]
            r2 = x * x + y * y + z * z
            r = np.sqrt(r2)
            x, y, z = x / r, y / r, z / r
            ai, aj = mi[0] * x + mi[1] * y + mi[2] * z, mj[0] * x + mj[1] * y + mj[2] * z
            both = mi[0] * mj[0] + mi[1] * mj[1] + mi[2] * mj[2] - 5.0 * ai * aj
            scale = 3e-7 / (r2 * r2)
            force[i, 0] += scale * (aj * mi[0] + ai * mj[0] + both * x)
            force[i, 1] += scale * (aj * mi[1] + ai * mj[1] + both * y)
            force[i, 2] += scale * (aj * mi[2] + ai * mj[2] + both * z)


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
    predicted = seconds.get("predicted", {})
    lines = [
        f"{summary['title']}: {summary['steps']} steps of {summary['grains']} grains in {whole:.4g} s, of which "
        f"{seconds.get('compiling', 0.0):.3g} s compiled kernels, within the parts that called them first"
    ]
    for name, spent in parts.items():
        beside = f", predicted {predicted[name]:.3g} s" if name in predicted else ""
        lines.append(f"  {name:9}{100.0 * spent / whole:5.1f} %  {spent:8.4g} s{beside}")
    if "moments" in summary:
        lines.append(f"  {summary['moments']['sweeps_per_update']:.2g} sweeps of the moments an update")
    return "\n".join(lines)


@dataclass(frozen=True, slots=True)
class Price:
    """Prices of a model of the moments, and of point dipoles' forces on the same rows [ns a listed pair]."""

    model: str
    neighbours: float
    fixed: float
    sweep: float
    set_up: float
    forces: float
    sweeps: int
    residual: float


def bed_prices(n: int, fill: float, repeats: int = 15) -> list[Price]:
    """Prices on a bed of ``n`` grains at a solid fraction, of `mutual` and of `near_field`."""
    x, radius, law = bed(n, fill), np.full(n, A), GrainLaw(999.0, 1.7e6)
    rows = neighbour_rows(x, REACH)
    pair = 1e-9 * len(rows.other)
    H = np.tile([0.0, 0.0, 46e3], (n, 1))
    force = np.zeros((n, 3))
    moment = np.tile([0.0, 0.0, 1e-9], (n, 1))
    fixed = timed(lambda: dipole_forces(x, moment, rows.start, rows.other, force), repeats)
    prices = []
    for model in ("mutual", "near_field"):
        solver = MutualMoments(grain_table(law, model), near=model == "near_field", reach=REACH)
        found = solver.solve(x, radius, H, rows, tolerance=1e-3)

        def swept(sweeps: int, solver=solver, start=found.dipole) -> float:
            more = {"start": start, "tolerance": 0.0, "max_sweeps": sweeps}
            return timed(lambda: solver.solve(x, radius, H, rows, **more), (repeats + 1) // 2)

        few, many = swept(FEW), swept(MANY)
        sweep = (many - few) / (MANY - FEW)
        forces = timed(lambda s=solver, f=found: s.forces(x, radius, rows, f), repeats)
        prices.append(
            Price(model, len(rows.other) / n, fixed / pair, sweep / pair, (few - FEW * sweep) / pair, forces / pair,
                  found.sweeps, found.residual)
        )  # fmt: skip
    return prices


def print_prices(n: int, fill: float) -> None:
    """Prices of given, mutual and near dipoles for each listed pair."""
    prices = bed_prices(n, fill)
    print(
        f"{n} grains at {fill}, {prices[0].neighbours:.1f} listed neighbours within 2.5 d, "
        f"threads {os.environ['OMP_NUM_THREADS']}; point dipoles: forces {prices[0].fixed:.1f} ns a listed pair"
    )
    for p in prices:
        print(
            f"{p.model}: {p.sweep:.1f} ns a listed pair and sweep, set up {p.set_up:.1f} ns, forces {p.forces:.1f} ns "
            f"({p.forces / p.fixed:.1f} of point dipoles); from nothing {p.sweeps} sweeps to {p.residual:.1e}"
        )


def main() -> None:
    """Prices of pairs, and the shares of a run where one is given."""
    parser = argparse.ArgumentParser(description="cost of grains that magnetise one another")
    parser.add_argument("grains", type=int, nargs="?", default=8000)
    parser.add_argument("fill", type=float, nargs="?", default=0.45, help="solid fraction")
    parser.add_argument("--run", type=Path, help="folder of a finished run")
    given = parser.parse_args()
    set_num_threads(int(os.environ["OMP_NUM_THREADS"]))  # waiting threads count as processor time
    print_prices(given.grains, given.fill)
    if given.run is not None:
        print(shares(given.run))


if __name__ == "__main__":
    main()
