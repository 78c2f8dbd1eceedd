"""What a step of rigid grains costs against their number, on a bed that settles in a box under exact Coulomb.

Steps of 10 to 200 sweeps from one state are fitted by time = rest + visits x (ns/visit) + projections x (a projection):
a visit is one contact in one sweep, a projection is one sweep over the positions that removes overlap (the fewer
sweeps, the more of them), the rest is neighbours, gaps, books and motion. Each is run three times in pieces of five
steps, and a piece counts with its shortest time: what else runs on the machine otherwise drowns the differences.

    python tests/benchmarks/dvi_cost.py [--sizes 200 1000 5000]
"""

from __future__ import annotations

import argparse
import time

import numpy as np
from scene_b import GRAVITY, WAYS, bed, in_box

PIECE = 5  # steps
SWEEPS = (10, 25, 50, 100, 200)


def main() -> None:
    """The table: processor time of one thread."""
    parser = argparse.ArgumentParser(description="cost of a step of rigid grains against their number")
    parser.add_argument("--sizes", type=int, nargs="+", default=[200, 1000, 5000])
    parser.add_argument("--steps", type=int, default=20)
    given = parser.parse_args()
    print("50 sweeps:")
    print(
        f"{'grains':>7} {'contacts':>8} {'ms/step':>8} {'us/grain':>8} {'ns/visit':>8} {'projections':>11} "
        f"{'us each':>8} {'rest ms':>8}"
    )
    for n in given.sizes:
        start, way = bed(n), WAYS["exact, 50 sweeps"] | {"gravity": (0.0, 0.0, -GRAVITY)}
        begin = in_box(n, start, **way)
        begin.run(80)
        state = begin.state()
        times = {sweeps: np.full(given.steps // PIECE, np.inf) for sweeps in SWEEPS}
        work = {}
        for sweeps in SWEEPS * 3:
            dvi = in_box(n, start, **(way | {"max_sweeps": sweeps}))
            dvi.restore(state)
            parts = []
            for piece in range(len(times[sweeps])):
                began = time.process_time()
                parts.append(dvi.run(PIECE))
                times[sweeps][piece] = min(times[sweeps][piece], (time.process_time() - began) / PIECE)
            work[sweeps] = [1.0, *(sum(getattr(t, k) for t in parts) / len(parts) / PIECE for k in
                                   ("visits", "projections"))]  # fmt: skip
            if sweeps == 50:
                contacts = parts[-1].n_contacts
        spent = {sweeps: float(t.mean()) for sweeps, t in times.items()}
        (rest, visit, projection), *_ = np.linalg.lstsq(
            np.array([work[k] for k in SWEEPS]), np.array([spent[k] for k in SWEEPS]), rcond=None
        )
        print(
            f"{n:7d} {contacts:8d} {1e3 * spent[50]:8.2f} {1e6 * spent[50] / n:8.2f} {1e9 * visit:8.1f} "
            f"{work[50][2]:11.1f} {1e6 * projection:8.1f} {1e3 * rest:8.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
