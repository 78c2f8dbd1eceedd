"""The table of `make bench`: its rows run, ratios, Chrono's times, and a line of the history that can be read back."""

import contextlib
import functools
import io
import json
import sys

import bench
import bench_rows
import magnetised_step
import pytest
import scene_a
import scene_a_rounds
from bench_rows import Row

from particles import DEM

TOY = {
    "start_rows": {"compiled": {"a function": "import numba; numba.njit(lambda x: x)(1)"}, "commands": (("--help",),)},
    "dem_rows": {},
    "dvi_rows": {"sizes": (200,), "warm_up": 1, "steps": 1},
    "field_rows": {"fields": ((2, 3.0), (3, 3.0)), "solenoid_size": 4.0},
    "moment_rows": {"n": 64},
    "step_rows": {"copies": 2, "values": {"particles.mass": "2 g", "field.size_factor": 3.0}, "time": 1e-6},
}


@pytest.fixture
def toy(monkeypatch, tmp_path):
    """`make bench` with little work: its main program, on the kinds that are given, and the rows that it leaves.

    What a round of ours of scene A does in a process of its own is done in this one; LAMMPS keeps its own, if it is
    here. The energy budget is kept: without it the DEM's kernel would be compiled once more, for this test alone.
    """
    for name, size in TOY.items():
        monkeypatch.setattr(bench_rows, name, functools.partial(getattr(bench_rows, name), **size))
    for module, name, value in (
        (bench_rows, "FOLDER", tmp_path),
        (bench_rows, "WINDOWS", {200: (5, 1)}),
        (bench_rows, "SAME_BED", {200: 0.5}),
        (magnetised_step, "KEPT", tmp_path),
        (scene_a, "DEM", lambda *given, **options: DEM(*given, **options | {"energy_budget": True})),
        (scene_a, "SETTLING", 10 * scene_a.TIME_STEP),
        (scene_a, "warm_up_steps", lambda n: 10),
    ):
        monkeypatch.setattr(module, name, value)
    answer = scene_a_rounds._answer

    def answer_here(command, threads, settings=None):
        if command[1] != scene_a.__file__:
            return answer(command, threads, settings)
        monkeypatch.setattr(sys, "argv", command[1:])
        with contextlib.redirect_stdout(io.StringIO()) as said:
            scene_a.main()
        return said.getvalue()

    monkeypatch.setattr(scene_a_rounds, "_answer", answer_here)

    def run(kind):
        history = tmp_path / "history.jsonl"
        monkeypatch.setattr(sys, "argv", ["bench.py", "--only", kind, "--rounds", "1", "--sizes", "200",
                                          "--history", str(history)])  # fmt: skip
        bench.main()
        return json.loads(history.read_text())["rows"]

    return run


@pytest.mark.parametrize(
    ("kind", "rows"), [("start", 2), ("dem", 2), ("dvi", 1), ("field", 3), ("moments", 2), ("step", 1)]
)
def test_each_kind_of_row_runs_at_toy_size(toy, kind, rows):
    """It has a time of ours; a peer that is not installed is said to be absent, and its time is empty."""
    found = toy(kind)
    assert len(found) >= rows  # more threads and more ways of a peer that is here
    for row in found:
        assert row["ours"] > 0.0 and row["n"] > 0
        assert (row["theirs"] is None) == row["peer"].endswith(("(not here)", "none"))
        assert row["theirs"] is None or row["theirs"] > 0.0


def test_copies_of_a_sector_divide_the_ring():
    """The shipped clutch has 273 sectors, of which eight do not make one that divides it."""
    assert [magnetised_step.whole_copies(n, 8) for n in (240, 273, 16, 8, 7, 1)] == [8, 7, 8, 4, 1, 1]


def test_a_peer_that_takes_twice_the_time_is_half_as_fast():
    row = Row("work", 10, 1, "processor", "ms", 2.0, "peer", 4.0)
    assert row.faster == 2.0
    assert Row("work", 10, 1, "processor", "ms", 2.0, "peer (not here)").faster is None


def test_chrono_is_scaled_by_the_speed_of_lammps():
    """On a machine where LAMMPS is twice as fast, Chrono takes half the time; without LAMMPS its time is as it was."""
    reported, scaled = bench_rows.chrono(1000, 0.5 * bench_rows.CHRONO_LAMMPS_NS)
    assert scaled == pytest.approx(0.5 * bench_rows.CHRONO_MS[1000])
    assert reported == "Chrono, scaled"
    assert bench_rows.chrono(1000, None) == ("Chrono, not scaled", bench_rows.CHRONO_MS[1000])


def test_every_word_of_a_row_stands_under_its_heading():
    line = Row("work", 10, 2, "wall", "ms a step", 2.0, "peer", 4.0, "remark").in_words()
    for heading, value in (("what", "work"), ("clock", "wall"), ("unit", "ms a step"), ("beside", "peer")):
        assert line.index(value) == bench.HEADER.index(heading)
    assert line.index("remark") > len(bench.HEADER)


def test_a_sitting_is_one_line_that_can_be_read_back():
    rows = [Row("a", 1, 1, "wall", "s", 1.0, "peer", 3.0, "remark"), Row("b", 2, 2, "wall", "s", 1.0, "none")]
    line = bench.as_line({"date": "today", "load_before": 0.5}, rows)
    assert "\n" not in line
    read = json.loads(line)
    assert [row["faster"] for row in read["rows"]] == [3.0, None]
    assert read["date"] == "today" and read["load_after"] >= 0.0
