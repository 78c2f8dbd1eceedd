"""A study in parts is the same study: same folders, same tables, whoever runs which part, and in which order."""

import os
import platform
import subprocess
import sys
import threading
from pathlib import Path

import pytest
from stand_in_runs import FRICTION, SPEED, study_file
from typer.testing import CliRunner

from emclutch.cli.main import app
from emclutch.results import OutputError, lease
from emclutch.results.errors import Interrupted, RunError
from emclutch.results.folder_lock import FolderInUse
from emclutch.results.lease import lease_holder, leased, leased_in_turn
from emclutch.scene.errors import SceneError
from emclutch.scene.study import read_study
from emclutch.studies.gather import gather
from emclutch.studies.sweep import sweep
from emclutch.studies.tasks import STOP

ROOT = Path(__file__).parents[2]
SIX = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]


def study_of(folder, values=None, **own):
    return study_file(folder, values or {FRICTION: SIX}, **own)


def tables(folder):
    """Files of a study, without its log, its index and its page, which have times."""
    found = (path for path in folder.iterdir() if path.is_file() and path.suffix not in (".log", ".jsonl", ".html"))
    return {path.name: path.read_bytes() for path in found}


def fails(_):
    raise RunError("the grains are gone")


def test_parts_in_any_order_make_the_tables_of_one_process(tmp_path, runs):
    """Byte for byte; and gathering again, or running a part again, changes nothing."""
    study = study_of(tmp_path, {"scene.seed": [1, 2], FRICTION: SIX[:3]})
    alone = sweep(study, out=tmp_path / "alone")
    runs.asked.clear()
    out = tmp_path / "out"
    for which in (4, 2, 1, 3):
        assert sweep(study, out=out, part=(which, 4), resume=True) == out
    assert runs.points == [f"point-00{n}" for n in (3, 1, 5, 0, 4, 2)]  # points 4; 2, 6; 1, 5; 3
    assert not tables(out)
    for _ in range(2):
        found = gather(study, out)
        assert found.complete and found.done == 6 and found.lines() == ["6 of 6 points are done, 0 failed, 0 missing"]
        assert tables(out) == tables(alone) and {"study.csv", "seeds.csv"} <= set(tables(out))
    runs.asked.clear()
    sweep(study, out=out, part=(2, 4), resume=True)
    assert not runs.asked and [path.name for path in (out / "parts").glob("*.lease")] == []


def test_a_study_goes_from_one_process_to_parts_and_back(tmp_path, runs):
    study, out = study_of(tmp_path), tmp_path / "out"

    def stops(_):
        raise KeyboardInterrupt

    runs.acts = {0.3: stops}
    with pytest.raises(Interrupted):
        sweep(study, out=out)  # points 1 and 2 are done, 3 has begun
    with pytest.raises(OutputError, match=r"point-000, point-002 in .*continue this part with --resume"):
        sweep(study, out=out, part=(1, 2))
    runs.acts = {}
    sweep(study, out=out, part=(1, 2), resume=True)
    assert runs.points[3:] == ["point-002", "point-004"]
    sweep(study, out=out, resume=True)
    assert runs.points[5:] == ["point-003", "point-005"]
    assert tables(out)["study.csv"] == tables(sweep(study, out=tmp_path / "alone"))["study.csv"]


def test_what_is_missing_and_what_has_failed_is_told_with_a_code(tmp_path, runs):
    study, out = study_of(tmp_path), tmp_path / "out"
    ask = CliRunner().invoke
    here = [str(study), "--out", str(out)]
    runs.acts = {0.4: fails}
    assert ask(app, ["sweep", *here, "--part", "1/3", "--resume"]).exit_code == 1  # points 1 and 4
    assert ask(app, ["sweep", *here, "--part", "2/3"]).exit_code == 0
    answer = ask(app, ["sweep", *here, "--gather"])
    assert answer.exit_code == 1
    assert "3 of 6 points are done, 1 failed, 2 missing" in answer.stdout
    assert "failed: point-003 (contact.friction = 0.4): the grains are gone" in answer.stdout
    assert "missing, not begun: point-002, point-005" in answer.stdout
    assert "parts with points to do, to run again with --resume: 1,3 of 3" in answer.stdout
    assert "the grains are gone" in tables(out)["failures.csv"].decode()
    runs.acts = {}
    assert ask(app, ["sweep", *here, "--part", "1/3", "--resume"]).exit_code == 0
    answer = ask(app, ["sweep", *here, "--gather"])
    assert answer.exit_code == 3 and "4 of 6 points are done, 0 failed, 2 missing" in answer.stdout
    assert "failures.csv" not in tables(out)
    assert ask(app, ["sweep", *here, "--part", "3/3", "--resume"]).exit_code == 0
    assert ask(app, ["sweep", *here, "--gather"]).exit_code == 0


