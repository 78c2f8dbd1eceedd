"""How often runs with `accuracy.target` are right: fresh replicas against a reference of far more effort.

    python tests/benchmarks/accuracy_coverage.py run SCENE.toml TARGET COUNT RUNS.csv [FIRST]
    python tests/benchmarks/accuracy_coverage.py reference SCENE.toml COUNT REFERENCE.csv
    python tests/benchmarks/accuracy_coverage.py judge RUNS.csv REFERENCE.csv [REFERENCE.csv ...]

Each run has a seed of its own, that no run of the study has. It is right where its best estimate,
with its total error, holds the reference: the mean torque of replicas of a finer scene, sheared for longer.
The reference's own half width, Student's t of few replicas, is printed and not added, which makes the test the harder.
"""

from __future__ import annotations

import sys
from pathlib import Path

import numpy as np
import pandas

import emclutch
from emclutch.results.fits import Measured
from emclutch.scene.replica_count import replica_seed
from emclutch.studies.accuracy.planned_values import is_sheared

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


def reference(case: emclutch.Case, count: int, out: Path) -> None:
    """Run finer replicas, and append their torques."""
    values, left_out = finer(case)
    for number in range(count):
        seed = replica_seed(REFERENCE_SEED, number + 1)
        folder = Path("runs") / f"reference-{case.name}-{number}"
        history = emclutch.run(case.with_values(QUIET | values | {"scene.seed": seed}), out=folder, threads=1).history
        late = history[history.time > left_out * history.time.iloc[-1]]
        torque = float(np.average(late.torque_disc, weights=np.gradient(late.time)))
        append(out, {"scene": case.name, "seed": seed, "torque": torque})


def run(case: emclutch.Case, target: str, seeds: range, out: Path) -> None:
    """Run the scene to its target with fresh replicas, and append what each run says of its torque."""
    for seed in seeds:
        folder = Path("runs") / f"fresh-{case.name}-{target.replace(' ', '')}-{seed}"
        turned = case.with_values(QUIET | {"accuracy.target": target, "scene.seed": seed})
        summary = emclutch.run(turned, out=folder).summary
        found = summary["discretisation_error"]
        append(out, {
            "scene": case.name, "target": target, "seed": seed, "torque": summary["torque"]["mean"],
            "bias": found["bias"], "corrected": found["best_estimate"]["mean"], "half_width": found["total_error"],
            "reached": summary["accuracy_target"]["reached"], "replicas": summary["torque"]["replicas"],
            "seconds": summary["seconds"]["processor"],
        })  # fmt: skip


def judge(runs: pandas.DataFrame, references: pandas.DataFrame) -> pandas.DataFrame:
    """Return a row for each scene and target: how many runs are right, median error and half width, processor time."""
    rows = []
    for (scene, target), some in runs.groupby(["scene", "target"], sort=False):
        torques = references.torque[references.scene == scene]
        truth = torques.mean()
        of_truth = Measured.of(torques).half_width() / truth
        error = (some.corrected / truth - 1.0).abs()
        median, half = error.median(), some.half_width.median()
        rows.append({
            "scene": scene, "target": target, "runs": len(some),
            "right": int((error <= some.half_width).sum()), "reached": int(some.reached.sum()),
            "error": median, "half_width": half, "ratio": half / median,
            "mean_error": (some.corrected / truth - 1.0).mean(), "reference": truth,
            "reference_half_width": of_truth, "replicas": some.replicas.median(), "seconds": some.seconds.median(),
        })  # fmt: skip
    return pandas.DataFrame(rows)


def append(path: Path, row: dict[str, object]) -> None:
    """Append a row to a CSV, with its head where it is new."""
    pandas.DataFrame([row]).to_csv(path, mode="a", header=not path.exists(), index=False)


def main() -> None:
    """See the module."""
    mode, first, *others = sys.argv[1:]
    if mode == "judge":
        references = pandas.concat([pandas.read_csv(one) for one in others])
        print(judge(pandas.read_csv(first), references).to_string(index=False, float_format="%.4g"))
        return
    case = emclutch.load_case(first)
    if mode == "reference":
        reference(case, int(others[0]), Path(others[1]))
        return
    target, count, out, *start = others
    begin = FRESH_SEED + (int(start[0]) if start else 0)
    run(case, target, range(begin, begin + int(count)), Path(out))


if __name__ == "__main__":
    main()
