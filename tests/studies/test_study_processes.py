"""A study of real runs: on two processes as in this one, and with grains that are handed from point to point."""

from pathlib import Path

import pandas
import pytest
from stand_in_runs import folder_of

import emclutch
from emclutch.results.checkpoint import read_checkpoint
from emclutch.results.errors import Interrupted
from emclutch.results.study_result import load_study

THESIS = Path(__file__).resolve().parents[2] / "cases" / "thesis"
TOY = {
    "particles.count": 8, "time.end": "10 ms", "time.window": "2 ms", "output.snapshots": 0, "output.pictures": False,
    "output.formats": [], "accuracy.replicas": 1,
}  # fmt: skip
SPEED = "motion.rotor.speed"


@pytest.fixture(scope="module")
def studied(tmp_path_factory):
    """Two seeds at two speeds, the second with the grains of the first; in this process, one after the other."""
    study = emclutch.read_study(THESIS / "centrifugal_speeds.toml")
    values = {SPEED: ["500 rpm", "250 rpm"], "scene.seed": [1, 2]}
    small = study.model_copy(update={"set": TOY, "values": values, "warm_start": SPEED})
    small._path = study.path
    return small, emclutch.sweep(small, out=tmp_path_factory.mktemp("study") / "alone")


@pytest.mark.slow
def test_processes_change_nothing(studied, tmp_path):
    study, alone = studied
    folder = emclutch.sweep(study, out=tmp_path / "two", jobs=2)
    for name in ("study.csv", "seeds.csv", "torque_vs_speed.csv"):
        first, second = (pandas.read_csv(path / name, dtype=str) for path in (alone, folder))
        if name == "study.csv":
            first, second = first.drop(columns="seconds"), second.drop(columns="seconds")
        assert first.equals(second), name
    for number in range(4):  # bit for bit
        first, second = (read_checkpoint(folder_of(path, number) / "checkpoint.h5") for path in (alone, folder))
        assert (first["dem"]["position_radius"] == second["dem"]["position_radius"]).all()


def test_grains_go_on_where_the_point_before_has_left_them(studied):
    _, folder = studied
    table = pandas.read_csv(folder / "study.csv")
    assert table["started_from"].fillna("").tolist() == ["", "", *(folder_of(folder, k).name for k in (0, 1))]
    origin = emclutch.load_result(folder_of(folder, 2)).folder.read_provenance()["grains_from"]
    before, after = (emclutch.load_result(folder_of(folder, k)).history for k in (0, 2))
    assert origin["time"] == pytest.approx(before["time"].iloc[-1]) and len(origin["checkpoint_sha256"]) == 64
    assert after["time"].iloc[0] == pytest.approx(2e-3, rel=0.01)  # time restarts
    # shot that 500 rpm has thrown out still flies: from rest, 250 rpm would give it a fourth of that at most
    assert after["kinetic_energy"].iloc[0] > 0.3 * before["kinetic_energy"].iloc[-1]


def test_a_run_that_began_with_others_grains_is_resumed_bit_for_bit(studied, tmp_path):
    _, folder = studied
    case = emclutch.load_case(folder_of(folder, 2) / "case.toml")
    short = {"output.folder": None, "time.end": "4 ms"}
    emclutch.run(case.with_values(short), out=tmp_path / "run", start=folder_of(folder, 0))
    emclutch.run(case, out=tmp_path / "run", resume=True)
    whole, parts = (read_checkpoint(path / "checkpoint.h5")["dem"] for path in (folder_of(folder, 2), tmp_path / "run"))
    assert whole.keys() == parts.keys()
    assert [name for name in whole if (whole[name] != parts[name]).any()] == []


def test_killed_before_its_first_checkpoint_a_run_begins_with_others_grains_again(studied, tmp_path):
    class Killed:
        def update(self, fraction, text):
            if text.startswith("packing"):
                raise KeyboardInterrupt

    _, folder = studied
    short = {"output.folder": None, "time.end": "2 ms"}
    case = emclutch.load_case(folder_of(folder, 2) / "case.toml").with_values(short)
    with pytest.raises(Interrupted):
        emclutch.run(case, out=tmp_path / "run", start=folder_of(folder, 0), progress=Killed())
    emclutch.run(case, out=tmp_path / "run", resume=True)
    emclutch.run(case, out=tmp_path / "whole", start=folder_of(folder, 0))
    whole, parts = (read_checkpoint(tmp_path / name / "checkpoint.h5")["dem"] for name in ("whole", "run"))
    assert [name for name in whole if (whole[name] != parts[name]).any()] == []


def test_grains_of_another_scene_or_of_no_checkpoint_are_refused(studied, tmp_path):
    _, folder = studied
    case = emclutch.load_case(folder_of(folder, 0) / "case.toml")
    other = case.with_values({"particles.count": 7})
    with pytest.raises(emclutch.OutputError, match=r"of another scene \(particles\.count: 8 -> 7\)"):
        emclutch.run(other, out=tmp_path / "run", start=folder_of(folder, 0))
    with pytest.raises(emclutch.OutputError, match=r"no grains to start from in .*no checkpoint\.h5"):
        emclutch.run(case, out=tmp_path / "run", start=tmp_path)
    assert not (tmp_path / "run").exists()


def test_grains_are_handed_on_along_a_value_that_leaves_them_as_they_are(tmp_path):
    text = f'[study]\ncase = "{THESIS / "centrifugal_held.toml"}"\nwarm_start = "particles.count"\n[study.values]\n'
    (tmp_path / "study.toml").write_text(text + '"particles.count" = [2, 3]\n')
    with pytest.raises(emclutch.SceneError, match=r"study\.warm_start = .*allowed in this study: none"):
        emclutch.read_study(tmp_path / "study.toml")
    text = text.replace("particles.count", SPEED)
    (tmp_path / "study.toml").write_text(
        text + f'"{SPEED}" = ["1 rpm", "2 rpm"]\n[study.set]\n"output.checkpoint" = false'
    )
    with pytest.raises(emclutch.SceneError, match=r"output\.checkpoint = false keeps no grains to start from"):
        emclutch.read_study(tmp_path / "study.toml")


def test_a_point_that_was_killed_before_its_pictures_gets_them(tmp_path):
    """It is done by its summary; resumed, the study draws what its pictures are of, the same as they were."""
    study = emclutch.read_study(THESIS / "centrifugal_speeds.toml")
    with_pictures = {**TOY, "time.end": "2 ms", "output.pictures": True}
    small = study.model_copy(update={"set": with_pictures, "values": {SPEED: ["500 rpm"]}, "warm_start": None})
    small._path = study.path
    folder = emclutch.sweep(small, out=tmp_path / "study")
    names = ("grains.png", "torque.png")
    drawn = {name: (folder_of(folder, 0) / name).read_bytes() for name in names}
    for name in (*names, "row.json"):
        (folder_of(folder, 0) / name).unlink()
    emclutch.sweep(small, out=folder, resume=True)
    assert {name: (folder_of(folder, 0) / name).read_bytes() for name in names} == drawn
    assert "had no pictures" in (folder / "study.log").read_text()
    read = load_study(folder)
    assert (read.title, read.total, list(read.results())) == (study.title, 1, [folder_of(folder, 0).name])
