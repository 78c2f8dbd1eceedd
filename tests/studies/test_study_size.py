"""A point costs the same in a study of any size: it is checked once, and no file is opened again for other points."""

import os
import sys
from collections import Counter
from itertools import count
from pathlib import Path

import pytest

from emclutch.results import HistoryWriter, RunFolder, load_result
from emclutch.results.study_result import load_study
from emclutch.scene import case as scene_case
from emclutch.scene.study import read_study
from emclutch.studies import tasks as study_tasks
from emclutch.studies import throttle
from emclutch.studies.gather import gather
from emclutch.studies.point_index import INDEX
from emclutch.studies.sweep import sweep

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
    monkeypatch.setattr(study_tasks, "run", run)
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
    """Opened files of a sweep, of continuing it, loading it, of 2 parts, of gathering them twice; checked scenes."""
    study = tmp_path / f"{points}.toml"
    study.write_text(
        f'[study]\ncase = "{GOOD}"\n[study.values]\n"contact.friction" = {{ from = 0.1, to = 0.6, count = {points} }}'
    )
    one, parts = tmp_path / f"{points}" / "one", tmp_path / f"{points}" / "parts"
    checks.clear()
    found = {
        "sweep": opens(one, lambda: sweep(study, out=one)),
        "checked": len(checks),
        "resume": opens(one, lambda: sweep(study, out=one, resume=True)),
        "load": opens(one, lambda: load_study(one)),
        "parts": opens(parts, lambda: [sweep(study, out=parts, part=(k, 2), resume=True) for k in (1, 2)]),
        "gather": opens(parts, lambda: gather(study, parts)),
    }
    checks.clear()
    return found | {"again": opens(parts, lambda: gather(study, parts)), "checked to gather": len(checks)}


def test_the_work_per_point_does_not_grow_with_their_number(tmp_path, checks):
    few, more, many = (work(tmp_path, checks, points) for points in (4, 8, 16))
    assert {name: many[name] - more[name] for name in many} == {name: 2 * (more[name] - few[name]) for name in more}
    a_point = {name: (many[name] - more[name]) / 8 for name in many}
    assert a_point["resume"] == a_point["load"] == a_point["gather"] == a_point["again"] == 0.0
    assert a_point["checked"] == 2.0  # with the whole study, and by the process that runs the point
    assert a_point["checked to gather"] == 1.0


def test_an_index_that_is_old_damaged_or_gone_changes_nothing(tmp_path, checks):
    study = tmp_path / "study.toml"
    study.write_text(f'[study]\ncase = "{GOOD}"\n[study.values]\n"contact.friction" = [0.1, 0.2, 0.3]\n')
    out = sweep(study, out=tmp_path / "out")
    table = (out / "study.csv").read_bytes()
    folder = RunFolder(out / "point-001")
    summary = folder.read_summary()
    summary["torque"]["mean"] = 7.0  # it was resumed alone
    folder.write_summary(summary)
    gather(study, out)
    assert load_study(out).table["torque"].tolist() == [0.1, 7.0, 0.3]
    summary["torque"]["mean"] = 0.2
    folder.write_summary(summary)
    with (out / INDEX).open("a") as file:
        file.write('{"name": "point-000", "sce')
    gather(study, out)
    assert (out / "study.csv").read_bytes() == table
    (out / INDEX).unlink()
    gather(study, out)
    assert (out / "study.csv").read_bytes() == table and read_study(study) is not None