def test_points_that_hand_on_their_grains_stay_in_one_part(tmp_path, runs):
    values = {SPEED: ["1 rpm", "2 rpm", "3 rpm"], FRICTION: [0.1, 0.2]}
    study, out = study_of(tmp_path, values, warm_start=SPEED), tmp_path / "out"
    sweep(study, out=out, part=(2, 2))
    assert [(asked.point, asked.start) for asked in runs.asked] == [
        ("point-001", None), ("point-003", "point-001"), ("point-005", "point-003")]  # fmt: skip
    with pytest.raises(SceneError, match=r"--part = 1/3 .*2 chains of points along motion\.rotor\.speed; allowed: 1/2"):
        sweep(study, out=out, part=(1, 3))


def test_two_equal_parts_at_once_divide_their_points(tmp_path, runs):
    """No point is run twice: who comes second leaves what the first is at, and keeps what it has done."""
    study, out = study_of(tmp_path), tmp_path / "out"
    inside, go_on = threading.Event(), threading.Event()

    def waits(_):
        inside.set()
        assert go_on.wait(20.0)

    runs.acts = {0.1: waits}
    first = threading.Thread(target=sweep, args=(study,), kwargs={"out": out, "part": (1, 3)})
    first.start()
    assert inside.wait(20.0)
    (found,) = [point.folder for point in gather(study, out).missing if point.holder]
    with pytest.raises(OutputError, match=rf"point-000 .*in use by process {os.getpid()} on .*wait for it"):
        sweep(study, out=out, part=(1, 3), resume=True)
    go_on.set()
    first.join()
    assert found == "point-000" and runs.points == ["point-000", "point-003"]
    assert gather(study, out).done == 2 and not gather(study, out).failed  # what was in use has not failed


def test_new_points_of_a_changed_study_get_numbers_that_no_other_part_can_take(tmp_path, runs):
    out = tmp_path / "out"
    sweep(study_of(tmp_path, {FRICTION: [0.1, 0.3]}), out=out)
    study = study_of(tmp_path, {FRICTION: [0.2, 0.3, 0.25, 0.1]})
    parts = {which: list(read_study(study).numbers_of((which, 4))) for which in (1, 2, 3, 4)}
    assert parts == {1: [0], 2: [1], 3: [2], 4: [3]}
    for which in (3, 1, 2, 4):
        sweep(study, out=out, part=(which, 4), resume=True)
    assert runs.points[2:] == ["point-002", "point-004"]
    assert gather(study, out).done == 4


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--part", "4/3"], "--part = 4/3 is no part of 3; allowed: 1/3 to 3/3"),
        (["--part", "0/3"], "--part = '0/3' is not K/N, two whole numbers; allowed: 1/N to N/N"),
        (["--part", "three"], "is not K/N"),
        (["--part", "1/7"], "which has 6 points; allowed: 1/6 to 6/6, or fewer parts"),
        (["--part", "1/3", "--jobs", "2"], "--jobs = 2 is for a study in one process"),
        (["--gather", "--part", "1/3"], "--part cannot be combined with --gather; remove one of them"),
        (["--gather", "--resume"], "--resume cannot be combined with --gather"),
        (["--gather"], "holds no points of a study; name the folder that --out named"),
    ],
)
def test_options_that_mean_nothing_are_refused_before_a_folder_is_made(options, message, tmp_path, runs):
    answer = CliRunner().invoke(app, ["sweep", str(study_of(tmp_path)), "--out", str(tmp_path / "out"), *options])
    assert answer.exit_code == 2 and message in " ".join(answer.stderr.split()), answer.stderr
    assert not (tmp_path / "out").exists() and not runs.asked


