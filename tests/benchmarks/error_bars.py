"""Do error bars hold? Single runs of a scene with many seeds, put together to runs of replicas, compared in pairs.

python tests/benchmarks/error_bars.py FOLDER SCENE.toml COUNT [replicas] [--set key=value ...]

Makes COUNT single runs with seeds that no other study takes, under FOLDER (those that are there are kept), forms
disjoint runs of so many replicas (2), pairs these, and tells how often their difference lies in its own 95 % interval:
90 to 99 % of the pairs should. Beside it the same for single runs with the error that each finds for itself.
"""

import os
import sys
from pathlib import Path

os.environ.setdefault("OMP_NUM_THREADS", "1")

import numpy as np

import emclutch
from emclutch.cli.input import assignments
from emclutch.results import Estimate, load_result
from emclutch.results.fits import Measured
from emclutch.results.steady_torque import SteadyConditions, steady_torque

FIRST_SEED = 77_000


def estimates(folder: Path, count: int, replicas: int) -> list[Estimate]:
    """The torques of disjoint runs of so many replicas."""
    results = [load_result(folder / f"seed-{FIRST_SEED + k}") for k in range(count)]
    found = []
    for k in range(0, count - replicas + 1, replicas):
        first, *others = (result.history for result in results[k : k + replicas])
        conditions = SteadyConditions.from_dict(results[k].folder.read_plan()["steady_torque"])
        found.append(steady_torque(first, conditions, others))
    return found


def share_within(found: list[Estimate]) -> tuple[int, int]:
    """Pairs of neighbours whose difference lies in its own 95 % interval (Welch), and how many pairs there are."""
    inside = pairs = 0
    for a, b in zip(found[::2], found[1::2], strict=False):
        if a.standard_error is None or b.standard_error is None or a.mean is None or b.mean is None:
            continue
        freedom = [e.batches - 1.0 if e.degrees_of_freedom is None else e.degrees_of_freedom for e in (a, b)]
        if min(freedom) < 1.0:
            continue
        difference = Measured(a.mean, a.standard_error, freedom[0]) - Measured(b.mean, b.standard_error, freedom[1])
        pairs += 1
        inside += not difference.is_significant()
    return inside, pairs


def main() -> None:
    arguments = sys.argv[1:]
    sets = [arguments[k + 1] for k, text in enumerate(arguments) if text == "--set"]
    plain = [text for k, text in enumerate(arguments) if text != "--set" and (k == 0 or arguments[k - 1] != "--set")]
    folder, scene, count = Path(plain[0]), plain[1], int(plain[2])
    replicas = int(plain[3]) if len(plain) > 3 else 2
    case = emclutch.load_case(scene, assignments(sets))
    quiet = {"accuracy.replicas": 1, "output.snapshots": 0, "output.pictures": False, "output.formats": []}
    for k in range(count):
        out = folder / f"seed-{FIRST_SEED + k}"
        if not (out / "summary.json").is_file():
            emclutch.run(case.with_values({**quiet, "scene.seed": FIRST_SEED + k}), out=out)
    for size in (1, replicas):
        found = estimates(folder, count, size)
        inside, pairs = share_within(found)
        means = np.array([one.mean for one in found])
        reported = np.sqrt(np.mean([one.standard_error**2 for one in found if one.standard_error is not None]))
        print(
            f"{size} a run: {inside} of {pairs} pairs within 95 % ({inside / max(pairs, 1):.0%}); mean "
            f"{means.mean():.4g} N m, scatter {means.std(ddof=1):.2g}, estimated error {reported:.2g} N m, "
            f"{sum(one.converged for one in found)} of {len(found)} converged"
        )


if __name__ == "__main__":
    main()
