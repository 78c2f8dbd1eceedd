"""A study is predicted before it runs: each point, so many at a time, and all faults of its points at once."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.device_model.device import build_device
from emclutch.results import RunFolder
from emclutch.scene.case import case_from
from emclutch.scene.study import read_study
from emclutch.simulation.stopping_rule import stopping_rule
from emclutch.studies.forecast import predict_study, total_seconds
from emclutch.studies.point import tasks_of, time_reached

CELL = """
[scene]
title = "sheared annulus"
[geometry]
kind = "shear_cell"
inner_radius = "10 mm"
outer_radius = "11.2 mm"
height = "1 mm"
[particles]
diameter = "0.3 mm"
solid_fraction = 0.45
sector = "20 deg"
[motion.rotor]
speed = "600 rpm"
[contact]
stiffness = "50 kN/m"
[time]
end = "60 ms"
[accuracy]
replicas = 1
"""


@pytest.fixture
def study(tmp_path):
    (tmp_path / "cell.toml").write_text(CELL, encoding="utf-8")

    def written(values: str) -> Path:
        path = tmp_path / "study.toml"
        path.write_text(f'[study]\ncase = "cell.toml"\n[study.values]\n{values}\n', encoding="utf-8")
        return path

    return written


def predicted(*arguments):
    reported = CliRunner().invoke(app, ["check", *map(str, arguments), "--json"])
    assert reported.exit_code == 0, reported.output
    return json.loads(reported.output)


def test_every_point_is_predicted_and_seeds_cost_the_same(study):
    found = predicted(study('"scene.seed" = [1, 2]\n"time.end" = ["60 ms", "120 ms"]'))
    short, long, *others = found["points"]
    assert others[0] == short | {"label": others[0]["label"]} and others[0]["label"] != short["label"]
    assert long["steps"] == pytest.approx(2 * short["steps"], rel=0.01) and long["seconds"] > short["seconds"]
    assert found["seconds"] == pytest.approx(sum(point["seconds"] for point in found["points"]))
    assert found["memory"] == pytest.approx(max(point["memory"] for point in found["points"]))
    assert found["disk"] == pytest.approx(sum(point["disk"] for point in found["points"]))


def test_a_target_may_end_points_early_and_the_words_say_so(study):
    path = study('"time.until" = ["none", "torque 5 %"]')
    plain, aimed = predicted(path)["points"]
    assert plain["earliest"] == plain["seconds"] and 0.0 < aimed["earliest"] < aimed["seconds"]
    reported = CliRunner().invoke(app, ["check", str(path)], env={"COLUMNS": "200"})
    assert " to " in reported.output and "2 points, 1 at a time" in reported.output


def test_of_a_point_that_has_begun_the_rest_is_predicted(study, tmp_path):
    """Half of a run at constant speed is half the work of its loop; what is done at its end is still to come."""
    read, out = read_study(study('"scene.seed" = [1, 2, 3]')), tmp_path / "out"
    tasks = tasks_of(read, out)
    for task, time in zip(tasks, ("0.0", "0.03", "0.06"), strict=True):
        run = RunFolder(out / task.name)
        run.path.mkdir(parents=True)
        run.checkpoint.touch()
        run.history.write_text(f"time\n{time}\n")
    found = predict_study(read, reached=[time_reached(task, out) for task in tasks])
    whole, half, none = (point.seconds for point in found.points)
    assert 0.0 < none < half < whole and half - none == pytest.approx(0.5 * (whole - none), rel=0.01)
    RunFolder(out / tasks[1].name).checkpoint.unlink()  # it restarts
    assert predict_study(read, reached=[time_reached(task, out) for task in tasks]).points[1].seconds == whole


def test_the_first_look_comes_after_three_times_the_start_up():
    """600 rpm over a radius of 10.6 mm and a gap of 1.2 mm: a strain of 5 takes 9 ms."""
    import tomllib

    case = case_from(tomllib.loads(CELL))
    device = build_device(case.scene)
    start_up = 5.0 * device.shear_gap / (device.shear_radius * 62.831853)
    aimed = case.with_values({"time.end": "60 ms", "time.until": "torque 5 %"}).scene
    assert stopping_rule(aimed, device, 0.06).lengths[0] == pytest.approx(3.0 * start_up)
    late = case.with_values({"time.end": "60 ms", "time.until": "torque 5 %", "time.average_from": "13 ms"}).scene
    assert stopping_rule(late, device, 0.06).lengths == pytest.approx((0.039, 0.06))
    assert stopping_rule(case.with_values({"time.until": None}).scene, device, 0.06) is None


@pytest.mark.parametrize(
    ("before", "jobs", "total"),
    [((None,) * 4, 1, 10.0), ((None,) * 4, 2, 5.0), ((None,) * 4, 9, 4.0), ((None, 0, 1, 2), 4, 10.0)],
)
def test_points_fill_the_places_that_are_free_and_chains_wait(before, jobs, total):
    assert total_seconds({0: 1.0, 1: 2.0, 2: 3.0, 3: 4.0}, before, jobs) == pytest.approx(total)
    assert total_seconds({}, before, jobs) == 0.0


def test_faults_of_all_plans_come_together_and_options_are_for_their_files(study, tmp_path):
    refused = CliRunner().invoke(app, ["check", str(study('"time.step" = ["auto", "1 ms", "2 ms"]'))])
    assert refused.exit_code == 2 and "2 errors" in refused.output
    assert "time.step = 1 ms)" in refused.output and "time.step = 2 ms)" in refused.output
    alone = CliRunner().invoke(app, ["check", str(tmp_path / "cell.toml"), "--jobs", "2"])
    assert alone.exit_code == 2 and "--jobs = 2 is for studies" in alone.output
    fixed = CliRunner().invoke(app, ["check", str(tmp_path / "study.toml"), "--set", "time.end='1 ms'"])
    assert fixed.exit_code == 2 and "study.set" in fixed.output