def test_a_part_needs_a_common_folder_and_each_point_once(tmp_path, runs):
    answer = CliRunner().invoke(app, ["sweep", str(study_of(tmp_path)), "--part", "1/3"])
    assert answer.exit_code == 2 and "name it with --out" in answer.stderr
    with pytest.raises(ValueError, match="leave jobs and executor out"):
        sweep(study_of(tmp_path), out=tmp_path / "out", part=(1, 3), jobs=2)
    with pytest.raises(SceneError, match=r"contact\.friction = 0\.1 is listed twice"):
        sweep(study_of(tmp_path, {FRICTION: [0.1, 0.2, 0.1]}), out=tmp_path / "out", part=(1, 3))
    sweep(study_of(tmp_path), out=tmp_path / "out", part=(1, 3))
    with pytest.raises(OutputError, match=r"holds point-000, point-003, none of them a point of"):
        gather(study_of(tmp_path, {FRICTION: [0.7]}), tmp_path / "out")


def test_a_lease_of_a_process_of_this_machine_ends_with_it(tmp_path):
    program = f"import os; from pathlib import Path; from emclutch.results.lease import leased\n\
with leased(Path({str(tmp_path)!r}) / 'a', 'a'):\n    os._exit(9)"
    subprocess.run([sys.executable, "-c", program], cwd=ROOT, check=False)
    assert [path.name for path in tmp_path.iterdir()] == ["a.1.lease"] and lease_holder(tmp_path / "a") is None
    with leased(tmp_path / "a", "a"):
        assert lease_holder(tmp_path / "a") == f"process {os.getpid()} on {platform.node()}"
        assert [path.name for path in tmp_path.iterdir()] == ["a.2.lease"]
        with pytest.raises(FolderInUse, match="a is in use by process"), leased(tmp_path / "a", "a"):
            pass
    assert not list(tmp_path.iterdir())


def test_a_lease_of_another_machine_holds_while_it_is_renewed(tmp_path, monkeypatch):
    """Whether it is, is seen by watching it; no clocks are compared."""
    monkeypatch.setattr(lease, "EXPIRE_SECONDS", 0.2)
    monkeypatch.setattr(lease, "LOOK_SECONDS", 0.01)
    other = tmp_path / "a.3.lease"
    other.write_text('{"pid": 7, "host": "node7"}')
    os.utime(other, (1e9, 1e9))  # its clock is wrong by years
    stop = threading.Event()

    def renew():
        while not stop.wait(0.02):
            os.utime(other)

    renewing = threading.Thread(target=renew)
    renewing.start()
    try:
        with pytest.raises(FolderInUse, match="in use by process 7 on node7"), leased(tmp_path / "a", "a"):
            pass
    finally:
        stop.set()
        renewing.join()
    with leased(tmp_path / "a", "a"):
        assert [path.name for path in tmp_path.iterdir()] == ["a.4.lease"]


def test_of_several_who_take_an_expired_lease_one_gets_it(tmp_path, monkeypatch):
    monkeypatch.setattr(lease, "EXPIRE_SECONDS", 0.05)
    monkeypatch.setattr(lease, "LOOK_SECONDS", 0.01)
    (tmp_path / "a.1.lease").write_text('{"pid": 7, "host": "node7"}')
    start, end, got = threading.Barrier(8), threading.Event(), []

    def take():
        start.wait()
        try:
            with leased(tmp_path / "a", "a"):
                got.append(True)
                end.wait(20.0)
        except FolderInUse:
            got.append(False)

    takers = [threading.Thread(target=take) for _ in range(8)]
    for taker in takers:
        taker.start()
    while len(got) < 8 and any(taker.is_alive() for taker in takers):
        end.wait(0.01)
    end.set()
    for taker in takers:
        taker.join()
    assert sorted(got) == [False] * 7 + [True]


def test_a_lease_that_cannot_be_read_is_not_taken(tmp_path, monkeypatch):
    monkeypatch.setattr(lease, "EXPIRE_SECONDS", 0.05)
    monkeypatch.setattr(lease, "LOOK_SECONDS", 0.01)
    (tmp_path / "a.1.lease").write_text('{"pid": 7, "host": "node7"}')

    def refused(file):
        raise PermissionError(13, "Permission denied", str(file))

    monkeypatch.setattr(lease, "_renewed", refused)
    with pytest.raises(FolderInUse), leased(tmp_path / "a", "a"):
        pass
    assert [path.name for path in tmp_path.iterdir()] == ["a.1.lease"]


