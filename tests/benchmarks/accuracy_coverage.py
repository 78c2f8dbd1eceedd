"""How often runs with `accuracy.target` are right: fresh packings against a reference of far more effort.

    python tests/benchmarks/accuracy_coverage.py SCENE.toml REFERENCE.csv TARGET COUNT OUT.csv [FIRST]

Each run has a seed of its own, that no run of the ladder has. It is right where its torque without the bias of its
settings, with its total error, holds the reference. The reference's own half width is added in quadrature.
REFERENCE.csv: torque of each packing of a finer scene [N m], made by

    python tests/benchmarks/accuracy_coverage.py SCENE.toml REFERENCE.csv reference COUNT
"""

from __future__ import annotations

import csv
import sys
from pathlib import Path

import numpy as np

import emclutch
from emclutch.results.ladder import student
from emclutch.scene.replica_count import replica_seed
from emclutch.studies.accuracy_rungs import is_sheared

REFERENCE_SEED, FRESH_SEED = 777, 5000
QUIET = {
    "time.until": None, "output.snapshots": 0, "output.pictures": False, "output.checkpoint": False,
    "output.formats": [], "output.energy_budget": False,
}  # fmt: skip
FIRST_STRAIN, LAST_STRAIN = 10.0, 42.0
LONGER, FIRST_SHARE = 3.0, 1.0 / 6.0
"""Without a shear strain: length of a reference over that of the scene, and the share of it that is left out."""


def finer(case: emclutch.Case) -> tuple[dict[str, object], float]:
    """Return settings whose errors are a fraction of those of the scene, and the share of a run that is left out."""
    plan = emclutch.plan(case)
    values: dict[str, object] = {
        "accuracy.replicas": 1, "time.until": None, "time.steps_per_contact": 28.0,
        "contact.stiffness": 2.0 * plan.stiffness,
    }  # fmt: skip
    if case.scene.grains.sector is not None:
        values["particles.sector"] = "12 diameters"
    if case.scene.effects.dipoles is not None:
        values["effects.dipoles.tolerance"] = 3e-4
        values["effects.dipoles.update_every"] = max(1, plan.steps_per_update // 2)
    if is_sheared(case):
        return values | {"time.end": f"strain {LAST_STRAIN:g}"}, FIRST_STRAIN / LAST_STRAIN
    return values | {"time.end": LONGER * plan.end}, FIRST_SHARE


def reference(case: emclutch.Case, out: Path, count: int) -> None:
    """Run finer packings, and append their torques."""
    values, left_out = finer(case)
    for number in range(count):
        seed = replica_seed(REFERENCE_SEED, number + 1)
        folder = Path("runs") / f"reference-{case.name}-{number}"
        history = emclutch.run(case.with_values(QUIET | values | {"scene.seed": seed}), out=folder, threads=1).history
        late = history[history.time > left_out * history.time.iloc[-1]]
        append(out, {"seed": seed, "torque": float(np.average(late.torque_disc, weights=np.gradient(late.time)))})


def fresh(case: emclutch.Case, torques: np.ndarray, target: str, seeds: range, out: Path) -> None:
    """Run the scene to its target with fresh packings, and append whether each run is right."""
    truth = float(torques.mean())
    of_truth = student(len(torques) - 1.0) * float(torques.std(ddof=1)) / len(torques) ** 0.5 / truth
    for seed in seeds:
        folder = Path("runs") / f"fresh-{case.name}-{target.replace(' ', '')}-{seed}"
        turned = case.with_values(QUIET | {"accuracy.target": target, "scene.seed": seed})
        summary = emclutch.run(turned, out=folder).summary
        found = summary["discretisation_error"]
        error = found["corrected_torque"]["mean"] / truth - 1.0
        append(out, {
            "scene": case.name, "target": target, "seed": seed, "torque": summary["torque"]["mean"],
            "corrected": found["corrected_torque"]["mean"], "half_width": found["total_error"], "reference": truth,
            "reference_half_width": of_truth, "error": error,
            "right": abs(error) <= np.hypot(found["total_error"], of_truth),
            "packings": summary["torque"]["replicas"], "seconds": summary["seconds"]["whole_run"],
        })  # fmt: skip


def append(path: Path, row: dict[str, object]) -> None:
    """Append a row to a CSV, with its head where it is new."""
    is_new = not path.exists()
    with path.open("a", newline="", encoding="utf-8") as stream:
        writer = csv.DictWriter(stream, list(row), lineterminator="\n")
        if is_new:
            writer.writeheader()
        writer.writerow(row)


def main() -> None:
    """See the module."""
    scene, known, target, count = sys.argv[1], Path(sys.argv[2]), sys.argv[3], int(sys.argv[4])
    case = emclutch.load_case(scene)
    if target == "reference":
        reference(case, known, count)
        return
    with known.open(encoding="utf-8") as stream:
        torques = np.array([float(row["torque"]) for row in csv.DictReader(stream)])
    first = FRESH_SEED + (int(sys.argv[6]) if len(sys.argv) > 6 else 0)
    fresh(case, torques, target, range(first, first + count), Path(sys.argv[5]))


if __name__ == "__main__":
    main()
