"""A point costs the same in a study of any size: it is checked once, and no file is opened again for other points."""

import json
import os
import shutil
import sys
from collections import Counter
from itertools import count
from pathlib import Path

import pytest

from emclutch.results import HistoryWriter, RunFolder, load_result
from emclutch.results.study_result import load_study
from emclutch.scene import case as scene_case
from emclutch.scene.case import load_case
from emclutch.scene.study import read_study
from emclutch.studies import point, throttle
from emclutch.studies.sweep import collect, sweep

GOOD = Path(__file__).parents[1] / "scene" / "broken" / "good.toml"
opened = Counter()
"""Files that were opened, by their path; counted while `counting` has an entry, as a hook cannot be taken back."""
counting = []


def count_opened(event, arguments):
    if event == "open" and counting and isinstance(arguments[0], (str, os.PathLike)):
        opened[str(arguments[0])] += 1


sys.addaudithook(count_opened)


def run(case, *, out, resume, **_):
    """Write the files of a finished run, whose files are not counted: they are its own work."""
    while_counted = counting.copy()
    counting.clear()
    folder = RunFolder.create(out, case.toml(), resume=resume)
    torque = case.scene.contact.friction
    with HistoryWriter(folder.history) as history:
        history.append({"time": case.scene.time.end, "torque_disc": torque})
    found = {"mean": torque, "standard_error": 0.1, "converged": True, "reason": ""}
    folder.write_summary({"torque": found, "typical_overlap": 0.0, "seconds": {"whole_run": 1.0}})
    counting.extend(while_counted)
    return load_result(folder.path)


@pytest.fixture
def checks(monkeypatch):
    """Number of scenes that were checked; tables are written after the first point and at the end."""
    found = []
    validate = scene_case._validate
    monkeypatch.setattr(scene_case, "_validate", lambda *given: found.append(1) or validate(*given))
    monkeypatch.setattr(point, "run", run)
    monkeypatch.setattr(throttle, "monotonic", count().__next__)  # to write them once takes 1
    monkeypatch.setattr(throttle, "MAX_FRACTION", 1e-9)
    yield found
    counting.clear()


def opens(folder, step):
    """Files in a folder that a step opens."""
    opened.clear()
    counting.append(True)
    step()
    counting.clear()
    return sum(number for path, number in opened.items() if path.startswith(str(folder)))


def work(tmp_path, checks, points):
    """Opened files of a sweep, of continuing it, of collecting and loading it; checked scenes."""
    study = tmp_path / f"{points}.toml"
    study.write_text(
        f'[study]\ncase = "{GOOD}"\n[study.values]\n"contact.friction" = {{ from = 0.1, to = 0.6, count = {points} }}'
    )
    out = tmp_path / f"{points}"
    checks.clear()
    found = {"sweep": opens(out, lambda: sweep(study, out=out)), "checked": len(checks)}
    checks.clear()
    found |= {"resume": opens(out, lambda: sweep(study, out=out, resume=True)), "checked again": len(checks)}
    return found | {"collect": opens(out, lambda: collect(study, out)), "load": opens(out, lambda: load_study(out))}


def test_the_work_per_point_does_not_grow_with_their_number(tmp_path, checks):
    few, more, many = (work(tmp_path, checks, points) for points in (4, 8, 16))
    assert {name: many[name] - more[name] for name in many} == {name: 2 * (more[name] - few[name]) for name in more}
    a_point = {name: (many[name] - more[name]) / 8 for name in many}
    assert a_point["resume"] == a_point["collect"] == 2.0 and a_point["load"] == 0.0  # its row and its summary
    assert a_point["checked"] == a_point["checked again"] == 1.0


def test_a_point_that_was_continued_alone_is_read_again_and_a_damaged_row_is_rebuilt(tmp_path, checks):
    study = tmp_path / "study.toml"
    study.write_text(f'[study]\ncase = "{GOOD}"\n[study.values]\n"contact.friction" = [0.1, 0.2, 0.3]\n')
    out = sweep(study, out=tmp_path / "out")
    (folder,) = map(RunFolder, out.glob("001_*"))
    summary = folder.read_summary()
    summary["torque"]["mean"] = 7.0
    folder.write_summary(summary)
    assert collect(study, out).is_complete
    assert load_study(out).table["torque"].tolist() == [0.1, 7.0, 0.3]
    (folder.path / "row.json").write_text('{"state": "do')
    sweep(study, out=out, resume=True)
    assert load_study(out).table["torque"].tolist() == [0.1, 7.0, 0.3]
    assert json.loads((folder.path / "row.json").read_text())["state"] == "done"
    shutil.copytree(out, tmp_path / "copy", copy_function=shutil.copyfile)  # with other times
    assert collect(study, tmp_path / "copy").is_complete


def test_points_share_the_sections_that_are_the_same(tmp_path):
    study = tmp_path / "study.toml"
    study.write_text(f'[study]\ncase = "{GOOD}"\n[study.values]\n"contact.friction" = [0.1, 0.2]\n')
    first, second = (case for _, case in read_study(study).cases())
    assert second.scene.geometry is first.scene.geometry and second.data["geometry"] is first.data["geometry"]
    assert (first.scene.contact.friction, second.scene.contact.friction) == (0.1, 0.2)
    assert second == load_case(GOOD, {"contact.friction": 0.2})
