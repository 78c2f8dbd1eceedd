"""Random scenes and broken ones through the command line: `python tests/hard/random_runs.py FOLDER [COUNT [SEED]]`.

What must hold is in `scene_verdict`. Prints the seed, with which the same scenes are drawn again, and a table: what was
drawn, and how often it was refused, checked only, stopped or run, by reason; it is stored as FOLDER/random.csv. Scenes
that break a promise are kept as FOLDER/find-NNN with what was done to them. Exit code 1: there are such scenes.
"""

from __future__ import annotations

import random
import shutil
import signal
import sys
import tempfile
import warnings
from collections import Counter
from pathlib import Path

import pandas
from random_faults import drawn
from random_scenes import RandomScene
from scene_verdict import Verdict, judge

from geometry.kernels.cache import specialisations

LONGEST = 120  # seconds of processor time: no scene that is run here takes a tenth of it
COUNT = 1000


class Hangs(Exception):
    """A scene took longer than any may."""


def _hangs(number: int, frame: object) -> None:
    raise Hangs(f"more than {LONGEST} s of processor time")


def verdict_of(scene: RandomScene, folder: Path) -> Verdict:
    """The verdict, also where the program does not come back."""
    signal.signal(signal.SIGPROF, _hangs)
    signal.setitimer(signal.ITIMER_PROF, LONGEST)
    try:
        return judge(scene, folder)
    except Hangs as hang:
        return Verdict("hung", broken=str(hang))
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)


def main(folder: Path, count: int, first: int) -> int:
    """Judge so many scenes; the exit code."""
    folder.mkdir(parents=True, exist_ok=True)
    warnings.simplefilter("error")
    warnings.filterwarnings("ignore", "Glyph")  # of a title in letters that matplotlib's font lacks
    print(f"{count} random scenes of the seed {first}", flush=True)
    counts: Counter[tuple[str, str]] = Counter()
    broken: Counter[tuple[str, str]] = Counter()
    finds: list[str] = []

    for scene in drawn(count, first):
        with tempfile.TemporaryDirectory() as scratch:
            found = verdict_of(scene, Path(scratch))
            counts[found.outcome, found.reason] += 1
            if found.broken:
                broken[found.outcome, found.reason] += 1
                kept = folder / f"find-{len(finds):03d}"
                shutil.rmtree(kept, ignore_errors=True)
                shutil.copytree(scratch, kept)
                finds.append(f"{kept.name}: {found.broken} ({'; '.join(scene.breaks) or 'as drawn'})")
                (kept / "find.txt").write_text(finds[-1] + "\n", encoding="utf-8")
                print(finds[-1], flush=True)
    rows = [(*kind, number, broken[kind]) for kind, number in sorted(counts.items())]
    pandas.DataFrame(rows, columns=["outcome", "reason", "scenes", "broken"]).to_csv(folder / "random.csv", index=False)
    print(f"\n{sum(counts.values())} drawn, {len(specialisations())} specialisations of kernels")
    for outcome in ("ran", "stopped", "checked", "refused"):
        reasons = {reason: number for (name, reason), number in counts.items() if name == outcome}
        print(f"{sum(reasons.values()):6d} {outcome}")
        for reason, number in sorted(reasons.items(), key=lambda item: -item[1]):
            if reason:
                print(f"{number:10d}   {reason}")
    print(f"{len(finds):6d} broke a promise" + "".join(f"\n{find}" for find in finds))
    return 1 if finds else 0


if __name__ == "__main__":
    given_seed = int(sys.argv[3]) if len(sys.argv) > 3 else random.SystemRandom().randrange(2**32)
    sys.exit(main(Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else COUNT, given_seed))
