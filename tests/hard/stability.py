"""Hard scenes, long, each over a decade of time steps: `python tests/hard/stability.py FOLDER [SCENE ...]`.

By DEM 10 to 100 steps a contact (20 is the default), by DVI a third of the default step to three times it. The
invariants hold, or the run stops as cases/hard/invariants.toml lists it for the scene and the step; any other stop
fails. The table (scene, step, invariant, margin, seconds) is printed, and
stored as FOLDER/stability.csv after every run. Exit code 1: an invariant is broken, or a run stopped that should not.
"""

from __future__ import annotations

import sys
import tempfile
import traceback
import warnings
from pathlib import Path
from time import process_time

import pandas
from hard_scene import HardScene, hard_scenes, kind_of_step

from emclutch.results.errors import RunError
from emclutch.scene.errors import SceneError

NO_EXPLANATION = "no explanation"


def rows_of(scene: HardScene) -> list[dict]:
    """A row for each invariant and step; where a run stops, one with its words."""
    rows = []
    for number, values in enumerate([{}] if scene.stops is not None else scene.steps()):
        begin, step = process_time(), ", ".join(f"{key} = {value:.4g}" for key, value in _numbers(values)) or "default"
        head = {"case": scene.name, "steps": step}
        with tempfile.TemporaryDirectory() as folder:
            try:
                found = scene.margins(scene.run(Path(folder) / "run", values))
                words = ""
            except (SceneError, RunError) as error:
                found, words = {}, " ".join(str(error).partition("\n(log:")[0].split())
            except Exception as error:  # no explanation, whatever it is; the next scenes are to run
                traceback.print_exc()
                found, words = {}, f"{NO_EXPLANATION}: {error!r}"
        seconds = round(process_time() - begin, 1)
        if words or scene.stops is not None:
            if scene.stops is not None:
                explained = scene.is_explained(words)
            else:
                explained = scene.may_stop_with(words, kind_of_step(values, number))
            margin = 0.0 if explained else float("inf")
            rows.append(head | {"invariant": f"stops: {words}"[:160], "margin": margin, "seconds": seconds})
        rows += [head | {"invariant": name, "margin": value, "seconds": seconds} for name, value in found.items()]
    return rows


def _numbers(values: dict) -> list[tuple[str, float]]:
    return [(key, value) for key, value in values.items() if isinstance(value, float)]


def main(folder: Path, names: list[str]) -> int:
    """Run the scenes of those names, all if there is none; the exit code."""
    folder.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("error")
    rows: list[dict] = []
    for scene in hard_scenes():
        if names and scene.name not in names:
            continue
        new = rows_of(scene)
        rows += new
        print(pandas.DataFrame(new).to_string(index=False, float_format=lambda value: f"{value:.3g}"), flush=True)
        pandas.DataFrame(rows).to_csv(folder / "stability.csv", index=False)
    broken = [row for row in rows if not row["margin"] < 1.0]
    print(f"{len(rows)} rows in {folder / 'stability.csv'}; {len(broken)} broken")
    for row in broken:
        print(f"  {row['case']}, {row['steps']}: {row['invariant']}, margin {row['margin']:.3g}")
    return 1 if broken else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
