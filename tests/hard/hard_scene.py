"""A hard scene with its invariants, and its runs: the short one of the gate and the long ones of `make stability`."""

from __future__ import annotations

import re
import tomllib
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from finished_run import FinishedRun
from invariants import margins

import emclutch
from emclutch.results.errors import RunError
from emclutch.scene.case import Case
from emclutch.scene.errors import SceneError
from emclutch.simulation.plan import make_plan

FOLDER = Path(__file__).resolve().parents[2] / "cases" / "hard"
TABLE = FOLDER / "invariants.toml"
BARE = {"output.snapshots": 0, "output.pictures": False, "output.formats": [], "accuracy.replicas": 1}
STEPS_PER_CONTACT = (10.0, 32.0, 100.0)  # by DEM; the default is 20, and 10 the least that is allowed
OF_DVI_STEP = (0.32, 1.0, 3.2)  # by DVI, of the default step
DEFAULT_STEPS = 20.0


def kind_of_step(values: Mapping[str, Any], number: int) -> str:
    """Whether the values of a long run, the `number`-th of its scene, make the step longer or shorter."""
    if (steps := values.get("time.steps_per_contact")) is not None:
        return "longer" if steps < DEFAULT_STEPS else "shorter"
    return ("shorter", "default", "longer")[number] if values else "default"


@dataclass(frozen=True, slots=True)
class HardScene:
    """A scene of cases/hard with what must hold in it.

    Attributes
    ----------
    name : str
        Of its file.
    bounds : dict
        Bound by invariant, those of every scene among them.
    short : dict
        Values that the gate sets.
    stops : str or None
        Pattern of the explanation with which the scene is refused, or stops; None: it runs to its end.
    may_stop : dict
        Patterns of explanations with which long runs may stop, by the step: "longer", "shorter", "default" or "any".
    """

    name: str
    bounds: dict[str, Any]
    short: dict[str, Any] = field(default_factory=dict)
    stops: str | None = None
    may_stop: dict[str, str] = field(default_factory=dict)

    def case(self, values: Mapping[str, Any] | None = None) -> Case:
        """The scene without pictures and frames, with `values`."""
        return emclutch.load_case(FOLDER / f"{self.name}.toml", BARE | dict(values or {}))

    def run(self, folder: Path, values: Mapping[str, Any] | None = None) -> FinishedRun:
        """Raises what a run raises: SceneError, RunError."""
        case = self.case(values)
        emclutch.run(case, out=folder)
        return FinishedRun.of(case, folder)

    def explanation(self, folder: Path, values: Mapping[str, Any] | None = None) -> str | None:
        """With what words the run was refused or stopped; None where it ran to its end."""
        try:
            self.run(folder, values)
        except (SceneError, RunError) as error:
            return str(error)
        return None

    def is_explained(self, words: str | None) -> bool:
        """Whether these are the words with which the scene is to stop."""
        return words is not None and self.stops is not None and re.search(self.stops, words, re.DOTALL) is not None

    def may_stop_with(self, words: str, step: str) -> bool:
        """Whether a long run at a step, "longer", "shorter" or "default", may stop with these words."""
        patterns = [self.may_stop[name] for name in (step, "any") if name in self.may_stop]
        return any(re.search(pattern, words, re.DOTALL) for pattern in patterns)

    def margins(self, run: FinishedRun) -> dict[str, float]:
        """Margin by invariant."""
        return margins(run, self.bounds)

    def steps(self) -> Iterator[dict[str, Any]]:
        """Values that set the steps of the long runs: a decade around the default, which is one of them by DVI."""
        case = self.case()
        if case.scene.contact.method == "dem":
            yield from ({"time.steps_per_contact": n, "time.step": "auto"} for n in STEPS_PER_CONTACT)
            return
        dt = make_plan(case)[1].dt
        yield from ({"contact.dvi.step": factor * dt, "contact.dvi.allow_long_step": True} for factor in OF_DVI_STEP)


def hard_scenes() -> list[HardScene]:
    """All scenes that ``cases/hard/invariants.toml`` names, in its order."""
    table = tomllib.loads(TABLE.read_text(encoding="utf-8"))
    every = table.pop("every")
    scenes = []
    for name, entry in table.items():
        short, stops, may_stop = entry.pop("short", {}), entry.pop("stops", None), entry.pop("may_stop", {})
        scenes.append(HardScene(name, every | entry, short, stops, may_stop))
    return scenes
