"""Points that processes run alone, as tasks of a job array, make the study of one process: same folders and tables."""

import pytest
from stand_in_runs import FRICTION, SPEED, folder_of, study_file
from typer.testing import CliRunner

import emclutch
from emclutch.cli.main import app
from emclutch.results.errors import Interrupted, RunError
from emclutch.studies.study import STOP
from emclutch.studies.sweep import collect, commands, sweep

SIX = [0.1, 0.2, 0.3, 0.4, 0.5, 0.6]


def study_of(folder, values=None, **own):
    return study_file(folder, values or {FRICTION: SIX}, **own)


def tables(folder):
    """Files of a study, without its log and its page, which have times."""
    found = (path for path in folder.iterdir() if path.is_file() and path.suffix not in (".log", ".html"))
    return {path.name: path.read_bytes() for path in found}


def fails(_):
    raise RunError("the grains are gone")


def test_points_alone_in_any_order_make_the_tables_of_one_process(tmp_path, runs):
    """Byte for byte; and collecting, or running a point, again changes nothing."""
    study = study_of(tmp_path, {"scene.seed": [1, 2], FRICTION: SIX[:3]})
    alone, out = sweep(study, out=tmp_path / "alone"), tmp_path / "out"
    runs.asked.clear()
    for number in (3, 5, 0, 2, 4, 1):
        assert sweep(study, out=out, point=number) == out
    assert runs.points == [3, 5, 0, 2, 4, 1] and not tables(out)
    for _ in range(2):
        assert collect(study, out).is_complete
        assert tables(out) == tables(alone) and {"study.csv", "seeds.csv"} <= set(tables(out))
    runs.asked.clear()
    sweep(study, out=out, point=2)
    sweep(study, out=out, resume=True)
    assert not runs.asked and sorted(path.name for path in out.iterdir()) == sorted(
        path.name for path in alone.iterdir()
    )


def test_a_study_goes_from_one_process_to_points_alone_and_back(tmp_path, runs):
    study, out = study_of(tmp_path), tmp_path / "out"

    def stops(_):
        raise KeyboardInterrupt

    runs.acts = {0.3: stops}
    with pytest.raises(Interrupted, match=r"stopped with 2 of 6 points done; continue with: .* --resume"):
        sweep(study, out=out)
    with pytest.raises(Interrupted, match=r"stopped with 0 of 1 points done; continue with: .* --point 2"):
        sweep(study, out=out, point=2)
    assert not (out / STOP).exists()
    runs.acts = {}
    sweep(study, out=out, point=4)
    sweep(study, out=out, resume=True)
    assert runs.points[4:] == [4, 2, 3, 5]
    assert tables(out)["study.csv"] == tables(sweep(study, out=tmp_path / "alone"))["study.csv"]


def test_what_is_missing_and_what_has_failed_is_told_with_a_code(tmp_path, runs):
    study, out = study_of(tmp_path), tmp_path / "out"

    def ask(*options):
        return CliRunner().invoke(app, ["sweep", str(study), "--out", str(out), *options])

    runs.acts = {0.4: fails}
    assert [ask("--point", str(k)).exit_code for k in (0, 1, 3)] == [0, 0, 1]
    answer = ask("--collect")
    assert answer.exit_code == 1 and "2 of 6 points done, 1 failed" in answer.stdout
    assert "the grains are gone" in tables(out)["failures.csv"].decode() and "waiting" in answer.stdout
    runs.acts = {}
    listed = ask("--list", "--threads", "2").stdout.splitlines()
    assert listed == [f"emclutch sweep {study} --out {out} --point {k} --threads 2" for k in (2, 3, 4, 5)]
    assert ask("--point", "3").exit_code == 0
    answer = ask("--collect")
    assert answer.exit_code == 3 and "3 of 6 points done" in answer.stdout and "failures.csv" not in tables(out)
    assert [ask("--point", str(k)).exit_code for k in (2, 4, 5)] == [0, 0, 0]
    assert ask("--collect").exit_code == 0
    answer = ask("--list")
    assert not answer.stdout and "all points are done" in answer.stderr


