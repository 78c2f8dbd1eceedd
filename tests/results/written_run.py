"""A run's folder as a run leaves it, made of plain numbers: for what only reads folders."""

import numpy as np
import tomli_w

from emclutch.results import HistoryWriter, RunFolder
from emclutch.results.atomic_file import replace_json
from emclutch.results.quantities import QUANTITIES
from emclutch.results.statistics import steady_mean

SCENE = {"scene": {"title": "", "seed": 1}, "effects": {"dipoles": {}}, "output": {"pictures": False}}


def written_run(path, title="a run", *, mean=2.0, off=1e-4, seed=0, windows=200, finished=True, effects=("dipoles",)):
    """A finished run of `windows` windows of 1 ms whose torque is `mean` [N m] and whose balances are `off`."""
    scene = {**SCENE, "scene": {"title": title, "seed": 1}, "effects": {name: {} for name in effects}}
    folder = RunFolder.create(path, tomli_w.dumps(scene))
    random = np.random.default_rng(seed)
    rows = []
    for window in range(1, windows + 1):
        torque = mean * (1.0 + 0.05 * random.standard_normal())
        rows.append({"time": 1e-3 * window, "torque_disc": torque, "torque_rotor": -torque, "work_walls": 1.0,
                     "dissipated": 1.0, "energy_residual": off, "torque_residual": off * mean, "steps": 10,
                     "max_overlap": 0.01, "inertial_number": None if window == 1 else 0.1 / 3.0})  # fmt: skip
    with HistoryWriter(folder.history) as history:
        for row in rows:
            history.append(row)
    folder.write_provenance(seed=1, threads=1, threading_layer="omp", input_files={})
    folder.write_plan({"decisions": {"grains": f"10 of {title}"}})
    if not finished:
        return folder
    columns = {name: np.array([row[name] for row in rows]) for name in ("time", "torque_disc")}
    seconds = {"field": 1.0, "contact": 3.0, "total": 4.0, "whole_run": 5.0, "compiling": 0.0,
               "predicted": {"field": 2.0, "contact": 3.0, "start": 1.0, "output": 1.0, "total": 7.0}}  # fmt: skip
    folder.write_summary({
        "title": title, "effects": list(effects), "torque": steady_mean(**{"time": columns["time"],
        "value": columns["torque_disc"]}).as_dict(), "time": 1e-3 * windows, "grains": 10, "max_overlap": 0.01,
        "typical_overlap": 0.005, "torque_residual_rms": off * mean, "energy_residual_relative": off,
        "discretisation_error": None, "contact": {"compliant": True}, "seconds": seconds, "plan": {},
    })  # fmt: skip
    return folder


def written_study(path, means, title="a study"):
    """A study over `coil.current` with one written run a point."""
    import pandas

    from emclutch.results import load_result

    rows = []
    for number, mean in enumerate(means):
        folder = written_run(path / f"point-{number:03d}", mean=mean, seed=number)
        torque = load_result(folder.path).torque
        low, high = torque.interval()
        rows.append({"coil.current": f"{number + 1} A", "end_time": 0.2, "current": number + 1.0, "torque": torque.mean,
                     "standard_error": torque.standard_error, "low": low, "high": high, "converged": torque.converged,
                     "seconds": 5.0, "folder": folder.path.name})  # fmt: skip
    pandas.DataFrame(rows).to_csv(path / "study.csv", index=False)
    replace_json(path / "study.json", {"title": title, "values": {}, "points": len(means) + 1})
    return path


def undefined(summary):
    """Names of numbers in a summary that no quantity defines."""
    known = {one.key.split(".")[0] for one in QUANTITIES}
    numbers = {key for key, value in summary.items() if isinstance(value, float | int) and not isinstance(value, bool)}
    return numbers - known
