"""What the program makes of a scene, through the command line, and whether it keeps its promises there.

Whatever it is given: exit code 0, 1 or 2, no traceback; a refusal names a key, a run that fails says why, and what a
run leaves behind holds finite numbers only. What is right is run if it is predicted to be short, and if its kernels are
among those that the other tests compile; else it is only checked.
"""

from __future__ import annotations

import json
import re
import traceback
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import tomli_w
from random_scenes import RandomScene
from typer.testing import CliRunner, Result

from emclutch.cli.main import app
from emclutch.results import read_history
from emclutch.scene.case import load_case
from emclutch.scene.errors import SceneError
from emclutch.scene.model import Scene
from emclutch.scene.schema_walk import all_keys
from emclutch.scene.study import read_study
from emclutch.simulation.kernel_warm_up import kind_of
from emclutch.simulation.plan import make_plan
from emclutch.simulation.plan_in_words import plan_in_words

KEYS = {*all_keys(Scene), "study", "study.case"}
UNDEFINED = ("inertial_number",)  # of a history: without a torque there is none
MAX_VISITS, MAX_STEPS, MAX_WINDOWS = 400_000, 30_000, 250  # steps times grains; of a field that is solved 12 windows
MAX_SOLVED_WINDOWS = 12
# Kinds of step (`emclutch.simulation.kernel_warm_up.kind_of`) that other tests compile too, but for the energy
# budget, which all have; sizes count in the linear law only
KINDS = {
    "linear", "linear sector", "linear resistance", "linear resistance sector", "linear resistance sector attraction",
    "linear sector attraction", "linear sizes", "linear resistance sizes", "linear sizes attraction",
    "linear sizes sector attraction", "hertz_mindlin", "hertz_mindlin resistance", "hertz", "walton_braun",
    "walton_braun resistance", "thesis",
}  # fmt: skip


@dataclass(frozen=True, slots=True)
class Verdict:
    """What became of a scene.

    Attributes
    ----------
    outcome : str
        refused, checked (right, and not run), stopped or ran.
    reason : str
        Key of the refusal, why it was not run, or words of the failure.
    broken : str
        The promise that was broken; empty where all were kept.
    """

    outcome: str
    reason: str = ""
    broken: str = ""


def judge(scene: RandomScene, folder: Path) -> Verdict:
    """Write a scene into an empty folder, and check and run it there."""
    for name, text in scene.files.items():
        (folder / name).write_text(text, encoding="utf-8")
    text = tomli_w.dumps(scene.data).encode()
    if scene.cut is not None:
        text = text[: int(scene.cut * len(text))] + b"\xff"
    (folder / "scene.toml").write_bytes(text)
    if scene.study is not None:
        (folder / "study.toml").write_text(tomli_w.dumps(scene.study), encoding="utf-8")
        return _study(scene, folder)
    checked = CliRunner().invoke(app, ["check", str(folder / "scene.toml"), "--json"])
    if broken := _broken_by(checked):
        return Verdict("check", broken=broken)
    if checked.exit_code != 0:
        return _refusal(scene, checked)
    if scene.named:
        return Verdict("checked", broken=f"{scene.named[0]} was not refused")
    plan = _strict(checked.stdout)["plan"]
    case = load_case(folder / "scene.toml")
    why_not = _not_run(case, plan)
    if why_not:
        return Verdict("checked", why_not)
    done = CliRunner().invoke(app, ["run", str(folder / "scene.toml"), "--out", str(folder / "run"), "--json"])
    if broken := _broken_by(done):
        return Verdict("run", broken=broken)
    if done.exit_code == 2:
        return Verdict("run", broken=f"checked, and refused when it was run: {done.stderr}")
    if done.exit_code == 1:
        return Verdict("stopped", _in_short(done.stderr))
    return Verdict("ran", broken=_not_finite(folder / "run", done.stdout))


def _study(scene: RandomScene, folder: Path) -> Verdict:
    """A study has no check of its own: it is swept where all of its points may run, and where it is refused."""
    file = folder / "study.toml"
    try:
        cases = [case for _, case in read_study(file).cases()]
        why_not = next(filter(None, (_not_run(case, plan_in_words(*make_plan(case))) for case in cases)), "")
    except (SceneError, ValueError):  # of a plan: ValueError
        why_not = ""
    if why_not:
        return Verdict("checked", why_not)
    swept = CliRunner().invoke(app, ["sweep", str(file), "--out", str(folder / "study")])
    if broken := _broken_by(swept):
        return Verdict("sweep", broken=broken)
    if swept.exit_code == 2:
        return _refusal(scene, swept)
    if swept.exit_code == 1:
        return Verdict("stopped", _in_short(swept.stderr))
    points = sorted((folder / "study").glob("[0-9]*_*"))
    return Verdict("ran", "a study", next(filter(None, (_not_finite(point) for point in points)), ""))


