"""Which scene each picture of the gallery was made of; a new row after a picture was made again:

    python tests/project/pictures.py grains.png

The table is docs/pictures.csv: picture, scene, and the hash of what the scene says, comments aside.
"""

from __future__ import annotations

import csv
import hashlib
import json
import sys
import tomllib
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
TABLE = ROOT / "docs" / "pictures.csv"


def gallery() -> dict[str, str]:
    """Scene below cases/ by picture, as docs/gallery.md has them."""
    block = (ROOT / "docs" / "gallery.md").read_text(encoding="utf-8").split("```{gallery}\n")[1].split("```")[0]
    return {picture: scene for scene, picture in map(str.split, block.splitlines())}


def scene_hash(text: str) -> str:
    """Hash of a scene's content: comments and the order of its keys do not matter."""
    return hashlib.sha256(json.dumps(tomllib.loads(text), sort_keys=True).encode()).hexdigest()[:16]


def recorded() -> dict[str, tuple[str, str]]:
    """Scene and hash by picture."""
    with TABLE.open(encoding="utf-8", newline="") as file:
        return {row["picture"]: (row["scene"], row["hash"]) for row in csv.DictReader(file)}


def outdated() -> list[str]:
    """Pictures of the gallery whose scene has changed since, or that have no row."""
    rows = recorded()
    return [
        picture
        for picture, scene in gallery().items()
        if rows.get(picture) != (scene, scene_hash((ROOT / "cases" / scene).read_text(encoding="utf-8")))
    ]


def record(picture: str) -> None:
    """Write the row of a picture that was made of the present scene."""
    scene = gallery()[picture]
    rows = recorded() | {picture: (scene, scene_hash((ROOT / "cases" / scene).read_text(encoding="utf-8")))}
    with TABLE.open("w", encoding="utf-8", newline="") as file:
        writer = csv.writer(file, lineterminator="\n")
        writer.writerow(("picture", "scene", "hash"))
        writer.writerows((name, *row) for name, row in sorted(rows.items()))


if __name__ == "__main__":
    for name in sys.argv[1:]:
        record(name)
