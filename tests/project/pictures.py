"""Redraws the pictures of docs/ that are older than what they show: `make pictures`.

    python tests/project/pictures.py                        # the outdated ones
    python tests/project/pictures.py grains.png lock_up.png    # these; or: all
    python tests/project/pictures.py --record grains.png    # made by hand of the present sources

docs/pictures.csv has a row a picture: what it shows (`sources`: scenes and tables, separated by blanks), the `command`
that draws it, and the `hash` of the sources when it was drawn. In a command RUN is a folder below runs/pictures for
the sources and their hash, and PICTURE the file to write; parts are separated by `&&`. What several need is run
once and kept, but by `all` not for the next time; a run that was interrupted starts again. Costs are in the headers of
the scenes.
"""

from __future__ import annotations

import csv
import hashlib
import json
import os
import shutil
import subprocess
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "docs" / "pictures.csv"
COLUMNS = ("picture", "sources", "command", "hash")


def gallery() -> dict[str, str]:
    """Scene below cases/ by picture, as docs/gallery.md has them."""
    block = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8").split("```{gallery}\n")[1].split("```")[0]
    return {picture: scene for scene, picture in map(str.split, block.splitlines())}


def scene_hash(text: str) -> str:
    """Hash of a scene's content: comments and the order of its keys do not matter."""
    return hashlib.sha256(json.dumps(tomllib.loads(text), sort_keys=True).encode()).hexdigest()[:16]


def source_hash(sources: str) -> str:
    """Hash of scenes, with that which a study varies, of tables without their comments, and of other files."""
    parts, paths = [], [ROOT / source for source in sources.split()]
    for path in paths:
        text = path.read_text(encoding="utf-8")
        if path.suffix == ".csv":
            text = "".join(line for line in text.splitlines(keepends=True) if not line.startswith("#"))
        parts.append(scene_hash(text) if path.suffix == ".toml" else hashlib.sha256(text.encode()).hexdigest())
        if path.suffix == ".toml" and "study" in (scene := tomllib.loads(text)):
            paths.append(path.parent / scene["study"]["case"])
    return hashlib.sha256(" ".join(parts).encode()).hexdigest()[:16]


def recorded() -> dict[str, dict[str, str]]:
    """The rows of the table by picture."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return {row["picture"]: row for row in csv.DictReader(file)}


def outdated() -> list[str]:
    """Pictures whose sources have changed since they were drawn."""
    return [name for name, row in recorded().items() if row["hash"] != source_hash(row["sources"])]


def commands(picture: str) -> list[str]:
    """What draws a picture, with the folder of its runs."""
    row = recorded()[picture]
    run = f"runs/pictures/{Path(row['sources'].split()[0]).stem}-{source_hash(row['sources'])}"
    return [part.replace("RUN", run).replace("PICTURE", f"docs/{picture}") for part in row["command"].split(" && ")]


def output_folder(command: str) -> str | None:
    """The folder that a run, a study or an accuracy study writes; None of other commands."""
    words = command.split()
    makes_one = words[0] == "emclutch" and words[1] in ("run", "sweep", "accuracy")
    return words[words.index("--out") + 1] if makes_one else None


def refuse_unknown(pictures: list[str]) -> None:
    """Exit with a message that names the pictures of which the table has no row."""
    rows = recorded()
    if unknown := [name for name in pictures if name not in rows]:
        sys.exit(f"docs/pictures.csv has no picture {', '.join(unknown)}; it has {', '.join(rows)}; or take: all")


def record(picture: str) -> None:
    """Write the hash of a picture that was drawn of the present sources."""
    rows = recorded()
    rows[picture]["hash"] = source_hash(rows[picture]["sources"])
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        writer.writerows(row for _, row in sorted(rows.items()))


def draw(pictures: list[str], reuse: bool = True) -> int:
    """Run the commands of some pictures; the number of those that failed. `reuse`: also runs of an earlier call."""
    path = f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"
    done, failed = set(), 0
    (ROOT / "runs" / "pictures").mkdir(parents=True, exist_ok=True)
    for name in pictures:
        for command in commands(name):
            if (out := output_folder(command)) is not None:
                folder = ROOT / out
                if out in done or (reuse and (folder / "complete").exists()):
                    continue
                shutil.rmtree(folder, ignore_errors=True)
            print(f"{name}: {command}", flush=True)
            if subprocess.run(command, shell=True, cwd=ROOT, env=os.environ | {"PATH": path}).returncode:
                print(f"{name} was not drawn", file=sys.stderr)
                failed += 1
                break
            if out is not None:
                (folder / "complete").touch()
                done.add(out)
        else:
            record(name)
    return failed


if __name__ == "__main__":
    given = sys.argv[1:]
    if given[:1] == ["--record"]:
        refuse_unknown(given[1:])
        for name in given[1:]:
            record(name)
    elif given == ["all"]:
        sys.exit(min(draw(sorted(recorded()), reuse=False), 1))
    else:
        refuse_unknown(given)
        sys.exit(min(draw(given or outdated()), 1))