def test_a_lease_that_is_new_under_an_old_number_is_kept(tmp_path, monkeypatch):
    """Number 1 is given back, and taken by another, between the look at it and the making of number 2."""
    first, other = tmp_path / "a.1.lease", '{"pid": 8, "host": "node8"}'
    first.write_text('{"pid": 7, "host": "node7"}')

    def ends_and_another_comes(file, gives_up):
        first.write_text(other)
        return lease.ENDED

    monkeypatch.setattr(lease, "_state_of", ends_and_another_comes)
    with pytest.raises(FolderInUse, match="process 8 on node8"), leased(tmp_path / "a", "a"):
        pass
    assert first.read_text() == other and [path.name for path in tmp_path.iterdir()] == [first.name]


def test_a_lease_that_was_lost_is_not_given_back_for_another(tmp_path):
    with leased(tmp_path / "a", "a"):
        (tmp_path / "a.1.lease").write_text('{"pid": 8, "host": "node8"}')
    assert (tmp_path / "a.1.lease").is_file()


def test_a_lease_whose_server_does_not_answer_is_not_lost_and_ends_with_its_holder(tmp_path, monkeypatch):
    """That it could not be removed keeps nobody of the same process from taking it again."""
    monkeypatch.setattr(lease, "EXPIRE_SECONDS", 0.0)
    read = Path.read_text

    def no_answer(path, *how, **more):
        if path.suffix == ".lease":
            raise OSError(5, "Input/output error", str(path))
        return read(path, *how, **more)

    with leased(tmp_path / "a", "a") as held:
        with monkeypatch.context() as patched:
            patched.setattr(Path, "read_text", no_answer)
            held.renew()
            held.refuse_lost()
        with pytest.raises(FolderInUse), leased(tmp_path / "a", "a"):
            pass
        monkeypatch.setattr(Path, "read_text", no_answer)
    monkeypatch.undo()
    assert [path.name for path in tmp_path.iterdir()] == ["a.1.lease"] and lease_holder(tmp_path / "a") is None
    with leased(tmp_path / "a", "a"):
        assert [path.name for path in tmp_path.iterdir()] == ["a.2.lease"]


def test_who_waits_for_another_machine_gives_up_while_its_lease_is_watched(tmp_path, monkeypatch):
    monkeypatch.setattr(lease, "EXPIRE_SECONDS", 0.5)
    monkeypatch.setattr(lease, "LOOK_SECONDS", 0.01)
    monkeypatch.setattr(lease, "WAIT_SECONDS", 0.0)
    (tmp_path / "a.1.lease").write_text('{"pid": 7, "host": "node7"}')
    asked = iter([False])
    with leased_in_turn(tmp_path / "a", "a", lambda: next(asked, True)) as held:
        assert held is None
    assert [path.name for path in tmp_path.iterdir()] == ["a.1.lease"]


def test_a_stop_that_was_left_behind_is_told(tmp_path, runs):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / STOP).write_text("")
    with pytest.raises(OutputError, match="asks the points of this study to stop; remove it if"):
        sweep(study_of(tmp_path), out=tmp_path / "out", part=(1, 2))


def test_the_page_of_a_study_is_there_while_it_runs_and_is_gathered_from_parts(tmp_path, runs):
    """Seen from inside the second and the last of its points; a part leaves the page to who gathers."""
    study, seen = study_of(tmp_path), []
    page = tmp_path / "alone" / "index.html"
    runs.acts = {0.2: lambda _: seen.append(page.read_text()), 0.5: fails}
    with pytest.raises(RunError, match="the grains are gone"):
        sweep(study, out=page.parent)
    assert "1 of 6 points done" in seen[0] and 'http-equiv="refresh"' in seen[0]
    ended = page.read_text()
    assert "5 of 6 points done, 1 failed" in ended and "refresh" not in ended
    assert "point-004" in ended and "the grains are gone" in ended
    runs.acts, out = {}, tmp_path / "out"
    sweep(study, out=out, part=(1, 3), resume=True)
    assert not (out / "index.html").exists()
    gather(study, out)
    gathered = (out / "index.html").read_text()
    assert "2 of 6 points done" in gathered and gathered.count(">waiting<") == 4
