"""What a step of rigid grains costs against their number: 50 exact sweeps on a bed that settles in a box.

A visit is one contact in one sweep; the rest of a step is neighbours, gaps, books and motion.

    python tests/benchmarks/dvi_cost.py [--sizes 200 1000 5000]
"""

from __future__ import annotations

import argparse
import time

from scene_b import WAYS, bed, in_box


def main() -> None:
    """The table: processor time of one thread."""
    parser = argparse.ArgumentParser(description="cost of a step of rigid grains against their number")
    parser.add_argument("--sizes", type=int, nargs="+", default=[200, 1000, 5000])
    parser.add_argument("--steps", type=int, default=40)
    given = parser.parse_args()
    print(f"{'grains':>7} {'contacts':>8} {'ms/step':>8} {'us/grain':>8} {'ns/visit':>8} {'rest ms':>8}")
    for n in given.sizes:
        start = bed(n)
        spent, visits = {}, {}
        begin, _ = in_box(n, start, **WAYS["exact, 50 sweeps"])
        begin.run(80)
        state = begin.state()
        for sweeps in (50, 100):  # from one state: the difference is sweeps alone
            dvi, _ = in_box(n, start, **(WAYS["exact, 50 sweeps"] | {"max_sweeps": sweeps}))
            dvi.restore(state)
            began = time.process_time()
            last = dvi.run(given.steps)
            spent[sweeps] = (time.process_time() - began) / given.steps
            visits[sweeps] = last.visits / given.steps
        visit = (spent[100] - spent[50]) / (visits[100] - visits[50])
        rest = spent[50] - visits[50] * visit
        print(
            f"{n:7d} {last.n_contacts:8d} {1e3 * spent[50]:8.2f} {1e6 * spent[50] / n:8.2f} {1e9 * visit:8.1f} "
            f"{1e3 * rest:8.3f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
