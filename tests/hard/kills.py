"""Runs killed again and again: `python tests/hard/kills.py FOLDER [SCENE ...]`.

Each run is killed (SIGKILL) at random moments of its whole life, half of them by the clock, half at one of the moments
at which it writes a file or just after that, and resumed, until it has been killed as often as it is to be. What it
has at its end must be, to the last bit, what it has when nobody disturbs it: history, record, summary, last state,
profiles, files for ParaView, those of its replicas too; of a study the table and every point. Clocks are left out.

The table (scene, effects, kills, at what, runs that came to their end, what differs, processor seconds) is printed, and
stored as FOLDER/kills.csv. Exit code 1: a record differs, or a run did not continue.
"""

from __future__ import annotations

import os
import random
import shutil
import sys
from dataclasses import dataclass, field
from pathlib import Path
from time import monotonic
from typing import Any

import tomli_w
from hard_scene import FOLDER
from killed_run import Death, KilledRun, differences, ended, record_of, table_of

import emclutch

CASES = FOLDER.parent
QUIET = {"output.pictures": False, "output.snapshots": 5, "accuracy.replicas": 1}
SEED = 20
AFTER = 3e-3  # s, at most, between a file's event and the death: time enough to be in the midst of writing it


@dataclass(frozen=True, slots=True)
class Scene:
    """A scene, or a study, that is killed.

    Attributes
    ----------
    name : str
    effects : str
        What it has.
    kills : int
        How often.
    source : str
        File of cases.
    values : dict
        What makes it short.
    study : dict
        Of a study: values of its points.
    """

    name: str
    effects: str
    kills: int
    source: str
    values: dict[str, Any] = field(default_factory=dict)
    study: dict[str, Any] = field(default_factory=dict)

    def written(self, folder: Path) -> KilledRun:
        """The scene as a file, and its run in a folder that is not there yet."""
        if not self.study:
            case = emclutch.load_case(CASES / self.source, QUIET | self.values)
            path = folder / "scene.toml"
            path.write_text(case.toml(), encoding="utf-8")
            return KilledRun(path, folder / "run")
        study = {"case": str(CASES / self.source), "set": QUIET | self.values, **self.study}
        path = folder / "study.toml"
        path.write_text(tomli_w.dumps({"study": study}), encoding="utf-8")
        return KilledRun(path, folder / "run", "sweep", ["--jobs", "2"])


COARSE = {"field.size_factor": 3}
SCENES = [
    Scene("voltage", "coil circuit, necks, fed back, saturation, images, rolling", 7,
          "hard/voltage_jump.toml", COARSE | {"time.end": "0.8 ms"}),
    Scene("eddy currents", "eddy currents, coil circuit, necks, fed back", 7,
          "hard/eddy_currents_with_powder.toml", COARSE | {"time.end": "1 ms"}),
    Scene("mutual", "mutual moments, fed back, saturation, images, rolling", 6,
          "hard/mutual_and_dense.toml", COARSE | {"time.end": "6 us"}),
    Scene("free output", "necks, free shaft, pictures", 6,
          "hard/light_output.toml", COARSE | {"time.end": "15 us", "output.pictures": True}),
    Scene("slots", "field in 3D", 4, "hard/slots.toml", {"field.size_factor": 4, "time.end": "8 us"}),
    Scene("profiles", "profiles, free shaft, gravity, Walton-Braun", 5,
          "hard/dense_walton_braun.toml", {"time.end": "3 ms", "output.profiles": True}),
    Scene("rigid", "rigid grains (DVI), free shafts, weight", 6,
          "hard/shot_clutch_overloaded_dvi.toml", {"time.end": "20 ms"}),
    Scene("replicas", "two replicas until the torque is known, necks, fed back, sector", 6, "quickstart.toml",
          COARSE | {"particles.solid_fraction": 0.1, "accuracy.replicas": 2, "time.window": "4 us", "time.end": "40 us",
                    "time.until": "torque 1 N m"}),
    Scene("study", "study on two processes, grains handed on, free shaft", 6, "thesis/centrifugal_held.toml",
          {"particles.count": 12, "time.end": "40 ms", "time.window": "2 ms"},
          {"warm_start": "motion.rotor.speed",
           "values": {"motion.rotor.speed": ["500 rpm", "250 rpm"], "scene.seed": [1, 2]}}),
]  # fmt: skip


def killed(scene: Scene, folder: Path, kills: int | None = None) -> dict[str, Any]:
    """Kill a scene's run as often as it is to be; the row of the table."""
    begin, chance = os.times(), random.Random(f"{SEED} {scene.name}")
    undisturbed = scene.written(folder)
    undisturbed.live()  # compiles what is not in the cache: machine code of two compilations may differ
    shutil.rmtree(undisturbed.folder)
    since = monotonic()
    events = undisturbed.live()
    life, whole = monotonic() - since, record_of(undisturbed.folder)
    undisturbed.folder.rename(folder / "undisturbed")
    assert events is not None and whole
    run, deaths, done, wrong = scene.written(folder), 0, 0, set()
    while deaths < (scene.kills if kills is None else kills):
        number = chance.randint(1, events) if chance.random() < 0.5 and not scene.study else 0
        seconds = chance.choice([0.0, chance.uniform(0.0, AFTER)]) if number else chance.uniform(0.0, life)
        if run.live(Death(number, seconds, chance.random() < 0.5)) is None:
            deaths += 1
        else:
            wrong |= _compared(run.folder, whole)
            done += 1
    if run.folder.is_dir():
        ended(run.folder)
    run.live()
    wrong |= _compared(run.folder, whole)
    spent = [after - before for before, after in zip(begin, os.times(), strict=True)][:4]
    return {
        "scene": scene.name, "effects": scene.effects, "kills": deaths, "runs": done + 1,
        "killed at": ", ".join(f"{what} {times}" for what, times in sorted(run.moments.items())),
        "compared": len(whole), "differ": len(wrong), "which": "; ".join(sorted(wrong)[:4]),
        "seconds": round(sum(spent)),
    }  # fmt: skip


def _compared(folder: Path, whole: dict[str, Any]) -> set[str]:
    """What of a run that is done is not as of the undisturbed one; it is removed."""
    found = set(differences(record_of(folder), whole))
    shutil.rmtree(folder)
    return found


def main(folder: Path, names: list[str]) -> int:
    """Kill the scenes of those names, all if there is none; the exit code."""
    rows = table_of([scene for scene in SCENES if not names or scene.name in names], killed, folder / "kills.csv")
    differ = sum(row["differ"] for row in rows)
    print(f"{sum(row.get('kills', 0) for row in rows)} kills in {len(rows)} scenes; {differ} parts of records differ")
    return 1 if differ else 0


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), sys.argv[2:]))
