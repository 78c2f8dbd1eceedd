"""Which effects do not run together, as the checks of a scene answer; the table of docs/limits.md is made again by

    python tests/project/effect_combinations.py

Each pair is put into a scene of magnetised powder that is valid by itself: what its checks report is the reason.
"""

from __future__ import annotations

import re
from itertools import combinations
from pathlib import Path
from typing import Any

from emclutch.effects import EFFECTS
from emclutch.scene.case import Case, load_case
from emclutch.scene.errors import SceneError

ROOT = Path(__file__).resolve().parents[2]
PAGE = ROOT / "docs" / "limits.md"
BEGIN, END = "<!-- combinations: made by tests/project/effect_combinations.py -->\n", "<!-- end of combinations -->\n"

NEEDED = {"magnetic_force": {}, "dipoles": {"model": "near_field", "cutoff": 2.5}, "saturation": {}}
"""Effects that others need, in every scene; the grains' images stand in those that have steel faces."""

AT_A_VOLTAGE = {"coil.current": None, "coil.voltage": "24 V"}
TABLES: dict[str, dict[str, Any]] = {
    "cohesion": {"force": "1 mN"},
    "fluid_drag": {"viscosity": "0.1 Pa s"},
}
"""Of effects that have keys without a default."""

SETTINGS: dict[str, dict[str, Any]] = {
    "slots: a field in 3D": {
        "geometry.disc_slots": {"count": 60, "fraction": 0.4, "depth": "2 mm"},
        "particles.sector": "6 deg",
    },
    "contact.method = dvi": {"contact.method": "dvi"},
    "a sheared box without `geometry.walls`": {
        "geometry": {"kind": "sheared_box", "size": ["3 mm"] * 3, "shear_rate": 1000.0},
        "field": {"source": "uniform", "field_strength": "40 kA/m", "direction": "z", "means": "macroscopic"},
        **dict.fromkeys(("particles.stands_for", "particles.region", "particles.sector")),
        "particles.diameter": "0.25 mm",
        "particles.solid_fraction": 0.3,
        **dict.fromkeys(("coil", "motion", "effects.wall_images", "time.until")),
    },
}
"""What is no effect and may exclude some, by its name in the table."""

NAMES = (*(effect.name for effect in EFFECTS), *SETTINGS)


def base() -> Case:
    """The drum of the quickstart with the effects that others need."""
    return load_case(ROOT / "cases" / "quickstart.toml", {"effects": NEEDED | {"wall_images": {}}})


def values(*names: str) -> dict[str, Any]:
    """Values of a scene that has all of these effects and settings; a setting is the last."""
    found: dict[str, Any] = {}
    for name in names:
        found |= SETTINGS.get(name, {})
    for name in names:
        if name not in SETTINGS:
            found[f"effects.{name}"] = TABLES.get(name, NEEDED.get(name, {}))
    return found | (AT_A_VOLTAGE if "coil_circuit" in names and found.get("coil", "") is not None else {})


def reason(scene: Case, *names: str) -> str:
    """Why these do not run together, without the remedy, or that one has no effect; empty where they run."""
    try:
        found = scene.with_values(values(*names)).scene
    except SceneError as error:
        first = error.faults[0]
        return f"`{first.key}` {re.sub(r'; (remove|add|take) .*', '', first.message)}"
    warned = (said for one in found.effects.present for said in one.warnings(found))
    return next((said for said in warned if "has no effect" in said), "")


def refused() -> dict[tuple[str, str], str]:
    """Reason by pair, a setting second; pairs that run are not in it."""
    scene = base()
    pairs = [pair for pair in combinations(NAMES, 2) if pair[0] not in SETTINGS]
    return {pair: why for pair in pairs if (why := reason(scene, *pair))}


def table() -> str:
    """Markdown of the refused pairs, a row each."""
    lines = ["| effect | not with | message of `check` |", "|---|---|---|"]
    for (effect, other), why in refused().items():
        lines.append(f"| `{effect}` | {other if other in SETTINGS else f'`{other}`'} | {why} |")
    return "\n".join(lines) + "\n"


def in_page() -> str:
    """The table as the page has it."""
    return PAGE.read_text(encoding="utf-8").split(BEGIN)[1].split(END)[0]


if __name__ == "__main__":
    text = PAGE.read_text(encoding="utf-8")
    PAGE.write_text(text.replace(BEGIN + in_page() + END, BEGIN + table() + END), encoding="utf-8")