def _broken_by(result: Result) -> str:
    """What no command may do."""
    if result.exception is not None and not isinstance(result.exception, SystemExit):
        where = traceback.extract_tb(result.exception.__traceback__)[-1]
        return f"traceback: {type(result.exception).__name__}: {result.exception} ({where.filename}:{where.lineno})"
    if result.exit_code not in (0, 1, 2):
        return f"exit code {result.exit_code}"
    if "Traceback" in result.output:
        return "a traceback in what it says"
    if result.exit_code and not result.stderr.strip():
        return "it failed without a word"
    return ""


def _refusal(scene: RandomScene, result: Result) -> Verdict:
    """A refusal names the key that is wrong for certain, any key of the schema, or the file."""
    words = result.stderr
    keys = [key for key in re.findall(r"^  - ([\w.]+)", words, re.MULTILINE) if key.split(".")[0] in KEYS]
    keys += sorted(key for key in KEYS if "." in key and re.search(rf"(?<![\w.]){re.escape(key)}(?!\w)", words))
    files = ("is not TOML", "is not text in UTF-8", "does not exist", "is a folder")
    reason = next(iter(keys), "") or next((word for word in files if word in words), "")
    broken = ""
    if result.exit_code != 2:
        broken = f"exit code {result.exit_code} of a check: {words}"
    elif scene.named and scene.named[0] not in words:
        broken = f"{scene.named[0]} is not named: {words}"
    elif not reason and not scene.named and not any(name in words for name in scene.files):
        broken = f"no key is named: {words}"
    return Verdict("refused", reason, broken)


def _not_run(case: Any, plan: dict[str, str]) -> str:
    """Why a scene that is right is not run here; empty where it is."""
    scene = case.scene
    steps, grains = map(int, re.search(r"(\d+) steps of (\d+) grains", plan["cost by part"]).groups())  # type: ignore
    windows = int(re.search(r"(\d+) windows", plan["coupling window"])[1])  # type: ignore
    settles = scene.particles.settles and (scene.particles.settle_longest or 1.0) > 2e-3
    if "replicas" in plan:
        return "several replicas"
    if steps > MAX_STEPS or steps * grains > MAX_VISITS or settles:
        return "too long"
    if windows > (MAX_SOLVED_WINDOWS if "mesh" in plan else MAX_WINDOWS):
        return "too many windows"
    return "" if _is_compiled(scene) else "another kind of step"


def _is_compiled(scene: Any) -> bool:
    """Whether other tests have a step of the scene's kind."""
    if scene.contact.method == "dvi":
        return not (scene.contact.dvi.springs and scene.contact.dvi.friction_law == "convex")
    law, *parts = kind_of(scene)
    kept = [part for part in parts if part != "energies" and (law == "linear" or part != "sizes")]
    return scene.output.energy_budget and " ".join((law, *kept)) in KINDS


def _in_short(words: str) -> str:
    """Why a run failed, without numbers and paths: what failures have in common."""
    why = words.partition("failed: ")[2].partition("\n(log:")[0]
    return re.sub(r"[-+]?[\d.]+(e[-+]?\d+)?|\S*/\S*", "_", " ".join(why.split()))[:90]


def _strict(text: str) -> Any:
    """JSON that holds no number that is none."""

    def refuse(name: str) -> None:
        raise ValueError(f"{name} in JSON")

    return json.loads(text, parse_constant=refuse)


def _not_finite(folder: Path, printed: str | None = None) -> str:
    """What of a run's results is no finite number; empty where all are."""
    history = read_history(folder / "history.csv").drop(columns=list(UNDEFINED), errors="ignore")
    bad = [name for name in history if not np.isfinite(history[name].to_numpy(dtype=float)).all()]
    if bad:
        return f"history.csv: {', '.join(bad)}"
    for text in (printed, (folder / "summary.json").read_text(encoding="utf-8")):
        try:
            _strict(text or "{}")
        except ValueError as error:
            return f"summary: {error}"
    for file in sorted(folder.glob("*.h5")):
        with h5py.File(file) as opened:
            bad = [name for name, data in _arrays(opened) if not np.isfinite(data).all()]
        # of the checkpoint the grains: what else it keeps is no result, and may be infinite (a step that may be any)
        bad = [name for name in bad if not name.endswith(UNDEFINED) and not name.startswith("state/source")]
        if bad:
            return f"{file.name}: {', '.join(bad[:5])}"
    return ""


def _arrays(file: h5py.File) -> Iterator[tuple[str, np.ndarray]]:
    found: list[tuple[str, np.ndarray]] = []

    def take(name: str, node: Any) -> None:
        if isinstance(node, h5py.Dataset) and node.dtype.kind == "f":
            found.append((node.parent.name if name.endswith("value") else name, node[()]))

    file.visititems(take)
    yield from found