def test_points_that_hand_on_their_grains_are_one_line_and_wait_for_each_other(tmp_path, runs):
    values = {SPEED: ["1 rpm", "2 rpm"], FRICTION: [0.1, 0.2]}
    study, out = study_of(tmp_path, values, warm_start=SPEED), tmp_path / "out"
    begin = f"emclutch sweep {study} --out {out} --point"
    assert commands(emclutch.read_study(study), out) == [
        f"{begin} 0 && {begin} 2",
        f"{begin} 1 && {begin} 3",
    ]
    with pytest.raises(emclutch.OutputError, match=r"002_.* begins with the grains of 000_.*; run that point first"):
        sweep(study, out=out, point=2)
    for number in (0, 2):
        sweep(study, out=out, point=number)
    assert [(asked.point, asked.start) for asked in runs.asked] == [(0, None), (2, 0)]


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (["--point", "6"], "--point = 6 is no point of this study, which has 6; allowed: 0 to 5"),
        (["--point", "1", "--jobs", "2"], "--jobs cannot be combined with --point; remove one of them"),
        (["--point", "1", "--resume"], "--resume cannot be combined with --point"),
        (["--collect", "--point", "1"], "--collect cannot be combined with --point"),
        (["--list", "--dask", "a:1"], "--dask cannot be combined with --list"),
        (["--collect"], "holds no points of a study; name the folder of this study"),
        (["--dask", "a:1", "--jobs", "2"], "--jobs cannot be combined with --dask"),
    ],
)
def test_options_that_mean_nothing_are_refused_before_a_folder_is_made(options, message, tmp_path, runs):
    answer = CliRunner().invoke(app, ["sweep", str(study_of(tmp_path)), "--out", str(tmp_path / "out"), *options])
    assert answer.exit_code == 2 and message in " ".join(answer.stderr.split()), answer.stderr
    assert not (tmp_path / "out").exists() and not runs.asked
    answer = CliRunner().invoke(app, ["sweep", str(study_of(tmp_path)), "--point", "1"])
    assert answer.exit_code == 2 and "name it with --out" in answer.stderr


def test_points_of_another_study_are_not_collected_and_a_stop_that_was_left_behind_is_told(tmp_path, runs):
    out = tmp_path / "out"
    sweep(study_of(tmp_path), out=out, point=0)
    with pytest.raises(emclutch.OutputError, match=r"holds 000_friction=0\.1_.*, none of them a point of"):
        collect(study_of(tmp_path, {FRICTION: [0.7]}), out)
    (out / STOP).write_text("")
    with pytest.raises(emclutch.OutputError, match="asks the points of this study to stop; remove it if"):
        sweep(study_of(tmp_path), out=out, point=0)


@pytest.mark.parametrize("options", [[], ["--point", "1"]])
@pytest.mark.parametrize(
    ("given", "words"), [(0.3, "0.3 is not a list of values; write it in brackets"),
                         ([], "[] is an empty list: the study would have no points; give one value or more")],
)  # fmt: skip
def test_a_value_that_is_no_list_is_told_with_its_remedy(given, words, options, tmp_path, runs):
    study = study_file(tmp_path, {FRICTION: given, SPEED: ["1 rpm", "2 rpm"]})
    answer = CliRunner().invoke(app, ["sweep", str(study), "--out", str(tmp_path / "out"), *options])
    message = f"study.values.{FRICTION} = {words}"
    assert answer.exit_code == 2 and message in " ".join(answer.stderr.split())


def test_a_key_of_the_scene_in_the_table_of_the_study_is_told(tmp_path, runs):
    study = study_file(tmp_path, {FRICTION: [0.3]}, **{"coil.current": [1]})
    answer = CliRunner().invoke(app, ["sweep", str(study), "--out", str(tmp_path / "out")])
    assert answer.exit_code == 2 and "study.coil.current" in answer.stderr and "is not a known key" in answer.stderr


def test_a_point_alone_measures_no_accuracy(tmp_path, runs):
    study = study_file(tmp_path, {FRICTION: [0.1, 0.2]}, {"accuracy.target": "5 %", "time.average_from": "none"})
    with pytest.raises(emclutch.SceneError, match=r"accuracy\.target = .* run it first: emclutch accuracy"):
        sweep(study, out=tmp_path / "out", point=1)
    assert not runs.asked


def test_a_cluster_or_a_package_that_is_missing_is_told(tmp_path, monkeypatch):
    ask = ["sweep", str(study_of(tmp_path)), "--dask", "127.0.0.1:9", "--out", str(tmp_path / "out")]
    monkeypatch.setitem(__import__("sys").modules, "distributed", None)
    answer = CliRunner().invoke(app, ask)
    assert answer.exit_code == 2 and "pip install 'emclutch[dask]'" in " ".join(answer.stderr.split())
    assert not (tmp_path / "out").exists()


def test_the_page_of_a_study_is_there_while_it_runs_and_is_collected_from_points_alone(tmp_path, runs):
    """Seen from inside the second and the last of its points."""
    study, seen = study_of(tmp_path), []
    page = tmp_path / "alone" / "index.html"
    runs.acts = {0.2: lambda _: seen.append(page.read_text()), 0.5: fails}
    with pytest.raises(RunError, match="the grains are gone"):
        sweep(study, out=page.parent)
    assert "1 of 6 points done" in seen[0] and 'http-equiv="refresh"' in seen[0]
    ended = page.read_text()
    assert "5 of 6 points done, 1 failed" in ended and "refresh" not in ended
    assert folder_of(page.parent, 4).name in ended and "the grains are gone" in ended
    runs.acts, out = {}, tmp_path / "out"
    sweep(study, out=out, point=1)
    assert not (out / "index.html").exists()
    collect(study, out)
    collected = (out / "index.html").read_text()
    assert "1 of 6 points done" in collected and collected.count(">waiting<") == 5
